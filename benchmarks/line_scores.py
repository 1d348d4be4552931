"""Score every sample of lines and logs at once: `python -m benchmarks.line_scores [--save FILE] [--against FILE]`.

It scores the answers of today by the rules of `lines.py`, with the verdicts by hand in `lines-judged.toml`: the open
sets, the half that was set aside, and the samples that were looked at. Their own pages hold the first look; a sample
without a page was not looked at, and is left out. `--save` keeps the answers, `--against` prints a second table, of
answers that were kept, and each text whose verdict changed.
"""

from __future__ import annotations

import argparse
import json
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from benchmarks import lines
from benchmarks.lines import Answer
from harness.commands.explain import signatures
from harness.standalone.explain.explain_text import explain_text

Scores = dict[str, dict[str, list[str]]]
"""By sample and id of a text: the verdict, then the ids of the causes that count."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Explain every sample, and print its verdicts; with kept answers print theirs and the changes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", type=Path, metavar="FILE", help="keep the answers in a JSON file")
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with answers that were kept")
    args = parser.parse_args(arguments)
    scores: Scores = {
        name: {answer.line["id"]: [answer.verdict, *(cause["id"] for cause in answer.causes)] for answer in answers}
        for name, answers in samples()
    }
    print(table(scores))
    texts = tomllib.loads(lines.NONE.read_text(encoding="utf-8"))["text"]
    accused = [text for text in texts if explain_text(text["text"], signatures(), lines.FACTS).causes]
    print(f"{len(accused)} of {len(texts)} texts that are no such failure are blamed on a package.")
    if args.against:
        before: Scores = json.loads(args.against.read_text(encoding="utf-8"))
        print(f"\nBefore:\n\n{table(before)}", *changes(before, scores), sep="\n")
    if args.save:
        args.save.write_text(json.dumps(scores, indent=0), encoding="utf-8")


def samples() -> Iterator[tuple[str, Iterable[Answer]]]:
    """Yield the name and the answers of each sample; those without a page of a first look are left out."""
    yield "open half", lines.answers(is_aside=False)
    yield "half set aside", lines.answers(is_aside=True)
    yield "further lines", lines.explained(lines.MORE)
    yield "logs", lines.explained(lines.LOGS)
    for page in sorted(lines.HERE.glob("lines-*.md")):
        for kind in ("lines", "logs"):
            file = page.with_name(page.name.replace("lines-", f"{kind}-", 1)).with_suffix(".toml")
            if file.is_file():
                yield f"{kind}, {page.stem.partition('-')[2]}", lines.explained(file)


def table(scores: Scores) -> str:
    """Return the table of verdicts by sample, the sum last."""
    rows = ["| sample | texts | right | wrong | silent | to judge by hand | wrong of 100 |"]
    rows += ["| --- |" + " ---: |" * 6]
    rows += [_row(name, answers) for name, answers in scores.items()]
    everything = {f"{name} {key}": answer for name, answers in scores.items() for key, answer in answers.items()}
    return "\n".join([*rows, _row("all", everything), ""])


def _row(name: str, answers: Mapping[str, Sequence[str]]) -> str:
    counts = Counter(verdict for verdict, *_ in answers.values())
    numbers = [str(counts[verdict]) for verdict in lines.VERDICTS]
    share = 100 * counts[lines.WRONG] / max(len(answers), 1)
    return f"| {name} | {len(answers)} | {' | '.join(numbers)} | {share:.1f} |"


def changes(before: Scores, after: Scores) -> Iterator[str]:
    """Yield each text whose verdict changed."""
    for name, answers in after.items():
        for key, answer in answers.items():
            old = before.get(name, {}).get(key, answer)
            if old[0] != answer[0]:
                yield f"- {name}, {key}: {old[0]} {old[1:]} -> {answer[0]} {answer[1:]}"


if __name__ == "__main__":
    main()
