"""Equations for readers: as text, as LaTeX; with the author's names, in causal order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from compiler.api import LinearLoop, StateSpace, to_sympy

from .tables import visible


def equations_text(space: StateSpace, latex: bool) -> str:
    """Return one equation per line, in the order of computation; then the rates of the states."""
    lines = list(_latex_lines(space) if latex else _text_lines(space))
    lines = [visible(line) for line in lines]  # they contain names of files
    if latex:
        return "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}"
    return "\n".join(lines)


def _text_lines(space: StateSpace) -> Iterator[str]:
    symbol = symbols_of([v.name for v in space.variables])
    unknowns = {u.residual: u for u in space.unknowns}
    rows: list[tuple[str, str]] = []
    for step in space.steps:
        place = step.span.file_and_line
        if isinstance(step, LinearLoop):
            names = ", ".join(space.variables[t].name for t in step.targets)
            matrix = "; ".join(" ".join(str(symbol(e)) for e in row) for row in step.matrix)
            right = "; ".join(str(symbol(e)) for e in step.right)
            rows.append((f"solve [{matrix}] [{names}] = [{right}]", f"{place} loop of {', '.join(step.members)}"))
            continue
        right_side = to_sympy(step.expression, symbol)
        if step.target in unknowns:
            unknown = unknowns[step.target]
            solved_for = f"solved for {space.variables[unknown.variable].name}, loop of {', '.join(unknown.members)}"
            rows.append((f"0 = {right_side}", f"{place} {solved_for}"))
            continue
        rows.append((f"{space.variables[step.target].name} = {right_side}", place))
    for state in space.states:
        rate = space.variables[state.rate].name
        start = f"{state.start:.12g}" if isinstance(state.start, float) else space.variables[state.start].name
        place = state.span.file_and_line
        rows.append((f"d/dt {space.variables[state.variable].name} = {rate}", f"{place} starts at {start}"))
    width = min(72, max((len(r[0]) for r in rows), default=0))
    for text, place in rows:
        yield f"{text.ljust(width)}  # {place}"


def symbols_of(names: Sequence[str]) -> Callable[[int | float], Any]:
    """Return a function that gives a variable by its number as a symbol, and any other value as a number."""
    import sympy

    return lambda entry: sympy.Symbol(names[entry]) if isinstance(entry, int) else to_number(entry)


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

    def text(expression: object) -> str:
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
