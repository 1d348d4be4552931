"""Make reference pages from the code: commands from their help, matrix files and documents from their schemas."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import json
import os
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import run_examples

from harness import __main__ as command_line
from harness.commands.schema_ import DOCUMENTS
from harness.model import schema

DOCS = Path(__file__).resolve().parents[1]
WIDTH = "100"
"""Columns of a help text."""
Schema = Mapping[str, Any]
OTHERS = [name for name in DOCUMENTS if name != "matrix"]
"""Documents apart from a matrix file."""


def pages() -> Iterator[tuple[str, str]]:
    """Yield the place and the Markdown of each page."""
    yield "reference/commands.md", commands()
    yield "reference/matrix.md", matrix_file()
    yield "reference/documents.md", documents()
    for name in OTHERS:
        yield f"reference/documents/{name}.md", document(name)


def commands() -> str:
    """Return the page of all commands: the help of each, and commands of other pages that use it."""
    lines = ["# Commands", "", "Made from the commands' own help.", "", "```", f"{help_text()}", "```", ""]
    for verbs in command_line.GROUPS.values():
        for verb, (_, meaning) in verbs.items():
            lines += [f"## {verb}", "", f"{meaning[0].upper()}{meaning[1:]}.", ""]
            lines += ["```", help_text(verb), "```", "", *_examples_of(verb)]
    return "\n".join(lines)


def help_text(*words: str) -> str:
    """Return what `simmatrix WORDS --help` prints."""
    printed = io.StringIO()
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = WIDTH
    try:
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            command_line.main([*words, "--help"])
    finally:
        os.environ.pop("COLUMNS") if before is None else os.environ.update(COLUMNS=before)
    return printed.getvalue().rstrip()


def _examples_of(verb: str) -> list[str]:
    """Return the commands of tutorials and guides that use a verb, each with its page: all of them are run."""
    lines = []
    for page in sorted(DOCS.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        used = [each.command for each in run_examples.examples(text) if each.command.startswith(f"simmatrix {verb} ")]
        title = text.removeprefix("# ").partition("\n")[0]
        place = posixpath.relpath(page.relative_to(DOCS).as_posix(), "reference")
        lines += [f"| `{_in_table(command)}` | [{title}]({place}) |" for command in dict.fromkeys(used)]
    return ["| example | its output is in |", "| --- | --- |", *lines, ""] if lines else []


def matrix_file() -> str:
    """Return the page of the keys of a matrix file."""
    own = schema_of("matrix")
    lines = ["# Matrix files", "", "Made from the schema; `simmatrix schema matrix` prints it as JSON Schema.", ""]
    return "\n".join([*lines, *_tables(own)])


def documents() -> str:
    """Return the list of every other file and of every document that a command prints."""
    lines = ["# Documents", "", "Made from the schemas; `simmatrix schema NAME` prints one as JSON Schema.", ""]
    lines += ["| name | document |", "| --- | --- |"]
    return "\n".join([*lines, *(f"| [{name}](documents/{name}.md) | {DOCUMENTS[name][0]} |" for name in OTHERS), ""])


def document(name: str) -> str:
    """Return the page of one document."""
    what = DOCUMENTS[name][0]
    lines = [f"# {name}", "", f"Document: {what}. `simmatrix schema {name}` prints it as JSON Schema.", ""]
    return "\n".join([*lines, *_tables(schema_of(name))])


def schema_of(name: str) -> Schema:
    """Return the JSON Schema of a document."""
    _, module, kind = DOCUMENTS[name]
    return schema.json_schema(getattr(importlib.import_module(f"harness.{module}"), kind))


def _tables(own: Schema) -> Iterator[str]:
    """Yield a heading and a table of keys for each object of a schema, the outermost first."""
    definitions: dict[str, Schema] = dict(own.get("$defs", {}))
    top = str(own.get("$ref", "")).rpartition("/")[2]
    names = [top, *sorted(definitions.keys() - {top})] if top else sorted(definitions)
    for name in names:
        each = definitions[name]
        yield from (f"## {_title(name)}", "")
        if places := _places(name, definitions):
            yield from (f"Used in: {', '.join(places)}.", "")
        if text := each.get("description"):
            yield from (inspect.cleandoc(text), "")
        if "enum" in each:
            yield from (", ".join(f"`{value}`" for value in each["enum"]), "")
        if each.get("properties"):
            yield from _keys(each)


def _title(name: str) -> str:
    """Return the heading of a definition: the name of its type, which for a table of a matrix ends with `Table`."""
    return name.removesuffix("Table")


def _places(name: str, definitions: Mapping[str, Schema]) -> list[str]:
    """Return the keys whose values are of a definition."""
    reference = f'"#/$defs/{name}"'
    return [
        f"`{key}` of {_title(owner)}"
        for owner, table in definitions.items()
        for key, value in table.get("properties", {}).items()
        if reference in json.dumps(value)
    ]


def _keys(table: Schema) -> Iterator[str]:
    yield "| key | value | default | meaning |"
    yield "| --- | --- | --- | --- |"
    required = table.get("required", ())
    for key, value in table["properties"].items():
        default = "required" if key in required else _default(value)
        meaning = _in_table(value.get("description", ""))
        yield f"| `{key}` | {_in_table(_kind(value))} | {default} | {meaning} |"
    yield ""


def _default(value: Schema) -> str:
    default = value.get("default")
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return "" if not default or isinstance(default, Mapping) else f"`{_in_table(str(default))}`"


NAMES = {"string": "text", "boolean": "true or false", None: "any"}
"""Kinds of JSON Schema whose name a reader would stumble over."""


def _kind(value: Schema) -> str:
    """Return what a value may be, in words."""
    if "$ref" in value:
        name = str(value["$ref"]).rpartition("/")[2]
        return f"[{_title(name)}](#{_title(name).lower()})"
    if choices := value.get("enum") or ([value["const"]] if "const" in value else []):
        return _listed([f"`{each}`" for each in choices])
    if parts := value.get("anyOf") or value.get("oneOf"):
        return _listed(list(dict.fromkeys(_kind(each) for each in parts if each.get("type") != "null")))
    inner = value.get("items") if value.get("type") == "array" else value.get("additionalProperties")
    container = {"array": "list", "object": "table"}.get(str(value.get("type")))
    if container:
        return f"{container} of {_kind(inner)}" if isinstance(inner, Mapping) and inner else container
    return NAMES.get(value.get("type"), str(value.get("type")))


def _listed(parts: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))


def _in_table(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|")
