"""Turn a matrix file into a plan, without I/O: its shape, its ranges, its strategies, its changes, overlay recipes."""

__all__ = [
    "changes",
    "matrix_file",
    "matrix_remedies",
    "matrix_types",
    "overlay_recipes",
    "policies",
    "signatures",
    "version_ranges",
]
