"""The verb `site`: what it refuses, what it replaces, and that untrusted text stays text on every page."""

import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import pytest
from specimens import quick_document

from harness.__main__ import main
from harness.model.report_types import CellEntry, DiagnosisEntry, Document
from harness.reports import document
from harness.reports.site import build_site

EVIL = '<script>alert(1)</script>"><img src=x onerror=alert(2)>'
CELL = "cells/quick/py3.9_gymnasium-0.29.1_mujoco-3.3.7.html"
PNG = b"\x89PNG\r\n\x1a\n" + b"\x00\x00\x00\x00IEND\xaeB`\x82"
PINS = {"gymnasium": "1.2.3", "mujoco": "3.3.7", "numpy": "2.2.6"}
LOCK = "".join(f"{name}=={version} \\\n    --hash=sha256:{'0' * 64}\n" for name, version in PINS.items())


class Tags(HTMLParser):
    """Collects what a browser would make of a page: tags with their attributes, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


def parse(path: Path) -> Tags:
    """Return the tags and the text of a page."""
    tags = Tags()
    tags.feed(path.read_text(encoding="utf-8"))
    return tags


def write(folder: Path, report: Document, *, files: bool = True) -> Path:
    """Write a report with the files that it names, or without them; return its folder."""
    folder.mkdir(parents=True)
    for name in sorted(document.paths(report)) if files else ():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix:
            path.write_bytes(PNG if path.suffix == ".png" else LOCK.encode())
        else:
            path.mkdir(exist_ok=True)
            (path / "log.txt").write_text(f"Traceback of {name} {EVIL}\n")
    (folder / "report.json").write_bytes(document.encode(report))
    return folder


def evil_document() -> Document:
    """Return a report in which every text that can be anything is hostile."""
    replace = msgspec.structs.replace
    report = quick_document()
    diagnosis = DiagnosisEntry(
        signature=EVIL, cause=EVIL, remedy={"text": EVIL, "requirements": [EVIL]}, proven=False, masks=False,
        references=("javascript:alert(3)", EVIL), seen=EVIL,
    )  # fmt: skip

    def hostile(cell: Any) -> Any:
        cases = tuple(replace(one, decisive=EVIL, env=EVIL, reasons={"single.loop": EVIL}) for one in cell.cases)
        label = f"quick/{cell.id.partition('/')[2]}-{EVIL}"
        installed = {EVIL: EVIL, "numpy": "2.2.6"}
        return replace(cell, id=label, decisive=EVIL, cases=cases, installed=installed, diagnoses=(diagnosis,),
                       axes={**cell.axes, EVIL: EVIL}, environment={EVIL: EVIL})  # fmt: skip

    return replace(report, cells=tuple(map(hostile, report.cells)))


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder; nothing is known there, so that no page of a known issue is written."""
    monkeypatch.setenv("HARNESS_SIGNATURES", "")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / ".harness"))
    return tmp_path


@pytest.fixture(scope="module")
def evil(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the site of the hostile report."""
    folder = tmp_path_factory.mktemp("evil")
    source = write(folder / "report", evil_document())
    build_site.build([source / "report.json"], folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the site of an ordinary report."""
    folder = tmp_path_factory.mktemp("ordinary")
    source = write(folder / "report", quick_document())
    build_site.build([source / "report.json"], folder / "site")
    return folder / "site"


def pages(site: Path) -> Iterator[Path]:
    """Yield the pages of a site."""
    yield from sorted(site.rglob("*.html"))


# --- what it writes --------------------------------------------------------------------------------------------


def test_every_link_leads_to_a_file(site: Path) -> None:
    """Pages, scripts, pictures and logs that a page names are there; nothing else is loaded."""
    broken = []
    for page in pages(site):
        for tag, attributes in parse(page).tags:
            if tag == "link" and attributes.get("rel") not in {"stylesheet", "icon"}:
                continue
            target = attributes.get("href") or attributes.get("src")
            outside = target and tag == "a" and target.startswith("https://")
            if target and not outside and not target.startswith("#"):
                file = page.parent / target.partition("#")[0]
                broken += [] if file.is_file() else [f"{page.relative_to(site)}: {target}"]
    assert broken == []


def test_a_cell_page_begins_with_its_result(site: Path) -> None:
    """The result, the line, the ways to green, the phases in their order, and the command that repeats it."""
    text = " ".join(parse(site / CELL).text.split())
    assert "◐ partial in render as expected: gymnasium 0.29 reads a field that mujoco 3.0 renamed" in text
    assert "'mujoco._structs.MjData' object has no attribute 'solver_iter'" in text
    assert "Take the nearest combination that works: mujoco 2.3.7." in text
    order = [text.index(f"✔ {phase} passed") for phase in ("resolve", "install", "import", "single")]
    assert order == sorted(order)
    assert "simmatrix run quick -k py3.9_gymnasium-0.29.1_mujoco-3.3.7 --fresh" in text


def test_the_table_is_readable_without_scripts(site: Path) -> None:
    """Each square has a sign and a word, and links to its cell."""
    page = parse(site / "matrices/quick/index.html")
    squares = [attributes for tag, attributes in page.tags if "square" in (attributes.get("class") or "").split()]
    links = {str(one["href"]) for one in squares if one["class"] == "square partial"}
    assert "../../cells/quick/py3.11_gymnasium-1.2.3_mujoco-2.3.7.html" in links
    assert "◐ 1/2 partial" in " ".join(page.text.split())


def test_each_known_issue_has_its_line_as_title(site: Path) -> None:
    """The title of the page is the line of the first example, word for word."""
    page = (site / "issues/gym021-extras-require-setuptools/index.html").read_text(encoding="utf-8")
    title = re.search(r"<title>(.*?)</title>", page, re.DOTALL)
    assert title
    assert title[1].startswith("error in gym setup command: &#39;extras_require&#39; must be a dictionary")
    assert "simmatrix explain --id gym021-extras-require-setuptools" in page


def test_data_of_the_filters_follows_the_rows(site: Path) -> None:
    """The script sets one variable, and has an entry for each row of the list, in the same order."""
    text = (site / "matrices/quick/data.js").read_text(encoding="utf-8")
    data = json.loads(text.removeprefix("window.MATRIX = ").rstrip(";\n"))
    rows = [attributes for tag, attributes in parse(site / "matrices/quick/index.html").tags if tag == "tr"]
    page = parse(site / "matrices/quick/index.html").text
    labels = [cell["label"] for cell in data["cells"]]
    places = [page.index(label, page.index("Combinations")) for label in labels]
    assert places == sorted(places)
    assert len(labels) == len(quick_document().cells) < len(rows)


def test_each_figure_of_the_first_page_has_its_evidence(site: Path) -> None:
    """It lies in a link, or in a line with one, and each link opens a page and an anchor that are there."""
    bare, broken = [], []
    for block, links in blocks(site / "index.html"):
        if re.search(r"\d", block) and not links:
            bare.append(block)
        broken += [link for link in links if not opens(site, link)]
    assert (bare, broken) == ([], [])


def test_each_count_of_the_first_page_is_that_of_the_page_it_opens(site: Path) -> None:
    """The number of a matrix and a verdict is the number of combinations that the page then lists."""
    first = (site / "index.html").read_text(encoding="utf-8")
    counts = re.findall(r'<a class="count" href="(matrices/\w+/)index.html#verdict=(\w+)">(\d+)</a>', first)
    assert len(counts) > 1
    for folder, verdict, number in counts:
        data = (site / folder / "data.js").read_text(encoding="utf-8").removeprefix("window.MATRIX = ")
        cells = json.loads(data.rstrip(";\n"))["cells"]
        assert sum(cell["verdict"] == verdict for cell in cells) == int(number)


def blocks(page: Path) -> list[tuple[str, list[str]]]:
    """Return the text of each row, item and paragraph of a page, with the addresses of its links."""
    parts = re.findall(r"<(tr|li|p)\b[^>]*>(.*?)</\1>", page.read_text(encoding="utf-8"), re.DOTALL)
    found = []
    for _, part in parts:
        tags = Tags()
        tags.feed(re.sub(r"<pre\b.*?</pre>", "", part, flags=re.DOTALL))
        found.append((" ".join(tags.text.split()), [str(one["href"]) for tag, one in tags.tags if tag == "a"]))
    return found


def opens(site: Path, link: str) -> bool:
    """Return whether a link of the first page opens a page that is there, and its anchor or a filter there."""
    address, _, anchor = link.partition("#")
    file = site / (address or "index.html")
    if not file.is_file():
        return False
    ids = {attributes.get("id") for _, attributes in parse(file).tags}
    filtered = address.startswith("matrices/") and anchor.startswith("verdict=")
    return not anchor or anchor in ids or filtered


def test_a_badge_is_beside_the_page(site: Path) -> None:
    """It says which releases work."""
    assert ">3.3.7<" in (site / "packages/mujoco/badge.svg").read_text(encoding="utf-8")


# --- hostile reports -------------------------------------------------------------------------------------------


def test_hostile_text_stays_text(evil: Path) -> None:
    """No tag, no attribute and no address of a page comes from a report."""
    for page in pages(evil):
        for tag, attributes in parse(page).tags:
            assert not [name for name in attributes if name.startswith("on")], page
            assert attributes.get("src") != "x", page
            assert not (attributes.get("href") or "").lower().startswith("javascript"), page
            assert tag != "script" or (attributes.get("src") or "").endswith(".js"), page
    assert any(EVIL in parse(page).text for page in pages(evil))


def test_hostile_names_stay_in_the_folder(evil: Path) -> None:
    """The files of the site have plain names, whatever a report calls its cells, packages and environments."""
    names = [path.relative_to(evil).as_posix() for path in evil.rglob("*") if path.is_file()]
    assert [name for name in names if not re.fullmatch(r"[A-Za-z0-9._/-]+", name)] == []


def test_hostile_text_in_a_badge(evil: Path) -> None:
    """A badge of a hostile name is no script."""
    for badge in evil.rglob("badge.svg"):
        assert "<script" not in badge.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", ["../../secret.txt", "/etc/hostname", "frames/link.png", "report.json"])
def test_files_of_others_are_not_copied(place: Path, path: str) -> None:
    """A report may name any file; only texts and pictures inside its folder are copied."""
    report = quick_document()
    cells = tuple(msgspec.structs.replace(cell, lock=path) for cell in report.cells)
    source = write(place / "a/report", msgspec.structs.replace(report, cells=cells), files=False)
    (place / "secret.txt").write_text("secret")
    (source / "frames").mkdir()
    (source / "frames/link.png").symlink_to("/etc/hostname")
    main(["site", str(source), "--out", "site"])
    assert not list((place / "site").rglob("*secret*"))
    assert not (place / "site/files").exists()
    assert "Missing evidence" in parse(place / "site" / CELL).text


# --- evidence that is missing ----------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [b"not a picture", PNG[:12], b""])
def test_missing_evidence_stands_on_its_page_alone(place: Path, content: bytes) -> None:
    """The page names each file that is gone, cut or something else; all pages are built."""
    frame = "frames/ant.png"

    def draw(cell: CellEntry) -> CellEntry:
        cases = tuple(msgspec.structs.replace(case, frames=(frame,)) for case in cell.cases)
        return msgspec.structs.replace(cell, cases=cases)

    report = msgspec.structs.replace(quick_document(), cells=tuple(map(draw, quick_document().cells)))
    source = write(place / "report", report)
    cell = next(one for one in report.cells if CELL.endswith(f"{one.label}.html"))
    assert cell.lock
    (source / cell.lock).unlink()
    (source / frame).write_bytes(content)
    (source / "evidence.tar.xz").write_bytes(b"a cut pack")

    assert main(["site", str(source), "--out", "site"]) == 0

    text = " ".join(parse(place / "site" / CELL).text.split())
    assert f"{cell.lock}: there is no such file" in text
    assert f"{frame}: it is damaged" in text
    assert len(list((place / "site/cells/quick").glob("*.html"))) == len(report.cells)


def test_a_report_without_its_evidence_says_so(place: Path) -> None:
    """A wheel has the reports alone."""
    write(place / "report", document.relocate(quick_document(), lambda _: ""))
    assert main(["site", "report", "--out", "site"]) == 0
    assert "This report came without locks, logs and pictures." in parse(place / "site" / CELL).text


# --- bad input -------------------------------------------------------------------------------------------------


def refuse(words: list[str], capsys: pytest.CaptureFixture[str], out: str = "site") -> str:
    """Run the verb, which has to refuse and write nothing; return its message."""
    before = sorted(Path().rglob("*"))
    assert main(["site", *words, "--out", out]) == 2
    assert sorted(Path().rglob("*")) == before
    return capsys.readouterr().err.removeprefix("simmatrix: ").rstrip("\n")


def test_a_source_that_is_no_report(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder without a report, a missing one, and a file of another kind are refused."""
    (place / "empty").mkdir()
    (place / "list").mkdir()
    (place / "list/report.json").write_text("[1]")
    assert refuse(["empty"], capsys).startswith("empty: no report.json here")
    assert refuse(["nowhere"], capsys).startswith("nowhere: no report.json here")
    assert refuse(["list"], capsys).startswith("list/report.json")
    content = document.encode(quick_document())
    (place / "list/report.json").write_bytes(content[: len(content) // 2])
    assert refuse(["list"], capsys).startswith("list/report.json")


def test_a_newer_schema(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A report of a newer schema is refused, even if another source is good."""
    write(place / "good", quick_document())
    content = json.loads(document.encode(quick_document()))
    (place / "new").mkdir()
    (place / "new/report.json").write_text(json.dumps({**content, "schema": 2}))
    assert "schema" in refuse(["good", "new"], capsys)


def test_two_reports_of_one_name(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Their pages would overwrite each other."""
    write(place / "one", quick_document())
    write(place / "two", quick_document())
    assert refuse(["one", "two"], capsys) == (
        "site: two reports are named quick: one/report.json and two/report.json; name one of them only"
    )
    assert refuse(["."], capsys).startswith("site: two reports are named quick")


def test_a_folder_with_other_files(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Only an earlier site is replaced, and only where nothing was added to it."""
    write(place / "report", quick_document())
    (place / "mine").mkdir()
    (place / "mine/thesis.txt").write_text("years of work")
    assert refuse(["report"], capsys, out="mine") == (
        "--out mine: holds thesis.txt, which is no part of an earlier site; name another folder"
    )
    (place / "file").write_text("")
    assert refuse(["report"], capsys, out="file").startswith("--out file: is no folder")
    assert refuse(["report"], capsys, out="file/site") == f"--out file/site: {place}/file is no folder"


def test_an_earlier_site_is_replaced(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same report gives the same files; a file that somebody added is not deleted."""
    write(place / "report", quick_document())

    def files() -> dict[str, bytes]:
        site = place / "site"
        return {str(path.relative_to(site)): path.read_bytes() for path in site.rglob("*") if path.is_file()}

    assert main(["site", "report", "--out", "site"]) == 0
    first = files()
    assert main(["site", "report", "--out", "site", "--json"]) == 0
    assert files() == first
    printed = json.loads(capsys.readouterr().out.partition("\n")[2])
    assert printed["index"] == "site/index.html"
    assert printed["cells"] == len(quick_document().cells)
    assert printed["files"] + 1 == len(first)  # the list of files does not count itself
    assert sorted(path.name for path in place.iterdir() if path.is_dir()) == ["report", "site"]
    (place / "site/CNAME").write_text("example.org")
    assert refuse(["report"], capsys).startswith("--out site: holds CNAME")
