"""What requirement files ask for, from their text: requirements.txt, pyproject.toml, pylock.toml, environment.yml.

A line that cannot be modelled is named by file and line in `Inputs.not_modelled`; one that is wrong is BadInput.
"""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import unquote, urlsplit

from packaging.dependency_groups import resolve_dependency_groups
from packaging.pylock import Package, Pylock, PylockValidationError
from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name, parse_sdist_filename, parse_wheel_filename

from harness import schema
from harness.errors import BadInput
from harness.model import IndexSettings

ARCHIVES = (".whl", ".tar.gz", ".zip")

UNMODELLED_REPOSITORY = "a repository cannot be pinned by hash; build a wheel of it and name that"
UNMODELLED_FOLDER = "a folder cannot be pinned by hash; build a wheel of it and name that"


@dataclass(frozen=True, kw_only=True, slots=True)
class Inputs:
    """What files ask for. `python` is a specifier (`>=3.9,<3.12`); `prerelease` None means not said.

    `not_modelled` are sentences that begin with file and line; `notes` say what was read differently than pip would.
    """

    requirements: tuple[str, ...] = ()
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    only_binary: tuple[str, ...] = ()
    prerelease: str | None = None
    index: IndexSettings = field(default_factory=IndexSettings)
    python: str | None = None
    not_modelled: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __add__(self, other: Inputs) -> Inputs:
        """Both together; the later one decides where only one can."""
        both = SpecifierSet(self.python or "") & SpecifierSet(other.python or "")
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
            python=str(both) or None,
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
    """`-r FILE` or `-c FILE` in a file."""

    path: str
    constraint: bool
    where: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Parsed:
    """What a text asks for, and the files that it names."""

    inputs: Inputs
    includes: tuple[Include, ...] = ()
    extras: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()


# --- requirements.txt ------------------------------------------------------------------------------------------


def requirements_txt(text: str, source: Source) -> Parsed:
    """Read pip's format."""
    return _lines(_logical(text), source)


def _lines(lines: Iterable[tuple[int, str]], source: Source) -> Parsed:
    found, includes, hashed = Inputs(), [], 0
    for number, raw in lines:
        where = f"{source.name}:{number}"
        line = re.sub(r"\$\{([A-Z0-9_]+)\}", lambda match: source.variables.get(match[1], match[0]), raw)
        if line.startswith("-"):
            for option, value in _options(line, where):
                if option in {"--requirement", "--constraint"} and value:
                    includes.append(Include(path=value, constraint=option == "--constraint", where=where))
                else:
                    found += _option(option, value, source, where)
            continue
        wanted, _, options = line.partition(" --")
        hashed += "hash" in options
        found += _requirement(wanted.strip(), source, where)
        found += _more(options, where)
    if hashed:
        note = f"{source.name}: the hashes of {hashed} requirements are not asked for; a lock records its own"
        found += Inputs(notes=(note,))
    return Parsed(inputs=found, includes=tuple(includes))


def _logical(text: str) -> Iterator[tuple[int, str]]:
    """Lines with the number of their first part: continued ones joined, comments and blank ones gone."""
    start, parts = 0, ""
    for number, line in enumerate([*text.removeprefix("\ufeff").splitlines(), ""], 1):
        start = start or number
        if line.endswith("\\") and not line.lstrip().startswith("#"):
            parts += line[:-1] + " "
            continue
        whole = re.sub(r"(^|\s+)#.*$", "", parts + line).strip()
        if whole:
            yield start, whole
        start, parts = 0, ""


_SHORT = {"-r": "--requirement", "-c": "--constraint", "-e": "--editable", "-i": "--index-url", "-f": "--find-links"}
_FLAGS = {"--no-index", "--pre", "--prefer-binary", "--require-hashes"}


def _options(line: str, where: str) -> Iterator[tuple[str, str]]:
    """Option and value pairs of a line: `-r x`, `-rx`, `--pre`, `--index-url=x`."""
    try:
        words = iter(shlex.split(line))
    except ValueError as error:
        message = f"{where}: '{line}' cannot be read: {error}"
        raise BadInput(message) from None
    for word in words:
        option, separator, value = word.partition("=")
        if word[:2] in _SHORT:
            option, value = _SHORT[word[:2]], word[2:].removeprefix("=")
        if not separator and not value and option not in _FLAGS:
            value = next(words, "")
        yield option, value


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
        "--editable": Inputs(not_modelled=(f"{where}: -e {value}: editable installs are not modelled",)),
    }
    said = f"{option} {value}".strip()
    return modelled.get(option, Inputs(not_modelled=(f"{where}: {said}: this option is not modelled",)))


def _more(options: str, where: str) -> Inputs:
    """Options behind a requirement, hashes apart."""
    others = [one for one in options.split(" --") if one and not one.startswith("hash")]
    return Inputs(not_modelled=tuple(f"{where}: --{one.strip()}: this option is not modelled" for one in others))


def _requirement(text: str, source: Source, where: str) -> Inputs:
    """One requirement: PEP 508, or the address or path of an archive."""
    try:
        url = Requirement(text).url
    except InvalidRequirement as error:
        if "/" not in text and not text.endswith(ARCHIVES):
            message = f"{where}: '{text}' is no requirement: {str(error).splitlines()[0]}"
            raise BadInput(message) from None
        url, text = text, f"{_archive_name(text)} @ {_address(text, source)}"
    if url is None:
        return Inputs(requirements=(text,))
    if re.match(r"(git|hg|svn|bzr)\+", url):
        return Inputs(not_modelled=(f"{where}: {url}: {UNMODELLED_REPOSITORY}",))
    if not urlsplit(url.partition(";")[0].strip()).path.endswith(ARCHIVES):
        return Inputs(not_modelled=(f"{where}: {url}: {UNMODELLED_FOLDER}",))
    return Inputs(requirements=(text,))


def _archive_name(text: str) -> str:
    """The package that a wheel's or an sdist's file name tells; empty when it tells none."""
    filename = unquote(PurePath(urlsplit(text.partition(";")[0].strip()).path).name)
    try:
        return (parse_wheel_filename if filename.endswith(".whl") else parse_sdist_filename)(filename)[0]
    except ValueError:
        return ""


def _address(text: str, source: Source) -> str:
    path, separator, marker = text.partition(";")
    address = path.strip() if "://" in path else (source.folder / path.strip()).as_uri()
    return f"{address} {separator}{marker}".strip()


# --- pyproject.toml --------------------------------------------------------------------------------------------


def pyproject(text: str, source: Source, extras: Iterable[str], groups: Iterable[str]) -> Parsed:
    """Read the dependencies of a project, with some of its extras and dependency groups; the project stays out."""
    document = schema.load_toml(text, dict[str, Any], source.name)
    project, tool = document.get("project", {}), document.get("tool", {})
    optional: dict[str, list[str]] = {
        canonicalize_name(name): lines for name, lines in project.get("optional-dependencies", {}).items()
    }
    grouped = document.get("dependency-groups", {})
    known = {canonicalize_name(name): name for name in grouped}
    wanted = list(project.get("dependencies", ()))
    wanted += _with_extras(canonicalize_name(project.get("name", "")), optional, extras)
    with schema.located(source.name, "dependency-groups"):
        chosen = [known[name] for group in groups if (name := canonicalize_name(group)) in known]
        wanted += resolve_dependency_groups(grouped, *chosen)
    found = Inputs(python=project.get("requires-python"), not_modelled=tuple(_unread(text, source, project, tool)))
    for line in dict.fromkeys(wanted):
        found += _requirement(line, source, _where(text, _quoted(line), source))
    found += _uv_table(text, tool.get("uv", {}), source)
    return Parsed(inputs=found, extras=tuple(optional), groups=tuple(known))


def _with_extras(project: str, optional: Mapping[str, Sequence[str]], extras: Iterable[str]) -> list[str]:
    """The lines of extras; one that names the project itself (`all = ["project[mujoco]"]`) stands for its extras."""
    lines: list[str] = []
    waiting = [canonicalize_name(extra) for extra in extras]
    for extra in waiting:
        for line in optional.get(extra, ()):
            own = re.fullmatch(r"([\w.-]+)\s*\[([^]]*)\]\s*", line)
            if own and canonicalize_name(own[1]) == project:
                more = [canonicalize_name(name.strip()) for name in own[2].split(",")]
                waiting += [name for name in more if name not in waiting]
            else:
                lines.append(line)
    return lines


def _unread(text: str, source: Source, project: Mapping[str, Any], tool: Mapping[str, Any]) -> Iterator[str]:
    for name in project.get("dynamic", ()):
        if name in {"dependencies", "optional-dependencies", "requires-python"}:
            where = _where(text, rf"(?s)dynamic\s*=.*?{_quoted(name)}", source)
            yield f"{where}: {name} is dynamic: only a build of the project tells it"
    if "dependencies" in tool.get("poetry", {}):
        where = _where(text, r"tool\.poetry\.dependencies", source)
        yield f"{where}: tool.poetry.dependencies: Poetry's own format is not modelled; export requirements.txt"
    for name in tool.get("uv", {}).get("sources", {}):
        where = _where(text, rf"(?s)tool\.uv\.sources.*?{re.escape(name)}", source)
        yield f"{where}: tool.uv.sources.{name}: sources are not modelled; {name} is taken from the indexes"


def _uv_table(text: str, table: Mapping[str, Any], source: Source) -> Inputs:
    """What `[tool.uv]` says of a resolution."""
    indexes = [entry for entry in table.get("index", ()) if "url" in entry]
    plain = [entry for entry in indexes if not entry.get("explicit")]
    explicit = [entry["url"] for entry in indexes if entry.get("explicit")]
    return Inputs(
        constraints=tuple(table.get("constraint-dependencies", ())),
        overrides=tuple(table.get("override-dependencies", ())),
        build_constraints=tuple(table.get("build-constraint-dependencies", ())),
        prerelease=table.get("prerelease"),
        index=IndexSettings(
            default=next((entry["url"] for entry in plain if entry.get("default")), table.get("index-url")),
            extra=(
                *(entry["url"] for entry in plain if not entry.get("default")),
                *table.get("extra-index-url", ()),
            ),
        ),
        not_modelled=tuple(
            f"{_where(text, _quoted(url), source)}: {url}: an explicit index is not modelled" for url in explicit
        ),
    )


def _where(text: str, pattern: str, source: Source) -> str:
    """File and line where the first match of a pattern ends."""
    match = re.search(pattern, text)
    return f"{source.name}:{text.count(chr(10), 0, match.end()) + 1}" if match else source.name


def _quoted(value: str) -> str:
    """A pattern for a TOML string that begins like the value; what follows a quote inside may be escaped."""
    return "[\"']" + re.escape(value.partition('"')[0])


# --- pylock.toml -----------------------------------------------------------------------------------------------


def pylock(text: str, source: Source, extras: Iterable[str], groups: Iterable[str]) -> Parsed:
    """Read a lock: each package pinned to its version, with its marker."""
    try:
        lock = Pylock.from_dict(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, PylockValidationError) as error:
        message = f"{source.name}: {error}"
        raise BadInput(message) from None
    chosen = {"extras": frozenset(extras), "dependency_groups": frozenset((*(lock.default_groups or ()), *groups))}
    found = Inputs(
        python=str(lock.requires_python) if lock.requires_python else None,
        notes=(f"{source.name}: packages are pinned to its versions, its files and hashes are not asked for",),
    )
    for package in lock.packages:
        where = _where(text, rf"name\s*=\s*{_quoted(package.name)}", source)
        found += _locked(package, chosen, source, where)
    return Parsed(inputs=found, extras=tuple(lock.extras or ()), groups=tuple(lock.dependency_groups or ()))


def _locked(package: Package, chosen: Mapping[str, frozenset[str]], source: Source, where: str) -> Inputs:
    marker = package.marker
    notes: tuple[str, ...] = ()
    if marker is not None and re.search(r"\b(extras|dependency_groups)\b", str(marker)):
        if not marker.evaluate(dict(chosen), context="lock_file"):
            return Inputs()
        notes = (f"{where}: {package.name}: its marker was judged for this machine's Python: {marker}",)
        marker = None
    tail = f" ; {marker}" if marker else ""
    if package.archive is not None:
        address = package.archive.url or str(source.folder / str(package.archive.path))
        return replace(_requirement(f"{package.name} @ {address}{tail}", source, where), notes=notes)
    if package.vcs is not None or package.directory is not None or package.version is None:
        why = UNMODELLED_REPOSITORY if package.vcs is not None else UNMODELLED_FOLDER
        return Inputs(not_modelled=(f"{where}: {package.name}: {why}",))
    return Inputs(requirements=(f"{package.name}=={package.version}{tail}",), notes=notes)


# --- environment.yml -------------------------------------------------------------------------------------------


def environment_yml(text: str, source: Source) -> Parsed:
    """Read conda's format: its pip part and its Python; every other conda package is not modelled."""
    import yaml  # noqa: PLC0415  (not needed by most commands)

    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        message = f"{source.name}:{line}: {error.problem}"
        raise BadInput(message) from None
    tables = {key.value: value for key, value in (root.value if isinstance(root, yaml.MappingNode) else ())}
    dependencies = tables.get("dependencies")
    if not isinstance(dependencies, yaml.SequenceNode):
        message = f"{source.name}: there is no list of dependencies; is it a conda environment file?"
        raise BadInput(message)
    found, pip = Inputs(), []
    if "variables" in tables:
        line = tables["variables"].start_mark.line + 1
        found += Inputs(not_modelled=(f"{source.name}:{line}: variables are not modelled; give them with --set",))
    for entry in dependencies.value:
        where = f"{source.name}:{entry.start_mark.line + 1}"
        if isinstance(entry, yaml.MappingNode):
            pip += [(item.start_mark.line + 1, item.value) for _, items in entry.value for item in items.value]
        else:
            found += _conda(entry.value, where)
    parsed = _lines(pip, source)
    return replace(parsed, inputs=found + parsed.inputs)


def _conda(spec: str, where: str) -> Inputs:
    match = re.fullmatch(r"(?:[\w./-]+::)?(?P<name>[\w.-]+?)\s*(?P<version>(?:[=<>!~ ].*)?)", spec.strip())
    name = match["name"] if match else spec
    version = match["version"].strip() if match else ""
    if name == "pip" and not version:
        return Inputs()
    if name != "python":
        return Inputs(not_modelled=(f"{where}: {spec}: conda packages are not modelled",))
    fuzzy = re.fullmatch(r"(==?)?\s*(\d+(?:\.\d+)*)(\.?\*)?(=[^=]*)?", version)  # =3.10, =3.10.*, 3.10, =3.10.4=h1_0
    if fuzzy:
        version = f"=={fuzzy[2]}" if fuzzy[1] == "==" and not fuzzy[3] else f"=={fuzzy[2]}.*"
    try:
        return Inputs(python=str(SpecifierSet(version)) or None)
    except InvalidSpecifier:
        return Inputs(not_modelled=(f"{where}: {spec}: this way of naming a Python is not modelled; give --python",))
