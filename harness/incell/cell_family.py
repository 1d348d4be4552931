"""gym 0.26 and gymnasium from 0.26 on: one API under two names."""

import importlib


class Family:
    """The calls a user makes, made in a user's way: with the library's own checkers and wrappers in place."""

    def __init__(self, name):
        self.name = name

    def modules(self, case):
        """Names of modules to import before anything else."""
        prefix, colon, _ = (case["env"] or "").partition(":")
        return [self.name] + ([prefix] if colon else [])

    def knows(self, case):
        """Whether the environment of a case is registered."""
        return case["env"] in importlib.import_module(self.name + ".envs.registration").registry

    @property
    def spaces(self):
        """The module of space classes."""
        return importlib.import_module(self.name + ".spaces")

    @property
    def vector(self):
        """The module of vector environments."""
        return importlib.import_module(self.name + ".vector")

    def make(self, case, **more):
        """Make the environment of a case."""
        return importlib.import_module(self.name).make(case["env"], **dict(case["kwargs"], **more))

    def check_env(self, env):
        """Run the library's own checker."""
        importlib.import_module(self.name + ".utils.env_checker").check_env(env.unwrapped, skip_render_check=True)
