"""Compiled equations with outputs prescribed: the equations of every instant, with exact derivatives.

An output is differentiated along the motion until an input appears in it (its relative degree): by power series in time of the compiled
right-hand side, x_(k+1) = f_k/(k+1), so that each order costs one pass over the graph, at all instants at once. The unknowns of an instant are
states, unknowns of loops, and one strength for each input or pair; equations are all derivatives up to that order, residuals of loops, residuals
of loop joints. If their numbers are equal, the outputs determine everything (they are flat); otherwise internal dynamics remain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, Expression, Leaf, Number, Symbol, TaylorSeries, call, select, substitute, symbols

from ...errors import UsageError
from ..operating_point import OperatingPoint

STRENGTH = "strength"  # the role of the unknown behind an input or a pair
MOVING = frozenset({"state", "time", STRENGTH})
PROBE = 1e-3  # of the natural size of an input: value at which the derivative of a square is evaluated instead of zero


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Residuals and derivatives at N instants.

    `missed` (N, rows): residuals of the equations, `jacobian` (N, rows, columns): their derivatives; `rates` (N, n) of the states with theirs,
    (N, n, columns).
    """

    missed: Any
    jacobian: Any
    rates: Any
    rate_slopes: Any


class InversionEquations:
    """Equations with outputs prescribed. `degrees`: relative degree of each output. Columns are states, unknowns, strengths."""

    def __init__(self, point: OperatingPoint, outputs: Sequence[str], drives: Sequence[Drive]) -> None:
        self.point, self.outputs, self.drives = point, tuple(outputs), tuple(drives)
        lowered, self.count, self.all = point.lowered, point.count, point.all
        put = _replaced(point, drives)
        rates = [substitute(x, put) for x in lowered.rates]
        seen = [substitute(lowered.outputs[name], put) for name in outputs]
        taking = point.constraints.taking if point.constraints else np.zeros(0, dtype=bool)
        gaps = point.constraints.gaps
        rows = [i for i in range(len(lowered.invariants)) if i >= gaps or taking[i]]
        if len(taking) and not taking.all():
            kept = {int(r) for r in point.constraints.taking_rates + gaps}
            rows = [i for i in rows if i < gaps or i in kept]
        held = [substitute(lowered.invariants[i], put) for i in rows]
        self.held = len(held)
        reads, loops = [_leaves_of(rate) for rate in rates], [u.loop for u in lowered.space.unknowns]
        self.degrees = tuple(_degree(name, x, reads, loops) for name, x in zip(outputs, seen, strict=True))
        self.series = TaylorSeries([*rates, *seen, *held], MOVING)
        self.columns = self.all + len(drives)
        self.rows = sum(d + 1 for d in self.degrees) + (self.all - self.count) + self.held
        if self.free < 0:
            raise UsageError("BR325", f"the inputs cannot move {together(self.outputs, self.degrees)}")
        program = point.program
        self.units = (*program.states.units, *program.unknowns.units, *(f"drive {i}" for i in range(len(drives))))

    @property
    def free(self) -> int:
        """Number of coordinates of the internal dynamics."""
        return self.columns - self.rows

    def __call__(self, times: Array, unknowns: Array, wanted: Array) -> Evaluated:
        """Evaluate at instants (N,), `unknowns` (columns, N), `wanted` (outputs, highest degree + 1, N)."""
        with np.errstate(all="ignore"):
            return self._evaluated(times, unknowns, wanted)

    def _evaluated(self, times: Array, unknowns: Array, wanted: Array) -> Evaluated:
        n, size, width, count = self.count, self.all, self.columns, len(times)
        expansion = self.series.expand(self._leaves(times, unknowns))
        outputs = range(size, size + len(self.outputs))
        rows: list[Any] = []
        derivatives: list[list[Any]] = [[] for _ in self.outputs]
        rates = [filled(expansion[i], width, count) for i in range(n)]
        loops = [filled(expansion[i], width, count) for i in range(n, size)]
        rows += [*loops, *(filled(expansion[size + len(self.outputs) + i], width, count) for i in range(self.held))]
        slopes = np.stack([g[1:][n:size] for g in loops]) if loops else None  # residuals by unknowns, (m, m, N)
        for k in range(max(self.degrees) + 1):
            if k:
                self._advance(expansion, k, slopes, width, count)
            for row, place in enumerate(outputs):
                if k <= self.degrees[row]:
                    found = math.factorial(k) * filled(expansion[place], width, count)
                    found[0] -= wanted[row, k]
                    derivatives[row].append(found)
        stacked = np.stack([*(d for some in derivatives for d in some), *rows])
        flowing = np.stack(rates) if rates else np.zeros((0, 1 + width, count))
        return Evaluated(
            stacked[:, 0].T, np.moveaxis(stacked[:, 1:], -1, 0), flowing[:, 0].T, np.moveaxis(flowing[:, 1:], -1, 0)
        )

    def _advance(self, expansion: Any, k: int, slopes: Array | None, width: int, count: int) -> None:
        """Advance the series to order k. The unknowns' coefficients follow from the residuals without them: values first, then derivatives."""
        n, size = self.count, self.all
        given: dict[Leaf, Any] = {Leaf("time", 0): np.ones((1, 1)) if k == 1 else None}
        for i in range(n):
            rate = expansion[i]
            given[Leaf("state", i)] = None if rate is None else rate / k
        expansion.advance(given)
        if slopes is None:
            return
        matrix = np.moveaxis(slopes, -1, 0)
        found = np.zeros((size - n, 1 + width, count))
        for rows in (slice(0, 1), slice(1, None)):
            left = np.stack([filled(expansion[i], width, count) for i in range(n, size)])[:, rows]
            found[:, rows] = -np.moveaxis(_solved(matrix, np.moveaxis(left, -1, 0)), 0, -1)
            expansion.back()
            expansion.advance(given | {Leaf("state", n + j): found[j] for j in range(size - n)})

    def _leaves(self, times: Array, unknowns: Array) -> dict[Leaf, Any]:
        point, width, count = self.point, self.columns, len(times)
        given: dict[Leaf, Any] = {Leaf("time", 0): np.asarray(times, dtype=float)[None]}
        for role, values in (
            ("parameter", point.constraints.parameters), ("input", point.inputs), ("mode", np.atleast_1d(point.mode)),
        ):  # fmt: skip
            given |= {Leaf(role, i): np.array([[float(v)]]) for i, v in enumerate(values)}
        for i in range(width):
            leaf = Leaf("state", i) if i < self.all else Leaf(STRENGTH, i - self.all)
            full = np.zeros((1 + width, count))
            full[0], full[1 + i] = unknowns[i], 1.0
            given[leaf] = full
        return given


def together(outputs: Sequence[str], degrees: Sequence[int]) -> str:
    """Return the words for outputs that the inputs cannot move independently."""
    names, orders = ", ".join(f"`{n}`" for n in outputs), ", ".join(map(str, degrees))
    return (
        f"{names} apart from one another: differentiated {orders} times, as often as it takes for an input to show, "
        "they move with the same of the inputs, or say the same"
    )


def filled(coefficient: Array | None, width: int, count: int) -> Any:
    """Return a coefficient with all directions and instants, (1 + width, count)."""
    full = np.zeros((1 + width, count))
    if coefficient is not None:
        full[: len(coefficient)] = coefficient
    return full


def _solved(matrix: Array, right: Array) -> Any:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.full(right.shape, math.nan)


def _replaced(point: OperatingPoint, drives: Sequence[Drive]) -> Any:
    """Return the inputs as functions of strengths: for a pair whose force is proportional to the square, the root on the active side."""
    known: dict[Symbol, Expression] = {}
    for i, drive in enumerate(drives):
        strength = Symbol(Leaf(STRENGTH, i))
        for name, forward in ((drive.push, True), (drive.pull, False)):
            if name is None:
                continue
            role, place = point.set_at(name)
            known[Symbol(Leaf(role, place))] = _value_of(strength, drive, forward)
    return lambda symbol: known.get(symbol, symbol)


def _value_of(strength: Symbol, drive: Drive, forward: bool) -> Expression:
    if drive.pull is None:
        return strength if drive.power == 1 else call("sqrt", call("abs", strength))
    one, zero = Number(1.0), Number(0.0)
    on = call("less_equal", zero, strength) if forward else call("less", strength, zero)
    size = call("abs", strength)
    return (call("sqrt", size) if drive.power == 2 else size) * select(on, one, zero)


def _degree(name: str, output: Expression, reads: Sequence[set[Leaf]], loops: Sequence[int]) -> int:
    """Return the relative degree of an output: the number of differentiations until an input may appear. Raises `UsageError` if none ever does.

    `reads`: the leaves of the rates, then of the residuals; `loops`: index of the loop of each unknown.
    """
    now, seen, degree = _behind(_leaves_of(output), reads, loops), set[Leaf](), 0
    while not any(leaf.role == STRENGTH for leaf in now):
        states = {leaf for leaf in now if leaf.role == "state"} - seen
        if not states:
            raise UsageError("BR308", f"none of the inputs has an effect on `{name}`, however often it is differentiated")  # fmt: skip
        seen |= states
        now = _behind({leaf for s in states for leaf in reads[s.position]}, reads, loops)
        degree += 1
    return degree


def _behind(leaves: set[Leaf], reads: Sequence[set[Leaf]], loops: Sequence[int]) -> set[Leaf]:
    """Return the leaves with unknowns replaced by all leaves that the residuals of their loops read."""
    count, found, waiting, opened = len(reads) - len(loops), set[Leaf](), list(leaves), set[int]()
    while waiting:
        leaf = waiting.pop()
        if leaf.role != "state" or leaf.position < count:
            found.add(leaf)
        elif (loop := loops[leaf.position - count]) not in opened:
            opened.add(loop)
            waiting += [x for i, other in enumerate(loops) if other == loop for x in reads[count + i]]
    return found


def _leaves_of(x: Expression) -> set[Leaf]:
    return {symbol.key for symbol in symbols(x)}


@dataclass(frozen=True, slots=True)
class Drive:
    """One unknown: an input, or two inputs with one of them zero. `power` 2: the unknown is the square of the input.

    A single input of power 2 is positive: its negative would have the same effect.
    """

    push: str
    pull: str | None
    power: int = 1

    def settings(self, strength: float) -> dict[str, float]:
        """Return the values of the inputs."""
        size = math.sqrt(abs(strength)) if self.power == 2 else abs(strength)
        if self.pull is None:
            return {self.push: strength if self.power == 1 else math.copysign(size, strength)}
        return {self.push: size, self.pull: 0.0} if strength >= 0 else {self.push: 0.0, self.pull: size}

    def slope(self, strength: float, columns: Mapping[str, Any]) -> Any:
        """Return the derivative by the unknown, from the derivatives by the inputs."""
        if self.pull is None and self.power == 1:
            return columns[self.push]
        if self.pull is None:
            return columns[self.push] / (2 * math.sqrt(abs(strength)))
        column = columns[self.push] if strength >= 0 else -columns[self.pull]
        return column / (2 * math.sqrt(abs(strength))) if self.power == 2 else column


def drives_of(names: Sequence[str]) -> tuple[Drive, ...]:
    """Return the drives of names such as `push1/pull1` (a pair) or `fx` (a single input)."""
    return tuple(Drive(push.strip(), pull.strip() or None) for push, _, pull in (n.partition("/") for n in names))
