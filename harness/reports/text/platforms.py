"""Describe the machines of a report in words: their facts, and the platforms that they cover or do not cover."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.model.report_types import Document

PLATFORMS = {"linux": "Linux", "darwin": "macOS", "win32": "Windows"}
ARCHITECTURES = {"x86_64": "x86-64", "AMD64": "x86-64", "aarch64": "arm64", "arm64": "arm64"}
GPUS = "GPUs"


def coverage(document: Document) -> dict[str, Any]:
    """Return the days of measuring, the platforms measured on, and those that were not."""
    days = sorted(cell.measured[:10] for cell in document.cells if cell.measured)
    used = [
        (name, document.machines.get(name, {})) for name in sorted({c.machine for c in document.cells if c.machine})
    ]
    platforms = tuple(dict.fromkeys(_platform(name, facts) for name, facts in used))
    every = dict.fromkeys((*PLATFORMS.values(), *ARCHITECTURES.values(), GPUS))
    covered = " ".join(platforms)
    gpus = any(gpu_models(facts) for _, facts in used)
    return {
        "measured": (days[0], days[-1]) if days else None,
        "platforms": platforms,
        "uncovered": tuple(name for name in every if name not in covered and not (name == GPUS and gpus)),
    }


def _platform(name: str, facts: Mapping[str, Any]) -> str:
    """Return a platform in words: `Linux x86-64, CPU only`."""
    system, _, rest = name.partition("-")
    architecture = str(facts.get("architecture") or rest.partition("-")[0])
    words = " ".join(filter(None, (PLATFORMS.get(system, system), ARCHITECTURES.get(architecture, architecture))))
    return f"{words}, {gpu_models(facts) or 'CPU only'}"


def drawing(facts: Mapping[str, Any]) -> Mapping[str, str]:
    """Return the vendor, renderer and version of the OpenGL that a machine draws with; empty if there is none."""
    ways: list[Mapping[str, str]] = [facts.get(way) or {} for way in ("egl", "osmesa", "display")]
    return next((way for way in ways if way.get("vendor")), {})


def gpu_models(facts: Mapping[str, Any]) -> str:
    """Return the GPUs of a machine; empty if there is none."""
    gpu = facts.get("gpu")
    return str(gpu["models"]) if isinstance(gpu, dict) and gpu.get("models") else ""


def facts(machine: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the known facts of a machine as pairs of name and words."""
    words = {name.replace("_", " "): _words(fact) for name, fact in sorted(machine.items())}
    return tuple((name, text) for name, text in words.items() if text)


def _words(fact: Any) -> str:
    match fact:
        case None:
            return ""
        case {"missing": why}:
            return f"none ({why})"
        case dict():
            return ", ".join(str(value) for _, value in sorted(fact.items()))  # report.json keeps no other order
        case list() | tuple():
            return ", ".join(map(_words, fact))
        case _:
            return str(fact)
