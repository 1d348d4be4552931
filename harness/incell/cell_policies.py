"""Choose actions by the policy that a case names, and start its episodes."""

import numpy as np

from .cell_action_space import action_space_of
from .cell_errors import library, skip
from .cell_flat import flat


class LinearPolicy:
    """Multiplies the normalised observation with weights; of choices the one with the largest value is taken."""

    ends_with_success = False

    def __init__(self, env, case):
        given = case["policy"]
        self.env = env
        self.space = action_space_of(env)
        self.weights = np.array(given["weights"], dtype=float)
        self.mean = np.array(given["mean"], dtype=float)
        self.deviation = np.array(given["deviation"], dtype=float)
        self.seed = case["seed"]

    def begin(self, number):
        """Start an episode and return the observation."""
        observation = self.env.reset(self.seed + number)
        size = flat(observation).size
        if size != self.mean.size:
            skip("policy.size", size=size, wanted=self.mean.size)
        return observation

    def act(self, observation):
        """Return the action for an observation."""
        values = self.weights.dot((flat(observation) - self.mean) / self.deviation)
        if self.space.is_discrete:
            return int(np.argmax(values))
        return self.space.as_action(np.clip(values, self.space.low, self.space.high))


class ScriptedPolicy:
    """Plays a task of Meta-World by the policy that Meta-World brings for it, over tasks that are made from seeds.

    A seed of reset() changes nothing there. A task holds the places of its objects; those of one seed are drawn from
    NumPy's oldest generator, which gives the same numbers on every release, before any simulator moves.
    """

    ends_with_success = True

    def __init__(self, env, case):
        import metaworld
        from metaworld.policies import ENV_POLICY_MAP

        self.metaworld = metaworld
        self.name = case["kwargs"]["env_name"]
        self.raw = env.raw.unwrapped  # the wrappers choose tasks by themselves
        self.env = env.wrap_single(self.raw)
        self.space = action_space_of(self.env)
        self.make = ENV_POLICY_MAP[self.name]
        self.seed = case["seed"]
        self.tasks = []

    def begin(self, number):
        """Start an episode and return the observation."""
        with library:
            while len(self.tasks) <= number:
                self.tasks.extend(self.metaworld.MT1(self.name, seed=self.seed).train_tasks)
                self.seed += 1
            self.raw.set_task(self.tasks[number])
            self.policy = self.make()
        return self.env.reset()

    def act(self, observation):
        """Return the action for an observation."""
        with library:
            values = self.policy.get_action(observation)
        return self.space.as_action(np.clip(values, self.space.low, self.space.high))


POLICIES = {"linear": LinearPolicy, "metaworld": ScriptedPolicy}


def play(policy, number):
    """Play one episode and return its first observation, its return, its length, and whether it succeeded.

    That is 1 or 0 as `success` of an info says, -1 where no info has it.
    """
    observation = policy.begin(number)
    start, total, length, success = flat(observation), 0.0, 0, -1
    while True:
        observation, reward, terminated, truncated = policy.env.step(policy.act(observation))
        total, length = total + float(reward), length + 1
        flag = policy.env.info.get("success")
        if flag is not None:
            success = max(success, int(bool(flag)))
        if terminated or truncated or (success == 1 and policy.ends_with_success):
            return start, total, length, success
