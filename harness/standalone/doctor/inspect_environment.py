"""Inspect an environment twice: with the caller's variables and folder as they are, and without (scrubbed)."""

from __future__ import annotations

import json
import os
import pkgutil
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..keys import LEFT_OUT, MODULES
from ..running import ProcessResult, Run
from ..versions import canonical

SECONDS = 60
"""How long one import may take."""
LOOKING_SECONDS = 120.0

BASIC_VARIABLES = frozenset(
    "PATH HOME USER LOGNAME SHELL TERM LANG LANGUAGE TZ TMPDIR DISPLAY XAUTHORITY WAYLAND_DISPLAY HOSTNAME PWD".split()
)
"""The variables that stay when an environment is scrubbed; those of LC_ and XDG_, too."""
NO_USER_SITE = "PYTHONNOUSERSITE"


class Viewpoint(NamedTuple):
    """The point of view of an inspection: the interpreter, and the variables and folder of the caller."""

    run: Run
    python: str
    variables: Mapping[str, str]
    folder: str
    scratch: str

    def scrubbed(self, *allowlist: str, folder: Optional[str] = None) -> Viewpoint:
        """Return a copy without the caller's variables, except basic ones and `allowlist`.

        It works in `folder`, or without one in an empty folder.
        """
        left = {
            name: value
            for name, value in self.variables.items()
            if name in BASIC_VARIABLES or name in allowlist or name.startswith(("LC_", "XDG_"))
        }
        if USER_SITE not in allowlist:
            left[NO_USER_SITE] = "1"
        return self._replace(variables=left, folder=folder or ensure_folder(os.path.join(self.scratch, "empty")))

    @property
    def removed(self) -> List[str]:
        """Return the names of the variables that scrubbing removes."""
        left = self.scrubbed().variables
        return sorted(name for name in self.variables if name not in left and self.variables[name])


USER_SITE = "the user site"
"""In place of a variable: what lies in ~/.local."""


def ensure_folder(folder: str) -> str:
    """Return the folder; make it if it does not exist."""
    os.makedirs(folder, exist_ok=True)
    return folder


def describe_environment(here: Viewpoint, name: str, *flags: str) -> Dict[str, Any]:
    """Return the interpreter's description of its environment; if it gives none, `trouble` is the reason."""
    description, ran = _answer(here, "describe_environment.py", name, LOOKING_SECONDS, *flags)
    return description or {"trouble": describe_end(ran), "output": ran.output[-6000:]}


def list_rendering_support(here: Viewpoint) -> Dict[str, Any]:
    """Return the rendering libraries and devices found here; empty if they cannot be determined."""
    return _answer(here, "list_renderers.py", "seen", 30.0)[0]


def _answer(
    here: Viewpoint, script: str, name: str, seconds: float, *flags: str
) -> Tuple[Dict[str, Any], ProcessResult]:
    """Run a script of ours in the environment's interpreter. Return its answer, empty without one, and its end."""
    target = os.path.join(here.scratch, name + ".json")
    # -B keeps bytecode out of the environment. The answer goes to a file, because the output mixes both streams.
    ran = here.run([here.python, "-B", *flags, _script(here, script), target], here.variables, here.folder, seconds)
    try:
        with open(target, encoding="ascii") as file:
            return dict(json.load(file)), ran
    except (OSError, ValueError, TypeError):
        return {}, ran


def describe_end(ran: ProcessResult) -> str:
    """Describe in one line the end of a process that should have succeeded."""
    lines = [line.strip() for line in ran.output.splitlines() if line.strip()]
    if ran.timed_out:
        return "it did not end in its time"
    if ran.signal:
        return "it was killed by " + ran.signal
    return lines[-1] if lines else "it ended with {}, without a word".format(ran.code)


def _script(here: Viewpoint, name: str) -> str:
    """Return the path of a script for the environment's own interpreter: a copy, since ours may lie in an archive."""
    path = os.path.join(ensure_folder(os.path.join(here.scratch, "scripts")), name)
    if not os.path.exists(path):
        with open(path, "wb") as file:
            file.write(pkgutil.get_data(__name__.rpartition(".")[0], name) or b"")
    return path


def modules(description: Mapping[str, Any]) -> List[str]:
    """Return the modules to import: those of the packages that matter and are installed."""
    names = {canonical(one["name"]) for one in description.get("distributions", ())}
    tops = set(description.get("importable", ()))
    # conda installs some packages under another name; their modules are there all the same.
    selection = [module for name, module in MODULES.items() if name in names or module in tops]
    return list(dict.fromkeys(selection))


def left_out(description: Mapping[str, Any]) -> Dict[str, str]:
    """Return the installed packages that are not imported, with the reason."""
    names = {canonical(one["name"]) for one in description.get("distributions", ())}
    return {name: why for name, why in LEFT_OUT.items() if name in names}


# --- imports ---------------------------------------------------------------------------------------------------


def imports(here: Viewpoint, names: Sequence[str]) -> Dict[str, Dict[str, Any]]:
    """Import the modules one after the other and return their results; those that fail are tried again alone.

    `alone` says that a module can be imported where no other one is.
    """
    results = _together(here, names)
    for name in names[1:]:
        if results[name]["error"]:
            again = _together(here, [name])[name]
            results[name] = again if again["error"] else dict(results[name], alone=True)
    return results


def _together(here: Viewpoint, names: Sequence[str]) -> Dict[str, Dict[str, Any]]:
    results: Dict[str, Dict[str, Any]] = {}
    waiting = list(names)
    while waiting:
        target = os.path.join(here.scratch, "imports.jsonl")
        if os.path.exists(target):
            os.unlink(target)
        argv = [here.python, "-B", _script(here, "import_modules.py"), target, str(SECONDS), *waiting]
        # The alarm in `import_modules.py` ends one slow import; this limit ends a process that the alarm does not.
        ran = here.run(argv, here.variables, here.folder, SECONDS * len(waiting) + 30.0)
        records = list(_lines(target))
        results.update({one["module"]: dict(one, output="") for one in records if not one["started"]})
        left = [name for name in waiting if name not in results]
        if not left:
            break
        started = [one["module"] for one in records if one["started"] and one["module"] in left]
        guilty = started[-1] if started else left[0]
        results[guilty] = _died(guilty, ran, started=bool(started))
        waiting = left[left.index(guilty) + 1 :]
    return results


def _died(name: str, ran: ProcessResult, *, started: bool) -> Dict[str, Any]:
    slow = ran.timed_out or ran.signal == "SIGALRM"
    death = "killed by " + ran.signal if ran.signal else "the process ended with exit code {}".format(ran.code)
    message = "TimeoutError: `import {}` takes more than {} s".format(name, SECONDS) if slow else death
    return {
        "module": name,
        "error": message if started else describe_end(ran),
        "signal": None if slow else ran.signal,
        "traceback": ran.output[-6000:],
        "output": ran.output[-6000:],
        "libraries": [],
    }


def _lines(path: str) -> Iterator[Dict[str, Any]]:
    try:
        with open(path, encoding="ascii") as file:
            for line in file:
                yield json.loads(line)
    except (OSError, ValueError):  # the last one may be cut off
        return


# --- both ------------------------------------------------------------------------------------------------------


def run_probes(here: Viewpoint) -> Dict[str, Any]:
    """Return all results: `facts` and `imports` as it is, `scrubbed` and `clean_imports` scrubbed."""
    clean = here.scrubbed()
    as_it_is, scrubbed = describe_environment(here, "as-it-is"), describe_environment(clean, "scrubbed")
    if "trouble" in scrubbed:
        # Without `site` no .pth file or sitecustomize runs, which may be what keeps this Python from starting.
        bare = describe_environment(clean, "bare", "-I", "-S")
        scrubbed = scrubbed if "trouble" in bare else dict(bare, trouble=scrubbed["trouble"])
    looked = as_it_is if "distributions" in as_it_is else scrubbed
    names = modules(looked)
    startable = [one for one in (as_it_is, scrubbed) if "trouble" not in one]
    results = imports(here, names) if as_it_is in startable else {}
    # Something may come from the folder or the user site, too.
    alike = not here.removed and all(as_it_is.get(key) == scrubbed.get(key) for key in ("path", "hidden"))
    again = results if alike else imports(clean, names) if scrubbed in startable else {}
    return {
        "facts": as_it_is,
        "scrubbed": scrubbed,
        "imports": results,
        "clean_imports": again,
        "left_out": left_out(looked),
    }
