"""Enter a cell: `python bootstrap.py request.json`, run by the cell's own interpreter.

Python starts a script with the script's folder on `sys.path`. This one takes it off again, so that no module of ours
can stand in for one of the libraries under test, and loads the rest as a package that has a name but no place on
`sys.path`. Children that multiprocessing starts anew run this file again as `__mp_main__`: the same door.

Only modules that every interpreter has loaded by itself are imported here: `importlib.util`, say, would then also be
there for a library that forgot to import it, and a wrong "works" would be printed.
"""

import os
import sys

PACKAGE = "_simmatrix_cell"
FOLDER = os.path.dirname(os.path.realpath(__file__))


def enter():
    """Remove our folder from `sys.path` and make the package importable."""
    sys.path[:] = [entry for entry in sys.path if os.path.realpath(entry) != FOLDER]
    if PACKAGE not in sys.modules:
        package = type(sys)(PACKAGE)
        package.__path__ = [FOLDER]
        package.__spec__ = type(os.__spec__)(PACKAGE, None, is_package=True)
        package.__spec__.submodule_search_locations[:] = [FOLDER]
        sys.modules[PACKAGE] = package


if __name__ == "__mp_main__":
    enter()

if __name__ == "__main__":
    enter()
    from _simmatrix_cell.cell_run import run

    request = sys.argv.pop(1)
    run(request)
