"""Build the wheel and the sdist twice, check them, and install them as users do; sign and send nothing.

`python tests/real/release.py FOLDER` needs `build`, `twine`, `pipx` and `uv` in its environment.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
LINE = "AttributeError: module 'numpy' has no attribute 'bool8'"
NEEDED = ("PATH", "PIP_", "UV_", "SSL_", "REQUESTS_", "http", "HTTP")
"""Beginnings of the variables that installers need; nothing else of this environment is passed on."""


def run(*command: str | Path, home: Path | None = None) -> str:
    """Run a command, in an empty home and with an almost empty environment if `home` is given; return its stdout."""
    env = None
    if home:
        passed = {name: value for name, value in os.environ.items() if name.startswith(NEEDED)}
        env = passed | {"HOME": str(home), "COLUMNS": "80", "PIPX_HOME": str(home / "pipx"), "UV_TOOL_DIR": str(home)}
    done = subprocess.run([*map(str, command)], cwd=home, env=env, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}: exit {done.returncode}\n{done.stdout}")
    return done.stdout


def build(target: Path) -> dict[str, str]:
    """Build both files from a clean copy of the commit; return their hashes by name."""
    with TemporaryDirectory() as folder:
        run("git", "clone", "-q", ROOT, folder)
        run(sys.executable, "-m", "build", "--outdir", target, folder)
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in sorted(target.iterdir())}


def installed(file: Path, home: Path) -> Iterator[tuple[str, Path]]:
    """Install a file in each way that users know; yield the way and the command that it brought."""
    venv.create(home / "venv", with_pip=True)
    run(home / "venv" / "bin" / "pip", "install", "-q", file, home=home)
    yield "pip", home / "venv" / "bin" / "simmatrix"
    run("uv", "tool", "install", "-q", "--python", sys.executable, file, home=home)
    yield "uv tool", home / ".local" / "bin" / "simmatrix"
    shutil.rmtree(home / ".local" / "bin")
    run("pipx", "install", "-q", "--python", sys.executable, file, home=home)
    yield "pipx", home / ".local" / "bin" / "simmatrix"


def main(target: Path) -> None:
    """Build, compare, check, install; print a line for each."""
    shutil.rmtree(target, ignore_errors=True)
    hashes = build(target)
    with TemporaryDirectory() as folder:
        again = build(Path(folder))
    if hashes != again:
        sys.exit(f"two builds of one commit differ: {hashes}, {again}")
    (target / "SHA256SUMS").write_text("".join(f"{value}  {name}\n" for name, value in hashes.items()))
    files = [target / name for name in hashes]
    run(sys.executable, "-m", "twine", "check", "--strict", *files)
    for file in files:
        print(f"{file.name}: {file.stat().st_size / 1e6:.1f} MB, sha256 {hashes[file.name]}, two builds are equal")
        with TemporaryDirectory() as folder:
            for way, command in installed(file, Path(folder)):
                answer = run(command, "explain", LINE, home=Path(folder))
                if "numpy<2" not in answer:
                    sys.exit(f"{file.name} by {way}: no remedy for {LINE!r}:\n{answer}")
                print(f"{file.name} by {way}: {run(command, '--version', home=Path(folder)).strip()} explains")


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute())
