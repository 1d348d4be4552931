"""Predict how each library draws under a machine's settings, name the errors, and recommend settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from harness.devices.egl_rules import (
    ARGUMENT,
    CUDA,
    EGL_ID,
    GL,
    OLD_EGL_ID,
    PYOPENGL,
    Device,
    Settings,
    Stage,
    choose_device,
)

VARIABLES = (GL, EGL_ID, CUDA, PYOPENGL)
DISABLED = ("disable", "disabled", "off", "false", "0")
WINDOWED = ("glfw", "", "enable", "enabled", "on", "true", "1", "glx")
NO_WINDOW = (
    "FatalError: an OpenGL platform library has not been loaded into this process, this most likely means that a valid"
    " OpenGL context has not been created before mjr_makeContext was called (no display answers, so that GLFW opens"
    " no window)"
)

Variables = Mapping[str, str]


class Library(Struct, frozen=True, kw_only=True):
    """A library as users meet it: `name` says which releases, of which `release` is one, with `mujoco` beside it."""

    name: str
    library: str
    release: str
    mujoco: str


LIBRARIES = (
    Library(name="robosuite 1.4, 1.5", library="robosuite", release="1.5.2", mujoco="3.3.7"),
    Library(name="MuJoCo before 4", library="mujoco", release="3.17.0", mujoco="3.17.0"),
    Library(name="MuJoCo 4", library="mujoco", release="4.0.0", mujoco="4.0.0"),
    Library(name="gymnasium (MuJoCo 4)", library="gymnasium", release="1.4.0", mujoco="4.0.0"),
    Library(name="dm_control", library="dm_control", release="1.0.50", mujoco="3.17.0"),
)


class DrawingSupport(Struct, frozen=True, kw_only=True):
    """The ways to draw on a machine: EGL's devices, and whether OSMesa and a display answer."""

    devices: tuple[Device, ...]
    osmesa: bool
    display: bool


CROSSED = DrawingSupport(devices=(Device(cuda=1), Device(cuda=0), Device()), osmesa=True, display=False)
"""Two GPUs that EGL lists in another order than CUDA, and a software device behind them: where libraries part."""


class Prediction(Struct, frozen=True, kw_only=True):
    """The way a library draws: `egl` on a device, `osmesa`, `glfw`; or the error with which it fails instead."""

    way: str
    device: int | None = None
    error: str | None = None


class Advice(Struct, frozen=True, kw_only=True):
    """Variables to set and to unset before drawing, and the reason."""

    variables: Variables
    unset: tuple[str, ...]
    reason: str


def predict(who: Library, variables: Variables, here: DrawingSupport, argument: int | None = None) -> Prediction:
    """Return the way a library draws under these variables; `argument` is robosuite's device argument."""
    settings = Settings(
        argument=argument, egl=variables.get(EGL_ID), cuda=variables.get(CUDA), old=variables.get(OLD_EGL_ID)
    )
    choice = choose_device(who.library, who.release, settings, here.devices, who.mujoco)
    way, refused = _way(who.library, variables.get(GL))
    if who.library == "robosuite" and choice.error and choice.stage is Stage.IMPORT:
        return Prediction(way=way, error=choice.error)  # it compares the variables whatever it draws with
    error = refused or _unable(way, variables.get(PYOPENGL, ""), here)
    if error or way != "egl":
        return Prediction(way=way, error=error)
    return Prediction(way="egl", device=choice.device, error=choice.error)


def _unable(way: str, platform: str, here: DrawingSupport) -> str | None:
    """Return the error that rules this way out whatever the device, or None; `platform` is PYOPENGL_PLATFORM."""
    name = {"egl": "EGL", "osmesa": "OSMesa"}.get(way)
    if name and platform and platform.lower() != way:
        detail = f"The {PYOPENGL} environment variable is set to {platform!r} (should be either unset or {way!r})."
        return f"ImportError: Cannot use {name} rendering platform. {detail}"
    if way == "osmesa" and not here.osmesa:
        return "AttributeError: 'NoneType' object has no attribute 'glGetError' (OSMesa is not installed)"
    return NO_WINDOW if way == "glfw" and not here.display else None


def _way(library: str, value: str | None) -> tuple[str, str | None]:
    """Return the way to draw that MUJOCO_GL selects for a library, and its error if the library refuses the value.

    robosuite uses egl, whatever the value, unless it is osmesa or glx.
    """
    if library == "robosuite":
        return {"osmesa": "osmesa", "glx": "glfw"}.get(value or "", "egl"), None
    # MuJoCo ignores case and the blanks around the value; gymnasium and dm_control take it as it stands.
    plain = (value or "").lower().strip()
    if plain not in (*DISABLED, *WINDOWED, "egl", "osmesa"):
        return "none", f"RuntimeError: invalid value for environment variable {GL}: {plain}"  # MuJoCo, when imported
    if library == "mujoco" and plain in DISABLED:
        return "none", "AttributeError: module '...gl_context' has no attribute 'GLContext'"
    # The slice leaves out `glx`, the last one, which dm_control refuses.
    exact = {"gymnasium": ("glfw",), "dm_control": ("glfw", *WINDOWED[1:7])}.get(library)
    if library == "dm_control" and value in DISABLED:
        return "none", "RuntimeError: No OpenGL rendering backend is available."
    if exact and value is not None and value not in (*exact, "egl", "osmesa"):
        return "none", f"RuntimeError: Environment variable {GL} must be one of egl, osmesa, glfw: got {value!r}."
    return (plain if plain in {"egl", "osmesa"} else "glfw"), None


def troubles(variables: Variables, here: DrawingSupport) -> dict[str, list[Library]]:
    """Return the libraries that fail with these variables, by the error that they raise."""
    by_error: dict[str, list[Library]] = {}
    for who in LIBRARIES:
        error = predict(who, variables, here).error
        if error:
            by_error.setdefault(error, []).append(who)
    return by_error


def describe_error(error: str, failing: Sequence[Library], variables: Variables) -> str:
    """Describe an error of `troubles` in a sentence; add CUDA_VISIBLE_DEVICES if the error's number comes from it."""
    blamed = EGL_ID in error and EGL_ID not in variables and CUDA in variables
    hint = f" (the number is that of {CUDA}={variables[CUDA]})" if blamed else ""
    return f"{', '.join(who.name for who in failing)} cannot draw here: {error}{hint}"


def describe_disagreement(variables: Variables, here: DrawingSupport) -> str | None:
    """Return a sentence with the device of each library if the libraries draw on different devices, else None."""
    places: dict[int, list[str]] = {}
    for who in LIBRARIES:
        device = predict(who, variables, here).device
        if device is not None:
            places.setdefault(device, []).append(who.name)
    if len(places) <= 1:
        return None
    listed = "; ".join(f"device {place}: {', '.join(names)}" for place, names in sorted(places.items()))
    return f"the libraries draw on different EGL devices here: {listed}"


def possible(here: DrawingSupport) -> Iterator[tuple[str, Variables, int | None]]:
    """Yield each setting to compare, as (text to type, variables, device argument).

    Each is set alone, to every device number and to one beyond the last. Then both variables are set,
    CUDA_VISIBLE_DEVICES out of range.
    """
    base = {GL: "egl"}
    numbers = range(len(here.devices) + 1)
    yield "nothing", base, None
    for name in (EGL_ID, CUDA):
        for number in numbers:
            yield f"{name}={number}", {**base, name: str(number)}, None
    for number in numbers:
        yield f"{ARGUMENT}={number}", base, number
    yield f"{EGL_ID}=0 {CUDA}={len(here.devices)}", {**base, EGL_ID: "0", CUDA: str(len(here.devices))}, None


def recommend(variables: Variables, here: DrawingSupport) -> Advice | None:
    """Return the setting with which the most libraries draw on one device; another way if few can, None for none.

    CUDA_VISIBLE_DEVICES is left as it is where it can be: it is not set for the sake of drawing.
    """
    candidates = [
        (_worth(advice, variables, here), -place, advice) for place, advice in enumerate(_candidates(variables, here))
    ]
    # `_candidates` yields the best first; the negative place lets the earlier of two equal ones win.
    best = max(candidates, key=lambda candidate: candidate[:2], default=None)
    if best is None or not best[0]:
        return None
    advice = best[2]
    after = apply_advice(advice, variables)
    results = [predict(who, after, here) for who in LIBRARIES]
    devices = {result.device for result in results if result.error is None}
    failing = [who.name for who, result in zip(LIBRARIES, results, strict=True) if result.error]
    where = f"on EGL device {next(iter(devices))}, " if len(devices) == 1 and None not in devices else ""
    who = f"all but {', '.join(failing)} draw" if failing else "all libraries draw"
    different = f"; {describe_disagreement(after, here)}" if len(devices) > 1 else ""
    reason = f"{who} {where}{advice.reason}{different}"
    unset = tuple(name for name in advice.unset if name in variables)
    return Advice(variables=advice.variables, unset=unset, reason=reason)


def apply_advice(advice: Advice, variables: Variables) -> dict[str, str]:
    """Return the variables after the advice is applied."""
    rest = {name: value for name, value in variables.items() if name not in advice.unset}
    return {**rest, **advice.variables}


def _candidates(variables: Variables, here: DrawingSupport) -> Iterator[Advice]:
    """Yield settings worth a try, the best first: a CUDA device, another EGL device, OSMesa, a window.

    If CUDA_VISIBLE_DEVICES names devices that EGL has, these are the only EGL devices that are tried.
    """
    working = [place for place, device in enumerate(here.devices) if device.works]
    given = [part.strip() for part in variables.get(CUDA, "").split(",")]
    working = [place for place in working if str(here.devices[place].cuda) in given] or working
    for place in sorted(working, key=lambda place: (here.devices[place].cuda is None, place)):
        chosen_one = {GL: "egl", EGL_ID: str(place)}
        yield Advice(variables=chosen_one, unset=(PYOPENGL,), reason="by a number that every one of them reads")
        text = f"in the process that draws without {CUDA}, which robosuite takes for places in EGL's list"
        yield Advice(variables=chosen_one, unset=(PYOPENGL, CUDA), reason=text)
    if here.osmesa:
        yield Advice(variables={GL: "osmesa", PYOPENGL: "osmesa"}, unset=(), reason="by OSMesa, on the CPU")
    if here.display:
        yield Advice(variables={GL: "glfw"}, unset=(PYOPENGL,), reason="at the display")


def _worth(advice: Advice, variables: Variables, here: DrawingSupport) -> tuple[int, ...]:
    """Return a sort key of an advice, the best largest; empty if no library can draw.

    The key is (whether most libraries draw on the named device, how many draw there, how many draw at all). Without a
    named device every library that draws counts as right.
    """
    after = apply_advice(advice, variables)
    results = [predict(who, after, here) for who in LIBRARIES]
    drawing = [result for result in results if result.error is None]
    place = advice.variables.get(EGL_ID)
    right = [result for result in drawing if place is None or result.device == int(place)]
    most = place is not None and 2 * len(right) > len(results)
    return (most, len(right), len(drawing)) if drawing else ()


def outcomes(variables: Variables, here: DrawingSupport, argument: int | None = None) -> Sequence[Prediction]:
    """Return the way each of `LIBRARIES` draws, in their order; only robosuite takes `argument`."""
    return [predict(who, variables, here, argument if who.library == "robosuite" else None) for who in LIBRARIES]
