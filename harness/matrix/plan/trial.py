"""Plan the one cell that `try` asks for, without a matrix file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import PurePath

from msgspec import Struct, field
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.matrix import overlay_recipes
from harness.matrix.plan.adapter_choice import find_api, guess_api, speakers
from harness.matrix.plan.contents import IMPORTED
from harness.model import Case, Cell, IndexSettings, Phase, Plan, Question, Repair, Subject, cellid, replace
from harness.model.cellid import CellId, Detail
from harness.model.errors import BadInput
from harness.model.schema import locate_errors, suggestion
from harness.model.vocabulary import (
    APIS,
    FAMILY,
    GYM,
    GYMNASIUM,
    IMPORT_CHECK,
    SELF,
    Instant,
    ModuleName,
    PackageSelector,
    Requirement,
    Word,
    api_of,
    case_id,
    check_variable,
    checks_of,
    parsed_requirement,
    required_name,
)

NAME = "try"
SIMPLE = "CartPole-v1"
USUAL = checks_of(())
MUJOCO_EXTRAS = frozenset({"mujoco", "all"})
DRAWING_EXTRAS = frozenset({"classic-control", "toy-text", "box2d", "all"})
DRAWING_LIBRARIES = frozenset({"pygame", "pygame-ce"})
GYMNASIUM_1_UPLOADED = "2024-10-08"
"""Ant-v5 came with gymnasium 1.0, for Python 3.8 and later; the releases before it have Ant-v4."""


class TrialOptions(Struct, frozen=True, kw_only=True):
    """The options of a `try` command line, as given; `python` is a version or `host`.

    `brought` is the API to use for environments of which nothing else tells it. `interpreter` is the path of the
    Python, if one is given. `instant` is the cutoff where no `as_of` is given: the time of asking, which is no part of
    the cell's label. `listed` are requirements from a file: these need not be exercised one by one.
    """

    requirements: tuple[str, ...]
    python: str
    envs: tuple[str, ...] = ()
    api: str | None = None
    brought: str | None = None
    imports: tuple[str, ...] = ()
    environment: Mapping[str, str] = {}
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    only_binary: tuple[str, ...] = ()
    as_of: str | None = None
    instant: str | None = None
    interpreter: str | None = None
    index: IndexSettings = field(default_factory=IndexSettings)
    prerelease: str | None = None
    torch_backend: str = "cpu"
    overlay: tuple[Repair, ...] = ()
    subject: Subject | None = None
    files: Mapping[str, str] = {}
    listed: tuple[str, ...] = ()


def single(options: TrialOptions) -> Plan:
    """Plan the one cell that is asked for; its axes are Python and the packages that are pinned."""
    question = _question(options)
    for name in options.environment:
        with locate_errors("--set"):
            check_variable(name)
    axes = {"python": options.python, **_pins(question.requirements)}
    cell = Cell(
        id=NAME,
        matrix=NAME,
        axes=axes,
        python=options.interpreter or options.python,
        question=question,
        environment=options.environment,
        cases=cases_for(options),
        files=options.files,
        subject=options.subject,
        asked=tuple(dict.fromkeys(required_name(text) for text in options.requirements if text not in options.listed)),
    )
    cell = replace(cell, id=str(CellId.build(NAME, [_label(cell, dated=options.as_of is not None)])))
    return Plan(matrix=NAME, cells=(cell,), axes=tuple(axes))


def _question(options: TrialOptions) -> Question:
    if not options.requirements and options.subject is None:
        message = "try: name at least one requirement, such as 'gymnasium[mujoco]==1.2.3'"
        raise BadInput(message)
    question = Question(
        requirements=_canonicalize(Requirement, options.requirements, "try"),
        constraints=_canonicalize(Requirement, options.constraints, "--constraint"),
        overrides=_canonicalize(Requirement, options.overrides, "--override"),
        build_constraints=_canonicalize(Requirement, options.build_constraints, "--build-constraint"),
        only_binary=_canonicalize(PackageSelector, options.only_binary, "--only-binary"),
        torch_backend=options.torch_backend,
        index=options.index,
        snapshot=_canonicalize(Instant, [options.as_of], "--as-of")[0] if options.as_of else options.instant,
    )
    if options.prerelease:
        question = replace(question, prerelease=options.prerelease)
    return replace(question, overlay=overlay_recipes.select(options.overlay, question))


def _canonicalize(kind: type[Word], texts: Iterable[str], option: str) -> tuple[str, ...]:
    with locate_errors(option):
        return tuple(dict.fromkeys(kind.canonical(text) for text in texts))


def _pins(requirements: Iterable[str]) -> dict[str, str]:
    """Return the exact version of each package that is required by `==`."""
    pins = {}
    for text in requirements:
        specifiers = list(parsed_requirement(text).specifier)
        if len(specifiers) == 1 and specifiers[0].operator == "==" and not specifiers[0].version.endswith(".*"):
            pins[required_name(text)] = str(Version(specifiers[0].version))
    return pins


# --- the id ----------------------------------------------------------------------------------------------------


def _label(cell: Cell, *, dated: bool) -> str:
    """Return the label of an ad-hoc cell: equal for equal questions only."""
    lines = map(parsed_requirement, cell.question.requirements)
    return cellid.of_question(cell.axes["python"], lines, _details(cell, dated=dated))


def _details(cell: Cell, *, dated: bool) -> Iterator[Detail]:
    """Yield what a cell asks besides its requirements, where that is not the usual."""
    question, usual = cell.question, Question(requirements=())
    for word, lines in (
        ("constraint", question.constraints),
        ("override", question.overrides),
        ("build-constraint", question.build_constraints),
    ):
        yield from (cellid.requirement(word, parsed_requirement(line)) for line in lines)
    yield from (Detail("only-binary", name) for name in question.only_binary)
    yield from (Detail("absent", name) for name in question.absent)
    yield from (Detail("overlay", one.name, f"{one.version} {one.wheel}") for one in question.overlay)
    for word, variables in (("build-set", question.build_variables), ("set", cell.environment)):
        yield from (Detail(word, f"{name}-{text}", f"{name}={text}") for name, text in variables.items())
    for word in ("torch_backend", "prerelease", "resolution"):
        if getattr(question, word) != getattr(usual, word):
            yield Detail(cellid.spell(word), getattr(question, word))
    if dated and question.snapshot:
        yield Detail("as-of", question.snapshot.lower().removesuffix("t23:59:59z").replace(":", "."))
    # An address may hold a login, and a path is of this machine alone: both count in the digest, and are not shown.
    if question.index != usual.index:
        yield Detail("index", rest=repr(question.index))
    if "/" in cell.python:
        yield Detail("interpreter", rest=cell.python)
    if cell.subject:
        source = cell.subject
        yield Detail("subject", PurePath(source.source).name, source.source)
        yield from (Detail("extra", name) for name in source.extras)
        yield from (Detail("group", name) for name in source.groups)
    yield from (Detail("file", name, text) for name, text in cell.files.items())
    yield from _environments(cell, dated=dated)


def _environments(cell: Cell, *, dated: bool) -> Iterator[Detail]:
    """Yield the environments and modules that are tried, unless the requirements themselves suggest them."""
    question = cell.question
    suggested = cases_for(
        TrialOptions(
            requirements=tuple(sorted(question.requirements)),
            python=cell.axes["python"],
            constraints=question.constraints,
            as_of=question.snapshot if dated else None,
            subject=cell.subject,
        )
    )
    plain = [_plain(case) for case in cell.cases]
    if sorted(plain) != sorted(map(_plain, suggested)):
        yield from (Detail("env", case.env, _plain(case)) for case in cell.cases if case.env)
        yield from (Detail("import", ".".join(case.imports), _plain(case)) for case in cell.cases if not case.env)


def _plain(case: Case) -> str:
    """Return all that a case asks, whatever it is called and in whatever order its packages are asked for."""
    return repr(replace(case, id="", packages=tuple(sorted(case.packages))))


# --- cases -----------------------------------------------------------------------------------------------------


def cases_for(options: TrialOptions) -> tuple[Case, ...]:
    """Return the cases of a trial: the environments asked for, else those that the requirements suggest.

    gym and gymnasium bring CartPole, and Ant if MuJoCo is asked for; other adapters bring a small environment each. If
    no package has a known API, the modules that the packages install are imported.
    """
    imports = _canonicalize(ModuleName, options.imports, "--import")
    api = named_api(options)
    envs = dict.fromkeys(options.envs, USUAL) or _suggested(options, api)
    if not envs and imports:
        return (_import_case(imports=imports),)
    asked_for = dict.fromkeys(map(required_name, options.requirements))
    if not envs:
        return tuple(_import_case(packages=(name,)) for name in asked_for) + ((IMPORTED,) if options.subject else ())
    packages = tuple(name for name in asked_for if name not in FAMILY) + ((SELF,) if options.subject else ())
    cases: dict[str, Case] = {}
    for env, checks in envs.items():
        with locate_errors("--env"):
            name = _free(case_id(env, ()), cases)
            env_api = api_of(env, options.api) or api or find_api(env, options.requirements)
        env_api = env_api or options.brought or GYMNASIUM
        cases[name] = Case(id=name, env=env, api=env_api, imports=imports, packages=packages, checks=checks)
    return tuple(cases.values())


def _import_case(*, imports: tuple[str, ...] = (), packages: tuple[str, ...] = ()) -> Case:
    name = case_id(None, imports or packages)
    return Case(id=name, env=None, api="", imports=imports, packages=packages, checks=(IMPORT_CHECK,))


def named_api(options: TrialOptions) -> str | None:
    """Return the API asked for, else the first requirement that is itself an API (gym or gymnasium)."""
    if options.api is not None:
        if options.api not in APIS:
            message = f'--api: unknown API "{options.api}"{suggestion(options.api, APIS)}'
            raise BadInput(message)
        return options.api
    return next((name for name in map(required_name, options.requirements) if name in FAMILY), None)


def unspoken(options: TrialOptions) -> str | None:
    """Return the first environment asked for whose API nothing on the command line tells; None if there is none."""
    if named_api(options):
        return None
    return next(
        (env for env in options.envs if not api_of(env, None) and not guess_api(env, options.requirements)), None
    )


def _suggested(options: TrialOptions, api: str | None) -> dict[str, tuple[str, ...]]:
    """Return environments with their checks for each required adapter; MuJoCo's only if it is the sole adapter."""
    envs = _of_family(options, api) if api in FAMILY else {}
    names = {required_name(text) for text in options.requirements}
    rows = () if options.imports else speakers(options.requirements)
    for row in rows:
        alone = not envs and len(rows) == 1
        drawn = names & DRAWING_LIBRARIES or _extras(options, row.package)
        # mujoco beside another adapter is the engine beneath it.
        # PettingZoo's example needs pygame, which an extra brings.
        fitting = {"mujoco": alone, "pettingzoo": drawn}.get(row.api, True)
        if fitting and options.api in {None, row.api}:
            envs[row.example] = USUAL
    return envs


def _extras(options: TrialOptions, package: str) -> set[str]:
    wanted = [parsed_requirement(text) for text in options.requirements]
    return {required_name(extra) for each in wanted if required_name(each.name) == package for extra in each.extras}


def _of_family(options: TrialOptions, api: str) -> dict[str, tuple[str, ...]]:
    """Return the environments of gym or gymnasium; CartPole is drawn only if its drawing library is asked for."""
    names = set(map(required_name, options.requirements))
    extras = _extras(options, api)
    # Nobody who asks for gymnasium alone is to be told that pygame is missing.
    drawn = extras & DRAWING_EXTRAS or names & DRAWING_LIBRARIES
    envs = {SIMPLE: USUAL if drawn else tuple(check for check in USUAL if not check.startswith(Phase.RENDER))}
    # gym 0.21 means mujoco-py by this extra, a binding that looks for a MuJoCo unpacked in the home folder.
    if (extras & MUJOCO_EXTRAS or "mujoco" in names) and (api != GYM or _allows(options, api, ">=0.26")):
        envs["Ant-v5" if api == GYMNASIUM and _has_ant_v5(options) else "Ant-v4"] = USUAL
    return envs


def _has_ant_v5(options: TrialOptions) -> bool:
    version = re.fullmatch(r"3\.(\d+)(\..*)?", options.python)
    if version and int(version[1]) < 8:
        return False
    if options.as_of and _canonicalize(Instant, [options.as_of], "--as-of")[0] < GYMNASIUM_1_UPLOADED:
        return False
    return _allows(options, GYMNASIUM, ">=1.0")


def _allows(options: TrialOptions, package: str, versions: str) -> bool:
    """Return whether what is asked for leaves one of these versions of a package."""
    texts = [text for text in (*options.requirements, *options.constraints) if required_name(text) == package]
    specifiers = SpecifierSet(versions)
    for text in texts:
        specifiers &= parsed_requirement(text).specifier
    return not specifiers.is_unsatisfiable()


def _free(name: str, taken: Iterable[str]) -> str:
    """Return the name, or the first of name-2, name-3, ... that is not taken."""
    taken_names = {each.casefold() for each in taken}
    number, free = 1, name
    while free.casefold() in taken_names:
        number += 1
        free = f"{name}-{number}"
    return free
