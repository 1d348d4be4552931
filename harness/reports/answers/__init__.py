"""Answer from all measured results: which versions work together, which traps are known, what was never tried."""

__all__ = [
    "digest",
    "measured_cells",
    "misspelt",
    "recommended",
    "recommended_details",
    "recommended_text",
    "recommending",
    "result_index",
    "shipped_reports",
    "traps",
]
