"""Say in a sentence how two cells differ."""

from __future__ import annotations

from collections.abc import Mapping

from harness.physics.relation import STARTS, Class, Comparison, Consequence, Difference, Effect

OUTPUTS = {
    "step": "the next state of the simulator",
    "warm_step": "the next state of the simulator, started from a stored warm start,",
    "state": "the next state of the environment",
    "observation": "the observation",
    "reward": "the reward",
    "ended": "the end of the episode",
    "info": "the keys of `info`",
    "contacts": "the set of contacts",
}

KINDS = {
    Class.IDENTICAL: "behaves identically, to the bit",
    Class.ROUND_OFF: "behaves the same, up to rounding",
    Class.SOLVER_PRECISION: "behaves the same, up to the precision of the solver",
    Class.UNDECIDED: "cannot be decided: it differs by more than rounding, and no change is shown",
    Class.CHANGED: "behaves otherwise",
    Class.NOT_EXERCISED: "was not exercised",
    Class.NOT_COMPARABLE: "cannot be compared from the same states",
    Class.NONDETERMINISTIC: "cannot be compared: it does not repeat itself from the same state",
    Class.OTHER_INTERFACE: "has another interface: its state or its actions have another size",
    Class.OTHER_OBSERVATION: "moves the same, and observes otherwise",
    Class.OTHER_REWARD: "moves the same, and rewards otherwise",
    Class.OTHER_TERMINATION: "moves the same, and ends episodes otherwise",
    Class.RESEEDED: "starts from other states under the same seed, of the same distribution",
    Class.OTHER_START: "starts from another distribution of states",
}


def describe(comparison: Comparison) -> str:
    """Return what differs, as the rest of a sentence whose subject is the environment."""
    parts = [KINDS[comparison.kind]]
    if comparison.kind not in {Class.IDENTICAL, Class.ROUND_OFF}:
        leading = leading_difference(comparison)
        if leading:
            parts.append(f"{OUTPUTS[leading.output]} differs {size(leading)}")
        if comparison.stage:
            where = f" (at the start of {comparison.start_of_stage})" if comparison.start_of_stage else ""
            parts.append(f"the first stage that differs is {comparison.stage}{where}")
        if comparison.warm_start:
            parts.append("only a stored warm start shows it")
        if comparison.model:
            parts.append(f"the model differs in {', '.join(comparison.model)}")
    if comparison.seeded:
        parts.append("its state cannot be set, so short runs from seeded resets were compared")
    if comparison.unrepeated and comparison.kind is not Class.NONDETERMINISTIC:
        parts.append(f"not compared, because it depends on more than the state: {', '.join(comparison.unrepeated)}")
    if comparison.start in STARTS:
        parts.append(f"it {KINDS[comparison.start]}")
    return "; ".join(parts)


def leading_difference(comparison: Comparison) -> Difference | None:
    """Return the first output that differs by more than rounding, in the order in which a step makes them."""
    wanted = {Class.CHANGED, Class.UNDECIDED, Class.OTHER_OBSERVATION}
    differing = [one for one in comparison.differences if one.kind in wanted]
    return next(iter(sorted(differing, key=lambda one: list(OUTPUTS).index(one.output))), None)


def size(difference: Difference) -> str:
    """Return how much an output differs, and in how many states."""
    if difference.kind is Class.OTHER_OBSERVATION:
        return "in its size"
    share = f"in {percent(difference.share)} of the states"
    if not difference.largest:
        return share
    return f"{share}, relative difference up to {number(difference.largest)} (median {number(difference.median)})"


def percent(share: float) -> str:
    """Return a share in percent; one that is not 0 never reads as 0 %."""
    return f"{share:.0%}" if share == 0 or share >= 0.01 else f"{share:.1%}"


def number(value: float) -> str:
    """Return a number with two digits."""
    return f"{value:.2g}"


def moves(moved: Mapping[str, tuple[str | None, str | None]]) -> str:
    """Return which packages differ, each with both versions; empty for none."""
    return ", ".join(f"{name} {before or 'absent'} -> {after or 'absent'}" for name, (before, after) in moved.items())


def describe_consequence(effect: Consequence) -> str:
    """Return the effect of a change on a policy, with what was seen on both sides and how sure that is."""
    low, high, difference = (f"{value:+.1f}" for value in (effect.low, effect.high, effect.difference))
    if effect.measure == "success":
        before, after = (f"{100 * value:.1f} %" for value in (effect.before, effect.after))
        seen = f"{before} of {effect.episodes} episodes succeed before, {after} after ({difference} points"
    else:
        before, after = (f"{value:,.1f}" for value in (effect.before, effect.after))
        seen = f"mean return of {effect.episodes} episodes {before} before, {after} after ({difference} points"
    parts = [f"{effect.effect}: {seen}, {low} to {high})"]
    if effect.identical and effect.effect is Effect.EQUAL:
        parts.append("every episode is the same, to the bit")
    parts.append(f"a difference of {effect.least:.1f} points would have been seen")
    if effect.moved_starts:
        parts.append(f"{effect.moved_starts} of the same seeds start elsewhere")
    if not effect.repeats:
        parts.append("an episode does not repeat itself")
    return "; ".join(parts)
