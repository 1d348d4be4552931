"""`ci`: linters of each platform are content, `--check` tells what is current, and bad input gets a sentence."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from datetime import date
from importlib.metadata import version
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.ci import pipelines
from harness.model import CellRecord
from harness.reports import document
from harness.reports.template_files import read_template
from harness.running import open_matrix

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / ".github" / "workflows" / "simmatrix.yml"
SCRIPTS = Path(sysconfig.get_path("scripts"))
MATRIX = """
requirements = ["fake-healthy"]
cases = [{ env = "fake_healthy:Healthy-v0", api = "gymnasium" }]

[axes]
python = ["host"]
numpy = { range = ">=2", rule = "newest" }
"""
EXPANDED = """{"matrix": "mine", "instant": "2026-01-01T00:00:00Z", "axes": {"numpy": ["2.4.0"]},
"ranges": {"numpy": {"range": ">=2", "rule": "newest"}}}"""


@pytest.fixture
def repository(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with a matrix and its expansion, which is the working folder."""
    folder = workplace / "repository"
    (folder / ".git").mkdir(parents=True)
    (folder / "matrices").mkdir()
    (folder / "matrices" / "mine.toml").write_text(MATRIX)
    (folder / "matrices" / "mine.expanded.json").write_text(EXPANDED)
    monkeypatch.chdir(folder)
    return folder


def ci_text(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the text that `ci` prints for the matrix."""
    assert main(["ci", "matrices/mine.toml", *arguments]) == 0
    return capsys.readouterr().out


def run_linter(*command: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a linter and return the ended process; skip the test if it is missing."""
    program = shutil.which(command[0], path=f"{SCRIPTS}{os.pathsep}{os.environ['PATH']}")
    if program is None:
        pytest.skip(f"missing library: {command[0]}")
    return subprocess.run([program, *command[1:]], capture_output=True, text=True, check=False)


def report(file: Path, seconds: float, cells: slice = slice(None)) -> None:
    """Write a report in which these cells took so many seconds."""
    plan = open_matrix.load("matrices/mine.toml", print, offline=True)
    records = [CellRecord(cell=cell, machine="here", seconds=seconds) for cell in plan.cells[cells]]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(document.encode(document.build(records, [plan], {"here": {}}, "2026-11-21T12:00:00Z")))


ZIZMOR = ("zizmor", "--offline", "--no-progress", "--persona", "auditor", "--no-config")
GITHUB = ("check-jsonschema", "--builtin-schema", "vendor.github-workflows")
GITLAB = ("check-jsonschema", "--builtin-schema", "vendor.gitlab-ci")


class TestLinters:
    @pytest.mark.parametrize(
        ("provider", "command", "wrong"),
        [
            pytest.param("github", ZIZMOR, ("persist-credentials: false", "fetch-depth: 1"), id="zizmor"),
            pytest.param("github", GITHUB, ("runs-on:", "run-on:"), id="github-schema"),
            pytest.param("gitlab", GITLAB, ("parallel: 1", "parallel: one"), id="gitlab-schema"),
            pytest.param("slurm", ("shellcheck", "--severity=style"), ('"$FAIL_ON"', "$FAIL_ON"), id="shellcheck"),
            pytest.param("slurm", ("bash", "-n"), ("esac", ""), id="bash"),
        ],
    )
    def test_has_nothing_to_say(
        self,
        repository: Path,
        capsys: pytest.CaptureFixture[str],
        provider: str,
        command: tuple[str, ...],
        wrong: tuple[str, str],
    ) -> None:
        """The platform's strictest linter accepts the file, and rejects a spoilt version of it."""
        text = ci_text(capsys, "--provider", provider, "--fail-on", "unexpected")
        file = repository / f"made.{'sh' if provider == 'slurm' else 'yml'}"
        file.write_text(text)

        done = run_linter(*command, file)
        assert done.returncode == 0, done.stdout + done.stderr

        assert text.count(wrong[0]) >= 1
        file.write_text(text.replace(*wrong))
        assert run_linter(*command, file).returncode != 0


class TestCheck:
    def test_current(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A file just written is up to date, whoever asks, however often; stdout stays empty."""
        for provider in pipelines.Provider:
            asked = ["ci", "matrices/mine.toml", "--provider", provider]
            assert main([*asked, "--out", "made"]) == 0
            assert (repository / "made").read_text() == ci_text(capsys, "--provider", provider)
            assert main([*asked, "--check", "made"]) == 0
            assert capsys.readouterr() == ("", "made: is up to date\n")

    def test_out_of_date(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A file made with other options or edited by hand gives exit code 1, the difference, and what to do."""
        main(["ci", "matrices/mine.toml", "--out", "made.yml", "--limit", "60"])
        capsys.readouterr()

        assert main(["ci", "matrices/mine.toml", "--check", "made.yml"]) == 1

        out, err = capsys.readouterr()
        lines = err.splitlines()
        assert out == ""
        assert "-# Made by `simmatrix ci matrices/mine.toml --provider github --limit 60`." in lines
        assert "+# Made by `simmatrix ci matrices/mine.toml --provider github`." in lines
        assert "-    timeout-minutes: 60" in lines
        assert lines[-1] == (
            "made.yml: is out of date; the command in its first lines, with --out made.yml, makes it again"
        )

    def test_a_long_difference_is_cut(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """The difference to a completely different file is cut after its beginning."""
        Path("made.yml").write_text("other\n")

        assert main(["ci", "matrices/mine.toml", "--check", "made.yml"]) == 1

        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 22
        assert lines[-2].startswith("... and 1")

    def test_our_own(
        self, workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """The workflow of this repository is up to date."""
        monkeypatch.chdir(ROOT)

        code = main(["ci", "quickstart", "--install", ".", "--check", str(WORKFLOW.relative_to(ROOT))])

        assert code == 0, capsys.readouterr().err


class TestPlanning:
    def test_shards(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """`--emit` prints the plan job's outputs and its summary."""
        assert ci_text(capsys, "--emit", "shards") == "count=1\nshards=[1]\n"
        assert ci_text(capsys, "--emit", "summary").startswith("## mine: 1 cell in 1 shard\n")

    def test_the_user_chooses_the_number_of_shards(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """`--shards` goes into the file that it makes, in the command and where the shards are."""
        text = ci_text(capsys, "--provider", "gitlab", "--shards", "7")

        assert text.startswith("# Made by `simmatrix ci matrices/mine.toml --provider gitlab --shards 7`.\n")
        assert "  parallel: 7\n" in text
        assert "--provider github --shards 7 --emit shards" in ci_text(capsys, "--shards", "7")

    def test_recorded_seconds_make_shards(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """Shards are balanced by the seconds of the committed report and of reports given with `--durations`.

        `run` gets the same `--durations`.
        """
        expansion = Path("matrices/mine.expanded.json")
        expansion.write_text(EXPANDED.replace('"2.4.0"', ", ".join(f'"2.{minor}.0"' for minor in range(6))))
        assert "count=1\n" in ci_text(capsys, "--emit", "shards")
        report(Path("reports/mine/report.json"), 600)
        assert "count=4\n" in ci_text(capsys, "--emit", "shards")
        assert "count=2\n" in ci_text(capsys, "--emit", "shards", "--minutes", "30")
        report(Path("longer.json"), 1500, slice(1))

        text = ci_text(capsys, "--durations", str(repository / "longer.json"))

        assert "count=5\n" in ci_text(capsys, "--emit", "shards", "--durations", "longer.json")
        assert "simmatrix ci matrices/mine.toml --provider github --durations longer.json --emit shards" in text
        assert "simmatrix run matrices/mine.toml -j auto --durations longer.json --shard" in text

    def test_installs_the_version_that_made_it(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A workflow installs the simmatrix version that wrote it, unless another one is requested."""
        assert f"pip install --quiet simmatrix=={version('simmatrix')}\n" in ci_text(capsys)


class TestBadInput:
    def refused(self, capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 2) -> str:
        """Return the message of a refused command, which prints nothing on stdout."""
        assert main(["ci", *arguments]) == code
        out, err = capsys.readouterr()
        assert out == ""
        return err

    def test_outside_the_repository(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A matrix that no checkout has is refused."""
        shutil.copytree("matrices", "../elsewhere")

        assert self.refused(capsys, "../elsewhere/mine.toml") == (
            "simmatrix: ../elsewhere/mine.toml: lies outside the working folder, so no checkout has it; copy it into"
            " the repository\n"
        )

    def test_not_at_the_root(
        self, repository: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """Paths in a workflow start at the root of the repository."""
        monkeypatch.chdir(repository / "matrices")

        assert self.refused(capsys, "mine.toml") == (
            "simmatrix: mine.toml: workflows run at the root of the repository; run this command there, in ..\n"
        )

    def test_absolute_path(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """An absolute path of the same file makes the same workflow."""
        expected = ci_text(capsys)

        assert main(["ci", str(repository / "matrices" / "mine.toml")]) == 0
        assert capsys.readouterr().out == expected

    def test_never_expanded(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A matrix without a stored expansion is refused: other jobs could get another plan from the index."""
        Path("matrices/mine.expanded.json").unlink()

        assert self.refused(capsys, "matrices/mine.toml", code=3) == (
            "simmatrix: matrices/mine.toml: its ranges were never expanded, which asks the index; run"
            " `simmatrix lock matrices/mine.toml` without --offline\n"
        )

    def test_too_many_shards(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """A plan with more shards than the platform allows is refused."""
        assert self.refused(capsys, "matrices/mine.toml", "--shards", "257") == (
            "simmatrix: --shards 257: github runs at most 256 jobs of one kind\n"
        )

    def test_option_of_another_platform(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """An option that the platform would ignore is refused."""
        assert self.refused(capsys, "matrices/mine.toml", "--provider", "slurm", "--install", ".") == (
            "simmatrix: --install: has no effect on slurm; leave it out\n"
        )

    def test_nothing_to_compare_with(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """`--check` on a missing file is bad input, not an outdated file."""
        assert self.refused(capsys, "matrices/mine.toml", "--check", "made.yml") == (
            "simmatrix: --check made.yml: cannot be read: No such file or directory; --out made.yml makes it\n"
        )

    def test_comparing_and_writing(self, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
        """`--check` and `--out` exclude each other."""
        assert self.refused(capsys, "matrices/mine.toml", "--check", "a", "--out", "a") == (
            "simmatrix: --check compares and --out writes: name one of them\n"
        )


# --- actions ---------------------------------------------------------------------------------------------------

COPIES = "SIMMATRIX_ACTIONS"
"""A folder of copies of the actions' repositories: OWNER+NAME or OWNER-NAME, bare or not."""


def copy_of(repository: str) -> Path:
    """The git folder of a copy."""
    places = Path(os.environ.get(COPIES) or os.devnull)
    owner, name = repository.split("/")
    heads = (head for found in places.glob(f"{owner}[+-]{name}") for head in (found, *found.glob("*")))
    copy = next((head for head in heads if (head / "HEAD").is_file()), None)
    if copy is None:
        pytest.skip(f"unavailable: copies of the actions' repositories (set {COPIES})")
    return copy


def test_commits_are_those_of_the_tags() -> None:
    """Read again from copies of the actions' repositories, each tag names the commit of the table."""
    table = pipelines.actions(read_template(pipelines.ACTIONS))
    for action in table.values():
        named = f"refs/tags/{action.tag}^{{commit}}"
        asked = ["git", "--git-dir", str(copy_of(action.repository)), "rev-parse", named]
        assert subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip() == action.commit
        assert action.read
        assert action.read <= date.today()
