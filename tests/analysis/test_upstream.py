"""Linear models, responses and modes of some outputs leave out the states that these do not depend on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph import RunFailed
from bondgraph.analysis.operating_point import OperatingPoint
from bondgraph.commands import commands
from bondgraph.keywords import AnalysisRequest
from compiler.codegen.cost import cost
from tests.compiling import MODELS

CHAIN = """
model Chain {
  input push = 1 N
  1 body
  I mass   : p = 2 kg*v
  C spring : F = 8 [N/m]*x + 3 [N/m^3]*x^3
  R damper : F = 0.5 [N*s/m]*v
  body -> mass, spring, damper
  MSe drive : F = push
  drive -> body
  # the sensor: a voltage by the speed, which does not act back
  MSe copy : u = 3 [V*s/m]*mass.v
  1 sensor
  C cap  : u = q/2 F
  R wire : u = 3 ohm*i
  I coil : lambda = 2 H*i
  copy -> sensor -> cap, wire, coil
  # more
  output x = spring.x, u = cap.u
}
"""
SENSOR = ("cap.q", "coil.lambda")


def points(outputs: tuple[str, ...], text: str = CHAIN) -> tuple[OperatingPoint, OperatingPoint]:
    """The point of a part, and that of the whole."""
    model = bondgraph.load(text)
    given: Any = {"outputs": outputs, "by": ("push",)}
    return model.operating_point(AnalysisRequest(**given, upstream=True)), model.operating_point(AnalysisRequest(**given))  # fmt: skip


def test_a_sensor_behind_what_is_asked_is_left_out() -> None:
    part, whole = points(("x",))
    assert (part.count, whole.count) == (2, 4) and part.unneeded == SENSOR and whole.unneeded == ()
    assert (cost(part.lowered).rates, cost(whole.lowered).rates) == (8, 14)
    assert abs(part.outputs[0] - whole.outputs[0]) < 1e-12


def test_a_linear_model_of_a_part() -> None:
    model = bondgraph.load(CHAIN)
    part, whole = model.linearize(outputs=("x",)), model.linearize()
    places = [whole.states.index(n) for n in part.states]
    assert part.unneeded == SENSOR and whole.unneeded == () and len(part.states) == 2
    for word, rows, columns in (("A", places, places), ("B", places, [0]), ("C", [0], places), ("D", [0], [0])):
        assert np.abs(getattr(part, word) - getattr(whole, word)[np.ix_(rows, columns)]).max() < 1e-12
    assert "2 states are left out, as no requested output depends on them: `cap.q`, `coil.lambda`" in part.summary()
    assert part.to_json()["unneeded"] == list(SENSOR) and "unneeded" not in whole.to_json()
    assert model.linearize(outputs=("u",)).states == whole.states  # everything is behind the last one


def test_a_response_of_a_part() -> None:
    model = bondgraph.load(CHAIN)
    part, whole = model.response("push", "x", 0.01, 10, 50), model.response("push", ("x", "u"), 0.01, 10, 50)
    one, both = part.of("push", "x"), whole.of("push", "x")
    shared, mine, others = np.intersect1d(part.frequencies, whole.frequencies, return_indices=True)
    assert len(shared) >= 50 and np.abs(one[mine] - both[others]).max() < 1e-12 * np.abs(both).max()
    assert any("2 states are left out" in note for note in part.notes) and whole.notes == ()


def test_modes_of_a_part_are_told_so() -> None:
    model = bondgraph.load(CHAIN)
    part, whole = model.modes(outputs="x"), model.modes()
    (mode,) = part
    assert len(whole) == 3 and part.unneeded == SENSOR and whole.unneeded == ()
    assert min(abs(mode.eigenvalue - m.eigenvalue) for m in whole) < 1e-12 * abs(mode.eigenvalue)
    assert set(mode.energy) == {"mass", "spring"} and sum(mode.energy.values()) == pytest.approx(1)
    assert "2 states are left out" in part.note and "their own modes are not shown" in part.summary()
    assert len(model.modes(outputs=("x", "u"))) == 3 and model.modes(outputs="u").note == ""


def test_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "chain.bg").write_text(CHAIN, encoding="utf-8")
    done = CliRunner().invoke(commands, ["modes", str(tmp_path / "chain.bg"), "--output", "x", "--json"])
    found = json.loads(done.stdout)
    assert len(found["modes"]) == 1 and found["unneeded"] == list(SENSOR)
    done = CliRunner().invoke(commands, ["modes", str(tmp_path / "chain.bg"), "--output", "x", "--plot", str(tmp_path / "a.svg")])  # fmt: skip
    assert done.exit_code == 2 and "all modes" in done.stderr


DOWNSTREAM = {
    "a path that never rests": "signal way = integral(spring.x, 0 [m*s])\n  output w = way",
    "an unstable branch": "MSe at : F = mass.v*1 [N*s/m]\n  1 far\n  I m : p = 1 kg*v\n  C neg : F = -1 [N/m]*x\n  at -> far -> m, neg\n  output w = neg.x",
    "a law with a kink": "MSe at : F = mass.v*1 [N*s/m]\n  1 far\n  I m : p = 1 kg*v\n  C c : F = abs(x)*1 [N/m] + 2 [N/m]*x\n  at -> far -> m, c\n  output w = c.x",
    "a nonlinear loop": "MSe at : u = mass.v*1 [V*s/m]\n  0 node\n  1 far\n  R d : i = 1 A*(u/1 V + (u/1 V)^3)\n  R e : u = 1 ohm*i + 1 [V/A^3]*i^3\n  C c : u = q/1 F\n  at -> far -> e, node\n  node -> d, c\n  output w = c.u",
    "a sampled filter": "mode held = 0 m\n  every 0.1 s { held = 0.5*held + 0.5*spring.x }\n  output w = held",
    "a derivative storage": "MSf at : f = mass.v\n  1 far\n  I m : p = 1 kg*v\n  R r : F = 1 [N*s/m]*v\n  at -> far -> m, r\n  output w = m.p",
}  # fmt: skip


@pytest.mark.parametrize("lines", DOWNSTREAM.values(), ids=list(DOWNSTREAM))
def test_what_lies_downstream_decides_nothing(lines: str) -> None:
    """Not even whether there is a rest, or a linear model; the whole says what it says."""
    plain, model = bondgraph.load(CHAIN), bondgraph.load(CHAIN.replace("# more", lines.replace("MSf at : f =", "MSf at : v =")))  # fmt: skip
    assert "w" in model.outputs
    mine, other = (m.linearize(outputs=("x",)) for m in (model, plain))
    assert mine.states == other.states and np.array_equal(mine.A, other.A) and np.array_equal(mine.B, other.B)
    assert np.array_equal([m.eigenvalue for m in model.modes(outputs="x")], [m.eigenvalue for m in plain.modes(outputs="x")])  # fmt: skip
    assert np.array_equal(model.response("push", "x").values, plain.response("push", "x").values)


def test_stability_is_that_of_the_whole() -> None:
    """An equilibrium has a verdict, so no part of the model is left out of it."""
    model = bondgraph.load(CHAIN.replace("# more", DOWNSTREAM["an unstable branch"]))
    assert model.equilibrium(outputs=("x",)).stable is False
    with pytest.raises(RunFailed, match="drifts"):
        bondgraph.load(CHAIN.replace("# more", DOWNSTREAM["a path that never rests"])).equilibrium()


def test_coupled_parts_stay_whole() -> None:
    """All of the manipulator's coordinates are coupled by its flexures, whatever is asked."""
    model = bondgraph.load(MODELS / "manipulator.bg")
    part, whole = model.modes(outputs="x"), model.modes()
    assert part.unneeded == () and np.allclose(part.frequencies, whole.frequencies, rtol=1e-12)
    assert model.simulate("push_x", to="1 us").certificate.unexcited == ()


RESTS = """
model B {
  input push = 1 N
  1 body
  I mass : p = 2 kg*v
  C spring : F = -8 [N/m]*x + 3 [N/m^3]*x^3
  R damper : F = 0.5 [N*s/m]*v
  MSe drive : F = push
  drive -> body -> mass, spring, damper
  signal far = integral((spring.x - far)/1 s, 0 m)
  output x = spring.x, w = far
  experiment go { start spring.x = -0.3 m; simulate 0 .. 1 s }
}
"""


@pytest.mark.parametrize("push", [1.0, 2.0, 5.0])
def test_of_several_rests_the_part_has_that_of_the_whole(push: float) -> None:
    """A search in a part may end at another rest than one in the whole model."""
    model = bondgraph.load(RESTS)
    scene = {"experiment": "go", "settings": {"push": push}}
    part, whole = model.linearize(outputs=("x",), **scene), model.linearize(**scene)
    rest = model.equilibrium("go", {"push": push})
    assert part.y[0] == pytest.approx(whole.y[0], rel=1e-9) == pytest.approx(rest.outputs["x"], rel=1e-9)
    swing = model.modes(outputs=("x",), **scene)[0].frequency
    assert min(abs(mode.frequency - swing) for mode in model.modes(**scene)) < 1e-6 * swing


def test_another_rest_of_a_part_with_events_is_refused() -> None:
    """The state of the whole alone does not say in which mode the part rests."""
    text = RESTS.replace(
        "MSe drive : F = push",
        "mode up = false\n  when spring.x > 1 m { up = true }\n  when spring.x < 0.5 m { up = false }\n  MSe drive : F = push + (0.1 N if up else 0 N)",
    )
    model = bondgraph.load(text)
    scene = {"experiment": "go", "settings": {"push": 4.0}}
    assert model.linearize(**scene).y.shape == (2,)
    with pytest.raises(bondgraph.UsageError, match="has several rests, and finds another one"):
        model.linearize(outputs=("x",), **scene)


def test_a_given_state_may_name_what_is_left_out() -> None:
    model = bondgraph.load(CHAIN)
    state = {"spring.x": 0.2, "cap.q": 1.0}
    part, whole = model.linearize(outputs=("x",), state=state), model.linearize(state=state)
    assert "cap.q" in part.unneeded and part.x[part.states.index("spring.x")] == 0.2
    assert np.array_equal(part.y, whole.y[[whole.outputs.index("x")]])
    with pytest.raises(bondgraph.UsageError, match="is no state; states are"):
        model.linearize(outputs=("x",), state={"cup.q": 1.0})
