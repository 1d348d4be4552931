"""Requirement files as people have them, and what is asked for by each."""

import sys
from pathlib import Path

import pytest

from harness.model import IndexSettings
from harness.model.errors import BadInput
from harness.packages.requirement_files.entry import Inputs
from harness.packages.requirement_files.inputs import read


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(name: str, text: str) -> Path:
    """Write a file below the working folder and name it as a user would."""
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


class TestRequirementsTxt:
    def test_requirements_are_taken_as_written(self) -> None:
        """Comments, blank lines and continuations are pip's; markers and extras stay."""
        path = put(
            "requirements.txt",
            """
# a comment
gymnasium[mujoco] == 1.2.3   # the newest that works
mujoco \\
    >=3.2,<4 ; \\
    python_version >= "3.9"
numpy
""",
        )

        assert read([path]) == Inputs(
            requirements=("gymnasium[mujoco] == 1.2.3", 'mujoco      >=3.2,<4 ;      python_version >= "3.9"', "numpy")
        )

    def test_options_become_settings(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Index options, find-links, --pre and --only-binary are modelled; ${NAME} is a variable."""
        monkeypatch.setenv("INDEX_TOKEN", "secret")
        path = put(
            "sub/requirements.txt",
            """
-i https://${INDEX_TOKEN}@one.test/simple --extra-index-url=https://two.test/simple
--extra-index-url https://three.test/${UNSET}
-f wheels
--find-links https://four.test/links.html
--pre
--only-binary numpy,mujoco
""",
        )

        assert read([path]) == Inputs(
            index=IndexSettings(
                default="https://secret@one.test/simple",
                extra=("https://two.test/simple", "https://three.test/${UNSET}"),
                find_links=(str(folder / "sub/wheels"), "https://four.test/links.html"),
            ),
            prerelease="allow",
            only_binary=("numpy", "mujoco"),
        )

    def test_dropped_hashes_are_noted(self) -> None:
        """A lock records its own hashes; that the file's are not asked for is a note."""
        path = put(
            "locked.txt",
            "--require-hashes\nnumpy==2.2.6 \\\n  --hash=sha256:0 \\\n  --hash=sha256:1\ngym==0.26.2 --hash=sha256:2",
        )

        assert read([path]) == Inputs(
            requirements=("numpy==2.2.6", "gym==0.26.2"),
            notes=("locked.txt: the hashes of 2 requirements are not asked for; a lock records its own",),
        )

    def test_included_files_are_read_beside_the_file(self) -> None:
        """-r adds requirements, -c adds constraints, each relative to its file; a cycle ends."""
        put("requirements.txt", "-r more/base.txt\n-c limits.txt\ngymnasium")
        put("more/base.txt", "numpy\n-r ../requirements.txt\n--requirement=deep.txt")
        put("more/deep.txt", "mujoco")
        put("limits.txt", "numpy<2\n-r other-limits.txt")
        put("other-limits.txt", "mujoco<3.3\n--pre")

        assert read([Path("requirements.txt")]) == Inputs(
            requirements=("gymnasium", "numpy", "mujoco"),
            constraints=("numpy<2", "mujoco<3.3"),
            prerelease="allow",
        )

    def test_archives_become_direct_references(self, folder: Path) -> None:
        """A wheel or an sdist by address or path is required under the name that its file tells."""
        path = put(
            "requirements.txt",
            """
torch @ https://files.test/torch-2.13.0-py3-none-any.whl
https://files.test/My_Env-1.0.tar.gz ; sys_platform == 'linux'
./dist/pole-1.0-py3-none-any.whl
cart @ file:dist/cart-1.0-py3-none-any.whl
""",
        )

        assert read([path]).requirements == (
            "torch @ https://files.test/torch-2.13.0-py3-none-any.whl",
            "my-env @ https://files.test/My_Env-1.0.tar.gz ; sys_platform == 'linux'",
            f"pole @ {folder.as_uri()}/dist/pole-1.0-py3-none-any.whl",
            f"cart @ {folder.as_uri()}/dist/cart-1.0-py3-none-any.whl",
        )

    @pytest.mark.parametrize(
        ("line", "sentence"),
        [
            ("-e .", "-e .: editable installs are not supported"),
            ("--editable=git+https://x.test/y", "-e git+https://x.test/y: editable installs are not supported"),
            (
                "git+https://x.test/y@main#egg=y",
                "git+https://x.test/y@main#egg=y: "
                "a repository cannot be pinned by hash; build a wheel of it and name that",
            ),
            (
                "y @ git+https://x.test/y",
                "git+https://x.test/y: a repository cannot be pinned by hash; build a wheel of it and name that",
            ),
            ("./pole", "./pole: a folder cannot be pinned by hash; build a wheel of it and name that"),
            (
                "https://x.test/main.zip",
                "https://x.test/main.zip: the address does not say which package it is; write NAME @ ADDRESS",
            ),
            ("--no-binary numpy", "--no-binary numpy: this option is not supported"),
            ("--prefer-binary", "--prefer-binary: this option is not supported"),
            ("--trusted-host x.test", "--trusted-host x.test: this option is not supported"),
            ("-r https://x.test/more.txt", "https://x.test/more.txt: a file on the network is not supported"),
        ],
    )
    def test_lines_that_are_not_modelled_are_named(self, line: str, sentence: str) -> None:
        """No line is dropped: each is named with file, line number and reason."""
        path = put("requirements.txt", f"numpy\n\n{line}\n")

        assert read([path]) == Inputs(requirements=("numpy",), not_modelled=(f"requirements.txt:3: {sentence}",))

    def test_an_option_of_a_requirement_is_named(self) -> None:
        """The requirement counts, its build option does not."""
        path = put("requirements.txt", 'numpy==2.2.6 --config-settings="a=b" --hash=sha256:00')

        found = read([path])

        assert found.requirements == ("numpy==2.2.6",)
        assert found.not_modelled == ('requirements.txt:1: --config-settings="a=b": this option is not supported',)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (
                "numpy\nopencv-python (>=3.)",
                "requirements.txt:2: 'opencv-python (>=3.)' is not a requirement: "
                "Expected matching RIGHT_PARENTHESIS for LEFT_PARENTHESIS, after version specifier",
            ),
            ("-r 'x", "requirements.txt:1: '-r 'x' cannot be read: No closing quotation"),
            ("numpy\n-r gone.txt", "requirements.txt:2: there is no file gone.txt"),
        ],
    )
    def test_bad_lines_are_refused(self, text: str, message: str) -> None:
        """The message names file, line and mistake."""
        with pytest.raises(BadInput) as raised:
            read([put("requirements.txt", text)])

        assert str(raised.value) == message


PYPROJECT = """
[project]
name = "my-project"
requires-python = ">=3.9,<3.13"
dynamic = ["version"]
dependencies = [
    "gymnasium>=1.0",
    "numpy<2; python_version < \\"3.10\\"",
]

[project.optional-dependencies]
mujoco = ["mujoco>=3"]
Render_All = ["imageio"]
all = ["my-project[mujoco,render-all]", "tqdm"]

[dependency-groups]
test = ["pytest", {include-group = "Typing"}]
Typing = ["mypy"]

[tool.uv]
constraint-dependencies = ["numpy<2.3"]
override-dependencies = ["mujoco==3.3.7"]
build-constraint-dependencies = ["setuptools<67"]
prerelease = "allow"
index = [{url = "https://x.test/simple"}, {name = "t", url = "https://t.test/cpu", explicit = true}]

[tool.uv.sources]
gymnasium = {git = "https://x.test/gymnasium"}
"""


class TestPyproject:
    def test_a_project_with_its_extras_and_groups(self) -> None:
        """Dependencies, the extras asked for (through `all` too), the groups with those that they include."""
        path = put("pyproject.toml", PYPROJECT)

        assert read([path], extras=["all"], groups=["TEST"]) == Inputs(
            requirements=(
                "gymnasium>=1.0",
                'numpy<2; python_version < "3.10"',
                "tqdm",
                "mujoco>=3",
                "imageio",
                "pytest",
                "mypy",
            ),
            constraints=("numpy<2.3",),
            overrides=("mujoco==3.3.7",),
            build_constraints=("setuptools<67",),
            prerelease="allow",
            index=IndexSettings(extra=("https://x.test/simple",)),
            python="<3.13,>=3.9",
            not_modelled=(
                "pyproject.toml:28: tool.uv.sources.gymnasium: sources are not supported; "
                "gymnasium is taken from the indexes",
                "pyproject.toml:25: https://t.test/cpu: an explicit index is not supported",
            ),
        )

    def test_without_extras_and_groups_only_the_dependencies(self) -> None:
        """Nothing optional is taken unasked."""
        assert read([put("pyproject.toml", PYPROJECT)]).requirements == (
            "gymnasium>=1.0",
            'numpy<2; python_version < "3.10"',
        )

    def test_requirements_known_only_by_a_build_are_named(self) -> None:
        """Dynamic dependencies and Poetry's own table are not supported."""
        path = put(
            "pyproject.toml",
            '[project]\ndynamic = ["version",\n\n  "dependencies"]\n[tool.poetry.dependencies]\nnumpy = "^2"\n',
        )

        assert read([path]).not_modelled == (
            "pyproject.toml:4: dependencies is dynamic: only a build of the project tells it",
            "pyproject.toml:5: tool.poetry.dependencies: Poetry's own format is not supported; export requirements.txt",
        )

    @pytest.mark.parametrize(
        ("extras", "groups", "message"),
        [
            (["mujco"], [], '--extra mujco: no file that was given has this extra; did you mean "mujoco"?'),
            ([], ["docs"], '--group docs: no file that was given has this group; valid: "test", "typing"'),
        ],
    )
    def test_an_unknown_extra_or_group_is_refused(self, extras: list[str], groups: list[str], message: str) -> None:
        """The message suggests the nearest name, or lists the valid ones."""
        with pytest.raises(BadInput) as raised:
            read([put("pyproject.toml", PYPROJECT)], extras, groups)

        assert str(raised.value) == message

    @pytest.mark.parametrize(
        ("text", "groups", "message"),
        [
            (
                "[project]\ndependencies = [\n'numpy',\n'gym ==']",
                [],
                "pyproject.toml:4: 'gym ==' is not a requirement: "
                "Expected semicolon (after name with no version specifier) or end",
            ),
            (
                "[project]\ndependencies = 'numpy'",
                [],
                "pyproject.toml: project.dependencies: expected a list, got a string",
            ),
            (
                "[project]\nrequires-python = '3.9'",
                [],
                "pyproject.toml: project.requires-python: Invalid specifier: '3.9'",
            ),
            ("[project\n", [], "pyproject.toml: line 1, column 9: expected ']' at the end of a table declaration"),
            (
                "[dependency-groups]\na = [{include-group = 'b'}]\nb = [{include-group = 'a'}]",
                ["a"],
                "pyproject.toml: dependency-groups: Cyclic dependency group include while resolving a: a -> b, b -> a",
            ),
        ],
    )
    def test_bad_projects_are_refused(self, text: str, groups: list[str], message: str) -> None:
        """The message names file, place and mistake."""
        with pytest.raises(BadInput) as raised:
            read([put("pyproject.toml", text)], groups=groups)

        assert str(raised.value) == message


PYLOCK = """
lock-version = "1.0"
created-by = "test"
requires-python = ">=3.10"
extras = ["mujoco"]

[[packages]]
name = "numpy"
version = "2.2.6"
marker = "python_version >= '3.10'"
wheels = [{ url = "https://x.test/numpy-2.2.6-py3-none-any.whl", hashes = { sha256 = "00" } }]

[[packages]]
name = "mujoco"
version = "3.3.7"
marker = "'mujoco' in extras"
wheels = [{ url = "https://x.test/mujoco-3.3.7-py3-none-any.whl", hashes = { sha256 = "00" } }]

[[packages]]
name = "mine"
directory = { path = "." }

[[packages]]
name = "repo"
vcs = { type = "git", url = "https://x.test/repo", commit-id = "abc" }

[[packages]]
name = "cart"
archive = { url = "https://x.test/cart-1.0.tar.gz", hashes = { sha256 = "00" } }
"""


class TestPylock:
    @pytest.mark.parametrize("name", ["pylock.toml", "pylock.lab.toml", "exported.toml"])
    def test_packages_are_pinned(self, name: str) -> None:
        """Versions and markers of the lock; what has no release is named."""
        path = put(name, PYLOCK)

        assert read([path]) == Inputs(
            requirements=('numpy==2.2.6 ; python_version >= "3.10"', "cart @ https://x.test/cart-1.0.tar.gz"),
            python=">=3.10",
            not_modelled=(
                f"{name}:20: .: a folder cannot be pinned by hash; build a wheel of it and name that",
                f"{name}:24: git+https://x.test/repo: "
                "a repository cannot be pinned by hash; build a wheel of it and name that",
            ),
            notes=(f"{name}: packages are pinned to its versions, its files and hashes are not asked for",),
        )

    def test_an_extra_of_the_lock(self) -> None:
        """A marker on extras is judged here, which is said."""
        found = read([put("pylock.toml", PYLOCK)], extras=["mujoco"])

        assert "mujoco==3.3.7" in found.requirements
        assert found.notes[1:] == (
            'pylock.toml:14: mujoco: its marker was judged for this machine\'s Python: "mujoco" in extras',
        )

    def test_a_bad_lock_is_refused(self) -> None:
        """The message names the path of the wrong key."""
        with pytest.raises(BadInput) as raised:
            read([put("pylock.toml", 'lock-version = "1.0"\ncreated-by = "x"\n[[packages]]\nname = 1')])

        assert str(raised.value) == "pylock.toml: Unexpected type int (expected str) in 'packages[0].name'"


UV_LOCK = """\
version = 1
requires-python = ">=3.11"

[[package]]
name = "mujoco"
version = "3.3.7"
source = { registry = "https://x.test/simple" }

[[package]]
name = "me"
source = { editable = "." }

[[package]]
name = "lib"
version = "1.0"
source = { git = "https://x.test/lib" }

[[package]]
name = "numpy"
version = "1.26.4"
source = { registry = "https://x.test/simple" }
resolution-markers = ["python_full_version < '3.12'"]

[[package]]
name = "numpy"
version = "2.2.6"
source = { registry = "https://x.test/simple" }
resolution-markers = ["python_full_version >= '3.12'"]
"""


class TestUvLock:
    def test_releases_are_pinned(self) -> None:
        """The project stays out, what is no release is named with its line; of two versions one is for this Python."""
        found = read([put("uv.lock", UV_LOCK)])

        numpy = "1.26.4" if sys.version_info < (3, 12) else "2.2.6"
        assert (found.requirements, found.python) == (("mujoco==3.3.7", f"numpy=={numpy}"), ">=3.11")
        assert found.not_modelled == ("uv.lock:14: lib: it comes from an address, which no index knows",)
        assert len(found.notes) == 1

    def test_a_damaged_lock_is_refused(self) -> None:
        """The message names the file and the key."""
        with pytest.raises(BadInput) as raised:
            read([put("uv.lock", "version = 1\n[[package]]\nname = 1\n")])

        assert str(raised.value).startswith("uv.lock: ")


class TestEnvironmentYml:
    def test_python_and_the_pip_part(self) -> None:
        """Python and pip's lines are modelled, other conda packages named with file and line."""
        path = put(
            "environment.yml",
            """
name: lab
channels: [conda-forge]
dependencies:
  - python=3.10
  - pip
  - gymnasium=0.29.1
  - conda-forge::numpy >=1.26
  - pip:
    - mujoco==3.3.7   # newest
    - --extra-index-url https://x.test/simple
    - -r requirements.txt
    - -e .
variables:
  MUJOCO_GL: egl
""",
        )
        put("requirements.txt", "dm-control")

        assert read([path]) == Inputs(
            requirements=("mujoco==3.3.7", "dm-control"),
            conda=("gymnasium==0.29.1", "numpy>=1.26"),
            index=IndexSettings(extra=("https://x.test/simple",)),
            python="==3.10.*",
            not_modelled=(
                "environment.yml:15: variables are not supported; give them with --set",
                "environment.yml:7: gymnasium=0.29.1: conda packages are not supported",
                "environment.yml:8: conda-forge::numpy >=1.26: conda packages are not supported",
                "environment.yml:13: -e .: editable installs are not supported",
            ),
        )

    @pytest.mark.parametrize(
        ("spec", "python"),
        [
            ("python=3.10", "==3.10.*"),
            ("python 3.10", "==3.10.*"),
            ("python=3.10.*", "==3.10.*"),
            ("python==3.10.4", "==3.10.4"),
            ("python=3.10.4=h12debd9_0", "==3.10.4.*"),
            ("conda-forge::python>=3.9,<3.12", "<3.12,>=3.9"),
            ("python", None),
        ],
    )
    def test_pythons_of_conda(self, spec: str, python: str | None) -> None:
        """One equals sign means a prefix, two mean exactly this."""
        found = read([put("environment.yaml", f"dependencies:\n- {spec}\n")])

        assert (found.python, found.not_modelled) == (python, ())

    def test_another_way_of_naming_a_python_is_named(self) -> None:
        """Alternatives are beyond a specifier."""
        assert read([put("environment.yml", "dependencies:\n- python=3.9|3.10\n")]).not_modelled == (
            "environment.yml:2: python=3.9|3.10: this way of naming a Python is not supported; give --python",
        )

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("dependencies: [a", "env.yml:1: expected ',' or ']', but got '<stream end>'"),
            ("name: x", "env.yml: there is no list of dependencies; is it a conda environment file?"),
            ("dependencies:\n- pip:\n  - 'gym =='", "env.yml:3: 'gym ==' is not a requirement: {}"),
        ],
    )
    def test_bad_environments_are_refused(self, text: str, message: str) -> None:
        """The message names file, line and mistake."""
        with pytest.raises(BadInput) as raised:
            read([put("env.yml", text)])

        assert str(raised.value) == message.format("Expected semicolon (after name with no version specifier) or end")


class TestFiles:
    def test_several_files_are_one_question(self) -> None:
        """Requirements add up, Pythons must fit all, a later default index wins."""
        first = put("a.txt", "numpy\n--index-url https://a.test")
        second = put("b.txt", "mujoco\n--index-url https://b.test")
        project = put("pyproject.toml", '[project]\nrequires-python = ">=3.9"')
        conda = put("environment.yml", "dependencies: [python=3.10]")

        assert read([first, second, project, conda]) == Inputs(
            requirements=("numpy", "mujoco"), index=IndexSettings(default="https://b.test"), python="==3.10.*,>=3.9"
        )

    @pytest.mark.parametrize(
        ("name", "content", "message"),
        [
            ("gone.txt", None, "gone.txt: cannot be read: No such file or directory"),
            (
                "setup.py",
                b"",
                "setup.py: unknown format; "
                "give requirements.txt, pyproject.toml, uv.lock, pylock.toml or environment.yml",
            ),
            ("requirements.txt", b"\xff\xfe", "requirements.txt: is not UTF-8 text"),
        ],
    )
    def test_files_that_cannot_be_read_are_refused(self, name: str, content: bytes | None, message: str) -> None:
        """The message is one sentence that names the file."""
        if content is not None:
            Path(name).write_bytes(content)
        with pytest.raises(BadInput) as raised:
            read([Path(name)])

        assert str(raised.value) == message
