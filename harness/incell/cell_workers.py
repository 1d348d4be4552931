"""Worker processes of a vector environment: each leaves its own first exception, and how far it came.

What the parent gets is a mask: `BrokenPipeError`, `ConnectionResetError` or `EOFError` for anything that ended a
worker, and in gym 0.26 a `TypeError` for any exception of step().
"""

import functools

from .cell_errors import failure, library
from .cell_kept import getpid, join, monotonic
from .cell_lines import Lines
from .cell_search import imported
from .cell_watch import Stacks


class Maker:
    """Makes one environment. In a worker, whatever happens to it is also written to files of the worker's own."""

    def __init__(self, probe, check):
        self.api = probe.api
        self.case = probe.case
        self.modules = list(probe.import_modules())
        self.folder = probe.folder
        self.parent = probe.reply.pid
        self.deadline = probe.deadline
        self.check = check

    def __call__(self):
        """Make the environment; the parent makes one, too, to know its spaces."""
        if getpid() == self.parent:
            return self.made()
        name = join(self.folder, "worker-{}".format(getpid()))
        stacks = Stacks(name + ".txt")
        stacks.arm(0.9 * (self.deadline - monotonic()))
        diary = Diary(Lines(name + ".jsonl"), self.check)
        env = diary.kept("constructor", self.made)()
        diary.reached("constructed")
        for stage in ("reset", "step"):
            try:
                setattr(env, stage, diary.kept(stage, getattr(env, stage)))
            except AttributeError:  # an environment may refuse new attributes
                break
        return env

    def made(self):
        """Make one; in a worker that is started anew Python runs a user's script again, and so its imports."""
        for name in self.modules:
            imported(name)
        return self.api.bare(self.case)


class Diary:
    """Writes what a worker reached, each stage once, and its first exception."""

    def __init__(self, lines, check):
        self._lines = lines
        self._check = check
        self._stages = set()
        self._raised = False
        self.reached("start")

    def reached(self, stage):
        """Write a stage, unless it is written already."""
        if stage not in self._stages:
            self._stages.add(stage)
            self._lines.write("reached", check=self._check, stage=stage)

    def kept(self, stage, function):
        """Wrap a function: it is a stage, and its exception is written before it goes on."""

        @functools.wraps(function)
        def wrapper(*args, **kwargs):
            self.reached(stage)
            try:
                with library:
                    return function(*args, **kwargs)
            except BaseException as error:
                self._wrote(error)
                raise

        return wrapper

    def _wrote(self, error):
        if not self._raised:
            self._raised = True
            self._lines.write("raised", check=self._check, **failure(error))


def processes(env, error):
    """Return the workers of a vector environment, found in the traceback where its constructor never returned it."""
    found = getattr(env, "processes", None)
    step = error.__traceback__ if error is not None else None
    while found is None and step is not None:
        found = getattr(step.tb_frame.f_locals.get("self"), "processes", None)
        step = step.tb_next
    return [process for process in found or () if getattr(process, "pid", None)]  # those that could be started


def endings(workers, patience):
    """Wait for the workers, `patience` seconds for all together: their exit codes, None for those still running."""
    deadline = monotonic() + patience
    for worker in workers:
        worker.join(max(0.0, deadline - monotonic()))
    return [{"pid": worker.pid, "exit_code": worker.exitcode} for worker in workers]


def finish(workers):
    """End the workers that are left."""
    for worker in workers:
        if worker.exitcode is None:
            worker.kill()
            worker.join(5.0)
