"""Recipes that repair releases: what they say, which of them fit, and the wheel that comes out."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import zipfile
from pathlib import Path

import pytest

from harness.matrix import overlay_recipes
from harness.model import Edit, Question, Repair
from harness.model.errors import BadInput
from harness.packages.sources import wheel_patch

RECIPE = """
package = "Gym"
reason = "an extra of it requires what is no version"
link = "https://example.org/1"
build = ["setuptools==66.1.1"]
python = ">=3.7,<3.12"

[[edits]]
from = "opencv-python (>=3.)"
to = "opencv-python (>=3)"

[[edits]]
field = "Requires-Python"
from = ">=3.99"
to = ">=3.6"

[[releases]]
version = "0.21.0"
uploaded = 2021-10-06T22:04:25Z
sdist = "1111111111111111111111111111111111111111111111111111111111111111"
wheel = "2222222222222222222222222222222222222222222222222222222222222222"

[[releases]]
version = "0.9"
uploaded = 2020-01-01T00:00:00Z
sdist = "3333333333333333333333333333333333333333333333333333333333333333"
wheel = "4444444444444444444444444444444444444444444444444444444444444444"
"""
METADATA = """\
Metadata-Version: 2.1
Name: gym
Version: 0.21.0
Requires-Python: >=3.99
{lines}
License-File: LICENSE.md

A body with the words Requires-Dist: opencv-python (>=3.)
"""
LINES = (
    "Requires-Dist: numpy (>=1.18)",
    "Provides-Extra: all",
    "Requires-Dist: opencv-python (>=3.) ; extra == 'all'",
    "Requires-Dist: opencv-python-headless ; extra == 'all'",
)


def read() -> tuple[Repair, ...]:
    """Return the repairs of the recipe above."""
    return overlay_recipes.read(RECIPE, "gym.toml")


def wheel(lines: tuple[str, ...] = LINES, *, pure: bool = True, day: int = 1, order: int = 1) -> bytes:
    """Return a wheel as a build leaves it: compressed, in some order, with that day's times."""
    contents = {
        "gym/__init__.py": "VERSION = '0.21.0'\n",
        "gym/a, b.txt": "a name with a comma\n",
        "gym-0.21.0.data/scripts/run": "#!python\n",
        "gym-0.21.0.dist-info/METADATA": METADATA.format(lines="\n".join(lines)),
        "gym-0.21.0.dist-info/WHEEL": f"Wheel-Version: 1.0\nRoot-Is-Purelib: {str(pure).lower()}\n",
        "gym-0.21.0.dist-info/RECORD": "what the build wrote\n",
    }
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in list(contents)[::order]:
            info = zipfile.ZipInfo(name, (2026, 1, day, 0, 0, 0))
            info.external_attr = (0o100775 if "scripts" in name else 0o100664) << 16
            archive.writestr(info, contents[name])
    return file.getvalue()


def opened(content: bytes) -> dict[str, bytes]:
    """Return the files of a wheel, in their order."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


class TestRecipe:
    """Recipe files, and the repairs they describe."""

    def test_a_recipe_is_one_repair_for_each_release(self) -> None:
        """The oldest release comes first; what the recipe says of all of them is part of each."""
        old, new = read()

        assert (old.version, new.version) == ("0.9", "0.21.0")
        assert new == Repair(
            name="gym",
            version="0.21.0",
            uploaded="2021-10-06T22:04:25Z",
            origin="1" * 64,
            wheel="2" * 64,
            build=("setuptools==66.1.1",),
            python=">=3.7,<3.12",
            edits=(
                Edit(field="Requires-Dist", old="opencv-python (>=3.)", new="opencv-python (>=3)"),
                Edit(field="Requires-Python", old=">=3.99", new=">=3.6"),
            ),
            reason="an extra of it requires what is no version",
            link="https://example.org/1",
        )

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("setuptools==66.1.1", "setuptools<67",
             'gym.toml: build[0]: "setuptools<67" is not pinned; write it as in "setuptools==66.1.1"'),
            (">=3.7,<3.12", "3.9", 'gym.toml: python: "3.9" is not a specifier such as ">=3.7,<3.12"'),
            ('version = "0.9"', 'version = "0.21"', 'gym.toml: releases[1].version: "0.21" is listed twice'),
            ('version = "0.9"', 'version = "old"', 'gym.toml: releases[1].version: "old" is not a version'),
            ('field = "Requires-Python"', 'field = "Requires"',
             'gym.toml: edits[1].field: unknown value "Requires"; did you mean "Requires-Dist"?'),
            ('sdist = "3', f'wheel_from = "{"5" * 64}"\nsdist = "3',
             'gym.toml: releases[1]: name the file of the index that is repaired: either "sdist", which is built, or '
             '"wheel_from"'),
            (f'sdist = "{"3" * 64}"', "",
             'gym.toml: releases[1]: name the file of the index that is repaired: either "sdist", which is built, or '
             '"wheel_from"'),
            ('python = ">=3.7,<3.12"', "",
             'gym.toml: releases[0]: the sdist is built: say with which Pythons, as in python = ">=3.7,<3.12", at the '
             "top of the file"),
            ("from = ", "form = ", 'gym.toml: edits[0].form: unknown key; did you mean "from"?'),
        ],
    )  # fmt: skip
    def test_a_wrong_recipe_is_named_with_file_and_key(self, old: str, new: str, message: str) -> None:
        """The message names the file, the key and the right form."""
        with pytest.raises(BadInput) as caught:
            overlay_recipes.read(RECIPE.replace(old, new), "gym.toml")

        assert str(caught.value) == message

    def test_a_wheel_needs_nothing_to_build_it(self) -> None:
        """It is taken as the index has it, whatever builds the sdists beside it."""
        (old, new) = overlay_recipes.read(RECIPE.replace('sdist = "1', 'wheel_from = "1'), "gym.toml")

        assert (new.origin, new.build, new.python) == ("1" * 64, (), None)
        assert (old.origin, old.build, old.python) == ("3" * 64, ("setuptools==66.1.1",), ">=3.7,<3.12")

    def test_a_package_without_a_recipe_is_refused(self) -> None:
        """The message suggests the nearest name."""
        with pytest.raises(ValueError, match=r'^no recipe repairs "gmy"; did you mean "gym"\?$'):
            overlay_recipes.find_repairs({"gym": read()}, ("gmy",))


class TestFitting:
    """The repairs that a question may need."""

    @pytest.mark.parametrize(
        ("question", "versions"),
        [
            (Question(requirements=("gym==0.21",)), ["0.21.0"]),
            (Question(requirements=("Gym<0.21",)), ["0.9"]),
            (Question(requirements=("robots",)), ["0.9", "0.21.0"]),
            (Question(requirements=("gym==0.26.2",)), []),
            (Question(requirements=("gym==0.26.2; python_version < '3'",)), ["0.9", "0.21.0"]),
            (Question(requirements=("gym",), constraints=("gym>0.9",)), ["0.21.0"]),
            (Question(requirements=("gym==0.21",), overrides=("gym==0.9",)), ["0.9"]),
            (Question(requirements=("gym",), snapshot="2021-10-06T22:04:24Z"), ["0.9"]),
            (Question(requirements=("gym",), snapshot="2021-10-06T22:04:25Z"), ["0.9", "0.21.0"]),
            (Question(requirements=("robots",), absent=("gym",)), []),
        ],
    )
    def test_bounds_and_the_cutoff_leave_some_out(self, question: Question, versions: list[str]) -> None:
        """An override takes the place of a requirement, and a conditional one says nothing."""
        assert [one.version for one in overlay_recipes.select(read(), question)] == versions

    def test_used_are_those_whose_wheel_is_there(self) -> None:
        """A repair counts as used by the hash of its wheel, not by name and version."""
        assert [one.version for one in overlay_recipes.select_by_hash(read(), ("0" * 64, "2" * 64))] == ["0.21.0"]


class TestMending:
    """The wheel that comes out."""

    def test_only_the_named_lines_change(self) -> None:
        """Each line of the field that begins so, whatever follows; requirements and extras come in order."""
        made = opened(wheel_patch.repair_wheel(wheel(), read()[1]))

        assert made["gym-0.21.0.dist-info/METADATA"].decode() == (
            "Metadata-Version: 2.1\nName: gym\nVersion: 0.21.0\nRequires-Python: >=3.6\nLicense-File: LICENSE.md\n"
            "Provides-Extra: all\n"
            "Requires-Dist: numpy (>=1.18)\n"
            "Requires-Dist: opencv-python (>=3) ; extra == 'all'\n"
            "Requires-Dist: opencv-python-headless ; extra == 'all'\n"
            "\nA body with the words Requires-Dist: opencv-python (>=3.)\n"
        )
        before = opened(wheel())
        changed = {name for name in made if made[name] != before[name]}
        assert changed == {"gym-0.21.0.dist-info/METADATA", "gym-0.21.0.dist-info/RECORD"}

    def test_its_record_is_right(self) -> None:
        """Every file with hash and size, and itself without; it is the last file, as the standard wants."""
        made = opened(wheel_patch.repair_wheel(wheel(), read()[1]))
        record = "gym-0.21.0.dist-info/RECORD"
        rows = list(csv.reader(made[record].decode().splitlines()))

        assert rows[-1] == [record, "", ""]
        assert list(made)[-1] == record
        assert [row[0] for row in rows] == list(made)
        for name, mark, size in rows[:-1]:
            digest = base64.urlsafe_b64encode(hashlib.sha256(made[name]).digest()).decode().rstrip("=")
            assert (mark, size) == (f"sha256={digest}", str(len(made[name])))

    def test_it_is_the_same_to_the_byte(self) -> None:
        """Times, file order and requirement order of a build have no effect; some builds take them from a set."""
        other = wheel(LINES[::-1], day=2, order=-1)
        made = wheel_patch.repair_wheel(wheel(), read()[1])

        assert made == wheel_patch.repair_wheel(other, read()[1])
        assert wheel_patch.sha256(made) == "271f04a53041bb8e39899aff00d02db1a7e367054f30645e6c2dd5d70bfa543e"

    def test_scripts_stay_executable(self) -> None:
        """Other modes are those of the one who built it, and go."""
        with zipfile.ZipFile(io.BytesIO(wheel_patch.repair_wheel(wheel(), read()[1]))) as archive:
            modes = {info.filename: oct(info.external_attr >> 16) for info in archive.infolist()}

        assert modes.pop("gym-0.21.0.data/scripts/run") == "0o100755"
        assert set(modes.values()) == {"0o100644"}

    def test_an_edit_that_finds_nothing_is_refused(self) -> None:
        """The recipe was written for another wheel."""
        with pytest.raises(wheel_patch.Unrepairable) as caught:
            wheel_patch.repair_wheel(wheel(LINES[:2]), read()[1])

        assert str(caught.value) == (
            "gym 0.21.0: its metadata has no line that begins with `Requires-Dist: opencv-python (>=3.)`"
        )

    def test_a_wheel_for_one_machine_is_refused(self) -> None:
        """A compiled wheel is refused, since it cannot have the same hash everywhere."""
        with pytest.raises(wheel_patch.Unrepairable) as caught:
            wheel_patch.repair_wheel(wheel(pure=False), read()[1])

        assert str(caught.value) == "gym 0.21.0: only a wheel that fits every machine can be repaired"


def test_the_committed_recipes_can_be_read() -> None:
    """Each is called as its package is, and repairs something."""
    files = sorted((Path(__file__).parents[3] / "matrices" / "overlays").glob("*.toml"))

    assert files
    for file in files:
        made = overlay_recipes.read(file.read_text(encoding="utf-8"), file.name)
        assert {one.name for one in made} == {file.stem}
