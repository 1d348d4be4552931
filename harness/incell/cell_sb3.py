"""Names the releases of Stable-Baselines3 and torch."""

import sys

SB3 = "stable_baselines3"


def releases(module):
    """Return the releases of the library and of torch."""
    torch = sys.modules.get("torch")
    return {"library": str(module.__version__), "torch": str(getattr(torch, "__version__", "?"))}
