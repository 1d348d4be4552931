"""Run in a cell: print results of an adapter and of a loop by hand for the same actions, as one line of JSON.

The harness writes `ASKED` before it.
"""

import copy
import importlib
import json
import sys


def enter(folder):
    """Enter the cell's side as a probe does."""
    sys.path.insert(0, folder)
    importlib.import_module("bootstrap").enter()


def plain(value):
    """Return shape, dtype and values, by key or position."""
    if hasattr(value, "items"):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    numpy = importlib.import_module("numpy")
    array = numpy.asarray(value)
    return [f"{array.shape} {array.dtype}", array.tolist() if array.dtype.kind != "O" else repr(value)]


def number(value):
    """Return a number or a flag as a float, and several of them by key or position."""
    if value is None:
        return None
    if hasattr(value, "items"):
        return {str(key): number(item) for key, item in value.items()}
    return value.astype(float).tolist() if getattr(value, "shape", ()) else float(value)


def entry(observation, reward=None, terminated=None, truncated=None):
    """Return one reset or step as plain values."""
    return [plain(copy.deepcopy(observation))] + [number(one) for one in (reward, terminated, truncated)]


def by_adapter(case, seed, steps):
    """Return the adapter's entries and actions, and its complaints."""
    adapter = importlib.import_module("_simmatrix_cell.api_" + case["api"]).API
    complaints = []
    for name in case["imports"] + adapter.modules(case):
        importlib.import_module(name)
    env = adapter.make(case, lambda kind, code, **data: complaints.append((code, data)))
    env.seed_actions(seed)
    entries, actions = [entry(env.reset(seed))], []
    while len(actions) < steps:
        actions.append(copy.deepcopy(env.action()))
        values = env.step(actions[-1])
        entries.append(entry(*values))
        if values[2] or values[3]:
            break
    env.close()
    return entries, actions, complaints


def by_hand(source, case, seed, actions):
    """Return the entries of a loop without the harness."""
    entries = []
    prefix, colon, rest = case["env"].partition(":")
    names = {"API": case["api"], "ENV": rest if colon and prefix == case["api"] else case["env"], "SEED": seed}
    names.update(KWARGS=case["kwargs"], ACTIONS=actions, tell=lambda *values: entries.append(entry(*values)))
    exec(compile(source, "by hand", "exec"), names)
    return entries


def main(request):
    """Print the results of both."""
    enter(request["incell"])
    adapted, actions, complaints = by_adapter(request["case"], request["seed"], request["steps"])
    entries = by_hand(request["by_hand"], request["case"], request["seed"], actions)
    print("\nWITNESS " + json.dumps({"adapter": adapted, "by_hand": entries, "complaints": complaints}), flush=True)


if __name__ == "__main__":
    main(ASKED)  # noqa: F821
