"""`simmatrix recommend` on a fresh machine: an empty store, and what was measured before it shipped."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from packaging.version import Version

from harness.__main__ import main
from harness.commands.recommend import Recommended
from harness.schema import json_schema

REPORTS = Path(__file__).parents[2] / "reports"


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, no store."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HARNESS_RESULTS", raising=False)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    """Exit code and document."""
    code = main(["recommend", *arguments, "--json"])
    document = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, json_schema(Recommended))
    return code, document


def test_what_was_measured_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """robosuite with gymnasium, rendering, on Python 3.11: measured cells, each with the lock that its report has."""
    code, document = told(capsys, "robosuite", "gymnasium", "--python", "3.11", "--needs", "render", "--limit", "9")

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
    """`--lock-out` writes the newest combination that an index has, and says for which Python it is."""
    code = main(["recommend", "gym<0.22", "numpy", "--python", "3.9", "--limit", "1", "--lock-out", "lock.txt"])

    said = capsys.readouterr()
    text = (fresh / "lock.txt").read_text()
    assert code == 0
    assert (REPORTS / "gym-classic" / "locks" / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.txt").is_file()
    assert "gym==0.21.0" not in text, "0.21.0 works as it was repaired, and no index has it so"
    assert "repaired  gym 0.21.0: no index has it so" in said.out
    assert said.err.startswith("lock: lock.txt: gym 0.1")


def test_every_line_of_a_combination(capsys: pytest.CaptureFixture[str]) -> None:
    """Where and when it was measured, what passed, what to set, what to type next."""
    main(["recommend", "gym==0.26.2", "--python", "3.10", "--limit", "1"])

    said = capsys.readouterr().out
    for line in (
        "measured and found good",
        "gym 0.26.2",
        "  Python    3.10.",
        "  passed    import, single, vector, render",
        "  tried     CartPole-v1",
        "  set       SDL_VIDEODRIVER=dummy",
        "  measured  20",
        "  cell      gym-classic/",
        "sha256",
        "measured, and does not work",
        "known as numpy2-bool8-gym-checker",
        "next",
        "--lock-out requirements.txt",
    ):
        assert line in said


def test_unknown_says_what_would_measure_it(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing known: 1, the nearest name, and the command that finds out."""
    code = main(["recommend", "gymnasiun", "--python", "3.11", "--env", "Ant-v5"])

    said = capsys.readouterr().out
    assert code == 1
    assert 'gymnasiun: nothing was measured with it; did you mean "gymnasium"?' in said
    assert said.endswith("next\n  simmatrix try gymnasiun --python 3.11 --env Ant-v5\n")


def test_what_is_near_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing for this Python: what there is for others; and nothing of it counts as an answer."""
    code, document = told(capsys, "gym==0.26.2", "--python", "3.99")

    assert (code, document["measured"], document["found"]) == (1, [], 0)
    assert document["nearby"]["where"] == "on other Pythons than 3.99"
    assert document["nearby"]["combinations"][0]["versions"] == {"gym": "0.26.2"}


def test_inferred_is_no_answer(capsys: pytest.CaptureFixture[str]) -> None:
    """What only follows is marked as inferred with what it follows from, and the exit code is 1."""
    cells = {cell["id"]: cell for cell in json.loads((REPORTS / "gymnasium-mujoco/report.json").read_text())["cells"]}

    code, document = told(capsys, "gymnasium==1.2.3", "mujoco==3.3.5", "--python", "3.11")

    assert (code, document["measured"]) == (1, [])
    (one,) = document["inferred"]
    low, high = (Version(cells[name]["installed"]["mujoco"]) for name in one["from_cells"])
    assert low < Version("3.3.5") < high
    main(["recommend", "gymnasium==1.2.3", "mujoco==3.3.5", "--python", "3.11"])
    assert "\ninferred, not measured: gymnasium 1.2.3, mujoco 3.3.5 on Python 3.11" in capsys.readouterr().out


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
    """Refused with what was wrong, and 2."""
    assert main(["recommend", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"simmatrix: {message}")


def test_no_phase_of_this_name(capsys: pytest.CaptureFixture[str]) -> None:
    """`--needs` lists what it knows."""
    with pytest.raises(SystemExit, match="2"):
        main(["recommend", "gym", "--needs", "rendering"])
    assert "'rendering' is none of import, single, vector, render, interop" in capsys.readouterr().err
