"""Measure the site: `python -m benchmarks.site` builds it of all committed reports and writes `site.md`.

Pages are opened from disk in Debian's Chromium by Playwright: the time to the first paint, and the time in which a
filter of a matrix is applied and laid out. `--axe FILE` names `axe.min.js` of the npm package axe-core, which looks for
faults in accessibility and contrast on the same pages, in light and dark.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.model.measured import Measured
from harness.model.report_types import format_count
from harness.reports import document
from harness.reports.site import build_site, matrix_page
from harness.reports.site.evidence_files import EvidenceFiles
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts
from harness.reports.site.site_sources import Source

HERE = Path(__file__).parent
PAGES = {
    "home": "index.html",
    "matrix of 109 combinations": "matrices/gymnasium-mujoco/index.html",
    "matrix of behaviour": "matrices/drift-mujoco/index.html",
    "combination": "cells/gymnasium-mujoco/py3.8_gymnasium-0.27.1_mujoco-3.0.1.html",
    "package": "packages/mujoco/index.html",
    "environment": "environments/Ant-v5/index.html",
    "known issue": "issues/numpy124-aliases-of-builtins/index.html",
}
PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"
CHOICES = "[...document.querySelector('select[name=verdict]').options].slice(1).flatMap((one) => [one.value, ''])"
FILTER = """(value) => {
    const select = document.querySelector("select[name=verdict]");
    select.value = value;
    select.dispatchEvent(new Event("input", { bubbles: true }));
    document.body.getBoundingClientRect();
}"""
MANY = 10_000


def main() -> None:
    """Build the site, open its pages and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--axe", type=Path, metavar="FILE", help="axe.min.js of the npm package axe-core")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        site = Path(folder) / "site"
        seconds = []
        for _ in range(args.runs):
            start = time.perf_counter(), time.process_time()
            built = build_site.build([], site)
            seconds.append((time.perf_counter() - start[0], time.process_time() - start[1]))
        sizes = {name: (site / address).stat().st_size for name, address in PAGES.items()}
        measured = opened(site, PAGES, args.runs, args.axe)
        many = Path(folder) / "many"
        many_seconds = build_many(many)
        many_filter = opened(many, {"many": PAGES["matrix of 109 combinations"]}, args.runs, None)["many"]
    wall, computing = (statistics.median(column) for column in zip(*seconds, strict=True))
    largest = max(one["filter"] for one in measured.values())
    lines = [
        "# The site of all committed reports",
        "",
        f"Made by `python -m benchmarks.site` on {datetime.now(UTC):%Y-%m-%d}: Linux, {os.cpu_count()} cores, load "
        f"{os.getloadavg()[0]:.1f} with what others ran; medians of {format_count(args.runs, 'run')}.",
        "",
        f"- Built in {wall:.0f} s ({computing:.0f} s of computing); target: two minutes.",
        f"- {built.pages:,} pages on {built.cells:,} combinations, {built.files:,} files, {built.bytes / 1e6:.1f} MB.",
        f"- A filter of a matrix is applied and laid out in {largest:.0f} ms of computing; target: 200 ms.",
        f"- A matrix of {MANY:,} combinations: built in {many_seconds:.0f} s of computing, a filter takes "
        f"{many_filter['filter']:.0f} ms of computing, the first paint {many_filter['paint']:.0f} ms.",
        "",
        "| page | size | first paint | faults in light | faults in dark |",
        "| --- | --: | --: | --: | --: |",
        *(
            f"| {name} | {sizes[name] / 1000:.0f} kB | {one['paint']:.0f} ms | {one['light']} | {one['dark']} |"
            for name, one in measured.items()
        ),
        "",
        "Faults are those that axe-core counts on the page, contrast among them; `-` where it was not run.",
    ]
    (HERE / "site.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(HERE / "site.md")


def opened(site: Path, pages: dict[str, str], runs: int, axe: Path | None) -> dict[str, dict[str, Any]]:
    """Open each page several times; return its first paint and filter time in ms, and its faults in light and dark."""
    program = shutil.which("chromium")
    if program is None:
        sys.exit("chromium is missing: apt-get install chromium")
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - start-up

    measured: dict[str, dict[str, Any]] = {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        for name, address in pages.items():
            paints, filters = [], []
            for _ in range(runs):
                page = browser.new_page(offline=True)
                page.goto((site / address).as_uri())
                while page.evaluate(PAINT) is None:
                    page.wait_for_timeout(20)
                paints.append(page.evaluate(PAINT))
                if "matrices" in address:
                    filters += _filter_times(page)
                page.close()
            measured[name] = {"paint": statistics.median(paints), "filter": statistics.median(filters or [0.0])}
            for mode in ("light", "dark"):
                measured[name][mode] = _faults(browser, (site / address).as_uri(), mode, axe) if axe else "-"
        browser.close()
    return measured


def _filter_times(page: Any) -> list[float]:
    """Return the milliseconds of computing in which each filter is applied and laid out."""
    client = page.context.new_cdp_session(page)
    client.send("Performance.enable", {"timeDomain": "threadTicks"})  # other programs at the same time count nothing

    def computing() -> float:
        metrics = {one["name"]: one["value"] for one in client.send("Performance.getMetrics")["metrics"]}
        return 1000 * sum(float(metrics[f"{name}Duration"]) for name in ("Script", "Layout", "RecalcStyle"))

    times = []
    for value in page.evaluate(CHOICES):
        start = computing()
        page.evaluate(FILTER, value)
        times.append(computing() - start)
    return times


def build_many(target: Path) -> float:
    """Write the page of a matrix of ten thousand combinations; return the seconds of computing.

    They are those of a committed report with further versions, which were never measured.
    """
    report = document.read_file(HERE.parent / "reports" / "gymnasium-mujoco" / "report.json")
    cells = []
    for number in range(MANY):
        cell = report.cells[number % len(report.cells)]
        axes = {**cell.axes, "gymnasium": f"1.0.{number % 40}", "mujoco": f"3.{number // 40}.0"}
        label = f"py{axes['python']}_gymnasium-{axes['gymnasium']}_mujoco-{axes['mujoco']}"
        cells.append(replace(cell, id=f"gymnasium-mujoco/{label}", axes=axes, findings=(), cases=cell.cases[:2]))
    start = time.process_time()
    source = Source.of(replace(report, cells=tuple(cells)), None, "gymnasium-mujoco")
    nothing = Measured(generated="", machines={}, cells=(), locks={}, hashes={}, taken={})
    facts = SiteFacts(sources=(source,), measured=nothing, signatures={}, issues=())
    writer = PageWriter(target, {"generated": "", "version": ""})
    writer.copy_assets()
    matrix_page.write(facts, writer, EvidenceFiles(target))
    return time.process_time() - start


def _faults(browser: Any, address: str, mode: str, axe: Path) -> int:
    """Count the parts of a page in which axe-core finds a fault."""
    page = browser.new_page(color_scheme=mode, bypass_csp=True, offline=True)
    page.goto(address)
    page.evaluate(axe.read_text(encoding="utf-8"))
    violations = page.evaluate("axe.run()")["violations"]
    page.close()
    return sum(len(one["nodes"]) for one in violations)


if __name__ == "__main__":
    main()
