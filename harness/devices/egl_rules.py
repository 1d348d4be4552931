"""Predict which EGL device each library draws on: the rules that its releases really follow, without I/O.

Read from the releases' sources and held to measurements: a test compares every cell of the matrix robosuite-egl, and a
stand-in of several devices covers the cases that one machine cannot show. The rules that the libraries' pages publish
are elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum

from msgspec import Struct
from packaging.specifiers import SpecifierSet
from packaging.version import Version

EGL_ID, CUDA, ARGUMENT = "MUJOCO_EGL_DEVICE_ID", "CUDA_VISIBLE_DEVICES", "render_gpu_device_id"
GL, PYOPENGL = "MUJOCO_GL", "PYOPENGL_PLATFORM"
OLD_EGL_ID = "EGL_DEVICE_ID"

LISTED = 10
"""Devices that these libraries look at, at most: eglQueryDevicesEXT is asked for no more."""

OPENS_AT_IMPORT = SpecifierSet("<3.2.5")
"""Releases of MuJoCo whose `mujoco.egl` opens its display when it is imported."""

KNOWS_CUDA = SpecifierSet(">=4.0.0")
"""Releases of MuJoCo that put devices into CUDA's order; 3.17.0, the one before, has no line of that."""


class Stage(StrEnum):
    """The step at which a library decides on its device."""

    IMPORT = "import"
    MAKE = "make"


class Settings(Struct, frozen=True, kw_only=True):
    """The settings that choose a device, each as it is set, None if it is not. `old` is EGL_DEVICE_ID."""

    argument: int | None = None
    egl: str | None = None
    cuda: str | None = None
    old: str | None = None


class Device(Struct, frozen=True, kw_only=True):
    """One EGL device: the number that CUDA gives it, and whether it can be initialised."""

    cuda: int | None = None
    works: bool = True


class Choice(Struct, frozen=True, kw_only=True):
    """The place of the chosen device in EGL's list, or the error raised instead, and its stage; neither without EGL."""

    device: int | None = None
    error: str | None = None
    stage: Stage = Stage.MAKE


class Precedence(Struct, frozen=True, kw_only=True):
    """The rules by which `releases` of one library choose a device, in sentences, the first that applies first.

    `run` is false for rules that were read in its source, and never run by this project.
    """

    library: str
    releases: str
    steps: tuple[str, ...]
    run: bool = True


class _Raised(Exception):
    """The error that the library raises."""


Chooser = Callable[[Settings, Sequence[Device]], int]


def choose_device(
    library: str, release: str, settings: Settings, devices: Sequence[Device], mujoco: str | None = None
) -> Choice:
    """Return the device that a release of a library draws on by EGL; `mujoco` is the release of MuJoCo beside it.

    Libraries are robosuite, gymnasium, mujoco, dm_control.
    """
    beside = mujoco or release
    listed = devices[:LISTED]
    early = _within(beside, OPENS_AT_IMPORT) and library != "dm_control"
    try:
        if library == "robosuite" and _within(release, "<1.4"):
            return Choice()  # mujoco_py, built for the CPU, draws by OSMesa
        if early:
            _by_mujoco(settings, listed)
        if library == "robosuite":
            _agreeing(settings)
    except _Raised as raised:
        return Choice(error=str(raised), stage=Stage.IMPORT)
    ways: dict[str, Chooser] = {"robosuite": _by_robosuite, "dm_control": _by_dm_control}
    own = _by_cuda if _within(beside, KNOWS_CUDA) else _by_mujoco
    if library == "dm_control" and _within(release, "<1.0.9"):
        settings = Settings(egl=settings.old)
    stage = Stage.IMPORT if library == "dm_control" else Stage.MAKE
    try:
        return Choice(device=ways.get(library, own)(settings, listed), stage=stage)
    except _Raised as raised:
        return Choice(error=str(raised), stage=stage)


# --- the libraries ---------------------------------------------------------------------------------------------


def _agreeing(settings: Settings) -> None:
    """Check the variables as robosuite does when it is imported."""
    # robosuite searches the text, so `0` is found in `10,11`. That is its bug to predict, not ours to mend.
    if settings.cuda and settings.egl is not None and not (settings.egl.isdigit() and settings.egl in settings.cuda):
        message = f"AssertionError: {EGL_ID} needs to be set to one of the device id specified in {CUDA}"
        raise _Raised(message)


def _by_robosuite(settings: Settings, devices: Sequence[Device]) -> int:
    """Choose as `create_initialized_egl_device_display` of robosuite 1.4.0 to 1.5.2, which is one text in all."""
    selected = settings.cuda if settings.egl is None else settings.egl
    argument = -1 if settings.argument is None else settings.argument
    if selected is None:
        place = 0 if argument == -1 else argument
    else:
        if selected.isdigit():
            place = int(selected)
        else:
            listed = [_number(part) for part in selected.split(",")]
            if argument != -1 and argument not in listed:
                message = "AssertionError: specified device id is not made visible in environment variables."
                raise _Raised(message)
            place = listed[0] if argument == -1 else argument
        # robosuite's message names this variable even where the number is that of CUDA_VISIBLE_DEVICES.
        _within_range(place, devices, f"The {EGL_ID} environment variable")
    # This is a slice because robosuite checks no range without a variable: a place that is not there fails
    # like a device that cannot be initialised.
    return _opened([*range(len(devices))][place : place + 1], devices)


def _by_mujoco(settings: Settings, devices: Sequence[Device]) -> int:
    """Choose as `mujoco.egl` before 4.0: one variable, else the first device that can be initialised."""
    return _by_one_variable(settings, devices, f"The {EGL_ID} environment variable")


def _by_dm_control(settings: Settings, devices: Sequence[Device]) -> int:
    """Choose as dm_control, which has a copy of its own, and opens the display when it is imported."""
    return _by_one_variable(settings, devices, EGL_ID, "Cannot initialize a headless EGL display.")


def _by_one_variable(settings: Settings, devices: Sequence[Device], subject: str, failed: str = "") -> int:
    if settings.egl is None:
        return _opened(range(len(devices)), devices, failed)
    place = _number(settings.egl)
    _within_range(place, devices, subject)
    return _opened([place], devices, failed)


def _by_cuda(settings: Settings, devices: Sequence[Device]) -> int:
    """Choose as `mujoco.egl` since 4.0: in CUDA's order where the driver tells it for some device, each number once."""
    numbers = [device.cuda for device in devices if device.cuda is not None]
    if not numbers or len(set(numbers)) < len(numbers):
        return _by_mujoco(settings, devices)
    place = {device.cuda: index for index, device in enumerate(devices) if device.cuda is not None}
    visible = _cuda_numbers(settings.cuda)
    seen = _visible(place, visible)
    order = seen or [place[number] for number in sorted(numbers)]
    order = order + [index for index in range(len(devices)) if index not in order]
    if settings.egl is None:
        return _opened(order, devices)
    device_id = _number(settings.egl)
    if seen and 0 <= device_id < len(seen):
        return _opened([seen[device_id]], devices)
    if seen and device_id in visible:
        return _opened([seen[visible.index(device_id)]], devices)
    if device_id in place:
        return _opened([place[device_id]], devices)
    _within_range(device_id, devices, f"The {EGL_ID} environment variable")
    return _opened([order[device_id]], devices)


def _visible(place: Mapping[int, int], visible: Sequence[int]) -> list[int]:
    """Return the places of the devices in CUDA_VISIBLE_DEVICES, in its order; empty if they are not there.

    Its numbers are CUDA's. If CUDA lacks one of them, as many devices as it names are taken, from 0 on.
    """
    for numbers in (visible, range(len(visible))):
        if visible and all(number in place for number in numbers):
            return [place[number] for number in numbers]
    return []


def _cuda_numbers(text: str | None) -> list[int]:
    """Return the numbers of CUDA_VISIBLE_DEVICES; none if a part of it is not a number, or negative."""
    try:
        numbers = [int(part) for part in (text or "").split(",") if part.strip()]
    except ValueError:
        return []
    return [] if any(number < 0 for number in numbers) else numbers


# --- what they share -------------------------------------------------------------------------------------------


def _opened(places: Sequence[int], devices: Sequence[Device], failed: str = "") -> int:
    """Return the first of these places whose device can be initialised. Raises the library's error if none can."""
    for place in places:
        if devices[place].works:
            return place
    # The words are the library's own, grammar included: a test compares them with measured errors.
    reason = "This likely means that your EGL driver does not support the PLATFORM_DEVICE extension, which is required"
    usual = f"Cannot initialize a EGL device display. {reason} for creating a headless rendering context."
    message = f"ImportError: {failed or usual}"
    raise _Raised(message)


def _number(text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        message = f"ValueError: {error}"
        raise _Raised(message) from None


def _within_range(place: int, devices: Sequence[Device], subject: str) -> None:
    if not 0 <= place < len(devices):
        bounds = f"an integer between 0 and {len(devices) - 1} (inclusive), got {place}."
        message = f"RuntimeError: {subject} must be {bounds}"
        raise _Raised(message)


def _within(release: str, releases: str | SpecifierSet) -> bool:
    specifiers = SpecifierSet(releases) if isinstance(releases, str) else releases
    return specifiers.contains(Version(release), prereleases=True)


# --- in words --------------------------------------------------------------------------------------------------

ONE_VARIABLE = (
    f"{EGL_ID}, if it is set: the device at this place in EGL's list;"
    " another text than a number in range is an error, the empty one, too."
)
FIRST = "Else the first device in EGL's list that can be initialised."

PRECEDENCE = (
    Precedence(
        library="robosuite",
        releases=">=1.4,<1.6",
        steps=(
            f"When it is imported: if both variables are set, {EGL_ID} has to be digits that occur somewhere in the"
            f" text of {CUDA}; `0` occurs in `10,11` and in `GPU-8930`.",
            f"{EGL_ID}, if it is set, else {CUDA}: if that is digits and nothing else, the device at this place in"
            f" EGL's list; {ARGUMENT} is ignored.",
            f"If it is a list: {ARGUMENT}, which has to be in the list, else the first of the list; it is a place in"
            " EGL's list, never one in the list of the variable. A UUID and the empty text are errors.",
            f"If neither is set: {ARGUMENT}, else 0. No other device is tried where this one cannot be initialised or"
            " is not there.",
            "The first environment decides for the whole process. MUJOCO_GL becomes egl unless it was osmesa or glx.",
        ),
    ),
    Precedence(
        library="robosuite",
        releases="<1.4",
        steps=(
            "mujoco_py built for the CPU draws by OSMesa: nothing chooses a device, and what is asked for is ignored"
            " without a word.",
        ),
    ),
    Precedence(
        library="robosuite, its mujoco_py built for the GPU",
        releases="<1.4",
        steps=(f"{ARGUMENT}, if it is 0 or more; else GPUS; else the first of {CUDA}; else 0.",),
        run=False,
    ),
    Precedence(
        library="mujoco",
        releases="<3.2.5",
        steps=("When any library imports it with MUJOCO_GL=egl:", ONE_VARIABLE, FIRST),
    ),
    Precedence(library="mujoco", releases=">=3.2.5,<4", steps=(ONE_VARIABLE, f"{FIRST} {CUDA} is not read.")),
    Precedence(
        library="mujoco",
        releases=">=4",
        steps=(
            "Where no device is one of CUDA's: as before 4.0.",
            f"{EGL_ID}, if it is set: a place in {CUDA}, else a number of CUDA's, else a place in EGL's list once it"
            " is in CUDA's order.",
            f"Else the devices of {CUDA} in its order, else those of CUDA in CUDA's order, else the others: the first"
            " that can be initialised.",
        ),
    ),
    Precedence(library="gymnasium", releases=">=0.27", steps=("What the installed MuJoCo does.",)),
    Precedence(
        library="dm_control",
        releases=">=1.0.9",
        steps=(
            "When it is imported, after what MuJoCo itself does then:",
            ONE_VARIABLE,
            f"{FIRST} {CUDA} is not read.",
        ),
    ),
    Precedence(
        library="dm_control",
        releases="<1.0.9",
        steps=(f"The same with {OLD_EGL_ID} in the place of {EGL_ID}.",),
        run=False,
    ),
)
"""The true precedence, library by library."""

PUBLISHED = f"{EGL_ID}, then {ARGUMENT}, then {CUDA}"
"""The precedence that is told for robosuite."""


class Typed(Struct, frozen=True, kw_only=True):
    """A line typed in a shell with spaces around `=`, and the value that a program started after it, or by it, has.

    `value` is None where the variable stays unset; `says` is what the shell answers.
    """

    text: str
    value: str | None
    says: str = ""


SPACES = (
    Typed(text="export CUDA_VISIBLE_DEVICES=1", value="1"),
    Typed(text='export CUDA_VISIBLE_DEVICES=" 1"', value=" 1"),
    Typed(text="export CUDA_VISIBLE_DEVICES= 1", value="", says="not a valid identifier"),
    Typed(text="CUDA_VISIBLE_DEVICES= 1", value=None, says="command not found"),
    Typed(text="export CUDA_VISIBLE_DEVICES =1", value=None, says="not a valid identifier"),
    Typed(text="export CUDA_VISIBLE_DEVICES = 1", value=None, says="not a valid identifier"),
    Typed(text="CUDA_VISIBLE_DEVICES = 1", value=None, says="command not found"),
)
"""What bash makes of spaces."""
