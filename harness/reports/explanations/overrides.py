"""Find measured cells that work although a package in them excludes the release of another one that they hold."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

from packaging.markers import default_environment

from harness.reports.answers.measured_cells import CellResult
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.requirements import Requirement, requirement


def working_overrides(cells: Iterable[CellResult]) -> list[dict[str, Any]]:
    """Return each pair of releases once: `asker`, its `version`, the `package`, the release `held`, and the `cell`."""
    pairs: dict[tuple[str, str, str, str], str] = {}
    for result in cells:
        if not result.works:
            continue
        pins = {name: version.partition("+")[0] for name, version in result.pins.items()}
        for asker, version in pins.items():
            for each in _requirements(asker, version, result.minor):
                if each.name in pins and not each.specifiers.admits(pins[each.name]):
                    pairs.setdefault((asker, version, each.name, pins[each.name]), result.cell.id)
    keys = ("asker", "version", "package", "held", "cell")
    return [dict(zip(keys, (*pair, cell), strict=True)) for pair, cell in sorted(pairs.items())]


@cache
def _requirements(name: str, version: str, python: str) -> tuple[Requirement, ...]:
    """Return what a release requires on a Python; nothing where no history has the release."""
    history = load_shipped(name)
    if history is None or version not in history.versions:
        return ()
    place = history.versions.index(version)
    environment = {
        **{key: str(value) for key, value in default_environment().items()},
        "python_version": python,
        "python_full_version": f"{python}.99",
    }
    texts = [
        text
        for text, spans in history.plain.get("requires", {}).items()
        if any(first <= place <= last for first, last in spans)
    ]
    return tuple(each for text in texts if (each := _applying(text, environment)) is not None)


def _applying(text: str, environment: dict[str, str]) -> Requirement | None:
    try:
        each = requirement(text)
        return each if each.wanted(environment) else None
    except (ValueError, KeyError):
        return None
