"""Expectations written for what is red: they select these cells and no others, and leave the rest of the file alone."""

import tomllib
from collections.abc import Sequence
from random import Random
from time import monotonic

import pytest
from builders import case, entry, make_plan, matrix, phase, record

from harness.matrix.matrix_types import Matrix
from harness.model import Cell, Outcome, Phase, Plan
from harness.model.errors import BadInput
from harness.model.report_types import CellEntry
from harness.reports import expectation_writer

TODAY = "2026-11-21T12:00:00Z"
HEAD = """\
# Walkers, old and new.
[axes]
python = ["3.10", "3.11"]
gymnasium = ["0.29.1", "1.2.3"] # two of them
mujoco = ["2.3.7", "3.3.7"]

[[cases]]
id = "ant"
env = "Ant-v5"
api = "gymnasium"
"""
LINE = "ValueError: bad [model] (line 3)"
WISH = expectation_writer.Wish(pattern="*mujoco3*", reason="the model of Ant is too old")


def planned(text: str) -> tuple[Matrix, Plan]:
    """Return the matrix in a text, and its plan."""
    walkers = matrix(text, "walkers.toml")
    return walkers, make_plan(walkers)


def measured(cell: Cell, line: str | None = None, machine: str = "linux", at: Phase = Phase.SINGLE) -> CellEntry:
    """Return the result of a cell: it works, or is broken with this line."""
    failed = case("pfff" if at is Phase.SINGLE else "fnnn", **{at.value: phase(at, Outcome.FAILED, line)})
    return entry(record(failed if line else case("pppp"), of=cell, machine=machine))


def results(cells: Sequence[Cell], red: Sequence[str], line: str = LINE) -> dict[str, list[CellEntry]]:
    """Return a result for every cell: `red` ones are broken with this line, all others work."""
    return {cell.id: [measured(cell, line if cell.label in red else None)] for cell in cells}


def accepted(
    text: str, red: Sequence[str], wish: expectation_writer.Wish = WISH, line: str = LINE
) -> expectation_writer.Rewrite:
    """Accept the red cells; whichever they are, they are as expected then, and the others as before."""
    matrix, before = planned(text)
    entries = results(before.cells, red, line)
    found, mixed = expectation_writer.reds(before.cells, entries, TODAY)
    made = expectation_writer.accept(text, matrix, before.cells, found, wish)
    _, after = planned(made.text)
    ids = [one.cell.id for one in found]
    wrong = expectation_writer.trouble(
        before.cells,
        after.cells,
        ids,
        lambda cell: [expectation_writer.as_expected(cell, e, TODAY) for e in entries[cell.id]],
    )
    assert (wrong, mixed) == (None, [])
    assert sorted(ids) == sorted(cell.id for cell in before.cells if cell.label in red)
    return made


def labels(**wanted: str) -> list[str]:
    """Return the labels of the cells with these values."""
    return [cell.label for cell in planned(HEAD)[1].cells if all(cell.axes[a] == v for a, v in wanted.items())]


class TestTables:
    def test_whole_table(self) -> None:
        """Cells with one reason share a table, which has all that the user said; what means something is escaped."""
        wish = expectation_writer.Wish(
            pattern="*", reason='too "old"', link="https://example.org/1", until="2026-12-31"
        )

        made = accepted(HEAD, labels(mujoco="3.3.7"), wish)

        assert made.tables == (
            '[[expect]]\nwhen = { mujoco = "3.3.7" }\nverdict = "broken"\nphase = "single"\n'
            "match = 'ValueError: bad \\[model\\] \\(line 3\\)'\n"
            'reason = "too \\"old\\""\nlink = "https://example.org/1"\nuntil = "2026-12-31"\n',
        )
        assert made.text == HEAD + "\n" + made.tables[0]

    @pytest.mark.parametrize(
        ("red", "selectors"),
        [
            (labels(), ['when = { python = ["3.10", "3.11"] }']),
            (labels(gymnasium="1.2.3"), ['when = { gymnasium = "1.2.3" }']),
            (labels(gymnasium="1.2.3", mujoco="3.3.7"), ['when = { gymnasium = "1.2.3", mujoco = "3.3.7" }']),
            (labels()[:1], ['cells = "py3.10_gymnasium-0.29.1_mujoco-2.3.7"']),
            ([*labels()[:1], *labels()[3:4]],
             ['cells = "py3.10_gymnasium-0.29.1_mujoco-2.3.7"', 'cells = "py3.10_gymnasium-1.2.3_mujoco-3.3.7"']),
            ([label for label in labels() if label not in labels(gymnasium="1.2.3", mujoco="2.3.7")],
             ['when = { gymnasium = "0.29.1" }', 'when = { mujoco = "3.3.7" }']),
        ],
    )  # fmt: skip
    def test_selectors(self, red: list[str], selectors: list[str]) -> None:
        """Values of one axis, of two, several such, or a label: what selects the red cells and no others."""
        assert [table.splitlines()[1] for table in accepted(HEAD, red).tables] == selectors

    def test_the_glob_that_chose_them(self) -> None:
        """If no axes tell the cells apart, the user's glob selects them, provided that it matches no others."""
        text = HEAD.replace('"3.3.7"]', '"3.3.7", "4.0.0"]')
        red = [f"py3.11_gymnasium-1.2.3_mujoco-{version}" for version in ("3.3.7", "4.0.0")]

        for pattern, selectors in {
            "py3.11_gymnasium-1*_mujoco-[34]*": ['cells = "py3.11_gymnasium-1*_mujoco-[34]*"'],
            "*mujoco-[34]*": [f'cells = "{label}"' for label in red],
        }.items():
            made = accepted(text, red, expectation_writer.Wish(pattern=pattern, reason="x"))
            assert [table.splitlines()[1] for table in made.tables] == selectors

    def test_our_own_sentence_is_expected_by_its_code(self) -> None:
        """Our own sentence is expected by code and data, so that it is recognised when its words change."""
        line = "ContractViolation: render() returned shape (480, 720, 4), not (height, width, 3)"
        (table,) = accepted(HEAD, labels()[:1], line=line).tables
        expect = tomllib.loads(table)["expect"][0]
        data = {"got": r"\(480, 720, 4\)", "promised": r"\(height, width, 3\)"}
        assert (expect["code"], expect["data"], "match" in expect) == ("render.shape", data, False)

    def test_a_long_line_is_cut(self) -> None:
        """Of a long line its beginning is expected, to the end of a word."""
        (table,) = accepted(HEAD, labels()[:1], line="Because " + "no wheel " * 100).tables

        match = tomllib.loads(table)["expect"][0]["match"]
        assert match == ("Because " + "no wheel " * 100)[: len(match)]
        assert 150 < len(match) <= expectation_writer.LONGEST

    @pytest.mark.parametrize(
        "line", ["it's \\d+ (a)", "tab\there", "quote \" and ' both \\", "ünï: 模型", "a|b^$.*?{}"]
    )
    def test_any_line_is_met_again(self, line: str) -> None:
        """Whatever the decisive line is, its expectation holds at once."""
        accepted(HEAD, labels(mujoco="2.3.7"), line=line)

    @pytest.mark.parametrize("seed", range(25))
    def test_any_cells(self, seed: int) -> None:
        """Whichever cells are red, before or after others were accepted, all of them and only they are accepted."""
        random = Random(seed)
        first = accepted(HEAD, random.sample(labels(), random.randrange(1, 8))).text
        second = accepted_more(first, random.sample(labels(), random.randrange(1, 8)))

        assert second.startswith(HEAD)


def accepted_more(text: str, red: Sequence[str]) -> str:
    """Accept cells red with another line, where the matrix expects something already; return the new text."""
    matrix, before = planned(text)
    entries = results(before.cells, red, "RuntimeError: other")
    found, _ = expectation_writer.reds(before.cells, entries, TODAY)
    made = expectation_writer.accept(text, matrix, before.cells, found, WISH)
    after = planned(made.text)[1]
    for cell in after.cells:
        (entry,) = entries[cell.id]
        if cell.label in red:
            assert expectation_writer.as_expected(cell, entry, TODAY) == (True, None)
        else:
            assert cell.expect == next(one.expect for one in before.cells if one.id == cell.id)
    return made.text


class TestFile:
    OLD = (
        "\n# known for long\n[[expect]]\nwhen = { mujoco = \">=3\" } # all of them\nverdict = \"partial\"\n"
        'reason = "old"\n\n# and this\n[[expect]]\ncells = "*mujoco2*"\nverdict = "import_fails"\nreason = "older"\n'
    )  # fmt: skip
    REST = "\n# the end\n[index]\nno_index = false\n"

    def test_before_the_table_that_would_catch_them(self) -> None:
        """A new table stands above the one that fits more; comments stay with their tables."""
        made = accepted(HEAD + self.OLD + self.REST, labels(mujoco="3.3.7", python="3.10"))

        assert made.text == HEAD + "\n" + made.tables[0] + self.OLD + self.REST
        assert made.replaced == ()

    def test_a_table_of_these_cells_alone_is_replaced(self) -> None:
        """A table that covers no other cell is removed with its comment, and the user is told."""
        made = accepted(HEAD + self.OLD + self.REST, labels(mujoco="3.3.7"))

        second = self.OLD[self.OLD.index("\n# and this") :]
        assert made.text == HEAD + second + "\n" + made.tables[0] + self.REST
        assert made.replaced == ("expect[0] is gone, which spoke of these cells alone: old",)

    def test_an_expectation_that_ran_out_is_renewed(self) -> None:
        """A cell whose expectation expired yesterday is accepted anew."""
        text = accepted(
            HEAD, labels(mujoco="3.3.7"), expectation_writer.Wish(pattern="*", reason="x", until="2026-11-22")
        ).text
        matrix, before = planned(text)
        entries = results(before.cells, labels(mujoco="3.3.7"))

        assert expectation_writer.reds(before.cells, entries, "2026-11-22T12:00:00Z") == ([], [])
        found, _ = expectation_writer.reds(before.cells, entries, "2026-11-23T00:00:00Z")
        made = expectation_writer.accept(text, matrix, before.cells, found, WISH)

        assert made.text == HEAD + "\n" + made.tables[0]

    def test_line_ends_stay(self) -> None:
        """A file of another system keeps its line ends."""
        text = (HEAD + self.OLD).replace("\n", "\r\n")

        made = accepted(text, labels(mujoco="2.3.7", python="3.10"))

        assert made.text.count("\n") == made.text.count("\r\n")
        assert made.text.startswith(HEAD.replace("\n", "\r\n"))

    def test_text_that_looks_like_a_table(self) -> None:
        """A table header inside a string is not a table."""
        text = 'description = """\n[[expect]]\n[x]\n"""\n' + HEAD + self.OLD

        made = accepted(text, labels(mujoco="3.3.7", python="3.10"))

        assert made.text == text.replace(self.OLD, "") + "\n" + made.tables[0] + self.OLD

    def test_expectations_in_one_array(self) -> None:
        """A file that writes them in another way is refused."""
        text = 'expect = [{ cells = "*mujoco2*", verdict = "broken", reason = "x" }]\n' + HEAD

        with pytest.raises(BadInput) as caught:
            accepted(text, labels(mujoco="3.3.7"))

        assert str(caught.value) == (
            "its expectations are not written as [[expect]] tables; write them so, and accept again"
        )


class TestReds:
    def test_cells_that_are_never_accepted(self) -> None:
        """Cells that work, have no result, or are red as expected are never accepted."""
        text = accepted(HEAD, labels(mujoco="3.3.7")).text
        _, known = planned(text)
        entries = results(known.cells, labels(mujoco="3.3.7"))

        assert expectation_writer.reds(known.cells, entries, TODAY) == ([], [])
        assert expectation_writer.reds(known.cells, {}, TODAY) == ([], [])

    def test_machines_that_differ(self) -> None:
        """No expectation fits a cell that works on one machine and is red on another."""
        _, before = planned(HEAD)
        cell = before.cells[0]
        entries = {cell.id: [measured(cell), measured(cell, LINE, "mac")]}

        found, mixed = expectation_writer.reds(before.cells, entries, TODAY)

        assert found == []
        assert mixed == [f"{cell.id}: works on linux, broken on mac; no expectation fits them all"]

    def test_machines_with_their_own_words(self) -> None:
        """One verdict for two reasons: either of them is expected."""
        matrix, before = planned(HEAD)
        cell = before.cells[0]
        entries = {cell.id: [measured(cell, "no GL"), measured(cell, "no EGL", "mac")]}

        found, _ = expectation_writer.reds(before.cells, entries, TODAY)
        made = expectation_writer.accept(HEAD, matrix, before.cells, found, WISH)

        assert 'match = "no EGL|no GL"' in made.text
        after = planned(made.text)[1].cells[0]
        assert [expectation_writer.as_expected(after, entry, TODAY) for entry in entries[cell.id]] == [(True, None)] * 2


def test_a_file_with_thousands_of_tables_is_read_once() -> None:
    """Tables are found in a time that grows with the file, not with its square."""
    tables = "".join(
        f'[[expect]]\ncells = "none-{number}"\nverdict = "broken"\nreason = """\n[not.a.table]\n"""\n\n'
        for number in range(3_000)
    )
    start = monotonic()

    made = accepted(HEAD + tables, labels(mujoco="3.3.7"))

    assert made.text == HEAD + tables.rstrip() + "\n\n" + made.tables[0]
    assert monotonic() - start < 30  # a few seconds, where the square takes minutes


@pytest.mark.parametrize("text", ["\U0001f600", "a\x7fb", 'quo"te', "back\\slash", "tab\tnew\nline", "é\x00\x1b"])
def test_any_text_can_be_expected(text: str) -> None:
    """Any text that is written is read again as it is."""
    made = accepted(HEAD, labels(mujoco="3.3.7"), expectation_writer.Wish(pattern="*", reason=text))

    assert [table["reason"] for table in tomllib.loads(made.text)["expect"]] == [text]
