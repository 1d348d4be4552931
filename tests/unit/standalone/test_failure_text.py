"""Test the facts in a text of unknown origin: the line that says why, the phase, the signal, versions in passing."""

from __future__ import annotations

import pytest
from builders import standalone_signature

from harness.standalone.explain import explain_text, failure_text, version_hints
from harness.standalone.explain.explain_text import Facts
from harness.standalone.failures import matching

TRACE = """\
Traceback (most recent call last):
  File "/opt/env/lib/python3.10/site-packages/gym/core.py", line 5, in step
    fly()
ValueError: no wings
"""
CHAIN = """\
Process Worker<AsyncVectorEnv>-1:
Traceback (most recent call last):
  File "/opt/env/lib/python3.9/multiprocessing/process.py", line 315, in _bootstrap
    self.run()
OSError: no such model: arm.xml
Traceback (most recent call last):
  File "train.py", line 3, in <module>
    envs.reset()
  File "/opt/env/lib/python3.9/multiprocessing/connection.py", line 383, in _recv
    raise EOFError
ConnectionResetError: [Errno 104] Connection reset by peer
"""
NOTEBOOK = """\
---------------------------------------------------------------------------
KeyError                                  Traceback (most recent call last)
File ~/env/lib/python3.11/site-packages/gymnasium/envs/registration.py:741, in make(id)
    740 try:
--> 741     spec = registry[id]
    742 except KeyError:

KeyError: 'Ant-v9'

The above exception was the direct cause of the following exception:

VersionNotFound                           Traceback (most recent call last)
Cell In[3], line 1
----> 1 gym.make("Ant-v9")

VersionNotFound: Environment version `v9` for `Ant` doesn't exist.
"""
PIP_CONFLICT = """\
Collecting gymnasium==0.29.1
ERROR: Cannot install gymnasium==0.29.1 and robotics==1.3 because these package versions have conflicting dependencies.

The conflict is caused by:
    The user requested gymnasium==0.29.1
    robotics 1.3 depends on gymnasium>=1.0

To fix this you could try to:
1. loosen the range of package versions you've specified
ERROR: ResolutionImpossible: for help visit a page
"""
PIP_BUILD = """\
Collecting box2d==2.3
  error: subprocess-exited-with-error

  x python setup.py egg_info did not run successfully.
  │ exit code: 1
  ╰─> [6 lines of output]
      Traceback (most recent call last):
        File "<string>", line 2, in <module>
        File "setup.py", line 4, in <module>
      ModuleNotFoundError: No module named 'pkg_resources'
      [end of output]

note: This error originates from a subprocess, and is likely not a problem with pip.
"""
UV = """\
error: No solution found when resolving dependencies
  cause: Because only gym<=0.26.2 is available and you require gym>=1, we can conclude that your requirements are \
unsatisfiable.
"""
CONDA = """\
Solving environment: ...working... failed

LibMambaUnsatisfiableError: Encountered problems while solving:
  - package mujoco-2.3.7-py38h1 requires python >=3.8,<3.9.0a0, but none of the providers can be installed

Could not solve for environment specs
"""
POETRY = """\
Updating dependencies
Because robotics (1.3) depends on gymnasium (>=1.0)
 and lab depends on gymnasium (<1), robotics is forbidden.
So, because lab depends on robotics (1.3), version solving failed.
"""


@pytest.mark.parametrize(
    ("text", "decisive", "phase"),
    [
        (TRACE, "ValueError: no wings", "single"),
        (CHAIN, "OSError: no such model: arm.xml", "vector"),
        (NOTEBOOK, "VersionNotFound: Environment version `v9` for `Ant` doesn't exist.", "single"),
        (
            PIP_CONFLICT,
            "gymnasium==0.29.1 and robotics==1.3 conflict: The user requested gymnasium==0.29.1;"
            " robotics 1.3 depends on gymnasium>=1.0",
            "resolve",
        ),
        (PIP_BUILD, "ModuleNotFoundError: No module named 'pkg_resources'", "install"),
        (UV, "Because only gym<=0.26.2 is available and you require gym>=1", "resolve"),
        (
            CONDA,
            "LibMambaUnsatisfiableError: Encountered problems while solving: package mujoco-2.3.7-py38h1 requires"
            " python >=3.8,<3.9.0a0, but none of the providers can be installed",
            "resolve",
        ),
        (
            POETRY,
            "Because robotics (1.3) depends on gymnasium (>=1.0) and lab depends on gymnasium (<1), robotics is"
            " forbidden. So, because lab depends on robotics (1.3), version solving failed.",
            "resolve",
        ),
        (
            "ERROR: Could not find a version that satisfies the requirement gym==9 (from versions: 0.1, 0.2)\n"
            "ERROR: No matching distribution found for gym==9\n",
            "ERROR: Could not find a version that satisfies the requirement gym==9",
            "resolve",
        ),
        (
            "error: Failed to download and build `gym==0.21.0`\n  cause: Invalid tar file\n"
            "  cause: No space left on device (os error 28)\n",
            "Failed to download and build `gym==0.21.0`: No space left on device (os error 28)",
            "install",
        ),
        (
            "error: Failed to build `gym==0.21.0`\n  cause: The build backend returned an error\n"
            "  cause: Call to `setuptools.build_meta.build_wheel` failed (exit status: 1)\n\n[stderr]\n"
            "error in gym setup command: 'extras_require' must be a dictionary\n",
            "error in gym setup command: 'extras_require' must be a dictionary",
            "install",
        ),
        ("Segmentation fault (core dumped)\n", "Segmentation fault (core dumped)", None),
        ("bash: python3.6: command not found\n", "bash: python3.6: command not found", None),
    ],
    ids=[
        "trace",
        "worker",
        "notebook",
        "pip",
        "build",
        "uv",
        "conda",
        "poetry",
        "not-found",
        "disk",
        "backend",
        "signal",
        "shell",
    ],
)
def test_the_line_that_a_person_would_quote(text: str, decisive: str, phase: str | None) -> None:
    """Of every kind of text the line that a person would quote, and where it failed."""
    told = failure_text.read_failure(text)
    assert (told.decisive, told.phase, told.failed) == (decisive, phase, True)


@pytest.mark.parametrize(
    "changed",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "".join(f"[rank{n % 3}]: {line}\n" for n, line in enumerate(text.splitlines())),
        lambda text: "".join(f"(RolloutWorker pid={4210}, ip=10.0.0.7) {line}\n" for line in text.splitlines()),
        lambda text: "".join(f"2026-11-22T08:0{n}:01.5Z {line}\n" for n, line in enumerate(text.splitlines())),
        lambda text: "".join(f"\x1b[36m(pid=7)\x1b[0m {line}\n" for line in text.splitlines()),
        lambda text: "".join(f"app_1  | {line}\n" for line in text.splitlines()),
        lambda text: " 10%|█         | 1/10\r 20%|██        | 2/10\r\n" + text + "\n\x1b[2K\x1b[1Adone?\n",
        lambda text: text.replace("ValueError", "\x1b[1;31mValueError\x1b[0m"),
        lambda text: "INFO: starts\nEpisode 1: reward -3.2\n" + text + "wandb: Waiting for W&B process to finish\n",
    ],
    ids=["windows", "rank", "ray", "stamp", "colour", "compose", "progress", "bold", "training"],
)
def test_a_traceback_is_seen_through_what_stands_around_it(changed) -> None:
    """Line ends, prefixes of workers and services, colours, progress bars, other output."""
    assert failure_text.read_failure(changed(TRACE)).decisive == "ValueError: no wings"


def test_a_failure_in_pytests_output_is_found() -> None:
    """Its marks before each line are no part of it."""
    text = "    def test_it():\n>       fly()\nE       ValueError: no wings\n\ntest_it.py:3: ValueError\n"
    assert failure_text.read_failure(text).decisive == "ValueError: no wings"


@pytest.mark.parametrize(
    "text",
    [
        "Episode 12: reward 3.5, loss 0.02\nsaved to run/12.pt\n",
        "Successfully installed gym-0.26.2 numpy-2.2.6\n",
        "Mean error: 0.12\nerror: 0.3 over 10 episodes\n",
        "Exception ignored in: <function Env.__del__ at 0x7f>\nTraceback (most recent call last):\n"
        '  File "a.py", line 1, in __del__\nTypeError: no\n\ndone\n',
        "0 errors, 3 warnings\n",
        "ALSA lib conf.c:5180:(_snd_config_evaluate) function returned error: No such file or directory\n",
    ],
    ids=["training", "installed", "errors-of-a-model", "ignored", "counts", "sound"],
)
def test_a_log_without_a_failure_is_reported_as_such(text: str) -> None:
    """An honest answer to a log of something that went well."""
    told = failure_text.read_failure(text)
    assert (told.failed, told.decisive) == (False, None)
    assert explain_text.explain_text(text, [KNOWN]).diagnoses == ()


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Fatal Python error: Segmentation fault\n\nCurrent thread 0x1 (most recent call first):\n", "SIGSEGV"),
        ("train.sh: line 3: 4711 Killed                  python train.py\n", "SIGKILL"),
        ("died with <Signals.SIGABRT: 6>.\n", "SIGABRT"),
        ("Aborted (core dumped)\n", "SIGABRT"),
        ("killed time for 3 s\n", None),
        ("all is well\n", None),
    ],
)
def test_the_signal_that_killed_a_process(text: str, name: str | None) -> None:
    """The signal is read from the words of Python, of shells and of subprocess."""
    assert failure_text.read_failure(text).signal == name


# --- hints -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "python", "packages"),
    [
        (TRACE, "3.10", {}),
        ("C:\\Users\\me\\Python39\\lib\\site-packages\\gym\\core.py\n", "3.9", {}),
        ("Python 3.8.18 on linux\n", "3.8", {}),
        ("/a/lib/python3.10/x /b/lib/python3.11/y\n", None, {}),
        ("Successfully installed gym-0.26.2 numpy-2.2.6 opencv-python-4.9\n", None,
         {"gym": "0.26.2", "numpy": "2.2.6", "opencv-python": "4.9"}),
        ("Requirement already satisfied: numpy>=1 in /x (from gym) (1.26.4)\n", None, {"numpy": "1.26.4"}),
        ("Found numpy==1.20.0\nSuccessfully installed numpy-1.26.4\n", None, {"numpy": "1.26.4"}),
        (" + gym==0.21.0\n + cloudpickle==3.1.2\n", None, {"gym": "0.21.0", "cloudpickle": "3.1.2"}),
        ("Because gym==0.21.0 depends on x and gym==0.22.0 depends on x,\n", None, {}),
        ("Because you require gym==0.21.0 and more\n", None, {"gym": "0.21.0"}),
        ("numpy                     1.26.4          py310hb13e2d6_0    conda-forge\n", None, {"numpy": "1.26.4"}),
        ("Downloading mujoco-2.3.7-cp39-cp39-manylinux_2_17_x86_64.whl (4.6 MB)\n", "3.9", {"mujoco": "2.3.7"}),
        ("gymnasium version: 1.2.0\nx==y\n", None, {"gymnasium": "1.2.0"}),
        (" - Gym version : `0.21.0`\n", None, {"gym": "0.21.0"}),
    ],
)  # fmt: skip
def test_versions_are_read_in_passing(text: str, python: str | None, packages: dict[str, str]) -> None:
    """Of paths, of installers and of lists; what is told twice and differently is not told."""
    assert version_hints.hints(text) == (python, packages)


# --- known causes ----------------------------------------------------------------------------------------------


KNOWN = standalone_signature("wings", "no wings")
BROAD = standalone_signature("broad", "no wings", generic=True, packages=["gym>=0.26"])
ECHO = standalone_signature("echo", "ConnectionResetError", masks=True, generic=True, phases=["vector"])
MODEL = standalone_signature("model", "no such model", packages=["arms<2"], ties="line")
KILLED = standalone_signature("killed", None, signal="SIGSEGV", packages=["arms"])


def named(text: str, *those: matching.Signature, **here: object) -> list[str]:
    """Return the ids of the failures recognised in a text."""
    return [hit.signature.id for hit in explain_text.explain_text(text, those, Facts(**here)).diagnoses]  # type: ignore[arg-type]


def test_the_deepest_cause_comes_first_and_its_mask_last() -> None:
    """The worker's exception goes before what its parent saw."""
    assert named(CHAIN, ECHO, MODEL) == ["model", "echo"]
    assert explain_text.explain_text(CHAIN, [ECHO]).cause is None


def test_a_failure_that_hides_others_counts_where_nothing_is_behind_it() -> None:
    """But a process that only saw another die knows nothing."""
    hides = standalone_signature("hides", "no wings", masks=True)
    assert explain_text.explain_text(TRACE, [hides]).cause is not None
    assert explain_text.explain_text(CHAIN.replace("OSError", "EOFError"), [ECHO]).cause is None
    assert explain_text.explain_text("no wings\n\n" + TRACE.replace("no wings", "no wheels"), [hides]).cause is None


def test_a_trouble_of_the_machine_is_no_package_s() -> None:
    """Trouble of the machine is not called an unknown failure of a package."""
    made = explain_text.explain_text("OSError: [Errno 28] No space left on device\n", [])
    assert [(check, level) for check, level, _ in made.findings] == [("machine", "warning")]


def test_a_specific_cause_goes_before_a_broad_one() -> None:
    """A specific cause comes first even if the packages of both are installed."""
    assert named(TRACE, BROAD, KNOWN, installed={"gym": "0.26.2"}) == ["wings", "broad"]


def test_a_broad_cause_needs_its_packages() -> None:
    """Installed in a version that fits, or named by the text, which then is said."""
    assert named(TRACE, BROAD, installed={"gym": "0.26.2"}) == ["broad"]
    assert named(TRACE, BROAD, installed={"gym": "0.21.0"}) == []
    assert named("gym==0.21.0\n" + TRACE, BROAD) == []
    made = explain_text.explain_text(TRACE, [BROAD])
    assert [hit.signature.id for hit in made.diagnoses] == ["broad"]
    assert made.findings[0][2] == "likely if `gym>=0.26` is installed (the log does not show the version)"


def test_two_broad_causes_are_only_possible() -> None:
    """Two broad causes stay possible, since a text without versions cannot decide between them."""
    other = standalone_signature("other", "no wings", generic=True, packages=["gym<0.26"])
    made = explain_text.explain_text(TRACE, [BROAD, other])
    assert (made.diagnoses, [check for check, _, _ in made.findings]) == ((), ["possible", "possible"])


def test_a_signal_alone_needs_its_packages() -> None:
    """A process is killed for many reasons."""
    text = "Segmentation fault (core dumped)\n"
    assert named(text, KILLED) == []
    assert named(text, KILLED, installed={"arms": "1"}) == ["killed"]
    assert named("all is well", KILLED, installed={"arms": "1"}) == []


def test_another_python_speaks_against_a_cause() -> None:
    """A cause for another Python is dropped, as far as the text or the caller tells the version."""
    older = standalone_signature("older", "no wings", python="<3.10")
    exact = standalone_signature("exact", "no wings", python=">=3.10.5")
    assert named(TRACE, older, exact) == ["exact"]
    assert named(TRACE, older, exact, installed={}, python="3.10.2") == []


def test_a_mention_in_the_log_is_no_cause_of_an_exception() -> None:
    """A notice that stands in the same log is told besides."""
    notice = standalone_signature("notice", "is unmaintained")
    made = explain_text.explain_text("gym is unmaintained\n" + TRACE, [notice])
    assert (made.diagnoses, made.findings[0][0]) == ((), "besides")
    assert named("gym is unmaintained\n" + TRACE, notice, KNOWN) == ["wings"]


def test_a_mention_in_the_log_counts_behind_a_mask() -> None:
    """A line that hides why is no reason to pass over what was written before it; a mask in passing hides nothing."""
    hides = standalone_signature("hides", "no context", masks=True)
    raised = "Traceback (most recent call last):\n  File 'x.py', line 1, in <module>\nRuntimeError: {}\n"

    assert named("warning: no wings\n" + raised.format("no context"), KNOWN, hides) == ["wings", "hides"]
    assert named("warning: no context\n" + raised.format("no feathers"), KNOWN, hides) == []


def test_a_log_of_what_went_well_has_no_cause() -> None:
    """Though it mentions what is known; a line alone is looked up."""
    notice = standalone_signature("notice", "is unmaintained")
    assert named("gym is unmaintained\n", notice) == ["notice"]
    assert named("gym is unmaintained\n" + "Episode 1: reward 2\n" * 9, notice) == []
    wordless = explain_text.explain_text(
        "gym is unmaintained\n" + "Episode 1: reward 2\n" * 9, [notice], Facts(failed=True)
    )
    assert (wordless.diagnoses, wordless.findings[0][0]) == ((), "besides")


def test_a_pattern_over_frames_belongs_to_their_exception() -> None:
    """It says where, and the exception says what."""
    assert named(TRACE, standalone_signature("frames", r'gym/core\.py", line \d+, in step')) == ["frames"]


def test_installed_versions_do_not_contradict_those_being_installed() -> None:
    """The package that cannot be built is not there yet."""
    missing = standalone_signature("missing", "No module named 'pkg_resources'", packages=["box2d"], phases=["install"])
    assert named(PIP_BUILD, missing, installed={"numpy": "1.26.4"}, requirements=("box2d==2.3",)) == ["missing"]
    assert named(PIP_BUILD, missing, installed={"numpy": "1.26.4"}) == ["missing"]


def test_a_failure_after_another_is_reported() -> None:
    """The known one is not the last that failed."""
    text = TRACE + "\n" + TRACE.replace("no wings", "no wheels")
    made = explain_text.explain_text(text, [KNOWN])
    assert [hit.signature.id for hit in made.diagnoses] == ["wings"]
    assert made.findings[0][2].endswith("perhaps as a consequence: ValueError: no wheels")


def test_measured_cells_are_named() -> None:
    """By the cause; where it is unknown, by the line that says why, whatever its numbers."""
    cells = [
        {"id": "m/a", "causes": ["wings"], "decisive": "x", "requirements": ["gym==1"]},
        {"id": "m/b", "causes": [], "decisive": "ValueError: no wings", "requirements": ["gym==2"]},
    ]
    assert explain_text.explain_text(TRACE, [KNOWN], Facts(measured={"cells": cells})).findings == (
        ("measured", "note", "measured here, too: m/a (gym==1)"),
    )
    assert explain_text.explain_text(TRACE, [], Facts(measured={"cells": cells})).findings == (
        ("measured", "note", "measured here, too: m/b (gym==2)"),
    )


def test_the_document_is_that_of_the_contract() -> None:
    """`schema`, `decisive`, `diagnoses`, `findings`, and the phase."""
    made = explain_text.explain_text(TRACE, [KNOWN]).plain()
    assert made["decisive"] == "ValueError: no wings"
    assert made["phase"] == "single"
    assert made["diagnoses"] == [
        {
            "signature": "wings", "cause": "the cause of wings", "remedy": {"text": "mend it"}, "proven": False,
            "masks": False, "references": [], "generic": False, "phase": "single", "seen": "ValueError: no wings",
            "proof": None,
        }
    ]  # fmt: skip


def test_two_broad_causes_of_a_pasted_line_are_most_likely() -> None:
    """A line alone is all that somebody has: both are named, with the versions that would decide."""
    both = [
        standalone_signature(name, "no wings", generic=True, packages=[package], ties="line")
        for name, package in (("broad", "gym>=0.26"), ("other", "gym<0.26"))
    ]
    explanation = explain_text.explain_text("ValueError: no wings", both)
    assert sorted(hit.signature.id for hit in explanation.causes) == ["broad", "other"]
    assert [check for check, _, _ in explanation.findings] == ["packages", "packages"]
