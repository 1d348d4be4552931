"""Pictures in a report: which cells are compared, and what a sentence says of a boundary."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import case, cell, record
from readings import GOOD, HERE, Check, lines
from specimens import GENERATED

from harness.model import CaseRecord, CellRecord, Plan, replace
from harness.model.report_types import Document, PicturesEntry
from harness.probes import array_files, thumbnails
from harness.probes.evidence import GIVEN, PIXELS, REPLY, ProbeRun, Request
from harness.probes.vault import Vault, keep_files
from harness.reports.pictures import boundaries, first_pictures, picture_markdown

EMPTY = Document(generated=GENERATED, machines={}, cells=(), dropped=())
EYE = {"position": [0.0, -3.0, 1.0], "forward": [0.0, 1.0, 0.0], "up": [0.0, 0.0, 1.0], "fovy": 45.0}
AWAY = {**EYE, "position": [0.0, -5.0, 1.0]}
GREY, BRIGHT, NEARLY = 100, 180, 101


def frame(level: int) -> bytes:
    """Return a small picture of one grey, as it is kept."""
    array = io.BytesIO()
    np.save(array, np.full((96, 96, 3), level, np.uint8))
    small_frame = thumbnails.thumbnail(array.getvalue())
    assert small_frame
    return small_frame


def drawn(vault: Vault, level: int = GREY, camera: dict[str, Any] | None = None, start: float = 1.5) -> CaseRecord:
    """Return a case whose first picture is of one grey, after a start."""
    picture = {
        "shape": [96, 96, 3], "sha256": f"{level:064x}", "constant": True, "colours": {"111": 9216},
        "means": [[level] * 3] * 9, "spread": [0.0] * 3, "camera": camera or EYE,
    }  # fmt: skip
    values = {"steps": 1, "sizes": [1, 0, 0, 0], "entries": [[[start]]]}
    checks = [
        Check(name="single.loop", facts={"trajectory": ["0" * 12], "values": values}),
        Check(name="render.rgb_array", facts={"pictures": {"first": picture}, "gl": {"renderer": "soft"}}),
    ]
    return stored(vault, {REPLY: lines(checks), "render.rgb_array-first.png": frame(level)})


def drawn_states(vault: Vault, level: int = GREY, unrepeated: Sequence[int] = ()) -> CaseRecord:
    """Return a case of which two states of a bank were drawn."""
    states = [{"state": number, "shape": [96, 96, 3], "drawings": 1, "camera": EYE} for number in (0, 60)]
    facts = {"drawn": states, "unrepeated": unrepeated, "gl": {}, "form": 1}
    arrays = {"digest": np.full((2, 32), level, np.uint8), "small": np.full((2, 48, 48, 3), level, np.uint8)}
    return stored(vault, {PIXELS: array_files.encode(array_files.with_facts(arrays, facts)), GIVEN: b"a bank"})


def stored(vault: Vault, files: dict[str, bytes]) -> CaseRecord:
    """Return a case whose only run left these files."""
    run = ProbeRun(
        request=Request(), program={}, end=GOOD, host=HERE, files=keep_files(vault, files), measured=GENERATED
    )
    return replace(case("pppp", "ant"), runs=(vault.put(run, "key"),))


def measured(release: str, drawn_case: CaseRecord, python: str = "3.11", numpy: str = "2.2.6") -> CellRecord:
    """Return a cell of a release with this case."""
    axes = {"python": python, "gymnasium": release}
    of = cell(f"py{python}_gymnasium-{release}", ("ant",), axes=axes)
    return record(drawn_case, of=of, installed={"gymnasium": release, "numpy": numpy})


def pictures(vault: Vault, *records: CellRecord) -> tuple[PicturesEntry, ...]:
    """Return the pictures of a report of these cells."""
    plan = Plan(matrix="quick", cells=tuple(one.cell for one in records), axes=("python", "gymnasium"))
    entries = boundaries.add(EMPTY, records, [plan], vault).pictures or ()
    # A report asks for pictures only where they may differ: no entry may be lost by that.
    assert first_pictures.may_differ(records, vault) or not entries
    return entries


@pytest.fixture
def vault(tmp_path: Path) -> Vault:
    """Return an empty vault."""
    return Vault(tmp_path)


def test_a_release_that_moves_the_camera_is_named_in_one_sentence(vault: Vault) -> None:
    """Releases stand in their order, and equal ones share a column."""
    cells = [
        measured("1.4.0", drawn(vault, BRIGHT, AWAY)),
        measured("1.3.0", drawn(vault)),
        measured("1.10.0", drawn(vault, BRIGHT, AWAY)),
        measured("1.2.3", drawn(vault)),
    ]
    (entry,) = pictures(vault, *cells)
    assert picture_markdown.picture_table(entry) == (
        "| images / gymnasium | 1.2.3 to 1.3.0 | 1.4.0 to 1.10.0 |\n| --- | :-: | :-: |\n| Ant-v5 | a | b |\n"
    )
    assert picture_markdown.picture_sentences(entry) == [
        "gymnasium 1.3.0 to 1.4.0: 1 of 1 tasks look different in 100% of the image; the camera is elsewhere."
    ]
    assert picture_markdown.picture_title(entry) == "gymnasium (python 3.11)"


def test_a_boundary_between_locks_that_differ_in_more_names_the_rest(vault: Vault) -> None:
    """It is not separated from numpy."""
    cells = [measured("1.3.0", drawn(vault)), measured("1.4.0", drawn(vault, BRIGHT), numpy="2.3.0")]
    (entry,) = pictures(vault, *cells)
    (sentence,) = picture_markdown.picture_sentences(entry)
    assert sentence.endswith("; with the same camera and lens; other packages differ, too: numpy 2.2.6 to 2.3.0.")


def test_a_difference_that_nobody_sees_keeps_its_letter(vault: Vault) -> None:
    """It has a prime, and the legend explains that."""
    (entry,) = pictures(vault, measured("1.3.0", drawn(vault)), measured("1.4.0", drawn(vault, NEARLY)))
    assert entry.letters == {"Ant-v5": ("a", "a'")}
    assert "A prime: some pixels differ, but the eye does not see it." in picture_markdown.picture_legend(entry)
    assert picture_markdown.picture_sentences(entry)[0].startswith(
        "gymnasium 1.3.0 to 1.4.0: 1 of 1 tasks differ in pixels, but not visibly"
    )


def test_pictures_of_other_starts_are_not_compared(vault: Vault) -> None:
    """They show other states, whatever they look like."""
    cells = [measured("1.3.0", drawn(vault)), measured("1.4.0", drawn(vault, BRIGHT, start=1.6))]
    assert pictures(vault, *cells) == ()
    (entry,) = pictures(vault, *cells, measured("1.2.3", drawn(vault, BRIGHT)))
    assert entry.letters == {"Ant-v5": ("a", "b", "?")}
    assert [boundary.after for boundary in entry.boundaries] == ["1.3.0"]


def test_cells_on_other_pythons_are_no_neighbours(vault: Vault) -> None:
    """The longest line of cells that differ in one axis alone is compared, and a single cell has no pictures."""
    other = measured("1.0.0", drawn(vault, BRIGHT, AWAY), python="3.10")
    (entry,) = pictures(vault, other, measured("1.3.0", drawn(vault)), measured("1.4.0", drawn(vault, BRIGHT)))
    assert entry.releases == ("1.3.0", "1.4.0")
    assert pictures(vault, other, measured("1.3.0", drawn(vault))) == ()


def test_starts_that_look_the_same_everywhere_are_left_out(vault: Vault) -> None:
    """Nobody asked to compare them; drawn states are a table all the same."""
    assert pictures(vault, measured("1.3.0", drawn(vault)), measured("1.4.0", drawn(vault))) == ()
    (entry,) = pictures(vault, measured("1.3.0", drawn_states(vault)), measured("1.4.0", drawn_states(vault)))
    assert (entry.letters, entry.boundaries) == ({"Ant-v5": ("a", "a")}, ())


def test_drawn_states_go_before_starts_and_have_to_repeat(vault: Vault) -> None:
    """States of a bank are compared where they were drawn; what does not repeat is never called the same."""
    cells = [measured("1.3.0", drawn_states(vault)), measured("1.4.0", drawn_states(vault, unrepeated=[60]))]
    (entry,) = pictures(vault, *cells)
    assert (entry.method, entry.letters) == ("states", {"Ant-v5": ("a", "?")})
    (boundary,) = entry.boundaries
    assert boundary.differences[0].kind == "nondeterministic"
    assert "1 of 1 tasks draw the same state differently each time" in picture_markdown.picture_sentences(entry)[0]


def test_evidence_that_cannot_be_read_is_no_picture(vault: Vault) -> None:
    """A damaged file, facts of another shape and a missing frame compare with nothing, and raise nothing."""
    damaged = stored(vault, {PIXELS: b"PK no zip", GIVEN: b"a bank"})
    shapeless = stored(vault, {PIXELS: array_files.encode(array_files.with_facts({}, {"drawn": 7})), GIVEN: b"a bank"})
    assert pictures(vault, measured("1.3.0", damaged), measured("1.4.0", shapeless)) == ()
    facts = {"drawn": [{"state": 0, "shape": [9, 9, 3], "drawings": 1, "camera": None}], "unrepeated": [], "gl": {}}
    flat = {"digest": np.zeros((1, 32), np.uint8), "small": np.zeros((1, 9), np.uint8)}
    content = array_files.encode(array_files.with_facts(flat, {**facts, "form": 1}))
    assert (
        pictures(vault, *[measured(one, stored(vault, {PIXELS: content, GIVEN: b""})) for one in ("1.0", "2.0")]) == ()
    )


def test_equal_first_pictures_need_no_comparison(vault: Vault) -> None:
    """One digest for each case in all cells: nothing may differ, whatever the starts."""
    same = [measured("1.3.0", drawn(vault)), measured("1.4.0", drawn(vault, start=2.0))]
    assert not first_pictures.may_differ(same, vault)
    assert first_pictures.may_differ([*same, measured("1.5.0", drawn(vault, NEARLY))], vault)
    assert first_pictures.may_differ([measured("1.3.0", stored(vault, {REPLY: b'{"pictures": no JSON'}))], vault)
    assert not first_pictures.may_differ([measured("1.3.0", stored(vault, {REPLY: b""}))], vault)
