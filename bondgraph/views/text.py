"""Back to text: a flat graph as one model without instances, which compiles to an equal graph.

Units are gone in a graph, so the number in `F = 2e4*x^3` has lost its own. What a number stands beside gives it back: names and
variables have known dimensions, and a number takes the one that its sum, law or definition needs. Where no number is left to take
it, `1 [N/m]` is written as a factor, which vanishes again when the text is read: the laws are the same expressions, bit by bit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

from compiler.algebra.expression import (
    CONDITIONS,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    divide,
    multiply,
    negate,
    substitute,
    symbols,
)
from compiler.algebra.formula import Bound
from compiler.graph.domains import DOMAINS
from compiler.graph.mechanism import Body, Joint, Mechanism
from compiler.graph.network import BondGraph, Element, End, Junction, Kind, MechanismNode, Named, Own, Quantity, Reading
from compiler.graph.units import JOULE, KILOGRAM, METRE, ONE, SECOND, Dimension

from ..errors import UsageError

STORED = {Kind.CAPACITOR: "q", Kind.INERTIA: "p"}
INWARD = (Kind.CAPACITOR, Kind.INERTIA, Kind.STORAGE_FIELD, Kind.RESISTOR)
TWO_SIDED = (Kind.TRANSFORMER, Kind.GYRATOR)
ROLES = {"parameter": "parameter", "constant": "constant", "input": "input"}  # all others are signals
MAXIMUM_TERMS = 200_000  # of one expression: what is shared in the graph is written out here


def graph_text(graph: BondGraph) -> str:
    """The .bg text of one flat model: elements, bonds, laws, quantities, mechanisms, with numbers in SI.

    Names that a text cannot have (`comb[1].folded`) are mapped one to one and follow in a comment. Typed graphs stay typed. What
    cannot be typed (a unit with an exponent beyond the language's, a port without domain that no junction tells) becomes a
    `plain model` with the same numbers, and a comment says so. Raises `UsageError` for what no text can say.
    """
    try:
        return _Writer(graph, _is_plain(graph), "").text()
    except _Untyped as problem:
        if any(isinstance(n, MechanismNode) for n in graph.nodes):
            raise UsageError(f"`{graph.name}` cannot be written as text: {problem}") from None
        return _Writer(graph, True, str(problem)).text()


class _Untyped(Exception):
    """The model cannot be written with units."""


def _is_plain(graph: BondGraph) -> bool:
    """Whether the graph has ports, all of them untyped, and no unit anywhere."""
    domains = {d for n in graph.nodes for d in ([n.domain] if isinstance(n, Junction) else [p.domain for p in n.ports])}
    named = (*graph.quantities.values(), *graph.outputs.values())
    return domains == {"untyped"} and all(n.unit == "1" for n in named)


# ---------------------------------------------------------------- numbers, units, bonds as text


def number_text(value: float) -> str:
    """A number that is read again as the same double, also beyond what one literal of the language can say."""
    size = abs(value)
    if size and not 1e-299 < size < 1e299:  # powers of two cost no digit
        return f"{value * 2.0**600!r}/2^600" if size < 1 else f"{value / 2.0**600!r}*2^600"
    short = f"{value:.6g}"
    if float(short) == value:
        return short
    return repr(int(value)) if value == int(value) and size < 1e15 else repr(float(value))


def bond_lines(bonds: Iterable[tuple[str, str, str]]) -> Iterator[str]:
    """Bonds (tail, arrow, head) as chains and fans that are read again in the same order."""
    groups: list[list[str]] = []
    arrows: list[str] = []
    for tail, arrow, head in bonds:
        if groups and groups[-2] == [tail] and arrows[-1] == arrow and head not in groups[-1]:
            groups[-1].append(head)
        elif groups and groups[-1] == [tail]:
            groups.append([head])
            arrows.append(arrow)
        else:
            yield from _chain(groups, arrows)
            groups, arrows = [[tail], [head]], [arrow]
    yield from _chain(groups, arrows)


def _chain(groups: list[list[str]], arrows: list[str]) -> Iterator[str]:
    if groups:
        yield "".join(f"{', '.join(g)} {a} " for g, a in zip(groups, arrows, strict=False)) + ", ".join(groups[-1])


@cache
def _dimension_of(unit: str) -> Dimension:
    """The dimension of a unit as graphs write it."""
    from ..door import Literal, Source, parse_expression, scale_of

    found = parse_expression(Source("unit", f"1 [{unit}]"))
    assert isinstance(found, Literal) and found.unit is not None
    return scale_of(found.unit).dimension


def _unit(dimension: Dimension) -> str:
    """The SI unit of a dimension. Raises `_Untyped` if the language cannot write it."""
    if any(abs(e) > 20 or e.denominator > 20 for e in dimension.exponents):
        raise _Untyped(f"the language has no unit for {dimension}")
    return str(dimension)


# ---------------------------------------------------------------- expressions


class _Word(NamedTuple):
    """What a symbol is in the text."""

    text: str
    dimension: Dimension


# How tightly a piece of text holds together; the order of the grammar.
CHOICE, OR, AND, NOT, COMPARISON, SUM, PRODUCT, SIGN, POWER, ATOM = range(10)
FUNCTIONS = frozenset(
    ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log", "log10", "floor", "ceil"]
)  # fmt: skip
COMPARED = {"less": "<", "less_equal": "<=", "equal": "=="}


class _Printer:
    """Expressions over `_Word`s as text of a wanted dimension."""

    def __init__(self, plain: bool) -> None:
        self.plain = plain
        self._rigid: dict[Expression, Dimension | None] = {}
        self._size: dict[Expression, int] = {}

    def text(self, x: Expression, wanted: Dimension) -> str:
        """The expression, in the SI unit of a dimension."""
        if self._terms(x) > MAXIMUM_TERMS:
            raise UsageError(f"an expression of more than {MAXIMUM_TERMS} terms cannot be written as text")
        text, _ = self._write(x, ONE if self.plain else wanted)
        if text.count("(") > 30:
            self._check(text)
        return text

    def _check(self, text: str) -> None:
        from ..door import CompilationFailed, Source, parse_expression

        try:
            parse_expression(Source("expression", text))
        except CompilationFailed as failed:
            raise UsageError(f"an expression of the graph is too large for one of the text: {failed}") from None

    def _terms(self, x: Expression) -> int:
        if x not in self._size:
            self._size[x] = 1 + sum(map(self._terms, x.operands)) if isinstance(x, Apply) else 1
        return self._size[x]

    # ------------------------------------------------------------ dimensions
    def rigid(self, x: Expression) -> Dimension | None:
        """The dimension of an expression; None if a number in it can take any."""
        if x not in self._rigid:
            self._rigid[x] = self._dimension(x, None)
        return self._rigid[x]

    def usual(self, x: Expression) -> Dimension:
        """The dimension of an expression in which numbers that are free have no unit."""
        found = self.rigid(x)
        if found is None:
            found = self._dimension(x, ONE)
        return ONE if found is None else found

    def _dimension(self, x: Expression, number: Dimension | None) -> Dimension | None:
        if self.plain:
            return ONE
        if isinstance(x, Number):
            return number
        if isinstance(x, Symbol):
            return x.key.dimension  # type: ignore[no-any-return]
        assert isinstance(x, Apply)
        operator, operands = x.operator, x.operands
        inner = self.rigid if number is None else self.usual
        if operator in ("multiply", "divide"):
            found = [inner(o) for o in operands]
            result = ONE
            for i, dimension in enumerate(found):
                if dimension is None:
                    return None
                result = result / dimension if operator == "divide" and i else result * dimension
            return result
        if operator in ("power", "sqrt"):
            exponent = _exponent(x)
            base = inner(operands[0])
            return ONE if exponent is None else (None if base is None else base**exponent)
        if operator in ("add", "min", "max", "abs", "select"):
            parts = operands[1:] if operator == "select" else operands
            known = next((d for d in map(self.rigid, parts) if d is not None), None)
            return known if known is not None or number is None else self.usual(parts[0])
        return ONE

    def _common(self, parts: Sequence[Expression]) -> Dimension:
        return next((d for d in map(self.rigid, parts) if d is not None), None) or self.usual(parts[0])

    # ------------------------------------------------------------ text
    def _at(self, level: int, x: Expression, wanted: Dimension) -> str:
        text, found = self._write(x, wanted)
        return text if found >= level else f"({text})"

    def _write(self, x: Expression, wanted: Dimension) -> tuple[str, int]:
        """Text of the wanted dimension, and how tightly it holds together."""
        if isinstance(x, Number):
            return self._number(x.value, wanted)
        assert isinstance(x, Symbol | Apply)
        if isinstance(x, Apply) and x.operator in CONDITIONS:
            return self._scaled(f"(1 if {self._condition(x)[0]} else 0)", ATOM, wanted)
        rigid = self.rigid(x)
        if rigid is not None and rigid != wanted:
            text, level = self._write(x, rigid)
            return self._scaled(text, level, wanted / rigid)
        if isinstance(x, Symbol):
            return x.key.text, ATOM
        return self._apply(x, wanted)

    @staticmethod
    def _number(value: float, wanted: Dimension) -> tuple[str, int]:
        if value == 0:
            return "0", ATOM
        text = number_text(value)
        level = PRODUCT if "2^600" in text else SIGN if value < 0 else ATOM
        if wanted == ONE:
            return text, level
        unit = _unit(wanted)
        number = f"{text} {unit}" if unit.isidentifier() else f"{text} [{unit}]"
        return (number, level) if level != PRODUCT else (f"{text}*1 [{unit}]", PRODUCT)

    @staticmethod
    def _scaled(text: str, level: int, unit: Dimension) -> tuple[str, int]:
        """Brought to another unit by a factor of one, which vanishes when it is read."""
        if unit == ONE:
            return text, level
        return f"1 [{_unit(unit)}]*{text if level >= POWER else f'({text})'}", PRODUCT

    def _apply(self, x: Apply, wanted: Dimension) -> tuple[str, int]:
        operator, operands = x.operator, x.operands
        if operator == "add":
            return self._sum(operands, wanted), SUM
        if operator == "multiply":
            return self._product(operands, wanted)
        if operator == "divide":
            return self._quotient(*operands, wanted)
        if operator == "power":
            return self._power(x, wanted)
        if operator == "select":
            condition, value, otherwise = operands
            return (
                f"{self._at(OR, value, wanted)} if {self._condition(condition)[0]} else {self._at(OR, otherwise, wanted)}",
                CHOICE,
            )
        if operator == "sqrt":
            return f"sqrt({self._write(operands[0], wanted**2)[0]})", ATOM
        if operator in ("abs", "min", "max"):
            return f"{operator}({', '.join(self._write(o, wanted)[0] for o in operands)})", ATOM
        if operator in ("sign", "atan2"):
            common = self._common(operands)
            text = f"{operator}({', '.join(self._write(o, common)[0] for o in operands)})"
        elif operator in FUNCTIONS:
            text = f"{operator}({', '.join(self._write(o, ONE)[0] for o in operands)})"
        else:
            raise UsageError(f"the operator `{operator}` of the graph has no name in the language")
        return text, ATOM

    def _sum(self, terms: Sequence[Expression], wanted: Dimension) -> str:
        if _is_negative(terms[0]) and isinstance(terms[-1], Number) and not _is_negative(terms[-1]):
            terms = (terms[-1], *terms[:-1])  # `1 - x`: a number goes to the end again when it is read
        text = self._at(PRODUCT, terms[0], wanted)
        for term in terms[1:]:
            minus = _is_negative(term)
            text += f" {'-' if minus else '+'} {self._at(POWER if isinstance(term, Number) else PRODUCT, negate(term) if minus else term, wanted)}"
        return text

    def _product(self, factors: Sequence[Expression], wanted: Dimension) -> tuple[str, int]:
        free = next((i for i, f in enumerate(factors) if self.rigid(f) is None), None)
        units = [self.usual(f) for f in factors]
        if free is not None:
            rest = ONE
            for i, unit in enumerate(units):
                rest = rest if i == free else rest * unit
            units[free] = wanted / rest
        first, negative = factors[0], ""
        if isinstance(first, Number) and first.value == -1.0 and units[0] == ONE:
            negative, factors, units = "-", factors[1:], units[1:]
        parts = [
            self._at(PRODUCT if i == 0 and not negative else POWER, f, u)
            for i, (f, u) in enumerate(zip(factors, units, strict=True))
        ]
        return negative + "*".join(parts), PRODUCT if len(parts) > 1 else SIGN

    def _quotient(self, top: Expression, bottom: Expression, wanted: Dimension) -> tuple[str, int]:
        if self.rigid(top) is None:
            below = self.usual(bottom)
            above = wanted * below
        else:  # if the bottom were known too, the whole would be
            above = self.usual(top)
            below = above / wanted
        return f"{self._at(PRODUCT, top, above)}/{self._at(POWER, bottom, below)}", PRODUCT

    def _power(self, x: Apply, wanted: Dimension) -> tuple[str, int]:
        base, exponent = x.operands
        power = _exponent(x)
        inner = ONE
        if power is not None:
            inner = self.usual(base) if self.rigid(base) is not None else wanted ** (1 / power)
        return f"{self._at(ATOM, base, inner)}^{self._at(ATOM, exponent, ONE)}", POWER

    def _condition(self, x: Expression) -> tuple[str, int]:
        assert isinstance(x, Apply)
        if x.operator in COMPARED:
            common = self._common(x.operands)
            left, right = (self._at(SUM, o, common) for o in x.operands)
            return f"{left} {COMPARED[x.operator]} {right}", COMPARISON

        def inner(level: int, operand: Expression) -> str:
            text, found = self._condition(operand)
            return text if found >= level else f"({text})"

        if x.operator == "not":
            return f"not {inner(COMPARISON, x.operands[0])}", NOT
        if x.operator in ("and", "or"):
            level = AND if x.operator == "and" else OR
            left, right = x.operands
            return f"{inner(level, left)} {x.operator} {inner(level + 1, right)}", level
        raise UsageError(f"the condition `{x.operator}` of the graph has no name in the language")


def _exponent(x: Apply) -> Fraction | None:
    """The exponent of a power or root as the compiler takes it for units; None if it is no number."""
    if x.operator == "sqrt":
        return Fraction(1, 2)
    exponent = x.operands[1]
    found = Fraction(exponent.value).limit_denominator(60) if isinstance(exponent, Number) else None
    return found or None


def _is_negative(x: Expression) -> bool:
    first = x.operands[0] if isinstance(x, Apply) and x.operator == "multiply" else x
    return isinstance(first, Number) and first.value < 0


# ---------------------------------------------------------------- names


@dataclass(slots=True)
class _Names:
    """Names of the graph -> names of the text."""

    quantities: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    nodes: dict[str, str] = field(default_factory=dict)
    parts: dict[tuple[str, str], str] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def free(self, name: str, blocked: set[str], taken: set[str]) -> str:
        """A valid name like this one that nothing has yet."""
        word = re.sub(r"[^A-Za-z0-9_]+", "_", name)
        word = (word if word == name else word.rstrip("_")) or "unnamed"
        word = word if not word[0].isdigit() else f"n{word}"
        found, number = word, 1
        while found in taken or found in blocked:
            number += 1
            found = f"{word}_{number}"
        return found


def _own_words(node: Element) -> set[str]:
    """The words that the law of an element takes for its own variables."""
    if _is_field(node):
        return {p.name for p in node.ports}
    letters = [(p, v, DOMAINS[p.domain].letter(v)) for p in node.ports for v in _variables(node)]
    return {letter + p.name for p, *both in letters for letter in both}


def _variables(node: Element) -> str:
    """The variables that the law of an element may relate."""
    from compiler.semantics.laws import LAW_VARIABLES

    return LAW_VARIABLES[node.kind.value]


def _is_field(node: Element) -> bool:
    """Whether its ports have names, and its variables are written `port.letter`."""
    return node.kind not in TWO_SIDED and bool(node.ports[0].name)


def _tells(domain: str) -> bool:
    """Whether the letters of a law are taken to mean this domain."""
    return DOMAINS[domain].typed and DOMAINS[domain].guessed


def _names(graph: BondGraph, shared: Mapping[str, End], separate: set[str], plain: bool) -> _Names:
    """Give every name of the graph one of the text; those that are valid stay. `separate` outputs need a name of their own."""
    from compiler.semantics.scope import RESERVED

    elements = [n for n in graph.nodes if isinstance(n, Element)]
    always = set(RESERVED) | {"energy"} | _blocked_letters(graph, elements, plain)
    blocked: dict[tuple[str, str], set[str]] = {}
    for element in elements:  # what a law reads cannot be called like its own variables
        words = _own_words(element)
        for argument in element.arguments:
            if isinstance(argument, Quantity | Reading):
                key = ("quantity", argument.name) if isinstance(argument, Quantity) else ("node", argument.node)
                blocked.setdefault(key, set()).update(words)
    names = _Names()
    wanted = [("quantity", n) for n in graph.quantities] + [("output", n) for n in separate]
    wanted += [("node", n.name) for n in graph.nodes if n.name not in shared]
    home = {"quantity": names.quantities, "output": names.outputs, "node": names.nodes}
    later = []
    for kind, name in wanted:
        if _is_name(name) and name not in names.taken | always | blocked.get((kind, name), set()):
            home[kind][name] = name
            names.taken.add(name)
        else:
            later.append((kind, name))
    for kind, name in later:
        home[kind][name] = found = names.free(name, always | blocked.get((kind, name), set()), names.taken)
        names.taken.add(found)
    for node in graph.nodes:
        if isinstance(node, MechanismNode):
            _part_names(node.mechanism, names, always)
    return names


def _is_name(name: str) -> bool:
    return re.fullmatch(r"[A-Za-z_][A-Za-z_0-9]*", name) is not None


def _part_names(mechanism: Mechanism, names: _Names, always: set[str]) -> None:
    """Parts are looked up before quantities, so none has the name of one."""
    taken = set(names.quantities.values())
    parts = [p.name for p in (*mechanism.bodies, *mechanism.frames, *mechanism.joints)]
    for name in sorted(parts, key=lambda n: not _is_name(n)):
        found = names.free(name, always, taken)
        names.parts[mechanism.name, name] = found
        taken.add(found)


def _blocked_letters(graph: BondGraph, elements: Sequence[Element], plain: bool) -> set[str]:
    """Letters that no quantity may have: a law could not name its own variable otherwise, or would not tell its domain."""
    read = {n for n, q in graph.quantities.items() if q.role != "output"}
    blocked: set[str] = set()
    for element in elements:
        if element.kind in TWO_SIDED:
            blocked |= _own_words(element)
        elif not _is_field(element):
            domain = DOMAINS["untyped" if plain else element.ports[0].domain]
            letters = {v: domain.letter(v) if domain.guessed else v for v in _variables(element)}
            blocked |= {v for v, letter in letters.items() if letter == v or letter in read}
    for bond in graph.bonds if not plain else ():
        ends = [graph.nodes[bond.tail.node], graph.nodes[bond.head.node]]
        alone = [n for n in ends if isinstance(n, Element) and not _is_field(n)]
        if len(alone) == 2:  # no junction, field or mechanism tells the domain: a law must
            if not _tells(bond.domain):
                raise _Untyped(f"nothing could tell the domain of the bond from `{ends[0].name}` to `{ends[1].name}`")
            blocked |= _own_words(alone[0])
    return blocked


# ---------------------------------------------------------------- statements


class _Writer:
    """Writes one graph."""

    def __init__(self, graph: BondGraph, plain: bool, reason: str) -> None:
        self.graph, self.plain, self.reason = graph, plain, reason
        self.printer = _Printer(plain)
        self.shared = _shared_ports(graph)
        self.heating = _heating(graph)
        separate = {
            n for n in graph.outputs if n not in graph.quantities or graph.quantities[n].role in ("parameter", "constant", "input")
        }  # fmt: skip
        self.names = _names(graph, self.shared, separate, plain)
        self.read = {w for n, w in self.names.quantities.items() if not self._is_output(n)}  # what laws may read
        self.by_name = {n.name: n for n in graph.nodes}
        self.constants: dict[float, str] = {}

    def text(self) -> str:
        """The whole text."""
        nodes = [line for n in self.graph.nodes if n.name not in self.shared for line in self._node(n)]
        quantities = [self._quantity(q) for n, q in self.graph.quantities.items() if not self._is_output(n)]
        quantities += [f"constant {name} = {number_text(value)}" for value, name in self.constants.items()]
        outputs = [self._output(n, named) for n, named in self.graph.outputs.items()]
        parts = [quantities, nodes, list(bond_lines(self._bonds())), outputs]
        body = "\n\n".join("\n".join(f"  {line}" for line in lines) for lines in parts if lines)
        head = f"# {_comment(self.graph.name)}, flat: its instances are opened, its numbers are in SI.\n"
        if self.reason:
            head += f"# Written without units, with the same numbers: {_comment(self.reason)}.\n"
        return f"{head}{'plain ' if self.plain else ''}model {self.graph.name} {{\n{body}\n}}\n"

    def _is_output(self, name: str) -> bool:
        return name in self.graph.outputs and name not in self.names.outputs

    # ------------------------------------------------------------ what is read
    def _reference(self, reference: Quantity | Reading) -> _Word:
        if isinstance(reference, Reading):
            return self._reading(reference)
        if reference.name == "time" and "time" not in self.graph.quantities:
            return _Word("time", SECOND)
        return _Word(self.names.quantities[reference.name], _dimension_of(self.graph.quantities[reference.name].unit))

    def _reading(self, reading: Reading) -> _Word:
        node, variable = self.by_name[reading.node], reading.variable
        if isinstance(node, Junction):
            domain, name = DOMAINS[node.domain], self.names.nodes[node.name]
            return _Word(f"{name}.{self._letter(node.domain, variable)}", domain.dimension(variable))
        name = self.names.nodes[node.name]
        if isinstance(node, MechanismNode):
            part, _, freedom = reading.port.rpartition(".")
            domain = DOMAINS["rotation" if freedom == "phi" else "translation"]
            path = f"{name}.{self.names.parts[node.mechanism.name, part]}.{freedom}"
            return _Word(path if variable == "q" else f"{path}.{domain.letter(variable)}", domain.dimension(variable))
        port = next(p for p in node.ports if p.name == reading.port)
        letter = self._letter(port.domain, variable)
        if node.kind in TWO_SIDED:
            path = f"{name}.{letter}{port.name}"
        else:
            path = f"{name}.{port.name}.{letter}" if port.name else f"{name}.{letter}"
        return _Word(path, DOMAINS[port.domain].dimension(variable))

    def _letter(self, domain: str, variable: str) -> str:
        return variable if self.plain else DOMAINS[domain].letter(variable)

    def _bound(self, bound: Bound, wanted: Dimension) -> str:
        """A bound formula as text."""

        def put(symbol: Symbol) -> Expression:
            argument = bound.arguments[symbol.key]
            return Number(argument) if isinstance(argument, float) else Symbol(self._reference(argument))

        return self.printer.text(substitute(bound.formula.expression, put), wanted)

    # ------------------------------------------------------------ quantities
    def _quantity(self, named: Named) -> str:
        name = self.names.quantities[named.name]
        return self._item(ROLES.get(named.role, "signal"), name, named)

    def _output(self, name: str, named: Named) -> str:
        if name in self.names.outputs:
            return self._item("output", self.names.outputs[name], named)
        return self._item("output", self.names.quantities[name], self.graph.quantities[name])

    def _item(self, role: str, name: str, named: Named) -> str:
        dimension = _dimension_of(named.unit)
        integral = self.graph.integrals.get(named.name)
        if integral is not None:
            value = (
                f"integral({self._bound(integral.rate, dimension / SECOND)}, {self._bound(integral.start, dimension)})"
            )
        elif named.definition is not None:
            value = self._bound(named.definition, dimension)
        else:
            raise UsageError(f"`{named.name}` has no value, so the graph is that of a part and no model")
        unit = "" if self.plain or dimension == ONE else f": {_unit(dimension)}"
        if unit and re.fullmatch(r"-?[0-9.e+-]+ (\[.*\]|\w+)", value):  # `k: N/m = 5`: a bare number is in that unit
            value = value.split()[0]
        return f"{role} {name}{unit} = {value}{_description(named.description)}{_was(named.name, name)}"

    # ------------------------------------------------------------ nodes
    def _node(self, node: Element | Junction | MechanismNode) -> Iterator[str]:
        name = self.names.nodes[node.name]
        if isinstance(node, MechanismNode):
            yield from self._mechanism(node.mechanism, name)
        elif isinstance(node, Junction):
            yield f"{node.kind.value} {name}{'' if self.plain else f' : {node.domain}'}{_was(node.name, name)}"
        else:
            listed = ", ".join(p.name if self.plain else f"{p.name}: {p.domain}" for p in node.ports)
            ports = f"({listed})" if _is_field(node) else ""
            law, modulated = self._law(node)
            kind = f"{'M' if modulated else ''}{node.kind.value}{'S' if node.name in self.heating else ''}"
            yield f"{kind} {name}{ports} : {law}{_braces(self._attributes(node))}{_was(node.name, name)}"

    def _law(self, node: Element) -> tuple[str, bool]:
        """The law, and whether it reads what changes elsewhere."""
        written_ones = node.law.equations[:-1] if node.name in self.heating else node.law.equations
        sides = [s for pair in written_ones for s in pair] if node.law.energy is None else [node.law.energy]
        words = {own: Symbol(self._own(node, own)) for side in sides for own in _own_of(side)}

        def put(symbol: Symbol, folding: bool) -> Expression:
            if isinstance(symbol.key, Own):
                return words[symbol.key]
            argument = node.arguments[symbol.key]
            if not isinstance(argument, float):
                return Symbol(self._reference(argument))
            return Number(argument) if folding else Symbol(_Word(self._constant(argument), ONE))

        written = [substitute(s, lambda symbol: put(symbol, True)) for s in sides]
        kept = {s.key for side in written for s in symbols(side)}
        if not all(
            w.key in kept for w in words.values()
        ):  # a constant zero would take a variable out of the law: it keeps a name
            written = [substitute(s, lambda symbol: put(symbol, False)) for s in sides]
        present = {s.key for side in written for s in symbols(side)}
        modulated = any(
            self._changes(node, a) for a in node.arguments if not isinstance(a, float) and self._reference(a) in present
        )
        if node.law.energy is not None:
            true_power = all(DOMAINS[p.domain].typed and p.domain != "pseudothermal" for p in node.ports)
            wanted = JOULE if true_power else self.printer.usual(written[0])
            return f"energy = {self.printer.text(written[0], wanted)}", modulated
        equations = []
        for left, right in zip(written[0::2], written[1::2], strict=True):
            wanted = self.printer.rigid(left) or self.printer.rigid(right) or self.printer.usual(left)
            equations.append(f"{self.printer.text(left, wanted)} = {self.printer.text(right, wanted)}")
        return ", ".join(equations), modulated

    def _changes(self, node: Element, reference: Quantity | Reading) -> bool:
        if isinstance(reference, Reading):
            return True
        if reference.name == "time" and "time" not in self.graph.quantities:
            return node.kind not in (Kind.EFFORT_SOURCE, Kind.FLOW_SOURCE)
        return self.graph.quantities[reference.name].role not in ("parameter", "constant")

    def _constant(self, value: float) -> str:
        if value not in self.constants:
            self.constants[value] = name = self.names.free("constant_1", set(), self.names.taken)
            self.names.taken.add(name)
        return self.constants[value]

    def _own(self, node: Element, own: Own) -> _Word:
        """An element's own variable: by its domain's letter, or by `e f q p` if something else has that name."""
        port = node.ports[own.port]
        domain = DOMAINS[port.domain]
        letter = self._letter(port.domain, own.variable) if domain.guessed else own.variable
        if node.kind in TWO_SIDED:
            text = letter + port.name
        elif not port.name:
            text = letter if letter not in self.read else own.variable
        elif own.variable == STORED.get(node.kind) and port.name not in self.read:
            text = port.name
        else:
            text = f"{port.name}.{letter}"
        return _Word(text, domain.dimension(own.variable))

    def _attributes(self, node: Element) -> Iterator[str]:
        for word, values in (("start", node.starts), ("nominal", node.nominals)):
            for number, (variable, bound) in values.items():
                port = node.ports[number]
                letter = self._letter(port.domain, variable)
                target = f"{port.name}.{letter}" if port.name else letter
                yield f"{word} {target} = {self._bound(bound, DOMAINS[port.domain].dimension(variable))}"
        for word, value in (("prefer", node.prefer), ("require", node.require)):
            if value is not None:
                yield f"{word} = {value}"

    # ------------------------------------------------------------ mechanisms
    def _mechanism(self, mechanism: Mechanism, name: str) -> Iterator[str]:
        yield f"multibody {name} : planar {{{_was(mechanism.name, name)}"

        def part(words: str, own: str, attributes: Iterable[str]) -> str:
            mapped = self.names.parts[mechanism.name, own]
            return f"  {words.replace('@', mapped, 1)}{_braces(attributes)}{_was(own, mapped)}"

        def place(body: str) -> str:
            return self.names.parts.get((mechanism.name, body), body)

        gravity = self._point(mechanism.gravity, METRE / SECOND**2)
        if gravity != "(0, 0)":
            yield f"  gravity = {gravity}"
        for body in mechanism.bodies:
            yield part("body @", body.name, self._body(body))
        for frame in mechanism.frames:
            yield part(f"frame @ : {place(frame.body)}", frame.name, self._at(frame.position))
        for joint in mechanism.joints:
            yield part(
                f"{joint.kind} @ : {place(joint.first)} to {place(joint.second)}", joint.name, self._joint(joint)
            )
        yield "}"

    def _body(self, body: Body) -> Iterator[str]:
        for word, bound, dimension in (("mass", body.mass, KILOGRAM), ("inertia", body.inertia, KILOGRAM * METRE**2)):
            value = self._bound(bound, dimension)
            if value != "0":
                yield f"{word} = {value}"
        yield from self._at(body.position)
        angle = self._bound(body.angle, ONE)
        if angle != "0":
            yield f"angle = {angle}"
        yield from self._starts(body.starts)

    def _joint(self, joint: Joint) -> Iterator[str]:
        yield from self._at(joint.position)
        angle = self._bound(joint.angle, ONE)
        if joint.kind == "slide" or angle != "0":
            yield f"{'along' if joint.kind == 'slide' else 'angle'} = {angle}"
        if joint.axes != "from":
            yield f"axes = {joint.axes}"
        yield from self._starts(joint.starts)

    def _at(self, point: tuple[Bound, Bound]) -> Iterator[str]:
        where = self._point(point, METRE)
        if where != "(0, 0)":
            yield f"at = {where}"

    def _point(self, point: tuple[Bound, Bound], dimension: Dimension) -> str:
        return f"({', '.join(self._bound(b, dimension) for b in point)})"

    def _starts(self, starts: Mapping[str, Bound]) -> Iterator[str]:
        for key, bound in starts.items():
            freedom, _, rate = key.partition(".")
            domain = DOMAINS["rotation" if freedom == "phi" else "translation"]
            target = f"{freedom}.{domain.letter('f')}" if rate else freedom
            yield f"start {target} = {self._bound(bound, domain.dimension('f' if rate else 'q'))}"

    # ------------------------------------------------------------ bonds
    def _bonds(self) -> Iterator[tuple[str, str, str]]:
        for bond in self.graph.bonds:
            tail, head = self.graph.nodes[bond.tail.node], self.graph.nodes[bond.head.node]
            if self.shared.get(tail.name) == bond.head:
                continue  # from a junction that several bonds of one part make
            if isinstance(tail, Element) and tail.kind in INWARD and tail.name not in self.heating:
                raise UsageError(f"a bond leaves `{tail.name}`, but power counts as positive into C, I and R")
            for node, end, side in ((tail, bond.tail, 1), (head, bond.head, 0)):
                if node.kind in TWO_SIDED and end.port != side:
                    raise UsageError(f"the bonds of `{node.name}` do not run from its side 1 to its side 2")
            yield self._place(bond.tail), "->", self._place(bond.head)

    def _place(self, end: End) -> str:
        node = self.graph.nodes[end.node]
        if node.name in self.shared:
            return self._place(self.shared[node.name])
        name = self.names.nodes[node.name]
        if isinstance(node, Junction) or node.kind in TWO_SIDED:
            return name
        port = node.ports[end.port].name
        if isinstance(node, MechanismNode):
            part, _, freedom = port.rpartition(".")
            return f"{name}.{self.names.parts[node.mechanism.name, part]}.{freedom}"
        return f"{name}.{port}" if port else name


def _shared_ports(graph: BondGraph) -> dict[str, End]:
    """Junctions that the compiler puts where several bonds meet a part of a mechanism -> that port."""
    found = {}
    for bond in graph.bonds:
        node, other = graph.nodes[bond.tail.node], graph.nodes[bond.head.node]
        if isinstance(node, Junction) and isinstance(other, MechanismNode):
            if node.name == f"{other.name}.{other.ports[bond.head.port].name}":
                found[node.name] = bond.head
    return found


def _heating(graph: BondGraph) -> set[str]:
    """Resistors with a last port that a bond leaves, which gives what the others lose: in text an `RS`, without that equation."""
    found = set()
    for bond in graph.bonds:
        node = graph.nodes[bond.tail.node]
        if isinstance(node, Element) and node.kind is Kind.RESISTOR and bond.tail.port == len(node.ports) - 1 > 0:
            last = len(node.ports) - 1
            power = add(*(multiply(Symbol(Own(p, "e")), Symbol(Own(p, "f"))) for p in range(last)))
            if node.law.equations[-1:] == ((Symbol(Own(last, "f")), divide(power, Symbol(Own(last, "e")))),):
                found.add(node.name)
    return found


def _own_of(x: Expression) -> list[Any]:
    return [s.key for s in symbols(x) if isinstance(s.key, Own)]


def _braces(attributes: Iterable[str]) -> str:
    inner = ", ".join(attributes)
    return f" {{ {inner} }}" if inner else ""


def _description(text: str) -> str:
    """A description as a literal. Raises `UsageError` if it cannot stand in one."""
    if '"' in text or "\n" in text:
        raise UsageError("a description with a quotation mark or a line break cannot stand in a text")
    return f' "{text}"' if text else ""


def _was(before: str, now: str) -> str:
    return "" if before == now else f"  # {_comment(before)}"


def _comment(text: str) -> str:
    """Text that stays in its comment: what is not printable is shown by its number."""
    return "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text)
