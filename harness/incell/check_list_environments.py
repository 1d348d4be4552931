"""Lists the environments that importing packages and their submodules makes known. `init` alone asks for it.

The case imports the packages; `kwargs` has `skip`, submodules that are not imported. The file `importing` in the
reply's folder names the module whose import has begun: a module may end the process.
"""

import importlib
import os

from .cell_listing import loops, registered, suited


def run(probe, facts):
    """Tell `environments`, each with API, importable module and entry point, and `failed` imports with the reason."""
    tops = [name.partition(".")[0] for name in probe.case["imports"]]
    facts["environments"] = found = []
    facts["failed"] = failed = {}
    seen = set()
    failed.update(dict.fromkeys(probe.case["kwargs"]["skip"], "importing it ends the process"))
    for module in ["", *suited(tops)]:
        if module and not _imported(probe, module, failed):
            continue
        for each in registered(tops) + loops(tops, module):
            if each["env"] not in seen:
                seen.add(each["env"])
                found.append(dict(each, module=module))
    for each in found:
        entry = each["entry"].partition(":")[0]
        each["lacking"] = "" if not entry or _imported(probe, entry, failed) else failed[entry]


def _imported(probe, module, failed):
    """Import a module; remember why that failed."""
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
