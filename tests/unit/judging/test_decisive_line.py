"""Evidence without this machine in it, and the line of a log that says why."""

import pytest

from harness.judging.runs.decisive_line import decisive_of_check, exception_line
from harness.model import CheckReply, Outcome, Raised, WorkerRecord
from harness.standalone.failures.lines import decisive_line, describe_death, innermost_frame, normalise

PLACES = {"/home/ada/.cache/sim/env/abc": "$ENV", "/home/ada": "$HOME", "/tmp": "$TMP"}

MACHINE_SPECIFIC = {
    "an environment's folder, before the HOME it lies in": (
        'File "/home/ada/.cache/sim/env/abc/lib/python3.11/site-packages/x.py"',
        'File "$ENV/lib/python3.11/site-packages/x.py"',
    ),
    "a folder at the end of a sentence": ("nothing in /home/ada.", "nothing in $HOME."),
    "a compiler's flag": ("gcc -I/home/ada/include", "gcc -I$HOME/include"),
    "an address in a URL": ("file:///tmp/x.whl", "file://$TMP/x.whl"),
    "no part of another folder": ("/var/tmp/x /tmp2 /home/adamant", "/var/tmp/x /tmp2 /home/adamant"),
    "two streams in one line": (
        "--backgro/home/ada/.cache/sim/env/abc/lib/a.py:3: warns",
        "--backgro$ENV/lib/a.py:3: warns",
    ),
    "addresses": ("<function f at 0x7feb2adfa700>", "<function f at 0x…>"),
    "small hexadecimal constants stay": ("GL error 0x502", "GL error 0x502"),
    "process numbers": ("This process (pid=4711) is multi-threaded", "This process (pid=…) is multi-threaded"),
    "uv's build folders": ("/c/builds-v0/.tmpAnbybQ/lib", "/c/builds-v0/.tmp…/lib"),
    "Python's temporary files": ("/tmp/tmpq8x_1kz2/a", "$TMP/tmp…/a"),
    "ports": ("http://127.0.0.1:40213/ and localhost:8080", "http://127.0.0.1:…/ and localhost:…"),
    "timings": ("Resolved 10 packages in 628ms", "Resolved 10 packages in … s"),
    "colours": ("\x1b[1m\x1b[31merror\x1b[39m\x1b[0m: no", "error: no"),
    "what a carriage return wrote over": ("10%\r50%\rdone\r\nnext", "done\nnext"),
    "mirrors of the index": ("https://pkgs.lab.test/simple/gym/ is", "$INDEX/simple/gym/ is"),
    "versions stay": ("mujoco 3.3.7 needs numpy 2.2.6", "mujoco 3.3.7 needs numpy 2.2.6"),
}


@pytest.mark.parametrize(("text", "expected"), MACHINE_SPECIFIC.values(), ids=MACHINE_SPECIFIC.keys())
def test_normalise(text: str, expected: str) -> None:
    """Text that differs between machines and runs is replaced; all else is kept."""
    assert normalise(text, PLACES) == expected


def test_normalise_twice() -> None:
    """Text that was normalised stays as it is."""
    once = normalise("\n".join(text for text, _ in MACHINE_SPECIFIC.values()), PLACES)

    assert normalise(once, PLACES) == once


LINES = {
    "an exception": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
    import gymnasium.envs.mujoco
  File "$ENV/gymnasium/envs/mujoco/mujoco_env.py", line 4, in <module>
    import packaging
    ~~~~~~^^^^^^^^^^
ModuleNotFoundError: No module named 'packaging'
""",
        "ModuleNotFoundError: No module named 'packaging'",
    ),
    "an exception class with its module": (
        "Traceback (most recent call last):\n"
        '  File "x.py", line 1, in <module>\n'
        "gymnasium.error.DependencyNotInstalled: No module named 'mujoco'. (HINT: install it)\n",
        "gymnasium.error.DependencyNotInstalled: No module named 'mujoco'. (HINT: install it)",
    ),
    "an exception without a message": (
        'Traceback (most recent call last):\n  File "x.py", line 1, in <module>\nAssertionError\n',
        "AssertionError",
    ),
    "a message of several lines": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
ValueError: XML Error: top-level default class 'main' cannot be renamed
Element 'default', line 0

""",
        "ValueError: XML Error: top-level default class 'main' cannot be renamed / Element 'default', line 0",
    ),
    "MuJoCo's element after a blank line": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
ValueError: XML Error: Schema violation: unrecognized attribute: 'memory'

Element 'size', line 24, column 3
""",
        "ValueError: XML Error: Schema violation: unrecognized attribute: 'memory' / Element 'size', line 24, column 3",
    ),
    "a cause": (
        """\
Traceback (most recent call last):
  File "gl.py", line 3, in load
OSError: libEGL.so.1: cannot open shared object file: No such file or directory

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "x.py", line 1, in <module>
ImportError: Unable to load EGL library
""",
        "OSError: libEGL.so.1: cannot open shared object file: No such file or directory",
    ),
    "a cause that is a bare key": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
KeyError: 'Ant-v9'

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "x.py", line 1, in <module>
gymnasium.error.NameNotFound: Environment `Ant` in version 9 doesn't exist.
""",
        "gymnasium.error.NameNotFound: Environment `Ant` in version 9 doesn't exist.",
    ),
    "a missing module that the exception names with its remedy": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
ModuleNotFoundError: No module named 'pygame'

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "x.py", line 1, in <module>
gymnasium.error.DependencyNotInstalled: pygame is not installed, run `pip install "gymnasium[classic-control]"`
""",
        "gymnasium.error.DependencyNotInstalled: pygame is not installed, "
        'run `pip install "gymnasium[classic-control]"`',
    ),
    "a missing module that the exception does not name": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
ModuleNotFoundError: No module named 'packaging.version'

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "x.py", line 1, in <module>
gymnasium.error.DependencyNotInstalled: MuJoCo is not installed
""",
        "ModuleNotFoundError: No module named 'packaging.version'",
    ),
    "a first try that was handled": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
ModuleNotFoundError: No module named 'robosuite_models'

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "x.py", line 1, in <module>
ModuleNotFoundError: No module named 'gym'
""",
        "ModuleNotFoundError: No module named 'gym'",
    ),
    "a failure that broke the cleaning up": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in reset
ValueError: bad model

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "x.py", line 9, in close
AttributeError: 'NoneType' object has no attribute 'free'
""",
        "ValueError: bad model",
    ),
    "an exception seen as the end of a pipe": (
        """\
Process Worker<AsyncVectorEnv>-0:
Traceback (most recent call last):
  File "x.py", line 1, in _worker
RuntimeError: no device
Traceback (most recent call last):
  File "x.py", line 1, in <module>
ConnectionResetError: [Errno 104] Connection reset by peer
""",
        "RuntimeError: no device",
    ),
    "nothing but the end of a pipe": (
        'Traceback (most recent call last):\n  File "x.py", line 1, in recv\nEOFError\n',
        "EOFError",
    ),
    "an exception that Python ignored, after the real one": (
        """\
Traceback (most recent call last):
  File "x.py", line 1, in <module>
mujoco.FatalError: gladLoadGL error
Exception ignored in: <function GLContext.__del__ at 0x7feb2adfa700>
Traceback (most recent call last):
  File "x.py", line 38, in free
AttributeError: 'GLContext' object has no attribute '_context'
""",
        "mujoco.FatalError: gladLoadGL error",
    ),
    "faulthandler": (
        """\
Fatal Python error: Segmentation fault

Current thread 0x00007fe4821b9b80 (most recent call first):
  File "ctypes/__init__.py", line 505 in string_at
""",
        "Fatal Python error: Segmentation fault",
    ),
    "an abort with its reason": (
        """\
terminate called after throwing an instance of 'std::runtime_error'
  what():  GLEW initialization error: Missing GL version
Fatal Python error: Aborted
""",
        "what(): GLEW initialization error: Missing GL version",
    ),
    "setuptools' complaint": (
        """\
error: Failed to build `gym==0.21.0`
  cause: The build backend returned an error

         [stderr]
         /c/setuptools/dist.py:318: UserWarning: Unknown distribution option: 'tests_require'
           warnings.warn(msg)
         error in gym setup command: 'extras_require' must be a dictionary

hint: Build failures usually indicate a problem with the package or the build environment
""",
        "error in gym setup command: 'extras_require' must be a dictionary",
    ),
    "a build backend's exception inside uv's words": (
        """\
error: Failed to build `mujoco==2.3.7`
  cause: The build backend returned an error

         [stderr]
         Traceback (most recent call last):
           File "<string>", line 14, in <module>
           File "<string>", line 170, in _find_mujoco
         RuntimeError: MUJOCO_PATH environment variable is not set

hint: Build failures usually indicate a problem with the package or the build environment
""",
        "RuntimeError: MUJOCO_PATH environment variable is not set",
    ),
    "a compiler rather than the command that failed": (
        """\
osmesashim.c:1:10: fatal error: GL/osmesa.h: No such file or directory
compilation terminated.
Traceback (most recent call last):
  File "x.py", line 1, in <module>
distutils.errors.CompileError: command 'gcc' failed with exit status 1
""",
        "osmesashim.c:1:10: fatal error: GL/osmesa.h: No such file or directory",
    ),
    "CMake": (
        "-- The C compiler\nCMake Error at CMakeLists.txt:3 (find_package):\n  Could not find OpenGL\n\n-- Done\n",
        "CMake Error at CMakeLists.txt:3 (find_package): / Could not find OpenGL",
    ),
    "uv's resolution": (
        """\
error: No solution found when resolving dependencies
  cause: Because sb3==2.0.0 depends on gymnasium==0.28.1 and you require gymnasium==1.2.3, we can conclude that you
         require sb3!=2.0.0.
         And because you require sb3==2.0.0, we can conclude that your requirements are unsatisfiable.

hint: another
""",
        "Because sb3==2.0.0 depends on gymnasium==0.28.1 and you require gymnasium==1.2.3, we can conclude that you"
        " require sb3!=2.0.0. And because you require sb3==2.0.0",
    ),
    "the resolution of an older uv": (
        """\
  \u00d7 No solution found when resolving dependencies:
  ╰─▶ Because mujoco==1.50 was not found in the package registry and you
      require mujoco==1.50, we can conclude that your requirements are
      unsatisfiable.
""",
        "Because mujoco==1.50 was not found in the package registry and you require mujoco==1.50",
    ),
    "a plain error": ("starting\nerror: unknown option\n", "error: unknown option"),
    "an exception without its traceback": (
        "AttributeError: module 'numpy' has no attribute 'float'.\n`np.float` was a deprecated alias.\n",
        "AttributeError: module 'numpy' has no attribute 'float'.",
    ),
    "words at the end": ("hello\nCould not open display\n\n", "Could not open display"),
    "nothing": (" \n\n", None),
}


@pytest.mark.parametrize(("text", "line"), LINES.values(), ids=LINES.keys())
def test_decisive_line(text: str, line: str | None) -> None:
    """Of a log, the line that a person would quote."""
    assert decisive_line(text) == line


def test_decisive_line_is_bounded() -> None:
    """A long message is cut at its end, and says so."""
    line = decisive_line("error: " + "x" * 1000) or ""

    assert (len(line), line[-2:]) == (300, "x…")


MASK = Raised(
    type="ConnectionResetError", message="[Errno 104] Connection reset by peer", traceback="", blame="library"
)
MASKED = "ConnectionResetError: [Errno 104] Connection reset by peer"
XML = Raised(type="ValueError", message="XML Error: bad\nElement 'default', line 0\n", traceback="", blame="library")
STACKS = """\
Fatal Python error: Segmentation fault

Thread 0x00007f16d0ffab80 (most recent call first):
  File "/e/lib/python3.11/threading.py", line 331 in wait

Current thread 0x00007f16d0ffab81 (most recent call first):
  File "$ENV/lib/python3.11/site-packages/mujoco/egl/__init__.py", line 60 in create_initialized_egl_device_display
"""
HANGING = 'Thread 0x00007f16d0ffab80 (most recent call first):\n  File "/e/fake_env/core.py", line 12 in step\n'
WAITING = (
    'Thread 0x00007f16d0ffab80 (most recent call first):\n  File "/e/multiprocessing/connection.py", line 3 in recv\n'
)


def reply(raised: Raised | None, *workers: WorkerRecord, outcome: Outcome | None = Outcome.FAILED) -> CheckReply:
    """Return the reply of a vector check with these workers."""
    return CheckReply(check="vector.async.fork", outcome=outcome, raised=raised, workers=workers)


CHECKED = {
    "the parent's own exception": (reply(XML), ("ValueError: XML Error: bad / Element 'default', line 0", None)),
    "a worker's exception behind a broken pipe": (
        reply(MASK, WorkerRecord(pid=2, raised=MASK), WorkerRecord(pid=1, raised=XML)),
        ("ValueError: XML Error: bad / Element 'default', line 0", MASKED),
    ),
    "a worker's exception that the parent raises again": (
        reply(XML, WorkerRecord(pid=1, raised=XML)),
        ("ValueError: XML Error: bad / Element 'default', line 0", None),
    ),
    "a worker's exception behind another that misleads": (
        reply(
            Raised(type="TypeError", message="cannot unpack", traceback="", blame="library"),
            WorkerRecord(pid=1, raised=XML),
        ),
        ("ValueError: XML Error: bad / Element 'default', line 0", "TypeError: cannot unpack"),
    ),
    "a worker that crashed": (
        reply(MASK, WorkerRecord(pid=1, exit_code=1), WorkerRecord(pid=2, exit_code=-11, stacks=STACKS)),
        (
            "worker killed by SIGSEGV (Fatal Python error: Segmentation fault) in"
            " create_initialized_egl_device_display, egl/__init__.py line 60",
            MASKED,
        ),
    ),
    "a worker that exited": (
        reply(MASK, WorkerRecord(pid=1, exit_code=1)),
        ("worker exited with code 1 without a word", MASKED),
    ),
    "workers that ended because the parent failed": (
        reply(XML, WorkerRecord(pid=1, exit_code=-15), WorkerRecord(pid=2, exit_code=1, raised=MASK)),
        ("ValueError: XML Error: bad / Element 'default', line 0", None),
    ),
    "a worker that hangs, while another waits": (
        reply(None, WorkerRecord(pid=1, stacks=WAITING), WorkerRecord(pid=2, stacks=HANGING), outcome=None),
        ("worker hangs in step, fake_env/core.py line 12", None),
    ),
    "healthy workers": (
        reply(MASK, WorkerRecord(pid=1, exit_code=0), WorkerRecord(pid=2, stacks=WAITING)),
        (MASKED, None),
    ),
    "a reason without an exception": (
        CheckReply(check="render.rgb_array", outcome=Outcome.FAILED, reason="the frame is blank"),
        ("the frame is blank", None),
    ),
    "a check that never ended": (reply(None, outcome=None), (None, None)),
}


@pytest.mark.parametrize(("told", "expected"), CHECKED.values(), ids=CHECKED.keys())
def test_decisive_of_check(told: CheckReply, expected: tuple[str | None, str | None]) -> None:
    """The first failure of a worker takes precedence over its parent's view of it."""
    assert decisive_of_check(told) == expected


def test_original_of_a_raised_chain() -> None:
    """An exception that came with its traceback is quoted by its explicit cause."""
    chain = (
        'Traceback (most recent call last):\n  File "a.py", line 1, in f\nOSError: no libGL\n\n'
        "The above exception was the direct cause of the following exception:\n\n"
        'Traceback (most recent call last):\n  File "a.py", line 1, in g\nImportError: no OpenGL\n'
    )

    assert exception_line(Raised(type="ImportError", message="no OpenGL", traceback=chain, blame="library")) == (
        "OSError: no libGL"
    )


@pytest.mark.parametrize(
    ("exit_code", "number", "stacks", "expected"),
    [
        (3, None, "", "exited with code 3 without a word"),
        (None, 9, "", "killed by SIGKILL"),
        (None, 99, "", "killed by signal 99"),
        (
            None,
            6,
            "python: fcl.cpp:12: void f(): Assertion `x' failed.\n",
            "killed by SIGABRT (python: fcl.cpp:12: void f(): Assertion `x' failed.)",
        ),
        (None, 11, HANGING, "killed by SIGSEGV in step, fake_env/core.py line 12"),
    ],
)
def test_death(exit_code: int | None, number: int | None, stacks: str, expected: str) -> None:
    """The end of a process in words: signal or exit code, what it said, and where."""
    assert describe_death(exit_code, number, stacks) == expected


def test_innermost_frame_of_the_main_thread() -> None:
    """Without a thread that crashed the last one is told, which is the main thread."""
    assert innermost_frame(WAITING + "\n" + HANGING) == "step, fake_env/core.py line 12"
    assert innermost_frame("no stacks") is None
