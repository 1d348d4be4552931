"""Reading what a release offers from its files."""

from __future__ import annotations

from pathlib import Path

from harness.history.release_reader import read


def test_names_are_read_without_running_anything(tmp_path: Path) -> None:
    """Names imported from elsewhere in the package are offered, those of other packages and private ones are not."""
    package = tmp_path / "toy"
    package.mkdir()
    (package / "__init__.py").write_text("import os\nfrom toy.core import Env\nraise SystemExit('was run')\n")
    (package / "core.py").write_text(
        "class Env:\n    def reset(self, *, seed=None, **options):\n        pass\n\n    def _own(self):\n        pass\n"
    )
    (tmp_path / "toy-1.0.dist-info").mkdir()
    (tmp_path / "toy-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: toy\nVersion: 1.0\nRequires-Dist: numpy>=1.2\nProvides-Extra: all\n\n"
    )
    facts = read(tmp_path)
    assert facts.modules == ("toy", "toy.core")
    assert facts.names["toy"] == ("Env", "core")
    assert facts.members["toy.core.Env"] == ("reset",)
    assert facts.signatures["toy.core.Env.reset"] == "self, *, seed=, **options"
    assert (facts.requires, facts.extras) == (("numpy>=1.2",), ("all",))
