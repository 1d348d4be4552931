"""Faults inside a probe's own process: what a healthy package replaces, what a liar does."""

from __future__ import annotations

from benchmarks.faults import Desk, FaultResult, fault

SECTION = "hostile probes"
QUICK = ("import", "single")

HEALTHY = {
    "51": ("json.dumps returns bytes, as fast encoders do", "json.dumps = lambda value, **_: b'{}'"),
    "51b": (
        "json.JSONEncoder and its parts are replaced",
        "import json.encoder; json.encoder.encode_basestring_ascii = json.encoder.c_make_encoder = None; "
        "json.JSONEncoder = json.encoder.JSONEncoder = dict",
    ),
    "52": ("os.getpid is replaced", "os.getpid = lambda: 1"),
    "52b": ("time.monotonic and time.time stand still", "time.monotonic = time.time = lambda: 0.0"),
    "52c": ("gc.collect and importlib.import_module are replaced", "import gc, importlib; gc.collect = lambda *_: 0"),
    "52d": ("signal.setitimer and os.fstat are replaced", "import signal; signal.setitimer = lambda *_: None"),
    "52e": ("os.write does nothing", "os.write = lambda descriptor, data: len(data)"),
}
"""Row: what a package that does no wrong replaces, and how."""


def declare() -> None:
    """Declare a fault for each of them."""
    for row, (done, deed) in HEALTHY.items():

        def replacing(desk: Desk, deed: str = deed) -> FaultResult:
            """Replace something of the standard library."""
            matrix = desk.hostile(top=deed, checks=QUICK)
            return desk.check_verdicts(desk.measure(matrix, "-k", "*hx"), hx={"works"})

        replacing.__name__ = f"replacing_{row}"
        fault(row, section=SECTION, done=f"a healthy package: {done}", promise="it works", limit=200)(replacing)


declare()

OURS = "ours = {name.rpartition('.')[2]: module for name, module in sys.modules.items() if '_simmatrix_cell' in name}\n"


@fault(
    "33c",
    section=SECTION,
    done="a package replaces a check of ours in its process by one that always passes",
    promise="a finding says so: the same process cannot be kept from it",
    limit=200,
)
def replaced_check(desk: Desk) -> FaultResult:
    """Put a function in the place of ours, without hiding it."""
    deed = OURS + "ours['cell_run'].Probe._function = lambda self, check: lambda *_: None"
    matrix = desk.hostile(top=deed, checks=QUICK)
    ran = desk.measure(matrix, "-k", "*hx")
    came = desk.check_verdicts(ran, hx={"works", "broken", "inconclusive", "partial"})
    findings = [
        text["text"] for cell in ran.document["cells"] for text in cell["findings"] if ".replaced" in text["check"]
    ]
    return FaultResult(f"{came.what}; {'; '.join(findings) or 'no finding'}", came.held and bool(findings))


@fault(
    "34c",
    section=SECTION,
    done="a package replaces os.write and json.dumps, to turn its failure into a pass",
    promise="broken: what is written goes past them",
    limit=200,
)
def replaced_writers(desk: Desk) -> FaultResult:
    """Turn what is written."""
    top = """
        wrote, dumped = os.write, json.dumps
        os.write = lambda descriptor, data: wrote(descriptor, data.replace(b'"failed"', b'"passed"'))
        json.dumps = lambda value, **named: dumped(value, **named).replace('"failed"', '"passed"')
        """
    matrix = desk.hostile(top=top, step="raise ValueError('wrong')", checks=QUICK)
    return desk.check_verdicts(desk.measure(matrix, "-k", "*hx"), hx={"broken"})


@fault(
    "53b",
    section=SECTION,
    done="a package drops the harness's modules from sys.modules",
    promise="works or inconclusive, never red",
    limit=200,
)
def dropped_modules(desk: Desk) -> FaultResult:
    """Drop what is loaded of ours."""
    top = "for name in [name for name in sys.modules if name.startswith('_simmatrix')]: del sys.modules[name]"
    return desk.check_verdicts(
        desk.measure(desk.hostile(top=top, checks=QUICK), "-k", "*hx"), hx={"works", "inconclusive"}
    )
