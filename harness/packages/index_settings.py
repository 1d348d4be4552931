"""Read where the user's uv and pip take packages from, as their variables and files set it.

`settings` reads them, `combine` puts a matrix's places before them.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

from msgspec import Struct

from harness.machine.files import given_files
from harness.model import IndexSettings
from harness.model.errors import BadInput

ETC = Path("/etc")
"""Where the machine's own settings lie."""

NOTHING = IndexSettings()
"""Of a matrix that says nothing about its places."""


class UserIndex(Struct, frozen=True, kw_only=True):
    """The places from which this user's uv and pip take packages.

    `default` None is the index that pypi-simple and uv know by themselves. `extra` are asked before it, `find_links`
    are folders or pages of files. Logins that a variable gives (`UV_INDEX_NAME_PASSWORD`) are inside the addresses.
    `strategy` is uv's: pip's extra indexes mean `unsafe-best-match`, uv's own default is `first-index`.
    `trust` are uv's variables for certificates and hosts that its file speaks of.
    """

    default: str | None = None
    extra: tuple[str, ...] = ()
    find_links: tuple[str, ...] = ()
    no_index: bool = False
    strategy: str | None = None
    certificates: str | None = None
    proxy: str | None = None
    trust: Mapping[str, str] = {}


def settings() -> UserIndex:
    """Return the places that variables and files set for uv and pip; uv's settings win over pip's."""
    return _together(_uv_variables(), *map(_uv_file, _uv_files()), _pip_settings())


def combine(matrix: IndexSettings) -> UserIndex:
    """Return the user's places with the matrix's before them; the matrix's default replaces the user's."""
    own = UserIndex(default=matrix.default, extra=matrix.extra, find_links=matrix.find_links, no_index=matrix.no_index)
    return _together(own, settings())


def _together(*places: UserIndex) -> UserIndex:
    """Return these places as one: of a setting with one value the first that is set counts, lists follow each other."""

    def first(name: str) -> str | None:
        return next(filter(None, (getattr(one, name) for one in places)), None)

    return UserIndex(
        default=first("default"),
        extra=_distinct(*(one.extra for one in places)),
        find_links=_distinct(*(one.find_links for one in places)),
        no_index=any(one.no_index for one in places),
        strategy=first("strategy"),
        certificates=first("certificates"),
        proxy=first("proxy"),
        # Reversed: the last entry of a dict wins, and the user's file stands before the system's.
        trust={name: value for one in reversed(places) for name, value in one.trust.items()},
    )


def _uv_variables() -> UserIndex:
    given = os.environ.get
    defaults = [_named(value) for name in ("UV_DEFAULT_INDEX", "UV_INDEX_URL") if (value := given(name))]
    return UserIndex(
        default=next(iter(defaults), None),
        extra=tuple(_named(value) for name in ("UV_INDEX", "UV_EXTRA_INDEX_URL") for value in given(name, "").split()),
        find_links=tuple(_located(value, Path()) for value in _split(given("UV_FIND_LINKS", ""), ",")),
        strategy=given("UV_INDEX_STRATEGY"),
        certificates=given("SSL_CERT_FILE"),
    )


def _uv_files() -> Iterator[Path]:
    """Yield uv's settings files by its own rule: the named file alone, else the user's, then the system's first."""
    if named := os.environ.get("UV_CONFIG_FILE"):
        yield Path(named)
        return
    if os.environ.get("UV_NO_CONFIG", "").lower() in {"1", "true"}:
        return
    there = [path for folder in (*_system_config(), ETC) if (path := folder / "uv/uv.toml").is_file()]
    yield from (path for path in (_user_config() / "uv/uv.toml", *there[:1]) if path.is_file())


def _uv_file(path: Path) -> UserIndex:
    try:
        table = tomllib.loads(given_files.read_text(path))
    except (RecursionError, ValueError) as error:
        message = f"{path}: uv's settings cannot be read: {error}"
        raise BadInput(message) from None
    # Only `uv pip` commands run here, and for them the `[pip]` table comes before the top level.
    table = {**table, **table.get("pip", {})}
    indexes = [entry for entry in table.get("index", ()) if not entry.get("explicit")]
    addresses = [(entry, _named(f"{entry.get('name', '')}={entry['url']}", path.parent)) for entry in indexes]
    flat = [address for entry, address in addresses if entry.get("format") == "flat"]
    simple = [(entry, address) for entry, address in addresses if entry.get("format") != "flat"]
    defaults = [address for entry, address in simple if entry.get("default")]
    legacy = [_located(value, path.parent) for value in table.get("extra-index-url", ())]
    return UserIndex(
        default=next(iter(defaults), table.get("index-url")),
        extra=(*(address for entry, address in simple if not entry.get("default")), *legacy),
        find_links=(*flat, *(_located(value, path.parent) for value in table.get("find-links", ()))),
        no_index=bool(table.get("no-index")),
        strategy=table.get("index-strategy"),
        trust=_trust(table),
    )


def _trust(table: Mapping[str, Any]) -> dict[str, str]:
    """Return the variables that tell uv which certificates and hosts to trust."""
    system = table.get("system-certs") or table.get("native-tls")
    hosts = " ".join(table.get("allow-insecure-host", ()))
    return ({"UV_SYSTEM_CERTS": "true"} if system else {}) | ({"UV_INSECURE_HOST": hosts} if hosts else {})


def _pip_settings() -> UserIndex:
    options = _pip_options()
    extra = tuple(options.get("extra-index-url", "").split())
    return UserIndex(
        default=next(iter(options.get("index-url", "").split()), None),
        extra=extra,
        find_links=tuple(_located(value, Path()) for value in options.get("find-links", "").split()),
        no_index=options.get("no-index", "").lower() in {"1", "true", "yes", "on"},
        strategy="unsafe-best-match" if extra else "first-index",
        certificates=os.environ.get("REQUESTS_CA_BUNDLE") or os.environ.get("CURL_CA_BUNDLE") or options.get("cert"),
        proxy=options.get("proxy"),
    )


def _pip_options() -> dict[str, str]:
    """Return pip's options; later places win: global, user, environment, `PIP_CONFIG_FILE`, variables."""
    import configparser  # noqa: PLC0415 - start-up

    named = os.environ.get("PIP_CONFIG_FILE")
    active = os.environ.get("VIRTUAL_ENV") or os.environ.get("CONDA_PREFIX")
    files = [folder / "pip/pip.conf" for folder in reversed(_system_config())]
    files += [ETC / "pip.conf", Path.home() / ".pip/pip.conf", _user_config() / "pip/pip.conf"]
    files += [Path(active, "pip.conf")] if active else []
    files += [Path(named)] if named else []
    parser = configparser.RawConfigParser()
    try:
        # pip reads no file at all where PIP_CONFIG_FILE is the null device.
        parser.read([] if named == os.devnull else files, encoding="utf-8")
    except (configparser.Error, UnicodeDecodeError) as error:
        message = f"pip's settings cannot be read: {error}"
        raise BadInput(message) from None
    sections = [parser[name] for name in ("global", "install") if parser.has_section(name)]
    options = {key.replace("_", "-"): value for section in sections for key, value in section.items()}
    for key in ("index-url", "extra-index-url", "find-links", "no-index", "cert", "proxy"):
        if value := os.environ.get("PIP_" + key.upper().replace("-", "_")):
            options[key] = value
    return options


def _system_config() -> list[Path]:
    named = _split(os.environ.get("XDG_CONFIG_DIRS", ""), ":")
    return [Path(folder) for folder in named] or [ETC / "xdg"]


def _user_config() -> Path:
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")


def _named(value: str, folder: Path = Path()) -> str:
    """Return the address of uv's `NAME=ADDRESS`, with the login of `UV_INDEX_NAME_USERNAME` and `_PASSWORD`."""
    name, separator, address = value.partition("=")
    # An address may hold a `=` of its own; an index of a settings file may have an empty name.
    if not separator or not re.fullmatch(r"[\w.-]*", name):
        return _located(value, folder)
    prefix = "UV_INDEX_" + re.sub(r"\W", "_", name).upper()
    user, password = os.environ.get(f"{prefix}_USERNAME", ""), os.environ.get(f"{prefix}_PASSWORD", "")
    if not (user or password) or "@" in urlsplit(address).netloc:
        return _located(address, folder)
    return address.replace("://", f"://{quote(user, safe='')}:{quote(password, safe='')}@", 1)


def _located(value: str, folder: Path) -> str:
    """Return an address as it is, and a path made absolute."""
    return value if "://" in value else str((folder / Path(value).expanduser()).absolute())


def _split(value: str, separator: str) -> list[str]:
    return [part.strip() for part in value.split(separator) if part.strip()]


def _distinct(*groups: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(value for group in groups for value in group))
