"""Find what renders on this machine, what each setting selects, and which one to use (`doctor --rendering`)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from harness.devices import egl_advice, gl_inventory
from harness.devices.egl_advice import LIBRARIES, DrawingSupport, Prediction
from harness.devices.egl_rules import OLD_EGL_ID
from harness.devices.gl_inventory import Answer, RenderingWays
from harness.model import Level, decoding
from harness.model.report_types import DiagnosisEntry, FindingEntry
from harness.reports import document
from harness.running.signatures import shipped_signatures
from harness.standalone.failures import matching


class Selected(msgspec.Struct, frozen=True, kw_only=True):
    """The renderer of one library. `way` is egl, osmesa, glfw or none, `device` a place in EGL's list."""

    library: str
    way: str
    device: int | None
    error: str | None


class Possible(msgspec.Struct, frozen=True, kw_only=True):
    """The renderers that a setting would select alone, with MUJOCO_GL=egl."""

    setting: str
    selected: tuple[Selected, ...]


class Recommended(msgspec.Struct, frozen=True, kw_only=True):
    """The recommended setting: variables to set and to unset."""

    variables: dict[str, str]
    unset: tuple[str, ...]
    reason: str


class Rendering(msgspec.Struct, frozen=True, kw_only=True):
    """The renderers of this machine. `settings` are the caller's variables, None if a variable is not set."""

    devices: tuple[Answer, ...]
    egl_missing: str | None
    osmesa: Answer
    display: Answer
    settings: dict[str, str | None]
    selected: tuple[Selected, ...]
    possible: tuple[Possible, ...]
    recommended: Recommended | None


class RenderingReport(msgspec.Struct, frozen=True, kw_only=True):
    """The renderers of this machine, with the problems found and the known failures that they lead to."""

    findings: tuple[FindingEntry, ...]
    diagnoses: tuple[DiagnosisEntry, ...]
    rendering: Rendering


RENDERING_VARIABLES = (*egl_advice.VARIABLES, OLD_EGL_ID)
"""The variables that have a say."""


def here() -> RenderingReport:
    """Return the renderers of this machine, with the settings of this shell."""
    return assess_rendering(
        gl_inventory.ways(), {name: os.environ[name] for name in os.environ if name in RENDERING_VARIABLES}
    )


def assess_rendering(ways: RenderingWays, variables: egl_advice.Variables) -> RenderingReport:
    """Return the findings, known failures and recommendation for these renderers and variables."""
    there = DrawingSupport(
        devices=ways.as_devices(), osmesa="missing" not in ways.osmesa, display="missing" not in ways.display
    )
    troubles = egl_advice.troubles(variables, there)
    findings = [
        FindingEntry(check="rendering", level=Level.WARNING, text=egl_advice.describe_error(error, failing, variables))
        for error, failing in troubles.items()
    ]
    different = egl_advice.describe_disagreement(variables, there)
    if different:
        findings.append(FindingEntry(check="rendering", level=Level.NOTE, text=different))
    advice = egl_advice.recommend(variables, there)
    return RenderingReport(
        diagnoses=tuple(_diagnoses(troubles)),
        findings=tuple(findings),
        rendering=Rendering(
            devices=ways.devices,
            egl_missing=ways.egl_missing,
            osmesa=ways.osmesa,
            display=ways.display,
            settings={name: variables.get(name) for name in RENDERING_VARIABLES},
            selected=_selected(egl_advice.outcomes(variables, there)),
            possible=tuple(
                Possible(setting=typed, selected=_selected(egl_advice.outcomes(those, there, argument)))
                for typed, those, argument in egl_advice.possible(there)
            ),
            recommended=decoding.convert(advice, Recommended, attributes=True) if advice else None,
        ),
    )


def _selected(results: Sequence[Prediction]) -> tuple[Selected, ...]:
    return tuple(
        Selected(library=who.name, way=one.way, device=one.device, error=one.error)
        for who, one in zip(LIBRARIES, results, strict=True)
    )


def _diagnoses(troubles: Mapping[str, Sequence[egl_advice.Library]]) -> Iterable[DiagnosisEntry]:
    """Return the known failures that match the predicted errors, each once."""
    diagnoses: dict[str, DiagnosisEntry] = {}
    for error, failing in troubles.items():
        # The error is predicted and not seen in any phase; None fits known failures of every phase.
        evidence = [matching.Evidence(phase=None, reasons=(error,))]
        for who in failing:
            installed = {who.library.replace("_", "-"): who.release, "mujoco": who.mujoco}
            for diagnosis in matching.diagnose(
                shipped_signatures.load_all(), evidence, matching.Around(installed=installed)
            ):
                diagnoses.setdefault(diagnosis.signature.id, document.diagnosis_entry(diagnosis))
    return diagnoses.values()


# --- what is said ----------------------------------------------------------------------------------------------


def lines(rendering: Rendering) -> Iterable[str]:
    """Yield the table as lines for a terminal."""
    yield "EGL's devices, in EGL's order:"
    yield from (f"  {place}  {_answer(one)}" for place, one in enumerate(rendering.devices))
    if rendering.egl_missing:
        yield f"  none: {rendering.egl_missing}"
    yield f"OSMesa:  {_answer(rendering.osmesa)}"
    yield f"display: {_answer(rendering.display)}"
    yield ""
    yield "set here: " + (
        _typed({k: v for k, v in rendering.settings.items() if v is not None}) or "none of the variables"
    )
    alike: dict[str, list[str]] = {}
    for selection in rendering.selected:
        alike.setdefault(_outcome(selection), []).append(selection.library)
    yield from (f"  {', '.join(libraries)}: {outcome}" for outcome, libraries in alike.items())
    yield ""
    yield "what each value would select alone, with MUJOCO_GL=egl:"
    yield from _table(rendering.possible)
    yield ""
    yield f"recommended: {_advice(rendering.recommended)}"


def _answer(answer: Answer) -> str:
    kind = [f"CUDA device {answer['cuda']}"] if "cuda" in answer else []
    kind += [answer["file"]] if "file" in answer else []
    kind += ["software"] if "software" in answer else []
    names = [answer[name] for name in ("vendor", "renderer") if name in answer]
    return ", ".join([*names, *kind, *([f"none: {answer['missing']}"] if "missing" in answer else [])])


def _typed(variables: dict[str, Any]) -> str:
    return " ".join(
        f"{name}={value if value and ' ' not in value else repr(value)}" for name, value in variables.items()
    )


def _outcome(selection: Selected) -> str:
    if selection.error:
        return f"fails: {selection.error}"
    return f"EGL device {selection.device}" if selection.way == "egl" else f"no device: drawn by {selection.way}"


def _table(rows: Sequence[Possible]) -> Iterable[str]:
    head = ["", *(who.name for who in LIBRARIES)]
    body = [[row.setting, *(_short(one) for one in row.selected)] for row in rows]
    widths = [max(len(line[column]) for line in [head, *body]) for column in range(len(head))]
    for line in [head, *body]:
        yield ("  " + "  ".join(f"{text:<{width}}" for text, width in zip(line, widths, strict=True))).rstrip()


def _short(selection: Selected) -> str:
    return (selection.error.partition(":")[0]) if selection.error else str(selection.device)


def _advice(advice: Recommended | None) -> str:
    if advice is None:
        return "nothing can draw here: install Debian's libegl1 and libgl1-mesa-dri, or the GPU vendor's driver"
    unset = f"unset {' '.join(advice.unset)}; " if advice.unset else ""
    return f"{unset}export {_typed(advice.variables)}\n  {advice.reason}"
