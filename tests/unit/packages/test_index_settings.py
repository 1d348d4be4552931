"""Test the meaning of uv's and pip's settings."""

import os
from pathlib import Path

import pytest

from harness.model import IndexSettings
from harness.model.errors import BadInput
from harness.packages import index_settings
from harness.packages.index_settings import UserIndex, combine, settings


@pytest.fixture(autouse=True)
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return an empty home on a machine without settings."""
    for variable in os.environ:
        if variable.startswith(("UV_", "PIP_", "XDG_", "SSL_CERT", "REQUESTS_", "CURL_", "VIRTUAL_", "CONDA_", "ALL_")):
            monkeypatch.delenv(variable)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(index_settings, "ETC", tmp_path / "etc")
    return tmp_path


def put(path: Path, text: str) -> None:
    """Write a settings file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_a_machine_without_settings_has_none() -> None:
    """Nothing set means uv's and pypi-simple's own default index."""
    assert settings() == UserIndex(strategy="first-index")


def test_uv_variables_come_before_its_files(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Variables, then the user's uv.toml, then the machine's; explicit indexes count for nothing."""
    put(
        home / ".config/uv/uv.toml",
        """
index-strategy = "unsafe-first-match"
find-links = ["wheels"]
index = [
    {name = "mine", url = "https://mine.test/simple"},
    {name = "pin", url = "https://pin.test/simple", explicit = true},
    {name = "flat", url = "https://flat.test/files", format = "flat"},
    {url = "https://main.test/simple", default = true},
]
""",
    )
    put(home / "etc/uv/uv.toml", 'index-url = "https://machine.test/simple"\nextra-index-url = ["https://more.test"]')
    monkeypatch.setenv("UV_INDEX", "lab=https://lab.test/simple https://two.test/simple")
    monkeypatch.setenv("UV_FIND_LINKS", "/links,https://links.test/")

    assert settings() == UserIndex(
        default="https://main.test/simple",
        extra=(
            "https://lab.test/simple",
            "https://two.test/simple",
            "https://mine.test/simple",
            "https://more.test",
        ),
        find_links=("/links", "https://links.test/", "https://flat.test/files", str(home / ".config/uv/wheels")),
        strategy="unsafe-first-match",
    )
    monkeypatch.setenv("UV_DEFAULT_INDEX", "https://variable.test/simple")
    assert settings().default == "https://variable.test/simple"


def test_pip_files_are_read_in_its_order(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine's pip.conf, the user's, the environment's; a later one wins per option, a variable over all."""
    put(
        home / "etc/pip.conf",
        "[global]\nindex-url = https://machine.test\nfind-links = /machine /shared\nno-index = no",
    )
    put(
        home / ".config/pip/pip.conf", "[global]\nextra_index_url =\n  https://a.test\n  https://b.test\ncert = /ca.pem"
    )
    put(home / "env/pip.conf", "[install]\nindex-url = https://environment.test\nproxy = http://proxy.test:3128")
    monkeypatch.setenv("VIRTUAL_ENV", str(home / "env"))
    monkeypatch.setenv("PIP_FIND_LINKS", "/variable")

    assert settings() == UserIndex(
        default="https://environment.test",
        extra=("https://a.test", "https://b.test"),
        find_links=("/variable",),
        strategy="unsafe-best-match",
        certificates="/ca.pem",
        proxy="http://proxy.test:3128",
    )


def test_pip_does_not_override_uv(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If uv has its own default index, certificates or strategy, those of pip are ignored."""
    put(home / "etc/pip.conf", "[global]\nindex-url = https://pip.test\nextra-index-url = https://more.test\ncert = /a")
    put(home / ".config/uv/uv.toml", '[pip]\nindex-url = "https://uv.test"\nindex-strategy = "unsafe-first-match"')
    monkeypatch.setenv("SSL_CERT_FILE", "/b")

    assert settings() == UserIndex(
        default="https://uv.test", extra=("https://more.test",), strategy="unsafe-first-match", certificates="/b"
    )


def test_a_matrix_stands_before_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its default replaces the user's, its other places come first."""
    monkeypatch.setenv("UV_DEFAULT_INDEX", "https://user.test")
    monkeypatch.setenv("UV_FIND_LINKS", "/user")

    found = combine(IndexSettings(default="https://matrix.test", find_links=("/matrix",), no_index=True))

    assert (found.default, found.find_links, found.no_index) == ("https://matrix.test", ("/matrix", "/user"), True)


def test_settings_can_be_switched_off(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`UV_NO_CONFIG` and `PIP_CONFIG_FILE` at the null device hide the files, as they do for uv and pip."""
    put(home / ".config/uv/uv.toml", 'index-url = "https://uv.test"')
    put(home / "etc/pip.conf", "[global]\nindex-url = https://pip.test")
    monkeypatch.setenv("UV_NO_CONFIG", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)

    assert settings().default is None


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        (".config/uv/uv.toml", "index-url = ", "{home}/.config/uv/uv.toml: uv's settings cannot be read: "),
        ("etc/pip.conf", "index-url = x", "pip's settings cannot be read: File contains no section headers."),
    ],
    ids=["uv", "pip"],
)
def test_settings_that_cannot_be_read_are_bad_input(home: Path, file: str, text: str, message: str) -> None:
    """A broken settings file is named, not skipped."""
    put(home / file, text)

    with pytest.raises(BadInput) as raised:
        settings()

    assert str(raised.value).startswith(message.format(home=home))


def test_trusted_hosts_reach_uv_by_variables(home: Path) -> None:
    """Keys of uv.toml about certificates reach uv, which reads no file of its own when we start it."""
    put(home / "etc/uv/uv.toml", 'native-tls = true\nallow-insecure-host = ["a.test"]')
    put(home / ".config/uv/uv.toml", 'allow-insecure-host = ["b.test", "c.test:8080"]')

    assert settings().trust == {"UV_SYSTEM_CERTS": "true", "UV_INSECURE_HOST": "b.test c.test:8080"}
