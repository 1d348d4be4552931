"""Read pip's requirements.txt."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from harness.model import IndexSettings
from harness.model.errors import BadInput
from harness.packages.requirement_files.entry import (
    Include,
    Inputs,
    Parsed,
    Source,
    check_number,
    requirement,
    shorten,
)

COMMENT = re.compile(r"(?:^|(?<=\s))#")
UNQUOTED = re.compile(r"""(?:[^\s"'\\]|\\.|'[^']*'|"(?:[^"\\]|\\.)*")+""")
QUOTED = re.compile(r"""'([^']*)'|"((?:[^"\\]|\\.)*)"|\\(.)""")
"""A word of a shell, and its quotes: `shlex` takes a second for 64 KB."""


def requirements_txt(text: str, source: Source) -> Parsed:
    """Read a text in pip's format."""
    return read_lines(_logical(text), source)


def read_lines(lines: Iterable[tuple[int, str]], source: Source) -> Parsed:
    """Read numbered lines in pip's format."""
    inputs, includes, hashed = Inputs(), [], 0
    listed = list(lines)
    check_number(len(listed), source)
    for number, raw in listed:
        where = f"{source.name}:{number}"
        # As in pip: only upper-case names in braces, and an unset variable stays as it is written.
        line = re.sub(r"\$\{([A-Z0-9_]+)\}", lambda match: source.variables.get(match[1], match[0]), raw)
        if line.startswith("-"):
            for option, value in _options(line, where):
                if option in {"--requirement", "--constraint"} and value:
                    includes.append(Include(path=value, constraint=option == "--constraint", where=where))
                else:
                    inputs += _option(option, value, source, where)
            continue
        wanted, _, options = line.partition(" --")
        hashed += "hash" in options
        inputs += requirement(wanted.strip(), source, where)
        inputs += _more(options, where)
    if hashed:
        note = f"{source.name}: the hashes of {hashed} requirements are not asked for; a lock records its own"
        inputs += Inputs(notes=(note,))
    return Parsed(inputs=inputs, includes=tuple(includes))


def _logical(text: str) -> Iterator[tuple[int, str]]:
    """Yield lines with the number of their first part: continued ones joined, comments and blank ones dropped."""
    start, parts = 0, list[str]()
    for number, line in enumerate([*text.removeprefix("\ufeff").splitlines(), ""], 1):
        start = start or number
        if line.endswith("\\") and not line.lstrip().startswith("#"):
            parts.append(line[:-1])
            continue
        whole = " ".join([*parts, line])
        if comment := COMMENT.search(whole):
            whole = whole[: comment.start()]
        if whole := whole.strip():
            yield start, whole
        start, parts = 0, []


_SHORT = {"-r": "--requirement", "-c": "--constraint", "-e": "--editable", "-i": "--index-url", "-f": "--find-links"}
_FLAGS = {"--no-index", "--pre", "--prefer-binary", "--require-hashes"}


def _options(line: str, where: str) -> Iterator[tuple[str, str]]:
    """Yield the option and value pairs of a line: `-r x`, `-rx`, `--pre`, `--index-url=x`."""
    if UNQUOTED.sub("", line).strip():
        message = f"{where}: '{shorten(line)}' cannot be read: No closing quotation"
        raise BadInput(message)
    words = iter([QUOTED.sub(_bare, word) for word in UNQUOTED.findall(line)])
    for word in words:
        option, separator, value = word.partition("=")
        if word[:2] in _SHORT:
            option, value = _SHORT[word[:2]], word[2:].removeprefix("=")
        if not separator and not value and option not in _FLAGS:
            value = next(words, "")
        yield option, value


def _bare(match: re.Match[str]) -> str:
    """Return the text between quotes, or after a backslash."""
    if match[1] is not None:
        return match[1]
    return match[3] if match[2] is None else re.sub(r'\\(["\\])', r"\1", match[2])


def _option(option: str, value: str, source: Source, where: str) -> Inputs:
    packages = tuple(part.strip() for part in value.split(",") if part.strip())
    located = value if "://" in value else str(source.folder / value)
    modelled = {
        "--index-url": Inputs(index=IndexSettings(default=value)),
        "--extra-index-url": Inputs(index=IndexSettings(extra=(value,))),
        "--find-links": Inputs(index=IndexSettings(find_links=(located,))),
        "--no-index": Inputs(index=IndexSettings(no_index=True)),
        "--pre": Inputs(prerelease="allow"),
        "--only-binary": Inputs(only_binary=packages),
        "--require-hashes": Inputs(),
        "--editable": Inputs(not_modelled=(f"{where}: -e {value}: editable installs are not supported",)),
    }
    text = f"{option} {value}".strip()
    return modelled.get(option, Inputs(not_modelled=(f"{where}: {text}: this option is not supported",)))


def _more(options: str, where: str) -> Inputs:
    """Return the options behind a requirement, except hashes, as not modelled."""
    others = [one for one in options.split(" --") if one and not one.startswith("hash")]
    return Inputs(not_modelled=tuple(f"{where}: --{one.strip()}: this option is not supported" for one in others))
