"""Explain failures from logs, inspect environments (`doctor`), with the standard library alone, from Python 3.7 on.

In Python 3.7 to 3.14, with the standard library and itself alone. The host imports it and adds types;
`simmatrix-doctor.pyz` carries it to where no new Python is.
"""

__all__ = [
    "adapters",
    "control_characters",
    "installing",
    "keys",
    "opening",
    "output",
    "packages",
    "requirements",
    "running",
    "versions",
    "wrapping",
]
