"""Read what each adapter declares of its simulator: literal assignments at the top of `incell/api_NAME.py`.

The files are read and never imported. A file made to run alone carries the declarations as data.
"""

from __future__ import annotations

import ast
import json
import os
import pkgutil
import re
from functools import lru_cache
from typing import Any, Dict, NamedTuple, Optional, Tuple

CARRIED = "adapters.json"
"""The declarations of all adapters, in a file that runs alone."""

FOLDER = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "incell")
PREFIX = "api_"
CODE = re.compile(r"^(?:class |def |@)", re.MULTILINE)
"""The end of the top of a file."""


class Adapter(NamedTuple):
    """Hold the declarations of an adapter, each under the name in capitals; those left out are empty.

    `packages` maps a distribution to the module that it is imported as, first the one that brings the API. `ids` is a
    pattern of environment ids that mean this API where its package is asked for, `example` a small environment that is
    always there. `draws` are top-level modules that draw by OpenGL; `drawing_code` are patterns of paths in a
    traceback that comes from drawing; `native_errors` are patterns of whole lines that native code prints.
    """

    packages: Dict[str, str] = {}  # noqa: RUF012 - nobody changes it
    not_imported: Dict[str, str] = {}  # noqa: RUF012 - nor this
    """Packages that `doctor` does not import, and why."""

    ids: str = ""
    example: str = ""
    brings_models: bool = False
    """True where the package brings files that environments name as they would a file of the user's."""

    draws: Tuple[str, ...] = ()
    drawing_code: Tuple[str, ...] = ()
    native_errors: Tuple[str, ...] = ()
    reads_mujoco_gl: Tuple[str, ...] = ()
    """Packages to which the variable MUJOCO_GL matters."""


NAMES = {field.upper(): field for field in Adapter._fields}


@lru_cache(maxsize=None)
def adapters() -> Dict[str, Adapter]:
    """Return the declarations of all adapters, by API in order. Raises ValueError if one cannot be read."""
    content = carried_file(CARRIED)
    if content is not None:
        return read(content)
    names = sorted(each.name for each in pkgutil.iter_modules([FOLDER]) if each.name.startswith(PREFIX))
    return {name[len(PREFIX) :]: _read_adapter("{}.py".format(name)) for name in names}


def encode_declarations() -> bytes:
    """Return the declarations as a file that runs alone carries them."""
    return json.dumps({api: adapter._asdict() for api, adapter in adapters().items()}, sort_keys=True).encode()


def read(content: bytes) -> Dict[str, Adapter]:
    """Read declarations in the form that `encode_declarations` returns."""
    plain: Dict[str, Dict[str, Any]] = json.loads(content.decode())
    for fields in plain.values():
        fields.update({name: tuple(value) for name, value in fields.items() if isinstance(value, list)})
    return {api: Adapter(**fields) for api, fields in plain.items()}


def package(api: str) -> str:
    """Return the package that brings an API; its own name where none is declared."""
    adapter = adapters().get(api, Adapter())
    return next(iter(adapter.packages), api)


def declarations(source: str) -> Dict[str, Any]:
    """Return the declarations in the source of an adapter, by field.

    Raises ValueError where one is not a literal of its type; source that is no Python declares nothing.
    """
    code = CODE.search(source)
    try:
        tree = ast.parse(source[: code.start()] if code else source)
    except SyntaxError:
        # The cell that loads this adapter reports what is wrong with it.
        return {}
    fields = {}
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(node, ast.Assign) and isinstance(target, ast.Name) and target.id in NAMES:
            field = NAMES[target.id]
            fields[field] = _literal(node.value, target.id, type(Adapter._field_defaults[field]))
    return fields


def _literal(node: ast.expr, name: str, kind: type) -> Any:
    try:
        value = ast.literal_eval(node)
    except ValueError:
        value = None
    # A text in the place of a tuple would be read letter by letter.
    if not isinstance(value, kind):
        message = "{} is not written out as a {}".format(name, kind.__name__)
        raise ValueError(message)
    return value


def _read_adapter(file: str) -> Adapter:
    source = carried_file("../incell/{}".format(file)) or b""
    try:
        return Adapter(**declarations(source.decode("utf-8")))
    except ValueError as error:
        message = "harness/incell/{}: {}".format(file, error)
        raise ValueError(message) from None


def carried_file(name: str) -> Optional[bytes]:
    """Return a file that lies beside this one, or that a file made to run alone carries; None if there is none."""
    try:
        return pkgutil.get_data(str(__package__), name)
    except OSError:
        return None
