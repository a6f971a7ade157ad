"""Conditional parts: a model with a branch taken is the model that has that branch only."""

from __future__ import annotations

import re

import numpy as np
import pytest

import bondgraph
from compiler.graph.network import MechanismNode
from compiler.source import Source
from compiler.syntax.format import format_text
from compiler.unparse import write_text
from tests.compiling import compiled, mistake, mistakes, outputs_of

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]
OSCILLATOR = """
model Oscillator {
  parameter damped = true, n = 1
  I mass : p = 1 kg*v               { start v = 1 [m/s] }
  1 body
  body -> mass
  for i in 1..n { C spring[i] : F = 100/n*1 [N/m]*x; body -> spring[i] }
  if damped and n <= 2 {
    R damper : F = 2 [N*s/m]*v
    body -> damper
    output loss = damper.F*damper.v
  } else if n > 2 {
    C extra : F = 300 [N/m]*x
    body -> extra
  }
  output x = spring[1].x
  experiment ring { simulate 0 .. 1 s }
  experiment both { sweep damped = true, false; simulate 0 .. 1 s }
}
"""


def flat(text: str, settings: dict[str, str] | None = None) -> list[str]:
    """Lines of the flat text of the model `A`, without comments, in any order."""
    return sorted(re.sub(r" *#.*", "", write_text(compiled(text, settings, model="A").whole_graph)).splitlines())


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("settings", "r", "k"),
    [({}, 2.0, 100.0), ({"damped": False}, 0.0, 100.0), ({"damped": 0, "n": 3}, 0.0, 400.0), ({"n": "2"}, 2.0, 100.0)],
)
def test_the_taken_branch_against_a_closed_form(target: str, settings: dict[str, float], r: float, k: float) -> None:
    result = bondgraph.load(OSCILLATOR).simulate("ring", settings=settings, target=target, rtol=1e-10, points=11)
    w = np.sqrt(k - r**2 / 4)
    assert result["x"] == pytest.approx(np.exp(-r / 2 * result.time) * np.sin(w * result.time) / w, abs=1e-9)
    assert ("loss" in result.names) is (r > 0)


def test_a_sweep_and_many_runs_go_through_branches() -> None:
    model = bondgraph.load(OSCILLATOR)
    many = model.simulate_many(
        [{"damped": True}, {"damped": False}, {"damped": "false"}], experiment="ring", outputs=("x",)
    )
    runs = [many[i].final("x") for i in range(3)]
    assert runs == pytest.approx([np.exp(-1) * np.sin(99**0.5) / 99**0.5, np.sin(10) / 10, np.sin(10) / 10], abs=1e-6)
    swept = [p.numbers()["x"] for p in model.run("both", outputs=("x",))]
    assert swept == pytest.approx(runs[:2], abs=1e-12)


BRANCHES = """
model Part {
  parameter heats = false
  port a: electric
  if heats { port heat: thermal; RS wire(el: electric, th) : el.u = 2 ohm*el.i; a -> wire.el; wire.th -> heat }
  else { R wire : u = 2 ohm*i; a -> wire }
}
model A {
  parameter hot = true, n = 2
  constant few = n < 3
  Se supply : u = 12 V
  I core : lambda = 0.1 H*i
  1 loop
  supply -> loop -> core
  Part part { heats = hot }
  loop -> part.a
  if few { if hot { C case : T = 293 K*exp(S/500 [J/K]); part.heat -> case; output T = case.T } }
  else { if hot { Se out : T = 300 K; part.heat -> out } }
  for k in 1..n {
    if k == 2 { R short[k] : u = k*1 ohm*i; loop -> short[k] }
    else if k > 2 { C short[k] : u = q/(1 F); loop -> short[k] }
  }
}
"""
HOT = "RS wire(el: electric, th) : el.u = 2 ohm*el.i; a -> wire.el; wire.th -> heat"
HEAD = """model A {
  parameter hot = HOT, n = N
  constant few = n < 3
  Se supply : u = 12 V
  I core : lambda = 0.1 H*i
  1 loop
  supply -> loop -> core
  Part part { heats = hot }
  loop -> part.a
"""


@pytest.mark.parametrize(("hot", "n"), [("true", 2), ("true", 3), ("false", 1), ("false", 3)])
def test_the_flat_text_is_that_of_the_model_written_by_hand(hot: str, n: int) -> None:
    port = "port heat: thermal; " + HOT if hot == "true" else "R wire : u = 2 ohm*i; a -> wire"
    part = f"model Part {{ parameter heats = false; port a: electric; {port} }}\n"
    lines = []
    if hot == "true":
        lines += (
            ["C case : T = 293 K*exp(S/500 [J/K])", "part.heat -> case", "output T = case.T"]
            if n < 3
            else ["Se out : T = 300 K", "part.heat -> out"]
        )
    lines += ["for k in 2..2 { R short[k] : u = k*1 ohm*i; loop -> short[k] }"] * (n > 1)
    lines += ["for k in 3..n { C short[k] : u = q/(1 F); loop -> short[k] }"] * (n > 2)
    by_hand = part + HEAD.replace("HOT", hot).replace("N", str(n)) + "\n".join(lines) + "\n}\n"
    assert flat(BRANCHES, {"hot": hot, "n": str(n)}) == flat(by_hand)


def test_in_a_mechanism() -> None:
    """A rod of length 1 or 2 on a pin, with or without weight; a second one only where it is asked for."""
    text = """
    model A {
      parameter long = true, weighs = true, n = 1
      multibody arm : planar {
        if weighs { gravity = (0, -10 [m/s^2]) }
        if long { constant l = 2 m } else { constant l = 1 m }
        body rod { mass = 1 kg, inertia = 0, at = (l, 0) }
        hinge pin : ground to rod { at = (0, 0) }
        if n > 1 { body two { mass = 1 kg, inertia = 1 [kg*m^2], at = (l, 0) }; hinge pin2 : rod to two { at = (l, 0) } }
      }
      output phi = arm.pin.phi, y = arm.rod.y, tau = arm.pin.phi.omega
      experiment fall { simulate 0 .. 1 ms { rtol = 1e-10, points = 2 } }
    }
    """
    model = bondgraph.load(text)
    for settings, acceleration in (({}, -5.0), ({"long": False}, -10.0), ({"weighs": False}, 0.0)):
        assert model.simulate(settings=settings).final("tau") == pytest.approx(acceleration * 1e-3, abs=1e-9)
    for n in (1, 2):
        (mechanism,) = (
            x.mechanism for x in compiled(text, {"n": str(n)}).whole_graph.nodes if isinstance(x, MechanismNode)
        )
        assert [joint.name for joint in mechanism.joints] == ["pin", "pin2"][:n]


def test_order_does_not_matter() -> None:
    """Conditions are read before all branches: one cannot read what another branch declares."""
    lines = [
        "parameter n = 2",
        "if n > 1 { constant k = 3 } else { constant k = 4 }",
        "output y = k*n",
        "if n < 5 { signal z = k }",
    ]
    for text in ("\n".join(lines), "\n".join(reversed(lines))):
        assert outputs_of(compiled(f"model A {{ {text}\n}}")) == {"y": 6.0}
        assert outputs_of(compiled(f"model A {{ {text}\n}}", {"n": "1"})) == {"y": 4.0}
    found = mistake("model A { parameter n = 2\n if n > 1 { constant k = 3 }\n if k > 2 { signal a = 1 }\n}", "BG170")
    assert found.span.line == 3


def test_a_missing_value_leaves_both_branches_open_in_a_file_of_parts() -> None:
    part = "model Part { parameter n; port a: electric\n if n > 1 { R r : u = 1 ohm*i } else { C r : u = q/(1 F) }\n a -> r\n output y = r.u }\n"
    assert mistakes(part) == ()
    whole = part + "model A { Se s : u = 1 V; Part p { n = 2 }; s -> p.a; output y = p.r.i }"
    assert outputs_of(compiled(whole, model="A"))["y"] == 1.0


def test_a_truth_of_an_instance_leaves_other_instances_alone() -> None:
    """A place of the text is compiled once: the default says whether a parameter is a truth."""
    text = "model P { parameter n = 1, on = false; output y = 2*n, z = 5 if on else 7 }\n"
    text += "model A { P a { n = true; on = 1 }\n P b { n = 3 }\n output y = a.y, w = b.y, c = a.z, d = b.z }"
    assert outputs_of(compiled(text)) == {"y": 2.0, "w": 6.0, "c": 5.0, "d": 7.0}


def test_values_of_the_command_line_are_checked() -> None:
    model = bondgraph.load(OSCILLATOR)
    for settings, code in (({"damped": 0.5}, "BG122"), ({"n": 1.5}, "BG171")):
        with pytest.raises(bondgraph.CompilationFailed, match=code):
            model.simulate(settings=settings)
    with pytest.raises(bondgraph.CompilationFailed, match="BG170"):
        model.simulate(settings={"damped": False}, outputs=("loss",))


def test_formatting_keeps_branches_in_columns() -> None:
    before = "model A {\nparameter n=2\nif n>1 {\nsignal a=1\n}\n# none\nelse if n==1 {signal a=2}\nelse {\nsignal a=3\n}\noutput y=a\nif n>0\nelse 2\n}\n"
    after = "model A {\n  parameter n = 2\n  if n > 1 {\n    signal a = 1\n  }\n  # none\n  else if n == 1 { signal a = 2 }\n  else {\n    signal a = 3\n  }\n  output y = a\n    if n > 0\n    else 2\n}\n"
    assert format_text(Source("t", before)) == after == format_text(Source("t", after))
