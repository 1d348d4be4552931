"""Run one command, watch it, and leave nothing of it behind.

Run by path with the host's own interpreter (`python -I -S .../supervisor/__main__.py`): standard library only, nothing
of the rest of the package. `harness.machine.process` is the only caller and speaks to it through three descriptors:

    0  the order: its length (`SIZE` bytes, little-endian), then a dictionary as `marshal` writes it, which takes no
       import; later perhaps a line with the reason to end the command; the pipe's end means that the harness is gone
    1  the report: a dictionary, marshalled
    2  the log of the command, its head and tail

    harness -> guard -> keeper -> command -> ...

The guard enters the namespaces. The keeper, pid 1 of the PID namespace where there is one, starts the command, watches
it and ends the rest. Whichever of the three is killed, the others end everything below.
"""

SIZE = 4

__all__ = ["tree"]
