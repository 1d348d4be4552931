"""Test the findings that `doctor` derives from the facts of an environment."""

from __future__ import annotations

from typing import Any

import pytest
from builders import standalone_signature
from facts import SITE, distribution, facts, installed

from harness.standalone.doctor import package_findings
from harness.standalone.doctor.differences import Difference
from harness.standalone.doctor.environment_findings import (
    find_loaded_twice,
    find_shadowing,
    find_silent_issues,
    known_causes,
    predict_failures,
    report_differences,
    report_failed_imports,
)
from harness.standalone.doctor.inspect_environment import Viewpoint
from harness.standalone.failures.matching import Evidence, Signature, read
from harness.standalone.running import ProcessResult


def texts(findings: list[package_findings.Finding]) -> list[str]:
    """Return level and text of each finding."""
    return [f"{one.level}: {one.text}" for one in findings]


def here(**variables: str) -> Viewpoint:
    """Return a caller with these variables, which starts no process."""

    def run(*_: Any) -> ProcessResult:
        raise AssertionError

    return Viewpoint(run, "/env/bin/python", variables, "/here", "/scratch")


def test_a_version_that_is_not_asked_for() -> None:
    """A conflict lists all packages that require another version on one line; the most important conflict is first."""
    made = facts(
        distribution("ruler", "1.0", "measure>=2"),
        distribution("measure", "1.0"),
        distribution("gym", "0.21.0", "numpy>=1.18"),
        distribution("dm-control", "1.0.0", "numpy<2"),
        distribution("mujoco", "3.0.0", "numpy<2"),
        distribution("numpy", "2.2.6"),
    )

    assert texts(package_findings.conflicts(made)) == [
        "warning: numpy 2.2.6 is not what dm-control 1.0.0 (numpy<2), mujoco 3.0.0 (numpy<2) needs",
        "warning: measure 1.0 is not what ruler 1.0 (measure>=2) needs",
    ]


def test_markers_and_extras_count() -> None:
    """A requirement of another Python is none; one of an extra counts where another package asks for the extra."""
    lines = ('tomli; python_version < "3.11"', 'imageio>=2; extra == "mujoco"')
    api = distribution("gymnasium", "1.0.0", *lines)

    alone = package_findings.conflicts(facts(api))
    asked = package_findings.conflicts(facts(api, distribution("robots", "1.0", "gymnasium[mujoco]")))

    assert texts(alone) == []
    assert texts(asked) == ["warning: imageio is missing, which gymnasium 1.0.0 (imageio>=2) needs"]


def test_a_package_under_another_name() -> None:
    """A package that conda names differently is only a note, since its module is there."""
    made = facts(distribution("robosuite", "1.4.1", "opencv-python"), importable=["cv2"])

    assert [one.level for one in package_findings.conflicts(made)] == ["note"]


def test_pythons() -> None:
    """A package that excludes this Python gives a warning."""
    made = facts(distribution("gym", "0.21.0", requires_python="<3.11"))

    assert texts(package_findings.check_pythons(made)) == ["warning: gym 0.21.0 requires Python <3.11, this is 3.11.7"]


def test_broken_metadata() -> None:
    """A missing version, a duplicate, missing files, overwritten files and leftovers are each reported."""
    made = facts(
        distribution("numpy", "1.26.4"),
        distribution("numpy", "2.2.6"),
        distribution("six", None, trouble="it has no METADATA"),
        distribution("gym", "0.26.2", missing=3, missing_files=["gym/core.py"]),
        distribution("opencv-python", "4.9.0"),
        distribution("opencv-python-headless", "4.8.0"),
        leftovers=[f"{SITE}/~umpy"],
        claimed=[
            {
                "location": SITE,
                "folders": ["opencv_python-4.9.0.dist-info", "opencv_python_headless-4.8.0.dist-info"],
                "count": 9,
                "file": "cv2/__init__.py",
            }
        ],
    )

    assert [(one.check, one.level) for one in package_findings.metadata(made)] == [
        ("metadata.broken", "warning"),
        ("metadata.duplicate", "warning"),
        ("metadata.files", "warning"),
        ("modules.claimed", "warning"),
        ("metadata.leftover", "note"),
    ]
    assert (
        "opencv-python and opencv-python-headless have 9 file(s) in common" in texts(package_findings.metadata(made))[3]
    )


@pytest.mark.parametrize(
    ("more", "level", "word"),
    [
        ((), "warning", "shimmy, which translates, is not installed"),
        ((distribution("shimmy", "2.0.0", "gymnasium"),), "note", "gym 0.26.2 is asked for by old-robots"),
    ],
    ids=["without", "with-shimmy"],
)
def test_gym_beside_gymnasium(more: tuple[dict[str, Any], ...], level: str, word: str) -> None:
    """Packages that ask for one each are a trouble unless something translates."""
    made = facts(
        distribution("gym", "0.26.2"),
        distribution("gymnasium", "1.0.0"),
        distribution("old-robots", "1.0", "gym"),
        distribution("stable-baselines3", "2.3.0", "gymnasium"),
        *more,
    )

    (found,) = package_findings.check_gym_mix(made)

    assert (found.level, word in found.text) == (level, True)


def test_packages_that_pip_put_over_conda() -> None:
    """The version of conda and that which is really there; what is as conda left it is not told."""
    records = [
        {"name": "numpy", "version": "1.26.4", "build": "b_0", "metadata": ["numpy-1.26.4.dist-info"], "trouble": None},
        {"name": "six", "version": "1.16", "build": "py_0", "metadata": ["six-1.16.dist-info"], "trouble": None},
        {"name": "glfw", "version": "3.3", "build": "h1", "metadata": [], "trouble": None},
    ]  # fmt: skip
    made = facts(distribution("numpy", "2.2.6"), distribution("six", "1.16"), conda=records)

    assert texts(package_findings.conda(made)) == [
        "warning: conda says numpy 1.26.4 (b_0), but pip has put 2.2.6 over it"
    ]


# --- modules and libraries -------------------------------------------------------------------------------------


def test_hidden_modules() -> None:
    """The working folder, PYTHONPATH and the user site hide modules; a copy behind the environment's own hides none."""
    user = "/home/u/.local/lib/python3.11/site-packages"
    own = f"{SITE}/numpy/__init__.py"
    made = facts(
        path=["/more", user, SITE],
        hidden=[
            {"module": "mujoco", "first": "/here/mujoco.py", "then": f"{SITE}/mujoco/__init__.py", "standard": False},
            {"module": "queue", "first": "/here/queue.py", "then": "/usr/lib/python3.11/queue.py", "standard": True},
            {"module": "numpy", "first": "/more/numpy/__init__.py", "then": own, "standard": False},
            {"module": "gym", "first": f"{user}/gym/__init__.py", "then": f"{SITE}/gym/__init__.py", "standard": False},
            {"module": "six", "first": f"{SITE}/six.py", "then": "/usr/lib/python3/six.py", "standard": False},
        ],
    )  # fmt: skip

    found = texts(find_shadowing(here(PYTHONPATH="/more"), made))

    assert [text.partition(":")[2].partition(" hides")[0] for text in found] == [
        " the working folder",
        " the working folder",
        " PYTHONPATH (/more)",
        f" the user site ({user})",
    ]


def test_libraries_loaded_twice() -> None:
    """Two of one kind in a process; several of GCC's OpenMP only are noted."""
    paths = ["/a/libmujoco.so.3.1.6", "/b/libmujoco.so.3.3.2", "/c/libgomp-a34b.so.1", "/d/libgomp.so.1"]
    probes = {"imports": {"mujoco": {"libraries": paths}, "numpy": {"libraries": paths[:1]}}}

    assert [(one.level, one.text.partition(" was")[0]) for one in find_loaded_twice(probes)] == [
        ("warning", "MuJoCo"),
        ("note", "OpenMP"),
    ]


def imported(error: str | None, **more: Any) -> dict[str, Any]:
    """Return the result of an import."""
    return {"error": error, "file": "/x.py", "version": "1", "libraries": [], "traceback": error, **more}


def test_imports_that_fail() -> None:
    """Each failing import is reported once, and not again if a difference already shows it."""
    probes = {
        "imports": {
            "gym": imported("ImportError: a"),
            "mujoco": imported("OSError: b"),
            "torch": imported("OSError: c", alone=True),
        },
        "clean_imports": {},
    }
    apart = [Difference("import", "mujoco", "fails: OSError: b", "/x.py", ("LD_LIBRARY_PATH",))]

    assert texts(report_failed_imports(probes, apart)) == [
        "warning: `import gym` fails: ImportError: a",
        "warning: `import torch` fails once others are imported, and works alone: OSError: c",
    ]


def test_differences_in_sentences() -> None:
    """The variable with its value, and both outcomes; one that changes nothing is noted."""
    apart = [Difference("import", "mujoco", "fails: RuntimeError: no", "/x.py", ("MUJOCO_GL",))]

    found = report_differences(here(MUJOCO_GL="off!", LD_LIBRARY_PATH="/x"), facts(), apart)

    assert texts(found) == [
        "warning: with MUJOCO_GL=off! `import mujoco` fails: RuntimeError: no; without, it works",
        "note: set here, without effect on any import that was tried: LD_LIBRARY_PATH=/x",
    ]


# --- known failures --------------------------------------------------------------------------------------------


def bool8_signature(name: str, **more: Any) -> Signature:
    """Return the known failure of gym below 1 with numpy 2 or later."""
    usual = {"cause": "so it is", "packages": ["gym<1", "numpy>=2"], "remedy": {"requirements": ["numpy<2"]}}
    return standalone_signature(name, "bool8", **{**usual, **more})


def test_known_failures_of_an_import() -> None:
    """The error of an import is held against what is known, with what is installed."""
    probes = {"imports": {"gym": imported("AttributeError: no bool8", output="")}, "clean_imports": {}}
    one = bool8_signature("bool8", phases=["import"])

    hits = [
        [hit.signature.id for hit in known_causes([one], probes, installed(gym="0.26.2", numpy=version))]
        for version in ("2.2.6", "1.26.4")
    ]

    assert hits == [["bool8"], []]


def test_a_log_is_no_cause() -> None:
    """An error and its traceback count as evidence; other printed text does not."""
    seen = [Evidence(phase="single", reasons=("ValueError: other",), logs=("warning: bool8 is gone",))]
    probes: dict[str, Any] = {"imports": {}, "clean_imports": {}}

    assert known_causes([bool8_signature("bool8")], probes, installed(gym="0.26.2", numpy="2.2.6"), seen) == ()


def test_known_failures_that_these_versions_have() -> None:
    """All packages are there in such versions and the remedy asks for others; of one remedy, one is told."""
    those = [
        bool8_signature("wide", phases=["import", "single", "render"]),
        bool8_signature("narrow"),
        bool8_signature("one-package", packages=["gym<1"]),
        bool8_signature("no-other-version", remedy={"text": "reboot"}),
        bool8_signature("at-install", phases=["install"]),
        bool8_signature("mask", masks=True),
    ]

    assert [one.id for one in predict_failures(those, installed(gym="0.26.2", numpy="2.2.6"))] == ["narrow"]
    assert predict_failures(those, installed(gym="0.26.2", numpy="1.26.4")) == []
    assert predict_failures(those, installed(gym="0.26.2")) == []


def test_silent_failures() -> None:
    """A silent failure is recognised by the installed packages alone."""
    silent = read({"id": "quiet", "cause": "wrong", "remedy": {}, "packages": ["mujoco==4.0.0"], "silent": True})

    assert [one.id for one in find_silent_issues([silent], installed(mujoco="4.0.0"))] == ["quiet"]
    assert find_silent_issues([silent], installed(mujoco="4.0.1")) == []
    ants = silent._replace(envs=("Ant-*",))
    assert [one.id for one in find_silent_issues([ants], installed(mujoco="4.0.0"), "Ant-v5")] == ["quiet"]
    assert [one.id for one in find_silent_issues([ants], installed(mujoco="4.0.0"))] == ["quiet"]
    assert find_silent_issues([ants], installed(mujoco="4.0.0"), "CartPole-v1") == []
