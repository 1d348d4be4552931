"""Write a red cell as a report that its upstream can use: what fails, the versions, how to reproduce it.

It does not mention the harness. It is made of plain values; the text still has to be redacted by `redacting`.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from packaging.utils import canonicalize_name

from harness.judging.known_failures import select_counting
from harness.model import FAILING, Case, Cell, Outcome, Phase
from harness.model.report_types import CellEntry, word
from harness.model.vocabulary import required_name
from harness.model.words import VIOLATION, in_words
from harness.probes.wire import plain_records
from harness.reports.issue import redacting, reproducing
from harness.reports.tables.tables import settings
from harness.reports.text import platforms
from harness.reports.text.markdown_texts import address, block, code, prose, table_cell
from harness.standalone.control_characters import strip_controls
from harness.standalone.failures import remedies

LONGEST = 60
"""Lines of a traceback that are quoted, the last ones."""

BEFORE, AFTER = 15, 10
"""Lines of a log around the one that says why."""

OURS = re.compile(r'^\s*File "\$INCELL[/"]')
FOLDERS = re.compile(r"\$[A-Z]+[^\s'\"]*?/(site-packages|lib/python[\d.]+)/(?!site-packages/)")
"""Where an interpreter keeps what it imports, as evidence names such folders."""

LIBRARY = re.compile(r'^\s*File "(?:<frozen |[^"]*/lib/python[\d.]+/(?!site-packages/))')
TOP = re.compile(r"(?:site|dist)-packages/(\w+)")


@dataclass(frozen=True, kw_only=True, slots=True)
class Failing:
    """A red cell as planned and as judged; `lock` is the text of the lock, `texts` the evidence of the phase."""

    cell: Cell
    entry: CellEntry
    machine: Mapping[str, Any]
    lock: str | None
    instant: str | None
    texts: Mapping[str, str]

    @property
    def phase(self) -> Phase:
        """Return the phase that decided the verdict; the import if there is none."""
        return self.entry.phase or Phase.IMPORT

    @property
    def case(self) -> Case | None:
        """Return the first case that failed as the cell did, or None."""
        failed = [one for one in self.entry.cases if one.phases.get(self.phase) in FAILING]
        first = next((one for one in failed if one.decisive == self.entry.decisive), next(iter(failed), None))
        return next((one for one in self.cell.cases if first and one.id == first.case), None)

    @property
    def check(self) -> str:
        """Return what the deciding line names, or the first check of that case that failed; empty if there is none."""
        named, case = (self.entry.decisive or "").partition(": ")[0], self.case
        if re.fullmatch(rf"{self.phase}(\.\w+)+", named):
            return named
        entry = next((one for one in self.entry.cases if case and one.case == case.id), None)
        checks = [name for name, how in (entry.checks if entry else {}).items() if how in FAILING]
        return next((name for name in checks if name.startswith(self.phase)), "")


def issue(failing: Failing) -> str:
    """Return the report as Markdown."""
    parts = [
        _title(failing),
        *_what(failing),
        *_describe_cause(failing),
        *_versions(failing),
        *_again(failing),
        *_lock(failing),
    ]
    return strip_controls("\n\n".join(parts) + "\n")


def _title(failing: Failing) -> str:
    """Return the title: the packages that were asked for, and the decisive line."""
    installed = failing.entry.installed or {}
    # A requirement that is no axis, such as `envpool==0.8.4`, belongs to the question, too.
    pinned = [required_name(text) for text in failing.cell.question.requirements if "==" in text]
    names = [name for name in dict.fromkeys([*pinned, *failing.cell.axes]) if name in installed] or list(
        _required_packages(failing)
    )[:3]
    versions = ", ".join(f"{name} {installed[name]}" for name in names if name in installed)
    title = versions or ", ".join(failing.cell.question.requirements)
    return f"# {prose(title)}: {prose(failing.entry.decisive or 'fails')}"


def _what(failing: Failing) -> Iterator[str]:
    case, check = failing.case, failing.check
    where = f" of {code(case.env)}" if case and case.env else ""
    outcome = word(failing.entry.phases.get(failing.phase, "failed"))
    yield f"## What happens\n\n{SAYS.get(failing.phase, str(failing.phase))}{where}: {outcome}" + (
        f" (`{check}`)." if check else "."
    )
    yield block(failing.entry.decisive or "nothing was said")
    quoted = "\n".join(excerpt(failing.texts, failing.check, failing.entry.decisive).splitlines()[-LONGEST:])
    if quoted.strip() and quoted.strip() != failing.entry.decisive:
        yield block(quoted, "pytb" if "Traceback" in quoted else "")


SAYS = {
    Phase.RESOLVE: "The resolution of the requirements",
    Phase.INSTALL: "The install",
    Phase.IMPORT: "The import",
    Phase.SINGLE: "make, reset and step",
    Phase.VECTOR: "A vector environment",
    Phase.RENDER: "A picture",
}


def _describe_cause(failing: Failing) -> Iterator[str]:
    """Yield the deepest known cause, and its remedy if that was proven."""
    deepest = next(iter(select_counting(failing.entry)), None)
    if deepest is None:
        return
    links = "".join(f"\n- {address(link)}" for link in deepest.references)
    yield f"## Cause\n\n{deepest.cause}" + (f"\n{links}" if links else "")
    if deepest.proof:
        yield f"With this change alone, and all else as below, it works (measured): {remedies.in_words(deepest.remedy)}"


# --- versions --------------------------------------------------------------------------------------------------


def _versions(failing: Failing) -> Iterator[str]:
    entry, installed = failing.entry, failing.entry.installed or {}
    rows = [("Python", entry.python or entry.requested_python), *_machine(failing.machine)]
    rows += [(name, installed[name]) for name in _relevant_packages(failing) if name in installed]
    drawn = next((case.drawn for case in entry.cases if case.drawn), {})
    rows += [("drawn by", ", ".join(drawn[part] for part in ("api", "renderer", "version") if part in drawn))]
    rows += [(name, _shown(name, value)) for name, value in _variables(failing).items()]
    lines = [f"| {table_cell(name)} | {table_cell(value)} |" for name, value in rows if value]
    yield "\n".join(["## Versions", "", "| what | version |", "| --- | --- |", *lines])


def _machine(facts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "OS", ", ".join(str(facts[name]) for name in ("os", "architecture", "libc") if facts.get(name))
    drawing = platforms.drawing(facts)
    yield "OpenGL", ", ".join(drawing[name] for name in ("vendor", "renderer", "version") if drawing.get(name))
    gpu = facts.get("gpu") or {}
    yield "GPU", ", ".join(str(gpu[name]) for name in ("models", "driver") if gpu.get(name)) or "none"


def _required_packages(failing: Failing) -> tuple[str, ...]:
    question = failing.cell.question
    return tuple(dict.fromkeys(map(required_name, (*question.requirements, *question.constraints))))


def _relevant_packages(failing: Failing) -> tuple[str, ...]:
    """Return the packages that were asked for, and those in the traceback or in the decisive line."""
    installed = failing.entry.installed or {}
    modules = {name.replace("-", "_"): name for name in installed}
    seen = [modules.get(top.lower(), "") for text in failing.texts.values() for top in TOP.findall(text)]
    named = re.findall(r"[A-Za-z][\w-]+", failing.entry.decisive or "")
    mentions = [str(canonicalize_name(name)) for name in named if canonicalize_name(name) in installed]
    return tuple(dict.fromkeys((*failing.cell.axes, *_required_packages(failing), *filter(None, seen), *mentions)))


def _variables(failing: Failing) -> dict[str, str]:
    """Return the variables of the cell, and the supplied ones that its packages read."""
    entry = failing.entry
    supplied = settings(entry.supplied, entry.installed or ())
    return {**dict(text.split("=", 1) for text in supplied), **entry.environment}


def _shown(name: str, value: str) -> str:
    return redacting.HIDDEN if redacting.secret(name) else value


# --- how to see it ---------------------------------------------------------------------------------------------


def _again(failing: Failing) -> Iterator[str]:
    """Yield the commands to reproduce it, with plain uv and Python; say so if nobody else can run them."""
    minor = ".".join((failing.entry.python or failing.entry.requested_python).split(".")[:2])
    lines = [f"uv venv --python {minor} repro", _install(failing)]
    commands = block("\n".join(lines), "sh")
    if failing.phase in {Phase.RESOLVE, Phase.INSTALL}:
        yield f"## To reproduce\n\n{commands}"
        return
    case, script = failing.case, None
    own = failing.cell.files or failing.cell.bring or failing.cell.subject or failing.entry.repairs
    if case and not own:
        script = reproducing.script(case, failing.phase, failing.check, failing.entry.installed or {})
    variables = _variables(failing)
    assignments = [
        f"{name}={shlex.quote(_shown(name, value))}" for name, value in variables.items() if name != "DISPLAY"
    ]
    # `DISPLAY` holds our own word (`machine.display`), which is no address of an X server.
    display = ["xvfb-run"] if variables.get("DISPLAY") == "virtual" else []
    if script is None:
        yield f"## To reproduce\n\n{commands}\n\n{NO_SCRIPT}"
        return
    lines.append(" ".join([*assignments, *display, "repro/bin/python repro.py"]))
    where = " the lock at the end of this report as `requirements.txt` and" if failing.lock else ""
    yield f"## To reproduce\n\nWith{where} this as `repro.py`:\n\n{block(script.rstrip(), 'python')}"
    yield block("\n".join(lines), "sh")


NO_SCRIPT = "No short script reproduces this failure: these lines only install the packages."


def _install(failing: Failing) -> str:
    if failing.lock:
        return "uv pip install --python repro --require-hashes -r requirements.txt"
    question = failing.cell.question
    # Without a lock, the index as it was at that instant is part of the failure.
    instant = question.snapshot or failing.instant
    words = ["uv", "pip", "install", "--python", "repro"]
    words += ["--exclude-newer", instant] if instant else []
    return shlex.join([*words, *question.requirements])


def _lock(failing: Failing) -> Iterator[str]:
    if failing.lock:
        count = failing.lock.count("==")
        yield (
            f"<details><summary>All {count} packages, pinned and hashed (requirements.txt)</summary>\n\n"
            f"{block(failing.lock.rstrip())}\n\n</details>"
        )
    else:
        question = failing.cell.question
        lines = [*question.requirements, *(f"{line}  # constraint" for line in question.constraints)]
        lines += [f"{line}  # override" for line in question.overrides]
        listed = block("\n".join(lines))
        yield f"Asked for:\n\n{listed}"


# --- evidence --------------------------------------------------------------------------------------------------


def excerpt(texts: Mapping[str, str], check: str, decisive: str | None) -> str:
    """Return the traceback of a check that ends in the decisive line, without our frames; else the log around it."""
    replies = [text for name, text in texts.items() if name.endswith(".jsonl")]
    tracebacks = [clean_traceback(text) for reply in replies for text in _tracebacks(reply, check)]
    kind = (decisive or "").partition(":")[0]
    telling = [text for text in tracebacks if kind and any(line.startswith(kind) for line in text.splitlines()[-4:])]
    if tracebacks:
        return (telling or tracebacks)[0]
    if (decisive or "").startswith(f"{check}: ") and check:
        return ""  # A finding of ours: the log has other things.
    logs = [text for name, text in texts.items() if not name.endswith(".jsonl")]
    return FOLDERS.sub(r"…/\1/", "\n".join(_around(logs, decisive or "")))


def _tracebacks(text: str, check: str) -> Iterator[str]:
    """Yield the tracebacks of a check from a reply; those of its workers come first."""
    for entry in plain_records(text):
        if entry.get("check", check) == check:
            workers = entry.get("workers")
            worker_records = (
                [worker for worker in workers if isinstance(worker, dict)] if isinstance(workers, list) else []
            )
            for record in (*worker_records, entry):
                raised, observed = record.get("raised"), in_words(record.get("observed"))
                if isinstance(raised, dict) and isinstance(raised.get("traceback"), str):
                    yield raised["traceback"]
                elif observed and record.get("outcome") == Outcome.FAILED:
                    yield f"{VIOLATION}: {observed}"


def clean_traceback(traceback: str) -> str:
    """Return a traceback with shortened paths, without our frames and the standard library's that they call."""
    lines, ours = [], False
    for line in traceback.splitlines():
        if line.lstrip().startswith('File "'):
            ours = bool(OURS.match(line)) or (ours and bool(LIBRARY.match(line)))
        # Source lines belong to the frame above them; the line of the error is indented less and always stays.
        elif not line.startswith("    "):
            ours = False
        if not ours:
            lines.append(FOLDERS.sub(r"…/\1/", line))
    return "\n".join(lines)


def _around(logs: Sequence[str], decisive: str) -> Sequence[str]:
    """Return the lines of a log around the decisive line, or its last ones."""
    # `packages.uv_command` turns on uv's DEBUG lines for our own use; upstream did not ask for them.
    lines = [line for text in logs for line in text.splitlines() if not line.startswith(("simmatrix:", "DEBUG "))]
    # A decisive line may join several lines of the log, or be cut, so only its beginning is looked for.
    place = next((n for n, line in reversed([*enumerate(lines)]) if decisive and decisive[:60] in line), len(lines))
    return lines[max(place - BEFORE, 0) : place + AFTER]
