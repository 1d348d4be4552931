"""`fetch` on a machine with an index, `run --fetched` on another without any network."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest
from commandline import CommandResult, Desk

from harness.model import replace
from harness.running.offline import offline_collect

MATRIX = """
index = { default = "@INDEX@" }
requirements = ["fake-healthy"]
cases = [{ env = "fake_healthy:Healthy-v0", api = "gymnasium" }]

[axes]
python = ["host"]

[axes.which.wheels]

[axes.which.built]
requirements = ["fake-build-dependent"]

[axes.which.unresolvable]
requirements = ["fake-unresolvable"]

[axes.which.unbuildable]
requirements = ["fake-build-failure"]

[[expect]]
when = { which = "unresolvable" }
verdict = "unresolvable"
reason = "asks for a release that never was"

[[expect]]
when = { which = "unbuildable" }
verdict = "uninstallable"
reason = "its build fails"
"""
VERDICTS = {"wheels": "works", "built": "works", "unresolvable": "unresolvable", "unbuildable": "uninstallable"}
UPLOADED = "2024-01-01T00:00:00Z"


class Index:
    """Answers as an index with upload times does, from a folder of files; `asked` are the files that were taken."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.asked: list[str] = []

    def __call__(self, request: BaseHTTPRequestHandler) -> None:
        kind, _, name = request.path.strip("/").partition("/")
        content = self._page(name) if kind == "simple" else self._file(name, taken=request.command == "GET")
        request.send_response(200 if content else 404)
        request.send_header("Content-Type", "application/vnd.pypi.simple.v1+json" if kind == "simple" else "a/file")
        request.send_header("Content-Length", str(len(content or b"")))
        request.end_headers()
        if request.command == "GET":
            request.wfile.write(content or b"")

    def _file(self, name: str, *, taken: bool) -> bytes:
        """Return a file's content, or a wheel's metadata, so that no resolver needs the whole wheel."""
        if name.endswith(".metadata"):
            with zipfile.ZipFile(self.folder / name.removesuffix(".metadata")) as wheel:
                return wheel.read(next(one for one in wheel.namelist() if one.endswith(".dist-info/METADATA")))
        self.asked += [name] if taken else []
        return (self.folder / name).read_bytes()

    def _page(self, name: str) -> bytes | None:
        files = [path for path in sorted(self.folder.iterdir()) if _project(path.name) == name]
        entries = [
            {
                "filename": path.name,
                "url": f"/files/{path.name}",
                "hashes": {"sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
                "size": path.stat().st_size,
                "upload-time": UPLOADED,
                "core-metadata": path.suffix == ".whl",
            }
            for path in files
        ]
        page = {"meta": {"api-version": "1.1"}, "name": name, "versions": [], "files": entries}
        return json.dumps(page).encode() if files else None


@pytest.fixture
def machines(desk: Desk, tmp_path: Path) -> tuple[Desk, Desk]:
    """Return two machines: one that reaches the index, and one with its own caches that reaches nothing."""
    with_network, without = tmp_path / "with", tmp_path / "without"
    for folder in (with_network, without):
        folder.mkdir()
    return replace(desk, folder=with_network, online=True), replace(desk, folder=without, cache=tmp_path / "other")


def test_a_fetched_folder_runs_without_network(
    machines: tuple[Desk, Desk], serve: Callable[[Any], str], tmp_path: Path
) -> None:
    """A fetched folder gives the same verdicts offline; a changed wheel is refused, and fetching again replaces it.

    The seconds of the committed report come along: shards are balanced by them here, too.
    """
    online, node = machines
    index = Index(online.wheels)
    matrix = online.matrix("small", MATRIX.replace("@INDEX@", serve(index)))
    folder = tmp_path / "fetched"

    fetched = online.run("fetch", matrix, "--to", folder, HARNESS_CACHE=str(tmp_path / "cache"))
    brought = snapshot(folder)
    taken, index.asked = index.asked, []

    assert (fetched.code, fetched.err.count("Traceback")) == (0, 0), fetched.err
    assert len([name for name in taken if name.startswith("numpy")]) == 1
    assert_manifest(folder, brought)

    ran = node.run("run", "small", "--fetched", folder, "--json")

    assert (ran.code, verdicts(ran)) == (0, VERDICTS), ran.err
    assert snapshot(folder) == brought

    (wheel,) = folder.glob("wheels/*/fake_healthy-*.whl")
    content = wheel.read_bytes()
    wheel.write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])
    refused = node.run("run", "small", "--fetched", folder, "--json", "--fresh", "-k", "*wheels")
    name = wheel.relative_to(folder)

    assert (refused.code, verdicts(refused)) == (3, VERDICTS | {"wheels": "inconclusive"})
    told = f"{name}: is not the file that was fetched, its SHA-256 is another; fetch it again"
    assert refused.cells("which")["wheels"]["decisive"] == told

    committed = online.folder / "reports/small/report.json"
    committed.parent.mkdir(parents=True)
    seconds = [{**cell, "seconds": 100 if cell["axes"]["which"] == "built" else 1} for cell in ran.document["cells"]]
    committed.write_text(json.dumps({**ran.document, "cells": seconds}))
    again = online.run("fetch", matrix, "--to", folder, HARNESS_CACHE=str(tmp_path / "cache"))
    shard = node.run("run", "small", "--fetched", folder, "--shard", "1/2", "--until", "resolve", "--json")

    assert shard.err == "shard 1/2: 1 of 4 cells\n"
    assert (again.code, [one for one in index.asked if one.endswith(".whl")]) == (0, [wheel.name])
    mended = {name for name, (changed, _) in snapshot(folder).items() if changed != brought[name][0]}
    assert {str(name), "manifest.json"} <= mended
    assert not any(one.startswith("wheels/") for one in mended - {str(name)})
    assert_manifest(folder, snapshot(folder))


def test_a_folder_tells_what_it_is_not(
    machines: tuple[Desk, Desk], serve: Callable[[Any], str], tmp_path: Path
) -> None:
    """Each way in which a fetched folder does not fit has its own sentence.

    An interrupted fetch, another matrix, a cell left out, another Python, another machine.
    """
    online, node = machines
    index = Index(online.wheels)
    matrix = online.matrix("small", MATRIX.replace("@INDEX@", serve(index)))
    folder = tmp_path / "fetched"
    folder.mkdir()

    early = node.run("run", "small", "--fetched", folder)

    assert early.code == 2
    assert early.err == (
        f"simmatrix: {folder}/manifest.json: cannot be read: No such file or directory; "
        f"`simmatrix fetch MATRIX --to {folder}` writes it, and continues where it stopped\n"
    )

    partly = online.run("fetch", matrix, "--to", folder, "-k", "*-unresolvable")

    assert (partly.code, partly.err.count("Traceback")) == (0, 0), partly.err
    assert "no lock: " in partly.out

    changed = node.matrix("small", matrix.read_text() + "\n[axes.which.more]\n")
    other = node.run("run", changed, "--fetched", folder)
    unknown = node.run("run", "smell", "--fetched", folder)
    left_out = node.run("run", "small", "--fetched", folder, "--json", "-k", "*-wheels")

    assert (other.code, other.err) == (
        2,
        f"simmatrix: {changed}: is not the matrix that was fetched; "
        "fetch it again, or run `small`, as it was fetched\n",
    )
    assert (unknown.code, unknown.err) == (
        2,
        f'simmatrix: smell: was not fetched into {folder}; did you mean "small"?\n',
    )
    assert left_out.cells("which")["wheels"]["verdict"] == "unavailable"
    assert left_out.cells("which")["wheels"]["decisive"] == (
        "was not fetched; `simmatrix fetch small --to fetched` brings it"
    )

    manifest = folder / "manifest.json"
    text = manifest.read_text()
    (version,) = {cell["python"] for cell in json.loads(text)["cells"]}
    manifest.write_text(text.replace(f'"python": "{version}"', '"python": "3.99.1"'))
    other_python = node.run("run", "small", "--fetched", folder, "--json", "-k", "*-unresolvable")
    manifest.write_text(text.replace(os.uname().machine, "vax"))
    other_machine = node.run("run", "small", "--fetched", folder)
    manifest.write_text(text)

    assert other_python.cells("which")["unresolvable"]["decisive"] == (
        f"its lock is for cpython 3.99.1, and there is {version}; "
        "install 3.99.1 here, or fetch on a machine with the Python that is here"
    )
    assert (other_machine.code, other_machine.err) == (
        2,
        f"simmatrix: {folder}: was fetched for vax, and this machine is {os.uname().machine}; fetch on "
        "such a machine\n",
    )

    grown = online.run("fetch", changed, "--to", folder, "-k", "*-more")
    cells = json.loads((folder / "manifest.json").read_text())["cells"]

    assert "was changed since it was fetched; its cells are fetched again" in grown.err
    assert [cell["id"].rpartition("_")[2] for cell in cells] == ["more"]


def test_a_python_of_uvs_is_packed_and_runs_elsewhere(tmp_path: Path) -> None:
    """The archive holds the folder as it was, links and modes included."""
    folder = tmp_path / "cpython-3.99.0-linux-x86_64-gnu"
    (folder / "bin").mkdir(parents=True)
    (folder / "bin/python3.99").write_text("#!/bin/sh\necho here\n")
    (folder / "bin/python3.99").chmod(0o755)
    (folder / "bin/python").symlink_to("python3.99")
    (folder / "lib/__pycache__").mkdir(parents=True)

    offline_collect.pack(folder, tmp_path / "pythons" / f"{folder.name}.tar")
    unpacked = tmp_path / "elsewhere"
    shutil.unpack_archive(tmp_path / "pythons" / f"{folder.name}.tar", unpacked, filter="data")

    assert (unpacked / folder.name / "bin/python").readlink() == Path("python3.99")
    assert (unpacked / folder.name / "bin/python3.99").stat().st_mode & 0o777 == 0o755
    assert not (unpacked / folder.name / "lib/__pycache__").exists()


def assert_manifest(folder: Path, found: dict[str, tuple[int, bytes]]) -> None:
    """Every file is named with hash and size, wheels and locks by their cells, and no place of this machine."""
    text = (folder / "manifest.json").read_text()
    manifest = json.loads(text)
    files = {
        name: {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content)}
        for name, (_, content) in found.items()
        if name != "manifest.json" and not name.startswith(".")
    }
    cells = {cell["id"].rpartition("_")[2]: cell for cell in manifest["cells"]}
    everything = b"".join(content for name, (_, content) in found.items() if name.endswith((".json", ".txt")))

    assert manifest["files"] == files
    assert [len([one for one in cells["built"]["wheels"] if one.startswith("builds/")])] == [1]
    assert {one for one in cells["wheels"]["wheels"] if "fake_healthy" in one} < set(files)
    assert cells["wheels"]["lock"] in files
    assert cells["unresolvable"]["lock"] is None
    assert cells["unresolvable"]["complete"]
    assert str(folder.parent).encode() not in everything
    assert b"127.0.0.1" not in everything


def verdicts(ran: CommandResult) -> dict[str, str]:
    """Return the verdict of each cell by its value of `which`."""
    return {which: cell["verdict"] for which, cell in ran.cells("which").items()}


def snapshot(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Return modification time (ns) and content of every file below a folder."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


def _project(filename: str) -> str:
    name = re.split(r"-\d", filename, maxsplit=1)[0]
    return re.sub(r"[-_.]+", "-", name).lower()
