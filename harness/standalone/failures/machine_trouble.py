"""List what an operating system says when a machine or its network is short of something, whatever the package."""

from __future__ import annotations

SHORTAGES = (
    "No space left on device|Disk quota exceeded|Read-only file system|Cannot allocate memory|Too many open files"
)
UNREACHABLE = "Temporary failure in name resolution|Name or service not known|Network is unreachable"
"""Alternatives of regular expressions, to which each reader adds what only its tools say."""
