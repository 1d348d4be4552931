"""Schedule many cells: resolve each question once, make each environment once, reuse results, run several at a time."""

from harness.running.scheduler.control import ControlledRunner
from harness.running.scheduler.flow import order, run, short_turns, start_looks, threads
from harness.running.scheduler.runner import Prepared, Runner
from harness.running.scheduler.settings import (
    WAITING,
    Observer,
    QuietObserver,
    Settings,
    StepObserver,
)

__all__ = [
    "WAITING",
    "ControlledRunner",
    "Observer",
    "Prepared",
    "QuietObserver",
    "Runner",
    "Settings",
    "StepObserver",
    "cost_history",
    "order",
    "other_drawing",
    "run",
    "shared_environment",
    "short_turns",
    "start_looks",
    "steps",
    "threads",
]
