"""Check one environment: seeded episodes, twice the same."""

import gymnasium
import numpy as np

STEPS = 100


def trajectory():
    """Return the observations and rewards of a seeded rollout."""
    env = gymnasium.make("CartPole-v1")
    env.action_space.seed(1)
    observation, _ = env.reset(seed=1)
    seen = [observation]
    for _ in range(STEPS):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        seen.append(observation)
        if terminated or truncated:
            observation, _ = env.reset()
            seen.append(observation)
    env.close()
    return np.stack(seen)


assert np.array_equal(trajectory(), trajectory())
print("check single ok")
