"""Declarations of adapters are read from their files, which are never imported."""

from __future__ import annotations

import re

import pytest

from harness.judging.runs import native_errors
from harness.judging.runs.check import Ending, check_record
from harness.matrix.plan import adapter_choice
from harness.model import CheckReply, Outcome, Raised
from harness.model.vocabulary import APIS, FAMILY, INCELL, readers
from harness.probes import program
from harness.standalone import adapters, keys

DECLARED = adapters.adapters()


def test_every_adapter_declares_its_packages() -> None:
    """All but the one of a user's own callables name the package that brings the API, which ids and an example need."""
    assert tuple(DECLARED) == APIS
    assert {api for api, one in DECLARED.items() if not one.packages} == {"tensor"}
    assert {api for api, one in DECLARED.items() if bool(one.ids) != bool(one.example)} == set()
    assert not {api for api in FAMILY if DECLARED[api].ids}


@pytest.mark.parametrize("api", APIS)
def test_patterns_are_patterns(api: str) -> None:
    """Each can be compiled, and the example is one of the ids."""
    one = DECLARED[api]
    for pattern in (*one.drawing_code, *one.native_errors):
        assert re.compile(pattern).groups == 0
    assert not one.ids or one.example.startswith(f"{api}:")


def test_declarations_stand_at_the_top() -> None:
    """They are read down to the first class or function; all else is nothing to the host."""
    top = "import os\nPACKAGES = {'a-b': 'a_b'}\nOTHER = os.name\nDRAWS = ('a_b',)\n"
    source = top + "\n\nclass A:\n    pass\n\n\nIDS = 'x'\n"
    assert adapters.declarations(source) == {"packages": {"a-b": "a_b"}, "draws": ("a_b",)}


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("PACKAGES = dict(a='a')", "PACKAGES is not written out as a dict"),
        ("DRAWS = 'mujoco'", "DRAWS is not written out as a tuple"),
        ("IDS = ('a', 'b')", "IDS is not written out as a str"),
        ("BRINGS_MODELS = 1", "BRINGS_MODELS is not written out as a bool"),
        ("NATIVE_ERRORS = (PATTERN,)", "NATIVE_ERRORS is not written out as a tuple"),
    ],
)
def test_a_declaration_of_another_type_is_refused(source: str, message: str) -> None:
    """A declaration that would be passed over, or read letter by letter, is an error that names it."""
    with pytest.raises(ValueError, match=f"^{message}$"):
        adapters.declarations(source)


def test_a_file_that_is_no_python_declares_nothing() -> None:
    """Its cell tells what is wrong with it."""
    assert adapters.declarations("PACKAGES = {'a': 'a'\n") == {}


def test_a_file_that_runs_alone_carries_them() -> None:
    """They come back from JSON as they were."""
    assert adapters.read(adapters.encode_declarations()) == DECLARED


def test_packages_are_known_where_names_count() -> None:
    """A package that brings an API is a simulator, imported by `doctor` unless its adapter says why not."""
    names = {name for one in DECLARED.values() for name in one.packages}
    kept = {name for one in DECLARED.values() for name in one.not_imported}
    assert names <= keys.SIMULATORS
    assert names - kept <= set(keys.MODULES)
    assert kept <= set(keys.LEFT_OUT)
    assert not kept & set(keys.MODULES)
    assert list(keys.MODULES)[:5] == ["numpy", "scipy", "gym", "gymnasium", "mujoco"]
    assert {adapters.package(api) for api in ("mjx", "tensor", "other")} == {"mujoco-mjx", "tensor", "other"}


def test_ids_speak_for_their_package() -> None:
    """An id without an API means the one whose package is asked for and whose ids look so."""
    assert adapter_choice.guess_api("cartpole/balance", ["dm-control>=1"]) == "dm_control"
    assert adapter_choice.guess_api("cartpole", ["dm-control>=1"]) is None
    assert [api for api in APIS if adapter_choice.brings_models(api)] == ["pybullet"]


def test_variables_matter_to_declared_packages() -> None:
    """MUJOCO_GL is read by the packages that adapters name."""
    assert set(readers("MUJOCO_GL") or ()) == {"mujoco", "mujoco-py", "free-mujoco-py", "dm-control"}
    assert readers("DISPLAY") is None


def test_native_errors_are_declared_lines() -> None:
    """Whole lines that an adapter declares are told, and Mesa's own."""
    lines = ["[Error] [carb.gym.plugin] no GPU", "Failed to fill root state tensor", "all is well, [Error] or not"]
    lavapipe = "WARNING: lavapipe is not a conformant vulkan implementation, testing use only."
    assert native_errors.errors("\n".join([*lines, lavapipe])) == (*lines[:2], lavapipe)


@pytest.mark.parametrize(
    ("loaded", "file", "outcome"),
    [
        (["mujoco", "numpy"], "x.py", Outcome.UNAVAILABLE),
        (["dm_control"], "x.py", Outcome.UNAVAILABLE),
        (["OpenGL"], "x.py", Outcome.UNAVAILABLE),
        (["pygame", "numpy"], "x.py", Outcome.FAILED),
        ([], "mujoco/egl/__init__.py", Outcome.UNAVAILABLE),
        ([], "mujoco/bindings.py", Outcome.FAILED),
    ],
)
def test_drawing_modules_are_declared(loaded: list[str], file: str, outcome: Outcome) -> None:
    """A picture that fails where nothing can be drawn is this machine's lack if something loaded, or called, draws."""
    error = Raised(type="RuntimeError", message="no", traceback=f'  File "$ENV/site-packages/{file}"', blame="library")
    reply = CheckReply(check="render.rgb_array", outcome=Outcome.FAILED, raised=error, facts={"loaded": loaded})
    assert check_record(reply, Ending(), {"": "no EGL here: install it"}).outcome is outcome


def test_a_changed_declaration_measures_nothing_again(tmp_path) -> None:
    """They say how replies are judged, and are in no digest; the adapter's code is."""
    path = tmp_path / "api_mujoco.py"
    before = (INCELL / path.name).read_text()
    for changed, alike in [
        (before.replace('"mujoco:markers"', '"mujoco:sphere"').replace('DRAWS = ("mujoco",)', "DRAWS = ()"), True),
        (before.replace("HEIGHT, WIDTH = 240", "HEIGHT, WIDTH = 480"), False),
    ]:
        assert changed != before
        path.write_text(changed)
        found = program.read(tmp_path).files[path.name]
        assert (found == program.own().files[path.name]) is alike
