"""`simmatrix recommend` on a fresh machine: an empty store, and what was measured before it shipped."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from packaging.version import Version

from harness.__main__ import main
from harness.model.schema import json_schema
from harness.reports.answers.recommended import Recommended

REPORTS = Path(__file__).parents[3] / "reports"


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder without a store; measured results are distilled once for all tests of this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("HARNESS_RESULTS", raising=False)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    return tmp_path


def recommend(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    """Return exit code and document of `recommend`."""
    code = main(["recommend", *arguments, "--json"])
    document = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, json_schema(Recommended))
    return code, document


def test_measured_cells_are_listed_with_their_locks(capsys: pytest.CaptureFixture[str]) -> None:
    """robosuite with gymnasium, rendering, on Python 3.11: measured cells, each with the lock that its report has."""
    code, document = recommend(
        capsys, "robosuite", "gymnasium", "--python", "3.11", "--needs", "render", "--limit", "9"
    )

    assert code == 0
    assert len(document["measured"]) == document["found"] > 1
    assert document["inferred"] == []
    versions = [[Version(text) for text in one["versions"].values()] for one in document["measured"]]
    assert versions == sorted(versions, reverse=True)
    for one in document["measured"]:
        matrix = one["cell"].partition("/")[0]
        report = json.loads((REPORTS / matrix / "report.json").read_text())
        cell = next(cell for cell in report["cells"] if cell["id"] == one["cell"])
        assert (cell["verdict"], cell["phases"]["render"], cell["python"]) == ("works", "passed", one["python"])
        assert cell["installed"] | one["versions"] == cell["installed"]
        assert hashlib.sha256(one["lock"].encode()).hexdigest() == cell["lock_sha256"]


def test_no_store_is_made(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """Asking leaves nothing behind."""
    main(["recommend", "gymnasium"])

    assert list(fresh.iterdir()) == []


def test_the_lock_is_written(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """`--lock-out` writes the lock of the first combination; its header says which cell, Python and day it is of."""
    code = main(["recommend", "gym<0.22", "numpy", "--python", "3.9", "--limit", "1", "--lock-out", "lock.txt"])

    said = capsys.readouterr()
    header, _, text = (fresh / "lock.txt").read_text().partition("uv pip sync --require-hashes lock.txt\n")
    first = said.out.splitlines()[0]
    assert code == 0
    assert (REPORTS / "gym-classic" / "locks" / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.txt").is_file()
    assert "gym==0.21.0" not in text + first, "0.21.0 works with a patched wheel, and no index has it so"
    assert header.startswith("# simmatrix: gym-classic/py3.9_gym-0.1")
    assert "\n# Python 3.9." in header
    assert "measured 20" in header
    assert said.err.endswith("install: uv venv --python 3.9 && uv pip sync --require-hashes lock.txt\n")


def test_the_answer_comes_first(capsys: pytest.CaptureFixture[str]) -> None:
    """A line to paste; then what passed, where, the cell; at most three traps with ids; what to type next."""
    main(["recommend", "gym==0.26.2", "--python", "3.10"])

    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("'gym[classic_control]==0.26.2' ")
    assert "  # Python 3.10, SDL_VIDEODRIVER=dummy" in said[0]
    assert said[1].startswith("  passed import, single, vector, render in ")
    assert said[2].startswith("  measured 20")
    assert any(line.startswith("  simmatrix show gym-classic/py3.10_gym-0.26.2") for line in said)
    assert "    simmatrix known numpy2-bool8-gym-checker" in said
    assert 0 < sum(line.startswith("    simmatrix show ") for line in said) <= 3
    assert said[-2:] == ["next", "  simmatrix recommend gym==0.26.2 --python 3.10 --lock-out requirements.txt"]


@pytest.mark.parametrize("width", [60, 80, 140])
def test_lines_fit_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    """Sentences are wrapped at spaces; a line that somebody pastes stays whole."""
    monkeypatch.setenv("COLUMNS", str(width))
    main(["recommend", "robosuite"])

    said = capsys.readouterr().out.splitlines()
    pasted = [line for line in said if "# Python" in line or line.lstrip().startswith("simmatrix")]
    assert len(pasted) < len(said)
    assert all(len(line) <= width for line in said if line not in pasted)


@pytest.mark.parametrize("name", ["pettingzoo", "rsl-rl-lib", "pandas"])
def test_a_package_that_never_ran_is_never_good(capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Packages that only lay in locks of the shipped results."""
    assert main(["recommend", name]) == 1

    assert capsys.readouterr().out.startswith(f"{name} was installed with other packages, never run: ")


def test_never_measured_together_is_an_answer(capsys: pytest.CaptureFixture[str]) -> None:
    """Each half as it was measured, and a command with versions that exist."""
    code, document = recommend(capsys, "robosuite", "torch")
    main(["recommend", "robosuite", "torch"])

    said = capsys.readouterr().out.splitlines()
    assert (code, document["measured"], len(document["apart"]["halves"])) == (1, [], 2)
    assert said[0] == "never measured together: robosuite, torch"
    assert said[1].startswith("  robosuite alone works: robosuite==")
    assert said[-1].startswith("  simmatrix try robosuite==")
    assert " torch==" in said[-1]


def test_a_release_in_part_says_what_works(capsys: pytest.CaptureFixture[str]) -> None:
    """If one of two tasks works, both are listed, rather than nothing."""
    main(["recommend", "metaworld==3.1.1"])

    said = capsys.readouterr().out
    assert "  works: reach-v3\n  fails: reach-v3-seeded: " in said


def test_unknown_says_what_would_measure_it(capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown package, without the index, gives exit code 1, the nearest name, and the command that measures it."""
    code = main(["recommend", "gymnasiun", "--python", "3.11", "--env", "Ant-v5", "--offline"])

    said = capsys.readouterr()
    assert (code, said.err) == (1, "note: the package index could not be asked whether this exists: gymnasiun\n")
    assert 'gymnasiun: nothing was measured with it; did you mean "gymnasium"?' in said.out
    assert said.out.endswith("next\n  simmatrix try gymnasiun --python 3.11 --env Ant-v5\n")


def test_results_of_other_pythons_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """If nothing was measured on this Python, results of other Pythons are shown, but do not count as an answer."""
    code, document = recommend(capsys, "gym==0.26.2", "--python", "3.99")

    assert (code, document["measured"], document["found"]) == (1, [], 0)
    assert document["nearby"]["where"] == "on other Pythons than 3.99"
    assert document["nearby"]["combinations"][0]["versions"] == {"gym": "0.26.2"}


def test_inferred_is_no_answer(capsys: pytest.CaptureFixture[str]) -> None:
    """An inferred combination is marked as such, with the cells it follows from, and the exit code is 1."""
    cells = {cell["id"]: cell for cell in json.loads((REPORTS / "robosuite/report.json").read_text())["cells"]}

    code, document = recommend(capsys, "gymnasium==1.0.0", "mujoco==3.6.0", "--python", "3.11", "--offline")

    assert (code, document["measured"]) == (1, [])
    (one,) = document["inferred"]
    low, high = (Version(cells[name]["installed"]["mujoco"]) for name in one["from_cells"])
    assert low < Version("3.6.0") < high
    main(["recommend", "gymnasium==1.0.0", "mujoco==3.6.0", "--python", "3.11", "--offline"])
    assert "inferred, not measured: gymnasium 1.0.0, mujoco 3.6.0 on Python 3.11" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a b"], 'recommend: "a b" is not a requirement: '),
        (["gym", "gym>1"], 'recommend: "gym" is asked for twice; write `gym>=1,<2`'),
        (["gym", "--python", "three"], 'recommend: --python "three" is no version such as 3.11'),
        (["gym; extra == 'a'"], "recommend: \"gym; extra == 'a'\" has a marker; name a package, or `name>=version`"),
    ],
)
def test_bad_input(capsys: pytest.CaptureFixture[str], arguments: list[str], message: str) -> None:
    """Bad input is refused with the mistake, and exit code 2."""
    assert main(["recommend", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"simmatrix: {message}")


def test_no_phase_of_this_name(capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown phase is refused, and `--needs` lists the valid ones."""
    with pytest.raises(SystemExit, match="2"):
        main(["recommend", "gym", "--needs", "rendering"])
    assert "'rendering' is none of import, single, vector, render, interop" in capsys.readouterr().err
