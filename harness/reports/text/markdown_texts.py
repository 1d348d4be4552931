"""Escape any text for Markdown: it makes no link, picture or mention, and ends no table or code."""

from __future__ import annotations

import re
from collections.abc import Callable

TAG = re.compile(r"<(?=[A-Za-z/!?])(?!https?://)")
WHOLE_TAG = re.compile(r"(?<![\\`])<(?=[A-Za-z/!?])(?!https?://)[^<>`\n]{1,200}>(?!`)")
"""A whole tag in a text, such as `<class 'str'>`; it is shown as code, which needs no entity."""

CODE = re.compile(r"(?<!`)(`+)(?!`)(.+?)(?<!`)\1(?!`)", re.DOTALL)
"""A code span as CommonMark knows it: closed by a run of backticks as long as the one that opens it."""

# Brackets that begin no link stay as they are, so that `gymnasium[mujoco]` and `[Errno 2]` can be read.
LINKS = re.compile(r"!\[|\][(\[:]")
MENTION = re.compile(r"(?<![\w`])@(?=[A-Za-z0-9])")
BACKTICKS = re.compile(r"`+")
ADDRESS = re.compile(r"https?://[^\s<>\"`\\]+")
FILE = re.compile(r"(?!\w+:)[\w.+/~%-]+")
ODD = re.compile(r"(?<!\\)(?:\\\\)*\\$")
"""A backslash at the end, which would take what follows for a character."""


def table_cell(text: str) -> str:
    """Return text that stays in one cell of a table; code between backticks is shown as it is."""
    return _escaped(_tags_as_code(" ".join(text.split())), _prose_in_table, _code_in_table)


def code_cell(text: str) -> str:
    """Return text as a code span that stays in one cell of a table; nothing of an empty text."""
    return _code_in_table(code(" ".join(text.split()))) if text.strip() else ""


def prose(text: str) -> str:
    """Return one line of text in which nothing outside code begins an HTML tag, a link or a picture."""
    return _escaped(_tags_as_code(re.sub(r"\s*\n\s*", " ", text)), _prose, str)


def code(text: str) -> str:
    """Return text as a code span, even if it contains backticks."""
    line = re.sub(r"\s*\n\s*", " ", text)
    if "`" not in line:
        return f"`{line}`"
    fence = "`" * (_longest(line) + 1)
    return f"{fence} {line} {fence}"


def block(text: str, language: str = "") -> str:
    """Return text as a fenced block that no line of the text can end."""
    fence = "`" * max(3, _longest(text) + 1)
    return f"{fence}{language}\n{text}\n{fence}"


def address(link: str) -> str:
    """Return a web address as a link between angle brackets, anything else as code."""
    return f"<{link}>" if ADDRESS.fullmatch(link) else code(link)


def file_link(name: str, path: str) -> str:
    """Return a link to a file beside the page; the name alone if the path is no plain file path."""
    return f"[{table_cell(name)}]({path})" if FILE.fullmatch(path) else table_cell(name)


def _longest(text: str) -> int:
    return max(map(len, BACKTICKS.findall(text)), default=0)


def _tags_as_code(text: str) -> str:
    """Put what looks like a tag between backticks; not where a backtick is left over that could pair with these."""
    outside = CODE.sub("", text)
    return text if "`" in outside else _outside_code(text, lambda prose: WHOLE_TAG.sub(r"`\g<0>`", prose))


def _outside_code(text: str, change: Callable[[str], str]) -> str:
    """Change the prose between the code spans; prose that touches one keeps a tag there as it is."""
    pieces, at = [], 0
    for match in CODE.finditer(text):
        pieces += [_inner(text[at : match.start()], change, left=at > 0, right=True), match[0]]
        at = match.end()
    return "".join([*pieces, _inner(text[at:], change, left=at > 0, right=False)])


def _inner(prose: str, change: Callable[[str], str], *, left: bool, right: bool) -> str:
    touches = (left and prose.startswith("<")) or (right and prose.endswith(">"))
    return prose if touches else change(prose)


def _code_in_table(span: str) -> str:
    return span.replace("|", "\\|")


def _prose(text: str) -> str:
    # The character after `@` has no width: the text looks the same, and nobody is called.
    text = MENTION.sub("@&#8203;", TAG.sub("&lt;", text))
    return text.replace("[", "\\[") if LINKS.search(text) else text


def _prose_in_table(text: str) -> str:
    return _prose(text.replace("\\", "\\\\").replace("|", "\\|").replace("*", "\\*"))


def _escaped(text: str, of_prose: Callable[[str], str], of_code: Callable[[str], str]) -> str:
    """Escape prose and code (between backticks), each in its own way."""
    pieces, at = [], 0
    for match in CODE.finditer(text):
        before = of_prose(text[at : match.start()])
        pieces += [f"{before}\\" if ODD.search(before) else before, of_code(match[0])]
        at = match.end()
    return "".join([*pieces, of_prose(text[at:])])
