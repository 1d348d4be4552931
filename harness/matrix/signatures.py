"""Read signatures: patterns over evidence that name a cause and a remedy. `standalone/failures` matches them.

A file of them (`signatures/FAMILY.toml`) is read by `read`. Their patterns are regular expressions that a browser
understands as well as Python does: searched with `^` and `$` at every line, `.` never a line break.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, Struct, field
from msgspec.structs import asdict

from harness.matrix.matrix_types import Table
from harness.model import Change, Observation, Phase, decoding
from harness.model.errors import BadInput
from harness.model.schema import load_toml, locate_errors
from harness.model.vocabulary import Api, Checked, Label, Pattern, Requirement, Word, check_specifier
from harness.model.words import contains, refusal, sentence_pattern

ESCAPED = r"\\[\s\S]"
CLASS = r"\[[^\]]+\]"
PYTHONS_ESCAPE = re.compile(r"\\(?:[AZaU]|N\{)")
UNPORTABLE = (
    (r"\(\?P", "a named group"),
    (r"\(\?<", "a lookbehind or a named group"),
    (r"\(\?[aiLmsux-]", "an inline flag; `[\\s\\S]` is any character, `[Ee]` both cases"),
    (r"\(\?\(", "a conditional group"),
    (r"\(\?>", "an atomic group"),
    (r"\(\?#", "a comment"),
    (r"[*+?}]\+", "a possessive quantifier"),
    (r"\[\^?\]", "a class that begins with `]`; write `\\]`"),
)
"""What Python's regular expressions have and a browser's have not, or in which the two mean something else."""


class PortablePattern(Word):
    """A regular expression that means the same in Python and in a browser, searched line by line in the evidence."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the text itself, once it compiles and has nothing that is Python's alone."""
        compiled = Pattern.compiled(text, re.MULTILINE)
        # Escaped backslashes go first: the `\Z` in `C:\\Zone` is no escape.
        foreign = PYTHONS_ESCAPE.search(text.replace("\\\\", ""))
        plain = re.sub(ESCAPED, "e", text)
        fault = next((what for syntax, what in UNPORTABLE if re.search(syntax, _searched(syntax, plain))), None)
        if foreign:
            fault = f'the escape "{foreign[0]}"; `^` and `$` are the ends of a line'
        if fault:
            message = f'"{text}" has what a browser does not know: {fault}'
            raise ValueError(message)
        if compiled.search(""):
            message = f'"{text}" matches the empty text, and so everything'
            raise ValueError(message)
        return text


def _searched(syntax: str, plain: str) -> str:
    """Return a pattern without its classes, where signs have no meaning, unless the search is for classes."""
    return plain if syntax.startswith(r"\[") else re.sub(CLASS, "c", plain)


class Specifier(Word):
    """Versions of Python, such as `>=3.10,<3.12`."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the text itself, once it parses."""
        check_specifier(text, ">=3.8,<3.12")
        return text


EXAMPLES = 3
UNSHOWN = frozenset({"code", "data", "examples", "verified_on"})
"""Fields of a known failure that are neither matched in texts nor shown."""


class PartTaking(tuple[str, ...], metaclass=Checked):
    """A requirement, or several of which one must be met."""

    reads: ClassVar[tuple[Any, ...]] = (Requirement, Annotated[tuple[Requirement, ...], Meta(min_length=2)])

    @classmethod
    def parse(cls, plain: Any, convert: Any) -> tuple[str, ...]:
        """Return what either form stands for."""
        alternatives: tuple[str, ...] = (
            convert(plain, cls.reads[1]) if isinstance(plain, list) else (convert(plain, Requirement),)
        )
        return alternatives


class Ties(tuple[str, ...], metaclass=Checked):
    """Words that tie a text to a signature: expressions, or one of two words for a rule."""

    reads: ClassVar[tuple[Any, ...]] = (
        Literal["line", "packages"],
        Annotated[tuple[PortablePattern, ...], Meta(min_length=1)],
    )

    @classmethod
    def parse(cls, plain: Any, convert: Any) -> tuple[str, ...]:
        """Return what either form stands for."""
        rule: tuple[str, ...] = (convert(plain, cls.reads[0]),) if isinstance(plain, str) else ()
        words: tuple[str, ...] = rule or convert(plain, cls.reads[1])
        return words


class RemedyTable(Change, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The remedy of a failure: keys of a matrix's `[[change]]`, and `text` for what no machine can do."""

    text: Annotated[str, Meta(description="what to do that no machine can")] = ""

    @property
    def change(self) -> Change | None:
        """Return the part of the remedy that a machine can apply; None if there is none."""
        return decoding.convert(self, Change, attributes=True) or None


class VerifiedTable(Table, frozen=True, kw_only=True):
    """One occasion on which the failure was seen here, with real packages."""

    on: Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$", description="a date")]
    what: Annotated[str, Meta(min_length=1, description="what was run: versions, Python, platform")]


class Signature(Table, frozen=True, kw_only=True):
    """A known failure: how to recognise it, its cause, and its remedy."""

    id: Label
    cause: Annotated[str, Meta(min_length=1)]
    remedy: RemedyTable
    phases: Annotated[
        tuple[Phase, ...], Meta(description="where it shows; without any it is a trouble of the machine, in any phase")
    ] = ()
    pattern: PortablePattern | None = None
    ties: Annotated[
        Ties,
        Meta(
            description="words of which a text must have one for this cause to be named: its line is a common one;"
            " `line`: the line alone is enough; `packages`: each of them has to be named [packages]"
        ),
    ] = Ties()
    code: Annotated[
        str | Annotated[tuple[str, ...], Meta(min_length=2)] | None,
        Meta(description="what a check observes, or one of several; a pattern fits what libraries print"),
    ] = None
    data: Annotated[
        dict[str, Any], Meta(description="of such an observation: expressions for whole values, or tables of them")
    ] = field(default_factory=dict)
    signal: Annotated[str, Meta(pattern="^SIG[A-Z]+$", description="what killed the process")] | None = None
    packages: Annotated[
        tuple[PartTaking, ...],
        Meta(description="that take part: each, or one of each list, is installed in a version that fits"),
    ] = ()
    python: Specifier | None = None
    masks: Annotated[bool, Meta(description="it hides another failure, which goes before it")] = False
    generic: Annotated[bool, Meta(description="broad: what is specific goes before it, and its packages are there")] = (
        False
    )
    silent: Annotated[
        bool, Meta(description="no error is raised: the installed packages show it, also in results that work")
    ] = False
    envs: Annotated[
        tuple[Annotated[str, Meta(min_length=1)], ...],
        Meta(description="what ids of environments a silent one speaks of: `Fetch*-v3`; `!Ant-*` leaves some out"),
    ] = ()
    apis: Annotated[tuple[Api, ...], Meta(description="for a silent one: its APIs; default: all")] = ()
    opengl: Annotated[bool, Meta(description="for a silent one: it shows only in pictures drawn by OpenGL")] = False
    check: (
        Annotated[
            str,
            Meta(
                pattern=r"^[a-z]+(\.[a-z_0-9]+)+$", description="for a silent one: the check that shows or refutes it"
            ),
        ]
        | None
    ) = None
    formerly: Annotated[tuple[Label, ...], Meta(description="earlier ids, which still find it")] = ()
    references: tuple[str, ...] = ()
    examples: Annotated[
        tuple[str, ...],
        Meta(description="texts that it matches, of other paths, lines and versions; a silent one has none"),
    ] = ()
    verified_on: tuple[VerifiedTable, ...] = ()

    @property
    def loud(self) -> bool:
        """Return whether it has a pattern, code or signal by which it can be recognised."""
        return bool(self.pattern or self.code or self.signal)

    @property
    def wording(self) -> str | None:
        """Return the pattern for texts alone: its own, and that of our sentences for its codes; None without any."""
        ours = (sentence_pattern(code, self.data) for code in self.codes)
        return "|".join(filter(None, [self.pattern, *ours])) or None

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the codes of observations in which it shows."""
        return (self.code,) if isinstance(self.code, str) else self.code or ()

    def observes(self, observed: Observation) -> bool:
        """Return whether an observation has one of its codes and fits its data."""
        return any(contains(code, self.data, observed) for code in self.codes)

    @property
    def as_file(self) -> dict[str, Any]:
        """Return its file's fields that are matched in texts or shown; examples and sightings are left out."""
        fields = asdict(self) | {
            "remedy": self.remedy.plain,
            "pattern": self.wording,
            "packages": [each if len(each) > 1 else each[0] for each in self.packages],
        }
        return {name: value for name, value in fields.items() if value and name not in UNSHOWN}


class SignaturesFile(Table, frozen=True, kw_only=True):
    """Known failures of one family of packages: `signatures/FAMILY.toml`."""

    signature: Annotated[tuple[Signature, ...], Meta(min_length=1)]


def read(texts: Mapping[str, str]) -> tuple[Signature, ...]:
    """Return the signatures of files, given as texts by the names that messages use. Raises BadInput."""
    files_by_id: dict[str, str] = {}
    signatures: list[Signature] = []
    for file, text in texts.items():
        for index, signature in enumerate(load_toml(text, SignaturesFile, file).signature):
            with locate_errors(file, "signature", index):
                _check(signature)
            # A former id still finds its failure, so no other one may have it.
            for name in (signature.id, *signature.formerly):
                if name in files_by_id:
                    message = f'{file}: signature[{index}].id: "{name}" is listed twice, first in {files_by_id[name]}'
                    raise BadInput(message)
                files_by_id[name] = file
            signatures.append(signature)
    return tuple(signatures)


def _check(signature: Signature) -> None:
    refused = (refusal(code, signature.data) for code in signature.codes or (None,))
    message = next((why for why in refused if why), None) or _check_silent(signature)
    if message or (signature.silent and not signature.loud):
        pass
    elif len(signature.examples) < EXAMPLES:
        message = f'"{signature.id}" has too few examples: {EXAMPLES} texts at least that differ'
    elif not signature.loud:
        message = f'"{signature.id}" has neither a "pattern", a "code" nor a "signal", and so could be anything'
    elif signature.generic and not (signature.packages or signature.masks):
        message = f'"{signature.id}" is generic, and so has to name its "packages"'
    elif not signature.remedy.plain:
        message = f'"{signature.id}" has an empty remedy; say in words ("text") what can be done, or that nothing can'
    if message:
        raise ValueError(message)
    # The expressions in `data` are part of the wording, which a browser searches as well.
    if signature.code:
        PortablePattern.canonical(signature.wording or "")


def _check_silent(signature: Signature) -> str | None:
    scoped = [name for name in ("envs", "apis", "opengl", "check") if getattr(signature, name)]
    if not signature.silent:
        return f'"{signature.id}" has "{scoped[0]}", which only a silent one has' if scoped else None
    if not signature.packages:
        return f'"{signature.id}" is silent, and so has to name its "packages"'
    if signature.examples and not signature.loud:
        return f'"{signature.id}" is silent and has no "pattern": nothing is written that its "examples" could be of'
    return None


class Sighting(Struct, frozen=True, kw_only=True):
    """An observation with the line that it stands in; `is_reason` marks a line that says why something failed."""

    observed: Observation
    line: str
    is_reason: bool
