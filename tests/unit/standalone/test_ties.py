"""Ties: a common line names a package only where the text, or the environment at hand, speaks of it."""

from __future__ import annotations

import pytest

from harness.commands.explain import signatures
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.explain.explain_text import Explanation, Facts, explain_text
from harness.standalone.failures import ties
from tests.unit.standalone.test_failure_text import standalone_signature

LINE = "KeyError: 'policy'"


def ids(explanation: Explanation) -> list[str]:
    """Return the ids of the causes that count."""
    return [hit.signature.id for hit in explanation.causes]


@pytest.mark.parametrize(
    ("rule", "text", "is_tied"),
    [
        ("line", LINE, True),
        ("packages", LINE, False),
        ("packages", "torchrl 0.5, isaac lab\n" + LINE, True),
        ("packages", "torchrl 0.5\n" + LINE, False),
        ((), "torchrl 0.5\n" + LINE, False),
        (["torchrl"], 'File "/x/site-packages/torchrl/envs/common.py", line 3, in step\n' + LINE, True),
        (["torchrl"], "my_torchrl2\n" + LINE, False),
        ([r"envs?\.\w+"], "envs.make\n" + LINE, True),
    ],
)
def test_words_tie_a_text_to_a_known_failure(rule: str | list[str], text: str, is_tied: bool) -> None:
    """One word of a list is enough; of `packages`, which is the default, each has to be named."""
    one = standalone_signature("it", "KeyError: 'policy'", packages=["torchrl", "isaaclab"], ties=rule)
    assert ties.is_tied(one, text) is is_tied


def test_a_package_that_is_installed_ties_too() -> None:
    """A word that names an installed package is a tie; versions that fit are one without any word."""
    one = standalone_signature("it", "KeyError: 'policy'", ties=["torchrl"])
    assert ties.is_tied(one, LINE, {"torchrl": "0.5"})
    fits = standalone_signature("it", "KeyError: 'policy'", packages=["torchrl<0.6"], ties=["isaac"])
    assert ids(explain_text(LINE, [fits], Facts(installed={"torchrl": "0.5"}))) == ["it"]


def test_a_common_line_alone_is_only_possible() -> None:
    """The cause is listed as possible, with the package that would make it likely, and is no answer."""
    one = standalone_signature("it", "KeyError: 'policy'", packages=["torchrl"], ties=["torchrl"])
    explanation = explain_text(LINE, [one])
    assert ids(explanation) == []
    assert [(check, "`torchrl`" in text) for check, _, text in explanation.findings] == [("possible", True)]


def test_another_version_of_all_that_is_named_refutes() -> None:
    """Of two packages the text names one, in a version that does not fit: the other is no way out."""
    one = standalone_signature("it", "no seed", packages=[["gym>=0.22", "gymnasium"]], generic=True, ties="line")
    assert ids(explain_text("TypeError: no seed\nGym version: 0.21.0\n", [one])) == []
    assert ids(explain_text("TypeError: no seed\nGym version: 0.21.0\ngymnasium\n", [one])) == ["it"]


@pytest.mark.parametrize(
    "line",
    [
        "KeyError: 'policy'",
        "TypeError: 'NoneType' object does not support item assignment",
        "AttributeError: 'NoneType' object has no attribute 'view'",
        "AttributeError: 'numpy.ndarray' object has no attribute 'to'",
        "TypeError: cannot unpack non-iterable NoneType object",
        "TypeError: expected Tensor as element 0 in argument 0, but got NoneType",
        "ValueError: invalid literal for int() with base 10: ''",
        "AttributeError: 'Namespace' object has no attribute 'seed'",
        "ValueError: mesh volume is too small",
        "XML Error: repeated default class name",
        "AttributeError: Can't pickle local object 'main.<locals>.<lambda>'",
        "ModuleNotFoundError: No module named 'curobo.types.math'; 'curobo.types' is not a package",
    ],
)
def test_lines_that_anybody_meets_accuse_nobody(line: str) -> None:
    """No known failure of ours is named for a line that says nothing of its package."""
    assert ids(explain_text(line, signatures())) == []


def subjects(text: str) -> list[str]:
    """Return the ids of the causes, with the shipped known failures and histories."""
    return ids(explain_text(text, signatures(), Facts(history=load_shipped)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # gym had the id for three months: nobody can tell which side the installed release is on.
        ("gym.error.UnregisteredEnv: No registered env with id: FetchReach-v0", ["gym-unregistered-env"]),
        # The module before the colon was imported by gym itself: then a missing import is not why.
        ("gym.error.UnregisteredEnv: No registered env with id: pybullet_robot_envs:iCubReach-v0", []),
        # gym's own words before 0.22: a package that registers with gymnasium is no suspect.
        ("gym.error.UnregisteredEnv: No registered env with id: FrankaKitchen-v1", ["gym-unregistered-env"]),
        ("AttributeError: 'TimeLimit' object has no attribute 'ale'", ["derived:wrapper"]),
        ("gym: AttributeError: 'TimeLimit' object has no attribute 'ale'", ["derived:gym"]),
        ("ModuleNotFoundError: No module named 'rclpy._rclpy'", ["derived:ROS 2"]),
        ("ImportError: libpython3.7m.so.1.0: cannot open shared object file: No such file", ["derived:libpython"]),
        (
            "AttributeError: 'numpy.random._generator.Generator' object has no attribute 'randint'",
            ["gym022-np-random-generator", "derived:ale-py"],
        ),
        ("AttributeError: 'module' object has no attribute 'MjSim'", ["derived:mujoco-py"]),
        ("AttributeError: 'module' object has no attribute 'Monitor'", []),
        ('qt.qpa.plugin: Could not find the Qt platform plugin "xcb" in "/opt/CoppeliaSim"', []),
    ],
)
def test_a_derived_cause_is_tied_as_well(text: str, expected: list[str]) -> None:
    """A rule names a package only where the line, or the text around it, leaves no other."""
    assert subjects(text) == expected


def test_the_system_driver_was_tried_too() -> None:
    """Mesa names the last place of several: of the first, which has the driver, an older libstdc++ is mostly why."""
    line = (
        "libGL error: MESA-LOADER: failed to open swrast: /usr/lib/dri/swrast_dri.so: cannot open shared object file:"
        " No such file or directory (search paths {}/usr/lib/dri, suffix _dri)"
    )
    assert subjects(line.format("/usr/lib/x86_64-linux-gnu/dri:")) == [
        "derived:libstdcxx-ng",
        "mesa-dri-driver-missing",
    ]
    assert subjects(line.format("")) == ["mesa-dri-driver-missing"]


def test_a_missing_module_has_no_other_line_as_its_cause() -> None:
    """A complaint of a library above is no reason why Python finds no module."""
    text = (
        "[Error] [carb] Could not load it. Error: /lib64/libm.so.6: version `GLIBC_2.27' not found (required by a.so)\n"
        'Traceback (most recent call last):\n  File "train.py", line 10, in <module>\n    import rlgpu\n'
        "ModuleNotFoundError: No module named 'rlgpu'\n"
    )
    assert subjects(text) == []
    assert subjects(text.splitlines()[0]) == ["derived:glibc"]
