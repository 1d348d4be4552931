"""Build the whole site into a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from harness.reports.site import (
    cell_page,
    environment_page,
    home_page,
    issue_page,
    matrix_page,
    package_page,
    site_folder,
    site_sources,
)
from harness.reports.site.evidence_files import EvidenceFiles
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts
from harness.running.signatures import issue_texts, shipped_signatures


@dataclass(frozen=True, kw_only=True, slots=True)
class BuiltSite:
    """The size of a site: pages, cells, files and bytes."""

    pages: int
    cells: int
    files: int
    bytes: int


def build(files: Sequence[Path], out: Path) -> BuiltSite:
    """Build the site of these reports, or of all that come with the harness, into a folder. Raises BadInput.

    Nothing is written before every report was read; the folder is replaced as a whole at the end.
    """
    site_folder.check(out)
    sources, measured = site_sources.from_files(files) if files else site_sources.shipped()
    signatures = {str(one.id): one for one in shipped_signatures.load_all()}
    facts = SiteFacts(sources=sources, measured=measured, signatures=signatures, issues=issue_texts.load())
    with site_folder.replaced(out) as target:
        pages = write(facts, target)
        sizes = [path.stat().st_size for path in target.rglob("*") if path.is_file()]
    return BuiltSite(pages=pages, cells=len(facts.entries), files=len(sizes), bytes=sum(sizes))


def write(facts: SiteFacts, target: Path) -> int:
    """Write all pages, and return how many there are."""
    writer = PageWriter(target, {"generated": facts.generated, "version": _version()})
    evidence = EvidenceFiles(target)
    writer.copy_assets()
    home_page.write(facts, writer)
    matrix_page.write(facts, writer, evidence)
    cell_page.CellPages(facts, writer, evidence).write()
    package_page.write(facts, writer)
    environment_page.write(facts, writer)
    issue_page.write(facts, writer)
    # Hosts that run Jekyll would leave out files whose names begin with an underscore.
    (target / ".nojekyll").touch()
    return writer.pages


def _version() -> str:
    try:
        return version("simmatrix")
    except PackageNotFoundError:
        return ""
