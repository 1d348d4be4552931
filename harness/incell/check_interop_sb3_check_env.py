"""Run the checker of Stable-Baselines3."""

import importlib
import warnings

from .cell_errors import library
from .cell_interop import close, import_sb3, make_environment


def run(probe, facts):
    """Run Stable-Baselines3's own checker; its warnings are findings."""
    import_sb3(facts)
    probe.watch.take_warnings()
    with library:
        checker = importlib.import_module("stable_baselines3.common.env_checker")
        env = make_environment(probe)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with library:
            checker.check_env(env)
    close(env)
    for text in probe.watch.take_warnings():
        probe.finding("interop.sb3.check_env", "warned.check_env", text=text)
