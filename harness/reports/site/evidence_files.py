"""Copy the logs, locks and pictures of reports into the site. What is missing or damaged is said on the page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.machine.files import guarded_files
from harness.model.hostile_data import Unreadable
from harness.reports import size_plot
from harness.reports.site import addresses
from harness.reports.site.site_sources import Source
from harness.reports.tables.family_tables import FamilyTable

KINDS = {
    ".txt": (b"", b""), ".log": (b"", b""), ".jsonl": (b"", b""),
    ".png": (b"\x89PNG\r\n", b"IEND\xaeB`\x82"), ".svg": (b"<?xml", b"</svg>"),
}  # fmt: skip
"""Files that are copied, by the end of their names, with the bytes that they begin and end with."""

MOST = 16 << 20
TAIL = 40
"""Lines of a log that a page shows."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SiteFile:
    """A file of a report: its address in the site, or else the reason why it is `missing`."""

    name: str
    address: str = ""
    missing: str = ""


class EvidenceFiles:
    """Copies the files of reports into the site, each once."""

    def __init__(self, target: Path) -> None:
        self._target = target
        self._copied: dict[tuple[str, str], SiteFile] = {}

    def copy(self, source: Source, path: str) -> SiteFile:
        """Copy one file of a report."""
        key = source.name, path
        if key not in self._copied:
            self._copied[key] = self._copy(source, path)
        return self._copied[key]

    def copy_folder(self, source: Source, path: str) -> list[SiteFile]:
        """Copy a log, or all texts of a folder of evidence."""
        place = _inside(source, path)
        if place is None or not place.is_dir():
            return [self.copy(source, path)]
        names = sorted(each.name for each in place.iterdir() if each.suffix in {".txt", ".log", ".jsonl"})
        empty = SiteFile(name=path, missing="the folder holds no log")
        return [self.copy(source, f"{path}/{name}") for name in names] or [empty]

    def plot(self, source: Source, table: FamilyTable) -> SiteFile:
        """Copy the plot of a table of families; draw it anew if the report has none, as those in a wheel."""
        key = source.name, f"drawn/{table.picture}"
        file = self.copy(source, table.picture)
        if file.address:
            return file
        if key not in self._copied:
            self._copied[key] = self._add(source, table.picture, size_plot.draw(table))
        return self._copied[key]

    def tail(self, file: SiteFile) -> str:
        """Return the last lines of a log that was copied."""
        if not file.address:
            return ""
        text = (self._target / file.address).read_text(encoding="utf-8", errors="replace")
        return "\n".join(text.rstrip().splitlines()[-TAIL:])

    def _copy(self, source: Source, path: str) -> SiteFile:
        place = _inside(source, path)
        ends = KINDS.get(Path(path).suffix)
        if place is None or ends is None:
            reason = "only its table was kept" if source.folder is None else "it is no file of this report"
            return SiteFile(name=path, missing=reason)
        try:
            content = guarded_files.read(place, MOST)
        except Unreadable as error:
            return SiteFile(name=path, missing=str(error))
        if not (content.startswith(ends[0]) and content.rstrip().endswith(ends[1])):
            return SiteFile(name=path, missing="it is damaged")
        return self._add(source, path, content)

    def _add(self, source: Source, path: str, content: bytes) -> SiteFile:
        address = addresses.report_file(source.name, path)
        target = self._target / address
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
        return SiteFile(name=path, address=address)


def _inside(source: Source, path: str) -> Path | None:
    """Return the place of a file, None if it lies outside the folder of its report: a report may name anything."""
    if source.folder is None or "\0" in path:
        return None
    root = source.folder.resolve()
    place = root / path
    return place if root in place.resolve().parents else None


def list_missing(files: list[SiteFile]) -> Iterator[str]:
    """Yield a sentence for each file that is missing."""
    yield from (f"{file.name}: {file.missing}" for file in files if file.missing)
