"""`simmatrix recommend PACKAGE...`: which versions work together, as measured."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any

import msgspec
from packaging.version import InvalidVersion, Version

from harness import inferring, measured, recommending, store
from harness.errors import BadInput
from harness.inferring import Inferred
from harness.model import CASE_PHASES, Phase
from harness.recommending import Combination, Known, Query, Red, Wanted
from harness.reporttypes import number, word
from harness.schema import suggestion

HELP = "Which versions work together: the newest combinations that were measured and found good, with their locks."

SHOWN = 5
VIRTUAL = ("DISPLAY", "virtual")
"""As cells have it for which a display was started."""
LONGEST = 200
"""Characters of a line that says why."""
NEEDS = (Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER, Phase.INTEROP)


class Nearby(msgspec.Struct, frozen=True, kw_only=True):
    """What is known where nothing fits: `where` says how it is not what was asked for."""

    where: str
    combinations: tuple[Combination, ...]


class Recommended(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `recommend --json`: what was measured, what only follows, and what does not work.

    `found` is how many combinations there are, of which `measured` has the newest. `unknown` are packages of which
    nothing was measured. `next` is a command that would measure what was asked for.
    """

    schema: int = 1
    asked: tuple[str, ...]
    python: str | None
    needs: tuple[str, ...]
    env: str | None
    found: int
    measured: tuple[Combination, ...]
    inferred: tuple[Inferred, ...]
    red: tuple[Red, ...]
    nearby: Nearby | None
    unknown: tuple[str, ...]
    next: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `recommend`."""
    parser.add_argument("packages", metavar="PACKAGE", nargs="+", help="name or requirement: mujoco, 'gymnasium>=1'")
    parser.add_argument("--python", metavar="V", help="such as 3.11 [any]")
    parser.add_argument("--needs", type=_phases, default=(), metavar="PHASE,...",
                        help=f"what has to have passed, of {', '.join(NEEDS)}")  # fmt: skip
    parser.add_argument("--env", metavar="ID", help="an environment that has to have been tried")
    parser.add_argument("--limit", type=int, default=SHOWN, metavar="N", help=f"combinations to show [{SHOWN}]")
    parser.add_argument(
        "--lock-out", type=Path, metavar="FILE", help="write the lock of the newest one that an index has to a file"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def _phases(text: str) -> tuple[Phase, ...]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in NEEDS]
    if unknown or not names:
        message = f"{(unknown or [text])[0]!r} is none of {', '.join(NEEDS)}"
        raise argparse.ArgumentTypeError(message)
    return tuple(Phase(name) for name in dict.fromkeys(names))


def main(args: argparse.Namespace) -> int:
    """Print what is known; 0 where something is known to be good, 1 where nothing is."""
    query = _query(args)
    document = measured.load()
    cells = recommending.known(document)
    found = recommending.combinations(document, cells, query)
    told = _told(document, cells, query, found, max(args.limit, 1))
    best = _installable(found)
    if args.lock_out:
        _write(args.lock_out, best, query)
    if args.json:
        sys.stdout.buffer.write(msgspec.json.encode(told) + b"\n")
    else:
        print("\n".join(_lines(told, document["machines"], cells)))
        print("\n".join(["", "next", *_next(told, best)]))
    return 0 if told.measured else 1


def _query(args: argparse.Namespace) -> Query:
    wanted: dict[str, Wanted] = {}
    try:
        for text in args.packages:
            one = Wanted.of(text)
            if one.name in wanted:
                message = f'"{one.name}" is asked for twice; write `{one.name}>=1,<2`'
                raise ValueError(message)
            wanted[one.name] = one
        if args.python is not None:
            Version(args.python)
    except InvalidVersion:
        message = f'recommend: --python "{args.python}" is no version such as 3.11'
        raise BadInput(message) from None
    except ValueError as error:
        message = f"recommend: {error}"
        raise BadInput(message) from None
    return Query(wanted=tuple(wanted.values()), python=args.python, needs=args.needs, env=args.env)


def _told(
    document: Mapping[str, Any], cells: Sequence[Known], query: Query, found: Sequence[Combination], limit: int
) -> Recommended:
    return Recommended(
        asked=tuple(one.text for one in query.wanted),
        python=query.python,
        needs=tuple(query.needs),
        env=query.env,
        found=len(found),
        measured=tuple(found[:limit]),
        inferred=() if found else tuple(inferring.inferred(cells, query)[:limit]),
        red=tuple(recommending.red(cells, query)),
        nearby=None if found else _nearby(document, cells, query, limit),
        unknown=tuple(name for name in query.names if not any(one.version(name) for one in cells)),
        next=_try(query),
    )


def _nearby(document: Mapping[str, Any], cells: Sequence[Known], query: Query, limit: int) -> Nearby | None:
    """What works where less is asked for: the first such question that has an answer."""
    for where, other in recommending.relaxed(query):
        found = recommending.combinations(document, cells, other)
        if found:
            return Nearby(where=where, combinations=tuple(found[:limit]))
    return None


def _try(query: Query) -> str:
    """The command that would measure it."""
    words = ["simmatrix", "try", *(one.text for one in query.wanted)]
    words += ["--python", query.python] if query.python else []
    words += ["--env", query.env] if query.env else []
    return shlex.join(words)


def _write(path: Path, best: Combination | None, query: Query) -> None:
    if best is None:
        print(f"recommend: nothing good was measured of {' '.join(query.names)}: no lock was written", file=sys.stderr)
        return
    store.write_atomic(path, best.lock.encode())
    print(
        f"lock: {path}: {_versions(best.versions)}, for Python {best.python}, measured on {best.machine}",
        file=sys.stderr,
    )


def _installable(found: Sequence[Combination]) -> Combination | None:
    """The newest that installs from an index alone, else the newest."""
    return next((one for one in found if not one.repaired and not one.brought), next(iter(found), None))


# --- what is said ----------------------------------------------------------------------------------------------


def _lines(told: Recommended, machines: Mapping[str, Any], cells: Sequence[Known]) -> Iterator[str]:
    if told.measured:
        yield "measured and found good, the newest first"
        yield from (line for one in told.measured for line in ("", *_combination(one, machines)))
        if told.found > len(told.measured):
            older = number(told.found - len(told.measured), "older combination")
            yield f"\nand {older}; `--limit {told.found}` shows all"
    else:
        yield "nothing that was measured is known to be good"
        yield from (f"  {line}" for line in _unknown(told, cells))
    for one in told.inferred:
        yield from _inferred(one)
    yield from _reds(told)


def _combination(one: Combination, machines: Mapping[str, Any]) -> Iterator[str]:
    yield _versions(one.versions)
    yield from (f"  {name:<9} {text}" for name, text in _facts(one, machines) if text)


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def _facts(one: Combination, machines: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "Python", ", ".join(one.pythons)
    yield "with", _beside(one.beside)
    yield "passed", ", ".join(phase for phase in CASE_PHASES if one.phases.get(phase) == "passed")
    yield "unseen", ", ".join(one.unverified)
    yield "tried", _some(one.environments)
    shown = {name: value for name, value in one.settings.items() if (name, value) != VIRTUAL}
    yield (
        "set",
        ", ".join([f"{name}={value}" for name, value in shown.items()] + ["a display"] * (shown != one.settings)),
    )
    repaired = ", ".join(one.repaired)
    yield "repaired", repaired and f"{repaired}: no index has it so; `simmatrix try ... --overlay` makes it"
    yield "brought", ", ".join(one.brought)
    yield from (("measured", f"{one.measured[:10]} on {_machine(name, machines)}") for name in one.machines)
    yield "cell", one.cell + (f" and {len(one.cells) - 1} more" if len(one.cells) > 1 else "")
    yield "lock", f"{number(one.lock.count('=='), 'package')}, pinned and hashed, sha256 {one.lock_sha256[:16]}"


def _beside(versions: Mapping[str, Sequence[str]]) -> str:
    return ", ".join(f"{name} {' or '.join(held)}" for name, held in versions.items())


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _machine(name: str, machines: Mapping[str, Any]) -> str:
    facts = machines.get(name, {})
    told = [facts[key] for key in ("os", "libc", "gl", "gpu") if facts.get(key)]
    return f"{name} ({', '.join(told)})" if told else name


def _unknown(told: Recommended, cells: Sequence[Known]) -> Iterator[str]:
    for name in told.unknown:
        near = suggestion(name, {pin for one in cells for pin in one.chosen}).partition("; valid")[0]
        yield f"{name}: nothing was measured with it{near}"
    if told.nearby:
        yield f"{told.nearby.where} there is, measured and found good:"
        yield from (
            f"  {_versions(one.versions)} on Python {', '.join(one.pythons)} ({one.cell})"
            for one in told.nearby.combinations
        )


def _inferred(one: Inferred) -> Iterator[str]:
    what = "never measured together" if one.kind == "apart" else "inferred, not measured"
    yield f"\n{what}: {_versions(one.versions)} on Python {one.python}"
    yield f"  since     {one.why}"
    yield f"  cells     {', '.join(one.from_cells)}"


def _reds(told: Recommended) -> Iterator[str]:
    if told.red:
        yield "\nmeasured, and does not work" + (" with other versions of the rest" if told.measured else "")
    for one in told.red[:SHOWN]:
        yield from (f"  {line}" for line in _red(one))
    if len(told.red) > SHOWN:
        yield f"  and {number(len(told.red) - SHOWN, 'more cause')}; `--json` has all"


def _red(one: Red) -> Iterator[str]:
    versions = "; ".join(_versions(held) for held in one.versions[:SHOWN])
    more = f" and {len(one.versions) - SHOWN} more" if len(one.versions) > SHOWN else ""
    how = " or ".join(word(verdict) for verdict in one.verdicts)
    where = f" in {one.phase}" if one.phase and one.verdicts != ("unresolvable",) else ""
    beside = f" with {_beside(one.beside)}" if one.beside else ""
    yield f"{versions}{more}{beside}, Python {', '.join(one.pythons)}: {how}{where}"
    yield from (f"  {shorten(text, LONGEST, placeholder=' ...')}" for text in (one.line, one.reason) if text)
    yield from (f"  known as {name}" for name in one.causes)
    yield from [f"  <{one.link}>"] if one.link else []


def _next(told: Recommended, best: Combination | None) -> Iterator[str]:
    if best:
        words = ["simmatrix", "recommend", *told.asked]
        words += ["--python", told.python] if told.python else []
        words += ["--needs", ",".join(told.needs)] if told.needs else []
        words += ["--env", told.env] if told.env else []
        yield f"  {shlex.join([*words, '--lock-out', 'requirements.txt'])}"
        minor = ".".join(best.python.split(".")[:2])
        yield f"  uv venv --python {minor} && uv pip sync --require-hashes requirements.txt"
    else:
        yield f"  {told.next}"
