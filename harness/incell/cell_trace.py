"""Record the steps of an environment, to be compared with another run."""

import hashlib
import re

import numpy as np

ADDRESS = re.compile(r"0x[0-9a-f]+")
DIGITS = 12
LONGEST = 5000
BYTES_KEPT = 64 << 20
WIDEST, MOST = 64, 1000
"""Numbers that a reply has of each part of an entry, and of all entries together."""

PARTS = ("observation", "reward", "terminated", "truncated")


class Trace:
    """Keep one entry per reset (observation) and per step (observation, reward, terminated, truncated).

    Digests are kept of all entries, values only of the first 64 MiB.
    """

    def __init__(self):
        self.digests = []
        self._values = []
        self._room = BYTES_KEPT

    def add(self, *values):
        """Add one entry."""
        parts = [[np.array(leaf) for leaf in _leaves(value)] for value in values]
        combined = hashlib.sha256()
        for leaf in [leaf for part in parts for leaf in part]:
            combined.update("{}{}".format(leaf.dtype.str, leaf.shape).encode("utf-8"))
            combined.update(_bytes(leaf))
        self.digests.append(combined.hexdigest()[:DIGITS])
        self._room -= sum(leaf.nbytes for part in parts for leaf in part)
        self._values.append(parts if self._room >= 0 else None)

    def steps(self):
        """Return digests for a reply: at most 5000, the last one then standing for all the rest."""
        if len(self.digests) <= LONGEST:
            return list(self.digests)
        rest = "".join(self.digests[LONGEST - 1 :])
        return [*self.digests[: LONGEST - 1], hashlib.sha256(rest.encode("ascii")).hexdigest()[:DIGITS]]

    def values(self):
        """Return numbers for a reply: of the first entries, each part as a list, None where it holds no numbers.

        Of `steps` entries there are as many as hold 1000 numbers, of each part the first 64; `sizes` says how many
        numbers each part has.
        """
        entries, sizes, room = [], [0] * len(PARTS), MOST
        for parts in self._values:
            entry = [_numbers(leaves) for leaves in parts or ()]
            room -= sum(len(numbers or ()) for numbers in entry)
            if not entry or room < 0:
                break
            entries.append(entry)
            sizes = [max(pair) for pair in zip(sizes, [sum(leaf.size for leaf in part) for part in parts] + [0] * 3)]
        return {"steps": len(self.digests), "sizes": sizes, "entries": entries}

    def difference(self, other):
        """Return the first step that differs, what differs there and by how much; None where both agree."""
        if self.digests == other.digests:
            return None
        pairs = enumerate(zip(self.digests, other.digests))
        entry = next((n for n, (left, right) in pairs if left != right), min(len(self.digests), len(other.digests)))
        return dict(self._describe(other, entry), step=entry)

    def _describe(self, other, entry):
        both = list(zip(self._values, other._values))
        if entry >= len(both) or None in both[entry]:
            return {}
        gaps = [(name, _largest_gap(left, right)) for name, left, right in zip(PARTS, *both[entry])]
        name, gap = next(((name, gap) for name, gap in gaps if gap != 0), ("episode end", None))
        if gap is None:
            return {"part": name}
        most = [_largest_gap(left[0], right[0]) for left, right in both if left is not None and right is not None]
        most = max([gap] + [g for g in most if g is not None]) if name == PARTS[0] else gap
        return {"part": name, "gap": gap, "most": most}


def _numbers(leaves):
    """Return the first numbers of some arrays, of which None stands for one that is not finite."""
    if any(leaf.dtype.kind not in "biuf" for leaf in leaves):
        return None
    values = [value for leaf in leaves for value in leaf.ravel()[:WIDEST]]
    return [_number(value) for value in values[:WIDEST]]


def _number(value):
    """Return one number, for a float32 the shortest decimal that stands for it."""
    if value.dtype.kind != "f":
        return int(value)
    number = float(str(value)) if value.dtype.itemsize < np.dtype(float).itemsize else float(value)
    return number if np.isfinite(number) else None


def _largest_gap(leaves, others):
    """Return the largest difference between two lists of arrays; None where they cannot be subtracted."""
    if [leaf.shape for leaf in leaves] != [leaf.shape for leaf in others]:
        return None
    gaps = [0.0]
    for left, right in zip(leaves, others):
        if left.dtype.kind not in "biufc" or right.dtype.kind not in "biufc":
            if _bytes(left) != _bytes(right):
                return None
        elif left.size:
            gaps.append(float(np.max(np.abs(left.astype("c16") - right.astype("c16")))))
    return max(gaps)


def _bytes(leaf):
    if leaf.dtype.kind == "O":
        return ADDRESS.sub("0x", repr(leaf.tolist())).encode("utf-8", "backslashreplace")
    return (leaf + 0.0 if leaf.dtype.kind in "fc" else leaf).tobytes()  # -0.0 is 0.0


def _leaves(value):
    if hasattr(value, "items"):
        return [leaf for _, item in sorted(value.items(), key=lambda pair: str(pair[0])) for leaf in _leaves(item)]
    if isinstance(value, (tuple, list)):
        return [leaf for item in value for leaf in _leaves(item)]
    return [value]
