"""Draws pictures as arrays."""

import os

import numpy as np

from .cell_context import current
from .cell_episode import single
from .cell_errors import Skip, skip, violate
from .cell_frames import described
from .cell_observed import remark
from .cell_pictures import advance, composed, followed, marred, same, values
from .cell_pose import seen
from .cell_used import Called, exercised, loaded

STEPS = 10
LARGEST = 64 << 20
SHAPE, WITH_ALPHA = ("height", "width", "colour"), 4


def run(probe, facts):
    """Render after the reset and after some steps; both frames are kept."""
    try:
        _render(probe, facts)
    except Skip:
        raise
    except Exception:
        if probe.api.declares_pictures(probe.case):
            raise
        skip("render.undeclared")
    finally:
        facts["loaded"] = loaded()


def _render(probe, facts):
    seed, steps = probe.case["seed"], probe.case["steps"]
    with single(probe, draw=True) as env:
        env.seed_actions(seed)
        start = values(env.reset(seed))
        with seen(env) as pose:
            drawn = _drawn(env)
        _tell(probe, _alpha(drawn))
        first = _opaque(drawn)
        facts["gl"] = _context(env)
        _examine(probe, facts, first, "first", pose)
        since = advance(env, min(STEPS, steps))
        with seen(env) as pose, Called() as called:
            last = _picture(env)
        facts["exercised"] = exercised(called, probe.ours())
        _examine(probe, facts, last, "last", pose)
        _tell(probe, _blank(first, last))
        if steps >= STEPS and (same(first, last) or not since[1]):
            _tell(probe, followed(env, _picture, (first, last), start, since, steps - STEPS))
        wanted = probe.case["picture"] or probe.api.picture(probe.case)
        if wanted:
            _tell(probe, composed(first, wanted["above"], wanted["below"]))
            _tell(probe, marred(first, wanted.get("never")))


def _picture(env):
    """Draw a picture that no later one overwrites, without its alpha channel."""
    return _opaque(_drawn(env))


def _drawn(env):
    """Draw, as the environment does it: any array."""
    picture = env.render()
    if not isinstance(picture, np.ndarray):
        violate("render.not_array", got=type(picture).__name__)
    return picture


def _alpha(drawn):
    """Tell of a picture that has an alpha channel."""
    if drawn.ndim == len(SHAPE) and drawn.shape[2] == WITH_ALPHA:
        return remark("alpha", "render.alpha")
    return None


def _opaque(drawn):
    """Copy a picture without its alpha channel, if it has one."""
    return (drawn[:, :, :3] if _alpha(drawn) else drawn).copy()


def _context(env):
    """Describe the renderer in use; empty if it cannot be asked, which is no fault of the picture's."""
    try:
        return env.where_drawn(current)
    except Exception:
        return {}


def _tell(probe, found):
    if found:
        kind, code, data = found
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
        facts.setdefault("pictures", {})[which] = dict(described(frame), camera=pose.facts)


def _blank(first, last):
    """Tell of a first picture that shows nothing yet; where no later one does either, nothing can be seen."""
    if not _plain(first):
        return None
    colour = [int(v) for v in first[0, 0]]
    if _plain(last):
        violate("render.blank", got=colour)
    return remark("blank", "render.blank_at_first", got=colour)


def _plain(frame):
    return bool((frame == frame[0, 0]).all())
