"""Tell a text that only mentions a failure, as notes of a release or a page of help do, from one that shows it."""

from __future__ import annotations

import re

from .failure_text import START

SHOWN = re.compile(
    r"^[\s>*`|\-╰─▶E$'\"\[\]#\d.]*(?:\([\w-]+\) )?(?:[\w.\[\]/:-]+[:>] )?"
    r"(?:[A-Za-z_][\w.]*(?:Error|Exception|Warning|NotFound|Interrupt|Exit|NotInstalled|Failure)\b\W|(?:fatal )?error:"
    r"|ERROR|\[Error\]|\S+: (?:fatal )?error:|Could not|Failed to|Failed building|No module named|Segmentation fault)",
    re.MULTILINE,
)
"""A line that begins with an error: it shows a failure, whatever else the text says."""

PAST = re.compile(
    r"\b[Ff]ix(?:ed|es)\b(?! (?:it|this|that) by\b)|\b(?:[Ss]olved|[Rr]esolved)\b|\bis (?:now )?gone\b"
    r"|\bno longer (?:get|see|happens)|\b(?:works|runs|trains|working) (?:fine |again )?now\b"
    r"|\b(?:it|everything) (?:now )?(?:works|runs|trains)\b(?! on)|\b[Rr]elease notes?\b|\b[Cc]hangelog\b"
    r"|^#+ .*(?:Troubleshooting|FAQ|Changes|Known issues|\d+\.\d+)|\b[Ii]f you (?:see|get|encounter|run into)\b",
    re.MULTILINE,
)
"""Words of a text that tells of a failure that is over, or that may come."""


LONGEST = 8000
"""Characters of a text that somebody wrote by hand; a longer one is a log."""


def is_mention(text: str) -> bool:
    """Return whether a text only mentions failures: it says that they are over, or what to do about them."""
    return len(text) < LONGEST and START not in text and PAST.search(text) is not None and SHOWN.search(text) is None
