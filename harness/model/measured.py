"""Define the document of measured results: the cells of many reports, each with its lock.

`recommend` answers from it, and `harness.reports.answers.digest` makes it. `standalone` reads its JSON as plain values,
because it runs without msgspec.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from harness.model.report_types import CellEntry


class MeasuredCell(CellEntry, frozen=True, kw_only=True, omit_defaults=True):
    """A measured cell without paths of files and known failures; `lock` is the SHA-256 of its lock, if there is one.

    `causes` are the ids of the known failures that count. `imported` are modules that one of its cases imported, if the
    cell did not note which packages its cases ran.
    """

    machine: str
    measured: str
    causes: tuple[str, ...]
    imported: tuple[str, ...] = ()


class SeriesStep(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A release at which an environment changes, against the release measured before it.

    `kind` is `changed`, or how else the two differ; `share` is the share of states or pixels that do. `moved` are other
    packages that differ between the two: the change is not separated from theirs. `between` were not measured.
    """

    before: str
    after: str
    kind: str
    text: str
    share: float = 0.0
    moved: tuple[str, ...] = ()
    between: tuple[str, ...] = ()


class ReleaseSeries(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One environment over measured releases of one package, all else equal as it stands in `where`.

    `families` has a letter for each of `releases`: equal letters behave alike, or look alike in a series of `pictures`.
    `?` cannot be decided, a prime is the same up to what noise explains, `-` was not measured.
    """

    matrix: str
    env: str
    api: str
    package: str
    where: dict[str, str]
    releases: tuple[str, ...]
    families: tuple[str, ...]
    steps: tuple[SeriesStep, ...] = ()
    pictures: bool = False


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """Measured cells, and their locks by SHA-256 as pairs of name and version.

    `remedies` has, in a few words, what to do about each known failure that is a cause of some cell. `series` says
    which environments change between releases.
    `hashes` are the SHA-256 of the files of each release `name==version`, written once for all locks. `taken` has the
    places in them of the files of a release that a lock holds, if it does not hold all of them.
    """

    schema: Literal[1] = 1
    generated: str
    machines: dict[str, dict[str, Any]]
    cells: tuple[MeasuredCell, ...]
    locks: dict[str, tuple[tuple[str, str], ...]]
    hashes: dict[str, tuple[str, ...]]
    taken: dict[str, dict[str, tuple[int, ...]]]
    remedies: dict[str, str] = {}
    series: tuple[ReleaseSeries, ...] = ()

    def lock_text(self, sha256: str) -> str:
        """Return a lock as hash-pinned requirements, as they were measured."""
        taken = self.taken.get(sha256, {})
        lines = []
        for name, version in self.locks[sha256]:
            release_hashes = self.hashes[f"{name}=={version}"]
            hashes = [release_hashes[place] for place in taken[name]] if name in taken else release_hashes
            lines.append(" \\\n".join((f"{name}=={version}", *(f"    --hash=sha256:{one}" for one in hashes))) + "\n")
        return "".join(lines)
