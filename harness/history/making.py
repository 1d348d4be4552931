"""Read every release of the packages in `matrices/history/packages.toml`: `python -m harness.history.making [NAME...]`.

What was read of a file is kept below the cache folder, so that a second call reads new releases alone.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.version import Version

from harness.history import describe_release, release_reader, word_index
from harness.history.api_history import MeasuredRelease, ReleaseEntry, encode, fold
from harness.history.release_reader import ReleaseFacts
from harness.machine import interpreters, process
from harness.machine.store import cache_folder, digest, write_atomic
from harness.model import Artifact, Interpreter
from harness.model.errors import CouldNotTell, HarnessError
from harness.packages import index

ROOT = Path(__file__).parents[2]
PLAN = ROOT / "matrices" / "history" / "packages.toml"
OUT = ROOT / "matrices" / "history"
SECONDS = 300.0
"""The time that a command may take: an environment, or the import of one release."""

OLD_NUMPY, NEW_PYTHON = "numpy<1.24", 12
"""The NumPy of old releases, and the first minor version of Python that has no such NumPy."""

PLACEHOLDER = 20
"""A release with so many times fewer names than the middle one of its package holds the package's name, no more."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PackagePlan:
    """A package to read: its top-level modules, and those to import."""

    name: str
    imports: tuple[str, ...]
    run: tuple[str, ...]


def main(arguments: list[str] | None = None) -> None:
    """Read the packages and write their histories."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="the packages [all of them]")
    args = parser.parse_args(arguments)
    plan = tomllib.loads(PLAN.read_text(encoding="utf-8"))
    OUT.mkdir(exist_ok=True)
    for name, wanted in plan["packages"].items():
        if args.names and name not in args.names:
            continue
        package = PackagePlan(name=name, imports=tuple(wanted["imports"]), run=tuple(wanted.get("run", ())))
        history = encode(fold(name, _without_placeholders([*_releases(package, plan["helpers"])])))
        write_atomic(OUT / f"{name}.json.gz", history)
        print(f"{name}: {len(history):,} bytes", flush=True)
    word_index.main()


def _releases(package: PackagePlan, helpers: list[str]) -> Iterator[MeasuredRelease]:
    files = index.artifacts(package.name)
    for release in index.releases(package.name):
        tags = sorted({_tag(wheel) for wheel in release.wheels})
        entry = ReleaseEntry(
            version=release.version,
            uploaded=release.uploaded,
            python=release.requires_python,
            wheels=tuple(tags),
            sdist=release.sdist,
            yanked=release.yanked,
        )
        chosen = None if Version(release.version).is_prerelease else _choice(files.get(release.version, ()), entry)
        if chosen is None:
            yield MeasuredRelease(entry=entry)
            continue
        try:
            document = _read(package, *chosen, helpers)
        except (HarnessError, OSError, ValueError) as error:
            print(f"{package.name} {release.version}: not read: {error}", file=sys.stderr, flush=True)
            yield MeasuredRelease(entry=entry)
            continue
        yield _measured(entry, document)


def _without_placeholders(releases: list[MeasuredRelease]) -> list[MeasuredRelease]:
    """Return the releases; those that held a name for a package to come count as not read."""
    sizes = sorted(_size(item) for item in releases if item.facts)
    least = sizes[len(sizes) // 2] / PLACEHOLDER if sizes else 0
    return [
        MeasuredRelease(entry=msgspec.structs.replace(item.entry, read=False)) if _size(item) < least else item
        for item in releases
    ]


def _size(release: MeasuredRelease) -> int:
    return sum(map(len, release.facts.names.values())) if release.facts else 0


def _tag(wheel: str) -> str:
    return "-".join(wheel.removesuffix(".whl").rsplit("-", 3)[1:])


def _choice(files: tuple[Artifact, ...], entry: ReleaseEntry) -> tuple[Artifact, Interpreter | None] | None:
    """Return the file to read, and a Python of this machine that can import it: a wheel rather than an sdist."""
    pythons = [item for item in interpreters.available() if _admits(entry.python, item.version)]
    for python in sorted(pythons, key=lambda item: Version(item.version), reverse=True):
        short = "".join(python.version.split(".")[:2])
        fitting = (rf"-(py3|py2\.py3|py3\d|cp{short}|cp3\d-abi3)-", "-(any|[^-]*linux[^-]*_x86_64)\\.whl$")
        for file in files:
            if file.is_wheel and all(re.search(part, file.filename) for part in fitting):
                return file, python
    sdists = [file for file in files if not file.is_wheel and file.filename.endswith((".tar.gz", ".zip"))]
    return (sdists[0], _near(pythons, entry)) if sdists else None


def _near(pythons: list[Interpreter], entry: ReleaseEntry) -> Interpreter | None:
    """Return the Python that most of its time used, for a source that does not say: the oldest before 2022."""
    ordered = sorted(pythons, key=lambda item: Version(item.version))
    if not ordered:
        return None
    return ordered[0] if (entry.uploaded or "") < "2022" else ordered[len(ordered) // 2]


def _admits(requires: str | None, version: str) -> bool:
    try:
        return Version("3.7") <= Version(version) and SpecifierSet(requires or "").contains(version)
    except InvalidSpecifier:
        return True


# --- one release -----------------------------------------------------------------------------------------------


class ReleaseDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The names that one file holds, and what importing it tells besides."""

    facts: ReleaseFacts
    answers: dict[str, Any] | None = None


def _read(package: PackagePlan, artifact: Artifact, python: Interpreter | None, helpers: list[str]) -> ReleaseDocument:
    programs = [Path(item.__file__ or "").read_text(encoding="utf-8") for item in (release_reader, describe_release)]
    key = digest(artifact.sha256, package.imports, package.run, python.version if python else "", *programs)
    cached = cache_folder() / "history" / f"{key}.json"
    if cached.is_file():
        return msgspec.json.decode(cached.read_bytes(), type=ReleaseDocument)
    with tempfile.TemporaryDirectory() as scratch:
        archive = index.fetch(artifact, Path(scratch) / "file")
        folder = Path(scratch) / "release"
        release_reader.unpack(archive, folder)
        facts = release_reader.read(folder, package.imports)
        if not {module.partition(".")[0] for module in facts.modules} & {*package.imports}:
            message = "none of its modules is in this file"
            raise ValueError(message)
        answers = _run(folder, package.run, python, helpers) if package.run and python else None
    document = ReleaseDocument(facts=facts, answers=answers)
    cached.parent.mkdir(exist_ok=True)
    write_atomic(cached, msgspec.json.encode(document))
    failed = {**facts.failed, **((answers or {}).get("failed") or {})}
    print(f"{package.name}: {artifact.filename}{f' {failed}' if failed else ''}", file=sys.stderr, flush=True)
    return document


def _run(folder: Path, modules: tuple[str, ...], python: Interpreter, helpers: list[str]) -> dict[str, Any] | None:
    """Import the modules of an unpacked release; None if the interpreter did not come to an end of it."""
    home = _helpers(python, helpers, numpy="numpy" not in modules)
    source = folder / "src" if (folder / "src").is_dir() else folder
    answer = folder.with_name("answer.json")
    program = str(describe_release.__file__)
    _call(folder, str(home / "bin" / "python"), "-B", "-W", "ignore", program, str(answer), str(source), *modules)
    try:
        answers: dict[str, Any] = msgspec.json.decode(answer.read_bytes())
    except (OSError, msgspec.DecodeError):
        return None
    return answers


def _call(folder: Path, *argv: str) -> process.Completed:
    limits = process.Limits(seconds=SECONDS)
    log, profile = folder.with_name("log.txt"), process.Profile.HOST
    return process.run(process.Command(argv=argv, cwd=folder, env=os.environ, limits=limits, log=log, profile=profile))


def _helpers(python: Interpreter, helpers: list[str], *, numpy: bool) -> Path:
    """Return an environment that has what releases need to be imported. Raises CouldNotTell."""
    wanted = [*helpers, OLD_NUMPY] if numpy else [name for name in helpers if not name.startswith(("scipy", "imageio"))]
    home = cache_folder() / "history" / f"python-{digest(python.version, wanted)[:16]}" / "home"
    if not (home.parent / "done").exists():
        if Version(python.version).minor >= NEW_PYTHON:
            wanted = [re.split("[<=>]", name)[0] for name in wanted]
        home.parent.mkdir(parents=True, exist_ok=True)
        venv = _call(home.parent, "uv", "venv", "-q", "--clear", "-p", python.path, str(home))
        install = ("uv", "pip", "install", "-q", "--only-binary", ":all:", "-p", str(home / "bin" / "python"))
        if venv.exit_code or _call(home.parent, *install, *wanted).exit_code:
            message = f"no environment could be made with Python {python.version}; see {home.parents[1] / 'log.txt'}"
            raise CouldNotTell(message)
        (home.parent / "done").touch()
    return home


def _measured(entry: ReleaseEntry, document: ReleaseDocument) -> MeasuredRelease:
    answers = document.answers or {}
    ran = None
    if answers.get("names"):
        names = {name: tuple(item) for name, item in answers["names"].items()}
        members = {name: tuple(item) for name, item in answers["members"].items()}
        ran = ReleaseFacts(names=names, members=members)
    environments, schema = answers.get("environments"), answers.get("schema")
    return MeasuredRelease(
        entry=msgspec.structs.replace(entry, read=True),
        facts=document.facts,
        ran=ran,
        environments=tuple(environments) if environments else None,
        schema=tuple(schema) if schema else None,
    )


if __name__ == "__main__":
    main()
