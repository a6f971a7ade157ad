"""Stress tests of models: nothing breaks in sound ones, each of some planted defects is found, and small files show it."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.compiled_scene import CompiledScene
from bondgraph.errors import UsageError
from bondgraph.simulation import phase, resume
from bondgraph.simulation.monitors import energy
from bondgraph.simulation.phase_sequence import PhaseSequence
from bondgraph.simulation.run_options import RunRequest
from bondgraph.studies import stress as driver
from bondgraph.studies.stress_bench import StressBench
from bondgraph.studies.stressed import StressTest
from compiler.algebra import derivative
from compiler.algebra.expression import negate
from compiler.equations import derive
from compiler.errors import CompilationFailed
from compiler.graph.units import UNITS, Scale
from compiler.semantics.expressions import expression_compiler, scales
from tests.compiling import MODELS

RING = """model Ring {
  parameter R = 10 ohm, U = 5 V, unused = 3 m
  Se battery : u = U
  1 loop : electric
  R resistor : u = R*i
  I inductor : lambda = 10 mH*i   { start i = 0.1 A }
  C capacitor : q = 10 uF*u       { start u = 2 V }
  battery -> loop -> resistor, inductor, capacitor
  output i = loop.i, u = capacitor.u, loss = resistor.u*loop.i
  experiment go { simulate 0 .. 5 ms }
  experiment other { simulate 0 .. 1 ms }
}
"""
RESTING = RING.replace("{ simulate 0 .. 5 ms }", "{ equilibrium; simulate 0 .. 5 ms }")
SWING = """model Swing {
  parameter m = 1 kg, k = 4 [N/m], k3 = 1 [N/m^3]
  I mass : p = m*v
  C spring : F = k*x + k3*x^3  { start x = 1 m }
  R drag : F = 0.5 [kg/m]*v*abs(v)
  1(mass) -> spring, drag
  output x = spring.x, v = mass.v
  experiment go { simulate 0 .. 10 s }
}
"""
SPRUNG = """model Sprung {
  I mass : p = 1 kg*v
  C spring : energy = 2 [N/m]*x^2 + 1 [N/m^3]*x^4  { start x = 1 m }
  1(mass) -> spring
  output x = spring.x, v = mass.v
  experiment go { simulate 0 .. 3 s }
}
"""
REPELLED = SPRUNG.replace("1 [N/m^3]*x^4", "1 [N/m^5]*x^6").replace(
    "0 .. 3 s", "0 .. 0.2 s"
)  # by a wrong slope, not for long
BALL = """model Ball {
  I mass : p = 1 kg*v
  Se weight : F = -9.81 N
  1 fall : translation
  fall -> mass
  weight -> fall
  signal h = integral(fall.v, 1 m)
  when h <= 0 { mass.v = -0.8*mass.v }
  output height = h
  experiment go { simulate 0 .. 1.6 s }
}
"""


def tried(text: str, *kinds: str, **options: Any) -> StressTest:
    """A test of some kinds of changes only."""
    rows = driver.TRIALS
    driver.TRIALS = tuple(t for t in rows if t.kind in kinds)
    try:
        return bondgraph.load(text).stress(**{"seconds": 14, **options})
    finally:
        driver.TRIALS = rows


@pytest.fixture(autouse=True)
def one_second_a_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that goes by the number of looks at it: the number of changes is the same on every machine."""
    seconds = itertools.count()
    monkeypatch.setattr(driver, "clock", SimpleNamespace(perf_counter=lambda: float(next(seconds))))
    monkeypatch.setattr(driver, "LONGEST", 600.0)


# ---------------------------------------------------------------- sound models


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["dc_motor", "lotka_volterra"])
def test_nothing_breaks_in_sound_models(name: str) -> None:
    result = bondgraph.load(MODELS / f"{name}.bg").stress(seconds=40)
    assert result.holds and not result.doubt, result.summary()
    units = {"units", "SI", "energy"} if name == "lotka_volterra" else set[str]()  # bare numbers have none
    assert {row.kind for row in result.rows if not row.tried} == {*units, "reversed"}, result.summary()


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "text", [RING, SWING, SPRUNG, BALL, RESTING], ids=["ring", "swing", "sprung", "ball", "resting"]
)
def test_nothing_breaks_in_the_models_of_the_defects(text: str) -> None:
    result = bondgraph.load(text).stress(seconds=30)
    assert result.holds, result.summary()


@pytest.mark.parametrize(
    ("text", "applies"),
    [
        (SPRUNG, True), (SWING, False), (RING, False), (BALL, False),
        (SPRUNG.replace("p = 1 kg*v", "v = p/1 kg + 0.1 [s/(kg^2*m)]*p^2"), False),  # another mass in the other direction
        (SPRUNG.replace("1(mass) -> spring", "Se weight : F = 1 N\n  weight -> 1(mass) -> spring"), True),
        (SPRUNG.replace("1(mass) -> spring", "Sf belt : v = 1 [m/s]\n  belt -> 0(spring) -> 1(mass)"), False),
    ],
)  # fmt: skip
def test_way_back(text: str, applies: bool) -> None:
    """It is tried where momenta that are reversed lead back, and only there."""
    result = tried(text, "reversed")
    (row,) = result.rows
    assert (row.tried, row.broke) == (int(applies), 0), result.summary()


def test_corners() -> None:
    result = tried(SWING, "corners", vary={"k": "1 [N/m] .. 100 [N/m]", "m": "0.1 kg .. 1 kg"})
    (row,) = [row for row in result.rows if row.tried]
    assert (row.kind, row.tried, row.held) == ("corners", 4, 4)
    with pytest.raises(UsageError, match="a range is written"):
        tried(SWING, "corners", vary={"k": "1 [N/m]"})


def test_corners_of_starts() -> None:
    result = tried(SWING, "corners", vary={"start spring.x": "1 mm .. 2 m", "start mass.v": "-1 [m/s] .. 1 [m/s]"})
    (row,) = result.rows
    assert (row.kind, row.tried, row.held) == ("corners", 4, 4)
    bench = StressBench(bondgraph.load(SWING), RunRequest("go", {"m": "2 kg"}))
    corner = bench.at({"start spring.x": "0.5 m", "k": "3 [N/m]"}).base()
    text = SWING.replace("{ simulate", "{ set m = 2 kg; set k = 3 [N/m]; start spring.x = 0.5 m; simulate")
    assert (corner["x"] == bondgraph.load(text).simulate(points=len(corner.time))["x"]).all()
    with pytest.raises(CompilationFailed, match="There is no `other`"):
        tried(SWING, "corners", vary={"start other.x": "0 m .. 1 m"})


def test_settings_are_in_the_text() -> None:
    """Where a setting were lost on the way into the text, results would differ."""
    result = tried(RING, "one text", "names", settings={"R": "20 ohm", "U": 4.0})
    assert result.holds and sum(row.tried for row in result.rows) > 2, result.summary()


def test_a_test_takes_a_time() -> None:
    with pytest.raises(UsageError, match="takes a positive time"):
        bondgraph.load(RING).stress(seconds=0)


# ---------------------------------------------------------------- planted defects

Patch = pytest.MonkeyPatch


def other_start(monkeypatch: Patch, change: Callable[[tuple[str, ...], Any], Any]) -> None:
    """Programs start elsewhere: `change` gets the names of the states and their start."""
    program = vars(CompiledScene)["program"].func

    def changed(compiled_scene: CompiledScene) -> Any:
        right = program(compiled_scene)
        names = right.states.names
        return replace(right, start=lambda constants: change(names, np.array(right.start(constants), dtype=float)))

    monkeypatch.setattr(CompiledScene, "program", property(changed))


def wrong_slope(monkeypatch: Patch) -> None:
    right = derivative._power_slope
    monkeypatch.setattr(derivative, "_power_slope", lambda node, i: negate(right(node, i)))


def lost_event(monkeypatch: Patch) -> None:
    right = PhaseSequence.result

    def changed(run: PhaseSequence, stopped: str) -> Any:
        result = right(run, stopped)
        return replace(result, events=result.events[1:]) if result.rtol > 5e-7 else result

    monkeypatch.setattr(PhaseSequence, "result", changed)


def absolute_tolerance(monkeypatch: Patch) -> None:
    right = phase.Phase.tolerances

    def changed(part: phase.Phase) -> Any:
        tolerances = right(part)
        everywhere = np.ones_like(tolerances.absolute)
        return replace(tolerances, absolute=1e-6 * everywhere, held=everywhere > 0)

    monkeypatch.setattr(phase.Phase, "tolerances", changed)


def order_of_states(monkeypatch: Patch) -> None:
    other_start(monkeypatch, lambda names, state: np.where(np.arange(len(state)) == 0, 0.9 * state, state))


def scale_of_a_unit(monkeypatch: Patch) -> None:
    right = scales.scale_of
    wrong = Scale(UNITS["mH"].dimension, 10 * UNITS["mH"].number)
    monkeypatch.setattr(
        expression_compiler, "scale_of", lambda unit: wrong if unit.factors[0][0] == "mH" else right(unit)
    )


def reversed_bond(monkeypatch: Patch) -> None:
    right = derive._balance

    def changed(signs: tuple[int, ...]) -> Any:
        return right((1, *signs[1:]) if len(signs) > 1 and set(signs) == {-1} else signs)

    monkeypatch.setattr(derive, "_balance", changed)


def balance_without_a_state(monkeypatch: Patch) -> None:
    right = energy._changes
    monkeypatch.setattr(energy, "_changes", lambda *arguments: list(right(*arguments))[1:])


def start_behind_a_wall(monkeypatch: Patch) -> None:
    other_start(
        monkeypatch,
        lambda names, state: np.array([0.0 if n.count(".") > 1 else x for n, x in zip(names, state, strict=True)]),
    )


def output_in_single_precision(monkeypatch: Patch) -> None:
    right = PhaseSequence.result

    def changed(run: PhaseSequence, stopped: str) -> Any:
        result = right(run, stopped)
        return replace(result, values=result.values.astype(np.float32).astype(float))

    monkeypatch.setattr(PhaseSequence, "result", changed)


def name_that_matters(monkeypatch: Patch) -> None:
    other_start(
        monkeypatch,
        lambda names, state: np.array([x if n[0] in "ic" else 0.9 * x for n, x in zip(names, state, strict=True)]),
    )


def momentum_lost_on_the_way(monkeypatch: Patch) -> None:
    right = resume.resumed

    def changed(*arguments: Any) -> Any:
        scene, begin, left = right(*arguments)
        return scene, replace(begin, stored={n: 0.999 * x for n, x in begin.stored.items()}), left

    monkeypatch.setattr(resume, "resumed", changed)


DEFECTS = {
    "a partial derivative with another sign": (wrong_slope, REPELLED, "energy"),
    "a lost event": (lost_event, BALL, "tolerances"),
    "an absolute tolerance that does not scale": (absolute_tolerance, SWING, "units"),
    "an order of states that matters": (order_of_states, RING, "order"),
    "a wrong scale of a unit behind numbers": (scale_of_a_unit, RING, "SI"),
    "a reversed bond that keeps its sign": (reversed_bond, RING, "reversed bonds"),
    "a state left out of the energy balance": (balance_without_a_state, RING, "energy"),
    "a start that is ignored behind a wall": (start_behind_a_wall, RING, "wrapped"),
    "an output in single precision": (output_in_single_precision, SWING, "units"),
    "a name that matters": (name_that_matters, RING, "names"),
    "a state that is lost where a run goes on": (momentum_lost_on_the_way, SPRUNG, "reversed"),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_planted_defect_is_found(defect: str, monkeypatch: Patch) -> None:
    plant, text, kind = DEFECTS[defect]
    plant(monkeypatch)
    number = list(DEFECTS).index(
        defect
    )  # a text of its own: nothing that is compiled now is taken from a cache, or later from there
    result = tried(re.sub(r"model (\w+)", rf"model \1_{number}", text), kind)
    assert [item.kind for item in result.breaks] == [kind], result.summary()


# ---------------------------------------------------------------- small files, JSON, command


def test_small_files_show_a_break(monkeypatch: Patch, tmp_path: Path) -> None:
    start_behind_a_wall(monkeypatch)
    result = tried(RING, "wrapped", seconds=400, out=tmp_path)
    (broke,) = result.breaks
    small, changed = (Path(name).read_text(encoding="utf-8") for name in broke.files)
    assert "unused" not in small and "other" not in small and len(small.splitlines()) < len(RING.splitlines())
    assert "Outer" in changed
    runs = [bondgraph.load(small).simulate(), bondgraph.load(changed, "Outer").simulate()]
    assert np.abs(runs[0].values - runs[1].values[:, : runs[0].values.shape[1]]).max() > 1e-3
    data = json.loads(json.dumps(result.to_json()))
    assert data["schema"] == "bondgraph-stress/1" and not data["holds"]
    assert (
        data["breaks"][0]["files"] == list(broke.files)
        and {r["kind"]: r["broke"] for r in data["rows"]}["wrapped"] == 1
    )
    assert all(Path(name).name in result.summary() for name in broke.files)


def test_the_command(monkeypatch: Patch, tmp_path: Path) -> None:
    (tmp_path / "ring.bg").write_text(RING, encoding="utf-8")
    words = ["stress", str(tmp_path / "ring.bg"), "--for", "12 s"]
    sound = CliRunner().invoke(commands, words)
    assert sound.exit_code == 0 and "all held" in sound.output, sound.output
    order_of_states(monkeypatch)
    broken = CliRunner().invoke(commands, [*words[:2], "--for", "40 s", "--json", "--seed", "3"])
    assert broken.exit_code == 3
    assert json.loads(broken.output)["breaks"][0]["sentence"]


def test_a_run_that_ends_at_its_start() -> None:
    """Its one instant is compared."""
    text = "model M { signal x = integral(1 [1/s], 0)\n output y = x\n experiment e { simulate 0 .. 1 s; stop when x >= 0 } }"
    assert bondgraph.load(text).stress(seconds=14).holds
