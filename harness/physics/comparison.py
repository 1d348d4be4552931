"""Compare the outputs of two cells for one case, state by state, against the noise of each state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.physics.outputs import Array, Bank, Outputs
from harness.physics.relation import AGREEING, STARTS, Class, Comparison, Difference

ROUND_OFF_RATIO, CHANGED_RATIO = 1e2, 1e4
"""Up to the first ratio of difference to noise two cells agree; from the second on they do not."""

FEW_STATES = 2
"""States that have to differ. In a single one, rounding may have made or broken a contact that no twin did."""

PRECISION_GAIN = 100.0
"""Times by which a difference that is only the solver's falls when the solver runs to its end."""

SAME_MODEL = 1e-12
"""Relative difference of the sums of an array of the model that is rounding."""

SAME_ROTATION = frozenset({"body_quat", "body_iquat", "geom_quat"})
"""Arrays of the model that are not held against each other: a quaternion and its negative are one rotation, and
principal axes can be named in another order."""

STAGES = ("kinematics", "collision", "actuation", "passive", "bias", "acceleration", "constraint", "solver")


def compare(first: Outputs, second: Outputs, bank: Bank) -> Comparison:
    """Compare two cells for one case."""
    if not (first.steps_from_bank and second.steps_from_bank):
        kind = Class.OTHER_INTERFACE if first.facts.get("sizes") != second.facts.get("sizes") else Class.NOT_COMPARABLE
        return Comparison(kind=kind, dynamics=kind, start=_start(first, second))
    unrepeated = _unrepeated(first) | _unrepeated(second)
    if unrepeated & {"step", "state"} and ("step" in unrepeated or "step" not in first.arrays):
        kind = Class.NONDETERMINISTIC
        return Comparison(kind=kind, dynamics=kind, start=_start(first, second))
    start, seeded = _start(first, second), bank.facts.get("method") == "seeded"
    if seeded and start not in AGREEING:
        return Comparison(kind=Class.NOT_COMPARABLE, dynamics=Class.NOT_COMPARABLE, start=start, seeded=True)
    names = [name for name in ("step", "warm_step", "state", "observation", "reward") if name in first.arrays]
    differences = {name: _difference(name, first, second, bank) for name in names}
    differences["ended"] = _exact("ended", _texts(first.arrays["ended"]), _texts(second.arrays["ended"]))
    differences["info"] = _exact("info", first.entries("info"), second.entries("info"))
    differences |= {name: _identical(name) for name in unrepeated if name in differences}
    if "stages" in first.arrays:
        differences["contacts"] = _exact("contacts", first.entries("contacts"), second.entries("contacts"))
    stage = _first_stage(first, second, bank) if "stages" in first.arrays else _NO_STAGE
    dynamics = _dynamics(first, second, bank, differences, stage)
    warm_start = dynamics in AGREEING and differences.get("warm_step", _identical("")).kind is Class.CHANGED
    kind = _sum_up(first, second, dynamics, warm_start, differences)
    if unrepeated and (kind in AGREEING or kind is Class.UNDECIDED):
        kind = Class.NONDETERMINISTIC  # a change can be shown without the outputs that are left out, sameness cannot
    return Comparison(
        kind=kind,
        dynamics=Class.CHANGED if warm_start else dynamics,
        start=_comparable_start(start, differences["observation"]),
        differences=tuple(differences.values()),
        stage=stage.name if dynamics not in {Class.IDENTICAL, Class.ROUND_OFF} else None,
        start_of_stage=stage.start if dynamics not in {Class.IDENTICAL, Class.ROUND_OFF} else None,
        model=_model(first, second),
        warm_start=warm_start,
        seeded=seeded,
        unrepeated=tuple(sorted(unrepeated)),
    )


def _unrepeated(outputs: Outputs) -> set[str]:
    """Return the outputs that were others when the same states were stepped from once more."""
    return set() if outputs.facts["repeats"] else {*outputs.facts.get("unrepeated", ("step", "state"))}


def _sum_up(
    first: Outputs, second: Outputs, dynamics: Class, warm_start: bool, differences: Mapping[str, Difference]
) -> Class:
    # What is seen of another state is no other observation, reward or end.
    alike = dynamics in {Class.IDENTICAL, Class.ROUND_OFF}
    observation, reward, ended = (differences[name].kind for name in ("observation", "reward", "ended"))
    by_weight = (
        (Class.OTHER_INTERFACE, not _same_actions(first.facts, second.facts)),
        (Class.CHANGED, dynamics is Class.CHANGED or warm_start),
        (Class.OTHER_OBSERVATION, observation is Class.OTHER_OBSERVATION or (alike and observation is Class.CHANGED)),
        (Class.OTHER_REWARD, alike and reward is Class.CHANGED),
        (Class.OTHER_TERMINATION, alike and ended is Class.CHANGED),
    )
    kinds = [dynamics, observation, reward]
    order = (Class.UNDECIDED, Class.SOLVER_PRECISION, Class.ROUND_OFF)
    fitting = [kind for kind, holds in by_weight if holds] + [kind for kind in order if kind in kinds]
    return fitting[0] if fitting else Class.IDENTICAL


def _same_actions(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    """Return whether both take the same actions. Texts of spaces differ between releases whose spaces do not."""
    if "action" in first and "action" in second:
        return bool(first["action"] == second["action"])
    return bool(first["spaces"].get("action_space") == second["spaces"].get("action_space"))


# --- one output ------------------------------------------------------------------------------------------------


def _identical(output: str) -> Difference:
    return Difference(output=output, kind=Class.IDENTICAL)


def gaps(name: str, first: Array, second: Array, bank: Bank) -> Array:
    """Return the largest difference at each state, in the typical size of each number, or its own if larger."""
    scale = np.maximum(bank.scales[name], np.maximum(np.abs(first), np.abs(second)))
    with np.errstate(invalid="ignore", over="ignore"):
        difference = np.abs(first - second) / scale
    difference = np.where(np.isnan(first) & np.isnan(second), 0.0, np.nan_to_num(difference, nan=np.inf, posinf=np.inf))
    largest: Array = difference.reshape(len(difference), -1).max(axis=1, initial=0.0)
    return largest


def ratios(name: str, difference: Array, bank: Bank, every: int = 1) -> Array:
    """Return the differences as multiples of the noise of their state, which is one ulp at least.

    `every` is 2 where there is a difference for every second state alone.
    """
    noise = bank.noise["step" if name == "warm_step" else name][::every]
    return difference / np.maximum(noise, _ulp(name, bank))


def _ulp(name: str, bank: Bank) -> float:
    precision = str(bank.facts["observation_precision" if name == "observation" else "precision"])
    return float(np.finfo(precision).eps)


def _difference(name: str, first: Outputs, second: Outputs, bank: Bank) -> Difference:
    every = max(first.every(name), second.every(name))
    left, right = (one.arrays[name][:: every // one.every(name)] for one in (first, second))
    if left.shape != right.shape:
        return Difference(output=name, kind=Class.OTHER_OBSERVATION)
    if left.shape[1:] != bank.scales[name].shape:  # both are unlike the cell that made the bank
        bank = bank.scaled_by(first)
    if left.tobytes() == right.tobytes():
        return _identical(name)
    difference = gaps(name, left, right, bank)
    ratio = ratios(name, difference, bank, every)
    beyond = ratio >= CHANGED_RATIO
    kind = Class.ROUND_OFF
    if beyond.sum() >= FEW_STATES:
        kind = Class.CHANGED
    elif (ratio > ROUND_OFF_RATIO).sum() >= FEW_STATES:
        kind = Class.UNDECIDED
    counted = difference[beyond] if beyond.any() else difference[difference > 0]
    return Difference(
        output=name,
        kind=kind,
        largest=float(difference.max()),
        median=float(np.median(counted)) if counted.size else 0.0,
        share=float(beyond.mean()),
        ratio=float(ratio.max()),
        state=int(ratio.argmax()) * every,
    )


def _texts(flags: Array) -> list[str]:
    return [str(row.tolist()) for row in flags]


def _exact(name: str, left: list[str], right: list[str]) -> Difference:
    differ = [number for number, pair in enumerate(zip(left, right, strict=True)) if pair[0] != pair[1]]
    if not differ:
        return _identical(name)
    kind = Class.CHANGED if len(differ) >= FEW_STATES else Class.UNDECIDED
    return Difference(output=name, kind=kind, share=len(differ) / len(left), state=differ[0])


# --- the next state --------------------------------------------------------------------------------------------


def _dynamics(
    first: Outputs, second: Outputs, bank: Bank, differences: Mapping[str, Difference], stage: _Stage
) -> Class:
    kinds = [differences[name].kind for name in ("step", "state") if name in differences]
    if Class.CHANGED not in kinds:
        return next((kind for kind in (Class.UNDECIDED, Class.ROUND_OFF) if kind in kinds), Class.IDENTICAL)
    if not (stage.only_solver and "exact_step" in bank.noise):
        return Class.CHANGED
    if differences["step"].kind is not Class.CHANGED:
        return Class.UNDECIDED  # the solver was run to its end for the first step of the simulator alone
    return Class.SOLVER_PRECISION if _only_precision(first, second, bank) else Class.CHANGED


def _only_precision(first: Outputs, second: Outputs, bank: Bank) -> bool:
    """Return whether each state that differs agrees once the solver runs to its end, and differs far less."""
    plain = gaps("step", first.arrays["step"], second.arrays["step"], bank)
    exact = gaps("exact_step", first.arrays["exact_step"], second.arrays["exact_step"], bank)
    beyond = ratios("step", plain, bank) >= CHANGED_RATIO
    settled = ratios("exact_step", exact, bank) <= ROUND_OFF_RATIO
    return bool(beyond.any() and np.all(settled[beyond]) and np.all(exact[beyond] * PRECISION_GAIN <= plain[beyond]))


@dataclass(frozen=True)
class _Stage:
    """The first stage that differs, the start it was read at, and whether at every state it is the solver."""

    name: str | None
    start: str | None
    only_solver: bool


_NO_STAGE = _Stage(None, None, only_solver=False)


def _first_stage(first: Outputs, second: Outputs, bank: Bank) -> _Stage:
    """Return the first stage that differs at any state: the earliest start, and there the earliest stage.

    A step that differs although no stage at its start or inside it does was integrated otherwise.
    """
    left, right = first.arrays["stages"], second.arrays["stages"]
    if left.shape != right.shape or left.shape[1:] != bank.scales["stages"].shape:
        return _Stage("model", None, only_solver=False)
    scale = np.maximum(bank.scales["stages"], np.maximum(np.abs(left), np.abs(right)))
    noise = bank.noise["stages"][:, None, :]
    later = np.maximum(noise, bank.noise["state"][:, None, None])
    noise = np.concatenate([noise, np.repeat(later, left.shape[1] - 1, axis=1)], axis=1)
    ratio = np.abs(left - right) / scale / np.maximum(noise, _ulp("stages", bank))
    beyond = ratio >= CHANGED_RATIO  # (states, starts, stages)
    stepped = gaps("step", first.arrays["step"], second.arrays["step"], bank)
    stepped = ratios("step", stepped, bank) >= CHANGED_RATIO
    starts = list(first.facts["starts"])
    inner = sum(name == "step 1" or name.startswith("inner") for name in starts)
    # The integrator ends the first step: its place is behind the last stage of the starts inside that step.
    rows = [*beyond[:, :inner].reshape(len(beyond), -1).T, stepped, *beyond[:, inner:].reshape(len(beyond), -1).T]
    table = np.stack(rows, axis=1)
    names = [(start, stage) for start in starts for stage in STAGES]
    names.insert(inner * len(STAGES), ("step 1", "integrator"))
    if not table.any():
        return _Stage(None, None, only_solver=False)
    earliest = table.argmax(axis=1)[table.any(axis=1)]
    start, stage = names[int(earliest.min())]
    return _Stage(stage, start, only_solver=all(names[int(number)][1] == "solver" for number in earliest))


def _model(first: Outputs, second: Outputs) -> tuple[str, ...]:
    """Return the arrays of the model that differ by more than rounding."""
    left, right = first.facts.get("model", {}), second.facts.get("model", {})

    def differs(name: str) -> bool:
        pairs = zip(left[name], right[name], strict=True)
        return any(abs(a - b) > SAME_MODEL * max(abs(a), abs(b)) for a, b in pairs)

    return tuple(name for name in left if name in right and name not in SAME_ROTATION and differs(name))


# --- starts ----------------------------------------------------------------------------------------------------

SAME_START = 1e-6
"""Relative difference of a starting observation that is rounding: some are float32."""

FALSE_STARTS = 0.001
"""The share of equal distributions of starts that may be taken for others (false discovery rate)."""


def _start(first: Outputs, second: Outputs) -> Class:
    left, right = first.arrays["reset"], second.arrays["reset"]
    if left.shape != right.shape:
        return Class.OTHER_OBSERVATION
    if left.tobytes() == right.tobytes():
        return Class.IDENTICAL
    if np.all(np.abs(left - right) <= SAME_START * np.maximum(1.0, np.abs(left))):
        return Class.ROUND_OFF
    chances = [_same_distribution(a, b) for a, b in zip(left.T, right.T, strict=True) if len({*a, *b}) > 1]
    return Class.OTHER_START if any(_discoveries(chances)) else Class.RESEEDED


def _comparable_start(start: Class, observation: Difference) -> Class:
    """Return the class of the starts, which are seen through observations: other ones show nothing of them."""
    same = observation.kind not in {Class.CHANGED, Class.OTHER_OBSERVATION}
    return start if same or start not in STARTS else Class.NOT_COMPARABLE


def _same_distribution(first: Array, second: Array) -> float:
    """Return the chance of so large a distance between two samples of one distribution (Kolmogorov and Smirnov)."""
    every = np.sort(np.concatenate([first, second]))
    shares = [np.searchsorted(np.sort(sample), every, side="right") / len(sample) for sample in (first, second)]
    distance = float(np.max(np.abs(shares[0] - shares[1])))
    effective = np.sqrt(len(first) * len(second) / (len(first) + len(second)))
    argument = (effective + 0.12 + 0.11 / effective) * distance
    if argument < 0.2:
        return 1.0
    terms = np.arange(1, 101)
    return float(min(1.0, max(0.0, 2 * np.sum((-1.0) ** (terms - 1) * np.exp(-2 * (terms * argument) ** 2)))))


def _discoveries(chances: list[float]) -> list[bool]:
    """Return which of several chances are too small together (Benjamini and Hochberg)."""
    order = sorted(range(len(chances)), key=chances.__getitem__)
    last = max((rank for rank, n in enumerate(order, 1) if chances[n] <= FALSE_STARTS * rank / len(chances)), default=0)
    small = {*order[:last]}
    return [number in small for number in range(len(chances))]
