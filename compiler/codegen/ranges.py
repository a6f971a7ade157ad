"""Values and ranges over boxes of functions of time and of indicators of conditions, with the one table of `algebra/intervals.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .program import LEAVES, TimeFunctions

if TYPE_CHECKING:
    from ..algebra.intervals import Interval


class Ranges:
    """Some of the functions of time of a program in one run: their values at instants, and their ranges over boxes.

    Operations that depend on neither time nor conditions are computed once; `order` has the other ones, operands first.
    """

    def __init__(self, functions: TimeFunctions, roots: Sequence[int], constants: Any, inputs: Any = ()) -> None:
        from ..algebra import intervals

        self.table, self.plain, self.is_still = intervals.TABLE, intervals.plain, intervals.is_still
        self.everything = intervals.EVERYTHING
        self.nodes, self.roots = functions.nodes, tuple(roots)
        self.given: dict[str, Any] = {"constant": constants, "input": inputs}
        self.fixed: dict[int, float] = {}
        self.order = self._moving(functions.needed(self.roots))
        self.curves = {i: curve for i in self.order if (curve := self._curve(i)) is not None}
        self.states = sorted({self.nodes[i][1][0] for i in self.order if self.nodes[i][0] == "state"})
        self.moded = any(self.nodes[i][0] == "mode" for i in self.order)  # whether one of them depends on conditions

    def _moving(self, needed: list[int]) -> list[int]:
        """Return the operations that move; compute all others."""
        moving = []
        with np.errstate(all="ignore"):
            for number in needed:
                operator, operands = self.nodes[number]
                if operator == "number":
                    self.fixed[number] = float(operands[0])
                elif operator in self.given:
                    self.fixed[number] = float(self.given[operator][operands[0]])
                elif operator in LEAVES or not all(o in self.fixed for o in operands):
                    moving.append(number)
                else:
                    self.fixed[number] = float(self.plain(operator, [self.fixed[o] for o in operands]))
        return moving

    def _curve(self, number: int) -> Any | None:
        """Return the curve of an operation whose points are fixed; None for any other operation."""
        operator, operands = self.nodes[number]
        if operator not in ("linear", "cubic", "monotone") or not all(o in self.fixed for o in operands[2:]):
            return None
        from ..algebra.curves import curve

        return curve(operator, int(self.fixed[operands[0]]), tuple(self.fixed[o] for o in operands[2:]))

    @property
    def unbounded(self) -> bool:
        """True if the table has no range for one of the operations."""
        return any(self.nodes[i][0] not in self.table and self.nodes[i][0] not in LEAVES for i in self.order)

    def values(self, times: Any, mode: Any, states: Any = None) -> list[Any]:
        """Values of the roots at instants, arrays (instants,) or numbers. `mode`: (size,) or (instants, size); `states`: (instants, n)."""
        known: dict[int, Any] = {}
        fixed = self.fixed
        for number in self.order:
            operator, operands = self.nodes[number]
            if operator == "time":
                known[number] = times
            elif operator == "mode":
                known[number] = mode[..., operands[0]]
            elif operator == "state":
                known[number] = states[..., operands[0]]
            elif number in self.curves:
                known[number] = self.curves[number].values(known[operands[1]])
            else:
                known[number] = self.plain(operator, [fixed[o] if o in fixed else known[o] for o in operands])
        return [fixed[root] if root in fixed else known[root] for root in self.roots]

    def over(self, low: Any, high: Any, mode: Any, states: Any = None) -> list[Interval]:
        """Ranges of the roots over boxes. `mode`: (size,) or (boxes, size); `states`: their ranges by number, each two arrays (boxes,)."""
        known: dict[int, Any] = {}
        fixed = self.fixed

        def ends(number: int) -> Interval:
            return (fixed[number], fixed[number]) if number in fixed else known[number]

        for number in self.order:
            operator, operands = self.nodes[number]
            if operator == "time":
                known[number] = low, high
            elif operator == "mode":
                known[number] = (mode[..., operands[0]],) * 2
            elif operator == "state":
                known[number] = states[operands[0]]
            elif number in self.curves:
                known[number] = self.curves[number].over(*known[operands[1]])
            else:
                known[number] = self._range(operator, [ends(o) for o in operands])
        return [ends(root) for root in self.roots]

    def _range(self, operator: str, operands: list[Interval]) -> Interval:
        if all(map(self.is_still, operands)):
            value = float(self.plain(operator, [x[0] for x in operands]))
            return value, value
        return self.table[operator](*operands) if operator in self.table else self.everything
