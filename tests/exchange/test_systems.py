"""Systems of units: a model that is cut at the ports of its instances, by its own strokes, and joined again by other tools."""

from __future__ import annotations

import ctypes
import re
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from compiler import api
from compiler.errors import CompilationFailed
from tests.exchange.test_power_ports import CAR
from tests.exchange.unit_files import fmpy, read_model_description, validate_fmu

etree = pytest.importorskip("lxml.etree")

from fmpy.ssp.simulation import simulate_ssp  # noqa: E402

pytestmark = pytest.mark.machine_code
SCHEMAS = Path(fmpy.__file__).parent / "ssp" / "schema"
SSD, SSV = "{http://ssp-standard.org/SSP1/SystemStructureDescription}", "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"  # fmt: skip
# A sampled controller, a motor, and a load at the top; a parameter and an input that several of them read.
SERVO = """model Motor {
  parameter R: ohm, K = 0.05 [N*m/A]
  port pins: electric, shaft: rotation
  R  winding : u = R*i
  GY magnets : u1 = K*omega2
  I  coil    : lambda = 1 mH*i
  pins -> 1(winding, coil) -> magnets -> shaft
  output current = coil.i
}
model Controller {
  input wanted: rad/s = 0, seen: rad/s = 0
  parameter gain = 0.5 [V*s], limit = 12 V
  mode level: V = 0
  every 10 ms { level = min(gain*(wanted - seen), limit) }
  output command = level
}
model Servo {
  parameter R = 1 ohm
  input target = 20 [rad/s], torque = 0 [N*m]
  Motor motor { R = R }
  Controller controller { wanted = target, seen = load.omega }
  MSe supply : u = controller.command
  I load : L = 1e-3 [kg*m^2]*omega
  R drag : M = 1e-4 [N*m*s]*omega
  MSe push : M = torque
  supply -> motor.pins
  1 middle : rotation
  motor.shaft -> middle -> load, drag
  push -> middle
  signal work = integral(push.M*load.omega, 0 J)
  output error = target - load.omega, heat = R*motor.current^2, energy = work
  experiment go { simulate 0 .. 0.2 s }
  experiment weak { set R = 3 ohm; set target = 10 [rad/s]; simulate 0 .. 0.4 s }
  experiment pushed { set torque = 0.1 [N*m]*step(time - 0.1 s); set controller.gain = 1 [V*s]; simulate 0 .. 0.2 s }
}
"""


def written(text: str, name: str, file: Path, **options: object) -> Path:
    bondgraph.load(text, name).to_ssp(file, **options)  # type: ignore[arg-type]
    return file


def contents(file: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def connections(text: bytes) -> set[tuple[str, ...]]:
    ends = ("startElement", "startConnector", "endElement", "endConnector")
    return {tuple(c.get(end, "") for end in ends) for c in etree.fromstring(text).iter(f"{SSD}Connection")}


def check(file: Path, folder: Path) -> None:
    """Structures and sets by the schemas of the standard; units by FMPy's validation; connectors by the variables of the units."""
    files = contents(file)
    for ending, schema in ((".ssd", "Description"), (".ssv", "ParameterValues")):
        xsd = etree.XMLSchema(etree.parse(str(SCHEMAS / f"SystemStructure{schema}.xsd")))
        for name, data in files.items():
            if name.endswith(ending):
                assert xsd.validate(etree.fromstring(data)), (name, xsd.error_log)
    root = etree.fromstring(files["SystemStructure.ssd"])
    for component in root.iter(f"{SSD}Component"):
        unit = folder / "checked.fmu"
        unit.write_bytes(files[component.get("source")])
        assert validate_fmu(str(unit)) == []
        variables = {v.name: (v.causality, v.unit) for v in read_model_description(str(unit)).modelVariables}
        for connector in component.iter(f"{SSD}Connector"):
            assert variables[connector.get("name")] == (connector.get("kind"), connector[0].get("unit"))


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(CAR, "Car", tmp_path_factory.mktemp("car") / "car.ssp")


@pytest.fixture(scope="module")
def above() -> float:
    return bondgraph.load(CAR, "Car").simulate(rtol=1e-10).final("above")


def test_a_car_that_is_cut_is_the_whole_again(car: Path, above: float, tmp_path: Path) -> None:
    """Joined by FMPy, the difference from the model falls with the step, in first order."""
    check(car, tmp_path)
    files = contents(car)
    assert sorted(files) == ["SystemStructure.ssd", "go.ssd", "resources/OspSystemStructure.xml", "resources/body.fmu", "resources/wheel.fmu"]  # fmt: skip
    assert connections(files["SystemStructure.ssd"]) == {("wheel", "top_v", "body", "low_v"), ("body", "low_F", "wheel", "top_F")}  # fmt: skip
    errors = []
    for step in (8e-3, 4e-3):
        found = simulate_ssp(str(car), stop_time=1.0 - step / 2, step_size=step)
        errors.append(abs(found["body.above"][-1] - above))
    assert errors[0] < 0.06 * abs(above) and 1.8 < errors[0] / errors[1] < 2.2


def test_ecos_joins_a_car_that_is_cut(car: Path, above: float) -> None:
    threads = Path(sys.prefix) / "lib" / "libtbb.so.12"  # of the package tbb, which no loader looks for there
    if threads.exists():
        ctypes.CDLL(str(threads), ctypes.RTLD_GLOBAL)
    try:
        import ecospy
    except (ImportError, OSError):
        pytest.skip("no ecos")
    errors = []
    for step in (8e-3, 4e-3):
        with ecospy.EcosSimulation(ssp_path=str(car), step_size=step) as simulation:
            simulation.init()
            simulation.step(round(1 / step))
            errors.append(abs(simulation.get_real("body::above") - above))
    assert errors[0] < 0.2 * abs(above) and 1.8 < errors[0] / errors[1] < 2.2


def test_libcosim_joins_a_car_that_is_cut(car: Path, above: float, tmp_path: Path) -> None:
    """As a system with fixed steps, in first order; and by the energy that a cut bond makes (ECCO), whose residual decides the step."""
    execution = pytest.importorskip("libcosimpy.CosimExecution")
    from libcosimpy.CosimObserver import CosimObserver

    def places(run: object, unit: int) -> dict[str, int]:
        return {v.name.decode(): v.reference for v in run.slave_variables(unit)}  # type: ignore[attr-defined]

    def error(run: object, observer: object, body: int) -> float:
        return abs(observer.last_real_values(body, [places(run, body)["above"]])[0] - above)  # type: ignore[attr-defined]

    errors = []
    for step in (8e-3, 4e-3):
        run, observer = execution.CosimExecution.from_ssp_file(str(car), step * 1e9), CosimObserver.create_last_value()
        run.add_observer(observer)
        run.step(round(1 / step))
        errors.append(error(run, observer, run.slave_index_from_instance_name("body")))
    assert errors[0] < 0.06 * abs(above) and 1.8 < errors[0] / errors[1] < 2.2
    for name, data in contents(car).items():
        (tmp_path / Path(name).name).write_bytes(data)
    structure, errors = tmp_path / "OspSystemStructure.xml", []
    (tolerance,) = re.findall("<AbsoluteTolerance>(.*)</AbsoluteTolerance>", structure.read_text())
    for share in (1.0, 0.03):
        structure.write_text(structure.read_text().replace(tolerance, repr(share * float(tolerance))))
        run, observer = execution.CosimExecution.from_osp_config_file(str(tmp_path)), CosimObserver.create_last_value()
        run.add_observer(observer)
        while run.status().current_time < 1e9:
            run.step(1)
        errors.append(error(run, observer, run.slave_index_from_instance_name("body")))
    assert errors[0] < 0.02 * abs(above) and errors[1] < 0.3 * errors[0]


def test_a_controller_and_a_motor_are_units_beside_the_rest(tmp_path: Path) -> None:
    """What several units read comes in at the system; what is computed of it is computed in each; experiments are sets of parameters."""
    file = written(SERVO, "Servo", tmp_path / "servo.ssp", fmi="2")
    check(file, tmp_path)
    files = contents(file)
    assert connections(files["SystemStructure.ssd"]) == {
        ("", "target", "controller", "target"), ("", "target", "Servo", "target"), ("", "torque", "Servo", "torque"),
        ("Servo", "load.omega", "controller", "seen"), ("controller", "command", "Servo", "controller.command"),
        ("Servo", "motor.pins_u", "motor", "pins_u"), ("motor", "pins_i", "Servo", "motor.pins_i"),
        ("Servo", "motor.shaft_omega", "motor", "shaft_omega"), ("motor", "shaft_M", "Servo", "motor.shaft_M"),
    }  # fmt: skip
    sets = {n: {p.get("name"): float(p[0].get("value")) for p in etree.fromstring(d).iter(f"{SSV}Parameter")} for n, d in files.items() if n.endswith(".ssv")}  # fmt: skip
    assert sets == {
        "resources/SystemStructure.ssv": {"target": 20.0},
        "resources/go.ssv": {"target": 20.0},
        "resources/weak.ssv": {"target": 10.0, "motor.R": 3.0},
        "resources/pushed.ssv": {"target": 20.0, "controller.gain": 1.0},
    }
    weak = etree.fromstring(files["weak.ssd"])
    assert [b.get("source") for b in weak.iter(f"{SSD}ParameterBinding")] == ["resources/weak.ssv"]
    assert [e.get("stopTime") for e in weak.iter(f"{SSD}DefaultExperiment")] == ["0.4"]
    whole = bondgraph.load(SERVO, "Servo").simulate("go", rtol=1e-9, points=21)
    errors = []
    for step in (1e-3, 5e-4):
        found = simulate_ssp(str(file), stop_time=0.2 - step / 2, step_size=step, input={"target": lambda _: 20.0})
        heat = np.interp(whole.time[1:], found["time"] + step, found["motor.heat"])
        errors.append(np.abs(heat - whole["heat"][1:]).max() / np.abs(whole["heat"]).max())
    assert errors[0] < 0.2 and 1.8 < errors[0] / errors[1] < 2.4


def test_an_experiment_is_in_the_units_of_its_system(tmp_path: Path) -> None:
    """The way in that an experiment lets change with time is no input any more. `--part` names the units."""
    (tmp_path / "servo.bg").write_text(SERVO, encoding="utf-8")
    arguments = ["compile", str(tmp_path / "servo.bg"), "--model", "Servo", "-o", str(tmp_path / "s.ssp")]
    answer = CliRunner().invoke(commands, [*arguments, "--part", "controller", "-e", "pushed", "--fmi", "3"])
    assert answer.exit_code == 0, answer.output
    check(tmp_path / "s.ssp", tmp_path)
    found = connections(contents(tmp_path / "s.ssp")["SystemStructure.ssd"])
    assert ("", "target", "controller", "target") in found and not any("torque" in c for c in found)
    for wrong in (["--icon"], ["--port", "a=flow"], ["--float"]):
        assert CliRunner().invoke(commands, [*arguments, *wrong]).exit_code == 2
    assert CliRunner().invoke(commands, [*arguments[:-1], str(tmp_path / "s.py"), *["--part", "controller"] * 2]).exit_code == 2  # fmt: skip


def test_nested_instances_and_lists_are_units(tmp_path: Path) -> None:
    text = """model Cell { port a: translation
      parameter m = 1 kg
      I mass : p = m*v
      a -> 1(mass)
      output v = mass.v }
    model Row { port a: translation
      parameter n = 2
      for i in 1..2 {
        Cell cell[i] { m = i*1 kg }
        C spring[i] : F = 10 [N/m]*x
        R damper[i] : F = 1 [N*s/m]*v
      }
      1 middle : translation
      a -> 0(1(spring[1], damper[1])) -> middle -> cell[1].a
      middle -> 0(1(spring[2], damper[2])) -> cell[2].a
      signal gap = cell[1].v - cell[2].v }
    model Main {
      Row row
      Sf drive : v = 1 [m/s]*cos(3 [1/s]*time)
      drive -> row.a
      output gap = row.gap, v = row.cell[2].v
      experiment e { simulate 0 .. 1 s }
    }"""
    file = written(text, "Main", tmp_path / "row.ssp", parts=("row.cell[1]", "row.cell[2]"), fmi="3")
    check(file, tmp_path)
    assert {n for n in contents(file) if n.endswith(".fmu")} == {"resources/Main.fmu", "resources/row_cell_1_.fmu", "resources/row_cell_2_.fmu"}  # fmt: skip
    (tmp_path / "first.fmu").write_bytes(contents(file)["resources/row_cell_1_.fmu"])
    starts = {v.name: v.start for v in read_model_description(str(tmp_path / "first.fmu")).modelVariables if v.causality == "input"}  # fmt: skip
    assert {name: float(start) for name, start in starts.items()} == {"a_F": 1.0}  # of the damper, as in the whole


def read_back(folder: Path, uses: str, text: str | None = None) -> bondgraph.Model:
    """A model that imports the system `s.ssp` of a folder, whose structure is another one if a text is given."""
    if text is not None:
        files = contents(folder / "s.ssp") | {"SystemStructure.ssd": text.encode()}
        with zipfile.ZipFile(folder / "s.ssp", "w") as archive:
            for name, data in files.items():
                archive.writestr(name, data)
    (folder / "m.bg").write_text(uses, encoding="utf-8")
    return bondgraph.load(folder / "m.bg")


def test_a_system_is_imported_as_a_model(car: Path, above: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """It runs as the whole does, but for the step; a set of parameters and the inputs of the system hold."""
    monkeypatch.setenv("BONDGRAPH_RUN_FMU", "1")
    (tmp_path / "s.ssp").write_bytes(car.read_bytes())
    uses = """import Car from "s.ssp"
      model M {
        Car car { communication_step = STEP }
        output above = car.body.above, pull = 2*car.wheel.speed
        experiment e { simulate 0 .. 1 s { points = 11 } }
      }"""
    errors = [abs(read_back(tmp_path, uses.replace("STEP", step)).simulate().final("above") - above) for step in ("8 ms", "4 ms")]  # fmt: skip
    assert errors[0] < 0.2 * abs(above) and 1.8 < errors[0] / errors[1] < 2.2
    structure = contents(car)["SystemStructure.ssd"].decode()
    value = '<ssv:Parameter name="{0}"><ssv:Real value="{1}"/></ssv:Parameter>'.format
    binding = (
        '<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="s" '
        'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters>SET</ssv:Parameters>'
        "</ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
    )
    heavy = binding.replace("SET", value("body.m", "600.0")), binding.replace("SET", value("m", "600.0"))
    elements, end = "    <ssd:Elements>", "        </ssd:Connectors>\n      </ssd:Component>\n    </ssd:Elements>"
    whole = bondgraph.load(CAR, "Car").simulate(settings={"body.m": "600 kg"}).final("above")
    for new in (structure.replace(elements, heavy[0] + elements), structure.replace(end, end.replace("</ssd:Connectors>", f"</ssd:Connectors>{heavy[1]}"))):  # fmt: skip
        assert new != structure
        model = read_back(tmp_path, uses.replace("STEP", "4 ms"), new)
        assert model.simulate().final("above") == pytest.approx(whole, rel=0.1)
        assert model.simulate(settings={"car.body.m": "300 kg"}).final("above") == pytest.approx(above, rel=0.1)


def test_inputs_of_a_system_are_those_of_its_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BONDGRAPH_RUN_FMU", "1")
    written(SERVO, "Servo", tmp_path / "s.ssp", parts=("controller",))
    uses = """import Servo from "s.ssp"
      model M {
        Servo servo { communication_step = 0.5 ms WANTED }
        output error = servo.Servo.error
        experiment e { simulate 0 .. 0.2 s { points = 3 } }
      }"""
    own = bondgraph.load(SERVO, "Servo")
    for wanted in ("20", "10"):
        whole = own.simulate("go", {"target": f"{wanted} rad/s"}, points=3)
        found = read_back(tmp_path, uses.replace("WANTED", f", target = {wanted} [rad/s]" * (wanted == "10"))).simulate()  # fmt: skip
        assert found["error"] == pytest.approx(whole["error"], abs=0.05 * float(wanted))
    # an experiment of it is a model of its own, with what it sets
    whole = own.simulate("weak", to="0.2 s", points=3)
    weak = uses.replace("WANTED", "").replace("import Servo", "import weak").replace("Servo servo", "weak servo")
    found = read_back(tmp_path, weak).simulate()
    assert found["error"] == pytest.approx(whole["error"], abs=0.5) and found["error"][0] == 10


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<ssd:System name", "<ssd:Other name", "it is no system of units"),
        ("<ssd:SystemStructureDescription", "<!DOCTYPE x><ssd:SystemStructureDescription", "it is no system of units"),
        ("resources/body.fmu", "resources/none.fmu", "of its `body`: it is no functional mock-up unit"),
        ("resources/body.fmu", "/resources/body.fmu", "its `body` lies outside it"),
        ("<ssd:Connections>", '<ssd:Connections><ssd:Connection startElement="wheel" startConnector="speed" endElement="wheel" endConnector="top_F"/>', "two connections of it end at `wheel.top_F`"),
        ("application/x-fmu-sharedlibrary", "application/x-ssp-package", "its `wheel` is no unit"),
        ("<ssd:Elements>", "<ssd:Elements><ssd:System name='inner'/>", "it has systems within it"),
        ('endConnector="low_v"/>', 'endConnector="low_v"><x/></ssd:Connection>', "a connection of it changes values"),
        ('startConnector="top_v"', 'startConnector="none"', "it is no system of units"),
    ],
)  # fmt: skip
def test_structures_that_no_model_can_hold(old: str, new: str, words: str, car: Path, tmp_path: Path) -> None:
    (tmp_path / "s.ssp").write_bytes(car.read_bytes())
    structure = contents(car)["SystemStructure.ssd"].decode()
    read_back(tmp_path, 'import Car from "s.ssp"\nmodel M { Car c\n output x = c.body.above }', structure.replace(old, new))  # fmt: skip
    assert words in " ".join(d.sentence for d in bondgraph.check(tmp_path / "m.bg"))


def refused(text: str, *parts: str, name: str = "Main") -> str:
    model = bondgraph.load(text, name)
    with pytest.raises(CompilationFailed) as failed:
        model.to_ssp("never.ssp", parts)
    return f"{failed.value.diagnostics[0].code} {failed.value}"


# Two equal parts at one force, which the first line of `joined` hands on.
SIDE = """model Side {{
  port a: translation
  parameter k = 2 [N*s/m]
  mode n = 0
  {part}
  a -> 1(part)
  output v = part.v
}}
model Main {{
  Side one, two
  Se push : F = 1 N
  C soft : F = 5 [N/m]*x
  {junction} tie : translation
  push -> {push}
  tie -> one.a, two.a{soft}
  {more}
  experiment e {{ simulate 0 .. 1 s }}
}}"""
MASS, LOSS = "I part : p = 2 kg*v", "R part : F = k*v"


def test_cuts_that_cannot_be_are_told_with_their_reason() -> None:
    """Two masses that a junction makes one; resistors on both sides; an event that sets both sides; names of no instances."""
    rigid = SIDE.format(part=MASS, junction="1", push="tie", soft=", soft", more="")
    told = refused(rigid)
    assert told.startswith("BG503") and ".part` is forced by the input" in told
    parallel = SIDE.format(part=LOSS, junction="1", push="tie", soft="", more="soft.x")
    told = refused(parallel.replace("  C soft : F = 5 [N/m]*x\n", "").replace("soft.x", ""))
    assert "a loop without a state around a cut" in told and "of `one`" in told and "--part" in told
    event = "when time > 0.5 s { one.n = 1\n two.n = 2 }"
    told = refused(
        SIDE.format(part=MASS, junction="0", push="1(two_mass)\n  I two_mass : p = 1 kg*v", soft=", soft", more=event)
    )
    assert "an event that sets what belongs to two units" in told
    assert refused(rigid, "three").startswith("BG621") and "`one`, `two`" in refused(rigid, "three")
    assert refused("model Main { I m : p = 1 kg*v\n Se s : F = 1 N\n s -> 1(m) }", "m").startswith("BG621")


def test_what_a_part_remembers_stays_in_it() -> None:
    """A mode that is set after a delay, a relay and an integral of an input; nothing is left for the rest."""
    text = """model Part {
      input u = 0
      mode level = 0
      every 10 ms delay 2 ms { level = 2*u }
      output y = level + integral(u/1 s, 0), on = hysteresis(u, -1, 1, false)
    }
    model Main {
      Part part { u = sin(time/1 s) + below.y }
      Part below
      output twice = 2*part.y
      experiment e { simulate 0 .. 1 s }
    }"""
    scene = api.Scene("Main", None, free=frozenset({"*"}))
    system = bondgraph.load(text, "Main").compilation(scene).system(("part", "below"))
    assert set(system.links) == {("below", "below.y", "part", "below.y")}
    counts = {name: (len(unit.events), sum(q.role == "mode" for q in unit.quantities.values()), len(unit.integrals)) for name, unit in system.units.items()}  # fmt: skip
    assert counts == {"part": (3, 2, 1), "below": (3, 2, 1)}


def test_the_strokes_of_the_whole_say_what_comes_in() -> None:
    """The wheel gives its speed, the body its force; the rest is one unit, with the name of the model."""
    compilation = bondgraph.load(CAR, "Car").compilation(api.Scene("Car", None, free=frozenset({"*"})))
    system = compilation.system(("wheel",))
    assert set(system.links) == {("wheel", "wheel.top_v", "Car", "body.low_v"), ("Car", "body.low_F", "wheel", "wheel.top_F")}  # fmt: skip
    assert {name: len(unit.nodes) for name, unit in system.units.items()} == {"wheel": 6, "Car": 7}
