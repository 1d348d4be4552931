"""`simmatrix-doctor.pyz`: one file, any Python from 3.7, the standard library alone, the same answers as the host's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import msgspec
import pytest

from harness.commands import explain as verb
from harness.machine import interpreters
from harness.reports import doctor_pyz
from harness.reports.answers import result_index
from harness.running.signatures import shipped_signatures
from harness.standalone.explain import api_history, explain, explain_text, log_excerpt

SUPPORTED = ("3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14")
BOUND = 8_000_000
TRACE = 'Traceback (most recent call last):\n  File "/e/lib/python3.10/site-packages/gym/core.py", line 5, in step\n'
LOGS = {
    "bool8": TRACE + "AttributeError: module 'numpy' has no attribute 'bool8'. Did you mean: 'bool'?\n",
    "worker": f"Process Worker-1:\n{TRACE}ValueError: no wings\n{TRACE}EOFError\n",
    "unknown": TRACE + "ValueError: no wings\n",
    "windows": "\x1b[31m" + (TRACE + "KeyError: 'x'\n").replace("\n", "\r\n"),
    "pip": "ERROR: Could not find a version that satisfies the requirement gym==9 (from versions: 1)\n",
    "well": "Episode 1: reward 2\nÄpfel ✓\n",
}


@pytest.fixture(scope="module")
def pyz(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the single file, in a folder that nobody can write to."""
    folder = tmp_path_factory.mktemp("alone")
    doctor_pyz.write(folder / "simmatrix-doctor.pyz")
    folder.chmod(0o555)
    return folder / "simmatrix-doctor.pyz"


@pytest.fixture
def python(request: pytest.FixtureRequest) -> str:
    """Return an interpreter of a version."""
    found = interpreters.find(request.param)
    if found is None:
        pytest.skip(f"unavailable: python{request.param}")
    return str(found.path)


def run(python: str, pyz: Path, *arguments: str, given: bytes = b"", cwd: Path) -> subprocess.CompletedProcess[bytes]:
    """Run the file with nothing of this machine's user, and no site-packages."""
    return subprocess.run(
        [python, "-I", "-S", "-W", "error", str(pyz), *arguments],
        input=given,
        capture_output=True,
        cwd=cwd,
        env={"PATH": os.defpath, "HOME": str(cwd), "LC_ALL": "C"},
        timeout=120,
        check=False,
    )


@pytest.fixture(scope="module")
def answers() -> dict[str, tuple[int, dict[str, object]]]:
    """Return the host's exit code and answer for each log, using only the data that is shipped with it."""
    measured = msgspec.to_builtins(result_index.load_shipped())
    known, here = verb.signatures(), explain_text.Facts(measured=measured, history=api_history.load_shipped)
    made = {name: explain_text.explain_text(text, known, here) for name, text in LOGS.items()}
    return {name: (0 if one.cause else explain.UNKNOWN, one.plain()) for name, one in made.items()}


@pytest.mark.parametrize("python", SUPPORTED, indirect=True)
def test_every_python_gives_the_answers_of_the_host(request, python: str, pyz: Path, answers, tmp_path: Path) -> None:
    """In JSON, word for word; and nothing is written anywhere."""
    ends = request.node.callspec.params["python"] in {SUPPORTED[0], SUPPORTED[-2]}
    for name, text in LOGS.items() if ends else list(LOGS.items())[:2]:
        done = run(python, pyz, "explain", "--json", "-", given=text.encode(), cwd=tmp_path)
        assert done.stderr == b"", name
        assert (done.returncode, json.loads(done.stdout)) == answers[name], name
    assert list(tmp_path.iterdir()) == []
    assert [path.name for path in pyz.parent.iterdir()] == [pyz.name]


@pytest.mark.parametrize("python", SUPPORTED, indirect=True)
def test_every_python_runs_a_command_and_looks_at_itself(python: str, pyz: Path, tmp_path: Path) -> None:
    """The command's code, its output, the explanation; and `doctor` on the same interpreter."""
    code = "import sys; print('out'); raise ValueError('no wings')"
    done = run(python, pyz, "explain", "--", python, "-c", code, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, b"out\n")
    told = done.stderr.decode()
    assert "failed:    ValueError: no wings" in told
    assert f"next:      python simmatrix-doctor.pyz doctor --python {python}" in told
    Path(told.rpartition("output:")[2].strip()).unlink()

    looked = run(python, pyz, "doctor", "--json", "--python", python, cwd=tmp_path)
    assert looked.returncode in {0, 1}, looked.stderr
    assert json.loads(looked.stdout)["environment"]["python"] == python


def test_doctor_looks_at_the_environment_that_runs_it(pyz: Path, tmp_path: Path) -> None:
    """`env/bin/python FILE doctor` is about env, though none is active and PATH has another Python."""
    venv.create(tmp_path / "env", with_pip=False)
    python = str(tmp_path / "env" / "bin" / "python")

    done = subprocess.run(
        [python, str(pyz), "doctor", "--json"],
        capture_output=True,
        cwd=tmp_path,
        env={"PATH": os.defpath},
        timeout=120,
        check=True,
    )

    looked = json.loads(done.stdout)["environment"]
    assert (looked["python"], looked["why"]) == (python, "it runs this file")


def test_people_get_the_answer_in_words(pyz: Path, tmp_path: Path) -> None:
    """Cause, remedy, reference, what to type next; whatever characters the terminal knows."""
    done = run(sys.executable, pyz, "explain", given=LOGS["bool8"].encode(), cwd=tmp_path)
    words = [line.partition(":")[0] for line in done.stdout.decode("ascii").splitlines()]
    assert {"failed", "cause", "remedy", "reference", "known as", "next"} <= set(words)


def test_a_pasted_line_needs_no_file(pyz: Path, tmp_path: Path) -> None:
    """An error in place of the file is explained; a short file name is still a file."""
    line = LOGS["bool8"].splitlines()[-1]
    done = run(sys.executable, pyz, "explain", line, cwd=tmp_path)
    piped = run(sys.executable, pyz, "explain", given=line.encode(), cwd=tmp_path)

    assert ": " in line
    assert (done.returncode, done.stdout) == (0, piped.stdout)


@pytest.mark.parametrize(
    ("given", "is_pasted"),
    [
        ("No module named 'packaging'", True),
        ("Segmentation fault (core dumped)", True),
        ("no.log", False),
        ("my train log.txt", False),
        ("logs of/last run.log", False),
    ],
)
def test_an_error_is_no_name_of_a_file(given: str, is_pasted: bool) -> None:
    """Three words and no suffix are an error, even without the name of an exception."""
    assert bool(explain.PASTED.search(given)) is is_pasted


def test_bad_input_is_refused_in_one_line(pyz: Path, tmp_path: Path) -> None:
    """Bad input gives one line on stderr and exit code 2."""
    done = run(sys.executable, pyz, "explain", "no.log", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (
        2,
        b"python simmatrix-doctor.pyz: explain: no.log: cannot be read: No such file or directory\n",
    )
    assert run(sys.executable, pyz, "heal", cwd=tmp_path).returncode == 2


def test_equal_contents_make_an_equal_file(pyz: Path) -> None:
    """Byte for byte, small, and without a path of this machine."""
    made = doctor_pyz.content(shipped_signatures.load_all(), result_index.load_shipped())
    assert made == pyz.read_bytes()
    assert len(made) < BOUND
    with zipfile.ZipFile(pyz) as archive:
        texts = b"".join(archive.read(name) for name in archive.namelist() if not name.endswith(".gz"))
    assert str(Path.home()).encode() + b"/" not in texts
    assert str(Path(doctor_pyz.__file__).parents[2]).encode() not in texts


def test_it_can_be_started_by_its_name(pyz: Path, tmp_path: Path) -> None:
    """It has a first line for that."""
    assert os.access(pyz, os.X_OK)
    assert pyz.read_bytes().startswith(doctor_pyz.SHEBANG)


def test_a_python_that_is_too_old_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a traceback, before anything else is read; what says so has no syntax newer than Python 3.0."""
    monkeypatch.setattr(sys, "version_info", (3, 6, 15))
    with pytest.raises(SystemExit, match=r"^simmatrix-doctor: needs Python 3\.7 or newer, this is 3\.6$"):
        exec(compile(doctor_pyz.START, "__main__.py", "exec"))


def test_texts_are_decoded_alike() -> None:
    """Bytes decode to the text that the host explains here."""
    assert {name: log_excerpt.decode(text.encode()) for name, text in LOGS.items()} == LOGS
