"""Names in the text for references of the graph, with their dimensions."""

from __future__ import annotations

from ..algebra.expression import Expression
from ..algebra.formula import Bound, over
from ..graph.domains import DOMAINS
from ..graph.elements import OF_NODE, TRANSDUCERS
from ..graph.mechanism import domain_of
from ..graph.network import BondGraph, Element, Junction, MechanismNode, Named, PortVariable, Quantity, Reading
from ..graph.units import ONE, SECOND, Dimension
from .errors import UnwrittenPort
from .expressions import Printer, SymbolText
from .literals import NotWritable, dimension_of
from .names import ReferenceNames
from .ports import seen_at_a_node


class Words:
    """The words of one graph."""

    def __init__(self, graph: BondGraph, names: ReferenceNames, plain: bool) -> None:
        self.graph, self.names, self.plain = graph, names, plain
        self.printer = Printer(plain)
        self.constants: dict[float, str] = {}  # numbers that need a name
        self._nodes = {n.name: n for n in graph.nodes}
        outputs = {n for n in graph.outputs if n not in names.outputs}
        self._readable = {w for n, w in names.quantities.items() if n not in outputs}  # words that laws may read

    def bound(self, bound: Bound, wanted: Dimension) -> str:
        """A bound formula as text, in the SI unit of a dimension."""
        return self.printer.text(self._named(bound), wanted)

    def usual(self, bound: Bound) -> Dimension:
        """Dimension of a bound formula in which bare numbers have none."""
        return self.printer.usual(self._named(bound))

    def condition(self, bound: Bound) -> str:
        """A bound condition as text."""
        return self.printer.condition(self._named(bound))

    def _named(self, bound: Bound) -> Expression:
        """A bound formula over words."""
        texts = [a if isinstance(a, float) else self.reference(a) for a in bound.arguments]
        return over(bound.formula.expression, texts)

    def dimension(self, named: Named) -> Dimension:
        """Dimension of a quantity."""
        return ONE if self.plain else dimension_of(named.unit)

    def letter(self, domain: str, variable: str) -> str:
        """Letter for `e`, `f`, `q` or `p`."""
        return variable if self.plain else DOMAINS[domain].letter(variable)

    def is_time(self, reference: Quantity) -> bool:
        """Return True for the time, unless a quantity has that name."""
        return reference.name == "time" and "time" not in self.graph.quantities

    def reference(self, reference: Quantity | Reading) -> SymbolText:
        """Word for a reference in a law or definition."""
        if isinstance(reference, Reading):
            return self._reading(reference)
        if self.is_time(reference):
            return SymbolText("time", ONE if self.plain else SECOND)
        named = self.graph.quantities[reference.name]
        if named.role == "rate":
            assert named.definition is not None
            per_second = self.dimension(named)
            return SymbolText(
                f"der({self.bound(named.definition, per_second if self.plain else per_second * SECOND)})", per_second
            )
        return SymbolText(self.names.quantities[reference.name], self.dimension(named))

    def _reading(self, reading: Reading) -> SymbolText:
        reading = self._at_a_node(reading)
        node, variable = self._nodes[reading.node], reading.variable
        name = self.names.nodes[node.name]
        if isinstance(node, Junction):
            return SymbolText(f"{name}.{self.letter(node.domain, variable)}", DOMAINS[node.domain].dimension(variable))
        if isinstance(node, MechanismNode):
            return self._of_a_part(node, reading)
        port = next(p for p in node.ports if p.name == reading.port)
        letter = self.letter(port.domain, variable)
        if node.kind in TRANSDUCERS:
            path = f"{name}.{letter}{port.name}"
        else:
            path = f"{name}.{port.name}.{letter}" if port.name else f"{name}.{letter}"
        return SymbolText(path, DOMAINS[port.domain].dimension(variable))

    def _of_a_part(self, node: MechanismNode, reading: Reading) -> SymbolText:
        """`stage.pin.phi`, `stage.pin.phi.omega`, `stage.pin.reaction.x`."""
        part, _, inner = reading.port.partition(".")
        domain, variable = DOMAINS[domain_of(reading.port)], reading.variable
        path = f"{self.names.nodes[node.name]}.{self.names.parts[node.mechanism.name, part]}.{inner}"
        alone = variable == "q" or "." in inner  # a reaction or attitude has no letters
        return SymbolText(path if alone else f"{path}.{domain.letter(variable)}", domain.dimension(variable))

    def _at_a_node(self, reading: Reading) -> Reading:
        """A reading of a model's port as a reading of a node. Raises `NotWritable`."""
        found = seen_at_a_node(self.graph, reading)
        if found is None:
            domain = self.graph.bonds[self.graph.walls[reading.node, reading.port]].domain
            words = (reading.node, reading.port, self.letter(domain, reading.variable))
            raise NotWritable(UnwrittenPort, words=".".join(w for w in words if w))
        return found

    def own(self, node: Element, own: PortVariable) -> SymbolText:
        """An element's own variable: by its domain's letter, or by `e f q p` if another name equals that letter."""
        port = node.ports[own.port]
        domain = DOMAINS[port.domain]
        letter = self.letter(port.domain, own.variable) if domain.guessed else own.variable
        if node.kind in TRANSDUCERS:
            text = letter + port.name
        elif not port.name:
            text = letter if letter not in self._readable else own.variable
        elif own.variable == OF_NODE[node.kind].stored and port.name not in self._readable:
            text = port.name
        else:
            text = f"{port.name}.{letter}"
        return SymbolText(text, domain.dimension(own.variable))

    def constant(self, value: float) -> SymbolText:
        """A number with a name."""
        if value not in self.constants:
            self.constants[value] = name = self.names.free("constant_1", set(), self.names.taken)
            self.names.taken.add(name)
        return SymbolText(self.constants[value], ONE)
