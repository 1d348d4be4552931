"""Makes wheels and sdists of the tiny packages in `fakes/`, byte for byte the same every time, without any build tool.

A fake is a folder with a `fake.toml` and the files that land in site-packages. Keys of `fake.toml`:

- `name`; `versions` (one file set serves all: `@VERSION@` in a text becomes the version), default `["1.0"]`
- `kinds`: `wheel`, `sdist`, default `["wheel"]`; `tag` of the wheel, default `py3-none-any`; `local` builds (`["cpu"]`)
- `requires`, `requires-python`, `extras` (table: extra to requirements), `entry-points` (of wheels: group to table)
- `build-requires`: what the sdist is built with; `static = true`: its metadata can be read without a build

An sdist is built by `fakes/_backend.py` inside it, which imports `build_hooks.py` of the fake where there is one:
`build_hooks.requires(metadata)` and `build_hooks.files(files)` may change what comes out, or fail.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import json
import tarfile
import tomllib
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

FAKES = Path(__file__).parent / "fakes"
NOT_INSTALLED = frozenset({"fake.toml", "build_hooks.py"})
EPOCH = (1980, 1, 1, 0, 0, 0)


def make(folder: Path, *names: str) -> Path:
    """Put the files of some fakes, or of all, into a folder that `--find-links` can name."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(FAKES.glob("*/fake.toml")):
        if not names or path.parent.name in names:
            _release(path.parent, tomllib.loads(path.read_text(encoding="utf-8")), folder)
    return folder


def wheel(folder: Path, version: str, files: Mapping[str, str], about: Mapping[str, Any]) -> Path:
    """Write one wheel; `about` has the keys of a `fake.toml`."""
    name = about["name"]
    stem = f"{name.replace('-', '_')}-{version}"
    tag = about.get("tag", "py3-none-any")
    entries = {
        **files,
        f"{stem}.dist-info/METADATA": metadata(version, about),
        f"{stem}.dist-info/WHEEL": f"Wheel-Version: 1.0\nGenerator: fakes\nRoot-Is-Purelib: true\nTag: {tag}\n",
    }
    if "entry-points" in about:
        entries[f"{stem}.dist-info/entry_points.txt"] = _entry_points(about["entry-points"])
    rows = [f"{path},sha256={_digest(text.encode())},{len(text.encode())}" for path, text in entries.items()]
    record = f"{stem}.dist-info/RECORD"
    entries[record] = "\n".join([*rows, f"{record},,", ""])
    path = folder / f"{stem}-{tag}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for entry, text in entries.items():
            archive.writestr(zipfile.ZipInfo(entry, EPOCH), text)
    return path


def sdist(folder: Path, version: str, files: Mapping[str, str], about: Mapping[str, Any]) -> Path:
    """Write one sdist, whose metadata is known only once its backend was asked, unless it says `static`."""
    name = about["name"]
    stem = f"{name.replace('-', '_')}-{version}"
    requires = json.dumps(list(about.get("build-requires", ())))
    entries = {
        **{f"site/{path}": text for path, text in files.items()},
        "pyproject.toml": f'[build-system]\nrequires = {requires}\nbuild-backend = "_backend"\nbackend-path = ["."]\n',
        "_backend.py": (FAKES / "_backend.py").read_text(encoding="utf-8"),
        "about.json": json.dumps({"name": name, "version": version, "metadata": metadata(version, about)}),
        "PKG-INFO": metadata(version, about).replace("2.1", "2.2" if about.get("static") else "2.1", 1),
    }
    hooks = about.get("hooks")
    if hooks:
        entries["build_hooks.py"] = hooks
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for entry, text in entries.items():
            info = tarfile.TarInfo(f"{stem}/{entry}")
            info.size = len(text.encode())
            archive.addfile(info, io.BytesIO(text.encode()))
    path = folder / f"{stem}.tar.gz"
    path.write_bytes(gzip.compress(raw.getvalue(), mtime=0))
    return path


def metadata(version: str, about: Mapping[str, Any]) -> str:
    """Write the METADATA of a fake."""
    lines = ["Metadata-Version: 2.1", f"Name: {about['name']}", f"Version: {version}"]
    if "requires-python" in about:
        lines.append(f"Requires-Python: {about['requires-python']}")
    lines += [f"Requires-Dist: {line}" for line in about.get("requires", ())]
    for extra, requires in about.get("extras", {}).items():
        lines += [f"Provides-Extra: {extra}", *(f"Requires-Dist: {line}; extra == '{extra}'" for line in requires)]
    return "\n".join([*lines, ""])


def _entry_points(groups: Mapping[str, Mapping[str, str]]) -> str:
    """Write the file that installers keep of entry points."""
    lines = [
        (f"[{group}]", *(f"{name} = {target}" for name, target in names.items())) for group, names in groups.items()
    ]
    return "".join("\n".join((*block, "", "")) for block in lines)


def _release(fake: Path, about: dict[str, Any], folder: Path) -> None:
    hooks = fake / "build_hooks.py"
    if hooks.exists():
        about["hooks"] = hooks.read_text(encoding="utf-8")
    for version in about.get("versions", ["1.0"]):
        files = _files(fake, version)
        if "sdist" in about.get("kinds", ["wheel"]):
            sdist(folder, version, files, about)
        if "wheel" in about.get("kinds", ["wheel"]):
            for local in about.get("local", [""]):
                wheel(folder, f"{version}+{local}" if local else version, files, about)


def _files(fake: Path, version: str) -> dict[str, str]:
    paths: Iterable[Path] = sorted(path for path in fake.rglob("*") if path.is_file())
    return {
        path.relative_to(fake).as_posix(): path.read_text(encoding="utf-8").replace("@VERSION@", version)
        for path in paths
        if path.name not in NOT_INSTALLED and "__pycache__" not in path.parts
    }


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
