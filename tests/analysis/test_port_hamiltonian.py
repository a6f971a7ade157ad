"""The port-Hamiltonian form: textbook matrices, energy and rates of the compiled program, and models without such a form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import HealthCheck, given, settings

import bondgraph
from bondgraph.analysis.port_hamiltonian import PortHamiltonian
from bondgraph.errors import RunFailed, UsageError
from tests.compiling import MODELS
from tests.equations.random_network import Example, examples

MASS = "model A {\n  parameter m = 2 kg, k = 3 [N/m], b = 0.5 [N*s/m]\n  Se push : F = 7 N\n  1 body\n  I mass : p = m*v\n  C spring : F = k*x\n  R damper : F = b*v\n  push -> body -> mass, spring, damper\n}\n"
RLC = "model A {\n  Se s : u = 6 V\n  R r : u = 2 ohm*i\n  I l : lambda = 3 H*i\n  0 node\n  C c : u = q/5 F\n  R load : u = 4 ohm*i\n  s -> 1(r, l) -> node -> c, load\n}\n"
MOTOR = "model A {\n  Se s : u = 12 V\n  1 coil : electric\n  R r : u = 1.5 ohm*i\n  I l : lambda = 0.1 H*i\n  GY motor : u1 = 0.3 [V*s]*omega2\n  1 shaft : rotation\n  I j : L = 0.02 [kg*m^2]*omega\n  R b : M = 0.04 [N*m*s]*omega\n  s -> coil -> r, l, motor\n  motor -> shaft -> j, b\n}\n"
# A plate of three freedoms on a leaf spring whose frame turns by half the angle, with losses that couple two of them.
FLEXURE = """
model A {
  parameter k_phi = 1.09e-8 [N*m/rad], k_x = 0.0584 [N/m], k_y = 34404 [N/m], m = 2.1e-9 kg, J = 2.9e-17 [kg*m^2]
  C spring(x, y, phi) :
    energy = 1/2*k_phi*phi^2 + 1/2*k_x*(x*cos(phi/2) + y*sin(phi/2))^2 + 1/2*k_y*(-x*sin(phi/2) + y*cos(phi/2))^2
  R loss(x, y) : x.F = 2e-5 [N*s/m]*x.v - 1e-5 [N*s/m]*y.v, y.F = 3e-5 [N*s/m]*y.v - 1e-5 [N*s/m]*x.v
  I plate(x, y, phi) : energy = (x^2 + y^2)/(2*m) + phi^2/(2*J)
  Se push : F = 30 uN
  1 along_x, along_y : translation
  1 turn : rotation
  push -> along_x -> spring.x, loss.x, plate.x
  along_y -> spring.y, loss.y, plate.y
  turn -> spring.phi, plate.phi
}
"""


def form(text: str, **state: float) -> PortHamiltonian:
    return bondgraph.load(text).port_hamiltonian({n.replace("_", "."): v for n, v in state.items()})


def ordered(found: PortHamiltonian, matrix: Any, *names: str) -> Any:
    """A matrix with rows and columns in the order of the names."""
    places = [found.states.index(n) for n in names]
    return matrix[np.ix_(places, places)]


class TestTextbooks:
    def test_mass_spring_damper(self) -> None:
        found = form(MASS, mass_p=4.0, spring_x=0.5)
        assert ordered(found, found.J, "mass.p", "spring.x").tolist() == [[0, -1], [1, 0]]
        assert ordered(found, found.R, "mass.p", "spring.x").tolist() == [[0.5, 0], [0, 0]]
        assert found.sources == ("push",) and found.G[found.states.index("mass.p")].tolist() == [1]
        assert found.energy == pytest.approx(4**2 / 4 + 3 * 0.25 / 2, rel=1e-15)
        assert dict(zip(found.states, found.rates, strict=True)) == pytest.approx(
            {"mass.p": 7 - 1.5 - 0.5 * 2, "spring.x": 2.0}, rel=1e-15
        )
        assert found.hamiltonian({"mass.p": 2.0}) == pytest.approx(1.0, rel=1e-15)

    def test_rlc(self) -> None:
        found = form(RLC)
        assert ordered(found, found.J, "l.lambda", "c.q").tolist() == [[0, -1], [1, 0]]
        assert ordered(found, found.R, "l.lambda", "c.q").tolist() == [[2, 0], [0, 0.25]]

    def test_motor(self) -> None:
        """The gyrator is in J: it passes power on."""
        found = form(MOTOR)
        assert ordered(found, found.J, "l.lambda", "j.L").tolist() == [[0, -0.3], [0.3, 0]]
        assert ordered(found, found.R, "l.lambda", "j.L").tolist() == [[1.5, 0], [0, 0.04]]

    def test_flexure(self) -> None:
        state = {"spring.x": 1e-5, "spring.y": 2e-7, "spring.phi": 0.05, "plate.x": 1e-11, "plate.phi": 2e-15}
        found = bondgraph.load(FLEXURE).port_hamiltonian(state)
        stored, momenta = ["spring.x", "spring.y", "spring.phi"], ["plate.x", "plate.y", "plate.phi"]
        J = ordered(found, found.J, *stored, *momenta)
        assert J.tolist() == np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]]).tolist()
        R = ordered(found, found.R, *stored, *momenta)
        assert R[3:, 3:] == pytest.approx(np.array([[2e-5, -1e-5, 0], [-1e-5, 3e-5, 0], [0, 0, 0]]), rel=1e-14)
        assert not R[:3].any() and not R[:, :3].any()
        for i, name in enumerate(found.states):  # grad H by central differences of H itself
            size = max(abs(state.get(name, 0.0)), {"p": 1e-11, "s": 1e-6}[name[0]])
            ends = [found.hamiltonian(state | {name: state.get(name, 0.0) + s * 1e-4 * size}) for s in (1, -1)]
            assert found.gradient[i] == pytest.approx(
                (ends[0] - ends[1]) / (2e-4 * size), rel=1e-6, abs=1e-6 * abs(found.gradient).max() * 1e-6
            )

    def test_a_gyrating_resistor(self) -> None:
        """e = [[2, 1], [-1, 3]] f: its skew part goes to J."""
        text = "plain model A {\n  I m : p = 2*f\n  I n : p = 5*f\n  R r(a, b) : a.e = 2*a.f + b.f, b.e = 3*b.f - a.f\n  1(m) -> r.a\n  1(n) -> r.b\n}\n"
        found = form(text)
        assert ordered(found, found.R, "m.p", "n.p").tolist() == [[2, 0], [0, 3]]
        assert ordered(found, found.J, "m.p", "n.p").tolist() == [[0, -1], [1, 0]]

    def test_loops_of_resistors(self) -> None:
        """Two capacitors in a star of three resistors: conductances by hand."""
        text = "model A {\n  0 middle : electric\n  R a : u = 2 ohm*i\n  R b : u = 3 ohm*i\n  R g : u = 6 ohm*i\n  C c : u = q/1 F\n  C d : u = q/1 F\n  middle -> g\n  middle -> 1(a, c)\n  middle -> 1(b, d)\n}\n"
        found = form(text)
        # u = (uc/2 + ud/3)/(1/2 + 1/3 + 1/6): ic = (u - uc)/2
        assert ordered(found, found.R, "c.q", "d.q") == pytest.approx(
            np.array([[1 / 2 - 1 / 4, -1 / 6], [-1 / 6, 1 / 3 - 1 / 9]]), rel=1e-14
        )
        assert not found.J.any()


class TestNonlinear:
    def test_a_resistor_has_the_ratio_at_the_point(self) -> None:
        """F = 0.5 v + 0.2 v^3 at 3 m/s: 0.5 + 1.8; the rates are exact."""
        text = MASS.replace("F = b*v", "F = b*v + 0.2 [N*s^3/m^3]*v^3")
        found = form(text, mass_p=6.0)
        place = found.states.index("mass.p")
        assert found.R[place, place] == pytest.approx(0.5 + 0.2 * 9, rel=1e-14)
        assert found.rates[place] == pytest.approx(7 - 1.5 - 5.4, rel=1e-13)
        at_rest = form(text)
        assert at_rest.R[place, place] == pytest.approx(0.5, rel=1e-14)

    def test_a_nonlinear_loop(self) -> None:
        """A diode behind a resistor: dissipation is that of both, and the rate that of the program."""
        text = "model A {\n  Se s : u = 2 V\n  1 loop\n  R series : u = 3 ohm*i\n  R diode : i = 1 uA*(exp(u/26 mV) - 1)\n  C c : u = q/1 F\n  s -> loop -> series, diode, c\n}\n"
        found = form(text, c_q=0.5)
        i = float(found.rates[0])
        assert pytest.approx(3 * i + 0.026 * np.log1p(i / 1e-6), rel=1e-10) == 2 - 0.5
        assert found.R[0, 0] * 1.5 == pytest.approx(i, rel=1e-9) and found.G[0, 0] == pytest.approx(
            found.R[0, 0], rel=1e-12
        )

    def test_a_modulated_transformer(self) -> None:
        """An arm of 2 m at 60 degrees: v = 2 m cos(phi) omega, at this angle 1."""
        text = "model A {\n  1 turn : rotation\n  1 up : translation\n  I j : L = 3 [kg*m^2]*omega\n  C angle : M = 0 [N*m] + 1e-9 [N*m]*phi { start phi = 60 deg }\n  MTF arm : F2*2 m*cos(angle.phi) = M1\n  C k : F = 5 [N/m]*x\n  turn -> j, angle, arm\n  arm -> up -> k\n}\n"
        found = form(text)
        p, x = found.states.index("j.L"), found.states.index("k.x")
        assert found.J[x, p] == pytest.approx(1.0, rel=1e-14) and found.J[p, x] == -found.J[x, p]


class TestDependentStorages:
    def test_motor_with_a_load_behind_a_gearbox(self) -> None:
        """E = 1 + (J_load/N^2)/J, and the rates are those of the program."""
        model = bondgraph.load("models/dc_motor.bg")
        found = model.port_hamiltonian({"inertia.L": 3e-3, "coil.lambda": 2e-4})
        p = found.states.index("inertia.L")
        assert found.E[p, p] == pytest.approx(1 + 0.01 / 400 / 2e-5, rel=1e-14)
        rates = rates_of(model, {"inertia.L": 3e-3, "coil.lambda": 2e-4}, found)
        assert found.rates == pytest.approx(rates, rel=1e-13)
        # H holds both inertias, and its gradient is E' z.
        omega = 3e-3 / 2e-5
        assert found.energy == pytest.approx(
            2e-4**2 / 1e-3 + 2e-5 * omega**2 / 2 + 0.01 * (omega / 20) ** 2 / 2, rel=1e-13
        )
        step = 1e-7
        slope = (found.hamiltonian({"inertia.L": 3e-3 + step}) - found.hamiltonian({"inertia.L": 3e-3 - step})) / (
            2 * step
        )
        assert found.gradient[p] == pytest.approx(slope, rel=1e-8)

    def test_nonlinear_capacitors_in_parallel(self) -> None:
        """u = q + q^3 beside u = 2 q: E = 1 + (1 + 3 q^2)/2."""
        text = "plain model A {\n  Sf s : f = 3\n  0 node\n  C c : e = q + q^3 { prefer = integral }\n  C d : e = 2*q { prefer = derivative }\n  s -> node -> c, d\n}\n"
        found = form(text, c_q=0.5)
        assert found.states == ("c.q",)
        assert found.E[0, 0] == pytest.approx(1 + (1 + 0.75) / 2, rel=1e-14)
        assert found.rates[0] == pytest.approx(3 / found.E[0, 0], rel=1e-14)


class TestSymbols:
    def test_mass_spring_damper(self) -> None:
        found = bondgraph.load(MASS).symbolic_port_hamiltonian()
        m, k, b, p, x = (sympy.Symbol(n, real=True) for n in ("m", "k", "b", "mass.p", "spring.x"))
        assert found.states == ("mass.p", "spring.x")
        assert sympy.Matrix([[0, -1], [1, 0]]) == found.J and sympy.Matrix([[b, 0], [0, 0]]) == found.R
        assert sympy.Matrix([1, 0]) == found.G
        assert sympy.simplify(found.H - p**2 / (2 * m) - k * x**2 / 2) == 0

    def test_the_state_equations_follow(self) -> None:
        """x' = (J - R) grad H + G u, with a loop of resistors and a gyrator."""
        text = "model A {\n  parameter lead = 2 ohm, leak = 3 ohm, w = 12 V, K = 0.3 [V*s]\n  Se s : u = w\n  0 node : electric\n  R r : u = lead*i\n  R g : u = leak*i\n  R c : u = 5 ohm*i\n  GY motor : u1 = K*omega2\n  I l : lambda = 0.1 H*i\n  I j : L = 0.02 [kg*m^2]*omega\n  R b : M = 0.04 [N*m*s]*omega\n  C q : u = q/1 F\n  s -> 1(r) -> node -> g\n  node -> 1(c, q)\n  1 coil : electric\n  node -> coil -> l, motor\n  motor -> 1(j, b)\n}\n"
        model = bondgraph.load(text)
        found, equations = model.symbolic_port_hamiltonian(), model.state_equations()
        gradient = sympy.Matrix([sympy.diff(found.H, sympy.Symbol(n, real=True)) for n in found.states])
        w = sympy.Symbol("w", real=True)
        for i, name in enumerate(found.states):
            rate = ((found.J - found.R) * gradient + found.G * sympy.Matrix([w]))[i]
            difference = sympy.simplify(rate - equations[name])
            assert abs(complex(difference.subs(dict.fromkeys(difference.free_symbols, 1.7)))) < 1e-12

    def test_work_of_a_law(self) -> None:
        found = bondgraph.load(MASS.replace("F = k*x", "F = k*x + 4 [N/m^3]*x^3")).symbolic_port_hamiltonian()
        x = sympy.Symbol("spring.x", real=True)
        assert sympy.diff(found.H, x, 4) == 24


class TestRefused:
    def test_a_negative_resistor_is_named(self) -> None:
        text = MASS.replace("R damper : F = b*v", "R damper : F = b*v\n  R pump : F = -2*b*v").replace(
            "spring, damper", "spring, damper, pump"
        )
        with pytest.raises(UsageError, match=r"`pump` creates energy"):
            form(text)
        assert form(text.replace("-2*b", "-0.5*b")).R.max() == pytest.approx(0.25), "what others take counts too"

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("models/manipulator.bg", "`stage` is a mechanism"),
            (
                "model A {\n  1 axle : rotation\n  I wheel : L = 0.2 [kg*m^2]*omega\n  RS pad(shaft, heat) : shaft.M = 0.4 [N*m*s]*shaft.omega\n  C disc : T = 293 K*exp(S/500 [J/K])\n  axle -> wheel, pad.shaft\n  pad.heat -> disc\n}\n",
                "`pad`",
            ),
            (
                "model A {\n  Sf s : v = 1 [m/s]*sin(time*1 [1/s])\n  I m : p = 2 kg*v\n  C k : F = 3 [N/m]*x\n  s -> 1(m, k)\n}\n",
                "`m`",
            ),
            (
                "plain model A {\n  I m : p = 2*f\n  I n : p = f { start p = 1 }\n  R w : e = f\n  MTF t : f1 = (1 + w.e)*f2\n  1 a, b\n  a -> m, t\n  t -> b -> n\n  1 z\n  C y : e = q\n  z -> w, y\n}\n",
                "`t` is modulated by the effort",
            ),
        ],
    )
    def test_what_has_no_such_form(self, text: str, words: str) -> None:
        with pytest.raises(UsageError, match=words):
            bondgraph.load(text).port_hamiltonian()

    def test_an_unknown_state(self) -> None:
        with pytest.raises(UsageError, match=r"states are mass\.p, spring\.x"):
            bondgraph.load(MASS).port_hamiltonian({"spring.y": 1.0})

    def test_symbols_of_what_is_not_linear(self) -> None:
        with pytest.raises(UsageError, match=r"`damper` is not linear"):
            bondgraph.load(MASS.replace("F = b*v", "F = b*v^3/1 [m^2/s^2]")).symbolic_port_hamiltonian()


def rates_of(
    model: bondgraph.Model, state: dict[str, float], found: PortHamiltonian, values: Any = None, time: float = 0.0
) -> Any:
    """Rates of the compiled program, in the order of the form; for variables that are no state of the program, those of the form."""
    compilation = model.compilation(model.scene(None, values), everything=True)
    program = compilation.program
    constants = program.constants(np.array(program.defaults))
    start = np.asarray(program.start(constants))
    x = np.array([state.get(n, start[i]) for i, n in enumerate(program.states.names)])
    rates = program.derivative(
        time,
        x,
        np.array(program.input_defaults),
        constants,
        program.mode_at(time, x, np.array(program.input_defaults), constants),
    )
    known = dict(zip(program.states.names, rates, strict=True))
    return np.array([known.get(n, own) for n, own in zip(found.states, found.rates, strict=True)])


GALLERY = (
    "chain", "coupled_coils", "coupled_tanks", "drag", "duffing", "gyrator", "helmholtz", "hydraulic_press", "loudspeaker", "oscillator",
    "pid_dc_motor", "plates", "quarter_car", "rc_ladder", "rlc", "solenoid", "surge_tank", "transformer", "vibration_absorber",
)  # fmt: skip


@pytest.mark.parametrize("name", GALLERY)
def test_models_of_the_gallery(name: str) -> None:
    """J skew, R positive semidefinite, and the program's rates, away from the start."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    program = model.compilation(everything=True).program
    start = program.start(program.constants(np.array(program.defaults)))
    state = {n: (1.1 * x if x else 1e-7) for n, x in zip(program.states.names, start, strict=False)}
    found = model.port_hamiltonian(state)
    assert (found.J == -found.J.T).all()
    scale = 1 / np.sqrt(np.where(np.diag(found.R) > 0, np.diag(found.R), 1.0))
    assert np.linalg.eigvalsh(found.R * np.outer(scale, scale)).min() > -1e-12
    expected = rates_of(model, state, found)
    assert found.rates == pytest.approx(expected, rel=1e-9, abs=1e-12 * float(np.abs(expected).max()))


def test_a_displacement_that_is_known_twice() -> None:
    """Two springs on one flow: both displacements are in the form, whether or not both are states."""
    text = MASS.replace("R damper", "C other : F = 4 [N/m]*x\n  R damper").replace(
        "spring, damper", "spring, other, damper"
    )
    found = form(text, mass_p=4.0)
    assert set(found.states) == {"mass.p", "spring.x", "other.x"}
    J = ordered(found, found.J, "mass.p", "spring.x", "other.x")
    assert J.tolist() == [[0, -1, -1], [1, 0, 0], [1, 0, 0]]


COUNT = {"tried": 0, "made": 0, "dependent": 0}


@pytest.mark.machine_code
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
@given(examples())
def test_random_graphs(example: Example) -> None:
    """J is skew, R is positive semidefinite, and they give the program's rates for every graph."""
    model = bondgraph.load(example.text + "\n")
    compilation = model.compilation(model.scene(None, example.settings), everything=True)
    try:
        names, unknowns = compilation.program.states.names, compilation.program.unknowns.names
    except bondgraph.CompilationFailed:
        return
    state = {n: example.numbers[i % len(example.numbers)] * (1 + i // 6) for i, n in enumerate(names)}
    COUNT["tried"] += 1
    try:
        found = model.port_hamiltonian(state, example.settings, example.time)
    except (UsageError, RunFailed):
        return
    COUNT["made"] += 1
    COUNT["dependent"] += bool(compilation.state_space.dependent)
    assert (found.J == -found.J.T).all() and (found.R == found.R.T).all()
    assert np.linalg.eigvalsh(found.R).min(initial=0.0) >= -1e-9 * max(1.0, abs(found.R).max(initial=0.0))
    power = found.slopes @ (found.E @ found.rates)
    lost, supplied = found.slopes @ found.R @ found.slopes, found.slopes @ found.G @ found.given
    assert power == pytest.approx(
        supplied - lost,
        rel=1e-9,
        abs=1e-9 * (abs(lost) + abs(supplied) + abs(found.slopes) @ abs(found.E @ found.rates)),
    )
    if not unknowns:
        expected = rates_of(model, state, found, example.settings, example.time)
        size = max(1.0, float(np.abs(expected).max(initial=0.0)))
        np.testing.assert_allclose(found.rates, expected, rtol=1e-8, atol=1e-9 * size)


@pytest.mark.machine_code
def test_most_random_graphs_have_the_form() -> None:
    """The test above must not be empty."""
    if not COUNT["tried"]:
        test_random_graphs()
    assert COUNT["made"] > 0.3 * COUNT["tried"] and COUNT["dependent"] > 0
