"""Sentences made of codes and data, the patterns that find them, and observations that nothing can be made of."""

from __future__ import annotations

import re
from typing import Any

import pytest

from harness.model import Observation, words


def observation(code: str, **more: Any) -> Observation:
    """Return an observation of some check."""
    named = {name: more.pop(name) for name in ("at", "got", "promised") if name in more}
    return Observation(check="single.loop", code=code, data=more, **named)


WHERE = {"call": "reset()", "value": "an observation"}
NESTED = {"code": "render.blank", "at": None, "got": [0, 0, 0], "promised": None, "data": {}}


@pytest.mark.parametrize(
    ("observed", "sentence"),
    [
        (observation("render.blank", got=[0, 0, 0]), "blank frame: every pixel is [0, 0, 0]"),
        (
            observation("value.shape", got="(2,)", promised="(3,)", where=WHERE, promise="space"),
            "reset() returned an observation that has shape (2,), its space (3,)",
        ),
        (
            observation("value.not_finite", got=1, size=3, where={**WHERE, "path": "'arm' at 2"}),
            "reset() returned an observation that at 'arm' at 2 is not finite (1 of 3 values)",
        ),
        (observation("value.not_finite", got=1, size=3, where={"value": "qpos"}), "qpos is not finite (1 of 3 values)"),
        (
            observation("repeat.same", difference={"step": 1, "part": "observation", "gap": 0.30912, "most": 50.22}),
            "the same environment, reset with the same seed, gives another trajectory, "
            "from step 1 on (observation off by 0.309 there, at most by 50.2 later)",
        ),
        (
            observation("repeat.fresh", difference={"step": 4, "part": "terminated"}),
            "the same seed gives another trajectory in a new environment, from step 4 on (terminated)",
        ),
        (
            observation("device.other", promised="1", setting="X=1", got={"index": 0, "by": "Y=0"}),
            "asked for device 1 by X=1, drew on EGL device 0, which Y=0 named",
        ),
        (observation("raised", raised="KeyError: 'x'"), "KeyError: 'x'"),
        (observation("raised", raised=NESTED), "ContractViolation: blank frame: every pixel is [0, 0, 0]"),
        (
            observation("unmeasured.raised", raised=NESTED),
            "could not be measured: ContractViolation: blank frame: every pixel is [0, 0, 0]",
        ),
        (
            observation(
                "unmeasured.arrays",
                found={**NESTED, "code": "value.not_array", "data": {"where": WHERE}, "got": "a list"},
            ),
            "could not be measured as arrays: "
            "reset() returned an observation that is a list where an array was promised",
        ),
    ],
    ids=lambda value: value.code if isinstance(value, Observation) else "",
)
def test_sentences(observed: Observation, sentence: str) -> None:
    """Each as users have read it; the pattern of the code finds it, and so does that of all its data."""
    assert words.sentence(observed) == sentence
    if observed.code in {"raised", "unmeasured.raised", "unmeasured.arrays"}:
        return
    assert re.search(words.wording(observed.code), sentence)
    wanted = {name: _exactly(value) for name, value in words.values(observed).items()}
    assert words.contains(observed.code, wanted, observed)
    assert re.search(words.sentence_pattern(observed.code, wanted), sentence)


def _exactly(value: Any) -> Any:
    """Return a condition that only this value meets."""
    if isinstance(value, dict):
        return {name: _exactly(one) for name, one in value.items()}
    return value if isinstance(value, int | float) else words.escape(str(value))


@pytest.mark.parametrize(
    "observed",
    [
        observation("no.such.code", got=1),
        observation("value.shape"),
        observation("value.shape", got="(2,)", promised="(3,)", promise="space", where=None),
        observation("value.shape", got={"a": 1}, promised=[[[]]], promise=True, where={"call": 3}),
        observation("start.elsewhere", away="two", joints=None, name=[1], got="far", promised={}),
        observation("camera.aside", right=float("inf"), above=10**5000),
        observation("raised", raised={"code": "raised", "data": {"raised": {"code": "raised", "data": 3}}}),
        observation("raised", raised={"code": ["raised"]}),
        observation("more", got="\x1b[31m\n\x00"),
        observation("{got.__class__}", got=1),
    ],
    ids=lambda observed: observed.code,
)
def test_every_record_of_a_cell_has_words(observed: Observation) -> None:
    """An unknown code, data that are missing and data of another kind: some text, and no exception."""
    assert words.sentence(observed)
    assert not words.contains("render.blank", {}, observed)


def test_an_observation_within_itself_ends() -> None:
    """Nesting is followed to some depth, however deep it goes."""
    inner: dict[str, Any] = {"code": "raised", "data": {}}
    for _ in range(200):
        inner = {"code": "raised", "data": {"raised": inner}}
    assert len(words.sentence(observation("raised", raised=inner))) <= words.LONGEST


def test_a_long_sentence_keeps_its_ends() -> None:
    """Its beginning and its end, where the news is."""
    text = words.sentence(observation("warned.check_env", text="a" * 3000 + "z" * 3000))
    assert len(text) <= words.LONGEST + 40
    assert (text[0], text[-1]) == ("a", "z")


@pytest.mark.parametrize(
    ("wanted", "fits"),
    [
        ({}, True),
        ({"got": r"\(\d+, \d+, 4\)"}, True),
        ({"got": r"\(\d+, \d+"}, False),
        ({"got": r"\(\d+, \d+, 3\)"}, False),
        ({"promised": 3}, False),
        ({"other": "x"}, False),
        ({"got": {"a": 1}}, False),
    ],
)
def test_conditions(wanted: dict[str, Any], *, fits: bool) -> None:
    """A text is an expression for all of a value; in a sentence it stands in the value's place."""
    observed = observation("render.shape", got="(480, 720, 4)", promised="(height, width, 3)")
    assert words.contains("render.shape", wanted, observed) is fits
    if {"other"} != wanted.keys() and not isinstance(wanted.get("got"), dict):
        assert bool(re.search(words.sentence_pattern("render.shape", wanted), words.sentence(observed))) is fits


def test_conditions_of_tables_and_of_what_is_within() -> None:
    """A table has conditions of its own, of the phrases that fit it; an exception of ours is looked into."""
    wanted = {"setting": "X=.*", "got": {"api": "osmesa"}}
    drew = observation("device.other", promised="1", setting="X=1", got={"api": "osmesa"})
    assert words.contains("device.other", wanted, drew)
    assert re.search(words.sentence_pattern("device.other", wanted), words.sentence(drew))
    egl = observation("device.other", promised="1", setting="X=1", got={"index": 0, "by": "nothing"})
    assert not words.contains("device.other", wanted, egl)
    assert not re.search(words.sentence_pattern("device.other", wanted), words.sentence(egl))
    within = observation("raised", raised=NESTED)
    assert words.contains("render.blank", {}, within)
    assert words.contains("raised", {}, within)


@pytest.mark.parametrize(
    ("line", "code", "data"),
    [
        ("ContractViolation: blank frame: every pixel is [0, 0, 0]", "render.blank", {"got": r"\[0, 0, 0\]"}),
        (
            "ContractViolation: step() returned an observation that is not finite (1 of 3 values)",
            "value.not_finite",
            {"got": "1", "size": "3"},
        ),
        (
            "single.repeat.same: the same environment, reset with the same seed, gives another trajectory, "
            "from step 0 on (observation off by 0.157 there, at most by 0.157 later)",
            "repeat.same",
            {},
        ),
        (
            "ContractViolation: asked for device 1 by X=1, drew by osmesa, which knows no devices",
            "device.other",
            {"promised": "1", "setting": "X=1"},
        ),
    ],
)
def test_a_line_is_recognised(line: str, code: str, data: dict[str, str]) -> None:
    """By the template that has most of it, with the data that are no tables; and it is then found again."""
    assert words.recognise(line) == (code, data)
    assert re.search(words.sentence_pattern(code, data), line)


@pytest.mark.parametrize(
    "line",
    [
        "blank frame: every pixel is [0, 0, 0]",
        "ValueError: blank frame: every pixel is [0, 0, 0]",
        "ContractViolation: blank frame: every pixel is [0, 0…",
        "ContractViolation: of a library",
        "single.check_env: what the library says",
        "",
    ],
)
def test_no_line_of_a_library_is_recognised(line: str) -> None:
    """A line of a library, or a truncated line, is not recognised."""
    assert words.recognise(line) is None


def test_numbers_are_looked_for_as_they_are_written() -> None:
    """A number in the data is matched in the format that the template gives it."""
    told = observation("solver.differs", steps=5, gap=0.123456, largest=2.0)
    assert re.search(words.sentence_pattern("solver.differs", {"gap": 0.123456}), words.sentence(told))
    assert words.contains("solver.differs", {"gap": 0.123456}, told)
    assert not words.contains("solver.differs", {"steps": 5.0}, told)
