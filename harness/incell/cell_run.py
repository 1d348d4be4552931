"""Runs the checks asked for, one after the other; whatever a library does becomes a record.

Nothing is imported here that a library might have forgotten to import itself: see `bootstrap`.
"""

import atexit
import json
import platform
import sys

from .cell_errors import Skip, blame, describe, library, summary
from .cell_kept import collect, getpid, import_module, join, leave, monotonic, replaced, write
from .cell_lines import LAST_WORDS, Lines, bounded
from .cell_search import functions, imported, registering
from .cell_sources import ASIDE
from .cell_watch import Stacks, Watch

FINDINGS_OF_A_CHECK = 10
LONGEST_FINDING = 2000
DEFAULT_SECONDS = 120.0
TOLD = ("gym", "gymnasium", "numpy", "mujoco", "mujoco_py", "dm_control", "pygame", "OpenGL", "glfw", "torch", "jax")
"""Libraries whose version as imported is told, where they were imported."""


def run(path):
    """Run the request in this file. The last line is written when Python ends: what an exit handler raises counts."""
    with open(path, encoding="utf-8") as file:
        request = json.load(file)
    probe = Probe(request)
    atexit.register(probe.end)  # the first one registered runs last
    probe.run()


class Probe:
    """One process and its reply: what the phases are given.

    `memo` carries values from one check to the next; `workers` are exit codes that a check collected of children;
    `deadline` is when the running check will be ended, on the clock of `time.monotonic`.
    """

    def __init__(self, request):
        self.case = request["case"]
        self.checks = request["checks"]
        self.limits = request["limits"]
        self.folder = request["folder"]
        self.num_envs = request["num_envs"]
        self.vector_steps = request["vector_steps"]
        self.reply = Lines(join(self.folder, "reply.jsonl"))
        self.reply.write(
            "hello",
            python=platform.python_version(),
            implementation=platform.python_implementation(),
            executable=sys.executable,
        )
        self.stacks = Stacks(join(self.folder, "stacks.txt"))
        self.watch = Watch()
        self.api = import_module(".api_" + self.case["api"], __package__).API if self.case["api"] else None
        self.memo = {}
        self.workers = []
        self.deadline = 0.0
        self.searched = []
        self._phases = []
        self._found = {}
        self._imported = {}

    def run(self):
        """Run every check. Without the import, or one environment, the others would only say the same again."""
        for check in self.checks:
            outcome = self._check(check)
            if outcome == "passed":
                for follower in self._phase(check).FOLLOWERS.get(check, ()):
                    self._follow(follower)
            elif outcome == "failed" and check.startswith(("import.", "single.")):
                break

    def finding(self, check, text, level="warning"):
        """Say something that does not stop a user's loop: each text once, a bounded number of them."""
        known = self._found.setdefault(check, set())
        if text in known or len(known) > FINDINGS_OF_A_CHECK:
            return
        known.add(text)
        if len(known) > FINDINGS_OF_A_CHECK:
            text = "and more of this kind"
        self.reply.write("finding", check=check, level=level, text=bounded(text, LONGEST_FINDING))

    def findings(self, check):
        """Return the texts that were found so far."""
        return sorted(self._found.get(check, ()))

    def frame(self, check, which, name):
        """Tell of a picture that lies in the folder."""
        self.reply.write("frame", check=check, which=which, path=name)

    def end(self):
        """Write the last line."""
        self._aside("single", passed=True)
        if self.reply.pid == getpid() and self._phases:
            for name in replaced():
                text = "replaced a function of the harness in its own process, so that its checks say nothing: "
                self.finding(self._phases[-1] + ".replaced", text + name)
        modules = {name: sys.modules.get(name) for name in TOLD}
        versions = {name: str(getattr(module, "__version__", "?"))[:50] for name, module in modules.items() if module}
        self.reply.write("end", modules=_own_modules(), versions=versions)
        try:  # noqa: SIM105 - contextlib may be what a library forgot to import
            write(2, "\n{}\n".format(LAST_WORDS).encode("ascii"))
        except OSError:  # a library that closes everything has closed this, too
            pass

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
        """The modules that were imported only to look for the environment, or by name."""
        return [*self.case["imports"], *self.searched]

    def import_module(self, name):
        """Import a module, or call a function of one that registers environments, once."""
        if name not in self._imported:
            began = monotonic()
            with library:
                imported(name)
            self._imported[name] = round(monotonic() - began, 4)

    def _phase(self, check):
        return import_module(".phase_" + check.partition(".")[0], __package__)

    def _check(self, check):
        outcome, error = self._attempt(check)
        self._aside(check.partition(".")[0], passed=error is None)
        return outcome

    def _follow(self, check):
        """Run a check that nobody asked for. Where it can only find, what it raises is a finding, too."""
        _, error = self._attempt(check)
        if error and not getattr(self._phase(check).CHECKS[check], "compares", False):
            self.finding(check, error)
        self._aside(check.partition(".")[0], passed=error is None)

    def _attempt(self, check):
        """Run one check and write its record: (outcome, the exception on one line or None)."""
        outcome, raised, reason, told, facts = "passed", None, None, None, {}
        self.workers = []
        self._phases.append(check.partition(".")[0])
        self.reply.write("start", check=check)
        began = self._arm(check)
        try:
            if not check.startswith("import."):
                self._prepare()
            self._phase(check).CHECKS[check](self, facts)
        except Skip as skip:
            outcome, reason = "skipped", str(skip)
        except BaseException as error:  # SystemExit and KeyboardInterrupt of a library are outcomes, too
            outcome, raised, told = "failed", describe(error), _told(error)
        self.stacks.disarm()
        if getpid() != self.reply.pid:  # a child that a library forked and let come back here
            leave(0)
        seconds = round(monotonic() - began, 4)
        record = {"outcome": outcome, "seconds": seconds, "raised": raised, "reason": reason}
        self.reply.write("check", check=check, workers=self.workers, facts=facts, **record)
        library.raised = None
        return outcome, told

    def _prepare(self):
        """Import the libraries before those modules of ours that bring numpy in."""
        if not self.case["env"]:
            reason = "no environment was asked for"
            raise Skip(reason)
        self.import_modules()

    def _arm(self, check):
        began = monotonic()
        limit = self.limits.get(check, DEFAULT_SECONDS)
        self.deadline = began + limit
        self.stacks.arm(0.9 * limit)
        return began

    def _aside(self, phase, passed):
        """Turn what happened beside the calls into findings; after a failure the ruins tell nothing."""
        collect()
        for text in self.watch.take_deprecations():
            self.finding(phase + ".deprecation", text, level="note")
        ignored = self.watch.take_ignored()
        for text in ignored if passed else ():
            self.finding(phase + ".teardown", text)


def _told(error):
    fault = "" if blame(error) == "library" else "a fault of the harness: "
    return fault + summary(error)


def _own_modules():
    """The files of ours that this process loaded."""
    prefix = __package__ + "."
    loaded = [name[len(prefix) :] + ".py" for name in sys.modules if name.startswith(prefix)]
    return sorted(["bootstrap.py", *loaded])
