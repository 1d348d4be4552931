"""The build backend inside the sdists of the fakes: standard library only, Python 3.7 and newer."""

import base64
import hashlib
import json
import os
import sys
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)

try:
    import build_hooks
except ModuleNotFoundError as error:
    if error.name != "build_hooks":
        raise
    build_hooks = None


def get_requires_for_build_wheel(config_settings=None):
    hook = getattr(build_hooks, "more_requirements", None)
    return hook() if hook else []


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    about = _about()
    name = "%s-%s.dist-info" % (about["name"].replace("-", "_"), about["version"])
    os.mkdir(os.path.join(metadata_directory, name))
    with open(os.path.join(metadata_directory, name, "METADATA"), "w") as file:
        file.write(_metadata(about, "metadata"))
    return name


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    about = _about()
    stem = "%s-%s" % (about["name"].replace("-", "_"), about["version"])
    entries = {}
    for folder, _, names in os.walk(os.path.join(HERE, "site")):
        for name in names:
            path = os.path.join(folder, name)
            with open(path) as file:
                entries[os.path.relpath(path, os.path.join(HERE, "site"))] = file.read()
    hook = getattr(build_hooks, "files", None)
    if hook:
        entries = hook(entries)
    tag = "py3-none-any"
    entries[stem + ".dist-info/METADATA"] = _metadata(about, "wheel")
    entries[stem + ".dist-info/WHEEL"] = (
        "Wheel-Version: 1.0\nGenerator: fakes\nRoot-Is-Purelib: true\nTag: %s\n" % tag
    )
    rows = []
    for path, text in sorted(entries.items()):
        digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).decode().rstrip("=")
        rows.append("%s,sha256=%s,%d" % (path, digest, len(text.encode())))
    rows.append(stem + ".dist-info/RECORD,,")
    entries[stem + ".dist-info/RECORD"] = "\n".join(rows) + "\n"
    name = "%s-%s.whl" % (stem, tag)
    with zipfile.ZipFile(os.path.join(wheel_directory, name), "w") as archive:
        for path, text in sorted(entries.items()):
            archive.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), text)
    return name


def _about():
    with open(os.path.join(HERE, "about.json")) as file:
        return json.load(file)


def _metadata(about, stage):
    hook = getattr(build_hooks, "requires", None)
    lines = hook(stage) if hook else []
    return about["metadata"] + "".join("Requires-Dist: %s\n" % line for line in lines)
