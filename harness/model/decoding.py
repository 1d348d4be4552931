"""Make typed values of JSON and of plain values; the only place where msgspec looks at types.

msgspec notes on a class what it found there before it is complete, as types may hold themselves. A second thread that
decodes with it at that moment crashes the process. So one thread at a time looks at a type, and nobody decodes before.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")


def decoder(kind: type[T]) -> msgspec.json.Decoder[T]:
    """Return the JSON decoder of a type; each is made once."""
    json_decoder: msgspec.json.Decoder[T] | None = _decoders.get(kind)
    if json_decoder is None:
        with _looking:
            json_decoder = _decoders.setdefault(kind, msgspec.json.Decoder(kind))
    return json_decoder


def convert(
    plain: Any, kind: type[T], *, attributes: bool = False, read_other: Callable[[Any, Any], Any] | None = None
) -> T:
    """Return a value of a type, made of plain values, or of the attributes of an object.

    `read_other` makes values of types that msgspec does not know. Raises msgspec.ValidationError.
    """
    decoder(kind)
    return msgspec.convert(plain, kind, from_attributes=attributes, dec_hook=read_other)


_looking = RLock()
_decoders: dict[Any, Any] = {}
