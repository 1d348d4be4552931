"""The verb `merge`: where it finds reports, what it copies, what it never touches, what it exits with."""

import json
import shutil
from pathlib import Path

import pytest
from builders import GENERATED, HERE, MACHINES, case
from specimens import quick, quick_record

from harness.__main__ import main
from harness.model import CellRecord, Phase, replace
from harness.reports import document

PLAN, RECORDS = quick()


def write(folder: Path, *records: CellRecord, machine: str = HERE) -> Path:
    """Write the folder that `run --out` leaves: a report of these cells, and the files that it names; return it."""
    made = document.build(records, [PLAN], {machine: MACHINES[HERE]}, GENERATED)
    for name in sorted(document.paths(made)):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{name} on {machine}\n" if name.startswith("evidence") else "numpy==2.2.6\n")
    folder.mkdir(exist_ok=True)
    (folder / "report.json").write_bytes(document.encode(made))
    return folder


@pytest.fixture
def shards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of downloads: `shard-1` ran the first three cells, `shard-2` the next two, nobody the rest."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / ".harness"))
    (tmp_path / "shards").mkdir()
    write(tmp_path / "shards/shard-1", *RECORDS[:3])
    write(tmp_path / "shards/shard-2/report", *RECORDS[3:5])
    return tmp_path / "shards"


def test_shards_become_one_report(shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A summary on stdout, its folder last; page, document and files in it; what is missing is told."""
    assert main(["merge", "shards"]) == 1

    said = capsys.readouterr()

    assert said.out.splitlines()[-1] == "report: .harness/merged"
    assert said.err == "2 reports merged: 8 cells, 3 not run\n"
    made = document.read(Path(".harness/merged/report.json").read_bytes(), "r")
    assert [cell.id for cell in made.cells] == [cell.id for cell in PLAN.cells]
    assert all((Path(".harness/merged") / name).is_file() for name in document.paths(made))
    page = Path(".harness/merged/report.md").read_text()
    assert page.startswith("# quick: what works together\n\n**2 of 8 combinations work. ")
    assert len(said.out.splitlines()) < len(PLAN.cells) + 12  # not the whole report


def test_order_and_repetition_change_nothing(shards: Path) -> None:
    """The same folder named twice, in another order, or merged before: the same files, byte for byte."""

    def files(folder: str) -> dict[str, bytes]:
        found = (path for path in Path(folder).rglob("*") if path.is_file())
        return {str(path.relative_to(folder)): path.read_bytes() for path in found}

    main(["merge", "shards", "--out", "one"])
    main(["merge", "shards/shard-2", "shards/shard-1/report.json", "shards", "--out", "two"])
    main(["merge", "shards/shard-1", "--out", "three"])
    main(["merge", "three", "shards/shard-2", "--out", "three"])

    assert len(files("one")) == 4
    assert files("one") == files("two") == files("three")


def test_machines_keep_their_files(shards: Path) -> None:
    """Files of one name and two contents are both kept, and each result names its own."""
    write(shards / "other", *(replace(one, machine="z") for one in RECORDS[:1]), machine="z")

    main(["merge", "shards", "--out", "out"])

    made = document.read(Path("out/report.json").read_bytes(), "r")
    logs = {cell.machine: Path("out", cell.evidence or "").read_text() for cell in made.cells[:2]}
    assert logs == {HERE: f"evidence/install/log.txt on {HERE}\n", "z": "evidence/install/log.txt on z\n"}


def test_the_document_alone_is_on_stdout(shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--format md` prints the page, `--json` the document with paths from here; nothing else is on stdout."""
    main(["merge", "shards", "--format", "md"])
    assert capsys.readouterr().out == Path(".harness/merged/report.md").read_text()

    main(["merge", "shards", "--json", "--out", "out"])
    said = capsys.readouterr()
    cell = json.loads(said.out)["cells"][0]
    assert (cell["lock"], Path(cell["evidence"]).is_file()) == ("out/locks/5f0c.txt", True)
    assert said.err.splitlines()[-1] == "report: out"


@pytest.mark.parametrize(
    ("index", "kinds", "code"),
    [
        (0, None, 0),
        (1, None, 0),
        (2, None, 1),
        (2, "stale", 0),
        (5, None, 0),
        (5, "unexpected,stale,unavailable", 1),
        (None, None, 0),
        (None, "not_run", 1),
        ("inconclusive", None, 3),
        ("inconclusive", "inconclusive", 1),
        ("stale", None, 1),
        ("stale", "unexpected", 0),
        ("both", None, 1),
    ],
)
def test_exit_codes(shards: Path, index: int | str | None, kinds: str | None, code: int) -> None:
    """Every kind of `--fail-on`: 1 where it is named and met, 3 for inconclusive where it is not, else 0."""
    infra = quick_record(PLAN.cells[0], case("pppi"))
    better = quick_record(PLAN.cells[1], case("pppp"))
    chosen = {
        None: (),
        "inconclusive": (infra,),
        "stale": (better,),
        "both": (infra, RECORDS[2]),
    }.get(index if not isinstance(index, int) else "", (RECORDS[index],) if isinstance(index, int) else ())
    write(Path("one"), *chosen)
    if index == "stale":  # that a cell does better is also not as expected
        made = json.loads(Path("one/report.json").read_text())
        made["cells"][1]["as_expected"] = None
        Path("one/report.json").write_text(json.dumps(made))

    assert main(["merge", "one", *(["--fail-on", kinds] if kinds else [])]) == code
    assert main(["report", "one", *(["--fail-on", kinds] if kinds else [])]) == code


class TestHostileReports:
    """A report may come from anybody's pull request."""

    @pytest.mark.parametrize(
        "path",
        ["../secret.txt", "/etc/passwd", "evidence/../../secret.txt", "report.json", ".git/hooks/post-merge",
         "locks", "", "locks/link.txt", "locks/linked/secret.txt", "locks/" + "x" * 5000, "locks/\0"],
    )  # fmt: skip
    def test_nothing_outside_its_folder_is_read_or_written(
        self, shards: Path, capsys: pytest.CaptureFixture[str], path: str
    ) -> None:
        """A path that leads out, by itself or by a link, is left out of the merged report."""
        Path("secret.txt").write_text("secret")
        folder = shards / "shard-1"
        (folder / "locks/link.txt").symlink_to(Path("secret.txt").absolute())
        (folder / "locks/linked").symlink_to(Path().absolute())
        made = json.loads((folder / "report.json").read_text())
        made["cells"][0]["lock"] = path
        (folder / "report.json").write_text(json.dumps(made))
        before = {str(found) for found in Path().rglob("*")}

        main(["merge", "shards", "--out", "out/merged"])

        merged = document.read(Path("out/merged/report.json").read_bytes(), "r")
        assert merged.cells[0].lock is None
        assert {str(found) for found in Path().rglob("*") if not str(found).startswith("out")} == before
        assert not [found for found in Path("out").rglob("*") if found.is_file() and found.read_text() == "secret"]
        if path:
            assert "1 file that the reports name are missing" in capsys.readouterr().err

    def test_nothing_outside_is_swept(self, shards: Path) -> None:
        """Files that an older report in the target names are removed, but none elsewhere, nor the target itself."""
        Path("secret.txt").write_text("secret")
        main(["merge", "shards", "--out", "out"])
        Path("out/mine.txt").write_text("mine")
        made = json.loads(Path("out/report.json").read_text())
        made["cells"][0]["lock"] = str(Path("secret.txt").absolute())
        made["cells"][0]["evidence"] = "../secret.txt"
        made["cells"][0]["cases"][0]["frames"] = ["", "."]
        Path("out/report.json").write_text(json.dumps(made))

        main(["merge", "shards", "--out", "out"])

        assert (Path("secret.txt").read_text(), Path("out/mine.txt").read_text()) == ("secret", "mine")

    def test_a_link_in_the_target_is_not_followed(self, shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Nothing is written through a link that lies where files are to go."""
        Path("elsewhere").mkdir()
        Path("out").mkdir()
        Path("out/locks").symlink_to(Path("elsewhere").absolute())

        assert main(["merge", "shards", "--out", "out"]) == 2
        assert not list(Path("elsewhere").iterdir())
        assert capsys.readouterr().err == (
            "simmatrix: out/locks/5f0c.txt leads out of out; name another folder with --out\n"
        )


class TestBadInput:
    def test_no_report(self, shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A place without a report is named."""
        (shards / "empty").mkdir()

        for place in ("shards/empty", "nowhere"):
            assert main(["merge", "shards", place]) == 2
            assert capsys.readouterr().err == (
                f"simmatrix: {place}: no report.json in this folder or below it;"
                " `simmatrix run MATRIX --out DIR` writes one\n"
            )

    def test_broken_report(self, shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A report that was cut off is named; nothing is written."""
        path = shards / "shard-1/report.json"
        path.write_text(path.read_text()[:200])

        assert main(["merge", "shards", "--out", "out"]) == 2
        assert capsys.readouterr().err.startswith("simmatrix: shards/shard-1/report.json: ")
        assert not Path("out").exists()

    def test_other_matrix(self, shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Reports of two states of a matrix are refused by the names of their files."""
        path = shards / "shard-1/report.json"
        path.write_text(path.read_text().replace("gymnasium==1.2.3", "gymnasium==1.2.2"))

        assert main(["merge", "shards"]) == 2
        assert capsys.readouterr().err == (
            "simmatrix: shards/shard-2/report/report.json: made of another state of the matrix than"
            " shards/shard-1/report.json: the requirements of quick/py3.9_gymnasium-0.29.1_mujoco-2.3.7 differ;"
            " measure again what was measured before, with one state of it\n"
        )


def test_a_report_merged_before_counts_only_where_it_is_named(shards: Path) -> None:
    """Into a folder of its own shards it can be written again, without what it said the last time."""
    main(["merge", "shards", "--out", "shards/merged"])
    shutil.rmtree(shards / "shard-2")
    main(["merge", "shards", "--out", "shards/merged"])

    made = document.read((shards / "merged/report.json").read_bytes(), "r")
    assert sum(cell.phases[Phase.RESOLVE] == "passed" for cell in made.cells) == 3
