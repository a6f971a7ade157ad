"""Models that once gave a wrong number with exit code 0, run from the command line against closed forms and hand-written integrations.

A case with the mark `wrong_today` fails today. The mark is strict: who mends the cause is told by a failure (XPASS), and takes the name of the case out of `TODAY`,
or the mark off its test. No mark may be added.
"""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from bondgraph.commands import commands
from bondgraph.presentation.page.serve import Server, Session
from compiler.metamorphosis.printing import text_of
from compiler.metamorphosis.renaming import parsed
from compiler.metamorphosis.text_changes import permuted
from tests.compiling import MODELS, ROOT
from tests.page.test_serve_refusals import exchange, request

DEFECTS = Path(__file__).parent / "defects"
Arrays = dict[str, Any]
SECONDS = 120  # against a run without an end; some of these took a minute, and take 1 s now

# Cases of the tables below that are wrong today, by their names.
TODAY: frozenset[str] = frozenset()
pytestmark = pytest.mark.machine_code  # bounds on time; the parts' own tests run interpreted too
wrong_today = pytest.mark.xfail(strict=True, reason="not mended yet; remove this mark when it is")


def case(*arguments: Any, name: str) -> Any:
    """A case of a table, with the mark if it is wrong today."""
    return pytest.param(*arguments, id=name, marks=[wrong_today] if name in TODAY else [])


def command(*arguments: str) -> Any:
    """The command line in this process: exit code, standard output, standard error."""
    return CliRunner().invoke(commands, [*arguments])


def file_of(name: str) -> str:
    return str(DEFECTS / f"{name}.bg")


def values(name: str, tmp_path: Path, *arguments: str) -> Arrays:
    """All outputs of a run, in SI, with `time`. The run ends well."""
    out = tmp_path / "result.npz"
    path = name if name.endswith(".bg") else file_of(name)
    done = command("run", path, *arguments, "--out", str(out))
    assert done.exit_code == 0, done.stderr
    with np.load(out, allow_pickle=False) as arrays:
        return {key: arrays[key] for key in arrays.files}


def in_time(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A process of its own, ended after `SECONDS`."""
    command_line = [sys.executable, "-m", "bondgraph", *arguments]
    return subprocess.run(
        command_line, cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=False, timeout=SECONDS
    )


def is_refused(done: Any) -> bool:
    """Return True if the command ended with an error that is no defect of the program (exit code 70)."""
    return done.exit_code not in (0, 70) and bool(done.stderr.strip())


# ---------------------------------------------------------------- instants on time
OPEN = [
    ("gate_duty", {"open_for": 0.01}),
    ("window_of_time", {"by_abs": 2e-3}),
    ("bump_of_time", {"by_bump": 2e-3 * math.sqrt(math.log(2))}),
    ("when_of_time", {"flashes": 51}),
    ("switch_of_time", {"q": -math.expm1(-math.acos(0.999) / math.pi)}),
    ("time_sine_window", {"v": 0.02}),
    ("time_narrow_windows", {"v": 2e-4, "v2": math.acos(0.999) / math.pi, "v3": 2e-4}),
    ("time_heater_each_hour", {"T": 293 + 24 * 20 * 1000 / 50e3}),
    ("ramp_into_mass", {"p": 6, "J": 6}),
    ("ramp_into_capacitor", {"charge": 6, "moved": 6}),
    ("smoothstep_into_mass", dict.fromkeys(("ramp_", "three", "five", "nine", "clip", "momentum"), 6)),
]


@pytest.mark.parametrize(("name", "truth"), [case(*row, name=row[0]) for row in OPEN])
def test_instants_on_time(name: str, truth: dict[str, float], tmp_path: Path) -> None:
    found = values(name, tmp_path)
    for output, value in truth.items():
        assert found[output][-1] == pytest.approx(value, rel=1e-8), output


@pytest.mark.parametrize(("name", "output"), [("ramp_into_mass", "F"), ("ramp_into_capacitor", "i")])
def test_the_slope_of_a_ramp(name: str, output: str, tmp_path: Path) -> None:
    found = values(name, tmp_path, "--points", "4001")
    inside = (found["time"] > 1.0001) & (found["time"] < 1.0009)
    assert inside.any()
    np.testing.assert_allclose(found[output][inside], 6000, rtol=1e-9)
    outside = (found["time"] < 0.9999) | (found["time"] > 1.0011)
    np.testing.assert_allclose(found[output][outside], 0, atol=1e-6)


# ---------------------------------------------------------------- instants on states
EDGES = [
    (name, count, rtol)
    for name, count in (("encoder_edges_linear", 1812), ("edges_nonlinear", 1257))
    for rtol in ("1e-4", "1e-6", "1e-10")
]


@pytest.mark.few(2)
@pytest.mark.parametrize(("name", "count", "rtol"), [case(*row, name=f"{row[0]}/{row[2]}") for row in EDGES])
def test_edges_are_counted(name: str, count: int, rtol: str, tmp_path: Path) -> None:
    """Twice as many edges as steps: phi(2 s) = 628 (1 - exp(-0.2)) turns the encoder 1811.8 times, and it begins on an edge."""
    assert values(name, tmp_path, "--rtol", rtol)["cnt"][-1] == count


STOPS = {
    "default": (),
    "rtol": ("--rtol", "1e-8"),
    "radau": ("--solver", "radau"),
    "explicit": ("--solver", "explicit"),
}


@pytest.mark.few(2)
@pytest.mark.parametrize("options", [case(o, name=f"dry_friction_reversal/{n}") for n, o in STOPS.items()])
def test_the_first_stop_of_dry_friction(options: Sequence[str], tmp_path: Path) -> None:
    """v' = 8 sin(2 t) - 3 x - 2 - exp(-(v/0.01)^2) from where 8 sin(2 t) passes 3 N, until v = 0."""
    begin = math.asin(3 / 8) / 2

    def rates(t: float, y: Any) -> list[float]:
        return [y[1], 8 * math.sin(2 * t) - 3 * y[0] - 2 - math.exp(-((y[1] / 0.01) ** 2))]

    def stops(t: float, y: Any) -> float:
        return float(y[1]) if t > begin + 0.1 else 1.0

    stops.terminal = True  # type: ignore[attr-defined]
    truth = solve_ivp(rates, (begin, 3), [0, 0], "DOP853", rtol=1e-12, atol=1e-13, max_step=5e-4, events=stops)
    found = values("dry_friction_reversal", tmp_path, "--to", "1.66", "--points", "16601", *options)
    stopped = found["time"][(found["v"] <= 0) & (found["time"] > begin + 0.1)]
    rtol = 1e-8 if "1e-8" in options else 1e-6
    assert -1e-6 < stopped[0] - truth.t[-1] < 1.01e-4  # the instants of the report
    assert found["x"].max() == pytest.approx(truth.y[0, -1], rel=10 * rtol)


def test_a_ball_bounces_for_ever(tmp_path: Path) -> None:
    found = values("elastic_ball", tmp_path, "--points", "1001")
    half = math.sqrt(2 / 10)
    since = (found["time"] + half) % (2 * half) - half  # from the last top
    np.testing.assert_allclose(found["height"], 1 - 5 * since**2, atol=1e-5)


NAND = {"y1": 4.971088699385777, "y5": 4.970837023296724, "y6": -0.2091214032073855, "y10": -0.2090289583878100}


@pytest.mark.few(1)
@pytest.mark.parametrize("name", [case(n, name=n) for n in ("nand_if_laws_chatter", "nand_slow_look_ahead")])
def test_a_nand_gate(name: str, tmp_path: Path) -> None:
    """The digits are those of the test set for IVP solvers (Mazzia and Magherini, 2008). One was refused, the other looked ahead for half a minute."""
    done = in_time("run", file_of(name), "--out", str(tmp_path / "result.npz"))
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "result.npz") as found:
        for output, value in NAND.items():
            assert found[output][-1] == pytest.approx(value, rel=1e-4)


@pytest.mark.few(1)
@pytest.mark.parametrize("rtol", [1e-3, 1e-8, 1e-9])
def test_a_nand_gate_at_other_tolerances(rtol: float, tmp_path: Path) -> None:
    """At 1e-8 it was refused as sliding: a look ahead was longer than the time constants of what is at rest at its condition."""
    found = values("nand_if_laws_chatter", tmp_path, "--rtol", str(rtol))
    for output, value in NAND.items():
        assert found[output][-1] == pytest.approx(value, rel=rtol)


def test_a_tank_runs_empty(tmp_path: Path) -> None:
    done = in_time("run", file_of("tank_runs_empty"), "--json", "--out", str(tmp_path / "result.npz"))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["steps"] < 10_000
    with np.load(tmp_path / "result.npz") as found:
        np.testing.assert_allclose(found["V"], np.maximum(1 - found["time"], 0) ** 2, atol=1e-5)


# ---------------------------------------------------------------- ideal switching circuits
def buck(end: float) -> tuple[Any, Any]:
    """Instants and (current, voltage) of a buck converter with an ideal diode: exact pieces, with the diode's current cut at zero."""
    inductance, capacity, load, period, duty = 100e-6, 100e-6, 5.0, 10e-6, 0.4
    conducts = np.array([[0, -1 / inductance, 1 / inductance], [1 / capacity, -1 / (load * capacity), 0], [0, 0, 0]])
    blocks = np.array([[0, 0, 0], [0, -1 / (load * capacity), 0], [0, 0, 0]])
    state, times, states = np.array([0.0, 0.0]), [0.0], [[0.0, 0.0]]
    for number in range(round(end / period)):
        state = (expm(conducts * duty * period) @ [*state, 24.0])[:2]
        off = (1 - duty) * period

        def after(t: float, begin: Any = state) -> Any:
            return expm(conducts * t) @ [*begin, 0.0]

        if after(off)[0] < 0:
            zero = brentq(lambda t: after(t)[0], 0, off, xtol=1e-16)
            state = (expm(blocks * (off - zero)) @ [0, after(zero)[1], 0])[:2]
        else:
            state = after(off)[:2]
        times.append((number + 1) * period)
        states.append(list(state))
    return np.array(times), np.array(states)


def test_a_buck_converter_with_an_ideal_diode(tmp_path: Path) -> None:
    times, states = buck(5e-3)
    found = values("buck_ideal_diode", tmp_path, "--points", "501")
    np.testing.assert_allclose(found["time"], times, atol=1e-12)
    np.testing.assert_allclose(found["u"], states[:, 1], atol=1e-3)
    assert found["u"][-1] == pytest.approx(9.6, abs=0.1)


def test_a_freewheeling_diode(tmp_path: Path) -> None:
    """The inductor's current never falls to zero: one of the diodes conducts, and the node has the source's positive half."""

    def rate(t: float, i: Any) -> Any:
        return (max(10 * math.sin(100 * math.pi * t), 0) - 5 * i) / 0.01

    found = values("freewheel_diode", tmp_path, "--points", "61")
    truth = solve_ivp(rate, (0, 0.06), [0], "DOP853", t_eval=found["time"], rtol=1e-11, atol=1e-13, max_step=1e-4)
    np.testing.assert_allclose(found["i"], truth.y[0], atol=2e-5)


def test_a_bridge_of_ideal_diodes(tmp_path: Path) -> None:
    def rate(t: float, u: Any) -> Any:
        return (np.maximum(abs(10 * math.sin(100 * math.pi * t)) - u, 0) - u / 100) / 100e-6

    found = values("ideal_diode_bridge", tmp_path, "--points", "41")
    truth = solve_ivp(rate, (0, 0.04), [0], "DOP853", t_eval=found["time"], rtol=1e-10, atol=1e-12, max_step=2e-5)
    np.testing.assert_allclose(found["u"], truth.y[0], atol=1e-4)


# ---------------------------------------------------------------- loops with monotone laws
def bridge_current(source: float, voltage: float) -> float:
    """The current of a bridge of four Shockley diodes into `voltage`, fed by `source` behind 1 ohm; by symmetry plus = (a + u)/2, minus = (a - u)/2."""

    def diode(u: float) -> float:
        return 1e-9 * math.expm1(min(u / 0.05, 600))

    def excess(a: float) -> float:
        return (source - a) - diode((a - voltage) / 2) + diode(-(a + voltage) / 2)

    a = brentq(excess, -abs(source) - 1, abs(source) + 1, xtol=1e-14)
    return diode((a - voltage) / 2) + diode(-(a + voltage) / 2)


def test_a_bridge_of_shockley_diodes(tmp_path: Path) -> None:
    found = values("shockley_bridge", tmp_path, "--points", "81")
    truth = [
        brentq(lambda u, s=s: 100 * bridge_current(s, u) - u, -1, 11, xtol=1e-13)
        for s in 10 * np.sin(100 * np.pi * found["time"])
    ]
    np.testing.assert_allclose(found["u"], truth, rtol=1e-5, atol=1e-6)
    assert found["u"].max() == pytest.approx(8.097, abs=2e-3)


def test_a_smoothed_bridge_of_shockley_diodes(tmp_path: Path) -> None:
    def rate(t: float, u: Any) -> list[float]:
        return [(bridge_current(10 * math.sin(100 * math.pi * t), float(u[0])) - float(u[0]) / 100) / 100e-6]

    found = values("shockley_bridge_smoothed", tmp_path, "--points", "41")
    truth = solve_ivp(rate, (0, 0.04), [0], "Radau", t_eval=found["time"], rtol=1e-8, atol=1e-10, max_step=1e-3)
    np.testing.assert_allclose(found["u"], truth.y[0], atol=1e-4)


def test_a_point_mass_on_a_rod(tmp_path: Path) -> None:
    """x'' = g - (v v + g x) x on the unit sphere."""
    gravity = np.array([0, 0, -9.81])

    def rate(t: float, y: Any) -> Any:
        x, v = y[:3], y[3:]
        return [*v, *(gravity - (v @ v + gravity @ x) * x)]

    found = values("point_mass_on_a_rod", tmp_path, "--points", "21")
    truth = solve_ivp(rate, (0, 2), [1, 0, 0, 0, 1, 0], "DOP853", t_eval=found["time"], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(found["x"], truth.y[0], atol=2e-5)


# ---------------------------------------------------------------- starts
@pytest.mark.parametrize("degrees", [100, 130, 170, -140, -170, 250])
def test_the_assembly_of_a_slider_crank(degrees: int, tmp_path: Path) -> None:
    found = values("assembly_slider_crank", tmp_path, "--set", f"d={degrees} deg")
    np.testing.assert_allclose(found["x"][0], found["want"][0], atol=1e-9)


TURNED = """
  experiment turned {{ start linkage.shaft.phi = {degrees} deg; simulate 0 .. 1 us {{ points = 2 }}; report angle, swing }}
"""


def swing(phi: float) -> float:
    """The rocker's angle from the drawing on, of `models/four_bar.bg`: the crossing of two circles on the drawn side."""

    def rocker(angle: float) -> float:
        tip = 0.15 * np.array([math.cos(angle), math.sin(angle)])
        across = np.array([0.5, 0]) - tip
        length = float(np.hypot(*across))
        along = (length**2 + 0.45**2 - 0.35**2) / (2 * length)
        normal = np.array([-across[1], across[0]]) / length
        pin = tip + along * across / length + math.sqrt(0.45**2 - along**2) * normal
        return math.atan2(pin[1], pin[0] - 0.5)

    return rocker(phi) - rocker(0)


@pytest.mark.parametrize("degrees", [60, 120, 150, 180, -120, -150])
def test_the_assembly_of_a_four_bar(degrees: int, tmp_path: Path) -> None:
    text = (MODELS / "four_bar.bg").read_text(encoding="utf-8").rstrip()
    path = tmp_path / "turned.bg"
    path.write_text(text.removesuffix("}") + TURNED.format(degrees=degrees) + "}\n", encoding="utf-8")
    found = values(str(path), tmp_path, "-e", "turned")
    assert found["angle"][0] == pytest.approx(math.radians(degrees), abs=1e-9)
    assert found["swing"][0] == pytest.approx(swing(math.radians(degrees)), abs=1e-8)


POSES = [
    ("start_double_pendulum", {"x": 1.5, "y": 0.2, "p1": 0, "p2": 0, "w1": 2, "w2": -3}),
    ("start_rates_move_pose", {"x": 0.3, "z": 0.6, "v": 5, "w": 0, "wheel_x": 0, "ry": 0, "phi": 0}),
    ("start_rates_move_pose_planar", {"x": 0.3, "y": 0.6, "v": 5, "w": 0, "wheel_x": 0, "phi": 0, "hphi": 0}),
    ("start_winds_turns", {"a": -0.7219157990, "e": 1.0999306009, "c": -1.0999306009, "hc": -1.4779454027, "w": 3}),
]


@pytest.mark.parametrize(("name", "truth"), [case(*row, name=row[0]) for row in POSES])
def test_poses_at_the_start(name: str, truth: dict[str, float], tmp_path: Path) -> None:
    found = values(name, tmp_path, "--to", "1e-4", "--points", "2")
    for output, value in truth.items():
        assert found[output][0] == pytest.approx(value, abs=1e-8), output


# ---------------------------------------------------------------- rest and linear analyses
INVERSES = [
    ("invert_two_springs", "xa=1 m", "load", 40),
    ("invert_beside_an_integral", "x=1 m", "load", 10),
    ("invert_series_capacitors", "ua=1 V", "volt", 4 / 3),
    ("invert_plate_gap", "x=0.9 um", "volt", 2.6780962),
    ("invert_two_folded_flexures", "x=1 um", "push", 39.76),
]


@pytest.mark.parametrize(("name", "target", "source", "truth"), [case(*row, name=row[0]) for row in INVERSES])
def test_inverses_at_rest(name: str, target: str, source: str, truth: float) -> None:
    done = command("invert", file_of(name), "--want", target, "--by", source, "--json")
    assert done.exit_code == 0, done.stderr
    assert abs(json.loads(done.stdout)["inputs"][source]["value"]) == pytest.approx(truth, rel=3e-4)


BOUNDED = """model Bounded {
  input push = 0 N
  MSe s : F = push
  I m : p = 1 kg*v
  C spring : F = 4 [N/m]*x
  R loss : F = 1 [N*s/m]*v
  s -> 1(m, spring, loss)
  require spring.x < 1 m "the spring breaks"
  output x = spring.x
}
"""


@pytest.mark.parametrize("reach", ["0.99", "1.01", "2"])
def test_what_a_model_requires_along_an_inverse(reach: str, tmp_path: Path) -> None:
    """At rest it is refused, along a path told with the first instant, and only where the model is left."""
    path = tmp_path / "bounded.bg"
    path.write_text(BOUNDED, encoding="utf-8")
    rest = command("invert", str(path), "--want", f"x={reach} m", "--by", "push")
    along = f"x={reach} m*smoothstep9(time, 0 s, 5 s)"
    moved = command("invert", str(path), "--want", along, "--by", "push", "--to", "6 s", "--points", "61")
    words = "does not hold (the spring breaks)"
    assert moved.exit_code == 0 and (words in moved.output) == (float(reach) > 1)
    assert is_refused(rest) == (float(reach) > 1) and ("the spring breaks" in rest.output) == (float(reach) > 1)


def test_a_branch_stops_where_the_model_ends() -> None:
    """No branch crosses that of a plate over an electrode, which is unstable from the fold on; a gap of 5 % is not valid any more."""
    done = command("continue", file_of("unstable_called_stable"), "--along", "volt=0 V .. 10 V", "--json")
    assert done.exit_code == 0, done.stderr
    branch = json.loads(done.stdout)
    assert [s["kind"] for s in branch["special"] if s["kind"] in ("fold", "branch")] == ["fold"]
    places = np.array(branch["outputs"]["x"]["values"])
    assert places.max() <= 0.951 * 2e-6
    verdicts = np.array(branch["stable"])
    assert verdicts[places < 0.66e-6].all() and not verdicts[places > 0.67e-6].any()


def test_a_drift_has_no_rest() -> None:
    assert is_refused(command("equilibrium", file_of("equilibrium_of_a_drift")))


def test_the_rest_of_a_sampled_loop() -> None:
    done = command("equilibrium", file_of("sampled_loop_rest_and_bode"), "--json")
    assert is_refused(done) or json.loads(done.stdout)["outputs"]["y"]["value"] == pytest.approx(2 / 3, rel=1e-9)


def test_the_response_of_a_sampled_loop() -> None:
    """Refused, or z-domain: u = 2 (w - y), y+ = a y + (1 - a) u with a = exp(-1), so the gain at low frequencies is 2/3."""
    options = ("--input", "w", "--output", "y", "--over", "0.01 Hz .. 1 Hz")
    done = command("bode", file_of("sampled_loop_rest_and_bode"), *options)
    assert is_refused(done) or "0.666" in done.stdout


def test_an_undamped_peak_is_told_as_such() -> None:
    for points in ("10", "100", "400"):
        options = ("--input", "f", "--output", "x", "--points", points)
        done = command("bode", file_of("undamped_peak"), *options)
        assert done.exit_code == 0, done.stderr
        words = (done.stdout + done.stderr).lower()
        assert "inf" in words or "undamped" in words
        assert "0.3183" in words


def test_the_rest_of_a_steady_rotation() -> None:
    """The motor's speed is constant and its angle is not: 12 V = i + 0.05 omega, 0.05 i = 1e-4 omega."""
    done = command("equilibrium", file_of("steady_rotation"), "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["outputs"]["w"]["value"] == pytest.approx(12 * 0.05 / (1e-4 + 0.05**2), rel=1e-9)


def test_the_modes_of_a_bicycle_at_rest() -> None:
    """Of the benchmark of Meijaard et al., 2007, at v = 0: +-3.131643 and +-5.530943 1/s. (At v = 4.6 m/s the file's start turns the frame
    backwards as the rear wheel's own spin is not given: no motion near it is steady.)"""
    done = command("modes", file_of("whipple_modes_rounding"), "--json")
    assert done.exit_code == 0, done.stderr
    found = np.array([m["eigenvalue"]["re"] for m in json.loads(done.stdout)["modes"]])
    for value in (3.131643, -3.131643, 5.530943, -5.530943):
        assert np.abs(found - value).min() < 1e-4


def test_shares_of_a_variance_of_rounding() -> None:
    done = command("run", file_of("hardly_moves"))
    assert "determined" in done.stdout + done.stderr


# ---------------------------------------------------------------- tolerance
def chain_rates(t: float, q: Any) -> Any:
    """20 capacitors of 1 uF joined by diodes, each with a leak, fed by a current."""
    u = q / 1e-6
    s = min(max(t / 1e-3, 0.0), 1.0)
    diodes = 1e-6 * np.expm1((u[:-1] - u[1:]) / 0.05)
    rates = -u / 100e3
    rates[0] += 1e-3 * s**3 * (10 - 15 * s + 6 * s**2)
    rates[:-1] -= diodes
    rates[1:] += diodes
    return rates


def mesh_rates(t: float, q: Any, n: int = 8) -> Any:
    a, b = np.meshgrid(np.arange(1, n + 1), np.arange(1, n + 1), indexing="ij")
    u = q.reshape(n, n) / (1e-6 * (1 + 0.3 * np.sin(a * 1.7 + b)))
    s = min(max(t / 1e-3, 0.0), 1.0)
    rates = -u / 100e3
    rates[0, 0] += 1e-3 * s**3 * (10 - 15 * s + 6 * s**2)
    across = (u[:, :-1] - u[:, 1:]) / (1e3 * (1 + 0.5 * np.cos(a + 2 * b)[:, 1:]))
    rates[:, :-1] -= across
    rates[:, 1:] += across
    down = 1e-6 * np.expm1((u[:-1] - u[1:]) / 0.05)
    rates[:-1] -= down
    rates[1:] += down
    return rates.ravel()


CIRCUITS: list[tuple[str, Callable[..., Any], int, Callable[[Any], Any]]] = [
    ("diode_chain_tolerance_lost", chain_rates, 20, lambda q: {"a": q[0] / 1e-6, "b": q[-1] / 1e-6}),
    (
        "mesh8_tolerance_lost",
        mesh_rates,
        64,
        lambda q: {"a": q[0] / (1e-6 * (1 + 0.3 * math.sin(2.7))), "b": q[-1] / (1e-6 * (1 + 0.3 * math.sin(21.6)))},
    ),
]


TIGHT = [case(*row, rtol, name=f"{row[0]}/{rtol:.0e}".replace("-0", "-")) for row in CIRCUITS for rtol in (1e-4, 1e-9)]


@pytest.mark.parametrize(("name", "rates", "size", "outputs", "rtol"), TIGHT)
def test_what_a_tolerance_means(
    name: str, rates: Callable[..., Any], size: int, outputs: Callable[[Any], Any], rtol: float, tmp_path: Path
) -> None:
    found = values(name, tmp_path, "--rtol", f"{rtol:g}")
    truth = solve_ivp(rates, (0, 10e-3), np.zeros(size), "Radau", rtol=1e-11, atol=1e-18)
    for output, value in outputs(truth.y[:, -1]).items():
        assert found[output][-1] == pytest.approx(value, rel=30 * rtol), output


def test_elements_in_an_array_are_elements(tmp_path: Path) -> None:
    told = [
        json.loads(command("run", file_of(name), "--to", "40 ms", "--json").stdout)
        for name in ("rectifier_flat", "rectifier_arrays")
    ]
    assert told[0]["steps"] == told[1]["steps"]
    assert told[0]["outputs"]["u_out"] == told[1]["outputs"]["u_out"]


@pytest.mark.few(2)
@pytest.mark.parametrize("name", [case(n, name=n) for n in ("nand_explicit_rtol1e-11", "kite_swing_rtol1e-11")])
def test_a_very_tight_tolerance(name: str) -> None:
    done = in_time("run", file_of(name), "--rtol", "1e-11")  # JSON would estimate the error, by a run at 1e-12
    steps = re.search(r"; (\d+) steps", done.stdout)
    assert done.returncode == 0 and steps, done.stderr
    assert int(steps[1]) < 100_000


def test_a_manipulator_at_a_very_tight_tolerance() -> None:
    """From 1e-9 to 1e-11 the steps of a method of order 5 grow 10^(2/5) times; they grew 200 times."""
    path = str(MODELS / "manipulator.bg")
    loose, tight = (
        json.loads(command("run", path, "--rtol", rtol, "--to", "50 ms", "--points", "3", "--json").stdout)
        for rtol in ("1e-9", "1e-11")
    )
    assert tight["steps"] < 4 * loose["steps"]


def test_a_four_bar_at_a_loose_tolerance(tmp_path: Path) -> None:
    """Angle and swing against each other by the geometry of the bars, and both against a run at 1e-10."""
    path = str(MODELS / "four_bar.bg")
    found, truth = (values(path, tmp_path, "--rtol", rtol, "--points", "31") for rtol in ("1e-6", "1e-10"))
    np.testing.assert_allclose(truth["swing"], [swing(phi) for phi in truth["angle"]], atol=1e-8)
    for output in ("angle", "swing", "omega"):
        assert np.abs(found[output] - truth[output]).max() <= 30e-6 * np.abs(truth[output]).max(), output


PENDULUM = """model Pendulum {{
  constant span = {unit!r} s
  I bob : p = (1 kg)*v {{ start v = (1 m)/span }}
  C weight : F = (1 kg)*(1 m)/span^2*sin(x/(1 m))
  R air : F = (0.1 kg)/span*v
  1(bob, weight) -> air
  output x = weight.x
  experiment go {{ simulate 0 .. 50*span }}
}}
"""


@pytest.mark.parametrize("unit", [1e4, 1e8, 1e-4, 3e-9])
def test_a_scale_of_time_changes_no_steps(unit: float, tmp_path: Path) -> None:
    """They grew by 2 % in each decade. The units are no powers of two: a step more or less is rounding."""
    told = []
    for number, size in enumerate((1.0, unit)):
        path = tmp_path / f"{number}.bg"
        path.write_text(PENDULUM.format(unit=size), encoding="utf-8")
        told.append(json.loads(command("run", str(path), "--json").stdout))
    assert told[0]["steps"] > 50 and abs(told[1]["steps"] - told[0]["steps"]) <= 1


@pytest.mark.parametrize("seed", [1, 2])
def test_a_mechanism_with_its_declarations_permuted(seed: int, tmp_path: Path) -> None:
    """It had 8 states for 11 and results 2e-7 apart."""
    text = (MODELS / "spatial_slider_crank.bg").read_text(encoding="utf-8")
    other = tmp_path / "other.bg"
    other.write_text(text_of(permuted(parsed(text), seed)), encoding="utf-8")
    first, second = (
        values(path, tmp_path, "--rtol", "1e-8", "--to", "0.3", "--points", "16")
        for path in (str(MODELS / "spatial_slider_crank.bg"), str(other))
    )
    for output in ("angle", "omega", "x", "side"):
        np.testing.assert_allclose(second[output], first[output], rtol=0, atol=1e-8 * np.abs(first[output]).max())


# ---------------------------------------------------------------- accepted and wrong, slow, small
@pytest.mark.parametrize("name", ["check", "run"])
def test_an_integral_in_a_parameter(name: str) -> None:
    done = command(name, file_of("integral_in_parameter"))
    assert done.exit_code == 1
    assert "integral_in_parameter.bg:3:" in done.stderr and "BG106" in done.stderr


def test_samples_that_read_each_other(tmp_path: Path) -> None:
    """As a controller's program does it: no line waits for the next sample."""
    done = command("run", file_of("sequential_every"), "--out", str(tmp_path / "result.npz"))
    assert done.exit_code == 0
    with np.load(tmp_path / "result.npz") as found:
        assert [found[name][-1] for name in ("A", "B", "CC")] == [5, 5, 5]


def test_a_unit_that_is_a_parameter_is_noted() -> None:
    done = command("check", file_of("unit_or_parameter"))
    assert done.exit_code == 0 and "note: line 4" in done.output
    assert "5 [N]*m" in done.output and "5 [N*m]" in done.output


def test_an_integral_across_an_impulse(tmp_path: Path) -> None:
    found = values("charge_shared", tmp_path)
    np.testing.assert_allclose(found["moved"], found["q"], atol=1e-9)
    assert found["moved"][-1] == pytest.approx(0.5, abs=1e-9)


def test_a_chain_of_preferred_derivative_forms() -> None:
    done = in_time("check", file_of("slow_check_prefer_derivative"), "--json")
    assert done.returncode == 0, done.stderr


ODD = [
    ("POST /run HTTP/1.1", "Content-Length: ²"),
    ("GET /changes?since=%C2%B2 HTTP/1.1",),
    (f"GET /changes?since={'9' * 400} HTTP/1.1",),
]


@pytest.mark.parametrize("lines", ODD, ids=["length", "since", "digits"])
def test_odd_requests_to_the_live_server(lines: tuple[str, ...], tmp_path: Path) -> None:
    """Refused as the client's mistake (400); there were tracebacks. All are in `tests/page/test_serve_refusals.py`."""
    path = tmp_path / "bounded.bg"
    path.write_text(BOUNDED, encoding="utf-8")
    server = Server(Session(path))
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    server.start()
    thread.start()
    try:
        status, _ = exchange(server, request(server, *lines))
        assert status == 400
        assert exchange(server, request(server, "GET /changes?since=0 HTTP/1.1"))[0] == 200
    finally:
        server.end()
        thread.join()


def test_a_closed_standard_output() -> None:
    line = f'"{sys.executable}" -m bondgraph run "{file_of("gate_duty")}" --points 3 >&-'
    done = subprocess.run(["sh", "-c", line], cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode != 70 and "defect" not in done.stderr


@pytest.mark.parametrize("content", [b"", b"\n\n", b"# nothing\n", bytes(range(128, 256)) * 3], ids=range(4))
def test_a_file_without_a_model(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "nothing.bg"
    path.write_bytes(content)
    done = command("check", str(path))
    assert done.exit_code == 1
    assert "nothing.bg" in done.stderr
