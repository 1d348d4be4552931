"""Describe an environment by its own interpreter: `python -B describe_environment.py [FILE]` prints one JSON document.

It stands alone, imports nothing of the environment and changes nothing in it. What cannot be read is data, too.
"""

from __future__ import annotations

import sys

# This comes before our own imports: no file of the user can hide a module that Python has loaded by now.
STARTED = frozenset(sys.modules)
# Python puts a script's folder first on the path, where our own files would pass for the environment's.
HERE = __file__.rpartition("/")[0]
SEARCHED = [entry for entry in sys.path if entry != HERE]


def _standard(entries: Any) -> Any:
    """Return the folders of the standard library.

    This script's own imports come from there, whatever PYTHONPATH says.
    """
    roots = {sys.base_prefix, sys.base_exec_prefix, sys.prefix, sys.exec_prefix}
    below = [one for one in entries if any(one.startswith(root + "/") for root in roots)]
    return [one for one in below if "site-packages" not in one and "dist-packages" not in one]


STANDARD = _standard(SEARCHED)
sys.path[:] = STANDARD

import json  # noqa: E402 - not before it is known where it comes from
import os  # noqa: E402
import platform  # noqa: E402
import site  # noqa: E402
import sysconfig  # noqa: E402
from typing import Any, Dict, List  # noqa: E402

CODE = (".py", ".so", ".pyd")
MOST_FILES = 300000
SHOWN = 3
COMMON = frozenset(
    "tests test testing docs doc examples example scripts benchmarks benchmark setup conftest utils tools".split()
)
"""Names that many have and nobody imports."""


def document() -> Any:
    """Return the description of this environment, as it is printed."""
    errors: List[str] = []
    entries = _entries()
    distributions = _list_distributions(entries)
    return {
        "schema": 1,
        "python": _call_safely(_python, errors, {}),
        "path": entries,
        "distributions": distributions,
        "leftovers": [one for entry in entries for one in _leftovers(entry)],
        "claimed": _find_shared_files(distributions),
        "hidden": _find_shadowing(distributions, entries),
        "importable": sorted({name for entry in entries if entry not in STANDARD for name in _importable(entry)}),
        "conda": _call_safely(_conda, errors, []),
        "errors": errors,
    }


def _call_safely(ask: Any, errors: Any, otherwise: Any) -> Any:
    """Return a function's answer; if it raises, add a line to `errors` and return `otherwise`."""
    try:
        return ask()
    except Exception as error:
        errors.append("{}: {}: {}".format(ask.__name__.strip("_"), type(error).__name__, error))
        return otherwise


def _folder() -> Any:
    try:
        return os.getcwd()
    except OSError:
        return None


def _entries() -> Any:
    """Return the folders that Python searches for modules, in order.

    If `site` was left out, the folder that it would have added is included.
    """
    entries = [os.path.abspath(one) for one in SEARCHED if one]
    return list(dict.fromkeys([*entries, *(_site_packages() if sys.flags.no_site else ())]))


def _prefix() -> Any:
    """Return the folder of the environment; an older Python does not know it without `site`."""
    place = os.path.dirname(os.path.dirname(os.path.abspath(sys.executable)))
    return place if os.path.isfile(os.path.join(place, "pyvenv.cfg")) else sys.prefix


def _site_packages() -> Any:
    """Return the folders that hold the packages of the environment."""
    variables = {"base": _prefix(), "platbase": _prefix()}
    paths = sysconfig.get_paths(vars=variables)
    return list(dict.fromkeys(paths[name] for name in ("purelib", "platlib")))


# --- the interpreter -------------------------------------------------------------------------------------------


def _python() -> Any:
    return {
        "version": platform.python_version(),
        "implementation": sys.implementation.name,
        "executable": sys.executable,
        "prefix": _prefix(),
        "base_prefix": sys.base_prefix,
        "platform": sysconfig.get_platform(),
        "libc": " ".join(platform.libc_ver()).strip(),
        "user_site": _user_site(),
        "site_packages": _site_packages(),
        "markers": _markers(),
    }


def _markers() -> Any:
    """Return the values of the variables that markers of requirements use (PEP 508)."""
    version = platform.python_version()
    return {
        "python_version": ".".join(version.split(".")[:2]),
        "python_full_version": version,
        "os_name": os.name,
        "sys_platform": sys.platform,
        "platform_release": platform.release(),
        "platform_system": platform.system(),
        "platform_version": platform.version(),
        "platform_machine": platform.machine(),
        "platform_python_implementation": platform.python_implementation(),
        "implementation_name": sys.implementation.name,
        "implementation_version": version,
    }


def _user_site() -> Any:
    try:
        return site.getusersitepackages()
    except Exception:
        return None


# --- distributions ---------------------------------------------------------------------------------------------


def _list_distributions(entries: Any) -> Any:
    distributions = []
    for entry in entries:
        try:
            names = sorted(os.listdir(entry))
        except OSError:
            continue
        for name in names:
            if name.endswith((".dist-info", ".egg-info")) and not name.startswith("~"):
                distributions.append(_distribution(entry, name))
        if entry.endswith(".egg") and os.path.isdir(os.path.join(entry, "EGG-INFO")):
            distributions.append(_distribution(entry, "EGG-INFO"))
    return distributions


def _distribution(entry: Any, name: Any) -> Any:
    """Describe one distribution by its metadata; `trouble` says why the metadata cannot be read."""
    place = os.path.join(entry, name)
    headers, trouble = _metadata(place)
    stem = os.path.basename(entry) if name == "EGG-INFO" else name
    guessed = stem.rpartition(".")[0].split("-")
    files = _read_record(place)
    gone = _missing(entry, [one for one in files or () if not one.startswith(name + "/")])
    fields = {
        "name": headers.get("name", [guessed[0]])[0],
        "version": headers.get("version", [None])[0],
        "folder": name,
        "location": entry,
        "requires": headers.get("requires-dist", []) + _requires(place),
        "requires_python": headers.get("requires-python", [None])[0],
        "modules": _modules(place, files),
        "installer": _text(os.path.join(place, "INSTALLER")).strip() or None,
        "missing": len(gone),
        "missing_files": gone[:SHOWN],
        "trouble": trouble,
    }
    if fields["version"] is None:
        fields["trouble"] = trouble or "its metadata names no version"
        fields["version"] = guessed[1] if len(guessed) > 1 else None
    return fields


def _metadata(place: Any) -> Any:
    """Return the metadata headers by lower-case name, and the reason if they cannot be read (else None)."""
    paths = [os.path.join(place, name) for name in ("METADATA", "PKG-INFO")] if os.path.isdir(place) else [place]
    path = next((one for one in paths if os.path.exists(one)), None)
    if path is None:
        return {}, "it has no METADATA"
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        return {}, "{} cannot be read: {}".format(os.path.basename(path), error.strerror)
    try:
        text, trouble = data.decode("utf-8"), None
    except UnicodeDecodeError:
        # Latin-1 takes every byte, so name and version are still found.
        text, trouble = data.decode("latin-1"), "{} is not UTF-8 text".format(os.path.basename(path))
    headers = _headers(text)
    if not headers.get("name"):
        return headers, trouble or "{} names no project".format(os.path.basename(path))
    return headers, trouble


def _headers(text: Any) -> Any:
    headers: Dict[str, List[str]] = {}
    name = ""
    for line in text.splitlines():
        if not line.strip():
            break
        if line[0] in " \t" and name:
            continue
        name, sign, value = line.partition(":")
        name = name.strip().lower()
        if sign and value.strip():
            headers.setdefault(name, []).append(value.strip())
    return headers


def _requires(place: Any) -> Any:
    """Return the requirements of an egg-info; its sections (extras and conditions) become markers."""
    requirements: List[str] = []
    extra = marker = ""
    for line in map(str.strip, _text(os.path.join(place, "requires.txt")).splitlines()):
        if line.startswith("["):
            extra, _, marker = line.strip("[]").partition(":")
        elif line and not line.startswith("#"):
            conditions = ["({})".format(marker)] if marker else []
            conditions += ['extra == "{}"'.format(extra)] if extra else []
            requirements.append("; ".join([line, " and ".join(conditions)]) if conditions else line)
    return requirements


def _read_record(place: Any) -> Any:
    """Return the files that RECORD lists, with their hashes, relative to the package folder; None without RECORD."""
    path = os.path.join(place, "RECORD")
    if not os.path.isfile(path):
        return None
    # The split is from the right: a file's name may hold commas, its hash and size may not.
    rows = (row.rsplit(",", 2) for row in _text(path).splitlines() if row)
    return {row[0].strip('"'): row[1] if len(row) > 2 else "" for row in rows}


def _modules(place: Any, files: Any) -> Any:
    """Return the names that can be imported: the first part of each recorded code file, else top_level.txt."""
    if files is None:
        return sorted(line.strip() for line in _text(os.path.join(place, "top_level.txt")).splitlines() if line.strip())
    tops = {one.split("/")[0].partition(".")[0] for one in files if one.endswith(CODE) and ".data/" not in one}
    return sorted(one for one in tops if one.isidentifier() and not one.startswith("__"))


looked_at: List[str] = []


def _missing(entry: Any, files: Any) -> Any:
    """Return the code files that RECORD lists and that are gone."""
    plain = [one for one in files if not one.startswith(("..", "/")) and one.endswith(CODE)]
    if len(looked_at) + len(plain) > MOST_FILES:
        return []
    looked_at.extend(plain)
    return [one for one in plain if not os.path.lexists(os.path.join(entry, one))]


def _find_shared_files(distributions: Any) -> Any:
    """Find files that several distributions of a folder claim: the last one installed has overwritten the others.

    Two that bring the very same file do each other no harm.
    """
    owners: Dict[Any, Any] = {}
    for distribution in distributions:
        place = os.path.join(distribution["location"], distribution["folder"])
        for file, mark in (_read_record(place) or {}).items():
            if file.endswith(CODE) and not file.startswith("..") and file.split("/")[0].partition(".")[0] not in COMMON:
                owners.setdefault((distribution["location"], file), {})[distribution["folder"]] = mark
    groups: Dict[Any, Any] = {}
    for (location, file), marks in owners.items():
        if len(set(marks.values())) > 1:
            groups.setdefault((location, tuple(sorted(marks))), []).append(file)
    return [
        {"location": location, "folders": list(folders), "count": len(files), "file": min(files)}
        for (location, folders), files in sorted(groups.items())
    ]


def _leftovers(entry: Any) -> Any:
    """Return the leftovers of an interrupted installation: entries whose names begin with a tilde."""
    try:
        return [os.path.join(entry, name) for name in sorted(os.listdir(entry)) if name.startswith("~")]
    except OSError:
        return []


# --- modules that hide others ----------------------------------------------------------------------------------


def _find_shadowing(distributions: Any, entries: Any) -> Any:
    """Find modules that exist twice: `first` is imported, `then` is that of a distribution or of Python.

    The working folder comes first, as it does for `python -c` and for a script that lies there.
    """
    safe = getattr(sys.flags, "safe_path", False) or sys.flags.isolated
    here = [] if safe or not _folder() else [_folder()]
    order = [*here, *entries]
    modules = {name for one in distributions for name in one["modules"] if name not in COMMON}
    tops = {entry: _importable(entry) for entry in order}
    duplicates = []
    for name in sorted(modules):
        places = [tops[entry][name] for entry in order if name in tops[entry]]
        real = list(dict.fromkeys(map(os.path.realpath, places)))
        if len(real) > 1:
            duplicates.append({"module": name, "first": places[0], "then": real[1], "standard": False})
    return duplicates + _hiding_standard(order, tops)


def _hiding_standard(order: Any, tops: Any) -> Any:
    standard = {name: path for entry in STANDARD for name, path in _importable(entry).items()}
    earlier = order[: min([order.index(one) for one in STANDARD if one in order] or [0])]
    return [
        {"module": name, "first": path, "then": standard[name], "standard": True}
        for entry in earlier
        for name, path in sorted(tops[entry].items())
        if name in standard and name not in STARTED and name not in COMMON
    ]


def _importable(entry: Any) -> Any:
    """Return the modules and packages of a folder by name; a folder without `__init__.py` hides nothing."""
    modules: Dict[str, str] = {}
    try:
        names = sorted(os.listdir(entry))
    except OSError:
        return modules
    for name in names:
        path = os.path.join(entry, name)
        if name.endswith(CODE):
            modules.setdefault(name.partition(".")[0], path)
        elif "." not in name and os.path.isfile(os.path.join(path, "__init__.py")):
            modules[name] = os.path.join(path, "__init__.py")
    return modules


# --- conda -----------------------------------------------------------------------------------------------------


def _conda() -> Any:
    """Return the packages that conda installed here. `metadata` are the folders of Python metadata of each package."""
    place = os.path.join(_prefix(), "conda-meta")
    packages: List[Dict[str, Any]] = []
    for name in sorted(os.listdir(place)) if os.path.isdir(place) else ():
        if name.endswith(".json"):
            record = _json(os.path.join(place, name))
            if not isinstance(record, dict) or not record.get("name"):
                packages.append({"name": name[:-5], "trouble": "it cannot be read"})
                continue
            files = [one for one in record.get("files") or () if isinstance(one, str)]
            folders = {one.split("/")[-2] for one in files if one.endswith(("-info/METADATA", "-info/PKG-INFO"))}
            fields: Dict[str, Any] = {key: record.get(key) for key in ("name", "version", "build", "channel")}
            packages.append(dict(fields, metadata=sorted(folders), trouble=None))
    return packages


def _json(path: Any) -> Any:
    try:
        return json.loads(_text(path) or "null")
    except ValueError:
        return None


def _text(path: Any) -> Any:
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.read()
    except OSError:
        return ""


if __name__ == "__main__":
    OUTPUT = json.dumps(document())
    if len(sys.argv) > 1:
        with open(sys.argv[1], "w", encoding="ascii") as target:
            target.write(OUTPUT)
    else:
        print(OUTPUT)
