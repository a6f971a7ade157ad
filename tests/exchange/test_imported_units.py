"""Imported units: what was exported runs in a model as the model itself does; what no model can hold, and what no analysis can, is refused by name."""

from __future__ import annotations

import math
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.language_service.completion import completion
from bondgraph.language_service.navigation import definition
from bondgraph.language_service.workspace import Workspace
from bondgraph.simulation.run_options import RunRequest
from bondgraph.studies.stress_bench import StressBench
from compiler.api import Inapplicable, read_unit_description
from compiler.errors import CompilationFailed
from compiler.semantics.names.unit_file import unit_model
from tests.exchange.test_power_ports import CAR
from tests.exchange.unit_files import exported

pytestmark = pytest.mark.machine_code
MODELS = Path(__file__).resolve().parents[2] / "models"
DRIVE = """model Drive {
  "A controller."
  input omega: rad/s = 0
  parameter target = 50 rad/s, K: V*s/rad = 0.2
  output volt = K*(target - omega)
  experiment e { simulate 0 .. 1 s }
}"""
LOOP = """import Drive from "unit.fmu"
model Loop {
  parameter h = 5 ms
  Drive drive { communication_step = h, omega = rotor.omega, K = 0.3 [V*s/rad] }
  MSe supply : M = 0.01 [A*s]*drive.volt*1 [N*m/(V*A*s)]
  I rotor : L = 0.002 [kg*m^2]*omega
  R drag  : M = 1 [mN*m*s]*omega
  supply -> 1(rotor, drag)
  output omega = rotor.omega, volt = drive.volt
  experiment go { simulate 0 .. 0.1 s { points = 11 } }
  experiment rest { equilibrium; simulate 0 .. 0.1 s }
  experiment late { simulate 2 ms .. 0.1 s }
}"""


@pytest.fixture(autouse=True)
def _allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BONDGRAPH_RUN_FMU", "1")


def written(text: str, path: Path) -> Path:
    (path / "m.bg").write_text(text, encoding="utf-8")
    return path / "m.bg"


@pytest.fixture(scope="module")
def description(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("drive") / "unit.fmu"
    bondgraph.load(DRIVE).to_fmu(file)
    with zipfile.ZipFile(file) as archive:
        return archive.read("modelDescription.xml").decode()


def without_steps(path: Path) -> None:
    """Leave model exchange alone in the description of a unit."""
    with zipfile.ZipFile(path / "unit.fmu") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    pattern = rb"<CoSimulation([^>]*/>|.*?</CoSimulation>)"
    parts["modelDescription.xml"] = re.sub(pattern, b"", parts["modelDescription.xml"], flags=re.DOTALL)
    with zipfile.ZipFile(path / "unit.fmu", "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)


def importing(path: Path, name: str, uses: str, outputs: str, to: str) -> object:
    text = f'import {name} from "unit.fmu"\nmodel Uses {{\n  {name} u {{ {uses} }}\n  output {outputs}\n  experiment e {{ simulate 0 .. {to} {{ points = 41 }} }}\n}}'
    return bondgraph.load(written(text, path)).simulate()


@pytest.mark.parametrize(
    ("name", "outputs", "to"), [("oscillator", ("position",), "2 s"), ("pid_dc_motor", ("phi", "current"), "0.4 s")]
)
def test_a_model_in_a_unit_runs_as_the_model_itself(
    name: str, outputs: tuple[str, ...], to: str, tmp_path: Path
) -> None:
    text = re.sub(r"(simulate 0 \.\. \d+ s)", r"\1 { rtol = 1e-9 }", (MODELS / f"{name}.bg").read_text())
    model = bondgraph.load(text)
    unit = exported(text, tmp_path, model.experiments[0])
    found = importing(tmp_path, unit.modelName, "communication_step = 10 ms", ", ".join(f"{o} = u.{o}" for o in outputs), to)  # fmt: skip
    mine = model.simulate(to=to, points=41, rtol=1e-9)
    for output in outputs:
        assert np.abs(found[output] - mine[output]).max() < 1e-6 * np.abs(mine[output]).max()
    assert "co-simulated in steps of 0.01 s" in found.notes[0] and found.unit(outputs[0]) == mine.unit(outputs[0])


@pytest.mark.parametrize("fmi", ["2", "3"])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_bouncing_ball_in_a_unit_follows_its_closed_form(kind: str, fmi: str, tmp_path: Path) -> None:
    """It falls 1 m, then bounces with 0.7: between the first two bounces h = v t - g t^2/2 with v = 0.7*sqrt(2 g)."""
    text = """model Ball {
      parameter bounce = 0.8
      I mass : p = 0.1 kg*v
      Se weight : F = -0.981 N
      weight -> 1(mass)
      signal h = integral(mass.v, 1 m)
      output height = h
      when h < 0 m { mass.v = -bounce*mass.v }
      experiment drop { simulate 0 .. 1 s }
    }"""
    exported(text, tmp_path, fmi=fmi)
    if kind == "ModelExchange":
        without_steps(tmp_path)
    found = importing(tmp_path, "Ball", "communication_step = 5 ms, bounce = 0.7", "h = u.height", "1 s")
    t = found.time
    fall, v = math.sqrt(2 / 9.81), 0.7 * math.sqrt(2 * 9.81)
    after = t - fall
    closed = np.where(t < fall, 1 - 9.81 / 2 * t**2, v * after - 9.81 / 2 * after**2)
    assert (
        fall + 2 * v / 9.81 > t[-1]
        and np.abs(found["h"] - closed).max() < {"CoSimulation": 1e-9, "ModelExchange": 2e-6}[kind]
    )


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_loop_over_a_unit_is_that_of_a_sampled_controller(fmi: str, tmp_path: Path) -> None:
    """L omega' = -b omega + 0.01 volt, with volt of the step before: w' = w e + (1 - e) 0.01 u/b in each step, e = exp(-b h/L)."""
    exported(DRIVE, tmp_path, fmi=fmi)
    model = bondgraph.load(written(LOOP, tmp_path))
    found = model.simulate(rtol=1e-10)
    w, e, h = 0.0, math.exp(-1e-3 * 5e-3 / 0.002), 5e-3
    volts, speeds = [15.0], [0.0]
    for _ in range(20):
        before = volts[-1]
        volts.append(0.3 * (50 - w))  # of the speed at the point before
        w = w * e + (1 - e) * 0.01 * before / 1e-3
        speeds.append(w)
    at = np.round(found.time / h).astype(int)
    assert found["omega"] == pytest.approx(np.array(speeds)[at], rel=1e-8)
    assert found["volt"] == pytest.approx(np.array(volts)[at], rel=1e-8)
    again = model.simulate(rtol=1e-10)
    assert np.array_equal(again["omega"], found["omega"])  # a unit begins anew in each run
    one, two = (np.array(model.simulate(settings={"h": f"{h} ms"}, rtol=1e-9)["omega"])[-1] for h in (0.5, 0.25))
    exact = 0.15 / 4e-3 * (1 - math.exp(-4e-3 / 0.002 * 0.1))  # of a controller that acts at all times
    assert abs(two - exact) < 0.6 * abs(one - exact) < 1e-2  # of first order in the step


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_behaviour_of_the_reference_units(kind: str, tmp_path: Path) -> None:
    """Those of the Modelica Association's list, written here: a stair counts each second, what is fed through is one step late."""
    text = """model Reference {
      input continuous_input = 0
      parameter mu = 1
      mode counter = 0
      every 1 s { counter = counter + 1 }
      signal x0 = integral(x1/1 s, 2), x1 = integral((mu*(1 - x0^2)*x1 - x0)/1 s, 0)
      output n = counter, y = continuous_input, y0 = x0
      experiment e { simulate 0 .. 2 s }
    }"""
    exported(text, tmp_path)
    if kind == "ModelExchange":
        without_steps(tmp_path)
    found = importing(tmp_path, "Reference", "communication_step = 25 ms, continuous_input = time/1 s", "n = u.n, y = u.y, y0 = u.y0", "2 s")  # fmt: skip
    assert found["n"].tolist() == [1.0] * 20 + [2.0] * 20 + [3.0]
    assert found["y"] == pytest.approx(np.maximum(found.time - 25e-3, 0.0), abs=1e-12)
    mine = bondgraph.load(text).simulate(points=41, rtol=1e-9)
    assert found["y0"] == pytest.approx(mine["y0"], abs={"CoSimulation": 1e-7, "ModelExchange": 2e-6}[kind])
    assert {"CoSimulation": "co-simulated", "ModelExchange": "integrated by CVode"}[kind] in found.notes[0]


def test_units_of_other_scales_are_turned_into_si(tmp_path: Path) -> None:
    """A description that says mm and degC: 3 mm and 20 degC there are 0.003 m and 293.15 K here."""
    exported("model Way { input u = 0 m\n parameter T = 1 K\n output x = 2*u, warm = T\n experiment e { simulate 0 .. 1 s } }", tmp_path)  # fmt: skip
    file = tmp_path / "unit.fmu"
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    text = parts["modelDescription.xml"].decode()
    text = text.replace('<BaseUnit m="1"/>', '<BaseUnit m="1" factor="0.001"/>').replace('<BaseUnit K="1"/>', '<BaseUnit K="1" offset="273.15"/>')  # fmt: skip
    parts["modelDescription.xml"] = re.sub(r'(name="T".*?start=)"1.0"', r'\1"20.0"', text).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    found = importing(tmp_path, "Way", "communication_step = 0.1 s, u = 3 mm", "x = u.x, T = u.warm", "1 s")
    assert found.final("x") == pytest.approx(0.006, rel=1e-14) and found.final("T") == pytest.approx(293.15, rel=1e-14)


def test_a_library_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    """To load one ended the process: what a loader maps lies beyond the end of the file."""
    exported(DRIVE, tmp_path)
    file = tmp_path / "unit.fmu"
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    (library,) = [name for name in parts if name.startswith("binaries/")]
    model = bondgraph.load(written(LOOP, tmp_path))
    for part, words in ((2, "the library is cut off"), (4000, "the object is cut off"), (10**6, "")):
        with zipfile.ZipFile(file, "w") as archive:
            for name, data in parts.items():
                archive.writestr(name, data[: len(data) // part] if name == library else data)
        with pytest.raises(RunFailed, match=rf"the unit `drive` \(.*unit.fmu\) failed: .*{words}"):
            model.simulate()


def test_what_cannot_hold_a_unit_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exported(DRIVE, tmp_path)
    model = bondgraph.load(written(LOOP, tmp_path))
    result = model.simulate()
    for call in (model.modes, model.equilibrium, model.port_hamiltonian, lambda: model.simulate("rest"), lambda: model.simulate(to="1 s", start=result)):  # fmt: skip
        with pytest.raises(RunFailed, match=r"`drive` is an imported unit \(.*unit.fmu\)"):
            call()
    for code, write in (("BG606", lambda: model.to_fmu(tmp_path / "never.fmu")), ("BG607", lambda: model.compile("c")), ("BG706", model.text)):  # fmt: skip
        with pytest.raises(CompilationFailed) as failed:
            write()
        assert [d.code for d in failed.value.diagnostics] == [code]
    with pytest.raises(Inapplicable, match="an imported unit is no text"):
        _ = StressBench(model, RunRequest()).scene
    with pytest.raises(RunFailed, match="between two communication points of `drive`"):
        model.simulate("late")
    monkeypatch.delenv("BONDGRAPH_RUN_FMU")
    with pytest.raises(RunFailed, match="set BONDGRAPH_RUN_FMU=1"):
        model.simulate("go")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("modelIdentifier=", "other=", "it is no functional mock-up unit"),
        ("modelIdentifier=", 'needsExecutionTool="true" modelIdentifier=', "it needs the tool that made it"),
        ('fmiVersion="2.0"', 'fmiVersion="1.0"', "it is no functional mock-up unit"),
        ("<fmiModelDescription", "<!DOCTYPE x><fmiModelDescription", "it is no functional mock-up unit"),
        ('causality="output"', 'causality="local"', "it has no real output"),
        ('<Unit name="V"><BaseUnit', '<Unit name="V"><Other', ""),
        ('unit="V"', 'unit="V }"', "its unit `V }` is none of the language"),
        ('modelName="Drive"', 'modelName="drive-2"', "There is no model or set `Drive`"),
    ],
)  # fmt: skip
def test_descriptions_that_no_model_can_hold(old: str, new: str, words: str, description: str, tmp_path: Path) -> None:
    """They are refused as the import is read; nothing of a unit runs there."""
    with zipfile.ZipFile(tmp_path / "unit.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description.replace(old, new))
    told = " ".join(d.sentence for d in bondgraph.check(written(LOOP, tmp_path)))
    assert words in told and bool(told) == bool(words)


def test_an_editor_offers_units_and_what_they_have(description: str, tmp_path: Path) -> None:
    """Its file in an import, its variables behind a point; what a run exchanges with it is not offered, and its file is no text to go to."""
    with zipfile.ZipFile(tmp_path / "unit.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description)
    workspace, path = Workspace(), tmp_path / "m.bg"
    workspace.open(path, LOOP)
    assert "unit.fmu" in [s.label for s in completion(workspace, path, LOOP.index("unit.fmu"))]
    behind = {s.label for s in completion(workspace, path, LOOP.index("drive.volt") + 6)}
    assert behind == {"communication_step", "omega", "target", "K", "volt"}
    for word in ("Drive drive", "drive.volt", "unit.fmu"):
        assert (definition(workspace, path, LOOP.index(word)) is None) == (word != "drive.volt")


def test_terminals_are_ports(tmp_path: Path) -> None:
    """Two halves of a car, joined at their ports: the difference from the whole falls with the step, in first order. What is no port stays a signal."""
    for name, port, given in (("Wheel", "top", "effort"), ("Body", "low", "flow")):
        bondgraph.load(CAR, name).to_fmu(tmp_path / f"{name}.fmu", fmi="3", ports={port: given})
    uses = """import Body from "Body.fmu"
import Wheel from "Wheel.fmu"
model Joined {
  parameter h: s
  Wheel wheel { communication_step = h }
  Body body { communication_step = h }
  wheel.top -> body.low
  output above = body.speed
  experiment go { simulate 0 .. 1 s { points = 3 } }
}"""
    model, whole = bondgraph.load(written(uses, tmp_path)), bondgraph.load(CAR, "Car").simulate(points=3).final("above")
    errors = [abs(model.simulate(settings={"h": f"{h} ms"}).final("above") - whole) for h in (8, 4)]
    assert errors[0] < 0.2 * abs(whole) and 1.8 < errors[0] / errors[1] < 2.2
    file = tmp_path / "Wheel.fmu"
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = "terminalsAndIcons/terminalsAndIcons.xml"
    for old, new, is_port in ((b"_bondgraph_", b"org.other.", True), (b'variableName="top_F"', b'variableName="speed"', False)):  # fmt: skip
        with zipfile.ZipFile(file, "w") as archive:
            for part, data in (parts | {name: parts[name].replace(old, new)}).items():
                archive.writestr(part, data)
        unit = read_unit_description(file)
        text = unit_model(unit, "Wheel.fmu", file).text
        assert ("top -> " in text or "-> top" in text) == is_port == ("input top_F" not in text)


def test_what_a_unit_gives_at_the_start_is_there_at_once(tmp_path: Path) -> None:
    """A second unit and an `every` read 10 V from the first instant on; both had 0 V for a step."""
    exported(DRIVE, tmp_path)
    text = """import Drive from "unit.fmu"
model Two {
  Drive first { communication_step = 0.1 s }
  Drive second { communication_step = 0.1 s, omega = first.volt*1 [rad/(s*V)] }
  mode held = 0
  every 0.1 s { held = first.volt/(1 V) }
  output a = first.volt, b = second.volt, c = held
  experiment go { simulate 0 .. 0.2 s { points = 3 } }
}"""
    found = bondgraph.load(written(text, tmp_path)).simulate()
    assert (found["a"].tolist(), found["c"].tolist()) == ([10.0] * 3, [10.0] * 3)
    assert found["b"].tolist() == pytest.approx([10.0, 8.0, 8.0])  # it began with 0 rad/s


def test_a_unit_goes_no_further_than_the_run(tmp_path: Path) -> None:
    """A table over the second that the run takes: no step behind it is asked for."""
    exported("model Tab { output y = linear(time, (0 s, 1 s), (0, 2))\n experiment e { simulate 0 .. 1 s } }", tmp_path)
    found = importing(tmp_path, "Tab", "communication_step = 0.1 s", "y = u.y", "1 s")
    assert found["y"] == pytest.approx(0.2 * np.floor(found.time / 0.1 + 1e-9), abs=1e-12)


def test_a_unit_without_steps_that_fails_or_ends_is_told(tmp_path: Path) -> None:
    """What fails in the middle of a step of the solver is no number, and `stop when` ends the run with a sentence; nothing behind the end is asked for."""
    text = "model M { input u = 0\n output y = linear(integral(u/1 s, 0), (0, 1), (0, 2))\n experiment e { simulate 0 .. 1 s; STOP } }"
    for stop, words in (("", "The table .* is asked outside"), ("stop when time > 0.15 s", "it asks to end the run")):  # fmt: skip
        exported(text.replace("STOP", stop), tmp_path, "e")
        without_steps(tmp_path)
        found = importing(tmp_path, "M", "communication_step = 0.1 s, u = 1", "y = u.y", "1 s") if not stop else None
        assert found is None or found.final("y") == pytest.approx(2.0, rel=1e-6)
        with pytest.raises(RunFailed, match=rf"the unit `u` \(.*unit.fmu\) failed.*{words}"):
            importing(tmp_path, "M", "communication_step = 0.1 s, u = 3", "y = u.y", "1 s")


def test_a_unit_that_fails_is_told_with_its_own_words(tmp_path: Path) -> None:
    """A table that is left is an error of the unit, with a sentence in its log; one that is no archive is no unit; nor is one outside."""
    exported("model Limited { input u = 0\n output y = linear(u, (0, 1), (0, 2))\n experiment e { simulate 0 .. 1 s } }", tmp_path)  # fmt: skip
    with pytest.raises(RunFailed, match=r"the unit `u` \(.*unit.fmu\) failed.*The table .* is asked outside"):
        importing(tmp_path, "Limited", "communication_step = 0.1 s, u = 3*time/1 s", "y = u.y", "1 s")
    with zipfile.ZipFile(file := tmp_path / "unit.fmu") as archive:
        parts, place = {name: archive.read(name) for name in archive.namelist()}, Path.cwd()
    for platform, words in (
        ("other", r"it has no library for \S+ \(it has: other\)"),
        (None, "shared library .*Limited"),
    ):
        with zipfile.ZipFile(file, "w") as archive:
            for name, data in parts.items():
                is_library = name.startswith("binaries/")
                archive.writestr(
                    name if platform is None or not is_library else f"binaries/{platform}/m",
                    b"no library" if is_library else data,
                )
        with pytest.raises(RunFailed, match=rf"the unit `u` \(.*unit.fmu\) failed.*{words}"):
            importing(tmp_path, "Limited", "communication_step = 0.1 s", "y = u.y", "1 s")
        assert Path.cwd() == place  # where FMPy stays in the folder of a library that does not load
    (tmp_path / "unit.fmu").write_bytes(b"no archive")
    (told,) = bondgraph.check(written('import A from "unit.fmu"\nmodel M { A a\n output y = a.y }', tmp_path))[:1]
    assert "it is no functional mock-up unit" in told.sentence
    (told,) = bondgraph.check(written('import A from "../unit.fmu"\nmodel M { A a\n output y = a.y }', tmp_path))[:1]
    assert "lies outside the project folder" in told.sentence
