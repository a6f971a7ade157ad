"""Random models with events, switches, friction, closed loops and mechanisms; a seed always gives the same, and parts can be left out."""

from __future__ import annotations

import random
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

PARTS = """
plain model Friction {
  parameter fc = 0.5, fs = 0.6
  port ends: untyped
  mode direction = 0
  0 end
  1 contact { active = direction != 0 }
  MR surface : e = direction*fc + 0.1*f
  ends -> end -> contact -> surface
  when direction == 0 and abs(end.e) > fs { direction = 1 if end.e > 0 else -1 }
  when direction*contact.f < 0 { direction = 0 }
}
plain model Valve {
  port ends: untyped
  mode open = false
  1 line
  0 gap { active = not open }
  ends -> line -> gap
  when not open and gap.e > 0 { open = true }
  when open and line.f < 0 { open = false }
}
"""


@dataclass(frozen=True)
class Part:
    """Lines that are kept or removed together, and their traits."""

    lines: tuple[str, ...]
    traits: frozenset[str] = frozenset()
    needed: bool = False
    singly: tuple[str, ...] | None = None  # the same for the second opinion, where it reads another text
    before: str = ""  # models that the lines use


@dataclass(frozen=True)
class Example:
    """A model: its parts, its parameters, and how long it runs."""

    seed: int
    parts: tuple[Part, ...]
    parameters: dict[str, float]
    span: float
    plain: bool = True
    first: dict[str, float] | None = None  # the parameters of the first of the structure
    units: dict[str, str] = field(default_factory=dict)
    structure: dict[str, object] = field(default_factory=dict)  # settings of the product's text alone

    @property
    def traits(self) -> frozenset[str]:
        return frozenset().union(*(p.traits for p in self.parts))

    @property
    def settings(self) -> dict[str, float]:
        """The parameters that its lines read, with their values."""
        body = " ".join(line for part in self.parts for line in (*part.lines, *(part.singly or ())))
        return {n: v for n, v in self.parameters.items() if re.search(rf"\b{n}\b", body)}

    @property
    def text(self) -> str:
        """The structure with its first parameters; the others are set."""
        return self.written(self.first or self.parameters)

    @property
    def witness(self) -> str:
        """The text that the second opinion reads."""
        parts = (p if p.singly is None else replace(p, lines=p.singly, before="") for p in self.parts)
        return replace(self, parts=tuple(parts)).written(self.first or self.parameters, self.settings)

    def written(self, values: Mapping[str, float], names: Iterable[str] | None = None) -> str:
        """The whole model; `names` of the parameters that it declares."""
        body = "\n".join("  " + line for part in self.parts for line in part.lines)
        declared = "".join(
            f"  parameter {n}{': ' + self.units[n] if n in self.units else ''} = {values[n]!r}\n"
            for n in names or self.settings
        )
        shared = "".join(part.before for part in self.parts) + "".join(
            f"plain model {piece}" for piece in PARTS.split("plain model ")[1:] if f"{piece.split()[0]} " in body
        )
        head = "plain model" if self.plain else "model"
        span = f"{self.span!r}" if self.plain else f"{self.span!r} s"
        return f"{shared}{head} Random {{\n{declared}{body}\n  experiment go {{ simulate 0 .. {span} }}\n}}\n"

    def smaller(self) -> Iterator[Example]:
        """The same without one of its parts."""
        for i, part in enumerate(self.parts):
            if not part.needed:
                yield replace(self, parts=self.parts[:i] + self.parts[i + 1 :])


class Writer:
    """Parts of one random network: a chain of junctions, each with its elements."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.parts: list[Part] = []
        self.parameters: dict[str, float] = {}
        self.states: list[str] = []  # readings that an event may watch
        self.count = 0
        self.startable = "CI"  # of one storage, so that no two starts contradict each other

    def name(self, letter: str) -> str:
        self.count += 1
        return f"{letter}{self.count}"

    def number(self, low: float = 0.5, high: float = 2.0) -> str:
        """A parameter."""
        name = self.name("p_")
        self.parameters[name] = round(self.rng.uniform(low, high), 3)
        return name

    def add(self, *lines: str, traits: str = "", needed: bool = False) -> None:
        self.parts.append(Part(lines, frozenset(traits.split()), needed))

    def start(self, letter: str, value: str) -> str:
        """A start, if this storage has the one of the model."""
        if letter not in self.startable or self.rng.random() < 0.4:
            return ""
        self.startable = ""
        return f" {{ start {value} }}"

    # ------------------------------------------------------------ what hangs on a junction
    def resistor(self, at: str, needed: bool = False) -> None:
        r, a = self.number(), self.number(0.2, 1.0)
        laws = {
            f"e = {r}*f": "",
            f"e = {r}*f + {a}*f^3": "nonlinear",
            f"e = {r}*f + {a}*tanh(5*f)": "nonlinear",
            f"f = {a}*(exp(e/{r}) - 1)": "nonlinear exponential",
            f"e = {r}*f if f > 0 else {a}*f": "kink if",
            f"e = {r}*f + {a}*max(f - 0.2, 0)": "kink max",
            f"e = {r}*f*(1 + abs(f))": "kink abs",
        }
        law = self.rng.choice(list(laws))
        name = self.name("R")
        self.add(f"R {name} : {law}", f"{at} -> {name}", traits=laws[law], needed=needed)

    def capacitor(self, at: str, needed: bool = False) -> None:
        k, a, q = self.number(), self.number(0.2, 1.0), self.number(-0.5, 0.5)
        laws = {
            f"e = {k}*q": "",
            f"e = {k}*q + {a}*q^3": "nonlinear",
            f"energy = {k}/2*q^2 + {a}*q^4": "nonlinear energy",
            f"e = {k}*q + 5*max(q - {a}, 0) + 5*min(q + {a}, 0)": "kink stops",
        }
        law = self.rng.choice(list(laws))
        name = self.name("C")
        start = self.start("C", f"q = {q}")
        self.add(f"C {name} : {law}{start}", f"{at} -> {name}", traits=laws[law], needed=needed)
        self.states.append(f"{name}.q")

    def inertia(self, at: str, needed: bool = False) -> None:
        m, p = self.number(), self.number(-0.5, 0.5)
        law = self.rng.choice([f"p = {m}*f", f"p = {m}*f", f"energy = p^2/(2*{m}) + 0.05*p^4"])
        name = self.name("I")
        start = self.start("I", f"p = {p}")
        self.add(f"I {name} : {law}{start}", f"{at} -> {name}", traits="energy" * law.startswith("e"), needed=needed)
        self.states.append(f"{name}.p")

    def source(self, at: str) -> None:
        a, w = self.number(), self.number(2, 6)
        t = self.number(0.2, 0.8)
        values = {
            f"{a}*sin({w}*time)": "",
            f"{a}*step(time - {t})": "time",
            f"{a}*pulse(time, {t}, {t} + 0.3)": "time",
            f"{a} if sin({w}*time) > 0.8 else 0": "time if",
            f"{a}*ramp(time, 0.1, {t})": "time",
            f"{a}*max(sin({w}*time), 0)": "time max",
            f"{a}*abs(cos({w}*time))": "time abs",
        }
        value = self.rng.choice(list(values))
        name = self.name("S")
        self.add(f"Se {name} : e = {value}", f"{name} -> {at}", traits=values[value])

    # ------------------------------------------------------------ specials on a 1-junction
    def friction(self, at: str) -> None:
        name, fc = self.name("D"), self.number(0.2, 0.8)
        self.add(f"Friction {name} {{ fc = {fc}; fs = 1.2*{fc} }}", f"{at} -> {name}.ends", traits="friction events")

    def valve(self, at: str) -> None:
        name = self.name("V")
        self.add(f"Valve {name}", f"{at} -> {name}.ends", traits="diode events")

    def branch(self, at: str) -> None:
        """A branch that a condition switches."""
        name, r, c = self.name("w"), self.name("R"), self.name("C")
        watched = self.rng.choice([s for s in self.states if s[0] == "C"] or ["time"])
        level = self.number(0.02, 0.2)
        what = self.rng.choice([(f"R {r} : e = {self.number()}*f", r), (f"C {c} : e = {self.number()}*q", c)])
        inner = (f"R {r}_ : e = {self.number()}*f",) if what[1] == c else ()
        members = ", ".join([what[1], *([f"{r}_"] if inner else [])])
        self.add(
            what[0],
            *inner,
            f"1 {name} {{ active = {watched} > {level} }}",
            f"{at} -> {name} -> {members}",
            traits="switched events",
        )

    def controlled(self, at: str, gate: str) -> None:
        """A transistor: a current out of a node by another node's potential."""
        name, g, v = self.name("T"), self.number(0.3, 1.0), self.number(0.1, 0.4)
        self.add(f"MSf {name} : f = {g}*max({gate}.e - {v}, 0)^2", f"{at} -> {name}", traits="controlled")

    def field(self, first: str, second: str) -> None:
        """A storage of two ports between two junctions."""
        name, a, b = self.name("C"), self.number(1, 2), self.number(1, 2)
        self.add(
            f"C {name}(x, y) : energy = {a}/2*x^2 + {b}/2*y^2 + 0.3*x*y + 0.1*x^2*y^2",
            f"{first} -> {name}.x",
            f"{second} -> {name}.y",
            traits="field",
        )

    # ------------------------------------------------------------ signals and events
    def loop(self, at: str) -> None:
        """A controller that reads a state."""
        state, name, k = self.rng.choice(self.states), self.name("M"), self.number(0.3, 1.5)
        self.add(
            f"signal {name}_i = integral(0.3 - {state}, 0)",
            f"signal {name}_f = integral(({state} - {name}_f)/0.2, 0)",
            f"MSe {name} : e = {k}*(0.3 - {name}_f) + 0.5*{name}_i",
            f"{name} -> {at}",
            traits="loop",
        )

    def sampled(self, at: str) -> None:
        state, name, k = self.rng.choice(self.states), self.name("M"), self.number(0.3, 1.5)
        period = self.rng.choice([0.13, 0.25, 0.31])
        timing = {0.13: "", 0.25: " offset 0.05", 0.31: " offset 0.02 delay 0.11"}[period]
        self.add(
            f"mode {name}_u = 0, {name}_s = 0, {name}_e = 0",
            f"signal {name}_w = {name}_s + {k}*{name}_e",
            f"every {period}{timing} {{ {name}_e = 0.2 - {state}; {name}_s = {name}_s + 0.1*{name}_e; {name}_u = {name}_w }}",
            f"MSe {name} : e = {name}_u",
            f"{name} -> {at}",
            traits="sampled events",
        )

    def relay(self, at: str) -> None:
        state, name, h = self.rng.choice(self.states), self.name("M"), self.number(0.02, 0.2)
        self.add(
            f"mode {name}_u = 0.7",
            f"when {state} > {h} {{ {name}_u = -0.7 }}",
            f"when {state} < -{h} {{ {name}_u = 0.7 }}",
            f"MSe {name} : e = {name}_u",
            f"{name} -> {at}",
            traits="relay events",
        )

    def counter(self) -> None:
        state, name, h = self.rng.choice(self.states), self.name("n"), self.number(0.02, 0.2)
        wave = self.rng.choice([f"{state} > {h}", f"sin(9*{state}) > 0.6", f"abs({state}) > {h}"])
        self.add(
            f"mode {name} = 0",
            f"when {wave} {{ {name} = {name} + 1 }}",
            f"output o{name} = {name}",
            traits="counter events",
        )

    def bounce(self) -> None:
        """A momentum that is turned round where a displacement passes a level."""
        momenta, places = [s for s in self.states if s[0] == "I"], [s for s in self.states if s[0] == "C"]
        if not momenta or not places:
            return
        momentum, place, h = self.rng.choice(momenta), self.rng.choice(places), self.number(0.02, 0.2)
        self.add(
            f"when {place} {self.rng.choice(['> ', '< -'])}{h} {{ {momentum} = -0.7*{momentum} }}",
            traits="bounce events",
        )


SPECIALS = (
    "friction",
    "valve",
    "branch",
    "loop",
    "sampled",
    "relay",
    "counter",
    "bounce",
    "controlled",
    "field",
    "none",
)


def network(seed: int, structure: int = 8) -> Example:
    """A random network; `structure` seeds in a row share their structure and differ in parameters."""
    w = Writer(seed // structure)
    rng = w.rng
    specials = rng.sample(SPECIALS, rng.randint(1, 3))
    if {"friction", "valve", "branch"} & set(specials):
        w.startable = "C"  # what sticks or blocks at the start has no momentum
    junctions: list[tuple[str, str]] = []
    kind = rng.choice("01")
    for number in range(rng.randint(2, 5)):
        name = f"j{number}"
        w.add(f"{kind} {name}", needed=True)
        if junctions:
            before = junctions[-1][0]
            link = rng.random()
            if link < 0.15:
                coupler, ratio = w.name("T"), w.number()
                w.add(f"TF {coupler} : f1 = {ratio}*f2", f"{before} -> {coupler} -> {name}", needed=True)
            elif link < 0.3 and junctions[-1][1] == kind:
                coupler, ratio = w.name("G"), w.number()
                w.add(f"GY {coupler} : e1 = {ratio}*f2", f"{before} -> {coupler} -> {name}", needed=True)
            else:
                w.add(f"{before} -> {name}", needed=True)
        junctions.append((name, kind))
        kind = kind if rng.random() < 0.15 else "10"[int(kind)]
    for name, kind in junctions:
        (w.inertia if kind == "1" else w.capacitor)(name)
        if rng.random() < 0.8:
            w.resistor(name)
        if rng.random() < 0.3:
            (w.capacitor if kind == "1" else w.inertia)(name)
    ones = [n for n, k in junctions if k == "1"]
    zeros = [n for n, k in junctions if k == "0"]
    if ones:
        w.source(rng.choice(ones))
    else:
        source, amplitude = w.name("S"), w.number()
        w.add(f"Sf {source} : f = {amplitude}*sin(3*time)", f"{source} -> {zeros[0]}")
    for name in specials:
        special(w, name, ones, zeros)
    for number, state in enumerate(w.states[:4]):
        owner = state.split(".")[0]
        w.add(
            f"output y{number} = {state}", f"output z{number} = {owner}.{'e' if state[0] == 'C' else 'f'}", needed=True
        )
    w.add(f"output s = {junctions[-1][0]}.{'e' if junctions[-1][1] == '0' else 'f'}", needed=True)
    return varied(Example(seed, tuple(w.parts), w.parameters, round(rng.uniform(1.0, 2.5), 2)), seed % structure)


def special(w: Writer, name: str, ones: list[str], zeros: list[str]) -> None:
    """Add what a name says, where there is a junction for it."""
    rng = w.rng
    match name:
        case "friction" | "valve" | "branch" | "loop" | "sampled" | "relay" if ones:
            getattr(w, name)(rng.choice(ones))
        case "counter" | "bounce":
            getattr(w, name)()
        case "controlled" if len(zeros) > 1:
            at, gate = rng.sample(zeros, 2)
            w.controlled(at, gate)
        case "field" if len(ones) > 1:
            first, second = rng.sample(ones, 2)
            w.field(first, second)


def varied(example: Example, number: int) -> Example:
    """The same structure with other parameters."""
    if not number:
        return example
    rng = random.Random(example.seed)
    varied = {n: round(v * rng.uniform(0.7, 1.4), 4) for n, v in example.parameters.items()}
    return replace(example, parameters=varied, first=example.parameters)


# ---------------------------------------------------------------- mechanisms
class Dice(random.Random):
    """Random numbers, and parameters with units."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.parameters: dict[str, float] = {}
        self.units: dict[str, str] = {}

    def parameter(self, low: float, high: float, unit: str) -> str:
        name = f"p_{len(self.parameters)}"
        self.parameters[name], self.units[name] = round(self.uniform(low, high), 4), unit
        return name


def mechanism(seed: int, structure: int = 8) -> Example:
    """A random planar mechanism: a chain with springs, a four-bar or a slider-crank; `structure` seeds in a row differ in parameters."""
    number = seed // structure
    return varied([_chain, _four_bar, _slider_crank][number % 3](seed, Dice(number)), seed % structure)


def _u(rng: Dice, low: float, high: float) -> float:
    return round(rng.uniform(low, high), 4)


def _body(rng: Dice, name: str, x: float, y: float) -> str:
    mass, inertia = rng.parameter(0.3, 2, "kg"), rng.parameter(0.01, 0.1, "kg*m^2")
    return f"  body {name} {{ mass = {mass}, inertia = {inertia}, at = ({x:.6f} m, {y:.6f} m) }}"


def _mechanism(seed: int, block: list[str], parts: list[Part], outputs: list[str], rng: Dice) -> Example:
    gravity = "  gravity = (0, -9.81 [m/s^2])"
    moved = any(line.startswith("Se") for part in parts for line in part.lines) and rng.random() < 0.4
    lines = ("multibody b : planar {", *([] if moved else [gravity]), *block, "}")
    shown = tuple(f"output y{i} = {o}" for i, o in enumerate(outputs))
    whole = (Part(lines, frozenset({"mechanism"}), True), *parts, Part(shown, needed=True))
    return Example(seed, whole, rng.parameters, _u(rng, 0.3, 0.8), plain=False, units=rng.units)


def _hanging(rng: Dice, joints: list[str], letter: str = "M", rate: str = "omega", unit: str = "N*m") -> list[Part]:
    """Springs, dampers and drives on joints."""
    found = []
    q, per, damping = ("phi", "", f"{unit}*s") if letter == "M" else ("x", "/m", f"{unit}*s/m")
    for i, joint in enumerate(joints):
        choice = rng.random()
        if choice < 0.4:
            law = f"{rng.parameter(1, 20, unit + per)}*{q}"
            if rng.random() < 0.5:
                law += f" + {rng.parameter(1, 5, unit + ('/m^3' if per else ''))}*{q}^3"
            found.append(Part((f"C c_{i} : {letter} = {law}", f"b.{joint} -> c_{i}"), frozenset({"spring"})))
        if choice > 0.3:
            r = rng.parameter(0.01, 0.5, damping)
            found.append(Part((f"R r_{i} : {letter} = {r}*{rate}", f"b.{joint} -> r_{i}")))
        if choice > 0.8:
            drive = f"{rng.parameter(0.2, 3, unit)}*sin(7*time/1 s)"
            found.append(Part((f"Se s_{i} : {letter} = {drive}", f"s_{i} -> b.{joint}")))
    return found


def _chain(seed: int, rng: Dice) -> Example:
    count, x, y = rng.randint(1, 3), 0.0, 0.0
    block, joints, before, outputs = [], [], "ground", []
    for i in range(count):
        dx, dy = _u(rng, 0.2, 0.6), _u(rng, -0.4, 0.4)
        block.append(_body(rng, f"link{i}", x + dx / 2, y + dy / 2))
        start = (
            f", start phi = {_u(rng, -0.8, 0.8)}, start phi.omega = {_u(rng, -2, 2)} [1/s]"
            if rng.random() < 0.5
            else ""
        )
        block.append(f"  hinge h{i} : {before} to link{i} {{ at = ({x:.6f} m, {y:.6f} m){start} }}")
        joints.append(f"h{i}")
        outputs += [f"b.h{i}.phi", f"b.link{i}.y"]
        before, x, y = f"link{i}", x + dx, y + dy
    parts = _hanging(rng, joints)
    if rng.random() < 0.6:
        block.append(f"  frame wall : ground {{ at = ({_u(rng, 0.5, 1)} m, {_u(rng, 0.7, 1)} m) }}")
        block.append(f"  frame tip : {before} {{ at = ({x:.6f} m, {y:.6f} m) }}")
        block.append("  distance d : wall to tip")
        parts.append(
            Part((f"C c_d : F = {rng.parameter(5, 40, 'N/m')}*(x - 0.6 m)", "b.d -> c_d"), frozenset({"distance"}))
        )
        outputs.append("b.d.d")
    if rng.random() < 0.4:
        parts.append(
            Part(
                ("mode n = 0", f"when b.h0.phi.omega > {_u(rng, 0, 1)} [1/s] {{ n = n + 1 }}", "output count = n"),
                frozenset({"events"}),
            )
        )
    return _mechanism(seed, block, parts, outputs, rng)


def _four_bar(seed: int, rng: Dice) -> Example:
    a, g = _u(rng, 0.15, 0.35), _u(rng, 0.8, 1.1)
    angle = _u(rng, 0.3, 2.5)
    from math import atan2, cos, hypot, sin, sqrt

    ax, ay = a * cos(angle), a * sin(angle)
    reach = hypot(g - ax, ay)
    b, c = _u(rng, 0.55, 0.9) * (reach + 0.3), _u(rng, 0.55, 0.9) * (reach + 0.3)
    along = (reach**2 + b**2 - c**2) / (2 * reach)
    beside = sqrt(max(b**2 - along**2, 1e-4))
    turn = atan2(-ay, g - ax)
    cx, cy = ax + along * cos(turn) - beside * sin(turn), ay + along * sin(turn) + beside * cos(turn)
    block = [
        _body(rng, "crank", ax / 2, ay / 2), _body(rng, "coupler", (ax + cx) / 2, (ay + cy) / 2), _body(rng, "rocker", (g + cx) / 2, cy / 2),
        "  hinge hA : ground to crank { at = (0, 0) }",
        f"  hinge hB : crank to coupler {{ at = ({ax!r} m, {ay!r} m) }}",
        f"  hinge hC : coupler to rocker {{ at = ({cx!r} m, {cy!r} m) }}",
        f"  hinge hD : ground to rocker {{ at = ({g} m, 0) }}",
    ]  # fmt: skip
    parts = _hanging(rng, ["hA", "hD", "hC"])
    return _mechanism(seed, block, parts, ["b.hA.phi", "b.hD.phi", "b.coupler.x", "b.hA.phi.omega"], rng)


def _slider_crank(seed: int, rng: Dice) -> Example:
    from math import cos, sin, sqrt

    r, offset, angle = _u(rng, 0.1, 0.3), _u(rng, -0.05, 0.05), _u(rng, 0.2, 2.8)
    length = r * _u(rng, 2, 4)
    ax, ay = r * cos(angle), r * sin(angle)
    x = ax + sqrt(length**2 - (ay - offset) ** 2)
    block = [
        _body(rng, "crank", ax / 2, ay / 2), _body(rng, "rod", (ax + x) / 2, (ay + offset) / 2), _body(rng, "piston", x, offset),
        "  hinge main : ground to crank { at = (0, 0) }",
        f"  hinge pin : crank to rod {{ at = ({ax!r} m, {ay!r} m) }}",
        f"  hinge wrist : rod to piston {{ at = ({x!r} m, {offset} m) }}",
        "  slide bore : ground to piston { along = 0 }",
    ]  # fmt: skip
    parts = [*_hanging(rng, ["main", "pin"]), *(_hanging(rng, ["bore"], "F", "v", "N") if rng.random() < 0.5 else [])]
    renamed = [Part(tuple(f"{line}" for line in p.lines), p.traits) for p in parts[:]]
    unique: dict[str, Part] = {}
    for part in renamed:
        unique.setdefault(part.lines[0].split()[1], part)
    return _mechanism(
        seed, block, list(unique.values()), ["b.main.phi", "b.bore.x", "b.rod.phi", "b.main.phi.omega"], rng
    )
