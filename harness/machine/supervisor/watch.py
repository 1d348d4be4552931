"""Watch the command from its start to its end: output, time and memory within their limits."""

from __future__ import annotations

import os
import resource
import select
import time

from harness.machine.supervisor import objects
from harness.machine.supervisor.memory import Memory
from harness.machine.supervisor.rights import confine
from harness.machine.supervisor.sandbox import prctl, shares_objects
from harness.machine.supervisor.tree import SupervisorError, descendants, end_all, reap

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
    from typing import Any
else:
    import _signal as signal

GRACE = 0.5  # seconds between SIGTERM and SIGKILL
STRAY_GRACE = 0.25  # helpers such as multiprocessing's resource tracker end by themselves just after their parent
LOOK = 0.1  # seconds between two looks at the memory
CHUNK = 1 << 16
PR_SET_PDEATHSIG = 1


def spawn(order: dict[str, Any], output: int) -> int:
    """Start the command with everything it prints going to `output`; return its pid."""
    reader, trouble = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            become(order, output)
        except (SupervisorError, OSError, ValueError) as error:
            os.write(trouble, str(error).encode(errors="backslashreplace"))
        finally:
            os._exit(127)
    os.close(trouble)
    # The pipe closes at exec, so an end without a message means that the command has started.
    with open(reader, "rb") as file:
        message = file.read().decode()
    if message:
        os.waitpid(pid, 0)
        raise SupervisorError(message)
    return pid


def become(order: dict[str, Any], output: int) -> None:
    """Turn this process into the command, as a login shell would start it: no signal ignored, no terminal."""
    os.setsid()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    os.umask(0o022)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with open("/proc/self/oom_score_adj", "w") as file:  # should the kernel need memory, then not the harness's
        file.write("500")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    if order["confined"]:
        confine(apart=order["sandbox"].startswith("subreaper"))
    prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # the last resort, where guard and keeper are killed
    program = order["argv"][0]
    doing = f"enter {order['cwd']}"
    try:
        os.chdir(order["cwd"])
        doing = f"run {program}"
        os.execvpe(program, order["argv"], order["env"])
    except OSError as error:
        message = f"cannot {doing}: {error.strerror}"
        raise SupervisorError(message) from None


class Log:
    """Head and tail of endless output, within a limit of bytes."""

    def __init__(self, limit: int) -> None:
        self.head, self.room = limit // 2, limit - limit // 2
        self.tail = bytearray()
        self.omitted = 0

    def feed(self, data: bytes) -> None:
        """Take more output."""
        now, later = data[: self.head], data[self.head :]
        self.head -= len(now)
        write_all(2, now)
        self.tail += later
        excess = len(self.tail) - self.room
        if excess > 0:
            del self.tail[:excess]
            self.omitted += excess

    def close(self) -> None:
        """Write the tail."""
        if self.omitted:
            write_all(2, f"\n[... {self.omitted} bytes left out here ...]\n".encode())
        write_all(2, bytes(self.tail))


def write_all(descriptor: int, data: bytes) -> None:
    """Write all of it."""
    while data:
        data = data[os.write(descriptor, data) :]


class Watch:
    """The command from its start to its end."""

    def __init__(self, order: dict[str, Any], parent: int) -> None:
        self.log = Log(order["output_kb"] * 1024)
        self.parent = parent
        self.memory = Memory(order["memory_mb"] << 20, private=order["sandbox"] != "subreaper" and order["confined"])
        self.home = order["home"]
        self.least_room = room(self.home)
        self.swept = order["confined"] and shares_objects(order)
        self.apart = order["sandbox"].startswith("pid")
        self.objects = objects.present() if self.swept else set()
        self.seen: set[int] = set()
        self.output, inlet = os.pipe()
        os.set_blocking(self.output, False)
        self.poller = select.poll()
        for descriptor in (0, self.output, wakeup_on_child()):
            self.poller.register(descriptor, select.POLLIN)
        self.ended: dict[int, int] = {}
        self.killed: str | None = None
        self.timed_out = self.out_of_memory = False
        self.started = time.monotonic()
        self.deadline, self.last_chance = self.started + order["seconds"], float("inf")
        self.next_look = self.started + LOOK
        self.pid = spawn(order, inlet)
        self.seen.add(self.pid)
        os.close(inlet)

    def run(self, early: bytes) -> dict[str, Any]:
        """Watch until the end, leave nothing behind, and say what happened."""
        if early:
            self.obey(early)
        # The end of the output is not waited for: a daemon may hold the pipe open.
        while self.pid not in self.ended:
            self.wait()
            reap(self.ended)
            self.look()
        seconds = time.monotonic() - self.started
        # Strays end before the output is drained: one that prints without end would keep `drain` busy for ever.
        stray = self.clear()
        self.drain()
        self.log.close()
        self.sweep()
        code = os.waitstatus_to_exitcode(self.ended[self.pid])
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        largest = usage.ru_maxrss << 10  # of one that ended between two looks
        starved = self.memory.kills()
        # SIGKILL does not name its sender. If the kernel ended a process for want of memory meanwhile, it may have
        # been this one, and then the command is not to blame.
        if code == -signal.SIGKILL and not self.ending() and starved:
            self.out_of_memory, self.killed = True, self.memory.shortage()
        return {
            "exit_code": code if code >= 0 else None,
            "signal": -code if code < 0 else None,
            "timed_out": self.timed_out,
            "out_of_memory": self.out_of_memory,
            "killed": self.killed,
            "seconds": seconds,
            "core_seconds": usage.ru_utime + usage.ru_stime,
            "peak_mb": max(self.memory.peak, largest) >> 20,
            "starved": starved,
            "least_room_mb": self.least_room,
            "truncated": bool(self.log.omitted),
            "stray": stray,
        }

    def ending(self) -> bool:
        """Return whether we are the ones who end it."""
        return self.timed_out or self.out_of_memory or self.killed is not None

    def wait(self) -> None:
        """Sleep until something happens, at most until the next look."""
        until = min(self.next_look, self.deadline, self.last_chance)
        for descriptor, _ in self.poller.poll(max(0.0, until - time.monotonic()) * 1000):
            if descriptor == 0:
                self.obey(os.read(0, CHUNK))
            elif descriptor != self.output:
                os.read(descriptor, CHUNK)
            elif not self.pump():
                self.poller.unregister(self.output)

    def obey(self, order: bytes) -> None:
        """End the command: for the reason given, or at once where the harness is gone."""
        if order:
            self.killed = order.partition(b"\n")[0].decode()
            self.terminate()
        else:
            self.killed = self.killed or "the harness is gone"
            end_all(self.ended)

    def look(self) -> None:
        """Hold time and memory against their limits."""
        now = time.monotonic()
        if self.parent and os.getppid() != self.parent:
            self.killed = self.killed or "the guard is gone"
            end_all(self.ended)
        elif now >= self.last_chance:
            end_all(self.ended)
        elif now >= self.deadline:
            self.timed_out = True
            self.terminate()
        if now >= self.next_look and not self.out_of_memory:
            if self.memory.exceeded():
                self.out_of_memory = True
                end_all(self.ended)
            self.least_room = min(self.least_room, room(self.home))
            if self.swept and not self.apart:
                self.seen.update(descendants())
            after = time.monotonic()
            # A look reads all of /proc: on a busy machine looks become rarer, and take a twentieth of the time at most.
            self.next_look = after + max(LOOK, 20 * (after - now))

    def terminate(self) -> None:
        """Ask the command to end, and be ready to insist."""
        self.deadline = float("inf")
        # A second order does not put SIGKILL off.
        self.last_chance = min(self.last_chance, time.monotonic() + GRACE)
        if self.pid not in self.ended:
            os.kill(self.pid, signal.SIGTERM)

    def clear(self) -> int:
        """End the processes that the command left behind; return how many. Helpers may first end by themselves."""
        patience = time.monotonic() + STRAY_GRACE
        while not self.ending() and descendants() and time.monotonic() < patience:
            time.sleep(0.005)
            self.pump()
            reap(self.ended)
        return end_all(self.ended)

    def sweep(self) -> None:
        """Remove the System V objects that the command left, where they are not in a namespace that ends with it.

        In a namespace of processes nobody else's have a number; without one those count that were seen.
        """
        if self.swept:
            seen = self.seen | set(self.ended)
            objects.remove((lambda pid: True) if self.apart else seen.__contains__, self.objects)

    def drain(self) -> None:
        """Read what is there, without waiting for more."""
        while self.pump():
            continue

    def pump(self) -> bool:
        """Move one chunk of output to the log; False where there is none now."""
        try:
            data = os.read(self.output, CHUNK)
        except BlockingIOError:
            return False
        self.log.feed(data)
        return bool(data)


def room(folder: str) -> int:
    """Return the MB that are free on the disk of a folder, as many as one may use."""
    try:
        disk = os.statvfs(folder)
    except OSError:
        # A HOST command has no home, and a probe may remove its own: then no shortage is seen.
        return 1 << 40
    return disk.f_bavail * disk.f_frsize >> 20


def wakeup_on_child() -> int:
    """Return a descriptor that can be read when a child has ended."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    # Python writes to the descriptor only for signals that have a handler, so there is one that does nothing.
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    return reader
