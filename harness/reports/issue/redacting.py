"""Redact text for strangers: remove folders, people, hosts, addresses and secrets of this machine."""

from __future__ import annotations

import re
from collections.abc import Mapping

SYSTEM = "usr|lib|lib32|lib64|etc|proc|sys|dev|bin|sbin|opt/conda|nix/store"
"""Folders that are alike on many machines: what lies in them stays as it is."""

SECRET = r"(?:TOKEN|SECRET|PASSW(?:OR)?D|PASSPHRASE|CREDENTIALS?|API_?KEY|ACCESS_?KEY|PRIVATE_?KEY|AUTH(?:ORIZATION)?)"
"""What stands in the name of a variable whose value nobody should read."""

HIDDEN = "<redacted>"
START = r"(?<![\w.$~>/:…-])"
"""Where a path of a machine's root begins, and no address or part of another path."""

# The order matters: the rule for mail would take the end of a login in an address, and the rule for any folder
# would cut off the part of a package's path that is alike everywhere. Four numbers alone may be a version
# (opencv-python 4.11.0.86), so an address needs a port, a slash or a private range.
RULES = (
    # secrets, wherever they stand
    (re.compile(r"(?i)\b([a-z][a-z0-9+.-]*://)[^\s/@:]+(?::[^\s/@]*)?@"), rf"\1{HIDDEN}@"),
    (re.compile(rf"(?i)([?&][\w-]*(?:{SECRET}|sig|signature|key)[\w-]*=)[^\s&#'\"]+"), rf"\1{HIDDEN}"),
    (re.compile(rf"(?i)\b([\w-]*{SECRET}['\"]?\s*[=:]\s*['\"]?)(?:(?:bearer|basic)\s+)?[^\s'\",;&]+"), rf"\1{HIDDEN}"),
    (re.compile(r"(?i)\b(bearer|basic)\s+[\w.~+/=-]{8,}"), rf"\1 {HIDDEN}"),
    (
        re.compile(
            r"\b(?:gh[pousr]_\w{20,}|github_pat_\w{20,}|glpat-[\w-]{16,}|hf_\w{20,}|sk-[\w-]{16,}|xox[abprs]-[\w-]{10,}"
            r"|AKIA[0-9A-Z]{16}|pypi-[\w-]{16,}|eyJ[\w-]{8,}\.[\w-]{8,}\.[\w-]+)"
        ),
        HIDDEN,
    ),
    (re.compile(r"-----BEGIN [A-Z ]*PRIVATE KEY-----[\s\S]*?(?:-----END [A-Z ]*PRIVATE KEY-----|\Z)"), HIDDEN),
    # people and hosts
    (re.compile(r"[\w.+-]+@[A-Za-z0-9-]+(?:\.[A-Za-z0-9-]+)+"), "<email>"),
    (re.compile(r"(?<![\d.])(?!127\.0\.0\.1\b|0\.0\.0\.0\b)(?:\d{1,3}\.){3}\d{1,3}(?=:\d+|/)"), "<address>"),
    (re.compile(r"(?<![\d.\w])(?:10|192\.168|172\.(?:1[6-9]|2\d|3[01]))(?:\.\d{1,3}){2,3}(?![\d.])"), "<address>"),
    (re.compile(r"(?i)\b[\w-]+(?:\.[\w-]+)*\.(?:local|lan|internal|intranet|corp|home|localdomain)\b"), "<host>"),
    # folders: of an interpreter's packages the part that is alike everywhere, of others the file's own name
    (re.compile(rf"{START}(?:/[^\s'\":,;()<>|]+)*?/(site-packages|dist-packages)/"), r"…/\1/"),
    (re.compile(rf"{START}(?:/[^\s'\":,;()<>|]+)*?/(lib/python\d+(?:[.]\d+)?)/"), r"…/\1/"),
    (re.compile(rf"{START}/(?!(?:{SYSTEM})(?:/|\b))[\w.@%+~-]+(?:/[\w.@%+~-]*)*/([\w.@%+~-]+)"), r"<path>/\1"),
    (re.compile(rf"{START}/(?:home|root|Users|tmp|mnt|data|scratch|srv|work|workspace)/?(?![\w/])"), "<path>"),
    (re.compile(r"(?<![\w.$>/-])~[\w-]*/[^\s'\":,;()<>|]*?([\w.-]+)(?=[\s'\":,;()<>|]|$)"), r"<path>/\1"),
    (re.compile(r"(?i)\b[a-z]:\\(?:[^\\'\"\n]+\\)*([^\\\s'\"]+)"), r"<path>\\\1"),
)  # fmt: skip


def redact(text: str, words: Mapping[str, str]) -> str:
    """Return the text without private data; `words` maps names of this machine to their replacements."""
    for pattern, instead in RULES:
        text = pattern.sub(instead, text)
    # The longest comes first: a home folder goes as a whole before the user's name inside it.
    for word in sorted(filter(None, words), key=len, reverse=True):
        text = re.sub(rf"(?<![\w-]){re.escape(word)}(?![\w-])", words[word].replace("\\", r"\\"), text)
    return text


def secret(name: str) -> bool:
    """Return whether a variable of this name holds a secret."""
    return re.search(SECRET, name, re.IGNORECASE) is not None
