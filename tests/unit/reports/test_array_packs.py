"""Files of arrays in a pack: whole again after unpacking, and each kept as a difference from a similar one."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from harness.model.hostile_data import Unreadable
from harness.probes import array_files
from harness.reports import array_packs


def files(*arrays: np.ndarray) -> dict[str, bytes]:
    """Return files of one array each, by SHA-256."""
    contents = [array_files.encode({"step": array}) for array in arrays]
    return {hashlib.sha256(content).hexdigest(): content for content in contents}


def test_two_versions_that_alternate_are_each_kept_as_a_difference_from_their_own() -> None:
    """Releases of v4 and v5 follow each other in turn: the array just before is the other version's."""
    dice = np.random.default_rng(1)
    v4, v5 = dice.uniform(size=(50, 4)), dice.uniform(size=(50, 4))
    near = [array + 1e-15 * dice.uniform(size=array.shape) for array in (v4, v5)]
    given = files(v4, v5, *near)

    packed = array_packs.pack(given)

    assert array_packs.unpack(packed) == given
    names = [hashlib.sha256(next(array_packs.parts(content))[1]).hexdigest() for content in given.values()]
    bases = [packed[f"{array_packs.ARRAYS}/{name}"][:64].decode() for name in names]
    assert bases[0] == array_packs.NO_BASE
    assert bases[2:] == names[:2]


def test_an_array_whose_base_is_gone_is_refused() -> None:
    """It cannot be restored."""
    first = np.arange(40.0)
    packed = array_packs.pack(files(first, first + 1e-12))
    name = next(name for name, member in packed.items() if member.startswith(array_packs.NO_BASE.encode()))
    del packed[name]

    with pytest.raises(Unreadable, match="differs from one that is not there"):
        array_packs.unpack(packed)
