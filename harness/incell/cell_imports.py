"""Imports the libraries of a case, and looks for the package that registers its environment.

Nothing is imported here that a library might have forgotten to import itself: see `bootstrap`.
"""

from .cell_errors import library
from .cell_kept import monotonic
from .cell_search import functions, imported, registering
from .cell_sources import ASIDE


class Imports:
    """The modules that a case needs, each imported once; `searched` are those that were only looked into."""

    def __init__(self, case, api):
        self.case = case
        self.api = api
        self.searched = []
        self._imported = {}

    def import_modules(self):
        """Import what the case names, then what its API needs: seconds by module. Done once.

        An environment that is not registered by then is looked for in the packages that may bring it.
        """
        names = list(self.case["imports"]) + (self.api.modules(self.case) if self.api else [])
        for name in names:
            self.import_module(name)
        if self.api and not self.searched:
            self._search()
        return dict(self._imported)

    def _search(self):
        """Import the packages asked for, then their submodules that register environments, until one registers ours.

        What cannot be imported is the reason, where in the end the environment is not there.
        """
        before = set(self.api.versions(self.case))
        tops = [name for name in self.case["providers"] if name.lower() not in ASIDE]
        raised = self._until_registered(tops, before)
        raised += self._until_registered([one for top in tops for one in functions(top)], before)
        raised += self._until_registered([one for top in tops for one in registering(top, self.case["env"])], before)
        self._until_registered([name for name in self.case["beside"] if name.lower() not in ASIDE], before)
        if raised and not self.api.knows(self.case):
            library.raised = raised[0]
            raise raised[0]

    def _until_registered(self, modules, before):
        """Import these modules until the environment, or a version of it that was not there before, is registered.

        Returns what they raised.
        """
        raised = []
        for module in modules:
            if self.api.knows(self.case) or set(self.api.versions(self.case)) - before:
                break
            self.searched.append(module)
            try:
                self.import_module(module)
            except Exception as error:
                raised.append(error)
        return raised

    def ours(self):
        """Return the modules that were imported only to look for the environment, or by name."""
        return [*self.case["imports"], *self.searched]

    def import_module(self, name):
        """Import a module, or call a function of one that registers environments, once."""
        if name not in self._imported:
            began = monotonic()
            with library:
                imported(name)
            self._imported[name] = round(monotonic() - began, 4)
