"""Analyses as steps of an experiment: a step gives the same as a call, under its name, in its units."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from compiler.source import Source
from compiler.syntax.format import format_text

EPS0 = 8.8541878128e-12
PLATE = """\
model Actuator {
  parameter k: N/m = 8, gap = 3 um, A = 1 [mm^2], m = 20 ug, r = 2e-4 [N*s/m]
  constant  eps0 = 8.8541878128e-12 [F/m]
  input volt = 1 V, push = 0 N, pull = 0 N
  MSe plates : F = eps0*A*volt^2/(2*(gap - spring.x)^2)
  MSe drive  : F = push - pull
  1   plate
  C   spring : F = k*x
  I   mass   : p = m*v
  R   air    : F = r*v
  plates -> plate -> spring, mass, air
  drive -> plate
  output x = spring.x, F = spring.F
  experiment pull_in { continue volt over 0 V .. 2.6888 V; report F in uN }
  experiment held { sweep goal: um = 0.2, 0.4, 0.6; invert volt to x = goal; report F in uN }
  experiment pair { set volt = 0 V; sweep goal: um = -0.5, 0.5; invert push/pull to x = goal }
  experiment path {
    set volt = 0 V
    invert push to x = gap/6*smoothstep9(time, 0 s, 2 ms) over 0 .. 2 ms { points = 41, limit push = 1 mN }
  }
  experiment spread { set volt = 0 V; montecarlo k = normal(8 [N/m], 0.2 [N/m]), m = uniform(19 ug, 21 ug) { samples = 32, seed = 3, indices = 16 }; modes }
  experiment spreads { sweep volt = 0.5 V, 1 V; montecarlo k = truncated(normal(8 [N/m], 0.2 [N/m]), 7 [N/m], 9 [N/m]), gap = uniform(2.9 um, 3.1 um), correlation(k, gap) = 0.5 { samples = 8 }; equilibrium; modes; report x in um }
  experiment slopes { modes; sensitivity k, gap; linearize volt to x, spring.F }
  experiment survey { set volt = 0.5 V; bode { points = 50 } }
  experiment along { set volt = 2 V; simulate 0 .. 0.2 ms { points = 11 }; sensitivity k; report x in um }
}
"""
FIT = (
    PLATE.rstrip().removesuffix("}")
    + '  experiment bench { fit k = 1 [N/m] .. 20 [N/m], gap to "pulls.csv" { scale k = log }; report F }\n}\n'
)


@pytest.fixture(scope="module")
def plate() -> bondgraph.Model:
    return bondgraph.load(PLATE)


def test_a_branch_folds_at_a_third_of_the_gap(plate: bondgraph.Model) -> None:
    """x = g/3, V^2 = 8 k g^3/(27 eps A)."""
    (point,) = plate.run("pull_in")
    (fold,) = point.of("continue").folds
    volt = math.sqrt(8 * 8.0 * 3e-6**3 / (27 * EPS0 * 1e-6))
    assert fold.value == pytest.approx(volt, rel=1e-8)
    assert fold.states["spring.x"] == pytest.approx(1e-6, rel=1e-8)
    assert point.numbers()["fold 1 of volt"] == fold.value and point.units()["fold 1 of volt"] == "V"


def test_bode_needs_no_names(plate: bondgraph.Model) -> None:
    """From all inputs to all outputs; at rest at w -> 0, x/push = 1/(k - slope of the plates' force)."""
    (point,) = plate.run("survey")
    (found,) = point.responses
    called = plate.response(points=50, experiment=None, settings={"volt": 0.5})
    assert (found.inputs, found.outputs) == (called.inputs, called.outputs) == (("volt", "push", "pull"), ("x", "F"))
    assert np.array_equal(found.values, called.values) and np.array_equal(found.frequencies, called.frequencies)
    at_rest = plate.equilibrium(None, settings={"volt": 0.5})["x"]
    stiffness = 8 - EPS0 * 1e-6 * 0.5**2 / (3e-6 - at_rest) ** 3
    assert abs(found.of("push", "x")[0]) == pytest.approx(1 / stiffness, rel=0.02)
    assert "peak of push to x" in point.numbers()


def test_setpoints_become_a_table_of_inputs(plate: bondgraph.Model) -> None:
    """eps A V^2/(2 (g - x)^2) = k x. The swept name belongs to the experiment, and outputs outside of the report are not needed."""
    found = plate.run("held")
    x = found("goal")
    assert x == pytest.approx([2e-7, 4e-7, 6e-7])
    assert found("volt") == pytest.approx(np.sqrt(2 * 8 * x * (3e-6 - x) ** 2 / (EPS0 * 1e-6)), rel=1e-12)
    assert found.units == {"goal": "m", "volt": "V"}
    pair = plate.run("pair")
    assert pair("push") == pytest.approx([0, 4e-6], abs=1e-18) and pair("pull") == pytest.approx([4e-6, 0], abs=1e-18)


def test_a_path_reads_parameters(plate: bondgraph.Model) -> None:
    """push = m x'' + r x' + k x along x = g/6 s(t), for any setting of the gap."""
    for gap in (3e-6, 6e-6):
        (point,) = plate.run("path", {"gap": gap})
        lead = point.of("invert")
        s = lead.time / 2e-3
        shape = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])  # smoothstep9
        first, second = shape.deriv(1)(s) / 2e-3, shape.deriv(2)(s) / 2e-3**2
        force = gap / 6 * (20e-9 * second + 2e-4 * first + 8 * shape(s))
        assert lead["push"] == pytest.approx(force, rel=1e-9, abs=1e-9 * force.max())
        assert point.numbers() == {"largest push": pytest.approx(force.max(), rel=1e-9)}


def test_chance_is_that_of_the_call(plate: bondgraph.Model) -> None:
    (point,) = plate.run("spread")
    found = point.of("montecarlo")
    vary = {"k": "normal(8 N/m, 0.2 N/m)", "m": "uniform(19 ug, 21 ug)"}
    called = plate.montecarlo(vary, "modes", 32, seed=3, indices=16, settings={"volt": 0.0})
    assert (found.values == called.values).all() and (found.samples == called.samples).all()
    natural = np.sqrt(found("k") / found("m")) / (2 * np.pi)
    assert found("frequency 1") == pytest.approx(natural, rel=1e-9)
    assert point.numbers()["mean of frequency 1"] == pytest.approx(natural.mean())
    assert found.indices is not None and found.indices.count == 16
    with pytest.raises(bondgraph.UsageError, match="many runs"):
        plate.simulate("spread")


def test_chance_in_a_sweep(plate: bondgraph.Model) -> None:
    """At each swept value a study: of rest, x = F/k and somewhat more, and of the frequency."""
    found = plate.run("spreads")
    assert len(found) == 2 and found("volt") == pytest.approx([0.5, 1])
    for point in found:
        chance = point.of("montecarlo")
        assert chance.of == ("equilibrium", "modes") and len(chance) == 8
        assert ((chance("k") >= 7) & (chance("k") <= 9)).all()
        assert chance.correlations == {("k", "gap"): 0.5}
        assert chance("x") == pytest.approx(
            EPS0 * 1e-6 * point.settings["volt"] ** 2 / (2 * chance("k") * 9e-12), rel=0.2
        )


def test_slopes_and_linear_models(plate: bondgraph.Model) -> None:
    (point,) = plate.run("slopes")
    slopes, linear = point.of("sensitivity"), point.of("linearize")
    called = plate.sensitivity(("k", "gap"), "modes")
    assert slopes.quantities == called.quantities and slopes.slopes == pytest.approx(called.slopes)
    assert point.modes is not None and linear.outputs == ("x", "spring.F") and linear.inputs == ("volt",)
    (mode,) = np.abs(np.linalg.eigvals(linear.A))[:1]
    assert mode == pytest.approx(2 * np.pi * point.modes[0].frequency, rel=1e-9)
    entries = point.of("sensitivity of linearize")
    assert entries.parameters == ("k", "gap") and "A[spring.x, mass.p]" in entries.quantities
    assert entries.of("C[spring.F, spring.x]", "k") == pytest.approx(1) and len(point.analyses) == 3
    assert point.units()["frequency 1 by k"] == "Hz/(N/m)" or point.units()["frequency 1 by k"].startswith("Hz/(")


def test_slopes_of_a_response(plate: bondgraph.Model) -> None:
    text = plate.source.text.replace(
        "experiment slopes",
        "experiment answers { response volt to x over 1 kHz .. 1 MHz; sensitivity k }\n  experiment slopes",
    )
    (point,) = bondgraph.load(text).run("answers")
    (told,) = (found for word, found in point.analyses if word == "sensitivity of response")
    (given,) = point.responses
    assert (told.response.values == given.values).all() and told.parameters == ("k",)
    assert "degrees per percent" in bondgraph.load(text).run("answers").summary()


def test_slopes_of_a_run(plate: bondgraph.Model) -> None:
    (point,) = plate.run("along")
    assert point.run is not None and len(point.run.time) == 11
    slopes = point.of("sensitivity")
    step = 8e-4
    ends = [plate.simulate("along", {"k": 8 + sign * step}, rtol=1e-10).final("x") for sign in (1, -1)]
    assert slopes.of("x", "k")[-1] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)


def test_a_fit_of_a_file_beside_the_model(tmp_path: Path, plate: bondgraph.Model) -> None:
    rows = [(v, plate.equilibrium(None, settings={"volt": v, "k": 8.4})["x"] * 1e6) for v in (1.0, 1.6, 2.0, 2.4)]
    (tmp_path / "pulls.csv").write_text(
        "volt [V],x [um]\n" + "".join(f"{v},{x!r}\n" for v, x in rows), encoding="utf-8"
    )
    (tmp_path / "plate.bg").write_text(FIT, encoding="utf-8")
    (point,) = bondgraph.load(tmp_path / "plate.bg").run("bench")
    found = point.of("fit")
    assert found["k"] == pytest.approx(8.4, rel=1e-6) and found["gap"] == pytest.approx(3e-6, rel=1e-6)
    assert point.numbers() == {"k": found["k"], "gap": found["gap"]}
    with pytest.raises(bondgraph.CompilationFailed, match="this text is no file"):
        bondgraph.load(FIT).run("bench")


def test_the_command_line(tmp_path: Path) -> None:
    file = tmp_path / "plate.bg"
    file.write_text(PLATE, encoding="utf-8")
    told = CliRunner().invoke(commands, ["run", str(file), "-e", "held", "--jobs", "1", "--json"])
    assert told.exit_code == 0, told.output
    points = json.loads(told.output)["points"]
    assert [p["analyses"][0]["step"] for p in points] == ["invert"] * 3
    assert points[0]["analyses"][0]["schema"] == "bondgraph-inversion/1"
    shown = CliRunner().invoke(commands, ["run", str(file), "-e", "along", "--plot", str(tmp_path / "a.png")])
    assert shown.exit_code == 0, shown.output
    assert "sensitivity of a run" in shown.output and "11 instants" in shown.output
    lines = CliRunner().invoke(commands, ["run", str(file), "-e", "spread", "--set", "k=9 [N/m]"])
    assert lines.exit_code == 2 and "`k` is set and varies" in lines.output


def test_formatting_keeps_them() -> None:
    text = format_text(Source("plate", FIT))
    assert format_text(Source("plate", text)) == text
    crowded = FIT.replace("push/pull to x = goal", "push / pull to x=goal")
    assert format_text(Source("plate", crowded)) == text
