"""State equations as stable text: the derivative of each state over states, inputs and parameters, with the line that caused it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from sympy import Basic

from ...source import Span
from .partials import size_of
from .python_text import PythonPrinter, needed_lines, read_by
from .state_equations import Entry, Line, LinearSystem, SolvedEquation, StateEquations

CLOSED = 40  # operations up to which intermediate results are substituted
MARGIN = 72  # column at which short lines have their comment


class _Names(dict[Any, str]):
    """Symbols and functions under their own names."""

    def __missing__(self, key: Any) -> str:
        return str(key)


def listing(equations: StateEquations) -> Iterator[str]:
    """Yield a heading, then equations by kind: intermediate results, states, loops, outputs, events."""
    e, printer = equations, PythonPrinter(_Names(), _Names())
    known: dict[Basic, Basic] = {}
    kept = [line for line in (_closed(line, known) for line in e.lines) if line is not None]

    def rows(left: str, entries: Sequence[Entry]) -> Iterator[str]:
        for entry in entries:
            right = printer.text(entry.value.xreplace(known))
            yield _row(left.format(entry.name, right), entry.span)

    yield f"state equations {e.name}: states {len(e.states)}, unknowns {len(e.unknowns)}, outputs {len(e.outputs)}, events {len(e.events)}"
    results = [entry.value.xreplace(known) for group in (e.rates, e.residuals, e.outputs) for entry in group]
    results += [x.xreplace(known) for event in e.events for x in (event.condition, *(r.value for r in event.resets))]
    for line in needed_lines(kept, results):
        yield _line(line, printer)
    yield from rows("d/dt {} = {}", e.rates)
    yield from rows("0 = {1}, solved for {0}", e.residuals)
    yield from rows("output {} = {}", e.outputs)
    yield from rows("start of {} = {}", e.starts)
    yield from rows("at the start {} is 0 = {}", e.initial)
    yield from rows("along a run {} is 0 = {}", e.constraints)
    yield from rows("{} is on: {}", e.switches)
    for event in e.events:
        condition = printer.text(event.condition.xreplace(known))
        words = zip(("every", "offset", "delay", "jitter", "seed"), event.sampling, strict=False)
        timing = [f"{word} {printer.text(x.xreplace(known))}" for word, x in words if word == "every" or x != 0]
        when = " ".join(timing) or f"when {condition}"
        sets = "; ".join(f"{r.words} := {printer.text(r.value.xreplace(known))}" for r in event.resets)
        yield _row(f"{when}: {sets}", event.span)


def _closed(line: Line, known: dict[Basic, Basic]) -> Line | None:
    """The line over what is kept; None if it is small, and then part of what reads it."""
    replaced = {symbol: known[symbol] for symbol in read_by(line) if symbol in known}
    if isinstance(line, SolvedEquation):
        right = line.right.xreplace(replaced)
        if size_of(right) > CLOSED:
            return SolvedEquation(line.target, right, line.span, line.owner)
        known[line.target] = right
        return None
    matrix = tuple(tuple(x.xreplace(replaced) for x in row) for row in line.matrix)
    return LinearSystem(line.targets, matrix, tuple(x.xreplace(replaced) for x in line.right), line.span, line.owner)


def _line(line: Line, printer: PythonPrinter) -> str:
    if isinstance(line, SolvedEquation):
        return _row(f"{line.target} = {printer.text(line.right)}", line.span, line.owner)
    matrix = "; ".join(" ".join(map(printer.text, row)) for row in line.matrix)
    targets, right = ", ".join(map(str, line.targets)), ", ".join(map(printer.text, line.right))
    return _row(f"solve [{matrix}] [{targets}] = [{right}]", line.span, line.owner)


def _row(text: str, span: Span | None, owner: str = "") -> str:
    if span is None:
        return f"  {text}"
    return f"  {text.ljust(MARGIN)}  # {span.file_and_line} {owner}".rstrip()
