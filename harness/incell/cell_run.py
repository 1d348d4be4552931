"""Run the checks of a request, one after the other; whatever a library does becomes a record.

A check has a file of its own, `check_` and its name, with a function `run(probe, facts)`; the file is loaded when the
check is run. The request names the checks that follow another one that passed.

Nothing is imported here that a library might have forgotten to import itself: see `bootstrap`.
"""

import atexit
import json
import platform
import sys

from .cell_errors import Skip, blame, error_fields, library, observed_error, skip
from .cell_imports import Imports
from .cell_observation import current_step, observation
from .cell_originals import encode, getpid, import_module, join, leave, monotonic, write
from .cell_records import LAST_WORDS, RecordFile
from .cell_side_effects import report_raised, report_replaced, report_side_effects
from .cell_watch import Stacks, Watch

FINDINGS_OF_A_CHECK = 10
DEFAULT_SECONDS = 120.0
VERSIONED = (
    "gym", "gymnasium", "numpy", "mujoco", "mujoco_py", "dm_control", "pygame", "OpenGL", "glfw", "torch", "jax",
)  # fmt: skip
"""Libraries whose version as imported is written, where they were imported."""


def run(path):
    """Run the request in this file. The last line is written when Python ends: exceptions of exit handlers count."""
    with open(path, encoding="utf-8") as file:
        request = json.load(file)
    probe = Probe(request)
    atexit.register(probe.end)  # the first one registered runs last
    probe.run()


class Probe(Imports):
    """One process and its reply, which every check is given.

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
        self.reply = RecordFile(join(self.folder, "reply.jsonl"))
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
        self._findings = {}

    def run(self):
        """Run every check. Without the import, or one environment, the others would only fail in the same way."""
        for check in self.checks:
            outcome = self._attempt(check)
            if outcome == "passed":
                for follower in self.followers.get(check, ()):
                    self._attempt(follower, follows=True)
            elif outcome == "failed" and check.startswith(("import.", "single.")):
                break

    def finding(self, check, code, level="warning", **data):
        """Write a finding, which stops no user's loop: each once, at whatever step, a bounded number of them."""
        observed = observation(code, data)
        earlier = self._findings.setdefault(check, {})
        mark = encode(dict(observed, at=None))
        if mark in earlier or len(earlier) > FINDINGS_OF_A_CHECK:
            return
        earlier[mark] = observed
        if len(earlier) > FINDINGS_OF_A_CHECK:
            observed = observation("more", {})
        self.reply.write("finding", check=check, level=level, observed=observed)

    def findings(self, check):
        """Return the findings so far."""
        return list(self._findings.get(check, {}).values())

    def frame(self, check, which, name):
        """Write that a picture was saved in the folder."""
        self.reply.write("frame", check=check, which=which, path=name)

    def end(self):
        """Write the last line."""
        report_side_effects(self, "single", passed=True)
        if self.reply.pid == getpid() and self._phases:
            report_replaced(self, self._phases[-1])
        modules = {name: sys.modules.get(name) for name in VERSIONED}
        versions = {name: str(getattr(module, "__version__", "?"))[:50] for name, module in modules.items() if module}
        self.reply.write("end", modules=_own_modules(), versions=versions)
        try:  # noqa: SIM105 - contextlib may be what a library forgot to import
            write(2, "\n{}\n".format(LAST_WORDS).encode("ascii"))
        except OSError:  # a library that closes everything has closed this, too
            pass

    def _function(self, check):
        return import_module(".check_" + check.replace(".", "_"), __package__).run

    def _attempt(self, check, follows=False):
        """Run one check, write its record and return its outcome.

        A check that `follows` another was not requested. Where it can only find, what it raises is a finding, too.
        """
        phase, outcome, error, facts = check.partition(".")[0], "passed", None, {}
        record = {"raised": None, "observed": None}
        self.workers, self._compares = [], False
        self._phases.append(phase)
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
        except BaseException as raised:  # SystemExit and KeyboardInterrupt of a library are outcomes, too
            outcome, record, error = "failed", error_fields(raised), (observed_error(raised), blame(raised))
        self.stacks.disarm()
        current_step.number = None
        if getpid() != self.reply.pid:  # a child that a library forked and let come back here
            leave(0)
        seconds = round(monotonic() - began, 4)
        record.update(outcome=outcome, seconds=seconds, workers=self.workers, facts=facts)
        self.reply.write("check", check=check, **record)
        library.last_error = None
        if error and follows and not self._compares:
            report_raised(self, check, *error)
        report_side_effects(self, phase, passed=error is None)
        return outcome

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
    files = [name[len(prefix) :] + ".py" for name in sys.modules if name.startswith(prefix)]
    return sorted(["bootstrap.py", *files])
