"""Test which environment `doctor` inspects."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.standalone.doctor.environment_choice import NoEnvironment, choose_environment


def environment(folder: Path) -> Path:
    """Return an environment's folder, with a Python that nobody starts."""
    python = folder / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\n")
    python.chmod(0o755)
    return folder


def test_the_order(tmp_path: Path) -> None:
    """--python, then $VIRTUAL_ENV, $CONDA_PREFIX, ./.venv and PATH; what named it is said."""
    places = {name: environment(tmp_path / name) for name in ("asked", "venv", "conda", ".venv", "path")}
    variables = {
        "VIRTUAL_ENV": str(places["venv"]),
        "CONDA_PREFIX": str(places["conda"]),
        "PATH": str(places["path"] / "bin"),
    }
    told = []
    for gone in (None, "VIRTUAL_ENV", "CONDA_PREFIX"):
        variables.pop(gone or "", None)
        told.append(choose_environment(None, variables, str(tmp_path)))
    there = choose_environment(None, variables, str(tmp_path / "asked"))

    assert [Path(one.python).parts[-3] for one in told] == ["venv", "conda", ".venv"]
    assert [one.why for one in told] == ["named by $VIRTUAL_ENV", "named by $CONDA_PREFIX", "named by ./.venv"]
    assert (Path(there.python).parts[-3], there.why) == ("path", "`python` on PATH; no environment is active")
    assert choose_environment("asked", variables, str(tmp_path)).python == str(places["asked"] / "bin" / "python")
    assert told[0].remarks == [f"`python` starts another one here: {places['path']}/bin/python"]


def test_an_environment_that_is_gone(tmp_path: Path) -> None:
    """It is passed over, and that is said."""
    environment(tmp_path / ".venv")

    found = choose_environment(None, {"VIRTUAL_ENV": "/gone", "PATH": "/none"}, str(tmp_path))

    assert (found.why, found.remarks) == ("named by ./.venv", ["$VIRTUAL_ENV is passed over: no Python lies in /gone"])


def test_nothing_to_look_at(tmp_path: Path) -> None:
    """Each refusal says what to do."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text").write_text("")
    dangling = tmp_path / "moved" / "bin" / "python"
    dangling.parent.mkdir(parents=True)
    dangling.symlink_to("/usr/local/python-that-was")

    def refused(text: str | None) -> str:
        with pytest.raises(NoEnvironment) as refusal:
            choose_environment(text, {"PATH": "/none"}, str(tmp_path))
        return str(refusal.value).replace(str(tmp_path), "")

    hint = "name an interpreter or the folder of an environment with --python PATH"
    assert refused("empty") == f"--python empty: that folder holds no Python; {hint}"
    assert refused("text") == f"--python text: this file cannot be run; {hint}"
    assert refused("gone") == f"--python gone: there is no such file or folder; {hint}"
    assert refused("moved") == (
        "--python moved: its Python was /usr/local/python-that-was, which is gone; create the environment again"
    )
    assert refused(None) == (
        f"there is no Python here: no environment is active, there is no ./.venv, and PATH has no Python; {hint}"
    )


def test_the_environment_that_runs_the_file(tmp_path: Path) -> None:
    """`/env/bin/python FILE doctor` means /env, whatever shell it is typed in; --python still names another."""
    active, other = environment(tmp_path / "active"), environment(tmp_path / "other")
    variables = {"VIRTUAL_ENV": str(active), "PATH": "/none"}

    found = choose_environment(None, variables, str(tmp_path), "/env/bin/python")

    assert (found.python, found.why) == ("/env/bin/python", "it runs this file")
    assert choose_environment(str(other), variables, str(tmp_path), "/env/bin/python").why == "named by --python"
