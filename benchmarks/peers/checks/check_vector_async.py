"""Check several environments, each in a forked worker."""

import gymnasium
import numpy as np

env = gymnasium.vector.AsyncVectorEnv([lambda: gymnasium.make("CartPole-v1")] * 3, context="fork")
env.action_space.seed(1)
observations, _ = env.reset(seed=1)
for _ in range(50):
    observations, rewards, *_ = env.step(env.action_space.sample())
    assert observations.shape == (3, 4)
    assert np.isfinite(observations).all()
    assert rewards.shape == (3,)
env.close()
print("check vector_async ok")
