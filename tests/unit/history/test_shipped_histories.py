"""The histories that come with the harness: each can be read, is small, and says what plain environments show."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.history import api_history, making, package_plan
from harness.standalone.explain.api_history import load_shipped, package_of
from harness.standalone.explain.import_names import package_with

PACKAGES = [*package_plan.load(making.PLAN).all_packages()]
MOST_BYTES = 150_000
"""Bytes of one file, compressed: about 40 ms to read."""

LEAST_NAMES = 400
"""Names of the smallest of the main packages, over all releases."""

MOST_BYTES_OF_ALL = 6 << 20

FACTS = [
    ("numpy", "names numpy bool8", "1.26.4", "2.0.0"),
    ("numpy", "names numpy float", "1.23.5", "1.24.0"),
    ("setuptools", "modules pkg_resources", "81.0.0", "82.0.0"),
    ("pillow", "names PIL.Image ANTIALIAS", "9.5.0", "10.0.0"),
    ("huggingface-hub", "names huggingface_hub cached_download", "0.25.2", "0.26.0"),
    ("protobuf", "modules google.protobuf.internal.builder", "3.20.0", "3.19.6"),
    ("typing-extensions", "names typing_extensions TypeIs", "4.10.0", "4.9.0"),
    ("moviepy", "modules moviepy.editor", "1.0.3", "2.0.0"),
    ("gymnasium", "names gymnasium.wrappers FrameStack", "0.29.1", "1.0.0"),
    ("pybullet", "names pybullet getJointStateMultiDof", "2.3.7", "2.3.6"),
    ("pybullet", "names pybullet changeDynamicsInfo", "1.0.3", "1.0.4"),
    ("gym", "modules gym.envs.classic_control.rendering", "0.21.0", "0.22.0"),
    ("python-library", "names inspect getargspec", "3.10", "3.11"),
    ("python-library", "modules distutils", "3.11", "3.12"),
    ("python-library", "members threading.Thread isAlive", "3.8", "3.9"),
    ("pandas", "members pandas.core.frame.DataFrame append", "1.5.3", "2.0.0"),
    ("scipy", "names scipy.integrate simps", "1.13.1", "1.14.0"),
]
"""Facts seen in environments or sources of these releases: the name is there in the first, and not in the second."""


def files() -> list[Path]:
    """Return all files of the folder."""
    return sorted(making.OUT.glob("*.json.gz"))


@pytest.mark.parametrize("package", PACKAGES)
def test_each_package_of_the_plan_has_a_history(package: str) -> None:
    """Releases are in order, some were read, and every span is among them."""
    file = making.OUT / f"{package}.json.gz"
    assert file.stat().st_size <= MOST_BYTES
    history = api_history.decode(file.read_bytes())
    assert history.package == package
    read = [place for place, release in enumerate(history.releases) if release.read]
    assert read
    assert history.modules
    assert all({place for span in spans for place in span} <= {*read} for spans in history.modules.values())


@pytest.mark.parametrize("package", package_plan.load(making.PLAN).searched)
def test_the_main_packages_have_names(package: str) -> None:
    """Of the twelve packages that most errors are about, names are read and not only modules."""
    history = load_shipped(package)
    assert history is not None
    assert sum(map(len, history.plain["names"].values())) > LEAST_NAMES


def test_the_histories_are_small() -> None:
    """They are in every wheel of the harness, and in the doctor's file."""
    assert sum(file.stat().st_size for file in files()) <= MOST_BYTES_OF_ALL


@pytest.mark.parametrize(("package", "path", "there", "not_there"), FACTS)
def test_a_history_says_what_an_environment_shows(package: str, path: str, there: str, not_there: str) -> None:
    """Both releases were read, and a name is in the one and not in the other."""
    history = load_shipped(package)
    assert history is not None
    spans = history.spans(*path.split(" ", 2)) or ()
    having = {history.versions[place] for place in history.read if any(first <= place <= last for first, last in spans)}
    assert {there, not_there} <= {history.versions[place] for place in history.read}
    assert (there in having, not_there in having) == (True, False)


@pytest.mark.parametrize(
    ("module", "package"),
    [
        ("gym.envs.robotics", "gym"),
        ("google.protobuf.json_format", "protobuf"),
        ("mujoco", "mujoco"),
        ("mujoco.mjx", "mujoco-mjx"),
        ("pkg_resources", "setuptools"),
        ("pybullet_envs.bullet", "pybullet"),
        ("PIL.Image", "pillow"),
        ("cv2", "opencv-python"),
        ("yaml", "pyyaml"),
        ("sklearn.ensemble", "scikit-learn"),
        ("OpenGL.GL", "pyopengl"),
        ("tree", "dm-tree"),
        ("Box2D", "box2d"),
        ("skimage", "scikit-image"),
        ("my_own_module", None),
        ("google.cloud", None),
    ],
)
def test_an_import_name_leads_to_its_package(module: str, package: str | None) -> None:
    """The table is made from the files of releases."""
    assert package_of(module) == package


def test_a_module_that_the_newest_release_lacks_is_not_to_be_had_by_installing_its_package() -> None:
    """The table tells so without a look into the history."""
    assert (package_of("pkg_resources"), package_with("pkg_resources")) == ("setuptools", None)
    assert package_with("setuptools") == "setuptools"


def test_wheels_are_listed_for_each_release() -> None:
    """Tags tell for which Python and platform there is one, also of releases that were not read."""
    history = load_shipped("numpy")
    assert history is not None
    releases = {entry["version"]: entry for entry in history.plain["releases"]}
    assert "cp310-cp310-manylinux_2_17_x86_64.manylinux2014_x86_64" in releases["1.21.6"]["wheels"]
    assert not any(tag.startswith("cp311") for tag in releases["1.21.6"]["wheels"])
    assert releases["1.21.6"]["python"] == ">=3.7,<3.11"
    assert any(tag.startswith("cp313-cp313") for tag in releases["2.1.0"]["wheels"])
