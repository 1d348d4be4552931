"""Packages that compile at their first import are compiled during the install, and missing system packages named."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from asking import expect_failure, expect_lock, install, question

from harness.machine import debian_packages
from harness.model import IndexSettings, Interpreter, Outcome, Phase, Step
from harness.packages import resolver
from harness.packages.environments import environments, first_import
from harness.packages.environments.environments import Environment

pytestmark = [
    pytest.mark.usefixtures("workplace"),
    pytest.mark.skipif(not shutil.which("cc"), reason="unavailable: a C compiler"),
]

RECIPES = """
[[package]]
name = "fake-compiles"
modules = ["fake_compiles"]
system = ["fake-headers-dev"]
reason = "it is made for this"
"""
Ensure = Callable[..., Environment | Step]


@pytest.fixture(autouse=True)
def recipes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use a recipe by which the fake compiles at its first import."""
    file = tmp_path / "warming.toml"
    file.write_text(RECIPES)
    monkeypatch.setattr(first_import, "FILE", file)


@pytest.fixture
def ensure(host: Interpreter, offline_index: IndexSettings, tmp_path: Path) -> Ensure:
    """Return a function that makes the environment of a requirement."""

    def make(requirement: str, **variables: str) -> Environment | Step:
        asked = question(requirement, index=offline_index, build_variables=variables)
        lock = expect_lock(resolver.resolve(asked, host, tmp_path / "state" / "x"))
        return install(lock, host, asked)

    return make


def test_compiled_once_in_files_of_its_own(ensure: Ensure) -> None:
    """The install imports the package once; its compiled files stay, and none is a link into uv's cache."""
    made, again = ensure("fake-compiles==1.0"), ensure("fake-compiles==1.0")
    assert isinstance(made, Environment)
    assert isinstance(again, Environment)
    site = next(made.path.glob("lib/python*/site-packages"))

    assert (site / "fake_compiled.txt").read_text() == ""
    assert (made.reused, again.reused) == (False, True)
    assert (site / "fake_compiles.py").stat().st_nlink == 1
    (finding,) = again.findings
    assert (finding.check, finding.level) == ("install.compiled", "note")
    assert finding.text == "fake-compiles was compiled by its first import: it is made for this"


def test_variables_of_builds_make_another(ensure: Ensure) -> None:
    """Build variables apply to this compiler too, and are part of the environment's key."""
    plain, other = ensure("fake-compiles==1.0"), ensure("fake-compiles==1.0", FAKE_FLAGS="-O3")
    assert isinstance(plain, Environment)
    assert isinstance(other, Environment)

    assert plain.key != other.key
    assert next(other.path.glob("lib/python*/site-packages/fake_compiled.txt")).read_text() == "-O3"


@pytest.mark.parametrize("here", [True, False])
def test_a_compiler_that_fails_is_a_failed_install(here: bool, ensure: Ensure, monkeypatch: pytest.MonkeyPatch) -> None:
    """A failed compilation is a failed install with the compiler's own line and missing system packages.

    No usable environment is left.
    """
    monkeypatch.setattr(debian_packages, "installed_packages", lambda names: frozenset(names) if here else frozenset())
    step = ensure("fake-compiles==2.0")

    phase, outcome, decisive = expect_failure(step)
    assert (phase, outcome) == (Phase.INSTALL, Outcome.FAILED)
    assert decisive is not None
    assert decisive.startswith("fake-compiles, compiled by its first import: $TMP/fake.c:1:10: fatal error:")
    assert decisive.endswith("fake/absent.h: No such file or directory")
    assert isinstance(step, Step)
    assert [finding.text for finding in step.findings] == (
        [] if here else ["no fake-headers-dev here: run `apt install fake-headers-dev`"]
    )
    assert not list(environments.cache_folder().glob("environments/*/stamp.json"))


@pytest.mark.skipif(not shutil.which("dpkg-query"), reason="unavailable: dpkg")
def test_packages_of_the_system() -> None:
    """Packages that dpkg does not have are named with the command to install them."""
    assert debian_packages.describe_missing(("dpkg",)) is None
    told = debian_packages.describe_missing(("dpkg", "no-such-dev", "nor-this-one"))
    assert told == "no no-such-dev, nor-this-one here: run `apt install no-such-dev nor-this-one`"
    assert debian_packages.note_unchecked(("no-such-dev",)) == ()


def test_a_system_without_dpkg(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without dpkg the check is reported as not done, and the cell goes on."""
    monkeypatch.setattr(debian_packages, "DPKG", "no-such-dpkg")
    assert debian_packages.describe_missing(("libosmesa6-dev",)) is None
    (finding,) = debian_packages.note_unchecked(("libosmesa6-dev", "patchelf"))
    assert finding.text == (
        "whether libosmesa6-dev, patchelf are here could not be looked up: this system has no no-such-dpkg"
    )
    assert debian_packages.note_unchecked(()) == ()


def test_recipes_that_are_shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped recipe compiles free-mujoco-py."""
    monkeypatch.setattr(first_import, "FILE", Path(first_import.__file__).with_suffix(".toml"))
    (recipe,) = first_import.recipes({"free-mujoco-py", "numpy"})

    assert (recipe.modules, recipe.system) == (("mujoco_py",), ("libosmesa6-dev", "libglew-dev", "patchelf"))
    assert first_import.marks({"numpy"}, question("x", index=IndexSettings())) == ()
