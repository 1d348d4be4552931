"""Tell which package has a module, where people meet it by its import name alone."""

from __future__ import annotations

from typing import Optional

from .api_history import is_gone, package_of


def package_with(module: str) -> Optional[str]:
    """Return the package whose newest release has a module; None if none is known."""
    return None if is_gone(module) else package_of(module)
