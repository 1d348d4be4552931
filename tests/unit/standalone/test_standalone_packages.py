"""The packages of an interpreter are read from its folders; which interpreter a command runs, from its words."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.standalone import packages


def file(path: Path, text: str = "", mode: int = 0o755) -> Path:
    """Write a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(mode)
    return path


def dist(site: Path, name: str, version: str, kind: str = "dist-info") -> None:
    """Put a distribution into a folder."""
    inner = "METADATA" if kind == "dist-info" else "PKG-INFO"
    file(
        site / f"{name}-{version}.{kind}" / inner,
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n\nName: no\n",
    )


@pytest.fixture
def base(tmp_path: Path) -> Path:
    """Return an interpreter as pyenv installs it, with one package."""
    root = tmp_path / "pyenv" / "versions" / "3.9.18"
    file(root / "bin" / "python3.9")
    (root / "bin" / "python").symlink_to("python3.9")
    dist(root / "lib" / "python3.9" / "site-packages", "Old_Gym", "0.21.0", "egg-info")
    return root


def venv(folder: Path, base: Path, *, shared: str = "false") -> Path:
    """Make an environment from `base`, with another package; return its folder."""
    (folder / "bin").mkdir(parents=True)
    (folder / "bin" / "python").symlink_to(base / "bin" / "python3.9")
    file(folder / "pyvenv.cfg", f"home = {base}/bin\ninclude-system-site-packages = {shared}\nversion_info = 3.9.18\n")
    dist(folder / "lib" / "python3.9" / "site-packages", "numpy", "1.26.4")
    return folder


def packages_of(path: Path, **variables: str) -> packages.Packages:
    """Return the packages of an interpreter."""
    made = packages.of_interpreter(str(path), variables, "/")
    assert made is not None
    return made


def test_an_interpreter_of_its_own(base: Path) -> None:
    """Its packages, old ones of setuptools, too; its whole version by the folder that it lies in."""
    assert packages_of(base / "bin" / "python", HOME="/nowhere")[1:] == ("3.9.18", {"old-gym": "0.21.0"})


def test_an_environment_has_its_own_packages(base: Path, tmp_path: Path) -> None:
    """Those of its base only where it says so; it can be named by its folder."""
    alone, shared = venv(tmp_path / "a", base), venv(tmp_path / "b", base, shared="true")
    assert packages_of(alone / "bin" / "python")[1:] == ("3.9.18", {"numpy": "1.26.4"})
    assert packages_of(alone).python == str(alone / "bin" / "python")
    assert packages_of(shared, HOME="/nowhere").installed == {"numpy": "1.26.4", "old-gym": "0.21.0"}


def test_the_first_package_on_the_path_is_imported(base: Path, tmp_path: Path) -> None:
    """PYTHONPATH goes before the environment, the user's own packages before those of the interpreter."""
    dist(tmp_path / "extra", "numpy", "2.0.0")
    dist(tmp_path / "home" / ".local" / "lib" / "python3.9" / "site-packages", "old-gym", "0.26.2")
    environment = venv(tmp_path / "a", base)
    assert packages_of(environment, PYTHONPATH=str(tmp_path / "extra")).installed == {"numpy": "2.0.0"}
    assert packages_of(base / "bin" / "python", HOME=str(tmp_path / "home")).installed == {"old-gym": "0.26.2"}
    assert packages_of(base / "bin" / "python", HOME=str(tmp_path / "home"), PYTHONNOUSERSITE="1").installed == {
        "old-gym": "0.21.0"
    }


def test_the_version_comes_from_condas_metadata(tmp_path: Path) -> None:
    """The version comes from conda's metadata if no folder is named by it."""
    file(tmp_path / "envs" / "rl" / "bin" / "python3.10")
    (tmp_path / "envs" / "rl" / "bin" / "python").symlink_to("python3.10")
    (tmp_path / "envs" / "rl" / "lib" / "python3.10" / "site-packages").mkdir(parents=True)
    file(tmp_path / "envs" / "rl" / "conda-meta" / "python-3.10.13-h955ad1f_0.json")
    assert packages_of(tmp_path / "envs" / "rl" / "bin" / "python", HOME="/nowhere").version == "3.10.13"


def test_a_package_with_broken_metadata_is_named_by_its_folder(base: Path, tmp_path: Path) -> None:
    """A package without readable metadata is known by the name of its folder, or passed over."""
    site = venv(tmp_path / "a", base) / "lib" / "python3.9" / "site-packages"
    (site / "gym-0.26.2.dist-info").mkdir()
    (site / "~ip-1.dist-info").mkdir()
    (site / "odd.dist-info").mkdir()
    installed = packages_of(tmp_path / "a").installed
    assert (installed["gym"], installed["numpy"], "odd" in installed) == ("0.26.2", "1.26.4", False)


@pytest.mark.parametrize(
    "command",
    [
        ["{env}/bin/python", "train.py"],
        ["python", "-m", "train"],
        ["timeout", "10", "python", "train.py"],
        ["env", "A=1", "{env}/bin/python"],
        ["train"],
        ["{env}/bin/train", "--fast"],
        ["long"],
        ["shimmed"],
    ],
    ids=" ".join,
)
def test_the_interpreter_of_a_command(base: Path, tmp_path: Path, command: list[str]) -> None:
    """Named, found on PATH, behind wrappers, in the first line of a script."""
    environment = venv(tmp_path / "env", base)
    python = environment / "bin" / "python"
    file(environment / "bin" / "train", f"#!{python}\nprint()\n")
    file(environment / "bin" / "long", f"#!/bin/sh\n'''exec' \"{python}\" \"$0\" \"$@\"\n' '''\nprint()\n")
    file(environment / "bin" / "shimmed", "#!/usr/bin/env python\n")
    file(tmp_path / "usr" / "timeout", "\x7fELF")
    file(tmp_path / "usr" / "env", "\x7fELF")
    variables = {"PATH": f"{environment}/bin:{tmp_path}/usr"}
    made = packages.of_command([word.format(env=environment) for word in command], variables, "/")
    assert made is not None
    assert made.installed == {"numpy": "1.26.4"}


def test_a_shim_of_pyenv_is_seen_through(base: Path, tmp_path: Path) -> None:
    """A shim stands for the Python it would start: by the variable, the folder's file, or the global file."""
    root = base.parents[1]
    file(root / "shims" / "python", "#!/usr/bin/env bash\n")
    file(root / "version", "3.9.18\n")
    variables = {"PATH": str(root / "shims"), "HOME": "/nowhere"}
    made = packages.of_command(["python"], variables, str(tmp_path))
    assert made is not None
    assert made.version == "3.9.18"
    none = packages.of_command(["python"], {**variables, "PYENV_VERSION": "3.1"}, str(tmp_path))
    assert none is not None
    assert none.installed == {}


@pytest.mark.parametrize("command", [["make", "all"], ["bash", "train.sh"], ["/nowhere/python"], []])
def test_a_command_of_no_python_has_no_packages(command: list[str], tmp_path: Path) -> None:
    """Nothing is guessed."""
    file(tmp_path / "make", "\x7fELF")
    file(tmp_path / "bash", "\x7fELF")
    assert packages.of_command(command, {"PATH": str(tmp_path)}, str(tmp_path)) is None
