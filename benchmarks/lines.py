"""Explain lines and logs of real threads: `python -m benchmarks.lines [--set-aside] [--look NAME]` writes `lines.md`.

`lines.toml` has the lines and what is true of each. A hash of its id sets half of them aside: `--set-aside` prints the
figures of that half, and nothing else of it. `lines-none.toml` has texts that are no such failure.
`lines-more.toml` and `logs.toml` have further lines and whole logs, all of them open, which were looked at while the
rules were written. `lines-NAME.toml` and `logs-NAME.toml` were not: `--look NAME` explains them once and writes
`lines-NAME.md`.
`lines-judged.toml` has verdicts by hand, for answers that a program cannot judge.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.commands.explain import signatures
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.explain.explain_text import Explanation, Facts, explain_text
from harness.standalone.requirements import requirement
from harness.standalone.versions import canonical

HERE = Path(__file__).parent
LINES, NONE, JUDGED = HERE / "lines.toml", HERE / "lines-none.toml", HERE / "lines-judged.toml"
MORE, LOGS = HERE / "lines-more.toml", HERE / "logs.toml"
PAGE = HERE / "lines.md"
PAGE_OF_ASIDE = HERE / "lines-set-aside.md"
RIGHT, WRONG, SILENT, BY_HAND = "right", "wrong", "silent", "to judge by hand"
FACTS = Facts(history=load_shipped)
VERDICTS = (RIGHT, WRONG, SILENT, BY_HAND)
COUNTING = 2
"""Causes of an answer that count: more than two are no answer."""

LISTS = ("requirements", "constraints", "overrides", "build_constraints")
"""Keys of a remedy that hold requirements."""

QUOTED = re.compile(r"[A-Za-z][\w.-]*(?:\[[\w,-]+\])? ?(?:[<>]=?|==|~=)[\w.*<>=,~ ]*[\w*]")
"""A requirement with a bound within a sentence."""

UPPER, LOWER = frozenset({"<", "<="}), frozenset({">", ">="})
HEAD = """# Single lines of errors, and what `explain` answers

Made by `python -m benchmarks.lines` from [lines.toml](lines.toml): lines that people pasted in threads, with what is
true of each. Half of the lines are set aside by a hash of their id. An answer is right if one of its first two causes
names the package that is at fault, and bounds it on the right side or names it as missing. Answers that a program
cannot judge are judged by hand in [lines-judged.toml](lines-judged.toml). *Silent* names no cause, or leaves open which
side is at fault.
"""

HEAD_OF_LOOK = """# Lines and logs that were drawn when the rules were finished

Made by `python -m benchmarks.lines --look {0}`, once: [lines-{0}.toml](lines-{0}.toml) and
[logs-{0}.toml](logs-{0}.toml). What a program cannot judge was judged by hand afterwards. Whatever is mended for these
texts from now on, this page stays as it is.
"""

HEAD_OF_ASIDE = """# Single lines that no rule was written from

Made by `python -m benchmarks.lines --set-aside`, once, when the rules were finished: the half of
[lines.toml](lines.toml) that a hash set aside before the first run. What a program cannot judge was judged by hand
afterwards. Whatever is mended for these lines from now on, this page stays as it is.
"""


@dataclass(frozen=True)
class Answer:
    """The answer for one line: the causes that count, and the verdict on them."""

    line: Mapping[str, Any]
    explanation: Explanation
    by_hand: Mapping[str, str]

    @property
    def causes(self) -> list[Mapping[str, Any]]:
        """Return the causes that count as their files have them, the most likely first."""
        return [hit.signature.plain for hit in self.explanation.causes[:COUNTING]]

    @property
    def verdict(self) -> str:
        """Return the verdict: by hand for exactly these causes, else by the program."""
        if not self.causes:
            return SILENT
        named = " ".join(cause["id"] for cause in self.causes)
        if named in self.by_hand:
            return self.by_hand[named]
        verdicts = [judge(cause, self.line) for cause in self.causes]
        if RIGHT in verdicts:
            return RIGHT
        return WRONG if set(verdicts) == {WRONG} else BY_HAND


def main(arguments: Sequence[str] | None = None) -> None:
    """Explain the lines and the texts, print the figures and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set-aside", action="store_true", help="print the figures of the half that is set aside, too")
    parser.add_argument(
        "--look", metavar="NAME", help="explain a set that no rule was written from, and write its page"
    )
    args = parser.parse_args(arguments)
    texts = tomllib.loads(NONE.read_text(encoding="utf-8"))["text"]
    shipped = signatures()
    accused = [text for text in texts if explain_text(text["text"], shipped, FACTS).causes]
    opened, more, logs = list(answers(is_aside=False)), list(explained(MORE)), list(explained(LOGS))
    parts = [HEAD, _figures("open half", opened), _figures("further lines", more), _figures("logs", logs)]
    if args.set_aside:
        figures = _figures("half set aside", list(answers(is_aside=True)))
        print(figures)
        PAGE_OF_ASIDE.write_text(f"{HEAD_OF_ASIDE}\n{figures}", encoding="utf-8")
    if args.look:
        _look(args.look)
    parts.append(f"{len(accused)} of {len(texts)} texts that are no such failure are blamed on a package.\n")
    print("\n".join(parts[1:]))
    details = [*(_accusation(text) for text in accused), *map(_detail, opened)]
    parts += ["## Lines of the open half\n", *details, "## Further lines\n", *map(_detail, more)]
    parts += ["## Logs\n", *map(_detail, logs)]
    PAGE.write_text("\n".join(parts), encoding="utf-8")


def _look(name: str) -> None:
    """Explain a set of lines and logs, and write its figures and each answer. Raises SystemExit for a second look."""
    page = HERE / f"lines-{name}.md"
    if page.is_file():
        sys.exit(f"{page.name} is there: it was looked at before")
    looked = {kind: list(explained(HERE / f"{kind}-{name}.toml")) for kind in ("lines", "logs")}
    figures = [_figures(f"{name} {kind}", some) for kind, some in looked.items()]
    print("\n".join(figures))
    details = [part for kind, some in looked.items() for part in (f"## The {kind}\n", *map(_detail, some))]
    page.write_text("\n".join([HEAD_OF_LOOK.format(name), *figures, *details]), encoding="utf-8")


def is_set_aside(identifier: str) -> bool:
    """Return whether a line is set aside: the first hexadecimal digit of the SHA-256 of its id is odd."""
    return int(hashlib.sha256(identifier.encode()).hexdigest()[0], 16) % 2 == 1


def judge(cause: Mapping[str, Any], truth: Mapping[str, Any]) -> str:
    """Judge a cause by the bounds of its remedy on the package that is at fault.

    It is wrong if it bounds that package on the other side only. Whatever names it otherwise, or not at all, has to be
    judged by hand.
    """
    remedy = cause.get("remedy", {})
    package = canonical(truth["package"])
    bounds = [parsed for parsed in _requirements(remedy) if parsed[0] == package]
    if truth["side"] == "missing":
        words = " ".join([cause["cause"], remedy.get("text", ""), *remedy.get("environment", {})])
        return RIGHT if bounds or _speaks_of(truth["package"], words) else BY_HAND
    wanted, other = (UPPER, LOWER) if truth["side"] == "too new" else (LOWER, UPPER)
    operators: set[str] = set().union(*(signs for _, signs in bounds))
    if truth["side"] == "other" or not operators:
        return BY_HAND
    return RIGHT if operators & wanted else WRONG if operators & other else BY_HAND


def _requirements(remedy: Mapping[str, Any]) -> Iterator[tuple[str, set[str]]]:
    """Yield the packages that a remedy bounds, each with the operators of its bounds."""
    for text in (*(each for key in LISTS for each in remedy.get(key, ())), *QUOTED.findall(remedy.get("text", ""))):
        try:
            parsed = requirement(text)
        except ValueError:
            continue
        yield parsed.name, set(re.findall(r"[<>]=?|==|~=", text.partition(";")[0]))


def _speaks_of(package: str, words: str) -> bool:
    pattern = "[-_.]".join(map(re.escape, re.split(r"[-_.]", package)))
    return re.search(rf"(?<![\w-]){pattern}(?![\w-])", words, re.IGNORECASE) is not None


def answers(*, is_aside: bool) -> Iterator[Answer]:
    """Explain the lines of the half that is set aside, or of the other one."""
    return explained(LINES, lambda line: is_set_aside(line["id"]) == is_aside)


def explained(file: Path, wanted: Callable[[Mapping[str, Any]], bool] = lambda _: True) -> Iterator[Answer]:
    """Explain the wanted lines of a file."""
    by_hand = tomllib.loads(JUDGED.read_text(encoding="utf-8"))["judged"]
    shipped = signatures()
    for line in tomllib.loads(file.read_text(encoding="utf-8"))["line"]:
        if wanted(line):
            yield Answer(line, explain_text(line["text"], shipped, FACTS), by_hand.get(line["id"], {}))


def _figures(name: str, answers: Sequence[Answer]) -> str:
    """Return the table of verdicts by kind, the sums first."""
    rows = [(f"all of the {name}", answers)]
    for kind in sorted({answer.line["kind"] for answer in answers}):
        rows.append((kind, [answer for answer in answers if answer.line["kind"] == kind]))
    lines = [f"| kind | lines | {' | '.join(VERDICTS)} |", "| --- |" + " ---: |" * (len(VERDICTS) + 1)]
    for kind, some in rows:
        counts = Counter(answer.verdict for answer in some)
        lines.append(f"| {kind} | {len(some)} | {' | '.join(str(counts[verdict]) for verdict in VERDICTS)} |")
    return "\n".join([*lines, ""])


def _accusation(text: Mapping[str, Any]) -> str:
    first = text["text"].strip().splitlines()[-1]
    return f"- blamed although it is no such failure ({text['why']}): `{first}`\n"


def _detail(answer: Answer) -> str:
    """Return the line, what is true of it, and what was answered."""
    line = answer.line
    shown = [
        f"### [{line['id']}]({line['source']}): {answer.verdict}\n",
        f"```\n{line['text'].strip()}\n```\n",
        f"True: {line['package']} is {line['side'].replace('other', 'at fault otherwise')}. {line['cause']} "
        f"Fix: {line['fix']}.\n",
    ]
    for cause in answer.causes:
        remedy = "; ".join(f"{key} {value}" for key, value in cause.get("remedy", {}).items())
        shown.append(f"Answered: `{cause['id']}`: {cause['cause']} Fix: {remedy}\n")
    if not answer.causes:
        notes = [f"Note: {text}\n" for _, _, text in answer.explanation.findings]
        shown += ["Answered: no cause.\n", *notes]
    return "\n".join(shown)


if __name__ == "__main__":
    main()
