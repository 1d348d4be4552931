# ruff: noqa: E501, RUF001  (lines as uv printed them)
"""Failures of uv, told apart. Every text was printed by uv (0.13.9; the last one by an older release)."""

import pytest

from harness.model import Outcome, Phase, Step
from harness.model.errors import BadInput
from harness.packages import uv_failures

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
            "Failed to download `cloudpickle==3.1.2`: Hash mismatch for `cloudpickle==3.1.2`; it is not the file that was "
            "locked: if the index was wrong then and is right now, lock again (`simmatrix lock MATRIX --upgrade`)",
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
            "uv failed for an unknown reason: something new",
            id="unknown",
        ),
    ],
)
def test_a_message_of_uv_has_a_phase_and_an_outcome(
    text: str, asked: Phase, phase: Phase, outcome: Outcome, decisive: str
) -> None:
    """A message of uv means a phase, an outcome and a decisive line; what is not known is never the packages' fault."""
    step = uv_failures.failure(text, asked)

    assert (step.phase, step.outcome, step.decisive) == (phase, outcome, decisive)


WHOLE = [
    (
        "Failed to download `odd==1.0`",
        ("The wheel is invalid: Multiple .dist-info directories found: more-1.0, odd-1.0",),
    ),
    ("Failed to download `odd==1.0`", ("The wheel is invalid: Missing .dist-info directory",)),
    (
        "Failed to download `odd==1.0`",
        (
            "`RECORD` file is invalid",
            "CSV deserialize error: record 0 (line: 1, byte: 0): invalid length 1, expected struct RecordEntry with 3 elements",
        ),
    ),
    (
        "Failed to download `odd==1.0`",
        ("Failed to extract archive: odd-1.0-py3-none-any.whl", "Archive contains unacceptable filename: od?d?.py"),
    ),
    (
        "Failed to download and build `odd==1.0`",
        (
            "Failed to extract archive: odd==1.0",
            "Invalid tar file",
            'at byte 2560: unsafe symbolic-link target "../../../etc/passwd": escapes the destination root',
        ),
    ),
    (
        "Failed to download and build `odd==1.0`",
        (
            "Failed to extract archive: odd==1.0",
            "Invalid tar file",
            'at byte 2560: unsafe member path "/tmp/evil": is absolute',
        ),
    ),
    (
        "Failed to download and build `odd==1.0`",
        (
            "Failed to extract archive: odd==1.0",
            "Invalid tar file",
            "at byte 2560: cannot extract unsupported member type Fifo at odd-1.0/dev",
        ),
    ),
]
"""Headlines and causes of archives that came whole, and that uv refuses."""


@pytest.mark.parametrize(("headline", "causes"), WHOLE, ids=[causes[-1][:40] for _, causes in WHOLE])
@pytest.mark.parametrize("asked", [Phase.RESOLVE, Phase.INSTALL])
def test_an_archive_that_uv_refuses_is_the_packages_fault(headline: str, causes: tuple[str, ...], asked: Phase) -> None:
    """Uv refuses to unpack what no index and no disk can have made: the package is uninstallable, in uv's words."""
    text = f"error: {headline}\n" + "".join(f"  cause: {cause}\n" for cause in causes)
    step = uv_failures.failure(text, asked)

    assert (step.phase, step.outcome) == (Phase.INSTALL, Outcome.FAILED)
    assert step.decisive == ": ".join((headline, *causes))


@pytest.mark.parametrize(
    ("cause", "told"),
    [
        (
            "failed to open file `$CACHE/uv/.tmpnDxtnR/odd-1.0.dist-info/RECORD`: No such file or directory (os error 2)",
            "failed to open file `odd-1.0.dist-info/RECORD`: No such file or directory (os error 2)",
        ),
        (
            "`$CACHE/uv/sdists-v11/index/9ac8/odd/1.0/h9MO/src` does not appear to be a Python project, as neither "
            "`pyproject.toml` nor `setup.py` are present in the directory",
            "`its source` does not appear to be a Python project, as neither `pyproject.toml` nor `setup.py` are present "
            "in the directory",
        ),
    ],
    ids=["no RECORD", "no project"],
)
def test_random_names_of_folders_are_left_out(cause: str, told: str) -> None:
    """Folders that uv's cache holds for a moment have no name of their own in a decisive line."""
    step = uv_failures.failure(f"error: Failed to download and build `odd==1.0`\n  cause: {cause}\n", Phase.RESOLVE)

    assert step.outcome is Outcome.FAILED
    assert step.decisive == f"Failed to download and build `odd==1.0`: {told}"


BROKEN = [
    "Bad CRC (got 1a62d7c5, expected 08d7782b) for file: odd.py",
    "Invalid zip file structure\n  cause: unexpected end of file",
    "Bad uncompressed size (got 00000067, expected 000000f6) for file: odd-1.0.dist-info/RECORD",
    "Invalid tar file\n  cause: at byte 0: failed to read tar data\n  cause: Invalid gzip header",
]


@pytest.mark.parametrize("cause", BROKEN)
def test_an_archive_that_is_not_whole_is_nobody_s(cause: str) -> None:
    """A cut download, a broken mirror or a login page says nothing of a package."""
    text = f"error: Failed to download `odd==1.0`\n  cause: Failed to extract archive: odd.whl\n  cause: {cause}\n"

    assert uv_failures.failure(text, Phase.INSTALL).outcome is Outcome.INFRA


def test_another_package_s_file_is_nobody_s() -> None:
    """An index that serves another wheel under a name makes the package neither unresolvable nor uninstallable."""
    text = (
        "error: No solution found when resolving dependencies\n"
        "  cause: Because odd==1.0 has an invalid package format and only odd==1.0 is available, we can conclude ...\n\n"
        "hint: The structure of `odd` (v1.0) was invalid:\n"
        "  The .dist-info directory `other-1.0` does not start with the normalized package name: odd\n"
    )
    step = uv_failures.failure(text, Phase.RESOLVE)

    assert (step.phase, step.outcome) == (Phase.RESOLVE, Outcome.INFRA)
    assert step.decisive == ("the index hands out another package's file as odd (it holds other-1.0); try again later")


def test_metadata_of_another_package_blame_nobody() -> None:
    """An index may have mixed them up, or a wheel be malformed: uv's words do not tell which."""
    text = (
        "error: The index returned metadata for the wrong package: "
        "expected distribution metadata for odd, got distribution metadata for other\n"
    )
    step = uv_failures.failure(text, Phase.RESOLVE)

    assert (step.phase, step.outcome) == (Phase.RESOLVE, Outcome.INFRA)
    assert step.decisive == (
        "the metadata of odd are those of other: the index mixed them up, or a wheel is malformed; try again later"
    )


def test_an_address_within_a_package_is_its_own_fault() -> None:
    """A wheel of an index may not require an address."""
    cause = (
        "Package `other` was included as a URL dependency. URL dependencies must be expressed as direct requirements"
    )
    step = uv_failures.failure(
        f"error: Failed to resolve dependencies for package `odd==1.0`\n  cause: {cause}\n", Phase.RESOLVE
    )

    assert (step.phase, step.outcome) == (Phase.RESOLVE, Outcome.FAILED)
    assert step.decisive == f"Failed to resolve dependencies for package `odd==1.0`: {cause}"


@pytest.mark.parametrize(
    ("decisive", "mended"),
    [
        ("Because dep was not found in the package registry and odd depends on dep, we can conclude", True),
        ("Because odd==1.0 has an invalid package format and only odd==1.0 is available", True),
        ("Because there is no version of mujoco==99 and you require mujoco==99", False),
    ],
)
def test_answers_that_an_index_may_have_fixed_are_asked_again(decisive: str, mended: bool) -> None:
    """A page that was missing and a broken file may be there today; a version that was never released is not."""
    step = Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive=decisive)

    assert uv_failures.may_be_mended(step) is mended


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
    """Input that uv cannot read is reported in one sentence."""
    with pytest.raises(BadInput) as raised:
        uv_failures.failure(text, Phase.RESOLVE)

    assert str(raised.value) == f"uv cannot use its input: {told}; correct the requirement or setting"


def test_met_source() -> None:
    """uv's log tells whether an sdist was looked into."""
    assert uv_failures.met_source("DEBUG Preparing metadata for: gym==0.26.2\n")
    assert uv_failures.met_source("DEBUG Downloading source distribution: gym==0.26.2\n")
    assert not uv_failures.met_source("warning: source distribution\nResolved 3 packages\n")
