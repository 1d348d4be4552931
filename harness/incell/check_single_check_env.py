"""Run the checker that the library itself brings."""

import warnings


def run(probe, _facts):
    """Run the library's own checker; its warnings and what it raises are findings."""
    probe.watch.take_warnings()
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        probe.api.check_env(probe.case)
    for text in probe.watch.take_warnings():
        probe.finding("single.check_env", "warned.check_env", text=text)
