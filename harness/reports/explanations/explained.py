"""Describe the document that `explain --json` prints."""

from __future__ import annotations

import msgspec

from harness.model.report_types import DiagnosisEntry, FindingEntry


class Explained(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `explain --json`: `decisive` is the line that says why, None where nothing failed.

    `diagnoses` are the causes, the most likely first; none where the cause is unknown. `phase` is where it failed, as
    far as the text tells.
    """

    schema: int = 1
    decisive: str | None
    phase: str | None
    diagnoses: tuple[DiagnosisEntry, ...]
    findings: tuple[FindingEntry, ...]
