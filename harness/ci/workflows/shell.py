"""Find the packages that the commands of a step install, as far as their text shows."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

VALUED = frozenset(
    """-r --requirement --requirements -c --constraint --constraints -i --index-url --extra-index-url --index
    --default-index -f --find-links -p --python -t --target --prefix --root --src --upgrade-package -P --override
    --build-constraint --no-binary --only-binary --exclude-newer --torch-backend --cache-dir --timeout --retries
    --config-settings -C --platform --python-version --link-mode --index-strategy --resolution --prerelease --log
    -n --name --channel --file""".split()  # noqa: SIM905 - read as one types them
)
"""Options whose next word belongs to them."""

MARK = re.compile("\x01([^\x02]*)\x02|\x03")
"""Around what was put in for an expression: names, then the value."""

_OPENING = frozenset({"then", "else", "do", "!", "fi", "done"})
_PIP = re.compile(r"pip[\d.]*$")
_PYTHON = re.compile(r"python[\d.]*$")
_CONDA = frozenset({"conda", "mamba", "micromamba"})
_SIGNS = frozenset({"&&", "||", ";", "|", "&", "(", ")", "\n"})


@dataclass(frozen=True, kw_only=True, slots=True)
class Install:
    """One command that installs: its words (requirements, paths, addresses), files that it takes more from."""

    words: tuple[str, ...]
    files: tuple[str, ...] = ()
    upgrade: bool = False
    removes: bool = False


def remove_marks(text: str) -> str:
    """Return the text without the marks that name the sources of its values."""
    return MARK.sub("", text)


def commands(script: str) -> Iterator[list[str]]:
    """Yield the simple commands of a script, as words, without branches of an `if` that its text decides against."""
    branches: list[_Branch] = []
    testing: list[list[str]] | None = None
    for words in _simple(script):
        if words[0] in {"if", "elif"}:
            branches += [_Branch()] if words[0] == "if" else []
            testing = [words[1:]]
        elif words[0] == "then" and testing is not None and branches:
            # A test of several commands, such as `a || b`, is not decided, so no branch is left out because of it.
            branches[-1].enter(_test(testing[0]) if len(testing) == 1 else None)
            testing = None
        elif testing is not None:
            testing.append(words)
        elif words[0] == "else" and branches:
            branches[-1].enter(True)
        elif words[0] == "fi" and branches:
            branches.pop()
        command = words[1:] if words[0] in _OPENING else words
        if command and testing is None and all(branch.runs for branch in branches):
            yield command


@dataclass(slots=True)
class _Branch:
    """The current branch of an `if`: whether it may run, and whether an earlier branch surely has."""

    runs: bool = True
    settled: bool = False

    def enter(self, holds: bool | None) -> None:
        """Go on to the next branch, whose test holds, does not, or cannot be told (None)."""
        self.runs = holds is not False and not self.settled
        self.settled = self.settled or holds is True


def _test(words: Sequence[str]) -> bool | None:
    """Return the result of a test such as `[ a = b ]`, None unless it is all text."""
    inner = [remove_marks(word) for word in words[1:] if word not in {"]", "]]"}]
    if words[:1] not in (["["], ["[["], ["test"]) or any("$" in word or "`" in word for word in inner):
        return None
    match inner:
        # In `[[ ]]` a star makes a pattern, which is not decided here.
        case [one, "=" | "==", other] if "*" not in other:
            return one == other
        case [one, "!=", other] if "*" not in other:
            return one != other
        case ["-n", text]:
            return bool(text)
        case ["-z", text]:
            return not text
    return None


def _simple(script: str) -> Iterator[list[str]]:
    """Yield the commands one by one. A line that cannot be split into words is left out."""
    for line in re.sub(r"\\\r?\n", " ", script).splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=";|&()")
        lexer.whitespace_split = True
        lexer.commenters = "#"
        try:
            words = list(lexer)
        except ValueError:  # a quote that ends on another line
            continue
        command: list[str] = []
        for word in [*words, ";"]:
            if word not in _SIGNS:
                command.append(word)
            elif command:
                yield command
                command = []


def python_of(words: Sequence[str]) -> str | None:
    """Return the Python that `uv venv --python` or `conda create python=` names, None for other commands."""
    if list(words[:2]) == ["uv", "venv"]:
        named = [word for option, word in pairwise(words) if option in {"-p", "--python"}]
        named += [word.partition("=")[2] for word in words if word.startswith("--python=")]
        return named[-1] if named else None
    if words and words[0] in _CONDA:
        named = [word.removeprefix("python").lstrip("=") for word in words if re.match(r"python=", word)]
        return named[-1] if named else None
    return None


def install(words: Sequence[str]) -> Install | None:
    """Return the packages that a command installs or removes, None for other commands."""
    rest = _arguments(words)
    if rest is None:
        return None
    verb, arguments = rest
    plain: list[str] = []
    files: list[str] = []
    upgrade = False
    waiting = iter(arguments)
    for word in waiting:
        option, _, value = word.partition("=")
        if word in {"-U", "--upgrade"}:
            upgrade = True
        elif option in VALUED:
            value = value or next(waiting, "")
            files += [value] if option in {"-r", "--requirement", "--requirements", "--file"} else []
        elif not word.startswith("-"):
            plain.append(word)
    # conda pins with a single `=`.
    if words[0] in _CONDA:
        plain = [re.sub(r"(?<![=<>!~])=(?!=)", "==", word, count=1) for word in plain]
    return Install(words=tuple(plain), files=tuple(files), upgrade=upgrade, removes=verb == "uninstall")


def _arguments(words: Sequence[str]) -> tuple[str, Sequence[str]] | None:
    """Return the verb of an installing command and the words after it, None for other commands."""
    rest = list(words)
    while rest and (re.match(r"\w+=", rest[0]) or rest[0] in {"sudo", "time", "exec", "-E"}):
        rest.pop(0)
    name = rest[0].rpartition("/")[2] if rest else ""
    if name == "uv" and rest[1:2] == ["pip"]:
        rest = rest[1:]
    elif _PYTHON.match(name) and rest[1:2] == ["-m"]:
        rest = rest[2:]
    elif not _PIP.match(name) and name not in _CONDA:
        return None
    installer = rest and (_PIP.match(rest[0].rpartition("/")[2]) or rest[0] in _CONDA)
    verbs = [index for index, word in enumerate(rest) if word in {"install", "uninstall", "create"}]
    if not installer or not verbs:
        return None
    return rest[verbs[0]], rest[verbs[0] + 1 :]
