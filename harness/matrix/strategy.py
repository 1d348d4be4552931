"""Define the strategy of a matrix as its file has it: the choice of combinations to plan."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from typing import Annotated, Any, ClassVar, Literal, Self

from msgspec import Meta, Struct

StrategyName = Literal["full", "pairwise", "baseline", "boundaries", "listed"]


class StrategyTable(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A strategy with its own numbers and values; a table with both keys is the union of the two."""

    ways: Annotated[
        Annotated[int, Meta(ge=1)] | None,
        Meta(description="every combination of values of this many axes is in some cell"),
    ] = None
    baseline: Annotated[
        dict[str, str] | None,
        Meta(description="axis to the value kept while another axis varies; default: newest version, first name"),
    ] = None


class Strategy:
    """The choice of combinations to plan: a name, a table, or a list of these, meaning their union."""

    __slots__ = ("baselines", "boundaries", "full", "names", "ways")
    reads: ClassVar[tuple[Any, ...]] = (
        StrategyName,
        StrategyTable,
        Annotated[tuple[StrategyName | StrategyTable, ...], Meta(min_length=1)],
    )

    def __init__(self, parts: Iterable[str | StrategyTable]) -> None:
        written = tuple(parts)
        tables = [part for part in written if isinstance(part, StrategyTable)]
        baselines = [table.baseline for table in tables if table.baseline is not None]
        self.full = "full" in written
        self.ways = max([table.ways or 0 for table in tables] + [2 * ("pairwise" in written)])
        self.baselines = (*([{}] if "baseline" in written else []), *baselines)
        self.boundaries = "boundaries" in written
        self.names = tuple(
            name
            for name, given in (
                ("baseline", self.baselines),
                ("boundaries", self.boundaries),
                ("listed", "listed" in written),
                ("pairwise" if self.ways == 2 else f"{self.ways}-way", self.ways),
            )
            if given
        )

    @classmethod
    def parse(cls, plain: Any, convert: Callable[[Any, Any], Any]) -> Self:
        """Return the strategy that any of the three forms stands for."""
        name, table, several = cls.reads
        if isinstance(plain, list):
            return cls(convert(plain, several))
        strategy = cls([convert(plain, table if isinstance(plain, dict) else name)])
        if not strategy.full and not strategy.names:
            message = 'an empty table is no strategy; write "ways" or "baseline"'
            raise ValueError(message)
        return strategy

    def with_values(self, canonical: Callable[[str, str], str]) -> Strategy:
        """Return the strategy with canonical baseline values; `canonical` takes axis and value."""
        strategy = copy(self)
        strategy.baselines = tuple(
            {axis: canonical(axis, text) for axis, text in each.items()} for each in self.baselines
        )
        return strategy

    @property
    def listed(self) -> bool:
        """Return whether only the combinations that the matrix includes one by one are planned."""
        return self.names == ("listed",) and not self.full

    @property
    def covering(self) -> int:
        """Return how many axes must be covered in every combination of values; 0 if nothing has to be computed."""
        return 0 if self.full else self.ways


FULL = Strategy(["full"])
