"""Bring Markdown files of the repository that lie outside `docs/` into the site, and lead links to them.

A page links to `../reports/NAME/report.md` as it does in the repository. In the site that report is a page below
`repository/`. A link to any other file leads to the repository's address, or is shown as a path where there is none.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import unquote

from pymdownx.slugs import slugify

ROOT = Path(__file__).resolve().parents[2]
PLACE = "repository"
"""Folder of the site for files from outside `docs/`."""
LINK = re.compile(
    r"(?P<code>^(?:```|~~~).*?^(?:```|~~~)$|(?P<ticks>`+)[^\n]*?(?P=ticks))"
    r"|(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<target>[^)\s]+)\)",
    re.DOTALL | re.MULTILINE,
)
"""A link, or code, in which there are none."""
PICTURES = {".png", ".svg", ".jpg", ".gif"}
SLUG: Callable[[str, str], str] = slugify(case="lower")
"""From a heading's text and a separator to its anchor, as `mkdocs.yml` sets it."""


class MissingFile(Exception):
    """A link leads to no file of the repository."""


def linked_files() -> tuple[set[str], set[str]]:
    """Return Markdown files outside `docs/` that its pages link to, directly or not, and pictures of these files."""
    pages: set[str] = set()
    pictures: set[str] = set()
    waiting = [path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")] + ["CONTRIBUTING.md"]
    while waiting:
        source = waiting.pop()
        for target in _targets(source):
            if Path(target).suffix in PICTURES:
                pictures.add(target)
            elif target.endswith(".md") and not target.startswith("docs/") and target not in pages:
                pages.add(target)
                waiting.append(target)
    return pages, pictures


def _targets(source: str) -> Iterator[str]:
    for match in LINK.finditer((ROOT / source).read_text(encoding="utf-8")):
        target = resolve(source, match["target"])[0] if match["target"] else ""
        if target and (ROOT / target).is_file():
            yield target


def resolve(source: str, link: str) -> tuple[str, str]:
    """Return the path in the repository and the anchor of a link in a file; an empty path for any other link."""
    address, _, anchor = link.partition("#")
    if not address or re.match(r"[a-z]+:", address):
        return "", anchor
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), unquote(address))), anchor


def lead_links(text: str, source: str, place: str, shown: set[str], repository: str) -> str:
    """Return the Markdown of a file with its links as a page of the site needs them.

    `source` is its path in the repository and `place` its path in the site; `shown` are files that the site has.
    Raises MissingFile.
    """

    own_anchors = anchors(text)

    def link(match: re.Match[str]) -> str:
        if match["code"]:
            return match[0]
        if match["target"].startswith("#") and place.startswith(PLACE) and match["target"][1:] not in own_anchors:
            return match["text"]  # a report may name a cause that it has no section of
        target, anchor = resolve(source, match["target"])
        if not target or (target.startswith("docs/") and target in shown):
            return match[0] if place == source.removeprefix("docs/") else _moved(match, target, anchor, place)
        if target in shown:
            return _moved(match, target, anchor, place)
        if not (ROOT / target).exists() and place == site_path(source) and not place.startswith(PLACE):
            message = f"{source}: links to {match['target']}, which does not exist"
            raise MissingFile(message)
        if repository:
            return f"{match['image']}[{match['text']}]({repository.rstrip('/')}/blob/HEAD/{target})"
        return match["text"] if match["text"].startswith("`") else f"{match['text']} (`{target}`)"

    return LINK.sub(link, text)


def anchors(text: str) -> set[str]:
    """Return the anchors of the headings of a Markdown text."""
    headings = re.findall(
        r"^#+ +(.+?) *$", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE
    )
    return {SLUG(heading.replace("`", ""), "-") for heading in headings}


def _moved(match: re.Match[str], target: str, anchor: str, place: str) -> str:
    if not target:
        return match[0]
    address = posixpath.relpath(site_path(target), posixpath.dirname(place) or ".")
    return f"{match['image']}[{match['text']}]({address}{'#' if anchor else ''}{anchor})"


def site_path(path: str) -> str:
    """Return the place in the site of a file of the repository."""
    return path.removeprefix("docs/") if path.startswith("docs/") else OWN_PLACE.get(path, f"{PLACE}/{path}")


OWN_PLACE = {"CONTRIBUTING.md": "contributing.md"}
"""Files that have a page in the navigation."""
