"""Write a page for each known issue, titled with the line of an error that people search for."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from harness.judging.known_issues import Issue
from harness.matrix.signatures import Signature
from harness.model.vocabulary import required_name
from harness.reports.site import addresses
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts
from harness.reports.text import cause_markdown
from harness.standalone.failures import literals, matching

WORD = re.compile(r"[a-z_][a-z0-9_]{2,}")
LONGEST_TITLE = 200
ALIKE = 5
"""Issues that a page names as similar."""


def title(signature: Signature) -> str:
    """Return the line of the first example that shows the issue, word for word; without an example the cause."""
    example = next(iter(signature.examples), "")
    pattern = signature.wording
    match = matching.compile_once(pattern).search(example) if pattern and example else None
    if match:
        # A pattern may reach over several lines: the last one has the exception.
        start = example.rfind("\n", 0, max(match.end() - 1, 0)) + 1
        end = example.find("\n", match.end())
        line = example[start : end if end >= 0 else len(example)].strip()
        return line if len(line) <= LONGEST_TITLE else f"{line[: LONGEST_TITLE - 1]}…"
    lines = example.strip().splitlines()
    return lines[-1].strip() if lines else cause_markdown.first_sentence(signature.cause)


def write(facts: SiteFacts, writer: PageWriter) -> None:
    """Write a page for each known issue."""
    similar = alike(facts.signatures)
    for name, issue in facts.issues_with_cells.items():
        signature = facts.signatures[name]
        packages = dict.fromkeys(map(required_name, issue.packages))
        writer.write(
            addresses.issue_page(name),
            "issue.html.j2",
            issue=issue,
            signature=signature,
            title=title(signature),
            packages=[(package, facts.package_address(package)) for package in packages],
            cells=facts.cell_links(issue.cells),
            alike=[(title(facts.signatures[other]), addresses.issue_page(other), other) for other in similar[name]],
        )


def data(signatures: Mapping[str, Signature]) -> list[dict[str, Any]]:
    """Return what the box of the home page compares a pasted text with."""
    return [_entry(one) for one in signatures.values() if one.wording or one.examples]


def _entry(signature: Signature) -> dict[str, Any]:
    pattern = signature.wording
    return {
        "title": title(signature),
        "name": signature.id,
        "link": addresses.issue_page(signature.id),
        "pattern": pattern,
        "literals": [sorted(clause) for clause in literals.clauses(pattern)] if pattern else [],
        "generic": signature.generic or signature.masks,
        "words": sorted(set(WORD.findall(" ".join(signature.examples).lower())))[:80],
    }


# --- similar ones ----------------------------------------------------------------------------------------------


def alike(signatures: Mapping[str, Signature]) -> dict[str, list[str]]:
    """Return for each issue the most similar ones: by their words, rare words and packages counting most."""
    words = {name: _words(one) for name, one in signatures.items()}
    spread = Counter(word for bag in words.values() for word in bag)
    weights = {word: math.log(len(words) / count) for word, count in spread.items()}
    lengths = {name: math.sqrt(sum(weights[word] ** 2 for word in bag)) or 1.0 for name, bag in words.items()}
    return {name: _nearest(name, words, weights, lengths) for name in words}


def _nearest(
    name: str, words: Mapping[str, set[str]], weights: Mapping[str, float], lengths: Mapping[str, float]
) -> list[str]:
    scores = {
        other: sum(weights[word] ** 2 for word in words[name] & bag) / (lengths[name] * lengths[other])
        for other, bag in words.items()
        if other != name
    }
    best = sorted(scores, key=lambda other: (-scores[other], other))[:ALIKE]
    return [other for other in best if scores[other] > 0.05]


def _words(signature: Signature) -> set[str]:
    packages = {f"package:{required_name(each)}" for part in signature.packages for each in part}
    texts: Iterable[str] = (*signature.examples, signature.cause)
    return packages | set(WORD.findall(" ".join(texts).lower()))


def search_text(issue: Issue) -> str:
    """Return the text by which the search of the home page finds an issue."""
    return " ".join([issue.id, issue.cause, *issue.packages])
