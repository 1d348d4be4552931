"""The vendored `packaging` is the released one, and what is built on it means what today's `packaging` makes of it."""

from __future__ import annotations

import base64
import csv
import hashlib
import random
import re
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest
from packaging.markers import UndefinedComparison, default_environment
from packaging.requirements import InvalidRequirement
from packaging.requirements import Requirement as Theirs
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from harness.running.signatures import shipped_signatures
from harness.standalone import requirements, versions
from harness.standalone.requirements import Requirement
from harness.standalone.versions import Specifiers

ROOT = Path(__file__).parents[3]
VENDORED = Path(versions.__file__).parent / "vendored"
RECORD = VENDORED / "packaging-24.0.dist-info" / "RECORD"
WRITTEN = """
1 1.0 1.0.0 0 0.0 v1 1.0a 1.0a0 1.0-alpha-1 1.0_beta_2 1.0b2 1.0c1 1.0rc1 1.0.pre3 1.0.post 1.0-1 1.0.post1 1.0-r2
1.0.dev 1.0.dev0 1.0a1.dev2 1.0a1.post2 1.0a1.post2.dev3 1.0.post1.dev0 1!0 1!1.0 2!0.dev0 1.0+local 1.0+ubuntu-1
1.0.post1+cu118 2.0.1+cu118 20240101120000 1.0.0.0.1 1.10 1.9 3.11.0rc1 0.dev0
"""
OTHERWISE = re.compile(r">\d\S*(a|b|c|rc|pre|dev)|<\d\S*(post|rev|r\d|-)", re.IGNORECASE)
"""`>1.0b2` admits 1.0+local, and `<1.0.post1` admits 1.0b2, for today's `packaging`, and not for 24.0."""

OPERATORS = ("~=", "==", "!=", "<=", ">=", "<", ">", "===")


@cache
def corpus() -> tuple[str, ...]:
    """Return the requirements in this repository and in the packages installed here."""
    asked = {
        pin
        for lock in ROOT.glob("reports/*/locks/*.txt")
        for pin in re.findall(r"^([A-Za-z0-9][\w.-]*==[^\s;\\]+)", lock.read_text(), re.MULTILINE)
    }
    asked.update(text for one in metadata.distributions() for text in one.requires or ())
    asked.update(str(t) for one in shipped_signatures.load_all() for part in one.packages for t in part)
    matrices = " ".join(path.read_text() for path in ROOT.glob("matrices/**/*.toml"))
    asked.update(re.findall(r'"([A-Za-z][\w.-]*(?:\[\w+\])?[=<>!~][^"]*)"', matrices))
    return tuple(sorted(asked))


def is_requirement(text: str) -> bool:
    """Return whether `packaging` takes a requirement."""
    try:
        Theirs(text)
    except InvalidRequirement:
        return False
    return True


@pytest.mark.parametrize("row", list(csv.reader(RECORD.read_text().splitlines())), ids=lambda row: row[0])
def test_the_vendored_library_is_whole_and_unchanged(row: list[str]) -> None:
    """Every file has the hash of the released wheel, and there is no other one."""
    name, mark, _ = row
    content = (VENDORED / name).read_bytes()
    if mark:
        found = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        assert mark == f"sha256={found}"


def test_nothing_is_added_to_the_vendored_library() -> None:
    """The files in its folders are those that its RECORD lists."""
    listed = {row[0] for row in csv.reader(RECORD.read_text().splitlines())}
    there = {path.relative_to(VENDORED).as_posix() for path in VENDORED.glob("packaging*/**/*") if path.is_file()}
    assert {name for name in there if "__pycache__" not in name} == listed


def test_the_newest_that_fits() -> None:
    """The newest version that fits is returned, or None if none does."""
    assert Specifiers("<2").newest(["1.9", "1.10", "2.0", "what"]) == "1.10"
    assert Specifiers("<1").newest(["1.9", "2.0"]) is None


def test_a_text_that_is_no_version_fits_only_where_it_is_named() -> None:
    """`===` compares texts; every other operator refuses what is no version."""
    assert Specifiers("===any-Thing").admits("Any-thing")
    assert not Specifiers(">=0").admits("any-thing")
    assert Specifiers("").admits("any-thing")


def test_a_prerelease_may_be_spelt_with_a_dot() -> None:
    """`~=1.0.pre3` is `~=1.0rc3`, which admits every later 1."""
    assert Specifiers("~=1.0.pre3").admits("1.17.0")
    assert not Specifiers("~=1.0.pre3").admits("2.0")


def test_prereleases_fit() -> None:
    """A prerelease that is installed is there, whatever an installer would have chosen."""
    assert Specifiers(">=1").admits("2.0rc1")
    assert Specifiers(">=2.0rc1,<2.1").text == ">=2.0rc1,<2.1"


def test_unsatisfiable_specifiers_are_found() -> None:
    """Of one, two and three specifiers of the corpus that are asked for together."""
    sample = random.Random(7)
    odd = [f"{operator}{text}" for operator in OPERATORS for text in (*WRITTEN.split(), "1.0.*", "1!1.*")]
    asked = [str(Theirs(text).specifier) for text in corpus() if is_requirement(text)]
    known = []
    for text in dict.fromkeys([*odd, *asked]):
        try:
            known.append((text, Specifiers(text)))
        except ValueError:
            continue
    seen = {True: 0, False: 0}
    for count in (1, 2, 3):
        for _ in range(1500):
            chosen = [sample.choice(known) for _ in range(count)]
            if any(OTHERWISE.match(text) for text, _ in chosen):
                continue
            expected = SpecifierSet(",".join(text for text, _ in chosen)).is_unsatisfiable()
            seen[expected] += 1
            assert versions.unsatisfiable(ours for _, ours in chosen) is expected, [text for text, _ in chosen]
    assert min(seen.values()) > 300


ENVIRONMENTS = (
    {},
    {"python_version": "3.7", "python_full_version": "3.7.16", "sys_platform": "win32", "os_name": "nt"},
    {"python_version": "3.14", "python_full_version": "3.14.0rc1", "platform_python_implementation": "PyPy"},
    {"python_full_version": "3.12.0+", "platform_machine": "aarch64", "platform_release": "not-a-version"},
)


@pytest.mark.parametrize("changed", ENVIRONMENTS, ids=str)
def test_requirements_mean_the_same(changed: dict[str, str]) -> None:
    """Name, extras, URL, versions, and whether they count, in several environments, for extras and for none."""
    environment = {**default_environment(), **changed}
    asked = [text for text in corpus() if is_requirement(text)]
    assert len(asked) > 600
    for text in asked:
        expected, made = Theirs(text), Requirement(text)
        assert (made.name, made.url) == (canonicalize_name(expected.name), expected.url), text
        assert made.extras == {canonicalize_name(each) for each in expected.extras}
        for each in ("1.0", "1.0+local", "2.1", "0.9rc1"):
            assert made.specifiers.admits(each) is expected.specifier.contains(each, prereleases=True), (text, each)
        for extra in ("", "test", "all-of-it", "x"):
            assert applies(made, environment, extra) == applies_by_packaging(expected, environment, extra), (
                text,
                extra,
            )


def applies(made: Requirement, environment: dict[str, str], extra: str) -> bool | None:
    """Return whether a requirement applies in an environment; None if that cannot be decided."""
    try:
        return made.wanted(environment, (extra,) if extra else ())
    except ValueError:
        return None


def applies_by_packaging(expected: Theirs, environment: dict[str, str], extra: str) -> bool | None:
    """Return the same, as today's `packaging` answers it."""
    if expected.marker is None:
        return True
    try:
        return any(expected.marker.evaluate({**environment, "extra": one}) for one in dict.fromkeys(("", extra)))
    except UndefinedComparison:
        return None


@pytest.mark.parametrize("text", ["a b", "a>=", "a[b", "-a", "a; what == '1'", "a>=1 <2", ""])
def test_a_text_that_is_no_requirement_is_refused(text: str) -> None:
    """Callers skip it by a ValueError."""
    with pytest.raises(ValueError, match=r"."):
        Requirement(text)


def test_every_signature_can_be_read() -> None:
    """The packages and Pythons of each signature can be parsed by the vendored library."""
    for one in shipped_signatures.load_all():
        for part in one.packages:
            for text in part:
                assert requirements.requirement(str(text)).name == canonicalize_name(Theirs(text).name)
        if one.python:
            assert versions.specifiers(str(one.python)).clauses
