"""A quantity that stands alone in a call or on the command line: `20 ms`, `1 kHz`, or a bare number in SI."""

from __future__ import annotations

from .errors import UsageError


def quantity(text: str, unit: str, what: str) -> float:
    """Its value in SI; `unit` is one of its kind. Raises `UsageError`, with `what` it was meant for."""
    from .door import CompilationFailed, Literal, Source, parse_expression, read_unit

    try:
        tree = parse_expression(Source(what, text.strip()))
        if isinstance(tree, Literal):
            if tree.unit is None:
                return float(tree.number)
            scale = read_unit(Source(what, tree.unit.span.text))
            if scale.dimension == read_unit(Source(what, unit)).dimension:
                return scale.to_si(tree.number)
    except CompilationFailed:
        pass  # no expression, or no unit: the same answer as for a number of another kind
    raise UsageError(
        f"{what}: `{text.strip()}` is no quantity in {unit}; write a number with its unit, or a number in SI"
    )
