"""Outputs and reports: quantities that a run shows, their names and units; plans of experiments."""

from __future__ import annotations

import pytest

from compiler.errors import CompilationFailed
from compiler.scene import Plan
from tests.compiling import Running, compiled, mistake, mistakes, refused, units_of

TEXT = """
model A {
  parameter m = 2 kg, k: N/m = 8, room = 20 degC
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x
  body -> mass, spring
  output x = spring.x "how far", F = spring.F, E = 1/2*k*x^2, angle = 30 deg, T = room, both = (spring.x, mass.v), hit = spring.x > 1 m
  experiment first {
    "The first one is the default."
    simulate 0 .. 2 s { rtol = 1e-8, points = 11, atol = 1e-9, tolerance spring.x = 1 um, tolerance x = 2 um }
    report x in mm, F in kN, angle in deg, T in degC, (x - 1 m) in um, E, both[2], 2*F
  }
  experiment second { simulate 1 s .. 3 s }
}
"""


def plan(experiment: str | None) -> Plan:
    return compiled(TEXT, experiment=experiment).plan


def test_outputs_with_their_units() -> None:
    compilation = compiled(TEXT)
    assert units_of(compilation) == {
        "x": "m",
        "F": "N",
        "E": "N*m",
        "angle": "1",
        "T": "K",
        "both[1]": "m",
        "both[2]": "m/s",
        "hit": "1",
    }
    found = Running(compilation).outputs({"spring.x": 3.0, "mass.p": 4.0})
    assert found == pytest.approx(
        {
            "x": 3.0,
            "F": 24.0,
            "E": 36.0,
            "angle": 0.5235987755982988,
            "T": 293.15,
            "both[1]": 3.0,
            "both[2]": 2.0,
            "hit": 1.0,
        }
    )
    assert compilation.whole_graph.outputs["x"].description == "how far"


def test_an_output_is_a_signal_to_others() -> None:
    """`E` above reads the output x."""
    text = "model A {\n  parameter a = 3\n  output y = 2*a, z = y + 1\n  signal s = z^2\n  output w = s\n}\n"
    assert Running(compiled(text)).outputs() == {"y": 6.0, "z": 7.0, "w": 49.0}


def test_reports_choose_names_units_and_expressions() -> None:
    found = plan("first")
    assert [(r.name, r.unit) for r in found.report] == [
        ("x", "mm"), ("F", "kN"), ("angle", "deg"), ("T", "degC"), ("(x - 1 m)", "um"), ("E", "N*m"), ("both[2]", "m/s"), ("2*F", "N"),
    ]  # fmt: skip
    values = {r.name: (r.scale, r.offset) for r in found.report}
    assert values["x"] == (1000.0, 0.0)
    assert values["angle"][0] == pytest.approx(57.29577951308232, rel=1e-15)
    scale, offset = values["T"]
    assert scale * 293.15 + offset == pytest.approx(20.0, abs=1e-12)


def test_a_run_computes_what_it_reports() -> None:
    assert compiled(TEXT, experiment="second").program.outputs.names == (
        "x",
        "F",
        "E",
        "angle",
        "T",
        "both[1]",
        "both[2]",
        "hit",
    )
    names = compiled(TEXT, experiment="first").program.outputs.names
    assert len(names) == 8 and {"x", "2*F"} <= set(names) and "hit" not in names
    running = Running(compiled(TEXT, experiment="first"))
    assert running.outputs({"spring.x": 3.0})["2*F"] == 48.0


def test_plans() -> None:
    first, second, default, none = plan("first"), plan("second"), plan(""), plan(None)
    assert (first.experiment, first.start, first.stop) == ("first", 0.0, 2.0)
    assert dict(first.settings) == {"rtol": 1e-8, "points": 11.0, "atol": 1e-9}
    assert dict(first.tolerances) == {"spring.x": 1e-6, "x": 2e-6}
    assert (second.start, second.stop, second.report) == (1.0, 3.0, ())
    assert default.experiment == "first"
    assert (none.experiment, none.stop, none.report) == (None, None, ())


def test_only_these_outputs() -> None:
    compilation = compiled(TEXT, outputs=("E", "x"))
    assert set(compilation.program.outputs.names) == {"E", "x"}
    assert "`wrong`" in refused(compiled(TEXT, outputs=("x", "wrong")), "BG101").sentence


@pytest.mark.parametrize("name", ["third", "frist"])
def test_an_experiment_that_is_not_there(name: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        plan(name)
    (found,) = failed.value.diagnostics
    assert found.code == "BG101" and "first" in found.help


@pytest.mark.parametrize(
    ("step", "code"),
    [
        ("simulate 1 s .. 0", "BG150"), ("simulate 0 .. 0", "BG150"), ("simulate 0 .. 3", "BG103"), ("simulate 0 .. 3 m", "BG103"), ("simulate 0 .. time", "BG106"),
        ("simulate 0 .. 1 s { rtol = 0 }", "BG150"), ("simulate 0 .. 1 s { rtol = 2 }", "BG150"), ("simulate 0 .. 1 s { points = 1 }", "BG150"), ("simulate 0 .. 1 s { points = 2.5 }", "BG150"),
        ("simulate 0 .. 1 s { step = 3 }", "BG120"), ("simulate 0 .. 1 s { tolerance x = 1 N }", "BG103"), ("simulate 0 .. 1 s { tolerance x = -1 um }", "BG150"),
        ("simulate 0 .. 1 s { tolerance nothing = 1 um }", "BG101"), ("simulate 0 .. 1 s\n    simulate 0 .. 2 s", "BG150"), ("simulate 0 .. 1 s\n    report nothing", "BG101"),
        ("simulate 0 .. 1 s\n    report x in N", "BG103"), ("simulate 0 .. 1 s\n    report both", "BG111"), ("simulate 0 .. 1 s\n    report x in nothing", "BG102"),
        ("set nothing = 3\n    simulate 0 .. 1 s", "BG101"), ("set x = 3 m\n    simulate 0 .. 1 s", "BG101"), ("set m = 3 m\n    simulate 0 .. 1 s", "BG103"),
        ("set m = time\n    simulate 0 .. 1 s", "BG106"),
    ],
)  # fmt: skip
def test_experiments_that_are_wrong_are_told_by_check(step: str, code: str) -> None:
    """`check` reads every experiment, the first and the others."""
    for place in ("first", "second"):
        start = TEXT.index(f"experiment {place} {{")
        end = TEXT.index("\n  }\n", start) + 5 if place == "first" else TEXT.index("}\n", start) + 2
        text = TEXT[:start] + f"experiment {place} {{\n    {step}\n  }}\n" + TEXT[end:]
        found = mistakes(text)
        assert [d.code for d in found] == [code], (place, [d.sentence for d in found])


def test_sweeps_and_studies_are_planned() -> None:
    """In SI, in their order; `equilibrium` before `simulate` says where the run starts and is no study."""
    text = """model A {
  parameter m = 2 kg
  input u = 0 N
  output y = u/m
  experiment e { sweep m = 1 kg, 2000 g; sweep load: mN = 3, 4; set u = load; equilibrium; simulate 0 .. 1 s }
  experiment f { equilibrium; modes; response u to y over 1 Hz .. 1 kHz { points = 20 } }
}
"""
    assert mistakes(text) == ()
    plan = compiled(text, experiment="e").plan
    assert [(s.name, s.values, s.unit) for s in plan.sweeps] == [("m", (1, 2), "kg"), ("load", (0.003, 0.004), "N")]
    assert plan.equilibrium and not plan.studies and plan.stop == 1
    plan = compiled(text, experiment="f").plan
    assert [s.role for s in plan.studies] == ["equilibrium", "modes", "response"] and not plan.equilibrium
    bode = plan.studies[-1]
    assert (bode.given, bode.seen, bode.low, bode.high, bode.points) == ("u", "y", 1, 1000, 20)


@pytest.mark.parametrize(
    ("step", "code"),
    [
        ("sweep load = 1, 2", "BG150"),  # nobody reads it
        ("sweep y = 1 [N/kg]", "BG150"),
        ("sweep m = 1 kg, 2 m", "BG103"),
        ("sweep m = 1 kg; sweep m = 2 kg", "BG150"),
        ("modes { points = 3 }", "BG120"),
        ("response u to w over 1 Hz .. 2 Hz", "BG101"),
        ("response u to y over 2 Hz .. 1 Hz", "BG150"),
        ("response u to y over 1 Hz .. 2 Hz { points = 1 }", "BG150"),
        ("response u to y over 1 s .. 2 s", "BG103"),
    ],
)
def test_studies_that_are_wrong_are_told_by_check(step: str, code: str) -> None:
    text = f"model A {{\n  parameter m = 2 kg\n  input u = 0 N\n  output y = u/m\n  experiment e {{\n    {step}\n  }}\n}}\n"
    assert [d.code for d in mistakes(text)] == [code], [d.sentence for d in mistakes(text)]


def test_two_outputs_of_one_name() -> None:
    mistake("model A {\n  output y = 1\n  output y = 2\n}\n", "BG104")


def test_outputs_of_instances_are_not_reported() -> None:
    text = "model Part { output inner = 3 }\nmodel A {\n  Part p\n  output y = 2*p.inner\n}\n"
    assert Running(compiled(text)).outputs() == {"y": 6.0}
