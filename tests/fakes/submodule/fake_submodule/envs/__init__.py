import fake_healthy
import gymnasium


class Below(fake_healthy.Healthy):
    pass


gymnasium.register(id="Below-v2", entry_point=Below)
