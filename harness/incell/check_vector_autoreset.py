"""Goes over the ends of episodes in a batch."""

from .cell_autoreset import Short, beside_single
from .cell_batch import in_watched_workers, opened_batch, skip_several_rewards


def run(probe, facts):
    """Go over the ends of episodes, in this process and in workers, in each way that the library has."""
    check = "vector.autoreset"
    skip_several_rewards(probe)
    modes = probe.api.autoreset_modes()
    facts["modes"] = list(modes)
    makers = [Short(probe, check)] * probe.num_envs
    for name, chosen in modes.items():

        def go_over(env, mode=name):
            difference, lost = beside_single(probe, env, mode, makers[0])
            if difference:
                at = difference["step"]
                probe.finding(check, "vector.autoreset.differs", at=at, difference=difference, mode=mode)
            if lost:
                probe.finding(check, "vector.autoreset.lost", level="note")

        with opened_batch(probe, makers, dict(chosen)) as env:
            go_over(env)
        in_watched_workers(probe, makers, dict(chosen, context="fork"), go_over)
