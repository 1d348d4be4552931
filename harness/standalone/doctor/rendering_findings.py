"""List what settings and libraries allow to be rendered, without rendering.

This is the part of `doctor --rendering` that works without the rest of the harness.
"""

from __future__ import annotations

from typing import Any, Dict, Iterator, List, Mapping

from .package_findings import NOTE, WARNING, Finding

NAMES = {"egl": "EGL (libEGL.so.1)", "osmesa": "OSMesa (libOSMesa.so.8)", "gl": "OpenGL (libGL.so.1)"}
DEBIAN = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6", "gl": "libgl1"}
MORE = "to see the device of each library: pip install simmatrix; simmatrix doctor --rendering"


def findings(seen: Mapping[str, Any], variables: Mapping[str, str]) -> List[Finding]:
    """Return findings about unusable rendering libraries, and the variables to set."""
    if not seen:
        return [Finding("rendering", NOTE, "the renderers could not be listed")]
    gone = {way: why for way, why in seen["libraries"].items() if why}
    return [*_missing(gone, variables), *_mixed(variables), _here(seen, gone), Finding("rendering", NOTE, MORE)]


def _missing(gone: Mapping[str, str], variables: Mapping[str, str]) -> Iterator[Finding]:
    backend = variables.get("MUJOCO_GL", "").lower().strip()
    if backend in gone:
        text = "MUJOCO_GL={} asks for {}, which cannot be loaded ({}); on Debian it is in {}".format(
            backend, NAMES[backend], gone[backend], DEBIAN[backend]
        )
        yield Finding("rendering", WARNING, text)
    elif backend in {"", "glfw"} and not variables.get("DISPLAY") and not variables.get("WAYLAND_DISPLAY"):
        able = next((way for way in ("egl", "osmesa") if way not in gone), None)
        remedy = "export MUJOCO_GL={}".format(able) if able else "install {}".format(DEBIAN["egl"])
        text = "there is no display, and MUJOCO_GL {}: MuJoCo opens no window here; {}".format(
            "is glfw" if backend else "is not set", remedy
        )
        yield Finding("rendering", WARNING, text)
    if "gl" in gone:
        yield Finding("rendering", NOTE, "{} cannot be loaded: {}".format(NAMES["gl"], gone["gl"]))


def _mixed(variables: Mapping[str, str]) -> Iterator[Finding]:
    """Yield a finding if PyOpenGL is set to another way of rendering than MuJoCo."""
    backend, platform = variables.get("MUJOCO_GL", "").lower(), variables.get("PYOPENGL_PLATFORM", "").lower()
    if backend in {"egl", "osmesa"} and platform and platform != backend:
        text = "MUJOCO_GL={} and PYOPENGL_PLATFORM={} contradict each other: unset PYOPENGL_PLATFORM".format(
            backend, platform
        )
        yield Finding("rendering", WARNING, text)


def _here(seen: Mapping[str, Any], gone: Mapping[str, str]) -> Finding:
    there = [NAMES[way] for way in seen["libraries"] if way not in gone]
    fields: Dict[str, str] = {
        "libraries": ", ".join(there) or "none",
        "devices": ", ".join(seen["devices"]) or "none",
    }
    return Finding("rendering", NOTE, "to draw with: {libraries}; devices: {devices}".format(**fields))
