"""Make the contents of cells: questions, cases and surroundings, made once for all cells that share them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import PurePosixPath
from typing import Any, NamedTuple, TypeVar

from msgspec.structs import asdict

from harness.matrix import overlay_recipes, policies
from harness.matrix.matrix_types import (
    CONDITIONAL,
    NO_CHANGES,
    BringTable,
    CaseTable,
    Changes,
    ChangeTable,
    Constraint,
    SourceTable,
)
from harness.matrix.plan.adapter_choice import find_api
from harness.matrix.plan.choices import Choice, Combination, Condition, condition
from harness.matrix.plan.sources import Sources
from harness.model import Bring, Case, Change, Phase, Question, Subject, Suite, decoding, replace
from harness.model.errors import BadInput
from harness.model.schema import key_path, locate_errors, suggestion
from harness.model.vocabulary import (
    ABSENT,
    APIS,
    IMPORT_CHECK,
    OF_SUBJECT,
    PLAY,
    SELF,
    STEP,
    Kind,
    api_of,
    case_id,
    checks_of,
    required_name,
)

T = TypeVar("T")

LISTS = ("needs", "system", "empty", "python_path")
"""Keys of a matrix that are lists, and fields of a cell."""

Rules = tuple[tuple[str, Condition], ...]
CasesWhen = tuple[tuple[Case, "Condition | _InBaseline"], ...]

IMPORTED = Case(id="import-subject", env=None, api="", checks=(IMPORT_CHECK,), packages=(SELF,))
"""What is tried of a subject where the matrix has no case: its modules are imported."""


class _InBaseline(NamedTuple):
    """The condition of a case that exists in the cells of the baseline strategy only."""

    when: Condition
    combinations: frozenset[Combination]

    def holds(self, combination: Combination) -> bool:
        """Return whether it is one of them, and every axis agrees."""
        return combination in self.combinations and self.when.holds(combination)


class _Part(NamedTuple):
    """The additions of the matrix, or of one value of an axis, to cells: strings are plain, conditions compiled."""

    changes: Changes
    rules: Mapping[str, Rules]
    cases: CasesWhen


class Contents:
    """Makes questions, cases and surroundings of combinations; equal ones are made once and shared."""

    def __init__(
        self,
        sources: Sources,
        snapshot: str | None,
        baseline: frozenset[Combination] = frozenset(),
    ) -> None:
        self.matrix = matrix = sources.matrix
        self.recipes = sources.recipes
        self.baseline = baseline
        self.texts = sources.texts
        self.banks = sources.banks
        self.policies = sources.policies
        self.snapshot = snapshot
        self.index = sources.index or matrix.index
        self.source = sources.project.source if sources.project else matrix.subject
        self.base = self._part(matrix, matrix.cases)
        if (
            matrix.subject
            and not matrix.cases
            and not any(v.cases for axis in matrix.axes.values() for v in axis.values)
        ):
            self.base = self.base._replace(cases=((IMPORTED, condition(matrix, {})),))
        self.parts: dict[Choice, _Part] = {}
        self.questions: dict[Combination, Question] = {}
        self.surrounded: dict[Combination, dict[str, Any]] = {}
        self.known_cases: dict[tuple[int, ...], tuple[Case, ...]] = {}
        self.spoken: dict[tuple[int, str], Case] = {}
        self.suite = decoding.convert(matrix.suite, Suite, attributes=True) if matrix.suite else None
        self.suite_when = condition(matrix, matrix.suite.when if matrix.suite else {})
        self.subjects: dict[tuple[tuple[str, ...], tuple[str, ...], bool], Subject] = {}

    def question(self, combination: Combination) -> Question:
        """Return the question to resolve; environment variables do not affect it."""
        # Extras and groups are of the subject, which no lock holds.
        key = tuple(choice for choice in combination if choice.kind not in {Kind.VARIABLE, *OF_SUBJECT})
        if key not in self.questions:
            self.questions[key] = self._question(combination)
        return self.questions[key]

    def subject(self, combination: Combination) -> Subject | None:
        """Return the package under test with the extras and groups of a combination."""
        if self.source is None:
            return None
        chosen = {
            kind: [c.literal.split("+") for c in combination if c.kind is kind and c.literal] for kind in OF_SUBJECT
        }
        changes = [part.changes for part in self._parts(combination)]
        key = (
            _distinct(chain(*(change.extras for change in changes), *chosen[Kind.EXTRA])),
            _distinct(chain(*(change.groups for change in changes), *chosen[Kind.GROUP])),
            self.suite is not None and self.suite_when.holds(combination),
        )
        if key not in self.subjects:
            extras, groups, tested = key
            suite = self.suite if tested else None
            self.subjects[key] = Subject(source=self.source, extras=extras, groups=groups, suite=suite)
        return self.subjects[key]

    def surroundings(self, combination: Combination) -> dict[str, Any]:
        """Return a cell's variables, capabilities and files, by their fields.

        Those of the matrix come first, then those of values, then the variable axes.
        """
        key = tuple(c for c in combination if c.kind is Kind.VARIABLE or c.changes is not NO_CHANGES)
        if key not in self.surrounded:
            self.surrounded[key] = self._surroundings(combination)
        return self.surrounded[key]

    def change(self, choice: Choice, table: ChangeTable, combination: Combination) -> Change:
        """Return what a `[[change]]` does to the cell of a combination; `choice` stands for the change."""
        plain = {name: getattr(table, name) for name in Change.__struct_fields__}
        return Change(**plain | _holding(self._parts((choice,))[-1:], combination))

    def cases(self, combination: Combination) -> tuple[Case, ...]:
        """Return the cases that exist in a combination; there may be none."""
        parts = self._parts(combination)
        existing = tuple(case for part in parts for case, when in part.cases if when.holds(combination))
        existing = tuple(self._speaking(case, combination) if case.env and not case.api else case for case in existing)
        # Cases hold dictionaries and have no hash; `parts` and `spoken` keep them alive, so no identity is used twice.
        key = tuple(map(id, existing))
        if key not in self.known_cases:
            self._check_distinct(existing)
            self.known_cases[key] = existing
        return self.known_cases[key]

    def _speaking(self, case: Case, combination: Combination) -> Case:
        """Return the case with the API that the requirements of a combination imply, as for `try`."""
        api = find_api(case.env or "", self.question(combination).requirements)
        if api is None:
            message = (
                f'{self.matrix.path}: cases: the key "api" is missing of "{case.env}", and no requirement tells '
                f"which it is{suggestion('', APIS)}"
            )
            raise BadInput(message)
        return self.spoken.setdefault((id(case), api), replace(case, api=api))

    def places(self, choices: Iterable[Choice]) -> Iterator[tuple[Case, str]]:
        """Yield every case with its place in the file, and with the API that was found for it, if any."""
        own = {number: case for (number, _), case in self.spoken.items()}
        yield from ((own.get(id(case), case), f"cases[{index}]") for index, (case, _) in enumerate(self.base.cases))
        for choice in choices:
            for index, (case, _) in enumerate(self._parts((choice,))[-1].cases if choice.cases else ()):
                yield own.get(id(case), case), f"{key_path('axes', choice.axis, choice.literal, 'cases', index)}"

    def _check_distinct(self, cases: Iterable[Case]) -> None:
        by_id: dict[str, Case] = {}
        for case in cases:
            if by_id.setdefault(case.id.casefold(), case) is not case:
                message = f'{self.matrix.path}: cases: two cases of one cell have the id "{case.id}"; give one an "id"'
                raise BadInput(message)

    def _question(self, combination: Combination) -> Question:
        parts = self._parts(combination)
        packages = [choice for choice in combination if choice.kind is Kind.PACKAGE]
        absent = tuple(choice.axis for choice in packages if choice.text == ABSENT)
        requirements = [
            text for part in parts for text in part.changes.requirements if required_name(text) not in absent
        ]
        pins = [f"{choice.axis}=={choice.text}" for choice in packages if choice.text != ABSENT]
        question = Question(
            requirements=_distinct([*requirements, *pins]),
            **_holding(parts, combination),
            build_variables=_merged(part.changes.build_variables for part in parts),
            only_binary=_distinct(name for part in parts for name in part.changes.only_binary),
            absent=absent,
            resolution=self.matrix.resolution,
            prerelease=self.matrix.prerelease,
            index=self.index,
            torch_backend=self.matrix.torch_backend or "cpu",
            snapshot=self.snapshot,
        )
        names = _distinct(name for part in parts for name in part.changes.overlay)
        with locate_errors(self.matrix.path, "overlay"):
            return replace(
                question,
                overlay=overlay_recipes.select(overlay_recipes.find_repairs(self.recipes, names), question),
            )

    def _surroundings(self, combination: Combination) -> dict[str, Any]:
        changes = [part.changes for part in self._parts(combination)]
        variables = {choice.axis: choice.literal for choice in combination if choice.kind is Kind.VARIABLE}
        files = _merged(change.files for change in changes)
        self._check_places(files)
        lists = {name: _distinct(chain(*(getattr(change, name) for change in changes))) for name in LISTS}
        return lists | {
            "environment": {**_merged(change.environment for change in changes), **variables},
            "files": {
                path: self.texts[content.source] if isinstance(content, SourceTable) else content
                for path, content in files.items()
            },
            "bring": tuple(Bring(name=name, **asdict(table)) for name, table in self._brought(changes).items()),
        }

    def _brought(self, changes: Iterable[Changes]) -> dict[str, BringTable]:
        """Return what the user has to supply for a cell. Raises BadInput if one variable names two things."""
        tables: dict[str, BringTable] = {name: table for change in changes for name, table in change.bring.items()}
        variables = [table.variable for table in tables.values()]
        twice = next((one for one in variables if variables.count(one) > 1), None)
        if twice:
            message = f'{self.matrix.path}: bring: "{twice}" names two things; give each a variable of its own'
            raise BadInput(message)
        return tables

    def _check_places(self, files: Iterable[str]) -> None:
        """Refuse a file where a folder has to be."""
        folders = {str(parent): name for name in files for parent in PurePosixPath(name).parents}
        for name in files:
            if name in folders:
                message = f'{self.matrix.path}: files: "{name}" cannot be a file, being the folder of {folders[name]}'
                raise BadInput(message)

    def _parts(self, combination: Combination) -> list[_Part]:
        parts = [self.base]
        for choice in combination:
            if choice.changes is not NO_CHANGES:
                if choice not in self.parts:
                    self.parts[choice] = self._part(choice.changes, choice.cases)
                parts.append(self.parts[choice])
        return parts

    def _part(self, changes: Changes, cases: Iterable[CaseTable]) -> _Part:
        return _Part(
            changes=changes,
            rules={name: self._rules(getattr(changes, name)) for name in CONDITIONAL},
            cases=tuple((self._case(table), self._when(table)) for table in cases),
        )

    def _case(self, table: CaseTable) -> Case:
        """Return a case; the modules of the subject may register its environment."""
        bank = self.banks[table.bank][0] if table.bank else None
        policy = policies.of_case(table.policy, table.episodes, self.policies)
        packages = (SELF,) if self.matrix.subject and table.env else ()
        return replace(_case(table), packages=packages, bank=bank, policy=policy)

    def _when(self, table: CaseTable) -> Condition | _InBaseline:
        when = condition(self.matrix, table.when)
        return _InBaseline(when, self.baseline) if table.only else when

    def _rules(self, constraints: Iterable[Constraint]) -> Rules:
        return tuple((each.require, condition(self.matrix, each.when)) for each in constraints)


def _case(table: CaseTable) -> Case:
    values = asdict(table)
    del values["when"], values["only"], values["episodes"]
    api, picture = api_of(table.env, table.api), asdict(table.picture).items() if table.picture else ()
    return Case(**values | {
        "id": table.id or case_id(table.env, table.imports),
        "api": api if api and table.env else "",
        "checks": _checks(table),
        "timeouts": {Phase(phase): seconds for phase, seconds in table.timeouts.items()},
        "picture": {name: colour for name, colour in picture if colour} or None,
    })  # fmt: skip


def _checks(table: CaseTable) -> tuple[str, ...]:
    """Return the checks of a case. Of the phase `behave` those that the case brings something for."""
    if not table.env:
        return (IMPORT_CHECK,)
    useless = {PLAY} if not table.policy else {STEP} if not table.bank else set()
    return tuple(check for check in checks_of(table.checks) if check not in useless)


def _holding(parts: Sequence[_Part], combination: Combination) -> dict[str, Any]:
    """Return the conditional requirements of parts that hold in a combination, by the key of their list."""
    return {
        name: _distinct(text for part in parts for text, when in part.rules[name] if when.holds(combination))
        for name in CONDITIONAL
    }


def _distinct(items: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(items))


def _merged(mappings: Iterable[Mapping[str, T]]) -> dict[str, T]:
    return {name: value for mapping in mappings for name, value in mapping.items()}
