"""Convert resolutions: uv's pylock to a `Lock`, a lock to hash-pinned requirements, wheels to a pylock to install."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC
from functools import cache
from pathlib import PurePath
from typing import Any
from urllib.parse import unquote, urlsplit

from packaging.markers import default_environment
from packaging.requirements import InvalidRequirement, Requirement
from packaging.tags import Tag, compatible_tags, cpython_tags, platform_tags
from packaging.utils import canonicalize_name, parse_wheel_filename
from tomli_w import dumps

from harness.model import Artifact, Interpreter, Lock, Pin
from harness.model.errors import BadInput, CouldNotTell

PLACE = "https://wheels.invalid/{sha256}"
"""The index that a wheel is said to come from, so that what uv keeps of it goes by its content."""

UNRANKED = 1_000_000
"""After every tag that is known: what uv takes and packaging does not know of (another implementation's wheels)."""

HASH = re.compile(r"sha256:([0-9a-f]{64})")
PINNED = re.compile(r"(?m)^(?P<name>[\w.-]+)==(?P<version>\S+)(?P<hashes>(?: \\\n +--hash=sha256:[0-9a-f]{64})+)$")


def read(pylock: Mapping[str, Any], interpreter: Interpreter, instant: str) -> Lock:
    """Choose, for each package of a resolution that uv made for this interpreter, the file that uv would install.

    The hashes of a pin are those of all wheels that fit this interpreter here, or of the sdist where none does.
    """
    return assemble((_pin(package, interpreter) for package in pylock.get("packages", ())), instant)


def assemble(pins: Iterable[Pin], instant: str) -> Lock:
    """Make a lock of pins; a file without an upload time counts as escaped, since no cutoff applied to it."""
    ordered = tuple(sorted(pins, key=lambda pin: pin.name))
    text = "".join(_requirement(pin) for pin in ordered)
    return Lock(
        pins=ordered,
        requirements=text,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        instant=instant,
        escaped=tuple(pin.name for pin in ordered if pin.artifact.uploaded is None),
    )


def read_pins(requirements: str) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Read a lock's own requirements: name to version and hashes. Raises BadInput for any other text."""
    pins = {
        match["name"]: (match["version"], tuple(HASH.findall(match["hashes"])))
        for match in PINNED.finditer(requirements)
    }
    left = PINNED.sub("", requirements).strip()
    if left:
        message = f"not a lock of this harness: `{left.splitlines()[0]}` is no `name==version --hash=sha256:...`"
        raise BadInput(message)
    return pins


def restore(pylock: Mapping[str, Any], requirements: str, interpreter: Interpreter, instant: str) -> Lock:
    """Find the files of a lock among those that a resolution offers. Raises CouldNotTell where one is not offered."""
    pins_by_name = read_pins(requirements)
    packages = {str(canonicalize_name(package["name"])): package for package in pylock.get("packages", ())}
    pins = [_restore_pin(packages.get(name), name, *pins_by_name[name], interpreter) for name in pins_by_name]
    return assemble(pins, instant)


def format_pylock(wheels: Iterable[tuple[str, str, Artifact]]) -> str:
    """Write a pylock from which uv installs exactly these wheels (name, version, file) without asking an index."""

    packages: list[dict[str, Any]] = []
    for name, version, artifact in wheels:
        place = "url" if "://" in artifact.source else "path"
        file = {"name": artifact.filename, place: artifact.source, "hashes": {"sha256": artifact.sha256}}
        index = {"index": PLACE.format(sha256=artifact.sha256)} if _remote(artifact) else {}
        packages.append({"name": name, "version": version, **index, "wheels": [file]})
    return dumps({"lock-version": "1.0", "created-by": "simmatrix", "packages": packages})


def format_uv_settings(wheels: Iterable[Artifact]) -> str:
    """Write a `uv.toml` that makes uv keep the wheels it has for good, whatever the index says of caching files.

    Without it, uv asks an index that says nothing of caching for the whole file again for each environment (measured:
    uv 0.13).
    """

    indexes = [
        {
            "name": f"sha256-{artifact.sha256}",
            "url": PLACE.format(sha256=artifact.sha256),
            "explicit": True,
            "cache-control": {"files": "max-age=365000000, immutable"},
        }
        for artifact in filter(_remote, wheels)
    ]
    return dumps({"index": indexes} if indexes else {})


def _remote(artifact: Artifact) -> bool:
    # uv has unpacked a file of a folder when it resolved, and finds it again by the name of that folder.
    return "://" in artifact.source and not artifact.source.startswith("file:")


@cache
def tags(interpreter: Interpreter) -> Mapping[Tag, int]:
    """Return the wheel tags that the interpreter takes on this platform, best first, with their rank."""
    version = tuple(int(part) for part in interpreter.minor.split("."))
    name, _, build = interpreter.implementation.partition("+")
    platforms = list(platform_tags())
    own: Iterator[Tag] = iter(())
    if name == "cpython":
        # Before Python 3.8 the tag of an ABI ends in `m`, as in cp37m.
        abi = f"cp{version[0]}{version[1]}" + ("m" if version < (3, 8) else "t" * (build == "freethreaded"))
        own = cpython_tags(version, [abi], platforms)
    short = f"cp{version[0]}{version[1]}" if name == "cpython" else None
    ordered = [*own, *compatible_tags(version, short, platforms)]
    return {tag: rank for rank, tag in reversed(list(enumerate(ordered)))}


def rank(filename: str, interpreter: Interpreter) -> tuple[int, tuple[int, str]]:
    """Return a sort key for wheels of one version, as installers order them: best tag, then higher build number."""
    ranks = tags(interpreter)
    _, _, build, wheel_tags = parse_wheel_filename(filename)
    number, suffix = build or (0, "")
    return min(ranks.get(tag, UNRANKED) for tag in wheel_tags), (-number, suffix)


def unmet(requires: Iterable[str], lock: Lock, interpreter: Interpreter, overrides: Iterable[str]) -> str | None:
    """Say which `Requires-Dist` line of a wheel its lock does not fulfil, if any; overridden ones do not count."""
    overridden = {canonicalize_name(Requirement(line).name) for line in overrides}
    environment = marker_environment(interpreter)
    for line in requires:
        try:
            requirement = Requirement(line)
        except InvalidRequirement:
            return f"has a requirement that cannot be read: {line}"
        name = canonicalize_name(requirement.name)
        if name in overridden or not (requirement.marker is None or requirement.marker.evaluate(environment)):
            continue
        version = lock.versions.get(name)
        if version is None:
            return f"requires {line}, which the lock does not hold"
        if not requirement.specifier.contains(version, prereleases=True):
            return f"requires {line}, but the lock holds {name} {version}"
    return None


def marker_environment(interpreter: Interpreter) -> dict[str, str]:
    """Return the values of environment markers inside the interpreter, without extras."""
    name = interpreter.implementation.partition("+")[0]
    return {
        **{key: str(value) for key, value in default_environment().items()},
        "python_version": interpreter.minor,
        "python_full_version": interpreter.version,
        "implementation_name": name,
        "implementation_version": interpreter.version,
        "platform_python_implementation": {"cpython": "CPython", "pypy": "PyPy"}.get(name, name),
        "extra": "",
    }


def _pin(package: Mapping[str, Any], interpreter: Interpreter) -> Pin:
    name, version = canonicalize_name(str(package["name"])), str(package.get("version", ""))
    offered = list(_offered(package))
    wheels = sorted((one for one in offered if one.is_wheel), key=lambda artifact: rank(artifact.filename, interpreter))
    taken = wheels or offered
    if not taken or not version:
        message = (
            f"{name} comes from a folder or a repository, which no hash can pin; "
            f"build a wheel of it and require that: '{name} @ file:///...whl'"
        )
        raise BadInput(message)
    return Pin(name=name, version=version, artifact=taken[0], hashes=tuple(sorted({one.sha256 for one in taken})))


def _restore_pin(
    package: Mapping[str, Any] | None, name: str, version: str, hashes: tuple[str, ...], interpreter: Interpreter
) -> Pin:
    offered = [one for one in _offered(package or {}) if one.sha256 in hashes]
    if not offered:
        message = (
            f"no index or find-links place that was asked has {name} {version} with a hash of the lock; lock again"
        )
        raise CouldNotTell(message)
    offered.sort(
        key=lambda artifact: rank(artifact.filename, interpreter) if artifact.is_wheel else (UNRANKED + 1, (0, ""))
    )
    # All hashes of the lock, not only those found now: the restored text has to be the committed one.
    return Pin(name=name, version=version, artifact=offered[0], hashes=hashes)


def _offered(package: Mapping[str, Any]) -> Iterator[Artifact]:
    """Yield all files that uv lists for a package: an archive is a requirement that named its own address."""
    entries = [*package.get("wheels", ()), *(package[kind] for kind in ("sdist", "archive") if kind in package)]
    for entry in entries:
        source = str(entry.get("url") or entry.get("path"))
        filename = str(entry.get("name") or unquote(PurePath(urlsplit(source).path).name))
        sha256 = entry.get("hashes", {}).get("sha256")
        if sha256 is None:
            message = f"the index gives no SHA-256 of {filename}, so that it cannot be locked; use another index"
            raise CouldNotTell(message)
        yield Artifact(
            filename=filename,
            sha256=sha256,
            source=source,
            size=entry.get("size"),
            uploaded=_instant(entry.get("upload-time")),
        )


def _instant(moment: Any) -> str | None:
    return None if moment is None else moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _requirement(pin: Pin) -> str:
    return " \\\n".join((f"{pin.name}=={pin.version}", *(f"    --hash=sha256:{one}" for one in pin.hashes))) + "\n"
