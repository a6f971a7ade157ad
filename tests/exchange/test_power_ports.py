"""Power ports of units: a bond that is cut gives an input and an output on either side, and a small master joins them again."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from compiler.errors import CompilationFailed
from tests.exchange.unit_files import fmpy, instance, read_model_description, validate_fmu

pytestmark = pytest.mark.machine_code
# A quarter car, cut at the bond between the wheel and what it carries.
CAR = """model Wheel {
  port top: translation
  parameter m = 40 kg, k: N/m = 2e4
  Sf road : v = 0.5 [m/s]*sin(6 [1/s]*time)
  C tyre : F = k*x
  I mass : p = m*v
  1 wheel
  road -> 0(tyre) -> wheel -> mass, top
  output speed = mass.v
  experiment go { simulate 0 .. 1 s }
}
model Body {
  port low: translation
  parameter m = 300 kg, k: N/m = 2e3, r: N*s/m = 150
  C spring : F = k*x
  R damper : F = r*v
  I mass : p = m*v
  low -> 0(1(spring, damper)) -> 1(mass)
  output speed = mass.v
  experiment go { simulate 0 .. 1 s }
}
model Car {
  Wheel wheel
  Body body
  wheel.top -> body.low
  output below = wheel.mass.v, above = body.mass.v
  experiment go { simulate 0 .. 1 s }
}
"""


def written(path: Path, name: str, ports: dict[str, str], fmi: str) -> Path:
    folder = path / f"{name}{fmi}"
    folder.mkdir()
    bondgraph.load(CAR, name).to_fmu(folder / "unit.fmu", fmi=fmi, ports=ports)
    assert validate_fmu(str(folder / "unit.fmu")) == []
    return folder


def joined(wheel: Path, body: Path, step: float) -> tuple[float, float]:
    """Speed of the body after 1 s, and the energy that the cut has made: the master holds effort and flow over each step."""
    made = 0.0
    with instance(wheel, tolerance=1e-9) as (one, below), instance(body, tolerance=1e-9) as (two, above):
        for k in range(round(1 / step)):
            (force,), (speed,) = two.getReal([above["low_F"]]), one.getReal([below["top_v"]])
            one.setReal([below["top_F"]], [force])
            two.setReal([above["low_v"]], [speed])
            for unit in (one, two):
                unit.doStep(k * step, step)
            (force_after,), (speed_after,) = two.getReal([above["low_F"]]), one.getReal([below["top_v"]])
            made += step / 2 * (force * (speed_after - speed) - speed * (force_after - force))
        return two.getReal([above["speed"]])[0], made


def test_two_halves_of_a_quarter_car_are_the_whole(tmp_path: Path) -> None:
    """The error and the energy that the cut makes fall with the step, in first order."""
    halves = written(tmp_path, "Wheel", {"top": "effort"}, "2"), written(tmp_path, "Body", {"low": "flow"}, "3")
    whole = bondgraph.load(CAR, "Car").simulate(rtol=1e-10).final("above")
    steps = (8e-3, 4e-3, 2e-3)
    found = [joined(*halves, step) for step in steps]
    errors = [abs(speed - whole) for speed, _ in found]
    assert errors[0] < 0.05 * abs(whole)
    for values in (errors, [abs(energy) for _, energy in found]):
        assert 1.7 < values[0] / values[1] < 2.4 and 1.7 < values[1] / values[2] < 2.4


def test_a_port_is_given_either_way(tmp_path: Path) -> None:
    """Of the body both: held with a speed it answers with a force, and the other way round; units, signs and structure are those of the bond."""
    for given, result, number in (("flow", "low_F", 150.0), ("effort", "low_v", 1 / 150.0)):
        folder = written(tmp_path, "Body", {"low": given}, "2" if given == "flow" else "3")
        description = read_model_description(str(folder / "unit.fmu"))
        source = {"low_F": "low_v", "low_v": "low_F"}[result]
        causalities = {v.name: (v.causality, v.unit) for v in description.modelVariables}
        units = {"low_F": "N", "low_v": "m/s"}
        assert causalities[source] == ("input", units[source]) and causalities[result] == ("output", units[result])
        with instance(folder, values={source: 1.0}) as (unit, place):
            assert unit.getReal([place[result]])[0] == pytest.approx(
                number, rel=1e-14
            )  # of the damper alone at the start
            assert unit.getDirectionalDerivative([place[result]], [place[source]], [1.0])[0] == pytest.approx(number)


def read(file: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_terminals_and_icon_are_those_of_the_standard(tmp_path: Path) -> None:
    """What joins two ports: equal efforts, and flows that sum up to zero where both come in, so a bond goes out of one and into the other."""
    etree = pytest.importorskip("lxml.etree")
    pytest.importorskip("matplotlib")
    schema = etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd")))  # fmt: skip
    (tmp_path / "car.bg").write_text(CAR, encoding="utf-8")
    for name, port, kind in (("Wheel", "top", "outflow"), ("Body", "low", "inflow")):
        file = tmp_path / f"{name}.fmu"
        arguments = ["compile", str(tmp_path / "car.bg"), "--model", name, "--port", f"{port}=effort", "--fmi", "3", "-o", str(file)]  # fmt: skip
        assert CliRunner().invoke(commands, arguments + ["--icon"] * (name == "Wheel")).exit_code == 0
        assert validate_fmu(str(file)) == []
        files = read(file)
        root = etree.fromstring(files["terminalsAndIcons/terminalsAndIcons.xml"])
        assert schema.validate(root), schema.error_log
        *picture, terminals = root
        (terminal,) = terminals
        assert dict(terminal.attrib) == {"name": port, "matchingRule": "plug", "terminalKind": "_bondgraph_translation"}
        assert [(m.get("memberName"), m.get("variableKind")) for m in terminal] == [
            ("effort", "signal"),
            ("flow", kind),
        ]
        assert [m.get("variableName") for m in terminal] == [f"{port}_F", f"{port}_v"]
        assert {m.get("variableName") for m in terminal} < {
            v.name for v in read_model_description(str(file)).modelVariables
        }
        if not picture:
            continue
        system, icon = picture[0]
        width, height = struct.unpack(">II", files["terminalsAndIcons/icon.png"][16:24])
        x, y = float(icon.get("x2")), float(icon.get("y2"))
        assert max(x, y) == pytest.approx(100.0) and x / y == pytest.approx(width / height, rel=0.01)
        assert {k: system.get(k) for k in icon.attrib} == dict(icon.attrib)
        assert etree.fromstring(files["terminalsAndIcons/icon.svg"]).tag.endswith("svg")
        assert CliRunner().invoke(commands, [*arguments[:-4], "-o", str(file), "--icon"]).exit_code == 0  # of FMI 2.0
        older = read(file)
        assert older["model.png"] == files["terminalsAndIcons/icon.png"] and not any("terminals" in n for n in older)
    bondgraph.load(CAR, "Car").to_fmu(tmp_path / "car.fmu", fmi="3")
    assert not any("terminals" in n for n in read(tmp_path / "car.fmu"))


def test_strokes_that_forbid_a_way_are_told_with_their_reason(tmp_path: Path) -> None:
    text = "model Mass { port end: translation\n I mass : p = 2 kg*v\n end -> 1(mass)\n output speed = mass.v\n experiment e { simulate 0 .. 1 s } }"
    model = bondgraph.load(text)
    model.to_fmu(tmp_path / "m.fmu", ports={"end": "effort"})
    with pytest.raises(CompilationFailed) as failed:
        model.to_fmu(tmp_path / "never.fmu", ports={"end": "flow"})
    assert "`mass`" in failed.value.diagnostics[0].sentence and "`end_v`" in failed.value.diagnostics[0].sentence
    wide = bondgraph.load(text.replace("port end", "port tip: translation[2], end"))
    alone = bondgraph.load("model Mass { I mass : p = 2 kg*v\n Se push : F = 1 N\n push -> 1(mass) }")
    for case, advice in (
        (model, "are `end`"),
        (wide, "Only a port of one bond"),
        (alone, "write `port tip: translation`"),
    ):
        with pytest.raises(CompilationFailed, match="`tip` is no port of one bond of `Mass`") as unknown:
            case.to_fmu(tmp_path / "never.fmu", ports={"tip": "flow"})
        assert advice in str(unknown.value)
    with pytest.raises(UsageError, match="takes its `effort` or its `flow`"):
        model.to_fmu(tmp_path / "never.fmu", ports={"end": "both"})
    plain = "plain model Mass { port end: translation\n I mass : p = 2*f\n end -> 1(mass)\n output speed = mass.f\n experiment e { simulate 0 .. 1 } }"
    bondgraph.load(plain).to_fmu(tmp_path / "plain.fmu", ports={"end": "effort"})
    assert {"end_e", "end_f"} < {v.name for v in read_model_description(str(tmp_path / "plain.fmu")).modelVariables}
    (tmp_path / "m.bg").write_text(text, encoding="utf-8")
    arguments = ["compile", str(tmp_path / "m.bg"), "--port", "end=effort", "-o"]
    assert CliRunner().invoke(commands, [*arguments, str(tmp_path / "c.fmu")]).exit_code == 0
    assert (tmp_path / "c.fmu").read_bytes() == (tmp_path / "m.fmu").read_bytes()
    assert CliRunner().invoke(commands, [*arguments, str(tmp_path / "c.py")]).exit_code == 2


SYSTEM = """<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">
  <BaseStepSize>0.004</BaseStepSize>
  <Algorithm>fixedStep</Algorithm>
  <Simulators><Simulator name="wheel" source="Wheel.fmu"/><Simulator name="body" source="Body.fmu"/></Simulators>
  <Connections><VariableGroupConnection><VariableGroup simulator="wheel" name="top"/><VariableGroup simulator="body" name="low"/></VariableGroupConnection></Connections>
</OspSystemStructure>
"""


def test_libcosim_joins_ports_by_the_file_beside_a_unit(tmp_path: Path) -> None:
    for name, ports in (("Wheel", {"top": "effort"}), ("Body", {"low": "flow"})):
        bondgraph.load(CAR, name).to_fmu(tmp_path / f"{name}.fmu", ports=ports)
    text = (tmp_path / "Wheel_OspModelDescription.xml").read_text()
    assert '<LinearMechanicalPort name="top"><Force name="top Force"><Variable ref="top_F"/></Force>' in text
    execution = pytest.importorskip("libcosimpy.CosimExecution")
    from libcosimpy.CosimObserver import CosimObserver

    (tmp_path / "OspSystemStructure.xml").write_text(SYSTEM)
    run, observer = execution.CosimExecution.from_osp_config_file(str(tmp_path)), CosimObserver.create_last_value()
    run.add_observer(observer)
    run.step(250)
    body = run.slave_index_from_instance_name("body")
    (speed,) = (v.reference for v in run.slave_variables(body) if v.name == b"speed")
    whole = bondgraph.load(CAR, "Car").simulate(points=2).final("above")
    assert observer.last_real_values(body, [speed])[0] == pytest.approx(whole, rel=0.03)
