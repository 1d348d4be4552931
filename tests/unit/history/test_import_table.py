"""The table of import names: made from modules of releases, asked by dotted names."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

from harness.history import import_table
from harness.history.api_history import MeasuredRelease, ReleaseEntry, encode, fold
from harness.history.import_table import import_names
from harness.history.package_plan import PackagePlan, Plan
from harness.history.release_reader import ReleaseFacts


def test_a_package_has_its_top_level_modules() -> None:
    """One that only older releases have is among them."""
    assert [*import_names({"toy": 3, "toy.core": 3, "old": 1})] == ["old", "toy"]


def test_a_namespace_has_the_packages_in_it() -> None:
    """Other packages fill it, too; that an older release had a file of its own there does not matter."""
    assert [*import_names({"google": 1, "google.protobuf": 4, "google.protobuf.json_format": 4})] == ["google.protobuf"]
    assert [*import_names({"mujoco.mjx": 0, "mujoco.mjx.io": 0})] == ["mujoco.mjx"]


def test_the_first_package_of_the_plan_has_a_name_that_several_bring(tmp_path: Path) -> None:
    """A package without a history has none; those that are only listed come last."""
    for package, modules in {"box2d": ("Box2D",), "box2d-py": ("Box2D",), "pyyaml": ("Box2D", "yaml")}.items():
        release = MeasuredRelease(entry=ReleaseEntry(version="1.0", read=True), facts=ReleaseFacts(modules=modules))
        (tmp_path / f"{package}.json.gz").write_bytes(encode(fold(package, [release])))
    packages = {"box2d": PackagePlan(), "box2d-py": PackagePlan(), "never-read": PackagePlan()}
    plan = Plan(helpers=(), searched=("box2d",), listed=("pyyaml",), packages=packages)
    table = json.loads(gzip.decompress(import_table.encode(plan, tmp_path)))
    assert table == {"imports": {"Box2D": "box2d", "yaml": "pyyaml"}, "gone": [], "searched": ["box2d"]}


def test_a_module_in_few_old_releases_got_there_by_mistake() -> None:
    """The newest release decides of a new module; one that many had counts although it is gone."""
    modules = [("toy", "old", "setup_helper"), *([("toy", "old")] * 4), *([("toy",)] * 4), ("toy", "fresh")]
    releases = [
        MeasuredRelease(entry=ReleaseEntry(version=f"1.{number}", read=True), facts=ReleaseFacts(modules=some))
        for number, some in enumerate(modules)
    ]
    assert [*import_table.usual_modules(fold("toy", releases))] == ["fresh", "old", "toy"]


def test_a_module_of_an_earlier_package_stays_with_it(tmp_path: Path) -> None:
    """Some package brings a file into the folder of another one."""
    for package, modules in {
        "gym": ("gym", "gym.envs", "gym.envs.atari"),
        "ale-py": ("ale_py", "gym.envs.atari"),
    }.items():
        release = MeasuredRelease(entry=ReleaseEntry(version="1.0", read=True), facts=ReleaseFacts(modules=modules))
        (tmp_path / f"{package}.json.gz").write_bytes(encode(fold(package, [release])))
    plan = Plan(helpers=(), packages={"gym": PackagePlan(), "ale-py": PackagePlan()})
    table = json.loads(gzip.decompress(import_table.encode(plan, tmp_path)))
    assert table["imports"] == {"ale_py": "ale-py", "gym": "gym"}
