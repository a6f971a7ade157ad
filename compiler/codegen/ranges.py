"""Values and ranges over boxes of functions of time and of indicators of conditions, with the one table of `algebra/intervals.py`."""

from __future__ import annotations

from collections.abc import Sequence
from operator import mul
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algebra.systems import dense_count
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
        self.everything, self.eps = intervals.EVERYTHING, intervals.EPS
        self.nodes, self.roots = functions.nodes, tuple(roots)
        self.given: dict[str, Any] = {"constant": constants, "input": inputs}
        self.fixed: dict[int, float] = {}
        self.order = self._moving(functions.needed(self.roots))
        self.curves = {i: curve for i in self.order if (curve := self._curve(i)) is not None}
        self.inverses = {i: inverse for i in self.order if (inverse := self._inverse(i)) is not None}
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

    def _inverse(self, number: int) -> tuple[Any, Any] | None:
        """Return the inverse of the matrix of a system, and what rounding makes of its right sides, if the matrix is fixed; else None."""
        operator, operands = self.nodes[number]
        count = dense_count(len(operands))
        if operator != "solve" or not all(o in self.fixed for o in operands[: count * count]):
            return None
        matrix = np.array([self.fixed[o] for o in operands[: count * count]]).reshape(count, count)
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < count:
            return None
        inverse = np.linalg.inv(matrix)
        return inverse, count * np.abs(inverse) @ np.abs(matrix) @ np.abs(inverse)

    @property
    def unbounded(self) -> bool:
        """True if there is no range for one of the operations."""
        bounded = {*self.table, *LEAVES, *(("item",) if self.inverses else ())}
        return any(self.nodes[i][0] not in bounded and i not in self.inverses for i in self.order)

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
            elif number in self.inverses:
                inverse, _ = self.inverses[number]
                right = [fixed[o] if o in fixed else known[o] for o in operands[-len(inverse) :]]
                known[number] = [sum(map(mul, weights, right)) for weights in inverse.tolist()]
            elif operator == "item" and operands[0] in self.inverses:
                known[number] = known[operands[0]][int(fixed[operands[1]])]
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
            elif number in self.inverses:
                inverse, rounding = self.inverses[number]
                known[number] = self._solutions(inverse, rounding, [ends(o) for o in operands[-len(inverse) :]])
            elif operator == "item" and operands[0] in self.inverses:
                known[number] = known[operands[0]][int(fixed[operands[1]])]
            else:
                known[number] = self._range(operator, [ends(o) for o in operands])
        return [ends(root) for root in self.roots]

    def _solutions(self, inverse: Any, rounding: Any, right: list[Interval]) -> list[Interval]:
        """Return the ranges of the unknowns of a linear system with fixed coefficients."""
        add, multiply = self.table["add"], self.table["multiply"]
        sizes = [np.maximum(np.abs(low), np.abs(high)) for low, high in right]
        unknowns = []
        for weights, errors in zip(inverse.tolist(), rounding.tolist(), strict=True):
            low, high = add(*(multiply((w, w), x) for w, x in zip(weights, right, strict=True)))
            error = self.eps * sum(map(mul, errors, sizes))
            unknowns.append((low - error, high + error))
        return unknowns

    def _range(self, operator: str, operands: list[Interval]) -> Interval:
        if all(map(self.is_still, operands)):
            value = float(self.plain(operator, [x[0] for x in operands]))
            return value, value
        return self.table[operator](*operands) if operator in self.table else self.everything
