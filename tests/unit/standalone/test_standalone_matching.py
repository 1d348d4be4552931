"""Looking for literals first finds what a regular expression alone finds; the host's matcher is the one of the pyz."""

from __future__ import annotations

import random
import re
from typing import Any

import pytest

from harness.matrix import signatures
from harness.running.signatures import shipped_signatures
from harness.standalone.failures import literals, matching
from harness.standalone.failures.matching import Around, Evidence

WORDS = ("abc", "bcab", "cab")
"""Literals of random patterns: long enough to be looked for, and alike enough to be found by chance."""
PIECES = (*WORDS, *WORDS, "a", "b", "c", "x", "\n", " ")


def pattern(chance: random.Random, depth: int = 3) -> str:
    """Return a regular expression of all that signatures may use."""
    kinds = ["literal", "literal", "class", "any", "edge"] + (["group", "branch", "repeat", "ahead"] if depth else [])
    parts = []
    for _ in range(chance.randint(1, 3)):
        kind = chance.choice(kinds)
        inner = pattern(chance, depth - 1) if depth else ""
        parts.append(
            {
                "literal": lambda: "".join(chance.choice(WORDS) for _ in range(chance.randint(1, 2))),
                "class": lambda: chance.choice(["[ab]", "[^a]", r"\w", "[a-c]", r"[\s\S]"]),
                "any": lambda: chance.choice(
                    [".", ".*", ".*?", "a*", "b?", "c+", "[ab]+", "a{2}", "b{0,2}", "c{1,3}?"]
                ),
                "edge": lambda: chance.choice(["^", "$", r"\b", r"\B"]),
                "group": lambda inner=inner: chance.choice([f"({inner})", f"(?:{inner})"]),
                "branch": lambda inner=inner: f"(?:{inner}|{pattern(chance, depth - 1)}|cab)",
                "repeat": lambda inner=inner: f"(?:{inner})" + chance.choice(["*", "+", "?", "{2}", "{0,1}", "{1,2}?"]),
                "ahead": lambda inner=inner: chance.choice([f"(?={inner})", f"(?!{inner})"]),
            }[kind]()
        )
    return "".join(parts)


def test_random_patterns_are_found_all_the_same() -> None:
    """Random patterns are found in random texts, whatever literals are looked for first."""
    chance = random.Random(6)
    found = spared = 0
    for _ in range(3000):
        written = pattern(chance)
        plain = re.compile(written, re.MULTILINE)
        for _ in range(6):
            text = "".join(chance.choice(PIECES) for _ in range(chance.randint(0, 4)))
            expected = plain.search(text)
            made = matching.search(written, text)
            assert (made and made.span()) == (expected and expected.span()), (written, text)
            found += expected is not None
            spared += not literals.possible(written, text)
    assert min(found, spared) > 3000


def test_known_patterns_are_found_all_the_same() -> None:
    """Known patterns are found in the examples of every signature, whole and with one character lost."""
    chance = random.Random(7)
    known = [one for one in shipped_signatures.load_all() if one.wording]
    texts = [text for one in known for text in one.examples]
    texts += [text[:place] + text[place + 1 :] for text in texts for place in [chance.randrange(len(text))]]
    for one in known:
        plain = re.compile(str(one.wording), re.MULTILINE)
        for text in texts:
            assert bool(matching.search(str(one.wording), text)) is bool(plain.search(text)), (one.id, text)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (r"has no attribute '(bool8|float_)'", [{"has no attribute '"}, {"bool8", "float_"}]),
        (r"a.*b", []),
        (r"module (?:gym|gymnasium) is", [{"module gym"}, {" is"}]),
        (r"(?:one|two|[3-9])", []),
        (r"(?:abc)?def", [{"def"}]),
        (r"(?:abc)+def", [{"abc"}, {"def"}]),
        (r"(?!abcd)efg", [{"efg"}]),
        (r"(?i)abcdef", []),
        (r"(?i:abcdef)ghi", [{"ghi"}]),
        (r"x\.py\", line \d+", [{'x.py", line '}]),
        (r"(abc", []),
    ],
)
def test_literals_of_a_pattern(written: str, expected: list[set[str]]) -> None:
    """The literals that a match must contain are found; optional or variable text gives none."""
    assert sorted(map(sorted, literals.clauses(written))) == sorted(map(sorted, expected))


def test_most_known_patterns_have_literals() -> None:
    """Otherwise looking for them first would gain nothing."""
    known = [str(one.wording) for one in shipped_signatures.load_all() if one.wording]
    assert sum(bool(literals.clauses(one)) for one in known) > 0.9 * len(known)


def plain(one: signatures.Signature) -> dict[str, object]:
    """Return a signature as it stands in its file."""
    packages = [list(part) for part in one.packages]
    keys = ("id", "signal", "python", "masks", "generic", "silent")
    told = {key: getattr(one, key) for key in keys}
    return {"phases": list(one.phases), "packages": packages, "pattern": one.wording, **told}


def test_plain_signatures_are_matched_as_typed_ones() -> None:
    """Two examples of each: with nothing known, then, of those that match, with what is installed or asked for."""
    every = [(one, matching.read(plain(one))) for one in shipped_signatures.load_all()]
    for text in {text for one, _ in every for text in one.examples[:2]}:
        matched = assert_matched_alike(every, text, {})
        fitting = [pair for pair in every if pair[0].id in matched]
        for more in ({"installed": {"numpy": "2.2.6", "gym": "0.26.2"}}, {"requirements": ("numpy<2", "gym>=0.21")}):
            assert_matched_alike(fitting, text, more)


def assert_matched_alike(known: list[tuple[Any, Any]], text: str, more: dict[str, Any]) -> list[str]:
    """Assert that signatures and their plain forms match a text alike, and return the ids that match."""
    typed, plain_forms = [one for one, _ in known], [form for _, form in known]
    hits = matching.diagnose(typed, [Evidence(phase=None, reasons=(text,))], Around(python="3.10", **more))
    seen = matching.Evidence(phase=None, reasons=(text,))
    made = matching.diagnose(plain_forms, [seen], matching.Around(python="3.10", **more))
    matched = [hit.signature.id for hit in hits]
    assert [hit.signature.id for hit in made] == matched
    return matched
