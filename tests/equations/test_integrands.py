"""Factors of efforts and flows in integrals: what multiplies them, moving or stored, for rates of all forms."""

from __future__ import annotations

import pytest

from compiler.equations.products import Factor, Integrand, integrands
from compiler.graph.network import Reading
from tests.compiling import compiled

SWITCHED = """
  0 gap { active = time < 1 }
  Se s : e = 7 + time
  Sf j : f = k*time
  MSe m : e = 2*c.q
  parameter k = 3
  input u = 1
  R r : e = 2*f
  C c : e = q/3
  I l : p = 4*f
  C field(x, y) : energy = x.q^2 + x.q*y.q + y.q^2
  1 line
  s -> line -> gap
  m -> line
  line -> r, c, field.x
  0 n
  line -> n
  j -> n -> l
  n -> field.y
"""


def of_rate(rate: str, more: str = "") -> Integrand:
    graph = compiled("plain model A {" + SWITCHED + f"  signal w = integral({rate}, 0)\n{more}\n}}").whole_graph
    return next(i for i in integrands(graph) if i.name == "w")


def factor(node: str, variable: str, moving: bool, *coefficients: str, port: str = "") -> Factor:
    return Factor(Reading(node, port, variable), moving, coefficients)


R_F, R_E, C_F = ("r", "f"), ("r", "e"), ("c", "f")
CASES = {
    "r.f": ((), "f"),
    "3*r.f + k*c.f + u + time*r.e": ((), "ef"),
    "c.q": ((), ""),
    "r.e*r.f": ((factor(*R_E, True), factor(*R_F, True)), "ef"),
    "r.f^2": ((), "f"),
    "c.q*r.f": ((factor(*R_F, False, "c.q"),), "f"),
    "l.p*r.f + c.q*c.f": ((factor(*R_F, False, "l.p"), factor(*C_F, False, "c.q")), "f"),
    "c.q*r.f + l.p*r.f": ((factor(*R_F, False, "c.q", "l.p"),), "f"),
    "l.p*r.f + c.q*r.f": ((factor(*R_F, False, "c.q", "l.p"),), "f"),
    "c.q*r.f*r.e": ((factor(*R_F, True, "c.q"), factor(*R_E, True, "c.q")), "ef"),
    "r.f + c.q*r.e": ((factor(*R_E, False, "c.q"),), "ef"),
    "field.y.q*r.f": ((factor(*R_F, False, "field.y"),), "f"),
    "field.x.q*r.f": ((factor(*R_F, False, "field.x"),), "f"),
    # Sources are read as what they give, if it is of time, parameters and what others have.
    "s.e*r.f": ((), "f"),
    "j.f*r.e": ((), "e"),
    "s.e": ((), ""),
    "s.f*s.e": ((), "f"),
    "m.e*r.f": ((factor(*R_F, False, "c.q"),), "f"),
    "m.f*r.f": ((factor("m", "f", True), factor(*R_F, True)), "f"),
    # Signals are read as what defines them, and other integrals as what is stored.
    "a*r.f": ((factor(*R_F, False, "c.q"),), "f"),
    "b*c.f": ((factor(*R_F, True), factor(*C_F, True)), "f"),
    "v*r.f": ((factor(*R_F, False, "v"),), "f"),
    "v*c.q*r.f": ((factor(*R_F, False, "c.q", "v"),), "f"),
    "o*r.f": ((factor(*R_F, False, "c.q"),), "f"),
    "w*r.f": ((factor(*R_F, False, "w"),), "f"),
    "k*r.f": ((), "f"),
    "noise(r.f, k, 7)*c.q": ((factor(*R_F, False, "c.q"),), "f"),
    "noise(time, k, 7)*c.q*r.f": ((factor(*R_F, False, "c.q"),), "f"),
}
MORE = "  signal a = c.q, b = r.f\n  signal v = integral(time, 0)\n  output o = 3*c.q"


@pytest.mark.parametrize("rate", CASES)
def test_factors(rate: str) -> None:
    factors, reads = CASES[rate]
    found = of_rate(rate, MORE)
    assert found.reads == reads
    assert sorted(found.factors, key=str) == sorted(factors, key=str)


def test_integrals_come_in_order() -> None:
    graph = compiled(
        f"plain model A {{{SWITCHED}\n signal b = integral(r.f, 0)\n signal a = integral(r.e, 0)\n}}"
    ).whole_graph
    assert [(i.name, i.reads) for i in integrands(graph)] == [("b", "f"), ("a", "e")]


def test_without_switches_there_are_none() -> None:
    graph = compiled(
        "plain model A {\n Se s : e = 1\n R r : e = f\n s -> r\n signal w = integral(r.e*r.f, 0)\n}"
    ).whole_graph
    assert graph.integrals and integrands(graph) == ()


def test_a_law_of_the_element_itself_is_not_read_further() -> None:
    """A resistor's law has its own flow: its effort stays a factor."""
    assert of_rate("r.e*c.q").factors == (factor(*R_E, False, "c.q"),)
