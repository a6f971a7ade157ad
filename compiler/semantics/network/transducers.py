"""Transformers and gyrators with many ports, expanded to junctions with two-port transducers between them, as in textbooks.

`TF rods(a, b, c) : c.v = a.v + 2*b.v` gives the flow of one port by those of others. Each port becomes a junction. At a port that an
equation gives, the terms add up; at a port that it reads, the variable is shared; each term is a transformer (gyrator) with its
coefficient between the two junctions. The transposed equations follow, since neither junctions nor two-ports lose power, and the
causality pass needs no new kind. The direction of an arrow changes the sign of a term: equations use the signs of the bonds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...algebra.affine import affine_parts
from ...algebra.expression import ZERO, Expression, Number, Symbol, multiply, negate, substitute, symbols
from ...graph.domains import multibond_of
from ...graph.elements import TRANSDUCERS, Kind
from ...graph.network import Bond, BondEnd, Element, Junction, Law, Node, Port, PortVariable
from ...source import Span
from ..names.errors import WrongLaw
from ..names.statement_errors import Wrong

OTHER = {"e": "f", "f": "e"}


def has_many_ports(node: Node) -> bool:
    """Return True for a transducer that lists its ports."""
    return isinstance(node, Element) and node.kind in TRANSDUCERS and node.ports[0].name != "1"


def check_many_ports(
    kind: str, name: str, equations: Sequence[tuple[Expression, Expression]], ports: int, span: Span
) -> None:  # fmt: skip
    """Check that each equation gives one variable of one port by the matching variables of others. Raises `Wrong`."""

    def wrong(what: str, hint: str) -> Wrong:
        return Wrong(WrongLaw(span, f"The law of `{name}` {what}", hint))

    example = "`c.v = a.v + 2*b.v`" if kind == "TF" else "`c.F = K*a.i + L*b.i`"
    given: set[PortVariable] = set()
    read: set[PortVariable] = set()
    for left, right in equations:
        if not (isinstance(left, Symbol) and isinstance(left.key, PortVariable)):
            raise wrong("must give a variable of one port on the left", f"For example {example}.")
        terms = {s.key for s in symbols(right) if isinstance(s.key, PortVariable)}
        fitting = left.key.variable if kind == "TF" else OTHER[left.key.variable]
        if not terms or any(t.variable != fitting for t in terms):
            words = {"e": "efforts", "f": "flows"}
            what = f"must give {words[left.key.variable]} by {words[fitting]} of other ports"
            raise wrong(what, f"For example {example}; power gives the other equations.")
        rest = right
        for own in terms:
            parts = affine_parts(rest, Symbol(own))
            if parts is None or any(isinstance(s.key, PortVariable) for s in symbols(parts[0])):
                raise wrong(
                    "is not linear in its variables", "A transducer passes power on: a sum of ratios times others."
                )
            rest = parts[1]
        if rest != ZERO:
            raise wrong(
                "has a part that does not vanish with its variables", "It would create energy; put a source beside it."
            )
        given.add(left.key)
        read |= terms
    if len({o.port for o in given}) < len(equations) or {o.port for o in given} & {o.port for o in read}:
        raise wrong("reads a port that it gives, or gives one twice", "Solve it for as many ports as it has equations.")
    if len({o.variable for o in given}) > 1:
        raise wrong("gives efforts and flows", "Give one kind; power gives the other equations.")
    if {o.port for o in given | read} != set(range(ports)):
        raise wrong("leaves out one of its ports", "Every port that is listed must occur.")


def expand_transducers(nodes: list[Node], bonds: list[Bond], walls: dict[tuple[str, str], int]) -> None:
    """Replace the transducers of many ports, in place; their ports become walls, read by the bond through them.

    A port without bond, or with two, is left to the check of bonds.
    """
    ends: dict[BondEnd, list[tuple[int, bool]]] = {}
    for number, bond in enumerate(bonds):
        ends.setdefault(bond.tail, []).append((number, False))
        ends.setdefault(bond.head, []).append((number, True))
    for number, node in enumerate(list(nodes)):
        if isinstance(node, Element) and has_many_ports(node):
            found = [ends.get(BondEnd(number, p), []) for p in range(len(node.ports))]
            if node.law.equations and all(len(f) == 1 for f in found):  # a law with an error is skipped
                _expand(number, node, [f[0] for f in found], nodes, bonds)
                walls.update({(node.name, port.name): f[0][0] for port, f in zip(node.ports, found, strict=True)})


def _expand(number: int, node: Element, outer: list[tuple[int, bool]], nodes: list[Node], bonds: list[Bond]) -> None:
    left = node.law.equations[0][0]
    assert isinstance(left, Symbol)
    bundle = node.name if any(multibond_of(port.name) for port in node.ports) else ""
    given = {PortVariable(e[0].key.port, e[0].key.variable) for e in node.law.equations if isinstance(e[0], Symbol)}
    variable = left.key.variable
    transformer = node.kind is Kind.TRANSFORMER
    # Flows add up at a 0-junction, efforts at a 1-junction; the other side shares the variable that is read.
    adding = Kind.ZERO if variable == "f" else Kind.ONE
    sharing = {Kind.ZERO: Kind.ONE, Kind.ONE: Kind.ZERO}[adding] if transformer else adding
    places: list[int] = []
    for port, item in enumerate(node.ports):
        kind = adding if any(o.port == port for o in given) else sharing
        junction = Junction(f"{node.name}.{item.name}", kind, item.domain, node.definition, node.span, bundle)
        places.append(number if not port else len(nodes))
        if port:
            nodes.append(junction)
        else:
            nodes[number] = junction
        bond, arrives = outer[port]
        end = BondEnd(places[port], 0)
        bonds[bond] = replace(bonds[bond], head=end) if arrives else replace(bonds[bond], tail=end)
    for target, source, coefficient in _terms(node):
        bond, arrives = outer[target]
        ratio = negate(coefficient) if arrives else coefficient
        given_own, read_own = PortVariable(1, variable), PortVariable(0, variable if transformer else OTHER[variable])
        law = Law(((Symbol(given_own), multiply(ratio, Symbol(read_own))),), None, node.law.arity)
        sides = (Port("1", node.ports[source].domain), Port("2", node.ports[target].domain))
        name = f"{node.name}({node.ports[source].name} to {node.ports[target].name})"
        two_port = replace(node, name=name, ports=sides, law=law, prefer=None, require=None, bundle=bundle)
        middle = len(nodes)
        nodes.append(two_port)
        span = bonds[bond].span
        bonds.append(Bond(BondEnd(places[source], 0), BondEnd(middle, 0), sides[0].domain, span))
        bonds.append(Bond(BondEnd(middle, 1), BondEnd(places[target], 0), sides[1].domain, span))


def _terms(node: Element) -> Iterator[tuple[int, int, Expression]]:
    """Terms of the equations: given port, read port, coefficient. An entry of a matrix that is zero, whatever is set, is no term."""
    numbers = [Number(a) if isinstance(a, float) else None for a in node.arguments]
    for left, right in node.law.equations:
        assert isinstance(left, Symbol)
        for symbol in [s for s in symbols(right) if isinstance(s.key, PortVariable)]:
            parts = affine_parts(right, symbol)
            assert parts is not None
            if substitute(parts[0], lambda s: numbers[s.key] or s) != ZERO:
                yield left.key.port, symbol.key.port, parts[0]
