"""Known failures and expectations tell our own sentences by code: no pattern of theirs can meet one."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import pytest

from harness.matrix.signatures import Sighting, Signature
from harness.model import Observation, Phase, words
from harness.model.words import VIOLATION
from harness.reports import document
from harness.running.signatures.shipped_signatures import load_all
from harness.standalone.failures import matching
from harness.standalone.failures.lines import shorten_line
from harness.standalone.failures.matching import Around, Evidence, diagnose

ROOT = Path(__file__).parents[3]
SAMPLES: dict[str, tuple[Any, ...]] = {
    "got": ("(480, 720, 4)", "#38acf4", 3),
    "promised": ("(height, width, 3)", "#0c0050", 1),
    "setting": ("MUJOCO_EGL_DEVICE_ID=1", "render_gpu_device_id=1"),
    "call": ("step()", "get_camera_image_gpu_tensor()"),
    "wrapper": ("GymWrapper",),
    "steps": (100,),
    "times": (4,),
    "number": (0,),
}
"""Values such as cells report, by field; any other field holds a word."""

TABLES: dict[str, tuple[Any, ...]] = {
    "where": ({"call": "reset()", "value": "an observation", "path": "'x'"}, {"value": "qpos"}),
    "difference": ({"step": 0, "part": "observation", "gap": 0.157, "most": 0.2}, {"step": 3, "part": "end"}),
    "difference:alone": ({"number": 0, "environments": 2, "part": "reward", "step": 5},),
    "got:drew": ({"index": 0, "by": "MUJOCO_EGL_DEVICE_ID=0"}, {"api": "osmesa"}),
}
CHECKS = ("single.repeat.same", "render.picture", "render.rgb_array", "interop.torchrl.reset", "interop.torchrl.last")


def samples(code: str) -> Iterator[str]:
    """Yield sentences of a code, as they stand in a decisive line, as a finding and after the name of its check."""
    fields = sorted({(name, form) for _, name, form in words.split(words.templates()[code]) if name})
    choices = [TABLES.get(f"{name}:{form}" if form else name) or TABLES.get(name) for name, form in fields]
    chosen = [found or SAMPLES.get(name, ("word",)) for (name, _), found in zip(fields, choices, strict=True)]
    for values in product(*chosen):
        data = {name: value for (name, _), value in zip(fields, values, strict=True)}
        text = words.sentence(Observation(check="single.loop", code=code, data=data))
        yield from (text, f"{VIOLATION}: {text}", *(f"{check}: {text}" for check in CHECKS))


OURS = [text for code in words.templates() for text in samples(code)]


def test_samples_are_whole() -> None:
    """Each code has some, and none of them is what is written where data are missing."""
    assert not [text for text in OURS if re.match(r"[\w.]+: \{", text)]


def patterns() -> Iterator[tuple[str, str]]:
    """Yield the patterns of known failures and of the expectations of matrices, each with its place."""
    yield from ((one.id, str(one.pattern)) for one in load_all() if one.pattern)
    for path in sorted((ROOT / "matrices").glob("*.toml")):
        plain = tomllib.loads(path.read_text(encoding="utf-8"))
        tables = [*plain.get("expect", ()), *(change.get("expect", {}) for change in plain.get("change", ()))]
        yield from ((f"{path.name}: {table['match']}", table["match"]) for table in tables if "match" in table)


def matching_sentences(pattern: str) -> list[str]:
    """Return our own sentences that a pattern finds."""
    return [text for text in OURS if re.search(pattern, text, re.MULTILINE)]


def test_no_pattern_finds_our_own_sentence() -> None:
    """A `code` is for that: a sentence may change, and words of a library may not be taken for it."""
    every = list(patterns())
    assert len(every) > len(load_all())
    assert [(place, found[0]) for place, pattern in every if (found := matching_sentences(pattern))] == []


@pytest.mark.parametrize(
    "pattern",
    [
        r"single\.repeat\.same: the same environment, reset with the same seed, gives another trajectory",
        r"render\.picture: (something|nothing) in the picture has the colour #",
        r"render\(\) returned shape \(\d+, \d+, 4\), not \(height, width, 3\)",
        r"asked for device \d+( or \d+)* by (render_gpu_device_id|MUJOCO_EGL_DEVICE_ID)=.*, drew (on|by) ",
        r"a stored rollout of \d+ steps holds other values than the steps returned: [\s\S]{0,300}?at every step",
        r"interop\.torchrl\.reset: the whole environment was reset \d+ times? while some of its worlds",
        r"interop\.torchrl\.last: \w+: where an episode ended, zeros are stored for its last observation",
        r"camera image is None|TypeError: expected Tensor as ele?ment \d+ in argument 0, but got NoneType",
        r"asked for device 1 by render_gpu_device_id=1, drew by osmesa, which knows no devices",
        r"gives another trajectory",
        r"blank frame",
    ],
)
def test_a_pattern_of_our_own_sentence_is_seen(pattern: str) -> None:
    """Those that known failures and matrices had before they named codes."""
    assert matching_sentences(pattern)


BY_CODE = [one for one in load_all() if one.code]


def observed(one: Signature) -> Iterator[Observation]:
    """Yield observations with the codes of a known failure, some of which have its data."""
    for code in one.codes:
        fields = sorted(words.fields(code))
        for values in product(*((*SAMPLES.get(name, ()), *TABLES.get(name, ()), "word") for name in fields)):
            yield Observation(check="x", code=code, data=dict(zip(fields, values, strict=True)))


@pytest.mark.parametrize("one", BY_CODE, ids=lambda one: one.id)
def test_code_and_sentence_tell_the_same(one: Signature) -> None:
    """It fits the code that a cell reported, and the sentence that somebody pasted."""
    assert one.wording
    found = [(one.observes(seen), bool(re.search(one.wording, words.sentence(seen)))) for seen in observed(one)]
    assert (True, True) in found
    assert {pair for pair in found if pair[0] != pair[1]} == set()


@pytest.mark.parametrize("one", BY_CODE, ids=lambda one: one.id)
def test_the_standalone_code_knows_the_sentence(one: Signature) -> None:
    """It has neither codes nor templates: what it is given of a known failure has the pattern of our sentence."""
    alone = matching.read(json.loads(json.dumps(one.as_file)))
    pasted = next(words.sentence(seen) for seen in observed(one) if one.observes(seen))
    (hit,) = matching.matches([alone], matching.Evidence(phase=None, reasons=(f"{VIOLATION}: {pasted}",)))
    assert (hit.signature.id, hit.seen) == (one.id, shorten_line(f"{VIOLATION}: {pasted}"))


@pytest.mark.parametrize("one", BY_CODE, ids=lambda one: one.id)
def test_a_code_is_recognised_whatever_its_sentence(one: Signature) -> None:
    """Words may change: with the code there, its line is what it is told by; without it, no line of ours is."""
    seen = next(seen for seen in observed(one) if one.observes(seen))
    sighting = Sighting(observed=seen, line="in other words", is_reason=True)
    phase = Phase(one.phases[0])
    told = Evidence(phase=phase, reasons=("in other words",), observed=(sighting,))
    around = Around(
        installed={
            "metaworld": "3",
            "mujoco": "3",
            "numpy": "2",
            "torchrl": "0.8",
            "panda-gym": "2",
            "gymnasium": "1.2.3",
            "envpool": "0.8.4",
            "myosuite": "2.12.2",
        }
    )
    found = diagnose([msgspec.structs.replace(one, generic=False)], [told], around)
    assert [(hit.signature.id, hit.seen, hit.is_reason) for hit in found] == [(one.id, "in other words", True)]
    other = Evidence(phase=phase, reasons=(words.sentence(seen),), observed=())
    assert diagnose([msgspec.structs.replace(one, generic=False)], [other], around) == ()


def test_committed_reports_hold_them() -> None:
    """Cells are known to have failed of what is told by code."""
    wanted = {one.id for one in BY_CODE}
    made = [document.read(path.read_bytes(), str(path)) for path in (ROOT / "reports").glob("*/report.json")]
    seen = {one.signature for read in made for cell in read.cells for one in cell.diagnoses}
    assert len(wanted & seen) >= 5
