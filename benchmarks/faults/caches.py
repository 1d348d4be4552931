"""Faults of the cache folder: byte code, environments, uv's own cache, damaged by the disk or poisoned by a probe."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from benchmarks.faults import Desk, FaultResult, fault

SECTION, DISKS = "hostile probes", "disks and damaged files"
QUICK = ("import", "single")
POISON = """
import importlib.util, marshal, struct, fake_healthy
def poisoned(source):
    about = os.stat(source)
    code = compile("raise ImportError('poisoned by a neighbour')", source, "exec")
    head = importlib.util.MAGIC_NUMBER + struct.pack("<III", 0, int(about.st_mtime), about.st_size & 0xFFFFFFFF)
    return head + marshal.dumps(code)
def poison(path):
    try:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as file:
            file.write(poisoned(fake_healthy.__file__))
        os.utime(path)
    except OSError as error:
        print("refused", path, error.strerror, flush=True)
"""


def rotten(path: Path) -> None:
    """Replace a file by as many bytes of garbage, as a disk does: only this name of it."""
    size = path.stat().st_size
    path.unlink()
    path.write_bytes(b"\xff" * size)


def spoiled(path: Path, content: bytes) -> None:
    """Write over a file in place, through all of its names."""
    with path.open("r+b") as file:
        file.write(content)
        file.truncate()


def source_of(desk: Desk, module: str = "fake_healthy.py", where: str = "environments/*/lib/*/site-packages") -> Path:
    """Return the file of a module in an environment, or in uv's cache."""
    (path, *_) = sorted(desk.cache.glob(f"{where}/{module}"))
    return path


@fault(
    "70",
    section=SECTION,
    done="a probe writes poisoned byte code of its neighbour's module wherever Python could look for it",
    promise="the neighbour works, now, with --fresh and with --verify",
)
def poisoned_byte_code(desk: Desk) -> FaultResult:
    """Poison the byte code folder, the cache's own, and the place beside the module."""
    matrix = desk.hostile(
        checks=QUICK,
        shared=True,
        top=POISON,
        reset=f"""
            poison(fake_healthy.__cached__)
            poison(importlib.util.cache_from_source(fake_healthy.__file__))
            for folder in glob.glob({str(desk.cache)!r} + "/pycache/*"):
                poison(folder + fake_healthy.__cached__[len(sys.pycache_prefix or ""):])
                poison(folder + "/code")
        """,
    )
    promised = {"hx": {"works"}, "neighbour": {"works"}}
    first = desk.check_verdicts(desk.measure(matrix, "-j", "1"), **promised)
    for options in (["--fresh"], ["--fresh", "--verify"]):
        again = desk.check_verdicts(desk.measure(matrix, "-j", "1", *options), **promised)
        first = FaultResult(f"{first.what}; {' '.join(options)}: {again.what}", first.held and again.held)
    return first


def warmed(desk: Desk) -> Path:
    """Run a healthy matrix often enough that byte code is kept."""
    matrix = desk.hostile(checks=QUICK, shared=True)
    for _ in range(2):
        desk.measure(matrix, "-j", "1", "--fresh")
    return matrix


@fault(
    "30d",
    section=DISKS,
    done="the end of all byte code that is kept becomes garbage, its header stays",
    promise="the same verdicts, with and without --fresh and --verify",
)
def rotten_byte_code(desk: Desk) -> FaultResult:
    """Damage what Python loads by itself."""
    matrix = warmed(desk)
    files = [path for path in desk.cache.glob("pycache/**/*") if path.is_file()]
    parts, held = [f"{len(files)} files of byte code"], bool(files)
    for options in (["--fresh"], ["--fresh", "--verify"]):
        for path in files:
            content = path.read_bytes()
            path.write_bytes(content[: len(content) // 2] + b"\xff" * (len(content) // 2))
        came = desk.check_verdicts(desk.measure(matrix, *options), hx={"works"}, neighbour={"works"})
        parts, held = [*parts, f"{' '.join(options)}: {came.what}"], held and came.held
    return FaultResult("; ".join(parts), held)


@fault(
    "30e",
    section=DISKS,
    done="the byte code that is kept is cut short, a folder, a FIFO, a link to nowhere, nested too deeply",
    limit=400,
    promise="the same verdicts each time",
)
def odd_byte_code(desk: Desk) -> FaultResult:
    """Put all kinds of things in the place of what is kept."""
    matrix = warmed(desk)
    (cache_folder,) = (folder for folder in desk.cache.glob("pycache/*") if (folder / "code").is_file())
    content, parts, held = (cache_folder / "code").read_bytes(), [], True
    deeds = {
        "cut": lambda path: path.write_bytes(content[: len(content) // 3]),
        "empty": lambda path: path.write_bytes(b""),
        "folder": lambda path: path.mkdir(),
        "fifo": os.mkfifo,
        "link": lambda path: path.symlink_to("nowhere"),
        "deep": lambda path: path.write_bytes(b"[" * 100_000),
    }
    for name, deed in deeds.items():
        for file in ("code", "names"):
            place = cache_folder / file
            shutil.rmtree(place) if place.is_dir() and not place.is_symlink() else place.unlink(missing_ok=True)
            deed(place)
        came = desk.check_verdicts(desk.measure(matrix, "--fresh"), hx={"works"}, neighbour={"works"})
        parts, held = [*parts, f"{name}: {came.what}"], held and came.held
    return FaultResult("; ".join(parts), held)


def join_results(*came: FaultResult) -> FaultResult:
    """Join what came of several steps."""
    return FaultResult("; ".join(one.what for one in came), all(one.held for one in came))


WORKS = {"hx": {"works"}, "neighbour": {"works"}}


@fault(
    "23",
    section=DISKS,
    done="a module in uv's unpacked cache is garbage of the same size, the environments are gone; then again, --verify",
    promise="the package works: it is downloaded anew",
    limit=300,
)
def rotten_unpacked_cache(desk: Desk) -> FaultResult:
    """Let the disk rot below what environments are made of."""
    matrix = desk.hostile(checks=QUICK)
    came = []
    for options in ([], ["--fresh"], ["--fresh", "--verify"]):
        if options:
            rotten(source_of(desk, where="uv/archive-v0/*"))
        shutil.rmtree(desk.cache / "environments", ignore_errors=True)
        came.append(desk.check_verdicts(desk.measure(matrix, *options), **WORKS))
    return join_results(*came)


@fault(
    "24",
    section=DISKS,
    done="a module of an installed environment is garbage of the same size",
    promise="the package works: its environment is made anew within the run",
    limit=300,
)
def rotten_environment(desk: Desk) -> FaultResult:
    """Let the disk rot in an environment."""
    matrix = desk.hostile(checks=QUICK, shared=True)
    desk.measure(matrix)
    rotten(source_of(desk))
    return desk.check_verdicts(desk.measure(matrix, "--fresh"), **WORKS)


@fault(
    "24b",
    section=DISKS,
    done="a data file of an installed environment changed, its size did not",
    promise="--verify makes the environment anew",
    limit=300,
)
def rotten_data(desk: Desk) -> FaultResult:
    """Change what no import touches."""
    matrix = desk.hostile(checks=QUICK, shared=True, files={"hx_data.txt": "1234"})
    desk.measure(matrix)
    rotten(source_of(desk, "hx_data.txt"))
    came = desk.check_verdicts(desk.measure(matrix, "--fresh", "--verify"), **WORKS)
    return FaultResult(came.what, came.held and source_of(desk, "hx_data.txt").read_text() == "1234")


@fault(
    "28",
    section=DISKS,
    done="pyvenv.cfg of an environment is replaced by a folder, then by nothing, then by garbage",
    promise="the package works each time",
    limit=300,
)
def lost_configuration(desk: Desk) -> FaultResult:
    """Take away what makes an environment one."""
    matrix = desk.hostile(checks=QUICK, shared=True)
    came = [desk.check_verdicts(desk.measure(matrix), **WORKS)]
    for how in ("folder", "nothing", "garbage"):
        (config,) = desk.cache.glob("environments/*/pyvenv.cfg")
        config.unlink()
        if how == "folder":
            config.mkdir()
        elif how == "garbage":
            config.write_bytes(b"\xff\x00" * 40)
        came.append(desk.check_verdicts(desk.measure(matrix, "--fresh"), **WORKS))
    return join_results(*came)


@fault(
    "28b",
    section=DISKS,
    done="the interpreter's link in an environment leads nowhere",
    promise="the package works",
    limit=300,
)
def lost_python(desk: Desk) -> FaultResult:
    """Take away the Python of an environment."""
    matrix = desk.hostile(checks=QUICK, shared=True)
    desk.measure(matrix)
    (python,) = desk.cache.glob("environments/*/bin/python")
    python.unlink()
    python.symlink_to("/nonexistent/python")
    return desk.check_verdicts(desk.measure(matrix, "--fresh"), **WORKS)


def through_the_cache(desk: Desk) -> Path:
    """Make a package that writes over its neighbour's module through every name that it has in the cache."""
    return desk.hostile(
        checks=QUICK,
        reset=f"""
            for path in glob.glob({str(desk.cache)!r} + "/**/fake_healthy.py", recursive=True):
                try:
                    with open(path, "w") as file:
                        file.write("raise ImportError('poisoned through the cache')")
                except OSError as error:
                    print("refused", error.strerror, flush=True)
        """,
    )


@fault(
    "69",
    section=SECTION,
    done="a probe writes over a module of its neighbour in uv's cache and in every environment",
    promise="the neighbour works, in new environments, too",
    limit=300,
)
def poisoned_cache(desk: Desk) -> FaultResult:
    """Write through the hard links into the cache."""
    matrix = through_the_cache(desk)
    came = [desk.check_verdicts(desk.measure(matrix, "-j", "1"), **WORKS)]
    shutil.rmtree(desk.cache / "environments")
    came.append(desk.check_verdicts(desk.measure(matrix, "-j", "1", "--fresh"), neighbour={"works"}))
    return join_results(*came)


@fault(
    "69b",
    section=SECTION,
    done="the same without privileges",
    promise="the neighbour works, in new environments, too",
    limit=300,
)
def poisoned_cache_by_nobody(desk: Desk) -> FaultResult:
    """Write through the hard links as nobody."""
    return poisoned_cache(desk.as_nobody())


@fault(
    "69c",
    section=SECTION,
    done="the same where no mount namespace is allowed",
    promise="the neighbour works: what was poisoned is downloaded anew, with --verify and where something fails",
    limit=400,
)
def poisoned_cache_unsealed(desk: Desk) -> FaultResult:
    """Write into the cache where nothing keeps a probe from it."""
    open_desk = desk.with_variables(HARNESS_SANDBOX="subreaper")
    matrix = through_the_cache(open_desk)
    came = [open_desk.check_verdicts(open_desk.measure(matrix, "-j", "1"), neighbour={"works"})]
    shutil.rmtree(desk.cache / "environments")
    only = ("-j", "1", "-k", "*neighbour", "--fresh")
    came.append(open_desk.check_verdicts(open_desk.measure(matrix, *only), neighbour={"works"}))
    return join_results(*came)


def reaching(desk: Desk, more: str = "") -> Path:
    """Make a package that writes wherever the harness keeps something, and says where it got through."""
    return desk.hostile(
        checks=QUICK,
        step=f"""
            got = []
            for folder in ({str(desk.cache)!r}, {str(desk.cache / "environments")!r}, {str(desk.cache / "wheels")!r},
                           {str(desk.cache / "uv")!r}, {str(desk.state)!r}, {str(desk.state / "results")!r}):
                try:
                    os.makedirs(folder, exist_ok=True)
                    open(folder + "/hx_pwned", "w").close()
                    got.append(folder)
                except OSError:
                    pass
            {more or "pass"}
        """,
    )


def pwned(*folders: Path) -> list[str]:
    """Return the folders in which the package left a file outside, by name."""
    return sorted(str(path.parent.name) for folder in folders for path in folder.rglob("hx_pwned"))


@fault(
    "71",
    section=SECTION,
    done="a probe writes to the cache folder, the wheel store and the state",
    promise="nothing of it is there afterwards",
    limit=200,
)
def writes_to_the_cache(desk: Desk) -> FaultResult:
    """Write wherever the harness keeps something."""
    came = desk.check_verdicts(desk.measure(reaching(desk)), **WORKS)
    left = pwned(desk.cache, desk.state)
    return FaultResult(f"{came.what}; left behind: {', '.join(left) or 'nothing'}", came.held and not left)


@fault(
    "71b",
    section=SECTION,
    done="the same without privileges",
    promise="nothing of it is there afterwards",
    limit=200,
)
def writes_to_the_cache_by_nobody(desk: Desk) -> FaultResult:
    """Write wherever the harness keeps something, as nobody."""
    return writes_to_the_cache(desk.as_nobody())


@fault(
    "72",
    section=SECTION,
    done="a probe changes every stored result of the state to passed",
    promise="a red neighbour stays red",
    limit=300,
)
def forged_results(desk: Desk) -> FaultResult:
    """Turn stored failures into passes."""
    matrix = desk.hostile(
        checks=QUICK,
        step=f"""
            for path in glob.glob({str(desk.state)!r} + "/**/*.json", recursive=True):
                try:
                    text = open(path).read()
                    open(path, "w").write(text.replace('"failed"', '"passed"'))
                except OSError:
                    pass
        """,
    )
    text = matrix.read_text().replace("fake_healthy:Healthy-v0", "fake_wrong_arity:WrongArity-v0")
    matrix.write_text(
        text.replace('requirements = ["fake-healthy"', 'requirements = ["fake-healthy", "fake-wrong-arity"')
    )
    first = desk.check_verdicts(desk.measure(matrix, "-k", "*neighbour"), neighbour={"broken"})
    desk.measure(matrix, "-k", "*hx")
    return join_results(first, desk.check_verdicts(desk.measure(matrix), neighbour={"broken"}))


@fault(
    "23b",
    section=DISKS,
    done="WHEEL of a package is gone from uv's unpacked cache, the environments are gone",
    promise="the package works: it is downloaded anew",
    limit=300,
)
def lost_from_unpacked_cache(desk: Desk) -> FaultResult:
    """Let a file vanish below what environments are made of."""
    matrix = desk.hostile(checks=QUICK, shared=True)
    desk.measure(matrix)
    for path in desk.cache.glob("uv/archive-v0/*/hx-1.0.dist-info/WHEEL"):
        path.unlink()
    shutil.rmtree(desk.cache / "environments")
    return desk.check_verdicts(desk.measure(matrix, "--fresh"), **WORKS)
