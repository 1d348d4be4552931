"""Run somebody's own tests: `python bootstrap_suite.py FILE MODULES ARGUMENT...`, run by a cell's interpreter.

Neither our folder nor the working folder is on `sys.path` when pytest starts, as it is for the command `pytest`: the
tests import the installed package, not the source beside them. Afterwards the file lists these modules
(comma-separated), and all below them that were imported, with their places: name, tab, path.
"""

import os
import sys

FOLDER = os.path.dirname(os.path.realpath(__file__))


def main():
    """Run pytest, write the places of modules and end with pytest's exit code."""
    sys.path[:] = [entry for entry in sys.path if os.path.realpath(entry) != FOLDER]
    path, modules = sys.argv[1:3]
    del sys.argv[1:3]
    pytest = __import__("pytest")
    code = pytest.main()
    with open(path, "w", encoding="utf-8") as file:
        for name in sorted(sys.modules):
            if name.partition(".")[0] in modules.split(","):
                file.write("{}\t{}\n".format(name, getattr(sys.modules[name], "__file__", None) or ""))
    sys.exit(int(code))


if __name__ == "__main__":
    main()
