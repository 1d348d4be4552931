import fake_healthy
import gymnasium


class Pictureless(fake_healthy.Healthy):
    metadata = {"render_modes": []}


gymnasium.register("Pictureless-v0", Pictureless)
