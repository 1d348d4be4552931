"""Give pytest a few options and two fixtures, wherever simmatrix is installed.

Nothing of the harness is imported before `--matrix` is given.
"""

from __future__ import annotations

import argparse
from collections.abc import Generator
from typing import Any

import pytest

from harness.smoke import SUITE

NEEDED = "needs a matrix: pytest --matrix NAME (a matrix file, or the name of a built-in one)"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the suite."""
    group = parser.getgroup("simmatrix", "simmatrix: which versions work together")
    group.addoption(
        "--matrix",
        action="append",
        default=[],
        metavar="MATRIX",
        help="A matrix file, or the name of a built-in matrix; may be repeated. Its combinations are the tests of\n"
        f"`--pyargs {SUITE}`, and the values of the fixtures `cell` and `env`.",
    )
    group.addoption(
        "--matrix-jobs",
        type=_count,
        default=1,
        metavar="N",
        help="Measure N combinations at a time, ahead of their tests (default: 1); of no use with -n",
    )
    group.addoption("--matrix-fresh", action="store_true", help="Ignore earlier results; locks are kept")
    group.addoption("--matrix-offline", action="store_true", help="Use the caches only, never the network")
    group.addoption(
        "--matrix-verify",
        action="store_true",
        help="Run each check in a process of its own, repeat failures, compare installed files with their hashes",
    )
    group.addoption(
        "--matrix-out", metavar="DIR", help="Write the reports to this folder (default: .harness/reports/MATRIX)"
    )


def _count(text: str) -> int:
    """Return a number of at least 1. Raises ArgumentTypeError for any other text."""
    if not text.isdecimal() or not int(text):
        message = f"{text!r} is not a number of at least 1"
        raise argparse.ArgumentTypeError(message)
    return int(text)


@pytest.hookimpl(wrapper=True)
def pytest_cmdline_main(config: pytest.Config) -> Generator[None, Any, Any]:
    """Set `--dist loadgroup` for `-n` without `--dist`, so that cells with one environment go to one worker."""
    # The order matters: without xdist there is no option `dist`, and asking for it would be an error.
    if config.getoption("matrix") and config.getoption("numprocesses", None) and config.getoption("dist") == "no":
        config.option.dist = "loadgroup"
    return (yield)


@pytest.hookimpl(tryfirst=True, optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Return the number of workers for `-n auto`: one per core, but no more than fit into the free memory."""
    if not config.getoption("matrix"):
        # None leaves the number to xdist: this session does not use the harness.
        return None
    from harness.machine import capacity  # noqa: PLC0415 - loaded by every pytest there is
    from harness.running.scheduler.cost_history import UNKNOWN_MB  # noqa: PLC0415

    free, cores = capacity.free_mb(), capacity.default_jobs()
    return cores if free is None else max(1, min(cores, free // UNKNOWN_MB))


def pytest_configure(config: pytest.Config) -> None:
    """Register the suite if a matrix is named. Raises UsageError if the suite is asked for without one."""
    if config.getoption("matrix"):
        from harness.smoke.face import Face  # noqa: PLC0415 - loaded by every pytest there is

        config.pluginmanager.register(Face(config), "simmatrix-face")
    elif config.getoption("pyargs") and any(argument.partition("::")[0] == SUITE for argument in config.args):
        message = f"{SUITE} {NEEDED}"
        raise pytest.UsageError(message)


@pytest.fixture(scope="session")
def cell(request: pytest.FixtureRequest) -> Any:
    """Return each cell of the matrices in --matrix, installed: `cell.run("import gymnasium")` runs in its Python."""
    if not hasattr(request, "param"):
        pytest.skip(f"the fixture `cell` {NEEDED}")
    from harness.smoke.tried import prepare_cell  # noqa: PLC0415 - loaded by every pytest there is

    return prepare_cell(request.config, request.param)


@pytest.fixture(scope="session")
def env(request: pytest.FixtureRequest, cell: Any) -> Any:
    """Return each case of the cell: `env.env` is an environment id, `env.api` its API, `env.kwargs` its arguments."""
    return request.param
