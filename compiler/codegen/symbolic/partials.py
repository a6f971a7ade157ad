"""Partial derivatives by forward accumulation over the single assignments: no assignment is substituted into another.

Each entry is an expression over variables, so that its size is that of one law times the slopes before it
(Griewank and Walther, Evaluating Derivatives, 2008, chapter 3).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from sympy import Basic

from ...algebra.expression import ONE, ZERO, Apply, Expression, Number, Symbol, add, multiply, substitute
from ...algebra.sympy_form import as_written
from ...algebra.systems import SYSTEMS, entries_of
from ...reduction import LinearLoop, StateSpace
from ...reduction.order import needed
from ..lower import loop_slopes, partial
from ..order import in_order
from .state_equations import Line, LinearSystem, Partials, SolvedEquation

Slopes = dict[int, dict[int, Expression]]  # variable -> column -> nonzero derivative, over variables
LARGE = 24  # operations from which on a nested expression gets a line of its own
SHARED = 3  # operations from which on an expression with several uses gets one


def partials(
    space: StateSpace, rows: Sequence[int], columns: Sequence[int], symbol: Callable[[int], Basic], fresh: Callable[[str], Basic]
) -> Partials:  # fmt: skip
    """Derivatives of the variables `rows` by the variables `columns`.

    `symbol` gives the sympy object of a variable, `fresh` a new symbol with about this name.
    """
    slopes = _accumulated(space, rows, columns)
    entries = {
        (row, column): slope
        for row, variable in enumerate(rows)
        for column, slope in sorted(slopes.get(variable, {}).items())
    }
    names: dict[Expression, str] = {
        slope: f"d({space.variables[v].name})/d({space.variables[columns[c]].name})"
        for v, by in slopes.items()
        for c, slope in by.items()
        if isinstance(slope, Apply)
    }
    return _Lines(symbol, fresh, names, lambda v: space.variables[v].name).written(entries)


def _accumulated(space: StateSpace, rows: Sequence[int], columns: Sequence[int]) -> Slopes:
    slopes: Slopes = {variable: {column: ONE} for column, variable in enumerate(columns)}
    wanted = needed(rows, space.inputs)
    for step in space.steps:
        if isinstance(step, LinearLoop):
            if wanted & {*step.targets}:
                matrix = [{j: _entry(e) for j, e in enumerate(row) if e != 0.0} for row in step.matrix]
                loop_slopes(step, matrix, [Symbol(t) for t in step.targets], slopes, None)
            continue
        if step.target not in wanted or step.target in slopes:
            continue
        terms: dict[int, list[Expression]] = {}
        for slot, argument in enumerate(step.arguments):
            if not isinstance(argument, int) or not slopes.get(argument):
                continue
            slope = substitute(partial(step.formula, slot), lambda s, a=step.arguments: _entry(a[s.key]))  # type: ignore[misc]
            for column, inner in slopes[argument].items():
                terms.setdefault(column, []).append(multiply(slope, inner))
        sums = {column: add(*parts) for column, parts in terms.items()}
        slopes[step.target] = {column: x for column, x in sums.items() if x != ZERO}
    return slopes


def _entry(entry: int | float) -> Expression:
    return Number(entry) if isinstance(entry, float) else Symbol(entry)


def size_of(x: Basic) -> int:
    """Number of operations of a sympy expression."""
    return 0 if not x.args else 1 + sum(map(size_of, x.args))


class _Lines:
    """Writer of shared subexpressions as lines."""

    def __init__(
        self, symbol: Callable[[int], Basic], fresh: Callable[[str], Basic], names: Mapping[Expression, str], title: Callable[[int], str]
    ) -> None:  # fmt: skip
        self.symbol, self.fresh, self.names, self.title = symbol, fresh, names, title
        self.known: dict[Expression, Basic] = {}
        self.sizes: dict[Expression, int] = {}
        self.lines: list[Line] = []

    def written(self, entries: Mapping[tuple[int, int], Expression]) -> Partials:
        """Entries in sympy, after the lines that they need."""
        order, uses = in_order(list(entries.values()), {})
        for leaf, count in uses.items():  # an intermediate result that is no line of its own
            if isinstance(leaf, Symbol):
                self.sizes[leaf] = size_of(self.symbol(leaf.key))
                if count > 1 and self.sizes[leaf] >= SHARED:
                    self._line(leaf, self.title(leaf.key))
        for node in order:
            if node.operator in SYSTEMS:
                continue
            if node.operator == "item":
                self._solve(node.operands[0])
                continue
            size = 1 + sum(self.sizes.get(o, 0) for o in node.operands)
            if size >= LARGE or (uses[node] > 1 and size >= SHARED):
                self._line(node, self.names.get(node, "product" if node.operator == "multiply" else "term"))
                size = 0
            self.sizes[node] = size
        return Partials({place: self._sympy(x) for place, x in entries.items()}, tuple(self.lines))

    def _line(self, node: Expression, name: str) -> None:
        target = self.fresh(name)
        self.lines.append(SolvedEquation(target, self._sympy(node), None, ""))
        self.known[node], self.sizes[node] = target, 0

    def _solve(self, system: Expression) -> None:
        assert isinstance(system, Apply)
        items = [Apply("item", (system, Number(float(i)))) for i in range(len(entries_of(system)[1]))]
        if items[0] in self.known:
            return
        rows, rights = entries_of(system)
        targets = tuple(self.fresh(self.names.get(item, "solution")) for item in items)
        matrix = tuple(tuple(self._sympy(row.get(j, ZERO)) for j in range(len(rights))) for row in rows)
        self.lines.append(LinearSystem(targets, matrix, tuple(map(self._sympy, rights)), None, ""))
        self.known.update(zip(items, targets, strict=True))

    def _sympy(self, x: Expression) -> Basic:
        return self.known[x] if x in self.known else as_written(x, self.symbol, self.known)
