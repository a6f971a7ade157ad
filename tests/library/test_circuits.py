"""Parts together as people put them together: nothing is refused, and operating points are right."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

import bondgraph
from tests.library.bench import exact, near, run

U_T = 1.380649e-23 * 300.15 / 1.602176634e-19


def test_a_file_anywhere_imports_from_the_library(tmp_path: Path) -> None:
    file = tmp_path / "motor.bg"
    file.write_text(
        'import DcMotor from electric\nimport Gear, Screw from mechanics\n'
        "model Axis {\n  Se supply : u = 12 V\n  DcMotor motor\n  Gear gear\n  Screw screw\n  I table : p = 5 kg*v\n"
        "  supply -> motor.pins\n  motor.shaft -> gear.a\n  gear.b -> screw.a\n  screw.b -> table\n  output v = table.v, omega = motor.speed\n}\n",
        encoding="utf-8",
    )  # fmt: skip
    assert bondgraph.check(file) == ()
    found = bondgraph.load(file).simulate(to=2, rtol=1e-9)
    near(found.final("omega"), 0.05 * 12 / (1e-5 * 1 + 0.05**2))
    exact(found["v"], found["omega"] / 10 * 0.005 / (2 * math.pi))


def test_bridge_rectifier() -> None:
    """20 V through two diodes, smoothed: the capacitor is filled at the peaks and holds between them."""
    found = run(
        "electric", "Diode, Resistor, Capacitor",
        """
        Se mains : u = 20 V*sin(2*pi*50 Hz*time)
        Se earth : u = 0
        Diode d1, d2, d3, d4
        Resistor load { R = 100 ohm }
        Resistor line { R = 1 ohm }
        Capacitor smoothing { C = 1000 uF }
        1 source, out
        0 a, b, plus, minus, dc
        mains -> source -> line.pins, a
        b -> source
        a -> 1(d1.pins) -> plus
        b -> 1(d2.pins) -> plus
        minus -> 1(d3.pins) -> a
        minus -> 1(d4.pins) -> b
        plus -> out -> minus
        out -> dc -> load.pins, smoothing.pins
        earth -> minus
        output u = load.voltage, i1 = d1.current, i2 = d2.current, i3 = d3.current, i4 = d4.current, i = smoothing.current
        """,
        0.06, points=601, rtol=1e-7,
    )  # fmt: skip
    late = found.time > 0.02
    assert found["u"][late].min() > 14 and found["u"][late].max() < 20 - 2 * 0.7
    near(found["i1"] + found["i2"], found["i"] + found["u"] / 100, rtol=1e-7)  # Kirchhoff at `plus`
    near(found["i3"] + found["i4"], found["i1"] + found["i2"], rtol=1e-7)
    # A capacitor's mean current over a period is what its voltage changed by.
    whole = found.time >= 0.04
    charge = np.trapezoid(found["i"][whole], found.time[whole])
    assert charge == pytest.approx(1e-3 * (found["u"][-1] - found["u"][whole][0]), abs=1e-3 * 20 * 5e-3)


def test_transistor_amplifier_has_its_operating_point() -> None:
    """Common emitter with a base divider: the rest of the nodes by a solver of Kirchhoff's laws with Ebers and Moll."""
    found = run(
        "electric", "Bjt, Resistor, Capacitor",
        """
        Se vcc : u = 12 V
        Se signal_in : u = 0
        Bjt t
        Resistor r1 { R = 47 [kohm] }
        Resistor r2 { R = 10 [kohm] }
        Resistor rc { R = 2.2 [kohm] }
        Resistor re { R = 560 ohm }
        Resistor rs { R = 600 ohm }
        Resistor load { R = 10 [kohm] }
        Capacitor c_in { C = 0.1 uF }
        Capacitor c_out { C = 0.1 uF }
        0 supply, base, collector, emitter, out
        vcc -> supply
        supply -> 1(r1.pins) -> base
        supply -> 1(rc.pins) -> collector
        base -> r2.pins, t.base
        collector -> t.collector
        t.emitter -> emitter -> re.pins
        signal_in -> 1(rs.pins, c_in.pins) -> base
        collector -> 1(c_out.pins) -> out
        out -> load.pins
        output ue = re.voltage, ic = t.collector_current, u = load.voltage
        """,
        0.05,
    )  # fmt: skip

    def kirchhoff(x: np.ndarray) -> list[float]:
        be, bc = x
        forward, reverse = 1e-15 * math.expm1(be / U_T), 1e-15 * math.expm1(bc / U_T)
        ib, ic = forward / 100 + reverse, forward - 2 * reverse
        base = (12 / 47e3 - ib) / (1 / 47e3 + 1 / 10e3)
        inner_base, inner_emitter, inner_collector = base - 10 * ib, (560 + 0.1) * (ib + ic), 12 - (2200 + 1) * ic
        return [inner_base - inner_emitter - be, inner_base - inner_collector - bc]

    be, bc = fsolve(kirchhoff, [0.65, -5.0], xtol=1e-13)
    ic = 1e-15 * math.expm1(be / U_T) - 2e-15 * math.expm1(bc / U_T)
    near(found.final("ic"), ic)
    near(found.final("ue"), 560 * (ic + 1e-15 * (math.expm1(be / U_T) / 100 + math.expm1(bc / U_T))))
    near(found.final("u"), 0, scale=12)


def test_cmos_inverter_switches_from_rail_to_rail() -> None:
    found = run(
        "electric", "Mos, Capacitor",
        """
        Se vdd : u = 5 V
        Se volt : u = 5 V*smoothstep5(time, 0.1 us, 0.2 us)
        Se earth : u = 0
        Mos n
        Mos p { polarity = -1 }
        Capacitor load { C = 10 pF }
        0 gate, drain
        volt -> gate -> n.gate, p.gate
        drain -> p.drain, n.drain, load.pins
        n.source -> earth
        p.source -> vdd
        output u = load.voltage, i = p.source_current
        """,
        0.6e-6, points=601,
    )  # fmt: skip
    # High while the input is low: the p-channel has filled the load.
    assert found["u"][99] == pytest.approx(5, rel=1e-3)
    near(found.final("u"), 0, scale=5)
    near(found.final("i"), 0, scale=1e-3)
    assert found["u"].max() < 5.5


def test_follower_and_integrator_with_op_amps() -> None:
    found = run(
        "electric", "OpAmp, Resistor, Capacitor",
        """
        Se volt : u = 1 V
        Se zero : u = 0
        OpAmp follower, integrator
        Resistor r { R = 10 [kohm] }
        Capacitor c { C = 1 uF }
        0 followed, inverting, out
        volt -> follower.plus
        follower.out -> followed -> follower.minus
        followed -> 1(r.pins) -> inverting
        out -> 1(c.pins) -> inverting
        inverting -> integrator.minus
        zero -> integrator.plus
        integrator.out -> out
        output u = r.voltage, y = integrator.open - 75 ohm*integrator.current
        """,
        20e-3, points=201, rtol=1e-8,
    )  # fmt: skip
    # -t/RC, up to the finite gain (5e-6 a volt and what the start takes of a few us).
    late = found.time > 1e-3
    assert np.all(np.abs(found["y"][late] + found.time[late] / 10e-3) < 1e-3)
