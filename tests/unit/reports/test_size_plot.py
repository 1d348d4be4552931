"""Plots of changes in behaviour over releases."""

import matplotlib.font_manager  # noqa: F401 - its first import in a home asks a program for the fonts, not a test

from harness.model import replace
from harness.physics.relation import Class
from harness.reports import size_plot
from harness.reports.tables.family_tables import FamilyTable, ReleaseStep

ALIKE = ReleaseStep(kind=Class.ROUND_OFF)
TABLE = FamilyTable(
    axis="mujoco",
    where="",
    columns=("3.4.0", "3.5.0 to 3.6.0"),
    rows=(("Ant-v5", ("A", "B")),),
    measured=3,
    changed=1,
    tasks=1,
    releases=("3.4.0", "3.5.0", "3.6.0"),
    steps={
        "Ant-v5": (None, ReleaseStep(kind=Class.CHANGED, size=2.5e-3), ALIKE),
        "Swimmer-v5": (None, ReleaseStep(kind=Class.UNDECIDED, size=1e-9), ALIKE),
        "Hopper-v5": (None, ALIKE, ReleaseStep(kind=Class.IDENTICAL, starts_otherwise=True)),
    },
    coverage=(),
    picture="behaviour-1.svg",
)


def test_a_plot_names_environments_releases_and_sizes() -> None:
    """It is text that can be searched: each release, each environment, the power of ten, a dot for other starts."""
    text = size_plot.draw(TABLE).decode()
    for word in ("Ant-v5", "Hopper-v5", "3.4.0", "3.6.0", "release by release of mujoco", ">-3<", "●", ">?<"):
        assert word in text, word


def test_a_plot_is_the_same_bytes_each_time() -> None:
    """No date and no random name is in it."""
    assert size_plot.draw(TABLE) == size_plot.draw(TABLE)


def test_a_name_is_text_whatever_it_holds() -> None:
    """It is neither a formula nor markup."""
    odd = replace(TABLE, steps={"$a_$<b>": (None, ALIKE, ALIKE)})
    assert "$a_$&lt;b&gt;" in size_plot.draw(odd).decode()
