"""Random mechanisms in space by number: trees with all kinds of joints, closed chains, gyroscopes, and what rolls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.second_opinion.random_models import Dice, Example, Part, varied

KINDS = ("hinge", "hinge", "slide", "cylinder", "screw", "universal", "ball", "planar", "weld")
LETTERS = {
    "hinge": ("phi",), "screw": ("phi",), "slide": ("x",), "cylinder": ("x", "phi"), "universal": ("phi1", "phi2"),
    "ball": ("rx", "ry", "rz"), "planar": ("x", "y", "phi"), "free": ("x", "y", "z", "rx", "ry", "rz"),
}  # fmt: skip


def spatial(seed: int, structure: int = 8) -> Example:
    """A random mechanism in space; `structure` seeds in a row share their structure and differ in parameters."""
    number = seed // structure
    w = Workshop(seed, number)
    kind = number % 6
    [w.tree, w.tree, w.closed, w.bricard, w.gyroscope, w.rolling][kind]()
    return varied(w.example(), seed % structure)


class Workshop:
    """Lines of a `multibody` block, what hangs on it, and outputs."""

    def __init__(self, seed: int, number: int) -> None:
        self.seed, self.rng = seed, Dice(number)
        self.block: list[str] = []
        self.parts: list[Part] = []
        self.outputs: list[str] = []
        self.joints: list[tuple[str, str]] = []  # name, kind
        self.traits: set[str] = set()

    def u(self, low: float, high: float) -> float:
        return round(self.rng.uniform(low, high), 3)

    def vector(self, size: float = 1.0, about: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        return np.array([round(c + self.rng.uniform(-size, size), 3) for c in about])

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    # ------------------------------------------------------------ parts
    def body(self, name: str, at: Any, starts: str = "") -> None:
        mass, size = self.rng.parameter(0.5, 2, "kg"), self.rng.parameter(0.02, 0.1, "kg*m^2")
        shares = [self.u(0.8, 1.4) for _ in range(3)], [self.u(-0.2, 0.2) for _ in range(3)]
        turn = f", turn = {written(self.vector())}" if self.chance(0.5) else ""
        tensor = f"{size}*({', '.join(map(str, [*shares[0], *shares[1]]))})"
        self.block.append(f"body {name} {{ mass = {mass}, inertia = {tensor}, at = {written(at, 'm')}{turn}{starts} }}")
        self.outputs += [f"{name}.{self.rng.choice('xyz')}", f"{name}.{self.rng.choice(['rx', 'ry', 'rz'])}.omega"]
        if self.chance(0.3):
            self.outputs.append(f"{name}.attitude.{self.rng.choice('wxyz')}")

    def joint(self, kind: str, name: str, ends: str, at: Any, start: float = 0.0, rates: str = "") -> None:
        """`start`: the chance that its coordinates are said; `rates`: those of which the start is said, with their sizes."""
        axis, second = self.vector(about=(1.1, 0, 0)), self.vector()
        more = {
            "hinge": f", about = {written(axis)}", "slide": f", along = {written(axis)}", "cylinder": f", along = {written(axis)}",
            "screw": f", along = {written(axis)}, lead = {self.u(0.2, 0.6)} m",
            "universal": f", about = {written(axis)}, then = {written(np.cross(axis, second))}",
            "planar": f", turn = {written(second)}", "free": f", turn = {written(second)}, axes = {self.rng.choice(['from', 'to', 'middle'])}",
        }.get(kind, "")  # fmt: skip
        for letter in LETTERS.get(kind, ()) if self.chance(start) else ():
            metres = letter in "xyz"
            more += f", start {letter} = {self.u(-0.5, 0.5)}{' m' if metres else ''}"
            more += f", start {letter}.{'v' if metres else 'omega'} = {self.u(-2, 2)} [{'m/s' if metres else '1/s'}]"
        more += "".join(
            f", start {c}.omega = {self.u(0.5 * float(v), float(v))} [1/s]"
            for c, v in (r.split() for r in rates.split(",") if r)
        )
        self.block.append(f"{kind} {name} : {ends} {{ at = {written(at, 'm')}{more} }}")
        self.joints.append((name, kind))
        self.traits.add(kind)
        self.outputs += [f"{name}.{letter}" for letter in LETTERS.get(kind, ())[:2]]
        if kind not in ("weld", "free") and self.chance(0.4):
            self.outputs.append(f"{name}.reaction.{self.rng.choice(['x', 'y', 'z', 'rx', 'ry', 'rz'])}")

    def hang(self, name: str, kind: str) -> None:
        """Springs, dampers and drives on the freedoms of a joint."""
        for letter in LETTERS.get(kind, ()):
            metres, port, element = letter in "xyz", f"b.{name}.{letter}", f"{name}_{letter}"
            effort, flow, unit = ("F", "v", "N") if metres else ("M", "omega", "N*m")
            if self.chance(0.5):
                k = self.rng.parameter(2, 20, unit + ("/m" if metres else ""))
                cubic = f" + {self.rng.parameter(1, 5, unit + ('/m^3' if metres else ''))}*{'x' if metres else 'phi'}^3"
                law = f"{k}*{'x' if metres else 'phi'}{cubic if self.chance(0.4) else ''}"
                self.parts.append(
                    Part((f"C c_{element} : {effort} = {law}", f"{port} -> c_{element}"), frozenset({"spring"}))
                )
            if self.chance(0.6):
                r = self.rng.parameter(0.05, 0.5, f"{unit}*s" + ("/m" if metres else ""))
                self.parts.append(Part((f"R r_{element} : {effort} = {r}*{flow}", f"{port} -> r_{element}")))
            if self.chance(0.15):
                drive = f"{self.rng.parameter(0.2, 2, unit)}*sin(5*time/1 s)"
                self.parts.append(
                    Part((f"Se s_{element} : {effort} = {drive}", f"s_{element} -> {port}"), frozenset({"drive"}))
                )

    def reach(self, place: str, at: Any) -> None:
        """A spring to a wall, a force at a point, or one of six freedoms of a bushing."""
        tip = at + self.vector(0.4)
        self.block.append(
            f"frame tip : {place} {{ at = {written(tip, 'm')}{', axes = body' if self.chance(0.3) else ''} }}"
        )
        choice = self.rng.random()
        if choice < 0.4:
            self.block.append(f"frame wall : ground {{ at = {written(tip + self.vector(about=(0, 0, 1.2)), 'm')} }}")
            self.block.append("distance d : wall to tip")
            k = self.rng.parameter(5, 40, "N/m")
            self.parts.append(Part((f"C c_d : F = {k}*(x - 0.6 m)", "b.d -> c_d"), frozenset({"distance"})))
            self.outputs.append("d.d")
        elif choice < 0.7:
            port = self.rng.choice(["x", "y", "z", "rx", "ry", "rz"])
            law = (
                f"F = {self.rng.parameter(0.5, 3, 'N')}"
                if port in "xyz"
                else f"M = {self.rng.parameter(0.1, 1, 'N*m')}"
            )
            self.parts.append(Part((f"Se push : {law}*cos(4*time/1 s)", f"push -> b.tip.{port}"), frozenset({"force"})))
        else:
            self.joint("free", "bush", f"ground to {place}", tip)
            self.hang("bush", "free")

    def example(self) -> Example:
        moved = self.chance(0.2)
        gravity = (
            []
            if moved and any("Se " in part.lines[0] for part in self.parts)
            else [f"gravity = {written(self.vector(9), 'm/s^2')}"]
        )
        lines = ("multibody b : spatial {", *("  " + line for line in (*gravity, *self.block)), "}")
        chosen = self.rng.sample(self.outputs, min(6, len(self.outputs)))
        shown = tuple(f"output y{i} = b.{o}" for i, o in enumerate(chosen))
        whole = (Part(lines, frozenset(self.traits), True), *self.parts, Part(shown, needed=True))
        return Example(self.seed, whole, self.rng.parameters, self.u(0.3, 0.7), plain=False, units=self.rng.units)

    # ------------------------------------------------------------ mechanisms
    def tree(self) -> None:
        """Bodies on bodies, with all kinds of joints, one or two that float."""
        count, geared = self.rng.randint(1, 4), self.chance(0.3)
        places, loose = [self.vector() for _ in range(count)], set[int]()
        for i, at in enumerate(places):
            parent = self.rng.randint(-1, i - 1) if i else -1
            floats = self.chance(0.15)
            if floats or parent in loose:
                loose.add(i)
            speed = f", start x.v = {self.u(-1, 1)} [m/s], start ry.omega = {self.u(-2, 2)} [1/s]"
            self.body(f"a{i}", at, speed if floats and self.chance(0.5) else "")
            if floats:
                self.traits.add("floating")
                continue
            first, second = ("ground" if parent < 0 else f"a{parent}"), f"a{i}"
            ends = f"{first} to {second}" if self.chance(0.8) else f"{second} to {first}"
            kind = "hinge" if geared else self.rng.choice(KINDS)
            self.joint(kind, f"j{i}", ends, self.vector(0.6, at), 0.0 if geared or i in loose else 0.5)
            self.hang(f"j{i}", kind)
        if self.chance(0.6):
            self.reach(f"a{count - 1}", places[-1])
        if geared and len(self.joints) > 1:
            self.block.append(f"gear mesh : {self.joints[0][0]} to {self.joints[1][0]} {{ ratio = {self.u(0.5, 2)} }}")
            self.traits.add("gear")

    def closed(self) -> None:
        """A crank that leads a coupler to a rocker or slider: RSSR, RSUR, RSCR, RSSP and others; or a rod between two arms."""
        a, b, c, d = (self.vector(0.4, (x, y, 0)) for x, y in ((0, 0), (0.6, 0), (1.2, 0.6), (1.8, 0)))
        last = self.rng.choice(["hinge", "hinge", "slide", "cylinder"])
        eye = "universal" if last == "cylinder" or self.chance(0.7) else "ball"
        rod = self.chance(0.3)
        turns = (
            self.chance(0.5) and not rod and eye == "universal" and last != "cylinder"
        )  # all else follows from the crank
        self.body("crank", (a + b) / 2)
        self.body("rocker", (c + d) / 2)
        self.joint("hinge", "main", "ground to crank", a, rates="phi 2" if turns else "")
        self.joint(last, "end", "ground to rocker", d)
        if rod:
            self.block += [
                f"frame p : crank {{ at = {written(b, 'm')} }}",
                f"frame q : rocker {{ at = {written(c, 'm')} }}",
                "rod bar : p to q",
            ]
            self.traits.add("rod")
            self.outputs.append("bar.reaction.x")
        else:
            self.body("coupler", (b + c) / 2)
            self.joint("ball", "big", "crank to coupler", b)
            self.joint(eye, "eye", "coupler to rocker", c)
        for name, kind in (("main", "hinge"), ("end", last)):
            self.hang(name, kind)
        self.traits.add("closed")

    def bricard(self) -> None:
        """Six hinges, of which the last three are the first ones turned by half a turn about a line: it moves, though counting says that it cannot."""
        half = np.diag([-1.0, -1.0, 1.0])
        places = [self.vector(0.5, (x, y, 0)) for x, y in ((0.8, -0.6), (1.0, 0.2), (0.6, 0.9))]
        axes = [self.vector(about=(0, 0, 1)) for _ in places]
        places, axes = [*places, *(half @ p for p in places)], [*axes, *(half @ a for a in axes)]
        names = ["ground", *(f"a{i}" for i in range(5))]
        for i in range(5):
            self.body(f"a{i}", (places[i] + places[i + 1]) / 2)
        for i in range(6):
            ends = f"{names[i]} to {names[(i + 1) % 6]}"
            self.block.append(f"hinge h{i} : {ends} {{ at = {written(places[i], 'm')}, about = {written(axes[i])} }}")
            self.outputs.append(f"h{i}.phi")
        self.hang("h0", "hinge")
        self.traits |= {"closed", "redundant"}

    def gyroscope(self) -> None:
        """A rotor in rings or on its point, fast."""
        at = self.vector(0.3)
        self.body("rotor", at)
        if self.chance(0.5):
            self.joint("ball", "foot", "ground to rotor", self.vector(0.2), rates="rx -12, ry 12, rz 12")
            self.hang("foot", "ball")
        else:
            self.body("ring", at)
            self.joint("universal", "rings", "ground to ring", at, 1.0)
            self.joint("hinge", "axle", "ring to rotor", at, rates="phi 20")
            self.hang("rings", "universal")
        self.reach("rotor", at)
        self.traits.add("spinning")

    def rolling(self) -> None:
        """A ball, a disc or a skate on a plane that may be tilted, or on a plate that moves."""
        kind, radius = self.rng.choice(["ball", "disc", "skate"]), self.u(0.2, 0.5)
        plate = "ground"
        if self.chance(0.3):
            plate = "plate"
            self.body("plate", np.array([0, 0, -0.2]))
            self.joint(self.rng.choice(["slide", "hinge", "ball"]), "pivot", "ground to plate", self.vector(0.3))
        self.body("runner", np.array([0, 0, radius]))
        at = f"at = (0, 0, {radius} m)"
        level = f"({self.u(0.5, 1)}, {self.u(-1, 1)}, 0)"
        more = {
            "ball": f"{at}, radius = {radius} m",
            "disc": f"{at}, about = {level}, radius = {radius} m",
            "skate": f"at = (0.1 m, 0, 0), along = {level}",
        }
        self.block.append(f"{'skate' if kind == 'skate' else 'wheel'} contact : {plate} to runner {{ {more[kind]} }}")
        self.outputs += [f"contact.reaction.{c}" for c in "xyz"]
        self.traits |= {kind if kind != "ball" else "rolling ball"}
        port = self.rng.choice(["x", "y", "rz"])
        law = "F = 2 N" if port != "rz" else "M = 0.3 [N*m]"
        self.parts.append(Part((f"Se push : {law}*cos(3*time/1 s)", f"push -> b.runner.{port}"), frozenset({"force"})))


def written(v: Sequence[float] | np.ndarray, unit: str = "") -> str:
    """A vector in the language."""
    return f"({', '.join(map(repr, map(float, v)))})" + (f"*1 [{unit}]" if unit else "")
