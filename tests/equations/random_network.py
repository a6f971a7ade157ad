"""Random well-formed bond graphs, twice: as .bg text for the compiler, and as a flat network of residuals for the oracle.

A `Part` is one model: junctions in a random tree with some loops of bonds, elements on them, and instances of further parts
behind ports. Its statements are written as it grows; `flatten` builds the oracle's network from the same data, each law from a
formula of its own, never from the compiler's result.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hypothesis import strategies as st

from tests.equations.network_oracle import Network, Values
from tests.equations.time_series import exp, sin, sinh

# effort, flow, displacement, momentum: letters and units
DOMAINS = {
    "translation": (("F", "v", "x", "p"), ("N", "m/s", "m", "N*s")),
    "rotation": (("M", "omega", "phi", "L"), ("N*m", "rad/s", "rad", "N*m*s")),
    "electric": (("u", "i", "q", "lambda"), ("V", "A", "C", "V*s")),
    "hydraulic": (("P", "Q", "V", "Gamma"), ("Pa", "m^3/s", "m^3", "Pa*s")),
    "untyped": (("e", "f", "q", "p"), ("1", "1", "1", "1")),
}
VARIABLES = "efqp"
NUMBERS = (
    1.0, 0.73, 1.37, 2.11, 0.41, 1.93, 0.59, 2.83, 1.19, 0.89, 3.17, 0.31, 1.61, 2.39, 0.67, 1.07, 2.69, 0.53, 1.79, 3.61,
    0.47, 1.27, 0.83, 2.03, 1.49, 0.37, 1.13, 2.21, 0.97, 3.07, 0.61, 1.87, 1.43, 0.79, 2.57, 1.31, 0.43, 1.73, 0.71, 2.93,
)  # fmt: skip


class Choices:
    """Hypothesis' choices with shorter names; the first of each is the simplest."""

    def __init__(self, draw: Callable[[Any], Any]) -> None:
        self._draw = draw

    def integer(self, low: int, high: int) -> int:
        return int(self._draw(st.integers(low, high)))

    def one(self, options: Sequence[Any]) -> Any:
        return options[self.integer(0, len(options) - 1)]

    def chance(self, percent: int) -> bool:
        """False is the simple answer."""
        return self.integer(0, 99) >= 100 - percent

    def number(self) -> float:
        return float(self.one(NUMBERS))


class ManyChoices(Choices):
    """The same from a generator of random numbers: hypothesis likes to repeat itself with small changes, which a long run does not."""

    def __init__(self, seed: str) -> None:
        self._random = random.Random(seed)

    def integer(self, low: int, high: int) -> int:
        return self._random.randint(low, high)


def over(top: str, bottom: str, power: int = 1) -> str:
    """The unit top/bottom^power."""
    return f"({top})/({bottom})^{power}"


def cube(x: Any) -> Any:
    """x^3 by products: a general power of complex numbers would lose a tiny imaginary part."""
    return x * x * x


# ---------------------------------------------------------------- numbers and what modulates them


@dataclass
class Parameter:
    """A parameter of a part."""

    name: str
    unit: str
    value: float
    text: str = ""  # of its default
    role: str = "parameter"


@dataclass
class Reading:
    """Quantity that a modulated law reads: a variable of an element of the same part, made a bare number."""

    element: str
    port: int
    variable: str
    path: str
    unit: str


@dataclass
class Factor:
    """A coefficient of a law: a number or a parameter, perhaps with a factor that reads something."""

    text: str
    number: float
    parameter: str | None = None
    reading: Reading | None = None

    def value(self, place: Place, v: Values) -> Any:
        base = self.number if self.parameter is None else place.parameters[self.parameter]
        if self.reading is None:
            return base
        return base * (1 + 0.4 * sin(place.read(self.reading, v)))


# ---------------------------------------------------------------- elements


@dataclass
class Element:
    """One element of a part: its law as text and as residuals of (place, values, bonds, storage ports)."""

    name: str
    kind: str
    ports: list[str]
    domains: list[str]
    text: str
    law: Callable[[Place, Values, list[int], list[int]], list[Any]]
    traits: set[str] = field(default_factory=set)
    starts: dict[int, float] = field(default_factory=dict)  # of what is stored, by port
    stored: str = ""  # of a storage, port by port: q or p

    @property
    def stores(self) -> bool:
        return bool(self.stored)

    def letter(self, port: int, variable: str) -> str:
        return DOMAINS[self.domains[port]][0][VARIABLES.index(variable)]

    def path(self, port: int, variable: str) -> str:
        if self.kind in ("TF", "GY"):
            return f"{self.name}.{self.letter(port, variable)}{port + 1}"
        if self.ports == [""]:
            return f"{self.name}.{self.letter(port, variable)}"
        if variable in "qp":
            return f"{self.name}.{self.ports[port]}" + (f".{variable}" if self.kind == "IC" else "")
        return f"{self.name}.{self.ports[port]}.{self.letter(port, variable)}"


@dataclass
class Wall:
    """A port of a part: component -> domain, and whether its arrow comes in."""

    name: str
    components: dict[str, str]
    inwards: dict[str, bool]


End = tuple[str, str, str]  # ("node", name, port) | ("wall", name, component) | ("inside", instance, wall.component)


@dataclass
class Part:
    """One model."""

    name: str
    plain: bool
    walls: list[Wall] = field(default_factory=list)
    parameters: dict[str, Parameter] = field(default_factory=dict)
    junctions: dict[str, tuple[str, str]] = field(default_factory=dict)  # name -> kind, domain
    hidden: dict[str, str] = field(default_factory=dict)  # junction without a name -> its text in place
    elements: dict[str, Element] = field(default_factory=dict)
    instances: dict[str, tuple[Part, dict[str, Factor]]] = field(default_factory=dict)
    bonds: list[tuple[End, End]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    tail: list[str] = field(default_factory=list)

    def source(self) -> str:
        head = "plain model" if self.plain else "model"
        ports = []
        for wall in self.walls:
            if list(wall.components) == [""]:
                ports.append(f"port {wall.name}" + ("" if self.plain else f": {wall.components['']}"))
            else:
                inner = ", ".join(c if self.plain else f"{c}: {d}" for c, d in wall.components.items())
                ports.append(f"port {wall.name}({inner})")
        defaults = [
            f"{p.role} {p.name}{'' if self.plain else ': ' + p.unit} = {p.text}" for p in self.parameters.values()
        ]
        return (
            f"{head} {self.name} {{\n"
            + "".join(f"  {x}\n" for x in (*ports, *defaults, *self.lines, *self.tail))
            + "}\n"
        )


class Place:
    """One instance of a part while it is flattened."""

    def __init__(self, part: Part, path: str, parameters: dict[str, float], flat: Flat) -> None:
        self.part, self.path, self.parameters, self.flat = part, path, parameters, flat

    def read(self, reading: Reading, v: Values) -> Any:
        name = self.path + reading.element
        if reading.variable in "qp":
            return v.stored[self.flat.stored[name, reading.port]]
        bond = self.flat.bond_at[name, reading.port]
        value = (v.effort if reading.variable == "e" else v.flow)[bond]
        return np.real(value) if self.flat.signals_given else value


@dataclass
class Flat:
    """The flat network with the names that the text gives its parts."""

    network: Network = field(default_factory=Network)
    bond_at: dict[tuple[str, int], int] = field(default_factory=dict)  # element and port -> bond
    stored: dict[tuple[str, int], int] = field(default_factory=dict)  # element and port -> storage port
    elements: dict[str, Element] = field(default_factory=dict)
    traits: dict[str, int] = field(default_factory=dict)
    starts: dict[int, float] = field(default_factory=dict)
    signals_given: bool = False  # whether complex steps see the efforts and flows that modulate laws as given


def flatten(root: Part, settings: dict[str, float]) -> Flat:
    """The whole model; `settings` are parameters set from outside, by path."""
    flat = Flat()
    segments: list[tuple[tuple[str, ...], tuple[str, ...]]] = []
    places: list[Place] = []

    def open_part(part: Part, path: str, bindings: dict[str, float]) -> None:
        values = {n: settings.get(path + n, bindings.get(n, p.value)) for n, p in part.parameters.items()}
        place = Place(part, path, values, flat)
        places.append(place)
        for tail, head in part.bonds:
            segments.append(tuple((e[0], path + e[1], e[2], str(inner)) for e, inner in ((tail, 0), (head, 1))))  # type: ignore[arg-type]
        for name, (inner, factors) in part.instances.items():
            static = {n: f.number if f.parameter is None else values[f.parameter] for n, f in factors.items()}
            open_part(inner, f"{path}{name}.", static)

    open_part(root, "", {})
    ends = _through_walls(segments)
    junction_ends: dict[str, list[tuple[int, int]]] = {}
    for tail, head in ends:
        bond = flat.network.bond()
        for (name, port), sign in ((tail, -1), (head, 1)):
            if port == "":
                junction_ends.setdefault(name, []).append((bond, sign))
            else:
                flat.bond_at[name, int(port)] = bond
    for place in places:
        for name, (kind, _) in place.part.junctions.items():
            flat.network.junction(kind, junction_ends.get(place.path + name, []))
        for element in place.part.elements.values():
            _add_element(flat, place, element)
    return flat


def _add_element(flat: Flat, place: Place, element: Element) -> None:
    name = place.path + element.name
    flat.elements[name] = element
    bonds = [flat.bond_at[name, i] for i in range(len(element.ports))]
    stored = []
    for i, bond in enumerate(bonds if element.stores else ()):
        label = place.path + (
            f"{element.name}.{element.ports[i]}" if element.kind == "IC" else element.path(i, element.stored[i])
        )
        stored.append(flat.network.storage(label, bond, "C" if element.stored[i] == "q" else "I"))
        flat.stored[name, i] = stored[-1]
        if i in element.starts:
            flat.starts[stored[-1]] = element.starts[i]
    flat.network.residuals.append(lambda v: element.law(place, v, bonds, stored))
    for trait in element.traits:
        flat.traits[trait] = flat.traits.get(trait, 0) + 1


def _through_walls(segments: list[Any]) -> list[tuple[tuple[str, str], tuple[str, str]]]:
    """Bonds between nodes: halves that meet in a hole of a wall are joined."""

    def hole(end: tuple[str, ...]) -> tuple[str, str] | None:
        kind, name, port, _ = end
        if kind == "node":
            return None
        if kind == "wall":  # seen from inside: `sub.` + wall
            path, _, wall = name.rpartition(".")
            return path, f"{wall}.{port}"
        return name, port

    starting = {hole(tail): (tail, head) for tail, head in segments if tail[0] != "node"}
    result = []
    for tail, head in segments:
        if tail[0] != "node":
            continue
        while head[0] != "node":
            head = starting[hole(head)][1]
        result.append((tail[1:3], head[1:3]))
    return result


# ---------------------------------------------------------------- laws


class Builder:
    """Grows one part."""

    def __init__(self, choices: Choices, name: str, plain: bool, parts: list[Part], depth: int) -> None:
        self.c, self.part, self.parts, self.depth = choices, Part(name, plain), parts, depth
        self.counts: dict[str, int] = {}
        self.deferred: list[tuple[str, Factor]] = []

    def name(self, letter: str, *domains: str) -> str:
        """A new name, perhaps an item of an array; all items of an array are of one domain."""
        self.counts[letter] = number = self.counts.get(letter, 0) + 1
        array = letter + "".join(d[0] for d in domains)
        return f"{array}[{number}]" if self.c.chance(15) else f"{letter}{number}"

    def bare_name(self, letter: str) -> str:
        self.counts[letter] = number = self.counts.get(letter, 0) + 1
        return f"{letter}{number}"

    def unit(self, domain: str, variable: str) -> str:
        return DOMAINS[domain][1][VARIABLES.index(variable)]

    def factor(self, unit: str, modulate: bool = False, zero: int = 0) -> Factor:
        """A coefficient with this unit."""
        number = 0.0 if self.c.chance(zero) else self.c.number()
        literal = repr(number) if self.part.plain else f"{number!r} [{unit}]"
        factor = Factor(literal, number)
        if self.c.chance(40) or number == 0:
            name = self.bare_name("w")
            factor = Factor(name, number, name)
            self.part.parameters[name] = Parameter(name, unit, number, literal)
        elif self.c.chance(10):
            factor = Factor(f"(2*{literal} - {literal})", number)
        if modulate and (reading := self.reading()):
            inner = reading.path if reading.unit == "1" or self.part.plain else f"{reading.path}/1 [{reading.unit}]"
            text = f"{factor.text}*(1 + 0.4*sin({inner}))"
            if self.c.chance(30):
                signal = self.bare_name("g")
                self.part.lines.append(f"signal {signal} = 1 + 0.4*sin({inner})")
                text = f"{signal}*{factor.text}"
            factor = Factor(text, factor.number, factor.parameter, reading)
        return factor

    def reading(self) -> Reading | None:
        """Something that is there already: mostly what is stored."""
        stores = [e for e in self.part.elements.values() if e.stores]
        element = self.c.one(stores) if stores else None
        variable = ""
        if self.c.chance(10) and self.part.elements:
            element = self.c.one(list(self.part.elements.values()))
            variable = self.c.one("ef")
            element.traits.add("read")
        if element is None:
            return None
        port = self.c.integer(0, len(element.ports) - 1)
        variable = variable or element.stored[port]
        return Reading(
            element.name, port, variable, element.path(port, variable), self.unit(element.domains[port], variable)
        )

    def add(self, element: Element, letter: str, law: str, more: str = "") -> Element:
        ports = (
            ""
            if element.ports == [""] or element.kind in ("TF", "GY")
            else f"({', '.join(self._port(element, i) for i in range(len(element.ports)))})"
        )
        self.part.elements[element.name] = element
        element.text = f"{letter} {element.name}{ports} : {law}{more}"
        self.part.lines.append(element.text)
        return element

    def _port(self, element: Element, i: int) -> str:
        return element.ports[i] if self.part.plain else f"{element.ports[i]}: {element.domains[i]}"

    def attributes(self, element: Element, preferences: Sequence[str]) -> str:
        """`{ start x = …, prefer = … }`, or nothing."""
        parts = []
        if element.stores and self.c.chance(25):
            for i, port in enumerate(element.ports):
                value = self.c.number()
                stored = element.stored[i]
                letter = element.letter(i, stored)
                target = letter if not port else self.c.one([port, f"{port}.{letter}"])
                if element.kind == "IC":
                    target = f"{port}.{stored}"
                unit = self.unit(element.domains[i], stored)
                parts.append(f"start {target} = {value!r}" + ("" if self.part.plain else f" [{unit}]"))
                element.starts[i] = value
        if preferences and self.c.chance(6):
            parts.append(f"prefer = {self.c.one(preferences)}")
            element.traits.add("prefer")
        return f" {{ {', '.join(parts)} }}" if parts else ""

    # ------------------------------------------------------------ one-ports
    def source(self, domain: str, kind: str) -> Element:
        variable = "e" if kind == "Se" else "f"
        element = Element(self.name("s", domain), kind, [""], [domain], "", lambda *a: [], {kind})
        letter, unit = element.letter(0, variable), self.unit(domain, variable)
        form = self.c.integer(0, 6)
        factor = self.factor(unit, modulate=form == 4)
        if self.c.chance(4) and factor.reading is None and factor.parameter is None:
            name = self.bare_name("n")
            self.part.parameters[name] = Parameter(name, unit, factor.number, factor.text, "input")
            factor = Factor(name, factor.number, name)
            element.traits.add("input")
        text, amount = factor.text, factor.value
        if form in (2, 3, 5):
            frequency = self.c.number()
            time = f"{frequency!r}*time" if self.part.plain else f"{frequency!r}*time/1 s"
            text = f"{text}*sin({time})"
            element.traits.add("time")
            amount = lambda place, v: factor.value(place, v) * sin(frequency * v.time)  # noqa: E731
        element.law = lambda place, v, b, s: [(v.effort if kind == "Se" else v.flow)[b[0]] - amount(place, v)]
        if factor.reading is not None:
            element.traits.add("modulated")
        modulated = factor.reading is not None or "input" in element.traits
        return self.add(element, "M" * modulated + kind, f"{letter} = {text}")

    def resistor(self, domain: str) -> Element:
        element = Element(self.name("r", domain), "R", [""], [domain], "", lambda *a: [], {"R"})
        e, f = element.letter(0, "e"), element.letter(0, "f")
        ue, uf = self.unit(domain, "e"), self.unit(domain, "f")
        form = self.c.integer(0, 31)
        modulate = self.c.chance(15)
        zero = 20 if form == 24 else 0
        if form in (1, 2, 5, 6, 7):  # f = g e
            factor = self.factor(over(uf, ue), modulate)
            law = f"{f} = {factor.text}*{e}"
            element.law = lambda p, v, b, s: [v.flow[b[0]] - factor.value(p, v) * v.effort[b[0]]]
        elif form in (
            25,
            26,
            27,
        ):  # f = g e + a (exp(e) - 1): a diode with a leak, which no formula solves for e; or e so
            element.traits.add("nonlinear")
            y, x, uy, ux = (f, e, uf, ue) if form < 27 else (e, f, ue, uf)
            factor, third = self.factor(over(uy, ux), modulate), self.factor(uy)
            inner = f"{x}/4" if self.part.plain else f"{x}/4 [{ux}]"
            law = f"{y} = {factor.text}*{x} + {third.text}*(exp({inner}) - 1)"

            def diode(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
                out, into = (v.flow[b[0]], v.effort[b[0]]) if form < 27 else (v.effort[b[0]], v.flow[b[0]])
                return [out - factor.value(p, v) * into - third.value(p, v) * (exp(0.25 * into) - 1)]

            element.law = diode
        elif form in (3, 28, 29):  # e = r f + c f^3
            element.traits.add("nonlinear")
            factor, third = self.factor(over(ue, uf), modulate), self.factor(over(ue, uf, 3))
            law = f"{e} = {factor.text}*{f} + {third.text}*{f}^3"
            element.law = lambda p, v, b, s: [
                v.effort[b[0]] - factor.value(p, v) * v.flow[b[0]] - third.value(p, v) * cube(v.flow[b[0]])
            ]
        elif form in (4, 30):  # f = a sinh(e), which can be solved for e
            element.traits.add("nonlinear")
            factor = self.factor(uf, modulate)
            inner = f"{e}/4" if self.part.plain else f"{e}/4 [{ue}]"  # large arguments would only try the oracle
            law = f"{f} = {factor.text}*sinh({inner})"
            element.law = lambda p, v, b, s: [v.flow[b[0]] - factor.value(p, v) * sinh(0.25 * v.effort[b[0]])]
        elif form == 8:
            factor = self.factor(over(ue, uf), modulate)
            law = f"{factor.text}*{f} = {e}"
            element.law = lambda p, v, b, s: [v.effort[b[0]] - factor.value(p, v) * v.flow[b[0]]]
        else:
            factor = self.factor(over(ue, uf), modulate, zero)
            law = f"{e} = {factor.text}*{f}"
            element.law = lambda p, v, b, s: [v.effort[b[0]] - factor.value(p, v) * v.flow[b[0]]]
        if factor.number == 0:
            element.traits.add("zero")
        if factor.reading is not None:
            element.traits.add("modulated")
        return self.add(
            element, "M" * (factor.reading is not None) + "R", law, self.attributes(element, ("effort", "flow"))
        )

    def storage(self, domain: str, kind: str) -> Element:
        """C: e = k q, or I: f = p / m; written in several ways."""
        element = Element(
            self.name("c" if kind == "C" else "i", domain), kind, [""], [domain], "", lambda *a: [], {kind}
        )
        element.stored = "q" if kind == "C" else "p"
        given, stored = ("e", "q") if kind == "C" else ("f", "p")
        y, x = element.letter(0, given), element.letter(0, stored)
        uy, ux = self.unit(domain, given), self.unit(domain, stored)

        def power(v: Values, b: list[int]) -> Any:
            return (v.effort if kind == "C" else v.flow)[b[0]]

        form = self.c.integer(0, 24)
        if form in (3, 4, 8, 9, 10):  # q = c e
            factor = self.factor(over(ux, uy), zero=2)
            law = f"{x} = {factor.text}*{y}"
            element.law = lambda p, v, b, s: [v.stored[s[0]] - factor.value(p, v) * power(v, b)]
        elif form == 5:
            element.traits.add("nonlinear storage")
            factor, third = self.factor(over(uy, ux)), self.factor(over(uy, ux, 3))
            law = f"{y} = {factor.text}*{x} + {third.text}*{x}^3"
            element.law = lambda p, v, b, s: [
                power(v, b) - factor.value(p, v) * v.stored[s[0]] - third.value(p, v) * cube(v.stored[s[0]])
            ]
        elif form in (6, 11, 12):
            element.traits.add("energy")
            factor = self.factor(over(uy, ux))
            law = f"energy = 1/2*{factor.text}*{x}^2"
            element.law = lambda p, v, b, s: [power(v, b) - factor.value(p, v) * v.stored[s[0]]]
        elif form == 7:
            element.traits.add("nonlinear storage")
            factor = self.factor(uy)
            inner = f"{x}/4" if self.part.plain else f"{x}/4 [{ux}]"
            law = f"{y} = {factor.text}*sinh({inner})"
            element.law = lambda p, v, b, s: [power(v, b) - factor.value(p, v) * sinh(0.25 * v.stored[s[0]])]
        else:
            factor = self.factor(over(uy, ux), zero=2 if kind == "C" else 0)
            law = f"{y} = {factor.text}*{x}" if self.c.chance(70) else f"{factor.text}*{x} = {y}"
            if factor.number == 0:
                law = f"{y} = {factor.text}*{x}"
            element.law = lambda p, v, b, s: [power(v, b) - factor.value(p, v) * v.stored[s[0]]]
        if factor.number == 0:
            element.traits.add("zero")
        return self.add(element, kind, law, self.attributes(element, ("integral", "derivative")))

    # ------------------------------------------------------------ fields
    def storage_field(self, domains: list[str], kind: str) -> Element:
        """A positive definite quadratic energy, often with a quartic or a periodic part; or linear equations."""
        n = len(domains)
        element = Element(
            self.name("f", *domains),
            kind,
            ["a", "b", "d"][:n],
            domains,
            "",
            lambda *a: [],
            {f"{kind} field"},
        )
        element.stored = stored = "".join(
            self.c.one("qp") if kind == "IC" else "q" if kind == "C" else "p" for _ in domains
        )
        given = ["e" if x == "q" else "f" for x in stored]
        root = np.array([[self.c.number() if j <= i else 0.0 for j in range(n)] for i in range(n)])
        for i in range(n):
            for j in range(i):
                root[i, j] *= self.c.one((0.0, 0.3, -0.5))
        matrix = np.round(root @ root.T, 6)
        form = self.c.integer(0, 2 if kind == "IC" else 3)
        weight, direction = 0.0, np.zeros(n)
        if form == 3:  # equations for what is stored, which must be solved
            inverse = np.round(np.linalg.inv(matrix), 6)
            matrix = np.linalg.inv(inverse)
        elif form:
            weight, direction = self.c.number(), np.array([self.c.one((1.0, 0.4, -0.7)) for _ in range(n)])

        def law(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
            y = [(v.effort if g == "e" else v.flow)[b[i]] for i, g in enumerate(given)]
            x = [v.stored[i] for i in s]
            along = sum(d * xi for d, xi in zip(direction, x, strict=True))
            slope = weight * (cube(along) if form == 1 else sin(along)) if weight else 0.0
            return [y[i] - sum(matrix[i, j] * x[j] for j in range(n)) - slope * direction[i] for i in range(n)]

        element.law = law
        names = [
            f"{port}.{stored[i]}" if kind == "IC" else self.c.one((port, f"{port}.{element.letter(i, stored[i])}"))
            for i, port in enumerate(element.ports)
        ]
        units = [self.unit(d, x) for d, x in zip(domains, stored, strict=True)]
        joule = "N*m"

        def with_unit(number: float, unit: str) -> str:
            return f"{number!r}" if self.part.plain else f"{number!r} [{unit}]"

        if kind != "IC" and form in (0, 3) and (form == 3 or self.c.chance(50)):
            element.traits.add("field equations")
            y = [f"{port}.{element.letter(i, given[i])}" for i, port in enumerate(element.ports)]
            uy = [self.unit(d, g) for d, g in zip(domains, given, strict=True)]
            left, right, ul, ur = (names, y, units, uy) if form == 3 else (y, names, uy, units)
            table = inverse if form == 3 else matrix
            rows = [
                f"{left[i]} = "
                + " + ".join(f"{with_unit(float(table[i, j]), over(ul[i], ur[j]))}*{right[j]}" for j in range(n))
                for i in range(n)
            ]
            text = ", ".join(rows)
        else:
            terms = []
            for i in range(n):
                for j in range(i + 1):
                    if matrix[i, j]:
                        number = float(matrix[i, j]) * (0.5 if i == j else 1.0)
                        terms.append(
                            f"{with_unit(number, f'({joule})/({units[i]})/({units[j]})')}*{names[i]}*{names[j]}"
                        )
            if weight:
                element.traits.add("nonlinear storage")
                sums = []
                for d, name, unit in zip(direction, names, units, strict=True):
                    sums.append(
                        f"{float(d)!r}*{name}"
                        if self.part.plain or unit in ("1", "rad")
                        else f"{float(d)!r}*{name}/1 [{unit}]"
                    )
                along = "(" + " + ".join(sums) + ")"
                energy = f"{along}^4/4" if form == 1 else f"(1 - cos{along})"
                terms.append(f"{with_unit(weight, joule)}*{energy}")
            text = "energy = " + " + ".join(terms)
        return self.add(element, kind, text, self.attributes(element, ()))

    def resistor_field(self, domains: list[str]) -> Element:
        """Linear, positive definite, perhaps with a gyrating part."""
        n = len(domains)
        element = Element(self.name("h", *domains), "R", ["a", "b", "d"][:n], domains, "", lambda *a: [], {"R field"})
        matrix = np.zeros((n, n))
        for i in range(n):
            matrix[i, i] = self.c.number()
            for j in range(i):
                matrix[i, j] = self.c.one((0.0, 0.25, -0.15)) * matrix[i, i]
                matrix[j, i] = self.c.one((1, -1)) * matrix[i, j]
        conductance = self.c.chance(40)
        left, right = ("f", "e") if conductance else ("e", "f")

        def law(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
            y, x = (v.flow, v.effort) if conductance else (v.effort, v.flow)
            return [y[b[i]] - sum(matrix[i, j] * x[b[j]] for j in range(n)) for i in range(n)]

        element.law = law
        rows = []
        for i, port in enumerate(element.ports):
            terms = []
            for j, other in enumerate(element.ports):
                if matrix[i, j] or i == j:
                    unit = over(self.unit(domains[i], left), self.unit(domains[j], right))
                    number = repr(float(matrix[i, j])) if self.part.plain else f"{float(matrix[i, j])!r} [{unit}]"
                    terms.append(f"{number}*{other}.{element.letter(j, right)}")
            rows.append(f"{port}.{element.letter(i, left)} = {' + '.join(terms)}")
        return self.add(element, "R", ", ".join(rows), self.attributes(element, ("effort", "flow")))

    # ------------------------------------------------------------ two-ports
    def transducer(self, first: str, second: str, kind: str) -> Element:
        """TF or GY between two domains, by one of its four laws."""
        element = Element(
            self.name("t" if kind == "TF" else "y", first, second),
            kind,
            ["1", "2"],
            [first, second],
            "",
            lambda *a: [],
            {kind},
        )
        left = self.c.one(("e", "f"))
        side = self.c.one((0, 1))
        right = left if kind == "TF" else ("f" if left == "e" else "e")
        unit = over(self.unit(element.domains[side], left), self.unit(element.domains[1 - side], right))
        factor = self.factor(unit, modulate=self.c.chance(35))
        if factor.reading is not None:
            element.traits.add("modulated")

        def law(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
            n = factor.value(p, v)
            here, there = b[side], b[1 - side]
            y = {"e": v.effort, "f": v.flow}
            other_left = "f" if left == "e" else "e"
            other_right = "f" if right == "e" else "e"
            # y_here = n x_there, and power e1 f1 = e2 f2 gives the conjugate: x'_there = n y'_here
            return [y[left][here] - n * y[right][there], y[other_right][there] - n * y[other_left][here]]

        element.law = law
        a, b = f"{element.letter(side, left)}{side + 1}", f"{element.letter(1 - side, right)}{2 - side}"
        text = f"{a} = {factor.text}*{b}" if self.c.chance(70) else f"{factor.text}*{b} = {a}"
        return self.add(element, "M" * (factor.reading is not None) + kind, text)

    # ------------------------------------------------------------ structure
    def junction(self, domain: str) -> str:
        name = self.name("j", domain)
        kind = self.c.one("10")
        self.part.junctions[name] = (kind, domain)
        self.part.lines.append(f"{kind} {name}" + ("" if self.part.plain else f" : {domain}"))
        return name

    def connect(self, tail: End, head: End, text: str | None = None) -> None:
        self.part.bonds.append((tail, head))
        if text is None:
            text = f"{self.spelled(tail)} -> {self.spelled(head)}"
        if text:
            self.part.tail.append(text)

    def spelled(self, end: End) -> str:
        kind, name, port = end
        if kind == "node":
            element = self.part.elements.get(name)
            if element is None or element.ports == [""] or element.kind in ("TF", "GY"):
                return name
            return f"{name}.{element.ports[int(port)]}"
        if kind == "wall":
            return f"{name}.{port}" if port else name
        wall, _, component = port.partition(".")
        return f"{name}.{wall}.{component}" if component else f"{name}.{wall}"

    def link(self, a: str, b: str) -> None:
        """Join two junctions by a bond or a transducer."""
        (_, first), (_, second) = self.part.junctions[a], self.part.junctions[b]
        if self.c.chance(50):
            a, b, first, second = b, a, second, first
        kind = self.c.one(("", "", "TF", "GY")) if first == second else self.c.one(("TF", "GY"))
        if not kind:
            self.connect(("node", a, ""), ("node", b, ""))
            return
        element = self.transducer(first, second, kind)
        chained = self.c.chance(50)
        self.connect(("node", a, ""), ("node", element.name, "0"), "" if chained else None)
        text = f"{a} -> {element.name} -> {b}" if chained else None
        self.connect(("node", element.name, "1"), ("node", b, ""), text)

    def domain(self) -> str:
        return "untyped" if self.part.plain else self.c.one(("translation", "electric", "rotation", "hydraulic"))

    def grow(self, walls: list[Wall]) -> Part:
        """Junctions, loops, elements, instances; `walls` are what the part shows to its surroundings."""
        part, c = self.part, self.c
        part.walls = walls
        first = next((d for w in walls for d in w.components.values()), None) or self.domain()
        self._furnish(self.junction(first))
        for domain in [d for w in walls for d in w.components.values()][1:]:
            self._grow_junction(domain)
        for _ in range(c.integer(0, 4 if not self.depth else 2)):
            self._grow_junction(self.domain() if c.chance(40) else c.one(list(part.junctions.values()))[1])
        names = list(part.junctions)
        for _ in range(c.integer(0, 2) if len(names) > 2 and c.chance(35) else 0):
            a, b = c.one(names), c.one(names)
            if a != b:
                self.link(a, b)
        for wall in walls:
            for component, domain in wall.components.items():
                inner = ("node", c.one([n for n in names if part.junctions[n][1] == domain]), "")
                outer = ("wall", wall.name, component)
                self.connect(*((outer, inner) if wall.inwards[component] else (inner, outer)))
        if c.chance(18):
            self._ladder(c.one(names))
        if c.chance(14):
            self._forced_twice(c.one(names))
        first = c.integer(0, 3)
        for number in range(c.integer(1, 3) if c.chance(35) else 0):
            self._field(names, ("C", "I", "IC", "R")[(first + number) % 4])
        if self.depth == 0:
            for _ in range(c.integer(1, 2) if c.chance(35) else 0):
                self._instances(names)
        self._shuffle()
        return part

    def _grow_junction(self, domain: str) -> None:
        before = self.c.one(list(self.part.junctions))
        name = self.junction(domain)
        self._furnish(name)
        self.link(before, name)

    def _furnish(self, name: str) -> None:
        kind, domain = self.part.junctions[name]
        c = self.c
        for _ in range(c.integer(0, 3)):
            form = c.integer(0, 20)
            natural = not c.chance(15)
            if form <= 8:
                element = self.storage(domain, "C" if (kind == "0") is natural else "I")
            elif form <= 17:
                element = self.resistor(domain)
            else:
                element = self.source(domain, "Se" if (kind == "1") is natural else "Sf")
            self.hang(name, element, 0)

    def hang(self, junction: str, element: Element, port: int) -> None:
        """A bond between a junction and an element; sources in either direction."""
        inner, outer = ("node", junction, ""), ("node", element.name, str(port))
        out = element.kind in ("Se", "Sf") and not self.c.chance(30)
        self.connect(*((outer, inner) if out else (inner, outer)))

    def _ladder(self, start: str) -> None:
        """Sections alike, by `for`: a junction with a storage and a resistor each, one hanging on the other."""
        c, part, domain = self.c, self.part, self.part.junctions[start][1]
        count, number = c.integer(2, 4), self.counts.get("l", 0) + 1
        self.counts["l"] = number
        kinds = c.one("10"), c.one("CI")
        junction, storage, resistor = f"lj{number}", f"lc{number}", f"lr{number}"
        stored, given = ("q", "e") if kinds[1] == "C" else ("p", "f")
        units = {x: self.unit(domain, x) for x in "efqp"}
        letters = dict(zip("efqp", DOMAINS[domain][0], strict=True))
        scale, loss = self.factor(over(units[given], units[stored])), self.factor(over(units["e"], units["f"]))
        colon = "" if part.plain else f" : {domain}"
        part.lines.append(
            f"for k in 1..{count} {{\n    {kinds[0]} {junction}[k]{colon}\n"
            f"    {kinds[1]} {storage}[k] : {letters[given]} = k*{scale.text}*{letters[stored]}\n"
            f"    R {resistor}[k] : {letters['e']} = {loss.text}*{letters['f']}\n"
            f"    {junction}[k] -> {storage}[k], {resistor}[k]\n  }}"
        )
        part.lines.append(f"for k in 1..{count - 1} {{ {junction}[k] -> {junction}[k + 1] }}")
        for k in range(1, count + 1):
            place = f"{junction}[{k}]"
            part.junctions[place] = (kinds[0], domain)
            store = Element(f"{storage}[{k}]", kinds[1], [""], [domain], "", lambda *a: [], {kinds[1], "for"})
            store.stored = stored

            def law(p: Place, v: Values, b: list[int], s: list[int], k: int = k) -> list[Any]:
                return [(v.effort if given == "e" else v.flow)[b[0]] - k * scale.value(p, v) * v.stored[s[0]]]

            def drop(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
                return [v.effort[b[0]] - loss.value(p, v) * v.flow[b[0]]]

            store.law = law
            part.elements[store.name] = store
            element = Element(f"{resistor}[{k}]", "R", [""], [domain], "", drop, {"R"})
            part.elements[element.name] = element
            for name in (store.name, element.name):
                self.connect(("node", place, ""), ("node", name, "0"), "")
            if k > 1:
                self.connect(("node", f"{junction}[{k - 1}]", ""), ("node", place, ""), "")
        self.connect(("node", start, ""), ("node", f"{junction}[1]", ""))

    def _forced_twice(self, start: str) -> None:
        """A flow that time gives to an I, whose effort is then the effort of a C: the second derivative of the source, index 3."""
        domain = self.part.junctions[start][1]
        amount, frequency, mass, share = (self.c.number() for _ in range(4))
        x = dict(zip("efqp", DOMAINS[domain][0], strict=True))
        unit = {v: "" if self.part.plain else f" [{self.unit(domain, v)}]" for v in "efqp"}
        mass_unit = "" if self.part.plain else f" [{over(self.unit(domain, 'p'), self.unit(domain, 'f'))}]"
        second = "" if self.part.plain else "/1 s"
        one, zero = self.bare_name("jd"), self.bare_name("jz")
        for kind, name in (("1", one), ("0", zero)):
            self.part.junctions[name] = (kind, domain)
            self.part.lines.append(f"{kind} {name}" + ("" if self.part.plain else f" : {domain}"))

        def forced(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
            return [v.flow[b[0]] - amount * sin(frequency * v.time)]

        def inert(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
            return [v.stored[s[0]] - mass * v.flow[b[0]]]

        source = Element(self.bare_name("sd"), "Sf", [""], [domain], "", forced, {"Sf", "time"})
        self.add(source, "Sf", f"{x['f']} = {amount!r}{unit['f']}*sin({frequency!r}*time{second})")
        inertia = Element(self.bare_name("id"), "I", [""], [domain], "", inert, {"I"}, stored="p")
        self.add(inertia, "I", f"{x['p']} = {mass!r}{mass_unit}*{x['f']}")
        reading = Reading(inertia.name, 0, "e", inertia.path(0, "e"), self.unit(domain, "e"))

        def copy(p: Place, v: Values, b: list[int], s: list[int]) -> list[Any]:
            return [v.effort[b[0]] - share * p.read(reading, v)]

        second_source = Element(self.bare_name("sz"), "Se", [""], [domain], "", copy, {"Se", "modulated"})
        self.add(second_source, "MSe", f"{x['e']} = {share!r}*{reading.path}")
        for junction, element in (
            (one, source),
            (one, inertia),
            (zero, second_source),
            (zero, self.storage(domain, "C")),
        ):
            self.hang(junction, element, 0)
        self.link(start, one)
        self.link(start, zero)

    def _field(self, names: list[str], kind: str) -> None:
        c = self.c
        chosen = self._distinct(names, c.integer(2, 3))
        domains = [self.part.junctions[n][1] for n in chosen]
        element = self.resistor_field(domains) if kind == "R" else self.storage_field(domains, kind)
        if not c.chance(40):
            for port, junction in enumerate(chosen):
                self.hang(junction, element, port)
            return
        splitter = self.name("z", *domains)
        element.traits.add("splitter")
        self.part.lines.append(
            f"splitter {splitter}({', '.join(self._port(element, i) for i in range(len(element.ports)))})"
        )
        self.part.tail.append(f"{splitter} => {element.name}")
        for port, junction in enumerate(chosen):
            self.connect(
                ("node", junction, ""),
                ("node", element.name, str(port)),
                f"{junction} -> {splitter}.{element.ports[port]}",
            )

    def _instances(self, names: list[str]) -> None:
        """A part of its own, with one or two instances."""
        c = self.c
        chosen = self._distinct(names, c.integer(1, 3))
        domains = [self.part.junctions[n][1] for n in chosen]
        if len(chosen) > 1 and c.chance(40):
            walls = [
                Wall(
                    "ends",
                    {"abd"[i]: d for i, d in enumerate(domains)},
                    {"abd"[i]: c.chance(50) for i in range(len(chosen))},
                )
            ]
        else:
            walls = [Wall(f"port{i}", {"": d}, {"": c.chance(50)}) for i, d in enumerate(domains)]
        inner = Builder(c, f"Part{len(self.parts)}", self.part.plain, self.parts, self.depth + 1).grow(walls)
        self.parts.append(inner)
        array = c.chance(40)
        for number in range(1, c.integer(1, 2) + 1):
            name = f"{inner.name.lower()}[{number}]" if array else f"{inner.name.lower()}_{number}"
            bindings = {p.name: self.factor(p.unit) for p in inner.parameters.values() if c.chance(50)}
            for p in (
                inner.parameters.values()
            ):  # what is zero in the definition may be anything in an instance, and vice versa
                if p.value == 0 and p.name in bindings:
                    del bindings[p.name]
            braces = f" {{ {', '.join(f'{n} = {f.text}' for n, f in bindings.items())} }}" if bindings else ""
            self.part.lines.append(f"{inner.name} {name}{braces}")
            self.part.instances[name] = (inner, bindings)
            places = iter(
                chosen
                if number == 1
                else [c.one([n for n in names if self.part.junctions[n][1] == d]) for d in domains]
            )
            for wall in walls:
                for component in wall.components:
                    outer, hole = ("node", next(places), ""), ("inside", name, f"{wall.name}.{component}")
                    self.connect(*((outer, hole) if wall.inwards[component] else (hole, outer)))

    def _distinct(self, names: list[str], count: int) -> list[str]:
        """Different junctions as long as there are some, seldom the same ones."""
        if self.c.chance(10) or count > len(names):
            return [self.c.one(names) for _ in range(count)]
        first = self.c.integer(0, len(names) - 1)
        return (names[first:] + names[:first])[:count]

    def _shuffle(self) -> None:
        """The order of the text decides ties of causality; names are known in any order."""
        for lines in (self.part.lines, self.part.tail):
            if lines:
                cut = self.c.integer(0, len(lines) - 1)
                lines[:] = lines[cut:] + lines[:cut]
                if self.c.chance(30):
                    lines.reverse()


@dataclass
class Example:
    """One random model: its text, its network, its settings from outside, and the states and time at which it is evaluated."""

    text: str
    flat: Flat
    settings: dict[str, str | float]
    read: list[tuple[str, str, int, str]]  # output, element, port, variable
    time: float
    numbers: list[float]
    plain: bool
    parts: int


@st.composite
def examples(draw: Callable[[Any], Any]) -> Example:
    """Random models with their networks."""
    return example_of(Choices(draw))


def example_of(c: Choices) -> Example:
    """The model that some choices make."""
    plain = not c.chance(50)
    parts: list[Part] = []
    root = Builder(c, "Root", plain, parts, 0).grow([])
    settings: dict[str, str | float] = {}
    values: dict[str, float] = {}
    for name, parameter in root.parameters.items():
        if parameter.value and c.chance(10):
            values[name] = c.number()
            settings[name] = (
                values[name]
                if c.chance(50)
                else (repr(values[name]) if plain else f"{values[name]!r} [{parameter.unit}]")
            )
    for instance, (part, _) in root.instances.items():
        for name, parameter in part.parameters.items():
            if parameter.value and c.chance(10):
                values[f"{instance}.{name}"] = settings[f"{instance}.{name}"] = c.number()
    flat = flatten(root, values)
    read: list[tuple[str, str, int, str]] = []
    if flat.elements and c.chance(60):
        everything = [
            (name, port, variable)
            for name, element in flat.elements.items()
            for port in range(len(element.ports))
            for variable in "ef" + (element.stored[port] if element.stores else "")
        ]
        first = c.integer(0, len(everything) - 1)
        for number, (name, port, variable) in enumerate((everything[first:] + everything[:first])[: c.integer(1, 12)]):
            element = flat.elements[name]
            path = name[: len(name) - len(element.name)] + element.path(port, variable)
            root.tail.append(f"output o{number} = {path}")
            read.append((f"o{number}", name, port, variable))
    sources = [part.source() for part in parts] + [root.source()]
    if c.chance(30):
        sources.reverse()
    numbers = [c.integer(-20, 20) / 16 + 0.03 for _ in range(6)]
    return Example("\n".join(sources), flat, settings, read, c.integer(0, 8) / 7, numbers, plain, len(parts))
