"""Write a script of a few lines that reproduces a failure, for people with plain Python and no harness.

It covers only APIs whose calls are the same for everybody. An environment that a matrix brings itself has no script.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from packaging.version import Version

from harness.model import Case, Phase

STEPS = 100
FIRST, MODERN = Version("0.25"), Version("0.26")
"""Releases of gym: render_mode came with the first, five values and reset(seed=) with the second."""


def script(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> str | None:
    """Return the script, or None if there is none that everybody could run."""
    imports = [f"import {name}" for name in case.imports]
    if phase is Phase.IMPORT:
        api_imports = [f"import {name}" for name in IMPORTED.get(case.api, (case.api,))]
        own = [f"import {prefix}" for prefix in [_module(case)] if prefix]
        return _joined(list(dict.fromkeys([*imports, *api_imports, *own])))
    make = WAYS.get(case.api)
    lines = make(case, phase, check, installed) if make and case.env else None
    return _joined([*imports, *lines]) if lines else None


def _joined(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


def _named(case: Case) -> str:
    """Return the id of the environment as the library expects it."""
    return (case.env or "").removeprefix(f"{case.api}:")


def _module(case: Case) -> str:
    """Return the module that an id such as `module:Name-v0` imports; empty for other ids."""
    return _named(case).rpartition(":")[0] if case.api in {"gym", "gymnasium"} else ""


def _arguments(kwargs: Mapping[str, Any], **more: str) -> str:
    given = [f"{name}={value!r}" for name, value in kwargs.items()]
    return "".join(f", {text}" for text in [*given, *(f"{name}={text}" for name, text in more.items())])


# --- gym and gymnasium -----------------------------------------------------------------------------------------


def _gymnasium(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    modern = case.api == "gymnasium" or _version(installed) >= MODERN
    draws = phase is Phase.RENDER
    if phase is Phase.VECTOR:
        return _vector(case, check, modern=modern)
    if check.startswith(REPEAT):
        return _repeat(case, same=check in {f"{REPEAT}.same", f"{REPEAT}.first"}) if modern else None
    if phase is Phase.INTEROP:
        learn = LEARNING.get(check)
        return learn(case) if learn else None
    if phase not in {Phase.SINGLE, Phase.RENDER}:
        return None
    mode = {"render_mode": '"rgb_array"'} if draws and (modern or _version(installed) >= FIRST) else {}
    lines = [f"import {case.api}", "", f'env = {case.api}.make("{_named(case)}"{_arguments(case.kwargs, **mode)})']
    lines += [f"env.reset(seed={case.seed})"] if modern else [f"env.seed({case.seed})", "env.reset()"]
    lines += [f"env.action_space.seed({case.seed})", f"for _ in range({10 if draws else case.steps or STEPS}):"]
    values = "observation, reward, terminated, truncated, info" if modern else "observation, reward, done, info"
    lines += [f"    {values} = env.step(env.action_space.sample())"]
    lines += [f"    if {'terminated or truncated' if modern else 'done'}:", "        env.reset()"]
    if draws:
        call = "render()" if mode else 'render(mode="rgb_array")'
        lines += [f"print(env.{call})"]
    return [*lines, "env.close()"]


REPEAT = "single.repeat"


def _repeat(case: Case, *, same: bool) -> list[str]:
    """Return lines that play one episode twice from one seed, in the same environment or in two."""
    make = f'{case.api}.make("{_named(case)}"{_arguments(case.kwargs)})'
    return [
        f"import {case.api}",
        "import numpy",
        "",
        "",
        "def play(env):",
        f"    observations = [env.reset(seed={case.seed})[0]]",
        f"    env.action_space.seed({case.seed})",
        f"    for _ in range({case.steps or STEPS}):",
        "        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())",
        "        observations.append(observation)",
        "        if terminated or truncated:",
        "            break",
        "    return observations",
        "",
        "",
        f"first = {make}",
        f"second = {'first' if same else make}",
        "one, other = play(first), play(second)",
        "print([numpy.array_equal(a, b) for a, b in zip(one, other)])",
    ]


def _sb3(case: Case) -> list[str]:
    return [
        f"import {case.api}",
        "from stable_baselines3 import PPO",
        "",
        f'env = {case.api}.make("{_named(case)}"{_arguments(case.kwargs)})',
        'policy = "MultiInputPolicy" if hasattr(env.observation_space, "spaces") else "MlpPolicy"',
        f'model = PPO(policy, env, device="cpu", seed={case.seed}, n_steps=32, batch_size=32, n_epochs=1)',
        "model.learn(total_timesteps=64)",
    ]


def _minari(case: Case) -> list[str]:
    return [
        f"import {case.api}",
        "import minari",
        "",
        "# MINARI_DATASETS_PATH names a folder to write to.",
        f'env = minari.DataCollector({case.api}.make("{_named(case)}"{_arguments(case.kwargs)}))',
        f"env.reset(seed={case.seed})",
        "for _ in range(20):",
        "    env.step(env.action_space.sample())",
        'env.create_dataset("repro/recorded-v0", algorithm_name="random", code_permalink="none", author="none",'
        ' author_email="none")',
        'print(minari.load_dataset("repro/recorded-v0").total_steps)',
    ]


LEARNING = {"interop.sb3.learn": _sb3, "interop.minari.dataset": _minari}
"""Scripts that train or record, by the name of the check."""


def _vector(case: Case, check: str, *, modern: bool) -> list[str]:
    make_line = f'env = {case.api}.make("{_named(case)}"{_arguments(case.kwargs)})'
    lines = _vector_of(case.api, check, case.seed, [], make_line)
    return lines if modern else [line.replace(f"reset(seed={case.seed})", "reset()") for line in lines]


def _vector_of(library: str, check: str, seed: int, imports: list[str], make_line: str) -> list[str]:
    """Return lines that run two environments as one, in this process or in workers."""
    kind = "SyncVectorEnv" if check == "vector.sync" else "AsyncVectorEnv"
    method = check.rpartition(".")[2]
    way = ", shared_memory=False" if method == "unshared" else f', context="{method}"' if method in METHODS else ""
    # `imports` are given for robosuite alone, whose environments need its wrapper. The script's last guard is for
    # workers that are spawned: they import the script again.
    return [
        f"import {library}",
        *imports,
        f"from {library}.vector import {kind}",
        "",
        "",
        "def make():",
        f"    {make_line}",
        f"    return {'GymWrapper(env)' if imports else 'env'}",
        "",
        "",
        'if __name__ == "__main__":',
        f"    envs = {kind}([make] * 2{way})",
        f"    envs.reset(seed={seed})",
        "    for _ in range(10):",
        "        envs.step(envs.action_space.sample())",
        "    envs.close()",
    ]


ROBOSUITE = ["import robosuite", "from robosuite.wrappers import GymWrapper"]
METHODS = frozenset({"fork", "spawn", "forkserver"})


def _version(installed: Mapping[str, str]) -> Version:
    return Version(installed.get("gym", "0"))


# --- others ----------------------------------------------------------------------------------------------------


def _dm_control(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    domain, _, task = _named(case).partition("/")
    # A colon that is left belongs to an environment that the matrix brings itself.
    if phase not in {Phase.SINGLE, Phase.RENDER} or not task or ":" in domain:
        return None
    lines = [
        "import numpy",
        "from dm_control import suite",
        "",
        f'env = suite.load("{domain}", "{task}"{_arguments(case.kwargs)})',
        "env.reset()",
        "spec = env.action_spec()",
        f"for _ in range({10 if phase is Phase.RENDER else case.steps}):",
        "    env.step(numpy.random.uniform(spec.minimum, spec.maximum, spec.shape))",
    ]
    return [*lines, "print(env.physics.render())"] if phase is Phase.RENDER else lines


def _robosuite(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    task = _named(case)
    if not task.isidentifier() or phase not in {Phase.SINGLE, Phase.RENDER, Phase.VECTOR}:
        return None
    draws = phase is Phase.RENDER
    options = {"robots": '"Panda"', "has_renderer": "False"} | {
        name: str(draws) for name in ("has_offscreen_renderer", "use_camera_obs")
    }
    given = {name: text for name, text in options.items() if name not in case.kwargs}
    lines = [
        "import numpy",
        "import robosuite",
        "",
        f'env = robosuite.make("{task}"{_arguments(case.kwargs, **given)})',
    ]
    if phase is Phase.VECTOR:
        return _vector_of("gymnasium" if "gymnasium" in installed else "gym", check, case.seed, ROBOSUITE, lines[-1])
    lines += ["env.reset()", f"for _ in range({10 if draws else case.steps}):"]
    return [*lines, "    observation, reward, done, info = env.step(numpy.zeros(env.action_dim))"]


def _mujoco(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    file = _named(case)
    if not file.endswith(".xml") or phase not in {Phase.SINGLE, Phase.RENDER}:
        return None
    lines = [
        "import mujoco",
        "",
        f'model = mujoco.MjModel.from_xml_path("{file}")',
        "data = mujoco.MjData(model)",
        f"for _ in range({10 if phase is Phase.RENDER else case.steps}):",
        "    mujoco.mj_step(model, data)",
    ]
    drawn = ["renderer = mujoco.Renderer(model)", "renderer.update_scene(data)", "print(renderer.render())"]
    return [*lines, *drawn] if phase is Phase.RENDER else lines


def _pybullet(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    file = _named(case)
    load = {"urdf": "loadURDF", "sdf": "loadSDF", "xml": "loadMJCF"}.get(file.rpartition(".")[2])
    if load is None or phase not in {Phase.SINGLE, Phase.RENDER}:
        return None
    lines = [
        "import pybullet",
        "import pybullet_data",
        "",
        "pybullet.connect(pybullet.DIRECT)",
        "pybullet.setAdditionalSearchPath(pybullet_data.getDataPath())",
        "pybullet.setGravity(0, 0, -9.81)",
        f'pybullet.{load}("{file}")',
        f"for _ in range({10 if phase is Phase.RENDER else case.steps}):",
        "    pybullet.stepSimulation()",
    ]
    return [*lines, "print(pybullet.getCameraImage(320, 240)[2])"] if phase is Phase.RENDER else lines


def _brax(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    if phase not in {Phase.SINGLE, Phase.RENDER, Phase.VECTOR}:
        return None
    name, batch = _named(case), phase is Phase.VECTOR
    call = f'create("{name}", batch_size=2' if batch else f'get_environment("{name}"'
    lines = [
        "import jax",
        "from brax import envs",
        "",
        f"env = envs.{call}{_arguments(case.kwargs)})",
        f"state = jax.jit(env.reset)(jax.random.PRNGKey({case.seed}))",
        "step = jax.jit(env.step)",
        f"for _ in range({case.steps if phase is Phase.SINGLE else 10}):",
        f"    state = step(state, jax.numpy.zeros({'(2, env.action_size)' if batch else 'env.action_size'}))",
    ]
    drawn = ["from brax.io import image", "", "print(image.render_array(env.sys, state.pipeline_state, 240, 320))"]
    return [*lines, *drawn] if phase is Phase.RENDER else lines


def _envpool(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    if phase not in {Phase.SINGLE, Phase.VECTOR}:
        return None
    kwargs = {"env_type": "gymnasium", **case.kwargs}
    count = 1 if phase is Phase.SINGLE else 2
    return [
        "import envpool",
        "import numpy",
        "",
        f'envs = envpool.make("{_named(case)}", num_envs={count}, seed={case.seed}{_arguments(kwargs)})',
        "print(envs.reset())",
        f"for _ in range({case.steps if phase is Phase.SINGLE else 10}):",
        f"    observation, *_ = envs.step(numpy.array([envs.action_space.sample() for _ in range({count})]))",
        "print(observation, observation.strides)",
        "envs.close()",
    ]


def _pettingzoo(case: Case, phase: Phase, check: str, installed: Mapping[str, str]) -> list[str] | None:
    module, _, name = _named(case).removeprefix("aec:").rpartition("/")
    if phase not in {Phase.SINGLE, Phase.RENDER} or not module or not name.isidentifier():
        return None
    mode = {"render_mode": '"rgb_array"'} if phase is Phase.RENDER else {}
    arguments = _arguments(case.kwargs, **mode).removeprefix(", ")
    drawn = ["print(env.render())"] if phase is Phase.RENDER else []
    return [
        f"from pettingzoo.{module.replace('/', '.')} import {name}",
        "",
        f"env = {name}.env({arguments})",
        f"env.reset(seed={case.seed})",
        f"for agent in env.agent_iter({10 if drawn else case.steps or STEPS}):",
        "    observation, reward, terminated, truncated, info = env.last()",
        "    mask = observation.get('action_mask') if isinstance(observation, dict) else None",
        "    env.step(None if terminated or truncated else env.action_space(agent).sample(mask))",
        *drawn,
        "env.close()",
    ]


WAYS = {
    "envpool": _envpool,
    "pettingzoo": _pettingzoo,
    "gymnasium": _gymnasium,
    "gym": _gymnasium,
    "dm_control": _dm_control,
    "robosuite": _robosuite,
    "mujoco": _mujoco,
    "pybullet": _pybullet,
    "brax": _brax,
}
IMPORTED = {"dm_control": ("dm_control.suite",), "robosuite": ("robosuite",), "pybullet": ("pybullet",)}
