import fake_healthy
import gymnasium


class WrongArity(fake_healthy.Healthy):
    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, terminated or truncated, info


gymnasium.register("WrongArity-v0", WrongArity)
