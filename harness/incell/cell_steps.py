"""Step an environment from each state of a bank, and from twins of it, and keep all that comes of it as arrays."""

import random

import numpy as np

from .cell_action_space import action_space_of
from .cell_episode import open_single
from .cell_errors import library
from .cell_flat import flat, precision_of
from .cell_physics import physics_of

TWINS, EXACT_TWINS = 16, 4
CONTACT_TWINS, LARGE_NOISE = 199, {"float64": 1e-9, "float32": 1e-3}
"""Twins of a state near the making or breaking of a contact: twins end in other contacts, or far from each other."""

LAST_BITS, SMALL = 4e-16, 1e-3
"""Relative difference of two steps that are equal but for the last bits; numbers below the second count as that."""

RESET_SEEDS = 50
EPISODES, LONGEST_EPISODE = 5, 200
MOVED_ACTIONS, UNMOVED = ("action", "state.past"), ("state.time", "state.seed", "state.count")
"""Parts of a state that a twin moves unless they are choices, and parts that it never moves."""

LARGE_OBSERVATION, OBSERVED_EVERY = 30, 2
"""An observation of more numbers than the first is kept of every second state: its rounding fills most of a report."""

REPEATED = 30
"""States, of all kinds, that are stepped from once more at the end, and once more in a copy of the environment."""


class Stepper:
    """Steps one environment from given states."""

    def __init__(self, env, physics):
        self.env = env
        self.physics = physics
        self.space = action_space_of(env)
        self.keys = {}
        self.pairs = {}

    def outputs(self, bank):
        """Return what every state leads to: arrays by name with one row a state."""
        rows = [self._row(bank, number) for number in range(len(bank["action"]))]
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def unrepeated(self, bank, outputs, copy=None):
        """Return the names of outputs that are others when some states are stepped from again, in the other order.

        A `copy` steps from them in this one's place: what an environment keeps beside its state differs between two.
        """
        stepper = copy or self
        stepper.keys, stepper.pairs = self.keys, self.pairs
        count = len(bank["action"])
        unlike = set()
        for number in reversed(range(0, count, max(1, count // REPEATED))):
            for name, again in stepper._row(bank, number).items():
                if np.asarray(again).tobytes() != outputs[name][number].tobytes():
                    unlike.add(name)
        return unlike

    def entries(self):
        """Return what the numbers in the outputs `info` and `contacts` stand for."""
        contacts = [["-".join(map(str, pair)) for pair in met] for met in self.pairs]
        return {"info": [list(names) for names in self.keys], "contacts": contacts}

    def fits(self, bank):
        """Return whether the states of a bank are states of this environment, and its actions valid."""
        sizes = {name: values.size for name, values in self.physics.read().items()}
        given = {name[6:]: values.shape[1] for name, values in bank.items() if name.startswith("state.")}
        return given == sizes and bank["action"].shape[1] == self.space.size

    def describe(self, env):
        """Return the facts of the environment that are no arrays."""
        physics, observation = self.physics, env.reset(0)
        facts = {
            "method": physics.method,
            "spaces": env.describe(),
            "action": self.space.describe(),
            "sizes": {name: int(values.size) for name, values in physics.read().items()},
            "parts": list(physics.parts),
            "unset": list(physics.unset),
            "precision": physics.precision.name,
            "observation_precision": precision_of(observation),
        }
        if physics.stages:
            facts["model"] = physics.model_sums()
            facts["starts"] = physics.stages.names_of_starts(physics.substeps)
            facts["geometries"] = physics.stages.geometries()
        return facts

    def _row(self, bank, number):
        physics = self.physics
        state = state_of(bank, number)
        action = self.space.as_action(bank["action"][number])
        row = {}
        if physics.warm_starts:
            warm = bank["warm"][number]
            row["step"] = self.simulated(state)
            row["warm_step"] = self.simulated(state, warm)
            row["exact_step"] = self.exactly_simulated(state)
            row["stages"] = self.stages(state, action)
        physics.write(state)
        if physics.stages:
            row["rows"] = physics.stages.rows()
        row["contacts"] = np.array(self.pairs.setdefault(physics.contacts(), len(self.pairs)))
        after, info = self.advance(state, action)
        row["info"] = np.array(self.keys.setdefault(tuple(sorted(map(str, info))), len(self.keys)))
        row.update(after)
        return row

    def advance(self, state, action):
        """Make one step of the environment from a state: its outputs by name, and the info."""
        self.physics.write(state)
        with library:
            result = self.physics.step(action)
        observation, reward, info = result[0], result[1], result[-1]
        ended = (result[2], result[3] if len(result) > 4 else False)  # before gym 0.26 there is one flag
        return {
            "state": self.physics.outcome(),
            "observation": flat(observation),
            "reward": np.array(float(reward)),
            "ended": np.array([float(bool(value)) for value in ended]),
        }, info

    def simulated(self, state, warm=None):
        """Make one step of the simulator from a state and return the next one: positions, velocities, activations."""
        self.physics.write(state, warm)
        self.physics.simulate()
        now = self.physics.read()
        return np.concatenate([now[name] for name in ("qpos", "qvel", "act") if name in now])

    def exactly_simulated(self, state):
        """Make one step whose solver iterates until more iterations change nothing but the last bits."""
        before = None
        for times in self.physics.exact_iterations:
            with self.physics.exactly(times):
                after = self.simulated(state)
            if before is not None and np.all(np.abs(after - before) <= LAST_BITS * np.maximum(np.abs(after), SMALL)):
                break
            before = after
        return after

    def stages(self, state, action, further=True):
        """Return the sums of the stages at the start of each step of the simulator: (starts, stages).

        First come the state itself and the inner stages from it, then the further steps of one environment step.
        """
        physics, stages = self.physics, self.physics.stages
        physics.write(state)
        physics.data.ctrl[:] = self._control(state, action)
        outputs = [stages.forward()]
        if not further:
            return np.array(outputs)
        outputs.extend(stages.inner())
        physics.write(state)
        physics.data.ctrl[:] = self._control(state, action)
        for _ in range(physics.substeps - 1):
            physics.simulate()
            outputs.append(stages.forward())
        return np.array(outputs)

    def _control(self, state, action):
        """Return the controls that an environment makes of an action, as seen after a step with it."""
        return action if np.shape(action) == self.physics.data.ctrl.shape else state.get("ctrl", np.zeros(0))


def step_all(probe, bank, stepper):
    """Return what every state leads to, and facts: what of it is another when it is done again, or in a copy."""
    outputs = stepper.outputs(bank)
    unlike = stepper.unrepeated(bank, outputs)
    if not stepper.physics.pure:
        with open_single(probe) as other:
            other.reset(probe.case["seed"])
            unlike |= stepper.unrepeated(bank, outputs, Stepper(other, physics_of(other)))
    return outputs, dict(stepper.entries(), repeats=not unlike, unrepeated=sorted(unlike))


def state_of(bank, number):
    """Return one state of a bank."""
    return {name[6:]: values[number] for name, values in bank.items() if name.startswith("state.")}


def scales(outputs):
    """Return the typical size of each number of each output: the median, a millionth of the largest at least."""
    sizes = {}
    for name, values in outputs.items():
        size = np.median(np.abs(values), axis=0)
        sizes[name] = np.maximum(size, 1e-6 * max(1e-300, float(np.max(np.abs(values))) if values.size else 1.0))
    return sizes


def gap(first, second, scale):
    """Return the largest difference of two outputs, in the typical size of each number, or its own if larger."""
    size = np.maximum(scale, np.maximum(np.abs(first), np.abs(second)))
    difference = np.abs(np.asarray(first) - np.asarray(second)) / size
    return float(np.max(np.where(np.isnan(difference), np.inf, difference))) if difference.size else 0.0


def noise(stepper, bank, outputs, seed):
    """Return the largest difference that twins of each state make, by output: a twin has each number moved by one ulp.

    An ulp is that of the number's typical size in the bank, in the precision that is computed in. The sums of stages
    have a row each, (states, stages), all others are (states,).
    """
    dice, physics, size = random.Random(seed), stepper.physics, scales(outputs)
    count = len(bank["action"])
    worst = {
        name: np.zeros(count) for name in ("step", "exact_step", "state", "observation", "reward") if name in outputs
    }
    if "stages" in outputs:
        worst["stages"] = np.zeros((count, outputs["stages"].shape[2]))
    for number in range(count):
        turn, near_contact, met = 0, False, None
        while turn < (CONTACT_TWINS if near_contact else TWINS):
            twin = _twin(stepper, bank, number, dice)
            state, action = state_of(twin, 0), stepper.space.as_action(twin["action"][0])
            row = stepper.advance(state, action)[0]
            contacts = physics.contacts()
            near_contact, met = near_contact or met not in (None, contacts), contacts
            if physics.warm_starts:
                row["step"] = stepper.simulated(state)
                sums = stepper.stages(state, action, further=False)
                for stage in range(sums.shape[1]):
                    error = gap(sums[0, stage], outputs["stages"][number, 0, stage], size["stages"][0, stage])
                    worst["stages"][number, stage] = max(worst["stages"][number, stage], error)
                if turn < EXACT_TWINS:
                    row["exact_step"] = stepper.exactly_simulated(state)
            for name, errors in worst.items():
                if name in row:
                    errors[number] = max(errors[number], gap(row[name], outputs[name][number], size[name]))
            near_contact = near_contact or worst["state"][number] > LARGE_NOISE[physics.precision.name]
            turn += 1
    return worst


def _twin(stepper, bank, number, dice):
    """Return one state of the bank, as a bank of one, with every number moved by one ulp up or down."""
    eps = float(np.finfo(stepper.physics.precision).eps)
    twin = {}
    for name, values in bank.items():
        row = values[number : number + 1]
        if name in MOVED_ACTIONS:
            moved = not stepper.space.is_discrete
        else:
            moved = name.startswith("state.") and name not in UNMOVED
        if moved:
            signs = np.array([1.0 if dice.random() < 0.5 else -1.0 for _ in range(row.size)]).reshape(row.shape)
            row = row + eps * np.maximum(np.median(np.abs(values), axis=0), np.abs(row)) * signs
        twin[name] = row
    return twin


def starts(env, space):
    """Return the observations of seeded resets, one row a seed, and the lengths of some episodes."""
    observations = np.array([flat(env.reset(seed)) for seed in range(RESET_SEEDS)])
    lengths = []
    for seed in range(EPISODES):
        dice = random.Random(seed)
        env.reset(seed)
        length = 0
        while length < LONGEST_EPISODE:
            length += 1
            if any(env.step(space.as_action(space.draw(dice)))[2:4]):
                break
        lengths.append(length)
    return observations, lengths
