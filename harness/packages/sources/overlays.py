"""Make the wheels of repaired releases, from the index's wheel or its sdist, for resolutions to find and lock.

They lie among the wheels that were built here, each in a folder of its own that a resolution is led to.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.machine import interpreters
from harness.machine.files.file_locks import exclusive
from harness.machine.store import cache_folder, digest, write_atomic
from harness.matrix import overlay_recipes
from harness.model import IndexSettings, Interpreter, Lock, Outcome, Phase, Pin, Question, Repair, Step, replace
from harness.model.errors import CouldNotTell
from harness.packages import index, locks, resolver, uv_command
from harness.packages.environments import environments
from harness.packages.sources import builds, wheel_patch
from harness.packages.step_failed import StepFailed


def resolve(question: Question, interpreter: Interpreter, folder: Path, *, offline: bool = False) -> Lock | Step:
    """Resolve as `resolver.resolve` does, with the repaired releases of the question to choose from."""
    try:
        led = _add_find_links(question, offline=offline)
    except StepFailed as failed:
        return failed.step
    return _dated(resolver.resolve(led, interpreter, folder, offline=offline), question)


def restore(
    requirements: str, question: Question, interpreter: Interpreter, folder: Path, *, offline: bool = False
) -> Lock | Step:
    """Restore as `resolver.restore` does, after making the repaired wheels that the lock holds."""
    hashes = [mark for _, marks in locks.read_pins(requirements).values() for mark in marks]
    overlay = overlay_recipes.select_by_hash(question.overlay, hashes)
    try:
        led = _add_find_links(replace(question, overlay=overlay), offline=offline)
    except StepFailed as failed:
        return failed.step
    return _dated(resolver.restore(requirements, led, interpreter, folder, offline=offline), question)


def provide_wheels(lock: Lock, question: Question, *, offline: bool = False) -> Lock:
    """Return the lock with its repaired wheels in their places, made anew if they are gone. Raises StepFailed."""
    replacements = {}
    pins = {pin.artifact.sha256: pin for pin in lock.pins if not Path(pin.artifact.source).is_file()}
    for repair in overlay_recipes.select_by_hash(question.overlay, pins):
        try:
            path = wheel(repair, question.index, offline=offline)
        except (index.UnknownPackage, StepFailed) as error:
            failed = error if isinstance(error, StepFailed) else _failed(repair, str(error))
            raise StepFailed(replace(failed.step, phase=Phase.INSTALL)) from None
        pin = pins[repair.wheel]
        replacements[pin.name] = replace(pin, artifact=replace(pin.artifact, source=str(path)))
    return replace(lock, pins=tuple(replacements.get(pin.name, pin) for pin in lock.pins)) if replacements else lock


def wheel(repair: Repair, settings: IndexSettings, *, offline: bool = False) -> Path:
    """Return the repaired wheel, made now or before.

    Raises StepFailed, which is never blamed on a package; index.UnknownPackage if no place has one of its name.
    """
    folder = _folder(repair)
    with exclusive(folder.with_name("requests") / f"{folder.name}.lock"):
        build = builds.load_wheel(folder.name)
        if build and build.sha256 == repair.wheel:
            return build.path
        name, content = _repair_wheel(repair, settings, offline=offline)
        write_atomic(folder / name, content)
        return folder / name


def _repair_wheel(repair: Repair, settings: IndexSettings, *, offline: bool) -> tuple[str, bytes]:
    """Return the file name and the content of the repaired wheel."""
    take = _fetched if repair.python is None else _built
    name, wheel, note = take(repair, settings, offline=offline)
    try:
        content = wheel_patch.repair_wheel(wheel, repair)
    except wheel_patch.Unrepairable as error:
        raise _failed(repair, str(error)) from None
    sha256 = wheel_patch.sha256(content)
    if sha256 != repair.wheel:
        raise _failed(repair, f"the SHA-256 is {sha256}{note}, and the recipe says {repair.wheel}")
    return name, content


def _fetched(repair: Repair, settings: IndexSettings, *, offline: bool) -> tuple[str, bytes, str]:
    """Return the file name and the content of the index's own wheel."""
    try:
        artifact = index.find(repair.name, repair.origin, settings, offline=offline)
        with uv_command.scratch() as folder:
            content = index.fetch(artifact, folder, settings, offline=offline).read_bytes()
    except CouldNotTell as error:
        raise _failed(repair, str(error)) from None
    return artifact.filename, content, ""


def _built(repair: Repair, settings: IndexSettings, *, offline: bool) -> tuple[str, bytes, str]:
    """Return the file name and the content of the wheel built from the index's sdist, and which Python built it."""
    builder = _builder(repair)
    if builder is None:
        reason = f"its repaired wheel is built by a Python {repair.python}, and there is none here"
        raise _failed(repair, reason, Outcome.UNAVAILABLE)
    # Without a cutoff: the recipe pins everything that the sdist is built with.
    question = Question(requirements=(), build_constraints=repair.build, index=settings)
    try:
        artifact = index.find(repair.name, repair.origin, settings, offline=offline)
    except CouldNotTell as error:
        raise _failed(repair, str(error)) from None
    pin = Pin(name=repair.name, version=repair.version, artifact=artifact, hashes=(repair.origin,))

    try:
        built = builds.build(pin, builder, question, environments.ensure, offline=offline)
    except StepFailed as failed:
        raise _failed(repair, failed.step.decisive or "its build failed", log=failed.step.log) from None
    return built.path.name, built.path.read_bytes(), f" (built by Python {builder.version})"


def _failed(repair: Repair, reason: str, outcome: Outcome = Outcome.INFRA, log: str | None = None) -> StepFailed:
    decisive = f"{repair.name} {repair.version} could not be repaired: {reason}"
    return StepFailed(Step(phase=Phase.RESOLVE, outcome=outcome, decisive=decisive, log=log))


def _builder(repair: Repair) -> Interpreter | None:
    """Return the newest CPython here that can build the release; None if there is none."""
    allowed = SpecifierSet(repair.python or "")
    candidates = [
        one
        for one in interpreters.available()
        if allowed.contains(one.version) and one.implementation.partition("+")[0] == "cpython"
    ]
    return max(candidates, key=lambda interpreter: Version(interpreter.version), default=None)


def _add_find_links(question: Question, *, offline: bool) -> Question:
    """Return the question with the folders of its repaired wheels among its find-links. Raises StepFailed."""
    links = []
    for repair in overlay_recipes.select(question.overlay, question):
        try:
            path = wheel(repair, question.index, offline=offline)
        except index.UnknownPackage:
            continue  # a resolution cannot come to it: `try --overlay` offers all that there are
        links.append(str(path.parent))
    settings = msgspec.structs.replace(question.index, find_links=(*links, *question.index.find_links))
    return replace(question, index=settings, overlay=()) if links else question


def _dated(answer: Lock | Step, question: Question) -> Lock | Step:
    """Return the lock with repaired wheels as old as their originals, so that they did not escape the cutoff."""
    if isinstance(answer, Step) or not question.overlay:
        return answer
    repairs = {repair.wheel: repair for repair in question.overlay}
    return locks.assemble((_as_made(pin, repairs) for pin in answer.pins), answer.instant)


def _as_made(pin: Pin, repairs: Mapping[str, Repair]) -> Pin:
    """Return a pin of the repaired wheel alone if its hash is allowed; the index may have another or a namesake."""
    repair = next((repairs[mark] for mark in pin.hashes if mark in repairs), None)
    if repair is None:
        return pin
    source = str(_folder(repair) / pin.artifact.filename)
    artifact = replace(pin.artifact, sha256=repair.wheel, source=source, size=None, uploaded=repair.uploaded)
    return replace(pin, artifact=artifact, hashes=(repair.wheel,))


def _folder(repair: Repair) -> Path:
    """Return the folder that holds the repaired wheel and nothing else."""
    return cache_folder() / "wheels" / digest("overlay", repair.wheel)
