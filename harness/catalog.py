"""From the name of a matrix to its plan: the file, its expansion, the instant that its locks are made as of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from harness import expansion, index, interpreters, matrixfile, plan
from harness.errors import BadInput, CouldNotTell
from harness.matrix import Expansion, Matrix
from harness.model import IndexSettings, Plan, Question
from harness.store import Store, now, write_atomic

PACKAGE = Path(__file__).parent


def built_in() -> dict[str, Path]:
    """The matrices that come with the harness: beside the package in a checkout, inside it in a wheel."""
    folders = (PACKAGE / "matrices", PACKAGE.parent / "matrices")
    folder = next((folder for folder in folders if folder.is_dir()), folders[0])
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load(name: str, say: Callable[[str], None], *, offline: bool = False, renew: bool = False) -> Plan:
    """Plan a matrix; a range that was never expanded (or is to be renewed) is expanded from the index and kept."""
    path = _locate(name)
    matrix = matrixfile.read(_text(path), str(path))
    expanded = _expansion(matrix, path, say, offline=offline, renew=renew) if matrix.ranges else None
    sources = {source: _text(path.parent / source, place) for source, place in matrixfile.sources(matrix).items()}
    planned = plan.expand(matrix, expanded, host_python=_host(), sources=sources)
    index = _located(plan.index_settings(matrix), path.parent)
    if matrix.snapshot and str(matrix.snapshot) > now():
        say(f"{path}: snapshot: {matrix.snapshot} is still to come; these locks miss what is uploaded until then")
    return _with_questions(planned, lambda question: replace(question, index=index))


def dated(planned: Plan, store: Store, *, renew: bool = False) -> Plan:
    """The plan with an instant in every question: the matrix's own, else that of its first lock, which is kept."""
    if all(cell.question.snapshot for cell in planned.cells):
        return planned
    instant = store.instant(planned.matrix, renew=renew)
    return _with_questions(planned, lambda question: replace(question, snapshot=question.snapshot or instant))


def _locate(name: str) -> Path:
    path = Path(name)
    if path.suffix == ".toml":
        return path
    known = built_in()
    if name in known:
        return known[name]
    near = get_close_matches(name, known, n=1)
    hint = f'did you mean "{near[0]}"?' if near else f"the built-in ones are: {', '.join(known) or 'none'}"
    message = f"{name}: not a matrix file (NAME.toml) and not a built-in matrix; {hint}"
    raise BadInput(message)


def _text(path: Path, place: str | None = None) -> str:
    """The text of a file, which `place` in a matrix asks for."""
    where = f"{place}: {path}" if place else f"{path}"
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        message = f"{where}: cannot be read: {error.strerror}"
        raise BadInput(message) from None
    except UnicodeDecodeError:
        message = f"{where}: is not UTF-8 text"
        raise BadInput(message) from None


def _expansion(matrix: Matrix, path: Path, say: Callable[[str], None], *, offline: bool, renew: bool) -> Expansion:
    file = path.with_suffix(".expanded.json")
    if file.exists() and not renew:
        return expansion.read(_text(file), str(file))
    if offline:
        known = "are to be expanded again" if renew else "were never expanded"
        message = f"{path}: its ranges {known}, which asks the index; run `simmatrix lock {path}` without --offline"
        raise CouldNotTell(message)
    instant = str(matrix.snapshot or now())
    settings = _located(plan.index_settings(matrix), path.parent)
    releases = {
        name: [(release.version, release.yanked) for release in index.releases(name, settings, cutoff=instant)]
        for name in matrix.ranges
    }
    made = expansion.expand(matrix, releases, instant)
    write_atomic(file, expansion.text_of(made).encode())
    say(f"expanded {', '.join(matrix.ranges)} as of {instant} into {file}; commit it beside the matrix")
    return made


def _host() -> str:
    found = interpreters.find("host")
    if found is None:
        message = "the Python that runs this cannot be found on disk"
        raise CouldNotTell(message)
    return found.version


def _located(settings: IndexSettings, folder: Path) -> IndexSettings:
    """Settings whose folders of files are found from anywhere: the file names them as seen from its own folder."""
    links = tuple(link if "://" in link else str((folder / link).absolute()) for link in settings.find_links)
    return replace(settings, find_links=links)


def _with_questions(planned: Plan, change: Callable[[Question], Question]) -> Plan:
    """The plan with each question changed; equal questions stay one object."""
    distinct = {id(cell.question): cell.question for cell in planned.cells}
    made = {key: change(question) for key, question in distinct.items()}
    return replace(planned, cells=tuple(replace(cell, question=made[id(cell.question)]) for cell in planned.cells))
