"""Name the tables of a checkout that hold measured combinations without a report."""

from __future__ import annotations

from pathlib import Path

HAND = "tests/real/measured.toml"
AGREEMENT = "tests/real/agreement.md"
JUDGED = "benchmarks/judged.toml"
TRUTH = "benchmarks/judged-truth.toml"
JUDGED_PAGE = "benchmarks/judged.md"
SIGNATURES = "matrices/signatures"


def list_files(root: Path) -> list[Path]:
    """Return the files that `collection` reads of a checkout, without its reports; a wheel has none."""
    tables = (root / name for name in (HAND, AGREEMENT, JUDGED, TRUTH, JUDGED_PAGE))
    return [path for path in (*tables, *sorted((root / SIGNATURES).glob("*.toml"))) if path.is_file()]
