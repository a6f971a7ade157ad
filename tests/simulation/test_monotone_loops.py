"""Loops of monotone laws are solved from anywhere: random resistive networks, bridges of diodes, laws in either form."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.optimize import brentq

import bondgraph
from bondgraph.simulation.loops.waves import _arguments

Law = Callable[[float, float], tuple[float, float]]  # voltage, current -> what the law lacks, the size of its terms


SMOOTH = ("linear", "linear", "diode", "logarithm", "cubic", "tanh", "sinh")
BENT = ("corner", "rectifier", "two sides", "other sides", "saturation")


def _element(number: int, random: np.random.Generator, kinds: Sequence[str]) -> tuple[str, Law]:
    """A resistive element as text, and its law."""
    kind = str(random.choice(kinds))
    g = float(10.0 ** random.uniform(-4, 0))
    saturation, thermal = float(10.0 ** random.uniform(-14, -6)), float(random.choice([0.0258, 0.05]))

    def diode(u: float, i: float) -> tuple[float, float]:
        return i - saturation * math.expm1(u / thermal), abs(i) * (1 + abs(u) / thermal) + saturation

    if kind in BENT:
        return _bent(number, kind, g, float(10.0 ** random.uniform(-1, 3)), float(10.0 ** random.uniform(-3, 0)))
    if kind == "linear":
        return f"R e{number} : u = {1 / g!r} [ohm]*i", lambda u, i: (u - i / g, abs(u) + abs(i / g))
    if kind == "diode":
        return f"R e{number} : i = {saturation!r} [A]*(exp(u/{thermal} [V]) - 1)", diode
    if kind == "logarithm":
        return f"R e{number} : u = {thermal} [V]*log(i/{saturation!r} [A] + 1)", diode
    if kind == "cubic":
        return f"R e{number} : i = {g!r} [A/V]*u + {g!r} [A/V^3]*u^3", lambda u, i: (
            i - g * u - g * u**3,
            abs(i) + g * abs(u) + 3 * g * abs(u) ** 3,
        )
    if kind == "tanh":
        law = f"i = {g!r} [A]*tanh(u/0.1 [V]) + {1e-3 * g!r} [A/V]*u"
        return f"R e{number} : {law}", lambda u, i: (
            i - g * math.tanh(u / 0.1) - 1e-3 * g * u,
            abs(i) + g * (1 + abs(u)),
        )
    return f"R e{number} : i = 1e-6 [A]*sinh(u/0.2 [V])", lambda u, i: (
        i - 1e-6 * math.sinh(u / 0.2),
        (abs(i) + 1e-6) * (1 + abs(u) / 0.2),
    )


def _bent(number: int, kind: str, g: float, at: float, part: float) -> tuple[str, Law]:
    """A law of straight pieces that meet, as text, and as what it lacks."""
    texts: dict[str, tuple[str, Callable[[float], float]]] = {
        "corner": (f"i = {g!r} [A/V]*max(u - {at!r} [V], 0 [V]) + {part * g!r} [A/V]*u", lambda u: g * max(u - at, 0) + part * g * u),
        "rectifier": (f"u = {1 / g!r} [ohm]*i + {0.9 / g!r} [ohm]*abs(i)", lambda i: (i + 0.9 * abs(i)) / g),
        "two sides": (f"u = ({1 / g!r} [ohm]*i if i > 0 [A] else {part / g!r} [ohm]*i)", lambda i: i / g if i > 0 else part / g * i),
        "other sides": (f"i = ({g!r} [A/V]*u if u < {at!r} [V] else {part * g!r} [A/V]*u + {(1 - part) * g * at!r} [A])",
                        lambda u: g * u if u < at else part * g * u + (1 - part) * g * at),
        "saturation": (f"i = {g!r} [A/V]*min(max(u, -{at!r} [V]), {at!r} [V]) + {1e-4 * g!r} [A/V]*u",
                       lambda u: g * min(max(u, -at), at) + 1e-4 * g * u),
    }  # fmt: skip
    text, law = texts[kind]

    def lacks(u: float, i: float) -> tuple[float, float]:
        argument, value = (u, i) if text.startswith("i") else (i, u)
        steepest = (2 * g) if text.startswith("i") else 2 / g
        return value - law(argument), abs(value) + steepest * (
            abs(argument) + (at if kind != "rectifier" else 0) * 1e-3
        )

    return f"R e{number} : {text}", lacks


def _network(seed: int, kinds: Sequence[str] = SMOOTH) -> tuple[str, list[Law], list[tuple[int, int]], int]:
    """A connected network of up to 16 nodes with one source, its laws, where its elements lie, and the node of the source."""
    random = np.random.default_rng(seed)
    nodes = int(random.integers(2, 16))
    lines = [f"model N{seed} {{", " Se earth : u = 0", *(f" 0 n{k} : electric" for k in range(nodes)), " earth -> n0"]
    volt, inner, at = 10.0 ** random.uniform(-2, 4), 10.0 ** random.uniform(-1, 4), int(random.integers(1, nodes))
    lines += [
        f" Se source : u = {float(volt)!r} [V]*sin(2*pi*time/1 [s] + 0.3)",
        f" R inner : u = {float(inner)!r} [ohm]*i",
    ]
    lines += [f" source -> 1(inner) -> n{at}"]
    edges = [(int(random.integers(0, k)), k) for k in range(1, nodes)]
    edges += [
        tuple(map(int, random.choice(nodes, 2, replace=False))) for _ in range(int(random.integers(1, nodes + 1)))
    ]  # type: ignore[misc]
    edges = [(b, a) if random.random() < 0.5 else (a, b) for a, b in edges]
    laws = []
    for k, (a, b) in enumerate(edges):
        text, law = _element(k, random, kinds)
        lines += [" " + text, f" n{a} -> 1(e{k}) -> n{b}"]
        laws.append(law)
    read = ", ".join(f"u{k} = e{k}.u, i{k} = e{k}.i" for k in range(len(edges)))
    lines += [f" output fed = inner.i, {read}", " experiment go { simulate 0 .. 1 s { points = 5 } }", "}"]
    return "\n".join(lines), laws, edges, at


BENT_SEEDS = (1, 5, 6, 8, 11, 22)


@pytest.mark.few(4)
@pytest.mark.machine_code
@pytest.mark.parametrize("seed", [4, 8, 15, 18, 19, 36, 39, 53, 60, 63, 127])
def test_a_random_network_fulfils_its_laws_and_balances(seed: int) -> None:
    """If Newton's method from the last instant fails, the loop is solved from afar; the equations themselves are the witness."""
    text, laws, edges, at = _network(seed)
    _is_solved(bondgraph.load(text).simulate(), laws, edges, at)


@pytest.mark.machine_code
@pytest.mark.parametrize("seed", BENT_SEEDS)
def test_a_random_network_with_laws_of_pieces_fulfils_its_laws_and_balances(seed: int) -> None:
    """Without states, the sides of an `if` change where their condition does, and each reported instant has the side that holds there."""
    text, laws, edges, at = _network(seed, (*SMOOTH, *BENT))
    _is_solved(bondgraph.load(text).simulate(), laws, edges, at)


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", [8, 36])
@pytest.mark.parametrize("more", ["when", "switch", "every"])
def test_events_leave_a_network_as_it_is(seed: int, more: str) -> None:
    """The opened loops know what only events change, and conditions on time; conditions on states are looked at where they are."""
    text, laws, edges, at = _network(seed)
    if more == "switch":
        text = text.replace(
            " source -> 1(inner) ->",
            " 1 feed : electric { active = closed > 0.5 }\n mode closed = 0\n when time > 0.1 s { closed = 1 }\n feed -> inner\n source -> feed ->",
        )
    else:
        event = "when time > 0.6 s { n = n + 1 }" if more == "when" else "every 0.3 s { n = n + 1 }"
        text = text.replace(" output", f" mode n = 0\n {event}\n output", 1)
    _is_solved(bondgraph.load(text).simulate(), laws, edges, at)


def _is_solved(result: bondgraph.Result, laws: list[Law], edges: list[tuple[int, int]], at: int) -> None:
    for j in range(5):
        fed = result["fed"][j]
        balance = np.zeros(1 + max(max(e) for e in edges))
        balance[at] = fed
        largest = abs(fed)
        rounding = 1e-14 * max(
            abs(result[f"u{k}"][j]) for k in range(len(laws))
        )  # of currents by conductances of up to 1 S
        for k, (law, (a, b)) in enumerate(zip(laws, edges, strict=True)):
            u, i = result[f"u{k}"][j], result[f"i{k}"][j]
            lacks, size = law(u, i)
            balance[a] -= i
            balance[b] += i
            largest = max(largest, abs(i))
            assert abs(lacks) <= 1e-7 * size + rounding, (k, u, i)
        assert np.abs(balance[1:]).max() <= 1e-11 * largest + rounding  # at all nodes but ground


BRIDGE = """
model Bridge {{
  parameter I_s = {saturation} [A], U_T = {thermal} [V]
  Se s : u = {volt} [V]*sin(2*pi*50 Hz*time)
  Se gnd : u = 0
  R rs : u = {inner} [ohm]*i
  R load : u = {load} [ohm]*i
  for k in 1..4 {{ R d[k] : {law} }}
  0 a
  0 b : electric
  0 p
  0 m
  s -> 1(rs) -> a
  gnd -> b
  a -> 1(d[1]) -> p
  b -> 1(d[2]) -> p
  m -> 1(d[3]) -> a
  m -> 1(d[4]) -> b
  p -> 1(load) -> m
  {more}
  output u = load.u, i = rs.i
  experiment go {{ simulate 0 .. 20 ms {{ points = 41 }} }}
}}
"""
LAWS = ("i = I_s*(exp(u/U_T) - 1)", "u = U_T*log(i/I_s + 1)")


@pytest.mark.few(5)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("volt", "saturation", "thermal", "inner", "load"),
    [
        (10, 1e-9, 0.05, 1, 100),
        (1, 1e-12, 0.0258, 1, 1e4),
        (325, 1e-14, 0.0258, 0.1, 50),
        (3000, 1e-9, 0.05, 10, 1e3),
        (0.2, 1e-6, 0.03, 5, 1e3),
    ],
)
def test_a_bridge_of_diodes_feeds_its_load(
    volt: float, saturation: float, thermal: float, inner: float, load: float, law: str
) -> None:
    """Two diodes conduct in series with source and load, two block; by symmetry each of the latter bears what the load and one diode do."""
    text = BRIDGE.format(volt=volt, saturation=saturation, thermal=thermal, inner=inner, load=load, law=law, more="")
    result = bondgraph.load(text).simulate()
    for t, u, i in zip(result.time, result["u"], result["i"], strict=True):
        source = abs(volt * math.sin(2 * math.pi * 50 * t))

        def lack(x: float, source: float = source) -> float:
            """Of the source, with the current x of the conducting diodes: blocking ones carry back what they let through."""
            forward = thermal * math.log1p(x / saturation)
            # Load current: that of a conducting diode and of a blocking one of the same node.
            blocked = brentq(
                lambda y: y - saturation * math.expm1(-((x + y) * load + forward) / thermal), -saturation, 0, xtol=1e-30
            )
            return source - 2 * forward - (x + blocked) * load - (x - blocked) * inner

        top = (source + 1e-12) / load
        current = brentq(lack, 0, max(top, 1e-15), xtol=1e-18, rtol=1e-14) if source > 1e-9 else 0.0
        forward = thermal * math.log1p(current / saturation)
        blocked = saturation * math.expm1(-(current * load + forward) / thermal) if source > 1e-9 else 0.0
        assert u == pytest.approx((current + blocked) * load, rel=1e-6, abs=2 * saturation * load + 1e-9 * volt)
        assert abs(i) == pytest.approx(current - blocked, rel=1e-6, abs=2 * saturation + 1e-9 * volt / load)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_a_bridge_with_a_capacitor_charges_it(target: str) -> None:
    """While all diodes block, leakage alone decides the potential of the output; the capacitor's voltage does not depend on it."""
    more = "C cap : u = q/(100 uF)\n  p -> 1(cap) -> m"
    text = BRIDGE.format(volt=10, saturation=1e-9, thermal=0.05, inner=1, load=100, law=LAWS[0], more=more)
    result = bondgraph.load(text).simulate(target=target)
    assert result["u"].max() == pytest.approx(_charged(), rel=2e-6)


def _charged() -> float:
    """The highest voltage of the capacitor, by equations of one pair of diodes that conduct and one that blocks, in small steps (Heun)."""
    from scipy.integrate import solve_ivp

    def rate(t: float, x: np.ndarray) -> list[float]:
        source, u = abs(10 * math.sin(2 * math.pi * 50 * t)), float(x[0])
        drive = source - u
        # i through source, inner resistance and two diodes; what the blocking ones let through is below 1e-9 A.
        current = brentq(lambda i: drive - i - 0.1 * math.log1p(i / 1e-9), 0, 10, xtol=1e-20) if drive > 0 else 0.0
        return [(current - u / 100) / 100e-6]

    found = solve_ivp(rate, (0, 0.02), [0.0], rtol=1e-9, atol=1e-10, method="LSODA", dense_output=True, max_step=2e-5)
    at = np.linspace(0, 0.02, 41)
    return float(found.sol(at)[0].max())


@pytest.mark.parametrize("near", [0.0, -1.0, 0.5, 1e-3])
@pytest.mark.parametrize("wave", [0.0, 1.0, -2.0])
def test_a_wave_at_which_one_law_is_met_exactly(near: float, wave: float) -> None:
    """The other laws are solved all the same: 2 a and a + sinh(a) are waves, from one place."""
    waves = np.array([wave, wave + 0.3])
    with np.errstate(all="ignore"):
        found = _arguments(lambda a: np.array([a[0], np.sinh(a[1])]), waves, np.ones(2), np.full(2, near))
    np.testing.assert_allclose(found + np.array([found[0], math.sinh(found[1])]), waves, rtol=1e-14, atol=1e-290)


FLOATING = """model Bridge {{
  parameter I_s = 1e-12 A, U_T = 25.852 mV, I_1 = I_s, I_2 = I_s, I_3 = 1e-12 A, I_4 = 1e-12 A
  Se s : u = 10 V*sin(2*pi*50 Hz*time + 0.1)
  Se gnd : u = 0
  R rs : u = 1 ohm*i
  R load : u = 100 ohm*i
  C cap : q = 100 uF*u
  {}
  0 a, b : electric
  0 p, m
  s -> 1(rs) -> a
  gnd -> b
  a -> 1(d1) -> p
  b -> 1(d2) -> p
  m -> 1(d3) -> a
  m -> 1(d4) -> b
  p -> 1(load) -> m
  p -> 1(cap) -> m
  output u = cap.u, across = d1.u, before = a.u
}}
"""


def floating(law: str, rtol: float) -> bondgraph.Result:
    text = FLOATING.format("\n  ".join(f"R d{k} : i = {law.format(k)}" for k in range(1, 5)))
    return bondgraph.load(text).simulate(to=0.04, points=101, rtol=rtol)


@pytest.mark.parametrize(
    "law",
    [
        "1e-12 A*(exp(u/25.852 mV) - 1)",
        pytest.param(
            "I_s*(exp(u/U_T) - 1)", marks=pytest.mark.machine_code
        ),  # one of the forms shows the steps without
        pytest.param("I_s*exp(u/U_T) - I_s", marks=pytest.mark.machine_code),
    ],
)
def test_rails_float_where_no_digit_of_a_current_shows(law: str) -> None:
    """Of four equal diodes that block each has half of what the source leaves beside the capacitor: e^(a - p) + e^(-p) = e^(m - a) + e^m."""
    run = floating(law, 1e-6)
    assert run["across"] == pytest.approx((run["before"] - run["u"]) / 2, abs=1e-12)
    assert run["across"].min() < -5 and not run.warnings


@pytest.mark.machine_code
def test_what_the_equations_leave_open_is_told() -> None:
    """Constants of different names do not cancel: their rounding hides what is left. A leak beside each diode decides."""
    (warning,) = floating("I_{}*(exp(u/U_T) - 1)", 1e-7).warnings
    assert "the equations do not determine `across` in double precision" in str(warning)
    assert not floating("I_{}*(exp(u/U_T) - 1) + 1e-9 S*u", 1e-7).warnings
