"""A tolerance is kept, or a warning says that it is not: magnitudes of states that start at zero, names and order, units of time, rounding."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import bondgraph
from bondgraph.model import Model
from bondgraph.results.records import ToleranceDoubt
from bondgraph.results.result import Result
from bondgraph.simulation.magnitudes.free_response import free_response
from bondgraph.simulation.magnitudes.nominal_magnitudes import nominal_magnitudes
from bondgraph.simulation.segments.timeline import segments
from compiler.source import Source
from tests.compiling import Running, compiled


def model(text: str) -> Model:
    return Model(Source("made.bg", text))


def largest_error(result: Result, reference: Result) -> float:
    """The largest difference of all outputs, in parts of the largest value of any: they have one unit."""
    size = max(float(np.abs(reference[name]).max()) for name in reference.names)
    return max(float(np.abs(result[name] - reference[name]).max()) for name in reference.names) / size


# ---------------------------------------------------------------- diodes and capacitors from rest
def chain(nodes: int, amperes: float, saturation: float = 1e-6) -> str:
    """Capacitors of 1 uF joined by diodes, at rest; a current into the first."""
    outputs = ", ".join(f"u{a} = node[{a}].u" for a in range(1, nodes + 1))
    return f"""model Line {{
  parameter n = {nodes}
  Sf push : i = {amperes} [A]*smoothstep5(time, 0 s, 1 ms)
  for a in 1..n {{
    0 node[a]
    C c[a] : u = q/1 [uF]
    R leak[a] : i = u/100 [kohm]
    node[a] -> c[a], leak[a]
  }}
  for a in 2..n {{ R d[a] : i = {saturation} [A]*(exp(u/0.05 [V]) - 1)
    node[a-1] -> 1(d[a]) -> node[a] }}
  push -> node[1]
  output {outputs}
  experiment go {{ simulate 0 .. 10 ms {{ points = 11 }} }}
}}
"""


def mesh(nodes: int, amperes: float) -> str:
    """Capacitors in rows and columns, resistors along the rows, diodes down the columns."""
    return f"""model Mesh {{
  parameter n = {nodes}
  Sf push : i = {amperes} [A]*smoothstep5(time, 0 s, 1 ms)
  for a in 1..n {{ for b in 1..n {{
    0 node[a, b]
    C c[a, b] : u = q/(1 uF*(1 + 0.3*sin(a*1.7 + b)))
    R leak[a, b] : i = u/100 [kohm]
    node[a, b] -> c[a, b], leak[a, b]
  }} }}
  for a in 1..n {{ for b in 2..n {{
    R across[a, b] : i = u/(1 kohm*(1 + 0.5*cos(a + 2*b)))
    node[a, b-1] -> 1(across[a, b]) -> node[a, b]
  }} }}
  for a in 2..n {{ for b in 1..n {{
    R down[a, b] : i = 1e-6 [A]*(exp(u/0.05 [V]) - 1)
    node[a-1, b] -> 1(down[a, b]) -> node[a, b]
  }} }}
  push -> node[1, 1]
  output first = node[1, 1].u, last = node[n, n].u, corner = node[n, 1].u
  experiment go {{ simulate 0 .. 10 ms {{ points = 11 }} }}
}}
"""


NETWORKS = [
    *(chain(n, amperes) for n, amperes in itertools.product((3, 8), (1e-9, 1e-6, 1e-3))),
    chain(5, 1e-3, 1e-14),
    *(mesh(n, amperes) for n, amperes in itertools.product((2, 3), (1e-9, 1e-3))),
]
LARGE = [
    *(chain(n, amperes) for n, amperes in itertools.product((20, 40), (1e-9, 1e-6, 1e-3))),
    chain(5, 1.0),
    *(mesh(8, amperes) for amperes in (1e-9, 1e-3)),
]


@pytest.mark.few(6)
@pytest.mark.parametrize("text", [*NETWORKS, *(pytest.param(t, marks=pytest.mark.machine_code) for t in LARGE)])
def test_networks_of_diodes_from_rest_hold_their_tolerance(text: str) -> None:
    """All charges are zero at the start, and those behind the first diodes stay many decades below the others."""
    line = model(text)
    reference = line.simulate(rtol=1e-11)
    for rtol in (1e-4, 1e-6, 1e-9):
        result = line.simulate(rtol=rtol)
        assert not result.warnings and largest_error(result, reference) < 30 * rtol


@pytest.mark.machine_code
def test_a_chain_of_diodes_against_scipy() -> None:
    """The same equations by hand, integrated by scipy's Radau."""
    nodes, amperes = 20, 1e-3

    def rates(time: float, charges: Any) -> Any:
        volts = charges / 1e-6
        s = min(time / 1e-3, 1.0)
        through = 1e-6 * (np.exp((volts[:-1] - volts[1:]) / 0.05) - 1)
        into = -volts / 1e5
        into[0] += amperes * s**3 * (10 - 15 * s + 6 * s**2)
        into[:-1] -= through
        into[1:] += through
        return into

    result = model(chain(nodes, amperes)).simulate(rtol=1e-9)
    first = solve_ivp(rates, (0, 1e-3), np.zeros(nodes), "Radau", result.time[:2], rtol=1e-11, atol=1e-20)
    truth = solve_ivp(rates, (1e-3, 1e-2), first.y[:, -1], "Radau", result.time[1:], rtol=1e-11, atol=1e-20)
    volts = np.stack([result[f"u{a + 1}"][1:] for a in range(nodes)])
    assert np.abs(volts - truth.y / 1e-6).max() < 30e-9 * np.abs(truth.y).max() / 1e-6


# ---------------------------------------------------------------- names and order
def filter_of(names: list[str], order: list[int], declared: str = "") -> str:
    """A driven filter: coils, capacitors of many sizes and a diode each; elements by these names, declared in this order."""
    parts, joints = [], []
    for k in order:
        c, coil, diode, load = names[4 * k : 4 * k + 4]
        parts += [
            f"C {c} : u = q/({10.0 ** -(3 + k)} [F])",
            f"I {coil} : p = {10.0 ** (k - 6)} [H]*i",
            f"R {diode} : i = 1e-9 [A]*(exp(u/0.1 [V]) - 1)",
            f"R {load} : u = {10.0 ** (k - 1)} [ohm]*i",
        ]
        joints += [f"supply -> 1({coil}, {load}) -> 0({c}, {diode})"]
    return (
        f"model Filters {{\n{declared}\n"
        + "Se mains : u = 2 V*sin(300 [1/s]*time)\n0 supply\nmains -> supply\n"
        + "\n".join(parts + joints)
        + f"\noutput first = {names[0]}.u, second = {names[4]}.u, third = {names[8]}.u\n"
        + "experiment go { simulate 0 .. 20 ms { points = 21 } }\n}\n"
    )


PLAIN = [f"part_{k}" for k in range(12)]
NAMINGS = {
    "renamed": [f"{'zyxwvutsrqpo'[k]}{k}" for k in range(12)],
    "one array": [f"p[{k + 1}]" for k in range(12)],
    "one array backwards": [f"p[{12 - k}]" for k in range(12)],
    "one array mixed": [f"p[{(5 * k) % 12 + 1}]" for k in range(12)],
    "arrays by kind": [f"{'cldr'[k % 4]}[{k // 4 + 1}]" for k in range(12)],
    "arrays by branch": [f"b{k // 4}[{k % 4 + 1}]" for k in range(12)],
    "two indices": [f"e[{k // 4 + 1}, {k % 4 + 1}]" for k in range(12)],
}


@pytest.mark.machine_code
@pytest.mark.parametrize("naming", NAMINGS)
@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_names_and_arrays_change_no_bit(naming: str, rtol: float) -> None:
    """The name of an element, and its being an item of an array, change neither a step nor a number."""
    plain, other = (model(filter_of(names, [0, 1, 2])).simulate(rtol=rtol) for names in (PLAIN, NAMINGS[naming]))
    assert (plain.steps, plain.evaluations) == (other.steps, other.evaluations)
    assert np.array_equal(plain.values, other.values)


@pytest.mark.machine_code
@pytest.mark.parametrize("order", [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
@pytest.mark.parametrize("naming", ["one array", "arrays by branch"])
def test_the_order_of_declarations_changes_no_step(naming: str, order: list[int]) -> None:
    """Sums are taken in another order, which is rounding."""
    first, other = (model(filter_of(NAMINGS[naming], way)).simulate(rtol=1e-6) for way in ([0, 1, 2], order))
    assert first.steps == other.steps
    assert largest_error(first, other) < 1e-9


# ---------------------------------------------------------------- units of time
def oscillator(unit: float) -> str:
    """A hardening oscillator whose time has this unit: stiffness and charge as they are, inertia by its square."""
    return f"""model Swing {{
  C spring : F = 1 [N/m]*x + 1 [N/m^3]*x^3
  I mass : p = {unit**2!r} [kg]*v
  R damper : F = {0.1 * unit!r} [N*s/m]*v
  Se push : F = 0.3 N*cos(1.3*time/({unit!r} [s])) + 0.1 N
  push -> 1(spring, mass, damper)
  output x = spring.x
  experiment go {{ simulate 0 .. {30 * unit!r} s {{ points = 7 }} }}
}}
"""


def stiff(unit: float) -> str:
    """A stiff capacitor behind a resistor, and a diode."""
    return f"""model Stiff {{
  C slow : u = 1 [V/C]*q + 1 [V/C^3]*q^3 {{ start q = 1 C }}
  C fast : u = 1e5 [V/C]*q
  R lead : u = {unit!r} [ohm]*i
  R diode : i = (exp(u/1 [V]) - 1)*({1 / unit!r} [A])
  0 left
  0 right
  left -> slow
  left -> 1(lead) -> right
  right -> fast, diode
  output x = slow.u, y = fast.u
  experiment go {{ simulate 0 .. {20 * unit!r} s {{ points = 7 }} }}
}}
"""


@pytest.mark.few(4)
@pytest.mark.parametrize("solver", ["automatic", "radau", "rodas", "explicit"])
@pytest.mark.parametrize("made", [oscillator, stiff])
def test_nothing_is_absolute_in_time(made: Any, solver: str) -> None:
    """The same steps in seconds, hours and nanoseconds: units are powers of two, so that not even rounding differs."""
    if made is stiff and solver == "explicit":
        pytest.skip("some 800 000 steps")
    results = [model(made(2.0**k)).simulate(solver=solver) for k in (0, -40, -13, 13, 40)]
    for other in results[1:]:
        assert (other.steps, other.evaluations) == (results[0].steps, results[0].evaluations)
        np.testing.assert_allclose(other.values, results[0].values, rtol=1e-10, atol=1e-14)


@pytest.mark.machine_code
# ---------------------------------------------------------------- bare numbers
@pytest.mark.parametrize("size", [10.0**k for k in (-18, -15, -12, -9, -6, 0, 6, 12)])
def test_bare_numbers_may_be_small(size: float) -> None:
    """A number without unit is no angle: the tolerance of charges of 1e-15 in a `plain model` is relative to that, not to 1e-12."""
    text = f"""plain model Swing {{
  C spring : e = q/{size!r} + (q/{size!r})^3
  I mass : p = {size!r}*f
  R damper : e = 0.1/{size!r}*f
  Se push : e = 0.3*cos(1.3*time) + 0.1
  push -> 1(spring, mass, damper)
  output x = spring.q
  experiment go {{ simulate 0 .. 50 {{ points = 11 }} }}
}}
"""
    swing = model(text)
    reference = swing.simulate(rtol=1e-10)
    for rtol in (1e-4, 1e-6, 1e-8):
        assert largest_error(swing.simulate(rtol=rtol), reference) < 30 * rtol


# ---------------------------------------------------------------- what is not known
UNKNOWN = """model TwoParts {
  "The upper part cannot be followed beyond 10 ms; the lower one is moved only after that."
  Se early : F = 1 N*sqrt(10 ms - time)/sqrt(1 s)
  I first : p = 1 kg*v
  early -> 1(first)
  Se late : F = 1e-6 N*step(time - 0.5 s)
  C second : F = 1 [N/m]*x
  late -> 1(second, air)
  R air : F = 1 [N*s/m]*v
  output a = first.v, b = second.x
  experiment go { simulate 0 .. 1 s { points = 2 } }
}
"""


def test_an_unknown_magnitude_is_a_warning_and_small(tmp_path: Path) -> None:
    """It is in the result, in its file and in its JSON; no micrometre is compared with a metre."""
    running = Running(compiled(UNKNOWN))
    stretches = segments(running.program, running.constants, 0.0, 1.0)
    with np.errstate(all="ignore"):
        found = nominal_magnitudes(running.constraints, (), running.start, stretches)
    assert found.unknown == ("second.x",) and found.values[1] <= 1e-6 * 1e-6
    result = replace(model(chain(3, 1e-3)).simulate(), warnings=found.doubts)
    assert isinstance(result.warnings[0], ToleranceDoubt)
    assert result.to_json()["warnings"][0]["condition"] == "tolerance"
    result.to_npz(tmp_path / "r.npz")
    again = bondgraph.read_result(tmp_path / "r.npz")
    assert str(again.warnings[0]) == str(result.warnings[0]) and "`second.x`" in str(again.warnings[0])


# ---------------------------------------------------------------- rounding
MODELS = Path(__file__).resolve().parents[2] / "models"


@pytest.mark.machine_code  # thousands of steps
@pytest.mark.parametrize(("name", "most"), [("manipulator", 5000), ("feed_forward", 3000), ("six_axes", 3000)])
def test_tight_tolerances_do_not_follow_what_rounding_excites(name: str, most: int) -> None:
    """From 1e-9 to 1e-11 the steps of a method of order 5 grow 10^(2/5) to 10^(2/4) times; modes of a MHz would take 190 000."""
    loaded = bondgraph.load(MODELS / f"{name}.bg")
    loose, tight = (loaded.simulate(rtol=rtol, points=11) for rtol in (1e-9, 1e-11))
    assert tight.steps < most and tight.steps < 4 * loose.steps


@pytest.mark.machine_code  # thousands of steps
@pytest.mark.parametrize("name", ["manipulator", "feed_forward"])
def test_a_tolerance_below_rounding_is_told(name: str) -> None:
    """At 1e-12 rounding rings at a MHz: it took 240 000 steps, turn by turn. The tightest tolerance that is told needs no word and gives the same."""
    loaded = bondgraph.load(MODELS / f"{name}.bg")
    held, below = (loaded.simulate(rtol=rtol, points=11) for rtol in (1e-11, 1e-12))
    assert not held.warnings and below.steps < 40_000
    (warning,) = below.warnings
    assert isinstance(warning, ToleranceDoubt) and "rtol = 1e-12 is below what rounding leaves" in str(warning)
    for output in held.names:
        assert np.abs(held[output] - below[output]).max() < 30 * 1e-11 * np.abs(held[output]).max()


@pytest.mark.machine_code
@pytest.mark.parametrize("rtol", [1e-12, 1e-13])
@pytest.mark.parametrize(("name", "to", "solver"), [("manipulator", 2e-4, "explicit"), ("manipulator", 2e-4, "rodas"), ("feed_forward", None, "rodas")])  # fmt: skip
def test_every_method_tells_a_tolerance_below_rounding(name: str, to: float | None, solver: str, rtol: float) -> None:
    """DOP853 and Rodas5P followed rounding without a word: 236 000 steps of the manipulator, ten million of the other."""
    loaded = bondgraph.load(MODELS / f"{name}.bg")
    held, below = (loaded.simulate(rtol=r, points=11, to=to, solver=s) for r, s in ((1e-11, "radau"), (rtol, solver)))
    assert below.steps < 20_000
    (warning,) = below.warnings
    assert isinstance(warning, ToleranceDoubt) and "is below what rounding leaves" in str(warning)
    for output in held.names:
        assert np.abs(held[output] - below[output]).max() < 3e-8 * np.abs(held[output]).max()


@pytest.mark.parametrize("solver", ["radau", "rodas"])
@pytest.mark.parametrize(("volts", "start"), [(0.3, 0.0), (5.0, 0.0), (5.0, 0.7)])
def test_a_diode_over_very_many_time_constants(volts: float, start: float, solver: str) -> None:
    """A millionth of the run ahead of the start, where a first step is estimated, its exponential has no value."""
    text = f"""model Junction {{
  Se bias : u = {volts} V
  R lead : u = 1 ohm*i
  C store : q = 1 pF*u {{ start u = {start} V }}
  R diode : i = 1e-9*1 A*(exp(u/26 mV) - 1)
  bias -> 1(lead) -> 0(store, diode)
  output u = diode.u
}}"""
    found = model(text).simulate(to=1e-2, points=3, solver=solver, target="numpy")
    assert found["u"][0] == start and not found.warnings
    rest = brentq(lambda u: volts - u - 1e-9 * np.expm1(u / 0.026), 0.0, 2.0, xtol=1e-15)
    np.testing.assert_allclose(found["u"][1:], rest, rtol=1e-6)


def volume(stiffness: str, law: str, source: str) -> Model:
    return model(f"""plain model Volume {{
      C t : q = {stiffness}*e
      Sf s : f = {source}
      R o : {law}
      s -> 0(t, o)
      output q = o.f, e = t.e
    }}""")


@pytest.mark.parametrize("stiffness", ["1e-6", "1e-9"])
def test_a_mode_that_no_longer_holds_gives_no_magnitude(stiffness: str) -> None:
    """Before the orifice of a stiff volume opens, all that comes is stored: a step that long made a magnitude of it, beside which the volume is nothing."""
    found = volume(stiffness, "f = sign(e)*sqrt(abs(e))", "sin(time)").simulate(
        to=3, points=61, solver="radau", rtol=1e-4
    )
    assert np.abs(found["q"] - np.sin(found.time)).max() < 1e-4


# efforts at 0.25 s, 0.75 s and 2.75 s, of Radau IIA of order 3 in the flow as variable, by steps of its own
@pytest.mark.parametrize(
    ("stiffness", "law", "rtol", "solver", "efforts"),
    [
        ("1e-3", "e = f*abs(f)", 1e-4, "automatic", [0.55584958, 0.80462225, 1.39691716]),
        ("0.1", "f = sign(e)*sqrt(abs(e))", 1e-4, "radau13", [0.27819618, 1.32354036, 1.47078956]),
        ("1", "f = sign(e)*abs(e)^(1/3)", 1e-3, "radau", [0.04395659, 0.35471752, 0.29092075]),
        ("0.03", "f = e^(1/3) if e > 0 else 0", 1e-3, "radau13", [0.28402712, 1.58121554, -7.66724028]),
    ],
)
def test_a_triangle_through_zero_beside_a_root(
    stiffness: str, law: str, rtol: float, solver: str, efforts: list[float]
) -> None:
    """The root is infinitely steep at zero: corrections of 1e-20 counted as converged, and the flow stayed zero for a quarter of a period."""
    found = volume(stiffness, law, "asin(sin(3*time))").simulate(to=7, points=29, rtol=rtol, solver=solver)
    np.testing.assert_allclose(found["e"][[1, 3, 11]], efforts, atol=3 * rtol * np.abs(found["e"]).max())
    assert not found.warnings


@pytest.mark.parametrize(
    ("solver", "target"), [("radau", None), ("radau", "numpy"), ("radau13", None), ("rodas", None)]
)
def test_rates_that_steps_miss_are_told(solver: str, target: str | None) -> None:
    """As steep as a root of the fourth order, but for 1e-30: there is no root that could be an unknown, and the effort stayed at 1e-16."""
    orifice = volume("1", "f = e/(e^2 + 1e-60)^0.375", "sin(3*time)")
    found = orifice.simulate(to=2, points=3, rtol=1e-3, solver=solver, target=target).warnings
    (warning,) = [w for w in found if w.condition != "below its tolerance"]  # that is told of such an effort, too
    assert isinstance(warning, ToleranceDoubt) and "missed rates that would move `t.q`" in str(warning)


@pytest.mark.parametrize(
    ("stiffness", "share", "target"),
    [("1", "0.02", None), ("0.1", "0.02", None), ("1", "0.03", None), ("2", "0.02", None), ("1", "0.02", "numpy")],
)
def test_rates_that_steps_miss_beside_a_law_without_a_value_are_told(
    stiffness: str, share: str, target: str | None
) -> None:
    """A tolerance further the logarithm had no value, which was taken for rounding: the effort stayed at 1e-12 where it falls to -0.7."""
    valve = volume(stiffness, f"f = {share}*log(1 + e/1e-30) if e > 0 else 0", "sin(3*time)")
    found = valve.simulate(to=3, points=4, rtol=1e-3, target=target)
    assert found["e"].min() < -0.2 or any("missed rates that would move `t.q`" in str(w) for w in found.warnings)


@pytest.mark.parametrize("rate", [1.0, 1e-2, 1e-4, 1e-6, 1e-9, 1e-13])
def test_what_only_rounding_restores_goes_no_farther_than_a_run_lets_it(rate: float) -> None:
    """The angle of a wheel had a magnitude of 1e15 rad, and all angles beside it tolerances of 1e5 rad, by an eigenvalue that was rounding."""
    moving = free_response(np.array([[0.0, 1.0], [0.0, -rate]]), False, 10.0)
    if moving is not None:  # modes that are told apart
        assert moving(np.array([0.0, 1.0]))[0] <= 10 * 1e2
    away = free_response(np.diag([-rate, -1.0]), False, 10.0).rest(np.ones(2), 10.0)
    assert np.isfinite(away).all() == (rate > 1e-3)


@pytest.mark.parametrize(
    ("law", "share"),
    [
        ("f = {0}*sign(e)*sqrt(abs(e))", 1 / 5),
        ("e = {0}^(-2)*f*abs(f)", 1 / 5),
        ("f = {0}*sign(e)*abs(e)^(1/3)", 1 / 9),
    ],
)
def test_two_laws_of_infinite_slope_in_a_row_from_rest(law: str, share: float) -> None:
    """Where nothing flows Newton's method goes far away: a pilot run that took its first iterate gave the flow a magnitude of 1e18, and the run an effort of 1e22."""
    text = f"""plain model Row {{
  signal p = integral(1e5*cos(time), 0)
  MSe source : e = p
  R a : {law.format("1e-6")}
  R b : {law.format("2e-6")}
  0 node
  source -> 1(a) -> node -> b
  output between = b.e
}}"""
    result = bondgraph.load(text).simulate(to=10, points=21)
    assert result["between"] == pytest.approx(1e5 * share * np.sin(result.time), abs=2)
