"""Values and ranges over boxes of the functions of time of a program, with the one table of `algebra/intervals.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .program import TimeFunctions

if TYPE_CHECKING:
    from ..algebra.intervals import Interval

LEAVES = frozenset({"number", "time", "constant", "input", "mode"})


class Ranges:
    """Functions of time of a program in one run: their values at instants, and their ranges over boxes."""

    def __init__(self, functions: TimeFunctions, roots: Sequence[int], constants: Any, inputs: Any = ()) -> None:
        from ..algebra import intervals

        self.table, self.plain, self.is_still = intervals.TABLE, intervals.plain, intervals.is_still
        self.everything = intervals.EVERYTHING
        self.nodes, self.roots = functions.nodes, tuple(roots)
        self.given: dict[str, Any] = {"constant": constants, "input": inputs}
        self.order = self._behind(self.roots)

    def _behind(self, roots: Sequence[int]) -> list[int]:
        """Nodes that some roots need, operands first, as they are stored."""
        needed, stack = set(roots), list(roots)
        while stack:
            operator, operands = self.nodes[stack.pop()]
            if operator not in LEAVES:
                more = set(operands) - needed
                needed |= more
                stack += more
        return sorted(needed)

    @property
    def unbounded(self) -> bool:
        """True if the table has no range for one of the operations."""
        return any(self.nodes[i][0] not in self.table and self.nodes[i][0] not in LEAVES for i in self.order)

    def values(self, times: Any, mode: Any) -> list[Any]:
        """Values of the roots at instants, arrays (instants,) or numbers. `mode`: (size,) or (instants, size)."""
        known: dict[int, Any] = {}
        for number in self.order:
            operator, operands = self.nodes[number]
            if operator == "time":
                known[number] = times
            elif operator in LEAVES:
                known[number] = self._leaf(operator, operands[0], mode)
            else:
                known[number] = self.plain(operator, [known[o] for o in operands])
        return [known[root] for root in self.roots]

    def over(self, low: Any, high: Any, mode: Any) -> list[Interval]:
        """Ranges of the roots over boxes. `mode`: (size,) or (boxes, size)."""
        known: dict[int, Any] = {}
        for number in self.order:
            operator, operands = self.nodes[number]
            if operator == "time":
                known[number] = low, high
            elif operator in LEAVES:
                known[number] = (self._leaf(operator, operands[0], mode),) * 2
            else:
                known[number] = self._range(operator, [known[o] for o in operands])
        return [known[root] for root in self.roots]

    def _leaf(self, operator: str, which: Any, mode: Any) -> Any:
        if operator == "number":
            return which
        return mode[..., which] if operator == "mode" else float(self.given[operator][which])

    def _range(self, operator: str, operands: list[Interval]) -> Interval:
        if all(map(self.is_still, operands)):
            value = float(self.plain(operator, [x[0] for x in operands]))
            return value, value
        return self.table[operator](*operands) if operator in self.table else self.everything
