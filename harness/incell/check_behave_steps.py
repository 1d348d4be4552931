"""Steps an environment from each state of the bank that the host gave."""

from .cell_arrays import OUTPUTS, load, save
from .cell_episode import open_single
from .cell_physics import physics_of
from .cell_steps import LARGE_OBSERVATION, OBSERVED_EVERY, Stepper, starts, step_all


def run(probe, _facts):
    """Write what each state leads to. Where the bank does not fit, write the sizes of the state instead."""
    bank = load(probe)
    with open_single(probe) as env:
        env.reset(probe.case["seed"])
        physics = physics_of(env)
        stepper = Stepper(env, physics)
        facts, outputs = stepper.describe(env), {}
        if stepper.fits(bank):
            outputs, more = step_all(probe, bank, stepper)
            facts.update(more)
            if outputs["observation"].shape[1] > LARGE_OBSERVATION:
                outputs["observation"] = outputs["observation"][::OBSERVED_EVERY]
                facts["observed_every"] = OBSERVED_EVERY
        outputs["reset"], facts["lengths"] = starts(env, stepper.space)
    save(probe, OUTPUTS, outputs, dict(facts, form=1))
