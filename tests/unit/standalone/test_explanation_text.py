"""Test the words of `explain` for people: cause, remedy, reference, and the commands that help from there."""

from __future__ import annotations

from builders import standalone_signature

from harness.standalone.explain import explain_text, explanation_text
from harness.standalone.explain.explain_text import Facts
from harness.standalone.explain.explanation_text import Place
from harness.standalone.failures import matching, remedies

TRACE = 'Traceback (most recent call last):\n  File "/e/lib/python3.9/site-packages/gym/a.py", line 5, in step\n'
REMEDY = {"requirements": ["numpy<2"], "environment": {"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": ""}, "text": "or wait"}


def wings_signature(remedy: dict[str, object], **more: object) -> matching.Signature:
    """Return a known failure."""
    links = ["https://example.org/1"]
    return standalone_signature("wings", **{"cause": "it has none", "remedy": remedy, "references": links, **more})


def explanation_lines(text: str, place: Place, *those: matching.Signature, **here: object) -> list[str]:
    """Return the lines that `explain` prints about a text."""
    return list(explanation_text.lines(explain_text.explain_text(text, those, Facts(**here)), place))  # type: ignore[arg-type]


def test_a_known_cause() -> None:
    """The text has the remedy as commands for this interpreter, and the place of the output."""
    place = Place(python="/e/bin/python", output_file="out.log")
    assert explanation_lines(TRACE + "ValueError: no wings\n", place, wings_signature(REMEDY)) == [
        "failed:    ValueError: no wings",
        "cause:     it has none",
        "remedy:    install `numpy<2`; set `MUJOCO_GL=egl`; unset `PYOPENGL_PLATFORM`. or wait",
        "reference: https://example.org/1",
        "known as:  wings",
        "next:      /e/bin/python -m pip install 'numpy<2'",
        "           export MUJOCO_GL=egl",
        "           unset PYOPENGL_PLATFORM",
        "           simmatrix doctor --python /e/bin/python --prove",
        "output:    out.log",
    ]


def test_an_unknown_one() -> None:
    """The text suggests what to inspect, what to try, and what to search for."""
    text = f"gym==0.21.0\n{TRACE}OSError: /home/me/a/b.xml is gone at 0x7fff12\n"
    assert explanation_lines(text, Place()) == [
        "failed:    OSError: /home/me/a/b.xml is gone at 0x7fff12 (in single)",
        "cause:     unknown: no known failure fits",
        "next:      simmatrix doctor",
        "           simmatrix repair gym==0.21.0 --python 3.9",
        "           search for: OSError: b.xml is gone at gym",
    ]


def test_the_file_that_stands_alone_names_itself() -> None:
    """The single file names itself in commands, and only verbs that it has."""
    told = explanation_lines(
        TRACE + "ValueError: no wings\n", Place(program="python a.pyz", alone=True), wings_signature({"text": "wait"})
    )
    assert told[-1] == "next:      python a.pyz doctor"


def test_a_worker_that_died_without_a_word_is_asked_to_speak() -> None:
    """The command is run again, so that a crash says where."""
    mask = wings_signature({"text": "look"}, pattern="EOFError", masks=True, phases=["vector"])
    told = explanation_lines(TRACE + "EOFError\n", Place(command=("python", "my train.py")), mask, failed=True)
    assert told[:4] == [
        "failed:    EOFError (in vector)",
        "that is:   it has none",
        "remedy:    look",
        "cause:     unknown: no known failure fits",
    ]
    assert "next:      simmatrix explain -- env PYTHONFAULTHANDLER=1 python 'my train.py'" in told


def test_a_package_that_is_there_is_upgraded() -> None:
    """An installer leaves it alone where no version is asked for; a package that is not there is installed."""
    signature = wings_signature({"requirements": ["wings"], "constraints": ["feathers<4"]})
    here, elsewhere = Place(requirements=("wings==1.0",)), Place(requirements=("beak==1.0",))

    shown = [explanation_lines(TRACE + "ValueError: no wings\n", place, signature) for place in (here, elsewhere)]
    assert "next:      python -m pip install --upgrade wings 'feathers<4'" in shown[0]
    assert "next:      python -m pip install wings 'feathers<4'" in shown[1]


def test_nothing_failed() -> None:
    """The last line is shown, and how to catch what does."""
    assert explanation_lines("Episode 1\nall done\n", Place(), wings_signature(REMEDY)) == [
        "no failure: no line of this text reports a failure",
        "last line: all done",
        "next:      simmatrix explain -- COMMAND, which keeps the complete output",
    ]


def test_a_release_that_is_repaired_is_tried_so() -> None:
    """The suggested command is `simmatrix try` with `--overlay`."""
    told = explanation_lines("gym==0.21.0\nValueError: no wings\n", Place(), wings_signature({"overlay": ["gym"]}))
    assert told[-1] == "           simmatrix try gym==0.21.0 --overlay"


def test_every_key_of_a_remedy_has_words() -> None:
    """Those that a machine can apply, then the text."""
    remedy = {
        "constraints": ["a<1"], "overrides": ["b"], "build_constraints": ["c<2"], "build_variables": {"V": "1"},
        "only_binary": ["d"], "overlay": ["e"], "uninstall": ["f"], "python": "3.10", "as_of": "2024-01-01T00:00:00Z",
    }  # fmt: skip
    assert remedies.in_words(remedy) == (
        "pin `a<1`; override `b`; build with `c<2`; set for builds `V=1`; install only wheels of `d`; patch `e`;"
        " uninstall `f`; Python 3.10; resolved as of 2024-01-01T00:00:00Z"
    )
