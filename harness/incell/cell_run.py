"""Runs the checks asked for, one after the other; whatever a library does becomes a record.

Nothing is imported here that a library might have forgotten to import itself: see `bootstrap`.
"""

import atexit
import gc
import importlib
import json
import os
import platform
import sys
from time import monotonic

from .cell_errors import Skip, blame, describe, library, summary
from .cell_lines import LAST_WORDS, Lines, bounded
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
        self.reply = Lines(os.path.join(self.folder, "reply.jsonl"))
        self.reply.write(
            "hello",
            python=platform.python_version(),
            implementation=platform.python_implementation(),
            executable=sys.executable,
        )
        self.stacks = Stacks(os.path.join(self.folder, "stacks.txt"))
        self.watch = Watch()
        self.api = importlib.import_module(".api_" + self.case["api"], __package__).API if self.case["api"] else None
        self.memo = {}
        self.workers = []
        self.deadline = 0.0
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

    def frame(self, check, which, name):
        """Tell of a picture that lies in the folder."""
        self.reply.write("frame", check=check, which=which, path=name)

    def end(self):
        """Write the last line."""
        self._aside("single", passed=True)
        modules = {name: sys.modules.get(name) for name in TOLD}
        versions = {name: str(getattr(module, "__version__", "?"))[:50] for name, module in modules.items() if module}
        self.reply.write("end", modules=_own_modules(), versions=versions)
        try:  # noqa: SIM105 - contextlib may be what a library forgot to import
            os.write(2, "\n{}\n".format(LAST_WORDS).encode("ascii"))
        except OSError:  # a library that closes everything has closed this, too
            pass

    def import_modules(self):
        """Import what the case names, then what its API needs: seconds by module. Done once.

        An environment that is not registered by then is looked for in the modules that may bring it.
        """
        names = list(self.case["imports"]) + (self.api.modules(self.case) if self.api else [])
        for name in names:
            self._import(name)
        for name in self.case["providers"] if self.api else ():
            if not self.api.knows(self.case):
                self._import(name)
        return dict(self._imported)

    def _import(self, name):
        if name not in self._imported:
            began = monotonic()
            with library:
                importlib.import_module(name)
            self._imported[name] = round(monotonic() - began, 4)

    def _phase(self, check):
        return importlib.import_module(".phase_" + check.partition(".")[0], __package__)

    def _check(self, check):
        outcome, error = self._attempt(check)
        self._aside(check.partition(".")[0], passed=error is None)
        return outcome

    def _follow(self, check):
        """Run a check that can only find: what it raises is a finding, too."""
        _, error = self._attempt(check)
        if error:
            self.finding(check, error)
        self._aside(check.partition(".")[0], passed=error is None)

    def _attempt(self, check):
        """Run one check and write its record: (outcome, the exception on one line or None)."""
        outcome, raised, reason, told, facts = "passed", None, None, None, {}
        self.workers = []
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
        if os.getpid() != self.reply.pid:  # a child that a library forked and let come back here
            os._exit(0)
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
        gc.collect()
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
