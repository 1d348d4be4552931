"""Test the files that `ci` writes for a matrix: whole, for each platform, with least rights and proportional shards."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from specimens import quick

import harness
from harness.ci import pipelines
from harness.ci.pipelines import Action, Pipeline, Provider
from harness.model import Dropped, replace
from harness.model.errors import BadInput

TEMPLATES = Path(harness.__file__).parent / "reports" / "templates"
ACTIONS = pipelines.actions((TEMPLATES / pipelines.ACTIONS).read_text(encoding="utf-8"))
PIPELINE = Pipeline(
    matrix="matrices/a b.toml",
    name="a.b",
    made_by="simmatrix ci 'matrices/a b.toml'",
    shards=3,
    planning="--provider github --minutes 20",
    measuring="-j auto",
    state="${{ hashFiles('matrices/a b.toml') }}",
    dated=True,
    install="simmatrix==0.1.0",
    python="3.12",
    branch="trunk",
    runner="ubuntu-24.04",
    limit=90,
    fail_on="unexpected,not_run",
)


def rendered(provider: Provider, actions: dict[str, Action] = ACTIONS, **changed: Any) -> str:
    """Return the file for a platform."""
    template = (TEMPLATES / pipelines.TEMPLATES[provider]).read_text(encoding="utf-8")
    return pipelines.render(replace(PIPELINE, **changed), template, actions)


def github(**changed: Any) -> dict[Any, Any]:
    """Return the parsed workflow for GitHub. (`on` is `True` to a YAML 1.1 reader.)"""
    return dict(yaml.safe_load(rendered(Provider.GITHUB, **changed)))


def steps(workflow: dict[Any, Any]) -> list[dict[str, Any]]:
    """Return every step of every job."""
    return [step for job in workflow["jobs"].values() for step in job["steps"]]


class TestGitHub:
    def test_rights_are_the_least(self) -> None:
        """Nothing is granted but reading the contents, where something is checked out; no credential is left behind."""
        workflow = github()

        assert workflow["permissions"] == {}
        for job in workflow["jobs"].values():
            checkouts = [step for step in job["steps"] if "checkout" in step.get("uses", "")]
            assert job["permissions"] == ({"contents": "read"} if checkouts else {})
            assert [step["with"]["persist-credentials"] for step in checkouts] == [False] * len(checkouts)

    def test_works_for_forks(self) -> None:
        """It starts by the event that forks may start, and wants no secret."""
        assert set(github()[True]) == {"pull_request", "push", "schedule", "workflow_dispatch"}
        assert "secrets." not in rendered(Provider.GITHUB)

    def test_every_action_stands_in_the_table(self) -> None:
        """Each action is used by commit and tag, as in the table, and the table has no other."""
        used = {re.sub(r"^\s*uses: ", "", line) for line in re.findall(r".*uses: .*", rendered(Provider.GITHUB))}

        assert used == {str(action) for action in ACTIONS.values()}
        assert all(re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line) for line in used)

    def test_an_action_without_commit_is_taken_by_tag(self) -> None:
        """An action without a commit is pinned by its tag, and the file says so."""
        by_tag = {name: Action(repository=action.repository, tag=action.tag) for name, action in ACTIONS.items()}
        text = rendered(Provider.GITHUB, actions=by_tag)

        assert (
            f"uses: actions/cache@{ACTIONS['cache'].tag}"
            " # by tag: no copy of its repository was at hand to read the commit from\n"
        ) in text
        assert "# An action stands here by the commit" not in text

    def test_no_expression_inside_a_script(self) -> None:
        """Values of a run reach scripts through variables, where they cannot become code."""
        assert [step["run"] for step in steps(github()) if "${{" in step.get("run", "")] == []

    def test_one_check_waits_for_every_other_job(self) -> None:
        """It runs whatever became of them, and its name depends on the matrix alone."""
        jobs = github()["jobs"]
        gate = jobs.pop("simmatrix")

        assert set(gate["needs"]) == set(jobs)
        assert (gate["name"], gate["if"]) == ("simmatrix a.b", "${{ always() }}")

    def test_every_job_ends(self) -> None:
        """Each job has a limit; that of a shard was asked for."""
        limits = {name: job["timeout-minutes"] for name, job in github(limit=45)["jobs"].items()}

        assert limits == {"plan": 10, "shard": 45, "merge": 15, "simmatrix": 5}

    def test_shards_are_counted_when_it_runs(self) -> None:
        """One red shard ends no other, and the matrix may grow without a new workflow."""
        jobs = github()["jobs"]

        assert jobs["shard"]["strategy"]["fail-fast"] is False
        assert jobs["shard"]["strategy"]["matrix"] == {"shard": "${{ fromJSON(needs.plan.outputs.shards) }}"}
        assert rendered(Provider.GITHUB, shards=3) == rendered(Provider.GITHUB, shards=4)

    def test_options_reach_the_commands(self) -> None:
        """Matrix, branch, Python, runner, what is installed and what fails are those that were asked for."""
        workflow = github()
        scripts = "\n".join(step.get("run", "") for step in steps(workflow))

        assert "simmatrix ci 'matrices/a b.toml' --provider github --minutes 20 --emit shards" in scripts
        assert "python -m pip install --quiet simmatrix==0.1.0" in scripts
        assert "--format github --fail-on unexpected,not_run" in scripts
        assert workflow[True]["push"] == {"branches": ["trunk"]}
        assert {step["with"]["python-version"] for step in steps(workflow) if "python" in step.get("uses", "")} == {
            "3.12"
        }
        assert {job["runs-on"] for job in workflow["jobs"].values()} == {"ubuntu-24.04"}

    def test_cache_belongs_to_the_state_of_the_matrix(self) -> None:
        """A changed matrix makes a cache of its own out of an older one."""
        (cache,) = (step["with"] for step in steps(github()) if "cache@" in step.get("uses", ""))

        assert cache["key"].endswith("-${{ matrix.shard }}-${{ hashFiles('matrices/a b.toml') }}")
        older = cache["restore-keys"].split("\n")
        assert cache["key"].startswith(older[0])
        assert older[0].startswith(older[1])

    def test_cache_of_a_matrix_without_snapshot_is_renewed(self) -> None:
        """The cache key holds the week: locks change from week to week, and GitHub never overwrites a cache."""
        workflow = github(dated=False)
        plan, shard = workflow["jobs"]["plan"], workflow["jobs"]["shard"]
        cache = next(step["with"] for step in shard["steps"] if "restore-keys" in step.get("with", {}))

        assert cache["key"].endswith("-${{ hashFiles('matrices/a b.toml') }}-${{ needs.plan.outputs.week }}")
        assert cache["key"].startswith(cache["restore-keys"].split("\n")[0])
        assert plan["outputs"]["week"] == "${{ steps.plan.outputs.week }}"
        assert plan["steps"][-1]["run"].endswith('date -u +week=%G-%V >> "$GITHUB_OUTPUT"\n')
        assert "week" not in rendered(Provider.GITHUB)


class TestGitLab:
    def test_shards_stand_in_the_file(self) -> None:
        """`parallel` takes a number only; reports of all shards are kept apart and united."""
        made = yaml.safe_load(rendered(Provider.GITLAB))

        assert made["shard"]["parallel"] == 3
        assert made["shard"]["script"][-1] == (
            "simmatrix run 'matrices/a b.toml' -j auto --shard \"$CI_NODE_INDEX/$CI_NODE_TOTAL\" "
            "--out \"shards/$CI_NODE_INDEX\" --fail-on ''"
        )
        assert made["shard"]["artifacts"]["paths"] == ["shards"]
        assert made["merge"]["script"] == ["simmatrix merge shards --out merged --fail-on unexpected,not_run"]

    def test_the_merge_runs_whatever_became_of_the_shards(self) -> None:
        """A lost shard is told by the report, not by its absence."""
        made = yaml.safe_load(rendered(Provider.GITLAB))

        assert (made["merge"]["when"], made["merge"]["needs"]) == ("always", ["shard"])
        assert made["shard"]["artifacts"]["when"] == "always"


class TestSlurm:
    def test_values_of_the_file(self) -> None:
        """Shards and time are those that were asked for, a change from outside goes before them."""
        text = rendered(Provider.SLURM, limit=75)

        assert ': "${SHARDS:=3}"' in text
        assert ': "${TIME:=1:15:00}"' in text
        assert "\nmatrix='matrices/a b.toml'\n" in text


@pytest.mark.parametrize("provider", Provider)
def test_the_file_says_how_it_was_made(provider: Provider) -> None:
    """The command stands in the first lines, and the text ends with one line end."""
    text = rendered(provider)

    assert "Made by `simmatrix ci 'matrices/a b.toml'`." in "".join(text.splitlines()[:2])
    assert text.endswith("\n")
    assert not re.search(r"<<|>> *it\.|\n\n\n|[ \t]\n", text)


@pytest.mark.parametrize(("name", "action"), ACTIONS.items())
def test_table_of_actions(name: str, action: Action) -> None:
    """A whole version, a whole commit, and the day on which it was read; named as its repository is."""
    assert action.repository == f"actions/{name}"
    assert re.fullmatch(r"v\d+\.\d+\.\d+", action.tag)
    assert re.fullmatch(r"[0-9a-f]{40}", action.commit or "")
    assert action.read


# --- shards ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cells", "seconds", "most", "count"),
    [
        pytest.param(6, {}, 256, 1, id="little work is one shard"),
        pytest.param(120, {}, 256, 8, id="unmeasured cells take a minute each"),
        pytest.param(120, {str(at): 5.0 for at in range(120)}, 256, 1, id="recorded seconds count"),
        pytest.param(120, {"0": 90.0, "1": 100.0, "2": 900.0}, 256, 15, id="others are taken for usual ones"),
        pytest.param(3, {"0": 5000.0}, 256, 3, id="never more than cells"),
        pytest.param(120, {"0": 100_000.0}, 20, 20, id="never more than the platform takes"),
    ],
)
def test_shard_count(cells: int, seconds: dict[str, float], most: int, count: int) -> None:
    """There are as many shards of a quarter of an hour as there is work for."""
    assert pipelines.shard_count([str(at) for at in range(cells)], seconds, 15, most) == count


def test_shard_outputs() -> None:
    """Two outputs of a step, one of them a JSON list."""
    assert pipelines.shard_outputs(3) == "count=3\nshards=[1, 2, 3]\n"


def test_plan_page_counts_combinations() -> None:
    """One line of a strategy counts as many left-out combinations as it stands for."""
    dropped = (Dropped(id="quick/py3.9_*", reason="too old", count=4), Dropped(id="quick/*", reason="rest", count=301))

    page = pipelines.plan_page(replace(quick()[0], dropped=dropped), 2)

    assert page.splitlines()[-6:-2] == [
        "<details><summary>305 combinations left out</summary>",
        "",
        "- 4: too old",
        "- 301: rest",
    ]


def test_plan_page() -> None:
    """The summary of the plan job: how much, over what, and what was left out."""
    plan, _ = quick()

    assert pipelines.plan_page(replace(plan, stale=("nobody expects this",)), 2).splitlines() == [
        "## quick: 8 cells in 2 shards",
        "",
        "| axis | values |",
        "| --- | --- |",
        "| python | 3.9, 3.11, 3.13 |",
        "| gymnasium | 0.29.1, 1.2.3 |",
        "| mujoco | 1.50, 2.3.7, 3.3.7 |",
        "",
        "Out of date: nobody expects this.",
        "",
        "<details><summary>2 combinations left out</summary>",
        "",
        "- 2: gymnasium 1.2 needs Python 3.10",
        "",
        "</details>",
    ]


# --- what does not go into a workflow --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["a'b.toml", "${{ x }}.toml", "a\nb.toml", "$(id).toml", "", " a.toml", "a`b`", "-x.toml", "a -x"]
)
def test_texts_that_a_platform_would_read(text: str) -> None:
    """A quote, an expression, a line end, what would be an option never reach the file."""
    with pytest.raises(BadInput) as caught:
        pipelines.plain(text, "MATRIX")
    assert str(caught.value) == (
        f"MATRIX {text!r}: a workflow takes letters, digits, spaces and ./+@:_- here, no word that starts with -"
    )


@pytest.mark.parametrize("text", ["3.10", "2.7", "3", "pypy3.11", "3.11; id", ""])
def test_pythons_that_are_too_old(text: str) -> None:
    """The harness itself needs a newer one than cells do."""
    with pytest.raises(BadInput) as caught:
        pipelines.python(text)
    assert str(caught.value) == f"--python {text}: simmatrix runs on Python 3.11 or newer; cells on any"


def test_oldest_python() -> None:
    """It is the one that the project declares."""
    declared = tomllib.loads((Path(harness.__file__).parents[1] / "pyproject.toml").read_text())["project"]

    assert declared["requires-python"] == f">={'.'.join(map(str, pipelines.OLDEST))}"
    assert pipelines.python("3.11") == "3.11"


@pytest.mark.parametrize(
    ("text", "quoted"),
    [
        (".", "."),
        ("-e '.[ci]' other>=2", "-e '.[ci]' 'other>=2'"),
        ("a; rm -r b", "'a;' rm -r b"),
        ("$(id)", "'$(id)'"),
    ],
)
def test_words_are_quoted(text: str, quoted: str) -> None:
    """Words for `pip install` are quoted so that pip receives them unchanged."""
    assert pipelines.words(text, "--install") == quoted


@pytest.mark.parametrize(
    ("noted", "expected"),
    [
        (None, "simmatrix==1.2"),
        ('{"url": "https://example.org/s.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}}',
         "git+https://example.org/s.git@abc"),
        ('{"url": "https://example.org/s-1.2-py3-none-any.whl", "archive_info": {}}',
         "https://example.org/s-1.2-py3-none-any.whl"),
        ('{"url": "file:///home/me/s", "dir_info": {"editable": true}}', None),
        ('{"url": "file:///home/me/s", "vcs_info": {"vcs": "git", "commit_id": "abc"}}', None),
    ],
)  # fmt: skip
def test_a_workflow_installs_simmatrix_as_it_is_installed_here(noted: str | None, expected: str | None) -> None:
    """A workflow installs simmatrix as it was installed here, unless from a folder, which no runner has."""
    assert pipelines.install_words(noted, "1.2") == expected


@pytest.mark.parametrize("text", ["", "a\nb", "a ${{ github.head_ref }}"])
def test_words_that_are_refused(text: str) -> None:
    """Empty text, a second line and an expression are refused in one sentence."""
    with pytest.raises(BadInput) as caught:
        pipelines.words(text, "--install")
    assert str(caught.value) == (
        f"--install {text!r}: takes words for `pip install` on one line, and no expressions of the platform"
    )


def test_words_with_an_open_quote() -> None:
    """The message gives the reason."""
    with pytest.raises(BadInput) as caught:
        pipelines.words("'a", "--install")
    assert str(caught.value) == '--install "\'a": cannot be read as words of a shell: No closing quotation'
