"""One module per verb: `HELP`, `add_arguments(parser)` and `main(args) -> exit code`; options that verbs share."""

__all__ = ["arguments", "select_cells", "verb_help"]
