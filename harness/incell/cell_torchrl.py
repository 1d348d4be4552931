"""Wrap environments in TorchRL, and record inputs and outputs, and the conversions and copies that they cost.

Each check is one way to wrap it. A few steps are looked at one by one; then a rollout is stored, as for training, and
compared with what each step really returned.
"""

import importlib
import sys
from contextlib import ExitStack

from . import cell_interop
from .cell_errors import library, skip
from .cell_exchange import Exchange, equal, reuses, rows, same_memory, shown

FIRST, LOOKED_AT = 2, 4
"""Steps that are let pass first (TorchRL validates), and those after that are looked at one by one."""

BESIDE = ("reward", "terminated", "truncated", "done")
"""What TorchRL stores of a step besides the observations."""

ZEROS = "zeros"
MADE = "simmatrix/Made-v0"


def gym(probe, facts):
    """Check GymWrapper as it is: it converts actions to numpy."""
    _drive(probe, facts, lambda raw: _of("gym").GymWrapper(raw, device="cpu"))


def gym_tensor(probe, facts):
    """Check GymWrapper that passes actions on as they are."""
    _drive(probe, facts, lambda raw: _of("gym").GymWrapper(raw, device="cpu", convert_actions_to_numpy=False))


def isaaclab(probe, facts):
    """Check IsaacLabWrapper on the CPU; its own default is the first GPU."""
    _isaaclab(probe, facts)


def isaaclab_native(probe, facts):
    """Check IsaacLabWrapper that leaves it to the environment to begin episodes."""
    _isaaclab(probe, facts, native_autoreset=True)


def _isaaclab(probe, facts, **options):
    import inspect

    torchrl = cell_interop.present("torchrl", "torchrl")
    try:
        wrapper = _of("isaac_lab").IsaacLabWrapper
    except ModuleNotFoundError as error:
        if error.name != "torchrl.envs.libs.isaac_lab":
            raise
        skip("torchrl.no_wrapper", version=torchrl.__version__)
    if not set(options) <= set(inspect.signature(wrapper.__init__).parameters):
        skip("torchrl.no_option", version=torchrl.__version__, options=", ".join(options))
    options["device"] = importlib.import_module("torch").device("cpu")
    _drive(probe, facts, lambda raw: wrapper(raw, **options))


def backend(probe, facts):
    """Check GymEnv, which makes an environment by its id, in the backend that set_gym_backend names."""
    cell_interop.present("torchrl", "torchrl")
    gymnasium = importlib.import_module("gymnasium")
    if probe.case["api"] == "gymnasium" and probe.case["env"] in gymnasium.envs.registration.registry:
        name, options = probe.case["env"], probe.case["kwargs"]
    else:
        name, options = MADE, {}
        gymnasium.register(MADE, entry_point=lambda **_: cell_interop.made(probe))
    libs = _of("gym")
    with ExitStack() as chosen:
        with library:
            chosen.enter_context(libs.set_gym_backend("gymnasium"))
            facts["backend"] = libs.gym_backend().__name__
        _drive(probe, facts, lambda _: libs.GymEnv(name, device="cpu", **options), make=lambda _: None)


def _drive(probe, facts, wrap, make=cell_interop.made):
    """Wrap the environment, look at single steps, store a rollout."""
    cell_interop.present("torchrl", "torchrl")
    torch = importlib.import_module("torch")
    told = facts["told"] = {"library": _library(probe)}
    with library:
        raw = make(probe)
        env = _wrapped(raw, wrap)
    told["wrapper"], told["batch"] = _names(env), list(env.batch_size)
    torch.manual_seed(probe.case["seed"])
    try:
        with Exchange(_inner(env)) as exchange:
            stored = _steps(env, exchange)
            places = _places(exchange, stored)
            told.update(_passed(exchange, stored, places))
            told["keys"] = _keys(probe, exchange, stored, places)
            before = len(exchange.resets)
            with library:
                rollout = env.rollout(probe.case["steps"], break_when_any_done=False)
            told["rollout"] = _stored(probe, told["wrapper"][-1], exchange.steps[-rollout.shape[-1] :], rollout, places)
            told["resets"] = _resets(probe, exchange.resets[before + 1 :])
    finally:
        cell_interop.close(env)


def _wrapped(raw, wrap):
    """Wrap an environment; close it if that fails, since of some there can be only one at a time."""
    try:
        return wrap(raw)
    except BaseException:
        if raw is not None:
            raw.close()
        raise


def _steps(env, exchange):
    """Make a few steps, counting in the later ones: for each the action that went in and what TorchRL stores."""
    onward = importlib.import_module("torchrl.envs.utils").step_mdp
    stored = []
    with library:
        at = env.reset()
    for number in range(FIRST + LOOKED_AT):
        with library:
            at = env.rand_action(at)
            action = at[env.action_key]
            if number < FIRST:
                at = env.step(at)
            else:
                with exchange.counts.counted("wrapper"):
                    at = env.step(at)
        stored.append((action, at["next"]))
        with library:
            at = onward(at)
    return stored


def _places(exchange, stored):
    """Return the key under which TorchRL stores each part of a step, its own or one with the same values."""
    step, (_, after) = exchange.steps[-1], stored[-1]
    there, found = _names_in(after), {}
    for name in step.parts:
        keys = [name] if name in there else [key for key in there if equal(after[key], step.copies[name])]
        if keys:
            found[name] = keys[0]
    return found


def _passed(exchange, stored, places):
    """Describe the inputs and outputs of the latest steps: arrays, shared memory, conversions and copies."""
    pairs = list(zip(exchange.steps[-LOOKED_AT:], stored[-LOOKED_AT:]))
    step, (_, after) = pairs[-1]
    same = {"action": _always(same_memory(taken, step.action) for step, (taken, _) in pairs)}
    for name, key in places.items():
        same[name] = _always(same_memory(step.parts[name], after[key]) for step, (_, after) in pairs)
    counts = exchange.counts.by_place
    return {
        "takes": shown(step.action),
        "gives": {name: shown(value) for name, value in step.parts.items()},
        "stored": {name: shown(after[name]) for name in _names_in(after)},
        "same_memory": same,
        "per_step": {place: {kind: _mean(number) for kind, number in counts[place].items()} for place in counts},
        "reused": [name for name in step.parts if _one_place([step.parts[name] for step, _ in pairs])],
        "aliased": [name for name, key in places.items() if _one_place([after[key] for _, (_, after) in pairs])],
    }


def _keys(probe, exchange, stored, places):
    """Return whether what the environment observes can be found by its name in what TorchRL stores."""
    wanted = [name for name in exchange.steps[-1].parts if name not in BESIDE]
    renamed = {name: places[name] for name in wanted if places.get(name, name) != name}
    for name, key in renamed.items():
        probe.finding("interop.torchrl.keys", "torchrl.renamed", level="note", promised=repr(name), got=repr(key))
    for name in wanted:
        if name not in places:
            probe.finding("interop.torchrl.keys", "torchrl.missing", promised=repr(name))
    return {"environment": wanted, "stored": _observed(stored[-1][1]), "renamed": renamed}


def _stored(probe, wrapper, steps, rollout, places):
    """Compare a stored rollout with what each of its steps returned, where no episode ended; there apart."""
    wrong, ends, apart = {}, set(), 0
    ended = sum(bool(step.ended.any()) for step in steps)
    if not ended:
        probe.finding("interop.torchrl.ends", "torchrl.no_end", level="note", steps=len(steps))
    for number, step in enumerate(steps):
        after = rollout[..., number]["next"]
        apart += bool(step.ended.any() and not step.ended.all())
        for name, key in places.items():
            compared = ~step.ended | (name in BESIDE)
            if not equal(rows(after[key], compared), rows(step.copies[name], compared)):
                wrong[name] = wrong.get(name, 0) + 1
            if step.ended.any() and name not in BESIDE:
                ends.add(_at_end(step, name, after[key]))
    if ZEROS in ends:
        probe.finding("interop.torchrl.last", "torchrl.zeros", wrapper=wrapper)
    if wrong:
        where = ", ".join("{} in {}".format(name, number) for name, number in sorted(wrong.items()))
        if reuses(steps):
            probe.finding("interop.torchrl.alias", "torchrl.alias", wrapper=wrapper, steps=len(steps), got=where)
        else:
            probe.finding("interop.torchrl.alias", "torchrl.rollout", wrapper=wrapper, steps=len(steps), got=where)
    return {"steps": len(steps), "ends": ended, "ends_apart": apart, "wrong": wrong, "at_ends": sorted(ends)}


def _at_end(step, name, stored):
    """Describe the observation stored where an episode ended: the last one, as returned, zeros or another."""
    import numpy as np

    found = rows(stored, step.ended)
    if name in step.last and equal(found, rows(step.last[name], step.ended)):
        return "the last of the episode"
    if equal(found, rows(step.copies[name], step.ended)):
        return "as returned"
    if not found.any():
        return ZEROS
    return "not a number" if np.isnan(found).all() else "another"


def _resets(probe, resets):
    """Return how often the environment was reset besides the beginning, and how often with worlds amid an episode."""
    amid = [number for number in resets if number]
    if amid:
        probe.finding("interop.torchrl.reset", "torchrl.reset", times=len(amid))
    return {"number": len(resets), "amid": len(amid)}


def _inner(env):
    """Return the environment that is wrapped."""
    transformed = importlib.import_module("torchrl.envs").TransformedEnv
    while isinstance(env, transformed):
        env = env.base_env
    return env._env


def _names(env):
    """Return the names of the classes of a wrapper, the outermost first."""
    transformed = importlib.import_module("torchrl.envs").TransformedEnv
    found = [type(env).__name__]
    while isinstance(env, transformed):
        env = env.base_env
        found.append(type(env).__name__)
    return found


def _names_in(tensordict):
    return list(tensordict.keys())  # itself it yields its values


def _observed(after):
    return [name for name in _names_in(after) if name not in BESIDE]


def _always(answers):
    """Return one answer if all agree."""
    found = set(answers)
    return found.pop() if len(found) == 1 else "sometimes"


def _one_place(arrays):
    return all(same_memory(arrays[0], other) for other in arrays[1:])


def _mean(number):
    each = number / LOOKED_AT
    return int(each) if each == int(each) else round(each, 2)


def _of(name):
    return importlib.import_module("torchrl.envs.libs." + name)


def _library(probe):
    """Return the releases that work together, and why TorchRL's compiled part does not work, if it does not."""
    names = ("torchrl", "tensordict", "torch", "gymnasium")
    told = {name: str(getattr(sys.modules.get(name), "__version__", None)) for name in names}
    try:
        importlib.import_module("torchrl._torchrl")
    except ImportError as error:
        told["compiled"] = str(error).rpartition(": ")[2][:100]
        torch, symbol = told["torch"], told["compiled"]
        probe.finding("interop.torchrl.compiled", "torchrl.compiled", level="note", torch=torch, symbol=symbol)
    return told
