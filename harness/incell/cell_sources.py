"""Walks the modules below a package without importing them: their names, files and texts."""

import os
import sys

MOST_FILES, LARGEST = 3000, 1 << 20
ASIDE = frozenset(
    ("test", "tests", "testing", "example", "examples", "script", "scripts", "docs", "benchmarks", "__main__")
)
"""Folders and modules whose import a user would not expect."""


def sources(package):
    """Yield the name and the file of each module of an imported package, itself included; a bounded number of them."""
    seen = 0
    for folder in list(getattr(sys.modules.get(package), "__path__", ())):
        for place, folders, names in os.walk(folder):
            folders[:] = sorted(name for name in folders if _suits(name) and name != "__pycache__")
            parts = [package] + [part for part in os.path.relpath(place, folder).split(os.sep) if part != "."]
            for name in sorted(names):
                stem, _, kind = name.rpartition(".")
                if kind == "py" and _suits(stem):
                    seen += 1
                    if seen > MOST_FILES:
                        return
                    yield ".".join(parts if stem == "__init__" else [*parts, stem]), os.path.join(place, name)


def text_of(path):
    """Return the beginning of a file as text; the empty text where it cannot be read."""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.read(LARGEST)
    except OSError:
        return ""


def _suits(name):
    return name.isidentifier() and name.lower() not in ASIDE
