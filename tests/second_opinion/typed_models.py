"""Random models of planar and spatial multibonds, units, slots, `IC` and `RS`, each written twice.

The product reads matrices with a unit in each entry, units of other systems, a chosen model and an `RS`; the second opinion single bonds, numbers in SI, the
parts of the chosen model, and an `R` whose heat is written out.
"""

from __future__ import annotations

from tests.second_opinion.random_models import Dice, Example, Part, varied

COMPONENTS = {"planar": ("x", "y", "phi"), "spatial": ("x", "y", "z", "rx", "ry", "rz")}
SLOTS = """model Soft { port tip: rotation; parameter k: N*m = 1; C coil : M = k*phi; tip -> coil }
model Hard {
  port tip: rotation
  parameter k: N*m = 1
  C coil : M = k*phi + 2 [N*m]*phi^3
  R rub  : M = 0.1 [N*m*s]*omega
  1 here : rotation
  tip -> here -> coil, rub
}
"""
# A law with a number in an unusual unit, and that unit in SI.
UNITS = (
    ("C {n} : F = {v} [lbf/inch]*x", "C {n} : F = {v}*{si!r} [N/m]*x", 4.4482216152605 / 0.0254),
    ("C {n} : F = {v} [kgf/m]*x", "C {n} : F = {v}*{si!r} [N/m]*x", 9.80665),
    ("R {n} : F = {v} [hp*min^2/ft^2]*v", "R {n} : F = {v}*{si!r} [N*s/m]*v", 745.6998715822702 * 3600 / 0.3048**2),
    ("R {n} : F = {v} [lb/h]*v", "R {n} : F = {v}*{si!r} [N*s/m]*v", 0.45359237 / 3600),
    ("I {n} : p = {v} [lb]*v", "I {n} : p = {v}*{si!r} [kg]*v", 0.45359237),
)


class Typed:
    """Parts of one random model."""

    def __init__(self, seed: int) -> None:
        self.rng = Dice(seed)
        self.parts: list[Part] = []
        self.structure: dict[str, object] = {}

    def both(self, rich: list[str], single: list[str], traits: str, before: str = "") -> None:
        self.parts.append(Part(tuple(rich), frozenset(traits.split()), True, tuple(single), before))

    def multibond(self, domain: str) -> None:
        """A body of some freedoms with losses, on a spring whose place is moved by a matrix."""
        rng, names = self.rng, COMPONENTS[domain]
        straight = [n for n in names if n in "xyz"]
        kinds = {n: "translation" if n in straight else "rotation" for n in names}
        ports = ", ".join(f"{n}: {kinds[n]}" for n in names)
        rate = {n: "v" if n in straight else "omega" for n in names}

        def unit(row: str, column: str, both: str, one: str, none: str) -> str:
            return (both, one, none)[(row not in straight) + (column not in straight)]

        mass = [rng.parameter(0.5, 2, "kg" if n in straight else "kg*m^2") for n in names]
        stiff = {
            (r, c): rng.parameter(20, 60, unit(r, c, "N/m", "N", "N*m"))
            if r == c
            else rng.parameter(-5, 5, unit(r, c, "N/m", "N", "N*m"))
            for i, r in enumerate(names)
            for c in names[i:]
        }
        loss = [rng.parameter(0.1, 1, "N*s/m" if n in straight else "N*m*s") for n in names]
        k = [[stiff.get((r, c)) or stiff[c, r] for c in names] for r in names]
        arms = {  # of the velocities at the spring, from angular velocities at the body
            "planar": {("x", "phi"): "-l_y", ("y", "phi"): "l_x"},
            "spatial": {("x", "ry"): "l_x", ("x", "rz"): "-l_y", ("y", "rx"): "-l_x", ("z", "rx"): "l_y"},
        }[domain]
        l_x, l_y = (rng.parameter(-0.5, 0.5, "m") for _ in range(2))
        value = {key: text.replace("l_x", l_x).replace("l_y", l_y) for key, text in arms.items()}
        turn = [["1" if r == c else value.get((r, c), "0") for c in names] for r in names]
        start = f"{{ start x.p = {_number(rng)} [N*s] }}"
        drive = f"Se push : F = {rng.parameter(1, 5, 'N')}*sin({_number(rng, 2, 6)}*time/1 s)"
        listed = ", ".join(names)
        rich = [
            f"1 b : {domain}", f"constant M_b = {_diagonal(mass)}, K_b = {_matrix(k)}, D_b = {_diagonal(loss)}, T_b = {_matrix(turn)}",
            f"I body({listed}) : p = M_b*f {start}", f"R loss({listed}) : e = D_b*f", f"C spring({listed}) : e = K_b*q",
            f"TF arm(a: {domain}, b: {domain}) : b.f = T_b*a.f", "b => body, loss, arm.a", "arm.b => spring", drive, "push -> b.y",
        ]  # fmt: skip
        flows = {n: f"{n}.{rate[n]}" for n in names}
        effort = {n: "F" if n in straight else "M" for n in names}
        single = [
            *(f"1 b_{n} : {kinds[n]}" for n in names), *(f"0 c_{n} : {kinds[n]}" for n in names),
            f"I body({ports}) : " + ", ".join(f"{n} = {m}*{flows[n]}" for n, m in zip(names, mass, strict=True)) + f" {start.replace('x.p', 'x')}",
            f"R loss({ports}) : " + ", ".join(f"{n}.{effort[n]} = {r}*{flows[n]}" for n, r in zip(names, loss, strict=True)),
            f"C spring({ports}) : " + ", ".join(f"{r}.{effort[r]} = " + " + ".join(f"{k[i][j]}*{c}" for j, c in enumerate(names)) for i, r in enumerate(names)),
            *(f"b_{n} -> body.{n}, loss.{n}, c_{n}" for n in names), *(f"c_{n} -> spring.{n}" for n in names), drive, "push -> b_y",
        ]  # fmt: skip
        for i, ((r, c), ratio) in enumerate(value.items()):
            single += [f"TF arm_{i} : {rate[r]}2 = {ratio}*{rate[c]}1", f"b_{c} -> arm_{i} -> c_{r}"]
        self.both(rich, single, domain)
        self.both(
            [f"output y_{n} = spring.{n}" for n in names[-3:]], [f"output y_{n} = spring.{n}" for n in names[-3:]], ""
        )

    def units(self) -> None:
        """A mass with a spring and a damper in units of other systems."""
        rich, single = [], []
        for i, law in enumerate(self.rng.sample(UNITS, 2)):
            value = _number(self.rng, 0.2, 1.5)
            rich.append(law[0].format(n=f"u_{i}", v=value))
            single.append(law[1].format(n=f"u_{i}", v=value, si=law[2]))
        own = [
            f"I mass : p = {self.rng.parameter(0.5, 2, 'kg')}*v", f"R rub : F = {self.rng.parameter(0.5, 2, 'N*s/m')}*v", "1 spot",
            f"Se kick : F = {self.rng.parameter(1, 3, 'N')}*cos(3*time/1 s)", "kick -> spot -> mass, rub, u_0, u_1", "output v = mass.v",
        ]  # fmt: skip
        self.both(rich + own, single + own, "units")

    def slot(self) -> None:
        """A model in a slot, set from outside or as it stands."""
        k, hard = self.rng.parameter(5, 20, "N*m"), self.rng.random() < 0.5
        if self.rng.random() < 0.5:
            self.structure["Leg"] = "Hard" if hard else "Soft"
        chosen = "Soft" if hard and self.structure else "Hard" if hard or self.structure else "Soft"
        wheel = [
            f"I wheel : L = {self.rng.parameter(0.5, 2, 'kg*m^2')}*omega {{ start omega = 2 [1/s] }}",
            "1 hub",
            "hub -> wheel",
        ]
        rich = [
            f"parameter Leg: model = {chosen}",
            *wheel,
            f"Leg leg {{ k = {k} }}",
            "hub -> leg.tip",
            "output phi = leg.coil.phi",
        ]
        rich += [
            "Soft one",
            "Hard other",
            "Sf held, kept : omega = 0",
            "held -> one.tip",
            "kept -> other.tip",
        ]  # else they were models to run
        single = [
            *wheel,
            f"C coil : M = {k}*phi" + (" + 2 [N*m]*phi^3" if hard else ""),
            "hub -> coil",
            "output phi = coil.phi",
        ]
        single += ["R rub2 : M = 0.1 [N*m*s]*omega", "hub -> rub2"] if hard else []
        self.both(rich, single, "slot", SLOTS)

    def relay(self) -> None:
        """An `IC`: charge and momentum in one energy."""
        c, m = self.rng.parameter(0.5, 2, "F"), self.rng.parameter(0.5, 2, "kg")
        lines = [
            f"IC store(coil: electric, arm: translation) : energy = coil.q^2/(2*{c}) + arm.p^2/(2*{m}) + {_number(self.rng, -0.3, 0.3)} [V/(N*s)]*coil.q*arm.p*cos(coil.q/1 C)",
            f"Se supply : u = {self.rng.parameter(0.5, 2, 'V')}", f"R lead : u = {self.rng.parameter(0.5, 2, 'ohm')}*i", "supply -> 1(lead) -> store.coil",
            f"C bow : F = {self.rng.parameter(2, 9, 'N/m')}*x", "Sf still : v = 0.3 [m/s]*sin(2*time/1 s)", "still -> 0(bow) -> store.arm", "output charge = store.coil.q",
        ]  # fmt: skip
        self.both(lines, lines, "IC")

    def brake(self) -> None:
        """An `RS`: in the witness an `R` gives the heat against its arrow."""
        b, c = self.rng.parameter(0.5, 2, "N*m*s"), self.rng.parameter(5, 20, "J/K")
        law = f"shaft.M = {b}*shaft.omega*(1 + (heat.T - 290 K)/100 K)"
        shared = [
            "1 axle : rotation",
            f"I flywheel : L = {self.rng.parameter(0.5, 2, 'kg*m^2')}*omega {{ start omega = 9 [1/s] }}",
            f"C disc : T = 293 K*exp(S/{c})",
        ]
        rich = [
            *shared,
            f"RS pad(shaft, heat) : {law}",
            "axle -> flywheel, pad.shaft",
            "pad.heat -> disc",
            "output T = disc.T, w = axle.omega",
        ]
        single = [
            *shared, f"R pad(shaft: rotation, heat: thermal) : {law}, heat.S_dot = -{law.partition(' = ')[2]}*shaft.omega/heat.T", "0 rim : thermal",
            "axle -> flywheel, pad.shaft", "rim -> pad.heat, disc", "output T = disc.T, w = axle.omega",
        ]  # fmt: skip
        self.both(rich, single, "RS")


def _matrix(rows: list[list[str]]) -> str:
    return "[" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]"


def _diagonal(entries: list[str]) -> str:
    return _matrix([[x if i == j else "0" for j in range(len(entries))] for i, x in enumerate(entries)])


def _number(rng: Dice, low: float = 0.2, high: float = 1.0) -> str:
    return repr(round(rng.uniform(low, high), 3))


def typed(seed: int, structure: int = 8) -> Example:
    """A random model with units; `structure` seeds in a row share their structure and differ in parameters."""
    w = Typed(seed // structure)
    w.multibond(w.rng.choice(["planar", "planar", "spatial"]))
    for name in w.rng.sample(["units", "slot", "relay", "brake"], 2):
        getattr(w, name)()
    example = Example(
        seed,
        tuple(w.parts),
        w.rng.parameters,
        round(w.rng.uniform(0.5, 1.5), 2),
        plain=False,
        units=w.rng.units,
        structure=w.structure,
    )
    return varied(example, seed % structure)
