"""Write the causes of a matrix as Markdown: each once, with its combinations, its fix as commands, and its issue."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence

from msgspec import Struct

from harness.model import Verdict
from harness.model.report_types import SYMBOLS, UNTOLD, format_count, word
from harness.reports.tables.table_types import Explanation, Report, Trouble
from harness.reports.text.markdown_texts import ADDRESS, address, block, code, code_cell, prose, table_cell

LONGEST = 100
"""Characters of a cause or a line in the list of causes."""

REFERENCES = 3
"""Links of a cause that its section shows; `simmatrix known` has all."""

UNBLAMED = {
    Verdict.WORKS: "It works, which was not expected.",
    Verdict.UNAVAILABLE: "This machine lacks something that the combination needs.",
    Verdict.INCONCLUSIVE: "This machine could not decide it.",
}
"""Sentences for results without a known cause that no package is blamed for."""

INDEXED = 2
"""Causes up to which a list of them would say nothing that their headings do not say."""

NAMED, LISTED = 3, 6
"""Combinations that are named where there are more than a few, and how many are a few."""


class Headings(Struct, frozen=True):
    """The headings of the causes of a page, and the anchors that GitHub makes of them."""

    titles: Mapping[int, str] = {}
    anchors: Mapping[int, str] = {}

    def title(self, trouble: Trouble) -> str:
        """Return the heading of a cause: the id of its known issue as code, else a number and its verdicts."""
        return self.titles[id(trouble)]

    def link(self, trouble: Trouble) -> str:
        """Return a link to the section of a cause, for a table."""
        title, target = self.titles[id(trouble)], self.anchors[id(trouble)]
        text = table_cell(title.split(":")[0]) if not trouble.known else table_cell(title)
        return f"[{text}](#{target})" if re.fullmatch(r"[\w.-]+", target) else text


def find_headings(report: Report) -> Headings:
    """Return the headings of all causes of a page; equal ones get anchors as GitHub tells them apart."""
    titles: dict[int, str] = {}
    anchors: dict[int, str] = {}
    seen: dict[str, int] = {}
    troubles = (one for sheet in report.sheets for one in sheet.troubles)
    for number, trouble in enumerate(troubles, 1):
        verdicts = " and ".join(word(verdict) for verdict, _ in trouble.verdicts)
        title = code(trouble.known) if trouble.known else f"Cause {number}: {verdicts}"
        target = re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")
        again = seen.get(target, 0)
        seen[target] = again + 1
        titles[id(trouble)] = title
        anchors[id(trouble)] = f"{target}-{again}" if again else target
    return Headings(titles, anchors)


def cause_index(troubles: Sequence[Trouble], headings: Headings) -> str:
    """Return a table of many causes: how many combinations, and the fix; empty for a few."""
    if len(troubles) <= INDEXED:
        return ""
    rows = [[_index_name(one, headings), str(one.cells), table_cell(short_fix(one))] for one in troubles]
    lines = [["cause", "combinations", "fix"], ["---", "--:", "---"], *rows]
    if not any(fixes for *_, fixes in rows):
        lines = [line[:2] for line in lines]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _index_name(trouble: Trouble, headings: Headings) -> str:
    """Return the link to a cause; of one that has no name also its first words, or its error line."""
    link = headings.link(trouble)
    if trouble.known:
        return link
    words = table_cell(cut(first_sentence(trouble.cause))) if trouble.cause else code_cell(cut(trouble.line))
    return f"{link}: {words}" if words else link


def cut(text: str) -> str:
    """Return one line of a text, its end cut off if it is long."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 1].rstrip()}…"


def short_fix(trouble: Trouble) -> str:
    """Return the commands of a fix as code, else the first sentence of its words."""
    if trouble.commands:
        return ", ".join(map(code, trouble.commands))
    return sentence(first_sentence(trouble.remedy)).removesuffix(".")


def where(trouble: Trouble) -> str:
    """Return a sentence on the combinations of a cause and their results."""
    return f"{trouble.where[:1].upper()}{trouble.where[1:]}: {describe_results(trouble)}."


def why(trouble: Trouble) -> str:
    """Return the cause in words: of a known issue, or what the matrix says; else that nobody knows it."""
    if trouble.known or trouble.cause:
        return prose(sentence(trouble.cause))
    return UNBLAMED.get(trouble.verdicts[0][0], "No known issue fits.")


def fix(trouble: Trouble) -> str:
    """Return the fix in words, whether it was tried, and the commands to paste; empty if there is nothing to do."""
    parts = []
    if trouble.remedy:
        tried = proven(trouble)
        parts.append(f"**Fix**{f' ({tried})' if tried else ''}: {prose(sentence(trouble.remedy))}")
    search = () if trouble.commands else _search(trouble)
    if search:
        parts.append("To apply it and prove it by a rerun:" if trouble.remedy else "To search for a fix:")
    if trouble.commands or search:
        parts.append(block("\n".join(trouble.commands or search), "sh"))
    return "\n\n".join(parts)


def _search(trouble: Trouble) -> tuple[str, ...]:
    """Return the command that searches for a fix; none where a fix is in words, or the matrix gives the cause."""
    if trouble.cause and not trouble.known:
        return ()
    failed = {verdict for verdict, _ in trouble.verdicts} - UNTOLD - {Verdict.WORKS}
    if not failed or not trouble.example or (trouble.remedy and not trouble.applicable):
        return ()
    return (f"simmatrix repair {shlex.quote(trouble.example)}",)


def sources(trouble: Trouble) -> str:
    """Return links to what is known of a cause, and the command that shows all of it; empty if nothing is known."""
    links = [reference(link) for link in trouble.references[:REFERENCES]]
    shown = ", ".join(links)
    if not trouble.known:
        return f"See {shown}." if links else ""
    command = code(f"simmatrix known {shlex.quote(trouble.known)}")
    return f"Known issue: {shown}. Details: {command}." if links else f"Known issue: {command}."


def also(trouble: Trouble, headings: Headings, troubles: Iterable[Trouble]) -> Iterator[str]:
    """Yield a line for each further known issue; one that has a section of its own is linked there."""
    subject = "it" if trouble.cells == 1 else "some of them"
    sections = {one.known: one for one in troubles if one.known}
    for cause in trouble.also:
        if cause.signature in sections:
            yield f"{headings.link(sections[cause.signature])} fits {subject}, too."
            continue
        remedy = f" Fix: {prose(sentence(cause.remedy))}" if cause.remedy else ""
        proof = "".join(f" (proven: {code(cell)} works)" for cell, _ in cause.proofs)
        links = "".join(f" {reference(link)}" for link in cause.references[:REFERENCES])
        yield f"{code(cause.signature)} fits {subject}, too: {prose(sentence(cause.cause))}{remedy}{proof}{links}"


def unexpected(trouble: Trouble) -> list[str]:
    """Return sentences on results that nobody expected; of an unknown cause also what the matrix expected."""
    return [text for text, expected in _expectations(trouble) if not (expected and trouble.known)]


def details(trouble: Trouble) -> str:
    """Return what the section of a cause folds: what the matrix says of it, and the error lines by combination."""
    reasons = [f"{text}\n" for text, expected in _expectations(trouble) if expected and trouble.known]
    return "\n".join([*reasons, *([_lines(trouble)] if _several_lines(trouble) else [])])


def summary(trouble: Trouble) -> str:
    """Return the line of a section's details that is shown while they are folded."""
    lines = "Error lines by combination" if _several_lines(trouble) else ""
    reasons = "why the matrix expects it" if any(expected for _, expected in _expectations(trouble)) else ""
    text = "; ".join(filter(None, (lines, reasons if trouble.known else "")))
    return f"{text[:1].upper()}{text[1:]}"


def _several_lines(trouble: Trouble) -> bool:
    return len(_merged(trouble.explanations)) > 1 or any(one.hidden_by for one in trouble.explanations)


def _lines(trouble: Trouble) -> str:
    """Return a table of the combinations of a cause by their error line, and what hid it."""
    hidden = any(one.hidden_by for one in trouble.explanations)
    head = ["combinations", "result", "error line", *(["hidden behind"] if hidden else [])]
    rows = [
        [
            table_cell(few(one.cells)),
            f"{SYMBOLS[one.verdict]} {word(one.verdict)}{f' in {one.phase}' if one.phase else ''}",
            code_cell(one.decisive),
            *([", ".join(code_cell(mask) for mask in one.hidden_by)] if hidden else []),
        ]
        for one in _merged(trouble.explanations)
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in [head, ["---" for _ in head], *rows])


def _merged(explanations: Iterable[Explanation]) -> list[Explanation]:
    """Return the explanations that differ in what the table shows."""
    groups: dict[tuple[object, ...], list[Explanation]] = {}
    for why in explanations:
        groups.setdefault((why.verdict, why.phase, why.decisive, why.hidden_by), []).append(why)
    return [
        Explanation(
            verdict=held[0].verdict,
            phase=held[0].phase,
            decisive=held[0].decisive,
            hidden_by=held[0].hidden_by,
            expected="",
            link="",
            cells=tuple(dict.fromkeys(cell for one in held for cell in one.cells)),
        )
        for held in groups.values()
    ]


def _expectations(trouble: Trouble) -> list[tuple[str, bool]]:
    """Return what the matrix expected, each reason once, and whether it came so; not what is told as the cause."""
    redundant = {f"as expected: {trouble.cause}", "as expected", ""}
    groups: dict[tuple[str, str], list[str]] = {}
    for reason in trouble.explanations:
        if reason.expected not in redundant:
            groups.setdefault((reason.expected, reason.link), []).extend(reason.cells)
    return [
        (_expectation(text, link, cells if len(cells) < trouble.cells else ()), text.startswith("as expected"))
        for (text, link), cells in groups.items()
    ]


def _expectation(text: str, link: str, cells: Sequence[str]) -> str:
    """Return a sentence on an expectation, with the combinations that it is about if it is not about all."""
    subject = f"{few(cells)}: {prose(text.rstrip('.'))}." if cells else prose(sentence(text))
    return subject + (f" See {reference(link)}." if link else "")


# --- words -----------------------------------------------------------------------------------------------------


def describe_results(trouble: Trouble) -> str:
    """Return the results of the cells of a cause: `◐ 2 partial, ✘ broken in single`."""
    several = len(trouble.verdicts) > 1
    verdicts = ", ".join(
        f"{SYMBOLS[each]} {f'{count} ' if several else ''}{word(each)}" for each, count in trouble.verdicts
    )
    return verdicts + (f" in {', '.join(trouble.phases)}" if trouble.phases else "")


def unknown(trouble: Trouble) -> str:
    """Return the words for a cause where no known failure fits."""
    verdict = trouble.verdicts[0][0]
    return "it works" if verdict is Verdict.WORKS else word(verdict) if verdict in UNTOLD else "not known"


def first_sentence(text: str) -> str:
    """Return the text up to the first full stop that ends a sentence."""
    match = re.match(r".*?[^.][.](?= [A-Z`(]|$)", text)
    return (match[0] if match else text).removesuffix(".")


def proven(trouble: Trouble) -> str:
    """Say which cell proves a fix, and for how many cells if not for all; or that nobody tried it."""
    if trouble.proofs:
        return f"proven by {code(trouble.proofs[0][0])}" + (
            f", for {trouble.proven} of {trouble.cells}" if trouble.proven < trouble.cells else ""
        )
    if trouble.neighbour:
        return f"proven by a neighbour: {code(trouble.neighbour)} works and differs only in this"
    if trouble.together:
        return f"not tried alone; {code(trouble.together)} works with this and more"
    return "not tried" if trouble.applicable else ""


def reference(link: str) -> str:
    """Return a link with a text as short as it can be: `owner/name#12`, else its host."""
    match = re.match(r"https?://(?:www\.)?([^/]+)(?:/([^/]+/[^/]+)/(?:issues|pull|discussions)/(\d+))?", link)
    text = (f"{match[2]}#{match[3]}" if match[3] else match[1]) if match else link
    return f"[{table_cell(text)}]({link})" if ADDRESS.fullmatch(link) and ")" not in link else address(link)


def sentence(text: str) -> str:
    """Return text that begins with a capital letter and ends with a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def codes(labels: Iterable[str]) -> str:
    """Return names of combinations as code, each with its machine if it has one."""
    return ", ".join(" on ".join(map(code, label.split(" on "))) for label in labels)


def few(labels: Sequence[str]) -> str:
    """Return a few names as code; of more than `LISTED` names, the first ones and the number of the others."""
    if len(labels) <= LISTED:
        return codes(labels)
    return f"{codes(labels[:NAMED])} and {format_count(len(labels) - NAMED, 'other')}"
