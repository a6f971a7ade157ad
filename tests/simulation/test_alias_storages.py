"""Storages whose law says that the stored quantity is the flow, or the effort: junctions that go on and off keep them by their own names."""

from __future__ import annotations

from math import exp

import pytest

import bondgraph
from compiler.api import Scene

ON = 0.5  # s: the junction goes on
DRIVE = 1.3, 1.6, 1.9, 2.2, 2.5, 2.8  # from 0.3 s on, for 0.3 s each

# The law of an inertia, and its size
LAWS = {
    "p = f": 1.0,
    "f = p": 1.0,
    "p = 1*f": 1.0,
    "p = m*f": 1.0,
    "p = f + 0": 1.0,
    "p = 2*f": 2.0,
    "p = -(-f)": 1.0,
    "f = p/2": 2.0,
}
MASS = """plain model Held {{
  parameter m = 1
  1 j
  I mass : {law}
  mode u = 0
  every 0.3 {{ u = 1 + time }}
  MSe drive : e = u
  drive -> j -> mass
  R rest : e = f
  1 gate {{ active = {active} }}
  j -> gate -> rest
  output flow = j.f, content = mass.p
}}
"""
TANK = """plain model Filled {{
  parameter m = 1
  0 j
  C tank : {law}
  mode u = 0
  every 0.3 {{ u = 1 + time }}
  MSf drive : f = u
  drive -> j -> tank
  R rest : f = e
  0 gate {{ active = {active} }}
  j -> gate -> rest
  output flow = j.e, content = tank.q
}}
"""


def witness(size: float, on: float = ON, to: float = 2.0) -> float:
    """The flow of `size f' = u - f` from rest at `on`, with u constant in each 0.3 s."""
    f, time = 0.0, on
    while time < to - 1e-12:
        place = int(time / 0.3 + 1e-9)
        stop = min(0.3 * (place + 1), to)
        u = 1 + 0.3 * place
        f = u + (f - u) * exp(-(stop - time) / size)
        time = stop
    return f


@pytest.mark.few(24)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("model", [MASS, TANK], ids=["mass", "tank"])
@pytest.mark.parametrize("active", ["time > 0.5", "u > 1 and time > 0.5", "time >= 0.3 + 0.2"])
def test_a_storage_named_by_its_law(model: str, law: str, active: str) -> None:
    """Nothing moves while the junction is off; then the storage fills as the closed form says, and its content is size times flow."""
    if model is TANK:
        law = law.replace("p", "q").replace("f", "e")
    found = bondgraph.load(model.format(law=law, active=active)).simulate(to=2.0, points=5, rtol=1e-9, target="numpy")
    size = LAWS[law.replace("q", "p").replace("e", "f")]
    assert found.final("flow") == pytest.approx(witness(size), rel=1e-7)
    assert found.final("content") == pytest.approx(size * witness(size), rel=1e-7)


@pytest.mark.parametrize("second", ["p = f", "p = 3*f"])
def test_two_storages_of_one_flow(second: str) -> None:
    """Both are the flow, and both are kept."""
    text = MASS.format(law="p = f", active="time > 0.5")
    text = text.replace("  mode u", f"  I other : {second}\n  mode u").replace("j -> mass\n", "j -> mass, other\n")
    text = text.replace("drive -> j -> mass, other", "drive -> j\n  j -> mass\n  j -> other")
    found = bondgraph.load(text).simulate(to=2.0, points=5, rtol=1e-9, target="numpy")
    size = 2.0 if second == "p = f" else 4.0
    assert found.final("flow") == pytest.approx(witness(size), rel=1e-7)


def test_units_are_those_of_the_content() -> None:
    """`1 kg*v` is the number v, but no velocity."""
    text = (
        "model Held {\n  1 j\n  I mass : p = 1 kg*v\n  Se drive : F = 3 N\n  R rest : F = 1 [N*s/m]*v\n"
        "  1 gate { active = time > 0.5 s and time < 1 s }\n  drive -> j -> mass\n  j -> gate -> rest\n  output v = j.f, p = mass.p\n}\n"
    )
    model = bondgraph.load(text)
    program = model.compiled_scene(Scene(model.model, None), False, "numpy").program
    assert (program.dependents.names, program.dependents.units) == (("mass.p",), ("N*s",))
    # 3 N on a held mass; then 3 (1 - exp(-0.5)); then held again: an impulse
    assert model.simulate(to=1.0 - 1e-9, points=3, rtol=1e-9).final("p") == pytest.approx(3 * (1 - exp(-0.5)), rel=1e-7)
