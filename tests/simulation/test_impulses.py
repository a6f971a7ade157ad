"""Impulses of storages with curved laws: what passes is what each storage gains, and integrals take it or refuse it by name."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import bondgraph

TIED = """plain model Tied {
  parameter a1 = 1, a3 = 0, a2 = 0, q_a = 1, b1 = 1, b3 = 0, b2 = 0, q_b = 0
  C a : e = a1*q + a3*q^3 + a2*(exp(q) - 1) { start q = q_a }
  C b : e = b1*q + b3*q^3 + b2*(exp(q) - 1) { start q = q_b }
  R leak : f = 1e-12*e
  1 tie
  0 gap { active = time < 1 }
  0 n
  n -> a, leak
  n -> tie -> b
  tie -> gap
  signal moved = integral(tie.f, 0)
  output through = moved, weighted = integral(2*time*b.f, 1), rest = integral(sin(moved), 0)
  EXTRA
}"""
DUAL = (
    TIED.replace("C a : e", "I a : f").replace("C b : e", "I b : f").replace("q", "p").replace("0 gap", "1 gap")
    .replace("1 tie", "0 tie").replace("0 n", "1 n").replace("tie.f", "tie.e").replace("b.f", "b.e")
    .replace("R leak : f = 1e-12*e", "R leak : e = 1e-12*f")
)  # fmt: skip


@cache
def model(text: str) -> bondgraph.Model:
    return bondgraph.load(text)


@pytest.mark.few(6)
@pytest.mark.parametrize("text", [TIED, DUAL], ids=["charge", "momentum"])
@pytest.mark.parametrize("seed", range(10))
def test_integrals_take_the_impulse_of_curved_storages(text: str, seed: int) -> None:
    """The charge that passes is where both laws agree, found by bisection; signals that do not grow with the current take none of it."""
    numbers = np.random.default_rng(seed)
    values = dict(zip(("a1", "a3", "a2", "b1", "b3", "b2"), numbers.uniform(0.1, 3, 6).tolist(), strict=True))
    q_a, q_b = numbers.uniform(-2, 2, 2).tolist()
    letter = "q" if text is TIED else "p"
    found = model(text.replace("EXTRA", "")).simulate(
        settings={**values, f"{letter}_a": q_a, f"{letter}_b": q_b}, to=2, points=3, rtol=1e-9
    )

    def law(side: str, q: float) -> float:
        return float(values[side + "1"] * q + values[side + "3"] * q**3 + values[side + "2"] * (np.exp(q) - 1))

    charge = brentq(lambda d: law("a", q_a - d) - law("b", q_b + d), -8, 8, xtol=1e-14)
    close = {"rtol": 1e-7, "atol": 1e-7}
    np.testing.assert_allclose(found["through"], [0, charge, charge], **close)
    np.testing.assert_allclose(found["weighted"], [1, 1 + 2 * charge, 1 + 2 * charge], **close)
    np.testing.assert_allclose(found["rest"][-1], np.sin(charge), rtol=1e-6, atol=1e-7)


PLATES = """plain model Plates {
  parameter s_1 = 1, s_2 = 0.5
  C pair(a, b) : energy = a.q^2/2 + 0.3*a.q*b.q + b.q^2 + 0.1*a.q^4 + 0.2*b.q^4 { start a.q = s_1 }
  C c : e = q + q^3 { start q = s_2 }
  R leak : f = 1e-12*e
  1 tie
  0 gap { active = time < 1 }
  0 n
  n -> pair.a, leak
  n -> tie -> c
  tie -> gap
  Sf none : f = 0
  none -> pair.b
  output through = integral(tie.f, 0), q_c = c.q
}"""


@pytest.mark.parametrize("seed", range(3))
def test_integrals_take_the_impulse_of_a_field(seed: int) -> None:
    s_1, s_2 = np.random.default_rng(seed).uniform(-1, 1, 2).tolist()
    found = model(PLATES).simulate(settings={"s_1": s_1, "s_2": s_2}, to=2, points=3, rtol=1e-9)
    charge = brentq(lambda d: (s_1 - d) + 0.4 * (s_1 - d) ** 3 - (s_2 + d) - (s_2 + d) ** 3, -5, 5, xtol=1e-14)
    np.testing.assert_allclose(found["through"][1:], charge, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found["q_c"][1:], s_2 + charge, rtol=1e-8, atol=1e-8)


CHAIN = """plain model Chain {
  parameter p_1 = 2
  I one : f = p + 0.2*p^3 { start p = p_1 }
  I two : f = 2*p
  I three : f = p + 0.1*p^3
  1 x, y, z
  TF lever : f1 = 3*f2
  0 w { active = time > 1 }
  x -> one
  x -> w -> y
  y -> two
  y -> lever -> z
  z -> three
  output push = integral(w.e, 0), turn = integral(three.e, 0)
}"""


@pytest.mark.parametrize("start", [-3.0, -1.0, 0.5, 2.0])
def test_integrals_take_the_impulse_of_a_lever(start: float) -> None:
    """Three inertias, one behind a lever: momentum is weighed with the ratio."""
    found = model(CHAIN).simulate(settings={"p_1": start}, to=2, points=3, rtol=1e-9)

    def rest(unknown: np.ndarray) -> list[float]:
        push, turn = unknown
        p_1, p_2 = start - push, push - turn / 3
        v = p_1 + 0.2 * p_1**3
        return [2 * p_2 - v, turn + 0.1 * turn**3 - v / 3]

    push, turn = fsolve(rest, [0.3 * start, 0.2 * start], xtol=1e-13)
    np.testing.assert_allclose(found["push"][1:], push, rtol=1e-7)
    np.testing.assert_allclose(found["turn"][1:], turn, rtol=1e-7)


@pytest.mark.parametrize(
    "rate",
    ["b.e*b.f", "a.e*tie.f", "b.q*tie.f", "moved*tie.f", "b.f*abs(a.e)", "(1 + a.q^2)*tie.f", "a.e*a.f", "b.f^2"],
)
def test_an_impulse_times_what_jumps_is_refused(rate: str) -> None:
    text = TIED.replace("EXTRA", f"signal work = integral({rate}, 0)\n  output w = work")
    with pytest.raises(
        bondgraph.RunFailed, match="at t = 1 s an impulse passes, and what `work` integrates has no integral"
    ):
        bondgraph.load(text).simulate(to=2, points=3, target="numpy")


@pytest.mark.parametrize(("rate", "share"), [("source.e*source.f", 2.5), ("x*source.f", 0.5), ("time*source.f", 1.0)])
def test_an_impulse_times_what_does_not_jump(rate: str, share: float) -> None:
    """Work of a source that charges a capacitor at once; a ramp and a time beside it."""
    text = f"""plain model Source {{
  Se source : e = 2.5
  C c : e = q + q^3
  1 tie
  0 gap {{ active = time < 1 }}
  signal x = integral(0.5 + 0*time, 0)
  source -> tie -> c, gap
  output w = integral({rate}, 0), q = c.q
}}"""
    found = bondgraph.load(text).simulate(to=2, points=3, rtol=1e-9, target="numpy")
    charge = brentq(lambda q: q + q**3 - 2.5, 0, 3)
    np.testing.assert_allclose(found["w"][1:], share * charge, rtol=1e-7)


def test_what_an_event_sets_passes_through_no_bond() -> None:
    """A storage that an event sets takes its charge from outside of the model: no current carries it, and integrals of currents take nothing."""
    text = """plain model Reset {
  C c : e = q + q^3 { start q = 1 }
  R load : e = 2*f
  0 n
  n -> c, load
  mode done = false
  when time >= 1 and not done { c.q = 3; done = true }
  output through = integral(load.f, 0), own = integral(c.f, 0), q = c.q
}"""
    found = bondgraph.load(text).simulate(to=2, points=21, rtol=1e-10)
    first = solve_ivp(lambda t, q: -(q + q**3) / 2, (0, 1), [1.0], rtol=1e-12, atol=1e-13)
    last = solve_ivp(lambda t, q: -(q + q**3) / 2, (0, 1), [3.0], rtol=1e-12, atol=1e-13)
    lost = 1 - float(first.y[0, -1])
    np.testing.assert_allclose(found["own"][9], -lost, atol=0.1)
    np.testing.assert_allclose(found["own"][10], -lost, atol=1e-8)
    np.testing.assert_allclose(found["own"][-1], -lost - 3 + float(last.y[0, -1]), atol=1e-8)
    np.testing.assert_allclose(found["through"], -found["own"], atol=1e-8)
    np.testing.assert_allclose(found["q"][10], 3, atol=1e-8)


TIED_CAPACITORS = """model Two {{
  parameter near_size = {near}, far_size = {far}
  C near : u = q/near_size {{ start u = 5 V }}
  C far  : u = q/far_size
  1 tie  : electric {{ active = time > 1 ms }}
  0 one  : electric
  0 other : electric
  one -> near
  one -> tie -> other -> far
  output u = near.u, w = far.u
}}
"""


@pytest.mark.parametrize(("near", "far"), [("10 pF", "20 pF"), ("0.1 fF", "0.2 fF"), ("1 F", "2 F"), ("2 pF", "1 F")])
def test_small_charges_are_shared_as_large_ones(near: str, far: str) -> None:
    """What holds nothing yet has the size of what it is tied to: a charge of 5e-11 C passed into nothing, and the voltage stayed."""
    run = bondgraph.load(TIED_CAPACITORS.format(near=near, far=far)).simulate(to="2 ms", points=3)
    sizes = [float(text.split()[0]) * {"pF": 1e-12, "fF": 1e-15, "F": 1.0}[text.split()[1]] for text in (near, far)]
    shared = 5 * sizes[0] / sum(sizes)
    assert run.final("u") == pytest.approx(shared, rel=1e-9) and run.final("w") == pytest.approx(shared, rel=1e-9)


STOPPED = """plain model Stopped {
  I m : p = 2*f { start p = 3 }
  R r : e = 0.3*f
  R q : e = 0.2*f
  Se push : e = PUSH
  1 j
  1 other { active = time < 0.9 or time > 1.5 }
  1 line
  0 gap { active = not open }
  mode open = true
  push -> j -> m, r
  j -> line -> gap
  j -> other -> q
  when not open and gap.e > 0 { open = true }
  when open and line.f < 0 { open = false }
  output p = m.p, passed = integral(m.e, 0)
  experiment go { simulate 0 .. 2 }
}
"""
STOPPED_DUAL = (
    STOPPED.replace("I m : p = 2*f", "C m : q = 2*e").replace("start p", "start q").replace("m.p,", "m.q,")
    .replace("R r : e = 0.3*f", "R r : f = 0.3*e").replace("R q : e = 0.2*f", "R q : f = 0.2*e").replace("m.e,", "m.f,")
    .replace("Se push : e", "Sf push : f").replace("1 j", "0 j").replace("1 other", "0 other").replace("open = true\n", "open = false\n")
    .replace("gap.e > 0", "gap.e < 0").replace("line.f < 0", "line.f > 0")
)  # fmt: skip


@pytest.mark.few(4)
@pytest.mark.parametrize("text", [STOPPED, STOPPED_DUAL], ids=["momentum", "charge"])
@pytest.mark.parametrize("push", [-0.5, 0.5])
@pytest.mark.parametrize("arrow", ["j -> other", "other -> j"])
def test_what_is_held_beside_a_valve_passes_its_impulse(text: str, push: float, arrow: str) -> None:
    """A junction that goes off stops all, whatever a valve beside it does; the integral of the force is the change of the momentum."""
    written = text.replace("PUSH", str(push)).replace("j -> other -> q", f"{arrow}\n  other -> q")
    run = bondgraph.load(written).simulate(points=21, rtol=1e-9)
    times, steady, after = np.asarray(run.time), 4 * push, 4 * max(push, 0.0)
    expected = np.where(times < 0.9, steady + (3 - steady) * np.exp(-times / 4), 0.0)
    expected = np.where(times > 1.5, after * (1 - np.exp(-(times - 1.5) / 4)), expected)
    where = np.abs(times - 0.9) > 1e-6  # at the instant itself both are right
    np.testing.assert_allclose(run["p"][where], expected[where], atol=1e-8)
    np.testing.assert_allclose(run["passed"][where], expected[where] - 3, atol=1e-8)
