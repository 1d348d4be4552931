"""Build what the wheel and the sdist hold beside the code: measured results, links in the README, project links.

Measured results are the results behind `reports/`, and combinations of which only a table of the checkout is left.
`repository` in pyproject.toml is the one setting that fills all links.
"""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

TARGET = "harness/measured.json.gz"
REPORTS = "harness/reports.zip"

PAGES = {"Homepage": "", "Documentation": "/blob/HEAD/docs/index.md", "Source": ""} | {
    "Issues": "/issues",
    "Changelog": "/blob/HEAD/docs/changelog.md",
}
"""Names of the project links, and what follows the address of the repository in each."""

LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^][]+)\]\((?P<target>[^)\s]+)\)")


class Metadata(MetadataHookInterface):
    """Fills the README and the project links of the package with the address of the repository."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set `readme` and `urls`; without an address there are no project links."""
        repository = str(self.config.get("repository", "")).rstrip("/")
        readme = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": lead_links(readme, repository)}
        metadata["urls"] = {name: f"{repository}{rest}" for name, rest in PAGES.items()} if repository else {}


class Hook(BuildHookInterface):
    """Puts the measured results into the wheel and the sdist; an editable install reads `reports/` itself."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Collect the results of the reports in a temporary folder, which the build takes in.

        An unpacked sdist has these two files already, and no reports.
        """
        self.folder: TemporaryDirectory[str] | None = None
        if version == "editable":
            return
        root = Path(self.root)
        if (root / TARGET).is_file():
            build_data["force_include"] |= {str(root / target): target for target in (TARGET, REPORTS)}
            return
        self.folder = TemporaryDirectory()
        for target, content in zip((TARGET, REPORTS), pack(root), strict=True):
            file = Path(self.folder.name) / Path(target).name
            file.write_bytes(content)
            build_data["force_include"][str(file)] = target

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        if self.folder:
            self.folder.cleanup()


def pack(root: Path) -> tuple[bytes, bytes]:
    """Return what was measured in a checkout, and its whole reports; both compressed."""
    sys.path.insert(0, str(root))  # nothing is installed yet
    try:
        digest = importlib.import_module("harness.reports.answers.digest")
    finally:
        sys.path.remove(str(root))
    files = sorted((root / "reports").glob("*/report.json"))
    return digest.pack(digest.from_files(files)), digest.pack_reports(files)


def lead_links(readme: str, repository: str) -> str:
    """Lead links to files of the checkout to the repository; without an address leave their text, and no pictures."""

    def lead(match: re.Match[str]) -> str:
        image, text, target = match["image"], match["text"], match["target"]
        if "://" in target or target.startswith("#"):
            return match[0]
        if repository:
            return f"{image}[{text}]({repository}/{'raw' if image else 'blob'}/HEAD/{target})"
        return "" if image else text

    return LINK.sub(lead, readme)
