"""Use this machine: processes under the supervisor, files and file locks, interpreters, displays, memory."""

__all__ = [
    "console",
    "debian_packages",
    "display",
    "free_memory",
    "interpreters",
    "interrupts",
    "process",
    "source_digests",
    "store",
    "this_machine",
]
