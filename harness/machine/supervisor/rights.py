"""Drop rights: the command may not do everything to this machine that the user of the harness may.

The capabilities that it keeps are those of a container, less what reaches past its own files: without CAP_SYS_ADMIN it
cannot take a mount away, without CAP_SYS_PTRACE it cannot read what belongs to a process with more rights. The network,
and the files that the user may read or write, stay open to it.
"""

from __future__ import annotations

import ctypes
import os

from harness.machine.supervisor.sandbox import call, libc, prctl

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

CHOWN, DAC_OVERRIDE, FOWNER, FSETID, KILL, SETGID, SETUID = 0, 1, 3, 4, 5, 6, 7
NET_BIND_SERVICE, NET_RAW, IPC_LOCK, IPC_OWNER, SYS_CHROOT, SYS_NICE, SETFCAP = 10, 13, 14, 15, 18, 23, 31
FILES = (CHOWN, DAC_OVERRIDE, FOWNER, FSETID, SETFCAP)
OTHERS = (KILL, SETGID, SETUID, NET_BIND_SERVICE, NET_RAW, IPC_LOCK, IPC_OWNER, SYS_CHROOT, SYS_NICE)
CAPABILITY_MASK = sum(1 << capability for capability in (*FILES, *OTHERS))
CAPABILITIES = 64  # in the three sets of capset(2); the kernel refuses those that it does not know

PR_CAPBSET_DROP, PR_SET_NO_NEW_PRIVS, PR_CAP_AMBIENT, PR_CAP_AMBIENT_CLEAR_ALL = 24, 38, 47, 4
CAPABILITY_VERSION = 0x20080522
LANDLOCK_CREATE_RULESET, LANDLOCK_ADD_RULE, LANDLOCK_RESTRICT_SELF = 444, 445, 446
LANDLOCK_VERSION, PATH_BENEATH, ACCESS_REFER, SCOPE_SIGNAL = 1, 1, 1 << 13, 2
FIRST_WITH_REFER, FIRST_WITH_SCOPES = 2, 6

DRIVER, DEVICE, LOADER = "/proc/driver/nvidia/version", "/dev/nvidia-uvm", "nvidia-modprobe"


def ready_gpu() -> None:
    """Have NVIDIA's device for CUDA made, as its library does at first use: that takes rights that are given up."""
    if os.path.exists(DEVICE) or not os.path.exists(DRIVER):
        return
    pid = os.fork()
    if pid == 0:
        try:
            for stream in (0, 1, 2):  # ours are the harness's
                os.dup2(os.open(os.devnull, os.O_RDWR), stream)
            os.execvp(LOADER, [LOADER, "-c", "0", "-u"])
        except OSError:
            os._exit(127)
    os.waitpid(pid, 0)


def confine(apart: bool) -> None:
    """Give up the rights that the command is not to have, for ever; `apart` where it has no processes of its own."""
    prctl(PR_SET_NO_NEW_PRIVS, 1)
    # The bounding set comes before `drop_now`, which gives up CAP_SETPCAP: without it nothing can be dropped there.
    for capability in range(CAPABILITIES):
        if not CAPABILITY_MASK >> capability & 1:
            try:
                prctl(PR_CAPBSET_DROP, capability)
            except OSError:  # one that this kernel does not know, or we may not drop any: then they go with exec
                continue
    tolerated(lambda: prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_CLEAR_ALL))
    tolerated(drop_now)
    if apart:
        tolerated(stay_among_own)


def tolerated(step: Callable[[], object]) -> None:
    """Take a step that not every kernel, or container, allows."""
    try:
        step()
    except (OSError, AttributeError):
        # An AttributeError means a C library without this function.
        return


def drop_now() -> None:
    """Keep only `CAPABILITY_MASK` of our capabilities: with no_new_privs no program that is started gets more back."""
    header, sets = (ctypes.c_uint32 * 2)(CAPABILITY_VERSION, 0), (ctypes.c_uint32 * 6)()
    call("capget", header, sets)
    for number in range(6):  # effective, permitted, inheritable: of the capabilities below 32, then of those above
        mask = CAPABILITY_MASK >> 32 * (number // 3) & 0xFFFFFFFF
        sets[number] = 0 if number % 3 == 2 else sets[number] & mask
    call("capset", header, sets)


def stay_among_own() -> None:
    """Forbid, by Landlock, to read variables and memory of processes that are not below, and to signal them.

    A kernel before 6.12 has no rules for signals; there, a rule for files that forbids nothing protects variables and
    memory.
    """
    version = libc.syscall(LANDLOCK_CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(LANDLOCK_VERSION))
    if version < FIRST_WITH_REFER:
        return
    scoped = version >= FIRST_WITH_SCOPES
    rules = (ctypes.c_uint64 * 3)(0, 0, SCOPE_SIGNAL) if scoped else (ctypes.c_uint64 * 1)(ACCESS_REFER)
    size = ctypes.c_size_t(ctypes.sizeof(rules))
    ruleset = libc.syscall(LANDLOCK_CREATE_RULESET, rules, size, ctypes.c_uint32(0))
    if ruleset < 0:
        return
    if not scoped:
        root = os.open("/", os.O_PATH | os.O_DIRECTORY)
        everything = ACCESS_REFER.to_bytes(8, "little") + root.to_bytes(4, "little")
        libc.syscall(LANDLOCK_ADD_RULE, ruleset, PATH_BENEATH, everything, ctypes.c_uint32(0))
        os.close(root)
    libc.syscall(LANDLOCK_RESTRICT_SELF, ruleset, ctypes.c_uint32(0))
    os.close(ruleset)
