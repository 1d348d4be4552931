"""Gives the trajectory of a second process, to be compared with the one of `single.loop`."""

from .cell_episode import episode


def run(probe, facts):
    """Only the trajectory: for a second process, to be compared with the first one's."""
    trace = episode(probe)
    facts["trajectory"], facts["values"] = trace.steps(), trace.values()
