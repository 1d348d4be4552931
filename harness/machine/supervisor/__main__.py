"""Run by path: the rest is in modules, whose byte code is kept."""

import os
import sys

if __name__ == "__main__":  # the package is found last, after the standard library
    sys.path.append(os.path.abspath(__file__).rpartition("/harness/")[0])

from harness.machine.supervisor.fork_server import serve

if __name__ == "__main__":
    serve()
