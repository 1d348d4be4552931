"""Build the package under test, read what it requires, and make the question that a lock without it answers.

The lock of a cell holds what the subject depends on and never the subject itself, be it required by others: a new
commit with the same dependencies asks the same question, and finds its lock and its environment made.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from email.parser import HeaderParser
from pathlib import Path
from typing import Any

from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name, parse_wheel_filename

from harness.machine.files.file_locks import exclusive
from harness.machine.store import cache_folder, digest, sha256_of, write_atomic
from harness.model import (
    Artifact,
    Interpreter,
    Outcome,
    Phase,
    Question,
    Step,
    Subject,
    Tested,
    replace,
    requirement_texts,
    schema,
)
from harness.model.errors import BadInput, CouldNotTell
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.packages import locks
from harness.packages.environments import environments, site_packages
from harness.packages.requirement_files import project
from harness.packages.sources import builds, checkouts, sdists
from harness.packages.step_failed import StepFailed, install_failed

WHEEL = ".whl"
PURE = "-none-any"
UNNAMED = "the package under test"
NEVER = "sys_platform == 'never'"
"""A marker that drops a requirement, whoever states it."""

TESTS = frozenset({"test", "tests"})
"""Folders that find their way into wheels by mistake; they are no module of the package."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SubjectWheel:
    """The subject's wheel for one interpreter, with its metadata; `groups` is the table in its pyproject.toml.

    `requirement_cache` remembers the requirements worked out for earlier cells.
    """

    path: Path
    tested: Tested
    requires: tuple[str, ...]
    extras: tuple[str, ...]
    modules: tuple[str, ...]
    groups: Mapping[str, Any]
    requirement_cache: dict[object, tuple[str, ...]] = field(default_factory=dict, compare=False)

    @property
    def wheel(self) -> environments.Wheel:
        """Return the wheel in the form that environments install."""
        artifact = Artifact(filename=self.path.name, sha256=self.tested.sha256, source=str(self.path))
        # Two builds of the same files are different wheels; by their content they share an environment.
        return environments.Wheel(
            name=self.tested.name, version=self.tested.version, artifact=artifact, mark=self.tested.content
        )


def locate_source(source: str, folder: Path) -> str:
    """Return the source in a form that is found from anywhere; a path starts at the project of the matrix file.

    The project is the nearest folder, from the file's own upwards, that holds a pyproject.toml, setup.py or setup.cfg;
    else the file's own folder.
    """
    if source.startswith(checkouts.REPOSITORY):
        return source
    near = folder.absolute()
    marked = (one for one in (near, *near.parents) if any((one / name).exists() for name in project.FILES))
    return str((next(marked, near) / source).resolve())


def about(subject: Subject) -> project.About | None:
    """Read the pyproject.toml of a folder before anything is built; None for a wheel, a repository or no such file."""
    if subject.source.startswith(checkouts.REPOSITORY) or not (Path(subject.source) / project.FILES[0]).is_file():
        return None
    return _about(subject)


def record_state(subject: Subject, *, offline: bool = False) -> Subject:
    """Return the subject with the present state of its source. Raises BadInput if there is no usable source."""
    path = Path(subject.source)
    is_wheel = path.suffix == WHEEL and path.is_file()
    if is_wheel and (subject.suite or subject.groups):
        message = f"subject: {path.name} is a wheel, which has neither tests nor dependency groups; name a folder"
        raise BadInput(message)
    in_repository = subject.source.startswith(checkouts.REPOSITORY)
    usable = is_wheel or in_repository or any((path / name).is_file() for name in project.FILES)
    state = checkouts.state_of(subject.source, offline=offline) if usable else None
    if state is None:
        message = f"subject: {path} is neither a wheel nor a folder with a pyproject.toml or setup.py"
        raise BadInput(message)
    return replace(subject, state=state.mark, commit=state.commit, changed=state.changed)


def copy_source(subject: Subject, target: Path) -> Path:
    """Make a clean copy of the source below a folder; return where the project lies in it.

    Raises CouldNotTell if the source has changed since the subject was settled: a wheel made of the copy would be kept
    under the wrong state.
    """
    if subject.source.startswith(checkouts.REPOSITORY):
        return checkouts.copy_commit(subject.source, subject.commit or "", target)
    path = Path(subject.source)
    copy = checkouts.copy_folder(path, target)
    # Compared after the copy, so that a change in the middle of it is noticed, too.
    if checkouts.of_folder(path).mark != subject.state:
        here = (one.relative_to(copy) for one in copy.rglob("*") if one.is_file() and ".git" not in one.parts)
        newest = max(here, key=lambda name: (copy / name).stat().st_mtime, default=Path())
        hint = "run it again, and write output elsewhere or to a path that git ignores"
        message = f"subject: its files were changed since this run began, the last of them {newest}; {hint}"
        raise CouldNotTell(message)
    return copy


# --- its wheel -------------------------------------------------------------------------------------------------


def find_wheel(subject: Subject, interpreter: Interpreter, question: Question) -> SubjectWheel | None:
    """Return the wheel of a settled subject if it was built before. Raises StepFailed if it excludes this Python."""
    if subject.source.endswith(WHEEL):
        return _read(Path(subject.source), interpreter, {})
    about = _about(subject)
    _check_python(about.name or UNNAMED, about.python, interpreter)
    memories = _memories(subject, interpreter, question)
    build = next((built for path in memories if (built := builds.recall_wheel(path))), None)
    return _read(build.path, interpreter, about.groups) if build else None


def ensure_wheel(
    subject: Subject, interpreter: Interpreter, question: Question, *, offline: bool = False
) -> SubjectWheel:
    """Return the wheel of a settled subject for an interpreter, built now or before. Raises StepFailed.

    A wheel that says to be for any Python is built once, by the first that needs it.
    """
    for_any, for_this = _memories(subject, interpreter, question)
    with exclusive(for_any.with_suffix(".lock")):
        result = find_wheel(subject, interpreter, question)  # it may have been built while we waited
        if result:
            return result
        about = _about(subject)
        tree = builds.Tree(
            name=about.name or UNNAMED, mark=subject.state or "", unpack=lambda target: copy_source(subject, target)
        )
        build = builds.build_tree(tree, interpreter, question, environments.ensure, offline=offline)
        write_atomic(for_any if build.path.stem.endswith(PURE) else for_this, build.key.encode())
    return _read(build.path, interpreter, about.groups)


def _about(subject: Subject) -> project.About:
    return project.about(checkouts.text(subject.source, subject.commit, "pyproject.toml"))


def _memories(subject: Subject, interpreter: Interpreter, question: Question) -> tuple[Path, Path]:
    """Return the files that remember which build a state led to: for any Python, and for this one."""
    inputs = (question.build_constraints, question.build_variables, question.only_binary, question.index)
    names = [digest("subject", subject.state, python, *inputs) for python in (None, interpreter.identity)]
    for_any, for_this = (cache_folder() / "subjects" / f"{name}.txt" for name in names)
    return for_any, for_this


def _read(path: Path, interpreter: Interpreter, groups: Mapping[str, Any]) -> SubjectWheel:
    try:
        with raise_unreadable():
            name, version, _, tags = parse_wheel_filename(path.name)
            with zipfile.ZipFile(path) as archive:
                entries = sorted((info.filename, info.CRC, info.file_size) for info in archive.infolist())
                headers = HeaderParser().parsestr(sdists.about_wheel(archive, "METADATA"))
                record = sdists.about_wheel(archive, "RECORD").splitlines()
    except Unreadable as error:
        raise install_failed(Outcome.FAILED, f"{path.name} is no wheel: {error}") from None
    if not any(tag in locks.tags(interpreter) for tag in tags):
        reason = f"{path.name} is not for Python {interpreter.minor} on this platform"
        raise install_failed(Outcome.FAILED, reason)
    _check_python(f"{name} {version}", str(headers.get("Requires-Python", "")), interpreter)
    files = [line.partition(",")[0] for line in record]
    return SubjectWheel(
        path=path,
        tested=Tested(
            name=name,
            version=str(version),
            sha256=sha256_of(path),
            content=digest("content", entries, sorted(record)),
        ),
        requires=tuple(str(value) for value in headers.get_all("Requires-Dist", ())),
        extras=tuple(canonicalize_name(str(value)) for value in headers.get_all("Provides-Extra", ())),
        modules=tuple(top for top in site_packages.top_level(files) if top not in TESTS),
        groups=groups,
    )


def _check_python(named: str, requires_python: str, interpreter: Interpreter) -> None:
    """Raise StepFailed if the package excludes this Python."""
    try:
        allowed = SpecifierSet(requires_python)
    except InvalidSpecifier:
        return
    if not allowed.contains(interpreter.version, prereleases=True):
        decisive = f"{named} requires Python {requires_python}, and this is {interpreter.version}"
        raise StepFailed(Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive=decisive))


# --- what it asks for ------------------------------------------------------------------------------------------


def complete_question(
    question: Question, subject: Subject, package: SubjectWheel, interpreter: Interpreter
) -> Question:
    """Return the question of a cell: the subject's dependencies besides the requirements of the matrix.

    The subject itself is kept out of the lock. Raises BadInput for an extra or a group that the subject does not have,
    or where the matrix asks for it by name.
    """
    name = package.tested.name
    refuse_naming(name, (*question.requirements, *question.overrides), "`extras`")
    lines = list_requirements(package, interpreter, subject.extras, subject.groups)
    return replace(
        question,
        requirements=tuple(dict.fromkeys((*lines, *question.requirements))),
        overrides=(*question.overrides, f"{name} ; {NEVER}"),
    )


def refuse_naming(name: str, lines: Iterable[str], instead: str) -> None:
    """Raise BadInput where one of these lines would bring the subject from an index, or would be passed over."""
    if any(canonicalize_name(requirement_texts.requirement(line).name) == name for line in lines):
        message = (
            f"{name} is the subject, which no requirement, override or axis may name; its extras are for {instead}"
        )
        raise BadInput(message)


def list_requirements(
    package: SubjectWheel, interpreter: Interpreter, extras: tuple[str, ...], groups: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the subject's requirements with some of its extras and groups, as they apply to an interpreter."""
    key = (interpreter, extras, groups)
    if key not in package.requirement_cache:
        for what, names, valid in (
            ("extra", extras, package.extras),
            ("dependency group", groups, tuple(map(canonicalize_name, package.groups))),
        ):
            unknown = next((one for one in names if one not in valid), None)
            if unknown:
                message = f'{package.tested.name} has no {what} "{unknown}"{schema.suggestion(unknown, valid)}'
                raise BadInput(message)
        package.requirement_cache[key] = tuple(_expanded(package, interpreter, extras, groups))
    return package.requirement_cache[key]


def _expanded(
    package: SubjectWheel, interpreter: Interpreter, extras: tuple[str, ...], groups: tuple[str, ...]
) -> dict[str, None]:
    """Return the lines that apply, repeating until no further extra of the package itself comes with them."""
    lines = (
        *package.requires,
        *project.resolve_groups(package.groups, groups, f"the dependency groups of {package.tested.name}"),
    )
    environment = locks.marker_environment(interpreter)
    chosen = list(dict.fromkeys(extras))
    requirements: dict[str, None] = {}
    done = -1
    while done != len(chosen):
        done = len(chosen)
        for line in lines:
            requirements |= dict.fromkeys(_holding(line, package.tested.name, environment, chosen))
    return requirements


def _holding(line: str, name: str, environment: Mapping[str, str], chosen: list[str]) -> Iterator[str]:
    """Yield a requirement without its marker if it applies; one of the package itself adds to the chosen extras."""
    try:
        requirement = Requirement(line)
    except InvalidRequirement:
        yield line  # uv says what is wrong with it
        return
    marker = requirement.marker
    if marker and not any(marker.evaluate({**environment, "extra": extra}) for extra in ("", *chosen)):
        return
    if canonicalize_name(requirement.name) == name:
        chosen += [one for one in sorted(map(canonicalize_name, requirement.extras)) if one not in chosen]
        return
    # uv knows none of these extras and would drop a requirement whose marker names one.
    requirement.marker = None
    yield str(requirement)
