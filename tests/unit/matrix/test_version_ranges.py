"""Ranges: which releases they come to, and when a committed expansion no longer holds."""

import tomllib
from pathlib import Path

import pytest
from packaging.version import Version

import harness
from harness.matrix import matrix_file, version_ranges
from harness.matrix.matrix_types import Matrix, RangeTable
from harness.model.errors import BadInput
from harness.model.vocabulary import Rule

RELEASES = [
    ("0.9", False),
    ("1.0", False),
    ("1.0.2", False),
    ("1.0.10", False),
    ("1.1.0", False),
    ("1.1.1", True),
    ("2.0.0rc1", False),
    ("2.0.0", False),
    ("2.0.0.post1", False),
    ("2.1", False),
    ("not-a-version", False),
]


def matrix(spec: str = ">=1.0", head: str = "") -> Matrix:
    """Return a matrix with one range."""
    return matrix_file.read(
        f'{head}\naxes = {{ python = ["3.11"], mujoco = {{ range = "{spec}" }} }}\n'
        '[[cases]]\nenv = "Ant-v5"\napi = "gymnasium"',
        "demo.toml",
    )


@pytest.mark.parametrize(
    ("rule", "versions"),
    [
        (Rule.ALL, ("1.0", "1.0.2", "1.0.10", "1.1.0", "2.0.0", "2.0.0.post1", "2.1")),
        (Rule.LATEST_PATCH, ("1.0.10", "1.1.0", "2.0.0.post1", "2.1")),
        (Rule.LATEST_MINOR, ("1.1.0", "2.1")),
        (Rule.NEWEST, ("2.1",)),
        (Rule.OLDEST_AND_NEWEST, ("1.0", "2.1")),
    ],
)
def test_rules(rule: Rule, versions: tuple[str, ...]) -> None:
    """A rule picks among the final, unyanked releases of the range, oldest first whatever the order given."""
    wanted = RangeTable(range=">=1.0", rule=rule)

    assert version_ranges.expand_range(wanted, RELEASES) == versions
    assert version_ranges.expand_range(wanted, reversed(RELEASES)) == versions


@pytest.mark.parametrize(
    ("breaks", "versions"),
    [
        ([], ("1.0.10", "1.1.0", "2.0.0.post1", "2.1")),
        (["1.0.2"], ("1.0", "1.0.2", "1.0.10", "1.1.0", "2.0.0.post1", "2.1")),
        (["1.0.5"], ("1.0.2", "1.0.10", "1.1.0", "2.0.0.post1", "2.1")),
        (["2.0"], ("1.0.10", "1.1.0", "2.0.0", "2.0.0.post1", "2.1")),
        (["1.0", "3.0"], ("1.0.10", "1.1.0", "2.0.0.post1", "2.1")),
    ],
)
def test_boundaries(breaks: list[str], versions: tuple[str, ...]) -> None:
    """Newest patches, and of each break inside the range the last release before it and the first one with it."""
    wanted = RangeTable(range=">=1.0", rule=Rule.BOUNDARIES)

    assert version_ranges.expand_range(wanted, RELEASES, map(Version, breaks)) == versions


def test_known_breaks() -> None:
    """Each is a release of its own with a reference; gym, gymnasium and mujoco are known."""
    text = (Path(harness.__file__).parent / "running" / "breaks.toml").read_text(encoding="utf-8")
    known = tomllib.loads(text)["breaks"]
    read = version_ranges.read_breaks(text, "breaks.toml")

    assert {"gym", "gymnasium", "mujoco"} <= read.keys()
    assert len({(each["package"], Version(each["version"])) for each in known}) == len(known)
    assert all(each["source"].startswith("https://") and each["what"] for each in known)
    assert read["gymnasium"] == (Version("0.27"), Version("1.0"), Version("1.1"))


def test_mistakes_in_breaks() -> None:
    """A file of breaks is read as strictly as any other."""
    with pytest.raises(BadInput) as error:
        version_ranges.read_breaks(
            '[[breaks]]\npackage = "gym"\nversion = "newest"\nwhat = "x"\nsource = "y"', "b.toml"
        )

    assert str(error.value) == 'b.toml: breaks[0].version: "newest" is not a version; ids name resolved versions only'


def test_prereleases_and_yanked_releases_when_asked_for() -> None:
    """Both are left out unless the range says so."""
    wanted = RangeTable(range=">=1.1,<=2.0.0", rule=Rule.ALL, prereleases=True, yanked=True)

    assert version_ranges.expand_range(wanted, RELEASES) == ("1.1.0", "1.1.1", "2.0.0rc1", "2.0.0")


def test_oldest_and_newest_of_one_release() -> None:
    """One release is not listed twice."""
    wanted = RangeTable(range="==2.1", rule=Rule.OLDEST_AND_NEWEST)

    assert version_ranges.expand_range(wanted, RELEASES) == ("2.1",)


def test_written_and_read_again() -> None:
    """The committed text reads as the expansion it was made from, and says what it was made from."""
    made = version_ranges.expand(matrix(), {"mujoco": RELEASES}, "2026-11-20T00:00:00Z")
    text = version_ranges.text_of(made)

    assert version_ranges.read(text, "demo.expanded.json") == made
    assert (
        text
        == """\
{
  "schema": 1,
  "matrix": "demo",
  "instant": "2026-11-20T00:00:00Z",
  "ranges": {
    "mujoco": {
      "range": ">=1.0",
      "rule": "latest-patch",
      "prereleases": false,
      "yanked": false
    }
  },
  "axes": {
    "mujoco": [
      "1.0.10",
      "1.1.0",
      "2.0.0.post1",
      "2.1"
    ]
  }
}
"""
    )


@pytest.mark.parametrize(
    ("later", "fits"),
    [
        pytest.param(matrix(), True, id="unchanged"),
        pytest.param(matrix(">=2.0"), False, id="another-range"),
        pytest.param(matrix(head="snapshot = 2026-11-20T00:00:00Z"), True, id="snapshot-of-its-instant"),
        pytest.param(matrix(head="snapshot = 2026-11-21"), False, id="another-snapshot"),
    ],
)
def test_an_expansion_fits_what_it_was_made_from(later: Matrix, fits: bool) -> None:
    """A range or a snapshot that changed since makes an expansion useless."""
    made = version_ranges.expand(matrix(), {"mujoco": RELEASES}, "2026-11-20T00:00:00Z")

    assert made.fits(later) is fits


def test_a_range_without_releases_is_refused() -> None:
    """A range that nothing falls into is a mistake in the matrix file."""
    with pytest.raises(BadInput) as error:
        version_ranges.expand(matrix(">=9"), {"mujoco": RELEASES}, "2026-11-20T00:00:00Z")

    assert str(error.value) == 'demo.toml: axes.mujoco: the index has no release that ">=9" allows'
