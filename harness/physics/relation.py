"""Define the relation of two cells for one case: in behaviour, to a policy that plays it, and in pictures.

NumPy is not imported here: reports show relations that others computed.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from msgspec import Struct

JUST_NOTICEABLE = 2.3
"""The distance of two colours in CIELAB (CIE 1976) that is just noticed (Mahy, Van Eycken and Oosterlinck, 1994)."""


class Class(StrEnum):
    """The relation of two cells for one case or one output of it."""

    IDENTICAL = "identical"
    ROUND_OFF = "round_off"
    SOLVER_PRECISION = "solver_precision"
    UNDECIDED = "undecided"
    CHANGED = "changed"
    NOT_EXERCISED = "not_exercised"
    NOT_COMPARABLE = "not_comparable"
    NONDETERMINISTIC = "nondeterministic"
    OTHER_INTERFACE = "other_interface"
    OTHER_OBSERVATION = "other_observation"
    OTHER_REWARD = "other_reward"
    OTHER_TERMINATION = "other_termination"
    RESEEDED = "reseeded"
    OTHER_START = "other_start"


STARTS = frozenset({Class.RESEEDED, Class.OTHER_START})
"""Classes of resets that do not start alike."""


AGREEING = frozenset({Class.IDENTICAL, Class.ROUND_OFF, Class.SOLVER_PRECISION})
"""Classes of two cells that belong to one family."""


class Difference(Struct, frozen=True, kw_only=True):
    """The difference of one output.

    `largest` and `median` are relative differences, of the states that differ (see `gaps`); `share` is the share of
    states whose difference is beyond `CHANGED_RATIO`, `state` the one with the largest ratio, `ratio` that ratio.
    """

    output: str
    kind: Class
    largest: float = 0.0
    median: float = 0.0
    share: float = 0.0
    ratio: float = 0.0
    state: int | None = None


class Comparison(Struct, frozen=True, kw_only=True):
    """The relation of two cells for one case.

    `kind` sums it up. `dynamics` is of the next state alone, `start` of the resets. `stage` is the first stage that
    differs, `start_of_stage` the step or inner stage at whose start it was read, `model` the physical arrays of the
    model that differ. `warm_start` is whether the next state differs only from the stored warm start. `seeded` is
    whether no state can be set: then the states are those of short runs from seeded resets. `unrepeated` are outputs
    that depend on more than the state, and are left out.
    """

    kind: Class
    dynamics: Class
    start: Class
    differences: tuple[Difference, ...] = ()
    stage: str | None = None
    start_of_stage: str | None = None
    model: tuple[str, ...] = ()
    warm_start: bool = False
    seeded: bool = False
    unrepeated: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Return whether both belong to one family."""
        return self.kind in AGREEING

    @property
    def behaves_otherwise(self) -> bool | None:
        """Return whether both behave or start in different ways; None where that cannot be told."""
        if self.kind in {Class.UNDECIDED, Class.NOT_COMPARABLE, Class.NONDETERMINISTIC}:
            return None
        return not self.agrees or self.start in STARTS

    def of(self, output: str) -> Difference:
        """Return the difference of one output; identical where it was not compared."""
        return next(
            (one for one in self.differences if one.output == output), Difference(output=output, kind=Class.IDENTICAL)
        )


class Effect(StrEnum):
    """The effect of a change on a policy."""

    WORSE = "worse"
    BETTER = "better"
    EQUAL = "equal within 5 points"
    UNTOLD = "cannot tell"


class Consequence(Struct, frozen=True, kw_only=True):
    """The effect of a change on a policy.

    `before` and `after` are the share of episodes that succeed, or the mean return. `difference` is in points, with the
    interval of 95 % from `low` to `high`: percentage points of success, or hundredths of what the policy gains over
    random actions. `least` is the smallest difference whose interval leaves out 0 with a power of 80 %. `moved_starts`
    counts episodes that start elsewhere, `identical` is whether all are the same to the bit.
    """

    effect: Effect
    measure: Literal["success", "return"]
    episodes: int
    before: float
    after: float
    difference: float
    low: float
    high: float
    least: float
    moved_starts: int = 0
    identical: bool = False
    repeats: bool = True


class Look(StrEnum):
    """The relation of the pictures of two cells."""

    IDENTICAL = "identical"
    IMPERCEPTIBLE = "imperceptible"
    CHANGED = "changed"
    OTHER_SIZE = "other_size"
    NOT_COMPARABLE = "not_comparable"
    NONDETERMINISTIC = "nondeterministic"


class Part(StrEnum):
    """A part of a picture's making that can move; `DRAWING` is the drawing itself, where all others are the same."""

    CAMERA = "camera"
    LENS = "lens"
    LIGHTS = "lights"
    THINGS = "things"
    COLOURS = "colours"
    TEXTURES = "textures"
    SETTINGS = "settings"
    RENDERER = "renderer"
    DRAWING = "drawing"


class PixelComparison(Struct, frozen=True, kw_only=True):
    """The relation of the pictures of two cells.

    `share` is the largest share of a picture that looks different, `median` that of the middle one of all states,
    `distance` the largest mean distance of colours. `moved` are the parts of the making that differ, `compared` those
    that are known of both.
    """

    kind: Look
    share: float = 0.0
    median: float = 0.0
    distance: float = 0.0
    moved: tuple[Part, ...] = ()
    compared: tuple[Part, ...] = ()

    @property
    def looks_same(self) -> bool:
        """Return whether nobody sees a difference."""
        return self.kind in {Look.IDENTICAL, Look.IMPERCEPTIBLE}
