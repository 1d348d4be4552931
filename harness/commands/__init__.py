"""One module per verb: `HELP`, `add_arguments(parser)` and `main(args) -> exit code`."""

__all__ = ["select_cells"]
