"""Claims that a loop has one solution at most: made for monotone laws in structures that conserve power, and never where a search finds two."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import root

import bondgraph
from compiler.certificate import LoopSummary
from tests.graphs.test_several_solutions import CIRCUIT, TUNNEL
from tests.simulation.test_monotone_loops import SMOOTH, _network

# Currents of resistors over their voltages, as text and as functions.
RISING: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "linear": ("0.5 S*u", lambda u: 0.5 * u),
    "cubic": ("0.1 [A/V^3]*u^3", lambda u: 0.1 * u**3),
    "tanh": ("2 A*tanh(u/0.3 V) + 0.01 S*u", lambda u: 2 * np.tanh(u / 0.3) + 0.01 * u),
    "sinh": ("0.1 A*sinh(u/1 V)", lambda u: 0.1 * np.sinh(np.clip(u, -30, 30))),
    "diode": ("1e-3 A*(exp(u/0.5 V) - 1)", lambda u: 1e-3 * np.expm1(np.clip(u / 0.5, -200, 60))),
    "corner": ("1 S*max(u - 1 V, 0 V) + 0.1 S*u", lambda u: np.maximum(u - 1, 0) + 0.1 * u),
    "square": ("0.2 [A/V^2]*u*abs(u)", lambda u: 0.2 * u * abs(u)),
    "arc": ("1 A*atan(u/1 V) + 0.2 A*asinh(u/1 V)", lambda u: np.arctan(u) + 0.2 * np.arcsinh(u)),
}
OTHERS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "tunnel": ("9 S*u - 6 [A/V^2]*u^2 + 1 [A/V^3]*u^3", lambda u: 9 * u - 6 * u**2 + u**3),
    "hump": ("4 A*(u/1 V)*exp(-u/1 V) + 0.01 S*u", lambda u: 4 * u * np.exp(np.clip(-u, -50, 50)) + 0.01 * u),
    "wave": ("1 A*sin(3*u/1 V) + 0.3 S*u", lambda u: np.sin(3 * u) + 0.3 * u),
    "flat": ("1 S*max(u, 0 V)", lambda u: np.maximum(u, 0)),
    "negative": ("-0.2 S*u + 0.05 [A/V^3]*u^3", lambda u: -0.2 * u + 0.05 * u**3),
}
ALL = RISING | OTHERS


def loops(text: str) -> tuple[LoopSummary, ...]:
    return bondgraph.load(text).certificate.loops


def ladder(kinds: list[str], volt: float) -> tuple[str, Callable[[Any], Any]]:
    """A source, and a chain of series and shunt elements in turn; the residual currents of its nodes."""
    nodes = len(kinds) // 2
    lines = [
        f"model L {{\n  Se source : u = {volt} V",
        *(f"  0 n{k} : electric" for k in range(nodes + 1)),
        "  source -> n0",
    ]
    for k, kind in enumerate(kinds):
        lines.append(f"  R e{k} : i = {ALL[kind][0]}")
        lines.append(f"  n{k // 2} -> 1(e{k}) -> n{k // 2 + 1}" if k % 2 == 0 else f"  n{k // 2 + 1} -> e{k}")
    lines.append(f"  output {', '.join(f'u{k} = e{2 * k + 1}.u' for k in range(nodes))}\n}}")

    def residual(u: Any) -> Any:
        whole = np.concatenate([[volt], u])
        series = [ALL[kinds[2 * k]][1](whole[k] - whole[k + 1]) for k in range(nodes)]
        shunt = [ALL[kinds[2 * k + 1]][1](whole[k + 1]) for k in range(nodes)]
        return np.array([series[k] - shunt[k] - (series[k + 1] if k + 1 < nodes else 0.0) for k in range(nodes)])

    return "\n".join(lines), residual


def solutions(residual: Callable[[Any], Any], count: int, volt: float, random: np.random.Generator) -> list[Any]:
    """Distinct solutions that a search from many starts finds."""
    found: list[Any] = []
    for _ in range(40):
        result = root(residual, random.uniform(-1, 1.2, count) * max(volt, 3.0), tol=1e-13)
        if np.abs(residual(result.x)).max() < 1e-9 and all(np.abs(result.x - x).max() > 1e-4 for x in found):
            found.append(result.x)
    return found


@pytest.mark.parametrize("seed", range(40))
def test_ladders(seed: int) -> None:
    """Claimed for rising laws alone; then forty starts lead to one solution."""
    random = np.random.default_rng(seed)
    names = [*RISING] if seed % 2 else [*ALL]
    kinds = [str(random.choice(names)) for _ in range(2 * int(random.integers(1, 4)))]
    volt = float(random.uniform(0.5, 6.0))
    text, residual = ladder(kinds, volt)
    for loop in loops(text):
        own = {kinds[int(m[1:])] for m in loop.members if m[1:].isdigit() and m.startswith("e")}
        assert loop.unique == own.issubset(RISING), (loop, kinds)
    if set(kinds) <= set(RISING):
        assert len(solutions(residual, len(kinds) // 2, volt, random)) == 1


def test_the_search_finds_several() -> None:
    """What the claims are tested by does find second solutions, and of such circuits nothing is claimed."""
    several = 0
    for seed in range(30):
        random = np.random.default_rng(1000 + seed)
        kinds = ["linear", str(random.choice(["tunnel", "wave", "hump"])), "linear", str(random.choice([*ALL]))]
        text, residual = ladder(kinds, float(random.uniform(2.0, 6.0)))
        if len(solutions(residual, 2, 6.0, random)) > 1:
            several += 1
            assert not any(loop.unique for loop in loops(text))
    assert several >= 5


@pytest.mark.parametrize("seed", range(30))
def test_random_networks(seed: int) -> None:
    """Connected networks of up to 16 nodes, with laws in either form: all of them monotone."""
    assert all(loop.unique for loop in loops(_network(seed, SMOOTH)[0]))


TWO_PORTS = """model T {{
  parameter n = {n}, r: V/A = {r}, g: A = 1e-3
  Se source : u = 3 V
  R inner : u = r*i
  R diode : i = g*(exp(u/0.1 V) - 1)
  R shunt : i = 0.1 A*sinh(u/1 V)
  {two}
  0 node : electric
  source -> 1(inner, first) -> two
  two -> node -> diode, shunt
  output u = diode.u
}}
""".replace("source -> 1(inner, first)", "R first : u = 1 ohm*i + 1 [V/A^3]*i^3\n  source -> 1(inner, first)")


@pytest.mark.parametrize("n", [0.3, -2.0, 1.0, 7.1])
@pytest.mark.parametrize("two", ["TF two : u1 = n*u2", "GY two : u1 = n*1 ohm*i2", "TF two : u2 = u1/n"])
def test_transformers_and_gyrators(two: str, n: float) -> None:
    """Any ratio, as it conserves power; a resistance of the other sign ends the claim."""
    assert [loop.unique for loop in loops(TWO_PORTS.format(two=two, n=n, r=0.2))] == [True]
    assert [loop.unique for loop in loops(TWO_PORTS.format(two=two, n=n, r=-0.2))] == [False]
    model = bondgraph.load(TWO_PORTS.format(two=two, n=n, r=0.2))
    for settings, unique in (({}, True), ({"r": -1e-6}, False)):  # of what a run sets the sign is not known
        run = model.simulate(to="1 s", points=2, settings=settings)
        assert [loop.unique for loop in run.certificate.loops] == [unique]


@pytest.mark.parametrize(
    ("extra", "unique"),
    [
        ("", True),
        ("MSe amplifier : u = 3*shunt.u", False),  # power from outside, by a signal of the loop
        ("Se drift : u = 1 V*time/1 s", True),  # a signal of time
        ("MR rest : u = (1 ohm + 1 [ohm/V]*abs(shunt.u))*i", False),
    ],
)
def test_signals(extra: str, unique: bool) -> None:
    name = extra.split()[1] if extra else ""
    joined = f"{name} -> line" if " amplifier" in extra or " drift" in extra else f"line -> {name}" if extra else ""
    text = f"""model S {{
      Se source : u = 2 V
      R series : u = 2 ohm*i + 1 [V/A^3]*i^3
      R shunt : i = 0.1 A*sinh(u/1 V)
      {extra}
      1 line : electric
      source -> line -> series
      line -> shunt
      {joined}
      output u = shunt.u
    }}"""
    assert {loop.unique for loop in loops(text)} == {unique}


def test_states_and_coefficients() -> None:
    """A coefficient that a state gives has no known sign; one that is positive throughout has."""
    text = """model S {{
      Se source : u = 2 V
      C store : u = q/1 F
      MR series : u = {}*(1 ohm*i + 1 [V/A^3]*i^3)
      R shunt : i = 0.1 A*sinh(u/1 V)
      source -> 1(series) -> 0(shunt, 1(lead, store))
      R lead : u = 1 ohm*i
      output u = shunt.u
    }}"""
    assert [x.unique for x in loops(text.format("store.u/1 V"))] == [False]
    assert [x.unique for x in loops(text.format("exp(store.u/1 V)"))] == [True]


def test_linear_loops() -> None:
    text = """model B {{
      Se s : u = 6 V
      0 top, a, b : electric
      R r1 : u = 10 ohm*i
      R r2 : u = 20 ohm*i
      R r3 : u = {} ohm*i
      R r4 : u = 60 ohm*i
      R gauge : u = 7 ohm*i
      s -> top
      top -> 1(r1) -> a -> r2
      top -> 1(r3) -> b -> r4
      a -> 1(gauge) -> b
      output i = gauge.i
    }}"""
    assert [(x.linear, x.unique) for x in loops(text.format(30))] == [(True, True)]
    assert [(x.linear, x.unique) for x in loops(text.format(-30))] == [(True, False)]


def test_words_and_data() -> None:
    monotone = bondgraph.load(CIRCUIT.format(4, "R tunnel : i = 9 S*u + 1 [A/V^3]*u^3", "tunnel")).certificate
    tunnel = bondgraph.load(CIRCUIT.format(4, TUNNEL, "tunnel")).certificate
    assert "(one solution at most, as its laws are monotone) through: " in str(monotone)
    assert "(not known whether it has one solution only) through: " in str(tunnel)
    told = [json.loads(json.dumps(c.to_json()))["loops"][0]["unique"] for c in (monotone, tunnel)]
    assert told == [True, None]
