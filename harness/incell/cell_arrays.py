"""Write arrays for the host, and read those that it gives: one file of NumPy's own form, a zip of `.npy` parts."""

import json

import numpy as np

from .cell_originals import join

GIVEN, OUTPUTS, BANK = "given.npz", "outputs.npz", "bank.npz"
FACTS = "facts"
"""The part that holds all that is no array: JSON, as bytes."""


def save(probe, name, arrays, facts):
    """Write arrays by name, and facts, into the folder of the reply."""
    text = json.dumps(facts, sort_keys=True).encode("ascii")
    np.savez(join(probe.folder, name), **dict(arrays, facts=np.frombuffer(text, dtype=np.uint8)))


def load(probe):
    """Return the states that the host gave, by name: arrays of float64, a row a state."""
    with np.load(join(probe.folder, GIVEN)) as arrays:
        names = [name for name in arrays.files if name.startswith("state.") or name in ("warm", "action")]
        return {name: arrays[name].astype(float) for name in names}
