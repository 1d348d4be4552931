"""Describe a remedy, as documents hold it, in words."""

from __future__ import annotations

from typing import Any, Iterator, List, Mapping

VERBS = (
    ("install", "requirements"),
    ("pin", "constraints"),
    ("override", "overrides"),
    ("build with", "build_constraints"),
    ("set for builds", "build_variables"),
    ("install only wheels of", "only_binary"),
    ("patch", "overlay"),
    ("uninstall", "uninstall"),
)
"""The keys of a remedy that a machine can apply, in words."""


def in_words(remedy: Mapping[str, Any]) -> str:
    """Describe a remedy: first the steps that a machine can take, then its text."""
    return ". ".join(filter(None, ("; ".join(describe_steps(remedy)), str(remedy.get("text", "")))))


def describe_steps(remedy: Mapping[str, Any]) -> Iterator[str]:
    """Yield the steps of a remedy that a machine can take, in a few words each."""
    for verb, key in VERBS:
        values = remedy.get(key) or ()
        if values:
            yield "{} {}".format(verb, ", ".join("`{}`".format(each) for each in _each(values)))
    variables = remedy.get("environment") or {}
    for verb, names in (
        ("set", [one for one in _each(variables) if not one.endswith("=")]),
        ("unset", [name for name, value in variables.items() if not value]),
    ):
        if names:
            yield "{} {}".format(verb, ", ".join("`{}`".format(each) for each in names))
    if remedy.get("python"):
        yield "Python {}".format(remedy["python"])
    if remedy.get("as_of"):
        yield "resolved as of {}".format(remedy["as_of"])


def _each(values: Any) -> List[str]:
    if isinstance(values, Mapping):
        return ["{}={}".format(name, value) for name, value in values.items()]
    return [str(each) for each in values]
