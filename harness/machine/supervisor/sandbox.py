"""Set up namespaces and mounts: the command's view of this machine, which keeps its writes away from the machine."""

from __future__ import annotations

import ctypes
import os

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

CLONE_NEWNS, CLONE_NEWIPC, CLONE_NEWUSER, CLONE_NEWPID = 0x00020000, 0x08000000, 0x10000000, 0x20000000
MS_RDONLY, MS_NOSUID, MS_NODEV, MS_NOEXEC, MS_REMOUNT = 1, 2, 4, 8, 32
MS_NOATIME, MS_NODIRATIME, MS_BIND, MS_REC, MS_PRIVATE = 1024, 2048, 4096, 16384, 1 << 18
MNT_DETACH = 2
ESCAPED = str.maketrans({character: f"\\{character}" for character in "\\:,"})
"""What the options of an overlay do not take as it is."""

OVERLAY_OPTIONS = (",userxattr,volatile", ",userxattr", "")
"""The best first. A user namespace needs `userxattr`, which kernels before 5.11 do not know. `volatile` (since 5.10)
writes nothing to the disk before the layer is thrown away."""

NAMES, LENGTH = 20_000, 1_000
"""Entries of a layer over byte code that are looked at, and the characters that the path of one may have."""

libc = ctypes.CDLL(None, use_errno=True)


def call(name: str, *arguments: Any) -> None:
    """Call the C library; OSError where it refuses."""
    if getattr(libc, name)(*arguments) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code), name)


def prctl(option: int, value: int) -> None:
    """Call prctl(2)."""
    call("prctl", option, ctypes.c_ulong(value), ctypes.c_ulong(0), ctypes.c_ulong(0), ctypes.c_ulong(0))


def mount(source: str, target: str, kind: str | None, flags: int = 0, options: str = "") -> None:
    """Call mount(2)."""
    encoded = (os.fsencode(source), os.fsencode(target), kind.encode() if kind else None)
    call("mount", *encoded, ctypes.c_ulong(flags), os.fsencode(options))


def umount(target: str) -> None:
    """Call umount2(2), though something below may still be open."""
    call("umount2", os.fsencode(target), MNT_DETACH)


def shares_objects(order: dict[str, Any]) -> bool:
    """Tell whether a command shares the host's System V objects, through which it hands pictures to an X server."""
    return order["sandbox"] == "subreaper" or "DISPLAY" in order["env"] or not os.path.exists("/proc/self/ns/ipc")


def enter_namespaces(order: dict[str, Any]) -> None:
    """Leave the host's mounts and, for the children to come, its processes; in a user namespace where need be."""
    sandbox = order["sandbox"]
    flags = (CLONE_NEWPID if sandbox.startswith("pid") else 0) | (CLONE_NEWNS if sandbox != "subreaper" else 0)
    flags |= 0 if shares_objects(order) else CLONE_NEWIPC
    if not flags:
        return
    # The ids are read before the call: in a new user namespace everybody is nobody until the maps are written.
    user, group = os.geteuid(), os.getegid()
    try:
        call("unshare", flags)
    except PermissionError:
        call("unshare", flags | CLONE_NEWUSER)
        # The order matters: the kernel takes no gid_map of an ordinary user before setgroups is denied.
        for name, text in (("setgroups", "deny"), ("uid_map", f"{user} {user} 1"), ("gid_map", f"{group} {group} 1")):
            with open(f"/proc/self/{name}", "w") as file:
                file.write(text)


class Layer:
    """A throw-away layer over a sealed folder: what is written there lands in `upper`."""

    def __init__(self, folder: str, scratch: str) -> None:
        self.folder, self.scratch = folder, scratch
        self.upper, self.work = f"{scratch}/upper", f"{scratch}/work"
        # The folder is opened before the overlay covers it: later no path leads below the overlay.
        self.lower = os.open(folder, os.O_PATH | os.O_DIRECTORY)
        os.makedirs(scratch)
        self.in_memory = False
        try:
            self.cover()
        except OSError:  # not every file system can hold an upper layer, a tmpfs can
            self.in_memory = True
            mount("tmpfs", scratch, "tmpfs", MS_NOSUID | MS_NODEV)
            self.cover()

    def cover(self) -> None:
        """Mount the overlay with the first options that this kernel takes."""
        for path in (self.upper, self.work):
            os.makedirs(path, exist_ok=True)
        os.chmod(self.upper, os.stat(self.folder).st_mode & 0o7777)
        paths = (("lowerdir", self.folder), ("upperdir", self.upper), ("workdir", self.work))
        options = ",".join(f"{name}={path.translate(ESCAPED)}" for name, path in paths)
        *better, plain = OVERLAY_OPTIONS
        for extra in better:
            try:
                mount("overlay", self.folder, "overlay", 0, options + extra)
            except OSError:  # a kernel that does not know it
                continue
            return
        mount("overlay", self.folder, "overlay", 0, options + plain)

    def written(self) -> Iterator[str]:
        """Yield new, changed and removed paths, relative to the folder; byte code is left out."""
        for parent, folders, files in os.walk(self.upper):
            base = os.path.relpath(parent, self.upper)
            folders[:] = sorted(set(folders) - {"__pycache__"})
            # A removed path is a device in the upper layer, which `os.walk` lists among the files.
            # A folder that existed lies there only because something inside it changed.
            for name in sorted(set(files) - {"__pycache__"}) + folders:
                path = os.path.normpath(os.path.join(base, name))
                if name in files or not self.existed(path):
                    yield path

    def compiled(self) -> Iterator[str]:
        """Yield the paths of new and changed byte code, relative to the folder, as far as names are of use."""
        waiting, seen = [self.upper], 0
        while waiting and seen < NAMES:
            try:
                with os.scandir(waiting.pop()) as entries:
                    for entry in entries:
                        seen += 1
                        if len(entry.path) > LENGTH:
                            continue
                        if entry.is_dir(follow_symlinks=False):
                            waiting.append(entry.path)
                        elif entry.name.endswith(".pyc") and entry.is_file(follow_symlinks=False):
                            yield entry.path[len(self.upper) + 1 :]
            except OSError:  # the command has taken its own rights away
                continue

    def existed(self, path: str) -> bool:
        """Return whether the sealed folder has this path."""
        try:
            os.stat(path, dir_fd=self.lower, follow_symlinks=False)
        except OSError:
            return False
        return True

    def remove(self) -> None:
        """Remove the layer: its work folder is closed to everyone but us."""
        umount(self.folder)
        if self.in_memory:
            umount(self.scratch)
        for parent, folders, files in os.walk(self.scratch, topdown=False):
            for path in (*(os.path.join(parent, name) for name in files + folders), parent):
                try:
                    (os.rmdir if os.path.isdir(path) and not os.path.islink(path) else os.unlink)(path)
                except OSError:  # the owner of the home removes what is left
                    continue


def supply_shared_memory(scratch: str) -> None:
    """Cover /dev with a copy that has the same entries and a folder `shm`; the machine's own stays as it is."""
    os.makedirs(scratch)
    mount("tmpfs", scratch, "tmpfs", MS_NOSUID, "mode=755")
    for entry in os.scandir("/dev"):
        target = f"{scratch}/{entry.name}"
        if entry.is_symlink():
            os.symlink(os.readlink(entry.path), target)
            continue
        if entry.is_dir():
            os.mkdir(target)
        else:
            os.close(os.open(target, os.O_CREAT | os.O_WRONLY))
        mount(entry.path, target, None, MS_BIND | MS_REC)
    os.mkdir(f"{scratch}/shm")
    mount(scratch, "/dev", None, MS_BIND | MS_REC)
    umount(scratch)
    os.rmdir(scratch)


def furnish(order: dict[str, Any]) -> dict[str, Layer]:
    """Mount the command's view: its own /proc and /dev/shm, and sealed folders; return the layers that cover them."""
    process, _, seal = order["sandbox"].partition("+")
    if not seal:
        return {}
    # Many systems share their mounts: without this, ours would appear on the machine itself.
    mount("none", "/", None, MS_REC | MS_PRIVATE)
    if process == "pid":
        mount("proc", "/proc", "proc", MS_NOSUID | MS_NODEV | MS_NOEXEC)
    if not os.path.isdir("/dev/shm"):
        supply_shared_memory(f"{order['home']}/.dev")
    mount("tmpfs", "/dev/shm", "tmpfs", MS_NOSUID | MS_NODEV, f"mode=1777,size={order['memory_mb']}m")
    open_folders = [(path, os.open(path, os.O_PATH)) for path in order["writable"]]
    shield(order["shielded"], open_folders)
    layers = {}
    closed = [*order["sealed"], *order["byte_code"]]
    for number, folder in enumerate(closed):
        if seal == "overlay":
            layers[folder] = Layer(folder, f"{order['home']}/.sealed/{number}")
        else:
            read_only(folder)
    reopen(open_folders, closed)
    return layers


def shield(folders: list[str], open_folders: list[tuple[str, int]]) -> None:
    """Let nothing be written to the harness's own folders, those for the command apart."""
    for folder in folders:
        read_only(folder)
    reopen(open_folders, folders)


def read_only(folder: str) -> None:
    """Mount a folder over itself, so that nothing can be written to it."""
    mount(folder, folder, None, MS_BIND | MS_REC)
    # A bind mount becomes read-only only by a second call. In a user namespace the kernel refuses that call if it
    # drops flags that the mount had.
    flags = os.statvfs(folder).f_flag & (MS_NOSUID | MS_NODEV | MS_NOEXEC | MS_NOATIME | MS_NODIRATIME)
    mount("none", folder, None, MS_REMOUNT | MS_BIND | MS_RDONLY | flags)


def reopen(open_folders: list[tuple[str, int]], closed: list[str]) -> None:
    """Mount writable folders as they were before the folder above them was closed."""
    for path, descriptor in open_folders:
        if any(os.path.commonpath((path, folder)) == folder for folder in closed):
            mount(f"/proc/self/fd/{descriptor}", path, None, MS_BIND | MS_REC)
