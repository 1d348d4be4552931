import sys


def files(found):
    print("error: a line that is not the last")
    sys.stdout.flush()
    raise RuntimeError("FAKE_PATH environment variable is not set")
