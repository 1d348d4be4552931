"""Gives the trajectory of a second process, to be compared with the one of `single.loop`."""

from .cell_episode import episode


def run(probe, facts):
    """Record only the trajectory of a second process, to be compared with that of the first."""
    trace = episode(probe)
    facts["trajectory"], facts["values"] = trace.steps(), trace.values()
