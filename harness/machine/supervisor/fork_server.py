"""Fork a guard for each command that is asked for: Python starts once for all of them, and not once for each.

The harness is at the other end of a socket, which is our descriptor 0. A message is a pid and a signal, four bytes
each (little-endian). Pid 0 asks for a guard: with it come its three descriptors, and a fourth to which we write how it
ended; the answer is its pid, four bytes. Any other pid is a guard to be signalled: one that has ended gets nothing.
The end of the socket is the end of the harness, and ours. Guards see that at their own descriptors.
"""

from __future__ import annotations

import _socket
import os
import select
import sys

from harness.machine.supervisor import SIZE
from harness.machine.supervisor.guard import main
from harness.machine.supervisor.watch import CHUNK, wakeup_on_child

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
else:
    import _signal as signal

DESCRIPTORS = 4
"""Those that come for a guard: its order, its report, its log, and how it ended."""


class ForkServer:
    """The guards that are running: the pid of each, and the descriptor for its end."""

    def __init__(self) -> None:
        self.socket = _socket.socket(fileno=os.dup(0))
        self.woken = wakeup_on_child()
        self.ends: dict[int, int] = {}

    def serve(self) -> None:
        """Answer until the harness is gone."""
        poller = select.poll()
        for descriptor in (self.socket.fileno(), self.woken):
            poller.register(descriptor, select.POLLIN)
        while True:
            for descriptor, _ in poller.poll():
                if descriptor == self.woken:
                    os.read(self.woken, CHUNK)
                    self.reap()
                elif not self.answer():
                    return

    def answer(self) -> bool:
        """Take one message; False where there will be no other."""
        room = _socket.CMSG_SPACE(DESCRIPTORS * SIZE)
        message, passed, _, _ = self.socket.recvmsg(2 * SIZE, room, _socket.MSG_CMSG_CLOEXEC)
        if not message:
            return False
        pid, number = (int.from_bytes(part, "little") for part in (message[:SIZE], message[SIZE:]))
        if pid:
            if pid in self.ends:  # no other process has its pid before we have waited for it
                os.kill(pid, number)
            return True
        data = b"".join(part for _, _, part in passed)
        places = range(0, len(data), SIZE)
        descriptors = [int.from_bytes(data[place : place + SIZE], sys.byteorder) for place in places]
        self.socket.send(self.fork(descriptors).to_bytes(SIZE, "little"))
        return True

    def fork(self, descriptors: list[int]) -> int:
        """Start a guard with these descriptors; return its pid."""
        pid = os.fork()
        if pid == 0:
            self.become_guard(descriptors)
        *others, end = descriptors
        for descriptor in others:
            os.close(descriptor)
        self.ends[pid] = end
        return pid

    def become_guard(self, descriptors: list[int]) -> None:
        """Turn this process into a guard that holds nothing of ours, and never return."""
        code = 1
        try:
            os.setsid()
            # Nobody may write to the end of a guard but us: the others' ends are closed with all the rest.
            closed = {signal.set_wakeup_fd(-1), self.woken, self.socket.fileno(), *self.ends.values(), *descriptors}
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for target, descriptor in enumerate(descriptors[:-1]):
                os.dup2(descriptor, target)
            for descriptor in closed:
                os.close(descriptor)
            main()
            code = 0
        except BaseException:
            # What ends a guard must not go on as a server: every exception ends here, and the log shows it.
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(code)

    def reap(self) -> None:
        """Write how guards ended."""
        while self.ends:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if not pid:
                return
            end = self.ends.pop(pid)
            os.write(end, os.waitstatus_to_exitcode(status).to_bytes(SIZE, "little", signed=True))
            os.close(end)


def serve() -> None:
    """Serve with the streams of a daemon."""
    server = ForkServer()
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    server.serve()
