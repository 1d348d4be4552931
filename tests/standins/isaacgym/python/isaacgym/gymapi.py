"""The API as the stubs document it, made from them when it is imported."""

import sys
from pathlib import Path

from .documented import NotPlayed, Refused, Stubs, played, structure
from .plays import PLAYS

if "torch" in sys.modules:  # as isaacgym/gymdeps.py does: https://github.com/PKU-MARL/DexterousHands/issues/1
    told = "PyTorch was imported before isaacgym modules.  Please import torch after isaacgym modules."
    raise ImportError(told)

STUBS = Stubs(Path(__file__).with_name("gymapi.pyi"))
NUMBERS = {"INVALID_HANDLE": -1, "STATE_NONE": 0, "STATE_POS": 1, "STATE_VEL": 2, "STATE_ALL": 3}
STRUCTURES = {}
NAMES = {}


def get_version():
    """Preview 4 calls itself 1.0."""
    version = STRUCTURES["Version"]()
    version.major, version.minor = 1, 0
    return version


for name, documented in STUBS.classes.items():
    if documented.members:
        NAMES.update({member: number for number, member in enumerate(documented.members)})
        NAMES[name] = type(name, (), {member: NAMES[member] for member in documented.members})
    elif name == "Gym":
        NAMES[name] = played(documented, dict(PLAYS, get_version=get_version))
    else:
        NAMES[name] = STRUCTURES[name] = structure(documented, STRUCTURES)
NAMES.update({name: number for name, number in NUMBERS.items() if name in STUBS.constants}, acquire_gym=NAMES["Gym"])


def __getattr__(name):
    if name in NAMES:
        return NAMES[name]
    if name in STUBS.functions or name in STUBS.constants:
        raise NotPlayed(__name__, name)
    raise Refused(__name__, name)
