"""An environment of trees of bodies that are tied together, whose constraint Jacobian is sparse."""

import gymnasium
import mujoco
import numpy as np


def model(seed):
    """Make bodies that hang on others at random, some tied together."""
    random = np.random.RandomState(seed)
    count = random.randint(6, 25)
    parents = [-1 if (i == 0 or random.rand() < 0.25) else random.randint(0, i) for i in range(count)]

    def body(number, free):
        place = random.uniform(-0.2, 0.2, 3) + np.array([0, 0, 0.3 if free else 0])
        text = '<body name="b{}" pos="{} {} {}">'.format(number, *place)
        axis = '<joint type="hinge" axis="{} {} {}" damping=".1"/>'
        text += "<freejoint/>" if free and random.rand() < 0.5 else axis.format(*random.standard_normal(3))
        below = [other for other in range(count) if parents[other] == number]
        return text + '<geom type="sphere" size=".08"/>' + "".join(body(one, False) for one in below) + "</body>"

    ties = [random.choice(count, 2, replace=False) for _ in range(random.randint(0, 4))]
    tied = "".join('<connect body1="b{}" body2="b{}" anchor="0 0 0"/>'.format(*pair) for pair in ties)
    roots = "".join(body(number, True) for number in range(count) if parents[number] < 0)
    return (
        '<mujoco><option jacobian="sparse" timestep="0.002"/><worldbody><geom type="plane" size="5 5 .1"/>'
        + roots
        + "</worldbody><equality>"
        + tied
        + "</equality></mujoco>"
    )


class Tangled(gymnasium.Env):
    """An environment of nothing but the simulation."""

    def __init__(self, seed=0, render_mode=None):
        self.model = mujoco.MjModel.from_xml_string(model(seed))
        self.data = mujoco.MjData(self.model)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (self.model.nq,), np.float64)
        self.action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        """Start where the model does."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        return self.data.qpos.copy(), {}

    def step(self, action):
        """Make a step."""
        mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy(), 0.0, False, False, {}
