"""Cells as nox sessions, planned from files alone; each takes its environment from the harness's own pool.

In a noxfile, with the harness installed beside nox:

    from harness import noxface

    noxface.cells("quickstart")

`nox -t quickstart` runs them all, `nox -s "cell(...)"` one as `nox -l` prints it. HARNESS_MATRICES names more of them.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import nox

from harness.commands.arguments import DEFAULT_FAIL_ON, fail_kinds
from harness.model import Cell, Plan, Verdict, cellid
from harness.model.errors import BadInput, HarnessError
from harness.model.report_types import CellEntry, format_count, word
from harness.reports import document
from harness.running import open_matrix

VARIABLE = "HARNESS_MATRICES"
MOST = 100
"""Cells of one matrix that are listed one by one; of a larger matrix there is one session per Python."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Offer:
    """One session: the cells of a matrix that `glob` matches, or why it cannot run any (`reason`).

    `matrix` is how the user names it, `called` its own name, `python` what nox's `--python` selects it by.
    """

    id: str
    matrix: str
    called: str
    glob: str = "*"
    python: str | None = None
    many: bool = False
    reason: str = ""

    @property
    def tags(self) -> tuple[str, ...]:
        """Return the nox tags of the session: the matrix and, if it has one, the Python."""
        return (self.called, f"py{self.python}") if self.python else (self.called,)


def cells(*matrices: str) -> None:
    """Make the sessions of these matrices and of those that HARNESS_MATRICES names; none of them runs by default."""
    named = (name.strip() for name in (*matrices, *os.environ.get(VARIABLE, "").split(",")))
    offers = list(offer_sessions(filter(None, dict.fromkeys(named))))
    _register(cell, [offer for offer in offers if not offer.many], side_by_side=True)
    _register(matrix, [offer for offer in offers if offer.many], side_by_side=False)


def offer_sessions(names: Iterable[str]) -> Iterator[Offer]:
    """Yield the sessions of matrices, without network. A matrix that cannot be planned is reported and fails if run."""
    plans: dict[str, Plan] = {}
    for name in names:
        try:
            plan = open_matrix.load(name, _say, offline=True)
            # One matrix may be named twice, as `a.toml` and `./a.toml`: its sessions are offered once.
            if plans.setdefault(plan.matrix, plan) != plan:
                message = f"{name}: another matrix has the name {plan.matrix}, too; rename one of them"
                raise BadInput(message)
            if plans[plan.matrix] is plan:
                yield from sessions(name, plan.matrix, plan.cells)
        except HarnessError as error:
            _say(str(error))
            yield Offer(id=name, matrix=name, called=name, reason=str(error))


def sessions(name: str, called: str, planned: Sequence[Cell]) -> Iterator[Offer]:
    """Yield a session per cell, or one per Python if the cells are too many to list."""
    if len(planned) <= MOST:
        for each in planned:
            for cell_id in (each.id, *filter(_typed, {cellid.to_old_form(each)} - {each.id})):
                yield Offer(id=cell_id, matrix=name, called=called, glob=each.id, python=each.axes["python"])
        return
    for python in dict.fromkeys(each.axes["python"] for each in planned):
        glob = _glob(called, python, planned)
        if glob is None:  # no glob tells its cells from the others
            yield Offer(id=called, matrix=name, called=called, many=True)
            return
        yield Offer(id=f"{called}/py{python}", matrix=name, called=called, glob=glob, python=python, many=True)


def _typed(cell_id: str) -> bool:
    """Return whether the session of an id of earlier versions is asked for: such sessions are not listed."""
    return any(f"({cell_id})" in text for text in (*sys.argv[1:], os.environ.get("NOXSESSION", "")))


def _glob(called: str, python: str, planned: Sequence[Cell]) -> str | None:
    """Return a glob for exactly the cells of one Python, wherever their ids name it. None if there is none."""
    # An id names its Python first, in between or last. The `_` keeps py3.1 from matching py3.10.
    for glob in (f"{called}/py{python}_*", f"{called}/*_py{python}_*", f"{called}/*_py{python}"):
        if all(cellid.fits(glob, each) == (each.axes["python"] == python) for each in planned):
            return glob
    return None


def _say(text: str) -> None:
    print(f"simmatrix: {text}", file=sys.stderr)


# --- what the sessions do --------------------------------------------------------------------------------------


def _register(function: Callable[..., None], offers: Sequence[Offer], *, side_by_side: bool) -> None:
    """Hand sessions to nox; it makes no environment for them, so that no missing Python lets it skip one."""
    if not offers:
        return
    params = [
        nox.param(offer.python, offer.matrix, offer.glob, offer.reason, id=offer.id, tags=offer.tags)
        for offer in offers
    ]
    parametrized = nox.parametrize("python,matrix,glob,reason", params)(function)
    registered = nox.session(venv_backend="none", default=False)(parametrized)
    registered.allow_parallel = side_by_side  # not as an argument, which nox before 2026.8.10 does not know


def cell(session: nox.Session, matrix: str, glob: str, reason: str) -> None:
    """Measure one cell, or reuse what is known of it."""
    # One job, since nox itself may run several of these sessions at once (`--parallel`).
    _run(session, reason, matrix, glob, "--jobs", "1")


def matrix(session: nox.Session, matrix: str, glob: str, reason: str) -> None:
    """Measure the cells of one Python, several at a time, or reuse what is known of them."""
    _run(session, reason, matrix, glob)


def _run(session: nox.Session, reason: str, name: str, glob: str, *options: str) -> None:
    """Run cells in a process of their own, and end the session as they ended."""
    if reason:
        session.error(reason)
    command = (sys.executable, "-m", "harness", "run", name, "-k", glob, *options, *session.posargs, "--json")
    with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
        # its exit code is of all cells of the matrix that are known, its document tells of each
        if session.run(*command, stdout=output, stderr=None, success_codes=(0, 1, 3)) is None:
            return  # by `nox --install-only`
        output.seek(0)
        content = output.read()
    if not content:
        session.error("inconclusive: no report was written; the reason is above")
    report = document.read(content.encode(), "the report")
    _end(session, [entry for entry in report.cells if cellid.fits(glob, entry)], report.stale)


def _end(session: nox.Session, entries: Sequence[CellEntry], stale: Sequence[str]) -> None:
    """End the session: fail if a cell is unexpected, out of date or inconclusive, skip if no cell could be measured."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--fail-on", type=fail_kinds, default=DEFAULT_FAIL_ON)
    fail_on = {*parser.parse_known_args(session.posargs)[0].fail_on}
    ids = {entry.id for entry in entries}
    # A sentence about a cell begins with its id; one about an expectation that matches no cell belongs to no session.
    outdated = [sentence for sentence in stale if sentence.partition(" ")[0] in ids]
    if "unexpected" in fail_on and (wrong := [entry for entry in entries if entry.as_expected is False]):
        session.error(f"not as expected: {_describe_outcome(wrong)}")
    if "stale" in fail_on and outdated:
        session.error(f"out of date: {outdated[0]}")
    if unsure := [entry for entry in entries if entry.verdict in {Verdict.INCONCLUSIVE, *fail_on}]:
        session.error(_describe_outcome(unsure))
    if all(entry.verdict in {Verdict.UNAVAILABLE, Verdict.NOT_RUN} for entry in entries):
        session.skip(_describe_outcome(entries))
    verdicts = Counter(word(entry.verdict) for entry in entries)
    session.log(", ".join(f"{count} {verdict}" for verdict, count in verdicts.items()))


def _describe_outcome(entries: Sequence[CellEntry]) -> str:
    """Return the outcome and the reason of the first cell, and the number of further cells."""
    first, *rest = entries
    where = f" in {first.phase}" if first.phase and first.verdict is not Verdict.UNAVAILABLE else ""
    why = f": {first.decisive.rstrip('.')}" if first.decisive else ""
    more = f" ({first.id}; and {format_count(len(rest), 'cell')} more)" if rest else ""
    return f"{word(first.verdict)}{where}{why}{more}"
