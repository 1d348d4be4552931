"""Read releases of the packages in `matrices/history/packages.toml`: `python -m harness.history.making [NAME...]`.

What was read of a file is kept below the cache folder, so that a second call reads new releases alone.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

import msgspec

from harness.history import (
    c_names,
    describe_release,
    import_table,
    module_names,
    package_plan,
    partial_sdists,
    partial_wheels,
    python_library,
    release_reader,
    release_runner,
    word_index,
)
from harness.history.api_history import MeasuredRelease, ReleaseEntry, encode, fold
from harness.history.package_plan import ChosenFile, PackagePlan
from harness.history.release_reader import ReleaseFacts
from harness.machine.store import cache_folder, digest, write_atomic
from harness.model import Artifact, decoding
from harness.model.errors import HarnessError
from harness.model.report_types import format_duration
from harness.packages import index

ROOT = Path(__file__).parents[2]
PLAN = ROOT / "matrices" / "history" / "packages.toml"
OUT = ROOT / "matrices" / "history"

BIG = 100 << 20
"""Bytes of a wheel of which only the names of files and the metadata are read."""

PLACEHOLDER = 20
"""A release with so many times fewer names than the middle one of its package holds the package's name, no more."""

PROGRAMS = (release_reader, module_names, describe_release)
"""The programs on which a cached answer depends."""

C_PROGRAMS = (c_names, partial_sdists)
"""The programs on which an answer depends besides, if an sdist has the names in sources in C."""


class ReleaseDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The names that one file holds, what importing it tells besides, and the bytes that were read for it."""

    facts: ReleaseFacts
    answers: dict[str, Any] | None = None
    downloaded: int = 0


def main(arguments: list[str] | None = None) -> None:
    """Read the packages and write their histories, then the table of import names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="packages to read (default: all)")
    args = parser.parse_args(arguments)
    plan = package_plan.load(PLAN)
    packages = plan.all_packages()
    if unknown := {*args.names} - {*packages, python_library.PACKAGE}:
        parser.error(f"{PLAN.name} has no {', '.join(sorted(unknown))}")
    names, began = args.names or (*packages, python_library.PACKAGE), monotonic()
    for number, name in enumerate(names, 1):
        if name == python_library.PACKAGE:
            write_atomic(OUT / f"{name}.json.gz", encode(fold(name, python_library.read())))
            continue
        reader = _Reader(name, packages[name], plan.helpers)
        history = encode(fold(name, without_placeholders([*reader.releases()])))
        write_atomic(OUT / f"{name}.json.gz", history)
        to_go = format_duration((monotonic() - began) / number * (len(names) - number))
        sizes = f"{len(history):,} bytes, read from {reader.downloaded:,}"
        print(f"[{number}/{len(names)}] {name}: {sizes} (about {to_go} to go)", flush=True)
    write_atomic(OUT / import_table.FILE, import_table.encode(plan, OUT))
    word_index.main()


class _Reader:
    """Reads the releases of one package, and counts the bytes."""

    def __init__(self, name: str, package: PackagePlan, helpers: Sequence[str]) -> None:
        self.name = name
        self.package = package
        self.helpers = helpers
        self.downloaded = 0

    def releases(self) -> Iterator[MeasuredRelease]:
        """Yield all releases, oldest first; those that are not read as well."""
        releases, files = index.releases(self.name), index.artifacts(self.name)
        chosen = package_plan.choose(self.package, releases, files)
        big = self._is_big(chosen)
        for release in releases:
            entry = ReleaseEntry(
                version=release.version,
                uploaded=release.uploaded,
                python=release.requires_python,
                wheels=tuple(sorted({_tag(wheel) for wheel in release.wheels})),
                sdist=release.sdist,
                yanked=release.yanked,
            )
            file = chosen.get(release.version)
            document = self._document(release.version, file, big=big) if file else None
            measured = _measured(self.package, entry, document)
            if document and not measured.facts:
                message = f"{self.name} {release.version}: not read: some of its names cannot be seen"
                print(message, file=sys.stderr, flush=True)
            yield measured

    def _is_big(self, chosen: dict[str, ChosenFile]) -> bool:
        """Return whether only names of files are read: of all releases, so that none seems to lack a name."""
        if self.package.big is not None or not chosen:
            return bool(self.package.big)
        newest = [*chosen.values()][-1].artifact
        with index.parts(newest) as read:
            return read("-1")[1] > BIG

    def _document(self, version: str, file: ChosenFile, *, big: bool) -> ReleaseDocument | None:
        """Return what was read of a file; None with a message if it cannot be read."""
        python = file.python.version if file.python else ""
        package, in_c = self.package, self._has_c_sources(file.artifact)
        modules = (*PROGRAMS, *(C_PROGRAMS if in_c else ()))
        programs = [Path(item.__file__ or "").read_text(encoding="utf-8") for item in modules]
        ways = (package.imports, package.run, package.without, big, *((package.places(),) if in_c else ()))
        cached = cache_folder() / "history" / f"{digest(file.artifact.sha256, ways, python, *programs)}.json"
        try:
            if cached.is_file():
                document = decoding.decoder(ReleaseDocument).decode(cached.read_bytes())
            else:
                document = self._read(file, big=big)
                cached.parent.mkdir(exist_ok=True)
                write_atomic(cached, msgspec.json.encode(document))
        except (HarnessError, OSError, ValueError) as error:
            print(f"{self.name} {version}: not read: {error}", file=sys.stderr, flush=True)
            return None
        self.downloaded += document.downloaded
        return document

    def _has_c_sources(self, artifact: Artifact) -> bool:
        return bool(self.package.c_sources) and not artifact.is_wheel

    def _read(self, file: ChosenFile, *, big: bool) -> ReleaseDocument:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "release"
            if self._has_c_sources(file.artifact):
                downloaded = self._unpack_sdist(file.artifact, folder)
                facts, answers = c_names.read_release(folder, self.package)
            else:
                files, downloaded = self._unpack(file.artifact, folder, big=big)
                read = release_reader.read_listing if big else release_reader.read
                facts, answers = read(folder, self.package.imports, files), None
                if self.package.run and file.python and facts.modules and not big:
                    answers = release_runner.run(folder, self.package.run, file.python, self.helpers)
            if not facts.modules:
                message = "none of its modules is in this file"
                raise ValueError(message)
        failed = {**facts.failed, **((answers or {}).get("failed") or {})}
        if failed:
            print(f"{file.artifact.filename}: {failed}", file=sys.stderr, flush=True)
        return ReleaseDocument(facts=facts, answers=answers, downloaded=downloaded)

    def _unpack(self, artifact: Artifact, folder: Path, *, big: bool) -> tuple[tuple[str, ...] | None, int]:
        """Unpack what is needed of a file; return the names of all its files, None if all are there, and the bytes."""
        if not artifact.is_wheel:
            archive = index.fetch(artifact, folder.parent / "file")
            release_reader.unpack(archive, folder)
            return None, archive.stat().st_size
        kinds = [release_reader.is_metadata]
        if not big:
            kinds += [release_reader.is_source, *([release_reader.is_library] if self.package.run else ())]
        passed_over = tuple(f"{module.replace('.', '/')}/" for module in self.package.without)

        def wanted(member: str) -> bool:
            return any(kind(member) for kind in kinds) and not member.startswith(passed_over)

        wheel = partial_wheels.fetch(artifact, folder.with_name("wheel"), wanted)
        wheel.extract(folder, wanted)
        return wheel.names, wheel.downloaded

    def _unpack_sdist(self, artifact: Artifact, folder: Path) -> int:
        """Unpack what is needed of an sdist with sources in C, and keep it; return the bytes that were read for it."""
        places, downloaded = self.package.places(), 0
        archive = cache_folder() / "history" / "sources" / f"{digest(artifact.sha256, places)}.tar.gz"

        def wanted(member: str) -> bool:
            in_root = member.endswith(".py") and member.startswith(f"{self.package.source_root}/")
            return member in places or in_root or partial_sdists.is_metadata(member)

        if not archive.is_file():
            part = folder.with_name("part.tar.gz")
            downloaded = partial_sdists.fetch(artifact, part, places, wanted)
            write_atomic(archive, part.read_bytes())
        release_reader.unpack(archive, folder)
        return downloaded


def without_placeholders(releases: list[MeasuredRelease]) -> list[MeasuredRelease]:
    """Return the releases; those that held a name for a package to come count as not read."""
    sizes = sorted(_size(item) for item in releases if item.facts)
    least = sizes[len(sizes) // 2] / PLACEHOLDER if sizes else 0
    return [
        MeasuredRelease(entry=msgspec.structs.replace(item.entry, read=False)) if _size(item) < least else item
        for item in releases
    ]


def _size(release: MeasuredRelease) -> int:
    """Return the number of names, those that only running or a source in C tells among them."""
    names = [facts.names for facts in (release.facts, release.ran) if facts]
    return sum(map(len, {owner: some for facts in names for owner, some in facts.items()}.values()))


def _tag(wheel: str) -> str:
    return "-".join(wheel.removesuffix(".whl").rsplit("-", 3)[1:])


def _without_copies(members: dict[str, list[str]]) -> dict[str, tuple[str, ...]]:
    """Return the members of classes; of one that several modules hand on, by its shortest path."""
    paths: dict[tuple[str, ...], str] = {}
    for path in sorted(members, key=lambda path: (-path.count("."), path)):
        paths[path.rpartition(".")[2], *members[path]] = path
    return {path: tuple(members[path]) for path in sorted(paths.values())}


def _hides_names(package: PackagePlan, facts: ReleaseFacts, answers: dict[str, Any]) -> bool:
    """Return whether a release would seem to lack names, as a module that only running shows could not be imported."""
    not_imported = {*package.run} - {*answers.get("names", ())}
    return bool(not_imported & {*facts.dynamic}) or bool(facts.natives and {*package.run[:1]} & not_imported)


def _measured(package: PackagePlan, entry: ReleaseEntry, document: ReleaseDocument | None) -> MeasuredRelease:
    answers = (document.answers if document else None) or {}
    if document is None or document.facts.failed or _hides_names(package, document.facts, answers):
        return MeasuredRelease(entry=entry)
    ran = None
    if answers.get("names"):
        names = {name: tuple(item) for name, item in answers["names"].items()}
        members = _without_copies(answers["members"])
        ran = ReleaseFacts(names=names, members=members)
    environments, schema = answers.get("environments"), answers.get("schema")
    return MeasuredRelease(
        entry=msgspec.structs.replace(entry, read=True),
        facts=document.facts if package.signatures else msgspec.structs.replace(document.facts, signatures={}),
        ran=ran,
        environments=tuple(environments) if environments else None,
        schema=tuple(schema) if schema else None,
    )


if __name__ == "__main__":
    main()
