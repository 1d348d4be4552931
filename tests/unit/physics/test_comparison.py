"""Two cells that stepped from the same states: what the comparison says of every kind of difference."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from harness.model import replace
from harness.physics.comparison import compare
from harness.physics.outputs import Array, Bank, Outputs, typical_sizes
from harness.physics.relation import Class

STATES, NOISE = 300, 1e-14
SPACES = {"action_space": "Box(2,)", "observation_space": "Box(3,)"}
STAGE_STARTS = ["step 1", "step 2"]
ULP = 2.0**-52


def outputs(**changed: Array) -> Outputs:
    """Return outputs of a simulator with numbers about 1; arrays in `changed` stand in the place of its own."""
    dice = np.random.RandomState(3)
    arrays = {
        "step": dice.uniform(1, 2, (STATES, 4)),
        "warm_step": dice.uniform(1, 2, (STATES, 4)),
        "exact_step": dice.uniform(1, 2, (STATES, 4)),
        "stages": dice.uniform(1, 2, (STATES, 2, 8)),
        "state": dice.uniform(1, 2, (STATES, 5)),
        "observation": dice.uniform(1, 2, (STATES, 3)),
        "reward": dice.uniform(1, 2, STATES),
        "ended": np.zeros((STATES, 2)),
        "contacts": np.zeros(STATES, int),
        "info": np.zeros(STATES, int),
        "reset": dice.uniform(1, 2, (50, 3)),
    }
    facts = {"repeats": True, "spaces": SPACES, "sizes": {"qpos": 2}, "starts": STAGE_STARTS, "info": [["x"]],
             "contacts": [["1-2"]], "model": {"body_mass": [2, 1.0]}, "precision": "float64",
             "observation_precision": "float64"}  # fmt: skip
    return Outputs(arrays | changed, facts)


def bank() -> Bank:
    """Return the bank of these states, with the same noise in each."""
    made = outputs()
    names = ("step", "exact_step", "state", "observation", "reward")
    noise = {name: np.full(STATES, NOISE) for name in names} | {"stages": np.full((STATES, 8), NOISE)}
    scales = {name: typical_sizes(array) for name, array in made.arrays.items()}
    return Bank({"action": np.zeros((STATES, 2))}, noise, scales, made.facts)


def moved(name: str, size: float, states: int = STATES, **more: float) -> Outputs:
    """Return outputs of which some arrays differ in the first states, by a share of each number."""
    changed = {}
    for part, share in {name: size, **more}.items():
        array = outputs().arrays[part].copy()
        array[:states] *= 1 + share
        changed[part] = array
    return outputs(**changed)


def with_facts(**facts: object) -> Outputs:
    """Return the outputs with other facts."""
    plain = outputs()
    return replace(plain, facts={**plain.facts, **facts})


def test_equal_outputs_are_identical() -> None:
    """Equal bits need no statistics."""
    found = compare(outputs(), outputs(), bank())
    assert (found.kind, found.dynamics, found.start, found.agrees) == (*[Class.IDENTICAL] * 3, True)


@pytest.mark.parametrize("name", ["step", "state", "observation", "reward"])
def test_differences_within_the_noise_are_rounding(name: str) -> None:
    """A twin moves it as far."""
    found = compare(outputs(), moved(name, 3 * NOISE), bank())
    assert (found.kind, found.agrees) == (Class.ROUND_OFF, True)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("step", Class.CHANGED),
        ("state", Class.CHANGED),
        ("observation", Class.OTHER_OBSERVATION),
        ("reward", Class.OTHER_REWARD),
    ],
)
def test_a_difference_beyond_the_noise_is_a_change(name: str, kind: Class) -> None:
    """The output that differs decides its name."""
    found = compare(outputs(), moved(name, 1e-6), bank())
    assert (found.kind, found.agrees) == (kind, False)
    assert found.of(name).largest == pytest.approx(1e-6, rel=0.01)
    assert found.of(name).share == 1.0


def test_a_difference_between_both_thresholds_is_undecided() -> None:
    """Nothing is claimed where no known change and no known rounding lies."""
    assert compare(outputs(), moved("state", 1e3 * NOISE), bank()).kind is Class.UNDECIDED


def test_one_state_alone_is_no_change() -> None:
    """Rounding makes or breaks a contact now and then, which no twin did."""
    assert compare(outputs(), moved("state", 1e-3, states=1), bank()).kind is Class.ROUND_OFF
    assert compare(outputs(), moved("state", 1e-3, states=2), bank()).kind is Class.CHANGED


def stage(start: int, number: int, more: Callable[[Array], Array] = lambda array: array) -> Array:
    """Return sums of stages of which one differs."""
    array = outputs().arrays["stages"].copy()
    array[:, start, number:] *= 1 + 1e-6
    return more(array)


def test_the_first_stage_that_differs_is_named() -> None:
    """The earliest start counts, and there the earliest stage."""
    step = moved("step", 1e-6, state=1e-6).arrays
    found = compare(outputs(), outputs(**{**step, "stages": stage(0, 1)}), bank())
    assert (found.stage, found.start_of_stage) == ("collision", "step 1")
    found = compare(outputs(), outputs(**{**moved("state", 1e-6).arrays, "stages": stage(1, 6)}), bank())
    assert (found.stage, found.start_of_stage) == ("constraint", "step 2")


def test_a_step_without_a_stage_that_differs_is_the_integrator() -> None:
    """All that comes before the integrator is equal."""
    found = compare(outputs(), moved("step", 1e-6, state=1e-6), bank())
    assert (found.stage, found.start_of_stage) == ("integrator", "step 1")


def test_a_difference_that_more_iterations_remove_is_the_precision_of_the_solver() -> None:
    """Both come to the same state once the solver runs to its end."""
    step = moved("step", 1e-6, state=1e-6).arrays
    other = outputs(**{**step, "stages": stage(0, 7)})
    found = compare(outputs(), other, bank())
    assert (found.kind, found.agrees, found.stage) == (Class.SOLVER_PRECISION, True, "solver")
    lasting = outputs(**{**other.arrays, "exact_step": moved("exact_step", 1e-7).arrays["exact_step"]})
    assert compare(outputs(), lasting, bank()).kind is Class.CHANGED


def test_an_effect_of_the_solver_is_no_other_observation() -> None:
    """The observation and the reward differ because the state does."""
    step = moved("step", 1e-6, state=1e-6, observation=1e-6, reward=1e-6).arrays
    other = outputs(**{**step, "stages": stage(0, 7)})
    assert compare(outputs(), other, bank()).kind is Class.SOLVER_PRECISION


def test_a_solver_that_differs_later_in_the_step_is_undecided() -> None:
    """It was run to its end for the first step of the simulator alone."""
    other = outputs(**{**moved("state", 1e-6, observation=1e-6).arrays, "stages": stage(1, 7)})
    assert compare(outputs(), other, bank()).kind is Class.UNDECIDED


def test_a_difference_only_from_the_stored_warm_start_is_named_so() -> None:
    """Steps from a zeroed warm start agree."""
    found = compare(outputs(), moved("warm_step", 1e-6), bank())
    assert (found.kind, found.warm_start, found.agrees) == (Class.CHANGED, True, False)


def test_an_episode_that_ends_elsewhere_is_reported() -> None:
    """States, observations and rewards agree."""
    ended = np.zeros((STATES, 2))
    ended[:5, 0] = 1
    assert compare(outputs(), outputs(ended=ended), bank()).kind is Class.OTHER_TERMINATION


def test_other_sizes_are_another_interface_and_no_error() -> None:
    """A bank whose states do not fit leaves the resets alone."""
    one = Outputs({"reset": outputs().arrays["reset"]}, {"sizes": {"qpos": 3}})
    found = compare(outputs(), one, bank())
    assert (found.kind, found.start) == (Class.OTHER_INTERFACE, Class.IDENTICAL)
    same = Outputs({"reset": outputs().arrays["reset"]}, {"sizes": {"qpos": 2}})
    assert compare(outputs(), same, bank()).kind is Class.NOT_COMPARABLE
    assert compare(outputs(), with_facts(spaces={"action_space": "Box(9,)"}), bank()).kind is Class.OTHER_INTERFACE


def test_another_size_of_the_observation_is_another_observation() -> None:
    """The states still agree."""
    found = compare(outputs(), outputs(observation=np.ones((STATES, 7))), bank())
    assert (found.kind, found.dynamics) == (Class.OTHER_OBSERVATION, Class.IDENTICAL)


def test_an_observation_of_every_second_state_is_compared_there() -> None:
    """A cell that kept all rows is held against one that kept half of them; the state is named by its own number."""
    every = outputs().arrays
    half = Outputs({**every, "observation": every["observation"][::2]}, {**outputs().facts, "observed_every": 2})
    assert compare(outputs(), half, bank()).kind is Class.IDENTICAL
    changed = every["observation"].copy()
    changed[[4, 6]] += 0.1
    found = compare(outputs(observation=changed), half, bank())
    assert (found.kind, found.of("observation").state in {4, 6}) == (Class.OTHER_OBSERVATION, True)
    unseen = every["observation"].copy()
    unseen[[3, 5]] += 0.1
    assert compare(outputs(observation=unseen), half, bank()).kind is Class.IDENTICAL


def test_a_step_that_does_not_repeat_itself_is_recognised_first() -> None:
    """No difference of such a cell means anything."""
    assert compare(outputs(), with_facts(repeats=False), bank()).kind is Class.NONDETERMINISTIC


@pytest.mark.parametrize("left_out", ["state", "observation", "reward"])
def test_an_output_that_does_not_repeat_itself_is_never_called_the_same(left_out: str) -> None:
    """The other outputs may show a change; without one nothing is claimed."""
    again = with_facts(repeats=False, unrepeated=[left_out])
    assert compare(outputs(), again, bank()).kind is Class.NONDETERMINISTIC
    changed = replace(again, arrays={**again.arrays, "step": again.arrays["step"] + 1})
    assert compare(outputs(), changed, bank()).kind is Class.CHANGED


def test_the_same_actions_in_other_words_are_the_same_interface() -> None:
    """gym printed one space in three ways; its bounds count where both cells noted them."""
    bounds = {"kind": "bounds", "shape": [1], "low": [-1.0], "high": [1.0]}
    first = with_facts(action=bounds, spaces={**SPACES, "action_space": "Box(1,)"})
    second = with_facts(action=bounds, spaces={**SPACES, "action_space": "Box(-1.0, 1.0, (1,), float32)"})
    assert compare(first, second, bank()).kind is Class.IDENTICAL
    wider = with_facts(action={**bounds, "high": [2.0]})
    assert compare(first, wider, bank()).kind is Class.OTHER_INTERFACE


def test_another_generator_is_no_other_distribution_of_starts() -> None:
    """Fifty seeds of one distribution, and of a wider one; the kind of the cell stays what its steps say."""
    dice = np.random.RandomState(9)
    reseeded = compare(outputs(), outputs(reset=dice.uniform(1, 2, (50, 3))), bank())
    assert (reseeded.kind, reseeded.start) == (Class.IDENTICAL, Class.RESEEDED)
    other = compare(outputs(), outputs(reset=dice.uniform(1, 3, (50, 3))), bank())
    assert (other.kind, other.start) == (Class.IDENTICAL, Class.OTHER_START)
    rounded = compare(outputs(), outputs(reset=outputs().arrays["reset"] * (1 + 1e-8)), bank())
    assert rounded.start is Class.ROUND_OFF


def test_starts_are_not_compared_through_other_observations() -> None:
    """An observation in another order shows nothing of where an episode starts."""
    plain = outputs().arrays
    turned = {name: np.ascontiguousarray(plain[name][:, ::-1]) for name in ("observation", "reset")}
    found = compare(outputs(), outputs(**turned), bank())
    assert (found.kind, found.start) == (Class.OTHER_OBSERVATION, Class.NOT_COMPARABLE)


def test_arrays_of_the_model_that_differ_are_named() -> None:
    """Rounding in a compiler is not."""
    one = with_facts(model={"body_mass": [2, 1.0 + 1e-15]})
    assert compare(outputs(), one, bank()).model == ()
    assert compare(outputs(), with_facts(model={"body_mass": [2, 1.001]}), bank()).model == ("body_mass",)
    turned = [with_facts(model={"body_iquat": [4, sign]}) for sign in (1.0, -1.0)]
    assert compare(*turned, bank()).model == ()  # one rotation


def test_numbers_that_are_not_finite_differ_from_those_that_are() -> None:
    """Two that are not finite in the same place agree."""
    broken = outputs().arrays["state"].copy()
    broken[:, 0] = np.nan
    assert compare(outputs(), outputs(state=broken), bank()).kind is Class.CHANGED
    assert compare(outputs(state=broken), outputs(state=broken.copy()), bank()).kind is Class.IDENTICAL
