"""Write an observation of a check as a code and data; the host has the words, in `model/words.toml`."""

from .cell_records import shorten

LONGEST = 4000
"""Characters of a text."""

MOST, DEEPEST = 50, 8
"""Items of a list or table, and levels of them."""


class Step:
    """The number of the step that is being made, where steps are counted; None elsewhere."""

    number = None


current_step = Step()


def observation(code, data):
    """Return a code and data as plain values: `at`, `got` and `promised` apart, everything else below `data`."""
    plain = _plain(data, DEEPEST)
    fields = {"code": code, "at": plain.pop("at", current_step.number)}
    fields.update((name, plain.pop(name, None)) for name in ("got", "promised"))
    return dict(fields, data=plain)


def _plain(value, levels):
    """Copy a value, bounded; whatever is no list or table of plain values becomes its text."""
    if isinstance(value, dict) and levels:
        return {shorten(str(name), LONGEST): _plain(value[name], levels - 1) for name in list(value)[:MOST]}
    if isinstance(value, (list, tuple)) and levels:
        return [_plain(item, levels - 1) for item in value[:MOST]]
    if value is None or isinstance(value, (bool, int, float)):
        return value
    return shorten(str(value), LONGEST)


def place(value, call=None):
    """Name a value that is examined, and the call that returned it."""
    return {"value": value} if call is None else {"value": value, "call": call}


def inside(where, key):
    """Name a part of a value by its key or number there."""
    return dict(where, path=" at ".join([where["path"], repr(key)] if "path" in where else [repr(key)]))


def remark(kind, code, **data):
    """Return something to report, of a kind such as `type` or `space`."""
    return kind, code, data
