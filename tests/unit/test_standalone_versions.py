"""Versions, specifiers, requirements and markers without a library mean what `packaging` makes of them."""

from __future__ import annotations

import itertools
import random
import re
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from packaging.markers import UndefinedComparison, default_environment
from packaging.requirements import InvalidRequirement
from packaging.requirements import Requirement as Theirs
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion
from packaging.version import Version as TheirVersion

from harness.running import shipped_signatures
from harness.standalone import requirements, versions
from harness.standalone.requirements import Requirement
from harness.standalone.versions import Specifiers, Version

ROOT = Path(__file__).parents[2]
WRITTEN = """
1 1.0 1.0.0 0 0.0 v1 V1.0 1.0a 1.0a0 1.0.a1 1.0-alpha-1 1.0_beta_2 1.0b2 1.0c1 1.0rc1 1.0.pre3 1.0preview4 1.0.post
1.0-1 1.0.post0 1.0.post1 1.0-r2 1.0rev3 1.0.dev 1.0.dev0 1.0dev5 1.0a1.dev2 1.0a1.post2 1.0a1.post2.dev3
1.0.post1.dev0 1!0
1!1.0 2!0.dev0 1.0+local 1.0+1 1.0+01 1.0+ubuntu-1 1.0+a.b.1 1.0+a.1.b 1.0.post1+cu118 2.0.1+cu118 2.0.1+cpu 2024.1.1
20240101120000 1.0.dev20240101120000 01.02 1.0.0.0.1 1.10 1.9 1.0a. 1.0a- 1.0.post- 1..0 1.0..dev a 1.0+ 1.0++a 1.0+a_b
1.0-a.-1 1.0.rc-1 1.0rc1.post-2 1.0--1 -1 1.0.*  1.* .1 1. 1.0.0rc10 1.0RC1 1.0.DEV1 0.dev0 0.0.1.dev0 3.11.0rc1 3.11.0+
"""
ODD = WRITTEN.split()
OPERATORS = ("~=", "==", "!=", "<=", ">=", "<", ">", "===")
SAMPLE = 20_000


@cache
def corpus() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the versions and requirements in this repository and in the packages installed here."""
    found: set[str] = set(ODD)
    asked: set[str] = set()
    for lock in ROOT.glob("reports/*/locks/*.txt"):
        pins = re.findall(r"^([A-Za-z0-9][\w.-]*==[^\s;\\]+)", lock.read_text(), re.MULTILINE)
        asked.update(pins)
        found.update(pin.partition("==")[2] for pin in pins)
    for one in metadata.distributions():
        asked.update(one.requires or ())
        found.add(one.version)
    for signature in shipped_signatures.known():
        asked.update(str(text) for part in signature.packages for text in part.requirements)
    for name in re.findall(r'"([A-Za-z][\w.-]*(?:\[\w+\])?[=<>!~][^"]*)"', " ".join(_matrices())):
        asked.add(name)
    return tuple(sorted(found)), tuple(sorted(asked))


def _matrices() -> list[str]:
    return [path.read_text() for path in ROOT.glob("matrices/**/*.toml")]


def theirs(text: str) -> Any:
    """Return a version as `packaging` reads it, or None if it is not one."""
    try:
        return TheirVersion(text)
    except InvalidVersion:
        return None


def test_the_corpus_is_large() -> None:
    """Otherwise the tests here say little."""
    known, asked = corpus()
    assert (len(known) > 400, len(asked) > 600) == (True, True), (len(known), len(asked))


def test_versions_are_the_same_ones() -> None:
    """A text is a version for both or for none, and both write it alike."""
    for text in corpus()[0]:
        expected = theirs(text)
        assert versions.is_version(text) is (expected is not None), text
        if expected is not None:
            assert str(Version(text)) == str(expected)
            assert Version(text).is_prerelease is expected.is_prerelease


def test_versions_are_in_the_same_order() -> None:
    """Every pair of odd ones, and all of the corpus sorted."""
    fine = [text for text in corpus()[0] if theirs(text)]
    odd = [text for text in fine if text in ODD]
    for one, other in itertools.product(odd, odd):
        assert (Version(one) < Version(other)) is (theirs(one) < theirs(other)), (one, other)
        assert (Version(one) == Version(other)) is (theirs(one) == theirs(other)), (one, other)
    assert [str(each) for each in sorted(map(Version, fine))] == [str(each) for each in sorted(map(theirs, fine))]


def test_what_is_no_version_is_refused() -> None:
    """An invalid version is refused in one sentence."""
    with pytest.raises(ValueError, match=r'^"1\.\.0" is not a version$'):
        Version("1..0")


@cache
def specifiers() -> tuple[str, ...]:
    """Return the specifiers of the corpus, and every operator before every odd version."""
    odd = [f"{operator}{text}" for operator in OPERATORS for text in (*ODD, "1.0.*", "1!1.*", "1.0a1.*", "1.0+a.*")]
    asked = [str(Theirs(text).specifier) for text in corpus()[1] if _parses(text)]
    return tuple(dict.fromkeys([*odd, *asked, "", " >=1 , <2 ", ">=1,,<2", ",", ">=1,", ">= 1", ">=1 <2", "1", "=1"]))


def _parses(text: str) -> bool:
    try:
        Theirs(text)
    except InvalidRequirement:
        return False
    return True


def test_specifiers_admit_the_same_versions() -> None:
    """Prereleases among them; what is none for one is none for the other."""
    sample = random.Random(6)
    pairs = list(itertools.product(specifiers(), corpus()[0]))
    for text, each in sample.sample(pairs, min(SAMPLE, len(pairs))):
        try:
            expected = SpecifierSet(text)
        except InvalidSpecifier:
            with pytest.raises(ValueError, match="is not a specifier"):
                Specifiers(text)
            continue
        assert Specifiers(text).admits(each) is expected.contains(each, prereleases=True), (text, each)


def test_the_newest_that_fits() -> None:
    """The newest version that fits is returned, or None if none does."""
    assert Specifiers("<2").newest(["1.9", "1.10", "2.0", "what"]) == "1.10"
    assert Specifiers("<1").newest(["1.9", "2.0"]) is None


def test_what_nothing_fits_is_told() -> None:
    """Of one, two and three specifiers of the corpus that are asked for together."""
    sample = random.Random(7)
    known = []
    for text in specifiers():
        try:
            known.append((text, SpecifierSet(text), Specifiers(text)))
        except (InvalidSpecifier, ValueError):
            continue
    seen = {True: 0, False: 0}
    for count in (1, 2, 3):
        for _ in range(1500):
            chosen = [sample.choice(known) for _ in range(count)]
            together = SpecifierSet(",".join(text for text, _, _ in chosen))
            expected = together.is_unsatisfiable()
            seen[expected] += 1
            assert versions.unsatisfiable(ours for _, _, ours in chosen) is expected, [text for text, _, _ in chosen]
    assert min(seen.values()) > 300


MARKERS = """
python_version<"3.11"|python_version >= '3.8' and sys_platform == "linux"|python_version in "3.8, 3.9"
(python_version<"3.8" or os_name=="nt") and extra == "All_Of-it"|extra=='test' or extra == 'docs'
'linux' in sys_platform
"3.9" <= python_version|python_full_version < "3.11.0rc1"|platform_python_implementation != 'PyPy'|os.name == 'posix'
sys.platform == 'win32'|python_implementation == 'CPython'|platform_machine not in 'arm64 aarch64'
python_version == "3.1*"
python_version == '3.*'|python_version ~= '3.8'|platform_release >= "5"|implementation_version>"3"|sys_platform<'linux'
python_version>"3" and (extra=="a" or (extra=="b" and os_name!="nt"))|'a' in extras|python_version not  in '3.7'
|python_version|python_version<3|what=="1"|python_version<"3"and os_name=="posix"|(os_name=="posix"|extra=="
python_version === '3.11'|os_name ~= "x"|sys_platform>="linux"|python_version <= 'new'
""".replace("\n", "|").split("|")  # fmt: skip


@cache
def asked() -> tuple[str, ...]:
    """Return the requirements of the corpus, odd ones, and every marker."""
    odd = """a|a[b]|A.B_c[X, y_Z]>=1|a[]|a[,]|a[b,]|a[b|a (>=1,<2)|a(>=1)|a (>=1|a >=1 , <2|a>=1,|a>=1,,<2|a,|a=1
a==1.*,!=1.3.*
a @ https://example.org/a.whl|a @ https://example.org/a.whl ; os_name=="nt"|a@file:///x|a @|a @ x;os_name=="nt"
a @ x os_name
-a|a-|a.|_a|a b|a;|a ;os_name=="nt"|a;os_name=="nt";|1a|a>=1.0+local|a==1.0+local|a===any-Thing|a~=1|a~=1.0|a>1.*| a |é|
a>=1;extra=="x"|a[b]@x|a [b] >=1|a>=1 <2|a==1 ; |a >= 1.0 ;python_version<"3"|a<2!1|a; extra == 'x' and extra == 'y'"""
    marked = [f"a; {marker}" for marker in MARKERS]
    return tuple(dict.fromkeys([*odd.replace("\n", "|").split("|"), *marked, *corpus()[1]]))


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
    for text in asked():
        try:
            expected = Theirs(text)
        except InvalidRequirement:
            with pytest.raises(ValueError, match=r"is not a (requirement|marker)"):
                Requirement(text)
            continue
        made = Requirement(text)
        assert (made.name, made.url) == (canonicalize_name(expected.name), expected.url), text
        assert made.extras == {canonicalize_name(each) for each in expected.extras}
        for each in ("1.0", "1.0+local", "2.1", "0.9rc1", "any-Thing"):
            assert made.specifiers.admits(each) is expected.specifier.contains(each, prereleases=True), (text, each)
        for extra in ("", "test", "all-of-it", "x"):
            assert holds(made, environment, extra) == _evaluated(expected, environment, extra), (text, extra)


def holds(made: Requirement, environment: dict[str, str], extra: str) -> bool | None:
    """Return whether a requirement applies in an environment; None if that cannot be decided."""
    try:
        return made.wanted(environment, (extra,) if extra else ())
    except ValueError:
        return None


def _evaluated(expected: Theirs, environment: dict[str, str], extra: str) -> bool | None:
    if expected.marker is None:
        return True
    try:
        found = [
            expected.marker.evaluate({**environment, "extra": one, "extras": set()}, context="requirement")  # type: ignore[arg-type]
            for one in dict.fromkeys(("", extra))
        ]
    except UndefinedComparison:
        return None
    return any(found)


@pytest.mark.parametrize("marker", ["'a' == 'b'", "os_name == sys_platform"])
def test_a_comparison_of_no_variable_or_of_two_is_refused(marker: str) -> None:
    """It says nothing about an environment; `packaging` takes it, and then cannot say what it means."""
    with pytest.raises(ValueError, match="is not a marker"):
        Requirement(f"a; {marker}")


def test_a_missing_variable_is_told() -> None:
    """An environment has to give what a marker asks of it."""
    with pytest.raises(KeyError):
        Requirement("a; os_name == 'posix'").wanted({})


def test_every_signature_can_be_read_without_a_library() -> None:
    """The packages and Pythons of each signature can be parsed without `packaging`."""
    for one in shipped_signatures.known():
        for part in one.packages:
            for text in part.requirements:
                assert requirements.requirement(str(text)).name == canonicalize_name(Theirs(text).name)
        if one.python:
            assert versions.specifiers(str(one.python)).clauses
