"""A chain in which each state is moved by the square of the one before: from rest the coarse run finds how large each gets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bondgraph.simulation.magnitudes.nominal_magnitudes import nominal_magnitudes
from bondgraph.simulation.segments.timeline import segments
from tests.compiling import Running, compiled, magnitudes

TEXT = """model Plates {
  "Plates far below pull-in, on a voltage that rises slowly: the charge moves first, then the force, then the place."
  Se supply : u = 1 V*smoothstep5(time, 0 s, 10 ms)
  R lead : u = 1 kohm*i
  C plates(q: electric, x: translation) : energy = q^2*(2 um - x)/(2*8e-20 [F*m])
  I mass : p = 1 ug*v
  C spring : F = 1 [N/m]*x
  R air : F = 6e-5 [N*s/m]*v
  supply -> 1(lead) -> plates.q
  1(mass, spring, air) -> plates.x
  output x = spring.x
}
"""


def test_what_is_pulled_by_a_square_has_its_own_size() -> None:
    """k x = V^2 eps A/(2 (g - x)^2) and q = V eps A/(g - x): 1e-8 m and 4e-14 C, in a factor of ten; never one, for want of better."""
    running = Running(compiled(TEXT))
    program = running.program
    stretches = segments(program, running.constants, 0.0, 12e-3)
    found = nominal_magnitudes(running.constraints, (), running.start, stretches).values
    size = dict(zip(program.states.names, found.tolist(), strict=True))
    x = 8e-20 / (2 * 2e-6**2)
    assert x < size["plates.x"] < 10 * x
    assert 4e-14 < size["plates.q"] < 4e-13 and 1e-16 < size["mass.p"] < 1e-11


GIVING_UP = """model TwoParts {
  "The upper part cannot be followed beyond 10 ms; the lower one is moved only after that."
  Se early : F = 1 N*sqrt(10 ms - time)/sqrt(1 s)
  I first : p = 1 kg*v
  early -> 1(first)
  Se late : F = 1 N*step(time - 0.5 s)
  I second : p = 1 kg*v
  late -> 1(second, air)
  R air : F = 1 [N*s/m]*v
  output a = first.v, b = air.v
}
"""
MOMENTUM, DISPLACEMENT = "I second : p = 1 kg*v", "C second : F = 1 [N/m]*x"


def test_what_the_first_look_ahead_did_not_see_is_told() -> None:
    """The magnitude of a momentum follows from another of its unit; a displacement has none, and a warning says that its scale is a guess."""
    for text, unknown in ((GIVING_UP, ()), (GIVING_UP.replace(MOMENTUM, DISPLACEMENT), ("second.x",))):
        running = Running(compiled(text))
        stretches = segments(running.program, running.constants, 0.0, 1.0)
        with np.errstate(all="ignore"):
            found = nominal_magnitudes(running.constraints, (), running.start, stretches)
        assert found.stopped is not None and abs(found.stopped - 10e-3) < 1e-4
        assert found.unknown == unknown
        assert len(found.doubts) == len(unknown)
        if unknown:  # a displacement of 1 m in the run, of which it is a small share
            assert "`second.x`" in str(found.doubts[0]) and found.values[1] < 1e-3


@pytest.mark.parametrize(("force", "grown"), [("", True), (" + 1 uN*sin(1 [1/s]*time)", False)])
def test_a_motion_that_grows_on_its_own_has_the_size_of_its_beginning(force: str, grown: bool) -> None:
    """sinh(w t) for 60/w: where nothing drives it, a coarse run to the end is no measure; where a signal of time does, that run counts."""
    text = f"model A {{ Se u : F = 1 uN{force}; I m : p = 1 kg*v; C c : F = -1 [N/m]*x; u -> 1(m, c); output x = c.x }}"
    running = Running(compiled(text))
    size = magnitudes(running, segments(running.program, running.constants, 0.0, 60.0))
    end = 1e-6 * math.exp(60) / 4
    assert (size < 1e-6 * end).all() if grown else (size > end).all()
