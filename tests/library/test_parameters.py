"""Senseless parameters are refused: each parameter of each part turned in sign and set to zero breaks a `require` that names it, or is allowed with a reason."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

import bondgraph
from bondgraph.catalogue import library_parts
from bondgraph.simulation.monitors.validity import ValidityMonitor
from compiler.algebra.expression import evaluate
from compiler.graph.network import BondGraph, Quantity
from tests.library.test_examples import NAMES, example

# The values that are allowed ("-": of the other sign, "0": zero), why, and the parameters.
ALLOWED = (
    ("-0", "a gain, a weight, or a coefficient of a polynomial or a fit",
     "Pid.k_p Pid.k_i Pid.w_p Pid.w_d FirstOrder.K SecondOrder.K LeadLag.K LeadLag.T_1 TransferFunction2.b_1 TransferFunction2.b_0 "
     "TransferFunction2.a_1 TransferFunction2.a_0 DiscretePid.k_p DiscretePid.k_i DiscretePid.w_p DiscretePid.w_d TorqueConverter.a_0 "
     "TorqueConverter.a_1 TorqueConverter.a_2 TorqueConverter.b_0 TorqueConverter.b_1 TorqueConverter.b_2 TorqueConverter.c_0 "
     "TorqueConverter.c_1 TorqueConverter.c_2 Tyre.E TyreSide.E"),
    ("-0", "an entry of a matrix",
     "StateSpace.A[1,1] StateSpace.A[2,1] StateSpace.A[2,2] StateSpace.A[3,2] StateSpace.A[3,3] StateSpace.B[1] StateSpace.C[3]"),
    ("-", "the same, and zero is its default, or a start",
     "StateSpace.A[1,2] StateSpace.A[1,3] StateSpace.A[2,3] StateSpace.A[3,1] StateSpace.B[2] StateSpace.B[3] StateSpace.C[1] StateSpace.C[2] "
     "StateSpace.D StateSpace.x_0[1] StateSpace.x_0[2] StateSpace.x_0[3]"),
    ("-", "the same, and zero is its default", "Pid.k_d TransferFunction2.b_2 DiscretePid.k_d"),
    ("-", "the same, and its part is of another order without it", "TransferFunction2.a_2"),
    ("-0", "an unstable plant has a negative damping ratio", "SecondOrder.zeta"),
    ("-", "a start, or an instant",
     "Pid.start FirstOrder.y_0 SecondOrder.y_0 LeadLag.x_0 RateLimit.y_0 Lowpass.y_0 DiscretePid.start DiscreteRateLimit.y_0 Encoder.count_0 "
     "UniversalJoint.phi_0 CrankSlider.phi_0 Capacitor.U_0 Inductor.I_0 Cylinder.P_a0 Cylinder.P_b0 Pipe.Q_0 Volume.P_0 Plunger.P_0 "
     "StepperMotor.phi_0 SpringDamper.x_0 TorsionSpring.phi_0 DryFriction.moving Stops.x_0 RotaryStops.phi_0 Backlash.x_0 "
     "TrapezoidProfile.start SmoothProfile.start Observer.x_0"),
    ("-0", "a start", "StoppedMass.v_0 Rope.x_0"),
    ("-0", "a start; the Reynolds number is looked at in the run", "TurbulentPipe.Q_0"),
    ("-", "the language refuses samples before zero (BG176)", "Adc.phase Dac.phase DiscretePid.phase DiscreteRateLimit.phase Encoder.phase"),
    ("0", "an end of a range may be zero",
     "Pid.low Adc.low Adc.high Dac.low Dac.high DiscretePid.low Stops.low Stops.high RotaryStops.low RotaryStops.high StoppedMass.low "
     "StoppedMass.high TwoPoint.low TwoPoint.high ThreePoint.off"),
    ("-0", "an end of a range of which the other is far", "Pid.high DiscretePid.high"),
    ("-", "turns, pulls or is wound the other way",
     "Differential.ratio WormGear.ratio DcMotor.K Transformer.ratio Pump.D VoiceCoil.K SeriesMotor.k StepperMotor.K Winding.n Gear.ratio "
     "Lever.l_a Lever.l_b Screw.lead EndStop.side"),
    ("-0", "points the other way, or nowhere",
     "UniversalJoint.angle Cam.lift CoupledCoils.coupling Pmsm.psi PermanentMagnet.B_r ChevronActuator.theta PiezoStack.d_33 "
     "CapacitiveReadout.U SmoothProfile.distance Peltier.alpha Flexure.turn"),
    ("-", "the other polarity", "Bjt.polarity Mos.polarity"),
    ("-0", "a threshold below zero conducts without a voltage (depletion)", "Mos.U_th"),
    ("-0", "a place; pressed together at the start where it is negative", "EndStop.gap HertzContact.gap"),
    ("-", "the same", "GroundPoint.height GroundBall.gap"),
    ("-0", "a pressure against the surroundings", "Reservoir.pressure"),
    ("0", "an absolute pressure: vacuum", "Accumulator.P_out GasSource.pressure GasVolume.P_0 GasCylinder.P_0 GasCylinder.P_out"),
    ("-0", "some materials shrink, or conduct better, where it gets warm", "ChevronActuator.alpha PowerMosfet.alpha HeatedResistor.alpha"),
    ("-0", "a negative stiffness is one that tips or buckles", "SpringDamper.k TorsionSpring.k"),
    ("-0", "compiled in: the language refuses no sections", "CableSections.n HeatRod.n"),
    ("0", "without friction, damping, resistance, leakage or another effect",
     "Dac.late DiscretePid.T_f DiscreteRateLimit.rise DiscreteRateLimit.fall WormGear.mu FrictionClutch.M_max DiscBrake.mu Tyre.mu TyreSide.mu "
     "Resistor.R Mos.modulation OpAmp.R_out DcMotor.R DcMotor.b CoupledCoils.R_1 CoupledCoils.R_2 Thermistor.B Battery.R_0 SolarCell.I_ph "
     "CableSections.R CableSections.G Relay.R Cylinder.r Plunger.r VoiceCoil.R SeriesMotor.R SeriesMotor.b Pmsm.R InductionMotor.R_s "
     "InductionMotor.R_r StepperMotor.R Winding.R EddyCurrents.G Belt.r SpringDamper.r TorsionSpring.r Friction.F_c Friction.r "
     "RotaryFriction.M_c RotaryFriction.r EndStop.loss DryFriction.F_c Stops.r RotaryStops.r StoppedMass.bounce Backlash.play Backlash.r "
     "Lugre.sigma_1 Lugre.sigma_2 AirDrag.c_d AirDrag.rho GroundPoint.loss GroundPoint.mu GroundBall.loss GroundBall.mu Rope.r "
     "Flexure.k_phi Flexure.k_x Flexure.k_y Flexure.r_phi Flexure.r_x Flexure.r_y LeafFlexure.r_phi LeafFlexure.r_x LeafFlexure.r_y "
     "ReinforcedFlexure.r_phi ReinforcedFlexure.r_x ReinforcedFlexure.r_y StiffeningFlexure.shortening StiffeningFlexure.r_phi "
     "StiffeningFlexure.r_x StiffeningFlexure.r_y BuckConverter.R BoostConverter.R BuckBoostConverter.R Conductor.G Radiator.area "
     "Radiator.emissivity Peltier.R Peltier.K HeatExchanger.UA Bushing.k[1] Bushing.k[2] Bushing.k[3] Bushing.c[1] Bushing.c[2] Bushing.c[3] BeamChain.tau "
     "PlanarBushing.k[1] PlanarBushing.k[2] PlanarBushing.c PlanarBushing.r[1] PlanarBushing.r[2] PlanarBushing.d"),
    ("0", "without a threshold, a share, an angle or an exponent",
     "WormGear.pressure_angle Cam.dwell Diode.grading Diode.forward Battery.U_empty Battery.soc_0 Tank.level_0 ReliefValve.P_set "
     "ReducingValve.P_set ReinforcedFlexure.p StiffeningFlexure.p GasOrifice.ratio PowerMosfet.U_d Igbt.U_0 Thyristor.U_0 Thyristor.I_hold "
     "DiodeBridge.U_0 HeatExchanger.counter"),
)  # fmt: skip


def value(graph: BondGraph, reference: object, given: dict[str, float]) -> float:
    """Return a number, parameter or constant with other parameters. Raises LookupError for what changes in a run."""
    if isinstance(reference, float):
        return reference
    quantity = graph.quantities.get(reference.name) if isinstance(reference, Quantity) else None
    if quantity is None or quantity.role not in ("parameter", "constant"):
        raise LookupError(reference)
    if quantity.name in given:
        return given[quantity.name]
    if quantity.definition is not None:
        return evaluate(quantity.definition.expression, lambda key: value(graph, key, given))
    assert quantity.value is not None
    return quantity.value


def broken(graph: BondGraph, given: dict[str, float]) -> Iterator[str]:
    """Yield the conditions on parameters alone that do not hold; of an instance in the part without its names."""
    for requirement in graph.requirements:
        try:
            holds = evaluate(requirement.condition.expression, lambda key: value(graph, key, given))
        except LookupError:
            continue
        except (ArithmeticError, ValueError):
            holds = 0.0
        if holds != 1.0:
            yield requirement.words if requirement.name == "part" else ""


@pytest.mark.parametrize("name", NAMES)
def test_senseless_parameters_are_refused(name: str) -> None:
    graph = example(name).compilation().whole_graph
    assert list(broken(graph, {})) == []
    allowed = {
        p.removeprefix(f"{name}."): s for s, _, listed in ALLOWED for p in listed.split() if p.startswith(f"{name}.")
    }
    parameters = [
        q.name for q in graph.quantities.values() if q.role == "parameter" and re.fullmatch(r"part\.[^.]*", q.name)
    ]
    found = {}
    for parameter in parameters:
        own, now = parameter.removeprefix("part.").replace(", ", ","), value(graph, Quantity(parameter), {})
        for sign, other in (("-", -now or -1.0), ("0", 0.0)):
            if other == now:  # its default
                continue
            named = list(broken(graph, {parameter: other}))
            if not named:
                found[own] = found.get(own, "") + sign
            word = re.escape(re.sub(r"\[\d\]", "", own))
            assert not named or any(not c or re.search(rf"\b{word}\b", c) for c in named), (own, named)
    assert found == allowed


def test_the_table_has_parameters_of_parts_alone() -> None:
    listed = [p for _, _, names in ALLOWED for p in names.split()]
    assert len(set(listed)) == len(listed)
    assert {p.split(".")[0] for p in listed} <= {p.name for p in library_parts()}


@pytest.mark.parametrize(("name", "parameter", "wrong"), [
    ("Adc", "bits", 2.5), ("Encoder", "lines", 0.5), ("Pmsm", "p", 1.5), ("Accumulator", "V_oil", 0.002), ("Diode", "grading", 1.0),
    ("Diode", "forward", 1.0), ("DryFriction", "moving", 0.5), ("Tyre", "C", 2.5), ("Tyre", "E", 1.5), ("WormGear", "lead_angle", 1.56),
    ("Thyristor", "U_fire", 0.5), ("Cam", "dwell", 4.0), ("Radiator", "emissivity", 1.2), ("StoppedMass", "x_0", 0.002),
    ("StoppedMass", "bounce", 1.0), ("Relay", "I_off", 0.04), ("UniversalJoint", "angle", 1.6), ("Flexure", "turn", 1.0),
])  # fmt: skip
def test_limits_of_formulas_are_refused(name: str, parameter: str, wrong: float) -> None:
    assert any(
        re.search(rf"\b{parameter}\b", c)
        for c in broken(example(name).compilation().whole_graph, {f"part.{parameter}": wrong})
    )


# ---------------------------------------------------------------------- who honours them
CIRCUIT = """
import Resistor, Capacitor from electric
model Circuit {
  parameter R = 2 ohm
  Se supply : u = 1 V
  Resistor lead { R = R }
  Capacitor store { C = 1 F }
  supply -> 1(lead.pins, store.pins)
  output u = store.voltage
  experiment go       { simulate 0 .. 1 s }
  experiment sweep_it { sweep R = 1 ohm, -1 ohm; simulate 0 .. 1 s }
  experiment draw_it  { montecarlo R = uniform(-1 ohm, 1 ohm) { samples = 8 }; simulate 0 .. 1 s }
}
"""


def test_a_run_says_once_what_a_parameter_breaks() -> None:
    model = bondgraph.load(CIRCUIT)
    (told,) = model.simulate("go", {"R": -1.0}).warnings
    assert (told.time, told.owner, told.condition) == (0.0, "lead", "R >= 0") and told.values == (("R", -1.0, "ohm"),)
    assert model.simulate("go", {"R": 1.0}).warnings == ()


def test_studies_honour_the_limits_of_parameters() -> None:
    model = bondgraph.load(CIRCUIT)
    swept = model.run("sweep_it")
    assert list(swept.warnings) == [1] and "warnings at 1 of 2 points; point 2: from t = 0 s `lead`" in swept.summary()
    drawn = model.run("draw_it").points[0].of("montecarlo")
    assert set(drawn.failures) == {i for i, (resistance,) in enumerate(drawn.samples) if resistance < 0} != set()


@pytest.mark.parametrize(("condition", "looks"), [("R > 0", 1), ("store.voltage < 2 V", 1000)])
def test_a_limit_on_parameters_is_looked_at_once(condition: str, looks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit on a voltage is looked at in each step, at several instants of it."""
    seen: list[int] = []
    holds = ValidityMonitor._holds
    monkeypatch.setattr(
        ValidityMonitor, "_holds", lambda self, times, *rest: seen.append(len(times)) or holds(self, times, *rest)
    )
    model = bondgraph.load(
        CIRCUIT.replace("output", f'require {condition} "limit"\n  output', 1).replace(
            "u = 1 V", "u = 1 V*step(time - 0.1 s)"
        )
    )
    model.simulate("go", points=1001)
    assert sum(seen) == looks if looks == 1 else sum(seen) > looks
