"""The history of a package: what its releases offer, read from files, folded, and asked."""

from __future__ import annotations

import gzip

import pytest

from harness.history.api_history import MeasuredRelease, ReleaseEntry, encode, fold
from harness.history.release_reader import ReleaseFacts
from harness.standalone.explain.api_history import History, decode


def release(version: str, *names: str, signature: str = "self", read_it: bool = True) -> MeasuredRelease:
    """Return a release of the package `toy`, whose module has these names."""
    facts = ReleaseFacts(modules=("toy",), names={"toy": names}, signatures={"toy.Env.reset": signature})
    return MeasuredRelease(entry=ReleaseEntry(version=version, read=read_it), facts=facts if read_it else None)


def history(*releases: MeasuredRelease) -> History:
    """Return the history of releases, as it is read from its file."""
    made = decode(encode(fold("toy", releases)))
    assert made is not None
    return made


FOUR = (
    release("0.9", "Box"),
    release("0.10", "Box", "Monitor"),
    release("1.0", "Box", "Monitor", signature="self, *, seed="),
    release("2.0", "Box", signature="self, *, seed="),
)


def test_a_name_has_the_releases_that_have_it() -> None:
    """Spans are places of the first and last of consecutive releases."""
    made = history(*FOUR)
    assert made.versions == ["0.9", "0.10", "1.0", "2.0"]
    assert made.spans("names", "toy", "Box") == [[0, 3]]
    assert made.spans("names", "toy", "Monitor") == [[1, 2]]
    assert made.spans("signatures", "toy.Env.reset") == [[0, 1, "self"], [2, 3, "self, *, seed="]]
    assert made.spans("names", "toy", "Never") is None


def test_a_release_that_was_not_read_neither_has_a_name_nor_lacks_it() -> None:
    """A span goes on over releases that nobody read."""
    made = history(release("1.0", "Box"), release("1.1", read_it=False), release("1.2", "Box"), release("2.0"))
    assert made.spans("names", "toy", "Box") == [[0, 2]]
    where = made.where([[0, 2]], None)
    assert where is not None
    assert where.after == "2.0"


@pytest.mark.parametrize(
    ("version", "bound", "too_new"),
    [
        (None, "toy<2.0", True),
        ("2.0", "toy<2.0", True),
        ("0.9", "toy>=0.10,<2.0", False),
        ("3.1", "toy<2.0", True),
        ("1.0", None, None),
    ],
)
def test_the_bound_leads_from_the_release_at_hand_to_the_name(
    version: str | None, bound: str | None, too_new: bool | None
) -> None:
    """An older release needs a lower bound, a newer one an upper bound, and one that has the name needs none."""
    where = history(*FOUR).where([[1, 2]], version)
    assert (where and where.bound, where and where.too_new) == (bound, too_new)


@pytest.mark.parametrize(
    ("years", "bound"),
    [
        (("2018", "2021", "2022", "2024"), "toy>=0.10,<2.0"),
        (("2014", "2018", "2019", "2024"), "toy<2.0"),
        (("2014", "2015", "2016", "2024"), None),
    ],
)
def test_an_unknown_release_may_be_on_either_side_of_a_name_that_came_lately(
    years: tuple[str, ...], bound: str | None
) -> None:
    """A name of long ago is missing from newer releases alone, and one of very long ago accuses nobody."""
    plain = {"package": "toy", "releases": []}
    for version, year in zip(("0.9", "0.10", "1.0", "2.0"), years, strict=True):
        plain["releases"].append({"version": version, "uploaded": year, "read": True})
    where = History(plain).where([[1, 2]], None)
    assert (where and where.bound) == bound


def test_nothing_is_derived_of_what_all_releases_have_or_none() -> None:
    """The fault is then elsewhere."""
    made = history(*FOUR)
    assert made.where([[0, 3]], None) is None
    assert made.where(None, None) is None


def test_a_bound_holds_where_releases_between_were_not_read() -> None:
    """The bound is the last release that surely has the name: nobody knows which of the others lost it."""
    made = history(release("1.0", "Box"), release("1.1", read_it=False), release("1.2"), release("1.3"))
    where = made.where([[0, 0]], "1.3")
    assert where is not None
    assert (where.bound, where.after) == ("toy<=1.0", "1.2")
    candidate = history(release("1.0", "Box"), release("2.0rc1", read_it=False), release("2.0")).where([[0, 0]], None)
    assert candidate is not None
    assert candidate.bound == "toy<2.0"


def test_releases_are_read_without_names_until_names_are_asked_for() -> None:
    """The first line of a file has the releases alone."""
    content = encode(fold("toy", FOUR))
    damaged = decode(content[:-20])
    assert damaged is not None
    assert damaged.versions == ["0.9", "0.10", "1.0", "2.0"]
    with pytest.raises(EOFError):
        damaged.spans("names", "toy", "Box")


def test_a_release_read_by_its_files_alone_has_modules_and_no_names() -> None:
    """Of such a package nothing is derived from names."""
    releases = [
        MeasuredRelease(entry=ReleaseEntry(version=version, read=True), facts=ReleaseFacts(modules=modules))
        for version, modules in (("1.0", ("big", "big.old")), ("2.0", ("big",)))
    ]
    made = history(*releases)
    assert made.spans("modules", "big.old") == [[0, 0]]
    assert made.spans("names", "big", "anything") is None
    assert made.plain.get("names", {}) == {}


def test_a_name_from_another_package_counts_where_some_release_defines_it() -> None:
    """A class that moved to another package can still be imported from here."""
    own = ReleaseFacts(modules=("toy",), names={"toy": ("Trainer",)})
    moved = ReleaseFacts(modules=("toy",), names={"toy": ()}, imported={"toy": ("Trainer", "np")})
    releases = [
        MeasuredRelease(entry=ReleaseEntry(version=version, read=True), facts=facts)
        for version, facts in (("1.0", own), ("2.0", moved), ("3.0", ReleaseFacts(modules=("toy",), names={"toy": ()})))
    ]
    made = history(*releases)
    assert made.spans("names", "toy", "Trainer") == [[0, 1]]
    assert made.spans("names", "toy", "np") is None


def test_a_module_that_makes_names_as_it_runs_has_none() -> None:
    """They would seem to go where a release begins to make them so; importing a release shows them."""
    plain = ReleaseFacts(modules=("toy",), names={"toy": ("BOX",)})
    dynamic = ReleaseFacts(modules=("toy",), names={"toy": ()}, dynamic=("toy",))
    first = MeasuredRelease(entry=ReleaseEntry(version="1.0", read=True), facts=plain)
    entry = ReleaseEntry(version="2.0", read=True)
    unseen = history(first, MeasuredRelease(entry=entry, facts=dynamic))
    assert unseen.spans("names", "toy", "BOX") is None
    seen = history(first, MeasuredRelease(entry=entry, facts=dynamic, ran=ReleaseFacts(names={"toy": ("BOX",)})))
    assert seen.spans("names", "toy", "BOX") == [[0, 1]]


def test_a_file_of_another_form_is_no_history() -> None:
    """A newer harness may have written it."""
    plain = gzip.decompress(encode(fold("toy", FOUR)))
    assert decode(gzip.compress(plain)) is not None
    assert decode(gzip.compress(plain.replace(b'"package"', b'"form":9,"package"'))) is None


def test_equal_histories_are_equal_files() -> None:
    """No time of making gets into a file."""
    assert encode(fold("toy", FOUR)) == encode(fold("toy", FOUR))
