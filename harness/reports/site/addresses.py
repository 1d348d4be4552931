"""Give every page of the site a stable address, which any file system and any web host accepts."""

from __future__ import annotations

import re
from hashlib import sha256

from harness.model.cellid import CellId

PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,119}")
ODD = re.compile(r"[^A-Za-z0-9.-]+")


def name_for(text: str) -> str:
    """Return a text as the name of a file: the text itself if it is plain, else a readable part and a hash."""
    if PLAIN.fullmatch(text):
        return text
    readable = ODD.sub("-", text).strip("-.")[:80]
    return f"{readable or 'x'}-{sha256(text.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}"


def cell_page(cell_id: str, matrix: str) -> str:
    """Return the address of a cell's page."""
    return f"cells/{name_for(matrix)}/{name_for(CellId.parse(cell_id).label)}.html"


def matrix_page(matrix: str) -> str:
    """Return the address of the page of a matrix."""
    return f"matrices/{name_for(matrix)}/index.html"


def package_page(package: str) -> str:
    """Return the address of a package's page."""
    return f"packages/{name_for(package)}/index.html"


def environment_page(environment: str) -> str:
    """Return the address of the page of an environment id."""
    return f"environments/{name_for(environment)}/index.html"


def issue_page(issue: str) -> str:
    """Return the address of the page of a known issue."""
    return f"issues/{name_for(issue)}/index.html"


def report_file(report: str, path: str) -> str:
    """Return the address of a file of a report."""
    return "/".join(["files", name_for(report), *(name_for(part) for part in path.split("/"))])
