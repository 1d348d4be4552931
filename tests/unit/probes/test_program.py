"""The digests of the in-cell program: what changes them, and for which checks."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from harness.ci import first_cases
from harness.model.vocabulary import APIS, CHECKS, INCELL, MAKE_BANK
from harness.probes import program, wire

FOLLOWERS = tuple(name for names in wire.FOLLOWERS.values() for name in names)
ALL = (*CHECKS, *FOLLOWERS, "single.repeat", first_cases.LISTING, MAKE_BANK)
VECTOR = tuple(check for check in ALL if check.startswith("vector."))
DIGESTS = {(api, check): program.digest(api, check) for api in ("", *APIS) for check in ALL}


@pytest.fixture
def changed(tmp_path: Path):
    """Return a function that edits a file in a copy of the program; it returns API and check of each new digest."""

    def change(name: str, before: str, after: str) -> set[tuple[str, str]]:
        folder = tmp_path / "incell"
        shutil.copytree(INCELL, folder)
        source = (folder / name).read_text()
        assert before in source
        (folder / name).write_text(source.replace(before, after))
        other = program.read(folder)
        return {pair for pair, digest in DIGESTS.items() if other.digest(*pair) != digest}

    return change


def pairs(*checks: str, apis: tuple[str, ...] = ("", *APIS)) -> set[tuple[str, str]]:
    """Return pairs of API and check."""
    return {(api, check) for api in apis for check in checks}


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("check_single_loop.py", '"""Drive one', '"""Really drive one'),
        ("check_single_loop.py", '    """Make, reset', '    """Take, reset'),
        ("check_single_loop.py", "# a training loop", "# any training loop"),
        ("check_vector_async_fork.py", "\nrun =", "\n\n\n# a comment\nrun ="),
        ("cell_batch.py", '"""Seconds given to workers', '"""The seconds given to workers'),
        ("api_gymnasium.py", '"""Drive', '"""Really drive'),
    ],
    ids=["of a module", "of a function", "comment", "layout", "below a name", "of an adapter"],
)
def test_words_change_nothing(name: str, before: str, after: str, changed) -> None:
    """A docstring or a comment of a check, of what it imports or of an adapter measures nothing anew."""
    assert changed(name, before, after) == set()


@pytest.mark.parametrize(
    ("name", "before", "after", "checks"),
    [
        ("check_single_loop.py", "trace.steps()", "trace.steps()[:9]", ("single.loop",)),
        ("check_single_repeat.py", ".steps()", ".steps()[:9]", ("single.repeat",)),
        ("check_single_repeat_same.py", "_ANOTHER_SEED = 10", "_ANOTHER_SEED = 11", ("single.repeat.same",)),
        ("check_vector_async_spawn.py", '"spawn"', '"fork"', ("vector.async.spawn",)),
        ("check_render_unclosed.py", "env.render()", "env.render(), env.render()", ("render.unclosed",)),
        ("check_single_start_pose.py", "FAR = 0.05", "FAR = 0.06", ("single.start_pose",)),
        ("cell_batch.py", "PATIENCE = 3.0", "PATIENCE = 4.0", (*VECTOR, "render.device")),
        ("cell_pictures.py", "WINDOW = 5", "WINDOW = 6", ("render.rgb_array", "behave.pixels")),
        ("check_list_environments.py", "environments = {}", "environments = dict()", (first_cases.LISTING,)),
        ("cell_side_effects.py", '".teardown"', '".after"', ALL),
        ("cell_errors.py", '"(its message', '"(the message', ALL),
        ("cell_imports.py", ", 4)", ", 3)", ALL),
    ],
)
def test_a_changed_check_measures_that_check_alone(
    name: str, before: str, after: str, checks: tuple[str, ...], changed
) -> None:
    """A file that several checks use changes those, under every adapter; one of the runner changes all checks."""
    assert changed(name, before, after) == pairs(*checks)


@pytest.mark.parametrize(
    ("name", "before", "after", "apis"),
    [
        ("api_pybullet.py", "import_module", "import_modul", ("pybullet",)),
        ("cell_cartpole.py", "def ", "def a", ("isaaclab",)),
        (
            "cell_batched_worlds.py",
            "def ",
            "def a",
            ("brax", "gymnax", "isaaclab", "mani_skill", "mjx", "mujoco_warp", "newton", "playground", "tensor"),
        ),
    ],
)
def test_a_changed_adapter_measures_its_own_cells_alone(
    name: str, before: str, after: str, apis: tuple[str, ...], changed
) -> None:
    """Its digests change for all checks of these APIs, and for no other."""
    assert changed(name, before, after) == pairs(*ALL, apis=apis)


@pytest.mark.parametrize("name", program.TRANSPORT)
def test_the_transport_is_in_no_digest(name: str, changed, tmp_path: Path) -> None:
    """It enters by its number alone; its source is held to that number."""
    assert changed(name, "\n\n\ndef ", "\n\n\nOTHER = 1\n\n\ndef ") == set()
    assert program.read(tmp_path / "incell").transport_digest() != program.TRANSPORT_DIGEST


def test_another_protocol_measures_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of the transport is part of every digest."""
    monkeypatch.setattr(program, "PROTOCOL", program.PROTOCOL + 1)
    assert not {pair for pair, digest in DIGESTS.items() if program.own().digest(*pair) == digest}


def test_the_transport_is_the_one_of_its_number() -> None:
    """Whoever changes it decides what that means for what was measured before."""
    found = program.own().transport_digest()
    assert found == program.TRANSPORT_DIGEST, (
        f"{', '.join(program.TRANSPORT)}: the code that carries requests and records has changed. Would a cell of "
        "before give the same records? If not, raise PROTOCOL in harness/probes/program.py, and everything is "
        f"measured anew. In both cases set TRANSPORT_DIGEST there to {found!r}."
    )


def test_checks_and_files_belong_together() -> None:
    """Each check that the host asks for has its file, and each in-cell file is loaded by one of them."""
    own = program.own()
    assert {program.check_file(check) for check in ALL} == {name for name in own.files if name.startswith("check_")}
    loaded = {name for api in APIS for name in own.loaded(api, ALL)}
    assert loaded | {"bootstrap_suite.py"} == set(own.files)


def test_the_memory_gives_the_digests_of_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second reading parses nothing and gives the same; a damaged memory is made anew."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    first = program.read(INCELL)
    with monkeypatch.context() as without:
        without.setattr(program.ast, "parse", None)
        assert program.read(INCELL) == first
    for path in tmp_path.glob("remembered/program/*"):
        path.write_bytes(b"{")
    assert program.read(INCELL) == first
