"""Copy software that the user supplies because no index has it: a vendor's archive, a research project's checkout.

A cell gets a clean copy, kept in the cache by what it holds: the user's own folder is never written to.
"""

from __future__ import annotations

import os
import shutil
import tarfile
import tempfile
from pathlib import Path

from msgspec import Struct

from harness.machine.files.file_locks import exclusive, mark_used
from harness.machine.store import cache_folder, digest
from harness.model import Bring, Brought
from harness.model.errors import BadInput
from harness.packages.sources import checkouts

WHOLE = "copied"
"""The name of the copy in its folder: it is renamed to it once it is whole."""


class Source(Struct, frozen=True, kw_only=True):
    """Software that the user supplies: the entry that asks for it, its place, and its present state."""

    bring: Bring
    source: str
    fingerprint: Brought


def absent(bring: Bring) -> str | None:
    """Say what to do if the user supplied nothing, in a sentence; None if something was supplied."""
    if _source(bring):
        return None
    return f"{bring.name} is not here, and {bring.variable} names no place of it: {bring.say}"


def inspect_source(bring: Bring, *, offline: bool = False) -> Source:
    """Return the supplied software in its present state. Raises BadInput if nothing lies at the named place."""
    source = _source(bring)
    state = checkouts.state_of(source, offline=offline)
    if state is None:
        message = f"{bring.variable}: {source} is neither a folder nor an archive; {bring.say}"
        raise BadInput(message)
    fingerprint = Brought(name=bring.name, mark=state.mark, commit=state.commit, changed=state.changed)
    return Source(bring=bring, source=source, fingerprint=fingerprint)


def copy_source(source: Source) -> Path:
    """Return the folder of the copy for cells, made now or before. Raises BadInput for a file that is no archive."""
    folder = cache_folder() / "brought" / digest("brought", source.fingerprint.mark)
    mark_used(folder)
    with exclusive(folder.with_suffix(".lock")):
        remembered = folder / WHOLE
        if not remembered.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            making = Path(tempfile.mkdtemp(dir=folder))
            place = _copy(source, making / "tree")
            # The project may lie below the tree, so a link remembers where; it is relative, since `making` is renamed.
            (making / "place").symlink_to(place.relative_to(making))
            making.rename(remembered)
        return (remembered / "place").resolve()


def python_path(source: Source, copy: Path) -> tuple[str, ...]:
    """Return the folders of a copy that modules are imported from; missing ones are left out."""
    places = (copy / folder for folder in source.bring.python_path)
    return tuple(str(place) for place in places if place.is_dir())


def _source(bring: Bring) -> str:
    return os.environ.get(bring.variable, "") or bring.source or ""


def _copy(source: Source, target: Path) -> Path:
    if source.source.startswith(checkouts.REPOSITORY):
        return checkouts.copy_commit(source.source, source.fingerprint.commit or "", target)
    path = Path(source.source)
    if path.is_dir():
        return checkouts.copy_folder(path, target)
    try:
        if tarfile.is_tarfile(path):
            with tarfile.open(path) as archive:
                archive.extractall(target, filter="data")
        else:
            shutil.unpack_archive(path, target)
    except (shutil.ReadError, tarfile.TarError, OSError) as error:
        message = f"{source.bring.variable}: {path.name} cannot be unpacked: {error}"
        raise BadInput(message) from None
    return target
