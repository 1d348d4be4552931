"""Hold texts for users to plain English: documents, help, messages, pages, matrices, known failures."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FORBIDDEN = re.compile(
    r"""\b(
    mend(s|ed|ing)? | heirs? | foretell\w* | foretold | whither | anew | none\ such | whatever | whoever | beside
    | what\ comes\ of | comes?\ about | of\ (ours|theirs|yours) | as\ it\ is\ imported | not\ to\ be\ had | thereof
    | for\ who | is\ called\ so | keeps?\ (no|none)(\ \w+){1,3}\ out | keeps?\ no\ (later|earlier) | asks?\ for\ no
    | hands?\ on | says\ nothing | said\ nothing | took\ (it|\w+)\ away | is\ of\ gym(nasium)?
    )\b""",
    re.VERBOSE | re.IGNORECASE,
)
"""Old words, and forms that say by a negation or a relative clause what a plain verb says; each has a plain one: fix,
successor, predict, again, any, with or next to, the result of, on import, has no upper bound, passes, removed."""

CODE = re.compile(r"```.*?```|`[^`\n]*`|https?://\S+|\{[{%#].*?[}%#]\}", re.DOTALL)
"""Parts of a text that are no prose: code, addresses, and a template's expressions."""

SENTENCES = {"reason", "cause", "text", "say", "description", "title", "what", "note"}
"""Keys of a TOML file whose values are prose; ids and patterns are not."""


def texts(path: Path) -> Iterator[str]:
    """Yield the prose of a file that users read."""
    content = path.read_text(encoding="utf-8")
    match path.suffix:
        case ".toml":
            yield from _prose(tomllib.loads(content), inside=path.name == "words.toml")
        case ".py":
            yield from _messages(ast.parse(content))
        case _:
            yield content


def _prose(value: Any, *, inside: bool) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _prose(inner, inside=inside or key in SENTENCES)
    elif isinstance(value, list):
        for inner in value:
            yield from _prose(inner, inside=inside)
    elif isinstance(value, str) and inside:
        yield value


def _messages(tree: ast.Module) -> Iterator[str]:
    """Yield the strings of several words that are no docstrings."""
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in documentation and " " in str(node.value).strip():
            yield str(node.value)


def files() -> Iterator[Path]:
    """Yield the files that hold texts for users; programs of a cell hold codes, whose sentences are in `words.toml`."""
    yield from (ROOT / name for name in ("README.md", "CONTRIBUTING.md"))
    for folder, pattern in (("docs", "*.md"), ("harness", "*.md"), ("harness", "*.j2"), ("harness", "*.toml")):
        yield from (ROOT / folder).rglob(pattern)
    yield from (ROOT / "matrices").rglob("*.toml")
    yield from (ROOT / "matrices" / "pages").rglob("*.md*")
    yield from (ROOT / "harness").rglob("*.py")


FILES = sorted({path for path in files() if not {"incell", "vendored"} & {*path.parts}})


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_texts_are_plain(path: Path) -> None:
    """No text has a word or a turn of phrase of the list."""
    found = [text for text in texts(path) if FORBIDDEN.search(CODE.sub("``", text))]
    assert not [(match[0], text[:100]) for text in found if (match := FORBIDDEN.search(CODE.sub("``", text)))]


LONGEST = 24
"""Words of a sentence of a document; code counts as a word."""
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of a Markdown text, without its code blocks; a cell of a table is one, or several."""
    prose = re.sub(r"^```.*?^```$|<!--.*?-->", "\n\n", text, flags=re.DOTALL | re.MULTILINE)
    prose = re.sub(r"`[^`]*`", "code", re.sub(r"\]\([^)]*\)", "]", prose))
    for part in re.split(r"\n\s*\n|\n(?=[-|#]|\d+\. )|\|", prose):
        yield from (" ".join(sentence.split()) for sentence in re.split(r"(?<=[.!?:;])\s+", part))


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_sentences_of_documents_are_short(path: Path) -> None:
    """No sentence has to be read twice."""
    found = sentences(path.read_text(encoding="utf-8"))
    assert [each for each in found if len(re.findall(r"\b\w[\w'.-]*", each)) > LONGEST] == []


def test_a_long_sentence_is_seen() -> None:
    """It ends with a full stop, not with its line; code in it is one word, a block none."""
    (first, second) = filter(None, sentences(f"{'word ' * 30}\nof `x y z`. Short.\n\n```\n{'word ' * 40}\n```\n"))

    assert (len(first.split()), second) == (32, "Short.")


@pytest.mark.parametrize(
    "text",
    [
        "mend that first",
        "newton keeps none of them out",
        "what comes of that",
        "a bug of ours",
        "shimmy is of gymnasium",
    ],
)
def test_words_are_found(text: str) -> None:
    """The list finds forms that stood in texts before."""
    assert FORBIDDEN.search(text)
