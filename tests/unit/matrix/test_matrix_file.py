"""Matrix files: what each form means, and the sentence for each mistake."""

from pathlib import Path
from typing import Any

import jsonschema
import pytest
from builders import CASE

from harness.matrix import matrix_file
from harness.matrix.matrix_types import Matrix, MatrixTable
from harness.model import schema
from harness.model.errors import BadInput
from harness.model.vocabulary import Instant, Kind

MATRICES = Path(__file__).parents[3] / "matrices"
AXES = 'axes = { python = ["3.11"], gymnasium = ["0.29.1", "1.2.3"] }\n'


def read(text: str, path: str = "matrices/demo.toml") -> Matrix:
    """Return a matrix from text."""
    return matrix_file.read(text, path)


def refused(text: str, path: str = "demo.toml") -> str:
    """Return the sentence with which a matrix is refused."""
    with pytest.raises(BadInput) as error:
        read(text, path)
    return str(error.value)


class TestReading:
    def test_name_is_the_stem_of_the_file(self) -> None:
        """A matrix is called like its file; messages give the path."""
        matrix = read(AXES + CASE)

        assert (matrix.name, matrix.path) == ("demo", "matrices/demo.toml")

    def test_axes_of_every_form(self) -> None:
        """Lists, tables in lists, ranges, variables and bundles become axes with values."""
        axes = read(
            """
            [axes]
            python = ["3.11", "host"]
            gymnasium = ["0.29.1", { version = "1.2.3", constraints = ["numpy<2"] }, "absent"]
            mujoco = { range = ">=2.3,<4" }
            MUJOCO_GL = { variable = ["egl", ""] }
            api = { old = { requirements = ["scipy"] }, new = {} }
            """
            + CASE
        ).axes

        assert {name: (axis.kind, [value.text for value in axis.values]) for name, axis in axes.items()} == {
            "python": (Kind.PYTHON, ["3.11", "host"]),
            "gymnasium": (Kind.PACKAGE, ["0.29.1", "1.2.3", "absent"]),
            "mujoco": (Kind.PACKAGE, []),
            "MUJOCO_GL": (Kind.VARIABLE, ["egl", ""]),
            "api": (Kind.BUNDLE, ["old", "new"]),
        }

    def test_versions_are_normalised(self) -> None:
        """A version is kept in the form that the index gives it."""
        matrix = read('axes = { python = ["3.10"], gymnasium = ["v1.0.0-RC1"] }\n' + CASE)

        assert [value.text for value in matrix.axes["gymnasium"].values] == ["1.0.0rc1"]

    def test_only_ranges_need_an_expansion(self) -> None:
        """A matrix knows which of its axes the index has to expand."""
        matrix = read(
            'axes = { python = ["3.10"], numpy = ["2.0"], mujoco = { range = ">=3", rule = "newest" } }\n' + CASE
        )

        assert {name: table.range for name, table in matrix.ranges.items()} == {"mujoco": ">=3"}

    def test_sources_are_named_once(self) -> None:
        """The texts that lie beside the matrix file are named for the caller to read."""
        matrix = read(
            'files = { a = "text", b = { source = "x/./model.xml" } }\n'
            'axes.python = [{ version = "3.11", files = { c = { source = "x/model.xml" } } }]\n' + CASE
        )

        assert matrix_file.sources(matrix) == {"x/model.xml": "matrices/demo.toml: axes.python[0].files.c.source"}

    @pytest.mark.parametrize(
        ("written", "instant"),
        [
            ("2026-11-20", "2026-11-20T23:59:59Z"),
            ('"2026-11-20"', "2026-11-20T23:59:59Z"),
            ("2026-11-20T12:00:00Z", "2026-11-20T12:00:00Z"),
            ("2026-11-20T12:00:00+02:00", "2026-11-20T10:00:00Z"),
            ("2026-11-20 12:00:00.5", "2026-11-20T12:00:00Z"),
        ],
    )
    def test_snapshot_is_an_instant_in_utc(self, written: str, instant: str) -> None:
        """A bare date is the end of that day, an offset is taken off, no offset is UTC."""
        assert read(f"snapshot = {written}\n{AXES}{CASE}").snapshot == Instant(instant)

    def test_schema_describes_every_key(self) -> None:
        """The JSON Schema of a matrix names the keys that reading knows, and no others."""
        definitions = schema.json_schema(MatrixTable)["$defs"]

        assert set(definitions["MatrixTable"]["properties"]) == set(MatrixTable.__struct_fields__)
        assert all(table.get("additionalProperties", False) is False for table in definitions.values())


MISTAKES: dict[str, tuple[str, str]] = {
    "unknown-key": (
        AXES + '[[cases]]\nchekcs = ["single"]',
        'demo.toml: cases[0].chekcs: unknown key; did you mean "checks"?',
    ),
    "python-number": (
        'axes = { python = ["3.9", 3.10] }\n' + CASE,
        'demo.toml: axes.python[1]: expected a string or a table, got a number (write "3.10", not 3.10)',
    ),
    "no-axes": (CASE, 'demo.toml: the key "axes" is missing'),
    "no-python": (
        'axes = { gymnasium = ["1.2.3"] }\n' + CASE,
        'demo.toml: axes: there is no Python; write for instance python = ["3.11"]',
    ),
    "no-case": (AXES, "demo.toml: there is no case; write for instance [[cases]] with env and api"),
    "empty-axis": ("axes = { python = [] }\n" + CASE, "demo.toml: axes.python: expected a list that is not empty"),
    "python-range": (
        'axes = { python = { range = ">=3.9" } }\n' + CASE,
        'demo.toml: axes.python: Python is a list of versions, such as ["3.10", "3.11"]',
    ),
    "latest": (
        'axes = { python = ["3.11"], gymnasium = ["latest"] }\n' + CASE,
        'demo.toml: axes.gymnasium[0]: "latest" is not a version; write { range = ">=0", rule = "newest" }',
    ),
    "no-version": (
        'axes = { python = ["3.11"], gymnasium = ["1.2.x"] }\n' + CASE,
        'demo.toml: axes.gymnasium[0]: "1.2.x" is not a version; ids name resolved versions only',
    ),
    "python-absent": (
        'axes = { python = ["absent"] }\n' + CASE,
        'demo.toml: axes.python[0]: "absent" is not a version; ids name resolved versions only',
    ),
    "listed-twice": (
        'axes = { python = ["3.11"], gymnasium = ["1.0", "1.0"] }\n' + CASE,
        'demo.toml: axes.gymnasium[1]: "1.0" is listed twice',
    ),
    "package-name": (
        'axes = { python = ["3.11"], dm_control = ["1.0.9"] }\n' + CASE,
        'demo.toml: axes.dm_control: write the package by its normalised name, "dm-control"',
    ),
    "variable-name": (
        'axes = { python = ["3.11"], "MUJOCO-GL" = { variable = ["egl"] } }\n' + CASE,
        'demo.toml: axes.MUJOCO-GL: "MUJOCO-GL" is not the name of an environment variable',
    ),
    "own-home": (
        'environment = { HOME = "x" }\n' + AXES + CASE,
        'demo.toml: environment: "HOME" cannot be set: every cell gets its own',
    ),
    "bundle-label": (
        'axes = { python = ["3.11"], api = { "a b" = {} } }\n' + CASE,
        'demo.toml: axes.api."a b": "a b" cannot be a label: use letters, digits and "._+-" only',
    ),
    "range-key": (
        'axes = { python = ["3.11"], mujoco = { rang = ">=2" } }\n' + CASE,
        'demo.toml: axes.mujoco.rang: unknown key; did you mean "range"?',
    ),
    "key-of-another-form": (
        'axes = { python = ["3.11"], GL = { variable = ["egl"], rule = "all" } }\n' + CASE,
        'demo.toml: axes.GL.rule: unknown key; valid: "extra", "group", "variable"',
    ),
    "range-specifier": (
        'axes = { python = ["3.11"], mujoco = { range = "2.x" } }\n' + CASE,
        'demo.toml: axes.mujoco: "2.x" is not a specifier such as ">=2.3,<4"',
    ),
    "range-rule": (
        'axes = { python = ["3.11"], mujoco = { range = ">=2", rule = "latest" } }\n' + CASE,
        'demo.toml: axes.mujoco.rule: unknown value "latest"; did you mean "latest-patch"?',
    ),
    "requirement": (
        'requirements = ["numpy", "gymnasium=1.0"]\n' + AXES + CASE,
        'demo.toml: requirements[1]: "gymnasium=1.0" is not a requirement: '
        "Expected semicolon (after name with no version specifier) or end",
    ),
    "constraint-extras": (
        'constraints = ["numpy<2", "gymnasium[mujoco]<1"]\n' + AXES + CASE,
        'demo.toml: constraints[1]: "gymnasium[mujoco]<1" has extras, which a constraint cannot have',
    ),
    "nested-requirement": (
        'axes = { python = [{ version = "3.11", overrides = [{ require = "x y" }] }] }\n' + CASE,
        'demo.toml: axes.python[0].overrides[0].require: "x y" is not a requirement: '
        "Expected semicolon (after name with no version specifier) or end",
    ),
    "only-binary": (
        'only_binary = ["mujoco", ":none:"]\n' + AXES + CASE,
        'demo.toml: only_binary[1]: ":none:" is not the name of a package',
    ),
    "strategy": (
        'strategy = "pairwize"\n' + AXES + CASE,
        'demo.toml: strategy: unknown value "pairwize"; did you mean "pairwise"?',
    ),
    "need": ('needs = ["elg"]\n' + AXES + CASE, 'demo.toml: needs[0]: unknown value "elg"; did you mean "egl"?'),
    "torch-backend": (
        'torch_backend = "cuda"\n' + AXES + CASE,
        'demo.toml: torch_backend: "cuda" is not a torch backend such as "cpu", "cu126", "rocm6.3", "xpu" or "auto"',
    ),
    "snapshot": (
        'snapshot = "yesterday"\n' + AXES + CASE,
        'demo.toml: snapshot: "yesterday" is not a date such as 2026-11-20 nor a moment such as 2026-11-20T12:00:00Z',
    ),
    "file-outside": (
        'files = { "../x" = "" }\n' + AXES + CASE,
        'demo.toml: files: "../x" is not a relative path inside the folder',
    ),
    "source-outside": (
        'files = { x = { source = "/etc/passwd" } }\n' + AXES + CASE,
        'demo.toml: files.x.source: "/etc/passwd" is not a relative path inside the folder',
    ),
    "api": (
        AXES + '[[cases]]\nenv = "x"\napi = "gymnasim"',
        'demo.toml: cases[0].api: unknown value "gymnasim"; did you mean "gymnasium"?',
    ),
    "no-api-but-nearly": (
        AXES + '[[cases]]\nenv = "dm_contol:cheetah/run"',
        'demo.toml: cases[0]: the key "api" is missing; did you mean "dm_control"?',
    ),
    "picture-never-looked-at": (
        AXES + CASE + 'checks = ["single"]\npicture = { above = "#ff0000", below = "#0000ff" }',
        'demo.toml: cases[0].picture: has no effect, since "checks" leaves "render" out',
    ),
    "required-of-a-check-that-is-not-run": (
        AXES + CASE + 'required = ["vector.autoreset"]',
        'demo.toml: cases[0].required[0]: "vector.autoreset" has no effect, since "checks" leaves it out',
    ),
    "two-apis": (
        AXES + '[[cases]]\nenv = "gym:x"\napi = "gymnasium"',
        'demo.toml: cases[0]: "gym:x" names the API "gym", but "gymnasium" is asked for',
    ),
    "nothing-to-try": (
        AXES + '[[cases]]\napi = "gym"',
        'demo.toml: cases[0]: a case needs an "env", or "imports" alone',
    ),
    "check-without-env": (
        AXES + '[[cases]]\nimports = ["mujoco"]\nchecks = ["single"]',
        'demo.toml: cases[0].checks: without an "env" there is nothing to check but "import"',
    ),
    "check": (
        AXES + CASE + 'checks = ["vector.fork"]',
        'demo.toml: cases[0].checks[0]: unknown value "vector.fork"; did you mean "vector.async.fork"?',
    ),
    "required": (
        AXES + CASE + 'required = ["single.repeat"]',
        'demo.toml: cases[0].required[0]: unknown value "single.repeat"; did you mean "single.repeat.same"?',
    ),
    "required-never-looked-at": (
        AXES + CASE + 'checks = ["render"]\nrequired = ["single.space"]',
        'demo.toml: cases[0].required[0]: "single.space" has no effect, since "checks" leaves its phase out',
    ),
    "module": (
        AXES + CASE + 'imports = ["dm-control"]',
        'demo.toml: cases[0].imports[0]: "dm-control" is not the name of a Python module',
    ),
    "timeout": (
        AXES + CASE + "timeouts = { single = 0 }",
        "demo.toml: cases[0].timeouts.single: expected a number > 0.0",
    ),
    "infinite-argument": (
        AXES + CASE + "kwargs = { range = [0, inf] }",
        "demo.toml: cases[0].kwargs: inf cannot be handed to a cell",
    ),
    "endless-timeout": (
        AXES + CASE + "timeouts = { single = inf }",
        "demo.toml: cases[0].timeouts.single: expected a number <= 1000000.0",
    ),
    "when-axis": (
        AXES + CASE + 'when = { gymnasum = ">=1" }',
        'demo.toml: cases[0].when.gymnasum: there is no such axis; did you mean "gymnasium"?',
    ),
    "when-pattern": (
        AXES + CASE + 'when = { gymnasium = [">=1", "new"] }',
        'demo.toml: cases[0].when.gymnasium: "new" is neither a version nor a specifier such as ">=1.0,<2"',
    ),
    "when-label": (
        'axes = { python = ["3.11"], api = { old = {}, new = {} } }\n' + CASE + 'when = { api = "nwe" }',
        'demo.toml: cases[0].when.api: no value of this axis is "nwe"; did you mean "new"?',
    ),
    "when-variable-in-constraint": (
        'constraints = [{ require = "numpy<2", when = { GL = "egl" } }]\n'
        'axes = { python = ["3.11"], GL = { variable = ["egl"] } }\n' + CASE,
        "demo.toml: constraints[0].when.GL: an environment variable never changes what is installed; use a bundle axis",
    ),
    "exclude-everything": (
        AXES + CASE + '[[exclude]]\nwhen = {}\nreason = "x"',
        "demo.toml: exclude[0].when: expected a table that is not empty",
    ),
    "exclude-without-reason": (
        AXES + CASE + '[[exclude]]\nwhen = { python = "3.11" }',
        'demo.toml: exclude[0]: the key "reason" is missing',
    ),
    "include-partly": (
        AXES + CASE + '[[include]]\naxes = { python = "3.8" }\nreason = "x"',
        'demo.toml: include[0].axes: the key "gymnasium" is missing',
    ),
    "include-axis": (
        AXES + CASE + '[[include]]\naxes = { pyton = "3.8" }\nreason = "x"',
        'demo.toml: include[0].axes.pyton: there is no such axis; did you mean "python"?',
    ),
    "include-label": (
        'axes = { python = ["3.11"], api = { old = {} } }\n'
        + CASE
        + '[[include]]\naxes = { python = "3.8", api = "odl" }\nreason = "x"',
        'demo.toml: include[0].axes.api: unknown value "odl"; did you mean "old"?',
    ),
    "expect-nothing-named": (
        AXES + CASE + '[[expect]]\nverdict = "broken"\nreason = "x"',
        'demo.toml: expect[0]: say which cells: a glob as "cells", or a "when"',
    ),
    "expect-verdict": (
        AXES + CASE + '[[expect]]\ncells = "*"\nverdict = "unavailable"\nreason = "x"',
        'demo.toml: expect[0]: "unavailable" does not test packages and cannot be expected',
    ),
    "expect-phase": (
        AXES + CASE + '[[expect]]\ncells = "*"\nverdict = "partial"\nphase = "suite"\nreason = "x"',
        'demo.toml: expect[0]: no cell goes through the phase "suite" yet',
    ),
    "expect-match": (
        AXES + CASE + '[[expect]]\ncells = "*"\nverdict = "partial"\nmatch = "("\nreason = "x"',
        'demo.toml: expect[0].match: "(" is not a regular expression: missing ), unterminated subpattern at position 0',
    ),
}


@pytest.mark.parametrize(("text", "sentence"), MISTAKES.values(), ids=MISTAKES.keys())
def test_mistakes_are_one_sentence(text: str, sentence: str) -> None:
    """Every mistake is told with file, key path, what is wrong, and where it helps the nearest valid name."""
    assert refused(text) == sentence


def test_name_of_the_file_must_be_a_label() -> None:
    """The file's name is part of every id."""
    assert (
        refused(AXES + CASE, "my matrix.toml")
        == 'my matrix.toml: "my matrix" cannot be a label: use letters, digits and "._+-" only'
    )


@pytest.mark.parametrize("file", sorted(MATRICES.glob("*.toml")), ids=lambda file: file.stem)
def test_committed_matrices_are_right(file: Path) -> None:
    """Each matrix of this project can be read, and is valid by the schema that is published."""
    text = file.read_text(encoding="utf-8")
    document = schema.load_toml(text, dict[str, Any], file.name)

    assert read(text, str(file)).name == file.stem
    jsonschema.Draft202012Validator(schema.json_schema(MatrixTable)).validate(document)


def test_values_are_plain_data() -> None:
    """The keyword arguments for `make` are plain data, exactly as in the file."""
    kwargs: dict[str, Any] = dict(read(AXES + CASE + 'kwargs = { a = [1, 2.5], b = { c = "d" } }').cases[0].kwargs)

    assert kwargs == {"a": [1, 2.5], "b": {"c": "d"}}


class TestPivot:
    def test_the_axes_of_the_small_table(self) -> None:
        """They are kept as they are written: down, then across."""
        assert read('pivot = ["gymnasium", "python"]\n' + AXES + CASE).pivot == ("gymnasium", "python")

    def test_two_axes_of_the_matrix(self) -> None:
        """Another name is refused with the nearest, and a table over one axis is none."""
        assert refused('pivot = ["gymnasim", "python"]\n' + AXES + CASE) == (
            'demo.toml: pivot[0]: there is no axis "gymnasim"; did you mean "gymnasium"?'
        )
        assert refused('pivot = ["python", "python"]\n' + AXES + CASE) == (
            "demo.toml: pivot: down and across are the same axis"
        )
