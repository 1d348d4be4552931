"""Signatures: what a file of them may say, and which of them fit a failure, the deepest cause first."""

from __future__ import annotations

import textwrap
from typing import Any

import pytest

from harness.matrix import signatures
from harness.matrix.signatures import Signature
from harness.model import Change, Phase
from harness.model.errors import BadInput
from harness.standalone.failures import matching
from harness.standalone.failures.matching import Around, Evidence, diagnose

FULL = """
[[signature]]
id = "numpy-2"
phases = ["import", "single"]
pattern = '''has no attribute '(bool8|float_)\\''''
packages = ["numpy>=2", ["gym", "gymnasium<1"]]
python = ">=3.9"
cause = "numpy 2 took the name away"
examples = [
    "AttributeError: module 'numpy' has no attribute 'bool8'", "`np` has no attribute 'float_'",
    "again: AttributeError: module 'numpy' has no attribute 'bool8'",
]
references = ["https://example.org/1"]
[signature.remedy]
requirements = ["numpy<2"]
environment = { A = "b" }
python = "3.10"
as_of = 2024-06-15
text = "or wait"
[[signature.verified_on]]
on = 2026-11-22
what = "gym 0.26.2, numpy 2.0.0"
"""
LINE = "AttributeError: module 'numpy' has no attribute 'bool8'"


def import_signature(name: str = "it", pattern: str | None = "it broke", **more: Any) -> Signature:
    """Return a signature of the import phase."""
    remedy = signatures.RemedyTable(text="mend it")
    values: dict[str, Any] = {"phases": (Phase.IMPORT,), "examples": ("it broke", "it broke again")} | more
    packages = tuple(
        signatures.PartTaking((each,) if isinstance(each, str) else each) for each in values.pop("packages", ())
    )
    return Signature(id=name, cause="because", remedy=remedy, pattern=pattern, packages=packages, **values)  # type: ignore[arg-type]


def fitting_ids(known: list[Signature], *evidence: Evidence, **around: Any) -> list[str]:
    """Return the ids of the signatures that fit, in order."""
    return [each.signature.id for each in diagnose(known, evidence, Around(**around))]


SAID = Evidence(phase=Phase.IMPORT, reasons=("RuntimeError: it broke",))


def test_a_file_says_what_there_is_to_say() -> None:
    """Every field is read; a remedy is the change that a machine can apply, and words."""
    (read,) = signatures.read({"numpy.toml": FULL})
    change = Change(requirements=("numpy<2",), environment={"A": "b"}, python="3.10", as_of="2024-06-15T23:59:59Z")
    assert (read.id, read.phases, read.python) == ("numpy-2", (Phase.IMPORT, Phase.SINGLE), ">=3.9")
    assert list(read.packages) == [("numpy>=2",), ("gym", "gymnasium<1")]
    assert (read.remedy.change, read.remedy.text) == (change, "or wait")
    assert (read.verified_on[0].on, read.verified_on[0].what) == ("2026-11-22", "gym 0.26.2, numpy 2.0.0")


def test_words_alone_are_no_change() -> None:
    """A remedy in words alone is no change, so no machine ever tries it."""
    assert signatures.RemedyTable(text="buy a GPU").change is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('id = "numpy-2"', 'id = "numpy 2"', '.id: "numpy 2" cannot be a label: use letters, digits and "._+-" only'),
        ('"single"]', '"singel"]', '.phases[1]: unknown value "singel"; did you mean "single"?'),
        ("cause =", "coarse =", '.coarse: unknown key; did you mean "cause"?'),
        ("gymnasium<1", "gymnasium<", '.packages[1][1]: "gymnasium<" is not a requirement: '),
        ('python = ">=3.9"', 'python = "new"', '.python: "new" is not a specifier such as ">=3.8,<3.12"'),
        ('python = "3.10"', 'python = "new"', '.remedy.python: "new" is not a version'),
        ("\npattern = ", "\nremark = 1\n#", ".remark: unknown key"),
        ("\npattern = ", "\n#", ': "numpy-2" has neither a "pattern", a "code" nor a "signal"'),
        ('packages = [', 'generic = true\n#', ': "numpy-2" is generic, and so has to name its "packages"'),
        ("has no attr", "|has no attr", " matches the empty text, and so everything"),
        ("has no attr", "(?i)has no attr", " has what a browser does not know: an inline flag; "),
        ("has no attr", "(?P<what>has) no attr", " has what a browser does not know: a named group"),
        ("has no attr", "(?<=x)has no attr", " has what a browser does not know: a lookbehind or a named group"),
        ("has no attr", "has no++ attr", " has what a browser does not know: a possessive quantifier"),
        ("has no attr", "\\Ahas no attr", 'the escape "\\A"; `^` and `$` are the ends of a line'),
        ("has no attr", "[]h]as no attr", "a class that begins with `]`; write `\\]`"),
        ("has no attr", "(has no attr", " is not a regular expression: "),
    ],
)  # fmt: skip
def test_mistakes_are_reported_with_their_place(old: str, new: str, message: str) -> None:
    """File and key, what is wrong, and the nearest name."""
    assert old in FULL
    with pytest.raises(BadInput) as told:
        signatures.read({"numpy.toml": FULL.replace(old, new, 1)})
    assert str(told.value).startswith("numpy.toml: signature[0]")
    assert message in str(told.value)


@pytest.mark.parametrize(
    ("written", "held"),
    [('"line"', ("line",)), ('"packages"', ("packages",)), ("""["gym", 'envs?']""", ("gym", "envs?"))],
)
def test_ties_are_a_rule_or_words(written: str, held: tuple[str, ...]) -> None:
    """The key is one of two rules, or a list of expressions; all are held as a list."""
    (one,) = signatures.read({"a.toml": FULL.replace("packages =", f"ties = {written}\npackages =")})
    assert one.ties == held
    assert matching.read(one.as_file).ties == held


@pytest.mark.parametrize("written", ['"lines"', "[]", '["("]'])
def test_other_ties_are_refused(written: str) -> None:
    """A third rule, no word at all, and an expression that does not compile."""
    with pytest.raises(BadInput, match="ties"):
        signatures.read({"a.toml": FULL.replace("packages =", f"ties = {written}\npackages =")})


def test_a_remedy_says_something() -> None:
    """An empty one is a mistake."""
    with pytest.raises(BadInput, match='"x" has an empty remedy; say in words'):
        signatures.read(
            {"x.toml": '[[signature]]\nid="x"\npattern="x"\ncause="x"\nexamples=["x","xx","again: x"]\nremedy={}\n'}
        )


def test_an_id_is_there_once() -> None:
    """An id that is listed twice is refused, even across files."""
    with pytest.raises(BadInput) as told:
        signatures.read({"a.toml": FULL, "b.toml": FULL})
    assert str(told.value) == 'b.toml: signature[0].id: "numpy-2" is listed twice, first in a.toml'


@pytest.mark.parametrize("pattern", [r"a\+\+b", r"[*+]+x", r"C:\\Zone", r"\(\?P", r"x{2,3}?y", "a(?!b)", "(?:a|b)c"])
def test_patterns_that_both_matchers_understand_are_accepted(pattern: str) -> None:
    """A pattern that only looks like Python's own syntax is accepted unchanged."""
    assert signatures.PortablePattern.canonical(pattern) == pattern


def test_no_signature_without_the_pattern() -> None:
    """A text without the pattern, or another phase, gives no signature."""
    assert fitting_ids([import_signature()], Evidence(phase=Phase.IMPORT, reasons=("it works",))) == []
    assert fitting_ids([import_signature()], Evidence(phase=Phase.VECTOR, reasons=("it broke",))) == []
    assert fitting_ids([import_signature()], Evidence(phase=None, reasons=("it broke",))) == ["it"]


def test_the_line_that_matched_is_shown() -> None:
    """If a pattern spans a traceback, its exception is shown."""
    trace = import_signature(pattern=r'gym/core\.py", line \d+[\s\S]{0,80}it broke')
    log = 'x\n  File "gym/core.py", line 5, in step\n    fly()\nRuntimeError: it broke at 0x1\nmore\n'
    (seen,) = diagnose([trace], [Evidence(phase=Phase.IMPORT, reasons=("RuntimeError",), logs=(log,))], Around())
    assert (seen.seen, seen.is_reason, seen.phase) == ("RuntimeError: it broke at 0x1", False, Phase.IMPORT)


def test_a_signal_alone_can_be_the_sign() -> None:
    """With a pattern both have to fit."""
    alone, both = import_signature("alone", None, signal="SIGSEGV"), import_signature("both", signal="SIGSEGV")
    assert fitting_ids([alone, both], Evidence(phase=Phase.IMPORT, reasons=("killed",), signal="SIGSEGV")) == ["alone"]
    assert fitting_ids([alone, both], Evidence(phase=Phase.IMPORT, reasons=("it broke",), signal="SIGABRT")) == []
    assert fitting_ids([both], Evidence(phase=Phase.IMPORT, reasons=("it broke",), signal="SIGSEGV")) == ["both"]


@pytest.mark.parametrize(
    ("around", "fits"),
    [
        ({"installed": {"NumPy": "2.1.0", "gym": "0.26.2"}}, True),
        ({"installed": {"numpy": "2.1.0", "gymnasium": "0.29.1"}}, True),
        ({"installed": {"numpy": "2.1.0", "gymnasium": "1.2.0"}}, False),
        ({"installed": {"numpy": "1.26.4", "gym": "0.26.2"}}, False),
        ({"installed": {"gym": "0.26.2"}}, False),
        ({"requirements": ("gym==0.26.2",)}, True),
        ({"requirements": ("gym==0.26.2", "numpy>=1.20", "numpy<2")}, False),
        ({"requirements": ("gym==0.26.2", "numpy>=1.20")}, True),
        ({"requirements": ("gymnasium==1.2.0",)}, True),
        ({"installed": {"numpy": "2.1.0", "gym": "0.26.2"}, "python": "3.8.10"}, False),
        ({"installed": {"numpy": "2.1.0", "gym": "0.26.2"}, "python": "3.13.0rc1"}, True),
    ],
)
def test_packages_and_python(around: dict[str, Any], fits: bool) -> None:
    """Installed versions decide; without any, the requirements must not contradict the signature."""
    (read,) = signatures.read({"numpy.toml": FULL})
    assert fitting_ids([read], Evidence(phase=Phase.SINGLE, reasons=(LINE,)), **around) == (["numpy-2"] if fits else [])


def test_a_generic_signature_needs_its_packages() -> None:
    """A generic signature needs its packages; a specific one fits unless something contradicts it."""
    known = [
        import_signature("specific", packages=("pip",)),
        import_signature("generic", packages=("pip",), generic=True),
    ]
    assert fitting_ids(known, SAID) == ["specific"]
    assert fitting_ids(known, SAID, requirements=("pip",)) == ["specific", "generic"]


def test_the_deepest_cause_comes_first() -> None:
    """Masks last, then troubles of the machine, then what is generic; what was told before what only a log has."""
    known = [
        import_signature("mask", "pipe", masks=True),
        import_signature("machine", "no GPU", phases=()),
        import_signature("broad", packages=("gym",), generic=True),
        import_signature("logged", "deep"),
        import_signature("later", "other", phases=(Phase.VECTOR,)),
        import_signature("specific"),
    ]
    texts = Evidence(phase=Phase.IMPORT, reasons=("it broke; no GPU; pipe",), logs=("deep",))
    vector = Evidence(phase=Phase.VECTOR, reasons=("other",))
    order = ["specific", "later", "logged", "broad", "machine", "mask"]
    for turn in range(len(known)):
        assert fitting_ids(known[turn:] + known[:turn], vector, texts, installed={"gym": "1"}) == order


def test_of_equal_ones_that_of_what_failed_first() -> None:
    """Of two known failures of one cell, the one whose line stands first comes first, however the files are ordered."""
    first, second = (Evidence(phase=Phase.SINGLE, reasons=(word,)) for word in ("it broke", "it burst"))
    known = [
        import_signature("a", "it burst", phases=(Phase.SINGLE,)),
        import_signature("b", "it broke", phases=(Phase.SINGLE,)),
    ]

    assert fitting_ids(known, first, second) == ["b", "a"]
    assert fitting_ids(known, second, first) == ["a", "b"]


def test_each_signature_is_reported_once_with_its_best_line() -> None:
    """A decisive line is preferred to a log, then the earlier phase to the later."""
    twice = import_signature(phases=(Phase.IMPORT, Phase.SINGLE))
    logged = Evidence(phase=Phase.IMPORT, logs=("it broke in a log",))
    told = Evidence(phase=Phase.SINGLE, reasons=("it broke in so many words",))
    (seen,) = diagnose([twice], [logged, told], Around())
    assert (seen.phase, seen.seen) == (Phase.SINGLE, "it broke in so many words")


class TestSilent:
    """Failures that raise nothing."""

    TEXT = """
    [[signature]]
    id = "quietly"
    silent = true
    packages = ["physics==2"]
    cause = "It computes other numbers."
    remedy = { requirements = ["physics>2"] }
    """

    def test_silent_issues_are_recognised_by_installed_versions(self) -> None:
        """A silent issue needs an installed package in a version that fits."""
        known = signatures.read({"silent.toml": textwrap.dedent(self.TEXT)})

        assert [one.id for one in matching.lurking(known, Around(installed={"physics": "2"}))] == ["quietly"]
        assert matching.lurking(known, Around(installed={"physics": "3"})) == ()
        assert matching.lurking(known, Around(requirements=("other",))) == ()

    def test_they_never_explain_evidence(self) -> None:
        """Silent signatures explain no evidence, whatever its text."""
        known = signatures.read({"silent.toml": textwrap.dedent(self.TEXT)})

        assert diagnose(known, [Evidence(phase=None, reasons=("anything",))], Around(installed={"physics": "2"})) == ()

    def test_examples_without_a_pattern_are_refused(self) -> None:
        """Nothing is written that they could be of."""
        text = textwrap.dedent(self.TEXT).replace("silent", "examples = ['x']\nsilent")
        with pytest.raises(BadInput, match='"quietly" is silent and has no "pattern": nothing is written'):
            signatures.read({"silent.toml": text})

    def test_a_finding_may_tell_of_it_too(self) -> None:
        """With a pattern it explains evidence as well, and is the same known issue."""
        text = textwrap.dedent(self.TEXT).replace("silent", "pattern = 'off by'\nexamples = [EXAMPLES]\nsilent")
        text = text.replace("EXAMPLES", "'off by 1', 'off by 2', 'off by 3'")
        known = signatures.read({"silent.toml": text})
        around = Around(installed={"physics": "2"})

        assert [one.id for one in matching.lurking(known, around)] == ["quietly"]
        seen = diagnose(known, [Evidence(phase=Phase.SINGLE, reasons=("off by 7",))], around)
        assert [one.signature.id for one in seen] == ["quietly"]

    def test_only_a_silent_one_is_scoped(self) -> None:
        """Environments, APIs and a check that refutes it are of one that no evidence tells of."""
        text = textwrap.dedent(self.TEXT).replace("silent = true", "envs = ['Ant-*']")
        with pytest.raises(BadInput, match='"quietly" has "envs", which only a silent one has'):
            signatures.read({"silent.toml": text})

    def test_a_former_id_is_nobody_elses(self) -> None:
        """It is still found by it, so that no other one may have it."""
        text = textwrap.dedent(self.TEXT)
        other = text.replace('"quietly"', '"loudly"').replace("silent", "formerly = ['quietly']\nsilent")
        with pytest.raises(BadInput, match=r'"quietly" is listed twice, first in a\.toml'):
            signatures.read({"a.toml": text, "b.toml": other})


def test_a_mask_that_is_only_mentioned_is_none() -> None:
    """A notice in a log is no mask if an exception says why; of an installer, whose errors are only logged, it is."""
    mask = [import_signature(masks=True, phases=(Phase.INSTALL, Phase.IMPORT))]
    logs = ("a notice that it broke",)

    assert fitting_ids(mask, Evidence(phase=Phase.IMPORT, reasons=("ValueError",), logs=logs)) == []
    assert fitting_ids(mask, Evidence(phase=Phase.IMPORT, reasons=logs)) == ["it"]
    assert fitting_ids(mask, Evidence(phase=Phase.INSTALL, reasons=("error",), logs=logs)) == ["it"]
