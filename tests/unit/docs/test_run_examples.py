"""The runner of the documents' commands reads pages as written, and finds each difference."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

PATH = Path(__file__).parents[3] / "docs" / "making" / "run_examples.py"
SPECIFICATION = importlib.util.spec_from_file_location("run_examples", PATH)
assert SPECIFICATION
assert SPECIFICATION.loader
run_examples = importlib.util.module_from_spec(SPECIFICATION)
sys.modules["run_examples"] = run_examples
SPECIFICATION.loader.exec_module(run_examples)

PAGE = """
<!-- example: file=a.txt -->
```text
one
```

<!-- example: exit=3 network -->
```console
$ cat a.txt
one
$ printf 'two \\
> three'; exit 3
two three
```

```
not a command
```
"""


def test_a_page_is_read_in_its_order() -> None:
    """A file, then two commands; the exit code is the last one's, the network both's."""
    written, first, last = run_examples.examples(PAGE)

    assert (written.file, written.output) == ("a.txt", "one\n")
    assert (first.command, first.output, first.exit_code, first.network) == ("cat a.txt", "one", 0, True)
    assert (last.command, last.output, last.exit_code) == ("printf 'two \\\nthree'; exit 3", "two three", 3)


@pytest.mark.parametrize(
    ("page", "message"),
    [
        ("<!-- example: exti=1 -->\n```console\n$ true\n```\n", "unknown option"),
        ("<!-- example: exit=1 -->\n```toml\na = 1\n```\n", "before a block that is no `console`"),
        ("```console\nsimmatrix known\n```\n", "begins with a command"),
    ],
)
def test_a_mistake_in_a_page_is_refused(page: str, message: str) -> None:
    """An example that would never run is no example."""
    with pytest.raises(ValueError, match=message):
        list(run_examples.examples(page))


@pytest.mark.parametrize(
    ("expected", "printed", "same"),
    [
        ("good  a\nbad b", "good a\nbad b\n", True),
        ("good a\n...\nlast", "good a\nbad b\nbad c\nlast\n", True),
        ("good ... last", "good a\n  and last\n", True),
        ("good a", "good a\nbad b\n", False),
        ("good a\n...", "bad b\n", False),
        ("...\nlast ...", "first\n", False),
        ("2.*", "23", False),
        ("", "\n", True),
        ("", "something\n", False),
    ],
)
def test_dots_stand_for_any_text_and_nothing_else_does(expected: str, printed: str, same: bool) -> None:
    """Words and their order are compared, not the places where lines are wrapped."""
    assert run_examples.fits(expected, printed) is same
