"""Hold the contents of a requirement file, and read one requirement of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from urllib.parse import unquote, urlsplit

from packaging.requirements import InvalidRequirement
from packaging.specifiers import SpecifierSet
from packaging.utils import parse_sdist_filename, parse_wheel_filename

from harness.model import IndexSettings, requirement_texts
from harness.model.errors import BadInput

ARCHIVES = (".whl", ".tar.gz", ".zip")
MOST = 2_000
"""Requirements of a file."""

CONDA_PACKAGE = "conda packages are not supported"
"""The reason why no lock has a package of conda; `Inputs.conda` has the release of it."""

LONGEST_QUOTE = 200
"""Characters of a file that a message quotes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Inputs:
    """The contents of requirement files. `python` is a specifier (`>=3.9,<3.12`); `prerelease` None means not given.

    `conda` are packages that conda would install, as requirements of the same releases. `not_modelled` are sentences
    that begin with file and line; `notes` say what was read differently than pip would.
    """

    requirements: tuple[str, ...] = ()
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    only_binary: tuple[str, ...] = ()
    prerelease: str | None = None
    index: IndexSettings = field(default_factory=IndexSettings)
    python: str | None = None
    conda: tuple[str, ...] = ()
    not_modelled: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __add__(self, other: Inputs) -> Inputs:
        """Return both together; the later one decides where only one value is possible."""
        python = self.python or other.python
        if self.python and other.python:
            python = str(SpecifierSet(self.python) & SpecifierSet(other.python))
        index = IndexSettings(
            default=other.index.default or self.index.default,
            extra=self.index.extra + other.index.extra,
            find_links=self.index.find_links + other.index.find_links,
            no_index=self.index.no_index or other.index.no_index,
        )
        return Inputs(
            requirements=self.requirements + other.requirements,
            constraints=self.constraints + other.constraints,
            overrides=self.overrides + other.overrides,
            build_constraints=self.build_constraints + other.build_constraints,
            only_binary=self.only_binary + other.only_binary,
            prerelease=other.prerelease or self.prerelease,
            index=index,
            python=python,
            conda=self.conda + other.conda,
            not_modelled=self.not_modelled + other.not_modelled,
            notes=self.notes + other.notes,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Source:
    """A file being read: its name in messages, its folder (absolute), and the variables it may refer to."""

    name: str
    folder: Path
    variables: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, slots=True)
class Include:
    """A reference to another file: `-r FILE` or `-c FILE`."""

    path: str
    constraint: bool
    where: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Parsed:
    """The contents of a text, the files that it includes, and the extras and groups that it defines."""

    inputs: Inputs
    includes: tuple[Include, ...] = ()
    extras: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()


def requirement(text: str, source: Source, where: str) -> Inputs:
    """Read one requirement: PEP 508, or the address or path of an archive."""
    bare, separator, marker = text.partition(";")
    try:
        parsed = requirement_texts.requirement(text)
    except InvalidRequirement as error:
        if "/" not in bare and not bare.strip().endswith(ARCHIVES):
            message = f"{where}: '{shorten(text)}' is not a requirement: {str(error).splitlines()[0]}"
            raise BadInput(message) from None
        url, name = bare.strip(), _archive_name(bare.strip())
    else:
        if parsed.url is None:
            return Inputs(requirements=(text,))
        url, name = parsed.url, text.partition("@")[0].strip()
    if why := _unpinnable(url, name):
        return Inputs(not_modelled=(f"{where}: {url}: {why}",))
    address = url if "://" in url else (source.folder / url.removeprefix("file:")).as_uri()
    return Inputs(requirements=(f"{name} @ {address} {separator}{marker}".strip(),))


def _unpinnable(url: str, name: str) -> str | None:
    if re.match(r"(git|hg|svn|bzr)\+", url):
        return "a repository cannot be pinned by hash; build a wheel of it and name that"
    if not urlsplit(url).path.endswith(ARCHIVES):
        return "a folder cannot be pinned by hash; build a wheel of it and name that"
    return None if name else "the address does not say which package it is; write NAME @ ADDRESS"


def _archive_name(address: str) -> str:
    """Return the package named by a wheel's or an sdist's file name; empty if it names none."""
    filename = unquote(PurePath(urlsplit(address).path).name)
    try:
        return (parse_wheel_filename if filename.endswith(".whl") else parse_sdist_filename)(filename)[0]
    except ValueError:
        return ""


def where_in(text: str, pattern: str, source: Source) -> str:
    """Return the file and the line where the first match of a pattern ends; the file alone without a match."""
    match = re.search(pattern, text)
    return f"{source.name}:{text.count(chr(10), 0, match.end()) + 1}" if match else source.name


def check_number(count: int, source: Source) -> None:
    """Refuse a file of more requirements than any environment has packages. Raises BadInput."""
    if count > MOST:
        message = f"{source.name}: asks for {count:,} packages, at most {MOST:,} can be"
        raise BadInput(message)


def shorten(text: str) -> str:
    """Shorten a text that a message quotes to `LONGEST_QUOTE` characters."""
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}..."


def quote(value: str) -> str:
    """Return a pattern for a TOML string that begins like the value; what follows a quote inside may be escaped."""
    return "[\"']" + re.escape(value.partition('"')[0])
