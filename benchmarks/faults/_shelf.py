"""The wheels of the desks: all fakes, and gymnasium with what it needs, downloaded once."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from pathlib import Path

import shelf
import wheelhouse


def fill_shelf(folder: Path) -> Path:
    """Return a folder with all fakes as they are now and the real wheels that they need."""
    real = shelf.download_wheels(folder.with_name("real"), folder.with_name("downloads"))
    making = Path(tempfile.mkdtemp(dir=folder.parent))
    wheelhouse.make(making)
    for wheel in real:
        shutil.copy(wheel, making)
    texts = (f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in sorted(making.iterdir()))
    filled = folder.with_name(f"{folder.name}-{hashlib.sha256(' '.join(texts).encode()).hexdigest()[:12]}")
    if filled.exists():
        shutil.rmtree(making)
    else:
        making.chmod(0o755)
        making.rename(filled)
    return filled
