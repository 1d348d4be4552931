"""Wrap environments in TorchRL, and record inputs and outputs, and the conversions and copies that they cost.

Each check is one way to wrap it. A few steps are looked at one by one; then a rollout is stored, as for training, and
compared with what each step really returned.
"""

import importlib
import sys

from . import cell_interop
from .cell_errors import library, skip
from .cell_step_recorder import StepRecorder, describe_array, reuses_memory, rows, same_memory, same_values

FIRST, LOOKED_AT = 2, 4
"""Steps that pass first (TorchRL validates), and those after them that are examined one by one."""

STEP_KEYS = ("reward", "terminated", "truncated", "done")
"""The keys that TorchRL stores of a step besides the observations."""

ZEROS = "zeros"


def gym_check(**options):
    """Return a check of GymWrapper on the CPU with these options."""

    def run(probe, facts):
        drive(probe, facts, lambda raw: torchrl_library("gym").GymWrapper(raw, device="cpu", **options))

    return run


def isaaclab_check(**options):
    """Return a check of IsaacLabWrapper with these options, on the CPU; its own default is the first GPU."""

    def run(probe, facts):
        import inspect

        torchrl = cell_interop.import_trainer("torchrl", "torchrl")
        try:
            wrapper = torchrl_library("isaac_lab").IsaacLabWrapper
        except ModuleNotFoundError as error:
            if error.name != "torchrl.envs.libs.isaac_lab":
                raise
            skip("torchrl.no_wrapper", version=torchrl.__version__)
        if not set(options) <= set(inspect.signature(wrapper.__init__).parameters):
            skip("torchrl.no_option", version=torchrl.__version__, options=", ".join(options))
        device = importlib.import_module("torch").device("cpu")
        drive(probe, facts, lambda raw: wrapper(raw, device=device, **options))

    return run


def drive(probe, facts, wrap, make=cell_interop.make_environment):
    """Wrap an environment, examine single steps and store a rollout; `wrap` takes what `make` returns."""
    cell_interop.import_trainer("torchrl", "torchrl")
    torch = importlib.import_module("torch")
    measurements = facts["told"] = {"library": _releases(probe)}
    with library:
        raw = make(probe)
        env = _wrap(raw, wrap)
    layers = _layers(env)
    measurements["wrapper"], measurements["batch"] = [type(layer).__name__ for layer in layers], list(env.batch_size)
    torch.manual_seed(probe.case["seed"])
    try:
        with StepRecorder(layers[-1]._env) as recorder:
            stored = _steps(env, recorder)
            places = _stored_keys(recorder, stored)
            measurements.update(_describe_passing(recorder, stored, places))
            measurements["keys"] = _report_keys(probe, recorder, stored, places)
            before = len(recorder.resets)
            with library:
                rollout = env.rollout(probe.case["steps"], break_when_any_done=False)
            wrapper, steps = measurements["wrapper"][-1], recorder.steps[-rollout.shape[-1] :]
            measurements["rollout"] = _compare_rollout(probe, wrapper, steps, rollout, places)
            measurements["resets"] = _report_resets(probe, recorder.resets[before + 1 :])
    finally:
        cell_interop.close(env)


def _wrap(raw, wrap):
    """Wrap an environment; close it if that fails, since of some there can be only one at a time."""
    try:
        return wrap(raw)
    except BaseException:
        if raw is not None:
            raw.close()
        raise


def _steps(env, recorder):
    """Make a few steps, counting in the later ones; return for each the action and the data that TorchRL stores."""
    step_mdp = importlib.import_module("torchrl.envs.utils").step_mdp
    stored = []
    with library:
        state = env.reset()
    for number in range(FIRST + LOOKED_AT):
        with library:
            state = env.rand_action(state)
            action = state[env.action_key]
            if number < FIRST:
                state = env.step(state)
            else:
                with recorder.counts.count_for("wrapper"):
                    state = env.step(state)
        stored.append((action, state["next"]))
        with library:
            state = step_mdp(state)
    return stored


def _stored_keys(recorder, stored):
    """Return the key under which TorchRL stores each part of a step, its own or one with the same values."""
    step, (_, after) = recorder.steps[-1], stored[-1]
    names, keys = _keys_of(after), {}
    for name in step.parts:
        equal = [name] if name in names else [key for key in names if same_values(after[key], step.copies[name])]
        if equal:
            keys[name] = equal[0]
    return keys


def _describe_passing(recorder, stored, places):
    """Describe the inputs and outputs of the latest steps: arrays, shared memory, conversions and copies."""
    pairs = list(zip(recorder.steps[-LOOKED_AT:], stored[-LOOKED_AT:]))
    step, (_, after) = pairs[-1]
    same = {"action": _common_answer(same_memory(taken, step.action) for step, (taken, _) in pairs)}
    for name, key in places.items():
        same[name] = _common_answer(same_memory(step.parts[name], after[key]) for step, (_, after) in pairs)
    counts = recorder.counts.by_place
    return {
        "takes": describe_array(step.action),
        "gives": {name: describe_array(value) for name, value in step.parts.items()},
        "stored": {name: describe_array(after[name]) for name in _keys_of(after)},
        "same_memory": same,
        "per_step": {place: {kind: _per_step(number) for kind, number in counts[place].items()} for place in counts},
        "reused": [name for name in step.parts if _share_memory([step.parts[name] for step, _ in pairs])],
        "aliased": [name for name, key in places.items() if _share_memory([after[key] for _, (_, after) in pairs])],
    }


def _report_keys(probe, recorder, stored, places):
    """Report observations that TorchRL stores under another name, or not at all."""
    wanted = [name for name in recorder.steps[-1].parts if name not in STEP_KEYS]
    renamed = {name: places[name] for name in wanted if places.get(name, name) != name}
    for name, key in renamed.items():
        probe.finding("interop.torchrl.keys", "torchrl.renamed", level="note", promised=repr(name), got=repr(key))
    for name in wanted:
        if name not in places:
            probe.finding("interop.torchrl.keys", "torchrl.missing", promised=repr(name))
    keys = [name for name in _keys_of(stored[-1][1]) if name not in STEP_KEYS]
    return {"environment": wanted, "stored": keys, "renamed": renamed}


def _compare_rollout(probe, wrapper, steps, rollout, places):
    """Compare a stored rollout with the results of its steps; describe the ends of episodes apart."""
    wrong, ends, apart = {}, set(), 0
    ended = sum(bool(step.ended.any()) for step in steps)
    if not ended:
        probe.finding("interop.torchrl.ends", "torchrl.no_end", level="note", steps=len(steps))
    for number, step in enumerate(steps):
        after = rollout[..., number]["next"]
        apart += bool(step.ended.any() and not step.ended.all())
        for name, key in places.items():
            compared = ~step.ended | (name in STEP_KEYS)
            if not same_values(rows(after[key], compared), rows(step.copies[name], compared)):
                wrong[name] = wrong.get(name, 0) + 1
            if step.ended.any() and name not in STEP_KEYS:
                ends.add(_observation_at_end(step, name, after[key]))
    if ZEROS in ends:
        probe.finding("interop.torchrl.last", "torchrl.zeros", wrapper=wrapper)
    if wrong:
        where = ", ".join("{} in {}".format(name, number) for name, number in sorted(wrong.items()))
        if reuses_memory(steps):
            probe.finding("interop.torchrl.alias", "torchrl.alias", wrapper=wrapper, steps=len(steps), got=where)
        else:
            probe.finding("interop.torchrl.alias", "torchrl.rollout", wrapper=wrapper, steps=len(steps), got=where)
    return {"steps": len(steps), "ends": ended, "ends_apart": apart, "wrong": wrong, "at_ends": sorted(ends)}


def _observation_at_end(step, name, stored):
    """Describe the observation stored where an episode ended: the last one, as returned, zeros or another."""
    import numpy as np

    last = rows(stored, step.ended)
    if name in step.last and same_values(last, rows(step.last[name], step.ended)):
        return "the last of the episode"
    if same_values(last, rows(step.copies[name], step.ended)):
        return "as returned"
    if not last.any():
        return ZEROS
    return "not a number" if np.isnan(last).all() else "another"


def _report_resets(probe, resets):
    """Return how often the environment was reset besides the beginning, and how often with worlds amid an episode."""
    amid = [number for number in resets if number]
    if amid:
        probe.finding("interop.torchrl.reset", "torchrl.reset", times=len(amid))
    return {"number": len(resets), "amid": len(amid)}


def _layers(env):
    """Return a wrapper and all that it wraps, the outermost first."""
    transformed = importlib.import_module("torchrl.envs").TransformedEnv
    layers = [env]
    while isinstance(layers[-1], transformed):
        layers.append(layers[-1].base_env)
    return layers


def _keys_of(tensordict):
    return list(tensordict.keys())  # itself it yields its values


def _common_answer(answers):
    """Return one answer if all agree."""
    different = set(answers)
    return different.pop() if len(different) == 1 else "sometimes"


def _share_memory(arrays):
    return all(same_memory(arrays[0], other) for other in arrays[1:])


def _per_step(number):
    mean = number / LOOKED_AT
    return int(mean) if mean == int(mean) else round(mean, 2)


def torchrl_library(name):
    """Import the module of TorchRL that wraps environments of a library."""
    return importlib.import_module("torchrl.envs.libs." + name)


def _releases(probe):
    """Return the releases that work together, and why TorchRL's compiled part does not work, if it does not."""
    names = ("torchrl", "tensordict", "torch", "gymnasium")
    releases = {name: str(getattr(sys.modules.get(name), "__version__", None)) for name in names}
    try:
        importlib.import_module("torchrl._torchrl")
    except ImportError as error:
        releases["compiled"] = str(error).rpartition(": ")[2][:100]
        torch, symbol = releases["torch"], releases["compiled"]
        probe.finding("interop.torchrl.compiled", "torchrl.compiled", level="note", torch=torch, symbol=symbol)
    return releases
