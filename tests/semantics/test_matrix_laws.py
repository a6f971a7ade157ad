"""Laws with matrices: fields whose efforts are a matrix times displacements, losses and inertias likewise, transformers between multibonds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import bondgraph
from compiler.unparse import write_text
from tests.compiling import compiled, mistake, refused

STIFFNESS, MASS, LOSS = np.array([[100, -30], [-30, 50]]), np.array([[2, 0.5], [0.5, 1]]), np.array([[3, 1], [1, 2]])
FIELD = """
model A {
  parameter K: N/m = [[100, -30], [-30, 50]]
  constant S = inverse(K)
  C spring(x, y) : LAW
  I masses(x, y) : p = [[2 kg, 0.5 kg], [0.5 kg, 1 kg]]*v   { start x = 1 [N*s] }
  R oil(x, y) : F = [[3 [N*s/m], 1 [N*s/m]], [1 [N*s/m], 2 [N*s/m]]]*v
  1(masses.x, oil.x) -> spring.x
  1(masses.y, oil.y) -> spring.y
  output x = spring.x, y = spring.y, E = dot((spring.x.F, spring.y.F), (spring.x, spring.y))/2
}
"""
LAWS = ["e = K*q", "F = K*q", "K*q = e", "q = S*e", "(x.F, y.F) = K*(x, y)", "energy = transpose(q)*K*q/2"]
RUNS = [*((law, "numpy") for law in LAWS), pytest.param("e = K*q", "native", marks=pytest.mark.machine_code)]


@pytest.mark.parametrize(("law", "target"), RUNS)
def test_fields_by_matrices(law: str, target: str) -> None:
    """M v' = -R v - K x, by the exponential of a matrix written by hand."""
    result = bondgraph.load(FIELD.replace("LAW", law)).simulate(to=1, points=4, rtol=1e-10, target=target)
    rates = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(MASS, STIFFNESS), -np.linalg.solve(MASS, LOSS)]])
    start = np.concatenate([[0, 0], np.linalg.solve(MASS, [1, 0])])
    exact = np.array([expm(rates * t) @ start for t in result.time])[:, :2]
    assert result["x"] == pytest.approx(exact[:, 0], abs=1e-8)
    assert result["y"] == pytest.approx(exact[:, 1], abs=1e-8)
    assert result["E"] == pytest.approx(np.einsum("ti,ij,tj->t", exact, STIFFNESS, exact) / 2, abs=1e-7)


def test_a_stiffness_without_an_energy_is_refused() -> None:
    text = FIELD.replace("LAW", "e = K*q").replace("[-30, 50]", "[-31, 50]")
    found = refused(compiled(text), "BG405")
    assert "`spring.y.F` over `spring.x` is -31" in found.sentence and "-30" in found.sentence


def test_names_of_the_model_are_read_where_they_are_meant() -> None:
    """A law that has no letter of all ports reads the model's `q`; one that has some does not guess."""
    scalar = "x.F = q*x, y.F = q*y"
    text = FIELD.replace("constant S", "constant q = 7 [N/m], S")
    assert not bondgraph.check(text.replace("LAW", scalar))
    mistake(text.replace("LAW", "e = K*q"), "BG116")


MOVED = """
model A {
  parameter l = 0.1 m, K = [[12 [N/m], 0, 0.3 N], [0, 500 [N/m], 0], [0.3 N, 0, 0.05 [N*m]]]
  constant T = [[1, 0, -l/2], [0, 1, l/3], [0, 0, 1]]
  I body(x: translation, y: translation, phi: rotation) : p = [[1 kg, 0, 0], [0, 2 kg, 0], [0, 0, 0.01 [kg*m^2]]]*f { start x = 1 [N*s], start phi = 0.02 [N*m*s] }
  C spring(x, y, phi) : LAW
  ARM
  1(body.x) -> hand.x
  1(body.y) -> hand.y
  1(body.phi) -> hand.phi
  output v = body.x.v, w = body.phi.omega, E = spring.x.F + spring.y.F OUTPUT
}
"""
ARM = "TF arm(a: planar, b: planar) : {}\n splitter hand(x, y, phi)\n hand => arm.a\n arm.b => spring"
ONE_BY_ONE = "TF arm(a: planar, b: planar) : b.f = T*a.f\n splitter hand(x, y, phi)\n hand => arm.a\n arm.b.x -> spring.x; arm.b.y -> spring.y; arm.b.phi -> spring.phi"
ARMS = [ARM.format("b.f = T*a.f"), ARM.format("a.e = transpose(T)*b.e"), ARM.format("a.f = inverse(T)*b.f"), ONE_BY_ONE]


@pytest.mark.parametrize("arm", ARMS)
def test_a_spring_behind_an_arm_is_a_spring_with_a_moved_stiffness(arm: str) -> None:
    """K' = T' K T, whichever way the transformer is written; power passes through it."""
    power = ", power = arm.a.x.F*arm.a.x.v + arm.a.y.F*arm.a.y.v + arm.a.phi.M*arm.a.phi.omega"
    power += ", passed = arm.b.x.F*arm.b.x.v + arm.b.y.F*arm.b.y.v + arm.b.phi.M*arm.b.phi.omega"
    behind = bondgraph.load(MOVED.replace("LAW", "e = K*q").replace("ARM", arm).replace("OUTPUT", power))
    moved = MOVED.replace("LAW", "e = transpose(T)*K*T*q").replace("ARM", "splitter hand(x, y, phi)\n hand => spring")
    first = behind.simulate(to=0.5, points=4, rtol=1e-10, energy=True)
    second = bondgraph.load(moved.replace("OUTPUT", "")).simulate(to=0.5, points=4, rtol=1e-10)
    for name in ("v", "w"):
        assert first[name] == pytest.approx(second[name], rel=1e-7)
    assert np.abs(first["power"]).max() > 0.01
    assert first["power"] == pytest.approx(first["passed"], rel=1e-9)


def test_a_flat_text_does_not_show_a_port_of_a_transducer() -> None:
    """The port is a junction there: it was looked for as an element, which ended in a traceback."""
    text = MOVED.replace("LAW", "e = K*q").replace("ARM", ARMS[0]).replace("OUTPUT", ", F = arm.b.x.F")
    with pytest.raises(bondgraph.CompilationFailed, match=r"nothing shows `arm\.a\.x\.F`"):
        write_text(compiled(text.replace("arm.b.x.F", "arm.a.x.F")).whole_graph)
    assert "output F: N = arm_b_x.F" in write_text(compiled(text).whole_graph)
