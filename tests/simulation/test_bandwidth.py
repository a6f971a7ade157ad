"""A bandwidth: faster modes are truncated, and the result's data on them are right, by runs that follow every turn and by matrix exponentials."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from bondgraph.results.archive import read_result
from bondgraph.results.result import Result
from bondgraph.simulation.truncation import mode_truncation, report
from tests.compiling import MODELS

OFF = """
  experiment quiet { simulate 0 .. 20 ms; set fx = 30 uN*smoothstep5(time, 0 s, 5 ms) }
  experiment off { simulate 0 .. 20 ms; set fx = 30 uN*smoothstep5(time, 0 s, 5 ms); start stage.platform.x = 1 nm }
"""
VELOCITIES = "output vx = stage.platform.x.v, vy = stage.platform.y.v, w = stage.platform.phi.omega, v1 = stage.guide[1].x.v, v2 = stage.guide[2].x.v, v3 = stage.guide[3].x.v"  # fmt: skip

# Two masses of 1 kg on soft springs, and one of 10 g between them on a stiff one, which rings at 504 Hz.
CHAIN = """model Chain {
  parameter m = 1 kg, s = 10 g, k: N/m = 100, k3: N/m^3 = 10, stiff: N/m = 1e5, r: N*s/m = 0.05
  input pull = 0 N
  MSe hand : F = pull
  1 a, b, c
  0 ab, bc
  I ma : p = m*v
  I mb : p = s*v
  I mc : p = m*v
  C wall : F = k*x + k3*x^3
  C link : F = stiff*x
  C soft : F = k*x + k3*x^3
  R drag : F = r*v
  a -> ma, wall, drag
  a -> ab -> 1(link)
  ab -> b -> mb
  b -> bc -> 1(soft)
  bc -> c -> mc
  hand -> b
  output xa = wall.x, stretch = link.x, xs = soft.x, pa = ma.p, pb = mb.p, pc = mc.p
  experiment off { start link.x = 1 mm; start wall.x = 50 mm; simulate 0 .. 3 s; bandwidth 50 Hz }
  experiment kicked { set pull = 1 N*exp(-((time - 1 s)/(1 ms))^2); simulate 0 .. 3 s; bandwidth 50 Hz }
  experiment jumped { set pull = 100 N*step(time - 1 s); simulate 0 .. 2 s; bandwidth 50 Hz }
  experiment buzz { set pull = 1 N*sin(2*pi*300 Hz*time); simulate 0 .. 20 ms; bandwidth 50 Hz }
}"""
STRAIGHT = CHAIN.replace(" + k3*x^3", "")

# A ball on a stiff rod that swings by 1 rad and rings along itself at 159 Hz.
SWING = """model Swing {
  multibody arm : planar {
    gravity = (0, -9.81 [m/s^2])
    body ball { mass = 1 kg, at = (0, -1 m) }
    body bar { mass = 0.01 kg, inertia = 1e-4 [kg*m^2] }
    hinge pin : ground to bar { at = (0, 0) }
    slide rod : bar to ball { along = -90 deg, at = (0, -1 m) }
  }
  C spring : F = 1e6 [N/m]*x
  arm.rod -> spring
  output phi = arm.pin.phi, r = arm.rod.x
  experiment swing { start arm.pin.phi = 1 rad; start arm.rod.x = 3 mm; simulate 0 .. 10 s; bandwidth 20 Hz }
}"""

# What lies between two nonlinear resistors is an algebraic loop; a light mass on a stiff spring rings at 1.6 kHz.
LOOP = """model Loop {
  1 a, b
  0 ab, mid
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 10 [N/m^3]*x^3
  C link : F = 1e6 [N/m]*x
  R one : F = 0.001 [N*s/m]*v + 0.001 [N*s^3/m^3]*v^3
  R two : v = 0.001 [m/N/s]*F + 0.001 [m/N^3/s]*F^3
  a -> ma, wall
  a -> ab -> 1(link)
  ab -> b -> mb
  b -> mid -> one, two
  output xa = wall.x, stretch = link.x
  experiment off { start link.x = 0.1 mm; start wall.x = 50 mm; simulate 0 .. 0.2 s; bandwidth 100 Hz }
}"""

# A coil and a condenser, and behind them parasitic ones that ring at 50 MHz and are damped within microseconds.
FILTER = """model Filter {
  input volt = 0 V
  MSe source : u = volt
  R r : u = 10 [ohm]*i
  I coil : lambda = 10 mH*i
  C cap : u = q/(10 uF) + 1e12 [V/C^3]*q^3
  I para : lambda = 10 nH*i
  C stray : u = q/(1 nF)
  R skin : u = 0.01 [ohm]*i
  0 node, far
  source -> 1(r, coil) -> node -> cap
  node -> 1(para, skin) -> far -> stray
  output u = cap.u, far_u = stray.u
  experiment charged { start stray.q = 3 nC; simulate 0 .. 5 ms; bandwidth 100 kHz }
}"""


def lacking(full: Result, kept: Result) -> dict[str, float]:
    """The largest differences of the outputs."""
    return {n: float(np.abs(full[n] - kept[n]).max()) for n in full.names}


def within(found: float, wanted: float, factor: float) -> bool:
    return wanted / factor < found < wanted * factor


def followed(model: bondgraph.Model, experiment: str, **options: Any) -> Result:
    """Every turn, by the explicit pair where it can."""
    return model.simulate(experiment, bandwidth="1 THz", **options)


# ---------------------------------------------------------------- the manipulator
@pytest.fixture(scope="module")
def manipulator(tmp_path_factory: pytest.TempPathFactory) -> bondgraph.Model:
    """The manipulator with an experiment whose platform starts 1 nm off, and its speeds among the outputs."""
    folder = tmp_path_factory.mktemp("manipulator")
    text = (MODELS / "manipulator.bg").read_text(encoding="utf-8")
    (folder / "off.bg").write_text(
        text.replace("  experiment push_x {", f"  {VELOCITIES}\n{OFF}\n  experiment push_x {{", 1)
    )
    (folder / "mems.bg").write_text((MODELS / "mems.bg").read_text(encoding="utf-8"))
    return bondgraph.load(folder / "off.bg")


def slow_part(model: bondgraph.Model, below: float) -> tuple[tuple[str, ...], Any]:
    """The states, and the projector onto the modes below a frequency in Hz at rest, by numpy's eigenvectors and their inverse."""
    linear = model.linearize()
    values, right = np.linalg.eig(linear.A)
    return linear.states, ((right * (np.abs(values) < 2 * np.pi * below)) @ np.linalg.inv(right)).real


STATES = {
    "stage.guide[1].x": "c1", "stage.guide[2].x": "c2", "stage.guide[3].x": "c3", "stage.platform.x": "x", "stage.platform.y": "y",
    "stage.platform.phi": "phi", "stage.guide[1].x.v": "v1", "stage.guide[2].x.v": "v2", "stage.guide[3].x.v": "v3",
    "stage.platform.x.v": "vx", "stage.platform.y.v": "vy", "stage.platform.phi.omega": "w",
}  # fmt: skip


@pytest.mark.machine_code
def test_a_manipulator_that_starts_off(manipulator: bondgraph.Model) -> None:
    """1 nm off, 0.97 nm of it in the modes of MHz: as many steps as without; the slow motion and the estimates are right."""
    quiet = manipulator.simulate("quiet")
    usual = manipulator.simulate("off", bandwidth="50 kHz")
    assert usual.steps <= 1.1 * quiet.steps
    assert usual.evaluations["derivative"] <= 1.1 * quiet.evaluations["derivative"]
    full = followed(manipulator, "off", solver="explicit", rtol=1e-10)
    assert full.steps > 1000 * usual.steps
    names, slow = slow_part(manipulator, 50e3)
    order = [full.names.index(STATES[n]) for n in names]
    fine = manipulator.simulate("off", bandwidth=50e3, rtol=1e-8)
    apart = np.abs((full.values - fine.values)[:, order] @ slow.T).max(axis=0)
    size = np.abs(full.values[:, order] @ slow.T).max(axis=0)
    for kinds in (
        ("x", "y", "c1", "c2", "c3"),
        ("phi",),
    ):  # speeds: the modes of MHz turn with the pose, and have a part in what is slow at rest
        chosen = [i for i, n in enumerate(names) if STATES[n] in kinds]
        assert apart[chosen].max() < 1e-6 * size[chosen].max()
    tight = manipulator.simulate("off", bandwidth=50e3, rtol=1e-10)
    told, found = tight.truncation, lacking(full, tight)
    assert told is not None and told.faster == 3 and told.instants == (0.0,)
    assert told.outputs["x"] == pytest.approx(0.97e-9, rel=0.01)
    for name in ("x", "y", "phi", "c2", "c3", "vx", "vy", "w", "v2", "v3"):
        assert within(told.outputs[name], found[name], 3), name
    assert 0 < told.kept["x"] < 1e-9 * np.abs(full["x"]).max()
    assert usual.truncation is not None and not any(
        usual.truncation.kept.values()
    )  # below that tolerance, and not computed
    assert [round(m.frequency) for m in told.modes] == [836512] and told.modes[0].elements[0] == "stage.platform"


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_nothing_rings(manipulator: bondgraph.Model, target: str) -> None:
    """Bit by bit the same as without a bandwidth, if no mode is faster, or no faster mode rings."""
    quiet = manipulator.simulate("quiet", target=target, to="6 ms")
    for bandwidth, told in (("50 kHz", "3 modes are faster, and none rings"), ("10 MHz", "nothing in it is faster")):
        found = manipulator.simulate("quiet", target=target, to="6 ms", bandwidth=bandwidth)
        assert (found.values == quiet.values).all() and found.steps == quiet.steps
        assert found.truncation is not None and told in found.truncation.reason and not found.truncation.instants
        assert any(told in note for note in found.notes)


@pytest.mark.machine_code
def test_numpy_takes_the_same_steps(manipulator: bondgraph.Model) -> None:
    for model, experiment in ((manipulator, "off"), (bondgraph.load(CHAIN), "kicked")):
        a, b = (
            model.simulate(experiment, target=t, to=None, bandwidth=None if model is not manipulator else 50e3)
            for t in ("native", "numpy")
        )
        assert a.steps == b.steps and b.evaluations["derivative"] == pytest.approx(
            a.evaluations["derivative"], rel=0.02
        )
        assert (
            a.truncation is not None
            and b.truncation is not None
            and len(a.truncation.instants) == len(b.truncation.instants)
        )
        assert a.truncation.instants == pytest.approx(b.truncation.instants, rel=1e-9)
        assert np.abs(a.values - b.values).max(axis=0) == pytest.approx(0, abs=1e-7)


# ---------------------------------------------------------------- by matrix exponentials
@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_a_linear_model_keeps_its_slow_part(target: str) -> None:
    """By Radau, since what is linear is else solved exactly and leaves nothing out."""
    model = bondgraph.load(STRAIGHT)
    found = model.simulate("off", solver="radau", rtol=1e-9, target=target, points=61)
    linear = model.linearize()
    values, right = np.linalg.eig(linear.A)
    slow = np.abs(values) < 2 * np.pi * 50
    start = np.zeros(len(linear.states), dtype=complex)
    start[[linear.states.index("link.x"), linear.states.index("wall.x")]] = 1e-3, 50e-3
    shares = np.linalg.solve(right, start)
    names = {"wall.x": "xa", "link.x": "stretch", "soft.x": "xs", "ma.p": "pa", "mb.p": "pb", "mc.p": "pc"}
    for chosen, told in ((slow, None), (~slow, found.truncation)):
        states = (right[:, chosen] * shares[chosen]) @ np.exp(values[chosen, None] * found.time)
        for row, name in zip(states.real, linear.states, strict=True):
            if told is None:
                assert found[names[name]] == pytest.approx(row, abs=1e-7 * max(0.05, np.abs(row).max()))
            else:
                assert within(told.outputs[names[name]], float(np.abs(row).max()), 1.3)
    assert found.truncation is not None and max(found.truncation.kept.values()) < 1e-12
    exact = model.simulate("off", target=target)
    assert exact.truncation is not None and "solved exactly" in exact.truncation.reason
    assert (exact.values == model.simulate("off", target=target, bandwidth="1 THz").values).all()


# ---------------------------------------------------------------- what a ringing does to what is kept
@pytest.mark.machine_code
@pytest.mark.parametrize(
    ("text", "experiment", "shown", "beside"),
    [(CHAIN, "off", "xa", "stretch"), (SWING, "swing", "phi", "r"), (LOOP, "off", "xa", "stretch")],
)
def test_the_push_on_the_slow_motion(text: str, experiment: str, shown: str, beside: str) -> None:
    """Difference of the full run and the truncated one, without the part proportional to the fast output."""
    model = bondgraph.load(text)
    kept = model.simulate(experiment, rtol=1e-9, points=2001)
    full = followed(model, experiment, rtol=1e-10, points=2001)
    told, apart = kept.truncation, full[shown] - kept[shown]
    assert told is not None
    rings = full[beside] - kept[beside]
    rest = apart - rings * (rings @ apart) / (rings @ rings)
    assert within(told.kept[shown], float(np.abs(rest).max()), 3)
    assert within(told.outputs[beside], float(np.abs(rings).max()), 1.5)


@pytest.mark.parametrize(("text", "experiment"), [(CHAIN, "off"), (CHAIN, "jumped"), (SWING, "swing")])
def test_what_is_not_computed_is_small(text: str, experiment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound that saves the computation of the push is not smaller than its effect, in parts of the tolerance."""
    bounds: list[float] = []
    bound = report._bound

    def noted(*given: Any) -> float:
        bounds.append(bound(*given))
        return np.inf

    monkeypatch.setattr(report, "_bound", noted)
    found = bondgraph.load(text).simulate(experiment)
    assert found.truncation is not None and len(bounds) == 1
    for name, lacks in found.truncation.kept.items():
        assert lacks <= 2 * bounds[0] * 1e-6 * np.abs(found[name]).max()
        assert lacks == 0 or bounds[0] > 0.3


# ---------------------------------------------------------------- on the way
@pytest.mark.machine_code
def test_what_a_blow_leaves_ringing() -> None:
    """The blow is followed; the ringing after it is truncated within the segment."""
    model = bondgraph.load(CHAIN)
    found, full = model.simulate("kicked"), followed(model, "kicked", rtol=1e-9)
    told = found.truncation
    assert told is not None and told.instants and all(1 <= t < 1.1 for t in told.instants)
    assert found.steps < 750 < 20 * found.steps < full.steps
    after = found.time > 1.05
    apart = np.abs((full["stretch"] - found["stretch"])[after]).max()
    assert within(told.outputs["stretch"], float(apart), 3)
    assert found["xa"] == pytest.approx(full["xa"], abs=3 * told.outputs["xa"] + 3e-6 * np.abs(full["xa"]).max())


def test_what_a_jump_leaves_ringing() -> None:
    """The stiff spring takes half the jump at once: k x = 100 N/2, about which it would ring by as much."""
    found = bondgraph.load(CHAIN).simulate("jumped")
    told = found.truncation
    assert told is not None and told.instants[0] == 1.0
    assert told.outputs["stretch"] == pytest.approx(100 / 1e5, rel=0.1)
    after = found["stretch"][(found.time > 1.0) & (found.time < 1.02)]
    assert np.ptp(after) < 0.02 * np.abs(after).max()


def test_a_drive_that_is_faster_is_followed_and_told() -> None:
    model = bondgraph.load(CHAIN)
    found, full = (model.simulate("buzz", rtol=1e-8, bandwidth=b) for b in ("50 Hz", "1 THz"))
    assert found.truncation is not None
    assert "what drives it changes as fast as 3" in found.truncation.reason and found.truncation.reason.endswith(
        "0 Hz, and is followed"
    )
    quiet = np.abs(full["pa"]).max()
    assert within(found.truncation.outputs["pa"], float(np.abs(full["pa"] - found["pa"]).max()), 3)
    assert np.abs(full["pa"] - found["pa"]).max() < quiet


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_parasitics(target: str) -> None:
    """3 nC on 1 nF: 3 V that ring at 50 MHz, q^2/2C = 4.5 nJ of energy, and the balance closes."""
    found = bondgraph.load(FILTER).simulate("charged", target=target, energy=True)
    told = found.truncation
    assert told is not None and found.steps < 300
    assert told.outputs["far_u"] == pytest.approx(3, rel=1e-3)
    assert told.modes[0].frequency == pytest.approx(1 / (2 * np.pi * np.sqrt(1e-8 * 1e-9)), rel=1e-3)
    assert told.energy == pytest.approx(4.5e-9, rel=1e-3)
    assert found.energy is not None and abs(found.energy.residual) < 1e-4 * 4.5e-9 + 1e-10
    (element,) = (e for e in found.energy.elements if e.name == "left out")
    assert element.dissipated == told.energy


# ---------------------------------------------------------------- where all is followed
GROWS = """plain model Grows {
  signal x = integral(y, 1), y = integral(-x - 0.1*x^3, 0)
  signal u = integral(v, 1e-3), v = integral(100*u - u^3, 0)
  output a = x, b = u
}"""
BOUNCES = """plain model Bounces {
  signal x = integral(v, 1), v = integral(-1, 0)
  signal u = integral(w, 1e-3), w = integral(-1e6*u, 0)
  output a = x, b = u
  when x < 0 { v = -v }
}"""


def test_what_grows_is_followed() -> None:
    """Rates of 10 1/s: 1.6 Hz, above a bandwidth of 0.5 Hz."""
    model = bondgraph.load(GROWS)
    found, full = model.simulate(to=2, bandwidth=0.5), model.simulate(to=2)
    assert found.truncation is not None and "a motion of 1.592 Hz grows, so it is followed" in found.truncation.reason
    assert (found.values == full.values).all()


def test_with_events_all_is_followed() -> None:
    model = bondgraph.load(BOUNCES)
    found, full = (model.simulate(to=0.1, bandwidth=b) for b in (10, None))
    assert found.truncation is not None and "events ask for its states" in found.truncation.reason
    assert (found.values == full.values).all()


# ---------------------------------------------------------------- asking and telling
def test_it_is_kept_with_the_result(tmp_path: Path) -> None:
    model = bondgraph.load(LOOP)
    first = model.simulate("off", to="0.1 s")
    first.to_npz(tmp_path / "r.npz")
    again = read_result(tmp_path / "r.npz")
    assert again.truncation == first.truncation and first.truncation is not None
    told = json.loads(json.dumps(first.to_json()))["bandwidth"]
    assert told["frequency"] == 100 and told["instants"] == [0.0] and told["outputs"].keys() == {"xa", "stretch"}
    both = model.simulate("off", start=again)
    assert (
        both.truncation is not None and both.truncation.instants == first.truncation.instants
    )  # nothing rings any more
    assert "left out at t = 0 s" in first.notes[-1] and "`stretch`" in first.notes[-1]


def test_many_runs_are_as_single_ones() -> None:
    model = bondgraph.load(LOOP)
    many = model.simulate_many([{}, {}], "off", to="0.02 s", bandwidth="1 kHz", workers=1)
    assert many[1].truncation == model.simulate("off", to="0.02 s", bandwidth="1 kHz").truncation


@pytest.mark.parametrize("wrong", ["50 kg", "-1 Hz", "fast", 0.0, "1 Hz + 2 Hz", "600 rpm", "9 rad/s"])
def test_what_is_no_bandwidth(wrong: str | float) -> None:
    with pytest.raises(UsageError, match="is no bandwidth: write `50 kHz`"):
        bondgraph.load(LOOP).simulate("off", bandwidth=wrong)


def test_looks_are_rare(monkeypatch: pytest.MonkeyPatch) -> None:
    """If steps are as long as the bandwidth allows, nothing is examined between their ends."""
    seen: list[float] = []
    usual = mode_truncation.Leaving._found

    def counted(self: Any, at: float, *rest: Any) -> Any:
        seen.append(at)
        return usual(self, at, *rest)

    monkeypatch.setattr(mode_truncation.Leaving, "_found", counted)
    bondgraph.load(CHAIN).simulate("off")
    assert seen == [0.0]
