"""Use this machine: processes under the supervisor, files and file locks, interpreters, displays, cores and memory."""

__all__ = [
    "capacity",
    "console",
    "debian_packages",
    "display",
    "interpreters",
    "interrupts",
    "process",
    "source_digests",
    "store",
    "this_machine",
]
