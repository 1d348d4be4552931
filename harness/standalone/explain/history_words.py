"""Tell which packages' releases differ in a word, so that only their histories are opened.

`words.json.gz` is made by `harness/history/word_index.py`.
"""

from __future__ import annotations

import gzip
import json
from functools import lru_cache
from typing import Any, Dict, List

from ..adapters import carried_file
from .api_history import PLACES


def packages_with(kind: str, word: str) -> List[str]:
    """Return the packages whose releases differ in a word of a kind: `names`, `members` or `parameters`."""
    return list(_words().get(kind, {}).get(word, ()))


@lru_cache(maxsize=None)
def _words() -> Dict[str, Any]:
    contents = (carried_file("{}/words.json.gz".format(place)) for place in PLACES)
    content = next((each for each in contents if each is not None), None)
    words: Dict[str, Any] = json.loads(gzip.decompress(content).decode("utf-8")) if content else {}
    return words
