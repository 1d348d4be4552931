"""Environments of libraries as people hand them to a learner: each is one of Gymnasium with plain observations."""


def robosuite_lift(**options):
    """Return robosuite's Lift as an environment of Gymnasium, with low-dimensional observations."""
    import robosuite
    from robosuite.wrappers import GymWrapper

    env = robosuite.make(
        "Lift",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        horizon=options.pop("horizon", 100),
        **options,
    )
    return GymWrapper(env)


def minigrid_flat(**options):
    """Return an empty room of MiniGrid whose observation is one array, without the mission's text."""
    import gymnasium
    import minigrid
    from minigrid.wrappers import ImgObsWrapper

    minigrid.register_minigrid_envs() if "MiniGrid-Empty-5x5-v0" not in gymnasium.registry else None
    env = ImgObsWrapper(gymnasium.make("MiniGrid-Empty-5x5-v0", **options))
    return gymnasium.wrappers.FlattenObservation(env)
