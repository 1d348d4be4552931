"""Cell ids: equal for equal questions only, in one form, and found by the form of earlier versions, too."""

from __future__ import annotations

import json
import random
import re
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from builders import cell_requiring
from packaging.requirements import Requirement

from harness.machine.store import Store
from harness.matrix import plan
from harness.model import CellRecord, IndexSettings, Subject, cellid, replace
from harness.model.cellid import CellId
from harness.model.vocabulary import Instant
from harness.reports import document
from harness.reports.answers import result_index

REPORTS = Path(__file__).parents[3] / "reports"
LABEL = re.compile(r"[A-Za-z0-9.+-]+(_[A-Za-z0-9.+-]+)*")


class Named(NamedTuple):
    """A cell as far as its id goes."""

    id: str
    axes: dict[str, str]


AXES = {"python": "3.11", "gymnasium": "1.2.3", "gym": "absent", "mujoco": "3.3.7", "stack": "robosuite1.3-mujoco_py"}
CELL = Named("demo/py3.11_gymnasium-1.2.3_gym-absent_mujoco-3.3.7_robosuite1.3-mujoco-py", AXES)


def ad_hoc_id(*requirements: str, **more: Any) -> str:
    """Return the id of an ad-hoc cell."""
    return (
        plan.single(plan.TrialOptions(requirements=requirements, python=more.pop("python", "3.11"), **more)).cells[0].id
    )


# --- questions -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("gymnasium==1.2.3", "gymnasium-1.2.3"),
        ("mujoco_py==2.1", "mujoco-py-2.1"),
        ("gymnasium[classic_control]==1.2.3", "gymnasium.classic-control-1.2.3"),
        ("gymnasium[mujoco,classic-control]", "gymnasium.classic-control.mujoco"),
        ("numpy<2", "numpy-lt2"),
        ("numpy>=2", "numpy-ge2"),
        ("numpy!=2.0.1", "numpy-ne2.0.1"),
        ("numpy<2,>=1.24", "numpy-ge1.24.lt2"),
        ("numpy==1.24.*", "numpy-like1.24"),
        ("numpy~=1.24.1", "numpy-near1.24.1"),
        ("torch==2.1.0+cpu", "torch-2.1.0+cpu"),
        ("py-3", "py-3-any"),
        ("py==3", "py-3"),
    ],
)
def test_a_requirement_is_spelled_in_letters(line: str, part: str) -> None:
    """Extras, bounds and exclusions stand in the id, and need no digest."""
    assert cellid.of_question("3.11", [Requirement(line)]) == f"py3.11_{part}"


NAMES = ("numpy", "gymnasium", "gym", "mujoco", "py-3", "py", "dm_control")
EXTRAS = ("", "[mujoco]", "[classic-control]", "[mujoco,classic-control]", "[a-3]")
BOUNDS = ("", "==1.2.3", "==2.0", "<2", "<=2", ">2", ">=2", "!=2.0.1", ">=1.24,<2", ">=1.24,!=1.25,<2", "~=1.24.1",
          "==1.24.*", "!=1.24.*", "==3", "===3", "==1!2.0", "==2.0+cpu", "==2.0+lt2", "==2.0,<3")  # fmt: skip
MARKERS = ("", "; python_version < '3.12'", "; python_version < '3.11'")
OPTIONS: tuple[dict[str, Any], ...] = (
    *({key: (line,)} for key in ("constraints", "overrides", "build_constraints")
      for line in ("numpy<2", "numpy>=2", "numpy!=2.0.1", "gym[mujoco]<2", "numpy<2; python_version < '3.12'")),
    {"constraints": ("numpy<2", "mujoco<3")},
    *({"only_binary": (name,)} for name in ("mujoco", "all", ":all:")),
    *({"as_of": instant} for instant in ("2024-01-31", "2024-02-01", "2024-01-31T12:00:00Z")),
    *({"environment": {name: value}} for name, value in
      (("MUJOCO_GL", "egl"), ("mujoco_gl", "egl"), ("MUJOCO_GL", "osmesa"), ("MUJOCO", "GL-egl"), ("MUJOCO_GL", ""))),
    *({"envs": (env,)} for env in ("Ant-v5", "ant-v5", "a/b", "a-b", "a_b", "x" * 60, "x" * 61)),
    {"envs": ("Ant-v5",), "api": "gym"},
    {"envs": ("Ant-v5",), "imports": ("one",)},
    {"imports": ("one",)},
    {"imports": ("one.two",)},
    {"index": IndexSettings(default="https://example.org/a")},
    {"index": IndexSettings(default="https://example.org/b")},
    {"index": IndexSettings(no_index=True, find_links=("wheels",))},
    {"prerelease": "allow"},
    {"torch_backend": "cu126"},
    {"interpreter": "/a/bin/python"},
    {"interpreter": "/b/bin/python"},
    {"python": "3.12"},
    {"subject": Subject(source="/a/demo")},
    {"subject": Subject(source="/b/demo")},
    {"subject": Subject(source="/a/demo", extras=("x",))},
    {"subject": Subject(source="/a/demo", groups=("x",))},
    {"envs": ("mujoco:a.xml",), "files": {"a.xml": "<one/>"}},
    {"envs": ("mujoco:a.xml",), "files": {"a.xml": "<two/>"}},
)  # fmt: skip


def test_ids_of_different_questions_differ() -> None:
    """Whatever two requirements, options and variables say differently, no two of them share an id."""
    lines = [f"{name}{extra}{bound}{marker}" for name in NAMES for extra in EXTRAS for bound in BOUNDS
             for marker in MARKERS]  # fmt: skip
    chance = random.Random(7)
    several = {tuple(sorted(chance.sample(lines, chance.randint(2, 4)))) for _ in range(500)}
    several = {each for each in several if len({re.split(r"[\[=<>!~;]", line)[0] for line in each}) == len(each)}
    ids = [ad_hoc_id(line) for line in lines] + [ad_hoc_id(*each) for each in sorted(several)]
    ids += [ad_hoc_id("gymnasium==1.2.3", **more) for more in OPTIONS]

    assert len({name.casefold() for name in ids}) == len(ids)
    assert all(
        LABEL.fullmatch(CellId.parse(name).label) and len(CellId.parse(name).label) <= cellid.LONGEST for name in ids
    )


def test_options_together_are_another_question() -> None:
    """Two options are not one of them, nor two others."""
    pairs = [(one, other) for one, other in combinations(OPTIONS, 2) if not one.keys() & other.keys()]
    ids = [ad_hoc_id("gymnasium==1.2.3", **one, **other) for one, other in pairs]

    assert len({name.casefold() for name in ids}) == len(ids)


@pytest.mark.parametrize("seed", range(20))
def test_ids_of_equal_questions_are_equal(seed: int) -> None:
    """The order of requirements, bounds, constraints and variables changes nothing, nor how a name is written."""
    lines = ["gymnasium[mujoco,classic-control]==1.2.3", "numpy>=1.24,<2", "dm-control", "scipy!=1.0"]
    again = ["Gymnasium[classic_control,mujoco] == 1.2.3", "numpy<2, >=1.24", "dm_control", "SciPy!=1.0.0"]
    again[3] = "SciPy!=1.0"
    constraints, variables = ["mujoco<3", "torch<2"], [("A", "1"), ("B", "2")]
    chance = random.Random(seed)
    first = ad_hoc_id(*lines, constraints=tuple(constraints), environment=dict(variables))
    for each in (again, constraints, variables):
        chance.shuffle(each)

    assert ad_hoc_id(*again, constraints=tuple(constraints), environment=dict(variables)) == first


def test_the_instant_of_asking_is_no_part_of_the_question() -> None:
    """The instant of today's index is in no id; one that was asked for is."""
    plain = ad_hoc_id("gymnasium==1.2.3")

    assert (
        plain == ad_hoc_id("gymnasium==1.2.3", instant=Instant.canonical("2026-11-20")) == "try/py3.11_gymnasium-1.2.3"
    )
    assert ad_hoc_id("gymnasium==1.2.3", as_of="2024-01-31") == f"{plain}_+as-of-2024-01-31"


def test_environments_that_are_tried_anyway_are_no_other_question() -> None:
    """`--env CartPole-v1` beside gymnasium asks for what would be tried without it."""
    assert ad_hoc_id("gymnasium", envs=("CartPole-v1",)) != ad_hoc_id("gymnasium", envs=("Acrobot-v1",))
    assert ad_hoc_id("scipy", imports=("scipy",)) != ad_hoc_id("scipy")


def test_certificates_of_different_questions_lie_apart() -> None:
    """The folder of a certificate carries the cell and all that was asked of it."""
    words = [("numpy",), ("numpy", "any"), ("numpy-any",), ("numpy", "bad-2.0"), ("numpy any",), ("numpy:any",)]
    cells = ("try/py3.11_numpy-lt2", "try/py3.11_numpy-ge2")
    folders = {CellId.parse(name).folder(*each) for name in cells for each in words}

    assert len(folders) == 2 * len(words)
    assert CellId.parse("a/b_c").folder("along-x") == "a/b_c/along-x"


# --- changed cells ---------------------------------------------------------------------------------------------


def test_a_changed_cell_says_which_change_and_which_python() -> None:
    """A cell that runs on another Python than its base names it; a long base stays distinct."""
    long = [f"demo/py3.11_{'x' * 138}{end}" for end in "ab"]

    assert str(CellId.parse("demo/py3.12_a").changed("repair")) == "demo/py3.12_a_with-repair"
    assert str(CellId.parse("demo/py3.12_a").changed("repair", "3.9")) == "demo/py3.12_a_with-repair-on-py3.9"
    assert str(CellId.parse("demo/py3.12_a").changed("py3.9", "3.9")) == "demo/py3.12_a_with-py3.9"
    changed = [str(CellId.parse(each).changed("repair")) for each in long]
    assert len({*changed}) == 2
    assert all(len(CellId.parse(each).label) == cellid.LONGEST for each in changed)


@pytest.mark.parametrize("file", sorted(REPORTS.glob("*/report.json")), ids=lambda file: file.parent.name)
def test_no_committed_name_lies_about_its_python(file: Path) -> None:
    """The Python that a cell ran on is the one that its id names."""
    for cell in document.read(file.read_bytes(), file.name).cells:
        named = re.findall(r"(?:^|-on-|_)py(\d[\d.]*\d)", CellId.parse(cell.id).label)
        assert cell.python is None or f"{cell.python}.".startswith(f"{named[-1]}."), cell.id


# --- the form before -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "demo/py3.11-gymnasium1.2.3-gym-absent-mujoco3.3.7-robosuite1.3-mujoco_py",
        "py3.11-gymnasium1.2.3-gym-absent-mujoco3.3.7-robosuite1.3-mujoco_py",
        "demo/py3.11-*",
        "*-mujoco3.3*",
        "*mujoco_py",
        "*_mujoco-3.3*",
        "demo/py3.11_*",
    ],
)
def test_either_form_finds_a_cell(text: str) -> None:
    """Ids, labels and globs of earlier versions stay good."""
    assert cellid.has_name(text, CELL) is ("*" not in text)
    assert cellid.select(text, [CELL]) == [CELL]
    assert cellid.fits(text, CELL)


@pytest.mark.parametrize("text", ["demo/py3.1-*", "*-mujoco3.4*", "*-3.3.7", "py3.11-gymnasium-*", "mujoco"])
def test_a_glob_of_mixed_forms_finds_nothing(text: str) -> None:
    """Forms are not mixed: a glob holds for an id as a whole."""
    assert cellid.select(text, [CELL]) == []


def test_an_older_id_is_read() -> None:
    """It gives the id of today, whatever the order of the axes; one of today stays as it is."""
    older = "demo/py3.11-gymnasium1.2.3-gym-absent-mujoco3.3.7-robosuite1.3-mujoco_py"
    axes = dict(sorted(AXES.items()))

    assert cellid.to_old_form(CELL) == older
    assert cellid.to_current_form(older, axes) == cellid.to_current_form(CELL.id, axes) == CELL.id
    assert cellid.to_current_form(f"{older}-with-repair", axes, "3.9") == f"{CELL.id}_with-repair-on-py3.9"
    assert cellid.to_current_form(f"{CELL.id}_with-repair-on-py3.9", axes, "3.9") == f"{CELL.id}_with-repair-on-py3.9"
    assert cellid.to_old_form(Named(f"{CELL.id}_with-repair-on-py3.9", AXES)) == f"{older}-with-repair"


@pytest.mark.parametrize("file", sorted(REPORTS.glob("*/report.json")), ids=lambda file: file.parent.name)
def test_every_committed_id_has_one_form(file: Path) -> None:
    """Ids of committed reports are of the form of today, and a report with those of before reads as the same."""
    text = file.read_bytes()
    whole = document.read(text, file.name)
    plain = json.loads(text)

    assert [cell["id"] for cell in plain["cells"]] == [cell.id for cell in whole.cells]
    assert all(LABEL.fullmatch(CellId.parse(cell.id).label) for cell in whole.cells)
    before = {cell.id: cellid.to_old_form(cell) for cell in whole.cells}
    for cell in plain["cells"]:
        cell["id"] = before[cell["id"]]
        cell["base"] = before.get(cell.get("base") or "", cell.get("base"))
        for one in cell["diagnoses"]:
            one["proof"] = before.get(one.get("proof") or "", one.get("proof"))
    assert document.read(json.dumps(plain).encode(), file.name) == whole


def stored(cell_id: str, base: str | None = None) -> CellRecord:
    """Return a record as it may lie in a store."""
    cell = cell_requiring(id=cell_id, matrix="demo", axes=AXES, python="3.9" if base else "3.11", base=base)
    return CellRecord(cell=cell, machine="here", seconds=3.0)


def test_a_record_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    """It is known by its id of today, once; what was measured since goes before it."""
    kept = Store(tmp_path)
    older = cellid.to_old_form(CELL)
    kept.save_cell(stored(older))
    kept.save_cell(stored(f"{older}-with-repair", base=older))
    today = stored(CELL.id).cell

    assert [record.cell.id for record in kept.cells()] == [f"{CELL.id}_with-repair-on-py3.9", CELL.id]
    assert {record.cell.base for record in kept.cells()} == {CELL.id, None}
    found, glance = kept.load_cell("here", today), kept.read_summary("here", today)
    assert (found and found.cell, glance and glance.seconds) == (today, 3.0)

    kept.save_cell(replace(stored(CELL.id), seconds=5.0))
    assert [record.seconds for record in kept.cells() if record.cell == today] == [5.0]


def test_results_of_an_earlier_version_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports that `HARNESS_RESULTS` names and that have older ids speak of the cells of today."""
    whole = json.loads((REPORTS / "quickstart/report.json").read_bytes())
    ids = {cell["id"] for cell in whole["cells"]}
    for cell in whole["cells"]:
        cell["id"] = cellid.to_old_form(Named(cell["id"], cell["axes"]))
    (tmp_path / "report.json").write_text(json.dumps(whole))
    monkeypatch.setattr(result_index, "report_files", list)
    monkeypatch.setenv("HARNESS_RESULTS", str(tmp_path))
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "none"))

    assert {cell.id for cell in result_index.load().cells} == ids
