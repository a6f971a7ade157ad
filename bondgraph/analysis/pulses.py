"""Time in the equations of an analysis of one instant: a note on what is held there, and pulses whose instants move.

Stairs of time whose instants move with a state or an input have no slope at one instant, while their mean has: a linear model of one instant would
say that nothing follows.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from compiler.api import Expression, Leaf, Symbol, operations, symbols

from ..errors import UsageError

if TYPE_CHECKING:
    from compiler.api import Lowered

    from .operating_point import OperatingPoint

TIME = Symbol(Leaf("time", 0))
STAIRS = ("floor", "ceil")
COMPARISONS = ("less", "less_equal")


def held_note(point: OperatingPoint, linear: bool = False) -> str:
    """Return the note on a result that would be another at another instant, as time moves the rates (`linear`: their slopes). Empty if it would not."""
    lowered = point.lowered
    moving = {TIME, *(Symbol(Leaf("mode", place)) for place in lowered.events.timed)}
    rates = [*lowered.rates, *(item.root for item in lowered.events.located)]
    if not any(s in moving for root in rates for s in symbols(root)):
        return ""
    bent = {Symbol(Leaf("state", i)) for i in range(point.all)} | moving
    if linear and not any(s in bent for slope in lowered.jacobian.values() for s in symbols(slope)):
        return ""
    instant = f"t = {point.time:.6g} s"
    what = f"it would rest here if all that time moves kept its values of {instant}"
    if linear:
        what = f"slopes are those of {instant}"
    return f"time moves the equations: {what}; write means for pulses and oscillations, or simulate"


def refuse_moving_pulses(point: OperatingPoint) -> None:
    """Raise `UsageError` if a state, or one of the quantities by which derivatives are taken, moves the instants of stairs of time."""
    program, by = point.program, set(point.by)
    names = (*program.states.names, *program.unknowns.names)
    roles = (("parameter", program.parameters.names), ("input", program.inputs.names))
    moving = {(role, i): name for role, all_names in roles for i, name in enumerate(all_names) if name in by}
    for leaf in (symbol.key for root in _stairs_of_time(point.lowered) for symbol in symbols(root)):
        name = moving.get((leaf.role, leaf.position))
        if leaf.role == "state":
            name = names[leaf.position]
        if name is not None:
            raise UsageError(
                "BR268", f"`{name}` moves the instants at which a `pwm` or another stair of time jumps: its value at one instant has no slope;",
                "write the mean for a linear model, as `duty` for `pwm(time, period, duty)`, or simulate",
            )  # fmt: skip


def _stairs_of_time(lowered: Lowered) -> Iterator[Expression]:
    """Yield the stairs of time, and the comparisons with them, of a program."""
    events = lowered.events
    places = {
        Symbol(Leaf("mode", place))
        for place, root in zip(events.timed, lowered.switches, strict=True)
        if _has_stairs(root, set())
    }
    roots = [*lowered.switches, *(item.root for item in events.located), *(item.value for item in events.counts)]
    for root in (*lowered.rates, *lowered.outputs.values()):
        roots += [x for x in operations(root) if x.operator in (*STAIRS, *COMPARISONS)]
    yield from (root for root in roots if _has_stairs(root, places))


def _has_stairs(root: Expression, places: set[Symbol]) -> bool:
    """Return True if an expression has stairs of time; `places`: items of the mode that are such."""
    return any(s in places for s in symbols(root)) or any(
        x.operator in STAIRS and TIME in set(symbols(x)) for x in operations(root)
    )
