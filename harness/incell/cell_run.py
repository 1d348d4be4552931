"""Runs the checks asked for, one after the other; whatever a library does becomes a record.

A check has a file of its own, `check_` and its name, with a function `run(probe, facts)`; the file is loaded when the
check is run. The request says which checks follow another that passed.

Nothing is imported here that a library might have forgotten to import itself: see `bootstrap`.
"""

import atexit
import json
import platform
import sys

from .cell_beside import after_check, at_end, tell_raised
from .cell_errors import Skip, blame, failure, library, raised, skip
from .cell_imports import Imports
from .cell_kept import encoded, getpid, import_module, join, leave, monotonic, write
from .cell_lines import LAST_WORDS, Lines
from .cell_observed import observation, step
from .cell_watch import Stacks, Watch

FINDINGS_OF_A_CHECK = 10
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


class Probe(Imports):
    """One process and its reply: what the checks are given.

    `memo` carries values from one check to the next; `workers` are exit codes that a check collected of children;
    `deadline` is when the running check will be ended, on the clock of `time.monotonic`.
    """

    def __init__(self, request):
        self.checks = request["checks"]
        self.followers = request["followers"]
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
        api = request["case"]["api"]
        super().__init__(request["case"], import_module(".api_" + api, __package__).API if api else None)
        self.memo = {}
        self.workers = []
        self.deadline = 0.0
        self._phases = []
        self._compares = False
        self._found = {}

    def run(self):
        """Run every check. Without the import, or one environment, the others would only say the same again."""
        for check in self.checks:
            outcome = self._check(check)
            if outcome == "passed":
                for follower in self.followers.get(check, ()):
                    self._follow(follower)
            elif outcome == "failed" and check.startswith(("import.", "single.")):
                break

    def finding(self, check, code, level="warning", **data):
        """Say something that does not stop a user's loop: each once, at whatever step, a bounded number of them."""
        observed = observation(code, data)
        known = self._found.setdefault(check, {})
        mark = encoded(dict(observed, at=None))
        if mark in known or len(known) > FINDINGS_OF_A_CHECK:
            return
        known[mark] = observed
        if len(known) > FINDINGS_OF_A_CHECK:
            observed = observation("more", {})
        self.reply.write("finding", check=check, level=level, observed=observed)

    def findings(self, check):
        """Return the findings so far."""
        return list(self._found.get(check, {}).values())

    def frame(self, check, which, name):
        """Tell of a picture that lies in the folder."""
        self.reply.write("frame", check=check, which=which, path=name)

    def end(self):
        """Write the last line."""
        after_check(self, "single", passed=True)
        if self.reply.pid == getpid() and self._phases:
            at_end(self, self._phases[-1])
        modules = {name: sys.modules.get(name) for name in TOLD}
        versions = {name: str(getattr(module, "__version__", "?"))[:50] for name, module in modules.items() if module}
        self.reply.write("end", modules=_own_modules(), versions=versions)
        try:  # noqa: SIM105 - contextlib may be what a library forgot to import
            write(2, "\n{}\n".format(LAST_WORDS).encode("ascii"))
        except OSError:  # a library that closes everything has closed this, too
            pass

    def _function(self, check):
        return import_module(".check_" + check.replace(".", "_"), __package__).run

    def _check(self, check):
        outcome, told = self._attempt(check)
        after_check(self, check.partition(".")[0], passed=told is None)
        return outcome

    def _follow(self, check):
        """Run a check that nobody asked for. Where it can only find, what it raises is a finding, too."""
        _, told = self._attempt(check)
        if told and not self._compares:
            tell_raised(self, check, *told)
        after_check(self, check.partition(".")[0], passed=told is None)

    def _attempt(self, check):
        """Run one check and write its record: (outcome, what is told of an exception or None)."""
        outcome, record, told, facts = "passed", {"raised": None, "observed": None}, None, {}
        self.workers, self._compares = [], False
        self._phases.append(check.partition(".")[0])
        self.reply.write("start", check=check)
        began = self._arm(check)
        try:
            if not check.startswith("import."):
                self._prepare()
            function = self._function(check)
            self._compares = getattr(function, "compares", False)
            function(self, facts)
        except Skip as skipped:
            outcome, record = "skipped", {"raised": None, "observed": skipped.observed}
        except BaseException as error:  # SystemExit and KeyboardInterrupt of a library are outcomes, too
            outcome, record, told = "failed", failure(error), (raised(error), blame(error))
        self.stacks.disarm()
        step.number = None
        if getpid() != self.reply.pid:  # a child that a library forked and let come back here
            leave(0)
        seconds = round(monotonic() - began, 4)
        record.update(outcome=outcome, seconds=seconds, workers=self.workers, facts=facts)
        self.reply.write("check", check=check, **record)
        library.raised = None
        return outcome, told

    def _prepare(self):
        """Import the libraries before those modules of ours that bring numpy in."""
        if not self.case["env"]:
            skip("skip.no_environment")
        self.import_modules()

    def _arm(self, check):
        began = monotonic()
        limit = self.limits.get(check, DEFAULT_SECONDS)
        self.deadline = began + limit
        self.stacks.arm(0.9 * limit)
        return began


def _own_modules():
    """Return the files of ours that this process loaded."""
    prefix = __package__ + "."
    loaded = [name[len(prefix) :] + ".py" for name in sys.modules if name.startswith(prefix)]
    return sorted(["bootstrap.py", *loaded])
