"""Hold the outputs of one cell and the bank of states that they came from, as arrays with their facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

FORM = 1
"""The form of a bank and of outputs; another one is refused."""

LEAST_SCALE = 1e-6
"""The least typical size of a number, as a share of the largest in its array."""


@dataclass(frozen=True)
class Outputs:
    """The outputs of one case in one cell.

    Args:
        arrays: One row a state, but for `reset`. The next state after one step of the simulator: `step` with the warm
            start zeroed, `warm_step` as stored, `exact_step` with the solver run to its end. `stages` (states, starts,
            stages): the sum of each stage. `rows` (states, 3): rows of the solver that are of equalities, limits and
            contacts. After one step of the environment: `state`, `observation`, `reward` (states,), `ended` (states,
            2). `contacts`, `info` (states,): numbers of entries in the facts. `reset` (seeds, numbers): observations of
            seeded resets. A large `observation` is kept of every second state. Without the arrays of states the bank
            does not fit.
        facts: What is no array; see `Stepper.describe` in the cell.
    """

    arrays: Mapping[str, Array]
    facts: Mapping[str, Any]

    @property
    def steps_from_bank(self) -> bool:
        """Return whether the states of the bank could be set."""
        return "state" in self.arrays

    def every(self, name: str) -> int:
        """Return 2 for an array that holds every second state, and 1 for one that holds them all."""
        return int(self.facts.get("observed_every", 1)) if name == "observation" else 1

    def entry(self, name: str, state: int) -> Any:
        """Return what `contacts` or `info` stands for at a state."""
        return self.facts[name][int(self.arrays[name][state])]

    def entries(self, name: str) -> list[str]:
        """Return what `contacts` or `info` stands for, state by state, as texts."""
        texts = [repr(one) for one in self.facts[name]]
        return [texts[int(number)] for number in self.arrays[name]]


@dataclass(frozen=True)
class Bank:
    """States of one environment, the noise of each, and the typical size of each number of each output.

    `states` has an array (states, numbers) for each part. `noise` has the largest difference that a twin made, in
    typical sizes: (states,), of `stages` (states, stages). `scales` has the shape of one row of an output. `outputs`
    are those of the cell that made the bank, where the file has them.
    """

    states: Mapping[str, Array]
    noise: Mapping[str, Array]
    scales: Mapping[str, Array]
    facts: Mapping[str, Any]
    outputs: Outputs | None = None

    @classmethod
    def of(cls, arrays: Mapping[str, Array], facts: Mapping[str, Any]) -> Bank:
        """Return the bank in a file of arrays."""
        states = {name: array for name, array in arrays.items() if "." not in name or name.startswith("state.")}
        outputs = Outputs(_below(arrays, "out."), facts)
        noise, scales = _below(arrays, "noise."), _below(arrays, "scale.")
        return cls(states, noise, scales, facts, outputs if outputs.arrays else None)

    @property
    def size(self) -> int:
        """Return the number of states."""
        return len(self.states["action"])

    def scaled_by(self, outputs: Outputs) -> Bank:
        """Return the bank with typical sizes taken from other outputs, whose arrays have other shapes."""
        scales = {name: typical_sizes(array) for name, array in outputs.arrays.items()}
        return replace(self, scales={**self.scales, **scales})


def typical_sizes(array: Array) -> Array:
    """Return the typical size of each number of an output: its median, a millionth of the largest at least."""
    sizes = np.abs(array)
    largest = float(np.max(sizes)) if sizes.size else 1.0
    return np.asarray(np.maximum(np.median(sizes, axis=0), LEAST_SCALE * max(1e-300, largest)))


def _below(arrays: Mapping[str, Array], prefix: str) -> dict[str, Array]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
