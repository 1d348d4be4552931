import os
import subprocess

HERE = os.path.dirname(os.path.abspath(__file__))
BUILT = os.path.join(HERE, "fake_compiled.txt")


class CompileError(Exception):
    pass


def build():
    header = "fake/absent.h" if "@VERSION@" == "2.0" else "stddef.h"
    source = os.path.join(os.environ["TMPDIR"], "fake.c")
    with open(source, "w") as file:
        file.write("#include <%s>\nint main(void) { return 0; }\n" % header)
    code = subprocess.call(["cc", "-fsyntax-only", source])
    if code:
        raise CompileError("command 'cc' failed with exit code %d" % code)
    with open(BUILT, "w") as file:
        file.write(os.environ.get("FAKE_FLAGS", ""))


if not os.path.exists(BUILT):
    build()
