"""Hold what the rules of this room see of a failure, and what they answer."""

from __future__ import annotations

import re
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Tuple

from ..explain.api_history import PYTHON, History, Load, package_of
from ..explain.failure_text import QUOTED, Failure
from ..failures.matching import compile_once

QUOTE = "[`'\"\u2018\u2019\u201c\u201d]"
WORD = r"[A-Za-z_]\w*"
DOTTED = r"[A-Za-z_][\w.]*"
PACKAGE = r"[A-Za-z0-9](?:[A-Za-z0-9._-]*[A-Za-z0-9])?"
FRAME = r"(?:site|dist)-packages[/\\](\w+)[/\\.]"
SOURCE = r'^ *File "([^"]+)", line \d+, in (\S+)(?:\n +(.+))?'


RARE = 8
"""Letters of a word with an underscore that nobody's own class has by accident."""

EVERYBODYS = frozenset(
    "A2C Actor ActorCritic Agent Buffer Config Controller Critic Dataset Decoder Encoder EnvWrapper Game GymWrapper"
    " Logger Memory Model Net Network Node PPO Player Policy ReplayBuffer Robot Runner Sampler State Task Trainer"
    " Worker Wrapper".split()
)
"""Names of classes that users give to their own, too."""


class Cause(NamedTuple):
    """A derived cause: the package or file at fault, one or two sentences, and the remedy as documents hold it.

    `asker` is the package whose requirement excludes the subject, where that is the conflict.
    """

    subject: str
    text: str
    remedy: Mapping[str, Any]
    asker: str = ""


Causes = Iterator[Cause]


class Pattern:
    """A regular expression that is compiled only when a text has one of its literals: most rules see no text of theirs.

    `^` and `$` are the ends of a line.
    """

    def __init__(self, expression: str, *literals: str) -> None:
        self.expression = expression
        self.literals = literals

    def search(self, text: str) -> Optional[re.Match[str]]:
        """Return the first match in a text."""
        if self.literals and not any(literal in text for literal in self.literals):
            return None
        return compile_once(self.expression).search(text)


class Scene(NamedTuple):
    """A failure and what is known around it: versions by package, `3.N` of Python, and how to load a history.

    `installed` is None where no environment is known.
    """

    failure: Failure
    versions: Mapping[str, str]
    installed: Optional[Mapping[str, str]]
    python: Optional[str]
    load: Load

    @property
    def is_pasted(self) -> bool:
        """Return whether the text is a line or two without the traceback that would decide."""
        return self.failure.text.count("\n") < QUOTED and not self.frames

    @property
    def frames(self) -> List[Tuple[str, str, str]]:
        """Return the frames of the traceback that decides, the innermost last: path, function, line of source."""
        region = self.failure.region or self.failure.text
        matches = compile_once(SOURCE).finditer(region) if "File " in region else ()
        return [(match.group(1), match.group(2), match.group(3) or "") for match in matches]

    @property
    def modules(self) -> List[str]:
        """Return the top-level modules of installed packages that the traceback runs through, the innermost first."""
        return list(dict.fromkeys(reversed(compile_once(FRAME).findall(self.failure.region))))

    @property
    def is_own(self) -> bool:
        """Return whether the user's own code raised: the innermost frame lies in no installed package."""
        frames = self.frames
        return bool(frames) and re.search(r"(?:site|dist)-packages|[/\\]lib[/\\]python3", frames[-1][0]) is None

    def speaks_of(self, *names: str) -> bool:
        """Return whether the text names one of several packages or modules."""
        return any(
            re.search(r"(?<![A-Za-z0-9])" + re.escape(name) + r"(?![A-Za-z0-9])", self.failure.text, re.IGNORECASE)
            for name in names
        )

    def is_tied(self, owner: str, word: str, package: str) -> bool:
        """Return whether a class and a word of it mean a package: anybody may have written a class of a usual name."""
        rare = len(word) > RARE and "_" in word
        return (
            rare or owner not in EVERYBODYS or not self.is_pasted or self.speaks_of(package, package.replace("-", "_"))
        )

    def history(self, package: str) -> Optional[History]:
        """Return the history of a package, unless the environment at hand lacks the package."""
        if self.installed is not None and package not in self.installed and package != PYTHON:
            return None
        return self.load(package)

    def history_with(self, module: str) -> Optional[History]:
        """Return the history of the package that has a module, by its dotted name."""
        package = package_of(module)
        if package is None:
            python = self.history(PYTHON)
            is_part = python is not None and module.partition(".")[0] in python.plain.get("modules", {})
            return python if is_part else None
        return self.history(package)


def requirement_remedy(requirement: str, text: str = "") -> Dict[str, Any]:
    """Return the remedy that installs one requirement; `text` is a second way."""
    return {"requirements": [requirement], "text": text} if text else {"requirements": [requirement]}
