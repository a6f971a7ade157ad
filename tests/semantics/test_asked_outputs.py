"""Outputs that a run requests although the model declares none of that name: any quantity that `report` could read."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.api import CompilationFailed

TEXT = """model M {
  parameter m = 2 kg, k = 8 [N/m]
  1 body : translation
  I mass : p = m*v
  C spring : F = k*x { start x = 3 cm }
  body -> mass, spring
  output x = spring.x
  experiment go { simulate 0 .. 1 s; report x in mm }
}
"""


def test_readings_of_elements_and_junctions() -> None:
    result = bondgraph.load(TEXT).simulate("go", outputs=("x", "spring.F", "body.v", "mass.e"), points=101)
    assert result.names == ("x", "spring.F", "body.v", "mass.e")
    assert [result.unit(n) for n in result.names] == ["m", "N", "m/s", "N"]
    assert result["spring.F"] == pytest.approx(8 * result["x"], rel=1e-12)
    assert result["mass.e"] == pytest.approx(-result["spring.F"], rel=1e-12)


@pytest.mark.parametrize("name", ["spring.G", "nothing", "spring", "x +", "2*x", "spring.x; output y = 1", "a[1", ""])
def test_what_is_no_reading_is_refused(name: str) -> None:
    with pytest.raises(CompilationFailed, match="in the outputs"):
        bondgraph.load(TEXT).simulate("go", outputs=(name,))


@pytest.mark.parametrize("names", [("y",), ["y"], "y"])
def test_names_come_as_a_tuple_a_list_or_one_text(names: tuple[str, ...] | list[str] | str) -> None:
    model = bondgraph.load("model A { input u = 1; output y = 2*u, z = u }")
    assert model.simulate(outputs=names, points=2, to=1).names == ("y",)
    assert model.linearize(outputs=names).outputs == ("y",)
