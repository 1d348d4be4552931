"""Hold the rooms of the package to their order: imports go down, file by file, and never in a circle."""

from __future__ import annotations

import ast
import re
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import harness

PACKAGE = Path(harness.__file__).parent
DOORS = {"__init__", "__main__", "noxface"}
ROOMS = (
    ("commands", "smoke"), ("ci",), ("rootcause",), ("reports",), ("running",), ("physics",), ("judging",), ("probes",),
    ("history",), ("packages",), ("matrix",), ("devices",), ("machine",), ("model",), ("standalone",),
)  # fmt: skip
"""From top to bottom: a room imports itself and what stands below it."""
LEVEL = {room: level for level, rooms in enumerate(ROOMS) for room in rooms} | dict.fromkeys(DOORS, -1)
APART = {"incell", "matrices"}
PURE = ("physics", "judging", "matrix", "devices", "model")
"""Rooms that start nothing, connect to nothing, ask no clock and open no file."""
IMPURE = {"subprocess", "socket", "time", "multiprocessing", "threading", "tempfile", "shutil", "requests"}
LOCKING = {"harness.model.decoding"}
"""Modules of these rooms that hold a lock, and so import `threading`; they start no thread."""
MOST = 14
"""Modules of a room or of a room within it; verbs and in-cell files grow by verb and by adapter."""
DOORS_MOST = 10
"""Modules that a room hands on; those of `standalone` are the tools of every room."""
GROWING = {"commands"}
VENDORED = "vendored"
"""The folder of released libraries that are kept whole and unchanged."""

STANDALONE = frozenset(
    {
        "__main__", "run_command", "describe_environment", "import_modules", "list_renderers", "environment_choice",
        "running", "inspect_environment", "doctor", "explain",
        "packages", "installing", "wrapping",
    }
)  # fmt: skip
"""Files of `standalone` that read files and start processes, as that is what the verbs do where no harness is: the
command of `explain -- COMMAND` in a terminal of its own, which the supervisor's log file is not, and the interpreter
of an environment that is looked at. On the host the verbs alone, and `rootcause/doctor`, import them."""


def modules() -> dict[str, Path]:
    """Return every module of the host by its full name."""
    found = {}
    for path in (path for path in PACKAGE.rglob("*.py") if VENDORED not in path.parts):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        if len(parts) == 1 or parts[1] not in APART:
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imports(path: Path) -> set[str]:
    """Return the full names of what a file imports, those for types alone among them."""
    names: set[str] = set()
    package = ".".join(path.relative_to(PACKAGE.parent).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] if node.level else ""
            base = ".".join(part for part in (above, node.module) if part)
            names |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return names


def own_imports(path: Path) -> set[str]:
    """Return the modules of the package that a file imports."""
    found = imports(path) & MODULES.keys()
    return {name for name in found if not any(other.startswith(f"{name}.") for other in found)}


def room(module: str) -> str:
    """Return the room, or the door, of a module."""
    return module.split(".")[1] if "." in module else "__init__"


def test_nothing_but_rooms_and_doors() -> None:
    """A newcomer who opens the folder sees the rooms."""
    assert {room(module) for module in MODULES} == LEVEL.keys()


@pytest.mark.parametrize("module", sorted(MODULES))
def test_imports_never_go_up(module: str) -> None:
    """A module imports its own room and rooms below."""
    above = {name for name in own_imports(MODULES[module]) if LEVEL[room(name)] < LEVEL[room(module)]}
    assert not above


def test_imports_make_no_circle() -> None:
    """Files can be ordered so that each imports only files before it, those imported for types among them."""
    graph = {module: own_imports(path) - {module} for module, path in MODULES.items() if path.stem != "__init__"}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("folder", sorted({path.parent for path in MODULES.values()} - {PACKAGE}))
def test_a_room_can_be_overlooked(folder: Path) -> None:
    """It has few modules, and says in its first lines what it is for."""
    files = [path for path in folder.glob("*.py") if path.stem not in {"__init__", "__main__"}]
    assert len(files) <= MOST or folder.name in GROWING
    words = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    assert words
    assert "TODO" not in words


def package(module: str) -> str:
    """Return the room, or the room within a room, that a module lies in."""
    return module if MODULES[module].stem == "__init__" else module.rpartition(".")[0]


ENTERED = {
    other
    for module, path in MODULES.items()
    for other in own_imports(path)
    if package(other) not in {package(module), "harness"}
}
"""Modules that are imported from outside the folder that they lie in."""


@pytest.mark.parametrize("room", sorted({package(module) for module in MODULES} - {"harness", "harness.model"}))
def test_a_room_is_entered_by_its_doors(room: str) -> None:
    """Other rooms import only names of the `__all__` of its `__init__`; the rest is its own, and may change.

    `model` is the other way round: all of it is words for everybody.
    """
    tree = ast.parse(MODULES[room].read_text())
    lists = [
        node.value for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    names = {name for value in lists for name in ast.literal_eval(value)}
    bound = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    objects = bound | {
        alias.asname or alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    doors = {module.rpartition(".")[2] for module in ENTERED if package(module) == room and module != room}
    assert doors <= names
    assert names - objects == doors - objects
    assert len(names - objects) <= DOORS_MOST or room == "harness.standalone"


def test_the_list_of_rooms_says_what_the_rooms_say() -> None:
    """`harness/README.md` has the rooms in their order, each with its own words; every file that it names is there."""
    text = (PACKAGE / "README.md").read_text()
    listed = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE))
    assert list(listed) == [name for level in ROOMS for name in level]
    assert listed == {name: purpose_of(name) for name in listed}
    named = re.findall(r"`([a-z_/]+(?:\.py|\.toml|/))`", text)
    assert [name for name in named if not any((place / name).exists() for place in (PACKAGE, PACKAGE.parent))] == []


def purpose_of(name: str) -> str:
    """Return the first paragraph of what a room says about itself."""
    words = ast.get_docstring(ast.parse((PACKAGE / name / "__init__.py").read_text())) or ""
    return " ".join(words.split("\n\n")[0].split())


@pytest.mark.parametrize("module", sorted(name for name in MODULES if room(name) in (*PURE, "standalone")))
def test_pure_rooms_do_no_input_or_output(module: str) -> None:
    """Values and pure functions spawn nothing, connect to nothing, ask no clock and open no file."""
    path = MODULES[module]
    if room(module) == "standalone" and path.stem in STANDALONE:
        return
    assert not {name.split(".")[0] for name in imports(path)} & (
        IMPURE - ({"threading"} if module in LOCKING else set())
    )
    called = {ast.unparse(node.func) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)}
    assert not {name for name in called if name == "open" or name.split(".")[-1] in {"read_text", "read_bytes"}}


def test_nothing_but_the_fork_server_spawns() -> None:
    """There is one spawner, and what it starts forks the rest."""
    spawning = {module for module, path in MODULES.items() if "subprocess" in imports(path)}
    alone = {module for module in spawning if room(module) == "standalone" and module.split(".")[-1] in STANDALONE}
    assert spawning - alone <= {"harness.machine.fork_server"}


def test_only_verbs_use_what_stands_alone_and_spawns() -> None:
    """The rest of the host imports what is pure of it."""
    apart = {f"harness.standalone.{folder}{name}" for folder in ("", "doctor.", "explain.") for name in STANDALONE}
    using = {module for module, path in MODULES.items() if room(module) != "standalone" and imports(path) & apart}
    assert {".".join(module.split(".")[:3]) for module in using if room(module) != "commands"} <= {
        "harness.rootcause.doctor"
    }


def test_the_host_knows_only_the_path_of_the_cell_side() -> None:
    """No module of the host imports what runs in the cell."""
    assert not {module for module, path in MODULES.items() if any("incell" in name for name in imports(path))}


FACE = {
    "assess": {"Assessed", "assess"},
    "assessed_case": {"AssessedCase"},
    "counted_phases": {"find_observation", "reason", "step_outcome", "suite_phase"},
    "discount": set(),
    "identity": {"Failure", "failure"},
    "known_failures": {"NOTHING_KNOWN", "Knowledge", "select_counting", "select_nameable"},
    "verdict": set(),
}
"""Modules of judging that a verdict is put together of, with what others may take from each."""


def forbidden_imports(path: Path) -> set[str]:
    """Return the names, whole modules among them, that a file imports from these modules but may not."""
    found = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
    whole = {alias.name for node in found if node.module == "harness.judging" for alias in node.names} & FACE.keys()
    parted = [((node.module or "").removeprefix("harness.judging."), node) for node in found]
    names = {f"{name}.{alias.name}" for name, node in parted for alias in node.names if name in FACE}
    return whole | (names - {f"{module}.{name}" for module, taken in FACE.items() for name in taken})


def test_assess_is_the_one_door_to_a_verdict() -> None:
    """Outside the room of judging nobody puts a verdict together."""
    assert not {module for module, path in MODULES.items() if room(module) != "judging" and forbidden_imports(path)}


LONGEST = 50
"""Lines of a function, its docstring among them."""


def test_functions_are_short() -> None:
    """A function fits on a screen, those of programs in cells among them."""
    long = {
        f"{path.relative_to(PACKAGE)}: {node.name}"
        for path in PACKAGE.rglob("*.py")
        if VENDORED not in path.parts
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and (node.end_lineno or 0) - node.lineno >= LONGEST
    }
    assert not long


IN_THE_HOOK = {"msgspec", "packaging", "tomli_w"}
"""Packages that are installed where our wheel is built: `requires` of the build system in `pyproject.toml`."""


def loaded(path: Path) -> set[str]:
    """Return the full names that a file imports as it is loaded: not inside functions, and not for types alone."""
    body = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {alias.name for node in body if isinstance(node, ast.Import) for alias in node.names}
    for node in (node for node in body if isinstance(node, ast.ImportFrom) and not node.level):
        names |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_the_hook_of_the_wheel_loads_nothing_that_is_not_there() -> None:
    """Its modules need few packages; `recommend` starts with the same ones."""
    todo, seen, others = ["harness.reports.answers.digest"], set(), set()
    while todo:
        module = todo.pop()
        seen.add(module)
        names = loaded(MODULES[module]) if module in MODULES else set()
        others |= {name.partition(".")[0] for name in names if not name.startswith("harness")}
        todo += [name for name in names if name in MODULES and name not in seen]
    assert others - sys.stdlib_module_names - {"__future__"} <= IN_THE_HOOK
