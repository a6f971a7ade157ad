"""Equations for readers: in sympy, as text, as LaTeX; with the author's names, in causal order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import PurePath
from typing import Any

from ..door import Apply, Expression, LinearLoop, StateSpace, Symbol, Unknown, to_sympy
from ..errors import UsageError
from .tables import visible

LARGEST = 1e6  # most symbols and operations of one state equation in sympy


class Equations(dict[str, Any]):
    """Equations in sympy by name: rates of states, residuals of unknowns. Notebooks typeset this mapping."""

    def __init__(self, equations: Mapping[str, Any], rates: bool) -> None:
        super().__init__(equations)
        self.rates = rates

    def _repr_latex_(self) -> str | None:
        """Return LaTeX, for notebooks."""
        from ..page.notebook import equations_latex

        return equations_latex(self, self.rates) if self else None


def state_equations(space: StateSpace) -> Equations:
    """Return state -> right-hand side in sympy, over parameters, inputs, `time`, states and the unknowns of nonlinear loops.

    Assignments are substituted, in causal order; a linear loop is solved symbolically for its cut variables.
    """
    value = symbolic_values(space)
    return Equations({space.variables[s.variable].name: value(s.rate) for s in space.states}, rates=True)


def algebraic_equations(space: StateSpace) -> Equations:
    """Return unknown of a nonlinear loop -> an expression in sympy that vanishes, over the same symbols as in `state_equations`."""
    value = symbolic_values(space)
    return Equations({space.variables[u.variable].name: value(u.residual) for u in space.unknowns}, rates=False)


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
            f"with everything put in, one state equation of {space.name} would have some {largest:.0e} terms; "
            "`equations` has them step by step, as they are computed"
        )


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


def equations_text(space: StateSpace, latex: bool) -> str:
    """Return one equation per line, in the order of computation; then the rates of the states."""
    lines = list(_latex_lines(space) if latex else _text_lines(space))
    lines = [visible(line) for line in lines]  # they contain names of files
    if latex:
        return "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}"
    return "\n".join(lines)


def _text_lines(space: StateSpace) -> Iterator[str]:
    import sympy

    def symbol(entry: int | float) -> Any:
        return sympy.Symbol(space.variables[entry].name) if isinstance(entry, int) else to_number(entry)

    unknowns = {u.residual: u for u in space.unknowns}
    rows: list[tuple[str, str]] = []
    for step in space.steps:
        place = f"{PurePath(step.span.source.name).name}:{step.span.line}"
        if isinstance(step, LinearLoop):
            names = ", ".join(space.variables[t].name for t in step.targets)
            matrix = "; ".join(" ".join(str(symbol(e)) for e in row) for row in step.matrix)
            right = "; ".join(str(symbol(e)) for e in step.right)
            rows.append((f"solve [{matrix}] [{names}] = [{right}]", f"{place} loop of {', '.join(step.members)}"))
            continue
        right_side = to_sympy(step.expression, symbol)
        if step.target in unknowns:
            rows.append((f"0 = {right_side}", f"{place} {_solved_for(space, unknowns[step.target])}"))
            continue
        rows.append((f"{space.variables[step.target].name} = {right_side}", place))
    for state in space.states:
        rate = space.variables[state.rate].name
        start = f"{state.start:.12g}" if isinstance(state.start, float) else space.variables[state.start].name
        place = f"{PurePath(state.span.source.name).name}:{state.span.line}"
        rows.append((f"d/dt {space.variables[state.variable].name} = {rate}", f"{place} starts at {start}"))
    width = min(72, max((len(r[0]) for r in rows), default=0))
    for text, place in rows:
        yield f"{text.ljust(width)}  # {place}"


def _solved_for(space: StateSpace, unknown: Unknown) -> str:
    return f"solved for {space.variables[unknown.variable].name}, loop of {', '.join(unknown.members)}"


def to_number(value: float) -> Any:
    """Return a number in a form that sympy prints well."""
    import sympy

    return sympy.Integer(int(value)) if value == int(value) and abs(value) < 1e15 else sympy.Float(value, 15)


def _latex_lines(space: StateSpace) -> Iterator[str]:
    import sympy

    names = {}

    def symbol(entry: int | float) -> Any:
        if isinstance(entry, float):
            return to_number(entry)
        made = sympy.Symbol(f"v{entry}")
        names[made] = latex_name(space.variables[entry].name)
        return made

    def text(expression: Any) -> str:
        return str(sympy.latex(expression, symbol_names=names))

    unknowns = {u.residual: u for u in space.unknowns}
    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix = sympy.Matrix([[symbol(e) for e in row] for row in step.matrix])
            left = sympy.Matrix([symbol(t) for t in step.targets])
            yield f"{text(matrix)} {text(left)} &= {text(sympy.Matrix([symbol(e) for e in step.right]))}"
            continue
        right_side = to_sympy(step.expression, symbol)
        if step.target in unknowns:
            solved_for = latex_name(space.variables[unknowns[step.target].variable].name)
            yield f"0 &= {text(right_side)} && \\text{{solved for }} {solved_for}"
            continue
        yield f"{latex_name(space.variables[step.target].name)} &= {text(right_side)}"
    for state in space.states:
        variable, rate = (latex_name(space.variables[v].name) for v in (state.variable, state.rate))
        yield f"\\frac{{\\mathrm{{d}}}}{{\\mathrm{{d}}t}} {variable} &= {rate}"


_ESCAPES = {
    "_": r"\_",
    "^": r"\hat{}",
    "%": r"\%",
    "#": r"\#",
    "&": r"\&",
    "$": r"\$",
    "{": r"\{",
    "}": r"\}",
    "~": r"\sim ",
    "\\": r"\backslash ",
}


def latex_name(name: str) -> str:
    """Return a dotted name in upright letters; no part of it can end its group."""
    return r"\mathrm{" + "".join(_ESCAPES.get(c, c) for c in name.replace(" -> ", r">")) + "}"
