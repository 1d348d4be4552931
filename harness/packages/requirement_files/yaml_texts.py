"""Turn the errors of YAML readers into bad input that names the file and the line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import yaml

from harness.model.errors import BadInput
from harness.model.schema import readable

LONGEST = 300_000
"""Characters: its reader, which is pure Python, needs some seconds for them."""


@contextmanager
def readable_yaml(text: str, file: str) -> Iterator[None]:
    """Let an error of the YAML reader become BadInput, with the file and the line."""
    if len(text) > LONGEST:
        message = f"{file}: cannot be read: it has more than {LONGEST:,} characters"
        raise BadInput(message)
    with readable(file):
        try:
            yield
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            message = f"{file}:{line}: {error.problem}"
            raise BadInput(message) from None
        except yaml.reader.ReaderError as error:
            line = text.count("\n", 0, error.position) + 1
            message = f"{file}:{line}: YAML allows no character U+{int(error.character):04X} here"
            raise BadInput(message) from None
