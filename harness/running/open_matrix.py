"""Turn the name of a matrix into its plan: the file, its expansion, the instant that its locks are made as of."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from harness.machine.files import given_files, guarded_files
from harness.machine.store import Store, now, write_atomic
from harness.matrix import matrix_file, matrix_remedies, overlay_recipes, plan, policies, version_ranges
from harness.matrix.matrix_types import Expansion, Matrix
from harness.model import Cell, IndexSettings, Plan, Question, Repair, Subject, replace
from harness.model.errors import BadInput, CouldNotTell
from harness.model.hostile_data import Unreadable

if TYPE_CHECKING:
    from harness.running.offline.offline_bundle import Fetched

PACKAGE = Path(__file__).parent.parent
OVERLAYS = "overlays"
REUSED_FOR_HOURS = 24.0
"""Hours for which the instant of ad-hoc locks is kept."""


def built_in() -> dict[str, Path]:
    """Return the matrices that come with the harness, by name."""
    return {path.stem: path for path in sorted(data_folder().glob("*.toml"))}


def recipes(folder: Path) -> dict[str, tuple[Repair, ...]]:
    """Return the repairs of packages by name; recipes in `overlays/` beside a matrix go before those of the harness."""
    files = [path for place in (data_folder(), folder) for path in sorted((place / OVERLAYS).glob("*.toml"))]
    repairs = [overlay_recipes.read(_text(path), str(path)) for path in files]
    return {made[0].name: made for made in repairs}


def data_folder() -> Path:
    """Return the folder of the matrices: beside the package in a checkout, inside it in a wheel."""
    folders = (PACKAGE / "matrices", PACKAGE.parent / "matrices")
    return next((folder for folder in folders if folder.is_dir()), folders[0])


def load(
    name: str,
    say: Callable[[str], None],
    *,
    offline: bool = False,
    renew: bool = False,
    fetched: Fetched | None = None,
    ask: plan.Ask | None = None,
) -> Plan:
    """Plan a matrix: gather all that its plan is made of, and make the plan."""
    return plan.make_plan(gather(name, say, offline=offline, renew=renew, fetched=fetched, ask=ask))


def gather(
    name: str,
    say: Callable[[str], None],
    *,
    offline: bool = False,
    renew: bool = False,
    fetched: Fetched | None = None,
    ask: plan.Ask | None = None,
) -> plan.Sources:
    """Read and ask for all that the plan of a matrix is made of; everything after this is pure.

    A range that was never expanded (or is to be renewed) is expanded from the index and written beside the matrix.
    With `ask`, which resolves, so is a covering strategy that was never worked out.
    """
    path = fetched.matrix(name)[1] if fetched else locate(name)
    matrix = matrix_file.read(_text(path), str(path))
    if matrix_remedies.named_failures(matrix):
        from harness.running.signatures import shipped_signatures  # noqa: PLC0415 - start-up: few matrices name one

        matrix = matrix_remedies.fill(matrix, shipped_signatures.load_all())
    # Both are UTC in one form, in which texts sort as instants do (`Instant.canonical`).
    if matrix.snapshot and matrix.snapshot > now():
        say(f"{path}: snapshot: {matrix.snapshot} is still to come; these locks miss what is uploaded until then")
    expansion = _expansion(matrix, path, say, offline=offline, renew=renew)
    sources = plan.Sources(
        matrix=matrix,
        host_python=platform.python_version().removesuffix("+"),  # a build from a checkout calls itself 3.14.0+
        expansion=expansion,
        texts={source: _text(path.parent / source, place) for source, place in matrix_file.sources(matrix).items()},
        breaks=_breaks() if matrix.strategy.boundaries else version_ranges.NO_BREAKS,
        recipes=recipes(path.parent) if matrix_file.repairing(matrix) else {},
        index=_located(matrix.index, path.parent),
        project=_project(matrix.subject, path.parent) if matrix.subject else None,
        banks={bank: _bank(path.parent / bank, place) for bank, place in matrix_file.banks(matrix).items()},
        policies={name: _policy(path.parent / name, place) for name, place in matrix_file.policies(matrix).items()},
    )
    if ask and expansion and matrix.strategy.covering and (renew or not expansion.chosen):
        return replace(sources, expansion=_chosen(sources, expansion, ask, say))
    return sources


def set_instant(
    planned: Plan, store: Store, *, renew: bool = False, fetched: Fetched | None = None, offline: bool = False
) -> Plan:
    """Return the plan with an instant in every question: the matrix's own, else that of its first lock, which is kept.

    Subjects are looked at: a cell tests the package as it stands now. Banks of states are kept in the store.
    """
    for name, path in planned.banks.items():
        keep_bank(store, Path(path), name)
    planned = _with_subjects(planned, partial(_settled, offline=offline))
    if all(cell.question.snapshot for cell in planned.cells):
        return planned
    fetched_instant = fetched.instant(planned.matrix) if fetched else None
    # A fetched folder answers only questions as of its own instant (`offline_bundle.question_mark`).
    instant = fetched_instant or store.instant(planned.matrix, renew=renew)
    return as_of(planned, instant)


def keep_bank(store: Store, path: Path, name: str | None = None) -> str:
    """Keep a bank of states where probes find it, and return its SHA-256. Raises BadInput if it is not `name`."""
    from harness.probes.vault import MOST_FILE, Vault  # noqa: PLC0415 - start-up: few matrices have banks

    content_name = Vault(store.folder).keep(guarded_files.read(path, MOST_FILE, follow=True))
    if name not in {None, content_name}:
        message = f"{path}: it was changed while the matrix was read"
        raise BadInput(message)
    return content_name


def as_of(planned: Plan, instant: str) -> Plan:
    """Return the plan with this instant in every question that has none."""
    return _with_questions(planned, lambda question: replace(question, snapshot=question.snapshot or instant))


def files(name: str) -> dict[str, Path]:
    """Return all files that a plan is made of, the matrix first, by their paths relative to its folder."""
    path = locate(name)
    matrix = matrix_file.read(_text(path), str(path))
    expanded = _expanded(path)
    beside = [Path(expanded.name)] if matrix.expands and expanded.exists() else []
    beside += [file.relative_to(path.parent) for file in sorted((path.parent / OVERLAYS).glob("*.toml"))
               if matrix_file.repairing(matrix)]  # fmt: skip
    named = (*matrix_file.sources(matrix), *matrix_file.banks(matrix), *matrix_file.policies(matrix))
    names = [Path(path.name), *beside, *map(Path, named)]
    return {one.as_posix(): path.parent / one for one in names}


def _bank(path: Path, place: str) -> tuple[str, str]:
    """Return the SHA-256 and the file of a bank of states. Raises BadInput."""
    from harness.probes.vault import MOST_FILE  # noqa: PLC0415 - start-up

    try:
        content = guarded_files.read(path, MOST_FILE, follow=True)
    except Unreadable as error:
        message = f"{place}: {path}: {error}"
        raise BadInput(message) from None
    return hashlib.sha256(content).hexdigest(), str(path.resolve())


def _policy(path: Path, place: str) -> dict[str, Any]:
    """Return the policy in a file, as a case holds it. Raises BadInput."""
    try:
        return policies.read(guarded_files.read(path, policies.MOST_BYTES, follow=True))
    except Unreadable as error:
        message = f"{place}: {path}: {error}; make one with `python -m benchmarks.linear_policy ENV --out FILE`"
        raise BadInput(message) from None


def locate(name: str) -> Path:
    """Return the file of a matrix, given as a path or as the name of a built-in matrix. Raises BadInput."""
    path = Path(name)
    if path.suffix == ".toml":
        return path
    matrices = built_in()
    if name in matrices:
        return matrices[name]
    near = get_close_matches(name, matrices, n=1)
    hint = f'did you mean "{near[0]}"?' if near else f"the built-in ones are: {', '.join(matrices) or 'none'}"
    message = f"{name}: neither a matrix file (NAME.toml) nor a built-in matrix; {hint}"
    raise BadInput(message)


def _text(path: Path, place: str | None = None) -> str:
    """Return the text of a file, which `place` in a matrix asks for."""
    return given_files.read_text(path, f"{place}: {path}" if place else "")


def _expansion(
    matrix: Matrix, path: Path, say: Callable[[str], None], *, offline: bool, renew: bool
) -> Expansion | None:
    """Return the committed expansion, or make it now; None if the matrix needs none.

    A new expansion is written if it has ranges; a choice is written once it is made. Raises CouldNotTell where the
    index is needed and `offline` forbids it.
    """
    file = _expanded(path)
    if not matrix.expands:
        return None
    if file.exists() and not renew:
        return version_ranges.read(_text(file), str(file))
    instant = str(matrix.snapshot or now())
    if not matrix.ranges:
        return version_ranges.expand(matrix, {}, instant)
    if offline:
        status = "are to be expanded again" if renew else "were never expanded"
        message = f"{path}: its ranges {status}, which asks the index; run `simmatrix lock {path}` without --offline"
        raise CouldNotTell(message)
    from harness.packages import index  # noqa: PLC0415 - start-up

    settings = _located(matrix.index, path.parent)
    releases = {
        name: [(release.version, release.yanked) for release in index.releases(name, settings, cutoff=instant)]
        for name in matrix.ranges
    }
    expansion = version_ranges.expand(matrix, releases, instant, _breaks())
    write_atomic(file, version_ranges.text_of(expansion).encode())
    say(f"expanded {', '.join(matrix.ranges)} as of {instant} into {file}; commit it next to the matrix")
    return expansion


def _expanded(path: Path) -> Path:
    return path.with_suffix(".expanded.json")


def _chosen(sources: plan.Sources, expansion: Expansion, ask: plan.Ask, say: Callable[[str], None]) -> Expansion:
    """Write and return the expansion with the combinations that a covering strategy chose of those that resolve."""

    def ask_settled(cells: Sequence[Cell]) -> list[str | None]:
        # Resolving builds the subject, and a build is kept by the state of its source.
        return ask(_with_subjects(Plan(matrix=sources.matrix.name, cells=tuple(cells)), _settled).cells)

    file = _expanded(Path(sources.matrix.path))
    chosen = msgspec.structs.replace(expansion, chosen=plan.choose(plan.candidates(sources), ask_settled, say))
    write_atomic(file, version_ranges.text_of(chosen).encode())
    say(f"chose combinations as of {chosen.instant} into {file}; commit it next to the matrix")
    return chosen


def _breaks() -> version_ranges.Breaks:
    path = PACKAGE / "running" / "breaks.toml"
    return version_ranges.read_breaks(_text(path), path.name)


def _located(settings: IndexSettings, folder: Path) -> IndexSettings:
    """Return settings whose folders of files are found from anywhere: the file names them from its own folder."""
    links = tuple(link if "://" in link else str((folder / link).absolute()) for link in settings.find_links)
    return msgspec.structs.replace(settings, find_links=links)


def _project(source: str, folder: Path) -> plan.Project:
    """Return the package under test as it is found from anywhere, with what its pyproject declares."""
    from harness.packages import package_under_test  # noqa: PLC0415 - start-up

    place = package_under_test.locate_source(source, folder)
    about = package_under_test.about(Subject(source=place))
    return plan.Project(
        source=place, extras=about.extras if about else None, groups=tuple(about.groups) if about else None
    )


def _settled(subject: Subject, *, offline: bool = False) -> Subject:
    from harness.packages import package_under_test  # noqa: PLC0415 - start-up

    return package_under_test.record_state(subject, offline=offline)


def _with_subjects(planned: Plan, change: Callable[[Subject], Subject]) -> Plan:
    """Return the plan with each subject changed; equal subjects are changed once, and stay one object."""
    replacements: dict[Subject, Subject] = {}
    cells = []
    for cell in planned.cells:
        if cell.subject and cell.subject not in replacements:
            replacements[cell.subject] = change(cell.subject)
        cells.append(replace(cell, subject=replacements[cell.subject]) if cell.subject else cell)
    return replace(planned, cells=tuple(cells)) if replacements else planned


def _with_questions(planned: Plan, change: Callable[[Question], Question]) -> Plan:
    """Return the plan with each question changed; equal questions stay one object."""
    # By identity: questions hold mappings and cannot be hashed.
    distinct = {id(cell.question): cell.question for cell in planned.cells}
    replacements = {key: change(question) for key, question in distinct.items()}
    return replace(
        planned, cells=tuple(replace(cell, question=replacements[id(cell.question)]) for cell in planned.cells)
    )
