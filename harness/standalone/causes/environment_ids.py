"""Explain environment ids that nobody registered: which package registers them, and Atari games without their ROMs."""

from __future__ import annotations

import re
from typing import Tuple

from ..explain.api_history import Availability
from .scene import QUOTE, Cause, Causes, Pattern, Scene

UNKNOWN_ID = Pattern(
    "(?:Environment|\\bEnv(?= )|No registered env with id:?|No registered environment with (?:name|id):?"
    "|Unknown environment:?|Namespace\\b|not find (?:the )?environment:?) ?{0}?([\\w:./-]+?){0}?"
    "(?: doesn't exist| not found|[.,!`'\"\\s]|$)"
    .format(QUOTE),
    "nvironment", "registered env", "Namespace", "Env ", "not find",
)  # fmt: skip
IS_ERROR = re.compile(
    r"Error|DeprecatedEnv|Exception|NotFound|No registered|doesn't exist|Namespace \S+ not found|not find"
)
NAMESPACE = Pattern(
    r"in namespace (\w+)|Namespace {0}?(\w+){0}? (?:not found|does ?n.t exist)".format(QUOTE), "amespace "
)
ROMS = Pattern(
    r"ROM is missing for (\w+)|[Uu]nable to find (?:the )?game \W?(\w+)|ROM file for .* not found|Please install roms"
    r"|rom file .* (?:missing|not found)|We're Unable to find the game",
    "ROM", "rom", "find game", "find the game",
)  # fmt: skip
RETRO = Pattern(r"Game not found: \S+\. Did you make sure to import the ROM", "Game not found")
SUGGESTED = Pattern(r"Did you mean: [`'\"]?([\w:./-]+)", "Did you mean")
VALID = Pattern(r"valid versions include \[([^\]]*)\]", "valid versions include")
OWNERS: Tuple[Tuple[str, str, str], ...] = (
    (r"ALE/|\w+(?:NoFrameskip|Deterministic)|(?:Pong|Breakout|SpaceInvaders|Seaquest|MsPacman|Qbert|BeamRider|Enduro|Boxing|Freeway|Assault|Asterix|Alien)"
     r"(?:NoFrameskip|Deterministic|-ram|-v\d|$)", "ale-py", "ale_py"),
    (r"myo\w+|motor\w+Custom", "myosuite", "myosuite"),
    (r"Fetch(?:Reach|Push|Slide|PickAndPlace)|HandManipulate|HandReach|AdroitHand|FrankaKitchen|PointMaze_|AntMaze_",
     "gymnasium-robotics", "gymnasium_robotics"),
    (r"Panda(?:Reach|Push|Slide|PickAndPlace|Stack|Flip)", "panda-gym", "panda_gym"),
    (r"(?:highway|merge|roundabout|parking|intersection|racetrack|exit|lane-keeping|two-way)(?:-fast|-parked|-v\d|$)",
     "highway-env", "highway_env"),
    (r"(?:MiniGrid|BabyAI)-", "minigrid", "minigrid"),
    (r"MiniWorld-", "miniworld", "miniworld"),
    (r"procgen", "procgen", "procgen"),
    (r"(?:PushCube|PickCube|StackCube|PegInsertionSide|PlugCharger|TurnFaucet|OpenCabinet\w+|PushT|LiftPegUpright)-v\d",
     "mani-skill", "mani_skill.envs"),
    (r"(?:halfcheetah|hopper|walker2d|ant)-(?:random|medium|expert|medium-replay|full-replay|medium-expert|mixed)(?:-v\d)?$"
     r"|antmaze-(?:eval-)?(?:umaze|medium|large)\b|maze2d-(?:eval-)?(?:open|umaze|medium|large)\b"
     r"|kitchen-(?:complete|partial|mixed)\b|(?:pen|door|hammer|relocate)-(?:human|cloned|expert)\b", "d4rl", "d4rl"),
    (r"Meta-World/", "metaworld", "metaworld"),
    (r"\w+BulletEnv", "pybullet", "pybullet_envs"),
    (r"Safety(?:Point|Car|Doggo|Racecar|Ant|Hopper|Walker2d|HalfCheetah|Humanoid)", "safety-gymnasium",
     "safety_gymnasium"),
    (r"Isaac-", "isaaclab", "isaaclab_tasks"),
    (r"dm_control/|GymV2\w+/", "shimmy", "shimmy"),
    (r"SuperMarioBros", "gym-super-mario-bros", "gym_super_mario_bros"),
    (r"gym_aloha/|Aloha", "gym-aloha", "gym_aloha"),
    (r"gym_pusht/|PushT", "gym-pusht", "gym_pusht"),
    (r"gym_xarm/|Xarm", "gym-xarm", "gym_xarm"),
    (r"flappy_bird|FlappyBird", "flappy-bird-gymnasium", "flappy_bird_gymnasium"),
    (r"vizdoom|Vizdoom", "vizdoom", "vizdoom.gymnasium_wrapper"),
)  # fmt: skip
"""Ids as a pattern, the package that registers them, and the module that does so when it is imported."""

OF_OLD_GYM = Pattern(r"No registered env with id|UnregisteredEnv", "No registered env", "UnregisteredEnv")
"""The words of gym before 0.22: a package that registers with gymnasium has no part in it."""

OF_GYMNASIUM = frozenset(
    "flappy-bird-gymnasium gym-aloha gym-pusht gym-xarm gymnasium-robotics isaaclab mani-skill safety-gymnasium"
    " shimmy vizdoom".split()
)
"""Packages all of whose releases register their environments with gymnasium."""

D4RL_LIKE = re.compile(
    r"(?:halfcheetah|hopper|walker2d)-(?!(?:random|medium|expert|medium-replay|full-replay|medium-expert|mixed)(?:-v\d)?$)"
    r"[a-z]+-[a-z-]+"
)
"""Ids that look like those of d4rl, which has none of these."""

MYOSUITE = "2.4"
"""The first release of myosuite that requires gymnasium; those before it require gym."""


def released(line: str, scene: Scene) -> Causes:
    """Yield the release that has the environment id of a line, where the releases of gym or gymnasium differ in it."""
    name, _ = _named(line)
    answers = list(_of_histories(name, scene)) if name else []
    yield from answers if len(answers) == 1 else ()


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where the package of an environment id did not register it, or a game has no ROM."""
    if RETRO.search(line):
        text = "the games of gym-retro come without their ROMs, and this one was not imported"
        yield Cause("atari-roms", text, {"text": "Type `python -m retro.import FOLDER` with the folder of your ROMs."})
        return
    if ROMS.search(line):
        yield _roms(scene)
        return
    name, space = _named(line)
    module, _, bare = name.rpartition(":")
    if D4RL_LIKE.match(bare):
        text = "d4rl registers no `{}`: its ids are such as `walker2d-medium-expert-v2`".format(bare)
        yield Cause("environment-id", text, {"text": "Correct the id."})
        return
    near, valid = SUGGESTED.search(line), VALID.search(line)
    if valid and name:
        yield from _older(bare, valid.group(1))
        return
    if near and near.group(1).startswith("bullet-"):
        text = "d4rl was imported, and its MuJoCo environments were not: what they need (mujoco-py, mjrl) is missing"
        way = "`import d4rl` prints what it lacks, unless D4RL_SUPPRESS_IMPORT_ERROR is set. Or take minari's datasets."
        yield Cause("d4rl", text, {"text": way})
        return
    is_old = OF_OLD_GYM.search(scene.failure.text) is not None
    for pattern, package, importing in OWNERS if name else ():
        if is_old and package in OF_GYMNASIUM:
            continue
        if re.match(pattern, bare) or (space and re.match(pattern, space + "/")):
            there = near is not None and re.match(pattern, near.group(1)) is not None
            yield (
                _misspelt(bare, str(near.group(1)), package)
                if near is not None and there
                else _unregistered(bare, package, module or importing, scene)
            )
            return


def _misspelt(name: str, near: str, package: str) -> Cause:
    """Return the cause that a package is there, and registers other ids than this."""
    text = "{} is loaded and registers no `{}`; `{}` is the nearest id that it has".format(package, name, near)
    way = "Use a registered id: `print(gymnasium.registry.keys())` lists them."
    if name.startswith("ALE/") and re.search(r"NoFrameskip|Deterministic|-ram", name):
        way = "Ids that end in NoFrameskip-v4 have no namespace: leave `ALE/` out. Those with it end in -v5."
    return Cause("environment-id", text, {"text": way})


def _older(name: str, valid: str) -> Causes:
    """Yield the cause that only other versions of an environment are registered."""
    wanted = re.search(r"-v(\d+)$", name)
    versions = [int(each) for each in re.findall(r"-v(\d+)", valid)]
    if not wanted or not versions:
        return
    if name.startswith("ALE/"):
        text = "the namespace ALE came with gym 0.20 and ale-py 0.7; the installed gym is older"
        yield Cause("gym", text, {"requirements": ["gym>=0.20"], "text": "Or use an id without `ALE/`."})
    elif int(wanted.group(1)) > max(versions):
        text = "the installed release registers older versions of `{}` only: {}".format(name, valid)
        yield Cause("environment-id", text, {"text": "Upgrade the package that registers it, or use one of these ids."})


def _named(line: str) -> Tuple[str, str]:
    """Return the environment id that a line says is unknown, and its namespace; both are empty without one."""
    match, namespace = UNKNOWN_ID.search(line), NAMESPACE.search(line)
    if (match is None and namespace is None) or not IS_ERROR.search(line):
        return "", ""
    space = next(filter(None, namespace.groups())) if namespace else ""
    name = match.group(1).rstrip(".`'\"") if match else space
    return "{}/{}".format(space, name) if space and "/" not in name and name != space else name, space


def _of_histories(name: str, scene: Scene) -> Causes:
    libraries = ("gymnasium", "gym") if "gymnasium" in scene.failure.text else ("gym", "gymnasium")
    bare = name.rpartition(":")[2]
    for library in libraries:
        history = scene.history(library) if re.search(r"-v\d+$", bare) else None
        spans = history.spans("environments", bare) if history else None
        there = history.where(spans, scene.versions.get(library), history.ran) if history and spans else None
        if history is not None and there is not None and library not in scene.versions and history.is_brief(there):
            return
        if there is not None and there.too_new and re.match(OWNERS[0][0], bare):
            text = _words(bare, there) + "; ale-py registers it since"
            way = "Or `{}`, with what its Atari environments need.".format(there.bound)
            yield Cause("ale-py", text, {"requirements": ["gym[atari,accept-rom-license]"], "text": way})
            return
        if there is not None:
            yield Cause(library, _words(bare, there), {"requirements": [there.bound]})
            return


def _words(name: str, there: Availability) -> str:
    if there.after is None:
        return "{} has the environment `{}` only since {}, and the installed release is older".format(
            there.package, name, there.first
        )
    if there.first is None or there.too_new:
        return "{} lacks the environment `{}` since {}, and the installed release is newer".format(
            there.package, name, there.after
        )
    return "{} has the environment `{}` from {} to {}".format(there.package, name, there.first, there.last)


def _unregistered(name: str, package: str, module: str, scene: Scene) -> Cause:
    """Return the cause that the package of an id was not imported, or is not installed."""
    if package == "ale-py":
        return _atari(name, scene)
    if package == "myosuite" and re.search(r"\bgym\.error", scene.failure.text):
        return Cause(
            package,
            "myosuite since {} registers its environments with gymnasium, but the program uses gym".format(MYOSUITE),
            {"requirements": ["myosuite<{}".format(MYOSUITE)], "text": "Or move the program to gymnasium."},
        )
    text = "the environment `{}` is registered by the package {} when `{}` is imported, and it was not".format(
        name, package, module
    )
    if package == "d4rl":
        text += ", or its import failed in part"
        way = "Then `import d4rl` before make: it prints which of its parts failed, and these register nothing."
        return Cause(package, text, {"requirements": [package], "text": way})
    return Cause(package, text, {"requirements": [package], "text": "Then `import {}` before make.".format(module)})


def _atari(name: str, scene: Scene) -> Cause:
    if "gymnasium" in scene.failure.text or (scene.installed and "gymnasium" in scene.installed):
        return Cause(
            "ale-py",
            "the Atari environments are registered by ale-py, which gymnasium 1.0 and newer does not load by itself",
            {
                "requirements": ["gymnasium[atari]"],
                "text": "Then `import ale_py; gymnasium.register_envs(ale_py)` before make.",
            },
        )
    return Cause(
        "ale-py",
        "the Atari environments are registered by ale-py, which is not installed, or has no ROMs",
        {"requirements": ["gym[atari,accept-rom-license]"], "text": "With gymnasium: `gymnasium[atari]`."},
    )


def _roms(scene: Scene) -> Cause:
    if scene.speaks_of("atari-py", "atari_py") or "ROM is missing for" in scene.failure.text:
        return Cause(
            "atari-roms",
            "atari-py no longer includes ROMs, and does not find the ROM of this game",
            {
                "text": "Type `pip install autorom[accept-rom-license]; AutoROM`, then"
                " `python -m atari_py.import_roms FOLDER`."
            },
        )
    return Cause(
        "atari-roms",
        "the ROMs of the Atari games are not installed; ale-py before 0.9 does not include them",
        {
            "requirements": ["ale-py>=0.9"],
            "text": "With gym before 0.26: `pip install 'gym[atari,accept-rom-license]'` installs the ROMs.",
        },
    )
