"""Many cells: each question resolved once, each environment made once, results reused, several cells at a time."""

from harness.scheduler.flow import default_jobs, run
from harness.scheduler.runner import Runner
from harness.scheduler.settings import Observer, Settings

__all__ = ["Observer", "Runner", "Settings", "default_jobs", "run"]
