"""Made worlds with planted culprits, bisected for real: `python benchmarks/worlds.py --folder DIR [--worlds N]`.

Each world is an index of tiny wheels: a package of which one release breaks everything from there on, or two packages
that do so only together; one release in seven cannot be installed, and in half of the worlds one look in ten at what is
broken goes well. Every candidate is resolved by uv, installed into an environment of its own, and probed. What was done
lies in the folder and is not done twice; the table is `worlds.md`, after the same worlds without environments.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE.parent / "tests" / "e2e" / "spine")]

import market  # noqa: E402 - it lies among the tests

from harness.machine import interpreters, process, store  # noqa: E402
from harness.matrix import changes  # noqa: E402
from harness.model import Case, Cell, CellRecord, Change, IndexSettings, Question  # noqa: E402
from harness.model.vocabulary import IMPORT_CHECK  # noqa: E402
from harness.rootcause import search  # noqa: E402
from harness.rootcause.bench import Bench  # noqa: E402
from harness.rootcause.bisection import candidates  # noqa: E402
from harness.rootcause.bisection.bisecting import Bisection, Task  # noqa: E402
from harness.rootcause.bisection.predicate import Predicate, strip_run_count  # noqa: E402
from harness.rootcause.search import Answer, Rules  # noqa: E402
from harness.running import scheduler  # noqa: E402

COUNT, MANY = 200, 4000
MISSING = 1 / 7
FLAKY = 0.1
SURE = 0.99
DAY = "2026-01-01"
ROBOT = """
import os
import random
{imports}

if {broken} and random.SystemRandom().random() >= {flaky}:
    raise AttributeError("the grip is gone")
"""


SHOWN = {
    Answer.GOOD: Answer.BAD,
    Answer.BAD: Answer.GOOD,
    Answer.FLAKY: Answer.GOOD,
    Answer.UNTESTABLE: Answer.UNTESTABLE,
}
"""What is looked for of two culprits is the failure: the fewest parts that, moved on, bring it."""


@dataclass(frozen=True, kw_only=True)
class World:
    """Packages of which one release, or one of each of two, is the culprit; releases are numbered from 0."""

    seed: int
    pair: bool
    flaky: bool
    releases: int
    culprits: tuple[int, ...]
    missing: tuple[int, ...]

    @property
    def line(self) -> int:
        """Return how many candidates a search begins with."""
        return self.releases


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """The end of a search in a world; `tested` counts the runs of what could be installed, `asked` all."""

    seed: int
    right: bool
    asked: int
    tested: int
    environments: int
    bound: int
    seconds: float


def world(seed: int) -> World:
    """Return the world of a seed: every other is flaky, every fourth has a pair."""
    rng = random.Random(f"world {seed}")
    pair = seed % 4 == 3
    releases = rng.randint(4, 16) if pair else rng.randint(6, 48)
    culprits = rng.sample(range(releases), 2) if pair else [rng.randint(1, releases - 1)]
    missing = [] if pair else [one for one in range(1, releases - 1) if rng.random() < MISSING]
    return World(seed=seed, pair=pair, flaky=bool(seed % 2) != bool(seed // 4 % 2), releases=releases,
                 culprits=tuple(sorted(culprits)), missing=tuple(missing))  # fmt: skip


# --- without environments --------------------------------------------------------------------------------------


def simulate_search(scenario: World, rate: float | None = None, sure: float = SURE) -> SearchResult:
    """Search with a die instead of environments; `rate` is the chance of a wrong look, if not that of the world."""
    rng = random.Random(f"runs {scenario.seed}")
    wrong = rate if rate is not None else FLAKY if scenario.flaky else 0.0

    def look(broken: bool) -> Answer:
        return Answer.BAD if broken and rng.random() >= wrong else Answer.GOOD

    rules = Rules(confidence=sure)
    if scenario.pair:
        minimal = search.minimise(
            range(scenario.releases), lambda moved: SHOWN[look({*scenario.culprits} <= {*moved})], rules=rules
        )
        answers = [(each.candidate, each.answer) for each in minimal.observations]
        return _ended(scenario, set(minimal.items or ()) == set(scenario.culprits), answers, minimal.bound)
    boundary = search.boundary(
        range(scenario.releases),
        lambda index: Answer.UNTESTABLE if index in scenario.missing else look(index >= scenario.culprits[0]),
        rules=rules,
    )
    return _ended(
        scenario,
        _right(scenario, boundary.good, boundary.bad),
        [(each.candidate, each.answer) for each in boundary.observations],
        boundary.bound,
    )


def _right(scenario: World, good: int | None, bad: int | None) -> bool:
    is_enclosed = good is not None and bad is not None and good < scenario.culprits[0] <= bad
    return is_enclosed and {*range((good or 0) + 1, bad or 0)} <= {*scenario.missing}


def _ended(
    scenario: World, right: bool, answers: Sequence[tuple[object, Answer]], bound: int, seconds: float = 0.0
) -> SearchResult:
    tested = [candidate for candidate, answer in answers if answer is not Answer.UNTESTABLE]
    return SearchResult(
        seed=scenario.seed,
        right=right,
        asked=len(answers),
        tested=len(tested),
        environments=len(set(tested)),
        bound=bound,
        seconds=round(seconds, 1),
    )


# --- with environments -----------------------------------------------------------------------------------------


def real(scenario: World, folder: Path) -> SearchResult:
    """Search with uv's resolutions, environments and probes."""
    place = folder.absolute() / "index" / str(scenario.seed)
    shutil.rmtree(place, ignore_errors=True)
    market.write_index(place, place, folder / "no wheels", list(_releases(scenario)))
    opened = store.Store(folder / "state" / str(scenario.seed))
    cell = _cell(scenario, (place / "simple").as_uri())
    began = monotonic()
    with Bench(opened, scheduler.Settings(), Quiet()) as bench:
        return (_pair if scenario.pair else _single)(scenario, cell, bench, lambda: monotonic() - began)


def _releases(scenario: World) -> Iterator[market.Release]:
    flaky = FLAKY if scenario.flaky else 0.0
    names = [f"part{number}" for number in range(scenario.releases)] if scenario.pair else ["part"]
    guilty = [f"part{number}" for number in scenario.culprits] if scenario.pair else ["part"]
    limit = 2 if scenario.pair else scenario.culprits[0] + 1
    broken = " and ".join(f"{name}.VERSION >= {limit}" for name in guilty)
    code = ROBOT.format(imports="\n".join(f"import {name}" for name in names), broken=broken, flaky=flaky)
    yield market.Release(name=f"robot{scenario.seed}", version="1.0", day=DAY, code=code, requires=names)
    for name in names:
        for version in range(1, 3 if scenario.pair else scenario.releases + 1):
            lost = not scenario.pair and version - 1 in scenario.missing
            code = f"VERSION = {version}\nWORLD = {scenario.seed}\n"
            yield market.Release(name=name, version=f"{version}.0", day=DAY, code=code,
                                 requires=["nowhere-to-be-had"] if lost else [])  # fmt: skip


def _cell(scenario: World, index: str) -> Cell:
    case = Case(id="import", env=None, api="", imports=(f"robot{scenario.seed}",), packages=(), checks=(IMPORT_CHECK,))
    question = Question(requirements=(f"robot{scenario.seed}==1.0",), index=IndexSettings(default=index))
    return Cell(
        id=f"worlds/{scenario.seed}",
        matrix="worlds",
        axes={},
        python="host",
        question=question,
        cases=(case,),
        environment={},
    )


def _single(scenario: World, cell: Cell, bench: Bench, clock: Callable[[], float]) -> SearchResult:
    interpreter = interpreters.find("host")
    assert interpreter
    line = candidates.of_package(cell, "part", interpreter, candidates.LineOptions(offline=True)).candidates
    task = Task(cell=cell, axis="part", line=line, good=0, bad=len(line) - 1, confidence=SURE)
    search_ = Bisection(task, bench, lambda _: None)
    done = search_.run()
    places = [int(step.candidate.name.partition(".")[0]) - 1 if step else None for step in (done.good, done.bad)]
    answers = [(step.candidate.name, step.classification.answer) for step in search_.steps if step.why != "whole"]
    return _ended(scenario, _right(scenario, *places), answers, search.bound(len(line)), clock())


def _pair(scenario: World, cell: Cell, bench: Bench, clock: Callable[[], float]) -> SearchResult:
    before = bench.measure(cell)
    while before.works:  # whoever asks has seen it fail
        before = bench.measure(cell, again=True)
    predicate = Predicate(failure=strip_run_count(before.failure))

    def moved(chosen: tuple[int, ...]) -> Answer:
        lines = tuple(f"part{number}==1.0" for number in range(scenario.releases) if number not in chosen)
        trial_cell = changes.apply(cell, Change(constraints=lines), {}) if lines else cell
        again = any(each.cell.question == trial_cell.question for each in bench.trials)
        return SHOWN[predicate.classify(bench.measure(trial_cell, again=again)).answer]

    minimal = search.minimise(range(scenario.releases), moved, rules=Rules(confidence=SURE))
    answers = [(each.candidate, each.answer) for each in minimal.observations]
    return _ended(scenario, set(minimal.items or ()) == set(scenario.culprits), answers, minimal.bound, clock())


class Quiet:
    """An observer that reports nothing."""

    def started(self, cell: Cell) -> None:
        """Report nothing."""

    def step(self, cell: Cell, text: str) -> None:
        """Report nothing."""

    def done(self, record: CellRecord) -> None:
        """Report nothing."""

    def say(self, text: str) -> None:
        """Report nothing."""


# --- the table -------------------------------------------------------------------------------------------------


AGAIN = (
    "Worlds 3, 36, 38, 49, 57, 115 and 163 did not come out right at first, and were run again: this benchmark had the "
    "meaning of a pair the wrong way round and began with cells that happened to work (115, 163), and bisect did not "
    "ask again a flaky bad end that had looked good once. A bad answer still counted as two looks then: now each is "
    "one, as failures are confirmed only with --verify, and a boundary takes one run more for the same confidence."
)


def main() -> None:
    """Search what is left of the worlds, as long as there is time, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--worlds", type=int, default=COUNT)
    parser.add_argument("--minutes", type=float, default=120, help="after which no other is begun")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    (args.folder / "no wheels").mkdir(exist_ok=True)
    os.environ |= {
        "HARNESS_SIGNATURES": "",
        "HARNESS_CONTROLS": "",
        "HARNESS_CACHE": str(args.folder.absolute() / "cache"),
    }
    for name in [name for name in os.environ if name.startswith(("UV_", "PIP_"))]:
        del os.environ[name]
    path, began = args.folder / "worlds.jsonl", monotonic()
    results = [SearchResult(**json.loads(line)) for line in path.read_text().splitlines()] if path.exists() else []
    for seed in range(args.worlds):
        if seed in {one.seed for one in results} or monotonic() - began > args.minutes * 60 or process.is_stopped():
            continue
        results.append(real(world(seed), args.folder))
        with path.open("a") as file:
            file.write(json.dumps(asdict(results[-1])) + "\n")
        print(results[-1], flush=True)
    text = "\n".join(page(sorted(results, key=lambda result: result.seed)))
    (HERE / "worlds.md").write_text(text + "\n", encoding="utf-8")
    print(text)


def page(results: list[SearchResult]) -> Iterator[str]:
    """Yield the table of all worlds."""
    yield "# Worlds with planted culprits"
    yield ""
    machine = f"{os.cpu_count()} cores, {platform.platform()}, Python {platform.python_version()}"
    yield f"{datetime.now(UTC):%Y-%m-%d}, {machine};"
    yield f"`python benchmarks/worlds.py --folder DIR --worlds {COUNT}`."
    yield ""
    yield "Bound: what a binary search for one culprit asks at most where every answer is right, both ends among it."
    yield f"Asked of a search is a confidence of {SURE}, which is that of `bisect` where it is told nothing else."
    yield ""
    yield f"## By the search alone: all {COUNT} worlds"
    yield ""
    yield from _table([simulate_search(world(seed)) for seed in range(COUNT)])
    yield ""
    yield from _sureness()
    yield ""
    yield f"## With environments: {f'all {COUNT}' if len(results) == COUNT else len(results)} worlds"
    yield ""
    yield AGAIN
    yield ""
    yield from _table(results)
    yield ""
    yield "| world | culprits | releases or parts | flaky | found | asked | run | environments | bound | seconds |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    for result in results:
        scenario = world(result.seed)
        culprits = " and ".join(str(each + 1) for each in scenario.culprits)
        flags = ("yes" if each else "no" for each in (scenario.flaky, result.right))
        cells = [result.seed, culprits, scenario.releases, *flags,
                 result.asked, result.tested, result.environments, result.bound, result.seconds]  # fmt: skip
        yield f"| {' | '.join(map(str, cells))} |"


def _sureness() -> Iterator[str]:
    """Yield a table of confidences: their cost, and how often they are right.

    It has more worlds and more rates than are asked for.
    """
    singles = [one for one in map(world, range(MANY)) if not one.pair]
    yield f"The same of {len(singles)} worlds of one culprit, by how many looks of a hundred at what is broken go well:"
    yield ""
    yield "| confidence | flaky | wrong | runs / bound | within 1.5 x |"
    yield "| --- | --- | --- | --- | --- |"
    for sure in (SURE, 0.999):
        for rate in (0.0, 0.05, FLAKY, 0.2):
            ended = [simulate_search(one, rate, sure) for one in singles]
            wrong = sum(not one.right for one in ended)
            runs, bound = sum(one.tested for one in ended), sum(one.bound for one in ended)
            within = sum(one.tested <= 1.5 * one.bound for one in ended)
            yield f"| {sure} | {100 * rate:.0f} | {wrong} | {runs / bound:.2f} | {within} |"


def _table(ended: list[SearchResult]) -> Iterator[str]:
    yield "| worlds | number | found | runs / bound | within 1.5 x | environments / bound | within 1.5 x |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for pair in (False, True):
        for flaky in (False, True):
            some = [one for one in ended if (world(one.seed).pair, world(one.seed).flaky) == (pair, flaky)]
            if some:
                yield _row(f"{'two culprits' if pair else 'one culprit'}{', flaky' if flaky else ''}", some)


def _row(name: str, some: list[SearchResult]) -> str:
    bound = sum(one.bound for one in some)
    cells = [name, len(some), sum(one.right for one in some)]
    for field in ("tested", "environments"):
        spent = [int(getattr(one, field)) for one in some]
        within = sum(each <= 1.5 * one.bound for each, one in zip(spent, some, strict=True))
        cells += [f"{sum(spent) / bound:.2f}", within]
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
