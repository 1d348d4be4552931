"""Make an environment by GymEnv."""

import importlib
from contextlib import ExitStack

from .cell_errors import library
from .cell_interop import import_trainer, make_environment
from .cell_torchrl import drive, torchrl_library

ENVIRONMENT_ID = "simmatrix/Made-v0"


def run(probe, facts):
    """Check GymEnv, which makes an environment by its id, in the backend that set_gym_backend names."""
    import_trainer("torchrl", "torchrl")
    gymnasium = importlib.import_module("gymnasium")
    if probe.case["api"] == "gymnasium" and probe.case["env"] in gymnasium.envs.registration.registry:
        name, options = probe.case["env"], probe.case["kwargs"]
    else:
        name, options = ENVIRONMENT_ID, {}
        gymnasium.register(ENVIRONMENT_ID, entry_point=lambda **_: make_environment(probe))
    libs = torchrl_library("gym")
    with ExitStack() as chosen:
        with library:
            chosen.enter_context(libs.set_gym_backend("gymnasium"))
            facts["backend"] = libs.gym_backend().__name__
        drive(probe, facts, lambda _: libs.GymEnv(name, device="cpu", **options), make=lambda _: None)
