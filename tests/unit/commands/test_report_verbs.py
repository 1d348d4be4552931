"""The verbs that only read what was stored: report, show, schema."""

import json
from pathlib import Path

import jsonschema
import pytest
from builders import GENERATED, MACHINES
from specimens import quick

from harness.__main__ import main
from harness.machine.store import Store
from harness.model import replace
from harness.model.vocabulary import APIS
from harness.reports import document

IDS = [planned.id for planned in quick()[0].cells]
RED = "quick/py3.11_gymnasium-1.2.3_mujoco-2.3.7"


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a state folder, below the working folder, in which `quick` was run, with its report."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / ".harness"))
    store = Store(tmp_path / ".harness")
    plan, records = quick()
    for made in records:
        store.save_cell(made)
    folder = store.folder / "reports" / "quick"
    (folder / "locks").mkdir(parents=True)
    (folder / "locks/5f0c.txt").write_text("numpy==2.2.6\n")
    log = store.folder / "evidence/install/log.txt"
    log.parent.mkdir(parents=True)
    log.write_text("".join(f"line {number}\n" for number in range(40)))
    whole = document.build(
        records, [plan], MACHINES, GENERATED, lambda path: path if path.startswith("locks") else f"../../{path}"
    )
    (folder / "report.json").write_bytes(document.encode(whole))
    return store.folder


class TestReport:
    def test_terminal(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Without arguments: the table of every matrix that was run here, and exit code 1 for unexpected reds."""
        assert main(["report"]) == 1
        assert "py3.11_gymnasium-1.2.3_mujoco-3.3.7" in capsys.readouterr().out

    def test_same_bytes_wherever_it_is_made(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """By name, by folder, by file, on stdout or into a folder, and from that folder again: the same page."""
        source = state / "reports/quick"
        pages = set()
        for name in ("quick", str(source), str(source / "report.json")):
            main(["report", name, "--format", "md"])
            pages.add(capsys.readouterr().out)
        main(["report", "quick", "--out", "copy"])
        main(["report", "copy", "--out", "copy/again", "--format", "md"])

        pages |= {Path("copy/report.md").read_text(), Path("copy/again/report.md").read_text()}

        assert len(pages) == 1
        assert Path("copy/locks/5f0c.txt").read_text() == "numpy==2.2.6\n"

    def test_paths_follow_the_document(self, state: Path) -> None:
        """In a copy the evidence is still found, from the copy's folder."""
        main(["report", "quick", "--out", "elsewhere/copy"])

        (made,) = (
            cell for cell in document.read(Path("elsewhere/copy/report.json").read_bytes(), "r").cells if cell.id == RED
        )

        assert made.evidence
        assert (Path("elsewhere/copy") / made.evidence).resolve() == state / "evidence/install/log.txt"

    def test_json(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """With --json stdout is one document, its paths seen from the working folder."""
        main(["report", "quick", "--json"])

        made = json.loads(capsys.readouterr().out)

        assert [cell["id"] for cell in made["cells"]] == IDS
        assert made["cells"][0]["lock"] == ".harness/reports/quick/locks/5f0c.txt"
        assert Path(made["cells"][0]["evidence"]).is_file()

    def test_two_sources(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Several sources are one report; the same cells are not told twice."""
        main(["report", "quick", "--out", "copy"])
        capsys.readouterr()

        main(["report", "quick", "copy", "--json"])

        assert [cell["id"] for cell in json.loads(capsys.readouterr().out)["cells"]] == IDS

    @pytest.mark.usefixtures("state")
    def test_of_a_matrix_file(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """The file that was run stands for its name, as in every other verb."""
        (tmp_path / "quick.toml").touch()
        main(["report", str(tmp_path / "quick.toml"), "--json"])
        assert [cell["id"] for cell in json.loads(capsys.readouterr().out)["cells"]] == IDS

    def test_fail_on(self, state: Path) -> None:
        """A verdict that says nothing fails only where it is named."""
        source = state / "reports/quick/report.json"
        made = json.loads(source.read_text())
        made["cells"] = [cell for cell in made["cells"] if cell["as_expected"] is not False]
        source.write_text(json.dumps(made))

        assert main(["report", "quick"]) == 0
        assert main(["report", "quick", "--fail-on", "unavailable"]) == 1

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (
                ["quik"],
                "simmatrix: quik: no report.json here, and no matrix of this name was measured; did you "
                'mean "quick"?\n',
            ),
            (
                ["matrices/quik.toml"],
                "simmatrix: quik: no report.json here, and no matrix of this name was measured; did you "
                'mean "quick"?\n',
            ),
            (
                ["quick", "--pivot", "python", "mujico"],
                "simmatrix: --pivot python mujico: takes two axes of one matrix; known here: gymnasium, mujoco,"
                " python\n",
            ),
        ],
    )
    def test_bad_input(
        self, state: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
    ) -> None:
        """A missing name is reported together with the names that exist; the exit code is 2."""
        assert main(["report", *arguments]) == 2
        assert capsys.readouterr() == ("", message)

    def test_nothing_run_yet(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """If nothing was run, the message names the first command to type."""
        monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "empty"))

        assert main(["report"]) == 2
        assert capsys.readouterr().err == (
            "simmatrix: nothing was measured here yet; run `simmatrix run quickstart`, or name a report.json\n"
        )


class TestShow:
    def test_everything_of_a_cell(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Verdict, reason, what hid it, versions, checks, the end of the log, the lock, and what to type next."""
        assert main(["show", RED]) == 0

        lines = capsys.readouterr().out.splitlines()

        assert lines[:3] == [
            RED,
            "◐ partial in vector",
            "  ValueError: XML Error: bad | worse / Element 'default', line 0",
        ]
        for line in (
            "python     3.11.7",
            "lock       .harness/locks/5f0c.txt",
            "  vector     failed",
            "  mujoco==2.3.7",
            "evidence   .harness/evidence/install/log.txt",
            "  | line 39",
            "  simmatrix run quick.toml -k py3.11_gymnasium-1.2.3_mujoco-2.3.7 --fresh",
        ):
            assert line in lines
        assert "  | line 24" not in lines
        assert any(
            line.endswith("hid behind ConnectionResetError: [Errno 104] Connection reset by peer") for line in lines
        )

    def test_by_glob(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A glob that matches one cell names it, as does its label."""
        main(["show", "*mujoco1.50"])
        main(["show", "py3.11_gymnasium-0.29.1_mujoco-1.50"])

        first, second = capsys.readouterr().out.split("quick/py3.11_gymnasium-0.29.1_mujoco-1.50\n")[1:]
        assert first == second

    def test_json(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """With --json the cell is printed as a report document."""
        main(["show", RED, "--json"])

        (cell,) = json.loads(capsys.readouterr().out)["cells"]

        assert (cell["id"], cell["verdict"]) == (RED, "partial")

    def test_trial(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Of a cell that `try` made the next command is that trial, in full."""
        _, records = quick()
        tried = replace(records[0].cell, id="try/py3.9", matrix="try", environment={"MUJOCO_GL": "egl"})
        Store(state).save_cell(replace(records[0], cell=tried))

        main(["show", "try/py3.9"])

        assert capsys.readouterr().out.splitlines()[-1] == (
            "  simmatrix try gymnasium==1.2.3 --python 3.9 --env Ant-v5 --set MUJOCO_GL=egl --fresh"
        )

    @pytest.mark.parametrize(
        ("pattern", "message"),
        [
            (
                "*mujoco2.3.7",
                "simmatrix: show *mujoco2.3.7: matches 2 combinations; name one of"
                " quick/py3.11_gymnasium-1.2.3_mujoco-2.3.7, quick/py3.9_gymnasium-0.29.1_mujoco-2.3.7\n",
            ),
            (
                "quick/py3.11_gymnasium-1.2.3_mujoco-2.3.8",
                "simmatrix: show quick/py3.11_gymnasium-1.2.3_mujoco-2.3.8: no combination of this name was measured;"
                " did you mean quick/py3.11_gymnasium-1.2.3_mujoco-2.3.7?\n",
            ),
        ],
    )
    def test_bad_input(self, state: Path, capsys: pytest.CaptureFixture[str], pattern: str, message: str) -> None:
        """A name for several cells, or for none, is refused with names that there are."""
        assert main(["show", pattern]) == 2
        assert capsys.readouterr() == ("", message)


class TestSchema:
    def test_names(self, capsys: pytest.CaptureFixture[str]) -> None:
        """Without a name the documents are listed."""
        assert main(["schema"]) == 0
        names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
        assert names == [
            "matrix",
            "expansion",
            "overlay",
            "controls",
            "signatures",
            "report",
            "plan",
            "lock",
            "gc",
            "init",
            "bisect",
            "doctor",
            "explain",
            "compare",
            "freeze",
            "recommend",
            "check",
            "checks",
            "upgrade",
            "known",
            "site",
            "repair",
            "manifest",
        ]

    def test_report_fits_its_schema(self, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A report that was written is valid by the schema; one with a wrong verdict is not."""
        main(["schema", "report"])
        validator = jsonschema.Draft202012Validator(json.loads(capsys.readouterr().out))
        made = json.loads((state / "reports/quick/report.json").read_bytes())

        assert validator.is_valid(made)
        made["cells"][0]["verdict"] = "fine"
        assert not validator.is_valid(made)

    def test_all_are_schemas(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Every schema is a valid one, also those written to a file, and the adapters are listed in the matrix's."""
        main(["schema", "--json"])
        every = json.loads(capsys.readouterr().out)
        for name, made in every.items():
            jsonschema.Draft202012Validator.check_schema(made)
            main(["schema", name, "--out", str(tmp_path / name)])
            assert json.loads((tmp_path / name).read_text()) == made
        assert every["matrix"]["$defs"]["CaseTable"]["properties"]["api"]["anyOf"][0]["enum"] == list(APIS)

    def test_unknown_name(self, capsys: pytest.CaptureFixture[str]) -> None:
        """An unknown document is refused with the nearest name."""
        assert main(["schema", "reprot"]) == 2
        assert capsys.readouterr().err == ('simmatrix: schema reprot: unknown document; did you mean "report"?\n')
