"""Tie known failures to a text: a common line alone names no package, so its words have to speak of one."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Container, Optional

from ..requirements import named
from .matching import Look

BY_LINE, BY_PACKAGES = "line", "packages"
"""The two words for `ties` of a signature: its line alone is enough, or each of its packages has to be named."""

TOOLS = {
    "pip": re.compile(r"^(?:ERROR|WARNING): |^Collecting |which is incompatible\.$", re.MULTILINE),
    "uv": re.compile(r"No solution found|we can conclude that|^ {2}cause: |╰─▶|^hint: ", re.MULTILINE),
    "conda": re.compile(r"libmamba|^(?:Collecting package metadata|Solving environment)", re.MULTILINE),
}
"""Whoever prints such lines is there, without a name."""

WORDS = {
    "box2d-py": re.compile(r"\b[Bb]ox2[dD]\b"),
    "gymnasium": re.compile(r"\bGymnasium\b"),
    "isaaclab": re.compile(r"\bisaac[ _]?lab|\bomni\.isaac\.lab", re.IGNORECASE),
    "isaacsim": re.compile(r"\bisaac[ _]?sim|\bomni\.(?:isaac|kit|usd)\b|\bcarb\b", re.IGNORECASE),
    "mujoco": re.compile(r"\bmj_\w+\(|\bmj[A-Z]\w+|XML Error: "),
    "opencv-python": re.compile(r"\bcv2\b|\bopencv\b", re.IGNORECASE),
    "pyopengl": re.compile(r"\bOpenGL\b|\begl[A-Z]\w+|\b(?:EGL|GLX|OSMesa)Platform\b"),
    "robosuite": re.compile(r"\brobosuite\b", re.IGNORECASE),
    "setuptools": re.compile(r"pkg_resources|distutils"),
    "stable-baselines3": re.compile(r"\bsb3\b", re.IGNORECASE),
    "torch": re.compile(r"Weights only load failed|^RuntimeError: CUDA error: |\bcuda:\d+ device type", re.MULTILINE),
}
"""Other names of a package, and words that only this package prints."""


def is_tied(signature: Any, text: str, installed: Optional[Container[str]] = None) -> bool:
    """Return whether a text, or a package that is installed, ties a known failure to its package.

    Without `ties` each of its packages has to be named; one without packages is tied by its line.
    """
    ties = signature.ties
    if BY_LINE in ties or (not ties and not signature.packages):
        return True
    if not ties or BY_PACKAGES in ties:
        return mentions_packages(signature, text)
    return any(_has_word(word, text) or named_by(word) in (installed or ()) for word in ties)


def is_refuted(signature: Any, text: str, look: Look) -> bool:
    """Return whether all that the text names of a part is there in other versions."""
    for part in signature.packages:
        results = [(look(each), named(each)) for each in part]
        if any(there is False for there, _ in results) and not any(
            there or (there is None and speaks_of(name, text)) for there, name in results
        ):
            return True
    return False


def named_by(word: str) -> str:
    """Return the name under which a word of a tie would be installed."""
    return word.lower().replace("_", "-")


def mentions_packages(signature: Any, text: str) -> bool:
    """Return whether a text speaks of each package that takes part."""
    return all(any(speaks_of(named(each), text) for each in part) for part in signature.packages)


def speaks_of(name: str, text: str) -> bool:
    """Return whether a text names a package, its module, or what only this package prints."""
    if any(name in known and known[name].search(text) for known in (TOOLS, WORDS)):
        return True
    return _has_word("[-_.]".join(map(re.escape, name.split("-"))), text)


@lru_cache(maxsize=None)
def _compiled(word: str) -> re.Pattern[str]:
    return re.compile("(?<![A-Za-z0-9])(?:" + word + ")(?![A-Za-z0-9])", re.IGNORECASE)


def _has_word(word: str, text: str) -> bool:
    return _compiled(word).search(text) is not None
