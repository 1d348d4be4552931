"""Test that the README and the documents are true."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from harness.commands import report
from harness.matrix import matrix_file, plan, signatures
from harness.matrix.matrix_types import Expansion
from harness.model.vocabulary import Instant
from harness.reports import readme_blocks

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MEASURE = (ROOT / "docs" / "guides" / "measure.md").read_text(encoding="utf-8")
LONGEST = 120
"""Lines of the README: one page."""


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_its_matrix_can_be_planned() -> None:
    """The example is a matrix: every case exists somewhere, every expectation meets a cell."""
    text, *_ = re.findall(r"```toml\n(.*?)```", MEASURE, re.DOTALL)
    matrix = matrix_file.read(text, "example.toml")
    expansion = Expansion(
        matrix="example",
        instant=Instant(str(matrix.snapshot)),
        ranges=matrix.ranges,
        axes={"mujoco": ("2.3.7", "3.0.1", "3.1.6")},
    )
    planned = plan.make_plan(plan.Sources(matrix=matrix, expansion=expansion, host_python="3.11.7"))

    assert len(planned.cells) == 12
    assert (planned.dropped, planned.stale) == ((), ())


def test_shown_parts_of_a_matrix_can_be_read() -> None:
    """The parts of a matrix that it shows apart: what is brought, a change."""
    parts = [part for part in re.findall(r"```toml\n(.*?)```", MEASURE, re.DOTALL) if "axes" not in part]
    axes = '[axes]\npython = ["3.9"]\nmujoco = ["3.3.7"]\n[[cases]]\nenv = "Ant-v5"\napi = "gymnasium"\n'
    read = [matrix_file.read(f"{part}\n{axes}", "m.toml") for part in parts]

    assert [(bool(matrix.bring), bool(matrix.change)) for matrix in read] == [(False, True), (True, False)]


def test_its_strategies_can_be_read() -> None:
    """Each line about strategies is one that a matrix file takes."""
    lines = re.findall(r"^(strategy = .*?)(?: *#.*)?$", MEASURE, re.MULTILINE)
    axes = 'axes = { python = ["3.11"], gymnasium = ["1.2.3"], mujoco = ["3.3.7"] }'
    cases = 'cases = [{ env = "Ant-v5", api = "gymnasium" }]'

    assert len(lines) == 5
    assert all(matrix_file.read(f"{line}\n{axes}\n{cases}\n", "m.toml").strategy for line in lines)


def test_ci_runs_its_test_command() -> None:
    """`.ci/run` ends with the very line that the README gives."""
    commands = re.findall(r"```\n(python3\.11 .*?)\n```", README)

    assert len(commands) == 2
    assert (ROOT / ".ci" / "run").read_text().rstrip().splitlines()[-1] == commands[1]


def test_it_is_one_page() -> None:
    """A reader sees the whole in a minute."""
    assert len(README.splitlines()) <= LONGEST


def test_files_that_it_names_exist() -> None:
    """Its links lead somewhere: to a file, or a folder of them."""
    links = [link.partition("#")[::2] for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]

    assert [file for file, _ in links if not (ROOT / file).exists()] == []
    assert [
        (file, anchor) for file, anchor in links if anchor and anchor not in anchors(ROOT / (file or "README.md"))
    ] == []


def test_the_list_of_reports_is_complete() -> None:
    """Each folder of `reports/` is linked from its list."""
    text = (ROOT / "docs" / "reports.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\(\.\./reports/([\w-]+)/", text))

    assert listed == {path.parent.name for path in (ROOT / "reports").glob("*/report.md")}


def test_the_known_issue_of_the_guide_can_be_read() -> None:
    """Its example is a file of known failures, with a pattern that meets its examples."""
    text = (ROOT / "docs" / "extending" / "known-issue.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (signature,) = signatures.read({"example.toml": table})

    assert signature.pattern
    assert all(re.search(signature.pattern, example) for example in signature.examples)


def test_the_environment_of_the_guide_can_be_read() -> None:
    """Its example is a matrix with one case."""
    text = (ROOT / "docs" / "extending" / "case.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)

    assert [case.env for case in matrix_file.read(table, "m.toml").cases] == ["Hopper-v5"]


def test_its_tables_are_current() -> None:
    """`simmatrix report --into README.md` would change nothing."""
    assert readme_blocks.renew_text(README, ROOT, report.render_block) == README


def test_contributors_can_read_of_every_nox_session() -> None:
    """The table has each session with its first line, and nothing else."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE)
    functions = [
        node for node in ast.parse((ROOT / "noxfile.py").read_text()).body if isinstance(node, ast.FunctionDef)
    ]
    assert listed == [(node.name, ast.get_docstring(node)) for node in functions]


def test_contributors_are_led_to_what_is_there() -> None:
    """Every link and every path in the page exists."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    paths = [
        *re.findall(r"\]\(([^)#]+)\)", text),
        *re.findall(r"`((?:tests|matrices|benchmarks|harness)/[\w./]*)`", text),
    ]
    assert [path for path in paths if not (ROOT / path).exists()] == []
