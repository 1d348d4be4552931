"""Runs the checker of Stable-Baselines3."""

import importlib
import warnings

from .cell_errors import library
from .cell_interop import close, made, present
from .cell_sb3 import SB3, releases


def run(probe, facts):
    """Run Stable-Baselines3's own checker; its warnings are findings."""
    facts["version"] = releases(present(SB3, "stable-baselines3"))
    probe.watch.take_warnings()
    with library:
        checker = importlib.import_module(SB3 + ".common.env_checker")
        env = made(probe)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with library:
            checker.check_env(env)
    close(env)
    for text in probe.watch.take_warnings():
        probe.finding("interop.sb3.check_env", "warned.check_env", text=text)
