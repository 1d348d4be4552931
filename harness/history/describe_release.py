"""Import an unpacked release and write what only running tells: `python -B describe_release.py FILE FOLDER MODULE...`.

Runs in any Python from 3.6 on, with what the release needs at hand. Writes one JSON document: `names` of modules,
`members` of classes, `environments` that are registered, `schema` of MuJoCo's files, `failed` imports with their error.
"""

import ast
import importlib
import json
import re
import sys
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Set

_ABSENT = object()


def main(file: str, folder: str, modules: Sequence[str]) -> None:
    """Import the modules and write the document."""
    sys.path.insert(0, folder)
    document: Dict[str, Any] = {"names": {}, "members": {}, "environments": None, "schema": None, "failed": {}}
    for name in modules:
        try:
            module = importlib.import_module(name)
        except BaseException as error:
            document["failed"][name] = f"{type(error).__name__}: {error}"[:200]
            continue
        public = [name_there for name_there in dir(module) if not name_there.startswith("_")]
        public += sorted(_offered(module) - set(public))
        document["names"][name] = [name_there for name_there in public if not _foreign(module, name_there)]
        for name_there in public:
            value = _value(module, name_there)
            if isinstance(value, type) and str(value.__module__).partition(".")[0] == name.partition(".")[0]:
                members = sorted(member for member in dir(value) if not member.startswith("_"))
                if not any(part.startswith("_") for part in str(value.__module__).split(".")):
                    document["members"][f"{value.__module__}.{value.__qualname__}"] = members
                document["members"][f"{name}.{name_there}"] = members
    document["environments"] = _environments()
    document["schema"] = _schema()
    Path(file).write_text(json.dumps(document, sort_keys=True))


def _foreign(module: Any, name: str) -> bool:
    """Return whether a name is a module of another package."""
    value = _value(module, name)
    top = str(getattr(value, "__name__", "")).partition(".")[0]
    return isinstance(value, type(sys)) and top != module.__name__.partition(".")[0]


def _offered(module: Any) -> Set[str]:
    """Return the names that only `__getattr__` of a module brings: those in its source that are answered."""
    if not hasattr(module, "__getattr__"):
        return set()
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    # Python 3.7 has a text as `s`, later ones as `value`.
    texts = {getattr(node, "value", getattr(node, "s", None)) for node in ast.walk(tree)}
    names = {text for text in texts if isinstance(text, str) and text.isidentifier() and not text.startswith("_")}
    return {name for name in names if _is_there(module, name)}


def _is_there(module: Any, name: str) -> bool:
    return _value(module, name, _ABSENT) is not _ABSENT


def _value(module: Any, name: str, otherwise: Any = None) -> Any:
    """Return what a module has under a name, or something else where it cannot be had: some are imported only then."""
    try:
        return getattr(module, name)
    except BaseException:
        return otherwise


def _environments() -> Optional[List[str]]:
    """Return the ids that are registered with gym or gymnasium; None where neither was imported."""
    for library in ("gymnasium", "gym"):
        registration = sys.modules.get(library + ".envs.registration")
        registry = getattr(registration, "registry", None)
        if registry is not None:
            specs = getattr(registry, "env_specs", registry)
            return sorted(map(str, specs))
    return None


def _schema() -> Optional[List[str]]:
    """Return `path attribute` of each attribute that MuJoCo's files may have, and each path; None without MuJoCo."""
    mujoco: Any = sys.modules.get("mujoco")
    if not hasattr(mujoco, "mj_printSchema"):
        return None
    entries: Set[str] = set()
    path: List[str] = []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        match = re.match(r"( *)(\w+) \([^)]+\)(.*)", line)
        if match:
            path[len(match.group(1)) // 3 :] = [match.group(2)]
            entries.add("/".join(path))
        for attribute in (match.group(3) if match else line).split():
            entries.add("/".join(path) + " " + attribute)
    return sorted(entries)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
