"""Random trees with all kinds of joints: drawn for the compiler, and as poses for the oracle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.multibody.drawing import Drawing
from tests.multibody.newton_euler import Oracle, Pose, of_quaternion, turn

KINDS = ("hinge", "slide", "screw", "cylinder", "planar", "universal", "ball", "weld", "float")
LETTERS = {
    "hinge": ("phi",), "slide": ("x",), "screw": ("phi",), "cylinder": ("x", "phi"), "planar": ("x", "y", "phi"),
    "universal": ("phi1", "phi2"), "ball": (), "weld": (), "float": (),
}  # fmt: skip


def rotation(v: Any) -> Any:
    """Of a rotation vector, which may be complex and near zero."""
    v = np.asarray(v)
    square = v @ v
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    if abs(square) < 1e-12:
        return np.eye(3) + k + k @ k / 2 - square / 6 * k
    a = np.sqrt(square)
    return np.eye(3) + np.sin(a) / a * k + (1 - np.cos(a)) / square * (k @ k)


@dataclass
class Part:
    """One body and its joint."""

    kind: str
    parent: int  # -1: ground
    at: Any
    axis: Any
    other: Any
    turned: Any
    reverse: bool
    lead: float
    first: int  # number of its first coordinate
    count: int


@dataclass
class RandomTree:
    """`count` bodies; `coordinates`: those that are tests' numbers (turns in space by a small rotation vector)."""

    count: int
    seed: int
    kinds: tuple[str, ...] = KINDS
    straight: bool = False  # axes along the world's
    parts: list[Part] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = random = np.random.default_rng(self.seed)
        self.centres = random.uniform(-1, 1, (self.count, 3))
        self.masses = random.uniform(0.5, 2, self.count)
        self.turned = random.uniform(-1, 1, (self.count, 3))
        self.gravity = random.uniform(-10, 10, 3)
        self.tensors = []
        self.coordinates = 0
        self.attitudes: dict[int, Any] = {}
        for i in range(self.count):
            kind = str(random.choice(self.kinds))
            parent = int(random.integers(-1, i)) if i else -1
            if kind == "float":
                parent = -1
            count = len(LETTERS[kind]) or {"ball": 3, "float": 6, "weld": 0}[kind]
            way, other = self._axis(), self._axis()
            if kind == "universal":
                other = np.cross(way, other + np.array([0.3, 0.5, 0.7]))
            at = random.uniform(-1, 1, 3)
            # what floats is the second body of no joint
            reverse = (
                bool(random.integers(2))
                and kind != "float"
                and not (parent >= 0 and self.parts[parent].kind == "float")
            )
            part = Part(kind, parent, at, way, other, random.uniform(-1, 1, 3), reverse, random.uniform(0.1, 1), self.coordinates, count)  # fmt: skip
            self.parts.append(part)
            self.coordinates += count
            if kind in ("ball", "float"):
                p = random.standard_normal(4)
                self.attitudes[i] = p / np.linalg.norm(p)
            roots = random.uniform(-1, 1, (3, 3))
            self.tensors.append(roots @ roots.T + 0.1 * np.eye(3))

    def _axis(self) -> Any:
        if self.straight or self.random.integers(2):
            return np.eye(3)[self.random.integers(3)] * self.random.choice([-1.0, 1.0])
        return self.random.uniform(-1, 1, 3)

    # ------------------------------------------------------------ for the compiler
    def drawing(self) -> Drawing:
        drawn = Drawing(gravity=self.gravity.tolist())
        for i, part in enumerate(self.parts):
            own = rotation(self.turned[i])
            t = own.T @ self.tensors[i] @ own  # in the body's own axes, which are turned
            six = [t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2]]
            drawn.body(f"b{i}", self.masses[i], six, self.centres[i].tolist(), self.turned[i].tolist())
            if part.kind == "float":
                continue
            ends = ["ground" if part.parent < 0 else f"b{part.parent}", f"b{i}"]
            drawn.joint(
                f"j{i}", part.kind, *(ends[::-1] if part.reverse else ends), part.at.tolist(), part.axis.tolist(),
                part.turned.tolist(), part.other.tolist(), ratio=part.lead,
            )  # fmt: skip
        return drawn

    def names(self) -> list[tuple[str, str]]:
        """Of each coordinate: its state (or the state of its turn's quaternion) and its rate's."""
        found: list[tuple[str, str]] = []
        for i, part in enumerate(self.parts):
            if part.kind in ("ball", "float"):
                owner = f"m.b{i}" if part.kind == "float" else f"m.j{i}"
                if part.kind == "float":
                    found += [(f"{owner}.{c}", f"{owner}.{c}.v") for c in "xyz"]
                found += [(f"{owner}.attitude", f"{owner}.spin.{c}") for c in "xyz"]
            else:
                found += [(f"m.j{i}.{c}", f"m.j{i}.{c}.{'omega' if c.startswith('phi') else 'v'}") for c in LETTERS[part.kind]]  # fmt: skip
        return found

    def ports(self) -> list[str]:
        """The scalar coordinates of joints."""
        return [f"j{i}.{c}" for i, part in enumerate(self.parts) for c in LETTERS[part.kind]]

    def state(self, q: Any, rates: Any, length: float = 1.0) -> dict[str, float]:
        """States by name; quaternions as long as wanted."""
        values: dict[str, float] = {}
        for (name, rate), x, v in zip(self.names(), q, rates, strict=True):
            if not name.endswith(".attitude"):
                values[name] = float(x)
            values[rate] = float(v)
        for i, p in self.attitudes.items():
            owner = f"m.b{i}" if self.parts[i].kind == "float" else f"m.j{i}"
            values |= {f"{owner}.attitude.{c}": float(length * x) for c, x in zip("wxyz", p, strict=True)}
        return values

    def sample(self) -> tuple[Any, Any]:
        """Random coordinates (those of turns in space are zero: they count from the quaternion) and rates."""
        q = self.random.uniform(-2, 2, self.coordinates)
        for i in self.attitudes:
            part = self.parts[i]
            q[part.first + part.count - 3 : part.first + part.count] = 0.0
        return q, self.random.uniform(-2, 2, self.coordinates)

    # ------------------------------------------------------------ for the oracle
    def poses(self, q: Any) -> list[Pose]:
        placed: list[tuple[Any, Any]] = []  # a point P of the drawing is at d + R P
        result = []
        for i, part in enumerate(self.parts):
            d, r = self._relative(part, i, q[part.first : part.first + part.count])
            if part.reverse and part.kind != "ball":
                d, r = -r.T @ d, r.T
            if part.parent >= 0:
                d0, r0 = placed[part.parent]
                d, r = d0 + r0 @ d, r0 @ r
            placed.append((d, r))
            result.append((d + r @ self.centres[i], r))
        return result

    def _relative(self, part: Part, i: int, q: Any) -> tuple[Any, Any]:
        axis = part.axis / np.linalg.norm(part.axis)
        match part.kind:
            case "slide":
                return axis * q[0], np.eye(3)
            case "hinge" | "screw":
                r = turn(axis, q[0])
                along = axis * q[0] * part.lead / (2 * np.pi) if part.kind == "screw" else 0
                return part.at - r @ part.at + along, r
            case "cylinder":
                r = turn(axis, q[1])
                return part.at - r @ part.at + axis * q[0], r
            case "planar":
                own = rotation(part.turned)
                r = turn(own[:, 2], q[2])
                return part.at - r @ part.at + own[:, 0] * q[0] + own[:, 1] * q[1], r
            case "universal":
                r = turn(axis, q[0]) @ turn(part.other, q[1])
                return part.at - r @ part.at, r
            case "ball":
                r = of_quaternion(self.attitudes[i]) @ rotation(q)
                return part.at - r @ part.at, r
            case "float":
                r = of_quaternion(self.attitudes[i]) @ rotation(q[3:])
                return q[:3] - r @ self.centres[i], r
        return np.zeros(3), np.eye(3)

    def oracle(self) -> Oracle:
        return Oracle(self.poses, self.masses, self.tensors, self.gravity)
