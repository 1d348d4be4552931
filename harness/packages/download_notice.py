"""Tell the user how much is about to be downloaded, if that is much."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

from harness.model import Artifact

MUCH = 500_000_000
"""Bytes that are announced before they are fetched."""

TIMEOUT = 5.0


def announce(artifacts: Iterable[Artifact], cached_hashes: frozenset[str]) -> None:
    """Tell the user of a large download; `cached_hashes` are hashes of files that are here already."""
    remote = (one for one in artifacts if "://" in one.source and not one.source.startswith("file:"))
    wanted = [one for one in remote if one.sha256 not in cached_hashes]
    with ThreadPoolExecutor(8) as pool:
        sizes = dict(zip(wanted, pool.map(_size, wanted), strict=True))
    if sum(sizes.values()) > MUCH:
        largest = max(sizes, key=lambda artifact: sizes[artifact])
        logging.getLogger("harness").warning(
            "about to download %.1f GB (%s alone %.1f GB)",
            sum(sizes.values()) / 1e9,
            largest.filename,
            sizes[largest] / 1e9,
        )


def _size(artifact: Artifact) -> int:
    """Return bytes as the index gives them, else the server; 0 for pure Python wheels (small) and if unknown."""
    if artifact.size is not None or artifact.filename.endswith("-any.whl"):
        return artifact.size or 0
    from urllib.request import Request, urlopen  # noqa: PLC0415  (slow to import)

    try:
        with urlopen(Request(artifact.source, method="HEAD"), timeout=TIMEOUT) as answer:
            return int(answer.headers.get("Content-Length") or 0)
    except (OSError, ValueError):
        # Only a notice depends on it: a size that cannot be had holds up no install.
        return 0
