"""Turn requirements into an environment: the index, uv, locks, and the package under test."""
