"""`nox` lints and tests, `nox -t quickstart` measures a matrix, `nox -s endurance` runs the full counts."""

from __future__ import annotations

import sys

import nox

try:
    from harness import noxface
except Exception as missing:  # nox was installed apart, or this tree is half edited: lint and tests run all the same
    print(f"simmatrix cannot be imported ({missing}): uvx --with-editable . nox", file=sys.stderr)
else:
    noxface.cells("quickstart")

nox.options.default_venv_backend = "uv"
nox.options.sessions = ["lint", "tests"]
nox.options.error_on_missing_interpreters = True


@nox.session(python="3.11")
def lint(session: nox.Session) -> None:
    """Ruff with size rules, mypy strict."""
    session.install("-e", ".[dev]")
    session.run("ruff", "check")
    session.run("ruff", "format", "--check")
    session.run("mypy")


@nox.session(python="3.11")
def tests(session: nox.Session) -> None:
    """The whole test suite, samples of the long counts."""
    session.install("-e", ".[dev]")
    session.run("pytest", *(session.posargs or ["-n", "2"]))


@nox.session(python="3.11")
def endurance(session: nox.Session) -> None:
    """A hundred thousand mutated inputs; combinations measured by hand, with their table; every adapter."""
    session.install("-e", ".[dev]")
    session.run("python", "tests/fuzzing/endurance.py")
    session.run("python", "tests/real/agreement.py")
    session.run("pytest", "tests/real/test_adapters.py", "tests/real/test_devices.py", env={"ENDURANCE": "1"})


@nox.session(python="3.11")
def controls(session: nox.Session) -> None:
    """Every control of `matrices/controls/` for real; `-- --lock ID` makes a lock again."""
    session.install("-e", ".[dev]")
    session.run("python", "tests/real/controls.py", *session.posargs)


@nox.session(python="3.11")
def history(session: nox.Session) -> None:
    """What the releases of `matrices/history/packages.toml` offer; new ones are read; `-- NAME` for one package."""
    session.install("-e", ".[dev]")
    session.run("python", "-m", "harness.history.making", *session.posargs)


@nox.session(python="3.11")
def newest(session: nox.Session) -> None:
    """Newest releases together: what is broken today, whose bound holds what back; `-- NAME` for one package."""
    session.install("-e", ".[dev]")
    session.run("python", "-m", "benchmarks.newest", *session.posargs)


@nox.session(python="3.11")
def costs(session: nox.Session) -> None:
    """What the harness itself costs, compared with the entries in `benchmarks/costs.jsonl`; a new one is added."""
    session.install("-e", ".[dev]")
    session.run("python", "-m", "benchmarks.costs", *session.posargs)


@nox.session(python="3.11")
def report(session: nox.Session) -> None:
    """Tables of what was measured here."""
    session.install("-e", ".")
    session.run("simmatrix", "report", *session.posargs)


@nox.session(python="3.11")
def site(session: nox.Session) -> None:
    """The static site of all committed reports, `dist/site`."""
    session.install("-e", ".")
    session.run("simmatrix", "site", "--out", "dist/site", *session.posargs)


@nox.session(python="3.11")
def pyz(session: nox.Session) -> None:
    """`explain` and `doctor` as one file for any Python, `dist/simmatrix-doctor.pyz`."""
    session.install("-e", ".")
    session.run("python", "-m", "harness", "doctor", "--standalone", "dist/simmatrix-doctor.pyz")


@nox.session(python="3.11")
def docs(session: nox.Session) -> None:
    """The site of `docs/` in `dist/docs/`; every command of README and documents is run; `-- PAGE` for one."""
    session.install("-e", ".[docs]")
    session.run("python", "docs/making/record_terminal.py", "dist/terminal.svg")
    session.run("mkdocs", "build", "--strict", "--site-dir", "dist/docs", env={"NO_MKDOCS_2_WARNING": "1"})
    session.run("python", "docs/making/run_examples.py", *session.posargs)


@nox.session(python="3.11")
def release(session: nox.Session) -> None:
    """Wheel and sdist in `dist/release`: built twice, checked, installed as users do; nothing is signed or sent."""
    session.install("build", "twine", "pipx", "uv")
    session.run("python", "tests/real/release.py", "dist/release")
