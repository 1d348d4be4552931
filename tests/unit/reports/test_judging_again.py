"""A report is judged again from the evidence that lies next to it: the same comes of it, or what judging alters."""

from __future__ import annotations

import json
import lzma
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from readings import CASE, DIED, FAILED, GOOD, HERE, Check, lines, passed, plan_case
from specimens import GENERATED, MACHINES, cell, record

from harness.__main__ import main
from harness.judging.runs import case as judging
from harness.judging.runs.fold import Folded, add_run
from harness.judging.runs.todo import todo
from harness.machine.store import Store
from harness.model import CellRecord, Expectation, Plan, Verdict, replace
from harness.model.report_types import Document
from harness.probes.evidence import LOG, REPLY, ProbeRun, RunEnd
from harness.probes.vault import Vault, keep_files
from harness.reports import document, packs, publishing
from harness.running import open_matrix

CRASH = RunEnd(signal=11, seconds=2.0)
RED = Expectation(verdict=Verdict.PARTIAL, reason="known", match="no camera")
PICTURE = b"\x89PNG not really"
ROOT = Path(__file__).parents[3]


def measured(opened: Store, label: str, *failing: Check, expect: Expectation | None = None) -> CellRecord:
    """Return a cell with a case whose checks ended as given; others passed, in as many runs as judging asked for."""
    vault, folded, wanted = Vault(opened.folder), Folded(), plan_case()
    ended = {check.name: check for check in failing}
    picture = vault.keep(PICTURE)
    while request := todo(wanted, folded):
        told: list[Check] = []
        for name in (one for led in request.limits for one in (led, *(f for f in request.followers))):
            told.append(ended.get(name) or passed(name)[0])
            if told[-1].outcome is DIED:
                break
        dead = told[-1].outcome is DIED
        texts = {REPLY: lines(told, last=not dead), LOG: f"{label} was here\n".encode()}
        run = ProbeRun(
            request=request,
            program=dict.fromkeys((*request.limits, *request.followers), "of-today"),
            end=CRASH if dead else GOOD,
            host=HERE,
            files={**keep_files(vault, texts), "render.rgb_array-first.png": picture},
            measured=GENERATED,
        )
        folded = add_run(wanted, folded, vault.reading(vault.put(run, label)))
    case = judging.case_record(CASE, judging.phases(wanted, folded), folded.runs)
    (opened.folder / "locks").mkdir(exist_ok=True)
    (opened.folder / "locks/5f0c.txt").write_text("numpy==2.2.6\n")
    of = cell(label, matrix="packed", cases=(), expect=expect)
    of = replace(of, id=f"packed/{label}", cases=(CASE,))
    return record(case, of=of, lock="locks/5f0c.txt")


def published(folder: Path, opened: Store, *records: CellRecord) -> Document:
    """Write the report of these cells, with its evidence, into a folder; return its document."""
    plan = Plan(matrix="packed", cells=tuple(one.cell for one in records), axes=("python", "gymnasium"))
    locate = publishing.place(records, opened, folder)
    made = document.build(records, [plan], MACHINES, GENERATED, locate)
    publishing.write(made, folder, None)
    publishing.pack(made, plan, records, opened, folder)
    return made


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the folder of a report of three cells, whose state was moved away."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "another"))
    opened = Store(tmp_path / "state")
    dead = Check(name="vector.sync", outcome=DIED)
    blank = Check(name="render.rgb_array", outcome=FAILED, message="no camera")
    published(
        tmp_path / "report",
        opened,
        measured(opened, "py3.11_gymnasium-1.0.0"),
        measured(opened, "py3.11_gymnasium-1.1.0", dead),
        measured(opened, "py3.11_gymnasium-1.2.0", blank, expect=RED),
    )
    (tmp_path / "state").rename(tmp_path / "gone")
    return tmp_path / "report"


def files(folder: Path) -> dict[str, bytes]:
    """Return every file of a report."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_same_comes_of_the_same(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Judging unchanged evidence again alters no report and writes nothing."""
    before = files(folder)

    assert main(["report", "--judge-again", str(folder)]) == 0
    assert capsys.readouterr() == ("", "1 report judged again, none altered\n")
    assert files(folder) == before


def test_all_of_a_report_comes_back_to_the_byte(folder: Path) -> None:
    """All files but frames and locks, which are no texts of a probe, are written again."""
    before = files(folder)
    for name in before:
        if name.startswith("evidence/") or name in {"report.json", "report.md"}:
            (folder / name).unlink()

    assert main(["report", "--judge-again", "--write", str(folder)]) == 0
    assert files(folder) == before
    assert any(name.startswith("evidence/") for name in before)


def test_a_crash_is_judged_again_by_a_later_reading(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each alteration is said, cell by cell; written, the report bears the instant at which it was judged."""
    monkeypatch.setattr(
        "harness.judging.runs.check.describe_death", lambda _code, signal, _stacks: f"signal {signal}, read better"
    )

    assert main(["report", "--judge-again", str(folder)]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said == ["packed/py3.11_gymnasium-1.1.0: decisive: killed by SIGSEGV -> signal 11, read better"]

    assert main(["report", "--judge-again", "--write", str(folder)]) == 0
    again = document.read((folder / "report.json").read_bytes(), "report.json")
    assert again.generated > GENERATED
    index = packs.index(folder)
    assert index
    assert index.judged == again.generated
    assert main(["report", "--judge-again", str(folder)]) == 0


@pytest.fixture
def quickstart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the matrix `quickstart`, beside copies of its report and of all other matrices."""
    shutil.copytree(ROOT / "reports/quickstart", tmp_path / "quickstart")
    shutil.copytree(ROOT / "matrices", tmp_path / "matrices")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(open_matrix, "PACKAGE", tmp_path)
    return tmp_path / "matrices/quickstart.toml"


def test_a_matrix_that_cannot_be_read_is_named(quickstart: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Then the report is judged by what was planned when it was measured."""
    quickstart.write_text("nonsense = 1\n" + quickstart.read_text())

    # The matrix has been reworded since, so the committed report has other words than the plan of that time.
    assert main(["report", "--judge-again", "--write", "quickstart"]) == 0
    assert capsys.readouterr().out == "quickstart: titles, tables or words, and no cell\n"
    assert main(["report", "--judge-again", "quickstart"]) == 0
    assert "quickstart is judged as it was planned, not as its matrix is today: " in capsys.readouterr().err


def test_titles_come_from_the_matrix(quickstart: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A report is brought to what its matrix says today, and it is said that no cell is altered."""
    quickstart.write_text('title = "As of today"\n' + quickstart.read_text())
    report = Path("quickstart")

    assert main(["report", "--judge-again", "--write", "quickstart"]) == 0
    assert capsys.readouterr().out == "quickstart: titles, tables or words, and no cell\n"
    again = document.read((report / "report.json").read_bytes(), "report.json")
    assert again.matrices["quickstart"].title == "As of today"
    assert "As of today" in (report / "report.md").read_text()


@pytest.mark.parametrize("gone", ["index.json", "evidence.tar.xz"])
def test_a_report_without_evidence_cannot_be_judged_again(
    folder: Path, gone: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command says so with its cells, and makes nothing up."""
    (folder / gone).unlink()

    assert main(["report", "--judge-again", str(folder)]) == 3
    assert capsys.readouterr().err.splitlines() == [
        "report: its evidence is missing; not judged again: packed/py3.11_gymnasium-1.0.0, "
        "packed/py3.11_gymnasium-1.1.0, packed/py3.11_gymnasium-1.2.0",
        "0 reports judged again, none altered",
    ]


@pytest.mark.parametrize("damage", ["cut", "changed", "other", "link"])
def test_a_damaged_pack_is_named(folder: Path, damage: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A damaged pack is named, and nothing is written."""
    pack = folder / "evidence.tar.xz"
    content = pack.read_bytes()
    damaged = {
        "cut": content[:-40],
        "changed": content[:100] + bytes([content[100] ^ 1]) + content[101:],
        "other": lzma.compress(b"x" * 3000),
    }
    if damage == "link":
        pack.unlink()
        pack.symlink_to("/etc/hostname")
    else:
        pack.write_bytes(damaged[damage])
    before = files(folder)

    assert main(["report", "--judge-again", "--write", str(folder)]) == 2
    assert "evidence.tar.xz" in capsys.readouterr().err
    assert files(folder) == before


def test_the_document_is_printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With `--json` it alone is on stdout."""
    assert main(["report", "--judge-again", "--json", str(folder)]) == 0
    assert [cell["verdict"] for cell in json.loads(capsys.readouterr().out)["cells"]] == ["works", "partial", "partial"]


@pytest.mark.parametrize(
    "arguments",
    [["report", "--judge-again"], ["report", "--write", "x"], ["report", "--judge-again", "--out", "y", "x"]],
)
def test_arguments_without_a_meaning_are_refused(
    arguments: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--judge-again` is refused without a report or with `--out`, and `--write` without it."""
    assert main(arguments) == 2
    assert "--judge-again" in capsys.readouterr().err


def test_members_that_a_pack_may_hold() -> None:
    """No member lies outside the folders of evidence, whatever an archive says."""
    for name in ("../x", "/etc/passwd", "cas/../../x", "cas/" + "g" * 64, "evidence/../x", "evidence/a/b/c"):
        assert not packs.NAME.fullmatch(name)
    for name in ("cells.json", "cas/" + "0" * 64, "evidence/lock-01ab/uv.log"):
        assert packs.NAME.fullmatch(name)


def test_evidence_of_many_cells_lies_in_several_packs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None is larger than a pack may be, where it has more than one cell."""
    monkeypatch.setattr(packs, "MOST_PACK", 10)
    opened = Store(folder.parent / "many")
    published(folder, opened, measured(opened, "py3.11_gymnasium-1.0.0"), measured(opened, "py3.11_gymnasium-1.1.0"))
    index = packs.index(folder)

    assert index
    assert set(index.packs) == {"evidence.tar.xz", "evidence-2.tar.xz"}
    assert main(["report", "--judge-again", str(folder)]) == 0
