"""Say in a sentence how the pictures of two cells differ."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from harness.physics.relation import Look, Part, PixelComparison
from harness.physics.sentences import percent

LOOKS = {
    Look.IDENTICAL: "is drawn identically, to the bit",
    Look.IMPERCEPTIBLE: "is drawn with other pixels, and nobody sees the difference",
    Look.CHANGED: "looks different",
    Look.OTHER_SIZE: "is drawn in another size",
    Look.NOT_COMPARABLE: "has no pictures that can be compared",
    Look.NONDETERMINISTIC: "cannot be compared as pictures: it does not draw the same state twice alike",
}

MOVES = {
    Part.CAMERA: "the camera is elsewhere",
    Part.LENS: "the lens of the camera is another one",
    Part.LIGHTS: "the lights differ",
    Part.THINGS: "the things in the scene differ in form or place",
    Part.COLOURS: "the colours or materials differ",
    Part.TEXTURES: "the textures differ",
    Part.SETTINGS: "the visual settings differ",
    Part.RENDERER: "another renderer drew it",
    Part.DRAWING: "camera, lights, things, colours, textures and settings are the same, so the drawing itself differs",
}


def describe(comparison: PixelComparison) -> str:
    """Return how the pictures differ, as the rest of a sentence whose subject is the environment."""
    text = LOOKS[comparison.kind]
    if comparison.kind is Look.CHANGED:
        text += f" in {percent(comparison.share)} of the picture (median {percent(comparison.median)})"
    if comparison.kind in {Look.CHANGED, Look.IMPERCEPTIBLE, Look.OTHER_SIZE}:
        text += f"; {describe_making(comparison.moved, comparison.compared)}"
    return text


def describe_making(moved: Sequence[str], compared: Collection[str]) -> str:
    """Return which parts of the making of a picture moved; where none did, which of them are the same."""
    if moved:
        return "; ".join(MOVES[Part(part)] for part in moved)
    same = [part for part in Part if part in compared and part is not Part.RENDERER]
    return f"with the same {' and '.join(same)}" if same else "it is not exposed which part of its making moved"
