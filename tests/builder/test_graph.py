"""Models built by calls: the same numbers as from text, to the last bit where nothing but the way in differs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph import Graph
from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax.format import format_text
from tests.compiling import MODELS, ROOT
from tests.unparse.same_graph import Same, same_motion

README = (ROOT / "README.md").read_text(encoding="utf-8")

OSCILLATOR = """model Oscillator {
  "A mass on a hardening spring, pushed."
  parameter m = 1 kg, k: N/m = 100, k3: N/m^3 = 2e4, r: N*s/m = 0.5
  Se push   : F = 1 N*step(time - 0.1 s)
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x + k3*x^3      { start x = 1 mm }
  R  damper : F = r*v
  push -> body -> mass, spring, damper
  output position = spring.x
}
"""


def oscillator() -> Graph:
    g = Graph("Oscillator", "A mass on a hardening spring, pushed.")
    m = g.parameter("m", 1.0, "kg")
    g.parameter("k", 100.0, "N/m")
    g.parameter("k3", 2e4, "N/m^3")
    g.parameter("r", 0.5, "N*s/m")
    push = g.Se("push", "F = 1 N*step(time - 0.1 s)")
    body = g.one("body", "translation")
    mass = g.I("mass", f"p = {m}*v")
    spring = g.C("spring", "F = k*x + k3*x^3", start={"x": "1 mm"})
    damper = g.R("damper", "F = r*v")
    push >> body >> (mass, spring, damper)
    g.output("position", f"{spring}.x")
    return g


def test_the_oscillator_is_that_of_the_text_bit_by_bit() -> None:
    built, written = oscillator().model(), bondgraph.load(OSCILLATOR)
    assert type(built) is type(written)
    Same(written.compilation().whole_graph, built.compilation().whole_graph).check()
    one, two = built.simulate(to="1 s", energy=True), written.simulate(to="1 s", energy=True)
    assert np.array_equal(one["position"], two["position"])
    assert one.unit("position") == "m"
    assert one.energy is not None and two.energy is not None
    assert one.energy.residual == two.energy.residual
    assert built.states == written.states == ("mass.p", "spring.x")


def test_the_oscillator_at_rest_against_its_energy() -> None:
    """k x + k3 x^3 = 1 N: after 60 s the push and the spring balance."""
    x = oscillator().model().simulate(to=60.0, points=2).final("position")
    assert 100 * x + 2e4 * x**3 == pytest.approx(1.0, rel=1e-5)


def test_settings_and_equations_as_from_text() -> None:
    model = oscillator().model()
    assert model.parameters["k3"].value == 2e4
    stiff = model.simulate(to=60.0, points=2, settings={"k": "1 [kN/m]", "k3": 0.0}).final("position")
    assert stiff == pytest.approx(1e-3, rel=1e-4)
    assert str(model.state_equations()["spring.x"]) == "mass.p/m"


def test_the_text() -> None:
    assert (
        oscillator().text()
        == """model Oscillator {
  "A mass on a hardening spring, pushed."

  parameter m: kg = 1
  parameter k: N/m = 100
  parameter k3: N/m^3 = 20000
  parameter r: N*s/m = 0.5

  Se push : F = 1 N*step(time - 0.1 s)
  1 body : translation
  I mass : p = m*v
  C spring : F = k*x + k3*x^3 { start x = 1 mm }
  R damper : F = r*v

  push -> body -> mass, spring, damper

  output position = spring.x
}
"""
    )


def test_the_text_is_the_model() -> None:
    g = oscillator()
    Same(g.model().compilation().whole_graph, bondgraph.load(g.text()).compilation().whole_graph).check()


def test_bonds_in_every_way_are_the_same() -> None:
    texts = []
    for way in range(4):
        g = Graph("M", plain=True)
        a, b, s, j = g.C("a", "e = q"), g.R("b", "e = f"), g.Se("s", "e = 1"), g.one("j")
        if way == 0:
            s >> j >> (a, b)
        elif way == 1:
            g.bond(s, j, [a, b])
        elif way == 2:
            s >> j
            j >> a
            j >> b
        else:
            g.bond("s", "j")
            g.bond("j", (a, "b"))
        texts.append(g.text())
    assert set(texts) == {texts[0]}
    assert "\n  s -> j -> a, b\n" in texts[0]


def test_several_tails() -> None:
    g = Graph("M", plain=True)
    one, two, j, r = g.Se("one", "e = 1"), g.Se("two", "e = 2"), g.one("j"), g.R("r", "e = 4*f")
    [one, two] >> j >> r
    g.output("f", "r.f")
    model = g.model()
    program = model.compilation().program
    c = program.constants(np.array(program.defaults))
    assert program.output(0.0, np.zeros(0), np.zeros(0), c, program.switches(0.0, c)).tolist() == [0.75]


def test_fields_splitters_and_energies() -> None:
    """The leaf spring of the language's tour as a part, hung on a free body: against hand-written forces."""
    leaf = Graph("Leaf")
    for name, unit in (("k_phi", "N*m"), ("k_x", "N/m"), ("k_y", "N/m")):
        leaf.parameter(name, unit=unit)
    ends = leaf.port("ends", "planar")
    spring = leaf.C(
        "spring",
        ports=("x", "y", "phi"),
        energy="""1/2*k_phi*phi^2
                + 1/2*k_x*( x*cos(phi/2) + y*sin(phi/2))^2
                + 1/2*k_y*(-x*sin(phi/2) + y*cos(phi/2))^2""",
    )
    leaf.multibond(ends, spring)
    g = Graph("Hanging")
    stage = g.multibody("stage")
    body = stage.body("body", mass=2.0, inertia=0.5, start={"x": 0.1, "y": -0.2, "phi": 0.3, "x.v": 1.0})
    joint = stage.free("joint", "ground", body)
    inner = g.instance("leaf", leaf, k_phi="3 [N*m]", k_x="50 [N/m]", k_y="70 [N/m]")
    g.multibond(joint, inner["ends"])
    program = g.model().compilation().program
    assert program.states.names == ("stage.body.x", "stage.body.x.v", "stage.body.y", "stage.body.y.v", "stage.body.phi", "stage.body.phi.omega")  # fmt: skip
    c = program.constants(np.array(program.defaults))
    start = np.asarray(program.start(c))
    assert start.tolist() == [0.1, 1.0, -0.2, 0.0, 0.3, 0.0]
    rate = program.derivative(0.0, start, np.zeros(0), c, program.switches(0.0, c))
    x, y, phi = start[[0, 2, 4]]
    cos, sin = np.cos(phi / 2), np.sin(phi / 2)
    u, v = x * cos + y * sin, -x * sin + y * cos
    fx, fy = 50 * u * cos - 70 * v * sin, 50 * u * sin + 70 * v * cos
    torque = 3 * phi + (50 - 70) * u * v / 2
    np.testing.assert_allclose(rate, [1.0, -fx / 2, 0.0, -fy / 2, 0.0, -torque / 0.5], rtol=1e-13, atol=1e-15)


def test_transducers_and_modulation() -> None:
    """A DC motor with a gear, driven by an input, braked by an RS that heats a store."""
    g = Graph("Drive")
    volt = g.input("volt", 12.0, "V")
    K = g.parameter("K", 0.05, "V*s")
    supply = g.MSe("supply", f"u = {volt}")
    circuit, rotor, shaft = g.one("circuit", "electric"), g.one("rotor", "rotation"), g.one("shaft")
    winding, coil = g.R("winding", "u = 1 ohm*i"), g.I("coil", "lambda = 0.5 mH*i")
    motor, gear = g.GY("motor", f"u1 = {K}*omega2"), g.TF("gear", "omega1 = 20*omega2")
    load = g.I("load", "L = 0.01 [kg*m^2]*omega")
    brake = g.RS("brake", "shaft.M = 0.1 [N*m*s]*shaft.omega", ports={"shaft": "rotation", "heat": "thermal"})
    store = g.C("store", "T = 300 K + S/(2 [J/K^2])")
    supply >> circuit >> (winding, coil, motor)
    motor >> rotor >> gear >> shaft >> (load, brake["shaft"])
    brake["heat"] >> store
    g.output("speed", "shaft.omega")
    g.output("T", f"{store}.T")
    text = """model Drive {
      input volt: V = 12
      parameter K: V*s = 0.05
      MSe supply : u = volt
      1 circuit : electric
      1 rotor : rotation
      1 shaft
      R winding : u = 1 ohm*i
      I coil : lambda = 0.5 mH*i
      GY motor : u1 = K*omega2
      TF gear : omega1 = 20*omega2
      I load : L = 0.01 [kg*m^2]*omega
      RS brake(shaft: rotation, heat: thermal) : shaft.M = 0.1 [N*m*s]*shaft.omega
      C store : T = 300 K + S/(2 [J/K^2])
      supply -> circuit -> winding, coil, motor -> rotor -> gear -> shaft -> load, brake.shaft
      brake.heat -> store
      output speed = shaft.omega, T = store.T
    }"""
    assert "rotor" in text
    written = bondgraph.load(text.replace("winding, coil, motor -> rotor", "winding, coil, motor\n motor -> rotor"))
    built = g.model()
    Same(written.compilation().whole_graph, built.compilation().whole_graph).check()
    assert same_motion(written.compilation(everything=True), built.compilation(everything=True), tolerance=0) == 3


def test_signals_integrals_constants_and_lists() -> None:
    g = Graph("Signals")
    d = g.parameter("d", np.array([1.5, 2.5]), "mm")
    e = g.parameter("e", (1, "2*pi", np.float64(0.1)))
    c = g.constant("c", "2 [m/s]", description="how fast")
    x = g.signal("x", f"integral({c}, {d[2]})", "m")
    g.output("far", f"{x} - {d[1]}")
    g.output("third", e[3])
    result = g.model().simulate(to="3 s", points=2)
    assert result["far"].tolist() == pytest.approx([1e-3, 6.001], rel=1e-12)
    assert result["third"].tolist() == [0.1, 0.1]


def test_matrices_and_multibonds_of_transformers() -> None:
    """The spring behind an arm of `language.md`, with its matrices from numpy: the stiffness that the plate feels is T' K T."""
    g = Graph("Held")
    arm, stiffness = np.array([[1, 0, -0.04], [0, 1, 0], [0, 0, 1]]), np.diag([2e3, 5e3])
    K = g.parameter("K", stiffness, "N/m")
    ports = {"x": "translation", "y": "translation", "phi": "rotation"}
    plate = g.I(
        "plate", "p = [[0.5 kg, 0, 0], [0, 0.5 kg, 0], [0, 0, 2e-4 [kg*m^2]]]*f", ports=ports, start={"x": "0.1 [N*s]"}
    )
    lever = g.TF("lever", "b.f = [[1, 0, -40 mm], [0, 1, 0], [0, 0, 1]]*a.f", ports={"a": "planar", "b": "planar"})
    spring = g.C("spring", f"x.F = {K[1, 1]}*x, y.F = {K[2, 2]}*y, phi.M = 3 [N*m]*phi", ports=tuple(ports))
    hand = g.splitter("hand", tuple(ports))
    for port in ports:
        joint = g.one(f"j_{port}")
        joint >> plate[port]
        joint >> hand[port]
    g.multibond(hand, lever["a"])
    g.multibond(lever["b"], spring)
    g.output("turn", f"{plate['phi']}.omega")
    result = g.model().simulate(to="20 ms", points=3, rtol=1e-10)
    whole, mass = arm.T @ np.diag([2e3, 5e3, 3.0]) @ arm, np.diag([0.5, 0.5, 2e-4])
    values, shapes = np.linalg.eig(np.linalg.solve(mass, whole))
    parts = np.linalg.solve(shapes, [0.2, 0, 0])
    exact = [(shapes @ (parts * np.cos(np.sqrt(values) * t)))[2] for t in result.time]
    assert result["turn"] == pytest.approx(exact, abs=1e-7)


def test_arrays_by_index() -> None:
    """A chain of three masses with a Python loop; the slowest mode of fixed ends is 2 sin(pi/8)."""
    g = Graph("Chain", plain=True)
    ends = [g.Sf("left", "f = 0"), g.Sf("right", "f = 0")]
    masses = [g.one(f"mass[{i}]") for i in (1, 2, 3)]
    for i, junction in enumerate(masses, 1):
        junction >> g.I(f"m[{i}]", "p = f")
    between = [g.zero(f"gap[{i}]") for i in (1, 2, 3, 4)]
    for i, gap in enumerate(between, 1):
        gap >> g.C(f"s[{i}]", "e = q")
    places = [ends[0], between[0], masses[0], between[1], masses[1], between[2], masses[2], between[3]]
    g.bond(*places)
    ends[1] >> between[3]
    program = g.model().compilation(everything=True).program
    c = program.constants(np.array(program.defaults))
    matrix = program.jacobian(0.0, np.zeros(7), np.zeros(0), c, program.switches(0.0, c))
    frequencies = sorted(abs(w.imag) for w in np.linalg.eigvals(np.asarray(matrix)) if w.imag > 1e-9)
    expected = [2 * np.sin(k * np.pi / 8) for k in (1, 2, 3)]
    np.testing.assert_allclose(frequencies, expected, rtol=1e-12)


def manipulator() -> Graph:
    """models/manipulator.bg in Python, its loops as Python's."""
    flexure = bondgraph.load(MODELS / "mems.bg", "Flexure")
    comb_drive = bondgraph.load(MODELS / "mems.bg", "CombDrive")
    g = Graph("Manipulator")
    for name, value, unit in [
        ("rho", 2330, "kg/m^3"), ("h", 38, "um"), ("f", 0.4375, ""), ("l_s", 1, "mm"), ("l_f", 400, "um"), ("p", 0.72, ""),
        ("d", (1.95, 1.75, 1.75), "um"), ("E", (130, 158, 158), "GPa"), ("a", 170, "um"), ("s", "l_s/2", ""), ("n", 100, ""),
        ("pitch", 6, "um"), ("r", 2.5e-5, "N*s/m"), ("m_f", "rho*h*(14 um*720 um*(14^2 - 9^2)/14^2 + 2 um*280 um)", ""),
        ("m_s", "39.8 ug + m_f", ""), ("m_p", "378*rho*(12 um)^2*h*f", ""), ("I_z", 2.94e-17, "kg*m^2"),
    ]:  # fmt: skip
        g.parameter(name, value, unit)
    for name, unit in [("push1", "V"), ("pull2", "V"), ("fx", "N"), ("fy", "N"), ("m", "N*m")]:
        g.input(name, 0, unit)
    stage = g.multibody("stage")
    platform = stage.body("platform", mass="m_p", inertia="I_z")
    guides, flexes = [], []
    for i in (1, 2, 3):
        arm = f"{120 * (i - 1)} deg"
        shuttle = stage.body(f"shuttle[{i}]", mass="m_s")
        guides.append(stage.slide(f"guide[{i}]", "ground", shuttle, along=f"{arm} + 90 deg"))
        at = f"polar(a, {arm}) - polar(s, {arm} + 90 deg)"
        flexes.append(stage.free(f"flex[{i}]", shuttle, platform, at=at, angle=arm))
    hand = g.splitter("hand", ("x", "y", "phi"))
    for name, law, port in (("push_x", "F = fx", "x"), ("push_y", "F = fy", "y"), ("twist", "M = m", "phi")):
        g.MSe(name, law) >> hand[port]
    g.multibond(hand, platform)
    for i in (1, 2, 3):
        g.constant(f"I[{i}]", f"h*d[{i}]^3/12")
        g.constant(f"A[{i}]", f"h*d[{i}]")
        combs = {"push": "push1"} if i == 1 else {"pull": "pull2"} if i == 2 else {}
        stiffness = f"48*E[{i}]*I[{i}]/l_f^3"
        comb = g.instance(f"comb[{i}]", comb_drive, n="n", h="h", gap=f"pitch - d[{i}]", k=stiffness, r="r", **combs)
        leaf = g.instance(
            f"flexure[{i}]", flexure, k_phi=f"E[{i}]*I[{i}]/l_s/(1 - p)", k_x=f"12*E[{i}]*I[{i}]/l_s^3/(1 - p^3)",
            k_y=f"E[{i}]*A[{i}]/l_s/(1 - p)",
        )  # fmt: skip
        comb["shuttle"] >> guides[i - 1]
        g.multibond(flexes[i - 1], leaf["ends"])
    for name in ("x", "y", "phi"):
        g.output(name, f"{platform}.{name}")
    return g


def test_the_manipulator_from_python() -> None:
    """Instances of models from a file, a mechanism, fields: the same rates as the text's at random states."""
    graph = manipulator()
    assert graph.check() == ()
    built = graph.model().compilation(everything=True).program
    written = bondgraph.load(MODELS / "manipulator.bg").compilation(everything=True).program
    assert sorted(built.states.names) == sorted(written.states.names)
    order = [built.states.names.index(n) for n in written.states.names]
    rng = np.random.default_rng(3)
    mine, theirs = (p.constants(np.array(p.defaults)) for p in (built, written))
    for _ in range(20):
        state = rng.normal(size=12) * np.array(
            [1e-6 if not n.endswith((".v", ".omega")) else 1e-3 for n in written.states.names]
        )
        own = np.empty(12)
        own[order] = state
        expected = written.derivative(
            0.0, state, np.zeros(len(written.inputs.names)), theirs, written.switches(0.0, theirs)
        )
        found = built.derivative(0.0, own, np.zeros(len(built.inputs.names)), mine, built.switches(0.0, mine))
        np.testing.assert_allclose(np.asarray(found)[order], expected, rtol=1e-11, atol=1e-13 * np.abs(expected).max())


def test_a_model_of_the_library_and_one_of_a_text() -> None:
    g = Graph("Bench")
    part = bondgraph.load(
        "model Half {\n  port a: electric\n  R r : u = 2 ohm*i\n  a -> r\n}  # no line break after this"
    )
    source = g.Se("source", "u = 3 V")
    source >> g.one("loop") >> (g.instance("one", part)["a"], g.instance("two", part)["a"])
    g.output("i", "loop.i")
    assert g.check() == ()
    assert g.text().count("model Half") == 1
    assert g.model().simulate(to=1.0, points=2).final("i") == pytest.approx(0.75)


def test_a_part_of_the_shipped_library_and_a_slot() -> None:
    """A slot takes any model with the same ports: 3 V over the library's 1 kohm, or over 6 ohm, with 2 ohm in series."""
    other = bondgraph.load(
        "model Other {\n  parameter R = 6 ohm\n  port pins: electric\n  R body : u = R*i\n  pins -> body\n}"
    )
    half = Graph("Half")
    kind = half.slot("Kind", "electric.Resistor")
    pins = half.port("pins", "electric")
    (
        pins
        >> half.one("loop")
        >> (half.instance("a", kind)["pins"], half.instance("b", "electric.Resistor", R="2 ohm")["pins"])
    )
    g = Graph("Bench")
    (
        g.Se("source", "u = 3 V")
        >> g.zero("node")
        >> (g.instance("one", half)["pins"], g.instance("two", half, Kind=other)["pins"])
    )
    g.output("i", "one.loop.i")
    g.output("j", "two.loop.i")
    assert g.check() == ()
    result = g.model().simulate(to=1.0, points=2)
    assert (result.final("i"), result.final("j")) == (pytest.approx(3 / 1002), pytest.approx(3 / 8))


def test_files_are_imported_from_the_folder(tmp_path: Path) -> None:
    """The text names files as seen from its folder, and does not become the file that it imports."""
    (tmp_path / "bondgraph.toml").write_text("")
    (tmp_path / "parts").mkdir()
    file = tmp_path / "parts" / "Bench.bg"
    file.write_text("model Half {\n  parameter R = 2 ohm\n  port a: electric\n  R r : u = R*i\n  a -> r\n}\n")
    g = Graph("Bench", folder=tmp_path)
    g.Se("source", "u = 3 V") >> g.instance("half", bondgraph.load(file), R="6 ohm")["a"]
    g.output("i", "half.r.i")
    assert g.text().startswith('import Half from "parts/Bench.bg"\n\nmodel Bench {\n')
    assert g.model().simulate(to=1.0, points=2).final("i") == pytest.approx(0.5)
    (tmp_path / "again.bg").write_text(g.text())
    assert bondgraph.check(tmp_path / "again.bg") == ()
    beside = Graph("Bench")
    beside.Se("source", "u = 3 V") >> beside.instance("half", bondgraph.load(file), R="6 ohm")["a"]
    beside.output("i", "half.r.i")
    assert beside.check() == ()


def test_numbers_come_back_exactly() -> None:
    rng = np.random.default_rng(11)
    values = [*(rng.normal(size=60) * 10.0 ** rng.integers(-300, 300, size=60)), 5e-324, 1.7976931348623157e308, 2.2250738585072014e-308, 1e22, -0.1, 0.0, 123456789, 1e15]  # fmt: skip
    g = Graph("Numbers")
    for i, value in enumerate(values):
        g.parameter(f"bare_{i}", value)
        g.parameter(f"unit_{i}", value, "N*s/m")
    found = g.model().parameters
    assert [found[f"bare_{i}"].value for i in range(len(values))] == values
    assert [found[f"unit_{i}"].value for i in range(len(values))] == values


@pytest.mark.parametrize(
    ("start", "expected"), [("1 mm", 1e-3), ("x0", 2e-3), ("2*x0 + 1 mm", 5e-3), (0, 0.0), (np.float64(0.0), 0.0)]
)
def test_starts(start: str | float, expected: float) -> None:
    g = Graph("M")
    x0 = g.parameter("x0", 2, "mm")
    value = x0 if start == "x0" else start
    spring = g.C("spring", "F = 100 [N/m]*x", start={"x": value}, nominal={"x": "1 um"})
    g.one("body") >> (spring, g.I("mass", "p = 1 kg*v", start={"p": "0.5 [N*s]"}))
    result = started(g)
    assert result["spring.x"] == pytest.approx(expected, rel=1e-15)
    assert result["mass.p"] == 0.5


def started(g: Graph) -> dict[str, float]:
    program = g.model().compilation(everything=True).program
    starts = program.start(program.constants(np.array(program.defaults)))
    return dict(zip(program.states.names, starts, strict=True))


def test_starts_of_fields_and_of_plain_graphs() -> None:
    g = Graph("M", plain=True)
    field = g.C("field", energy="a^2/2 + 2*b^2", ports=("a", "b"), start={"a": 0.25, "b.q": 0.5})
    g.one("loop") >> (field["a"], g.R("r", "e = f"))
    g.one("body") >> (field["b"], g.R("d", "e = f"))
    assert started(g) == {"field.a": 0.25, "field.b": 0.5}


def test_experiments_are_those_of_a_text() -> None:
    g = oscillator()
    g.experiment(
        "stiff", 60.0, settings={"k": "1 [kN/m]", "k3": 0}, report={"position": "mm", f"{'spring'}.F": ""}, points=3
    )
    g.experiment("long", "10 s if 1 < 2 else 5 s", report=["position"], rtol=1e-8)
    assert g.check() == ()
    result = g.model().simulate()
    assert result.final("position") == pytest.approx(1e-3, rel=1e-4)
    assert len(result.time) == 3
    assert result.final("spring.F") == pytest.approx(1.0, rel=1e-4)
    assert g.model().simulate("long").time[-1] == 10.0
    assert "    report position in mm\n" in g.text()


def test_a_bandwidth_is_a_step_of_an_experiment() -> None:
    g = oscillator()
    g.experiment("quick", "1 s", bandwidth="50 kHz")
    g.experiment("number", "1 s", bandwidth=5e4)
    assert "    bandwidth 50 kHz\n" in g.text()
    told = [g.model().simulate(name).truncation for name in ("quick", "number")]
    assert told[0] is not None and told[0].bandwidth == 5e4 and told[0] == told[1]


def ball() -> Graph:
    g = Graph("Ball")
    bounce = g.parameter("bounce", 0.8)
    resting = g.mode("resting", "false")
    body = g.one("ball", active=f"not {resting}")
    mass = g.I("mass", "p = 0.1 kg*v")
    g.Se("weight", "F = -0.981 N") >> body >> mass
    height = g.output("height", f"integral({body}.v, 1 m)")
    g.when(f"{height} < 0 m", {f"{mass}.v": f"-{bounce}*{mass}.v", resting: f"abs({mass}.v) < 1 [mm/s]"})
    return g


def test_events_of_a_builder() -> None:
    result = ball().model().simulate(to="5 s")
    assert len(result.events) == 39
    assert abs(result.final("height")) < 1e-6
    g = Graph("Counter")
    count = g.mode("count", 0)
    g.every(0.25, {count: f"{count} + 1"})
    g.output("c", count)
    g.signal("x", "integral(1 [1/s], 0)")
    assert g.model().simulate(to="1 s", points=5)["c"].tolist() == [1, 2, 3, 4, 5]
    with pytest.raises(CompilationFailed):
        ball().when("height < 0 m }", {"resting": "true"})


def test_the_text_is_formatted() -> None:
    for g in (oscillator(), manipulator(), ball()):
        assert format_text(Source("text", g.text())) == g.text()


EXAMPLES = re.findall(r"^```python\n(.*?)^```$", README, re.M | re.S)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.split()[1])
def test_the_examples_of_the_readme_run(example: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", example], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_nothing_heavy_is_imported() -> None:
    script = "import sys, bondgraph\ng = bondgraph.Graph('M')\ng.C('c', 'F = 2 [N/m]*x')\nassert g.text()\nprint([m for m in ('numpy', 'sympy', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "[]"


def test_multibonds_of_a_width() -> None:
    """A chain as one I, one C and a transformer by the incidence matrix: damped in the middle, the mode in which that rests is not."""
    g = Graph("Chain")
    n = g.parameter("n", 3)
    D = g.constant("D", np.eye(4, 3) - np.eye(4, 3, -1))
    body = g.one("body", f"translation[{n}]")
    mass = g.I("mass", ports={"p": f"translation[{n}]"}, energy="dot(p, p)/(2*1 kg)", start={"p[1].v": "1 [m/s]"})
    ends = g.TF("ends", f"b.f = {D}*a.f", ports={"a": f"translation[{n}]", "b": f"translation[{n} + 1]"})
    springs = g.C("springs", "e = 1 [N/m]*q", ports={"s": f"translation[{n} + 1]"})
    g.multibond(body, [mass, ends["a"]])
    g.multibond(ends["b"], springs)
    slider = g.R("slider", "F = 0.5 [N*s/m]*v")
    body[2] >> slider
    frame = g.one("frame", "planar")
    frame["x"] >> g.I("plate", "p = 1 kg*v")
    frame["y"] >> g.I("other", "p = 1 kg*v")
    frame["phi"] >> g.I("turning", "L = 1 [kg*m^2]*omega")
    g.output("v", f"{body[2]}.v")
    model = g.model()
    damped = [mode.damping for mode in model.modes() if mode.frequency and mode.frequency > 1e-6]
    assert len(damped) == 3 and sum(d < 1e-9 for d in damped) == 1  # the one in which the middle rests
    with pytest.raises(bondgraph.BondgraphError, match="no domain"):
        g.one("wrong", "translation[2")
