"""Describe this machine: its class, to which results belong, and the parts of it that a cell may use."""

from __future__ import annotations

import functools
import os
import platform
import re
import shutil
import sys
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from pathlib import Path
from threading import RLock
from types import MappingProxyType
from typing import Any

import msgspec
from msgspec import Struct

from harness.machine import display, process
from harness.machine.files import guarded_files
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.process import Command, Completed, Limits, Profile, run
from harness.machine.store import cache_folder, digest, write_atomic
from harness.model.vocabulary import readers
from harness.standalone.failures.lines import normalise

NOTHING: Mapping[str, str] = MappingProxyType({})
PROBE = Path(__file__).parent / "gl_probe.py"

HINTS = {
    "egl": ("EGL", "install Debian's libegl1 and libgl1-mesa-dri, or the GPU vendor's driver"),
    "osmesa": ("OSMesa", "install Debian's libosmesa6"),
    "display": ("X display", "install Debian's xvfb and libgl1-mesa-dri, or run where DISPLAY names an X server"),
    "glu": ("GLU", "install Debian's libglu1-mesa"),
    "vulkan": (
        "Vulkan device",
        "install Debian's libvulkan1 and mesa-vulkan-drivers (software; SAPIEN needs those of Debian 13 or later), "
        "or the GPU vendor's driver",
    ),
    "gpu": ("NVIDIA GPU", "run on a machine that has one, with its driver"),
}
"""What a matrix may name under `needs`: what it is called, and what to do where it is missing."""

ENVIRONMENT = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",  # the system's tools, no user's wrappers
    "LANG": "C.UTF-8",  # Python 3.7 and subprocesses would otherwise write ASCII
}
"""What every cell and every build has, whoever starts it."""

VULKAN = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")
"""Variables that say which drivers of Vulkan's there are."""

PASSED = {
    "": (  # where the OpenGL drivers lie, where that is not the usual place
        "__EGL_VENDOR_LIBRARY_FILENAMES",
        "__EGL_VENDOR_LIBRARY_DIRS",
        "LIBGL_DRIVERS_PATH",
    ),
    "vulkan": VULKAN,
    "gpu": ("CUDA_VISIBLE_DEVICES", "CUDA_DEVICE_ORDER", *VULKAN),  # which GPU of a shared machine is ours
}
"""The user's variables that a cell sees: always, or if it has that need. Not LD_LIBRARY_PATH, which would put other
libraries under the ones being tested: a matrix may set it."""


class Machine(Struct, frozen=True, kw_only=True):
    """A class of machine and this one's facts. Two machines with one id give the same results."""

    id: str
    facts: Mapping[str, Any]
    capabilities: frozenset[str]


def facts() -> Machine:
    """Return this machine; facts that take a process to find out are kept until the system changes.

    One thread looks, however many ask.
    """
    with _looking:
        return _facts()


def forget() -> None:
    """Forget all that this process knows of this machine, as a new process would."""
    _facts.cache_clear()


_looking = RLock()


@functools.cache
def _facts() -> Machine:
    parts = _parts()
    libc = " ".join(platform.libc_ver()).strip() or "unknown libc"
    properties = {
        "os": _distribution(),
        "kernel": ".".join(platform.release().split(".")[:2]),
        "architecture": platform.machine(),
        "libc": libc,
        "cpus": len(os.sched_getaffinity(0)),
        "memory_mb": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") >> 20,
        **parts,
    }
    return Machine(
        id="-".join((sys.platform, platform.machine(), libc.replace(" ", ""), label(parts))),
        facts=properties,
        capabilities=frozenset(name for name, part in parts.items() if "missing" not in part),
    )


SYSTEM = (
    "/usr/bin",
    "/usr/local/bin",
    "/usr/include",
    "/usr/lib",
    f"/usr/lib/{os.uname().machine}-linux-gnu",
    "/etc/ld.so.cache",
)
"""Folders and files that change when a program, a header or a library comes or goes."""

DRAWN_WITH = {"egl": "egl", "osmesa": "osmesa", "glfw": "display", "glx": "display", "": "display"}
"""Values of MUJOCO_GL, and what each draws with; where it stays unset on purpose, a window is tried first."""

WAYS = {"egl": "egl", "osmesa": "osmesa", "display": "glfw"}
"""Capabilities with which MuJoCo can draw, the best first, and the value of MUJOCO_GL that asks for each."""

PYGLET = "pyglet"


def choose_variables(
    given: Mapping[str, str], needs: Collection[str] = (), packages: Mapping[str, str] = NOTHING
) -> dict[str, str]:
    """Return the variables that rendering needs here, never over a variable that was given, be it empty.

    A display is among them only where something draws on one: `needs` and `packages` (with their versions) tell.
    """
    capabilities = facts().capabilities
    variables: dict[str, str] = {}
    way = next((value for name, value in WAYS.items() if name in capabilities), None)
    if way:
        variables["MUJOCO_GL"] = way
    if given.get("MUJOCO_GL", way) == "osmesa":
        # PyOpenGL binds itself to GLX where it is imported first, and then has no functions of OSMesa.
        variables["PYOPENGL_PLATFORM"] = "osmesa"
    variables["SDL_VIDEODRIVER"] = "dummy"
    shown = {*needs, *drawing_needs({**variables, **given}), *_pyglet_needs(packages)}
    if given.get("SDL_VIDEODRIVER") == "x11":
        shown.add("display")
    if "display" in shown and "display" in capabilities:
        variables[display.VARIABLE] = facts().facts["display"]["server"]
    return {name: value for name, value in variables.items() if name not in given}


def other_ways(
    supplied: Mapping[str, str], given: Mapping[str, str], packages: Collection[str] = ()
) -> tuple[dict[str, str], ...]:
    """Return the other sets of variables that could be supplied for rendering here, in the order to try them.

    SDL's own choice first, then a window on a display, then each way in which MuJoCo draws; never over a variable that
    was given.
    """
    capabilities = facts().capabilities
    window = {}
    if "display" in capabilities:
        window = {display.VARIABLE: facts().facts["display"]["server"], "SDL_VIDEODRIVER": "x11"}
    candidates = [{name: text for name, text in supplied.items() if name != "SDL_VIDEODRIVER"}, {**supplied, **window}]
    values = [value for name, value in WAYS.items() if name in capabilities]
    for value in values if "MUJOCO_GL" in supplied and {*packages} & {*(readers("MUJOCO_GL") or ())} else ():
        own = {"PYOPENGL_PLATFORM": "osmesa"} if value == "osmesa" else window if value == "glfw" else {}
        base = {name: text for name, text in supplied.items() if name != "PYOPENGL_PLATFORM"}
        candidates.append({**base, "MUJOCO_GL": value, **own})
    plain = [{name: text for name, text in each.items() if name not in given} for each in candidates]
    return tuple(each for number, each in enumerate(plain) if each not in (supplied, *plain[:number]))


@cache
def conditions() -> str:
    """Return a mark of the programs, headers and libraries of this system; an installation changes it."""
    times = [Path(place).stat().st_mtime_ns for place in SYSTEM if Path(place).exists()]
    return digest("conditions", times)


def drawing_needs(variables: Mapping[str, str]) -> tuple[str, ...]:
    """Return the capability that the way of drawing chosen by these variables needs."""
    need = DRAWN_WITH.get(variables["MUJOCO_GL"].casefold()) if "MUJOCO_GL" in variables else None
    return (need,) if need else ()


def explain_undrawable(variables: Mapping[str, str], packages: Mapping[str, str] = NOTHING) -> dict[str, str]:
    """Return why nothing can be drawn by OpenGL here with these variables: a sentence by the module that draws.

    pyglet has its own reason, all other modules share that of the empty name; empty if there is none.
    """
    anything = facts().capabilities & set(DRAWN_WITH.values())
    reasons = {
        "": describe_missing(drawing_needs(variables) or (() if anything else ("egl",))),
        PYGLET: describe_missing(_pyglet_needs(packages)),
    }
    return {module: reason for module, reason in reasons.items() if reason}


def _pyglet_needs(packages: Mapping[str, str]) -> tuple[str, ...]:
    """Return the capabilities that pyglet, with which old gym draws, needs of the machine."""
    version = packages.get(PYGLET)
    return ("display", *(("glu",) if version.startswith("1.") else ())) if version else ()


def base_environment(needs: Sequence[str] = ()) -> dict[str, str]:
    """Return the variables of this machine that a cell with these needs, or a build, may see."""
    names = [name for need in ("", *needs) for name in PASSED.get(need, ())]
    return ENVIRONMENT | {name: os.environ[name] for name in names if name in os.environ}


def describe_missing(needs: Collection[str]) -> str | None:
    """Return a sentence with the needs that this machine lacks and their remedies; None if it lacks nothing."""
    if not needs:
        return None
    machine = facts()
    return "; ".join(_hint(need, machine) for need in needs if need not in machine.capabilities) or None


def _hint(need: str, machine: Machine) -> str:
    if need not in HINTS:
        return f"unknown need {need!r}; choose from {', '.join(HINTS)}"
    name, remedy = HINTS[need]
    reason = machine.facts.get(need, {}).get("missing")
    return f"no {name} here{f' ({reason})' if reason else ''}: {remedy}"


# --- parts: each a few strings, or `missing`: why it is not there ----------------------------------------------


def _parts() -> dict[str, dict[str, str]]:
    """Return the description of each part; ask again only if something was installed, removed or started."""
    memory, marks = cache_folder() / "machine.json", _marks()
    record = guarded_files.load(memory, _Memory)
    if record and record.marks == marks:
        process.remember(record.sandbox)
        return record.parts
    from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415 - start-up

    ways = ("egl", "osmesa", "glu", "vulkan")
    process.sandbox_mode()  # found out once, not by each thread
    with ThreadPoolExecutor(len(ways) + 1) as pool:
        shown = pool.submit(_ask_display)
        gl_answers = dict(zip(ways, pool.map(_ask, ways), strict=True))
        answers = {**gl_answers, "display": shown.result(), "gpu": find_gpus()}
    parts = {name: answer for name, (answer, _) in answers.items()}
    # An answer that a limit or a kill cut short is not kept: the next attempt may give another.
    if all(certain for _, certain in answers.values()):
        # A forced sandbox was not found to be the best, so no later process may take it for that.
        sandbox = "" if os.environ.get(process.FORCED) else process.sandbox_mode()
        write_atomic(memory, msgspec.json.encode(_Memory(marks=marks, parts=parts, sandbox=sandbox)))
    return parts


class _Memory(msgspec.Struct):
    marks: list[str]
    parts: dict[str, dict[str, str]]
    sandbox: str


def _marks() -> list[str]:
    """Return marks that change when a driver, a library or a server comes or goes, or the probe would run otherwise."""
    patterns = (
        "etc/ld.so.cache",
        "usr/share/glvnd/egl_vendor.d/*",
        "etc/glvnd/egl_vendor.d/*",
        "usr/share/vulkan/icd.d/*",
        "usr/local/share/vulkan/icd.d/*",
        "etc/vulkan/icd.d/*",
        "usr/lib/dri",
        "usr/lib/*/dri",
        "proc/driver/nvidia/version",
        "dev/nvidia[0-9]*",
        "dev/dxg",
    )
    users = re.match(r":(\d+)", display.users() or "")
    socket = [display.SOCKETS / f"X{users[1]}"] if users else []
    paths = [PROBE, *socket, *(path for pattern in patterns for path in sorted(Path("/").glob(pattern)))]
    boot = Path("/proc/sys/kernel/random/boot_id")
    return [
        platform.release(),
        boot.read_text() if boot.exists() else "",
        *(f"{path} {path.stat().st_mtime_ns}" for path in paths if path.exists()),
        *(f"{name}={value}" for name, value in {**base_environment(("vulkan",)), **display.authority()}.items()),
        *(str(found) for found in (display.users(), display.program(), shutil.which("nvidia-smi"))),
        *process.confinement(),
    ]


def _ask_display() -> tuple[dict[str, str], bool]:
    """Ask a display of our own; ask the user's only if that fails: results are not to depend on a desk."""
    answer, certain = _ask("display", display.VIRTUAL)
    if "missing" not in answer:
        return {"server": display.VIRTUAL, **answer}, certain
    if not display.users():
        return answer, certain
    theirs, sure = _ask("display", display.OWN)
    if "missing" not in theirs:
        return {"server": display.OWN, **theirs}, certain and sure
    return {"missing": f"{answer['missing']}, and {theirs['missing']}"}, certain and sure


def _ask(way: str, screen: str = "") -> tuple[dict[str, str], bool]:
    """Run the probe in the sandbox that cells have; return its answer, and whether it would be the same again."""
    with scratch_folder() as scratch:
        home = scratch / "home"
        home.mkdir()
        answer = home / "answer.json"
        argv = (sys.executable, "-I", "-S", str(PROBE), way, str(answer))
        command = _command(argv, {**base_environment((way,)), display.VARIABLE: screen}, home, Profile.CELL)
        try:
            with display.open_display(command, home / "display") as seen:
                done = run(seen.command)
        except display.NoDisplayError as error:
            return {"missing": str(error)}, True
        strings = guarded_files.load(answer, dict[str, str])
    if strings is None:
        return {"missing": f"its driver {_death(done)}"}, done.killed is None and not done.timed_out
    return {name: normalise(text, seen.places) for name, text in strings.items()} if seen.places else strings, True


def _command(argv: tuple[str, ...], env: Mapping[str, str], home: Path, profile: Profile) -> Command:
    return Command(
        argv=argv, cwd=home, env=env, limits=Limits(seconds=60), log=home / "log", profile=profile, home=home
    )


def _death(done: Completed) -> str:
    if done.killed:
        return f"could not be asked: {done.killed}"
    return "did not answer" if done.timed_out else display.describe_end(done)


def find_gpus(root: Path = Path("/")) -> tuple[dict[str, str], bool]:
    """Return NVIDIA's GPUs and their driver, and whether that is certain.

    Read from the driver's files or, if it has none (WSL), from its tool.
    """
    cards = sorted((root / "proc/driver/nvidia/gpus").glob("*/information"))
    if cards and any((root / "dev").glob("nvidia[0-9]*")):
        models = [re.search(r"^Model:\s*(.+?)\s*$", card.read_text(), re.MULTILINE) for card in cards]
        version = re.search(r"\b\d{3,}\.\d+(\.\d+)?\b", (root / "proc/driver/nvidia/version").read_text())
        names = ", ".join(model[1] if model else "NVIDIA GPU" for model in models)
        return {"models": names, "driver": version[0] if version else ""}, True
    tool = shutil.which("nvidia-smi")
    if tool is None:
        return {"missing": "no driver of NVIDIA's"}, True
    with scratch_folder() as folder:
        argv = (tool, "--query-gpu=name,driver_version", "--format=csv,noheader")
        done = run(_command(argv, ENVIRONMENT, folder, Profile.HOST))
        lines = done.log.read_text().splitlines() if done.exit_code == 0 else []
    pairs = [tuple(line.split(", ")) for line in lines if line.count(", ") == 1]
    if not pairs:
        return {"missing": "nvidia-smi names none"}, done.killed is None and not done.timed_out
    return {"models": ", ".join(model for model, _ in pairs), "driver": pairs[0][1]}, True


# --- the id ----------------------------------------------------------------------------------------------------


def label(parts: Mapping[str, Mapping[str, str]]) -> str:
    """Return the part of an id that drawing and computing depend on: `mesa22.3-nvidia-h200-driver570.86`."""
    return "-".join(filter(None, (_gl_label(parts), _gpu_label(parts["gpu"]))))


def _gl_label(parts: Mapping[str, Mapping[str, str]]) -> str:
    """Return a label of the driver and its minor version: `mesa22.3`, `nvidia570.86`.

    The renderer follows unless it is software or NVIDIA's.
    """
    way = next((way for way in ("egl", "osmesa") if "missing" not in parts[way]), None)
    if way is None:
        return "nogl"
    strings = parts[way]
    driver = re.search(r"(Mesa|NVIDIA) (\d+\.\d+)", strings["version"])
    label = "".join(driver.groups()).lower() if driver else _slug(f"{strings['vendor']} {strings['version']}")
    software = re.match(r"llvmpipe|softpipe|swrast", strings["renderer"])
    hardware = "" if software or label.startswith("nvidia") else f"-{_slug(strings['renderer'])}"
    return ("osmesa-" if way == "osmesa" else "") + label + hardware


def _gpu_label(gpu: Mapping[str, str]) -> str:
    """Return a label of the models and the driver's minor version: `nvidia-h200-driver570.86`."""
    if "missing" in gpu:
        return ""
    models = "-".join(sorted({_slug(model) for model in gpu["models"].split(", ")}))
    return f"{models}-driver{'.'.join(gpu['driver'].split('.')[:2])}"


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", text.lower()).strip("-")[:40].rstrip("-")


def _distribution() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.system()
