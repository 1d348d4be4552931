"""List the environments that importing packages and their submodules makes available. `init` alone asks for it.

The case imports the packages; `kwargs` has `skip`, submodules that are not imported. Modules are chosen by their text,
before any of them is imported. The file `importing` in the reply's folder names the module whose import has begun: a
module may end the process.
"""

import importlib
import os
import re
import sys

from .cell_module_search import module_texts, registered

MOST_MODULES = 150
REGISTERS = re.compile(r"\bregister\w*\s*\(")
GYM = re.compile(r"\bgym(?:nasium)?\b")
AGENTS = re.compile(r"\b(?:parallel_env|raw_env)\b")
VERSIONED = re.compile(r"_v\d+$")
MAKERS = ("parallel_env", "env")
"""Names of functions that make an environment in a module of PettingZoo's kind; the second makes turn-based ones."""


def run(probe, facts):
    """List `environments`, each with API, importable module and entry point, and `failed` imports with the reason."""
    packages = [name.partition(".")[0] for name in probe.case["imports"]]
    failed = dict.fromkeys(probe.case["kwargs"]["skip"], "importing it ends the process")
    environments = {}
    facts["failed"] = failed
    for module in ["", *_candidates(packages)]:
        if not module or _import(probe, module, failed):
            for entry in _registered(packages) + _with_agents(module):
                environments.setdefault(entry["env"], dict(entry, module=module))
    facts["environments"] = list(environments.values())
    for environment in facts["environments"]:
        module = environment["entry"].partition(":")[0]
        environment["lacking"] = "" if not module or _import(probe, module, failed) else failed[module]


def _candidates(packages):
    """Return the submodules of packages that seem to register environments, or to be one of PettingZoo's kind."""
    candidates = []
    for package in packages:
        for module, text in module_texts(package):
            registers = REGISTERS.search(text) and GYM.search(text)
            if registers or (AGENTS.search(text) and "pettingzoo" in text + package):
                candidates.append((not registers, not VERSIONED.search(module), module.count("."), module))
    return [candidate[-1] for candidate in sorted(candidates)[:MOST_MODULES]]


def _registered(packages):
    """Return the environments of these packages that gymnasium and gym register, and those that robosuite lists."""
    environments = [{"env": name, "api": api, "entry": entry} for api, name, entry in registered(packages)]
    names = getattr(sys.modules.get("robosuite"), "ALL_ENVIRONMENTS", ()) if "robosuite" in packages else ()
    return environments + [{"env": "robosuite:" + str(name), "api": "robosuite", "entry": ""} for name in sorted(names)]


def _with_agents(module):
    """Return the environment of PettingZoo's kind that an imported module makes, in a list; an empty one for none."""
    makers = [name for name in MAKERS if callable(getattr(sys.modules.get(module), name, None))]
    if not makers or "pettingzoo" not in sys.modules:
        return []
    package, _, rest = module.partition(".")
    name = "{}:{}".format(module, makers[0])
    if package == "pettingzoo":
        name = ("" if makers[0] == MAKERS[0] else "aec:") + rest.replace(".", "/")
    return [{"env": "pettingzoo:" + name, "api": "pettingzoo", "entry": ""}]


def _import(probe, module, failed):
    """Import a module and return whether it could be; remember why not."""
    if module in failed:
        return False
    with open(os.path.join(probe.folder, "importing"), "w", encoding="utf-8") as file:
        file.write(module)
    try:
        importlib.import_module(module)
    except BaseException as error:  # SystemExit of a module that is a script, too
        failed[module] = "{}: {}".format(type(error).__name__, str(error)[:300])
        return False
    return True
