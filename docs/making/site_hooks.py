"""Hooks of `mkdocs build`: pages made from the code, and pages from outside `docs/`."""

from __future__ import annotations

import re
from pathlib import Path

import reference_pages
import repository_files
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = repository_files.ROOT
RECORDING = ROOT / "dist" / "terminal.svg"
"""An animated terminal, where `nox -s docs` recorded it."""
RECORDED = "<!-- terminal -->"
"""The place of a recording in a page."""
FILE = re.compile(r"^<!-- example: file=(?P<name>\S+) -->\n```(?P<language>\w+)$", re.MULTILINE)
"""A block that a tutorial has the reader write to a file: in the site the file's name is its title."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from the code, and files of the repository that pages link to."""
    for place, text in reference_pages.pages():
        files.append(File.generated(config, place, content=text))
    pages, pictures = repository_files.linked_files()
    for path in sorted(pages | pictures | set(repository_files.OWN_PLACE)):
        files.append(File.generated(config, repository_files.site_path(path), abs_src_path=str(ROOT / path)))
    if RECORDING.exists():
        files.append(File.generated(config, "assets/terminal.svg", abs_src_path=str(RECORDING)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead the links of a page to pages of the site."""
    place = page.file.src_uri
    source = _source(page)
    if source is None:
        return markdown
    shown = {_repository_path(file) for file in files}
    try:
        text = repository_files.lead_links(markdown, source, place, shown, str(config.extra["repository"]))
    except repository_files.MissingFile as error:
        raise PluginError(str(error)) from None
    if RECORDING.exists():
        text = text.replace(RECORDED, "![The three commands, recorded in a terminal](assets/terminal.svg)")
    text = FILE.sub(r'```\g<language> title="\g<name>"', text)
    return text.replace("<details>", "<details markdown>")


def _source(page: Page) -> str | None:
    """Return the path of a page's file in the repository; None if it was made from the code."""
    path = page.file.abs_src_path
    inside = path is not None and Path(path).is_relative_to(ROOT)
    return Path(path).relative_to(ROOT).as_posix() if path and inside else None


def _repository_path(file: File) -> str:
    """Return the path in the repository of a file of the site; pages made from the code lie in `docs/`."""
    path = file.abs_src_path
    if path is not None and Path(path).is_relative_to(ROOT):
        return Path(path).relative_to(ROOT).as_posix()
    return f"docs/{file.src_uri}"
