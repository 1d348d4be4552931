"""Say where the models of Playground's robots lie, which it clones from GitHub: imported before Playground.

The variable MUJOCO_MENAGERIE names their folder. Without it an empty folder stands in for them, which is enough for the
control suite: it has models of its own.
"""

import importlib.abc
import importlib.machinery
import os
import sys
import tempfile

NAME = "mujoco_playground._src.mjx_env"


class Finder(importlib.abc.MetaPathFinder):
    """Find the module that knows the place of the models, and change the place when it is loaded."""

    def find_spec(self, name, path=None, target=None):
        """Return the spec of that module alone."""
        if name != NAME:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        execute = spec.loader.exec_module

        def exec_module(module):
            execute(module)
            folder = os.environ.get("MUJOCO_MENAGERIE") or tempfile.mkdtemp()
            module.MENAGERIE_PATH = module.epath.Path(folder)

        spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, Finder())
