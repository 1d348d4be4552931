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
    | hands?\ on | says\ nothing | said\ nothing | took\ (it|\w+)\ away | is\ of\ (gym(nasium)?|mujoco)
    | of\ before | since\ then | (has|have)\ no\ longer | (is|are)\ gone(\ \w+)?\ since | unasked | (go|goes|went)\ well
    | stands?\ (above|last|under|there) | last\ words | harms?\ nothing | worth\ nothing | told\ nowhere | none,\ either
    | without\ the\ harness | by\ the\ system's\ packages
    )\b""",
    re.VERBOSE | re.IGNORECASE,
)
"""Old words, and forms that say by a negation or a relative clause what a plain verb says; each has a plain one: fix,
successor, predict, again, any, with or next to, the result of, on import, has no upper bound, passes, removed; older,
later, no longer has, automatically, works, is above, harmless, without simmatrix."""

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


KNOWN_ISSUES = sorted((ROOT / "matrices" / "signatures").glob("*.toml"))


def issue_faults(prose: str) -> Iterator[str]:
    """Yield what makes the cause or the fix of a known issue hard to read; code counts as a capital, and as a word."""
    text = re.sub(r"`[^`]*`", "Code", prose)
    if not re.match(r"[A-Z]", text):
        yield f"begins without a capital or code: {prose[:60]}"
    if not re.search(r"[.?!]\)?$", text):
        yield f"ends without a full stop: {prose[-60:]}"
    if "`" in text:
        yield f"has a backtick without its pair: {prose[:60]}"
    for sentence in re.split(r"(?<=[.!?:;])\s+", text):
        if len(words := re.findall(r"\b\w[\w'.-]*", sentence)) > LONGEST:
            yield f"{len(words)} words: {sentence}"


@pytest.mark.parametrize("path", KNOWN_ISSUES, ids=lambda path: path.stem)
def test_known_issues_are_short_sentences(path: Path) -> None:
    """Causes and fixes are read at two in the morning: sentences of at most 24 words, from a capital to a full stop."""
    issues = tomllib.loads(path.read_text(encoding="utf-8"))["signature"]
    prose = [(each["id"], text) for each in issues for text in (each["cause"], each["remedy"].get("text")) if text]

    assert issues
    assert [(name, fault) for name, text in prose for fault in issue_faults(text)] == []


@pytest.mark.parametrize(
    ("prose", "fault"),
    [
        ("numpy 1.24 removed `np.float`.", "capital"),
        ("Or take gym>=0.22", "full stop"),
        ("Install `numpy<2.", "backtick"),
        (f"Gym {'reads ' * 24}`a b c`.", "26 words"),
        (f"{'word ' * 20}; {'word ' * 25}", "25 words"),
    ],
)
def test_hard_prose_is_seen(prose: str, fault: str) -> None:
    """Each of the faults is found; a text without one is none."""
    assert any(fault in each for each in issue_faults(prose))
    assert [*issue_faults("`pip` 24.1 skips it. (Python 3.7 has none.)")] == []


@pytest.mark.parametrize(
    "text",
    [
        "mend that first",
        "newton keeps none of them out",
        "what comes of that",
        "a bug of ours",
        "shimmy is of gymnasium",
        "packages of before look into it",
        "why it ended stands above",
        "a name that NumPy 2 has no longer",
    ],
)
def test_words_are_found(text: str) -> None:
    """The list finds forms that stood in texts before."""
    assert FORBIDDEN.search(text)
