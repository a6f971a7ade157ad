"""Every connected bond graph up to a size, and the best strokes of each by trying all.

A graph is junctions (0 or 1), links between them (a bond, a TF or a GY; parallel ones too) and one-ports on them; its size is how many
of these it has together. Graphs that differ only in the numbers of their junctions are one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, combinations_with_replacement, permutations, product
from typing import NamedTuple

from compiler.algebra.expression import Number, Symbol
from compiler.graph.elements import Kind
from compiler.graph.network import Bond, BondEnd, BondGraph, Element, Junction, Law, Port, PortVariable
from compiler.source import Source, Span

SPAN = Span(Source("small.bg", "small graph"), 0, 5)
LINKS = ("bond", "TF", "GY")
ONE_PORTS = ("Se", "Sf", "C", "I", "R")


class Small(NamedTuple):
    """Junction types; links (junction, junction, kind); for each junction its one-ports."""

    types: tuple[str, ...]
    links: tuple[tuple[int, int, str], ...]
    leaves: tuple[tuple[str, ...], ...]


def small_graphs(size: int) -> Iterator[Small]:
    """Every connected graph of exactly this size."""
    for junctions in range(1, size + 1):
        pairs = list(combinations(range(junctions), 2))
        possible = [(a, b, kind) for a, b in pairs for kind in LINKS]
        for links in range(junctions - 1, size - junctions + 1):
            for chosen in combinations_with_replacement(possible, links):
                if _is_connected(junctions, chosen):
                    yield from _filled(junctions, chosen, size - junctions - links)


def _filled(junctions: int, links: tuple[tuple[int, int, str], ...], leaves: int) -> Iterator[Small]:
    """The types and one-ports that such links allow; of equal graphs the first."""
    same = [p for p in permutations(range(junctions)) if _moved(links, p) <= links]
    if any(_moved(links, p) < links for p in same):
        return
    for types in product("01", repeat=junctions):
        for counts in product(range(leaves + 1), repeat=junctions):
            if sum(counts) != leaves:
                continue
            if any(not c and not any(n in (a, b) for a, b, _ in links) for n, c in enumerate(counts)):
                continue
            for found in product(*(combinations_with_replacement(ONE_PORTS, c) for c in counts)):
                key = tuple(zip(types, found, strict=True))
                if all(key <= tuple(key[i] for i in p) for p in same):
                    yield Small(types, links, found)


def _moved(links: tuple[tuple[int, int, str], ...], to: tuple[int, ...]) -> tuple[tuple[int, int, str], ...]:
    return tuple(
        sorted(((*sorted((to[a], to[b])), k) for a, b, k in links), key=lambda x: (x[0], x[1], LINKS.index(x[2])))
    )  # type: ignore[return-value]


def _is_connected(junctions: int, links: tuple[tuple[int, int, str], ...]) -> bool:
    reached, before = {0}, 0
    while len(reached) > before:
        before = len(reached)
        for a, b, _ in links:
            if a in reached or b in reached:
                reached |= {a, b}
    return len(reached) == junctions


# ---------------------------------------------------------------- the compiler's graph


def graph_of(small: Small, wishes: dict[tuple[int, int], str] | None = None) -> BondGraph:
    """The same as the compiler's noun; `wishes`: (junction, which one-port) -> `prefer`."""
    nodes: list[Junction | Element] = []
    bonds: list[Bond] = []
    for number, kind in enumerate(small.types):
        nodes.append(Junction(f"j{number}", Kind(kind), "untyped", "Small", SPAN))
    for number, (a, b, kind) in enumerate(small.links):
        if kind == "bond":
            bonds.append(Bond(BondEnd(a, 0), BondEnd(b, 0), "untyped", SPAN))
            continue
        nodes.append(_element(f"{kind}{number}", kind, None))
        here = len(nodes) - 1
        bonds += [
            Bond(BondEnd(a, 0), BondEnd(here, 0), "untyped", SPAN),
            Bond(BondEnd(here, 1), BondEnd(b, 0), "untyped", SPAN),
        ]
    for number, leaves in enumerate(small.leaves):
        for place, kind in enumerate(leaves):
            nodes.append(_element(f"{kind}{number}{place}", kind, (wishes or {}).get((number, place))))
            bonds.append(Bond(BondEnd(number, 0), BondEnd(len(nodes) - 1, 0), "untyped", SPAN))
    return BondGraph("small", tuple(nodes), tuple(bonds), {}, {}, {}, SPAN)


def _element(name: str, kind: str, prefer: str | None) -> Element:
    ports = (Port("1", "untyped"), Port("2", "untyped")) if kind in ("TF", "GY") else (Port("", "untyped"),)
    left, right = {
        "Se": (PortVariable(0, "e"), None), "Sf": (PortVariable(0, "f"), None), "C": (PortVariable(0, "e"), PortVariable(0, "q")), "I": (PortVariable(0, "p"), PortVariable(0, "f")),
        "R": (PortVariable(0, "e"), PortVariable(0, "f")), "TF": (PortVariable(0, "e"), PortVariable(1, "e")), "GY": (PortVariable(0, "e"), PortVariable(1, "f")),
    }[kind]  # fmt: skip
    law = Law(((Symbol(left), Number(1.0) if right is None else Number(2.0) * Symbol(right)),), None, 0)
    stored = {"C": ("q",), "I": ("p",)}.get(kind, ())
    return Element(name, Kind(kind), False, ports, law, (), stored, {}, {}, prefer, None, "Small", SPAN)


# ---------------------------------------------------------------- all strokes


class Best(NamedTuple):
    """The most wishes for storages that any strokes fulfil, with these the most storages in integral form, with these the most
    wishes for resistors."""

    wishes: int
    integral: int
    others: int


def best_of(small: Small, wishes: dict[tuple[int, int], str] | None = None) -> Best | None:
    """By trying everything: the sides on which the links decide their junctions, then what is left to the one-ports.

    None if no strokes keep the rules.
    """
    found: Best | None = None
    for ways in product((False, True), repeat=len(small.links)):
        decided = [0] * len(small.types)
        for (a, b, kind), way in zip(small.links, ways, strict=True):
            # An effort that comes to the junction b decides a 0; one that it gives away decides a 1.
            to_b = way if kind != "GY" else not way
            decided[a] += (not way) is (small.types[a] == "0")
            decided[b] += to_b is (small.types[b] == "0")
        value = _value(small, decided, wishes or {})
        if value is not None and (found is None or value > found):
            found = value
    return found


def _value(small: Small, decided: list[int], wishes: dict[tuple[int, int], str]) -> Best | None:
    """Best result of one-ports at junctions, given the number of links that determine each junction."""
    total = Best(0, 0, 0)
    for number, count in enumerate(decided):
        options = []
        for places in [()] if count == 1 else [(p,) for p in range(len(small.leaves[number]))] if count == 0 else []:
            value = _one_ports(small, number, places, wishes)
            if value is not None:
                options.append(value)
        if not options:
            return None
        best = max(options)
        total = Best(*(a + b for a, b in zip(total, best, strict=True)))
    return total


def _one_ports(small: Small, number: int, deciding: tuple[int, ...], wishes: dict[tuple[int, int], str]) -> Best | None:
    """The value of one junction if these of its one-ports decide it; None if a source does not let them."""
    fulfilled = integral = others = 0
    for place, kind in enumerate(small.leaves[number]):
        effort = (place in deciding) is (small.types[number] == "0")
        if kind in ("Se", "Sf") and effort is not (kind == "Se"):
            return None
        if kind in "CI":
            integral += effort is (kind == "C")
        wish = wishes.get((number, place))
        if wish is not None:
            wanted = wish == "effort" if wish in ("effort", "flow") else (wish == "integral") is (kind == "C")
            fulfilled += kind in "CI" and effort is wanted
            others += kind not in "CI" and effort is wanted
    return Best(fulfilled, integral, others)
