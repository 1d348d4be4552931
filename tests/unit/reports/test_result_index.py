"""The measured results at hand: those that come with us, other people's, and our own, in layers."""

from pathlib import Path

import pytest
from builders import HERE, MACHINES
from specimens import quick, quick_document

from harness.machine.store import Store
from harness.model import Verdict, replace
from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.reports import document
from harness.reports.answers import digest, result_index

LOCK = f"numpy==2.2.6 \\\n    --hash=sha256:{'1' * 64}\n"


@pytest.fixture
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder for a package without reports and without a store."""
    monkeypatch.setattr(result_index, "PACKAGE", tmp_path / "nowhere" / "harness")
    monkeypatch.setattr(result_index, "PACKED", tmp_path / "packed.json.gz")
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.delenv(result_index.VARIABLE, raising=False)
    return tmp_path


def put(folder: Path) -> Path:
    """Write a report folder with a lock; return it."""
    (folder / "locks").mkdir(parents=True)
    (folder / "locks" / "5f0c.txt").write_text(LOCK)
    (folder / "report.json").write_bytes(document.encode(quick_document()))
    return folder


def works(found: Measured) -> list[str]:
    """Return the ids of the cells that work."""
    return [cell.id for cell in found.cells if cell.verdict is Verdict.WORKS]


def test_a_checkout_reads_its_reports() -> None:
    """The results of this checkout's reports are there, with a lock for every cell that works, in under 2 MB."""
    found = result_index.load_shipped()

    assert len({cell.matrix for cell in found.cells}) > 10
    assert len(works(found)) > 200
    assert all(cell.lock in found.locks for cell in found.cells if cell.verdict is Verdict.WORKS)
    assert len(digest.pack(found)) < 2_000_000


def test_nothing_is_known_and_no_store_is_made(alone: Path) -> None:
    """Without any results there are none, and asking leaves no folder behind."""
    assert result_index.load().cells == ()
    assert not (alone / "state").exists()


def test_a_wheel_reads_its_file(alone: Path) -> None:
    """The packed file is what comes with us; nothing beside the package is read."""
    put(alone / "nowhere" / "reports" / "quick")
    (alone / "packed.json.gz").write_bytes(digest.pack(digest.combine([])))

    assert result_index.load_shipped().cells == ()


@pytest.mark.parametrize("depth", [".", ".."], ids=["a report", "a folder of reports"])
def test_results_of_others_are_put_upon_them(alone: Path, monkeypatch: pytest.MonkeyPatch, depth: str) -> None:
    """HARNESS_RESULTS names folders of reports, or folders that hold such folders."""
    monkeypatch.setenv(result_index.VARIABLE, f"{put(alone / 'others' / 'quick') / depth}:")

    found = result_index.load()

    assert works(found)
    assert [*found.locks.values()] == [(("numpy", "2.2.6"),)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "{}: has no report.json, nor has a folder in it; HARNESS_RESULTS names folders of reports"),
        ("[", "{}/report.json: line 1, column 2: expecting value"),
        ("{}", '{}/report.json: the key "generated" is missing'),
        ("3", "{}/report.json: expected a table, got an integer"),
    ],
)
def test_a_folder_without_a_report_is_refused(
    alone: Path, monkeypatch: pytest.MonkeyPatch, content: str | None, message: str
) -> None:
    """A variable that names something else says so, with the file."""
    if content is not None:
        (alone / "report.json").write_text(content)
    monkeypatch.setenv(result_index.VARIABLE, str(alone))

    with pytest.raises(BadInput) as refused:
        result_index.load()

    assert str(refused.value).startswith(message.format(alone))


def test_results_of_this_store_lie_on_top(alone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cell that was measured here again is told as it stands here; a cell measured elsewhere alone stays."""
    monkeypatch.setenv(result_index.VARIABLE, str(put(alone / "others")))
    before = {cell.id: cell for cell in result_index.load().cells}
    opened = Store(alone / "state")
    record = next(one for one in quick()[1] if one.cell.id in works(result_index.load()))
    opened.save_machine(HERE, MACHINES[HERE])

    opened.save_cell(replace(record, lock=None, measured="2027-01-01T00:00:00Z"))

    after = {cell.id: cell for cell in result_index.load().cells}

    assert after.keys() == before.keys()
    changed = [name for name in after if after[name] != before[name]]
    assert changed == [record.cell.id]
    assert after[record.cell.id].measured == "2027-01-01T00:00:00Z"
