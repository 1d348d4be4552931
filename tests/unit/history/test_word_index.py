"""The index of words in which releases differ: `explain` opens only the histories that it names."""

from __future__ import annotations

import gzip

import msgspec

from harness.history import word_index
from harness.standalone.explain.history_words import packages_with

HISTORY = {
    "package": "wings",
    "releases": [{"version": "1", "read": True}, {"version": "2", "read": True}, {"version": "3"}],
    "names": {"wings": {"fly": [[0, 1]], "flap": [[1, 1]]}, "wings.deep": {"hidden": [[1, 1]]}},
    "members": {"wings.Bird": {"sing": [[0, 1]], "dive": [[0, 0]]}, "wings.Bat": {"hang": [[1, 1]]}},
    "signatures": {"wings.Bird.__init__": [[0, 0, "self, size"], [1, 1, "self, size=, colour="]]},
}


def test_only_words_in_which_releases_differ_are_listed() -> None:
    """A name of every release, a class that is there as long as its only member, and a deep module's name are not."""
    index = msgspec.json.decode(gzip.decompress(word_index.encode([HISTORY])))
    assert index == {
        "names": {"flap": ["wings"]},
        "members": {"dive": ["wings"]},
        "parameters": {"colour": ["wings"], "size": ["wings"]},
    }


def test_the_committed_index_is_that_of_the_committed_histories() -> None:
    """After a history was made anew, `python -m harness.history.word_index` is due."""
    made_anew = gzip.decompress(word_index.encode(word_index.read_histories(word_index.FOLDER)))
    assert gzip.decompress(word_index.INDEX.read_bytes()) == made_anew


def test_the_shipped_index_is_read() -> None:
    """A word that two packages have leads to both, an unknown one to none."""
    assert "gym" in packages_with("members", "seed")
    assert packages_with("members", "no_such_word") == []
