"""Mutations of real files: of their tokens, their lines, their bytes, and of the values of a JSON document."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Sequence
from typing import Any

TOKEN = re.compile(r'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|[\w.+-]+|\s+|.', re.DOTALL)
ATOMS = (
    "", "0", "-1", "1e999", "nan", "true", "null", "1" * 5000,
    "9" * 25, "3.10", "[]", "{}", '""', "''", "[[[[", "}}}}",
    "[" * 3000, "{a=" * 3000, '{"a":' * 3000, "(" * 3000, "x." * 2000 + "x", "\0", "\x1b[31m", "\x9b", "\x85", "\u202e",
    "\ud800", '"\\ud800"', "\\", "\\\n", "#", "=", ":", ",", ";", "@", "*", "*a" * 30, "?", "%s", "{{ x }}", "{% x %}",
    "$HOME", "${X}", "~", "/", "..", "../../etc/passwd", "/etc/passwd", "/dev/zero", "a" * 300, "a" * 50_000,
    " " * 50_000,
    "latest", "host", "absent", "unset", ">=0", "==*", "!=1,<", "~=1", "===x", "1!2.3.post1.dev4+local", "99999-99-99",
    "2026-01-01", "2026-01-01T00:00:00Z", "0000-00-00T99:99:99+99:99", "; python_version < '3'", "; extra == 'x'",
    "http://[", "git+https://x", "file:///x",
    "-r", "-e .", "--hash=sha256:0", "-c x", "&a", "*a", "<<: *a", "!!python/x",
    "| ", "- ", "? ", "```", "![x](http://x)", "\n", "\r", "\t", "\n[", "[[cases]]\n", "[axes]\n",
)  # fmt: skip
"""Replacements of a token: limits, other types, syntax of every format, characters that terminals and pages obey."""


def mutate(seeds: Sequence[str], chance: random.Random) -> str:
    """Return one of the texts with one to six mutations."""
    text = chance.choice(seeds)
    for _ in range(chance.choice((1, 1, 1, 1, 2, 5))):
        text = chance.choice(MUTATIONS)(text, seeds, chance)
    return text


def mutate_json(seeds: Sequence[str], chance: random.Random) -> str:
    """Return one of the JSON documents with other values, keys or depths; now and then as mutated text."""
    if chance.random() < 0.2:
        return mutate(seeds, chance)
    document = json.loads(chance.choice(seeds))
    for _ in range(chance.choice((1, 1, 2, 4))):
        _mutate_value(document, chance)
    return json.dumps(document)


def content(text: str, chance: random.Random) -> bytes:
    """Return a text as bytes, now and then in an encoding that nobody expects, or with a bit that is wrong."""
    data = text.encode("utf-8", "surrogatepass")
    match chance.randrange(40):
        case 0:
            return text.encode("utf-16", "surrogatepass")
        case 1:
            return b"\xef\xbb\xbf" + data
        case 2 if data:
            place = chance.randrange(len(data))
            return data[:place] + bytes([data[place] ^ 1 << chance.randrange(8)]) + data[place + 1 :]
    return data


def _replace_token(text: str, seeds: Sequence[str], chance: random.Random) -> str:
    tokens = TOKEN.findall(text) or [""]
    atom = chance.choice(ATOMS) if chance.random() < 0.7 else chance.choice(TOKEN.findall(chance.choice(seeds)) or [""])
    words = [place for place, token in enumerate(tokens) if token[0:1].isalnum() or token[:1] in "'\""]
    place = chance.choice(words) if words and chance.random() < 0.7 else chance.randrange(len(tokens))
    quoted = tokens[place][:1] in "'\"" if chance.random() < 0.8 else chance.random() < 0.5
    tokens[place] = json.dumps(atom) if quoted and atom[:1] not in "'\"" else atom
    return "".join(tokens)


def _drop_tokens(text: str, seeds: Sequence[str], chance: random.Random) -> str:
    tokens = TOKEN.findall(text)
    start = chance.randrange(len(tokens) + 1)
    del tokens[start : start + chance.randrange(1, 8)]
    return "".join(tokens)


def _repeat_tokens(text: str, seeds: Sequence[str], chance: random.Random) -> str:
    tokens = TOKEN.findall(text)
    start = chance.randrange(len(tokens) + 1)
    piece = tokens[start : start + chance.randrange(1, 12)]
    return "".join([*tokens[:start], *piece * chance.choice((2, 2, 30)), *tokens[start:]])


def _swap_lines(text: str, seeds: Sequence[str], chance: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    if len(lines) < 2:
        return text
    first, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[first], lines[other] = lines[other], lines[first]
    return "".join(lines)


def _splice(text: str, seeds: Sequence[str], chance: random.Random) -> str:
    other = chance.choice(seeds)
    return text[: chance.randrange(len(text) + 1)] + other[chance.randrange(len(other) + 1) :]


def _cut(text: str, seeds: Sequence[str], chance: random.Random) -> str:
    return text[: chance.randrange(len(text) + 1)]


MUTATIONS: tuple[Callable[[str, Sequence[str], random.Random], str], ...] = (
    _replace_token, _replace_token, _replace_token, _drop_tokens, _repeat_tokens, _swap_lines, _splice, _cut,
)  # fmt: skip


def _mutate_value(document: Any, chance: random.Random) -> None:
    """Change one value somewhere, each level being as likely as the one below it."""
    places: list[tuple[Any, Any]] = []
    inner = document
    while isinstance(inner, dict | list) and inner:
        key = chance.choice(sorted(inner)) if isinstance(inner, dict) else chance.randrange(len(inner))
        places.append((inner, key))
        inner = inner[key]
    if not places:
        return
    holder, key = chance.choice(places)
    match chance.randrange(10):
        case 6 | 7 | 8 | 9 if isinstance(holder[key], str):
            holder[key] = chance.choice([*ATOMS, holder[key] * 2, holder[key][:-1], chance.choice(ATOMS) + holder[key]])
        case 0:
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[chance.choice(ATOMS)] = holder.pop(key)
        case 2:
            for _ in range(chance.choice((1, 3, 40))):
                holder[key] = [holder[key]]
        case 3:
            holder[key] = chance.choice([None, True, -1, 0, 1e308, 10**30, [], {}, [None], {"": None}])
        case 4 if isinstance(holder, list):
            holder.extend(holder[:] if len(holder) < 1000 else ())
        case _:
            holder[key] = chance.choice(ATOMS)
