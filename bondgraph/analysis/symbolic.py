"""State equations in sympy: assignments substituted in causal order, with the author's names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from compiler.api import Apply, Expression, LinearLoop, StateSpace, Symbol, to_sympy

from ..errors import UsageError
from ..rendering import text_of

LARGEST = 1e6  # most symbols and operations of one state equation in sympy


class SymbolicEquations(dict[str, Any]):
    """Equations in sympy by name: rates of states, residuals of unknowns. Notebooks typeset this mapping."""

    def __init__(self, equations: Mapping[str, Any], rates: bool) -> None:
        super().__init__(equations)
        self.rates = rates

    def _repr_latex_(self) -> str | None:
        """Return LaTeX, for notebooks."""
        return text_of(self, "latex", self.rates) if self else None


def state_equations(space: StateSpace) -> SymbolicEquations:
    """Return state -> right-hand side in sympy, over parameters, inputs, `time`, states and the unknowns of nonlinear loops.

    Assignments are substituted, in causal order; a linear loop is solved symbolically for its cut variables.
    """
    value = symbolic_values(space)
    return SymbolicEquations({space.variables[s.variable].name: value(s.rate) for s in space.states}, rates=True)


def algebraic_equations(space: StateSpace) -> SymbolicEquations:
    """Return unknown of a nonlinear loop -> an expression in sympy that vanishes, over the same symbols as in `state_equations`."""
    value = symbolic_values(space)
    return SymbolicEquations({space.variables[u.variable].name: value(u.residual) for u in space.unknowns}, rates=False)


def symbolic_values(space: StateSpace) -> Callable[[int | float], Any]:
    """Return a function from variable or number to sympy, with all assignments substituted. Raises `UsageError` if the result would be too large."""
    import sympy

    _check_size(space)

    values: dict[int, Any] = {}

    def value(entry: int | float) -> Any:
        if isinstance(entry, float):
            return sympy.Float(entry) if entry != int(entry) else sympy.Integer(int(entry))
        if entry not in values:
            values[entry] = sympy.Symbol(space.variables[entry].name, real=True)
        return values[entry]

    named = _named_parameters(space)
    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix = sympy.Matrix([[value(e) for e in row] for row in step.matrix])
            solution = matrix.LUsolve(sympy.Matrix([value(e) for e in step.right]))
            values.update(zip(step.targets, solution, strict=True))
        elif step.target not in named:
            values[step.target] = to_sympy(step.expression, value)
    return value


def _check_size(space: StateSpace) -> None:
    """Raise `UsageError` if substitution would be too large: the equations of a long chain of bodies grow without bound."""
    sizes: dict[int, float] = {}
    for step in space.steps:
        if isinstance(step, LinearLoop):
            entries = [e for row in (*step.matrix, step.right) for e in row]
            whole = sum(sizes.get(e, 1.0) for e in entries if isinstance(e, int)) * len(step.targets)
            sizes |= dict.fromkeys(step.targets, whole)
        else:
            sizes[step.target] = _size(step.expression, sizes)
    rates = [s.rate for s in space.states] + [u.residual for u in space.unknowns]
    largest = max((sizes.get(v, 1.0) for v in rates), default=0.0)
    if largest > LARGEST:
        raise UsageError(
            "BR261", f"with everything put in, one state equation of {space.name} would have some {largest:.0e} terms;",
            "`equations` has them step by step, as they are computed",
        )  # fmt: skip


def _size(expression: Expression, sizes: Mapping[int, float]) -> float:
    """Return the number of symbols and operations of an expression after substitution of its variables."""
    known: dict[Expression, float] = {}
    stack = [expression]
    while stack:
        node = stack[-1]
        inner = [o for o in node.operands if o not in known] if isinstance(node, Apply) else []
        if inner:
            stack += inner
            continue
        stack.pop()
        if isinstance(node, Apply):
            known[node] = 1.0 + sum(known[o] for o in node.operands)
        else:
            known[node] = sizes.get(node.key, 1.0) if isinstance(node, Symbol) else 1.0
    return known[expression]


def _named_parameters(space: StateSpace) -> set[int]:
    """Return the author's names that depend on parameters alone: they are not substituted."""
    static = {i for i, v in enumerate(space.variables) if v.role == "parameter"}
    for step in space.steps:
        if not isinstance(step, LinearLoop) and all(isinstance(a, float) or a in static for a in step.arguments):
            static.add(step.target)
    return static & set(space.quantities.values())
