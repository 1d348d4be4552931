"""Run in a cell's interpreter: make states of an environment, step from them, and again after other play."""

import importlib
import json
import sys

import numpy as np

STATES, PLAYED = 40, 40


def main(incell, case):
    """Print what was seen as JSON."""
    sys.path.insert(0, incell)
    importlib.import_module("bootstrap").enter()

    def part(name):
        return importlib.import_module("_simmatrix_cell." + name)

    api = part("api_gymnasium").API
    for module in [*api.modules(case), *case["imports"]]:
        importlib.import_module(module)
    env = api.make(case, lambda kind, code, **data: None)
    env.reset(0)
    physics = part("cell_physics").physics_of(env)
    maker = part("cell_bank").Maker(env, physics, 0, STATES)
    bank = maker.make()
    stepper = part("cell_steps").Stepper(env, physics)
    first = stepper.outputs(bank)
    repeats = not stepper.unrepeated(bank, first)
    facts = stepper.entries()
    for seed in range(3):  # other goals, other places of objects, another past
        env.reset(100 + seed)
        for _ in range(PLAYED):
            env.step(env.action())
    second = stepper.outputs(bank)
    bank["state.task"] = np.roll(bank["state.task"], 1, axis=0)
    other = stepper.outputs(bank)
    unlike = sorted(name for name in first if first[name].tobytes() != second[name].tobytes())
    print(
        json.dumps(
            {
                "repeats": repeats,
                "unlike": unlike,
                "task": sorted(name for _, name in physics.memory.attributes),
                "places": len(physics.memory.rows),
                "other_task": first["observation"].tobytes() != other["observation"].tobytes(),
                "kinds": [int(np.sum(bank["kind"] == number)) for number in range(5)],
                "held": _held(maker, bank, first, facts),
            }
        )
    )


def _held(maker, bank, outputs, facts):
    """Return in how many grasps each finger of the gripper touches a free body."""
    if not maker.gripper:
        return 0
    model, gripper, held = maker.physics.model, maker.gripper, 0
    free = {int(model.jnt_bodyid[joint]) for joint in gripper.free}
    for number in np.flatnonzero(bank["kind"] == 4):
        met = [tuple(map(int, pair.split("-"))) for pair in facts["contacts"][int(outputs["contacts"][number])]]
        on_free = [set(pair) for pair in met if any(_root(model, geometry) in free for geometry in pair)]
        held += all(any(pair & set(finger) for pair in on_free) for finger in gripper.geometries)
    return held


def _root(model, geometry):
    """Return the body on the world that a geometry is on."""
    return int(model.body_rootid[model.geom_bodyid[geometry]])


if __name__ == "__main__":
    main(sys.argv[1], json.loads(sys.argv[2]))
