"""Finds environments of packages: what is registered, and the modules that register some or make some.

Modules are chosen by their text, before any of them is imported.
"""

import re
import sys

from .cell_sources import sources, text_of

MOST_MODULES = 150
REGISTERS = re.compile(r"\bregister\w*\s*\(")
LOOP = re.compile(r"\b(?:parallel_env|raw_env)\b")
VERSIONED = re.compile(r"_v\d+$")
REGISTRIES = ("gymnasium", "gym")
MAKERS = ("parallel_env", "env")
"""Names of functions that make an environment in a module of PettingZoo's kind; the second makes turn-based ones."""


def suited(tops):
    """Return the submodules of packages that seem to register environments, or to be one of PettingZoo's kind."""
    found = []
    for top in tops:
        for module, path in sources(top):
            text = text_of(path)
            registers = REGISTERS.search(text) and re.search(r"\bgym(?:nasium)?\b", text)
            if registers or (LOOP.search(text) and "pettingzoo" in text + top):
                found.append((not registers, not VERSIONED.search(module), module.count("."), module))
    return [each[-1] for each in sorted(found)[:MOST_MODULES]]


def registered(tops):
    """Return the environments of these packages that gymnasium and gym register, and those that robosuite lists."""
    found = []
    for api in REGISTRIES:
        registry = getattr(sys.modules.get(api + ".envs.registration"), "registry", {})
        for name, spec in list(getattr(registry, "env_specs", registry).items()):
            entry = getattr(spec, "entry_point", None)
            text = entry if isinstance(entry, str) else ""
            owner = text or str(getattr(entry, "__module__", ""))
            if owner.partition(":")[0].partition(".")[0] in tops:
                found.append({"env": str(name), "api": api, "entry": text})
    if "robosuite" in tops:
        for name in sorted(getattr(sys.modules.get("robosuite"), "ALL_ENVIRONMENTS", ())):
            found.append({"env": "robosuite:" + str(name), "api": "robosuite", "entry": ""})
    return found


def loops(tops, module):
    """Return the environments of PettingZoo's kind that an imported module makes."""
    there = sys.modules.get(module)
    makers = [name for name in MAKERS if callable(getattr(there, name, None))]
    if not makers or "pettingzoo" not in sys.modules:
        return []
    top, _, rest = module.partition(".")
    if top == "pettingzoo":
        turns = "" if makers[0] == MAKERS[0] else "aec:"
        return [{"env": "pettingzoo:" + turns + rest.replace(".", "/"), "api": "pettingzoo", "entry": ""}]
    return [{"env": "pettingzoo:{}:{}".format(module, makers[0]), "api": "pettingzoo", "entry": ""}]
