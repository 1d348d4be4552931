"""Keep probe runs by content and find them again by what they answer. Nothing that was kept is ever altered.

`cas/<sha256>` holds each file, and each run as JSON, under the hash of its content; `ac/<key>` names the runs that
answer a key, one in a line, in the order in which they were made. The two folders can lie on a web server or in an
object store as they are.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import msgspec
from msgspec import Struct

from harness.machine import process
from harness.machine.files import guarded_files
from harness.machine.store import write_atomic, write_changed
from harness.model import decoding
from harness.model.errors import CouldNotTell
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.probes.evidence import ARRAYS, PICTURE, ProbeRun, Reading, folder_of

MOST_RUN, MOST_CLAIM, MOST_FILE = 4 << 20, 4 << 20, 64 << 20
"""Bytes that are read of a run, of the names of the runs of a key, and of a file that a run left."""

RUN = re.compile(rb"[0-9a-f]{64}")
APPEND = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW
# People open the files of a run by hard links: a write there would damage what the vault keeps.
READ_ONLY = 0o444


class Vault(Struct, frozen=True):
    """Hold the probe runs below the folder of a state."""

    state: Path

    @property
    def folder(self) -> Path:
        """Return the folder of contents and claims."""
        return self.state / "vault"

    def keep(self, content: bytes) -> str:
        """Keep a content and return its name, the SHA-256."""
        name = hashlib.sha256(content).hexdigest()
        write_changed(self._content(name), content, mode=READ_ONLY)
        return name

    def put(self, run: ProbeRun, key: str) -> str:
        """Keep a run as an answer to a key, and return its name.

        Raises CouldNotTell for a run that the user's own stop ended: it says nothing, and nobody may reuse it.
        """
        if run.end.killed == process.INTERRUPTED:
            raise CouldNotTell(process.INTERRUPTED)
        name = self.keep(msgspec.json.encode(run, order="deterministic"))
        self._lay(name, run)
        # The key comes last: a kill before it leaves a run that nobody asks for, never a key without its run.
        path = self._claim(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, APPEND, 0o644)
        try:
            # This is one write to the end of the file, so lines of several processes do not mix.
            os.write(descriptor, f"{name}\n".encode())
        finally:
            os.close(descriptor)
        return name

    def runs(self, key: str) -> tuple[str, ...]:
        """Return the names of the runs that answer a key, the first one first."""
        try:
            content = guarded_files.head(self._claim(key), MOST_CLAIM)
        except Unreadable:
            return ()
        return tuple(dict.fromkeys(line.decode() for line in content.splitlines() if RUN.fullmatch(line)))

    def readings(self, names: Iterable[str]) -> Iterator[Reading]:
        """Yield these runs with what they left, those left out that cannot be read any more."""
        for name in names:
            with suppress(Unreadable):
                yield self.reading(name)

    def reading(self, name: str) -> Reading:
        """Return a run with the texts that it left. Raises Unreadable where anything of it is gone or damaged."""
        run = self._run(name)
        names = [file for file in run.files if not file.endswith((PICTURE, ARRAYS))]
        return Reading(name, run, {file: self.content(run.files[file], MOST_FILE) for file in names})

    def files(self, name: str) -> Mapping[str, str]:
        """Return the files of a run: each name with the SHA-256 of its content. Raises Unreadable."""
        return self._run(name).files

    def content(self, name: str, most: int) -> bytes:
        """Return the content kept under a name. Raises Unreadable, also if it was damaged."""
        content = guarded_files.read(self._content(name), most)
        if hashlib.sha256(content).hexdigest() != name:
            message = f"the content of {name} was damaged"
            raise Unreadable(message)
        return content

    def contents(self, name: str) -> dict[str, bytes]:
        """Return a run and the texts that it left, by the hashes of their content. Raises Unreadable."""
        run = self._run(name)
        texts = [sha for file, sha in run.files.items() if not file.endswith((PICTURE, ARRAYS))]
        return {sha: self.content(sha, MOST_FILE) for sha in (name, *texts)}

    def arrays(self, name: str) -> list[str]:
        """Return the hashes of the files of arrays of a run. Raises Unreadable."""
        return [sha for file, sha in sorted(self.files(name).items()) if file.endswith(ARRAYS)]

    def show(self, name: str) -> None:
        """Lay the files of a run side by side under their own names, for people. Raises Unreadable."""
        self._lay(name, self._run(name))

    def _run(self, name: str) -> ProbeRun:
        content = self.content(name, MOST_RUN)
        with raise_unreadable():
            return decoding.decoder(ProbeRun).decode(content)

    def _lay(self, name: str, run: ProbeRun) -> None:
        folder = self.state / folder_of(name)
        folder.mkdir(parents=True, exist_ok=True)
        for file, sha in run.files.items():
            self._link(self._content(sha), folder / file)

    def _link(self, content: Path, path: Path) -> None:
        try:
            path.hardlink_to(content)
        except FileExistsError:
            return
        except FileNotFoundError:  # a picture that lies elsewhere
            return
        except OSError:  # a file system without links
            write_atomic(path, content.read_bytes())

    def _content(self, name: str) -> Path:
        return self.folder / "cas" / name[:2] / name[2:]

    def _claim(self, key: str) -> Path:
        return self.folder / "ac" / key[:2] / key[2:]


def keep_files(vault: Vault, texts: Mapping[str, bytes]) -> dict[str, str]:
    """Keep the files of a run and return their names by content."""
    return {name: vault.keep(content) for name, content in sorted(texts.items())}
