"""A model by calls instead of text.

    g = Graph("Oscillator")
    m, k = g.parameter("m", 1.0, "kg"), g.parameter("k", 100.0, "N/m")
    push = g.Se("push", "F = 1 N*step(time - 0.1 s)")
    body = g.one("body", "translation")
    mass = g.I("mass", f"p = {m}*v")
    spring = g.C("spring", f"F = {k}*x", start={"x": 1e-3})
    push >> body >> (mass, spring)
    g.output("position", f"{spring}.x")
    g.model().simulate(to="5 s")
    print(g.text())

Two designs were weighed. A builder could make the nodes of the graph itself. Then units, domains, the form of laws, modulation,
instances and mechanisms would be checked in a second place, or nowhere, and whatever the language learns would have to be built
twice. Or every call writes the statement that an author would have written. The second is chosen: `model()` compiles that text like
any other, so there is one meaning of a model, with the same messages, under the names that were given in Python; and the way to
text is there from the start. (Nodes of the syntax tree would be no third way: each holds its place in a text.)

What is given is checked where it is given. Laws, expressions and units are parsed at once, never evaluated, and must be one law,
expression or unit: nothing in a string can end its statement. Names must be names of the language, descriptions must fit into one
literal, numbers are written so that the same double is read again.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar, Unpack

from compiler.graph.domains import BUNDLES, DOMAINS, GENERIC, Domain
from compiler.graph.mechanism import GROUND

from .door import Diagnostic, Source
from .views.text import bond_lines, number_text

if TYPE_CHECKING:
    from compiler.syntax.tree import Law

    from .model import Model

Value = Any  # a number in SI, an expression with units as text, a handle, or a sequence of these
Ports = Mapping[str, str] | Sequence[str]  # the names of ports, with or without their domains
Head = TypeVar("Head")

_NAME = re.compile(r"([A-Za-z_][A-Za-z_0-9]*)(?:\[([0-9]{1,9}(?:, ?[0-9]{1,9})*)\])?")
_STORED = {"C": "q", "I": "p", "IC": ""}
_CAUSALITIES = ("integral", "derivative", "effort", "flow")


class Attributes(TypedDict, total=False):
    """What any element may say besides its law. `start`, `nominal`: variable -> value, numbers in SI."""

    start: Mapping[str, Value]
    nominal: Mapping[str, Value]
    prefer: str
    require: str
    description: str


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A parameter, constant, input, signal or output; in an f-string it is its name."""

    graph: Graph
    name: str

    def __str__(self) -> str:
        return self.name

    def __getitem__(self, item: int) -> Quantity:
        """An item of a list, from 1."""
        if item < 1:
            raise ValueError(f"the items of `{self.name}` are counted from 1")
        return Quantity(self.graph, f"{self.name}[{int(item)}]")


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """What bonds reach: an element, a junction, a port, an instance; `part["x"]` is one of its ports.

    `a >> b` is the half arrow from a to b, `a >> (b, c)` are two; the right side comes back, so chains can be written. In an
    f-string a part is its path: `f"{spring}.x"`.
    """

    graph: Graph
    path: str
    ports: tuple[str, ...] | None = None  # None: only the compiler knows them

    def __str__(self) -> str:
        return self.path

    def __getitem__(self, port: str) -> Part:
        if self.ports is not None and port not in self.ports:
            known = ", ".join(self.ports) or "one, without a name"
            raise ValueError(f"`{self.path}` has no port `{port}`; its ports: {known}")
        return Part(self.graph, f"{self.path}.{_name(port)}")

    def __rshift__(self, head: Head) -> Head:
        self.graph.bond(self, head)
        return head

    def __rrshift__(self, tails: Sequence[Part]) -> Part:
        self.graph.bond(tails, self)
        return self


class Graph:
    """One model under construction. `plain`: bare numbers without units. `folder`: where the files that it imports lie."""

    def __init__(
        self, name: str, description: str = "", *, plain: bool = False, folder: str | Path | None = None
    ) -> None:
        self.name = _model_name(name)
        self.description = _description(description)
        self.plain = plain
        self.folder = None if folder is None else Path(folder)
        self._names: dict[str, set[str]] = {}  # without index -> the indices that are taken
        self._quantities: list[str] = []
        self._outputs: list[str] = []
        self._parts: list[str] = []
        self._mechanisms: list[Mechanism] = []
        self._bonds: list[tuple[str, str, str]] = []
        self._imports: dict[tuple[str, str], None] = {}  # (model, place as the text says it)
        self._files: list[Path] = []
        self._inner: list[Graph | Source] = []  # what stands in the text before this model

    def __repr__(self) -> str:
        return f"<bondgraph builder {self.name}: {len(self._parts) + len(self._mechanisms)} parts, {len(self._bonds)} bonds>"

    # ------------------------------------------------------------ quantities
    def parameter(self, name: str, value: Value = None, unit: str = "", description: str = "") -> Quantity:
        """Known before a run and set from outside. A number is in `unit`, a text has its own: `parameter("k", "2 [kN/m]")`."""
        return self._quantity("parameter", name, value, unit, description)

    def constant(self, name: str, value: Value, unit: str = "", description: str = "") -> Quantity:
        """As a parameter, but not to be set."""
        return self._quantity("constant", name, value, unit, description)

    def input(self, name: str, value: Value = 0.0, unit: str = "", description: str = "") -> Quantity:
        """A signal from outside; `value` is what holds without it."""
        return self._quantity("input", name, value, unit, description)

    def signal(self, name: str, value: Value, unit: str = "", description: str = "") -> Quantity:
        """A name for an expression: `signal("force", "c*volt^2")`, `signal("h", "integral(ball.v, 1 m)")`."""
        return self._quantity("signal", name, value, unit, description)

    def output(self, name: str, value: Value, unit: str = "", description: str = "") -> Quantity:
        """A signal that runs report: `output("position", "spring.x")`."""
        return self._quantity("output", name, value, unit, description)

    def _quantity(self, role: str, name: str, value: Value, unit: str, description: str) -> Quantity:
        if unit and self.plain:
            raise ValueError(f"`{name}`: a plain graph has no units")
        text = f"{role} {_name(name)}{f': {_unit(unit)}' if unit else ''}"
        if value is not None:
            text += f" = {_value(value, unit, f'the value of `{name}`', bare=True)}"
        text += _literal(description)
        quantity = Quantity(self, self._enter(name))
        (self._outputs if role == "output" else self._quantities).append(text)
        return quantity

    # ------------------------------------------------------------ junctions and elements
    def zero(self, name: str, domain: str = "", *, description: str = "") -> Part:
        """A 0-junction: one effort for all bonds."""
        return self._junction("0", name, domain, description)

    def one(self, name: str, domain: str = "", *, description: str = "") -> Part:
        """A 1-junction: one flow for all bonds."""
        return self._junction("1", name, domain, description)

    def Se(
        self, name: str, law: str, *, ports: Ports = (), modulated: bool = False, **attributes: Unpack[Attributes]
    ) -> Part:
        """A source of effort: `Se("push", "F = 1 N")`. `modulated`: its law reads what changes elsewhere."""
        return self._element(f"{'M' * modulated}Se", name, law, None, ports, attributes)

    def Sf(
        self, name: str, law: str, *, ports: Ports = (), modulated: bool = False, **attributes: Unpack[Attributes]
    ) -> Part:
        """A source of flow: `Sf("road", "v = 0.2 [m/s]")`."""
        return self._element(f"{'M' * modulated}Sf", name, law, None, ports, attributes)

    def C(
        self, name: str, law: str | None = None, *, energy: str | None = None, ports: Ports = (),
        **attributes: Unpack[Attributes],
    ) -> Part:  # fmt: skip
        """A storage of displacement, by its law or its energy: `C("spring", "F = k*x", start={"x": 1e-3})`."""
        return self._element("C", name, law, energy, ports, attributes)

    def I(  # noqa: E743
        self, name: str, law: str | None = None, *, energy: str | None = None, ports: Ports = (),
        **attributes: Unpack[Attributes],
    ) -> Part:  # fmt: skip
        """A storage of momentum, by its law or its energy: `I("mass", "p = m*v")`."""
        return self._element("I", name, law, energy, ports, attributes)

    def IC(
        self, name: str, law: str | None = None, *, energy: str | None = None, ports: Ports,
        **attributes: Unpack[Attributes],
    ) -> Part:  # fmt: skip
        """A field whose ports store displacement (`a.q`) or momentum (`b.p`)."""
        return self._element("IC", name, law, energy, ports, attributes)

    def R(
        self, name: str, law: str, *, ports: Ports = (), modulated: bool = False, **attributes: Unpack[Attributes]
    ) -> Part:
        """What dissipates: `R("damper", "F = r*v")`."""
        return self._element(f"{'M' * modulated}R", name, law, None, ports, attributes)

    def RS(self, name: str, law: str, *, ports: Ports, **attributes: Unpack[Attributes]) -> Part:
        """What turns power into heat; its last port gives what the others lose."""
        return self._element("RS", name, law, None, ports, attributes)

    def TF(self, name: str, law: str, *, modulated: bool = False, **attributes: Unpack[Attributes]) -> Part:
        """A transformer: `TF("gear", "omega1 = 20*omega2")`. The bond into it reaches side 1, the bond out of it leaves side 2."""
        return self._element(f"{'M' * modulated}TF", name, law, None, (), attributes)

    def GY(self, name: str, law: str, *, modulated: bool = False, **attributes: Unpack[Attributes]) -> Part:
        """A gyrator: `GY("motor", "u1 = K*omega2")`."""
        return self._element(f"{'M' * modulated}GY", name, law, None, (), attributes)

    def splitter(self, name: str, ports: Ports) -> Part:
        """A multibond on one side, its bonds one by one on the other: `hand`, `hand["x"]`."""
        listed, names = _ports(ports)
        return self._add(name, f"splitter {_name(name)}{listed}", names)

    def port(self, name: str, domain: str, *, description: str = "") -> Part:
        """A port of the model itself, so that it can stand in a larger one: `port("ends", "planar")`."""
        text = f"port {_name(name)}: {_domain(domain, BUNDLES)}{_literal(description)}"
        return self._add(name, text, tuple(BUNDLES.get(domain, ())))

    def _junction(self, kind: str, name: str, domain: str, description: str) -> Part:
        text = f"{kind} {_name(name)}{f' : {_domain(domain)}' if domain else ''}{_literal(description)}"
        return self._add(name, text, ())

    def _element(
        self, kind: str, name: str, law: str | None, energy: str | None, ports: Ports, attributes: Attributes
    ) -> Part:
        if (law is None) == (energy is None):
            raise ValueError(f"`{name}` needs {'either its law or its energy' if kind in _STORED else 'its law'}")
        listed, names = _ports(ports)
        head = f"{kind} {_name(name)}{listed} : "
        if energy is not None:
            law = f"energy = {_expression(energy, f'the energy of `{name}`')}"
        line, tree = _law(head, law)
        inner = _Inner(self, kind, name, tree, ports).text(attributes)
        return self._add(name, f"{head}{line}{_braces(inner)}{_literal(attributes.get('description', ''))}", names)

    def _add(self, name: str, text: str, ports: tuple[str, ...] | None) -> Part:
        part = Part(self, self._enter(name), ports)
        self._parts.append(text)
        return part

    # ------------------------------------------------------------ models within models
    def instance(self, name: str, model: Model | Graph | Quantity | str, /, **values: Value) -> Part:
        """An instance of another model, with its parameters and inputs; `instance["port"]` is one of its ports.

        `model` is a `Graph`, a model from `bondgraph.load` (`load("mems.bg", "CombDrive")`; a file is imported, a text is
        copied), a model of the shipped library by its path, "electric.Diode", or a slot of this graph.
        """
        kind = self._use(model)
        inner = [f"{_name(n)} = {self._given(v, f'`{n}` of `{name}`')}" for n, v in values.items()]
        return self._add(name, f"{kind} {_name(name)}{_braces(inner)}", None)

    def slot(self, name: str, default: Model | Graph | str) -> Quantity:
        """A kind that an instance of this graph may replace by another model with the same ports."""
        text = f"parameter {_name(name)}: model = {self._use(default)}"
        slot = Quantity(self, self._enter(name))
        self._quantities.append(text)
        return slot

    def _given(self, value: Value, what: str) -> str:
        """A value for an instance: also a model, for a slot of it."""
        from .model import Model

        return self._use(value) if isinstance(value, Graph | Model) else _value(value, "", what)

    def _use(self, model: Model | Graph | Quantity | str) -> str:
        """The name of a model that this one uses; the text gets what it needs for it."""
        if isinstance(model, Quantity):
            return model.name
        if isinstance(model, str):
            place, dot, kind = model.rpartition(".")
            if not dot:
                raise ValueError(f"{model!r} is no model of the library: write its path, `electric.Diode`")
            self._imports[_name(kind), _name(place)] = None
            return kind
        if isinstance(model, Graph):
            if model is self or self in model._within():
                raise ValueError(f"`{self.name}` cannot contain itself")
            if model not in self._inner:
                self._inner.append(model)
            return model.name
        kind = _model_of(model)
        if model.source.path is None:
            if model.source not in self._inner:
                self._inner.append(model.source)
            return kind
        path = model.source.path.resolve()
        self.folder = self.folder if self.folder is not None else path.parent
        place = Path(os.path.relpath(path, self.folder.resolve())).as_posix()
        self._imports[kind, _literal(place).strip()] = None
        self._files.append(path)
        return kind

    def _within(self) -> list[Graph]:
        """The graphs inside this one, at any depth."""
        direct = [g for g in self._inner if isinstance(g, Graph)]
        return direct + [deeper for g in direct for deeper in g._within()]

    def multibody(self, name: str, *, gravity: Sequence[Value] | None = None) -> Mechanism:
        """A planar mechanism: `stage = g.multibody("stage")`, then `stage.body(…)`, `stage.slide(…)`."""
        lines = [] if gravity is None else [f"gravity = {_value(gravity, 'm/s^2', 'gravity')}"]
        mechanism = Mechanism(self, self._enter(name), lines)
        self._mechanisms.append(mechanism)
        return mechanism

    # ------------------------------------------------------------ bonds
    def bond(self, *places: Any) -> None:
        """Half arrows from each place to the next; several places side by side stand in a sequence."""
        self._arrows("->", places)

    def multibond(self, *places: Any) -> None:
        """The same with multibonds: all ports of a splitter, joint, body or port at once, by name."""
        self._arrows("=>", places)

    def _arrows(self, arrow: str, places: tuple[Any, ...]) -> None:
        if len(places) < 2:
            raise ValueError("a bond has two ends")
        groups = [self._group(p) for p in places]
        for tails, heads in pairwise(groups):
            if len(tails) > 1 and len(heads) > 1:
                raise ValueError("a bond from several places to several places: which goes to which is not guessed")
            self._bonds += [(tail, arrow, head) for tail in tails for head in heads]

    def _group(self, places: Any) -> list[str]:
        several = isinstance(places, Sequence) and not isinstance(places, str)
        return [self._place(p) for p in places] if several else [self._place(places)]

    def _place(self, place: Any) -> str:
        if isinstance(place, str):
            return _path(place)
        if not isinstance(place, Part | Mechanism):
            raise TypeError(f"a bond reaches parts, not {place!r}")
        if place.graph is not self:
            raise ValueError(f"`{place}` belongs to the graph `{place.graph.name}`, not to `{self.name}`")
        return str(place)

    # ------------------------------------------------------------ what comes of it
    def text(self) -> str:
        """The model as .bg text, with what it contains."""
        imports: dict[tuple[str, str], None] = {}
        models: dict[Graph | Source, str] = {}
        self._collect(imports, models)
        lines = [f"import {kind} from {place}\n" for kind, place in imports]
        return "\n".join(["".join(lines), *models.values()] if lines else models.values())

    def _collect(self, imports: dict[tuple[str, str], None], models: dict[Graph | Source, str]) -> None:
        """Gather the texts of this model and of those in it, inner ones first."""
        for inner in self._inner:
            if isinstance(inner, Graph):
                inner._collect(imports, models)
            else:
                models[inner] = inner.text.rstrip() + "\n"
        imports.update(self._imports)
        models[self] = self._model_text()

    def _model_text(self) -> str:
        mechanisms = [line for m in self._mechanisms for line in m._text()]
        groups = [self._quantities, [*self._parts, *mechanisms], list(bond_lines(self._bonds)), self._outputs]
        groups.insert(0, [f'"{self.description}"'] if self.description else [])
        body = "\n\n".join("\n".join(f"  {line}" for line in lines) for lines in groups if lines)
        return f"{'plain ' * self.plain}model {self.name} {{\n{body}\n}}\n"

    def _source(self) -> Source:
        text = self.text()
        folders = {g.folder.resolve() for g in [self, *self._within()] if g.folder is not None}
        if len(folders) > 1:
            listed = ", ".join(sorted(map(str, folders)))
            raise ValueError(f"graphs in each other need one folder for what they import, not {listed}")
        name = f"{self.name}.bg"
        if not folders:
            return Source(name, text)
        path = folders.pop() / name
        files = [f for g in [self, *self._within()] for f in g._files]
        while path in files:  # a file of this name is imported: the text stands beside it under another
            path = path.with_name(f"_{path.name}")
        return Source(name, text, path)

    def model(self) -> Model:
        """The model, as if it had been read from text. Mistakes are told when something is asked of it."""
        from .model import Model

        return Model(self._source(), self.name)

    def check(self) -> tuple[Diagnostic, ...]:
        """Everything that is wrong with it; empty if nothing is."""
        from .door import check_source
        from .model import LIBRARY

        return tuple(check_source(self._source(), self.name, LIBRARY))

    # ------------------------------------------------------------ names
    def _enter(self, name: str) -> str:
        """Take a name; raises ValueError if something has it."""
        full = _name(name)
        word, _, index = full.partition("[")
        taken = self._names.setdefault(word, set())
        if index in taken or (taken and ("" in taken or not index)):
            raise ValueError(f"`{self.name}` already has `{full if index in taken else word}`")
        taken.add(index)
        return full


@dataclass(frozen=True, slots=True, eq=False)
class Mechanism:
    """A planar mechanism: bodies and joints placed in one world frame. Numbers are in SI, angles in rad."""

    graph: Graph
    path: str
    _lines: list[str]
    _taken: set[str] = field(default_factory=set)

    def __str__(self) -> str:
        return self.path

    def __getitem__(self, part: str) -> Part:
        return Part(self.graph, f"{self.path}.{_name(part)}")

    def body(
        self, name: str, *, mass: Value = None, inertia: Value = None, at: Value = None, angle: Value = None,
        start: Mapping[str, Value] | None = None,
    ) -> Part:  # fmt: skip
        """A rigid body: kg, kg m^2 about its centre of mass, where that centre is (m) and its angle."""
        given = {"mass": (mass, "kg"), "inertia": (inertia, "kg*m^2"), "at": (at, "m"), "angle": (angle, "")}
        return self._part("body", name, "", given, start, ("x", "y", "phi"))

    def frame(self, name: str, body: Part, *, at: Value) -> Part:
        """A point that is fixed to a body."""
        return self._part("frame", name, f" : {self._local(body)}", {"at": (at, "m")}, None, ("x", "y", "phi"))

    def slide(self, name: str, first: Part | str, second: Part | str, *, along: Value, at: Value = None,
              start: Mapping[str, Value] | None = None) -> Part:  # fmt: skip
        """A joint that leaves `second` one translation against `first`; `"ground"` is the world."""
        return self._joint("slide", name, first, second, {"along": (along, ""), "at": (at, "m")}, start, ("x",))

    def hinge(self, name: str, first: Part | str, second: Part | str, *, at: Value = None,
              start: Mapping[str, Value] | None = None) -> Part:  # fmt: skip
        """A joint that leaves a rotation."""
        return self._joint("hinge", name, first, second, {"at": (at, "m")}, start, ("phi",))

    def free(self, name: str, first: Part | str, second: Part | str, *, at: Value = None, angle: Value = None,
             axes: str = "from", start: Mapping[str, Value] | None = None) -> Part:  # fmt: skip
        """A joint that leaves all three freedoms, measured in the axes of one body (`from`, `to`) or between them (`middle`)."""
        if axes not in ("from", "to", "middle"):
            raise ValueError(f"axes are from, to or middle, not {axes!r}")
        given = {"at": (at, "m"), "angle": (angle, ""), "axes": (None if axes == "from" else axes, "")}
        return self._joint("free", name, first, second, given, start, ("x", "y", "phi"))

    def weld(self, name: str, first: Part | str, second: Part | str) -> Part:
        """A joint that leaves nothing."""
        return self._joint("weld", name, first, second, {}, None, ())

    def _joint(
        self, kind: str, name: str, first: Part | str, second: Part | str, given: Mapping[str, tuple[Value, str]],
        start: Mapping[str, Value] | None, ports: tuple[str, ...],
    ) -> Part:  # fmt: skip
        return self._part(kind, name, f" : {self._local(first)} to {self._local(second)}", given, start, ports)

    def _part(
        self, kind: str, name: str, definition: str, given: Mapping[str, tuple[Value, str]],
        start: Mapping[str, Value] | None, ports: tuple[str, ...],
    ) -> Part:  # fmt: skip
        own = _name(name)
        if own in self._taken:
            raise ValueError(f"`{self.path}` already has `{own}`")
        inner = [
            f"{word} = {_value(value, unit, f'`{word}` of `{own}`')}"
            for word, (value, unit) in given.items()
            if value is not None
        ]
        for key, value in (start or {}).items():
            port, _, letter = _path(key).partition(".")
            domain = DOMAINS["rotation" if port == "phi" else "translation"]
            unit = str(domain.dimension(domain.variable(letter or "q") or "q"))
            inner.append(f"start {key} = {_value(value, unit, f'the start of `{own}`')}")
        self._taken.add(own)
        self._lines.append(f"{kind} {own}{definition}{_braces(inner)}")
        return Part(self.graph, f"{self.path}.{own}", ports)

    def _local(self, body: Part | str) -> str:
        """The name of a body inside the mechanism."""
        if isinstance(body, str) and body == GROUND:
            return GROUND
        name = str(body).removeprefix(f"{self.path}.")
        if name not in self._taken or (isinstance(body, Part) and body.graph is not self.graph):
            raise ValueError(f"`{self.path}` has no body `{body}`")
        return name

    def _text(self) -> list[str]:
        return [f"multibody {self.path} : planar {{", *(f"  {line}" for line in self._lines), "}"]


# ---------------------------------------------------------------- attributes of elements


class _Inner:
    """What stands in the braces of one element."""

    def __init__(self, graph: Graph, kind: str, name: str, law: Law, ports: Ports) -> None:
        self.graph, self.kind, self.name, self.law = graph, kind, name, law
        self.ports = dict(ports) if isinstance(ports, Mapping) else dict.fromkeys(ports, "")

    def text(self, given: Attributes) -> list[str]:
        lines: list[str] = []
        for word, value in given.items():
            if word in ("start", "nominal"):
                assert isinstance(value, Mapping)
                lines += [self._stored(word, _path(key), v) for key, v in value.items()]
            elif word in ("prefer", "require"):
                if value not in _CAUSALITIES:
                    raise ValueError(f"`{word}` of `{self.name}` is one of {', '.join(_CAUSALITIES)}, not {value!r}")
                lines.append(f"{word} = {value}")
            elif word != "description":
                known = ", ".join(Attributes.__annotations__)
                raise TypeError(f"`{self.name}`: an element has no `{word}`; it has {known}")
        return lines

    def _stored(self, word: str, key: str, value: Value) -> str:
        what = f"`{word} {key}` of `{self.name}`"
        unit = self._unit(key, what) if _is_number(value) and value != 0 and not self.graph.plain else ""
        return f"{word} {key} = {_value(value, unit, what)}"

    def _unit(self, key: str, what: str) -> str:
        """The SI unit of one of its variables, from its domain: that of its port, or that of the letters in the law."""
        port, _, letter = key.partition(".") if self.ports else ("", "", key)
        domain = DOMAINS.get(self.ports.get(port, "")) or self._told(port, letter)
        variable = None if domain is None else domain.variable(letter or _STORED.get(self.kind, ""))
        if domain is None or variable is None:
            raise ValueError(
                f"{what}: its law does not tell the unit of `{key}`; write the value with its unit, '1 [m]'"
            )
        return str(domain.dimension(variable))

    def _told(self, port: str, letter: str) -> Domain | None:
        """The domain that the letters of the law mean, as the compiler takes them."""
        from compiler.semantics.domain_table import paths_of

        words = {letter}
        for path in paths_of(self.law):
            head, _, tail = path.words.partition(".")
            if port and head == port:
                words.add(tail)
            elif not port and not tail and head not in self.graph._names:
                words.add(head)
        letters = {w for d in DOMAINS.values() for w in d.letters if w in words} - set(GENERIC)
        fitting = [d for d in DOMAINS.values() if d.typed and d.guessed and letters and letters <= set(d.letters)]
        return fitting[0] if len(fitting) == 1 else None


# ---------------------------------------------------------------- what is given, checked


def _name(name: str) -> str:
    """A name of the language, with an index if it has one. Raises ValueError."""
    from compiler.semantics.scope import RESERVED

    match = _NAME.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise ValueError(
            f"{name!r} is no name: letters a-z, digits and _, not a digit first, and perhaps an index, `mass[2]`"
        )
    if match.group(1) in RESERVED:
        raise ValueError(f"`{match.group(1)}` is a word of the language and cannot be a name")
    if match.group(2) is None:
        return match.group(1)
    return f"{match.group(1)}[{', '.join(str(int(i)) for i in match.group(2).split(','))}]"


def _model_name(name: str) -> str:
    from compiler.semantics.domain_table import ELEMENT_KINDS

    if _name(name) in ELEMENT_KINDS or "[" in name:
        raise ValueError(f"`{name}` cannot be the name of a model")
    return name


def _description(text: str) -> str:
    """A text that fits into one literal, which has no way to write a quotation mark or a line break. Raises ValueError."""
    if not isinstance(text, str) or '"' in text or not text.isprintable():
        raise ValueError(f"a description has no quotation marks, line breaks or control characters: {text!r}")
    return text


def _literal(description: str) -> str:
    return f' "{_description(description)}"' if description else ""


def _domain(domain: str, also: Iterable[str] = ()) -> str:
    known = [*DOMAINS, *also]
    if domain not in known:
        raise ValueError(f"there is no domain {domain!r}; domains are {', '.join(known)}")
    return domain


def _ports(ports: Ports) -> tuple[str, tuple[str, ...]]:
    """Ports in parentheses, and their names."""
    if isinstance(ports, str):
        raise TypeError(f"ports are a list of names or a mapping from names to domains, not {ports!r}")
    given = dict(ports) if isinstance(ports, Mapping) else dict.fromkeys(ports, "")
    if len(given) < len(ports) or any("[" in _name(p) for p in given):
        raise ValueError(f"the ports of an element have different names, without indices: {', '.join(map(str, ports))}")
    listed = ", ".join(f"{p}: {_domain(d)}" if d else p for p, d in given.items())
    return (f"({listed})" if listed else ""), tuple(given)


def _one_line(text: Any, what: str) -> str:
    """The text on one line. Raises ValueError for what could hide in it."""
    if not isinstance(text, str):
        raise TypeError(f"{what} is a text of the language, not {text!r}")
    line = " ".join(text.split())
    if "#" in line or '"' in line or not line.isprintable():
        raise ValueError(f"{what} has no comments, quotation marks or control characters: {text!r}")
    return line


def _expression(text: Any, what: str) -> str:
    """One expression of the language. Raises `CompilationFailed`."""
    from .door import parse_expression

    line = _one_line(text, what)
    parse_expression(Source(what, line))
    return line


def _path(text: str) -> str:
    """A dotted name."""
    from compiler.syntax.tree import Path as TreePath

    from .door import parse_expression

    found = parse_expression(Source("path", _one_line(text, "a path")))
    if not isinstance(found, TreePath):
        raise ValueError(f"{text!r} is no dotted name")
    return found.words


def _unit(unit: str) -> str:
    """One unit of the language. Raises `CompilationFailed`."""
    from .door import Literal, parse_expression

    line = _one_line(unit, "a unit")
    found = parse_expression(Source("unit", f"1 [{line}]"))
    if not isinstance(found, Literal) or found.unit is None:
        raise ValueError(f"{unit!r} is no unit")
    return line


def _law(head: str, law: Any) -> tuple[str, Law]:
    """The law of one element, and nothing else. Raises `CompilationFailed`."""
    from compiler.syntax import parse, tree

    line = _one_line(law, "a law")
    (model, *others) = parse(Source("law", f"model m {{\n{head}{line}\n}}")).statements
    statements = model.statements if isinstance(model, tree.Model) else ()
    only = statements[0] if len(statements) == 1 and not others else None
    if isinstance(only, tree.Declaration) and isinstance(only.definition, tree.Law) and not only.attributes:
        return line, only.definition
    raise ValueError(f"{law!r} is not one law: equations with commas between, `F = k*x`")


def _value(value: Value, unit: str, what: str, bare: bool = False) -> str:
    """A value as an expression; a number gets the unit, unless it stands after `name : unit =` (`bare`)."""
    if isinstance(value, Quantity | Part | Mechanism):
        return str(value)
    if isinstance(value, str):
        return _expression(value, what)
    if hasattr(value, "tolist"):  # numpy's numbers and arrays
        value = value.tolist()
    if _is_number(value):
        return _number(value, unit if unit != "1" else "", what, bare)
    if isinstance(value, list | tuple):
        items = [_value(v, unit, what, bare) for v in value]
        if len(items) < 2:
            raise ValueError(f"{what}: a list has two items or more")
        return f"({', '.join(items)})"
    raise TypeError(f"{what} is a number, a text of the language, or a list of these, not {value!r}")


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _number(value: Any, unit: str, what: str, bare: bool) -> str:
    """A number so that the same double is read again, in a unit."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{what} is no finite number: {value!r:.40}")
    text = number_text(number)
    if not unit or value == 0 or (bare and "^" not in text):
        return text
    return f"{text}*1 [{unit}]" if "^" in text else f"{text} [{unit}]"


def _braces(inner: Sequence[str]) -> str:
    return f" {{ {', '.join(inner)} }}" if inner else ""


def _model_of(model: Model) -> str:
    """The name of a loaded model; a file of several must say which."""
    names = list(model.compilation().tree.models)
    if model.model is not None and model.model not in names:
        raise ValueError(f"{model.source.name} defines no model `{model.model}`; it defines: {', '.join(names)}")
    if model.model is None and len(names) != 1:
        raise ValueError(
            f"{model.source.name} defines {', '.join(names)}: name one, `load(path, {names[0] if names else ''!r})`"
        )
    return model.model or names[0]
