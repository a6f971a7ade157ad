"""Zero crossings of conditions on states, closer together than the steps are long: against closed forms that are sampled finely."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from bondgraph.compiled_scene import TARGETS
from bondgraph.errors import RunFailed
from bondgraph.numerics.indicators import COEFFICIENTS, FINER, ON_GRID, SHARES
from bondgraph.numerics.roots import crossing, zeros_between
from bondgraph.results.result import Result
from bondgraph.simulation.constraints.singular import SingularPoseMonitor
from bondgraph.simulation.integrators.acceptance.crossing_search import SEARCHED, mark_dips, narrow
from bondgraph.simulation.integrators.acceptance.zero_crossings import keeps_away

BOTH = [pytest.param(t, marks=pytest.mark.machine_code) if t == "native" else t for t in TARGETS]
SOLVERS = ["automatic", "explicit", "radau", "rodas"]

ROTOR = """plain model Rotor {{
  "A rotor that runs out: its angle is (1 - exp(-a t))/a times its first speed."
  parameter k = 40, c = 0
  signal w = integral(-0.1*w{bent}, 30), phi = integral(w, 0)
  mode n = 0
  when {condition} {{ n = n + 1 }}
  output count = n, angle = phi
}}
"""
SWING = """plain model Swing {{
  "x = cos t, y = -sin t: it reverses."
  parameter k = 40, c = 0
  signal x = integral(y, 1), y = integral(-x + 1e-30*x^3, 0)
  mode n = 0
  when {condition} {{ n = n + 1 }}
  output count = n, position = x
}}
"""


def run(text: str, to: float, **more: Any) -> Result:
    return bondgraph.load(text).simulate(to=to, points=3, **({"rtol": 1e-9} | more))


def rises(truth: Callable[[Any], Any], to: float) -> int:
    """Number of times a condition becomes true from the start on, from very many samples."""
    holds = truth(np.linspace(0, to, 4_000_001))
    return int(holds[0]) + int((holds[1:] & ~holds[:-1]).sum())


def angle(t: Any) -> Any:
    return 300 * (1 - np.exp(-0.1 * t))


EDGES = {
    "sin(k*phi) > 0": lambda p: np.sin(40 * p) > 0,
    "sin(k*phi) > 0.99": lambda p: np.sin(40 * p) > 0.99,
    "cos(k*phi) <= -0.9999": lambda p: np.cos(40 * p) <= -0.9999,
    "abs(sin(k*phi)) < 0.02": lambda p: np.abs(np.sin(40 * p)) < 0.02,
    "max(sin(k*phi), cos(k*phi)) > 0.999": lambda p: np.maximum(np.sin(40 * p), np.cos(40 * p)) > 0.999,
    "min(sin(k*phi), cos(k*phi)) > 0.7": lambda p: np.minimum(np.sin(40 * p), np.cos(40 * p)) > 0.7,
    "sin(k*phi) > 0.3 and sin(k*phi) < 0.31": lambda p: (np.sin(40 * p) > 0.3) & (np.sin(40 * p) < 0.31),
    "sin(k*phi) > 0 or sin(1.7*k*phi) > 0.5": lambda p: (np.sin(40 * p) > 0) | (np.sin(68 * p) > 0.5),
    "sin(k*phi)*sin(3*k*phi) > 0.2": lambda p: np.sin(40 * p) * np.sin(120 * p) > 0.2,
    "sin(k*phi) - 0.5*sin(7*k*phi) > 0.8": lambda p: np.sin(40 * p) - 0.5 * np.sin(280 * p) > 0.8,
}


@pytest.mark.few(6)
@pytest.mark.parametrize("condition", EDGES)
@pytest.mark.parametrize("bent", ["", " + 1e-30*w^3"], ids=["linear", "nonlinear"])
@pytest.mark.parametrize("target", BOTH)
def test_edges_of_an_encoder_are_counted(condition: str, bent: str, target: str) -> None:
    to = 0.2 if target == "native" else 0.05
    found = run(ROTOR.format(condition=condition, bent=bent), to, target=target)
    assert found.final("count") == rises(lambda t: EDGES[condition](angle(t)), to)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("target", BOTH)
def test_all_methods_count_alike(solver: str, target: str) -> None:
    to = 0.5 if target == "native" else 0.1
    found = run(ROTOR.format(condition="sin(k*phi) > c", bent=""), to, target=target, solver=solver)
    assert found.final("count") == rises(lambda t: np.sin(40 * angle(t)) > 0, to)


WINDOWS: dict[str, Callable[[Any, Any], Any]] = {
    "abs(x - 0.3) < 1e-5": lambda x, y: np.abs(x - 0.3) < 1e-5,
    "(x - 0.3)^2 < 1e-10": lambda x, y: (x - 0.3) ** 2 < 1e-10,
    "x > 0.3 and x < 0.300001": lambda x, y: (x > 0.3) & (x < 0.300001),
    "x > 0.3 and x < 0.300000001": lambda x, y: (x > 0.3) & (x < 0.300000001),
    "max(abs(x - 0.3), abs(y + sqrt(0.91))) < 1e-4": lambda x, y: (abs(x - 0.3) < 1e-4) & (abs(y + 0.91**0.5) < 1e-4),
    "x > 0.999999": lambda x, y: x > 0.999999,
    "not (x < 0.999999)": lambda x, y: x >= 0.999999,
    "sign(x - 0.5) > 0": lambda x, y: x > 0.5,
    "abs(abs(x) - 0.5) < 1e-6": lambda x, y: abs(abs(x) - 0.5) < 1e-6,
    "x^4 > 0.99999": lambda x, y: x**4 > 0.99999,
    "min(x, 0.9)*y < -0.45 and x > 0": lambda x, y: (np.minimum(x, 0.9) * y < -0.45) & (x > 0),
}


@pytest.mark.few(11)
@pytest.mark.parametrize("condition", WINDOWS)
@pytest.mark.parametrize("target", BOTH)
def test_narrow_windows_on_states_are_seen(condition: str, target: str) -> None:
    places = np.sort(np.concatenate([np.linspace(0, 20, 400_001), _near_windows(20.0)]))
    holds = WINDOWS[condition](np.cos(places), -np.sin(places))
    expected = int(holds[0]) + int((holds[1:] & ~holds[:-1]).sum())
    assert expected >= 3
    for solver in ("explicit", "radau") if target == "native" else ("explicit",):
        found = run(SWING.format(condition=condition), 20.0, target=target, solver=solver, rtol=1e-10)
        assert found.final("count") == expected


def _near_windows(to: float) -> Any:
    """Places that lie densely about all instants at which |x| is 0.3, 0.5 or 1."""
    centres = np.concatenate([np.arccos([0.3, 0.5, 1.0]), -np.arccos([0.3, 0.5])])
    centres = (centres + np.pi * np.arange(-1, 8)[:, None]).ravel()
    near = np.concatenate([s * np.logspace(-11, -2, 400) for s in (-1, 1)] + [np.zeros(1)])
    exits = np.concatenate([[w / 0.95, w / 0.87] for w in (1e-4, 1e-5, 1e-6, 1e-9)])
    found = np.concatenate([(centres[:, None] + near).ravel(), (centres[:, None] + 0.5 * exits).ravel()])
    return found[(found > 0) & (found < to)]


@pytest.mark.parametrize("target", BOTH)
def test_many_conditions_at_once(target: str) -> None:
    """Twenty thresholds that x = cos t passes downwards at once within a step, and upwards."""
    levels = np.round(np.linspace(-0.95, 0.95, 20), 3)
    names = [f"n{i}" for i in range(20)]
    modes = ", ".join(f"{name} = 0" for name in names)
    events = "\n".join(f"  when x < {c} {{ {n} = {n} + 1 }}" for c, n in zip(levels, names, strict=True))
    text = SWING.format(condition="x > 2").replace("mode n = 0", f"mode n = 0, {modes}\n{events}")
    found = run(text.replace("count = n", f"count = {' + '.join(names)}"), 12.0, target=target)
    assert found.final("count") == 20 * 2
    times = np.sort(np.concatenate([np.arccos(levels), 2 * np.pi + np.arccos(levels)]))
    np.testing.assert_allclose([e.time for e in found.events], times, atol=1e-7)


@pytest.mark.parametrize("target", BOTH)
def test_events_that_reset(target: str) -> None:
    """The angle is taken back by a turn of a tenth of a radian at each tooth, the speed is halved at each hundredth one."""
    text = ROTOR.format(condition="phi > 0.1", bent="").replace("n = n + 1", "n = n + 1; phi = phi - 0.1")
    to = 1.0 if target == "native" else 0.2
    found = run(text, to, target=target)
    assert found.final("count") == int(angle(to) / 0.1)
    assert found.final("angle") == pytest.approx(angle(to) % 0.1, abs=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("target", BOTH)
def test_the_integral_of_a_gate(solver: str, target: str) -> None:
    """Of a gate that is open while x = cos t lies in a window that it passes within a hundredth of a step or less."""
    text = SWING.format(condition="x > 2").replace(
        "mode n", "signal open = integral(1 if x > 0.3 and x < 0.301 else 0, 0)\n  mode n"
    )
    found = run(text.replace("output count = n", "output opened = open"), 12.0, target=target, solver=solver)
    assert found.final("opened") == pytest.approx(4 * (np.arccos(0.3) - np.arccos(0.301)), abs=1e-8)


BALL = """model Ball {{
  parameter m = {m} kg, bounce = {bounce}, h = {h} m, g = {g} [m/s^2]
  1  ball    : translation
  I  mass    : p = m*v
  Se weight  : F = -m*g
  weight -> ball -> mass
  output height = integral(ball.v, h)
  when height < {floor} {{ mass.v  = -bounce*mass.v }}
}}
"""


@pytest.mark.few(8)
@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("h", [1e-3, 0.1, 1.0, 30.0])
@pytest.mark.parametrize(("g", "m"), [(10.0, 0.1), (9.81, 5.0), (1.6, 1e-3)])
def test_a_ball_that_loses_nothing_bounces_for_ever(h: float, g: float, m: float, target: str) -> None:
    """First after sqrt(2 h/g), then always after twice that."""
    fall = np.sqrt(2 * h / g)
    to = (201.5 if target == "native" else 41.5) * fall
    found = run(BALL.format(m=m, bounce=1, h=h, g=g, floor="0 m"), to, target=target, rtol=1e-8)
    times = np.array([e.time for e in found.events])
    np.testing.assert_allclose(times, fall * np.arange(1, int(to / fall) + 1, 2), rtol=1e-6)


def test_events_in_shrinking_intervals_pile_up_and_regular_ones_late_do_not() -> None:
    """A ball that keeps 0.9 of its speed comes to rest after 19 falls; far from the start of time all is as at its start."""
    text = BALL.format(m=1, bounce=0.9, h=1, g=10, floor="0 m")
    with pytest.raises(RunFailed, match=r"at t = 8\.49\d* s .* again and again in no time"):
        run(text, 20)
    late = (
        BALL.format(m=1, bounce=1, h=1, g=10, floor="0 m").rstrip("}\n")
        + "}\n  experiment go { simulate 1000000 s .. 1000040 s }\n}"
    )
    found = bondgraph.load(late).simulate()
    np.testing.assert_allclose([e.time - 1e6 for e in found.events], np.sqrt(0.2) * np.arange(1, 90, 2), rtol=1e-6)


REVERSAL = """import DryFriction from mechanics
model Reversal {{
  Se f : F = {push} N*sin(2*time/1 s)
  I m : p = 1 kg*v
  C s : F = {stiff} [N/m]*x
  DryFriction rub {{ F_c = {coulomb} N; F_s = {static} N; v_s = {narrow} [m/s] }}
  1 b : translation
  f -> b -> m, s
  b -> rub.ends
  output x = s.x
}}
"""
FRICTION = [  # push, stiffness, Coulomb's friction, static friction, width of the peak, method
    (8, 3, 2, 3, 0.01, "radau"),
    (8, 3, 2, 3, 0.001, "explicit"),
    (8, 3, 2, 3, 0.1, "rodas"),
    (8, 3, 2, 6, 0.003, "automatic"),
    (20, 3, 2, 3, 0.01, "explicit"),
    (6, 1, 1, 4, 0.01, "radau"),
    (6, 10, 1, 2, 0.002, "rodas"),
    (12, 0.5, 3, 4, 0.03, "radau"),
    (12, 6, 0.5, 5, 0.005, "explicit"),
    (30, 12, 5, 7, 0.02, "automatic"),
    (5, 2, 0.1, 3, 0.01, "radau"),
]


@functools.cache
def turning_time(push: float, stiff: float, coulomb: float, static: float, narrow: float) -> tuple[float, float]:
    """Times of the start and of v = 0: v' = push sin(2 t) - stiff x - coulomb - (static - coulomb) exp(-(v/narrow)^2), from where the push passes the static friction."""
    begin = np.arcsin(static / push) / 2

    def rates(t: float, y: Any) -> list[float]:
        peak = (static - coulomb) * np.exp(-((y[1] / narrow) ** 2))
        return [y[1], push * np.sin(2 * t) - stiff * y[0] - coulomb - peak]

    def stops(t: float, y: Any) -> float:
        return float(y[1]) if t > begin + 0.05 else 1.0

    stops.terminal = True  # type: ignore[attr-defined]
    truth = solve_ivp(rates, (begin, 4), [0, 0], "DOP853", rtol=1e-11, atol=1e-13, max_step=2e-3, events=stops)
    # The last step of the witness ends in the stop as well: the last hundredth is integrated once more over speed, in which it has no event.
    i = int(np.searchsorted(truth.t, truth.t[-1] - 0.02))

    def over_speed(v: float, z: Any) -> list[float]:
        slope = rates(z[0], [z[1], v])[1]
        return [1 / slope, v / slope]

    end = solve_ivp(
        over_speed,
        (truth.y[1, i], 0),
        [truth.t[i], truth.y[0, i]],
        "DOP853",
        rtol=1e-11,
        atol=1e-13,
        max_step=narrow / 5,
    )
    return begin, end.y[0, -1]


@pytest.mark.few(2)
@pytest.mark.parametrize("row", FRICTION, ids=str)
@pytest.mark.parametrize("target", BOTH)
def test_the_peak_of_friction_before_a_stop_is_not_stepped_over(row: tuple[Any, ...], target: str) -> None:
    push, stiff, coulomb, static, narrow, solver = row
    begin, turn = turning_time(push, stiff, coulomb, static, narrow)
    text = REVERSAL.format(push=push, stiff=stiff, coulomb=coulomb, static=static, narrow=narrow)
    found = run(text, turn + 0.01, target=target, solver=solver, rtol=1e-7)
    stop = min((e.time for e in found.events if e.time > begin + 0.05), key=lambda t: abs(t - turn))
    assert stop == pytest.approx(turn, rel=3e-6)


def test_a_flat_zero_takes_few_evaluations() -> None:
    """x^9 from -1 to 4: the interval is halved if interpolation is not safe, else that would take twice as many."""
    count = 0

    def ninth(x: float) -> float:
        nonlocal count
        count += 1
        return x**9

    assert abs(crossing(ninth, -1.0, 4.0, 1e-12)) < 1e-11
    assert count <= 50


def test_an_end_at_which_a_function_is_zero() -> None:
    """It has no sign that a search between both ends could keep."""
    low, high = np.array([-8.0, 0.0, -1.0]), np.array([0.0, 1.0, 2.0])
    with np.errstate(all="ignore"):
        a, b, at_a, at_b = zeros_between(np.sinh, low, high, np.sinh(low), np.sinh(high), lambda _: 1e-16)
    np.testing.assert_allclose(np.where(np.abs(at_a) < np.abs(at_b), a, b), 0.0, atol=1e-15)


def test_a_least_value_at_the_edge_of_a_crossing_is_no_pose() -> None:
    """If the smallest singular value falls up to the end of a crossing, a singular pose can only be beyond it; with a minimum inside, there is one."""

    class Along(SingularPoseMonitor):
        least = 2.0  # where it is least

        def __init__(self) -> None:
            """Without a mechanism."""

        def _on(self, crossed: Any, times: Any, state: Any) -> Any:
            return times[:, None]

        def _least_all(self, times: Any, states: Any, mode: Any) -> Any:
            return np.abs(times - self.least)

        def _apart(self, one: Any, other: Any) -> float:
            return 0.0

    crossed = SimpleNamespace(start=0.0, size=1.0)
    ahead = SimpleNamespace(state=np.zeros(1), lost=1, joints=())
    watcher = Along()
    assert watcher._pose(crossed, ahead, np.zeros(1), np.zeros(0)) is None  # type: ignore[arg-type]
    watcher.least = 0.3
    pose = watcher._pose(crossed, ahead, np.zeros(1), np.zeros(0))  # type: ignore[arg-type]
    assert pose is not None and pose.time == pytest.approx(0.3, abs=1e-3)


def narrowed(there: float, root: Callable[[float], float]) -> float:
    """First zero crossing found in (0, 1] of a condition that does not hold at 0; `there`: its root at 1, before loops are solved for once more."""

    def exactly(time: float, out: Any) -> None:
        out[0] = root(time)

    arrays = {name: np.zeros(1) for name in ("seen", "floor", "scale")}
    numbers = {
        name: np.array([name == "strict"], dtype=int) for name in ("strict", "said", "flipping", "behind", "touching")
    }
    part: Any = SimpleNamespace(
        low=0.0, high=1.0, root_count=1, exactly=exactly, bracket=SimpleNamespace(), **arrays, **numbers
    )
    assert narrow(part, None, 1, 1, np.ones(1), np.array([there])) == 1  # type: ignore[arg-type]
    return float(part.found)


def test_a_flip_that_is_not_seen_again_is_where_it_was_seen() -> None:
    """A loop that is solved for twice at one instant may have two roundings, one on each side of zero."""
    for value in (0.0, 1e-300, 1e-18, 1.0):
        assert narrowed(-1e-18, lambda _, v=value: v) == 1.0  # type: ignore[misc]
    assert narrowed(-0.75, lambda time: 0.25 - time) == pytest.approx(0.25, rel=1e-14)


BELLS = [
    "exp(-((x - 0.123)/w)^2) > 0.5",
    "0.5 < exp(-((x - 0.123)/w)^2)",
    "2*exp(-((0.123 - x)/w)^2) > 1.3",
    "exp(-((x - 0.123)/w)^2) > c",
    "0.1 + exp(-((x - 0.123)/w)^2) > c",
    "1/(1 + ((x - 0.123)/w)^2) > c",
    "a/(1 + ((x - 0.123)/w)^2) > a*c",
    "w^2/(w^2 + (x - 0.123)^2) > c",
    "1/(1 + ((x - 0.123)/w)^4) > c",
    "(1 + ((x - 0.123)/w)^2)^(-2) > c",
    "sqrt(1/(1 + ((x - 0.123)/w)^2)) > c",
    "1/(1 + ((x - 0.123)/w)^2) > 1/(1 + x^2)",
    "1/((x - 0.123)/w)^2 > c",
    "1/cosh((x - 0.123)/w) > c",
    "1 - tanh((x - 0.123)/w)^2 > c",
    "tanh((x - 0.123)/w) - tanh((x - 0.123)/w - 4) > 1",
    "1/(1 + exp((0.123 - x)/w)) - 1/(1 + exp((0.123 + 2*w - x)/w)) > 0.3*c",
    "exp(-abs(x - 0.123)/w) > c",
    "x/((x - 0.123)^2 + w^2) > 0.01/w",
    "log((x - 0.123)^2) < 2*log(w)",
    "(x - 0.123)^2 < w^2",
    "(x - 0.123)^4 < w^4",
    "a*((x - 0.123)/w)^6 < c",
    "-c < -a*((x - 0.123)/w)^12",
    "abs(x - 0.123) < w",
]


@pytest.mark.few(20)
@pytest.mark.parametrize("condition", BELLS)
@pytest.mark.parametrize("width", [1e-6, 1e-9])
@pytest.mark.parametrize("target", BOTH)
def test_narrow_bells_of_states_are_seen(condition: str, width: float, target: str) -> None:
    """x = cos t passes the bell at 0.123 twice in a period."""
    text = SWING.format(condition=condition).replace("k = 40, c = 0", f"w = {width}, a = 2, c = 0.5")
    for solver in ("explicit", "radau") if target == "native" else ("explicit",):
        assert run(text, 2 * math.pi, target=target, solver=solver).final("count") == 2


@pytest.mark.parametrize(
    ("condition", "count"),
    [
        ("a*exp(-((x - 0.123)/w)^2) > -c", 1),  # always
        ("a*exp(-((x - 0.123)/w)^2) > a + c", 0),  # never
        ("-a*exp(-((x - 0.123)/w)^2) < -c", 2),
        ("-a*exp(-((x - 0.123)/w)^2) < c", 1),
        ("-a*exp(-((x - 0.123)/w)^2) > c", 0),
        ("(a - 2)*exp(-((x - 0.123)/w)^2) > -c", 1),
        ("(a - 2)*exp(-((x - 0.123)/w)^2) >= c", 0),
        ("(a - 2)*((x - 0.123)/w)^4 < c", 1),
        ("(a - 2)*((x - 0.123)/w)^4 < -c", 0),
        ("-a*((x - 0.123)/w)^4 < c", 1),
        ("a*((x - 0.123)/w)^4 < -c", 0),
        ("-a*((x - 0.123)/w)^4 < -c", 3),  # true at the start, false within the window
    ],
)
def test_signs_of_levels_and_factors(condition: str, count: int) -> None:
    """Whether a bell or a power ever crosses its level is decided by parameters of the run."""
    text = SWING.format(condition=condition).replace("k = 40, c = 0", "w = 1e-6, a = 2, c = 0.5")
    assert run(text, 2 * math.pi, target="numpy").final("count") == count


def test_a_narrow_condition_behind_a_delay_is_told() -> None:
    """A delayed signal has no range within a step."""
    text = SWING.format(condition="1/(1 + ((late - 0.1)/1e-6)^2) > 0.5").replace(
        "  mode n", "  signal late = delay(x, 0.1)\n  mode n"
    )
    assert any("has no bounds within a step" in note for note in run(text, 1.0).notes)


@pytest.mark.few(14)
@pytest.mark.parametrize("solver", ["automatic", "explicit", "radau", "rodas"])
@pytest.mark.parametrize("order", [3, 4, pytest.param(6, marks=pytest.mark.machine_code), 8])
def test_a_motion_from_rest_crosses_once(order: int, solver: str) -> None:
    """t^n/n! is above zero at once; with n = 4 and more an event was counted twice, as no look ahead shows which way so slow a motion goes.

    What counts it moves a state too, as that changes rates at the instant of the event.
    """
    chain = ", ".join(f"u{k} = integral({f'u{k - 1}' if k else 1}, 0)" for k in range(order))
    result = run(f"""plain model M {{
  signal {chain}, since = integral(n, 0)
  mode n = 0
  when u{order - 1} > 0 {{ n = n + 1 }}
  when u{order - 1} < 0 {{ n = n + 10 }}
  output count = n, y = since
}}""", 4.0, solver=solver)  # fmt: skip
    assert result.final("count") == 1 and len(result.events) == 1
    assert result.final("y") == pytest.approx(4, rel=1e-6)


def test_a_drive_from_rest_is_counted_once_whatever_is_known_of_magnitudes() -> None:
    """Current, speed and angle leave zero as t^4, t^5 and t^6: at the start neither their rates nor their magnitudes are known."""
    text = """plain model Drive {
  signal i = integral(smoothstep5(time, 0, 1) - i - w - 0.1*i^3, 0)
  signal w = integral(i - 0.2*w - 0.1*w*abs(w), 0), phi = integral(w, 0)
  mode n = 0, k = 0, q = 0
  when phi > 0 { n = n + 1 }
  when w > 0 { k = k + 1 }
  when i > 0 { q = q + 1 }
  output a = n, b = k, c = q
}"""
    for solver in ("automatic", "explicit"):
        result = run(text, 4.0, solver=solver, rtol=1e-6)
        assert [result.final(name) for name in "abc"] == [1, 1, 1] and result.events[-1].time < 1e-3


HALF = 10.575222039230587  # s of 20 s in which cos t is positive
PLATEAUS = {  # condition on x = cos t -> times that it becomes true in 20 s, and how long it holds
    "max(x, 0) > 0": (4, HALF),
    "max(x, 0)^3 <= 0": (3, 20 - HALF),
    "abs(x) + x > 0": (4, HALF),
    "abs(x) == x": (4, HALF),
    "min(x, 0.5) >= 0.5": (4, 7 * math.pi / 3),
    "min(max(x, -0.5), 0.5) == 0.5": (4, 7 * math.pi / 3),
    "x == 0.5": (0, 0.0),
    "x != 0.5": (1, 20.0),
}


@pytest.mark.few(12)
@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("condition", PLATEAUS)
def test_what_is_equal_for_a_while_holds_as_it_is_written(condition: str, target: str) -> None:
    """Behind its first event the rounding level of a condition hid each plateau at zero."""
    result = run(f"""plain model M {{
  signal x = integral(v, 1), v = integral(-x, 0), held = integral(1 if {condition} else 0, 0)
  mode n = 0
  when {condition} {{ n = n + 1 }}
  output count = n, y = held
}}""", 20.0, target=target)  # fmt: skip
    count, length = PLATEAUS[condition]
    assert result.final("count") == count and result.final("y") == pytest.approx(length, abs=1e-6)


@pytest.mark.few(15)
@pytest.mark.parametrize("solver", ["automatic", "radau", "explicit"])
@pytest.mark.parametrize("condition", ["x^2 > 0", "abs(x) > 0", "max(x, -x)^0.5 > 0", "not (x^2 <= 0)", "x != 0"])
def test_what_fails_at_one_instant_does_not_act_again(condition: str, solver: str) -> None:
    """x = 1 - t and (t^2 - 1)/2 are zero at t = 1 s, to the last place or but for it."""
    for law in ("signal x = integral(-1, 1)", "signal v = integral(1, 0), x = integral(v, -0.5)"):
        text = f"plain model M {{ {law}\n mode n = 0\n when {condition} {{ n = n + 1 }}\n output count = n }}"
        assert run(text, 5.3, solver=solver).final("count") == 1


def test_an_equality_at_the_very_end_holds() -> None:
    text = "plain model M { signal x = integral(1, 0)\n mode n = 0\n when x >= 2 { n = n + 1 }\n output count = n }"
    assert run(text, 2.0).final("count") == 1


@pytest.mark.parametrize("edge", [1e-3, 0.05, 0.29])
@pytest.mark.parametrize(
    "condition", ["max(x - {}, 0) > 0", "min(x, {}) >= {}", "linear(x, (-2, {}, 2), (0.3, 0.3, 1)) > 0.3"]
)
def test_a_plateau_in_which_a_run_begins_is_left_where_it_ends(condition: str, edge: float) -> None:
    """The look ahead for motions from rest reached over its edge: the event acted at the start."""
    written = condition.replace("{}", str(edge))
    text = f"plain model M {{ signal x = integral(v, 0), v = integral(-9*x, 3)\n mode at = -1\n when {written} and at < 0 {{ at = time }}\n output y = at }}"
    assert run(text, 2.0).final("y") == pytest.approx(np.arcsin(edge) / 3, abs=1e-6)


@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize(("sign", "count"), [(">", 2), ("<", 2), ("==", 4), ("!=", 4)])
def test_a_law_that_comes_to_a_plateau_at_its_own_condition_is_zero_there(sign: str, count: int, target: str) -> None:
    """Behind a dead zone's edge the condition had crossed zero with the branch before, which is not the law any more."""
    text = f"""plain model M {{ signal x = integral(v, 0), v = integral(-x, 1)
  signal dead = x - 0.2 if x > 0.2 else (x + 0.2 if x < -0.2 else 0)
  mode n = 0
  when dead {sign} 0 {{ n = n + 1 }}
  output count = n }}"""
    assert run(text, 10.0, target=target).final("count") == count


@pytest.mark.machine_code
@pytest.mark.parametrize("curve", ["linear", "monotone"])
def test_rounding_leads_no_table_beyond_a_plateau(curve: str) -> None:
    """-0.01 + 0.017 is beyond 0.007 by rounding: the rise to 0.007 % acted as one above it."""
    table = f"{curve}(x, (-1.1, -0.098, 0.011, 1.1), (-1 %, 0.7 %, 0.7 %, 1.0333333333333332 %))"
    text = f"""model M {{ signal x = integral(v, 0), v = integral(-x/1 [s^2], 1 [1/s])
  mode above = 0, below = 0
  when {table} > 0.7 % {{ above = above + 1 }}
  when {table} < 0.7 % {{ below = below + 1 }}
  output a = above, b = below }}"""
    result = run(text, 20.0, solver="rodas")
    assert (result.final("a"), result.final("b")) == (4, 3)


@pytest.mark.parametrize("target", BOTH)
def test_a_condition_whose_branch_changes_with_it_is_judged_anew(target: str) -> None:
    """|x| by two branches crosses zero under each of them, and is positive on both sides: the second one acted at each zero of x."""
    text = "plain model M { signal x = integral(v, 0), v = integral(-x, 1)\n mode n = 0\n when (x if x > 0 else -x) > 0 { n = n + 1 }\n output count = n }"
    assert run(text, 10.0, target=target).final("count") == 1


def begun(values: Any, said: int = 0) -> tuple[list[int], bool]:
    """The places of the grid beside which a part that begins a step is searched, and True if it is clear of crossings."""
    form = COEFFICIENTS @ values
    part: Any = SimpleNamespace(
        root_count=1, values=values, form=form, grid=ON_GRID @ form, error=[0.0], floor=[0.0], said=[said], dips=[0] * len(FINER), dipping=[0],
        root_form=form, root_floor=[0.0], root_strict=[1], root_said=[said],
    )  # fmt: skip
    mark_dips(part, 0, 1)
    return [i for i, dip in enumerate(part.dips) if dip == SEARCHED], keeps_away(part, 0, 0, 0.0)


def test_a_window_between_any_places_of_the_grid_is_searched() -> None:
    """Near the ends of a part the places are apart as 1, 3, 5: of windows of a sine, 1e-4 of its period, one in 6000 was passed there."""
    passed = []
    for place in [*np.linspace(1e-5, 0.02, 400), *np.linspace(0.45, 0.5, 100)]:
        for at in (float(place), 1 - float(place)):
            around, clear = begun((SHARES - at) ** 2 - 1e-11)
            beside = [FINER[max(i - 1, 0)] <= at <= FINER[min(i + 1, len(FINER) - 1)] for i in around]
            if clear or not any(beside):
                passed.append(at)
    assert not passed


@pytest.mark.parametrize("width", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_window_at_the_beginning_of_a_step_is_searched(width: float, sign: int) -> None:
    """A unit passed those that begin at a step of its importer, 48 of 108: the root there is zero, or on the other side by rounding."""
    said = int(sign < 0)
    for start in (0.0, 1e-20, -1e-20):
        around, clear = begun(sign * (SHARES * (SHARES - width) + start), said)
        assert around == [0] and not clear
        around, _ = begun(sign * (SHARES * (SHARES + width) + start), said)  # what an event has left goes its way
        assert around == []


@pytest.mark.parametrize(
    ("condition", "duration"),
    [
        ("1/x > 3", 6*math.asin(1/3)), ("y/x > 1", 1.5*math.pi), ("1/(x*x - 1/4) < 0", 6*math.pi/3 + 20 - 19*math.pi/3),
        ("atan(1/x) > 0.3", 20 - 3*math.pi), ("x^(-3) > 8", 6*math.pi/6 + 20 - 19*math.pi/3),
    ],
)  # fmt: skip
def test_a_condition_passes_through_a_pole(condition: str, duration: float) -> None:
    """Rounding of a root is larger at its pole than any root is beside it: what was rounding there is none a little later."""
    text = f"plain model M {{\n  signal x = integral(y, 1), y = integral(-x, 0)\n  output o = integral(1 if {condition} else 0, 0)\n}}\n"
    assert bondgraph.load(text).simulate(to=20, solver="explicit")["o"][-1] == pytest.approx(duration, abs=1e-5)
