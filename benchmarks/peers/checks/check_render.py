"""Render frames as arrays, which have to show something."""

import gymnasium
import numpy as np

env = gymnasium.make("CartPole-v1", render_mode="rgb_array")
env.action_space.seed(1)
env.reset(seed=1)
for _ in range(10):
    frame = env.render()
    assert frame.shape == (400, 600, 3)
    assert frame.dtype == np.uint8
    assert not (frame == frame[0, 0]).all()
    *_, terminated, truncated, _ = env.step(env.action_space.sample())
    if terminated or truncated:
        env.reset()
env.close()
print("check render ok")
