"""Requirements within the limits of `packaging`, and files of them that only a fuzzer writes."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from time import monotonic

import pytest
from packaging.requirements import InvalidRequirement
from packaging.specifiers import InvalidSpecifier
from packaging.version import InvalidVersion

from harness.model import requirement_texts, vocabulary
from harness.model.errors import BadInput
from harness.model.vocabulary import Kind
from harness.packages.requirement_files import inputs

DEEP = "numpy; " + "(" * 2000 + 'python_version > "3"' + ")" * 2000


def test_lines_that_packaging_cannot_take_are_refused() -> None:
    """Markers nested too deep and numbers of too many digits are wrong, no crash."""
    with pytest.raises(InvalidRequirement, match="nested too deep"):
        requirement_texts.requirement(DEEP)
    with pytest.raises(InvalidRequirement, match="too many digits"):
        requirement_texts.requirement("numpy==" + "1" * 5000)
    with pytest.raises(InvalidSpecifier, match="too many digits"):
        requirement_texts.specifiers(">=" + "1" * 5000)
    with pytest.raises(InvalidVersion, match="too many digits"):
        requirement_texts.version("1" * 5000)


def test_a_quote_of_them_is_short() -> None:
    """A message shows the beginning of what was wrong."""
    with pytest.raises(ValueError, match="nested too deep") as raised:
        vocabulary.parsed_requirement(DEEP)
    assert len(str(raised.value)) < 300


@pytest.mark.parametrize(
    ("pattern", "value", "fits"),
    [
        ("egl", "egl", True),
        ("egl", "eglx", False),
        ("*", "", True),
        ("e*l", "el", True),
        ("e*el", "el", False),
        ("*a*b*", "xxaxxbxx", True),
        ("*ab*ba*", "xaba", False),
        ("a?c", "abc", True),
        ("a?c", "ac", False),
        ("?*?", "a", False),
        ("?*?", "ab", True),
        ("a.c", "abc", False),
        ("*a?*a*", "xaxa", True),
        ("", "unset", True),
    ],
)
def test_a_pattern_of_a_when(pattern: str, value: str, *, fits: bool) -> None:
    """`*` stands for any text, `?` for one character, and nothing else for anything but itself."""
    assert vocabulary.matcher(Kind.VARIABLE, pattern)(value) is fits


def test_a_pattern_of_many_stars_takes_no_time() -> None:
    """Each piece is looked for once."""
    began = monotonic()
    assert not vocabulary.matcher(Kind.VARIABLE, "*a" * 50 + "*b")("a" * 5000)
    assert monotonic() - began < 1


LONG = {
    "blanks.txt": "numpy" + " " * 200_000 + "x\n",
    "comments.txt": "numpy" + " #" * 100_000 + "\n",
    "continued.txt": "\\\n" * 100_000 + "numpy\n",
    "option.txt": "--find-links '" + "a b" * 350_000 + "'\n",
    "quote.txt": "--find-links '" + "a b" * 350_000 + "\n",
    "escapes.txt": "--find-links " + "\\a" * 350_000 + '"\n',
    "many.txt": "".join(f"p{number}\n" for number in range(100_000)),
    "environment.yml": "dependencies:\n" + "".join(f" - p{number}\n" for number in range(100_000)),
    "pyproject.toml": '[project]\nname = "x"\ndependencies = [' + '"p",' * 100_000 + "]\n",
}


@pytest.mark.parametrize("name", LONG)
def test_a_long_file_is_read_or_refused_at_once(tmp_path: Path, name: str) -> None:
    """No reader takes time that grows with the square of a file."""
    (tmp_path / name).write_text(LONG[name])
    began = monotonic()
    with suppress(BadInput):
        inputs.read([tmp_path / name])
    assert monotonic() - began < 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("dependencies:\n - python\x1b\n", "environment.yml:2: YAML allows no character U+001B here"),
        ("x: " + "[" * 3000 + "]" * 3000, "environment.yml: is nested too deep"),
        ("dependencies:\n - [a]\n", "environment.yml:2: expected the name of a package"),
        ("dependencies:\n - pip: x\n", "environment.yml:2: expected a list"),
        ("dependencies:\n - pip:\n   - {a: b}\n", "environment.yml:3: expected the name of a package"),
    ],
)
def test_an_environment_of_conda_that_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    """Characters, depth and shapes that nobody expects are named with their line."""
    monkeypatch.chdir(tmp_path)
    Path("environment.yml").write_text(text)
    with pytest.raises(BadInput) as raised:
        inputs.read([Path("environment.yml")])
    assert str(raised.value) == message
