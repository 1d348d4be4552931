"""Run declared faults, all or some: see `benchmarks/faults/__init__.py`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from . import ROOT, Fault, FaultResult, _running, _shelf, _table, load_faults

RESULTS_FOLDER = ROOT / ".harness" / "faults"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what was selected and is not known yet; 1 where a promise is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__)
    parser.add_argument("-k", action="append", metavar="GLOB", help="only these rows, names, or modules")
    parser.add_argument("-j", type=int, choices=(1, 2), default=2, help="how many at a time")
    parser.add_argument("--list", action="store_true", help="list them and run nothing")
    parser.add_argument("--fresh", action="store_true", help="run again what is known")
    parser.add_argument("--keep", action="store_true", help="take results of older code, too")
    parser.add_argument("--write", action="store_true", help=f"write {_table.REPORT.relative_to(ROOT)}")
    parser.add_argument("--table", action="store_true", help="write the table from what is known, and run nothing")
    parser.add_argument("--folder", type=Path, default=RESULTS_FOLDER, help="where results and wheels are kept")
    parser.add_argument("--wheels", type=Path, help="a shelf with the fakes and gymnasium")
    parser.add_argument("--do", help=argparse.SUPPRESS)
    parser.add_argument("--into", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--at", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    faults = load_faults()
    if options.do:
        (chosen,) = (fault for fault in faults if f"{fault.module}.{fault.name}" == options.do)
        _running.do(chosen, options.wheels, options.into, options.at)
        return 0
    faults = [fault for fault in faults if fits(fault, options.k)]
    if options.list or not faults:
        print("\n".join(f"{fault.row:6} {fault.module}.{fault.name}: {fault.done}" for fault in faults))
        return 0 if faults else 2
    rows = results(faults, options)
    if options.write or options.table:
        whole = {row["fault"]: row for row in (*_table.load_rows(), *rows)}
        faults_by_name = {f"{fault.module}.{fault.name}": fault for fault in load_faults()}
        current = sum(
            whole[name]["digest"] == _running.digest(faults_by_name[name]) for name in faults_by_name if name in whole
        )
        _table.write([whole[name] for name in faults_by_name if name in whole], current)
    broken = [row for row in rows if not row["held"] and not row["documented"]]
    print(f"{len(rows)} faults, {len(broken)} broken", *(f"  {row['row']} {row['fault']}" for row in broken), sep="\n")
    return 1 if broken else 0


def fits(fault: Fault, globs: Sequence[str] | None) -> bool:
    """Tell whether a fault was selected."""
    words = (fault.row, fault.name, fault.module, f"{fault.module}.{fault.name}")
    return not globs or any(fnmatch(word, glob) for word in words for glob in globs)


def results(faults: Sequence[Fault], options: argparse.Namespace) -> list[dict[str, Any]]:
    """Return a row for each fault: a kept one, or what comes now."""
    wheels = Path() if options.table else options.wheels or _shelf.fill_shelf(options.folder / "wheels")

    def result(fault: Fault) -> dict[str, Any]:
        path = options.folder / f"{fault.module}.{fault.name}.json"
        if not options.fresh and path.exists():
            row: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            if options.keep or options.table or row["digest"] == _running.digest(fault):
                return {**row, **_running.texts(fault)}
        if options.table:
            return _running.row(fault, FaultResult("not tried: it was not run yet", True), 0)
        row = _running.run(fault, wheels.resolve(), options.folder)
        path.write_text(json.dumps(row), encoding="utf-8")
        held = "documented" if fault.documented else "held" if row["held"] else "BROKEN"
        print(f"{held:10} {row['row']:6} {row['seconds']:6.1f} s  {row['fault']}: {row['came']}", file=sys.stderr)
        return row

    with ThreadPoolExecutor(options.j) as pool:
        return [*pool.map(result, faults)]


if __name__ == "__main__":
    raise SystemExit(main())
