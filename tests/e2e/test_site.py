"""The site in a real browser: filters, the address, the boxes of the home page, the keyboard, and no network."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from harness.model.measured import Measured
from harness.reports import document
from harness.reports.site import build_site, matrix_page
from harness.reports.site.evidence_files import EvidenceFiles
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts
from harness.reports.site.site_sources import Source
from harness.running.signatures import shipped_signatures

ROOT = Path(__file__).parents[2]
REPORTS = [ROOT / "reports" / name / "report.json" for name in ("quickstart", "gymnasium-mujoco", "drift-mjx")]
MOST_CELLS = 1000
MILLISECONDS = 200
"""The time in which so many combinations have to be filtered."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the site of three committed reports."""
    target = tmp_path_factory.mktemp("site") / "site"
    build_site.build(REPORTS, target)
    return target


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Yield Debian's Chromium, driven by Playwright."""
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("missing library: chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # In a container the browser has no right to build its own.
        launched = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield launched
        launched.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """Yield a page; at the end no request may have left the disk, and no script may have failed."""
    context = browser.new_context(viewport={"width": 390, "height": 800}, offline=True)
    opened = context.new_page()
    requests: list[str] = []
    errors: list[str] = []
    opened.on("request", lambda request: requests.append(request.url))
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    yield opened
    assert requests
    assert [address for address in requests if not address.startswith("file://")] == []
    assert errors == []
    context.close()


def open_page(page: Any, site: Path, address: str, view: str = "") -> None:
    """Open a page of the site from disk; `view` is the part after the hash."""
    page.goto("about:blank")
    page.goto((site / address).as_uri() + view)


def rows(page: Any) -> list[str]:
    """Return the combinations that the list shows."""
    # The browser lays a list out when it comes into view; before that it has no inner text.
    return list(page.locator("[data-list] tbody tr:visible td:nth-child(2)").all_text_contents())


def test_pages_of_three_reports(site: Path) -> None:
    """Every combination has a page, each page its badge, each picture is there."""
    documents = [document.read_file(file) for file in REPORTS]
    assert len(list(site.glob("cells/*/*.html"))) == sum(len(each.cells) for each in documents) == 124
    assert {path.name for path in site.glob("matrices/*")} == {"quickstart", "gymnasium-mujoco", "drift-mjx"}
    assert len(list(site.glob("files/quickstart/frames/*.png"))) == 22
    assert (site / "packages/mujoco/index.html").is_file()
    assert (site / "environments/Ant-v5/badge.svg").is_file()


def test_filters_of_a_matrix(page: Any, site: Path) -> None:
    """The list, the table and the address follow what is chosen, and the address alone restores it."""
    open_page(page, site, "matrices/gymnasium-mujoco/index.html")
    assert len(rows(page)) == 60
    page.get_by_text("List all").click()
    assert len(rows(page)) == 109
    page.select_option("select[name=verdict]", "misleads")
    page.select_option("select[name='axis.mujoco']", "3.3.7")
    shown = rows(page)
    assert len(shown) == 4
    assert all("mujoco-3.3.7" in label for label in shown)
    assert page.url.endswith("#verdict=misleads&axis.mujoco=3.3.7")
    assert page.locator("[data-count]").inner_text() == "4 of 109 combinations"
    assert page.locator("[data-pivot] tbody tr").count() == 1

    open_page(page, site, "matrices/gymnasium-mujoco/index.html", "#verdict=misleads&axis.mujoco=3.3.7")
    assert rows(page) == shown
    page.fill("input[name=text]", "py3.9")
    assert rows(page) == [label for label in shown if label.startswith("py3.9")]
    page.click("button[type=reset]")
    page.get_by_text("109 of 109 combinations").wait_for()
    assert "#" not in page.url


def test_any_two_axes(page: Any, site: Path) -> None:
    """The table turns to other axes, and a square of one combination leads to its page."""
    open_page(page, site, "matrices/quickstart/index.html", "#rows=python&columns=mujoco")
    assert page.locator("[data-pivot] caption").inner_text().startswith("Rows: python. Columns: mujoco.")
    page.locator("[data-pivot] a.square").first.click()
    if "matrices" in page.url:
        assert "axis.python=" in page.url
    else:
        assert page.locator("h1").inner_text().startswith("py")


def test_tables_without_scripts(browser: Any, site: Path) -> None:
    """The table over two axes and the list are there, with words besides colours."""
    context = browser.new_context(java_script_enabled=False, offline=True)
    opened = context.new_page()
    open_page(opened, site, "matrices/gymnasium-mujoco/index.html")
    assert len(rows(opened)) == 109
    assert opened.locator("a.square").first.inner_text().startswith("✔ 4/4")
    assert not opened.locator("[data-filters]").is_visible()
    context.close()


@pytest.fixture(scope="module")
def large_site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a matrix of a thousand combinations."""
    target = tmp_path_factory.mktemp("large")
    report = document.read_file(REPORTS[1])
    cells = []
    for number in range(MOST_CELLS):
        cell = report.cells[number % len(report.cells)]
        axes = {**cell.axes, "gymnasium": f"1.0.{number % 40}", "mujoco": f"3.{number // 40}.0"}
        label = f"py{axes['python']}_gymnasium-{axes['gymnasium']}_mujoco-{axes['mujoco']}"
        cells.append(replace(cell, id=f"gymnasium-mujoco/{label}", axes=axes, findings=(), cases=cell.cases[:2]))
    source = Source.of(replace(report, cells=tuple(cells)), None, "gymnasium-mujoco")
    nothing = Measured(generated="", machines={}, cells=(), locks={}, hashes={}, taken={})
    facts = SiteFacts(sources=(source,), measured=nothing, signatures={}, issues=())
    writer = PageWriter(target, {"generated": "", "version": ""})
    writer.copy_assets()
    matrix_page.write(facts, writer, EvidenceFiles(target))
    return target


@pytest.mark.parametrize("times", [1, 10])
def test_many_combinations_are_filtered_at_once(page: Any, large_site: Path, tmp_path: Path, times: int) -> None:
    """A thousand of them, and ten thousand, take less than 200 ms of computing, the layout of the page included."""
    copied = tmp_path / "site"
    shutil.copytree(large_site, copied)
    if times > 1:
        # Each text and each value is one of the page above; further MuJoCo versions make further combinations.
        file = copied / "matrices/gymnasium-mujoco/data.js"
        start, _, text = file.read_text(encoding="utf-8").partition(" = ")
        data = json.loads(text.rstrip(";\n"))
        place = data["axes"].index("mujoco")
        data["cells"] = [
            {**cell, "axes": [*cell["axes"][:place], f"{turn}.{number // 40}", *cell["axes"][place + 1 :]]}
            for turn in range(times)
            for number, cell in enumerate(data["cells"])
        ]
        file.write_text(f"{start} = {json.dumps(data)};\n", encoding="utf-8")

    open_page(page, copied, "matrices/gymnasium-mujoco/index.html")
    total = MOST_CELLS * times
    assert page.locator("[data-count]").inner_text() == f"{total} of {total} combinations"
    assert len(rows(page)) == 60
    assert page.locator("[data-pivot] td").count() <= 600
    client = page.context.new_cdp_session(page)
    client.send("Performance.enable", {"timeDomain": "threadTicks"})  # other programs at the same time count nothing

    def computing() -> float:
        metrics = {one["name"]: one["value"] for one in client.send("Performance.getMetrics")["metrics"]}
        return 1000 * sum(metrics[f"{name}Duration"] for name in ("Script", "Layout", "RecalcStyle"))

    took = []
    for name, value in (("verdict", "misleads"), ("verdict", ""), ("text", "num"), ("text", ""), ("rows", "python")):
        start_time = computing()
        page.evaluate(
            """([name, value]) => {
                const control = document.querySelector(`[name=${name}]`);
                control.value = value;
                control.dispatchEvent(new Event("input", { bubbles: true }));
                document.body.getBoundingClientRect();
            }""",
            [name, value],
        )
        took.append(computing() - start_time)
    assert sorted(took)[len(took) // 2] < MILLISECONDS, took
    if times == 1:
        page.get_by_text(f"The first 60 of {total} are listed. List all").click()
        assert len(rows(page)) == total


def test_long_lists_are_read_without_scripts(browser: Any, large_site: Path) -> None:
    """A list and a table too long for one page have pages of their own, and all of them together are complete."""
    context = browser.new_context(java_script_enabled=False, offline=True)
    opened = context.new_page()
    open_page(opened, large_site, "matrices/gymnasium-mujoco/index.html")
    first = rows(opened)
    opened.click("text=combinations 501 to 1000")
    opened.wait_for_load_state()
    assert len({*first, *rows(opened)}) == MOST_CELLS
    open_page(opened, large_site, "matrices/gymnasium-mujoco/index.html")
    opened.click("text=The whole table")
    opened.wait_for_load_state()
    assert opened.locator("table.pivot tbody td").count() == MOST_CELLS
    context.close()


def test_behaviour_of_a_combination(page: Any, site: Path) -> None:
    """Its page has the plot over releases, and the column of its own release is marked."""
    open_page(page, site, "cells/drift-mjx/py3.11_mujoco-mjx-3.1.6.html")
    marked = page.locator("table.families th.here")
    assert marked.inner_text() == "mujoco-mjx-3.0.1 to mujoco-mjx-3.17.0"
    letters = page.locator("table.families tbody tr")
    assert page.locator("table.families td.here").count() == letters.count() > 0
    plot = page.locator("figure.plot img")
    plot.scroll_into_view_if_needed()
    page.wait_for_function("document.querySelector('figure.plot img').naturalWidth > 100")


def test_a_misleading_picture_is_beside_the_right_one(page: Any, site: Path) -> None:
    """The causes come first, and the pictures of the nearest combination that works are shown too."""
    open_page(page, site, "cells/gymnasium-mujoco/py3.10_gymnasium-1.4.0_mujoco-2.3.7.html")
    assert page.locator("h2").first.inner_text() == "Cause: mujoco-before-numpy2-vectors"
    here, right = page.locator(".frames figure:not(.right) img"), page.locator(".frames figure.right img")
    assert here.count() == right.count() > 0
    assert here.first.get_attribute("src") != right.first.get_attribute("src")


def test_the_search_finds_packages_environments_and_errors(page: Any, site: Path) -> None:
    """The best hit comes first, and Enter opens it."""
    open_page(page, site, "index.html")
    for words, first in (("mujoco", "mujoco"), ("Ant-v5", "Ant-v5"), ("bool8", "bool8")):
        page.fill("#search", words)
        assert first in page.locator("[data-search-result] a").first.inner_text()
    page.fill("#search", "Ant-v5")
    page.press("#search", "Enter")
    assert page.locator("h1").inner_text() == "Ant-v5"


def test_the_box_names_pages_and_a_command_but_no_cause(page: Any, site: Path) -> None:
    """A pasted line leads to pages; hostile text in it stays text."""
    open_page(page, site, "index.html")
    page.fill("#paste", "<img src=x onerror=alert(1)>\nAttributeError: module 'numpy' has no attribute 'bool8'\n")
    page.wait_for_selector("[data-paste-result] a")
    result = page.locator("[data-paste-result]")
    assert "simmatrix explain error.log" in result.inner_text()
    assert any("bool8" in text for text in result.locator("a").all_inner_texts())
    causes = [one.cause for one in shipped_signatures.load_all()]
    assert not [cause for cause in causes if cause in result.inner_text()]
    assert page.locator("main img[src=x]").count() == 0


def test_the_box_is_right_on_all_examples(page: Any, site: Path) -> None:
    """Each example of a known issue leads to its page, by the same patterns as in Python."""
    open_page(page, site, "index.html")
    examples = [(one.id, example) for one in shipped_signatures.load_all() for example in one.examples]
    found = page.evaluate("(texts) => texts.map((text) => explained(text).met.map((issue) => issue.link))",
                          [example for _, example in examples])  # fmt: skip
    missed = [
        name for (name, _), links in zip(examples, found, strict=True) if f"issues/{name}/index.html" not in links
    ]
    assert len(examples) > 300
    assert missed == []


def test_colours_follow_the_reader(browser: Any, site: Path) -> None:
    """Dark where the system is dark; the switch turns it, by keyboard too, with a visible focus."""
    context = browser.new_context(color_scheme="dark", offline=True)
    opened = context.new_page()
    open_page(opened, site, "index.html")
    background = "getComputedStyle(document.body).backgroundColor"
    assert opened.evaluate(background) == "rgb(18, 21, 27)"
    switch = opened.locator("[data-theme-switch]")
    for _ in range(20):
        opened.keyboard.press("Tab")
        if switch.evaluate("(node) => node === document.activeElement"):
            break
    assert switch.evaluate("(node) => getComputedStyle(node).outlineStyle") == "solid"
    opened.keyboard.press("Enter")
    assert opened.evaluate(background) == "rgb(255, 255, 255)"
    context.close()


@pytest.mark.parametrize(
    "address",
    ["index.html", "matrices/gymnasium-mujoco/index.html", "packages/mujoco/index.html",
     "environments/Ant-v5/index.html", "issues/numpy124-aliases-of-builtins/index.html",
     "cells/gymnasium-mujoco/py3.8_gymnasium-0.27.1_mujoco-3.0.1.html"],
)  # fmt: skip
def test_a_phone_shows_pages_without_sideways_scrolling(page: Any, site: Path, address: str) -> None:
    """Only tables and code scroll sideways, inside their frames."""
    open_page(page, site, address)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
