"""Make environments in workers of a vector environment; each worker leaves its first exception, and how far it came.

The parent gets a mask: `BrokenPipeError`, `ConnectionResetError` or `EOFError` for anything that ended a
worker, and in gym 0.26 a `TypeError` for any exception of step().
"""

import functools

from .cell_errors import error_fields, library
from .cell_module_search import import_or_call
from .cell_originals import getpid, join, monotonic
from .cell_records import RecordFile
from .cell_watch import Stacks


class Maker:
    """Make one environment. In a worker, whatever happens to it is also written to files of the worker's own."""

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
            return self.make()
        name = join(self.folder, "worker-{}".format(getpid()))
        stacks = Stacks(name + ".txt")
        stacks.arm(0.9 * (self.deadline - monotonic()))
        diary = Diary(RecordFile(name + ".jsonl"), self.check)
        env = diary.record("constructor", self.make)()
        diary.write_stage("constructed")
        for stage in ("reset", "step"):
            try:
                setattr(env, stage, diary.record(stage, getattr(env, stage)))
            except AttributeError:  # an environment may refuse new attributes
                break
        return env

    def make(self):
        """Make one; in a worker that is started anew Python runs a user's script again, and so its imports."""
        for name in self.modules:
            import_or_call(name)
        return self.api.make_raw(self.case)


class Diary:
    """Write the stages that a worker reached, each once, and its first exception."""

    def __init__(self, lines, check):
        self._lines = lines
        self._check = check
        self._stages = set()
        self._raised = False
        self.write_stage("start")

    def write_stage(self, stage):
        """Write a stage, unless it is written already."""
        if stage not in self._stages:
            self._stages.add(stage)
            self._lines.write("reached", check=self._check, stage=stage)

    def record(self, stage, function):
        """Wrap a function: it is a stage, and its exception is written before it goes on."""

        @functools.wraps(function)
        def wrapper(*args, **kwargs):
            self.write_stage(stage)
            try:
                with library:
                    return function(*args, **kwargs)
            except BaseException as error:
                self._write_error(error)
                raise

        return wrapper

    def _write_error(self, error):
        if not self._raised:
            self._raised = True
            self._lines.write("raised", check=self._check, **error_fields(error))


def end_workers(env, error, patience):
    """End the workers of a vector environment and return their exit codes, None for those that had to be killed.

    All together they have `patience` seconds to end by themselves. Where its constructor never returned the
    environment, the workers are taken from the traceback of the error.
    """
    workers = getattr(env, "processes", None)
    step = error.__traceback__ if error is not None else None
    while workers is None and step is not None:
        workers = getattr(step.tb_frame.f_locals.get("self"), "processes", None)
        step = step.tb_next
    workers = [worker for worker in workers or () if getattr(worker, "pid", None)]  # those that could be started
    deadline = monotonic() + patience
    for worker in workers:
        worker.join(max(0.0, deadline - monotonic()))
    exits = [{"pid": worker.pid, "exit_code": worker.exitcode} for worker in workers]
    for worker in workers:
        if worker.exitcode is None:
            worker.kill()
            worker.join(5.0)
    return exits
