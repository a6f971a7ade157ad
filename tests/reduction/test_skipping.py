"""Computations that a run does not need are left out: outputs choose, zeros vanish, and nothing relevant is lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.equations.system import Assignment
from compiler.reduction import StateSpace
from tests.compiling import MODELS, Running, compiled

TWO = """
model A {
  parameter unused = 5
  for i in 1..2 {
    1 body[i]
    I mass[i]   : p = i*1 kg*v
    C spring[i] : F = 8 [N/m]*x
    R damper[i] : F = 2 [N*s/m]*v
    body[i] -> mass[i], spring[i], damper[i]
  }
  signal never = exp(mass[2].v*1 [s/m])
  output x1 = spring[1].x, x2 = spring[2].x, power = damper[1].F*damper[1].v, odd = never
}
"""


def targets(space: StateSpace) -> list[str]:
    """The variables that the steps compute."""
    found: list[str] = []
    for step in space.steps:
        found += [space.variables[t].name for t in ((step.target,) if isinstance(step, Assignment) else step.targets)]
    return found


def states(space: StateSpace) -> list[str]:
    return [space.variables[s.variable].name for s in space.states]


def test_only_the_states_behind_the_outputs() -> None:
    """Two independent oscillators; a state needs its rate, and all variables that this reads."""
    assert states(compiled(TWO, outputs=("x1",)).state_space) == ["mass[1].p", "spring[1].x"]
    assert states(compiled(TWO, outputs=("x2",)).state_space) == ["mass[2].p", "spring[2].x"]
    assert len(states(compiled(TWO).state_space)) == 4


def test_only_the_steps_behind_the_outputs() -> None:
    """Counted: flow, spring force, damper force, rate of momentum."""
    one = compiled(TWO, outputs=("x1",)).state_space
    assert len(one.steps) == 4 and not any("[2]" in t or "never" in t for t in targets(one))
    assert len(compiled(TWO, outputs=("x1", "power")).state_space.steps) == 5
    assert len(compiled(TWO, outputs=("x1", "x2")).state_space.steps) == 8


LOOP = "model A {\n  Se s : u = 6 V\n  1 a\n  0 b\n  R r : u = 2 ohm*i\n  R t, w : u = 3 ohm*i\n  C c, d : u = q/5 F\n  s -> a -> r, b\n  b -> t, 1(w, c), 1(d, x)\n  R x : u = 1 ohm*i\n}\n"


@pytest.mark.parametrize("text", [TWO, LOOP, MODELS / "manipulator.bg"], ids=["two", "loop", "manipulator"])
def test_steps_are_in_an_order_that_can_be_computed(text: str | Path) -> None:
    space = compiled(text, everything=True).state_space
    known = {i for i, v in enumerate(space.variables) if v.role in ("parameter", "input", "time", "state")}
    for step in space.steps:
        if isinstance(step, Assignment):
            assert all(a in known for a in step.arguments if isinstance(a, int))
            known.add(step.target)
        else:
            assert all(e in known for row in (*step.matrix, step.right) for e in row if isinstance(e, int))
            known.update(step.targets)
    assert all(s.rate in known for s in space.states) and all(v in known for v in space.outputs.values())


def test_a_value_does_not_depend_on_what_else_is_asked() -> None:
    state = {"mass[1].p": 1.5, "spring[1].x": 0.25}
    every, one = Running(compiled(TWO, everything=True)), Running(compiled(TWO, outputs=("x1",)))
    assert {n: every.rates(state)[n] for n in one.program.states.names} == one.rates(state)


def test_an_output_of_time_alone_has_no_state() -> None:
    text = TWO.replace("output x1", "output t = 2*time, x1")
    space = compiled(text, outputs=("t",)).state_space
    assert states(space) == [] and len(space.steps) == 1


def test_generated_code_has_no_trace() -> None:
    source = compiled(TWO, outputs=("x1",)).program.source
    assert not any(
        word in source for word in ("mass_2", "mass[2]", "spring[2]", "damper_2", "damper[2]", "np.exp", "unused")
    )


class TestZeros:
    """A parameter counts as zero only if this run cannot change it."""

    TEXT = """
model A {
  parameter r_x: N*s/m = 0, k2: N/m = 0, m2: kg = 0
  input push = 0 N
  1 body
  I mass : p = 2 kg*v
  C spring : F = 8 [N/m]*x
  R loss : F = r_x*v
  C second : F = k2*x
  I extra : p = m2*v
  MSe drive : F = push
  drive -> body -> mass, spring, loss, second, extra
  output x = spring.x
}
"""

    def test_they_leave_no_trace(self) -> None:
        compilation = compiled(self.TEXT)
        assert {n.name for n in compilation.graph.nodes} == {"body", "mass", "spring"}
        source = compilation.program.source
        assert not any(word in source for word in ("r_x", "loss", "second", "extra", "drive", "push"))
        assert compilation.program.states.names == ("mass.p", "spring.x")

    @pytest.mark.parametrize(
        ("name", "value", "node", "rate"),
        [
            ("r_x", "3 [N*s/m]", "loss", -4.0 - 6.0),
            ("k2", "3 [N/m]", "second", -4.0 - 1.5),
            ("push", "7 N", "drive", 3.0),
        ],
    )
    def test_set_from_outside_they_are_there(self, name: str, value: str, node: str, rate: float) -> None:
        compilation = compiled(self.TEXT, {name: value}, everything=True)
        assert node in {n.name for n in compilation.graph.nodes}
        found = Running(compilation).rates({"mass.p": 4.0, "spring.x": 0.5})
        assert found["mass.p"] == pytest.approx(rate, rel=1e-15)

    def test_set_to_zero_they_are_kept_as_asked(self) -> None:
        """An override is a wish to change it: the structure does not depend on the number that was given."""
        assert "loss" in {n.name for n in compiled(self.TEXT, {"r_x": 0.0}).graph.nodes}

    def test_in_a_program_for_all_parameters_they_are_arguments(self) -> None:
        program = compiled(self.TEXT, free=("*",)).program
        assert {"r_x", "k2"} <= set(program.parameters.names) and program.inputs.names == ("push",)

    def test_what_is_read_stays(self) -> None:
        text = self.TEXT.replace("output x = spring.x", "output x = spring.x, F = loss.F")
        compilation = compiled(text)
        assert "loss" in {n.name for n in compilation.graph.nodes}
        assert Running(compilation).outputs({"mass.p": 4.0}) == {"x": 0.0, "F": 0.0}

    def test_instance_by_instance(self) -> None:
        text = "model Part {\n  parameter r: N*s/m = 0\n  port end: translation\n  1 hub\n  C c : F = 2 [N/m]*x\n  R loss : F = r*v\n  end -> hub -> c, loss\n}\nmodel A {\n  Part p\n  Part q { r = 3 [N*s/m] }\n  1 body\n  I m : p = 1 kg*v\n  body -> m, p.end, q.end\n  output v = m.v\n}\n"
        names = {n.name for n in compiled(text).graph.nodes}
        assert "q.loss" in names and "p.loss" not in names

    def test_a_zero_through_constants(self) -> None:
        text = self.TEXT.replace("parameter r_x: N*s/m = 0", "parameter r: N*s/m = 0\n  constant r_x = 2*r")
        assert "loss" not in {n.name for n in compiled(text).graph.nodes}

    def test_ports_of_a_field(self) -> None:
        """A field of losses with one coefficient that is not zero keeps that port alone."""
        text = "model A {\n  parameter a: N*s/m = 0, b: N*s/m = 3\n  1 x, y : translation\n  I m, n : p = 1 kg*v\n  R loss(x, y) : x.F = a*x.v, y.F = b*y.v\n  x -> m, loss.x\n  y -> n, loss.y\n}\n"
        compilation = compiled(text, everything=True)
        (loss,) = (n for n in compilation.graph.nodes if n.name == "loss")
        assert [p.name for p in loss.ports] == ["y"]  # type: ignore[union-attr]
        assert Running(compilation).rates({"m.p": 2.0, "n.p": 2.0}) == {"m.p": 0.0, "n.p": -6.0}

    def test_a_source_of_nothing_still_holds(self) -> None:
        """Sf = 0 on a 1-junction is a wall, Se = 0 on a 0-junction a short circuit: neither may be left out."""
        wall = "model A {\n  input speed = 0 [m/s]\n  MSf hold : v = speed\n  1 body : translation\n  0 between\n  C k : F = 8 [N/m]*x\n  I m : p = 2 kg*f\n  1 free\n  hold -> body -> between -> k\n  between -> free -> m\n  output x = k.x\n}\n"
        assert Running(compiled(wall)).rates({"m.p": 4.0})["k.x"] == -2.0
        short = "model A {\n  Se s : u = 0 V\n  0 node\n  R r : u = 2 ohm*i\n  I l : lambda = 3 H*i\n  s -> node -> 1(r, l)\n  output i = l.i\n}\n"
        assert Running(compiled(short)).rates({"l.lambda": 3.0}) == {"l.lambda": -2.0}

    def test_a_spring_without_stiffness_still_breaks_no_junction(self) -> None:
        text = "model A {\n  parameter k: N/m = 0\n  1 a, b : translation\n  0 j\n  I m, n : p = 1 kg*v\n  C spring : F = k*x\n  a -> m\n  b -> n\n  a -> j -> b\n  j -> spring\n  output v = m.v - n.v\n}\n"
        assert Running(compiled(text)).rates({"m.p": 2.0, "n.p": 1.0}) == {"m.p": 0.0, "n.p": 0.0}
