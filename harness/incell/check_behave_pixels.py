"""Draws an environment at some states of the bank that the host gave, with the environment's own camera."""

import os

import numpy as np

from .cell_arrays import load, save
from .cell_drawings import Artist, digest, small
from .cell_episode import open_single
from .cell_opengl_context import current_context
from .cell_physics import physics_of
from .cell_steps import Stepper, state_of

PIXELS = "pixels.npz"
STATES = 5
LARGEST = 64 << 20


def run(probe, facts):
    """Write digest and small picture of each drawn state, and what it is made of. The first frame is kept.

    All states are drawn once more, in the other order: `unrepeated` are those whose picture is another one then. Where
    the bank does not fit, nothing is drawn.
    """
    bank = load(probe)
    with open_single(probe, draw=True) as env:
        env.reset(probe.case["seed"])
        physics = physics_of(env)
        fits = Stepper(env, physics).fits(bank)
        numbers = chosen(len(bank["action"])) if fits else []
        artist = Artist(env, getattr(physics, "model", None))
        pictures, drawn = [], []
        for number in numbers:
            picture, contents = _draw(artist, physics, bank, number)
            pictures.append(picture)
            drawn.append(dict(contents, state=number, shape=list(picture.shape)))
        unrepeated = [
            number
            for number, picture in reversed(list(zip(numbers, pictures)))
            if digest(_draw(artist, physics, bank, number)[0]).tobytes() != digest(picture).tobytes()
        ]
        facts["gl"] = _renderer(env) if drawn else {}
        about = dict(artist.describe(), drawn=drawn, unrepeated=unrepeated, gl=facts["gl"], form=1)
    arrays = {}
    if pictures:
        arrays["digest"] = np.array([digest(picture) for picture in pictures])
        if len({picture.shape for picture in pictures}) == 1:
            arrays["small"] = np.array([small(picture) for picture in pictures])
        _keep(probe, pictures[0])
    save(probe, PIXELS, arrays, about)


def chosen(count):
    """Return the numbers of the states that are drawn, spread over all kinds of states."""
    return sorted({number * count // STATES for number in range(STATES)}) if count else []


def _draw(artist, physics, bank, number):
    physics.write(state_of(bank, number))
    return artist.draw()


def _renderer(env):
    """Describe the renderer in use; empty where it cannot be asked."""
    try:
        return env.call_where_drawn(current_context)
    except Exception:
        return {}


def _keep(probe, picture):
    if picture.nbytes <= LARGEST:
        name = "behave.pixels-first.npy"
        np.save(os.path.join(probe.folder, name), picture, allow_pickle=False)
        probe.frame("behave.pixels", "first", name)
