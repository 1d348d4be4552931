"""Import the libraries of a case, and look for the package that registers its environment.

Nothing is imported here that a library might have forgotten to import itself: see `bootstrap`.
"""

from .cell_errors import library
from .cell_module_search import ASIDE, import_or_call, registering_functions, registering_modules
from .cell_originals import monotonic


class Imports:
    """The modules that a case needs, each imported once; `searched` are those that were only looked into."""

    def __init__(self, case, api):
        self.case = case
        self.api = api
        self.searched = []
        self._imported = {}

    def import_modules(self):
        """Import the modules of the case, then those of its API, once; return the seconds by module.

        An environment that is not registered by then is looked for in the packages that may bring it.
        """
        names = list(self.case["imports"]) + (self.api.modules(self.case) if self.api else [])
        for name in names:
            self.import_module(name)
        if self.api and not self.searched:
            self._search()
        return dict(self._imported)

    def _search(self):
        """Import the requested packages, then their submodules that register environments, until one registers ours.

        The first error of an import is the reason, where in the end the environment is not there.
        """
        before = set(self.api.versions(self.case))
        packages = [name for name in self.case["providers"] if name.lower() not in ASIDE]
        errors = self._until_registered(packages, before)
        functions = [name for package in packages for name in registering_functions(package)]
        errors += self._until_registered(functions, before)
        modules = [name for package in packages for name in registering_modules(package, self.case["env"])]
        errors += self._until_registered(modules, before)
        self._until_registered([name for name in self.case["beside"] if name.lower() not in ASIDE], before)
        if errors and not self.api.has_environment(self.case):
            library.last_error = errors[0]
            raise errors[0]

    def _until_registered(self, modules, before):
        """Import these modules until the environment, or a version of it that was not there before, is registered.

        Return the errors that they raised.
        """
        errors = []
        for module in modules:
            if self.api.has_environment(self.case) or set(self.api.versions(self.case)) - before:
                break
            self.searched.append(module)
            try:
                self.import_module(module)
            except Exception as error:
                errors.append(error)
        return errors

    def own_imports(self):
        """Return the modules that were imported only to look for the environment, or by name."""
        return [*self.case["imports"], *self.searched]

    def import_module(self, name):
        """Import a module, or call a function of one that registers environments, once."""
        if name not in self._imported:
            began = monotonic()
            with library:
                import_or_call(name)
            self._imported[name] = round(monotonic() - began, 4)
