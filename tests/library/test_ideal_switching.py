"""Ideal diodes and switches: every conducting set is found, and the motion is that of exact pieces (`ideal_circuits.py`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import bondgraph
from tests.library.ideal_circuits import Circuit, solve

Case = tuple[str, dict[str, float], Circuit, float, float, dict[str, Callable[[np.ndarray], np.ndarray]]]
CLOSE = 1e-6  # of the largest value
W = 100 * math.pi


@cache
def model(text: str) -> bondgraph.Model:
    return bondgraph.load(text)


def agree(case: Case, **options: object) -> bondgraph.Result:
    text, settings, circuit, stop, grid, columns = case
    found = model(text).simulate(settings=settings, to=stop, points=101, rtol=1e-8, **options)  # type: ignore[arg-type]
    exact, _ = solve(circuit, found.time, grid)
    for name, read in columns.items():
        truth = read(exact)
        np.testing.assert_allclose(found[name], truth, atol=CLOSE * np.abs(truth).max())
    return found


def values(seed: int, *ranges: tuple[float, float]) -> list[float]:
    """Numbers between bounds, equally likely in their logarithm."""
    numbers = np.random.default_rng(seed)
    return [float(np.exp(numbers.uniform(math.log(a), math.log(b)))) for a, b in ranges]


FREEWHEEL = """import IdealDiode from electric
model HalfWave {
  parameter U: V = 10, L: H = 0.01, R: ohm = 5, I_0: A = 0, E: V = 0
  Se s : u = U*sin(2*pi*50 Hz*time)
  Se gnd : u = 0 V
  Se battery : u = E
  IdealDiode d, f
  I l : lambda = L*i { start i = I_0 }
  R load : u = R*i
  0 n : electric
  s -> 1(d.pins) -> n
  gnd -> 1(f.pins) -> n
  n -> 1(l, load) -> battery
  output i = l.i
}"""


def freewheel(seed: int) -> Case:
    u, inductance, r, e, current = values(seed, (1, 100), (1e-4, 0.1), (0.5, 20), (0.01, 0.9), (0.1, 10))
    e, current = (u * e if seed % 3 else 0.0), (current if seed % 2 else 0.0)
    circuit = Circuit(
        resistors=[(3, 4, r)], inductors=[(2, 3, inductance, current)], diodes=[(1, 2), (0, 2)],
        sources=[(1, 0, 0.0, u, W, 0.0), (4, 0, e, 0.0, 1.0, 0.0)],
    )  # fmt: skip
    settings = {"U": u, "L": inductance, "R": r, "I_0": current, "E": e}
    return FREEWHEEL, settings, circuit, 0.05, 1e-4, {"i": lambda z: z[:, 4]}


BRIDGE = """import IdealDiode from electric
model Bridge {
  parameter U: V = 10, R_s: ohm = 1, R: ohm = 100, C: F = 1e-4, U_0: V = 0
  Se s : u = U*sin(2*pi*50 Hz*time + 0.1)
  Se gnd : u = 0 V
  IdealDiode d1, d2, d3, d4
  R rs : u = R_s*i
  R load : u = R*i
  C cap : q = C*u { start u = U_0 }
  0 a, b : electric
  0 p, m
  s -> 1(rs) -> a
  gnd -> b
  a -> 1(d1.pins) -> p
  b -> 1(d2.pins) -> p
  m -> 1(d3.pins) -> a
  m -> 1(d4.pins) -> b
  p -> 1(load) -> m
  p -> 1(cap) -> m
  output u = cap.u
}"""


def bridge(seed: int, text: str = BRIDGE) -> Case:
    u, source, r, c, start = values(seed, (5, 50), (0.5, 5), (50, 500), (2e-5, 3e-4), (0.1, 0.8))
    start = start * u if seed % 2 else 0.0
    circuit = Circuit(
        resistors=[(1, 2, source), (3, 4, r)], capacitors=[(3, 4, c, start)], sources=[(1, 0, 0.0, u, W, 0.1)],
        diodes=[(2, 3), (0, 3), (4, 2), (4, 0)], leak=1e11,
    )  # fmt: skip
    settings = {"U": u, "R_s": source, "R": r, "C": c, "U_0": start}
    return text, settings, circuit, 0.04, 1e-4, {"u": lambda z: z[:, 2] - z[:, 3]}


CONVERTER = """import IdealDiode, Switch from electric
model Converter {
  parameter U: V = 24, L: H = 1e-4, C: F = 1e-4, R: ohm = 5, T = 10 us, duty = 0.4
  mode on = true
  signal saw = integral(1 - 0*time/1 s, 0 s)
  every T { on = true; saw = 0 s }
  when saw > duty*T { on = false }
  Se s : u = U
  Se gnd : u = 0 V
  IdealDiode d
  Switch sw { closed = 1 if on else 0 }
  I l : lambda = L*i
  C c : q = C*u
  R load : u = R*i
  0 n, o : electric
  WIRES
  o -> c, load
  output u = c.u, i = l.i
}"""
BUCK = CONVERTER.replace("WIRES", "s -> 1(sw.pins) -> n\n  gnd -> 1(d.pins) -> n\n  n -> 1(l) -> o")
BOOST = CONVERTER.replace("WIRES", "s -> 1(l) -> n -> 1(sw.pins) -> gnd\n  n -> 1(d.pins) -> o")
PERIODS = 20


def converter(seed: int, boost: bool) -> Case:
    """In continuous conduction, and for odd seeds in discontinuous one."""
    u, inductance, c, r, period = values(seed, (5, 50), (1e-4, 3e-4), (3e-5, 2e-4), (2, 10), (1e-5, 4e-5))
    duty = np.random.default_rng(seed + 1000).uniform(0.1, 0.7)
    r = r * (300 if seed % 2 else 1)
    instants = [t for k in range(PERIODS) for t in ((k + duty) * period, (k + 1) * period)]
    first, last = ((1, 2), (2, 3)) if boost else ((2, 3), (1, 2))
    circuit = Circuit(
        resistors=[(3, 0, r)], capacitors=[(3, 0, c, 0.0)], inductors=[(*first, inductance, 0.0)], sources=[(1, 0, u, 0.0, 1.0, 0.0)],
        diodes=[(2, 3)] if boost else [(0, 2)], switches=[(2, 0, _even) if boost else (*last, _even)], instants=instants,
    )  # fmt: skip
    settings = {"U": u, "L": inductance, "C": c, "R": r, "T": period, "duty": float(duty)}
    text = BOOST if boost else BUCK
    columns = {"u": lambda z: z[:, 2], "i": lambda z: z[:, 3]}
    return text, settings, circuit, (PERIODS - 0.5) * period, period / 50, columns


CUK = """import IdealDiode, Switch from electric
model Cuk {
  parameter U: V = 12, L_1: H = 1e-4, L_2: H = 1e-4, C_1: F = 1e-5, C_2: F = 4.7e-5, R: ohm = 10, T = 20 us, duty = 0.4
  Se s : u = U
  Switch sw { closed = 1 if mod(time/T, 1) < duty else 0 }
  IdealDiode d
  I l1 : lambda = L_1*i
  I l2 : lambda = L_2*i
  C c1 : q = C_1*u
  C c2 : q = C_2*u
  R load : u = R*i
  0 a, b, o : electric
  s -> 1(l1) -> a -> 1(c1) -> b -> 1(l2) -> o -> c2, load
  a -> sw.pins
  b -> d.pins
  output u = c2.u, i = l1.i
}"""


def cuk(seed: int) -> Case:
    u, l_1, l_2, c_1, c_2, r, period = values(
        seed, (5, 50), (1e-4, 3e-4), (1e-4, 3e-4), (5e-6, 2e-5), (3e-5, 2e-4), (2, 10), (1e-5, 4e-5)
    )
    duty = np.random.default_rng(seed + 1000).uniform(0.1, 0.7)
    instants = [t for k in range(PERIODS) for t in ((k + duty) * period, (k + 1) * period)]
    circuit = Circuit(
        resistors=[(4, 0, r)], capacitors=[(2, 3, c_1, 0.0), (4, 0, c_2, 0.0)], inductors=[(1, 2, l_1, 0.0), (3, 4, l_2, 0.0)],
        sources=[(1, 0, u, 0.0, 1.0, 0.0)], diodes=[(3, 0)], switches=[(2, 0, _even)], instants=instants,
    )  # fmt: skip
    settings = {"U": u, "L_1": l_1, "L_2": l_2, "C_1": c_1, "C_2": c_2, "R": r, "T": period, "duty": float(duty)}
    columns = {"u": lambda z: z[:, 3], "i": lambda z: z[:, 4]}
    return CUK, settings, circuit, (PERIODS - 0.5) * period, period / 50, columns


def _even(interval: int) -> bool:
    return interval % 2 == 0


H_BRIDGE = """import IdealDiode, Switch from electric
model Full {
  parameter U: V = 48, L: H = 1e-3, R: ohm = 3, T = 1 ms, level = 0.3, E: V = 0
  Se s : u = U
  Se gnd : u = 0 V
  Se back : u = E
  signal wave = sin(2*pi*time/T)
  input on = 1 if wave > level else 0
  input rev = 1 if wave < -level else 0
  Switch s1 { closed = on }
  Switch s2 { closed = rev }
  Switch s3 { closed = rev }
  Switch s4 { closed = on }
  IdealDiode d1, d2, d3, d4
  0 p, x, y, g
  s -> p
  gnd -> g
  p -> 1(s1.pins) -> x -> 1(s3.pins) -> g
  p -> 1(s2.pins) -> y -> 1(s4.pins) -> g
  x -> 1(d1.pins) -> p
  g -> 1(d3.pins) -> x
  y -> 1(d2.pins) -> p
  g -> 1(d4.pins) -> y
  I l : lambda = L*i
  R r : u = R*i
  back -> 1(l, r)
  x -> 1(l_in) -> y
  output i = l.i
}""".replace("  back -> 1(l, r)\n  x -> 1(l_in) -> y", "  1 arm\n  x -> arm -> y\n  arm -> l, r\n  back -> arm")


def h_bridge(seed: int) -> Case:
    u, inductance, r, back = values(seed, (10, 100), (2e-4, 5e-3), (1, 10), (0.01, 0.5))
    level = float(np.random.default_rng(seed + 2000).uniform(0.1, 0.8))
    back, period = (back * u if seed % 2 else 0.0), 1e-3
    rise = math.asin(level) / (2 * math.pi) * period
    parts = (rise, period / 2 - rise, period / 2 + rise, period - rise)
    instants = [k * period + t for k in range(6) for t in parts]
    forward, backward = (lambda k: k % 4 == 1), (lambda k: k % 4 == 3)
    circuit = Circuit(
        resistors=[(4, 5, r)], inductors=[(2, 4, inductance, 0.0)],
        sources=[(1, 0, u, 0.0, 1.0, 0.0), (3, 5, back, 0.0, 1.0, 0.0)], diodes=[(2, 1), (0, 2), (3, 1), (0, 3)],
        switches=[(1, 2, forward), (3, 0, forward), (1, 3, backward), (2, 0, backward)], instants=instants,
    )  # fmt: skip
    settings = {"U": u, "L": inductance, "R": r, "level": level, "E": back}
    return H_BRIDGE, settings, circuit, 4.3e-3, 5e-6, {"i": lambda z: z[:, 5]}


THREE_PHASE = """import IdealDiode from electric
model ThreePhase {
  parameter U: V = 100, L: H = 1e-3, R_s: ohm = 0.1, R: ohm = 10, C: F = 1e-3
  constant w = 2*pi*50 Hz
  Se sa : u = U*sin(w*time)
  Se sb : u = U*sin(w*time - 2*pi/3)
  Se sc : u = U*sin(w*time + 2*pi/3)
  IdealDiode d1, d2, d3, d4, d5, d6
  R ra, rb, rc : u = R_s*i
  I la, lb, lc : lambda = L*i
  0 a, b, c, p, m
  sa -> 1(ra, la) -> a
  sb -> 1(rb, lb) -> b
  sc -> 1(rc, lc) -> c
  a -> 1(d1.pins) -> p
  b -> 1(d3.pins) -> p
  c -> 1(d5.pins) -> p
  m -> 1(d4.pins) -> a
  m -> 1(d6.pins) -> b
  m -> 1(d2.pins) -> c
  R load : u = R*i
  C cap : q = C*u
  p -> 1(0(load, cap)) -> m
  output u = cap.u, i = la.i
}"""


def three_phase(seed: int) -> Case:
    u, inductance, source, r, c = values(seed, (10, 300), (3e-4, 5e-3), (0.05, 0.5), (5, 50), (3e-4, 2e-3))
    circuit = Circuit(
        resistors=[(1, 4, source), (2, 5, source), (3, 6, source), (10, 11, r)], capacitors=[(10, 11, c, 0.0)],
        inductors=[(4, 7, inductance, 0.0), (5, 8, inductance, 0.0), (6, 9, inductance, 0.0)],
        sources=[(k, 0, 0.0, u, W, phase) for k, phase in ((1, 0.0), (2, -2 * math.pi / 3), (3, 2 * math.pi / 3))],
        diodes=[(7, 10), (8, 10), (9, 10), (11, 7), (11, 8), (11, 9)],
    )  # fmt: skip
    settings = {"U": u, "L": inductance, "R_s": source, "R": r, "C": c}
    columns = {"u": lambda z: z[:, 9] - z[:, 10], "i": lambda z: z[:, 11]}
    return THREE_PHASE, settings, circuit, 0.03, 5e-5, columns


def cascade(stages: int, seed: int) -> Case:
    """Cockcroft and Walton's: charged a little at the start, so that all diodes block there."""
    c, r = values(seed, (3e-6, 3e-5), (2e4, 5e5))
    lines, capacitors, diodes = [], [], []
    above, below, column, row, node = "top", "g", 2, 0, 3
    for k in range(1, stages + 1):
        lines += [
            f"0 o{k}, e{k}",
            f"IdealDiode a{k}, b{k}",
            f"C co{k} : q = C*u {{ start u = {1 if k == 1 else 2.2} V }}",
        ]
        lines += [
            f"C ce{k} : q = C*u {{ start u = {2 if k == 1 else 2.2} V }}",
            f"{above} -> 1(co{k}) -> o{k} -> 1(b{k}.pins) -> e{k}",
        ]
        lines += [f"e{k} -> 1(ce{k}) -> {below}", f"{below} -> 1(a{k}.pins) -> o{k}"]
        capacitors += [(column, node, c, -(1.0 if k == 1 else 2.2)), (node + 1, row, c, 2.0 if k == 1 else 2.2)]
        lines[-3] = lines[-3].replace(f"{above} -> 1(co{k}) -> o{k} ->", f"o{k} -> 1(co{k}) -> {above}\n  o{k} ->")
        capacitors[-2] = (node, column, c, 1.0 if k == 1 else 2.2)
        diodes += [(row, node), (node, node + 1)]
        above, below, column, row, node = f"o{k}", f"e{k}", node, node + 1, node + 2
    body = "\n  ".join(lines)
    text = f"""import IdealDiode from electric
model Cascade {{
  parameter C: F = 1e-5, R: ohm = 1e5
  Se s : u = 10 V*sin(2*pi*50 Hz*time)
  Se gnd : u = 0 V
  R rs : u = 50 ohm*i
  R load : u = R*i
  0 g, top
  gnd -> g
  s -> 1(rs) -> top
  {body}
  {below} -> 1(load) -> g
  output u = {below}.u, u1 = e1.u
}}"""
    circuit = Circuit(
        resistors=[(1, 2, 50.0), (row, 0, r)], capacitors=capacitors, sources=[(1, 0, 0.0, 10.0, W, 0.0)], diodes=diodes
    )
    return text, {"C": c, "R": r}, circuit, 0.03, 1e-4, {"u": lambda z: z[:, row - 1], "u1": lambda z: z[:, 3]}


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(10))
def test_freewheeling(seed: int) -> None:
    agree(freewheel(seed))


@pytest.mark.parametrize("seed", range(10))
def test_bridges(seed: int) -> None:
    agree(bridge(seed))


@pytest.mark.few(5)
@pytest.mark.parametrize("seed", range(10))
def test_buck_converters(seed: int) -> None:
    agree(converter(seed, boost=False))


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(10))
def test_cuk_converters_without_a_word(seed: int) -> None:
    """A look ahead ends where a switch opens: its coil would charge without end, and what then moves would be far from what was seen."""
    found = agree(cuk(seed), solver="explicit" if seed % 2 else "automatic")
    assert not found.warnings and not found.notes


@pytest.mark.few(5)
@pytest.mark.parametrize("seed", range(10))
def test_boost_converters(seed: int) -> None:
    agree(converter(seed, boost=True))


@pytest.mark.few(5)
@pytest.mark.parametrize("seed", range(10))
def test_h_bridges(seed: int) -> None:
    agree(h_bridge(seed))


@pytest.mark.parametrize("seed", [4, 6])
def test_a_phase_whose_current_has_no_rate_at_the_start(seed: int) -> None:
    """At the start it conducts beside another, and the sum of three voltages that cancel to rounding says that it does not."""
    agree(three_phase(seed))


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(10))
def test_three_phases(seed: int) -> None:
    agree(three_phase(seed))


@pytest.mark.few(1)
@pytest.mark.parametrize("stages", [1, 2, 3, 5])
@pytest.mark.parametrize("seed", range(4))
def test_cascades(stages: int, seed: int) -> None:
    agree(cascade(stages, seed))


def test_a_current_that_is_the_rounding_of_two_that_cancel() -> None:
    """All upper diodes begin to conduct at once; where three of five do, that in the middle has the difference of two equal currents."""
    text, settings, circuit, _, grid, columns = cascade(5, 3)
    agree((text, settings, circuit, 6e-4, grid, columns), solver="radau")


@pytest.mark.few(3)
@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
@pytest.mark.parametrize("solver", ["explicit", "radau", "rodas"])
def test_solvers_and_back_ends(solver: str, target: str) -> None:
    agree(bridge(2), solver=solver, target=target)


@pytest.mark.parametrize("seed", range(4))
def test_order_of_declarations(seed: int) -> None:
    """The lines of the model in another order."""
    head, *lines, end = BRIDGE.splitlines()
    numbers = np.random.default_rng(seed)
    body = [lines[0], *np.array(lines[1:], dtype=object)[numbers.permutation(len(lines) - 1)]]
    agree(bridge(2, "\n".join([head, *body, end])))


def test_a_mode_is_compiled_once() -> None:
    """Five sets of junctions at most occur in a buck converter, and the companion: nothing is compiled when one comes again."""
    text, settings, _, stop, *_ = converter(3, boost=False)
    built = bondgraph.load(text)
    found = built.simulate(settings=settings, to=stop, points=11)
    first = built.compiled
    assert len(found.events) > 2 * PERIODS and first <= 8
    built.simulate(settings={**settings, "R": 2 * settings["R"]}, to=stop, points=11)
    assert built.compiled == first


SHARED = """import Switch from electric
model Shared {
  parameter A: F = 1, B: F = 1, u_a: V = 1, u_b: V = 0
  C a : q = A*u { start u = u_a }
  C b : q = B*u { start u = u_b }
  R leak : i = 1e-9 [S]*u
  Switch tie { closed = 1 if time > 1 s else 0 }
  0 n : electric
  n -> a, leak
  n -> 1(tie.pins) -> b
  output moved = integral(tie.current, 0 C), back = integral(-2*b.i, 1 C), doubled = integral(2*tie.current + a.u*0 [S], 0 C)
}"""


@pytest.mark.parametrize("seed", range(10))
def test_integrals_across_impulses(seed: int) -> None:
    a, b, u_a, u_b = values(seed, (0.1, 10), (0.1, 10), (0.1, 10), (0.1, 10))
    found = model(SHARED).simulate(settings={"A": a, "B": b, "u_a": u_a, "u_b": u_b}, to=2, points=5, rtol=1e-9)
    charge = a * b / (a + b) * (u_a - u_b)
    np.testing.assert_allclose(found["moved"][-1], charge, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found["back"][-1], 1 - 2 * charge, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found["doubled"][-1], 2 * charge, rtol=1e-7, atol=1e-7)
    assert any("`moved`" in note for note in found.notes)


def test_an_impulse_has_no_square() -> None:
    text = SHARED.replace("output moved", "signal heat = integral(1 ohm*tie.current^2, 0 J)\n  output h = heat, moved")
    with pytest.raises(bondgraph.RunFailed, match="`heat` integrates has no integral across it"):
        bondgraph.load(text).simulate(to=2, points=5)


def test_sources_against_each_other_are_refused() -> None:
    text = """import IdealDiode from electric
model Shorted {
  Se high : u = 10 V*time/1 s
  Se low : u = 5 V
  IdealDiode d
  high -> 1(d.pins) -> low
  output i = d.current
}"""
    with pytest.raises(bondgraph.RunFailed, match="no set of conducting and blocking valves among `d`") as failed:
        bondgraph.load(text).simulate(to=1, points=5)
    assert "t = 0.5 s" in str(failed.value)
