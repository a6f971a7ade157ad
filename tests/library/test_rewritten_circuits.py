"""Ideal circuits written in equivalent ways have one motion: branches turned, junctions split, arrows reversed, valves as gaps and as lines that open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import bondgraph
from tests.library.ideal_circuits import Circuit, solve
from tests.library.rewritten_circuits import text
from tests.library.test_ideal_switching import bridge, converter, freewheel, h_bridge, three_phase, values


def unequal_cascade(stages: int, seed: int) -> tuple[Circuit, float, float]:
    """Cockcroft and Walton's with capacitors and a load of its own, charged a little at the start, so that all diodes block there."""
    *sizes, load = values(seed, *[(3e-6, 3e-5)] * (2 * stages), (2e4, 5e5))
    capacitors, diodes = [], []
    column, row, node = 2, 0, 3
    for k in range(stages):
        capacitors += [
            (node, column, sizes[2 * k], 2.2 if k else 1.0),
            (node + 1, row, sizes[2 * k + 1], 2.2 if k else 2.0),
        ]
        diodes += [(row, node), (node, node + 1)]
        column, row, node = node, node + 1, node + 2
    source = (1, 0, 0.0, 10.0, 100 * np.pi, 0.0)
    circuit = Circuit(resistors=[(1, 2, 50.0), (row, 0, load)], capacitors=capacitors, sources=[source], diodes=diodes)
    return circuit, 0.02 if stages < 5 else 0.006, 1e-4


def earthed(circuit: Circuit) -> Circuit:
    """A rectifier whose load does not float."""
    return replace(circuit, resistors=[*circuit.resistors, (11, 0, 1e4)])


CASES: dict[str, Callable[[], tuple[Circuit, float, float]]] = {
    "freewheel": lambda: freewheel(3)[2:5],
    "bridge": lambda: bridge(2)[2:5],
    "buck": lambda: converter(2, boost=False)[2:5],
    "boost": lambda: converter(3, boost=True)[2:5],
    "h_bridge": lambda: h_bridge(1)[2:5],
    "three_phase": lambda: (earthed(three_phase(1)[2]), 0.015, 5e-5),
    "cascade": lambda: unequal_cascade(2, 2),
}


def run(circuit: Circuit, stop: float, seed: int | None) -> bondgraph.Result:
    stored = [f"q{k} = c{k}.q" for k in range(len(circuit.capacitors))]
    stored += [f"p{k} = l{k}.p" for k in range(len(circuit.inductors))]
    return bondgraph.load(text(circuit, seed, stored, stop)).simulate(to=stop, points=51, rtol=1e-9)


def stored(circuit: Circuit, found: bondgraph.Result) -> np.ndarray:
    """Charges and flux linkages, without the signs that turned lines give them."""
    names = [*(f"q{k}" for k in range(len(circuit.capacitors))), *(f"p{k}" for k in range(len(circuit.inductors)))]
    return np.abs([found[n] for n in names])


def truth(circuit: Circuit, times: np.ndarray, grid: float) -> np.ndarray:
    """The same by the exact pieces."""
    z, _ = solve(circuit, times, grid)
    potential = np.concatenate([np.zeros((len(times), 1)), z[:, : circuit.nodes]], axis=1)
    charges = [c * (potential[:, a] - potential[:, b]) for a, b, c, _ in circuit.capacitors]
    linkages = [size * z[:, int(circuit.first[0]) + k] for k, (_, _, size, _) in enumerate(circuit.inductors)]
    return np.abs([*charges, *linkages])


@cache
def as_numbered(name: str) -> np.ndarray:
    circuit, stop, grid = CASES[name]()
    found = run(circuit, stop, None)
    exact = truth(circuit, found.time, grid)
    assert (np.abs(stored(circuit, found) - exact).max(axis=1) <= 1e-6 * exact.max(axis=1)).all()
    return stored(circuit, found)


@pytest.mark.few(5)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", CASES)
def test_one_motion_however_it_is_written(name: str, seed: int) -> None:
    circuit, stop, _ = CASES[name]()
    plain = as_numbered(name)
    found = stored(circuit, run(circuit, stop, seed))
    assert (np.abs(found - plain).max(axis=1) <= 1e-9 * plain.max(axis=1)).all()


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("stages", "seed"), [(2, 0), (2, 1), (3, 2), (3, 3), (4, 4), (5, 5), (6, 6), (7, 7), (8, 8), (10, 9)]
)
def test_cascades_of_unequal_capacitors(stages: int, seed: int) -> None:
    circuit, stop, grid = unequal_cascade(stages, seed)
    found = run(circuit, stop, seed)
    exact = truth(circuit, found.time, grid)
    assert (np.abs(stored(circuit, found) - exact).max(axis=1) <= 1e-6 * exact.max()).all()


CLUTCH = """plain model Clutch {
  parameter J_a = 1, J_b = 1, d = 1, drag = 1
  mode grips = false
  Sf drive : f = 2*sin(6*time + 0.3)
  1 a, b
  0 coupling, w { active = grips }
  I rotor : p = J_a*f
  I load : p = J_b*f { start f = 0.4 }
  R slip : e = d*f
  R bearing : e = drag*f
  drive -> coupling -> a -> rotor
  coupling -> slip
  b -> load, bearing
  ARROWS
  when grips and SHUT { grips = false }
  when not grips and OPEN { grips = true }
  output fast = rotor.f, slow = load.f
}"""
FORMS = {
    "forward": ("a -> w -> b", "w.e < 0", "a.f > b.f"),
    "reversed": ("b -> w -> a", "w.e > 0", "b.f < a.f"),
    "other readings": ("a -> w -> b", "0 > w.e", "rotor.f - load.f > 0"),
    "split": ("1 more\n  0 less\n  a -> more -> less -> w -> b", "less.e < 0", "more.f > bearing.f"),
}


@pytest.mark.parametrize("form", FORMS)
def test_one_way_clutches(form: str) -> None:
    """Between two shafts: a diode between two capacitors, where speeds are voltages."""
    arrows, shut, opened = FORMS[form]
    model = bondgraph.load(
        CLUTCH.replace("ARROWS", arrows)
        .replace("SHUT", shut)
        .replace("OPEN", opened)
        .replace("0 coupling, w {", "0 coupling\n  0 w {")
    )
    for seed in range(3):
        j_a, j_b, d, drag = values(seed, (0.05, 1), (0.05, 1), (0.3, 3), (0.1, 1))
        circuit = Circuit(
            resistors=[(1, 2, 1 / d), (3, 0, 1 / drag)], capacitors=[(2, 0, j_a, 0.0), (3, 0, j_b, 0.4)],
            sources=[(1, 0, 0.0, 2.0, 6.0, 0.3)], diodes=[(2, 3)],
        )  # fmt: skip
        settings = {"J_a": j_a, "J_b": j_b, "d": d, "drag": drag}
        found = model.simulate(settings=settings, to=3, points=31, rtol=1e-9)
        exact, changes = solve(circuit, found.time, 1e-2)
        assert changes >= 3
        np.testing.assert_allclose(found["fast"], exact[:, 1], atol=1e-6)
        np.testing.assert_allclose(found["slow"], exact[:, 2], atol=1e-6)


RING = """plain model Ring {
  parameter S_a = 2, S_b = 3, q_a = 0.3
  Se earth : e = 0
  0 n0, n1, n2
  1 line_a, line_b, line_r
  C a : e = S_a*q { start q = q_a }
  C b : e = S_b*q
  R r : e = 2*f
  earth -> n0
  n1 -> line_a -> n2
  TURN
  line_a -> a
  line_b -> b
  n1 -> line_r -> n0
  line_r -> r
  n2 -> n0
  output q = a.q, p = b.q
}"""


@pytest.mark.parametrize("turn", ["n1 -> line_b -> n2", "n2 -> line_b -> n1"])
def test_capacitors_tied_by_a_ring_of_junctions(turn: str) -> None:
    """Two capacitors between the same two nodes, each on a line of its own: one state, whichever way the lines point."""
    sign = 1 if turn.startswith("n1") else -1
    found = bondgraph.load(RING.replace("TURN", turn)).simulate(to=2, points=11, rtol=1e-9, target="numpy")
    decay = np.exp(-found.time / (2 * (1 / 2 + 1 / 3)))
    np.testing.assert_allclose(found["q"], 0.3 * decay, atol=1e-8)
    np.testing.assert_allclose(found["p"], sign * 0.2 * decay, atol=1e-8)


HELD = """plain model Held {
  1 body
  1 one { active = time > 1 }
  1 two { active = time > 2 }
  I mass : p = 2*f
  Se push : e = 1
  C spring_one : e = 4*q
  C spring_two : e = 5*q
  push -> body -> mass
  ARROWS
  one -> spring_one
  two -> spring_two
  output v = mass.f, x = spring_one.q, y = spring_two.q
}"""


@pytest.mark.parametrize("arrows", ["body -> one\n  body -> two", "body -> one\n  0 node\n  body -> node -> two"])
def test_two_junctions_that_hold_one_motion(arrows: str) -> None:
    """Both are off at first, then one, then none: the body stands until the last lets go."""
    found = bondgraph.load(HELD.replace("ARROWS", arrows)).simulate(to=3, points=31, rtol=1e-9, target="numpy")
    after = np.maximum(found.time - 2, 0)
    x = (1 - np.cos(np.sqrt(4.5) * after)) / 9
    np.testing.assert_allclose(found["v"], np.sqrt(4.5) * np.sin(np.sqrt(4.5) * after) / 9, atol=1e-7)
    np.testing.assert_allclose(found["x"], x, atol=1e-7)


@pytest.mark.few(4)
@pytest.mark.parametrize("rungs", [1, 2, 3, 5])
@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_a_mesh_that_rests_while_its_valve_blocks(rungs: int, target: str) -> None:
    """A ladder of resistors behind a diode: as long as that blocks, all in the system of its loop are numbers. That ended with a defect."""
    last = 2 + rungs
    sizes = values(rungs, *[(1, 100)] * (3 * rungs))
    rails = [(2 + k, 3 + k, r) for k, r in enumerate(sizes[:rungs])]
    steps = [(3 + k // 2, 0, r) for k, r in enumerate(sizes[rungs:])]
    circuit = Circuit(
        resistors=[*rails, *steps, (2, 0, 7.0), (1, last + 1, 2.0)], capacitors=[(last + 1, 0, 1e-4, 1.0)],
        sources=[(1, 0, 1.0, 5.0, 300.0, 0.4)], diodes=[(1, 2)],
    )  # fmt: skip
    columns = [f"u{k} = n{k}.e" for k in range(1, last + 1)]
    found = bondgraph.load(text(circuit, None, columns, 0.05)).simulate(to=0.05, points=41, target=target)
    beyond, shares = math.inf, [1.0]  # resistance to earth from the end of a rail on; what of a potential passes it
    for k in reversed(range(rungs)):
        load = 1 / (1 / beyond + 1 / steps[2 * k][2] + 1 / steps[2 * k + 1][2])
        beyond = load + rails[k][2]
        shares.insert(1, load / beyond)
    source = 1 + 5 * np.sin(300 * found.time + 0.4)
    assert (source < -1).any()
    for k, share in enumerate(np.cumprod(shares)):
        np.testing.assert_allclose(found[f"u{k + 2}"], share * np.maximum(source, 0), atol=1e-9)
