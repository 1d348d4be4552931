"""Faults of wheels and sdists: what their packages get wrong is told as theirs, and nothing of it gets out."""

from __future__ import annotations

import gzip
import io
import tarfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import wheelhouse

from benchmarks.faults import Desk, FaultResult, fault

SECTION = "wheels and builds"
INFO = "odd-1.0.dist-info"
ODD = """
requirements = []
index = {{ no_index = true, find_links = ["{shelf}"] }}
[axes]
python = ["host"]
[axes.which.odd]
requirements = ["odd"]
cases = [{{ id = "odd", imports = ["odd"], checks = ["import"] }}]
"""
Entries = dict[str, bytes]
UNINSTALLABLE = frozenset({"uninstallable"})
IMPORTED = frozenset({"not_run"})
"""Only the import is tried: that is no verdict, but an import that fails is one."""

Change = Callable[[Entries], Entries]


def measure_odd(desk: Desk, verdicts: frozenset[str], says: str = "") -> FaultResult:
    """Measure the odd package; its line has to say so much."""
    matrix = desk.matrix("m", ODD.format(shelf=desk.shelf))
    return desk.check_verdicts(desk.measure(matrix), odd=set(verdicts), says=says)


def changed(desk: Desk, change: Change) -> Path:
    """Put a wheel on the shelf whose files are changed; its RECORD stays."""
    wheel = desk.shelve({"odd.py": "VALUE = 1\n"}, name="odd")
    with zipfile.ZipFile(wheel) as archive:
        entries = change({name: archive.read(name) for name in archive.namelist()})
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(zipfile.ZipInfo(name, wheelhouse.EPOCH), content, zipfile.ZIP_DEFLATED)
    return wheel


def info(**files: bytes) -> Change:
    """Replace files of the metadata."""
    return lambda entries: entries | {f"{INFO}/{name.replace('_txt', '.txt')}": text for name, text in files.items()}


def without(name: str) -> Change:
    """Leave a file of the metadata out."""
    return lambda entries: {path: text for path, text in entries.items() if path != f"{INFO}/{name}"}


def also(**files: bytes) -> Change:
    """Add files by path; two underscores stand for a slash."""
    return lambda entries: entries | {name.replace("__", "/"): text for name, text in files.items()}


def sdist(desk: Desk, *members: tuple[str, bytes, Mapping[str, Any]]) -> None:
    """Put an sdist on the shelf that has these members beside a backend."""
    backend = b'[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'
    every: list[tuple[str, bytes, Mapping[str, Any]]] = [
        ("odd-1.0/pyproject.toml", backend, {}),
        ("odd-1.0/backend.py", b"", {}),
        ("odd-1.0/PKG-INFO", b"Metadata-Version: 2.2\nName: odd\nVersion: 1.0\n", {}),
        *members,
    ]
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w") as archive:
        for name, content, settings in every:
            member = tarfile.TarInfo(name)
            member.size = len(content)
            for key, value in settings.items():
                setattr(member, key, value)
            archive.addfile(member, io.BytesIO(content))
    (desk.shelf / "odd-1.0.tar.gz").write_bytes(gzip.compress(raw.getvalue()))


def metadata(*lines: str, name: str = "odd", version: str = "1.0") -> bytes:
    """Write METADATA."""
    return "\n".join(["Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}", *lines, ""]).encode()


WHEELS: dict[str, tuple[str, str, Change, frozenset[str], str]] = {
    "record-odd": ("83a", "RECORD is nonsense", info(RECORD=b'nonsense\n,,,,\n"\n'), UNINSTALLABLE, "`RECORD` file"),
    "record-bytes": ("83b", "RECORD is no UTF-8", info(RECORD=b"\xff\xfe\x00,a,b\n"), UNINSTALLABLE, "`RECORD` file"),
    "record-none": ("83c", "there is no RECORD", without("RECORD"), UNINSTALLABLE, "RECORD`: No such file"),
    "record-empty": ("83d", "RECORD is empty", info(RECORD=b""), IMPORTED, ""),
    "record-long": (
        "83e",
        "RECORD has 400,000 lines of files that are not there",
        info(RECORD=b"".join(b"odd/%d.py,,\n" % number for number in range(400_000))),
        IMPORTED | UNINSTALLABLE,
        "",
    ),
    "second-info": (
        "85a",
        "it has a second dist-info",
        lambda entries: entries | {"more-1.0.dist-info/METADATA": metadata(name="more")},
        UNINSTALLABLE,
        "Multiple .dist-info",
    ),
    "no-info": ("85b", "it has no dist-info", lambda _: {"odd.py": b""}, UNINSTALLABLE, "Missing .dist-info"),
    "url": (
        "85c",
        "it requires an address",
        info(METADATA=metadata("Requires-Dist: other @ https://example.invalid/other-1.0-py3-none-any.whl")),
        frozenset({"unresolvable"}),
        "URL dependency",
    ),
    "wheel-9": (
        "85d",
        "its Wheel-Version is 9",
        info(WHEEL=b"Wheel-Version: 9.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"),
        UNINSTALLABLE,
        "got 9",
    ),
    "no-wheel": ("85e", "there is no WHEEL", without("WHEEL"), UNINSTALLABLE, "WHEEL"),
    "control": (
        "85f",
        "names of files have control characters",
        lambda entries: entries | {"od\x01d\n.py": b""},
        UNINSTALLABLE,
        "unacceptable filename",
    ),
    "other-name": (
        "85g",
        "METADATA names another package",
        info(METADATA=metadata(name="other")),
        UNINSTALLABLE | {"inconclusive"},
        "other",
    ),
    "other-version": (
        "85h",
        "METADATA names another version",
        info(METADATA=metadata(version="2.0")),
        UNINSTALLABLE,
        "2.0",
    ),
    "bad-requirement": (
        "85i",
        "a requirement cannot be read",
        info(METADATA=metadata("Requires-Dist: x >=> 1")),
        frozenset({"uninstallable", "unresolvable"}),
        "",
    ),
    "entry-points": (
        "82",
        "entry points are no INI",
        info(entry_points_txt=b"[[[no ini\n=\n"),
        UNINSTALLABLE,
        "entry_points",
    ),
    "traverse": (
        "78a",
        "names of files go up and out",
        lambda entries: entries | {"../../evil.py": b"", "/tmp/evil.py": b""},
        IMPORTED | UNINSTALLABLE,
        "",
    ),
    "configuration": (
        "86",
        "it replaces pyvenv.cfg and lets in the system's packages",
        also(**{"odd-1.0.data__data__pyvenv.cfg": b"include-system-site-packages = true\nhome = /usr/bin\n"}),
        UNINSTALLABLE,
        "pyvenv.cfg",
    ),
    "python": (
        "86b",
        "it brings a bin/python of its own",
        also(**{"odd-1.0.data__data__bin__python": b"#!/bin/sh\nexit 0\n"}),
        UNINSTALLABLE,
        "python",
    ),
    "exits": (
        "80a",
        "a .pth file ends Python whenever it starts",
        also(**{"odd.pth": b"import os; os._exit(0)\n"}),
        frozenset({"import_fails"}),
        "Python does not start with what is installed",
    ),
    "sitecustomize": (
        "80b",
        "sitecustomize ends Python with a word",
        also(**{"sitecustomize.py": b"raise SystemExit('a site of odd')\n"}),
        frozenset({"import_fails"}),
        "a site of odd",
    ),
    "no-json": (
        "80c",
        "a .pth file forbids the import of json",
        also(**{"odd.pth": b"import sys; sys.modules['json'] = None\n"}),
        frozenset({"import_fails"}),
        "import of json halted",
    ),
    "aborts": (
        "80d",
        "a .pth file aborts Python",
        also(**{"odd.pth": b"import os; os.abort()\n"}),
        frozenset({"import_fails"}),
        "SIGABRT",
    ),
    "runs": (
        "79",
        "a .pth file runs code that does no harm",
        also(**{"odd.pth": b"import os; os.getcwd()\n"}),
        IMPORTED,
        "",
    ),
    "standard": (
        "81",
        "it has modules named like those of the standard library and of the harness",
        also(
            **{
                "json.py": b"raise SystemExit",
                "typing.py": b"raise SystemExit",
                "cell_run.py": b"raise SystemExit",
                "_simmatrix_cell__x.py": b"",
            }
        ),
        IMPORTED,
        "",
    ),
}
"""Name: row, what is wrong with the wheel, how it is made, its verdicts, and what its line has to say."""

MEMBERS: dict[str, tuple[str, str, tuple[str, bytes, Mapping[str, Any]], str]] = {
    "up": ("78b", "a member goes up and out", ("odd-1.0/../../evil", b"x", {}), "parent-directory"),
    "absolute": ("78c", "a member has an absolute name", ("/tmp/evil", b"x", {}), "absolute"),
    "link-out": (
        "78d",
        "a link leads out",
        ("odd-1.0/l", b"", {"type": tarfile.SYMTYPE, "linkname": "../../../etc/passwd"}),
        "symbolic-link",
    ),
    "hard-out": (
        "78e",
        "a hard link leads out",
        ("odd-1.0/h", b"", {"type": tarfile.LNKTYPE, "linkname": "/etc/passwd"}),
        "hard-link",
    ),
    "device": (
        "78f",
        "a member is a device",
        ("odd-1.0/d", b"", {"type": tarfile.CHRTYPE, "devmajor": 1, "devminor": 5}),
        "CharacterDevice",
    ),
    "fifo": ("78g", "a member is a FIFO", ("odd-1.0/f", b"", {"type": tarfile.FIFOTYPE}), "Fifo"),
}
"""Name: row, what is wrong with the sdist, the member that it has besides, and what its line has to say."""


def declare() -> None:
    """Declare a fault for each wheel and each sdist of the tables."""
    for name, (row, done, change, verdicts, says) in WHEELS.items():

        def wheel(
            desk: Desk, change: Change = change, verdicts: frozenset[str] = verdicts, says: str = says
        ) -> FaultResult:
            """Install a wheel of the table."""
            changed(desk, change)
            return measure_odd(desk, verdicts, says)

        wheel.__name__ = f"wheel_{name}"
        fault(
            row,
            section=SECTION,
            done=f"a wheel: {done}",
            promise=f"its cell is {' or '.join(sorted(verdicts)).replace('not_run', 'imported')}",
        )(wheel)
    for name, (row, done, member, says) in MEMBERS.items():

        def source(desk: Desk, member: tuple[str, bytes, Mapping[str, Any]] = member, says: str = says) -> FaultResult:
            """Build an sdist of the table."""
            sdist(desk, member)
            return measure_odd(desk, UNINSTALLABLE, says)

        source.__name__ = f"sdist_{name}"
        fault(row, section=SECTION, done=f"an sdist: {done}", promise="its cell is uninstallable")(source)


declare()


@fault(
    "85j",
    section=SECTION,
    done="a wheel is cut in half, then garbage, then a login page",
    promise="inconclusive: nobody's fault",
    limit=200,
)
def broken_archive(desk: Desk) -> FaultResult:
    """Serve what is no wheel."""
    wheel = desk.shelve({"odd.py": ""}, name="odd")
    whole = wheel.read_bytes()
    came = []
    for content in (whole[: len(whole) // 2], b"\xff" * 3000, b"<html>log in</html>"):
        wheel.write_bytes(content)
        came.append(measure_odd(desk, frozenset({"inconclusive"})))
    return FaultResult("; ".join(one.what for one in came), all(one.held for one in came))


@fault("78h", section=SECTION, done="an sdist has nothing to build at its top", promise="its cell is uninstallable")
def empty_sdist(desk: Desk) -> FaultResult:
    """Leave out what makes a project one."""
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("odd-1.0/README"), io.BytesIO())
    (desk.shelf / "odd-1.0.tar.gz").write_bytes(gzip.compress(raw.getvalue()))
    return measure_odd(desk, UNINSTALLABLE, "does not appear to be a Python project")


def building(desk: Desk, *deed: str) -> None:
    """Put an sdist on the shelf whose build does a deed first."""
    lines = ["def files(found):", *(f"    {line}" for line in deed), "    return found", ""]
    about = {"name": "odd", "hooks": "\n".join(lines), "static": True}
    wheelhouse.sdist(desk.shelf, "1.0", {"odd.py": ""}, about)


@fault(
    "89c",
    section=SECTION,
    done="a build aborts itself",
    promise="uninstallable, and the line says how it died",
    limit=200,
)
def aborting_build(desk: Desk) -> FaultResult:
    """End the build by a signal of its own."""
    building(desk, "import os", "os.abort()")
    return measure_odd(desk, UNINSTALLABLE, "killed by SIGABRT")


@fault(
    "90",
    section=SECTION,
    done="a build writes into the wheel store, the cache and the state",
    promise="nothing of it is there afterwards",
    limit=200,
)
def writing_build(desk: Desk) -> FaultResult:
    """Write wherever the harness keeps something, from a build."""
    places = [str(desk.cache), str(desk.cache / "wheels"), str(desk.cache / "uv"), str(desk.state)]
    writing = ("try: open(place + '/hx_pwned', 'w').close()", "except OSError: print('refused', place)")
    building(desk, f"for place in {places}:", *(f"    {line}" for line in writing))
    came = measure_odd(desk, IMPORTED)
    left = [path for folder in (desk.cache, desk.state) for path in folder.rglob("hx_pwned")]
    return FaultResult(f"{came.what}; left behind: {len(left)} files", came.held and not left)


@fault(
    "88",
    section=SECTION,
    done="a small wheel unpacks to 600 MB of zeros",
    promise="it works, or its line says what is too large",
    limit=200,
)
def bomb(desk: Desk) -> FaultResult:
    """Install a file of zeros."""
    changed(desk, lambda entries: entries | {"zeros": bytes(600 << 20)})
    return measure_odd(desk, IMPORTED | {"uninstallable", "inconclusive"})
