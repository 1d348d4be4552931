import os
import sys

import fake_build_tool


def requires(stage):
    return ["fake-plain==" + fake_build_tool.VERSION]


def files(found):
    values = {
        "@TOOL@": fake_build_tool.VERSION,
        "@PYTHON@": "%d.%d" % sys.version_info[:2],
        "@FLAVOUR@": os.environ.get("FAKE_FLAVOUR", "none"),
    }
    for path, text in found.items():
        for mark, value in values.items():
            text = text.replace(mark, value)
        found[path] = text
    return found
