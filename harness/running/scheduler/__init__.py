"""Schedule many cells: resolve each question once, make each environment once, reuse results, run several at a time."""

from harness.running.scheduler.control import Beside, Controlled
from harness.running.scheduler.flow import run
from harness.running.scheduler.runner import Prepared, Runner
from harness.running.scheduler.settings import AUTO, WAITING, Observer, Settings, default_jobs

__all__ = [
    "AUTO",
    "WAITING",
    "Beside",
    "Controlled",
    "Observer",
    "Prepared",
    "Runner",
    "Settings",
    "default_jobs",
    "run",
]
