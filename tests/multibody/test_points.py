"""Bodies with mass and without inertia: what nothing turns needs none. Against points and rods by hand, a dense system with multipliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from compiler.errors import CompilationFailed

GRAVITY = np.array([0.4, -9.81, 0.7])
END = 0.3


@dataclass(frozen=True, slots=True)
class Points:
    """Points in the plane or in space, their mass matrix, and pairs at a fixed distance; those numbered below zero are at rest on the ground."""

    at: Any  # shape (points, 2 or 3)
    masses: Any  # shape (points, points)
    ground: Any
    pairs: Sequence[tuple[int, int]]

    def end(self, time: float = END) -> Any:
        """Their places after a while from rest: [M J'; J 0] with the second derivative of each squared distance."""
        count, size = self.at.shape
        mass = np.kron(self.masses, np.eye(size))
        load = np.kron(self.masses.sum(axis=1), GRAVITY[:size])

        def rate(_: float, y: Any) -> Any:
            x, v = (y[i * count * size : (i + 1) * count * size].reshape(count, size) for i in range(2))
            rows, bias = np.zeros((len(self.pairs), count, size)), np.zeros(len(self.pairs))
            for row, (i, j) in enumerate(self.pairs):
                apart = x[i] - (x[j] if j >= 0 else self.ground[-1 - j])
                rows[row, i] = apart
                moves = v[i] - (v[j] if j >= 0 else 0.0)
                if j >= 0:
                    rows[row, j] = -apart
                bias[row] = -moves @ moves
            slopes = rows.reshape(len(self.pairs), -1)
            whole = np.block([[mass, slopes.T], [slopes, np.zeros((len(self.pairs),) * 2)]])
            return np.concatenate([v.ravel(), np.linalg.solve(whole, np.concatenate([load, bias]))[: count * size]])

        begin = np.concatenate([self.at.ravel(), np.zeros(count * size)])
        return solve_ivp(rate, (0, time), begin, "DOP853", rtol=1e-11, atol=1e-12).y[: count * size, -1].reshape(count, size)  # fmt: skip


def place(p: Any) -> str:
    return "(" + ", ".join(f"{float(x)!r} m" for x in p) + ")"


def model(parts: Sequence[str], outputs: Sequence[str], size: int, head: str = "") -> str:
    """A mechanism with some parts."""
    gravity = ", ".join(f"{g} [m/s^2]" for g in GRAVITY[:size])
    kind = "planar" if size == 2 else "spatial"
    lines = "\n    ".join([f"gravity = ({gravity})", *parts])
    return f"model M {{\n  {head}\n  multibody m : {kind} {{\n    {lines}\n  }}\n  output {', '.join(outputs)}\n  experiment go {{ simulate 0 .. {END} s {{ points = 2 }} }}\n}}\n"


def ends(text: str, **settings: float) -> Any:
    """The outputs at the end of a run; the energy is balanced, and the analyses take the model, too."""
    made = bondgraph.load(text)
    found = made.simulate("go", settings, rtol=1e-8, energy=True, target="numpy")
    assert found.energy is not None and abs(found.energy.residual) < 1e-5
    assert made.certificate is not None
    return found.values[-1]


def read(body: str, size: int) -> list[str]:
    return [f"{body}_{c} = m.{body}.{c}" for c in "xyz"[:size]]


@pytest.mark.few(4)
@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_points_on_rods(seed: int, size: int) -> None:
    """One to three masses, each tied to the ground or to masses before by fewer rods than would hold it; one floats."""
    rng = np.random.default_rng(seed)
    count = 1 + seed % 3
    at, ground, masses = (rng.uniform(-1, 1, (n, size)) for n in (count, 3, count))
    weights = [1 + abs(float(x)) for x in masses[:, 0]]
    parts = [f"body b{i} {{ mass = {weights[i]!r} kg, at = {place(at[i])} }}" for i in range(count)]
    parts += [f"frame g{k} : ground {{ at = {place(g)} }}" for k, g in enumerate(ground)]
    pairs = []
    for i in range(count):
        others = [-1, -2, -3, *range(i)]
        for j in rng.choice(others, size=int(rng.integers(0 if seed == 4 else 1, size)), replace=False):
            pairs.append((i, int(j)))
            parts.append(f"rod r{len(pairs)} : b{i} to {f'b{j}' if j >= 0 else f'g{-1 - j}'}")
    found = ends(model(parts, [o for i in range(count) for o in read(f"b{i}", size)], size))
    truth = Points(at, np.diag(weights), ground, pairs).end()
    np.testing.assert_allclose(found.reshape(count, size), truth, atol=2e-7)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("bars", [1, 2])
def test_a_mass_that_rods_hold_beside_it(bars: int, size: int) -> None:
    """In the plane the turn of a point with arms follows from the rods at their ends; in space they leave a turn that moves nothing."""
    at = np.array([[1.0, 0, 0.2], [1.2, 0.3, 0.1], [0.8, 0.3, 0.3]])[: 1 + bars, :size]
    ground = np.array([[0.1, 0.2, 0.0], [1.4, 1.0, 0.3]])[:, :size]
    pairs = [(0, 1), (0, 2), (1, 2)][: 2 * bars - 1] + [(1, -1), (2, -2)][:bars]
    parts = [f"body a {{ mass = 2 kg, at = {place(at[0])} }}"]
    parts += [f"frame e{k} : a {{ at = {place(at[k])} }}\nframe g{k} : ground {{ at = {place(ground[k - 1])} }}\nrod r{k} : g{k} to e{k}" for k in range(1, bars + 1)]  # fmt: skip
    if size == 3:  # five freedoms or four, and a point has three, on a rod two
        with pytest.raises(CompilationFailed, match=r"BG202: Nothing with inertia moves along `a\.r[xyz]`"):
            ends(model(parts, read("a", size), size))
        return
    truth = Points(at, np.diag([2.0, 0.0, 0.0][: 1 + bars]), ground, pairs).end()
    np.testing.assert_allclose(ends(model(parts, read("a", size), size)), truth[0], atol=2e-7)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.1])
def test_a_thin_bar_that_hangs_at_its_ends(turn: float) -> None:
    """No inertia about itself, in axes that are turned; by hand two ends and the middle between them."""
    along = np.array([np.cos(turn), 0, -np.sin(turn)])
    at = np.stack([-0.5 * along, 0.5 * along]) + np.array([0, 0, 1.0])
    ground = np.array([[-0.6, 0.2, 2.0], [0.7, 0.1, 2.1]])
    parts = [
        f"body a {{ mass = 1 kg, inertia = (0, 0.1 [kg*m^2], 0.1 [kg*m^2]), turn = (0, {turn!r}, 0), at = (0, 0, 1 m) }}",
        f"frame e : a {{ at = {place(at[0])} }}", f"frame f : a {{ at = {place(at[1])} }}",
        f"frame g : ground {{ at = {place(ground[0])} }}", f"frame h : ground {{ at = {place(ground[1])} }}",
        "rod r1 : g to e", "rod r2 : h to f",
    ]  # fmt: skip
    masses = np.array([[0.35, 0.15], [0.15, 0.35]])  # 0.2 kg in each end, 0.6 kg in the middle
    truth = Points(at, masses, ground, [(0, -1), (1, -2), (0, 1)]).end()
    np.testing.assert_allclose(ends(model(parts, read("a", 3), 3)), truth.mean(axis=0), atol=2e-7)


@pytest.mark.parametrize("joint", ["hinge", "ball", "space"])
@pytest.mark.parametrize("mass", [0.2, 5.0])
def test_a_point_on_a_joint_through_its_centre(joint: str, mass: float) -> None:
    """A bob at the tip of an arm: phi'' = -g (m l/2 + mass l) cos(phi - lean)/(J + m l^2/4 + mass l^2), whatever joint holds it."""
    size, axis = (2, "") if joint == "hinge" else (3, ", about = (0, 0, 1)")
    zero = "" if size == 2 else ", 0"
    inertia = "0.1 [kg*m^2]" if size == 2 else "0.1 [kg*m^2]*(1, 1, 1)"
    tie = f"ball p : arm to bob {{ at = (1 m, 0{zero}) }}" if joint == "ball" else f"hinge p : arm to bob {{ at = (1 m, 0{zero}){axis} }}"  # fmt: skip
    parts = [
        f"body arm {{ mass = 1 kg, inertia = {inertia}, at = (0.5 m, 0{zero}) }}", f"body bob {{ mass = {mass} kg, at = (1 m, 0{zero}) }}",
        f"hinge h : ground to arm {{ at = (0, 0{zero}){axis} }}", tie,
    ]  # fmt: skip
    inertial, moment = 0.1 + 0.25 + mass, 0.5 + mass

    def rate(_: float, y: Any) -> list[float]:
        return [y[1], moment / inertial * (GRAVITY[1] * np.cos(y[0]) - GRAVITY[0] * np.sin(y[0]))]

    phi = solve_ivp(rate, (0, END), [0, 0], "DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
    found = ends(model(parts, read("bob", 2), size))
    np.testing.assert_allclose(found, [np.cos(phi), np.sin(phi)], atol=2e-7)


def test_a_point_between_two_bars_of_a_loop() -> None:
    """A four-bar with a mass of its own in a pin, which is a link then: as if the mass were the crank's."""
    bars = [
        "body s { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.2 m, 0.6 m) }", "body q { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.6 m, 1.1 m) }",
        "hinge d : ground to s { at = (1.2 m, 0) }", "hinge c : q to s { at = (1.2 m, 1.2 m) }", "hinge a : ground to p { at = (0, 0), start phi.omega = 2 [1/s] }",
    ]  # fmt: skip
    apart = ["body p { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0, 0.5 m) }", "body o { mass = 2 kg, at = (0, 1 m) }", *bars, "hinge b : p to o { at = (0, 1 m) }", "hinge e : o to q { at = (0, 1 m) }"]  # fmt: skip
    merged = [f"body p {{ mass = 3 kg, inertia = {0.1 + 0.25 * 2 / 3!r} [kg*m^2], at = (0, {2.5 / 3!r} m) }}", *bars, "hinge b : p to q { at = (0, 1 m) }"]  # fmt: skip
    first, second = (ends(model(parts, read("s", 2), 2)) for parts in (apart, merged))
    np.testing.assert_allclose(first, second, atol=2e-8)


def test_a_point_keeps_its_spin() -> None:
    """As a body does with ever less inertia; its swing knows nothing of it, and neither does its energy."""
    parts = ["body a {{ mass = 1 kg, at = (1 m, 0, 0){} }}", "frame o : ground {{ at = (0, 0, 0) }}", "rod r : o to a"]
    texts = [model([p.format(spin) for p in parts], read("a", 3), 3) for spin in ("", ", start rx.omega = 3 [1/s], start rz.omega = -7 [1/s]")]  # fmt: skip
    np.testing.assert_allclose(ends(texts[0]), ends(texts[1]), atol=2e-7)


@pytest.mark.parametrize("inertia", [0.0, 0.2], ids=["a point", "a thin bar"])
def test_a_mass_at_the_end_of_a_ball_joint(inertia: float) -> None:
    """A spherical pendulum, with any spin about itself: by hand the unit vector q along it."""
    pull = GRAVITY / (2.0 + inertia / 2)  # (J + m l^2)/(m l)

    def rates(_: float, y: Any) -> Any:
        q, v = y[:3], y[3:]
        return np.concatenate([v, pull - (pull @ q + v @ v) * q])

    exact = 2 * solve_ivp(rates, (0, END), [1, 0, 0, 0, 1.5, 0], "DOP853", rtol=1e-11, atol=1e-12).y[:3, -1]
    for spin in (0, 40):
        parts = [
            f"body a {{ mass = 1 kg, inertia = {inertia} [kg*m^2]*(0, 1, 1), at = (2 m, 0, 0) }}",
            f"ball h : ground to a {{ at = (0, 0, 0), start rz.omega = 1.5 [1/s], start rx.omega = {spin} [1/s] }}",
        ]
        np.testing.assert_allclose(ends(model(parts, read("a", 3), 3)), exact, atol=2e-7)


# ---------------------------------------------------------------- what is singular
TWISTED = "body a { mass = 1 kg, at = (1 m, 0) }"
LOST = {
    "a torque on a point": (2, ["{a}", "frame o : ground {{ at = (0, 0) }}", "rod r : o to a"], "Se M : M = 1 [N*m]\n  M -> m.a.phi", r"a\.phi"),
    "a spring on its hinge": (2, ["{a}", "hinge h : ground to a {{ at = (1 m, 0) }}"], "C k : M = 1 [N*m]*phi\n  m.h -> k", r"h\.phi"),
    "friction on its hinge": (2, ["{a}", "hinge h : ground to a {{ at = (1 m, 0) }}"], "R k : M = 1 [N*m*s]*omega\n  m.h -> k", r"h\.phi"),
    "a torque on the ball beside it": (3, ["{b}", "ball h : ground to b {{ at = (0, 0, 0) }}"], "Se M : M = 1 [N*m]\n  M -> m.h.rx", r"h\.r[xyz]"),
    "a gear on its hinge": (2, ["{a}", "body c {{ mass = 1 kg, at = (3 m, 0) }}", "hinge h : ground to a {{ at = (1 m, 0) }}", "hinge k : ground to c {{ at = (3 m, 0) }}", "gear g : h to k {{ ratio = 2 }}"], "", r"[hk]\.phi"),
    "no mass either": (2, ["body a {{ at = (1 m, 0) }}", "hinge h : ground to a {{ at = (1 m, 0) }}"], "", r"h\.phi"),
}  # fmt: skip


@pytest.mark.parametrize("name", LOST)
def test_what_turns_a_point_is_refused(name: str) -> None:
    """By the coordinate and the body, with advice that works."""
    size, parts, bonds, coordinate = LOST[name]
    zero = "" if size == 2 else ", 0"
    inertia = "0.1 [kg*m^2]" if size == 2 else "0.1 [kg*m^2]*(1, 1, 1)"

    def text(more: str) -> str:
        bodies = {c: f"body {c} {{ mass = 1 kg{more}, at = (1 m, 0{zero}) }}" for c in "ab"}
        lines = [p.format(**bodies) for p in parts]
        if more:
            lines = [p if "inertia" in p else p.replace("kg, at = (3", f"kg, inertia = {inertia}, at = (3").replace("body a { at", f"body a {{ mass = 1 kg, inertia = {inertia}, at") for p in lines]  # fmt: skip
        body = "b" if "{b}" in parts else "a"
        return model(lines, read(body, size), size).replace("  output", f"  {bonds}\n  output")

    with pytest.raises(CompilationFailed, match=f"BG202: Nothing with inertia moves along `{coordinate}`") as failed:
        ends(text(""))
    assert any(f"Give the body `{b}` inertia" in str(failed.value) for b in "abc")
    bondgraph.load(text(f", inertia = {inertia}")).simulate("go", target="numpy")


@pytest.mark.parametrize("drawn", [0.0, 0.2])
@pytest.mark.parametrize("off", [0.0, 0.2])
def test_a_rod_that_a_setting_puts_beside_the_mass(off: float, drawn: float) -> None:
    """At the mass nothing turns it, beside it the rod does: then the rod holds nothing, and the mass falls."""
    parts = ["body a { mass = 1 kg, at = (1 m, 0) }", "frame e : a { at = (1 m + off, 0.3*off) }", "frame o : ground { at = (0, 0.5 m) }", "rod r : o to e"]  # fmt: skip
    made = bondgraph.load(model(parts, read("a", 2), 2, f"parameter off = {drawn} m"))
    found = made.simulate("go", {"off": off}, to=0.1, rtol=1e-8, target="numpy").values[-1]
    on_it = Points(np.array([[1.0, 0]]), np.eye(1), np.array([[0, 0.5]]), [(0, -1)]).end(0.1)[0]
    np.testing.assert_allclose(found, on_it if off == 0 else [1.002, -0.04905], atol=2e-7)


@pytest.mark.parametrize("read_at", ["p", "a"])
def test_what_nothing_reads_is_refused_as_well(read_at: str) -> None:
    """A run without energies, one with, and the certificate tell the same."""
    parts = ["body p { mass = 1 kg, inertia = 1 [kg*m^2], at = (9 m, 9 m) }", "body a { mass = 1 kg, at = (1 m, 0) }", "frame o : ground { at = (0, 0) }", "frame e : a { at = (1.2 m, 0) }", "rod r : o to e"]  # fmt: skip
    made = bondgraph.load(model(parts, read(read_at, 2), 2))
    for tried in (
        lambda: made.simulate("go", target="numpy"),
        lambda: made.simulate("go", energy=True, target="numpy"),
        lambda: made.certificate,
    ):
        with pytest.raises(CompilationFailed, match=r"BG202: Nothing with inertia moves along `a\.phi`"):
            tried()
    fine = bondgraph.load(model([p.replace("1.2 m, 0", "1.2 m, 0.3 m") for p in parts], read(read_at, 2), 2))
    assert fine.certificate is not None
    fine.simulate("go", to=0.05, target="numpy")
