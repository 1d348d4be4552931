"""The one cell that `try` asks for, without a matrix file."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import PurePath

from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness import repairs
from harness.errors import BadInput
from harness.model import Case, Cell, Phase, Plan, Question, Repair, Subject
from harness.plan.contents import IMPORTED
from harness.plan.speaking import meant, speakers
from harness.schema import located, suggestion
from harness.vocabulary import (
    APIS,
    FAMILY,
    GYM,
    GYMNASIUM,
    IMPORT_CHECK,
    LONGEST_LABEL,
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


@dataclass(frozen=True, kw_only=True, slots=True)
class Asked:
    """What a command line asks for, as given; `python` is a version or `host`.

    `brought` is the API that comes with what is asked for: that of environments of which nothing else tells it.
    """

    requirements: tuple[str, ...]
    python: str
    envs: tuple[str, ...] = ()
    api: str | None = None
    brought: str | None = None
    imports: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    only_binary: tuple[str, ...] = ()
    as_of: str | None = None
    torch_backend: str = "cpu"
    overlay: tuple[Repair, ...] = ()
    subject: Subject | None = None
    files: Mapping[str, str] = field(default_factory=dict)


def single(asked: Asked) -> Plan:
    """Plan the one cell that is asked for; its axes are Python and the packages that are pinned."""
    question = _question(asked)
    for name in asked.environment:
        with located("--set"):
            check_variable(name)
    axes = {"python": asked.python, **_pins(question.requirements)}
    cell = Cell(
        id=f"{NAME}/{_label(asked.python, question.requirements, asked.subject)}",
        matrix=NAME,
        axes=axes,
        python=asked.python,
        question=question,
        environment=asked.environment,
        cases=cases_for(asked),
        files=asked.files,
        subject=asked.subject,
    )
    return Plan(matrix=NAME, cells=(cell,), axes=tuple(axes))


def _question(asked: Asked) -> Question:
    if not asked.requirements and asked.subject is None:
        message = "try: name at least one requirement, such as 'gymnasium[mujoco]==1.2.3'"
        raise BadInput(message)
    question = Question(
        requirements=_words(Requirement, asked.requirements, "try"),
        constraints=_words(Requirement, asked.constraints, "--constraint"),
        overrides=_words(Requirement, asked.overrides, "--override"),
        build_constraints=_words(Requirement, asked.build_constraints, "--build-constraint"),
        only_binary=_words(PackageSelector, asked.only_binary, "--only-binary"),
        torch_backend=asked.torch_backend,
        snapshot=_words(Instant, [asked.as_of], "--as-of")[0] if asked.as_of else None,
    )
    return replace(question, overlay=repairs.fitting(asked.overlay, question))


def _words(kind: type[Word], texts: Iterable[str], option: str) -> tuple[str, ...]:
    with located(option):
        return tuple(dict.fromkeys(kind.canonical(text) for text in texts))


def _pins(requirements: Iterable[str]) -> dict[str, str]:
    """The exact version of each package that is asked for by one."""
    found = {}
    for text in requirements:
        specifiers = list(parsed_requirement(text).specifier)
        if len(specifiers) == 1 and specifiers[0].operator == "==" and not specifiers[0].version.endswith(".*"):
            found[required_name(text)] = str(Version(specifiers[0].version))
    return found


def _label(python: str, requirements: Iterable[str], subject: Subject | None) -> str:
    pins = _pins(requirements)
    names = dict.fromkeys(required_name(text) for text in requirements)
    own = [PurePath(subject.source).name, *subject.extras, *subject.groups] if subject else []
    parts = [f"py{python}", *own, *(name + pins.get(name, "") for name in names)]
    label = re.sub(r"[^A-Za-z0-9._+-]+", "-", "-".join(parts))
    if len(label) <= LONGEST_LABEL:
        return label
    digest = hashlib.sha256(label.encode()).hexdigest()[:8]
    return f"{label[: LONGEST_LABEL - len(digest) - 1]}-{digest}"


# --- cases -----------------------------------------------------------------------------------------------------


def cases_for(asked: Asked) -> tuple[Case, ...]:
    """The cases of a trial: the environments asked for, else those that the requirements suggest.

    gym and gymnasium bring CartPole, with MuJoCo Ant too, other adapters a small environment each; of a package without
    an API that is known here, the modules that it installs are imported.
    """
    imports = _words(ModuleName, asked.imports, "--import")
    api = named_api(asked)
    envs = dict.fromkeys(asked.envs, USUAL) or _suggested(asked, api)
    if not envs and imports:
        return (_import_case(imports=imports),)
    asked_for = dict.fromkeys(map(required_name, asked.requirements))
    if not envs:
        return tuple(_import_case(packages=(name,)) for name in asked_for) + ((IMPORTED,) if asked.subject else ())
    packages = tuple(name for name in asked_for if name not in FAMILY) + ((SELF,) if asked.subject else ())
    cases: dict[str, Case] = {}
    for env, checks in envs.items():
        with located("--env"):
            name = _free(case_id(env, ()), cases)
            spoken = api_of(env, asked.api) or api or meant(env, asked.requirements)
            spoken = spoken or asked.brought or GYMNASIUM
        cases[name] = Case(id=name, env=env, api=spoken, imports=imports, packages=packages, checks=checks)
    return tuple(cases.values())


def _import_case(*, imports: tuple[str, ...] = (), packages: tuple[str, ...] = ()) -> Case:
    name = case_id(None, imports or packages)
    return Case(id=name, env=None, api="", imports=imports, packages=packages, checks=(IMPORT_CHECK,))


def named_api(asked: Asked) -> str | None:
    """The API asked for, else that of the first requirement that is one."""
    if asked.api is not None:
        if asked.api not in APIS:
            message = f'--api: unknown API "{asked.api}"{suggestion(asked.api, APIS)}'
            raise BadInput(message)
        return asked.api
    return next((name for name in map(required_name, asked.requirements) if name in FAMILY), None)


def unspoken(asked: Asked) -> str | None:
    """The first environment asked for whose API nothing on the command line tells."""
    if named_api(asked):
        return None
    return next((env for env in asked.envs if not api_of(env, None) and not meant(env, asked.requirements)), None)


def _suggested(asked: Asked, api: str | None) -> dict[str, tuple[str, ...]]:
    """Environments with their checks, of every adapter whose package is asked for; MuJoCo is in what is built on it."""
    envs = _of_family(asked, api) if api in FAMILY else {}
    names = {required_name(text) for text in asked.requirements}
    found = () if asked.imports else speakers(asked.requirements)
    for row in found:
        alone = not envs and len(found) == 1
        drawn = names & DRAWING_LIBRARIES or _extras(asked, row.package)
        fitting = {"mujoco": alone, "pettingzoo": drawn}.get(row.api, True)
        if fitting and asked.api in {None, row.api}:
            envs[row.example] = USUAL
    return envs


def _extras(asked: Asked, package: str) -> set[str]:
    wanted = [parsed_requirement(text) for text in asked.requirements]
    return {required_name(extra) for each in wanted if required_name(each.name) == package for extra in each.extras}


def _of_family(asked: Asked, api: str) -> dict[str, tuple[str, ...]]:
    """CartPole is drawn only where its drawing library is asked for, too."""
    names = set(map(required_name, asked.requirements))
    extras = _extras(asked, api)
    drawn = extras & DRAWING_EXTRAS or names & DRAWING_LIBRARIES
    envs = {SIMPLE: USUAL if drawn else tuple(check for check in USUAL if not check.startswith(Phase.RENDER))}
    if (extras & MUJOCO_EXTRAS or "mujoco" in names) and (api != GYM or _allows(asked, api, ">=0.26")):
        envs["Ant-v5" if api == GYMNASIUM and _has_ant_v5(asked) else "Ant-v4"] = USUAL
    return envs


def _has_ant_v5(asked: Asked) -> bool:
    version = re.fullmatch(r"3\.(\d+)(\..*)?", asked.python)
    if version and int(version[1]) < 8:
        return False
    if asked.as_of and _words(Instant, [asked.as_of], "--as-of")[0] < GYMNASIUM_1_UPLOADED:
        return False
    return _allows(asked, GYMNASIUM, ">=1.0")


def _allows(asked: Asked, package: str, versions: str) -> bool:
    """Whether what is asked for leaves one of these versions of a package."""
    texts = [text for text in (*asked.requirements, *asked.constraints) if required_name(text) == package]
    specifiers = SpecifierSet(versions)
    for text in texts:
        specifiers &= parsed_requirement(text).specifier
    return not specifiers.is_unsatisfiable()


def _free(name: str, taken: Iterable[str]) -> str:
    """The name, or the first of name-2, name-3, ... that is not taken."""
    known = {each.casefold() for each in taken}
    number, free = 1, name
    while free.casefold() in known:
        number += 1
        free = f"{name}-{number}"
    return free
