"""The plan of what is read: which releases of a package."""

from __future__ import annotations

import pytest

from harness.history import making, package_plan
from harness.history.package_plan import first_and_last
from harness.model import Artifact
from harness.packages import index

VERSIONS = ["0.9", "0.10.0", "0.10.1", "0.10.2", "1.0.0", "1.0.0.post1", "1!1.0", "2.1.0", "2.3.0", "2.3.1"]


def test_of_each_minor_version_the_first_and_the_last_are_read() -> None:
    """A minor version with one release has that one; an epoch is another version."""
    kept = ["0.9", "0.10.0", "0.10.2", "1.0.0", "1.0.0.post1", "1!1.0", "2.1.0", "2.3.0", "2.3.1"]
    assert first_and_last(VERSIONS, parts=2) == kept


def test_of_each_major_version_the_first_and_the_last_are_read() -> None:
    """Packages with hundreds of minor versions are read so."""
    assert first_and_last(VERSIONS, parts=1) == ["0.9", "0.10.2", "1.0.0", "1.0.0.post1", "1!1.0", "2.1.0", "2.3.1"]


def test_the_plan_of_the_histories_can_be_read() -> None:
    """Each package has its way of reading, and those that are searched are among them."""
    plan = package_plan.load(making.PLAN)
    assert {*plan.searched} <= {*plan.packages}
    assert {package.each for package in plan.all_packages().values()} <= {"newest", "release", *package_plan.PARTS}
    assert not {*plan.listed} & {*plan.packages}


def test_releases_before_the_first_one_wanted_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest pandas cannot be parsed any more, and nobody asks about it."""
    monkeypatch.setattr(package_plan.interpreters, "available", list)
    releases = [
        index.Release(version=version, uploaded=None, requires_python=None, wheels=(), sdist=True, yanked=False)
        for version in ("0.25.0", "1.0.0", "1.0.1rc1", "1.1.0")
    ]
    files = {
        each.version: (Artifact(filename=f"p-{each.version}.tar.gz", sha256="0", source="x"),) for each in releases
    }
    plan = package_plan.PackagePlan(since="1.0")
    assert [*package_plan.choose(plan, releases, files)] == ["1.0.0", "1.1.0"]
