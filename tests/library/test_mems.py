"""Parts of MEMS: forces as derivatives of energies, beams, films, pull-in."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.library.bench import exact, near, run

EPS0 = 8.8541878128e-12

# ---------------------------------------------------------------------- actuators

COMBS = """
    import FoldedFlexure from mems
    input volt = 30 V
    CombDrive ideal { n = 80, h = 30 um, gap = 3 um, push = volt, pull = volt/2 }
    FoldedFlexure guide1 { l = 300 um, h = 30 um }
    R air1 : F = 1e-4 [N*s/m]*v
    1 hub1
    ideal.shuttle -> hub1 -> guide1.ends, air1

    CombCapacitor comb { n = 80, h = 30 um, gap = 3 um, overlap = 15 um, R_s = 2 [kohm] }
    FoldedFlexure guide2 { l = 300 um, h = 30 um }
    R air2 : F = 1e-4 [N*s/m]*v
    MSe supply : u = volt
    1 hub2
    supply -> comb.pins
    comb.shuttle -> hub2 -> guide2.ends, air2
    output x1 = guide1.way, x2 = guide2.way, k = guide1.stiffness, F = comb.force, u = comb.voltage, way = comb.way
"""


def test_combs_pull_with_half_the_slope_of_the_capacitance() -> None:
    """F = V^2 C'/2 with C' = 2 n eps0 h/gap, against 8 pairs of 12 E I/l^3, two in series each."""
    found = run("mems", "CombDrive, CombCapacitor", COMBS, 5e-3, energy=True)
    stiffness = 8 * 6 * 160e9 * 30e-6 * (2e-6) ** 3 / 12 / (300e-6) ** 3
    slope = 2 * 80 * EPS0 * 30e-6 / 3e-6
    exact(found["k"], np.full(101, stiffness))
    near(found["x1"], slope / 2 * (30**2 - 15**2) / stiffness * (1 - np.exp(-stiffness / 1e-4 * found.time)))
    near(found["F"], slope / 2 * found["u"] ** 2, rtol=1e-13)
    near(found.final("x2"), slope / 2 * 30**2 / stiffness)
    near(found["way"], found["x2"])
    assert found.energy is not None
    near(
        found.energy.residual, 0, scale=found.energy.supplied, margin=1e4
    )  # the leads' work is a quadrature without error control


PLATE = """
    import EndStop from mechanics
    input volt = 5 V
    MSe supply : u = volt
    ParallelPlate plate { area = 1e4 [um^2], gap = 2 um }
    EndStop stop { gap = 1.5 um, k = 1e4 [N/m], soft = 1 nm, loss = 10 [s/m] }
    C spring : F = 1 [N/m]*x
    I mass   : p = 1 ug*v
    R air    : F = 6e-5 [N*s/m]*v
    1 hub
    supply -> plate.pins
    plate.plate -> hub -> mass, spring, air, stop.ends
    output x = spring.x, F = plate.force, u = plate.voltage, way = plate.way
"""
PULL_IN = math.sqrt(8 * 1 * (2e-6) ** 3 / (27 * EPS0 * 1e-8))  # of the textbook: at a third of the gap, V


def test_plates_attract_each_other() -> None:
    """F = V^2 C'/2 = eps0 A V^2/(2 (g - x)^2) at every instant, and balance with the spring at rest."""
    volt = 0.9 * PULL_IN
    found = run("mems", "ParallelPlate", PLATE, 3e-3, settings={"volt": volt})
    near(found["F"], EPS0 * 1e-8 * found["u"] ** 2 / (2 * (2e-6 - found["way"]) ** 2), rtol=1e-13)
    rest = brentq(lambda x: x - EPS0 * 1e-8 * volt**2 / (2 * (2e-6 - x) ** 2), 0, 2e-6 / 3, xtol=1e-20, rtol=1e-14)
    near(found.final("x"), rest)
    exact(found.final("u"), volt)


def test_plates_pull_in_at_a_third_of_the_gap() -> None:
    """1 percent below the pull-in voltage, approached slowly, they stay apart; 1 percent above they go to the stop."""
    below = run(
        "mems",
        "ParallelPlate",
        PLATE,
        20e-3,
        settings={"volt": f"{0.99 * PULL_IN!r} V*smoothstep5(time, 0 s, 10 ms)"},
        rtol=1e-6,
    )
    above = run(
        "mems",
        "ParallelPlate",
        PLATE,
        20e-3,
        settings={"volt": f"{1.01 * PULL_IN!r} V*smoothstep5(time, 0 s, 10 ms)"},
        rtol=1e-6,
    )
    assert below.final("x") < 2e-6 / 3
    assert above.final("x") > 1.5e-6


# ---------------------------------------------------------------------- flexures

LEAF = """
    %s leaf { %s, r_phi = 1e-10 [N*m*s], r_x = 1e-3 [N*s/m], r_y = 1 [N*s/m] }
    splitter load(x, y, phi)
    Se fx : F = %r N
    Se fy : F = %r N
    Se m  : M = %r [N*m]
    fx -> load.x
    fy -> load.y
    m  -> load.phi
    load => leaf.ends
    output x = leaf.%sspring.x, y = leaf.%sspring.y, phi = leaf.%sspring.phi
"""
DIMENSIONS = "l = 1 mm, d = 2 um, h = 40 um, E = 150 GPa"
SECOND_MOMENT = 40e-6 * (2e-6) ** 3 / 12


def leaf(part: str, parameters: str, fx: float, fy: float, m: float, to: float) -> tuple[float, float, float]:
    """Deflections of a leaf spring at rest under a load."""
    inner = "" if part == "Flexure" else "leaf."
    found = run(
        "mems", part, LEAF % (part, parameters, float(fx), float(fy), float(m), inner, inner, inner), to, points=2
    )
    return found.final("x"), found.final("y"), found.final("phi")


@pytest.mark.parametrize("turn", [0.5, -0.5, 0.0])
def test_flexure_rests_where_its_energy_says(turn: float) -> None:
    """Large deflections: the gradient of the energy, by complex steps, is the load."""
    k_phi, k_x, k_y = 1e-8, 0.06, 3e4
    load = np.array([1.5e-6, 4e-6, 3e-9])
    q = leaf("Flexure", f"k_phi = {k_phi} [N*m], k_x = {k_x} [N/m], k_y = {k_y} [N/m], turn = {turn}", *load, 3)

    def energy(x: complex, y: complex, phi: complex) -> complex:
        c, s = np.cos(turn * phi), np.sin(turn * phi)
        return (k_phi * phi**2 + k_x * (x * c + y * s) ** 2 + k_y * (-x * s + y * c) ** 2) / 2

    # A relative error of the displacements is one of the forces and torques in the stiff direction.
    step = 1e-30
    gradient = [energy(*(np.array(q) + 1j * step * np.eye(3)[i])).imag / step for i in range(3)]
    near(gradient[2], load[2], scale=k_y * q[0] ** 2)
    near(gradient[:2], load[:2], scale=k_y * abs(q[0]))
    assert abs(q[2]) > 0.2


@pytest.mark.parametrize(("part", "p"), [("LeafFlexure", 0.0), ("ReinforcedFlexure", 0.72)])
def test_leaf_springs_have_the_stiffness_of_beams(part: str, p: float) -> None:
    """(4.14): thick parts do not bend; each stiffness by a load of its own."""
    dimensions = DIMENSIONS + (f", p = {p}" if p else "")
    x, y, phi = leaf(part, dimensions, 1e-6, 0, 0, 2)
    near(x, 1e-6 * (1e-3) ** 3 * (1 - p**3) / (12 * 150e9 * SECOND_MOMENT))
    near([y, phi], 0, scale=1e-6)
    _, y, _ = leaf(part, dimensions, 0, 1e-3, 0, 0.1)
    near(y, 1e-3 * 1e-3 * (1 - p) / (150e9 * 80e-12))
    _, _, phi = leaf(part, dimensions, 0, 0, 1e-9, 1)
    near(phi, 1e-9 * 1e-3 * (1 - p) / (150e9 * SECOND_MOMENT))


def test_leaf_spring_is_a_cantilever() -> None:
    """A force F at the tip is F and F l/2 at the middle: F l^3/(3 E I) and F l^2/(2 E I) for small deflections."""
    force, length, stiffness = 1e-12, 1e-3, 150e9 * SECOND_MOMENT
    x, _, phi = leaf("LeafFlexure", DIMENSIONS, force, 0, force * length / 2, 2)
    near(phi, force * length**2 / (2 * stiffness), scale=1e-6)
    near(x + phi * length / 2, force * length**3 / (3 * stiffness))


# ---------------------------------------------------------------------- films and shuttle


def share(ratio: float) -> float:
    """The sum of Blech's series over 2000 terms."""
    n = np.arange(1, 4001, 2)
    return 1 - 192 / math.pi**5 * ratio * float(np.sum(np.tanh(n * math.pi / 2 / ratio) / n.astype(float) ** 5))


@pytest.mark.parametrize(("length", "width"), [(100, 100), (300, 80)])
def test_squeeze_film_closes_under_a_force(length: float, width: float) -> None:
    """c v/(g - x)^3 = F: 1/(g - x)^2 grows linearly."""
    found = run(
        "mems", "SqueezeFilm",
        f"""
        Se press : F = 20 uN
        C  free  : F = 1e-12 [N/m]*x
        SqueezeFilm film {{ length = {length} um, width = {width} um, gap = 3 um, closed = free.x }}
        1 plate
        press -> plate -> film.ends, free
        output x = free.x, F = film.force
        """,
        2e-3,
    )  # fmt: skip
    c = share(width / length) * 1.82e-5 * length * 1e-6 * (width * 1e-6) ** 3
    gap = 1 / np.sqrt(1 / 3e-6**2 + 2 * 20e-6 / c * found.time)
    near(found["x"], 3e-6 - gap)
    assert share(1) == pytest.approx(0.4217, abs=1e-4)  # of a square plate, as in the literature


def test_slide_film_and_shuttle() -> None:
    found = run(
        "mems", "Shuttle",
        """
        Shuttle part { n = 50, h = 30 um, gap = 2 um, l = 250 um, d = 1.5 um, pairs = 4, E = 169 GPa, area = 0.2 [mm^2], film = 1.5 um, push = 20 V }
        I mass : p = 30 ug*v
        part.shuttle -> mass
        output x = part.way, F = part.force, film = part.air.force, v = mass.v
        """,
        2e-3,
    )  # fmt: skip
    k = 4 * 6 * 169e9 * 30e-6 * (1.5e-6) ** 3 / 12 / (250e-6) ** 3
    r, m, force = 1.82e-5 * 0.2e-6 / 1.5e-6, 30e-9, 50 * EPS0 * 30e-6 / 2e-6 * 20**2
    delta = r / (2 * m)
    w = math.sqrt(k / m - delta**2)
    swing = np.exp(-delta * found.time) * (np.cos(w * found.time) + delta / w * np.sin(w * found.time))
    near(found["x"], force / k * (1 - swing))
    near(found["film"], r * found["v"], rtol=1e-13)
    exact(found["F"], np.full(101, force))


def test_a_mechanism_stands_on_flexures_of_the_library() -> None:
    """A body on two plain leaf springs side by side: its parallel guidance has twice their lateral stiffness."""
    found = run(
        "mems", "LeafFlexure",
        """
        multibody stage : planar {
          body table { mass = 1 ug, inertia = 1e-13 [kg*m^2], at = (0, 1 mm) }
          free left  : ground to table { at = (-0.3 mm, 0.5 mm), axes = from }
          free right : ground to table { at = ( 0.3 mm, 0.5 mm), axes = from }
        }
        LeafFlexure leaf1 { l = 1 mm, d = 2 um, h = 40 um, E = 150 GPa, r_x = 1e-5 [N*s/m], r_y = 1e-2 [N*s/m] }
        LeafFlexure leaf2 { l = 1 mm, d = 2 um, h = 40 um, E = 150 GPa, r_x = 1e-5 [N*s/m], r_y = 1e-2 [N*s/m] }
        stage.left  => leaf1.ends
        stage.right => leaf2.ends
        splitter hand(x, y, phi)
        Se push : F = 1e-8 N
        Se lift : F = 0
        Se turn : M = 0
        push -> hand.x
        lift -> hand.y
        turn -> hand.phi
        hand => stage.table
        output x = stage.table.x, phi = stage.table.phi
        """,
        3e-3, rtol=1e-6,
    )  # fmt: skip
    # The force at the table and the springs' at their middles make a couple F l/2; the table turns until the springs' length holds it.
    k_x, k_phi, k_y = 12 * 150e9 * SECOND_MOMENT / 1e-9, 150e9 * SECOND_MOMENT / 1e-3, 150e9 * 80e-12 / 1e-3
    phi = -1e-8 * 0.5e-3 / (2 * k_phi + 2 * k_y * 0.3e-3**2)
    near(found.final("phi"), phi, rtol=1e-6)
    near(found.final("x"), 1e-8 / (2 * k_x) - phi * 0.5e-3, rtol=1e-6)
