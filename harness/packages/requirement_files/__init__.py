"""Read requirement files from their text: one module per format, each `(text, source, ...) -> Parsed`.

A line that cannot be modelled is named by file and line in `Inputs.not_modelled`; one that is wrong is BadInput.
"""

from harness.packages.requirement_files.entry import Inputs

__all__ = ["Inputs", "entry", "inputs", "project", "yaml_texts"]
