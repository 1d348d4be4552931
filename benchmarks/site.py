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

from harness.reports.site import build_site

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
FILTER = """() => {
    const select = document.querySelector("select[name=verdict]");
    return [...select.options].slice(1).flatMap((option) => [option.value, ""]).map((value) => {
        const start = performance.now();
        select.value = value;
        select.dispatchEvent(new Event("input", { bubbles: true }));
        document.body.getBoundingClientRect();
        return performance.now() - start;
    });
}"""


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
        measured = opened(site, args.runs, args.axe)
    wall, computing = (statistics.median(column) for column in zip(*seconds, strict=True))
    largest = max(one["filter"] for one in measured.values())
    lines = [
        "# The site of all committed reports",
        "",
        f"Made by `python -m benchmarks.site` on {datetime.now(UTC):%Y-%m-%d}: Linux, {os.cpu_count()} cores, load "
        f"{os.getloadavg()[0]:.1f} with what others ran; medians of {args.runs} runs.",
        "",
        f"- Built in {wall:.0f} s ({computing:.0f} s of computing); target: two minutes.",
        f"- {built.pages:,} pages on {built.cells:,} combinations, {built.files:,} files, {built.bytes / 1e6:.1f} MB.",
        f"- A filter of a matrix is applied and laid out in {largest:.0f} ms; target: 200 ms.",
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


def opened(site: Path, runs: int, axe: Path | None) -> dict[str, dict[str, Any]]:
    """Open each page several times; return its first paint and filter time in ms, and its faults in light and dark."""
    program = shutil.which("chromium")
    if program is None:
        sys.exit("chromium is missing: apt-get install chromium")
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - start-up

    measured: dict[str, dict[str, Any]] = {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        for name, address in PAGES.items():
            paints, filters = [], []
            for _ in range(runs):
                page = browser.new_page(offline=True)
                page.goto((site / address).as_uri())
                while page.evaluate(PAINT) is None:
                    page.wait_for_timeout(20)
                paints.append(page.evaluate(PAINT))
                if "matrices" in address:
                    filters += page.evaluate(FILTER)
                page.close()
            measured[name] = {"paint": statistics.median(paints), "filter": statistics.median(filters or [0.0])}
            for mode in ("light", "dark"):
                measured[name][mode] = _faults(browser, (site / address).as_uri(), mode, axe) if axe else "-"
        browser.close()
    return measured


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
