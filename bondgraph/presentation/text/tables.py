"""Results as plain text for terminals: no colour, no escape sequence, no wider than necessary."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from compiler.api import Array, BondEnd, BondGraph, Reported

    from ...results.records import EnergyBalance
    from ...results.result import Result
    from ...results.run_check import RunCheck

LONGEST_NAME = 60
BARS, SPARKS = "▁▂▃▄▅▆▇█", 24
EXTREMES = "minimum", "at [s]", "maximum", "at [s]"  # heads of the cells of `extremes_shown`
TIME_UNITS = (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("ps", 1e12), ("fs", 1e15))


def time_unit(largest: float) -> tuple[str, float]:
    """Return the most readable unit for a time of that many seconds, and the number of units in a second."""
    for unit, factor in TIME_UNITS:
        if abs(largest) * factor >= 0.9999999:
            return unit, factor
    return TIME_UNITS[0] if not largest else TIME_UNITS[-1]


def digits_of_time(time: Array, digits: int = 4) -> int:
    """Return the digits for an instant of a run, so that it shows `digits` of them within the run: far from zero the first ones are the same."""
    length = float(time[-1] - time[0]) if len(time) else 0.0
    return digits + max(0, math.floor(math.log10(max(abs(time[0]), abs(time[-1])) / length))) if length > 0 else digits


def visible(text: str) -> str:
    """Return the text with control and bidirectional characters spelt out, so that a name cannot change a terminal or a plot."""
    return "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text)


def counted(number: int, what: str) -> str:
    """Return `1 loop`, `2 loops`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def some_of(names: Sequence[str], most: int) -> str:
    """Return the first names, and the number of the others."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def columns(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows as lines with aligned columns; very long cells do not widen a column."""
    if rows:
        yield from aligned(rows, "<" * len(rows[0]), widest=72).split("\n")


def short(name: str, longest: int = LONGEST_NAME) -> str:
    """Return a name for tables and legends: visible, and cut in the middle if it is a very long expression."""
    name = visible(name)
    if len(name) <= longest:
        return name
    half = (longest - 5) // 2
    return f"{name[:half]} ... {name[-half:]}"


def end_name(graph: BondGraph, end: BondEnd) -> str:
    """Return the node at an end of a bond, with the name of its port if it has one."""
    node = graph.nodes[end.node]
    ports = getattr(node, "ports", ())
    return f"{node.name}.{ports[end.port].name}" if ports and ports[end.port].name else str(node.name)


def labelled(name: str, unit: str, longest: int = 30) -> str:
    """Return a name with its unit in brackets, for an axis."""
    return short(name, longest) + (f" [{visible(unit)}]" if unit not in ("", "1") else "")


def shown_unit(unit: str) -> str:
    """Return a unit for a column of a table; empty for a bare number."""
    return "" if unit == "1" else visible(unit)


def summary(result: Result, sparks: bool = False) -> str:
    """Return the table of a result: each output's last, least and greatest value, the solver's work, the energy if present.

    `sparks`: each output also as a row of small bars over time, for terminals that support them.
    """
    error = result.error if result.error is not None and result.error.outputs else None
    rows = [
        (
            short(item.name), f"{values[-1] if len(values) else math.nan:.6g}", *extremes_shown(result, item),
            *(() if error is None else (f"{error.of(item.name) * item.scale:.2g}",)), "" if item.unit == "1" else item.unit,
            *((spark(result.time, values),) if sparks else ()),
        )
        for item, values in result.shown()
    ]  # fmt: skip
    parts = [f"{visible(result.title)}, {_span(result)}"]
    if rows:
        errors = () if error is None else ("error",)
        heads = ("", "final", *EXTREMES, *errors, "unit", *(("over time",) if sparks else ()))
        parts.append(aligned([heads, *rows], "<>>>>>" + ">" * len(errors) + "<" + "<" * sparks))
        if not result.searched:
            parts.append(f"minimum and maximum are those of the {len(result.time)} reported instants")
    if result.error is not None and result.error.failure:
        parts.append(visible(f"no estimate of the error: {result.error.failure}"))
    if result.certificate is not None:
        notes = (f"note: {note}" for note in result.certificate.notes)
        parts.append("\n".join(map(visible, (result.certificate.line, *notes))))
    parts.append(_work(result))
    if result.energy is not None:
        parts.append(_energy(result.energy))
    if result.check is not None:
        parts.append(_check(result.check))
    return "\n\n".join(parts)


def extremes_shown(result: Result, item: Reported) -> tuple[str, ...]:
    """Return the cells under `EXTREMES` of an output, in its unit."""
    ends = result.extremes(item.name)
    low, high = (value * item.scale + item.offset for value in (ends.minimum, ends.maximum))
    digits = digits_of_time(result.time)
    return f"{low:.6g}", f"{ends.minimum_at:.{digits}g}", f"{high:.6g}", f"{ends.maximum_at:.{digits}g}"


def _check(check: RunCheck) -> str:
    """Return the comparison of the run with its repetition: output by output, and the conclusion."""
    if check.failure:
        return visible(check.sentence)
    head = f"check: repeated with {check.solver or 'no steps'}, rtol {check.rtol:g}, in {check.parts} parts"
    heads = ("", "difference", "of magnitude", "covered", "unit")
    rows = [
        (short(r.name), *(f"{v:.3g}" for v in (r.difference, r.share, r.promised)), "" if r.unit == "1" else r.unit)
        for r in check.outputs
    ]
    events = f"events: {check.events[0]} and {check.events[1]}" if any(check.events) else ""
    if events and check.events[0] == check.events[1]:
        events += f", at instants within {check.shift:.3g} s"
    parts = (head, aligned([heads, *rows], "<>>><") if rows else "", events, visible(check.sentence))
    return "\n\n".join(part for part in parts if part)


def spark(time: Array, values: Array, width: int = SPARKS) -> str:
    """Return values over time as a row of bars from the least to the greatest: each column is the mean of its part of the time.

    A blank where no value is finite. A constant is a row in the middle.
    """
    import numpy as np

    finite = np.isfinite(values)
    if not finite.any():
        return " " * width
    low, high = float(values[finite].min()), float(values[finite].max())
    first, last = float(time[0]), float(time[-1])
    share = (time - first) / (last - first) if last != first else np.zeros(len(time))
    columns = np.minimum(share * width, width - 1).astype(int)
    bars, level = [], " "
    for column in range(width):
        here = values[finite & (columns == column)]
        if len(here):
            height = (float(here.mean()) - low) / (high - low) if high > low else 0.5
            level = BARS[min(len(BARS) - 1, int(height * len(BARS)))]
        elif (columns == column).any():
            level = " "  # values that are not finite
        bars.append(level)
    return "".join(bars)


def _span(result: Result) -> str:
    if not len(result.time):
        return "no instants"
    first, last = float(result.time[0]), float(result.time[-1])
    unit, factor = time_unit(max(abs(first), abs(last)))
    count = "1 instant" if len(result.time) == 1 else f"{len(result.time)} instants"
    digits = digits_of_time(result.time, 6)
    return f"{first * factor:.{digits}g} .. {last * factor:.{digits}g} {unit}, {count}"


def _work(result: Result) -> str:
    counted = ", ".join(f"{visible(what)} {count}" for what, count in result.evaluations.items())
    parts = [visible(result.solver)] if result.solver else []
    parts.append("1 step" if result.steps == 1 else f"{result.steps} steps")
    if counted:
        parts.append(f"evaluations: {counted}")
    if math.isfinite(result.rtol):
        parts.append(f"rtol {result.rtol:g}")
    if math.isfinite(result.wall_time):
        unit, factor = time_unit(result.wall_time)
        parts.append(f"took {result.wall_time * factor:.3g} {unit}")
    return "; ".join(parts)


def _energy(energy: EnergyBalance) -> str:
    rows = [("energy in J", "kind", "stored", "supplied", "dissipated", "residual")]
    rows += [
        (short(e.name), e.kind, f"{e.stored:.6g}", f"{e.supplied:.6g}", f"{e.dissipated:.6g}", f"{e.residual:.2g}")
        for e in energy.elements
    ]
    told = f"{energy.stored:.6g}", f"{energy.supplied:.6g}", f"{energy.dissipated:.6g}", f"{energy.residual:.2g}"
    rows.append(("sum", "", *told))
    return aligned(rows, "<<>>>>") + f"\nresidual (supplied - stored - dissipated): {energy.residual:.3g}"


def aligned(rows: Sequence[Sequence[str]], sides: str, widest: int = sys.maxsize) -> str:
    """Return rows as lines; `sides` has < or > for each column, `widest` is the largest width of a column."""
    widths = [min(widest, max(len(row[place]) for row in rows)) for place in range(len(sides))]
    lines = ("  ".join(f"{t:{s}{w}}" for t, s, w in zip(row, sides, widths, strict=True)).rstrip() for row in rows)
    return "\n".join(lines)
