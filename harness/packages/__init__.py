"""Turn requirements into an environment: the index, uv, locks, what is installed, and the package under test."""

__all__ = [
    "download_notice",
    "index",
    "index_settings",
    "locks",
    "package_under_test",
    "resolver",
    "step_failed",
    "uv_command",
    "uv_failures",
]
