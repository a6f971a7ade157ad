"""Ideal valves: junctions with two events that make effort and flow complementary (effort <= 0, flow >= 0, one of them zero).

`IdealDiode` of the library is written in this way: a 0-junction with one bond, which blocks while it is on and conducts while it is
off. One event makes it conduct when its effort becomes positive, the other makes it block when its flow becomes negative, and no other
event sets that mode. All valves of a model then switch together (a linear complementarity problem), not one after the other. A pair of
events with another threshold (a hysteresis) is no valve and acts as it is written.
"""

from __future__ import annotations

from collections.abc import Callable

from ..algebra.expression import evaluate
from ..algebra.formula import Bound
from ..nouns import dataclass
from ..source import Span
from .network import BondGraph, Event, Junction, Kind, Quantity, Reading, Switch

SAMPLES = (-1e3, -1.0, -1e-9, 1e-9, 1.0, 1e3)  # of an effort or a flow, at which conditions are read


@dataclass(frozen=True, slots=True)
class Valve:
    """An ideal valve. `events`: owner and number of the event that makes it conduct and of the one that makes it block."""

    junction: str
    mode: str
    conducting: float  # value of the mode where it conducts, 1 or 0
    events: tuple[tuple[str, int], tuple[str, int]]
    span: Span


def valves(graph: BondGraph) -> tuple[Valve, ...]:
    """Ideal valves of a graph, in the order of its switched junctions."""
    found = (_valve(graph, switch) for switch in graph.switches)
    return tuple(valve for valve in found if valve is not None)


def switched_gaps(graph: BondGraph) -> tuple[str, ...]:
    """All switched 0-junctions with one bond, valves first: two-terminal switches, with any kind of condition."""
    own = [v.junction for v in valves(graph)]
    others = (s.junction for s in graph.switches if s.junction not in own and _sides(graph, s.junction) is not None)
    return (*own, *others)


def _valve(graph: BondGraph, switch: Switch) -> Valve | None:
    modes = [a for a in switch.active.arguments if isinstance(a, Quantity)]
    if len(modes) != 1 or len(switch.active.arguments) != 1 or modes[0].name not in graph.quantities:
        return None
    mode = modes[0]
    on = tuple(_value(switch.active, lambda _, v=v: v) for v in (0.0, 1.0))  # type: ignore[misc]
    if graph.quantities[mode.name].role != "mode" or on not in ((0.0, 1.0), (1.0, 0.0)):
        return None
    conducting = 1.0 if on[1] == 0.0 else 0.0
    sides = _sides(graph, switch.junction)
    events = [e for e in graph.events if any(action.target == mode for action in e.actions)]
    if sides is None or len(events) != 2:
        return None
    for opening, closing in (events, events[::-1]):
        if (
            _sets(opening, conducting)
            and _sets(closing, 1.0 - conducting)
            and _holds(graph, opening, mode, 1.0 - conducting, (sides[0], 1.0))
            and _holds(graph, closing, mode, conducting, (sides[1], -1.0))
        ):
            keys = ((opening.name, opening.span.start), (closing.name, closing.span.start))
            return Valve(switch.junction, mode.name, conducting, keys, graph.quantities[mode.name].span)
    return None


Is = Callable[[object], bool]  # returns True for a reading of the effort, or of the flow, of the valve


def _sides(graph: BondGraph, name: str) -> tuple[Is, Is] | None:
    """Tests for readings of the effort and the flow of a 0-junction with one bond, whose arrow points into it; None for all others."""
    number = next(i for i, n in enumerate(graph.nodes) if isinstance(n, Junction) and n.name == name)
    bonds, node = graph.incident[number], graph.nodes[number]
    if node.kind is not Kind.ZERO or len(bonds) != 1 or graph.bonds[bonds[0]].head.node != number:
        return None
    through = graph.bonds[bonds[0]].tail.node
    line = graph.nodes[through]
    ends = graph.incident[through] if isinstance(line, Junction) and line.kind is Kind.ONE else ()

    def effort(argument: object) -> bool:
        return argument == Reading(name, "", "e")

    def flow(argument: object) -> bool:
        if not isinstance(argument, Reading) or argument.variable != "f":
            return False
        wall = graph.walls.get((argument.node, argument.port))
        return wall in ends if wall is not None else bool(ends) and argument == Reading(line.name, "", "f")

    return effort, flow


def _sets(event: Event, value: float) -> bool:
    """Return True if the only action of an event is to set one mode to a value."""
    if event.period is not None or len(event.actions) != 1:
        return False
    return _value(event.actions[0].value, lambda _: float("nan")) == value


def _holds(graph: BondGraph, event: Event, mode: Quantity, at: float, side: tuple[Is, float]) -> bool:
    """Return True if a condition holds exactly if the mode has a value and its reading has a sign."""
    reads, sign = side
    others = [a for a in event.condition.arguments if a != mode]
    if len(others) != 1 or not reads(others[0]) or mode not in event.condition.arguments:
        return False

    def truth(setting: float, x: float) -> float | None:
        return _value(event.condition, lambda a: setting if a == mode else x)

    return all(truth(setting, x) == float(setting == at and sign * x > 0) for setting in (0.0, 1.0) for x in SAMPLES)


def _value(bound: Bound, value: Callable[[object], float]) -> float | None:
    """Value of a formula with a value for each of its arguments; None if it has none."""
    try:
        return float(evaluate(bound.formula.expression, lambda slot: value(bound.arguments[slot])))
    except (ArithmeticError, ValueError, KeyError):
        return None
