"""Make two files of the package when a wheel is built: all measured results, and the reports.

Measured results are those behind `reports/`, and combinations of which only a table of the checkout is left.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

TARGET = "harness/measured.json.gz"
REPORTS = "harness/reports.zip"


class Hook(BuildHookInterface):
    """Puts the measured results into the wheel; an editable install reads `reports/` itself."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Collect the results of the reports in a file of a temporary folder, which the build takes in."""
        self.folder: TemporaryDirectory[str] | None = None
        if version == "editable":
            return
        self.folder = TemporaryDirectory()
        for target, content in zip((TARGET, REPORTS), pack(Path(self.root)), strict=True):
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
        collection = importlib.import_module("harness.reports.past_results.collection")
    finally:
        sys.path.remove(str(root))
    files = sorted((root / "reports").glob("*/report.json"))
    return digest.pack(collection.from_checkout(root, files)), digest.pack_reports(files)
