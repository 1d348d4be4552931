"""Changes that may cure: in parts, beside what the user asks for, and taken from what failed."""

from __future__ import annotations

import pytest
from builders import cell_requiring

from harness.matrix import changes
from harness.model import Change, Phase
from harness.rootcause.repair import candidate_changes, failure_hints
from harness.rootcause.repair.candidate_changes import Way
from harness.standalone.failures.matching import Evidence

WHOLE = Change(
    requirements=("packaging",),
    constraints=("numpy<2", "mujoco<3"),
    environment={"MUJOCO_GL": "egl", "DISPLAY": ""},
    python="3.10",
)


def evidence_of(*lines: str, phase: Phase = Phase.SINGLE) -> list[Evidence]:
    """Return the evidence of one failure with these lines."""
    return [Evidence(phase=phase, reasons=lines)]


def test_parts_make_the_whole_again() -> None:
    """Each line, variable and version is one; without one of them the others are left."""
    parts = candidate_changes.parts(WHOLE)
    assert len(parts) == 6
    assert candidate_changes.of_parts(parts) == WHOLE
    rest = candidate_changes.without(WHOLE, Change(constraints=("numpy<2",)))
    assert (rest.constraints, rest.environment) == (("mujoco<3",), WHOLE.environment)
    assert not candidate_changes.without(WHOLE, WHOLE)


def test_the_later_of_two_changes_has_the_last_word() -> None:
    """The later change wins on the same package or variable; the rest of both stays."""
    both = candidate_changes.merge_changes(
        WHOLE, Change(constraints=("numpy<1.24",), environment={"MUJOCO_GL": "osmesa"})
    )
    assert both.constraints == ("mujoco<3", "numpy<1.24")
    assert (both.environment, both.python) == ({"MUJOCO_GL": "osmesa", "DISPLAY": ""}, "3.10")


@pytest.mark.parametrize(
    ("asked", "bounded", "change", "made", "contrary"),
    [
        pytest.param(["gym==0.26.2"], [], "numpy<2", ["numpy<2"], False, id="of another package"),
        pytest.param(["numpy>=1.20"], [], "numpy<2", ["numpy<2,>=1.20"], False, id="both bounds hold"),
        pytest.param(["numpy==2.1"], [], "numpy<2", ["numpy<2"], True, id="contrary to a pin"),
        pytest.param(["numpy<2,>=1.20"], [], "numpy<1.24", ["numpy<1.24,>=1.20"], False, id="the lower bound says all"),
        pytest.param(["gym[mujoco]==0.26.2"], [], "gym<1", [], False, id="what is there already"),
        pytest.param(["gym[mujoco]<1"], [], "gym>=0.26", ["gym[mujoco]<1,>=0.26"], False, id="extras stay"),
        pytest.param(["gym==1.2"], [], "gym[other]<2", ["gym[other]==1.2"], False, id="an extra more"),
        pytest.param(["gym"], ["numpy>=1.20"], "numpy<2", ["numpy<2,>=1.20"], False, id="a bound of the user's"),
    ],
)
def test_remedy_beside_what_is_asked_for(
    asked: list[str], bounded: list[str], change: str, made: list[str], contrary: bool
) -> None:
    """The user's own requirements stay where they can; a contradiction is reported."""
    of = cell_requiring(*asked, constraints=tuple(bounded))
    assert candidate_changes.merge_with_bounds(of, Change(requirements=(change,))) == (
        Change(requirements=tuple(made)),
        contrary,
    )


def test_a_bound_that_is_contrary_to_a_pin_moves_it() -> None:
    """A constraint would leave the pin, and nothing to resolve."""
    made, contrary = candidate_changes.merge_with_bounds(
        cell_requiring("gymnasium==0.29.1", "mujoco==3.0.1"), Change(constraints=("mujoco<3",))
    )
    assert (made, contrary) == (Change(requirements=("mujoco<3",)), True)
    before = cell_requiring("mujoco==3.0.1")
    assert candidate_changes.find_replaced_packages(before, changes.apply(before, made, {})) == ("mujoco",)
    narrowed = changes.apply(cell_requiring("numpy<2"), Change(requirements=("numpy<1.24",)), {})
    assert candidate_changes.find_replaced_packages(cell_requiring("numpy<2"), narrowed) == ()
    free = changes.apply(before, Change(constraints=("numpy<2",)), {})
    assert candidate_changes.find_replaced_packages(before, free) == ()


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [("1.26.4", "2.0.0", "<2"), ("1.23.5", "1.24.0", "<1.24"), ("3.0.1", "3.0.2", "<3.0.2"), ("2.0.0", "1.9", ">=2")],
)
def test_bound_between_two_neighbours(good: str, bad: str, said: str) -> None:
    """The bound is as short as possible, and lies on the side of the version that works."""
    assert candidate_changes.bound(good, bad) == said


def test_missing_modules_and_who_brings_them() -> None:
    """Only what everybody knows, or what some package declares: no name is guessed."""
    evidence = evidence_of("ModuleNotFoundError: No module named 'pkg_resources'", "No module named 'left_pad.core'")
    assert failure_hints.missing_modules(evidence) == ("pkg_resources", "left_pad")
    assert failure_hints.providers("pkg_resources", ()) == ("setuptools<81",)
    assert failure_hints.providers("left_pad", ()) == ()
    assert failure_hints.providers("left_pad", ("left-pad",)) == ("left-pad",)


def test_an_error_that_names_a_package_to_install() -> None:
    """An extra of what is asked for, its version as it is; a package that nobody knows is not taken."""
    evidence = evidence_of(
        'DependencyNotInstalled: pygame is not installed, run `pip install "gymnasium[classic-control]"`',
        "pip install some-package-of-that-name",
    )
    found = list(failure_hints.find_suggested_installs(cell_requiring("gymnasium[mujoco]==1.2.3"), evidence))
    assert found == [Change(requirements=("gymnasium[classic-control,mujoco]==1.2.3",))]


def test_suspects() -> None:
    """Packages named in the line that says why come first, then those named in logs, then the others."""
    evidence = [
        Evidence(phase=Phase.SINGLE, reasons=("module 'cv2' has no attribute 'x'",), logs=("numpy/core numpy",))
    ]
    assert failure_hints.suspects(["aaa", "numpy", "opencv-python"], evidence) == ("opencv-python", "numpy", "aaa")


def test_ways_of_drawing() -> None:
    """Those that the machine has, where the failure speaks of drawing; first what the user set is taken away."""
    here = frozenset({"egl", "osmesa"})
    of = cell_requiring("mujoco", environment={"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "glx"})
    found = list(failure_hints.variables(of, Phase.RENDER, evidence_of("no OpenGL platform"), here=here))
    assert [one.change.environment for one in found] == [
        {"PYOPENGL_PLATFORM": ""},
        {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa"},
    ]
    assert not list(failure_hints.variables(of, Phase.SINGLE, evidence_of("numpy has no attribute"), here=here))
    shown = list(
        failure_hints.variables(
            cell_requiring("mujoco"), Phase.RENDER, evidence_of("no display"), here=frozenset({"display"})
        )
    )
    assert [one.change.environment for one in shown] == [
        {"SDL_VIDEODRIVER": "x11"},
        {"DISPLAY": "virtual"},
        {"DISPLAY": "virtual", "MUJOCO_GL": "glfw"},
    ]
    assert {one.way for one in shown} == {Way.DISPLAY}


def test_ways_of_drawing_that_nothing_reads() -> None:
    """A variable is left out where no package that reads it is there."""
    here = frozenset({"egl", "osmesa", "display"})

    def tried(*installed: str) -> list[dict[str, str]]:
        found = failure_hints.variables(
            cell_requiring("x"), Phase.RENDER, evidence_of("blank frame"), here=here, installed=installed
        )
        return [dict(one.change.environment) for one in found]

    assert tried("pygame") == [{"SDL_VIDEODRIVER": "x11"}, {"DISPLAY": "virtual"}]
    assert tried("numpy") == [{"DISPLAY": "virtual"}]
    assert {"MUJOCO_GL": "egl"} in tried("mujoco")


@pytest.mark.parametrize(
    ("text", "bounds"),
    [
        ("`Pusher-v4` is only supported on `mujoco<3`, for more information", {"mujoco": "<3"}),
        (
            "Because stable-baselines3==2.3.2 depends on gymnasium>=0.28.1,<0.30 and you require gymnasium==1.0.0",
            {"gymnasium": ">=0.28.1,<0.30"},
        ),
        ("dm-control==1.0.31 depends on mujoco>=3.3.3 and you require mujoco==3.3.2.", {"mujoco": ">=3.3.3"}),
        ("take gymnasium[mujoco] >= 1.1 or <1.", {"gymnasium": ">=1.1"}),
        ("line 3 < 4, mujoco is 3.1.6", {}),
    ],
)
def test_bounds_that_a_text_names(text: str, bounds: dict[str, str]) -> None:
    """Those on packages that matter here; a line that names one release bounds nothing."""
    found = failure_hints.bounds([text], {"mujoco", "gymnasium", "stable-baselines3", "dm-control"})
    assert {name: failure_hints.format_bound(bound) for name, bound in found.items()} == bounds


def test_bounds_that_are_not_met() -> None:
    """Only those that what is there contradicts are hints."""
    texts = ["needs numpy<2 and mujoco>=2.3"]
    assert list(failure_hints.find_unmet_bounds(texts, {"numpy": "2.2.6", "mujoco": "3.1.6"})) == ["numpy"]


def test_alternatives_of_one_package() -> None:
    """`or` goes on with the package before it."""
    assert [(name, str(each)) for name, each in failure_hints.named_bounds("take gymnasium>=1.1 or <1.")] == [
        ("gymnasium", ">=1.1"),
        ("gymnasium", "<1"),
    ]
