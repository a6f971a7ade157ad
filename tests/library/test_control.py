"""Signal blocks against their step responses in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from tests.library.bench import exact, linear, near, run


def test_pid_step_response() -> None:
    """1 at the input: k_p + k_i t + k_d/T_f exp(-t/T_f)."""
    found = run(
        "control", "Pid",
        """
        Pid pid { k_p = 3, k_i = 5 [1/s], k_d = 0.2 s, T_f = 40 ms, start = 0.5, setpoint = 1 }
        output u = pid.command, e = pid.error
        """,
        1,
    )  # fmt: skip
    t = found.time
    near(found["u"], 3 + 0.5 + 5 * t + 0.2 / 0.04 * np.exp(-t / 0.04))
    exact(found["e"], np.ones(101))


def test_pid_weighs_its_setpoint() -> None:
    found = run(
        "control", "Pid",
        """
        Pid pid { k_p = 3, k_i = 5 [1/s], k_d = 0.2 s, T_f = 40 ms, w_p = 0.4, w_d = 0, setpoint = 1 }
        output u = pid.command
        """,
        1,
    )  # fmt: skip
    near(found["u"], 3 * 0.4 + 5 * found.time)


PLANT = """
    import FirstOrder from control
    input reference = 1
    Pid pid { k_p = 2, k_i = 4 [1/s], low = -1.5, high = 1.5, T_t = 0.05 s, setpoint = reference, measured = plant.y }
    FirstOrder plant { K = 1, T = 0.5 s, u = pid.command }
    output u = pid.command, wanted = pid.wanted, y = plant.y, integrated = pid.integrated
"""


def test_pid_does_not_wind_up() -> None:
    """The integral of a command at its limit goes to the value that keeps it there, and no further: a first-order lag with T_t."""
    found = run(
        "control", "Pid",
        """
        Pid pid { k_p = 2, k_i = 10 [1/s], high = 3, T_t = 0.2 s, start = 2, setpoint = 1 }
        output u = pid.command, wanted = pid.wanted
        """,
        2,
    )  # fmt: skip
    # wanted = 2 + I, I' = 10 + (3 - wanted)/0.2: to 3 + 10*0.2 from 4
    exact(found["u"], np.full(101, 3.0))
    near(found["wanted"], 5 - np.exp(-found.time / 0.2))


def test_pid_controls_a_plant_within_its_limits() -> None:
    found = run("control", "Pid", PLANT, 20, points=2001)
    near(found.final("y"), 1)  # no error is left
    near(found.final("integrated"), 1)
    assert found["u"].max() == 1.5 and found["wanted"].max() > 1.5
    wound = run("control", "Pid", PLANT, 20, points=2001, settings={"pid.T_t": "1e9 s"})
    assert found["y"].max() - 1 < 0.5 * (wound["y"].max() - 1)  # it overshoots less than one that winds up
    never = run("control", "Pid", PLANT, 20, points=2001, settings={"reference": "2"})
    near(never.final("y"), 1.5)  # more cannot be had
    near(never.final("wanted"), 1.5 + 4 * 0.5 * 0.05, scale=2)


def test_pid_turns_a_motor_to_an_angle() -> None:
    """Without limits the loop is linear: its response by the matrix exponential."""
    found = run(
        "control", "Pid",
        """
        import DcMotor from electric
        input wanted = 2 rad
        Pid pid { k_p = 8, k_i = 20 [1/s], k_d = 0.3 s, T_f = 5 ms, setpoint = wanted/(1 rad), measured = angle/(1 rad) }
        DcMotor motor { R = 1 ohm, L = 2 mH, K = 0.1 [N*m/A], J = 1e-3 [kg*m^2], b = 1e-3 [N*m*s] }
        signal angle = integral(motor.speed, 0 rad)
        MSe supply : u = pid.command*1 V
        Se load : M = 0.05 [N*m]
        supply -> motor.pins
        motor.shaft -> load
        output phi = angle, i = motor.current
        """,
        1.5,
    )  # fmt: skip
    r, l, k, j, b = 1.0, 2e-3, 0.1, 1e-3, 1e-3
    # States: current, speed, angle, integral part, lag of the derivative; error e = 2 - angle.
    gain = 0.3 / 5e-3
    a = [
        [-r / l, -k / l, -(8 + gain) / l, 1 / l, -gain / l],
        [k / j, -b / j, 0, 0, 0],
        [0, 1, 0, 0, 0],
        [0, 0, -20, 0, 0],
        [0, 0, -1 / 5e-3, 0, -1 / 5e-3],
    ]
    expected = linear(a, [(8 + gain) * 2 / l, -0.05 / j, 0, 40, 2 / 5e-3], np.zeros(5), found.time)
    near(found["phi"], expected[:, 2])
    near(found["i"], expected[:, 0])


def test_first_order() -> None:
    found = run("control", "FirstOrder", "FirstOrder lag { K = 3, T = 0.2 s, y_0 = 1, u = 2 }\n output y = lag.y", 2)
    near(found["y"], 6 - 5 * np.exp(-found.time / 0.2))


@pytest.mark.parametrize("zeta", [0.2, 1.5])
def test_second_order(zeta: float) -> None:
    found = run(
        "control",
        "SecondOrder",
        f"SecondOrder lag {{ K = 3, w = 10 [rad/s], zeta = {zeta}, y_0 = 6, u = 4 }}\n output y = lag.y",
        2,
    )
    s = 10 * np.roots([1, 2 * zeta, 1])
    near(
        found["y"],
        12 - 6 * ((s[1] * np.exp(s[0] * found.time) - s[0] * np.exp(s[1] * found.time)) / (s[1] - s[0])).real,
    )


def test_lead_lag() -> None:
    found = run("control", "LeadLag", "LeadLag lead { K = 2, T_1 = 0.5 s, T_2 = 0.1 s, u = 3 }\n output y = lead.y", 1)
    near(found["y"], 6 * (1 + (0.5 / 0.1 - 1) * np.exp(-found.time / 0.1)))
    rest = run(
        "control", "LeadLag", "LeadLag lead { K = 2, T_1 = 0.5 s, T_2 = 0.1 s, x_0 = 3, u = 3 }\n output y = lead.y", 1
    )
    near(rest["y"], 6)


def test_transfer_function_of_second_order() -> None:
    """(2 s^2 + 3 s + 5)/(0.5 s^2 + 1.5 s + 1): poles -1 and -2; 4 + residues by partial fractions of H(s)/s."""
    found = run(
        "control", "TransferFunction2",
        """
        TransferFunction2 h { b_2 = 2 [s^2], b_1 = 3 s, b_0 = 5, a_2 = 0.5 [s^2], a_1 = 1.5 s, a_0 = 1, u = 1 }
        output y = h.y
        """,
        6,
    )  # fmt: skip

    def residue(pole: float, other: float) -> float:
        return (2 * pole**2 + 3 * pole + 5) / (0.5 * pole * (pole - other))

    near(found["y"], 5 + residue(-1, -2) * np.exp(-found.time) + residue(-2, -1) * np.exp(-2 * found.time))


def test_transfer_function_passes_a_sine() -> None:
    """After the transient: gain and phase of H(i w)."""
    found = run(
        "control", "TransferFunction2",
        """
        TransferFunction2 h { b_1 = 0.3 s, b_0 = 1, a_2 = 0.02 [s^2], a_1 = 0.2 s, u = sin(2*pi*1 Hz*time) }
        output y = h.y
        """,
        10,
    )  # fmt: skip
    s = 2j * math.pi
    h = (0.3 * s + 1) / (0.02 * s**2 + 0.2 * s + 1)
    late = found.time > 5
    near(found["y"][late], (h * np.exp(s * found.time[late])).imag)


def test_rate_limit() -> None:
    """y' = r tanh((u - y)/(r T)): sinh of the distance falls exponentially; a ramp below r is followed r T atanh behind."""
    found = run("control", "RateLimit", "RateLimit slow { limit = 2 [1/s], T = 50 ms, u = 1 }\n output y = slow.y", 1)
    distance = 0.1 * np.arcsinh(math.sinh(1 / 0.1) * np.exp(-found.time / 0.05))
    near(found["y"], 1 - distance)
    ramp = run(
        "control",
        "RateLimit",
        "RateLimit slow { limit = 2 [1/s], T = 50 ms, u = time*1.5 [1/s] }\n output y = slow.y",
        2,
    )
    near(ramp.final("y"), 3 - 0.1 * math.atanh(0.75))
    assert np.all(np.diff(found["y"]) <= 2 * 0.01 * (1 + 1e-9))


def test_lowpass_passes_half_the_power_at_its_corner() -> None:
    found = run(
        "control",
        "Lowpass",
        "Lowpass filter { f_c = 5 Hz, u = sin(2*pi*5 Hz*time) }\n output y = filter.y",
        4,
        points=401,
    )
    late = found.time > 1
    # Butterworth at its corner: 1/sqrt(2), a quarter of a period behind.
    near(found["y"][late], -np.cos(2 * np.pi * 5 * found.time[late]) / math.sqrt(2))


def test_blocks_take_bare_numbers_only() -> None:
    from tests.compiling import mistake

    found = mistake(
        "import FirstOrder from control\nmodel A {\n  FirstOrder lag { u = 2 V }\n  output y = lag.y\n}\n", "BG103"
    )
    assert "`u`" in found.sentence


def test_discrete_pid_against_its_program() -> None:
    """A lag under a controller that computes for 30 ms: between instants exact, at its limits without windup."""
    body = """
        import FirstOrder from control
        input reference = 1
        DiscretePid pid {
          T = 0.1 s, late = 30 ms, k_p = 4, k_i = 6 [1/s], k_d = 0.05 s, T_f = 0.02 s, T_t = 0.2 s, low = -1.2, high = 1.2, w_d = 0,
          setpoint = reference, measured = plant.y
        }
        FirstOrder plant { K = 1, T = 0.5 s, u = pid.command }
        output u = pid.command, y = plant.y
        """
    found = run("control", "DiscretePid", body, 1.99, points=200)
    x = u = computed = slope = seen = total = 0.0
    expected = []
    for n in range(200):
        if n % 10 == 0:
            slope = (0.02 * slope + 0.05 * (-x - seen)) / 0.12
            seen, wanted = -x, 4 * (1 - x) + total + slope
            computed = min(max(wanted, -1.2), 1.2)
            total += 0.6 * (1 - x) + 0.5 * (computed - wanted)
        if n % 10 == 3:
            u = computed
        expected.append((u, x))
        x = u + (x - u) * math.exp(-0.02)
    near(found["y"], [y for _, y in expected])
    settled = np.arange(200) % 10 != 3  # a reported instant may lie an ulp before the command changes
    near(found["u"][settled], np.array([u for u, _ in expected])[settled])
    assert found["u"].max() == 1.2 and found["y"].max() < 1.15, "it was at its limit and did not wind up"


def test_encoder_speed_is_right_on_average() -> None:
    """Counts differ by one at most; summed up, speed is the way."""
    body = "Encoder part { T = 1 ms, lines = 500, angle = sin(3 [rad/s]*time) }\noutput speed = part.speed, position = part.position, angle = part.angle"
    found = run("control", "Encoder", body, 1, points=1001)
    step = 2 * math.pi / 2000
    assert ((found["angle"] - found["position"] >= -1e-12) & (found["angle"] - found["position"] < step)).all()
    near(np.cumsum(found["speed"]) * 1e-3, found["position"], rtol=1e-12)
    assert np.abs(found["speed"] - 3 * np.cos(3 * found.time)).max() <= step / 1e-3 * 1.01


def test_converters_saturate() -> None:
    body = "Adc part { T = 0.1 s, bits = 4, low = -2, high = 2, u = 8*time/1 s - 4 }\noutput code = part.code, value = part.value"
    found = run("control", "Adc", body, 1, points=11)
    codes = np.clip(np.floor((8 * found.time - 2) / 0.25 + 0.5 + 1e-9), 0, 15)
    exact(found["code"], codes)
    exact(found["value"], -2 + 0.25 * codes)


def test_discrete_rate_limit_falls() -> None:
    body = "DiscreteRateLimit part { T = 0.1 s, rise = 5 [1/s], fall = 1 [1/s], y_0 = 0.3, u = 1 if time < 0.35 s else 0 }\noutput y = part.y"
    found = run("control", "DiscreteRateLimit", body, 1, points=11)
    exact(found["y"], [0.8, 1, 1, 1, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3])


def test_a_sampled_loop_is_at_rest_whatever_rounding_leaves_of_its_slope() -> None:
    """The slope of the controller is zero at rest, but for a rounding that halves from sample to sample: that is no change."""
    model = bondgraph.load("""import DiscretePid from control
    model M {
      parameter a = 3
      DiscretePid pid { T = 10 ms, k_i = 2 [1/s], setpoint = 2, measured = x }
      signal x = integral((pid.command - a*x)/1 s, 0)
      output y = x, u = pid.command
    }""")
    for a in (2.4816425714040147, 1.9814306529511398, 3.536764792707368):
        rest = model.equilibrium(settings={"a": a})
        near([rest["y"], rest["u"]], [2, 2 * a])
