"""Name the folder of environments, wheels and downloads; nothing is made, and little is loaded for it."""

from __future__ import annotations

import os
from pathlib import Path


def cache_path() -> Path:
    """Return the path of the cache folder: `HARNESS_CACHE`, else the user's cache folder. It need not exist."""
    return Path(os.environ.get("HARNESS_CACHE") or _users_cache()).absolute()


def _users_cache() -> Path:
    import platformdirs  # noqa: PLC0415 - start-up

    return platformdirs.user_cache_path("simmatrix")
