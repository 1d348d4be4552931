"""`simmatrix recommend` on a fresh machine: an empty store, and what was measured before it shipped."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
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
    assert [*REPORTS.glob(f"*/locks/{hashlib.sha256(text.encode()).hexdigest()[:16]}.txt")]
    assert "gym==0.21.0" not in text + first, "0.21.0 works with a patched wheel, and no index has it so"
    assert re.match(r"# simmatrix: (gym-classic|typed-gym)/py3\.9_gym-?0\.1", header)
    assert "\n# Python 3.9." in header
    assert "measured 20" in header
    assert said.err.endswith("install: uv venv --python 3.9 && uv pip sync --require-hashes lock.txt\n")


def test_the_answer_comes_first(capsys: pytest.CaptureFixture[str]) -> None:
    """A command to paste; what was weighed, when it was measured, the cell; traps with ids; what is left out."""
    main(["recommend", "gym==0.26.2", "--python", "3.10"])

    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("pip install 'gym[classic_control]==0.26.2' numpy==1.")
    assert said[0].endswith("  # Python 3.10, SDL_VIDEODRIVER=dummy")
    assert said[1] == "why"
    assert " work on Python 3.10: 2 tasks passed import, single, vector, render" in " ".join("".join(said[2:4]).split())
    assert any(line.startswith("  measured 20") for line in said)
    assert any(line.strip().startswith("simmatrix show gym-classic/py3.10_gym-0.26.2") for line in said)
    assert "traps" in said
    assert 0 < len(re.findall("simmatrix known ", "\n".join(said))) <= 3
    assert re.fullmatch(r"and (\d+ other combinations? that works? and )?\d+ more traps: --all", said[-1])


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


def rows(line: str, width: int = 80) -> int:
    """Return the rows of a terminal that a line takes."""
    return max(-(-len(line) // width), 1)


@pytest.mark.parametrize(
    "asked",
    [
        ["gymnasium", "mujoco", "--python", "3.12"],
        ["gymnasium", "mujoco"],
        ["robosuite", "torch"],
        ["gymnasium", "mujoco", "stable-baselines3"],
        ["robosuite", "gymnasium"],
        ["metaworld==3.1.1"],
        ["gym==0.26.2"],
        ["gym==0.21.0"],
        ["numpy"],
        ["isaaclab"],
        ["ale-py", "--offline"],
        ["gymnasium", "--env", "LunarLander-v3"],
        ["gymnasium==1.0.0", "mujoco==3.6.0", "--python", "3.11", "--offline"],
    ],
    ids=" ".join,
)
def test_the_answer_fits_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, asked: list[str]
) -> None:
    """24 lines of 80 columns: a command, at most three reasons, at most three traps of three lines."""
    monkeypatch.setenv("COLUMNS", "80")
    code = main(["recommend", *asked])

    said = capsys.readouterr().out.splitlines()
    assert sum(map(rows, said)) <= 24
    assert said[0].startswith(("pip install ", "simmatrix try ", "simmatrix recommend "))
    assert "  # " in said[0]
    assert code == (1 if said[0].startswith("simmatrix try ") or "tasks work" in said[0] else 0)
    places = [said.index(name) if name in said else len(said) for name in ("why", "traps")]
    reasons = [line for line in said[places[0] + 1 : places[1]] if re.match(" {2}[^ ]", line)]
    traps = [line for line in said[places[1] + 1 :] if re.match(" {2}[^ ]", line)]
    assert 0 <= len(reasons) <= 3
    assert len(traps) <= 3
    assert reasons or traps


def test_the_weighing_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """The number that work, the tasks, and how each release behaves against the one before it."""
    _, document = recommend(capsys, "gymnasium", "mujoco", "--python", "3.12")
    report = json.loads((REPORTS / "drift-mujoco" / "report.json").read_text())
    cells = {cell["id"]: cell for cell in report["cells"]}

    weighed, first = document["weighed"], document["measured"][0]
    assert (weighed["works"], weighed["newer"]) == (document["found"], {})
    assert weighed["tasks"] == len(first["environments"]) > 1
    (mujoco,) = (one for one in weighed["behaves"] if one["package"] == "mujoco")
    cases = {case["case"]: case["behaviour"] for case in cells[mujoco["cell"]]["cases"] if case.get("behaviour")}
    before = {one["reference"] for one in cases.values()} - {None}
    assert (mujoco["version"], mujoco["tasks"]) == (first["versions"]["mujoco"], len(cases))
    letters = {
        case["case"]: case["behaviour"]["family"]
        for name in before
        for case in cells[name]["cases"]
        if case.get("behaviour")
    }
    assert mujoco["same"] == sum(bool({*one["family"]} & {*letters[name]} - {*"'?"}) for name, one in cases.items())
    assert 0 < mujoco["same"] < mujoco["tasks"]


@pytest.mark.parametrize("name", ["tensorstore"])
def test_a_package_that_never_ran_is_never_good(capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Packages that only lay in locks of the shipped results."""
    assert main(["recommend", name]) == 1

    said = capsys.readouterr().out
    assert said.startswith(f"simmatrix try {name}  # never measured\nwhy\n")
    assert f"\n  {name} was installed with other packages, never run: " in said


@pytest.mark.parametrize(
    "names",
    [
        ["pettingzoo", "supersuit", "stable-baselines3"],
        ["gymnasium", "minigrid", "sb3-contrib"],
        ["gymnasium", "mujoco", "tianshou"],
        ["gymnasium", "minari", "mujoco"],
    ],
)
def test_sets_of_a_laboratory_are_measured(capsys: pytest.CaptureFixture[str], names: list[str]) -> None:
    """A learner or a bridge that a check ran counts, though no environment is of it."""
    code, document = recommend(capsys, *names)

    assert code == 0
    assert {*names} <= {*document["measured"][0]["versions"]}


def test_never_measured_together_is_an_answer(capsys: pytest.CaptureFixture[str]) -> None:
    """Each half as it was measured, and a command with versions that exist."""
    code, document = recommend(capsys, "robosuite", "brax")
    main(["recommend", "robosuite", "brax"])

    said = capsys.readouterr().out.splitlines()
    assert (code, document["measured"], len(document["apart"]["halves"])) == (1, [], 2)
    assert said[0].startswith("simmatrix try robosuite==")
    assert " brax==" in said[0]
    assert said[0].endswith("  # never measured together")
    assert said[2].startswith("  robosuite alone works: robosuite==")
    assert any(line.startswith("  brax alone works: brax==") for line in said)


def test_a_release_in_part_says_what_works(capsys: pytest.CaptureFixture[str]) -> None:
    """If one of two tasks works, both are listed, rather than nothing."""
    main(["recommend", "shimmy==0.2.1"])

    said = capsys.readouterr().out
    assert said.startswith("pip install shimmy==0.2.1 ")
    assert "; 1 of 2 tasks work\nwhy\n  works: ALE-Tetris-v5; " in said
    assert "\ntraps\n  fails: shimmy-Pong-v5: " in said


def test_unknown_says_what_would_measure_it(capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown package, without the index, gives exit code 1, the nearest name, and the command that measures it."""
    code = main(["recommend", "gymnasiun", "--python", "3.11", "--env", "Ant-v5", "--offline"])

    said = capsys.readouterr()
    assert (code, said.err) == (1, "note: the package index could not be asked whether this exists: gymnasiun\n")
    assert 'gymnasiun: nothing was measured with it; did you mean "gymnasium"?' in said.out
    assert said.out.startswith("simmatrix try gymnasiun --python 3.11 --env Ant-v5  # never measured\n")


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
    assert "\n  inferred, not measured: gymnasium 1.0.0, mujoco 3.6.0 on Python 3.11" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("conda", lambda text: yaml.safe_load(text)["dependencies"][0] == "python=3.11"),
        ("pyproject", lambda text: tomllib.loads(text)["project"]["requires-python"] == "==3.11.*"),
        ("dockerfile", lambda text: "\nFROM python:3.11-slim-bookworm\n" in text),
    ],
)
def test_a_file_is_all_of_stdout(capsys: pytest.CaptureFixture[str], name: str, read: Callable[[str], bool]) -> None:
    """A file of a tool stands alone on stdout, with cell, Python, day and variables in its head."""
    assert main(["recommend", "gymnasium", "mujoco", "--python", "3.11", "--format", name]) == 0

    said = capsys.readouterr().out
    assert read(said)
    assert re.match(
        r"# simmatrix: [\w-]+/py3.11_\S+\n# Python 3\.11\.7, measured 20\S+ on linux\S+\n# set: MUJOCO_GL=", said
    )


def test_no_file_without_an_answer(capsys: pytest.CaptureFixture[str]) -> None:
    """Stdout stays empty if nothing works: the answer in words goes to stderr."""
    assert main(["recommend", "robosuite", "brax", "--format", "conda"]) == 1

    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("simmatrix try robosuite==")


def test_a_patched_wheel_needs_its_lock(capsys: pytest.CaptureFixture[str]) -> None:
    """No file installs a wheel that no index has; `--lock-out` is named."""
    assert main(["recommend", "gym==0.21.0", "--format", "conda"]) == 2
    assert "no index has gym 0.21.0 as it was measured; --lock-out FILE" in capsys.readouterr().err


def test_every_combination_and_trap_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """`--all` adds every combination with its cells, every trap, and what to type for the lock."""
    _, document = recommend(capsys, "robosuite", "--limit", "99")
    main(["recommend", "robosuite", "--all"])

    said = capsys.readouterr().out
    cells = {cell for one in (*document["measured"], *document["red"]) for cell in one["cells"]}
    assert document["found"] == len(document["measured"])
    assert all(f"simmatrix show {cell}\n" in said for cell in cells)
    assert said.endswith("next\n  simmatrix recommend robosuite --lock-out requirements.txt\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a b"], 'recommend: "a b" is not a requirement: '),
        (["gym", "gym>1"], 'recommend: "gym" is named twice; write `gym>=1,<2`'),
        (["gym", "--python", "three"], 'recommend: --python "three" is not a version; write one such as 3.11'),
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
    assert "unknown phase 'rendering'; choose from import, single, vector, render, interop" in capsys.readouterr().err
