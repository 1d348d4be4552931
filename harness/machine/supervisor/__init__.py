"""Run commands, watch them, and leave nothing of them behind.

Run by path with the host's own interpreter (`python -I -S .../supervisor/__main__.py`): standard library only, nothing
of the rest of the package. `harness.machine.fork_server` is the only caller. The process that it starts forks a guard
for each command, to which `harness.machine.process` speaks through three descriptors:

    0  the order: its length (`SIZE` bytes, little-endian), then a dictionary as `marshal` writes it, which takes no
       import; later perhaps a line with the reason to end the command; the pipe's end means that the harness is gone
    1  the report: a dictionary, marshalled
    2  the log of the command, its head and tail

    harness -> fork server -> guard -> keeper -> command -> ...

The guard enters the namespaces. The keeper, pid 1 of the PID namespace where there is one, starts the command, watches
it and ends the rest. Whichever of the three is killed, the others end everything below.
"""

SIZE = 4
"""The bytes of a number in what is sent: the length of an order, a pid, a signal, an exit code."""

__all__ = ["tree"]
