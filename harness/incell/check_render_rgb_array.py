"""Draw pictures as arrays."""

import os

import numpy as np

from .cell_camera_pose import watch_camera
from .cell_episode import open_single
from .cell_errors import Skip, skip, violate
from .cell_observation import remark
from .cell_opengl_context import current_context
from .cell_pictures import (
    check_colour_order,
    check_forbidden_colour,
    compare_with_steps,
    is_same,
    make_steps,
    observation_values,
    picture_facts,
)
from .cell_used_packages import CallWatch, loaded_modules, used_distributions

STEPS = 10
LARGEST = 64 << 20
SHAPE, WITH_ALPHA = ("height", "width", "colour"), 4


def run(probe, facts):
    """Draw after the reset and after some steps; both frames are written."""
    try:
        _render(probe, facts)
    except Skip:
        raise
    except Exception:
        if probe.api.declares_pictures(probe.case):
            raise
        skip("render.undeclared")
    finally:
        facts["loaded"] = loaded_modules()


def _render(probe, facts):
    seed, steps = probe.case["seed"], probe.case["steps"]
    with open_single(probe, draw=True) as env:
        env.seed_actions(seed)
        start = observation_values(env.reset(seed))
        with watch_camera(env) as pose:
            picture = _draw(env)
        _report(probe, _alpha_remark(picture))
        first = _without_alpha(picture)
        facts["gl"] = _renderer(env)
        _examine(probe, facts, first, "first", pose)
        since = make_steps(env, min(STEPS, steps))
        with watch_camera(env) as pose, CallWatch() as calls:
            last = _draw_picture(env)
        facts["exercised"] = used_distributions(calls, probe.own_imports())
        _examine(probe, facts, last, "last", pose)
        _report(probe, _blank_remark(first, last))
        if steps >= STEPS and (is_same(first, last) or not since[1]):
            _report(probe, compare_with_steps(env, _draw_picture, (first, last), start, since, steps - STEPS))
        wanted = probe.case["picture"] or probe.api.picture_colours(probe.case)
        if wanted:
            _report(probe, check_colour_order(first, wanted["above"], wanted["below"]))
            _report(probe, check_forbidden_colour(first, wanted.get("never")))


def _draw_picture(env):
    """Draw a picture that no later one overwrites, without its alpha channel."""
    return _without_alpha(_draw(env))


def _draw(env):
    """Draw as the environment does, and return any array."""
    picture = env.render()
    if not isinstance(picture, np.ndarray):
        violate("render.not_array", got=type(picture).__name__)
    return picture


def _alpha_remark(picture):
    """Return a remark on a picture that has an alpha channel, or None."""
    if picture.ndim == len(SHAPE) and picture.shape[2] == WITH_ALPHA:
        return remark("alpha", "render.alpha")
    return None


def _without_alpha(picture):
    """Copy a picture without its alpha channel, if it has one."""
    return (picture[:, :, :3] if _alpha_remark(picture) else picture).copy()


def _renderer(env):
    """Describe the renderer in use; empty if it cannot be asked, which is no fault of the picture's."""
    try:
        return env.call_where_drawn(current_context)
    except Exception:
        return {}


def _report(probe, remarked):
    if remarked:
        kind, code, data = remarked
        probe.finding("render." + kind, code, **data)


def _examine(probe, facts, frame, which, pose):
    """Check that a frame is an array (height, width, 3) of uint8 that shows something."""
    if frame.ndim != 3 or frame.shape[2] != 3 or 0 in frame.shape:
        violate("render.shape", got=str(frame.shape), promised="(height, width, 3)")
    if frame.dtype != np.uint8:
        violate("render.dtype", got=str(frame.dtype), promised="uint8")
    facts["shape"] = list(frame.shape)
    if frame.nbytes <= LARGEST:
        name = "render.rgb_array-{}.npy".format(which)
        np.save(os.path.join(probe.folder, name), frame, allow_pickle=False)
        probe.frame("render.rgb_array", which, name)
        facts.setdefault("pictures", {})[which] = dict(picture_facts(frame), camera=pose.facts)


def _blank_remark(first, last):
    """Return a remark on a first picture that shows nothing yet; it is a violation if no later one does either."""
    if not _is_plain(first):
        return None
    colour = [int(v) for v in first[0, 0]]
    if _is_plain(last):
        violate("render.blank", got=colour)
    return remark("blank", "render.blank_at_first", got=colour)


def _is_plain(frame):
    return bool((frame == frame[0, 0]).all())
