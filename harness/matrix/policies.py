"""Read the file of a policy: weights of a linear one, as `benchmarks/linear_policy.py` writes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from harness.model import decoding
from harness.model.hostile_data import Unreadable, raise_unreadable

MOST_BYTES = 512 << 10
SCRIPTED = "metaworld"
"""The name of the policies that Meta-World brings, one for each task."""


class Scale(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The mean return of random actions and of the policy, when it was made."""

    random: float
    policy: float


class LinearPolicy(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of a policy. Observations are normalised by `mean` and `deviation`; each row of weights is an action's."""

    form: Literal[1]
    env: str
    origin: dict[str, Any]
    scale: Scale
    mean: Annotated[tuple[float, ...], Meta(min_length=1)]
    deviation: tuple[Annotated[float, Meta(gt=0)], ...]
    weights: Annotated[tuple[tuple[float, ...], ...], Meta(min_length=1)]


def read(content: bytes) -> dict[str, Any]:
    """Return the policy in a file as a case holds it. Raises Unreadable."""
    with raise_unreadable():
        policy = decoding.decoder(LinearPolicy).decode(content)
    if {len(policy.deviation), *map(len, policy.weights)} != {len(policy.mean)}:
        message = "`mean`, `deviation` and each row of `weights` have to have one length"
        raise Unreadable(message)
    if policy.scale.policy <= policy.scale.random:
        message = "its return is not above that of random actions, so no difference can be told in points"
        raise Unreadable(message)
    plain: dict[str, Any] = {name: getattr(policy, name) for name in ("mean", "deviation", "weights")}
    return {"by": "linear", "gain": policy.scale.policy - policy.scale.random, **plain}


def of_case(name: str | None, episodes: int, policies: Mapping[str, Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the policy that a case names, with the episodes that it plays; None where it names none."""
    if name is None:
        return None
    return {**({"by": SCRIPTED} if name == SCRIPTED else policies[name]), "episodes": episodes}
