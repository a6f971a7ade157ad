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
    names = [v.name for v in space.variables]
    symbol = symbols_of(names)
    unknowns = {u.residual: u for u in space.unknowns}
    rows: list[tuple[str, str]] = []
    for step in space.steps:
        place = step.span.file_and_line
        if isinstance(step, LinearLoop):
            matrix = "; ".join(" ".join(str(symbol(e)) for e in row) for row in step.matrix)
            targets, right = ", ".join(names[t] for t in step.targets), "; ".join(str(symbol(e)) for e in step.right)
            rows.append((f"solve [{matrix}] [{targets}] = [{right}]", f"{place} loop of {', '.join(step.members)}"))
        elif (unknown := unknowns.get(step.target)) is not None:
            solved_for = f"solved for {names[unknown.variable]}, loop of {', '.join(unknown.members)}"
            rows.append((f"0 = {to_sympy(step.expression, symbol)}", f"{place} {solved_for}"))
        else:
            rows.append((f"{names[step.target]} = {to_sympy(step.expression, symbol)}", place))
    for state in space.states:
        start = f"{state.start:.12g}" if isinstance(state.start, float) else names[state.start]
        place = f"{state.span.file_and_line} starts at {start}"
        rows.append((f"d/dt {names[state.variable]} = {names[state.rate]}", place))
    width = min(72, max((len(r[0]) for r in rows), default=0))
    return (f"{text.ljust(width)}  # {place}" for text, place in rows)


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

    written = [latex_name(v.name) for v in space.variables]
    symbol = symbols_of([f"v{number}" for number in range(len(written))])
    names = {symbol(number): name for number, name in enumerate(written)}

    def text(expression: object) -> str:
        return str(sympy.latex(expression, symbol_names=names))

    unknowns = {u.residual: u for u in space.unknowns}
    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix = sympy.Matrix([[symbol(e) for e in row] for row in step.matrix])
            left = sympy.Matrix([symbol(t) for t in step.targets])
            yield f"{text(matrix)} {text(left)} &= {text(sympy.Matrix([symbol(e) for e in step.right]))}"
        elif (unknown := unknowns.get(step.target)) is not None:
            yield f"0 &= {text(to_sympy(step.expression, symbol))} && \\text{{solved for }} {written[unknown.variable]}"
        else:
            yield f"{written[step.target]} &= {text(to_sympy(step.expression, symbol))}"
    for state in space.states:
        yield f"\\frac{{\\mathrm{{d}}}}{{\\mathrm{{d}}t}} {written[state.variable]} &= {written[state.rate]}"


_ESCAPES = {**{c: f"\\{c}" for c in "_%#&${}"}, "^": r"\hat{}", "~": r"\sim ", "\\": r"\backslash "}


def latex_name(name: str) -> str:
    """Return a dotted name in upright letters; no part of it can end its group."""
    return r"\mathrm{" + "".join(_ESCAPES.get(c, c) for c in name.replace(" -> ", r">")) + "}"
