"""Make two files of the package when a wheel is built: the measured results behind `reports/`, and the reports."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

TARGET = "harness/measured.json.gz"
REPORTS = "harness/reports.zip"


class Hook(BuildHookInterface):
    """Puts the measured results into the wheel; an editable install reads `reports/` itself."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Distil the reports into a file of a temporary folder, which the build takes in."""
        self.folder: TemporaryDirectory[str] | None = None
        if version == "editable":
            return
        self.folder = TemporaryDirectory()
        for target, content in zip((TARGET, REPORTS), packed(Path(self.root)), strict=True):
            file = Path(self.folder.name) / Path(target).name
            file.write_bytes(content)
            build_data["force_include"][str(file)] = target

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        if self.folder:
            self.folder.cleanup()


def packed(root: Path) -> tuple[bytes, bytes]:
    """Return what was measured in a checkout, distilled, and its whole reports; both compressed."""
    distilling = _distilling(root)
    layers, reports = [], {}
    for path in sorted((root / "reports").glob("*/report.json")):

        def text(name: str, folder: Path = path.parent) -> str | None:
            return (folder / name).read_text(encoding="utf-8") if (folder / name).is_file() else None

        reports[path.parent.name] = json.loads(path.read_bytes())
        layers.append(distilling.layer(reports[path.parent.name], text))
    return distilling.packed(distilling.combined(layers)), distilling.packed_reports(reports)


def _distilling(root: Path) -> ModuleType:
    """Return the module of the package that does it, which needs nothing but the standard library."""
    sys.path.insert(0, str(root))  # nothing is installed yet
    try:
        return importlib.import_module("harness.reports.answers.digest")
    finally:
        sys.path.remove(str(root))
