"""Compare a vector environment that SuperSuit makes of a PettingZoo environment with that environment."""

from .cell_episode import count_steps
from .cell_errors import library, violate
from .cell_interop import close
from .cell_supersuit import COPIES, check_batch, make_vector, make_wrapped

STEPS = 10


def run(probe, facts):
    """Step both with the same seed and actions; the first copy has to give what the environment itself gives."""
    import numpy as np

    env, vector = make_vector(probe, facts, "gymnasium")
    agents = list(env.possible_agents)
    facts["environments"] = number = COPIES * len(agents)
    alone = make_wrapped(probe)
    try:
        with library:
            for agent in agents:
                alone.action_space(agent).seed(probe.case["seed"])
            together, _ = vector.reset(seed=probe.case["seed"])
            apart = _first(alone.reset(seed=probe.case["seed"]))
        for _ in count_steps(STEPS):
            check_batch("observations", together, (number, *env.observation_space(agents[0]).shape))
            _compare("observations", together, apart, agents)
            with library:
                actions = [alone.action_space(agent).sample() for agent in agents]  # the vector's space is that of one
                together, rewards, ends, cuts, _ = vector.step(np.stack(actions * COPIES))
                apart, earned, *_ = alone.step(dict(zip(agents, actions)))
            for name, value in (("rewards", rewards), ("terminations", ends), ("truncations", cuts)):
                check_batch(name, value, (number,))
            _compare("rewards", rewards, earned, agents)
            if not alone.agents:
                break
    finally:
        close(vector)
        close(alone)


def _first(result):
    return result[0] if isinstance(result, tuple) else result


def _compare(part, together, apart, agents):
    """Raise a violation where the first copy differs from the environment itself."""
    import numpy as np

    for place, agent in enumerate(agents):
        if agent in apart and not np.allclose(together[place], apart[agent], atol=1e-5):
            violate("supersuit.differs", part=part, agent=str(agent))
