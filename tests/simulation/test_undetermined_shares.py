"""Valves, stuck friction and switches that keep one flow (or effort) at zero together: only the sum of their efforts is determined.

The motion is unique: it stays at rest as long as any shares are admissible. After that all are solutions of one linear equation, known in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import bondgraph
from tests.second_opinion.random_models import PARTS as FRICTION_AND_VALVE

CHECKS = """plain model Check {
  port ends: untyped
  mode open = false
  0 before, behind
  1 line { active = open }
  Se still : e = 0
  ends -> before -> line -> behind
  still -> behind
  when not open and before.e > behind.e { open = true }
  when open and line.f < 0 { open = false }
}
plain model Limiter {
  parameter fc = 0.5, fs = 0.6
  port ends: untyped
  mode slip = 0
  1 line
  0 contact { active = slip != 0 }
  MR surface : f = slip*fc + 0.1*e
  ends -> line
  contact -> surface
  line -> contact
  when slip == 0 and abs(line.f) > fs { slip = 1 if line.f > 0 else -1 }
  when slip*contact.e < 0 { slip = 0 }
}
"""
PARTS = FRICTION_AND_VALVE + CHECKS
A, B, D = "Friction A { fc = 0.3; fs = 0.5 }", "Friction B { fc = 0.4; fs = 0.8 }", "Friction D { fc = 0.1; fs = 0.4 }"
SWITCH = "1 w { active = time > 0.9 }\n  R q : e = 0.2*f"
COUPLED = "parameter n = 2\n  TF T : f1 = n*f2\n  1 k\n  j -> T -> k"
RAMP, PULSE, BACK = "0.5*time", "0.5*time + (1.5 if time < 0.5 else 0)", "0.5*time - (1.5 if time < 0.5 else 0)"


@dataclass(frozen=True)
class Case:
    """`body`: what hangs on the junction j; force `level` at which it moves, and the rest of the force against it: `drag` + `slope` f; `told`: in notes."""

    body: str
    level: float
    drag: float
    slope: float = 0.1
    push: str = RAMP
    told: tuple[str, ...] = ()
    settings: tuple[tuple[str, float], ...] = ()


PROPORTION, NONE, PLAIN = "in proportion to the limits", "takes none of it", "depends on how this program chooses them"
CASES = {
    "friction and valve": Case(f"{A}\n  Valve V\n  j -> A.ends, V.ends", 0.5, 0.3, push=BACK, told=(NONE, "A.contact", "V.gap")),
    "valve and friction": Case(f"Valve V\n  {A}\n  j -> V.ends\n  j -> A.ends", 0.5, 0.3, push=BACK, told=(NONE,)),
    "friction and check valve": Case(f"{A}\n  Check V\n  j -> A.ends, V.ends", 0.5, 0.3, push=BACK, told=(NONE,)),
    "two valves and friction": Case(f"{A}\n  Valve V, W\n  j -> V.ends, A.ends, W.ends", 0.5, 0.3, push=BACK, told=(NONE,)),
    "two frictions": Case(f"{A}\n  {B}\n  j -> A.ends, B.ends", 1.3, 0.7, 0.2, told=(PROPORTION, "A.contact", "B.contact")),
    "two frictions in another order": Case(f"{B}\n  {A}\n  j -> A.ends\n  j -> B.ends", 1.3, 0.7, 0.2, told=(PROPORTION,)),
    "three frictions": Case(f"{A}\n  {D}\n  {B}\n  j -> A.ends, B.ends, D.ends", 1.7, 0.8, 0.3, told=(PROPORTION,)),
    "two frictions and a valve": Case(f"{A}\n  Valve V\n  {B}\n  j -> A.ends, V.ends, B.ends", 1.3, 0.7, 0.2, BACK, (PROPORTION, NONE)),
    "friction and a switch": Case(f"{A}\n  {SWITCH}\n  j -> A.ends, w\n  w -> q", 0.5, 0.3, 0.3, PULSE, (NONE, "`A.contact` and `w`")),
    "friction, valve and a switch": Case(f"Valve V\n  {A}\n  {SWITCH}\n  j -> A.ends, w, V.ends\n  w -> q", 0.5, 0.3, 0.3, PULSE, (NONE,)),
    "valve and a switch": Case(f"Valve V\n  {SWITCH}\n  j -> w, V.ends\n  w -> q", 0.45, 0.0, 0.2),
    "friction and a switch behind a transformer": Case(
        f"{A}\n  {SWITCH}\n  {COUPLED}\n  k -> w -> q\n  j -> A.ends", 0.5, 0.3, 0.15, PULSE, (NONE,)
    ),
    "friction behind a transformer and a switch": Case(
        f"{B}\n  {SWITCH}\n  {COUPLED}\n  j -> w -> q\n  k -> B.ends", 0.45, 0.2, 0.225, "0.4*time + 0.09", (NONE,)
    ),
    "frictions on both sides of a transformer": Case(f"{A}\n  {B}\n  {COUPLED}\n  j -> A.ends\n  k -> B.ends", 0.9, 0.5, 0.125, told=(PROPORTION,)),
    "frictions on both sides of one that turns round": Case(
        f"{A}\n  {B}\n  {COUPLED}\n  j -> A.ends\n  k -> B.ends", 0.9, 0.5, 0.125, told=(PROPORTION,), settings=(("n", -2.0),)
    ),
    "friction and valve behind a transformer": Case(f"{A}\n  Valve V\n  {COUPLED}\n  j -> A.ends\n  k -> V.ends", 0.5, 0.3, push=BACK, told=(NONE,)),
    "frictions behind a 0-junction": Case(f"{A}\n  {B}\n  0 z\n  1 k\n  j -> z -> k\n  j -> A.ends\n  k -> B.ends", 1.3, 0.7, 0.2, told=(PROPORTION,)),
    "friction at a wall that gives way": Case(f"{A}\n  1 w {{ active = hold < 1 }}\n  R q : e = 0.2*f\n  parameter hold = 0\n  j -> A.ends, w\n  w -> q", 0.5, 0.3, 0.3),
}  # fmt: skip
TARGETS = [pytest.param("native", marks=pytest.mark.machine_code), "numpy"]
HEAD = "I m : p = 2*f\n  R r : e = 0.3*f\n  1 j\n  j -> m, r\n"


def written(body: str, head: str, push: str) -> str:
    used = "".join(f"plain model{p}" for p in PARTS.split("plain model")[1:] if f"{p.split()[0]} " in body)
    return f"{used}plain model Whole {{\n  {head}  Se S : e = {push}\n  S -> j\n  {body}\n  output v = m.p\n  experiment go {{ simulate 0 .. 4 }}\n}}\n"


def speed(case: Case, times: np.ndarray) -> np.ndarray:
    """Solution of 2 v' = a t + b - drag - c v from rest where the ramp passes the level."""
    a, b = (0.4, 0.09) if case.push.startswith("0.4") else (0.5, 0.0)
    c, begin = 0.3 + case.slope, (case.level - b) / a
    steady = (a * times + b - case.drag) / c - 2 * a / c**2
    at_begin = (a * begin + b - case.drag) / c - 2 * a / c**2
    return np.where(times > begin, steady - at_begin * np.exp(-c * (times - begin) / 2), 0.0)


@pytest.mark.few(10)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", CASES)
def test_it_rests_until_no_shares_are_admissible(name: str, target: str) -> None:
    case = CASES[name]
    found = bondgraph.load(written(case.body, HEAD, case.push)).simulate(
        points=41, rtol=1e-9, target=target, settings=dict(case.settings)
    )
    _check(case, found)


def _check(case: Case, found: bondgraph.Result) -> None:
    assert np.asarray(found["v"]) == pytest.approx(2 * speed(case, np.asarray(found.time)), abs=2e-8)
    notes = " ".join(n for n in found.notes if n.startswith("nothing determines"))
    assert all(word in notes for word in case.told) and bool(notes) == bool(case.told), notes


A_, B_, D_ = (x.replace("Friction", "Limiter") for x in (A, B, D))
DUALS = {
    "limiter and valve": Case(f"{A_}\n  Valve V\n  j -> V.ends, A.ends", 0.5, 0.3, push=BACK, told=(NONE, "A.contact", "V.gap")),
    "valve and limiter": Case(f"Valve V\n  {A_}\n  j -> V.ends\n  j -> A.ends", 0.5, 0.3, push=BACK, told=(NONE, "how much flow")),
    "limiter and two valves": Case(f"{A_}\n  Valve V, W\n  j -> V.ends, W.ends, A.ends", 0.5, 0.3, push=BACK, told=(NONE,)),
    "limiter and valve behind a transformer": Case(
        f"{A_}\n  Valve V\n  parameter n = 2\n  TF T : e1 = n*e2\n  0 k\n  j -> T -> k\n  k -> V.ends\n  j -> A.ends", 0.5, 0.3, push=BACK, told=(NONE,)
    ),
}  # fmt: skip


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", DUALS)
def test_the_same_of_flows(name: str, target: str) -> None:
    """A capacitor whose current a valve takes beside a limiter, which has no voltage until its current passes a limit."""
    case = DUALS[name]
    text = written(case.body, "C m : q = 2*e\n  R r : f = 0.3*e\n  0 j\n  j -> m, r\n", case.push).replace(
        "= m.p", "= m.q"
    )
    for old, new in (
        ("Se S : e", "Sf S : f"),
        ("gap.e > 0", "gap.e < 0"),
        ("line.f < 0", "line.f > 0"),
        ("open = false\n", "open = true\n"),
    ):
        text = text.replace(old, new)
    _check(case, bondgraph.load(text).simulate(points=41, rtol=1e-9, target=target))


def test_shares_without_influence_are_not_told() -> None:
    text = written("Valve V, W\n  j -> V.ends, W.ends", HEAD, RAMP)
    assert not bondgraph.load(text).simulate(points=5).notes


def test_limits_that_are_not_recognised_are_told() -> None:
    """A valve with a threshold beside friction: the shares decide which of them gives way, and when."""
    body = f"{A}\n  Valve V\n  j -> A.ends, V.ends"
    text = written(body, HEAD, RAMP).replace("gap.e > 0 {", "gap.e > 0.4 {")
    (note,) = bondgraph.load(text).simulate(points=5).notes
    assert PLAIN in note and "`A.contact`" in note and "`V.gap`" in note
