"""An element as text: its law, over its own variables and the quantities it reads, and its attributes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from ..algebra.expression import Expression, Number, Symbol, substitute, symbols
from ..graph.domains import BUNDLES, DOMAINS, multibond_of
from ..graph.elements import SOURCES
from ..graph.network import Element, PortVariable, Quantity, Reading
from ..graph.units import JOULE
from .literals import braces, former_name
from .names import is_field
from .reference_names import Words


def element_line(node: Element, words: Words, heating: bool) -> str:
    """Declaration of an element. `heating`: its last equation is the heat, which an `RS` has without writing it."""
    name = words.names.nodes[node.name]
    listed = ", ".join(_ports(node, words.plain))
    sides = _sides(node, words, heating)
    kind = f"{'M' if _is_modulated(node, words, sides) else ''}{node.kind.value}{'S' if heating else ''}"
    ports = f"({listed})" if is_field(node) else ""
    law = _law_text(node, words, sides)
    return f"{kind} {name}{ports} : {law}{braces(_attributes(node, words))}{former_name(node.name, name)}"


def _ports(node: Element, plain: bool) -> Iterator[str]:
    """The ports as they are declared: those of one width as one, `p: translation[3]`, those of a `planar` with their domain."""
    for whole, ports in groupby(node.ports, lambda p: multibond_of(p.name)):
        listed = tuple(ports)
        names, domains = [p.name[len(whole) + 1 :] for p in listed], [p.domain for p in listed]
        if not whole:
            yield from (p.name if plain else f"{p.name}: {p.domain}" for p in listed)
        elif listed[0].name.endswith("]"):
            yield f"{whole}: {domains[0]}[{len(listed)}]"
        else:
            yield f"{whole}: {next(name for name, parts in BUNDLES.items() if [*parts.items()] == [*zip(names, domains, strict=True)])}"


def _sides(node: Element, words: Words, heating: bool) -> list[Expression]:
    """Its energy, or the sides of its equations one after the other, over words."""
    equations = node.law.equations[:-1] if heating else node.law.equations
    sides = [s for pair in equations for s in pair] if node.law.energy is None else [node.law.energy]
    own = {
        s.key: Symbol(words.own(node, s.key))
        for side in sides
        for s in symbols(side)
        if isinstance(s.key, PortVariable)
    }

    def put(symbol: Symbol, named: bool) -> Expression:
        if isinstance(symbol.key, PortVariable):
            return own[symbol.key]
        argument = node.arguments[symbol.key]
        if not isinstance(argument, float):
            return Symbol(words.reference(argument))
        return Symbol(words.constant(argument)) if named else Number(argument)

    written = [substitute(side, lambda s: put(s, named=False)) for side in sides]
    if {s.key for s in own.values()} <= _keys(written):
        return written
    # A constant zero would take a variable out of the law: it keeps a name.
    return [substitute(side, lambda s: put(s, named=True)) for side in sides]


def _keys(sides: Sequence[Expression]) -> set[object]:
    return {s.key for side in sides for s in symbols(side)}


def _is_modulated(node: Element, words: Words, sides: Sequence[Expression]) -> bool:
    """Return True if the law reads a quantity that changes."""
    present = _keys(sides)
    read = [a for a in node.arguments if not isinstance(a, float)]
    return any(words.reference(a) in present and _changes(node, a, words) for a in read)


def _changes(node: Element, reference: Quantity | Reading, words: Words) -> bool:
    if isinstance(reference, Reading):
        return True
    if words.is_time(reference):
        return node.kind not in SOURCES
    return words.graph.quantities[reference.name].role not in ("parameter", "constant")


def _law_text(node: Element, words: Words, sides: Sequence[Expression]) -> str:
    printer = words.printer
    if node.law.energy is not None:
        has_power = all(DOMAINS[p.domain].has_power for p in node.ports)
        return f"energy = {printer.text(sides[0], JOULE if has_power else printer.usual(sides[0]))}"
    texts = []
    for left, right in zip(sides[0::2], sides[1::2], strict=True):
        wanted = printer.rigid(left) or printer.rigid(right) or printer.usual(left)
        texts.append(f"{printer.text(left, wanted)} = {printer.text(right, wanted)}")
    return ", ".join(texts)


def _attributes(node: Element, words: Words) -> Iterator[str]:
    for word, values in (("start", node.starts), ("nominal", node.nominals)):
        for number, (variable, bound) in values.items():
            port = node.ports[number]
            letter = words.letter(port.domain, variable)
            target = f"{port.name}.{letter}" if port.name else letter
            yield f"{word} {target} = {words.bound(bound, DOMAINS[port.domain].dimension(variable))}"
    for word, value in (("prefer", node.prefer), ("require", node.require)):
        if value is not None:
            yield f"{word} = {value}"
