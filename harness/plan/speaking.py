"""Which adapter an environment id means, and what is tried of a package when no environment is named.

An adapter without a row here needs its name before an id, or `--api`.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from typing import NamedTuple

from harness.vocabulary import APIS, FAMILY, required_name


class Speaker(NamedTuple):
    """The package that brings an API, what its environment ids look like, and a small one that it always has."""

    api: str
    package: str
    ids: str
    example: str


SPEAKERS = (
    Speaker("brax", "brax", r"[a-z][a-z0-9_]*", "brax:ant"),
    Speaker("dm_control", "dm-control", r"\w+/\w+", "dm_control:cheetah/run"),
    Speaker("isaaclab", "isaaclab", r"Isaac-[\w-]+", "isaaclab:Isaac-Cartpole-Direct"),
    Speaker("mjx", "mujoco-mjx", r".+\.xml", "mjx:sphere"),
    Speaker("mujoco", "mujoco", r".+\.xml|markers", "mujoco:markers"),
    Speaker("mujoco_warp", "mujoco-warp", r".+\.xml", "mujoco_warp:sphere"),
    Speaker("newton", "newton", r".+\.xml", "newton:sphere"),
    Speaker("pettingzoo", "pettingzoo", r"(aec:)?[a-z]+/\w+[_-]v\d+", "pettingzoo:classic/rps_v2"),
    Speaker("pybullet", "pybullet", r"direct|.+\.(urdf|sdf|xml)", "pybullet:direct"),
    Speaker("robosuite", "robosuite", r"(GymWrapper\()?[A-Z][A-Za-z]+\)?", "robosuite:Lift"),
)


BRING_MODELS = frozenset({"pybullet"})
"""The APIs whose package brings models of its own, which environments name as they would a file of the user's."""


def speakers(requirements: Iterable[str]) -> tuple[Speaker, ...]:
    """The adapters whose own package is asked for, in that order; gym and gymnasium apart."""
    rows = {row.package: row for row in SPEAKERS if row.api in APIS}
    return tuple(rows[name] for name in dict.fromkeys(map(required_name, requirements)) if name in rows)


def spoken(env: str, requirements: Collection[str]) -> str | None:
    """The API of an id without one, by what is asked for: gym or gymnasium where that is named, the first of both."""
    named = next((name for name in map(required_name, requirements) if name in FAMILY), None)
    return named or meant(env, requirements)


def meant(env: str, requirements: Collection[str]) -> str | None:
    """The API that an id without one can only mean, by what is asked for: None where it may be another's, too."""
    if any(required_name(text) in FAMILY for text in requirements):
        return None
    found = [row.api for row in speakers(requirements) if re.fullmatch(row.ids, env)]
    return found[0] if len(found) == 1 else None
