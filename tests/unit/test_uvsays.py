# ruff: noqa: E501, RUF001  (lines as uv printed them)
"""Failures of uv, told apart. Every text was printed by uv (0.13.9; the last one by an older release)."""

import pytest

from harness import uvsays
from harness.errors import BadInput
from harness.model import Outcome, Phase

NO_SOLUTION = """\
error: No solution found when resolving dependencies
  cause: Because gymnasium==1.2.3 depends on numpy>=1.21.0 and you require gymnasium==1.2.3, we can conclude that you require numpy>=1.21.0.
         And because you require numpy<1.20, we can conclude that your requirements are unsatisfiable.
"""
PYTHON = """\
error: No solution found when resolving dependencies
  cause: Because the current Python version (3.8.18) does not satisfy Python>=3.10 and gymnasium==1.4.0 depends on Python>=3.10, we can conclude that gymnasium==1.4.0 cannot be used.
         And because only gymnasium<=1.4.0 is available and you require gymnasium==1.4.0, we can conclude that your requirements are unsatisfiable.
"""
LOGIN = """\
error: No solution found when resolving dependencies
  cause: Because foo was not found in the package registry and you require foo, we can conclude that your requirements are unsatisfiable.

hint: An index URL (http://127.0.0.1:9104/simple) could not be queried due to a lack of valid authentication credentials (401 Unauthorized)
"""
OFFLINE = """\
error: No solution found when resolving dependencies
  cause: Because foo was not found in the cache and you require foo, we can conclude that your requirements are unsatisfiable.

hint: Packages were unavailable because the network was disabled. When the network is disabled, registry packages may only be read from the cache.
"""
SERVER = """\
error: Request failed after 3 retries in 6.6s
  cause: Failed to fetch: http://127.0.0.1:9100/simple/foo/
  cause: HTTP status server error (500 Internal Server Error) for url (http://127.0.0.1:9100/simple/foo/)
"""
SETUPTOOLS = """\
error: Failed to build `gym==0.21.0`
  cause: The build backend returned an error
  cause: Call to `setuptools.build_meta:__legacy__.get_requires_for_build_wheel` failed (exit status: 1)

         [stderr]
         setuptools/_distutils/dist.py:287: UserWarning: Unknown distribution option: 'tests_require'
           warnings.warn(msg)
         error in gym setup command: 'extras_require' must be a dictionary whose values are strings or lists of strings containing valid project/version requirement specifiers.

hint: Build failures usually indicate a problem with the package or the build environment
"""
FETCHING_BACKEND = """\
error: Failed to build `x==1`
  cause: The build backend returned an error
  cause: Call to `setuptools.build_meta.build_wheel` failed (exit status: 1)

         [stdout]
         Failed to fetch: the optional extension
         [stderr]
         Traceback (most recent call last):
           File "<string>", line 14, in <module>
         RuntimeError: MUJOCO_PATH environment variable is not set
"""
BACKEND_OFFLINE = FETCHING_BACKEND.replace(
    "RuntimeError: MUJOCO_PATH environment variable is not set",
    "wheel_stub.error.InstallFailedError: [Errno -2] Name or service not known",
)
BUILD_REQUIREMENTS = """\
error: Failed to download and build `gym==0.21.0`
  cause: Failed to resolve requirements from `setup.py` build
  cause: No solution found when resolving: `setuptools>=40.8.0`
  cause: Because you require setuptools>=40.8.0 and setuptools==1.0.0.99, we can conclude that your requirements are unsatisfiable.
"""
METADATA = """\
error: No solution found when resolving dependencies
  cause: Because gym==0.21.0 has invalid metadata and you require gym==0.21.0, we can conclude that your requirements are unsatisfiable.

hint: Metadata for `gym` (v0.21.0) could not be parsed:
  after parsing `3`, found `.`, which is not part of a valid version
  opencv-python (>=3.) ; extra == 'all'
                 ^^^^
"""
MISMATCH = """\
error: Failed to download `cloudpickle==3.1.2`
  cause: Hash mismatch for `cloudpickle==3.1.2`

         Expected:
           sha256:aacb47f6

         Computed:
           sha256:9acb47f6
"""
NOT_CACHED = """\
error: Failed to download `cloudpickle==3.1.2`
  cause: Network connectivity is disabled, but the requested data wasn't found in the cache: http://127.0.0.1/cloudpickle-3.1.2-py3-none-any.whl
"""
FULL = """\
error: Failed to inspect Python interpreter from provided path at `v9/bin/python`
  cause: Failed to query Python interpreter
  cause: failed to write to file `_manylinux.py`: No space left on device (os error 28)
"""
MALFORMED = """\
error: Failed to install: odd-1.0-py3-none-any.whl (odd==1.0)
  cause: Wheel version does not match filename (2.0 != 1.0), which indicates a malformed wheel. If this is intentional, set `UV_SKIP_WHEEL_FILENAME_CHECK=1`.
"""
OLDER = """\
  × No solution found when resolving dependencies:
  ╰─▶ Because there is no version of mujoco==99 and you require mujoco==99, we
      can conclude that your requirements are unsatisfiable.
"""


@pytest.mark.parametrize(
    ("text", "asked", "phase", "outcome", "decisive"),
    [
        pytest.param(
            NO_SOLUTION,
            Phase.RESOLVE,
            Phase.RESOLVE,
            Outcome.FAILED,
            "Because gymnasium==1.2.3 depends on numpy>=1.21.0 and you require gymnasium==1.2.3, we can conclude that "
            "you require numpy>=1.21.0. And because you require numpy<1.20",
            id="no-solution",
        ),
        pytest.param(
            PYTHON,
            Phase.RESOLVE,
            Phase.RESOLVE,
            Outcome.FAILED,
            "Because the current Python version (3.8.18) does not satisfy Python>=3.10 and gymnasium==1.4.0 depends on "
            "Python>=3.10, we can conclude that gymnasium==1.4.0 cannot be used. And because only gymnasium<=1.4.0 is "
            "available and you require gymnasium==1.4.0",
            id="python",
        ),
        pytest.param(
            OLDER,
            Phase.RESOLVE,
            Phase.RESOLVE,
            Outcome.FAILED,
            "Because there is no version of mujoco==99 and you require mujoco==99",
            id="older-uv",
        ),
        pytest.param(
            LOGIN,
            Phase.RESOLVE,
            Phase.RESOLVE,
            Outcome.INFRA,
            "An index URL (http://127.0.0.1:9104/simple) could not be queried due to a lack of valid authentication "
            "credentials (401 Unauthorized)",
            id="login",
        ),
        pytest.param(
            OFFLINE,
            Phase.RESOLVE,
            Phase.RESOLVE,
            Outcome.INFRA,
            "Packages were unavailable because the network was disabled. When the network is disabled, registry packages "
            "may only be read from the cache.",
            id="offline",
        ),
        pytest.param(
            SERVER,
            Phase.RESOLVE,
            Phase.RESOLVE,
            Outcome.INFRA,
            "Request failed after 3 retries in 6.6s: HTTP status server error (500 Internal Server Error) for url "
            "(http://127.0.0.1:9100/simple/foo/)",
            id="server",
        ),
        pytest.param(
            SETUPTOOLS,
            Phase.RESOLVE,
            Phase.INSTALL,
            Outcome.FAILED,
            "error in gym setup command: 'extras_require' must be a dictionary whose values are strings or lists of "
            "strings containing valid project/version requirement specifiers.",
            id="metadata-build",
        ),
        pytest.param(
            FETCHING_BACKEND,
            Phase.RESOLVE,
            Phase.INSTALL,
            Outcome.FAILED,
            "RuntimeError: MUJOCO_PATH environment variable is not set",
            id="words-of-a-backend",
        ),
        pytest.param(
            BACKEND_OFFLINE,
            Phase.RESOLVE,
            Phase.INSTALL,
            Outcome.INFRA,
            "wheel_stub.error.InstallFailedError: [Errno -2] Name or service not known",
            id="backend-without-network",
        ),
        pytest.param(
            BUILD_REQUIREMENTS,
            Phase.RESOLVE,
            Phase.INSTALL,
            Outcome.FAILED,
            "gym==0.21.0: no solution for its build requirements: Because you require setuptools>=40.8.0 and "
            "setuptools==1.0.0.99, we can conclude that your requirements are unsatisfiable.",
            id="build-requirements",
        ),
        pytest.param(
            METADATA,
            Phase.RESOLVE,
            Phase.INSTALL,
            Outcome.FAILED,
            "Metadata for `gym` (v0.21.0) could not be parsed: / after parsing `3`, found `.`, which is not part of a "
            "valid version / opencv-python (>=3.) ; extra == 'all'",
            id="invalid-metadata",
        ),
        pytest.param(
            MISMATCH,
            Phase.INSTALL,
            Phase.INSTALL,
            Outcome.INFRA,
            "Failed to download `cloudpickle==3.1.2`: Hash mismatch for `cloudpickle==3.1.2`",
            id="hash",
        ),
        pytest.param(
            NOT_CACHED,
            Phase.INSTALL,
            Phase.INSTALL,
            Outcome.INFRA,
            "Failed to download `cloudpickle==3.1.2`: Network connectivity is disabled, but the requested data wasn't "
            "found in the cache: http://127.0.0.1/cloudpickle-3.1.2-py3-none-any.whl",
            id="not-cached",
        ),
        pytest.param(
            FULL,
            Phase.INSTALL,
            Phase.INSTALL,
            Outcome.INFRA,
            "Failed to inspect Python interpreter from provided path at `v9/bin/python`: failed to write to file "
            "`_manylinux.py`: No space left on device (os error 28)",
            id="disk-full",
        ),
        pytest.param(
            MALFORMED,
            Phase.INSTALL,
            Phase.INSTALL,
            Outcome.FAILED,
            "Failed to install: odd-1.0-py3-none-any.whl (odd==1.0): Wheel version does not match filename (2.0 != 1.0), "
            "which indicates a malformed wheel. If this is intentional, set `UV_SKIP_WHEEL_FILENAME_CHECK=1`.",
            id="malformed",
        ),
        pytest.param(
            "error: something new\n",
            Phase.INSTALL,
            Phase.INSTALL,
            Outcome.INFRA,
            "uv failed in a way that is not known: something new",
            id="unknown",
        ),
    ],
)
def test_whose_failure(text: str, asked: Phase, phase: Phase, outcome: Outcome, decisive: str) -> None:
    """A message of uv means a phase, an outcome and a decisive line; what is not known is never the packages' fault."""
    step = uvsays.failure(text, asked)

    assert (step.phase, step.outcome, step.decisive) == (phase, outcome, decisive)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "error: Couldn't parse requirement in `requirements.in` at position 0\n"
            "  cause: Unexpected end of version specifier, expected version\n"
            "         numpy===\n              ^^^\n",
            "Couldn't parse requirement in `requirements.in` at position 0: Unexpected end of version specifier, "
            "expected version: numpy===",
        ),
        (
            "error: Distribution not found at: file:///nowhere/a.whl\n",
            "Distribution not found at: file:///nowhere/a.whl",
        ),
        (
            "error: Failed to read `--find-links` directory: /nowhere\n  cause: No such file or directory (os error 2)\n",
            "Failed to read `--find-links` directory: /nowhere: No such file or directory (os error 2)",
        ),
    ],
    ids=["requirement", "file", "find-links"],
)
def test_bad_input(text: str, told: str) -> None:
    """What the user gave and uv cannot read is said in one sentence."""
    with pytest.raises(BadInput) as raised:
        uvsays.failure(text, Phase.RESOLVE)

    assert str(raised.value) == f"uv cannot use what it was given: {told}; correct the requirement or setting"


def test_met_source() -> None:
    """uv's log tells whether an sdist was looked into."""
    assert uvsays.met_source("DEBUG Preparing metadata for: gym==0.26.2\n")
    assert uvsays.met_source("DEBUG Downloading source distribution: gym==0.26.2\n")
    assert not uvsays.met_source("warning: source distribution\nResolved 3 packages\n")
