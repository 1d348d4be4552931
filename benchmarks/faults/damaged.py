"""Faults of files that the harness kept itself: damaged by a disk, an editor or another program since."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.faults import Desk, FaultResult, fault

DISKS = "disks and damaged files"
QUICK = ("import", "single")
PYTHON = "{}.{}".format(*sys.version_info)
"""Looked for among all Pythons of the machine, unlike `host`."""
WORKS = {"hx": {"works"}, "neighbour": {"works"}}


def empty(path: Path) -> None:
    """Truncate it."""
    path.write_bytes(b"")


def garbage(path: Path) -> None:
    """Write bytes that are no text."""
    path.write_bytes(b"\xff\xfe\x80\x00garbage" * 50)


def half(path: Path) -> None:
    """Keep the first half."""
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def deep(path: Path) -> None:
    """Nest it without end."""
    path.write_bytes(b"[" * 100_000)


def other(path: Path) -> None:
    """Write JSON of another shape."""
    path.write_bytes(b'{"a": [1, {"b": null}], "Name": 3}')


def gone(path: Path) -> None:
    """Remove it."""
    path.unlink()


def folder(path: Path) -> None:
    """Put a folder in its place."""
    path.unlink()
    path.mkdir()


def loop(path: Path) -> None:
    """Put a link to itself in its place."""
    path.unlink()
    path.symlink_to(path.name)


def fifo(path: Path) -> None:
    """Put a FIFO in its place."""
    path.unlink()
    os.mkfifo(path)


def zero(path: Path) -> None:
    """Put a link to /dev/zero in its place."""
    path.unlink()
    path.symlink_to("/dev/zero")


def sparse(path: Path) -> None:
    """Put a file of 200 GB in its place, which takes no room."""
    path.unlink()
    with path.open("wb") as file:
        file.truncate(200 << 30)


def long_field(path: Path) -> None:
    """Write a field that no reader of CSV takes."""
    path.write_text('"' + "x" * 200_000 + '",sha256=a,1\n', encoding="utf-8")


DEEDS = (empty, garbage, half, deep, other, gone, folder, loop, fifo, zero, sparse)
Find = Callable[[Desk], list[Path]]


def inside(pattern: str) -> Find:
    """Return a function that finds files below the cache."""
    return lambda desk: sorted(desk.cache.glob(pattern))


def stored(pattern: str) -> Find:
    """Return a function that finds files below the state."""
    return lambda desk: sorted(desk.state.glob(pattern))


METADATA = "environments/*/lib/*/site-packages/hx-*.dist-info/METADATA"
RECORD = "environments/*/lib/*/site-packages/hx-*.dist-info/RECORD"
HEALS: dict[str, tuple[str, Find, tuple[Callable[[Path], None], ...], str]] = {
    "25": ("METADATA of an installed package", inside(METADATA), DEEDS, "--fresh"),
    "26": ("RECORD of an installed package", inside(RECORD), (*DEEDS, long_field), "--fresh --verify"),
    "27": ("stamp.json of an environment", inside("environments/*/stamp.json"), DEEDS, "--fresh"),
    "30c": (
        "the instant of a matrix without a snapshot",
        stored("instants/m"),
        (garbage, deep, other, empty, fifo),
        "",
    ),
    "30f1": ("a stored lock", stored("locks/*/*.json"), (garbage, half, deep, fifo, other), ""),
    "30f2": ("stored results", stored("results/*/*.json"), (garbage, half, deep, other, fifo), ""),
    "30f3": ("what an install came to", stored("installed/*/*.json"), (garbage, half, deep, other, fifo), ""),
    "30f4": ("records of cells", stored("cells/*/*/*.json"), (garbage, half, deep, other, fifo), ""),
    "30g": ("the report", stored("reports/m/report.json"), (garbage, half, deep, other, empty, fifo), ""),
    "30h": ("the facts of interpreters", inside("interpreters.json"), (garbage, deep, other, fifo), "--fresh"),
    "30i": ("the facts of the machine", inside("machine.json"), (garbage, deep, other, fifo), "--fresh"),
    "30j": ("the list of Pythons", inside("candidates.json"), (garbage, deep, other, fifo), "--fresh"),
}
"""What is damaged, by whom, and the option with which it is read again."""


def declare(row: str, what: str, find: Find, deeds: tuple[Callable[[Path], None], ...], option: str) -> None:
    """Declare the faults of one kind of file: each deed is done, and the run that follows heals it."""

    def do(desk: Desk) -> FaultResult:
        matrix = desk.hostile(checks=QUICK)
        matrix.write_text(matrix.read_text().replace('"host"', f'"{PYTHON}"'))
        first = desk.check_verdicts(desk.measure(matrix), **WORKS)
        parts, held = [f"first {first.what}"], first.held
        for deed in deeds:
            paths = [path for path in find(desk) if path.is_file() and not path.is_symlink()]
            for path in paths:
                deed(path)
            ran = desk.measure(matrix, *option.split())
            came = desk.check_verdicts(ran, code={0}, **WORKS)
            parts.append(f"{deed.__name__} ({len(paths)}): {'works' if came.held else came.what}")
            held = held and came.held and bool(paths)
            if not held:
                break
        return FaultResult("; ".join(parts), held)

    do.__name__ = f"damaged_{row}"
    fault(
        row,
        section=DISKS,
        done=f"{what} becomes {', '.join(deed.__name__ for deed in deeds)} in turn",
        promise="each run ends with 0 and the same verdicts",
        limit=600,
    )(do)


for _row, _entry in HEALS.items():
    declare(_row, *_entry)


# --- wheels that were built here -----------------------------------------------------------------------------------

BACKEND = """
import os, zipfile
def get_requires_for_build_wheel(config_settings=None):
    return []
def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    deed()
    name = 'own_build-1.0-py3-none-any.whl'
    with zipfile.ZipFile(os.path.join(wheel_directory, name), 'w') as file:
        info = 'own_build-1.0.dist-info/'
        file.writestr('own_build.py', '')
        file.writestr(info + 'METADATA', 'Metadata-Version: 2.1\\nName: own-build\\nVersion: 1.0\\n')
        file.writestr(info + 'WHEEL', 'Wheel-Version: 1.0\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n')
        file.writestr(info + 'RECORD', 'own_build.py,,\\n' + ''.join(info + n + ',,\\n' for n in
                      ('METADATA', 'WHEEL', 'RECORD')))
    return name
"""


def built(desk: Desk, deed: str = "pass") -> Path:
    """Make a matrix whose cells need a package that is built from an sdist; the build does a deed."""
    import io  # noqa: PLC0415 - one function of many
    import tarfile  # noqa: PLC0415

    files = {
        "pyproject.toml": '[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'
        '[project]\nname = "own-build"\nversion = "1.0"\n',
        "backend.py": BACKEND + "def deed():\n" + "\n".join(f"    {line}" for line in deed.strip().splitlines()) + "\n",
        "PKG-INFO": "Metadata-Version: 2.1\nName: own-build\nVersion: 1.0\n",
    }
    with tarfile.open(desk.shelf / "own_build-1.0.tar.gz", "w:gz") as archive:
        for inner, text in files.items():
            about = tarfile.TarInfo(f"own_build-1.0/{inner}")
            about.size = len(text.encode())
            archive.addfile(about, io.BytesIO(text.encode()))
    matrix = desk.hostile(checks=QUICK)
    text = matrix.read_text(encoding="utf-8").replace('"fake-healthy"]', '"fake-healthy", "own-build"]', 1)
    matrix.write_text(text, encoding="utf-8")
    return matrix


def rebuilt(desk: Desk, pattern: str, deeds: tuple[Callable[[Path], None], ...]) -> FaultResult:
    """Damage what is kept of a build, take the environments away, and run again."""
    matrix = built(desk)
    first = desk.check_verdicts(desk.measure(matrix), **WORKS)
    parts, held = [f"first {first.what}"], first.held
    for deed in deeds:
        paths = sorted(desk.cache.glob(pattern))
        for path in paths:
            deed(path)
        shutil.rmtree(desk.cache / "environments")
        came = desk.check_verdicts(desk.measure(matrix, "--fresh"), code={0}, **WORKS)
        parts.append(f"{deed.__name__} ({len(paths)}): {'works' if came.held else came.what}")
        held = held and came.held and bool(paths)
    return FaultResult("; ".join(parts), held)


def flip(path: Path) -> None:
    """Change one byte in the middle."""
    content = bytearray(path.read_bytes())
    content[len(content) // 4] ^= 0xFF
    path.write_bytes(bytes(content))


@fault(
    "30a",
    section=DISKS,
    done="a wheel that was built here becomes half, garbage, empty, a FIFO, a link, changed by one byte",
    promise="it is built again, all cells work",
    limit=400,
)
def damaged_wheel(desk: Desk) -> FaultResult:
    """Damage the store of wheels."""
    return rebuilt(desk, "wheels/*/*.whl", (half, garbage, empty, fifo, zero, flip))


@fault(
    "30b",
    section=DISKS,
    done="the key that a build's request led to becomes garbage, too long, nested, a FIFO, a path",
    promise="it is built again, all cells work",
    limit=400,
)
def damaged_request(desk: Desk) -> FaultResult:
    """Damage what leads to the store of wheels."""

    def long(path: Path) -> None:
        path.write_text("a" * 5000, encoding="ascii")

    def path_out(path: Path) -> None:
        path.write_text("../../../../etc", encoding="ascii")

    return rebuilt(desk, "wheels/requests/*.txt", (garbage, long, path_out, deep, fifo))


@fault(
    "47d",
    section="wheels and builds",
    done="a build leaves 3,000 nested folders and an unreadable one",
    promise="the wheel is built and the folders are gone",
)
def deep_build(desk: Desk) -> FaultResult:
    """Nest folders in the scratch folder of a build."""
    deed = """
here = os.getcwd()
os.chdir(os.environ['TMPDIR'])
os.makedirs('locked/inner', mode=0o700)
os.chmod('locked', 0)
for _ in range(3000):
    os.mkdir('d')
    os.chdir('d')
os.chdir(here)
"""
    came = desk.check_verdicts(desk.measure(built(desk, deed)), **WORKS)
    place = desk.cache / "tmp"
    left = sorted(path.name for path in place.iterdir()) if place.exists() else []
    return FaultResult(f"{came.what}; left: {left}", came.held and not left)


@fault(
    "84",
    section="wheels and builds",
    done="METADATA of a wheel is Latin-1, not UTF-8",
    promise="its cell and the neighbour are measured, no run is lost",
)
def latin_metadata(desk: Desk) -> FaultResult:
    """Make a wheel as setuptools of 2012 did."""
    import zipfile  # noqa: PLC0415 - one function of many

    matrix = desk.hostile(checks=QUICK)
    (wheel,) = desk.shelf.glob("hx-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        files = {info.filename: archive.read(info) for info in archive.infolist()}
    (about,) = (name for name in files if name.endswith("METADATA"))
    (record,) = (name for name in files if name.endswith("RECORD"))
    files[about] = files[about].rstrip() + b"\nAuthor: Andr\xe9 M\xfcller\n\n\xff\xfe text\n"
    files[record] = b"".join(line for line in files[record].splitlines(keepends=True) if b"METADATA" not in line)
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    ran = desk.measure(matrix)
    return desk.check_verdicts(ran, hx={"works", "uninstallable", "unresolvable", "inconclusive"}, neighbour={"works"})


@fault(
    "105",
    section="bad input",
    done="report.json of another machine is `[[[[`, garbage, of another shape, a FIFO: report and merge read it",
    promise="exit 2 with a sentence that names the file",
)
def hostile_report(desk: Desk) -> FaultResult:
    """Read reports that were damaged on their way."""
    desk.measure(desk.hostile(checks=("import",)))
    report = desk.state / "reports" / "m" / "report.json"
    whole, parts, held = report.read_bytes(), [], True
    for deed in (deep, garbage, other, half, empty, folder):
        deed(report)
        for verb in (("report", str(report)), ("merge", str(report.parent), "--out", str(desk.folder / "out"))):
            ran = desk.run(*verb)
            parts.append(f"{deed.__name__}, {verb[0]}: {ran.code}")
            held = held and ran.code == 2 and "report.json" in ran.err
        shutil.rmtree(report) if report.is_dir() else report.unlink()
        report.write_bytes(whole)
    return FaultResult("; ".join(parts), held)
