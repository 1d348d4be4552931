"""Name the sources that runs of common packages need, so that they are compiled before the first run of a machine.

Each section of the list is of one package, and was collected from runs of it in a cache of their own:
`HARNESS_CACHE=FOLDER python -m harness.packages.environments.bytecode PACKAGE` writes it anew. PACKAGE is a folder that
only environments with the package have. What an environment does not have is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from harness.model.vocabulary import INCELL

FILE = Path(__file__).with_name("first_sources.txt")
OWN, STANDARD, PACKAGES = "incell/", "standard/", "packages/"
"""The beginnings of names in the list: our in-cell files, the standard library, site-packages."""


def load(python: Path, is_there: Callable[[str], object]) -> set[str]:
    """Return the names of the sources in an environment of an interpreter, where `is_there` tells which it has."""
    places, needed = _places(python), set[str]()
    for package, lines in read().items():
        if is_there(f"{places[PACKAGES]}{package}/__init__.py"):
            needed |= {places[f"{top}/"] + rest for top, _, rest in (line.partition("/") for line in lines)}
    return {name for name in needed if is_there(name)}


def read() -> dict[str, list[str]]:
    """Return the sources by the package whose runs needed them."""
    sections: dict[str, list[str]] = {}
    for line in FILE.read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            section = sections.setdefault(line.strip("[]"), [])
        else:
            section.append(line)
    return sections


def write(package: str, needed: Iterable[tuple[Path, Iterable[str]]]) -> None:
    """Write the section of a package: the sources that its runs needed, by interpreters."""
    lines = {line for python, names in needed for line in _lines(python, names)}
    sections = {**read(), package: sorted(lines)}
    text = "".join(f"[{name}]\n" + "".join(f"{line}\n" for line in sections[name]) for name in sorted(sections))
    FILE.write_text(text, encoding="utf-8")


def libraries(python: Path) -> tuple[str, str]:
    """Return how the names of sources begin: those of the standard library, and those of an environment."""
    library = f"lib/{python.name.removesuffix('d')}/"
    return f"{python.parents[1]}/{library}", library


def _lines(python: Path, names: Iterable[str]) -> Iterator[str]:
    for name in names:
        for top, place in _places(python).items():
            if name.startswith(place):
                yield top + name.removeprefix(place)


def _places(python: Path) -> Mapping[str, str]:
    standard, library = libraries(python)
    return {OWN: f"{INCELL}/", STANDARD: standard, PACKAGES: f"{library}site-packages/"}
