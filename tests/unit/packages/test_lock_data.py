"""Locks as data: which file an interpreter takes, the text that is committed, what a built wheel may require."""

import tomllib

import pytest
from builders import SHA, interpreter, lock, pin

from harness.model import Artifact
from harness.model.errors import BadInput, CouldNotTell
from harness.packages import locks

A, B, C = "a" * 64, "b" * 64, "c" * 64
INSTANT = "2026-01-01T00:00:00Z"


def entry(name: str, sha256: str = A) -> dict[str, object]:
    """Return a file as uv writes it."""
    return {"url": f"https://files.invalid/x%2By/{name}".replace("+", "%2B"), "hashes": {"sha256": sha256}}


@pytest.mark.parametrize(
    ("version", "implementation", "files", "taken"),
    [
        pytest.param("3.7.16", "cpython", ("p-1-cp37-cp37m-linux_x86_64.whl", "p-1-py3-none-any.whl"), 0, id="3.7-abi"),
        pytest.param("3.12.1", "cpython", ("p-1-py3-none-any.whl", "p-1-cp38-abi3-linux_x86_64.whl"), 1, id="abi3"),
        pytest.param("3.11.7", "cpython", ("p-1-py2.py3-none-any.whl", "p-1-py311-none-any.whl"), 1, id="exact"),
        pytest.param("3.11.7", "cpython", ("p-1-1-py3-none-any.whl", "p-1-2-py3-none-any.whl"), 1, id="build-number"),
        pytest.param(
            "3.13.0",
            "cpython+freethreaded",
            ("p-1-py3-none-any.whl", "p-1-cp313-cp313t-linux_x86_64.whl"),
            1,
            id="free-threaded",
        ),
    ],
)
def test_file_that_is_taken(version: str, implementation: str, files: tuple[str, ...], taken: int) -> None:
    """Of several wheels that fit, the interpreter takes the most particular, of equals the last build."""
    package = {"name": "p", "version": "1", "wheels": [entry(name) for name in files]}
    lock = locks.read({"packages": [package]}, interpreter(version, implementation), INSTANT)

    assert lock.pins[0].artifact.filename == files[taken]


def test_newest_platform_first() -> None:
    """Of wheels for several platforms the one for the newest that is here is taken."""
    names = ["p-1-cp311-cp311-manylinux_2_5_x86_64.whl", "p-1-cp311-cp311-manylinux_2_17_x86_64.whl"]
    if locks.rank(names[0], interpreter("3.11.7"))[0] == locks.UNRANKED:
        pytest.skip("unavailable: a Linux of glibc on x86_64")

    assert sorted(names, key=lambda name: locks.rank(name, interpreter("3.11.7"))) == names[::-1]


def test_sdist_only_without_wheel() -> None:
    """Hashes are those of the wheels that fit; an sdist is taken, and hashed, only where there is none."""
    wheels = [entry("p-1-py3-none-any.whl", B), entry("p-1-py2.py3-none-any.whl", A)]
    both = {"name": "P.p", "version": "1", "sdist": entry("p-1.tar.gz", C), "wheels": wheels}
    alone = {"name": "q", "version": "2+x", "sdist": entry("q-2%2Bx.tar.gz", C)}
    lock = locks.read({"packages": [alone, both]}, interpreter("3.11.7"), INSTANT)

    assert lock.requirements == (
        f"p-p==1 \\\n    --hash=sha256:{A} \\\n    --hash=sha256:{B}\nq==2+x \\\n    --hash=sha256:{C}\n"
    )
    assert lock.pins[1].artifact.filename == "q-2+x.tar.gz"
    assert lock.escaped == ("p-p", "q")


def test_folder_cannot_be_locked() -> None:
    """A package from a folder or repository has no hash."""
    package = {"name": "p", "version": "1", "directory": {"path": "."}}
    with pytest.raises(BadInput) as raised:
        locks.read({"packages": [package]}, interpreter("3.11.7"), INSTANT)

    assert str(raised.value) == (
        "p comes from a folder or a repository, which no hash can pin; "
        "build a wheel of it and require that: 'p @ file:///...whl'"
    )


def test_index_without_hashes() -> None:
    """A file that an index gives no hash of cannot be locked: the index's fault."""
    package = {"name": "p", "version": "1", "wheels": [{"url": "https://files.invalid/p-1-py3-none-any.whl"}]}
    with pytest.raises(CouldNotTell) as raised:
        locks.read({"packages": [package]}, interpreter("3.11.7"), INSTANT)

    assert str(raised.value) == (
        "the index gives no SHA-256 of p-1-py3-none-any.whl, so that it cannot be locked; use another index"
    )


class TestText:
    def test_round_trip(self) -> None:
        """A lock is read back as it was written."""
        lock = locks.assemble([pin("b", "2.0+cpu"), pin("a", "1.0")], INSTANT)

        assert locks.read_pins(lock.requirements) == {"a": ("1.0", (SHA,)), "b": ("2.0+cpu", (SHA,))}

    @pytest.mark.parametrize(
        "text", ["a>=1", "a==1.0", "a==1.0 --hash=md5:00", f"a==1 \\\n    --hash=sha256:{A} extra"]
    )
    def test_no_lock(self, text: str) -> None:
        """Anything but pinned and hashed requirements is refused, with its line."""
        with pytest.raises(BadInput) as raised:
            locks.read_pins(text)

        assert str(raised.value) == (
            f"not a lock of this harness: `{text.splitlines()[0]}` is no `name==version --hash=sha256:...`"
        )


class TestUnmet:
    LOCK = lock(pin("b", "2.0"), pin("c", "1.0rc1"))

    @pytest.mark.parametrize(
        ("line", "told"),
        [
            ("b>=1", None),
            ("c", None),
            ("B.b", "requires B.b, which the lock does not hold"),
            ("b<2", "requires b<2, but the lock holds b 2.0"),
            ("d; extra == 'all'", None),
            ("d; python_version < '3.8'", "requires d; python_version < '3.8', which the lock does not hold"),
            ("d; python_version > '3.8'", None),
            ("d; platform_python_implementation == 'PyPy'", None),
            ("opencv-python (>=3.)", "has a requirement that cannot be read: opencv-python (>=3.)"),
            ("e", None),
        ],
    )
    def test_requirement(self, line: str, told: str | None) -> None:
        """A requirement counts where its marker holds in the cell's Python, unless it is overridden."""
        assert locks.unmet([line], self.LOCK, interpreter("3.7.16"), ["e==1"]) == told


def test_pylock_to_install_from() -> None:
    """uv is told the one file of each package, by address or path, with its hash."""
    remote = Artifact(filename="a-1-py3-none-any.whl", sha256=A, source="https://files.invalid/a-1-py3-none-any.whl")
    built = Artifact(filename="b-1-py3-none-any.whl", sha256=B, source="/wheels/b-1-py3-none-any.whl")

    one = {"name": "a-1-py3-none-any.whl", "url": remote.source, "hashes": {"sha256": A}}
    other = {"name": "b-1-py3-none-any.whl", "path": "/wheels/b-1-py3-none-any.whl", "hashes": {"sha256": B}}
    assert tomllib.loads(locks.format_pylock([("a", "1", remote), ("b", "1", built)])) == {
        "lock-version": "1.0",
        "created-by": "simmatrix",
        "packages": [
            {"name": "a", "version": "1", "index": f"https://wheels.invalid/{A}", "wheels": [one]},
            {"name": "b", "version": "1", "wheels": [other]},
        ],
    }


@pytest.mark.parametrize("folder", ["/\U0001f600", '/a"b\\c', "/é\x7f\t", "/{}[]='#"])
def test_any_folder_can_be_passed_to_uv(folder: str) -> None:
    """A path with whatever characters is read again as it is."""
    built = Artifact(filename="b-1-py3-none-any.whl", sha256=B, source=f"{folder}/b-1-py3-none-any.whl")

    (package,) = tomllib.loads(locks.format_pylock([("b", "1", built)]))["packages"]

    assert package["wheels"][0]["path"] == built.source


def test_wheels_that_uv_keeps_for_good() -> None:
    """A wheel with an address is kept by its hash, whatever the index says; a file that lies here needs none of it."""
    remote = Artifact(filename="a-1-py3-none-any.whl", sha256=A, source="https://files.invalid/a-1-py3-none-any.whl")
    built = Artifact(filename="b-1-py3-none-any.whl", sha256=B, source="/wheels/b-1-py3-none-any.whl")

    (only,) = tomllib.loads(locks.format_uv_settings([remote, built]))["index"]
    assert only["url"] == f"https://wheels.invalid/{A}"
    assert only["explicit"]
    assert "immutable" in only["cache-control"]["files"]
    assert locks.format_uv_settings([built]) == ""
