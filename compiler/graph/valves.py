"""Ideal valves: switched junctions whose two events say that effort and flow are complementary: one of them zero, the other of one sign.

A 0-junction that is on adds its flows to zero, and one that is off has no effort; a 1-junction that is on adds its efforts to zero, and one that is off
has no flow. A valve is one whose first event acts where what is zero off would take one sign (an effort under which a clutch would open), and whose second
one acts where the sum that is not zero would take the other (a slip that makes it grip). `IdealDiode` of the library is a 0-junction with one bond,
a check valve a 1-junction between two nodes, a one-way clutch a 0-junction between two shafts. All valves of a model switch together (a linear complementarity
problem), not one after the other. A pair of events with another threshold (a hysteresis) is no valve and acts as it is written. The event that makes
a valve conduct may ask for a gate, too (a thyristor): while it is closed, the valve cannot begin to conduct, but conducts on to the end of its flow. The
gate becomes an event of its own, which never acts.

Each is brought into one form: the junction stays, and a 0-junction with one bond hangs on it, the gap, which conducts while it is off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial, reduce

from ..algebra.affine import jointly_affine
from ..algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    call,
    evaluate,
    operations,
    select,
    substitute,
    symbols,
)
from ..algebra.formula import Bound, Formula, bind, over
from ..fast_dataclass import dataclass
from ..source import Span
from .elements import Kind
from .network import Bond, BondEnd, BondGraph, Element, Event, Junction, PortVariable, Quantity, Reading, Switch
from .sharing import groups

COMPARISONS = ("less", "less_equal", "equal")
# Storages that add nothing to the sum of a junction that is off.
RESTING = {Kind.ZERO: Kind.CAPACITOR, Kind.ONE: Kind.INERTIA}


@dataclass(frozen=True, slots=True)
class Valve:
    """An ideal valve. `events`: owner and number of the event that makes it conduct and of the one that makes it block."""

    junction: str  # its gap
    mode: str
    conducting: float  # value of the mode where it conducts, 1 or 0
    events: tuple[tuple[str, int], tuple[str, int]]
    span: Span
    # times the effort of its gap where it blocks: not above zero; times its flow where it conducts: not below
    sign: float
    gate: tuple[str, int] | None = None  # owner and place of the event whose condition is its gate
    fitted: bool = False  # its start mode is not the written one, which contradicts other demands


def with_gaps(graph: BondGraph) -> tuple[BondGraph, tuple[Valve, ...]]:
    """Return the graph with each ideal valve in the form of a gap, and the valves in the order of its switched junctions."""
    found = []
    for switch in graph.switches:
        valve = _valve(graph, switch)
        if valve is None:
            continue
        if valve.gate is not None:
            graph = replace(graph, events=tuple(_gated(graph, valve)))
        if not _is_gap(graph, switch.junction):
            graph = _opened(graph, switch, valve)
            valve = replace(valve, junction=f"{switch.junction}.gap")
        found.append(valve)
    return graph, tuple(found)


def switched_gaps(graph: BondGraph, valves: tuple[Valve, ...]) -> tuple[str, ...]:
    """All switched 0-junctions with one bond, valves first: two-terminal switches, whoever decides them."""
    own = [v.junction for v in valves]
    return (*own, *(s.junction for s in graph.switches if s.junction not in own and _is_gap(graph, s.junction)))


def _number(graph: BondGraph, name: str) -> int:
    return next(i for i, n in enumerate(graph.nodes) if isinstance(n, Junction) and n.name == name)


def _is_gap(graph: BondGraph, name: str) -> bool:
    """Return True for a 0-junction with one bond, whose arrow points into it."""
    number = _number(graph, name)
    bonds = graph.incident[number]
    return graph.nodes[number].kind is Kind.ZERO and len(bonds) == 1 and graph.bonds[bonds[0]].head.node == number


def _opened(graph: BondGraph, switch: Switch, valve: Valve) -> BondGraph:
    """Return the graph with a gap on a switched junction, which itself is always on. Its events read the gap, so that a zero has no rounding error."""
    number = _number(graph, switch.junction)
    node = graph.nodes[number]
    assert isinstance(node, Junction)
    sides = _sides(graph, node.name)
    gap = replace(node, name=f"{node.name}.gap", kind=Kind.ZERO)
    active = switch.active
    if node.kind is Kind.ONE:
        active = Bound(Formula(active.formula.arity, ONE - active.formula.expression), active.arguments)
    bond = Bond(BondEnd(number, 0), BondEnd(len(graph.nodes), 0), node.domain, switch.span)
    switches = tuple(replace(s, junction=gap.name, active=active) if s is switch else s for s in graph.switches)
    other = "f" if node.kind is Kind.ZERO else "e"
    events = tuple(
        replace(e, condition=_of_gap(e.condition, sides, Reading(gap.name, "in", other)))
        if (e.name, e.span.start) in valve.events
        else e
        for e in graph.events
    )
    walls = {**graph.walls, (gap.name, "in"): len(graph.bonds)}
    return replace(
        graph, nodes=(*graph.nodes, gap), bonds=(*graph.bonds, bond), switches=switches, events=events, walls=walls,
    )  # fmt: skip


def _of_gap(condition: Bound, sides: _Sides, total: Reading) -> Bound:
    """A condition on the sum of a junction as one on its gap, where the sum is; another one as it is."""
    places = {a: found for a in condition.arguments if (found := sides.group(a)) is not None}
    if not any(side == "sum" for side, _ in places.values()):
        return condition
    pivot = next(g for g in sides.signs if g not in sides.resting)
    arguments: list[object] = []
    signs: dict[int, int] = {}
    for slot, a in enumerate(condition.arguments):
        is_pivot = a in places and places[a][1] == pivot
        arguments.append(total if is_pivot else 0.0 if a in places else a)
        signs[slot] = sides.signs[pivot] if is_pivot else 1
    formula = condition.formula
    turned = substitute(formula.expression, lambda s: Number(1.0 / signs[s.key]) * s if signs[s.key] != 1 else s)
    return Bound(Formula(formula.arity, turned), tuple(arguments))


def _gated(graph: BondGraph, valve: Valve) -> Iterator[Event]:
    """Yield the events with the gate of a valve as one beside that which makes it conduct. It sets the same, so that it is kept, but never acts."""
    for event in graph.events:
        if (event.name, event.span.start) == valve.events[0]:
            condition, gate = _parted(event, Quantity(valve.mode), _sides(graph, valve.junction))
            assert gate is not None
            yield replace(event, condition=condition)
            yield replace(event, condition=gate, span=replace(event.span, start=event.span.start + 1))
        else:
            yield event


def _parted(event: Event, mode: Quantity, sides: _Sides) -> tuple[Bound, Bound | None]:
    """Return a condition as what it asks of the mode and of its junction's efforts and flows, and all else that it asks besides, the gate."""
    arguments, own, gate = event.condition.arguments, list[Expression](), list[Expression]()
    parts = [event.condition.formula.expression]
    while parts:
        x = parts.pop()
        match x:
            case Apply(operator="select", operands=(whole, one, zero)) if (one, zero) == (ONE, ZERO):
                parts.append(whole)
            case Apply(operator="and"):
                parts += x.operands[::-1]
            case Apply(operator="not", operands=(Apply(operator="or", operands=others),)):
                parts += [call("not", other) for other in others[::-1]]
            case _:
                read = [arguments[s.key] for s in symbols(x)]
                bound = any(a == mode or sides.own(a) for a in read)
                (own if bound else gate).append(x)
    if not gate or not own:
        return event.condition, None
    condition, asked = (bind(over(select(reduce(partial(call, "and"), x), ONE, ZERO), arguments)) for x in (own, gate))
    return condition, asked


def _valve(graph: BondGraph, switch: Switch) -> Valve | None:
    modes = [a for a in switch.active.arguments if isinstance(a, Quantity)]
    if len(modes) != 1 or len(switch.active.arguments) != 1 or modes[0].name not in graph.quantities:
        return None
    mode = modes[0]
    on = tuple(_value(switch.active, lambda _, v=v: v) for v in (0.0, 1.0))  # type: ignore[misc]
    events = [e for e in graph.events if any(action.target == mode for action in e.actions)]
    if graph.quantities[mode.name].role != "mode" or on not in ((0.0, 1.0), (1.0, 0.0)) or len(events) != 2:
        return None
    sides = _sides(graph, switch.junction)
    active = on[1]  # of the mode where the junction is on
    for off, back in (events, events[::-1]):
        if not (_sets(off, 1.0 - active) and _sets(back, active)):
            continue
        starts, ends = (off, back) if sides.kind is Kind.ZERO else (back, off)  # a 0-junction conducts while it is off
        condition, gate = _parted(starts, mode, sides)
        conditions = {starts: condition, ends: ends.condition}
        first = _sign(conditions[off], mode, active, sides, "common")
        last = _sign(conditions[back], mode, 1.0 - active, sides, "sum")
        if first is None or last is None or first == last:
            continue
        return Valve(
            switch.junction, mode.name, 1.0 - active if starts is off else active, ((starts.name, starts.span.start), (ends.name, ends.span.start)),
            graph.quantities[mode.name].span, first if starts is off else last, None if gate is None else (starts.name, starts.span.start + 1),
        )  # fmt: skip
    return None


@dataclass(frozen=True, slots=True)
class _Sides:
    """Readings of both sides of a switched junction. `common`: group of bonds with its common variable; `signs`: sign of each group of bonds in its
    sum; `resting`: groups that add nothing while it is off."""

    kind: Kind
    common: int
    signs: Mapping[int, int]
    resting: frozenset[int]
    group: Callable[[object], tuple[str, int] | None]  # a reading as the side, "common" or "sum", and its group

    def own(self, argument: object) -> bool:
        """Return True for a reading of this junction, not of another part of the graph."""
        side, group = self.group(argument) or ("", -1)
        return group == self.common if side == "common" else group in self.signs


def _sides(graph: BondGraph, name: str) -> _Sides:
    number = _number(graph, name)
    kind, bonds = graph.nodes[number].kind, graph.incident[number]
    own, other = ("e", "f") if kind is Kind.ZERO else ("f", "e")
    of = {"e": groups(graph, Kind.ZERO, frozenset()), "f": groups(graph, Kind.ONE, frozenset())}
    numbers = {n.name: i for i, n in enumerate(graph.nodes)}
    signs: dict[int, int] = {}
    resting = set()
    for b, sign, far in _terms(graph, number):
        signs[of[other][b]] = signs.get(of[other][b], 0) + sign
        if _rests(graph.nodes[far], kind):
            resting.add(of[other][b])

    def group(argument: object) -> tuple[str, int] | None:
        if not isinstance(argument, Reading) or argument.variable not in "ef":
            return None
        bond = graph.walls.get((argument.node, argument.port))
        if bond is None:
            place = numbers.get(argument.node)
            if place is None:
                return None
            node = graph.nodes[place]
            ends = [
                b
                for b in graph.incident[place]
                for end in (graph.bonds[b].tail, graph.bonds[b].head)
                if end.node == place and (isinstance(node, Junction) or node.ports[end.port].name == argument.port)
            ]
            if not ends:
                return None
            bond = ends[0]
        return "common" if argument.variable == own else "sum", of[argument.variable][bond]

    return _Sides(kind, of[own][bonds[0]], {g: c for g, c in signs.items() if c}, frozenset(resting), group)


def _terms(graph: BondGraph, number: int) -> list[tuple[int, int, int]]:
    """Return the bonds in the sum of a junction with their signs and far nodes; adjacent junctions of its kind count as one with it."""
    kind = graph.nodes[number].kind
    switched = {s.junction for s in graph.switches}
    found, seen, heap = [], {number}, [number]
    while heap:
        at = heap.pop()
        for b in graph.incident[at]:
            bond = graph.bonds[b]
            sign = 1 if bond.head.node == at else -1
            far = (bond.tail if sign > 0 else bond.head).node
            if far in seen:
                continue
            if graph.nodes[far].kind is kind and graph.nodes[far].name not in switched:
                seen.add(far)
                heap.append(far)
            else:
                found.append((b, sign, far))
    return found


def _rests(node: object, kind: Kind) -> bool:
    """Return True for an element with neither effort nor flow while its junction is off: a resistor, or a storage that the junction holds."""
    if not isinstance(node, Element) or len(node.ports) != 1:
        return False
    if node.kind is RESTING[kind]:
        return True
    if node.kind is not Kind.RESISTOR or len(node.law.equations) != 1:
        return False
    at_rest = (PortVariable(0, "e"), PortVariable(0, "f"))
    left, right = (substitute(x, lambda s: ZERO if s.key in at_rest else s) for x in node.law.equations[0])
    return left == right


def _sets(event: Event, value: float) -> bool:
    """Return True if the only action of an event is to set one mode to a value."""
    if event.sampling is not None or len(event.actions) != 1:
        return False
    return _value(event.actions[0].value, lambda _: float("nan")) == value


def _sign(condition: Bound, mode: Quantity, at: float, sides: _Sides, side: str) -> float | None:
    """Return the sign of one side of a junction where a condition holds, for a value of the mode; None if the condition is another one: it has one
    comparison beside the mode, of a multiple of that side with zero."""
    arguments = condition.arguments
    others = {Symbol(slot): sides.group(a) for slot, a in enumerate(arguments) if a != mode}
    signs = {sides.common: 1} if side == "common" else sides.signs
    own = [g[1] for g in others.values() if g is not None and g[0] == side and g[1] in signs]
    moving = [g for g in signs if side == "common" or g not in sides.resting]
    comparisons = [x for x in operations(condition.formula.expression) if x.operator in COMPARISONS]
    compared = [x for x in comparisons if not others.keys().isdisjoint(symbols(x))]
    if len(own) < len(others) or len(compared) != 1 or not moving:
        return None
    parts = jointly_affine(compared[0].operands[0] - compared[0].operands[1], tuple(others))
    slopes = [s.value for s in parts[0] if isinstance(s, Number)] if parts is not None and parts[1] == ZERO else []
    if len(slopes) < len(others):
        return None
    gains = {g: sum(s for s, other in zip(slopes, own, strict=True) if other == g) / signs[g] for g in moving}
    if len({*gains.values()}) > 1:
        return None

    def truth(m: float, x: float) -> float | None:
        moved = {arguments[s.key]: x * signs[g] if g == moving[0] else 0.0 for s, g in zip(others, own, strict=True)}
        return _value(condition, {**moved, mode: m}.__getitem__)

    truths = [truth(m, x) for m in (1.0 - at, at) for x in (1.0, -1.0)]
    return 1.0 if truths == [0.0, 0.0, 1.0, 0.0] else -1.0 if truths == [0.0, 0.0, 0.0, 1.0] else None


def _value(bound: Bound, value: Callable[[object], float]) -> float | None:
    """Value of a formula with a value for each of its arguments; None if it has none."""
    try:
        return float(evaluate(bound.formula.expression, lambda slot: value(bound.arguments[slot])))
    except (ArithmeticError, ValueError, KeyError):
        return None
