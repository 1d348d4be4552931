"""Record the trajectory of a second process, to be compared with the one of `single.loop`."""

from .cell_episode import run_episode


def run(probe, facts):
    """Record only the trajectory of a second process, to be compared with that of the first."""
    trace = run_episode(probe)
    facts["trajectory"], facts["values"] = trace.steps(), trace.values()
