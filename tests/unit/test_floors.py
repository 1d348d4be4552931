"""Which module stands on which floor: imports go down, or sideways without a circle, never up."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import harness

PACKAGE = Path(harness.__file__).parent
FLOORS = {
    0: {"cellid", "model", "errors", "standalone"},
    1: {
        "accepting", "advising", "answering", "apart", "cameras", "changes", "clues", "distilling", "document",
        "drafts", "entry_failures", "exercised", "expansion", "explaining", "grouping", "hostile_data",
        "inferring", "inputfiles",
        "interrupts", "judging", "judging.words", "known_issues", "locks", "markdown_texts",
        "matrix", "matrixfile", "measured_cells", "mending", "merging",
        "misleading", "moves", "nativesays",
        "normalise", "notices", "pages", "pasting", "pipelines", "plan", "platforms", "present",
        "probes.evidence", "probes.facts", "probes.syntax",
        "proving", "recommended", "recommended_text", "recommending", "redacting",
        "remedies", "rendering", "repairs", "reporttypes", "reproducing", "schema", "search", "shards", "signatures",
        "requirement_texts", "squares", "strategy", "suite_tables", "tables", "tabletypes", "terminal", "traps",
        "upstream", "uvsays", "vocabulary", "wire", "workflows", "yaml_texts",
    },
    2: {
        "alone", "answers", "bringing", "builds", "bytecode", "checkouts", "controls", "discovery",
        "display", "downloads",
        "drawing", "environment_damage", "environments", "fetched", "filelocks", "frames", "garbage",
        "given_files", "glprobe",
        "guarded_files", "index", "indexsettings",
        "inputs", "interpreters", "issue_texts", "knowledge", "machine", "measured", "memory",
        "overlays", "packs", "probes", "process", "scratch_folders",
        "sdists", "shipped_reports", "signature_files", "sitepackages", "sources",
        "store",
        "subjects", "supervisor", "systempackages", "typos", "uv", "uvcli", "warming",
    },
    3: {
        "catalog", "cellrun", "fetching", "firstcases", "firstvalues", "lock_files", "resolving", "rootcause",
        "scheduler", "suites",
    },
    4: {"commands"},
    5: {"__main__", "smoke", "noxface"},
}  # fmt: skip
FLOOR = {module: floor for floor, modules in FLOORS.items() for module in modules}
APART = {"incell"}
STANDALONE = set(
    "__main__ spawning looking importing seeing choosing running probing doctor explain packages"  # noqa: SIM905
    " installing wrapping".split()
)
"""Files of `standalone` that read files and start processes, as that is what the verbs do where no harness is: the
command of `explain -- COMMAND` in a terminal of its own, which the supervisor's log file is not, and the interpreter
of an environment that is looked at. On the host the verbs alone import them."""
PURE = {"subprocess", "socket", "time", "multiprocessing", "threading", "tempfile", "shutil", "requests"}


def parts() -> dict[str, list[Path]]:
    """Top-level module or folder of the package: its files."""
    found: dict[str, list[Path]] = {}
    for path in PACKAGE.rglob("*.py"):
        top = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if top not in APART | {"__init__", "matrices"}:
            inside = f"{top}.{path.stem}"
            found.setdefault(inside if inside in FLOOR else top, []).append(path)
    return found


def imports(path: Path) -> set[str]:
    """Full names of what a file imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def ours(path: Path) -> set[str]:
    """Modules of the package that a file imports, by their top-level names, or by the names that the map has."""
    found = {name.removeprefix("harness.") for name in imports(path) if name.startswith("harness.")}
    inside = {name for name in FLOOR if "." in name and any(f"{one}.".startswith(f"{name}.") for one in found)}
    tops = {one.split(".")[0] for one in found if not any(f"{one}.".startswith(f"{name}.") for name in inside)}
    return inside | (tops & set(FLOOR))


def test_every_module_has_a_floor() -> None:
    """A new module is placed before it lands, and the map names no module that is gone."""
    assert set(parts()) == set(FLOOR)


@pytest.mark.parametrize("module", sorted(FLOOR))
def test_imports_never_go_up(module: str) -> None:
    """What a module imports stands on its own floor or below."""
    above = {name for path in parts()[module] for name in ours(path) if FLOOR[name] > FLOOR[module]}

    assert not above


def test_imports_make_no_circle() -> None:
    """Modules can be ordered so that each imports only those before it."""
    waiting = {module: {n for path in files for n in ours(path)} - {module} for module, files in parts().items()}
    while ready := {module for module, needed in waiting.items() if not needed & set(waiting)}:
        for module in ready:
            del waiting[module]

    assert not waiting


@pytest.mark.parametrize("module", sorted(FLOORS[0] | FLOORS[1]))
def test_low_floors_do_no_input_or_output(module: str) -> None:
    """Values and pure functions spawn nothing, connect to nothing, ask no clock and open no file."""
    for path in parts()[module]:
        if module == "standalone" and path.stem in STANDALONE:
            continue
        assert not {name.split(".")[0] for name in imports(path)} & PURE
        called = {ast.unparse(n.func) for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)}
        assert not {name for name in called if name == "open" or name.split(".")[-1] in {"read_text", "read_bytes"}}


def test_nothing_but_process_spawns() -> None:
    """There is one spawner, and the supervisor that it starts."""
    found = [(module, path) for module, files in parts().items() for path in files if "subprocess" in imports(path)]
    spawning = {module for module, path in found if module != "standalone" or path.stem not in STANDALONE}

    assert spawning <= {"process"}


def test_only_verbs_use_what_stands_alone_and_spawns() -> None:
    """What the rest of the host imports of it is pure."""
    apart = {f"harness.standalone.{folder}{name}" for folder in ("", "doctor.", "explain.") for name in STANDALONE}
    using = {module for module, files in parts().items() for path in files if imports(path) & apart}

    assert using <= {"commands"}


def test_the_host_knows_only_the_path_of_the_cell_side() -> None:
    """No module of the host imports what runs in the cell."""
    found = {path.name for files in parts().values() for path in files if any("incell" in n for n in imports(path))}

    assert not found


FACE = {
    "assess": {"Assessed", "assess"},
    "assessed_case": {"AssessedCase"},
    "counted_phases": {"observed", "reason", "step_outcome", "suite_phase"},
    "discount": set(),
    "identity": {"Failure"},
    "known_failures": {"NOTHING_KNOWN", "Knowledge"},
    "verdict": set(),
}
"""Modules of judging that a verdict is put together of, with what others may take from each."""
SECOND_DOORS = {"entry_failures"}
"""It reads off a document which of its diagnoses count, by the one definition of counting."""


def composed(path: Path) -> set[str]:
    """Return what a file takes of these modules beyond that, whole modules among it."""
    found = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
    whole = {alias.name for node in found if node.module == "harness.judging" for alias in node.names} & FACE.keys()
    parted = [((node.module or "").removeprefix("harness.judging."), node) for node in found]
    names = {f"{name}.{alias.name}" for name, node in parted for alias in node.names if name in FACE}
    return whole | (names - {f"{module}.{name}" for module, taken in FACE.items() for name in taken})


def test_assess_is_the_one_door_to_a_verdict() -> None:
    """Outside the room of judging nobody puts a verdict together."""
    using = {module for module, files in parts().items() for path in files if module != "judging" and composed(path)}

    assert using == SECOND_DOORS
