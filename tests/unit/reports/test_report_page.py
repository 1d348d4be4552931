"""Read a report page as people do: each cause once with its fix, images beside each other, no column of one value."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest
from builders import diagnosis
from markdown_it import MarkdownIt
from specimens import moved, quick_document

from harness.model import Phase, Role, Verdict
from harness.model.report_types import CaseEntry, CellEntry, Document
from harness.reports import document
from harness.reports.tables import fix_commands, frame_rows, tables
from harness.reports.tables.table_types import Pivot, Square
from harness.reports.template_files import read_template
from harness.reports.text import report_markdown

REPORTS = sorted((Path(__file__).parents[3] / "reports").glob("*/report.json"))
HOSTILE = "`</code><img src=x>` ![p](http://evil.example/x.png) [l](http://evil.example) | <script>\n# head\n```\n<b>"


def page(*cells: CellEntry) -> str:
    """Return the page of the document of `quick` with other cells."""
    made = msgspec.structs.replace(quick_document(), cells=cells, dropped=())
    return report_markdown.markdown(tables.report(made), read_template(report_markdown.TEMPLATE))


def red(mujoco: str, line: str = "no such field", **more: object) -> CellEntry:
    """Return a red cell with a known cause, whose fix is a requirement."""
    known = diagnosis(
        "gone-field", remedy={"requirements": ["mujoco<4"]}, references=("https://github.com/a/b/issues/3",)
    )
    usual = {
        "verdict": Verdict.PARTIAL,
        "decisive": line,
        "diagnoses": (known,),
        "as_expected": True,
        "expectation": None,
    }
    return moved(2, {"python": "3.11", "mujoco": mujoco, "gymnasium": "1.2.3"}, **{**usual, **more})


def green(mujoco: str, *frames: str, misleads: Sequence[str] = (), **more: object) -> CellEntry:
    """Return a green cell, whose first case drew these frames."""
    cell = moved(0, {"python": "3.11", "mujoco": mujoco, "gymnasium": "1.2.3"}, findings=(), repairs=(), **more)
    first: CaseEntry = msgspec.structs.replace(cell.cases[0], frames=frames, misleads=tuple(misleads))
    return msgspec.structs.replace(cell, cases=(first, *cell.cases[1:]))


def test_a_cause_stands_once_with_a_command() -> None:
    """Its text and its fix stand in one section; rows link there."""
    text = page(red("4.0.0"), red("4.1.0", "no such field either"), green("3.3.7"))

    assert text.lower().count("cause of gone-field") == 1
    assert text.count("```sh\npip install 'mujoco<4'\n```") == 1
    assert text.count("| [`gone-field`](#gone-field) |") == 2
    assert "Known issue: [a/b#3](https://github.com/a/b/issues/3). Details: `simmatrix known gone-field`." in text
    assert text.index("## Environments tried") < text.index("### `gone-field`") < text.index("## Combinations")


def test_many_causes_have_a_list_with_their_fixes() -> None:
    """It stands above the sections; a cause without a name has its line in it."""
    lines = ("a line", "another", "a third")
    cells = [red(f"4.{place}.0", line, diagnoses=()) for place, line in enumerate(lines)]
    text = page(*cells, red("5.0.0"))

    assert "| [`gone-field`](#gone-field) | 1 | `pip install 'mujoco<4'` |" in text
    assert "| [Cause 1](#cause-1-partial): `a line` | 1 |  |" in text
    assert text.index("| [Cause 1]") < text.index("### Cause 1: partial")
    assert "To search for a fix:\n\n```sh\nsimmatrix repair quick/py3.11_mujoco-4.0.0_gymnasium-1.2.3\n```" in text


@pytest.mark.parametrize(
    ("fix", "commands"),
    [
        ({"requirements": ["numpy<2"], "constraints": ["mujoco==3.1"]}, ("pip install 'numpy<2' mujoco==3.1",)),
        ({"only_binary": ["mujoco"], "requirements": ["mujoco"]}, ("pip install --only-binary mujoco mujoco",)),
        ({"environment": {"MUJOCO_GL": "egl", "DISPLAY": ""}}, ("export MUJOCO_GL=egl", "unset DISPLAY")),
        ({"python": "3.9", "uninstall": ["gym"]}, ("uv venv --python 3.9", "pip uninstall -y gym")),
        ({"requirements": ["a; rm -rf ~"]}, ("pip install 'a; rm -rf ~'",)),
        ({"text": "Pass the space first."}, ()),
        ({"requirements": ["gym"], "overlay": ["gym"]}, ()),
    ],
)
def test_a_fix_as_commands(fix: dict[str, object], commands: tuple[str, ...]) -> None:
    """Requirements, variables and Pythons are commands, quoted; a patched wheel is not."""
    assert fix_commands.commands(fix) == commands


def test_columns_of_one_value_are_left_out() -> None:
    """They are told in one line. A column whose values the names of the combinations say is left out, too."""
    versions = ("4.0.0", "4.1.0", "3.3.7")
    installed = [{"mujoco": version, "numpy": "2.2.6"} for version in versions]
    cells = [
        make(version, installed=held)
        for make, version, held in zip((red, red, green), versions, installed, strict=True)
    ]
    text = page(*cells)

    assert "\nThe same in all 3: " in text
    assert re.search(r"The same in all 3: .*numpy 2\.2\.6", text)
    heads = [line for line in text.splitlines() if line.startswith("| result |")]
    assert heads
    assert not any(f"| {name} |" in head for head in heads for name in ("numpy", "mujoco", "machine"))


def test_green_combinations_are_folded_where_they_are_many() -> None:
    """Red ones stand above, unfolded."""
    text = page(*(green(f"3.{place}.0") for place in range(9)), red("4.0.0"))

    assert "<summary>9 combinations that work</summary>" in text
    assert (
        text.index("| ◐ partial")
        < text.index("<summary>9 combinations")
        < text.index("| ✔ works | `py3.11_mujoco-3.8.0")
    )
    assert "that work</summary>" not in page(green("3.0.0"), red("4.0.0"))


def test_images_of_a_task_stand_in_a_row() -> None:
    """Each once, with its releases under it; one that misleads has a sign and words."""
    text = page(
        green("3.0.0", "frames/a.png"),
        green("3.1.0", "frames/a.png"),
        green("3.2.0", "frames/b.png", misleads=["render.camera"]),
    )
    name = quick_document().cells[0].cases[0].case

    assert (
        f"| ![{name}, mujoco 3.0.0 or 3.1.0](frames/a.png) | ![{name}, mujoco 3.2.0](frames/b.png) |\n"
        "| :-: | :-: |\n"
        "| mujoco 3.0.0 or 3.1.0 | ≠ **this image misleads**<br>mujoco 3.2.0<br>`render.camera` |\n"
    ) in text


def test_images_follow_the_releases() -> None:
    """More than five go on below; those of older releases come first."""
    cells = [green(f"3.{place}.0", f"frames/{place}.png") for place in (6, 2, 10, 1, 3, 4)]
    (row,) = frame_rows.frame_rows(cells, ("python", "mujoco", "gymnasium"))

    assert [frame.path for frame in row.frames] == [f"frames/{place}.png" for place in (1, 2, 3, 4, 6, 10)]
    lines = [line for line in page(*cells).splitlines() if "frames/" in line]
    assert [line.count("![") for line in lines] == [5, 1]


def test_no_text_of_a_package_becomes_an_image() -> None:
    """Only frames that the report names are shown, and none outside it."""
    text = page(
        red("4.0.0", f"![x](frames/a.png) {HOSTILE}"),
        green("3.0.0", "frames/a.png"),
        green("3.1.0", "../x) ![y](u.png"),
    )
    reader = MarkdownIt("commonmark", {"html": True}).enable("table")
    tokens = [child for token in reader.parse(text) for child in token.children or ()]

    assert [token.attrs["src"] for token in tokens if token.type == "image"] == ["frames/a.png"]


def test_hostile_texts_stay_text() -> None:
    """A page whose every text is hostile has our own HTML alone, all its tables whole, and no foreign link."""
    known = diagnosis(
        "gone-field", cause=HOSTILE, remedy={"text": HOSTILE}, references=(f"https://e.example) {HOSTILE}",)
    )
    finding = msgspec.structs.replace(quick_document().cells[0].findings[0], text=HOSTILE)
    text = page(
        red("4.0.0", HOSTILE, diagnoses=(known,)),
        red("4.1.0", HOSTILE, diagnoses=(), findings=(finding,)),
        red("4.2.0", HOSTILE, diagnoses=(), role=Role.REPAIR, phase=Phase.RENDER),
    )
    reader = MarkdownIt("commonmark", {"html": True}).enable("table")
    tokens = reader.parse(text)
    inner = [child for token in tokens for child in token.children or ()]

    html = {one.content.strip() for one in [*tokens, *inner] if one.type in {"html_inline", "html_block"}}
    assert all(
        re.fullmatch(r"(?:</?(?:details|summary|sub)>|<br>|<summary>[\w :]+</summary>|\s)+", one) for one in html
    ), html
    assert not any(str(one.attrs["href"]).startswith("http://evil") for one in inner if one.type == "link_open")
    assert "head" not in [line.lstrip("# ") for line in text.splitlines() if line.startswith("#")]
    assert [one.type for one in inner if one.type == "image"] == []


def test_releases_that_are_alike_are_one_row() -> None:
    """In a table of one column; not if the rows are names, which have no order."""
    works = Square(machine="m", verdict=Verdict.WORKS, passed=1, tried=1)
    broken = Square(machine="m", verdict=Verdict.BROKEN, passed=0, tried=1)

    def rows(*names: str) -> list[str]:
        squares = tuple(((broken if place == 2 else works,),) for place in range(len(names)))
        pivot = Pivot(down="a", across="b", rows=names, columns=("1",), squares=squares)
        return [line.split(" | ")[0].removeprefix("| ") for line in report_markdown.pivot_table(pivot).splitlines()[2:]]

    assert rows("1.0", "1.1", "1.2", "1.3rc1") == ["1.0 to 1.1 (2)", "1.2", "1.3rc1"]
    assert rows("unset", "egl", "cuda-0", "glfw") == ["unset", "egl", "cuda-0", "glfw"]


@pytest.mark.parametrize("path", REPORTS, ids=lambda path: path.parent.name)
def test_committed_pages_are_sound(path: Path) -> None:
    """On each page no code holds an entity, each link within the page has a heading, each image a file."""
    made: Document = document.read(path.read_bytes(), str(path))
    text = report_markdown.markdown(tables.report(made), read_template(report_markdown.TEMPLATE))
    tokens = MarkdownIt("commonmark", {"html": True}).enable("table").parse(text)
    inner = [child for token in tokens for child in token.children or ()]

    code = [one.content for one in [*tokens, *inner] if one.type in {"code_inline", "code_block", "fence"}]
    assert [one for one in code if re.search(r"&(?:lt|gt|amp|#\d+);", one)] == []
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
    links = [str(one.attrs["href"]) for one in inner if one.type == "link_open"]
    assert [link for link in links if link.startswith("#") and link[1:] not in anchors] == []
    images = [str(one.attrs["src"]) for one in inner if one.type == "image"]
    assert [image for image in images if not (path.parent / image).is_file()] == []
    drawn = {case.frames[0] for cell in made.cells for case in cell.cases if case.frames}
    assert drawn == {image for image in images if image.startswith("frames/")}
