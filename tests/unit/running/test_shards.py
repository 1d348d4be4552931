"""Shards: about equal in recorded time, the same wherever they are computed."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from builders import cell_requiring

from harness.commands import select_cells
from harness.model import Cell, replace
from harness.model.errors import BadInput
from harness.reports import document
from harness.running import shards


def cell(name: str, question: str = "", python: str = "3.11") -> Cell:
    """Return a cell that asks for one package, its own unless another is named."""
    return cell_requiring(question or name, id=f"m/{name}", python=python)


def labels(split: tuple[tuple[Cell, ...], ...]) -> list[str]:
    """Return the labels of each shard's cells."""
    return ["".join(one.label for one in shard) for shard in split]


@pytest.mark.parametrize(
    ("seconds", "count", "expected"),
    [
        ({"a": 9, "b": 1, "c": 1, "d": 1}, 2, ["a", "bcd"]),
        ({"a": 5, "b": 4, "c": 3, "d": 2}, 2, ["ad", "bc"]),
        ({}, 2, ["ac", "bd"]),
        ({"a": 9}, 4, ["a", "b", "c", "d"]),
        ({"a": 10, "b": 2, "c": 2}, 2, ["a", "bcd"]),
        ({}, 6, ["a", "b", "c", "d", "", ""]),
        ({"a": 1}, 1, ["abcd"]),
    ],
    ids=["one-long", "longest-first", "unrecorded", "as-many", "median-of-unrecorded", "more-shards", "one"],
)
def test_split(seconds: dict[str, float], count: int, expected: list[str]) -> None:
    """Longest first, each to the shard with the least; what has no seconds counts as the median."""
    cells = [cell(name) for name in "abcd"]
    assert labels(shards.split(cells, count, {f"m/{name}": took for name, took in seconds.items()})) == expected


def test_cells_of_one_question_stay_together() -> None:
    """They share a lock and an environment, which one shard then makes alone; another Python shares neither."""
    cells = [cell("a", "x"), cell("b", "y"), cell("c", "x"), cell("d", "y"), cell("e", "x", "3.12")]
    assert labels(shards.split(cells, 2, {})) == ["ace", "bd"]
    assert labels(shards.split(cells, 3, {"m/a": 1, "m/b": 1, "m/c": 1, "m/d": 1, "m/e": 9})) == ["e", "ac", "bd"]


def test_a_group_beyond_a_fair_part_is_divided() -> None:
    """One question of eight cells does not keep three shards waiting."""
    cells = [cell(name, "x") for name in "abcdefgh"]
    assert labels(shards.split(cells, 4, {})) == ["ab", "cd", "ef", "gh"]


def test_every_cell_is_in_one_shard_and_shards_are_balanced() -> None:
    """No shard takes more than its fair part and the longest group."""
    some = random.Random(7)
    cells = [cell(str(number), str(some.randrange(40))) for number in range(200)]
    seconds = {one.id: some.expovariate(0.1) for one in cells if some.random() < 0.9}
    split = shards.split(cells, 7, seconds)
    assert sorted(one.id for shard in split for one in shard) == sorted(one.id for one in cells)
    assert all(list(shard) == sorted(shard, key=cells.index) for shard in split)
    loads = [sum(seconds.get(one.id, 7.0) for one in shard) for shard in split]
    assert max(loads) < 1.2 * min(loads)


def test_the_split_does_not_depend_on_the_order_of_the_cells() -> None:
    """Machines that name their matrices in another order run each cell once all the same."""
    cells = [cell(name, question) for name, question in zip("abcdefgh", "xxyyxyzx", strict=True)]
    seconds = {f"m/{name}": 0.1 * number for number, name in enumerate("abcde", 1)}

    for seed in range(20):
        shuffled = random.Random(seed).sample(cells, len(cells))

        for count in (2, 3):
            here, there = (shards.split(given, count, seconds) for given in (cells, shuffled))
            assert [{one.id for one in shard} for shard in there] == [{one.id for one in shard} for shard in here]


def test_the_split_depends_on_values_only() -> None:
    """Two machines that read the same matrix and the same report split alike, whatever objects they hold."""
    cells = [cell(str(number), str(number % 5)) for number in range(50)]
    copies = [replace(one, question=replace(one.question)) for one in cells]
    seconds = {f"m/{number}": float(number) for number in range(50)}
    backwards = dict(reversed(seconds.items()))
    assert labels(shards.split(cells, 3, seconds)) == labels(shards.split(copies, 3, backwards))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2", "'2' is not a shard; write I/N, such as 2/4 for the second of four"),
        ("a/b", "'a/b' is not a shard; write I/N, such as 2/4 for the second of four"),
        ("0/4", "'0/4': there is no shard 0 of 4; they are counted from 1"),
        ("5/4", "'5/4': there is no shard 5 of 4; they are counted from 1"),
        ("1/0", "'1/0': there is no shard 1 of 0; they are counted from 1"),
    ],
)
def test_a_wrong_shard_is_refused(text: str, message: str) -> None:
    """A message says what was wrong and how it is written."""
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the whole message is compared
        shards.Shard.parse(text)
    assert str(error.value) == message


def test_a_shard_reads_as_it_is_written() -> None:
    """`2/4` is the second of four."""
    assert shards.Shard.parse("2/4") == shards.Shard(number=2, count=4)
    assert str(shards.Shard(number=2, count=4)) == "2/4"


REPORT = Path(__file__).parents[3] / "reports" / "quickstart" / "report.json"


def test_seconds_come_from_a_report() -> None:
    """Each cell that was run has its seconds; one that was not has none."""
    known = document.read(REPORT.read_bytes(), "report.json")
    seconds = shards.recorded_seconds(known)
    assert seconds.keys() == {one.id for one in known.cells}
    assert all(took > 0 for took in seconds.values())


def test_the_committed_report_lies_beside_the_matrices(tmp_path: Path) -> None:
    """In a repository with `matrices/` it is in `reports/` next to that; else `reports/` is beside the matrix."""
    for folder in ("reports/one", "matrices/reports/two", "there/reports/one"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "report.json").touch()

    def found(matrix: str, name: str) -> str | None:
        report = select_cells.committed_report(tmp_path / matrix, name)
        return report.relative_to(tmp_path).as_posix() if report else None

    assert found("matrices/one.toml", "one") == "reports/one/report.json"
    assert found("matrices/two.toml", "two") == "matrices/reports/two/report.json"
    assert found("there/one.toml", "one") == "there/reports/one/report.json"
    assert found("there/two.toml", "two") is None


def test_a_report_that_is_not_there(tmp_path: Path) -> None:
    """`--durations` names a file that has to exist."""
    with pytest.raises(BadInput) as error:
        select_cells.durations([tmp_path / "nothing.json"])
    assert str(error.value) == f"--durations {tmp_path}/nothing.json: cannot be read: No such file or directory"
