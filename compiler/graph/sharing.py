"""Ideal switches whose currents or voltages the network leaves undetermined: they are shared.

A loop of closed switches alone leaves the division of a current undetermined; a part connected only through open switches has no
determined potential. Both follow in the limit of equal small resistances, and of equal small leakages: around such a loop the flows
of the switches add up to zero, with their signs, and so do the efforts across the switches that connect such a part. One switch of
each loop, and of each such cut, becomes a source with this condition; all others stay as they are. Loops and cuts are the null space
of the equations of the junctions and transformers (by Tellegen's theorem the rule is the dual of the freedom that the network leaves).

Where an event reads such a share (dry friction that slips at a limit), the shares decide when it acts. The motion is unique if it goes on as long as
any shares are admissible (Glocker, Set-Valued Force Laws, 2001), and the shares are chosen so: a switch that an event reads takes none while another
carries it all, and those that have limits only take it in proportion to them, so that all of them reach their limits at once.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from ..algebra.affine import jointly_affine
from ..algebra.expression import ONE, ZERO, Expression, Number, Symbol, add, call, divide, evaluate, multiply
from ..algebra.formula import Bound, Formula, bind, over
from ..fast_dataclass import dataclass
from .elements import Kind
from .groups import Groups
from .limits import Readers, Readings
from .network import BondGraph, Element, Event, Junction, Law, Port, PortVariable, Quantity, Reading

Row = dict[int, Fraction]  # group of bonds -> coefficient
ValveEvents = Mapping[str, tuple[tuple[str, int], ...]]  # junction of an ideal valve -> owner and place of its events
LEAST = 1e-12  # relative to the other limit: one that is zero
UNKNOWN = 1.3719  # ratio of a transformer that no value is known of


@dataclass(frozen=True, slots=True)
class Share:
    """Condition of a switch that becomes a source: minus the weighted sum of others', by name; `scale` multiplies it. `note`: if the model reads the share;
    `among`: the names of all that share."""

    others: Mapping[str, float]
    scale: Bound | None = None
    note: str = ""
    among: frozenset[str] = frozenset()


def shared(
    graph: BondGraph,
    valves: ValveEvents,
    closed: frozenset[str],
    holding: frozenset[str] = frozenset(),
    ports: frozenset[str] = frozenset(),
) -> BondGraph:
    """Return the graph with one source for each loop of closed switches and each part behind open ones, if a valve is among them.

    `closed`: junctions that have become sources of no effort. Open are the valves and switches that are still 0-junctions with one bond, and
    `holding`: sources of no flow in the place of 1-junctions. Several that hold one flow at zero share the effort as well. `ports` of a companion
    count as open and as closed, and stay as they are. A source that shares with one is a junction with one bond, which says the same: it becomes a port too.
    """
    if not valves and not holding:
        return graph
    ends = {
        n.name: i
        for i, n in enumerate(graph.nodes)
        if n.name in closed and isinstance(n, Element) and n.kind is Kind.EFFORT_SOURCE
    }
    opened = {s.junction for s in graph.switches} - closed
    gaps = {
        n.name: i
        for i, n in enumerate(graph.nodes)
        if n.name in opened and isinstance(n, Junction) and n.kind is Kind.ZERO and len(graph.incident[i]) == 1
    }
    ends |= {name: i for name, i in gaps.items() if name in ports}
    gaps |= {n.name: i for i, n in enumerate(graph.nodes) if n.name in holding}
    nodes = list(graph.nodes)
    valve_events = frozenset(key for own in valves.values() for key in own)
    notes: list[str] = []
    # switch and variable: its effort where closed ones make a loop with it, its flow where open ones cut it off
    zeros: set[tuple[str, str]] = set()
    for kind, among, others, own in (
        (Kind.FLOW_SOURCE, ends, gaps, valves.keys()),
        (Kind.EFFORT_SOURCE, gaps, ends, valves.keys() | holding),
    ):
        shares, idle = _open(graph, among, {} if ports else others, kind, frozenset(own), valve_events)
        zeros |= {(name, "e" if kind is Kind.FLOW_SOURCE else "f") for name in (*shares, *idle)}
        for name, share in shares.items():
            notes += [share.note] if share.note else []
            if name not in ports:
                alone = ports.isdisjoint(share.among)
                nodes[among[name]] = (_source if alone else _junction)(graph, among[name], kind, share)
    events = _with_zeros(graph, zeros) if zeros else graph.events
    return replace(graph, nodes=tuple(nodes), events=events, undetermined=(*graph.undetermined, *notes))


def _with_zeros(graph: BondGraph, zeros: Collection[tuple[str, str]]) -> tuple[Event, ...]:
    """Return the events with conditions that read zero, and not its rounding, where switches (by name) have none of a variable."""
    places = {n.name: i for i, n in enumerate(graph.nodes)}
    readings, zero_groups = {}, {}
    for variable, joins in (("e", Kind.ZERO), ("f", Kind.ONE)):
        group = groups(graph, joins, frozenset())
        readings[variable] = Readings(graph, variable, group)
        zero_groups[variable] = {group[b] for name, v in zeros if v == variable for b in graph.incident[places[name]]}

    def replaced(argument: object) -> object:
        if isinstance(argument, Reading) and argument.variable in "ef":
            behind = readings[argument.variable].of((argument,))
            return 0.0 if behind and behind <= zero_groups[argument.variable] else argument
        return argument

    bounds = (replace(e.condition, arguments=tuple(map(replaced, e.condition.arguments))) for e in graph.events)
    return tuple(replace(e, condition=bound) for e, bound in zip(graph.events, bounds, strict=True))


def _open(
    graph: BondGraph,
    among: Mapping[str, int],
    others: Mapping[str, int],
    kind: Kind,
    valves: frozenset[str],
    valve_events: frozenset[tuple[str, int]],
) -> tuple[dict[str, Share], list[str]]:
    """Return the share of each switch that becomes a source, by the others of its loop, or of its cut, and those of `others` that alone close one (or
    bridge one). `valve_events` read no share: a companion decides on valves."""
    if not among or not valves & {*among, *others}:
        return {}, []
    joins, sums = (Kind.ONE, Kind.ZERO) if kind is Kind.FLOW_SOURCE else (Kind.ZERO, Kind.ONE)
    variable = "f" if kind is Kind.FLOW_SOURCE else "e"
    group = groups(graph, joins, frozenset(among.values()))
    switches = {*among.values(), *others.values()}
    grounds = frozenset(i for i, n in enumerate(graph.nodes) if i not in switches and _is_ground(n, kind))
    transformers = _transformers(graph, variable)
    still = {
        group[b]
        for i, n in enumerate(graph.nodes)
        if not isinstance(n, Junction) and i not in switches and i not in grounds and i not in transformers
        for b in graph.incident[i]
    }
    rows = [
        row
        for i, n in enumerate(graph.nodes)
        if n.kind is sums and i not in switches
        if (row := _sum(graph, i, group, still))
    ]
    sides = {i: _side_groups(graph, i, group) for i in transformers}
    rows += [row for i, law in transformers.items() if (row := _turned(sides[i], law.slopes, still))]
    places = {name: group[graph.incident[i][0]] for name, i in among.items()}
    number = Counter(places.values())
    outer = Counter(group[graph.incident[i][0]] for i in others.values())
    # Closed ones in a row carry the same: one shares for all. Open ones at one node leave it without an effort.
    own = {places[n]: n for n in sorted(places, key=valves.__contains__) if joins is Kind.ONE or number[places[n]] == 1}
    inner = sorted({g for row in rows for g in row} - own.keys() - outer.keys())
    readings = Readings(graph, variable, group)
    readers = readings.readers(valve_events)
    inside = sorted(own, key=lambda g: (g in readers.events, own[g] not in valves))
    pivots = _eliminated(rows, [*inner, *inside, *sorted(outer.keys() - own.keys())])
    behind = {g for p, row in pivots.items() if p in outer for g in row}
    free = {g for g, n in outer.items() if n == 1 and g not in behind and g not in still}
    idle = [n for n, i in others.items() if group[graph.incident[i][0]] in free]
    shares = {}
    for g in [g for g in own if g not in pivots and g not in still]:
        loop = {own[p]: -float(row[g] * number[p] / number[g]) for p, row in pivots.items() if g in row and p in own}
        if not valves & {own[g], *loop}:
            continue
        carriers = {g, *(p for p, row in pivots.items() if g in row)}
        signs = [transformers[i].sign for i, pair in sides.items() if not carriers.isdisjoint(pair)]
        read = carriers & (readers.events.keys() | readers.others)
        limits = _in_proportion(readings, readers, [g, *(p for p in carriers - {g} if p in own)])
        if limits is not None and read <= own.keys():
            ((name, weight),) = loop.items()
            share = Share({name: math.copysign(1.0, weight)}, bind(multiply(*signs, limits)))
            how = "they take it in proportion to the limits in the conditions of their events, so that all reach them at once"
        elif read == {g} and g not in readers.others:
            share = Share({})
            how = f"`{own[g]}` takes none of it, so that its events act when the others cannot carry it all"
        else:
            share = Share({} if signs else loop)
            how = "what reads these shares depends on how this program chooses them"
        note = _note(kind, sorted([own[g], *loop], key=among.__getitem__), how) if read else ""
        shares[own[g]] = replace(share, note=note, among=frozenset(loop))
    return shares, idle


def _in_proportion(readings: Readings, readers: Readers, members: Sequence[int]) -> Expression | None:
    """Return the limit of the first of two groups over that of the second, if one event reads each, with a limit of its absolute value."""
    if len(members) != 2 or not readers.others.isdisjoint(members):
        return None
    limits = []
    for g in members:
        events = readers.events.get(g, [])
        limit = readings.limit(events[0], g) if len(events) == 1 else None
        if limit is None:
            return None
        limits.append(limit.expression)
    first, second = limits
    return divide(first, call("max", second, add(multiply(Number(LEAST), first), Number(LEAST**20))))


def _note(kind: Kind, names: Sequence[str], how: str) -> str:
    one, other = ("effort", "flow") if kind is Kind.EFFORT_SOURCE else ("flow", "effort")
    listed = " and ".join(f"`{n}`" for n in names)
    with_others = f"{listed} each carry" if len(names) > 1 else f"{listed} and others carry"
    return f"nothing determines how much {one} {with_others} where together they keep one {other} at zero: {how}"


@dataclass(frozen=True, slots=True)
class TransformerLaw:
    """Law a x_1 + b x_2 = 0 of a transformer, with present values. `sign`: 1, or -1 after a parameter has changed the sign of the ratio."""

    slopes: tuple[Fraction, Fraction]
    sign: Expression


def _transformers(graph: BondGraph, variable: str) -> dict[int, TransformerLaw]:
    """Return the laws of the transformers by the index of the node."""
    elements = [(i, n) for i, n in enumerate(graph.nodes) if isinstance(n, Element)]
    return {i: law for i, n in elements if (law := _transformer_law(graph, n, variable))}


def _transformer_law(graph: BondGraph, node: Element, variable: str) -> TransformerLaw | None:
    """Return the law of a transformer for its efforts or flows; None for any other node."""
    if node.kind is not Kind.TRANSFORMER:
        return None
    ((left, right),) = node.law.equations
    for letter in "ef":
        parts = jointly_affine(left - right, (Symbol(PortVariable(0, letter)), Symbol(PortVariable(1, letter))))
        if parts is None or parts[0] == [ZERO, ZERO]:
            continue
        values = [evaluate(x, lambda slot: _present(graph, node.arguments[slot])) for x in parts[0]]
        if not all(values) or not all(map(math.isfinite, values)):
            return None
        a, b = (Fraction(v) for v in (values if letter == variable else values[::-1]))
        sign = over(call("sign", multiply(*parts[0])), node.arguments)
        return TransformerLaw((a, b), multiply(Number(1.0 if a * b > 0 else -1.0), sign))
    return None


def _present(graph: BondGraph, argument: object) -> float:
    """Value of an argument before the run; for any other one a number that cancels with none."""
    if isinstance(argument, Quantity) and argument.name in graph.quantities:
        argument = graph.quantities[argument.name].value
    return argument if isinstance(argument, float) else UNKNOWN


def _is_ground(node: object, kind: Kind) -> bool:
    """Return True if a node is a source of zero, through which a loop or a cut may go."""
    other = Kind.EFFORT_SOURCE if kind is Kind.FLOW_SOURCE else Kind.FLOW_SOURCE
    return (
        isinstance(node, Element) and node.kind is other and len(node.ports) == 1 and node.law.equations[0][1] == ZERO
    )


def groups(graph: BondGraph, joins: Kind, own: frozenset[int]) -> list[int]:
    """For each bond the first of those that share its variable through junctions."""
    joined = Groups[int]()
    for i, node in enumerate(graph.nodes):
        if node.kind is joins and i not in own and graph.incident[i]:
            first, *others = graph.incident[i]
            for bond in others:
                joined.join(bond, first)
    return [joined.of(b) for b in range(len(graph.bonds))]


def _side_groups(graph: BondGraph, number: int, group: Sequence[int]) -> tuple[int, int]:
    """Return the groups of the bonds at both ports of a transformer."""
    at = {
        end.port: group[b]
        for b in graph.incident[number]
        for end in (graph.bonds[b].tail, graph.bonds[b].head)
        if end.node == number
    }
    return at[0], at[1]


def _turned(groups: tuple[int, int], slopes: tuple[Fraction, Fraction], still: set[int]) -> Row:
    """Equation of a transformer over groups of bonds, without those that carry nothing."""
    row: Row = {}
    for g, slope in zip(groups, slopes, strict=True):
        if g not in still:
            row[g] = row.get(g, Fraction(0)) + slope
    return {g: c for g, c in row.items() if c}


def _sum(graph: BondGraph, number: int, group: Sequence[int], still: set[int]) -> Row:
    """Balance of a junction over groups of bonds, without those that carry nothing."""
    row: Row = {}
    for bond in graph.incident[number]:
        sign = 1 if graph.bonds[bond].head.node == number else -1
        if group[bond] not in still:
            row[group[bond]] = row.get(group[bond], Fraction(0)) + sign
    return {g: c for g, c in row.items() if c}


def _eliminated(rows: list[Row], order: Sequence[int]) -> dict[int, Row]:
    """Reduced rows of a homogeneous system, by their pivots. Pivots are searched for in this order."""
    pivots: dict[int, Row] = {}
    rest = list(rows)
    for g in order:
        place = next((i for i, row in enumerate(rest) if g in row), None)
        if place is None:
            continue
        pivot = rest.pop(place)
        pivot = {k: c / pivot[g] for k, c in pivot.items()}
        rest = [r for r in (_without(row, g, pivot) for row in rest) if r]
        pivots = {p: _without(row, g, pivot) for p, row in pivots.items()} | {g: pivot}
    return pivots


def _without(row: Row, g: int, pivot: Row) -> Row:
    factor = row.get(g)
    if factor is None:
        return row
    result = {k: row.get(k, Fraction(0)) - factor * pivot.get(k, Fraction(0)) for k in {*row, *pivot}}
    return {k: c for k, c in result.items() if c}


def _junction(graph: BondGraph, number: int, kind: Kind, _: Share) -> Junction:
    """A source of no flow as a 0-junction with one bond, one of no effort as a 1-junction."""
    node = graph.nodes[number]
    domain = graph.bonds[graph.incident[number][0]].domain
    joins = Kind.ONE if kind is Kind.FLOW_SOURCE else Kind.ZERO
    return Junction(node.name, joins, domain, node.definition, node.span)


def _source(graph: BondGraph, number: int, kind: Kind, share: Share) -> Element:
    """A switch as a source of its share in a loop or cut."""
    node = graph.nodes[number]
    variable = "f" if kind is Kind.FLOW_SOURCE else "e"
    domain = graph.bonds[graph.incident[number][0]].domain
    scale = share.scale or Bound(Formula(0, ONE), ())
    first = len(scale.arguments)
    terms: list[Expression] = [
        multiply(Number(-sign), Symbol(first + i)) for i, sign in enumerate(share.others.values())
    ]
    value = multiply(scale.formula.expression, add(*terms)) if terms else ZERO
    arguments = (*scale.arguments, *(Reading(name, "", variable) for name in share.others))
    law = Law(((Symbol(PortVariable(0, variable)), value),), None, len(arguments))
    ports = (Port("", domain),)
    return Element(
        node.name, kind, bool(arguments), ports, law, arguments, (), {}, {}, None, None, node.definition, node.span
    )
