"""The six cells as nox sessions, one for each way of checking."""

import nox

nox.options.default_venv_backend = "uv"
PYTHONS = ["3.10", "3.11", "3.12"]
GYMNASIUM = ["0.29.1", "1.2.3"]


@nox.session(python=PYTHONS)
@nox.parametrize("gymnasium", GYMNASIUM)
def plain(session: nox.Session, gymnasium: str) -> None:
    """Run the files of our probes as scripts."""
    session.install(f"gymnasium[classic-control]=={gymnasium}")
    for asked in ("checks", "repeat"):
        session.run("python", "-s", "incell/bootstrap.py", f"requests/{session.python}-{gymnasium}/{asked}.json")


@nox.session(python=PYTHONS)
@nox.parametrize("gymnasium", GYMNASIUM)
def tested(session: nox.Session, gymnasium: str) -> None:
    """Run the check files inside pytest."""
    session.install(f"gymnasium[classic-control]=={gymnasium}", "pytest")
    session.run("pytest", "-q", "checks")
