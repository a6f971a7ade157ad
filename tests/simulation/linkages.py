"""Closed mechanisms with random dimensions, and where each of their coordinates is after some were turned from the drawing: closed forms along the
whole path (two bars between known points; two solutions of a cos + b sin = c), for a ring of six hinges a continuation in small steps by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

SAMPLES = 20_001  # along a path
QUICK = 0.5  # radians between two samples: whole turns are not counted surely
NEAR = 1e-5  # of 1 - |cosine| of the angle that vanishes at a dead centre: whether the path passes is left open
LONGEST, SHORTEST = 0.02, 1e-10  # steps by hand: radians, share of the path
BEND = 0.02  # of a step: what the first correction may be
WEAK = 0.01  # of the smallest singular value at the start: whether the path passes is left open


@dataclass(frozen=True, slots=True)
class Case:
    """Settings of a model, with the starts (radians), and the expected coordinates; None beyond a dead centre or crossing.

    `open_`: the path comes so near to a singular pose that the product may refuse it.
    """

    settings: Mapping[str, float]
    wanted: Mapping[str, float] | None
    open_: bool


def angle(cosine: Any) -> tuple[Any, float]:
    """The angle between 0 and pi along a path, and the least distance of its cosine from a dead centre, negative beyond one."""
    margin = float(np.min(1.0 - np.abs(cosine)))
    return np.arccos(np.clip(cosine, -1.0, 1.0)), margin


def wound(angles: Any) -> tuple[float, bool]:
    """The change of an angle along a path, with its whole turns; whether these are counted surely."""
    moves = (np.diff(angles) + np.pi) % (2 * np.pi) - np.pi
    return float(moves.sum()), bool(np.abs(moves).max() < QUICK)


def continued(residual: Callable[[Any, Any], Any], count: int) -> tuple[Any, bool]:
    """The unknowns at share 1 of residual(x, share) = 0 from zeros at share 0; None if the path turns back before; whether it is nearly singular.

    `residual` takes many rows of unknowns and shares at once; its slopes are by complex steps.
    """
    shifts = 1e-30j * np.eye(count + 1)

    def at(x: Any, share: float) -> tuple[Any, Any, Any]:
        """Values, slopes by the unknowns, slopes by the share."""
        rows = residual(x + shifts[:, :count], share + shifts[:, count])
        slopes = rows.imag.T / 1e-30
        return rows[0].real, slopes[:, :count], slopes[:, count]

    def solved(slopes: Any, value: Any) -> Any:
        return np.linalg.lstsq(slopes, value, rcond=1e-11)[0]

    x, share, step = np.zeros(count), 0.0, 1e-3
    _, slopes, pull = at(x, 0.0)
    tangent, first = solved(slopes, -pull), float(np.linalg.svd(slopes, compute_uv=False)[-1])
    least = first
    while share < 1.0:
        step = min(step, 1.0 - share, LONGEST / max(float(np.abs(tangent).max()), 1.0))
        trial, moves = x + step * tangent, []
        for _ in range(6):
            value, slopes, pull = at(trial, share + step)
            moves.append(solved(slopes, -value))
            trial = trial + moves[-1]
        new = solved(slopes, -pull)
        long = step * float(np.abs(tangent).max())
        if np.abs(moves[0]).max() > BEND * long + 1e-13 or np.abs(moves[-1]).max() > 1e-12 or tangent @ new < 0:
            step /= 2
            if step < SHORTEST:
                return None, least > WEAK * first
            continue
        x, share, tangent, step = trial, share + step, new, 2 * step
        least = min(least, float(np.linalg.svd(slopes, compute_uv=False)[-1]))
    return x, least < WEAK * first


# ---------------------------------------------------------------- in the plane
@dataclass(frozen=True, slots=True)
class Planar:
    """Bars between points, hinges at points, and pairs of bars that close loops, in the order in which they follow from each other."""

    bars: Mapping[str, str]  # bar -> its points, a letter each
    hinges: Mapping[str, tuple[str, str, str]]  # hinge -> first bar (or ground), second bar, point
    pairs: tuple[
        tuple[str, str], ...
    ]  # two bars, and three points: end of the first, where they meet, end of the second
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
        settings = {f"{p}{c}": float(v) for p, place in places.items() for c, v in zip("xy", place, strict=True)}
        settings |= {f"start_{h}": v for h, v in turns.items()}
        angles, margin, sure = self.followed({p: complex(*place) for p, place in places.items()}, turns)
        if margin <= 0:
            return Case(settings, None, margin > -NEAR)
        wanted = {f"o_{h}": angles[b] - angles[a] for h, (a, b, _) in self.hinges.items()}
        return Case(settings, wanted, margin < NEAR or not sure)

    def followed(
        self, drawn: Mapping[str, complex], turns: Mapping[str, float]
    ) -> tuple[dict[str, float], float, bool]:
        """Angles of all bars at the end of the path; its margin to a dead centre; whether whole turns are counted surely."""
        share, least, sure = np.linspace(0.0, 1.0, SAMPLES), np.inf, True
        now = {p: np.full(SAMPLES, drawn[p]) for a, _, p in self.hinges.values() if a == "ground"}
        angles = {"ground": 0.0}

        def carry(bar: str, pin: str, turned: Any) -> None:
            now.update({p: now[pin] + (drawn[p] - drawn[pin]) * turned for p in self.bars[bar] if p != pin})

        for hinge, turn in turns.items():
            _, bar, pin = self.hinges[hinge]
            angles[bar] = turn
            carry(bar, pin, np.exp(1j * turn * share))
        for bars, (begin, meet, end) in self.pairs:
            first, second = drawn[meet] - drawn[begin], drawn[meet] - drawn[end]
            base = now[end] - now[begin]
            far, one, two = np.abs(base), abs(first), abs(second)
            _, margin = angle((one**2 + two**2 - far**2) / (2 * one * two))
            least = min(least, margin)
            side = np.sign((first * base[0].conjugate()).imag)
            lean = np.arccos(np.clip((one**2 + far**2 - two**2) / (2 * one * far), -1.0, 1.0))
            now[meet] = now[begin] + one * base / far * np.exp(1j * side * lean)
            for bar, pin, arm in ((bars[0], begin, first), (bars[1], end, second)):
                turned = (now[meet] - now[pin]) / arm
                angles[bar], counted = wound(np.angle(turned))
                sure &= counted
                carry(bar, pin, turned)
        return angles, least, sure


FOUR_BAR = Planar(
    {"p": "AB", "q": "BC", "s": "CD"}, {"a": ("ground", "p", "A"), "b": ("p", "q", "B"), "c": ("q", "s", "C"), "d": ("ground", "s", "D")},
    (("qs", "BCD"),), ("a",),
)  # fmt: skip
FIVE_BAR = Planar(
    {"p": "AB", "q": "BC", "r": "CE", "s": "ED"},
    {"a": ("ground", "p", "A"), "b": ("p", "q", "B"), "c": ("q", "r", "C"), "f": ("s", "r", "E"), "d": ("ground", "s", "D")},
    (("qr", "BCE"),), ("a", "d"),
)  # fmt: skip
STEPHENSON = Planar(
    {"p": "AB", "q": "BCP", "s": "CD", "u": "PQ", "w": "QF"},
    {
        "a": ("ground", "p", "A"), "b": ("p", "q", "B"), "c": ("q", "s", "C"), "d": ("ground", "s", "D"),
        "g": ("q", "u", "P"), "h": ("u", "w", "Q"), "f": ("ground", "w", "F"),
    },
    (("qs", "BCD"), ("uw", "PQF")), ("a",),
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
        # The sine of the rod's angle, from the piston's side.
        heights = (off - r * np.sin(th + np.linspace(0, d, SAMPLES))) / l
        margin = float(np.min(1.0 - np.abs(heights)))
        if margin <= 0:
            return Case(settings, None, margin > -NEAR)
        leans = side * np.arcsin(heights)
        x = r * np.cos(th + d) + side * l * np.cos(leans[-1])
        # The wrist's angle is that of the piston, which does not turn, less that of the rod.
        return Case(settings, {"o_a": d, "o_x": x, "o_wrist": float(leans[0] - leans[-1])}, margin < NEAR)


# ---------------------------------------------------------------- in space
def turn_about(axis: Any, angles: Any) -> Any:
    """The turns about an axis by some angles, shape (angles, 3, 3) (Rodrigues)."""
    cross = np.cross(np.eye(3), axis / np.linalg.norm(axis))
    turns = angles[:, None, None]
    return np.eye(3) + np.sin(turns) * cross + (1 - np.cos(turns)) * (cross @ cross)


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
        shares = turn * np.linspace(0.0, 1.0, SAMPLES)
        tip = np.stack([b[0] * np.cos(shares) - b[1] * np.sin(shares), b[0] * np.sin(shares) + b[1] * np.cos(shares), 0 * shares + b[2]], axis=1)  # fmt: skip
        about = axis / np.linalg.norm(axis)
        along = about * (about @ (c - d))
        across, beside = c - d - along, np.cross(about, c - d)
        base = d + along - tip
        even, odd = base @ across, base @ beside  # even cos(x) + odd sin(x) = level keeps the rod's length
        level = ((c - b) @ (c - b) - np.sum(base**2, axis=1) - across @ across) / 2
        lean, margin = angle(level / np.hypot(even, odd))
        middle = np.arctan2(odd, even)
        side = -np.sign(np.sin(middle[0]))
        end, sure = wound(middle + side * lean)
        settings = {
            f"{p}{k}": float(v)
            for p, place in zip("BCDe", (b, c, d, axis), strict=True)
            for k, v in zip("xyz", place, strict=True)
        }
        settings |= {"start_a": turn}
        if margin <= 0:
            return Case(settings, None, margin > -NEAR)
        return Case(settings, {"o_a": turn, "o_d": end}, margin < NEAR or not sure)


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

        def residual(x: Any, share: Any) -> Any:
            """Displacement of three marks by all six turns."""
            points: Any = marks
            for (at, axis), turns in reversed(list(zip(lines, [share * turn, *x.T], strict=True))):
                points = at + (points - at) @ turn_about(axis, turns).swapaxes(1, 2)
            return (points - marks).reshape(len(x), -1)

        x, near = continued(residual, 5)
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
