"""Makes a bank of states of an environment, and what each of them leads to here."""

import numpy as np

from .cell_arrays import BANK, save
from .cell_bank import Maker
from .cell_bullet_bank import BulletMaker
from .cell_bullet_physics import BulletPhysics
from .cell_episode import open_single
from .cell_functional_bank import FunctionalMaker
from .cell_functional_physics import BraxPhysics, MjxPhysics
from .cell_physics import AttributePhysics, MujocoPhysics, SeededPhysics, physics_of
from .cell_plain_bank import AttributeMaker, SeededMaker
from .cell_steps import Stepper, noise, scales, starts, step_all

MAKERS = {
    MujocoPhysics: Maker,
    BulletPhysics: BulletMaker,
    MjxPhysics: FunctionalMaker,
    BraxPhysics: FunctionalMaker,
    AttributePhysics: AttributeMaker,
    SeededPhysics: SeededMaker,
}


def run(probe, _facts):
    """Make the states, step from each of them and from its twins, and write all of it to one file.

    Parts `state.*`, `warm`, `action`, `kind`: the states; `out.*`: what each leads to; `scale.*`: the typical size of
    each number of that; `noise.*`: the largest difference that a twin of a state makes.
    """
    with open_single(probe) as env:
        env.reset(probe.case["seed"])
        physics = physics_of(env)
        bank = MAKERS[type(physics)](env, physics, probe.case["seed"]).make()
        stepper = Stepper(env, physics)
        outputs, facts = step_all(probe, bank, stepper)
        worst = noise(stepper, bank, outputs, probe.case["seed"])
        outputs["reset"], facts["lengths"] = starts(env, stepper.space)
        facts.update(stepper.describe(env), env=probe.case["env"], api=probe.case["api"], kwargs=probe.case["kwargs"])
    arrays = {name: values.astype(np.float32) for name, values in bank.items()}  # they are rounded to that already
    arrays.update(("scale." + name, values.astype(np.float32)) for name, values in scales(outputs).items())
    arrays.update(("out." + name, values) for name, values in outputs.items())
    arrays.update(("noise." + name, values.astype(np.float32)) for name, values in worst.items())
    save(probe, BANK, arrays, dict(facts, form=1))
