"""`merge`: shards that ran apart, each with a state of its own, come out as one run of all of them."""

from __future__ import annotations

from commandline import Desk


def test_shards_are_one_report(desk_with_results: Desk) -> None:
    """In any order and twice: verdicts, files and exit code of the whole; a shard that is missing is a gap."""
    for part in ("1/2", "2/2"):
        name = part[0]
        shard = desk_with_results.run(
            "run", "small.toml", "--shard", part, "--out", f"parts/{name}", HARNESS_STATE=f"state-{name}"
        )
        assert shard.code in {0, 1}

    merged = desk_with_results.run("merge", "parts/2", "parts", "--out", "all", "--json", "--fail-on", "not_run")
    whole = desk_with_results.run("report", "small", "--json").document
    assert merged.code == 0
    assert merged.err == "2 reports merged: 2 cells, none not run\nreport: all\n"
    assert _summary(merged.document) == _summary(whole)
    for cell in merged.document["cells"]:
        paths = [cell["lock"], cell["evidence"], *(frame for case in cell["cases"] for frame in case["frames"])]
        assert all((desk_with_results.folder / path).exists() for path in paths)
        assert all(path.startswith("all/") for path in paths)
    assert desk_with_results.run("merge", "parts").code == 1

    gap = desk_with_results.run("merge", "parts/1", "--json", "--fail-on", "not_run")
    assert (gap.code, [cell["verdict"] for cell in gap.document["cells"]].count("not_run")) == (1, 1)
    page = desk_with_results.run("report", "all", "--format", "md").out
    assert page == (desk_with_results.folder / "all" / "report.md").read_text()


def _summary(document: dict[str, list[dict[str, object]]]) -> list[tuple[object, ...]]:
    told = ("id", "verdict", "as_expected", "phase", "decisive", "key", "lock_sha256", "installed")
    return [tuple(cell[name] for name in told) for cell in document["cells"]]
