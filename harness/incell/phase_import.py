"""Phase import: the modules that a user's script imports first."""


def modules(probe, facts):
    """Import what the case names, then what its API needs."""
    facts["seconds"] = probe.import_modules()


CHECKS = {"import.modules": modules}
FOLLOWERS = {}
