"""Closed mechanisms with random dimensions, and where each of their coordinates is after some were turned from the drawing: a fine continuation of
hand-written closure equations, independent of the product."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

STEPS = 500
CLOSE = 1e-9  # of a Newton step, after which one more goes to rounding
NEAR = 0.02  # of the smallest singular value at the start: whether the path passes is left open


@dataclass(frozen=True, slots=True)
class Case:
    """Settings of a model, the starts (radians) among them, and the coordinates to be read, None where a dead centre or crossing stands between.

    `open_`: the path comes so near to a singular pose that the product may refuse it.
    """

    settings: Mapping[str, float]
    wanted: Mapping[str, float] | None
    open_: bool


def continued(residual: Callable[[Any, float], Any], count: int, steps: int = STEPS) -> tuple[Any, bool]:
    """The unknowns at share 1 of residual(x, share) = 0 from zeros at share 0; None if the path ends before; whether it is nearly singular."""

    def slopes(x: Any, share: float) -> Any:
        shifted = x[None, :] + 1e-30j * np.eye(count)
        return np.stack([residual(row, share).imag / 1e-30 for row in shifted], axis=1)

    x, before, least, first = np.zeros(count), None, np.inf, None
    for share in np.linspace(0.0, 1.0, steps + 1):
        old = x
        for _ in range(12):
            matrix = slopes(x, share)
            move, *_ = np.linalg.lstsq(matrix, -np.real(residual(x, share)), rcond=1e-9)
            x = x + move
            if np.abs(move).max() < CLOSE:
                break
        else:
            return None, True
        values = np.linalg.svd(matrix, compute_uv=False)
        weight = float(values[count - 1])
        first = weight if first is None else first
        sign = float(np.sign(np.linalg.det(matrix))) if matrix.shape[0] == count else None
        if np.abs(x - old).max() > 0.2 or (before is not None and sign != before):
            return None, True
        before, least = sign, min(least, weight / first)
    for _ in range(3):
        x = x + np.linalg.lstsq(slopes(x, 1.0), -np.real(residual(x, 1.0)), rcond=1e-9)[0]
    return x, least < NEAR


# ---------------------------------------------------------------- in the plane
@dataclass(frozen=True, slots=True)
class Planar:
    """Bars between points, hinges at points, and loops of vectors from point to point along bars."""

    bars: Mapping[str, str]  # bar -> its points, a letter each
    hinges: Mapping[str, tuple[str, str, str]]  # hinge -> first bar (or ground), second bar, point
    loops: tuple[tuple[tuple[str, str], ...], ...]  # bars with two of their points each
    led: tuple[str, ...]  # hinges to the ground with a start

    @property
    def points(self) -> str:
        """All letters."""
        return "".join(dict.fromkeys(p for points in self.bars.values() for p in points))

    def text(self, starts: str = "") -> str:
        """The model: drawn places and starts are parameters; `starts`: of rates, by hinge, as `a 3`."""
        rates = dict(item.split() for item in starts.split(",") if item)
        lines = [f"  parameter {p}x = {k} m, {p}y = {k % 3} m" for k, p in enumerate(self.points)]
        lines += [f"  parameter start_{h} = 0.0" for h in self.led]
        lines.append("  multibody e : planar {")
        for bar, points in self.bars.items():
            at = ", ".join(f"({' + '.join(p + c for p in points)})/{len(points)}" for c in "xy")
            lines.append(f"    body {bar} {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = ({at}) }}")
        for hinge, (first, second, p) in self.hinges.items():
            more = f", start phi = start_{hinge}" if hinge in self.led else ""
            more += f", start phi.omega = {rates[hinge]} [1/s]" if hinge in rates else ""
            lines.append(f"    hinge {hinge} : {first} to {second} {{ at = ({p}x, {p}y){more} }}")
        outputs = ", ".join(f"o_{h} = e.{h}.phi" for h in self.hinges)
        return "\n".join(
            [
                "model M {",
                *lines,
                "  }",
                f"  output {outputs}",
                "  experiment go { simulate 0 .. 1 us { points = 2 } }",
                "}\n",
            ]
        )

    def case(self, rng: np.random.Generator) -> Case:
        """Random places and starts of up to a turn and more."""
        places = {p: rng.uniform(-1, 1, 2) for p in self.points}
        turns = {h: float(rng.choice([0.5, 1.5, 7.0]) * rng.uniform(-1, 1)) for h in self.led}
        fixed = {self.hinges[h][1]: v for h, v in turns.items()}
        free = [b for b in self.bars if b not in fixed]

        def residual(x: Any, share: float) -> Any:
            angles = {**{b: share * v for b, v in fixed.items()}, **dict(zip(free, x, strict=True))}
            rows: list[Any] = []
            for loop in self.loops:
                vectors = [(angles[bar], places[ends[1]] - places[ends[0]]) for bar, ends in loop]
                rows.append(sum((np.cos(t) - 1) * v[0] - np.sin(t) * v[1] for t, v in vectors))
                rows.append(sum(np.sin(t) * v[0] + (np.cos(t) - 1) * v[1] for t, v in vectors))
            return np.array(rows, dtype=complex)

        x, near = continued(residual, len(free))
        settings = {f"{p}{c}": float(v) for p, place in places.items() for c, v in zip("xy", place, strict=True)}
        settings |= {f"start_{h}": v for h, v in turns.items()}
        if x is None:
            return Case(settings, None, True)
        angles = {"ground": 0.0, **fixed, **dict(zip(free, x, strict=True))}
        return Case(settings, {f"o_{h}": float(angles[b] - angles[a]) for h, (a, b, _) in self.hinges.items()}, near)


FOUR_BAR = Planar(
    {"p": "AB", "q": "BC", "s": "CD"}, {"a": ("ground", "p", "A"), "b": ("p", "q", "B"), "c": ("q", "s", "C"), "d": ("ground", "s", "D")},
    ((("p", "AB"), ("q", "BC"), ("s", "CD")),), ("a",),
)  # fmt: skip
FIVE_BAR = Planar(
    {"p": "AB", "q": "BC", "r": "CE", "s": "ED"},
    {"a": ("ground", "p", "A"), "b": ("p", "q", "B"), "c": ("q", "r", "C"), "f": ("s", "r", "E"), "d": ("ground", "s", "D")},
    ((("p", "AB"), ("q", "BC"), ("r", "CE"), ("s", "ED")),), ("a", "d"),
)  # fmt: skip
STEPHENSON = Planar(
    {"p": "AB", "q": "BCP", "s": "CD", "u": "PQ", "w": "QF"},
    {
        "a": ("ground", "p", "A"), "b": ("p", "q", "B"), "c": ("q", "s", "C"), "d": ("ground", "s", "D"),
        "g": ("q", "u", "P"), "h": ("u", "w", "Q"), "f": ("ground", "w", "F"),
    },
    ((("p", "AB"), ("q", "BC"), ("s", "CD")), (("p", "AB"), ("q", "BP"), ("u", "PQ"), ("w", "QF"))), ("a",),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class SliderCrank:
    """A crank in the origin, a rod, and a piston along x that is off by some distance; in closed form."""

    def text(self, starts: str = "") -> str:
        """The model; `starts`: a rate of the crank, as `a 3`."""
        rate = f", start phi.omega = {starts.split()[1]} [1/s]" if starts else ""
        return (
            "model M {\n  parameter r = 50 mm, l = 150 mm, th = 0.7, start_a = 0.1, off = 0 mm, side = 1\n  multibody e : planar {\n"
            "    constant c = r*cos(th), s = r*sin(th), xe = c + side*sqrt(l^2 - (s - off)^2)\n"
            "    body crank { mass = 2 kg, inertia = 5e-3 [kg*m^2], at = (0, 0) }\n"
            "    body rod { mass = 0.5 kg, inertia = 1e-3 [kg*m^2], at = ((c + xe)/2, (s + off)/2) }\n    body piston { mass = 0.4 kg, at = (xe, off) }\n"
            f"    hinge a : ground to crank {{ at = (0, 0), start phi = start_a{rate} }}\n    hinge pin : crank to rod {{ at = (c, s) }}\n"
            "    hinge wrist : rod to piston { at = (xe, off) }\n    slide bore : ground to piston { along = 0 }\n  }\n"
            "  output o_a = e.a.phi, o_x = e.piston.x, o_wrist = e.wrist.phi\n  experiment go { simulate 0 .. 1 us { points = 2 } }\n}\n"
        )

    def case(self, rng: np.random.Generator) -> Case:
        """Random lengths, sides and turns."""
        r = float(rng.uniform(0.02, 0.1))
        l, off, side = r * float(rng.uniform(0.5, 4)), r * float(rng.uniform(-0.5, 0.5)), float(rng.choice([-1, 1]))
        th = float(rng.uniform(-np.pi, np.pi))
        while abs(r * np.sin(th) - off) > 0.98 * l:
            th = float(rng.uniform(-np.pi, np.pi))
        d = float(rng.uniform(-8, 8))
        settings = {"r": r, "l": l, "th": th, "start_a": d, "off": off, "side": side}
        heights = (
            off - r * np.sin(th + np.linspace(0, d, 4001))
        ) / l  # sine of the rod's angle, from the piston's side
        if np.abs(heights).max() >= 1:
            return Case(settings, None, True)
        leans = side * np.arcsin(heights)
        x = r * np.cos(th + d) + side * l * np.cos(leans[-1])
        # The wrist's angle is that of the piston, which does not turn, less that of the rod.
        return Case(
            settings, {"o_a": d, "o_x": x, "o_wrist": float(leans[0] - leans[-1])}, bool(np.abs(heights).max() > 0.9999)
        )


# ---------------------------------------------------------------- in space
def turned(axis: Any, angle: Any, vector: Any) -> Any:
    """A vector turned about an axis (Rodrigues)."""
    a = axis / np.linalg.norm(axis)
    return vector * np.cos(angle) + np.cross(a, vector) * np.sin(angle) + a * (a @ vector) * (1 - np.cos(angle))


@dataclass(frozen=True, slots=True)
class Rssr:
    """Two cranks about axes in space and a rod between two balls."""

    def text(self, starts: str = "") -> str:
        """The model; `starts`: a rate of the first crank, as `a 3`."""
        rate = f", start phi.omega = {starts.split()[1]} [1/s]" if starts else ""
        parameters = ", ".join(f"{p}{c} = {k + 1} m" for k, p in enumerate("BCD") for c in "xyz")
        return (
            f"model M {{\n  parameter {parameters}, ex = 1.0, ey = 2.0, ez = 1.0, start_a = 0.1\n  multibody e : spatial {{\n"
            "    body p { mass = 1 kg, inertia = 0.1 [kg*m^2]*(1, 1, 1), at = (Bx, By, Bz)/2 }\n"
            "    body q { mass = 1 kg, inertia = 0.1 [kg*m^2]*(1, 1, 1), at = (Bx + Cx, By + Cy, Bz + Cz)/2 }\n"
            "    body s { mass = 1 kg, inertia = 0.1 [kg*m^2]*(1, 1, 1), at = (Dx + Cx, Dy + Cy, Dz + Cz)/2 }\n"
            f"    hinge a : ground to p {{ at = (0, 0, 0), about = (0, 0, 1), start phi = start_a{rate} }}\n"
            "    ball b : p to q { at = (Bx, By, Bz) }\n    ball c : q to s { at = (Cx, Cy, Cz) }\n"
            "    hinge d : ground to s { at = (Dx, Dy, Dz), about = (ex, ey, ez) }\n  }\n"
            "  output o_a = e.a.phi, o_d = e.d.phi\n  experiment go { simulate 0 .. 1 us { points = 2 } }\n}\n"
        )

    def case(self, rng: np.random.Generator) -> Case:
        """Random places, axes and turns."""
        b, c, d, axis = (rng.uniform(-1, 1, 3) for _ in range(4))
        turn = float(rng.choice([0.5, 1.5, 7.0]) * rng.uniform(-1, 1))
        rod = (c - b) @ (c - b)

        def residual(x: Any, share: float) -> Any:
            gap = d + turned(axis, x[0], c - d) - turned(np.array([0.0, 0.0, 1.0]), share * turn, b)
            return np.array([gap @ gap - rod])

        x, near = continued(residual, 1)
        settings = {
            f"{p}{k}": float(v)
            for p, place in zip("BCDe", (b, c, d, axis), strict=True)
            for k, v in zip("xyz", place, strict=True)
        }
        return Case({**settings, "start_a": turn}, None if x is None else {"o_a": turn, "o_d": float(x[0])}, near)


@dataclass(frozen=True, slots=True)
class Bricard:
    """Six hinges in a ring, three lines and the same turned by half a turn about z: it moves though it is overconstrained (Bricard, 1897)."""

    def text(self, starts: str = "") -> str:
        """The model; `starts`: a rate of the first hinge, as `h1 3`."""
        rate = f", start phi.omega = {starts.split()[1]} [1/s]" if starts else ""
        lines = [
            f"  parameter p{i}{c} = {i + k} m, n{i}{c} = {1 + (i + k) % 3}.0"
            for i in (1, 2, 3)
            for k, c in enumerate("xyz")
        ]
        lines += ["  parameter start_h1 = 0.1", "  multibody e : spatial {"]
        bodies = ["ground", *(f"b{i}" for i in range(1, 6)), "ground"]
        for i in range(1, 6):
            lines.append(f"    body b{i} {{ mass = 1 kg, inertia = 0.1 [kg*m^2]*(1, 1, 1), at = (0.{i} m, 0, 0) }}")
        for i in range(1, 7):
            k, sign = (i, "") if i < 4 else (i - 3, "-")
            more = f", start phi = start_h1{rate}" if i == 1 else ""
            at, about = (f"({sign}{v}{k}x, {sign}{v}{k}y, {v}{k}z)" for v in "pn")
            lines.append(f"    hinge h{i} : {bodies[i - 1]} to {bodies[i]} {{ at = {at}, about = {about}{more} }}")
        outputs = ", ".join(f"o_h{i} = e.h{i}.phi" for i in range(1, 7))
        return "\n".join(
            [
                "model M {",
                *lines,
                "  }",
                f"  output {outputs}",
                "  experiment go { simulate 0 .. 1 us { points = 2 } }",
                "}\n",
            ]
        )

    def case(self, rng: np.random.Generator) -> Case:
        """Random lines, and turns of the first hinge."""
        places, axes = rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, (3, 3))
        half = np.array([-1.0, -1.0, 1.0])
        lines = [*zip(places, axes, strict=True), *zip(places * half, axes * half, strict=True)]
        turn = float(rng.choice([0.3, 1.0, 7.0]) * rng.uniform(-1, 1))
        marks = np.eye(3)

        def residual(x: Any, share: float) -> Any:
            """Where three marks are after all six turns, less where they were."""
            angles = [share * turn, *x]
            rows: list[Any] = []
            for mark in marks:
                point: Any = mark
                for (at, axis), angle in reversed(list(zip(lines, angles, strict=True))):
                    point = at + turned(axis, angle, point - at)
                rows.append(point - mark)
            return np.concatenate(rows)

        x, near = continued(residual, 5, STEPS // 2)
        settings = {
            f"{w}{i + 1}{c}": float(v)
            for w, rows in (("p", places), ("n", axes))
            for i, row in enumerate(rows)
            for c, v in zip("xyz", row, strict=True)
        }
        wanted = None if x is None else {f"o_h{i + 1}": float(v) for i, v in enumerate([turn, *x])}
        return Case({**settings, "start_h1": turn}, wanted, near)


Linkage = Planar | SliderCrank | Rssr | Bricard
LINKAGES: Mapping[str, Linkage] = {
    "slider-crank": SliderCrank(), "four-bar": FOUR_BAR, "five-bar": FIVE_BAR, "Stephenson": STEPHENSON, "RSSR": Rssr(), "Bricard": Bricard(),
}  # fmt: skip
