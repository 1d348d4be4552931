"""Build environments as `describe_environment.py` describes them, from the few facts that a test needs."""

from __future__ import annotations

from typing import Any

SITE = "/env/lib/python3.11/site-packages"


def distribution(name: str, version: str | None, *requires: str, **more: Any) -> dict[str, Any]:
    """Return one distribution; `more` replaces the defaults."""
    return {
        "name": name,
        "version": version,
        "folder": f"{name.replace('-', '_')}-{version}.dist-info",
        "location": SITE,
        "requires": list(requires),
        "requires_python": None,
        "modules": [name.replace("-", "_")],
        "installer": "pip",
        "missing": 0,
        "missing_files": [],
        "trouble": None,
        **more,
    }


def facts(*distributions: dict[str, Any], python: str = "3.11.7", **more: Any) -> dict[str, Any]:
    """Return an environment with these distributions."""
    return {
        "schema": 1,
        "python": {
            "version": python,
            "implementation": "cpython",
            "executable": "/env/bin/python",
            "prefix": "/env",
            "base_prefix": "/usr",
            "platform": "linux-x86_64",
            "libc": "glibc 2.36",
            "user_site": "/home/u/.local/lib/python3.11/site-packages",
            "site_packages": [SITE],
            "markers": {
                "python_version": ".".join(python.split(".")[:2]),
                "python_full_version": python,
                "sys_platform": "linux",
                "platform_machine": "x86_64",
            },
        },
        "path": ["/usr/lib/python3.11", SITE],
        "distributions": list(distributions),
        "leftovers": [],
        "claimed": [],
        "hidden": [],
        "importable": [],
        "conda": [],
        "errors": [],
        **more,
    }


def installed(python: str = "3.11.7", **versions: str) -> dict[str, Any]:
    """Return an environment with these versions; `_` in a name stands for `-`."""
    return facts(*(distribution(name.replace("_", "-"), version) for name, version in versions.items()), python=python)
