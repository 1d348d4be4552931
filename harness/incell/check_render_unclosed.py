"""Draw with an environment that is left open."""


def run(probe, _facts):
    """Draw with an environment that is left open, as many users leave theirs: Python's end shows what comes of that."""
    env = probe.api.make(probe.case, lambda *_, **_named: None, draw=True)
    env.seed_actions(probe.case["seed"])
    env.reset(probe.case["seed"])
    env.render()
    probe.memo["left open"] = env
