"""Mechanisms with closed loops: Andrews' squeezer, and N four-bars that pass poses in which all bars lie in one line.

The digits of the squeezer were computed again in quadruple precision by extrapolation (the published ones violate the constraint on
the velocities by 1e-9). The four-bars move as one pendulum of inertia (N + 1)/3 + N, exactly; the model does not show it, and at the
singular poses 2^N branches of motion cross.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.compiling import MODELS, compiled

PUBLISHED = MODELS / "published"
ANDREWS = (
    "1.58107711951537070971193873e+01", "-1.57563710584118394697277528e+01", "4.08222401196458048582823196e-02",
    "-5.34730116342079593770185031e-01", "5.24409965879954069371655800e-01", "5.34730116342079593770185031e-01",
    "1.04808074104193787306851547e+00", "1.13992030225910606419809685e+03", "-1.42437929517754007319602644e+03",
    "1.10329119106185937453273113e+01", "1.92933741050320408316275569e+01", "5.73569914829502453817687863e-01",
    "-1.92933741050320408316275569e+01", "3.23179149249130874990748392e-01",
)  # fmt: skip
GRAVITY = 9.81


def pendulum(loops: int, times: Any) -> Any:
    """x, y, vx, vy of the first corner; shape (4, times). By steps of order 8 that cost nothing."""
    from scipy.integrate import solve_ivp

    inertia, moment = (loops + 1) / 3 + loops, GRAVITY * ((loops + 1) / 2 + loops)
    run = solve_ivp(
        lambda t, y: (y[1], moment / inertia * np.sin(y[0])), (0, times[-1]), (0.0, 1.0), "DOP853", times, rtol=3e-14, atol=1e-15
    )  # fmt: skip
    angle, rate = run.y
    return np.array([np.sin(angle), np.cos(angle), rate * np.cos(angle), -rate * np.sin(angle)])


def corner(result: Any) -> Any:
    return np.array([result[n] for n in ("x", "y", "vx", "vy")])


def fourbars(loops: int, **arguments: Any) -> Any:
    return bondgraph.load(PUBLISHED / "iftomm_A02_N_fourbar.bg").simulate(settings={"N": str(loops)}, **arguments)


@pytest.mark.machine_code
def test_squeezer() -> None:
    found = bondgraph.load(PUBLISHED / "andrews.bg").simulate(rtol=1e-9)
    values = np.array([found.final(f"y{i}") for i in range(1, 15)])
    assert np.abs(values / np.array([float(x) for x in ANDREWS]) - 1).max() < 1e-8


@pytest.mark.machine_code
def test_fourbars_at_a_tight_tolerance() -> None:
    """Ten singular poses in ten seconds."""
    found = fourbars(2, rtol=1e-10, points=41)
    exact = pendulum(2, found.time)
    assert (
        np.abs(exact[:, -1] - (0.3284581114840815, 0.9445185381786010, 1.4230514702069441, -0.4948688454870429)).max()
        < 1e-10
    )
    assert np.abs(corner(found)[:, -1] / exact[:, -1] - 1).max() < 1e-8
    assert np.abs(corner(found) - exact).max() < 1e-7, "at the bottom, where an error of the angle is largest"
    (note,) = found.notes
    assert (
        note.startswith("10 singular poses passed")
        and "0.714356 s" in note
        and "`bars.left[1]`, `bars.left[2]`" in note
    )


@pytest.mark.machine_code
@pytest.mark.parametrize("loops", [10, 40])
def test_many_fourbars_at_a_tight_tolerance(loops: int) -> None:
    found = fourbars(loops, rtol=1e-10, points=2)
    exact = pendulum(loops, found.time)
    assert np.abs(corner(found)[:, -1] / exact[:, -1] - 1).max() < 1e-8
    assert found.notes[0].startswith("10 singular poses passed")


@pytest.mark.machine_code
def test_machine_code_crosses_the_poses_that_the_reference_crosses() -> None:
    native, numpy = (fourbars(2, rtol=1e-8, to=3.0, points=31, energy=True, target=t) for t in ("native", "numpy"))
    assert (native.solver, numpy.solver) == ("Radau IIA 5, native", "Radau IIA 5, numpy")
    assert native.steps == pytest.approx(numpy.steps, rel=0.05)
    assert all(r.notes[0].startswith("3 singular poses passed") for r in (native, numpy))
    assert np.abs(native.values - numpy.values).max() < 1e-7
    assert native.energy is not None and numpy.energy is not None
    assert max(abs(native.energy.residual), abs(numpy.energy.residual)) < 1e-6


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_loose_tolerances_stay_on_the_branch(rtol: float) -> None:
    found = fourbars(2, rtol=rtol, to=3.0, points=61)
    assert np.abs(corner(found) - pendulum(2, found.time)).max() < 300 * rtol


def test_more_loops() -> None:
    found = fourbars(6, rtol=1e-7, to=1.5, points=16)
    assert np.abs(corner(found) - pendulum(6, found.time)).max() < 1e-5
    assert "2 singular poses" in found.notes[0]


@pytest.mark.machine_code
def test_cost_grows_with_the_number_of_loops() -> None:
    """Operations of the rates, entries of the Jacobian, and lines of all code: with N, not with its square."""
    counts = []
    for loops in (4, 8, 12):
        program = compiled(PUBLISHED / "iftomm_A02_N_fourbar.bg", {"N": str(loops)}).program
        counts.append(
            (program.operations, len(program.pattern[0]), len(program.invariant_pattern[0]), program.source.count("\n"))
        )
    for small, middle, large in zip(*counts, strict=True):
        assert large - middle == pytest.approx(middle - small, rel=0.02)


GROUND = 0.999  # the other three bars are of length 1: near the pose in one line, none of them gets there


def independent(to: float) -> Any:
    """The unequal four-bar in the absolute angles of its bars, with the mass matrix by hand and two multipliers (no projection)."""
    from scipy.integrate import solve_ivp

    slopes = np.array([1.0, -1.0, 1.0])  # of the first upright, the second and the coupler in the loop

    def rates(_: float, y: Any) -> Any:
        angles, w = y[:3], y[3:]
        c, s = np.cos(angles), np.sin(angles)
        turn = angles[0] - angles[2]
        mass = np.diag([4 / 3, 1 / 3, 1 / 3])
        mass[0, 2] = mass[2, 0] = 0.5 * np.cos(turn)
        force = -GRAVITY * c * (1.5, 0.5, 0.5) - 0.5 * np.sin(turn) * np.array([w[2] ** 2, 0.0, -(w[0] ** 2)])
        loop = np.array([-slopes * s, slopes * c])
        bent = np.array([-slopes * c, -slopes * s]) @ w**2
        whole = np.block([[mass, loop.T], [loop, np.zeros((2, 2))]])
        return np.concatenate([w, np.linalg.solve(whole, np.concatenate([force, -bent]))[:3]])

    lean = np.arccos((1 - GROUND) / 2)
    start = np.array([np.pi - lean, lean, 0.0])
    w = -1 / np.sin(lean)
    run = solve_ivp(rates, (0, to), (*start, w, w, 2 * np.cos(lean) * w), "DOP853", [to], rtol=1e-13, atol=1e-14)
    angle, rate = run.y[0, -1], run.y[3, -1]
    return np.array([np.cos(angle), np.sin(angle), -rate * np.sin(angle), rate * np.cos(angle)])


UNEQUAL = """
model One {
  constant J = 1 kg*(1 m)^2/12, ground_bar = 0.999 m, lean = 0.5 mm, h = sqrt((1 m)^2 - lean^2), a = acos(lean/(1 m))
  multibody bars : planar {
    gravity = (0, -9.81 [m/s^2])
    body first   { mass = 1 kg, inertia = J, at = (-lean/2, h/2), angle = 180 deg - a }
    body second  { mass = 1 kg, inertia = J, at = (ground_bar + lean/2, h/2), angle = a }
    body coupler { mass = 1 kg, inertia = J, at = (ground_bar/2, h) }
    hinge foot1 : ground to first { at = (0, 0) }
    hinge foot2 : ground to second { at = (ground_bar, 0) }
    hinge left  : first to coupler { at = (-lean, h) }
    hinge right : coupler to second { at = (ground_bar + lean, h) }
    frame corner : first { at = (-lean, h), start x.v = 1 [m/s] }
  }
  output x = bars.corner.x, y = bars.corner.y, vx = bars.corner.x.v, vy = bars.corner.y.v
}
"""


def loaded(folder: Path, text: str) -> Any:
    path = folder / "model.bg"
    path.write_text(text, encoding="utf-8")
    return bondgraph.load(path)


def test_bars_that_are_almost_equal_have_no_singular_pose(tmp_path: Path) -> None:
    """They turn about each other near it, within a fortieth of a turn; nothing is crossed, and the motion is another one."""
    found = loaded(tmp_path, UNEQUAL).simulate(to=2.0, rtol=1e-9, points=3)
    exact = independent(2.0)
    assert np.abs(corner(found)[:, -1] - exact).max() < 2e-7
    assert np.abs(exact - pendulum(1, [2.0])[:, -1]).max() > 1e-2
    assert not found.notes


@pytest.mark.machine_code
@pytest.mark.parametrize("rank", [1e-7, 1e-9, 1e-10])
def test_thresholds_of_rank_change_nothing(rank: float, monkeypatch: pytest.MonkeyPatch) -> None:
    from bondgraph.simulation.constraints import constraints, singular
    from bondgraph.simulation.initialization import assembly

    monkeypatch.setattr(constraints, "RANK", rank)
    monkeypatch.setattr(assembly, "FULL", rank)
    monkeypatch.setattr(singular, "OPEN", rank)
    found = fourbars(2, rtol=1e-8, to=3.0, points=31)
    assert np.abs(corner(found) - pendulum(2, found.time)).max() < 3e-7


@pytest.mark.machine_code
@pytest.mark.parametrize("order", [("upright[i]", "coupler[i]"), ("coupler[i]", "upright[i]")])
def test_the_order_of_declarations_changes_nothing(order: tuple[str, str], tmp_path: Path) -> None:
    """Loops are cut elsewhere; the motion is the same."""
    text = """
model Row {
  constant J = 1 kg*(1 m)^2/12
  multibody bars : planar {
    gravity = (0, -9.81 [m/s^2])
    for i in 1..2 {
      %s
      hinge right[i] : coupler[i] to upright[i]   { at = (i*1 m, 1 m) }
      hinge left[i]  : upright[i-1] to coupler[i] { at = ((i - 1)*1 m, 1 m) }
    }
    body  upright[0] { mass = 1 kg, inertia = J, at = (0, 0.5 m), angle = 90 deg }
    for i in 0..2 {
      hinge foot[2-i] : upright[2-i] to ground { at = ((2 - i)*1 m, 0) }
    }
    frame corner : upright[0] { at = (0, 1 m), start x.v = 1 [m/s] }
  }
  output x = bars.corner.x, y = bars.corner.y, vx = bars.corner.x.v, vy = bars.corner.y.v
}
"""
    bodies = {
        "upright[i]": "body upright[i] { mass = 1 kg, inertia = J, at = (i*1 m, 0.5 m), angle = 90 deg }",
        "coupler[i]": "body coupler[i] { mass = 1 kg, inertia = J, at = ((i - 1/2)*1 m, 1 m) }",
    }
    found = loaded(tmp_path, text % "\n      ".join(bodies[n] for n in order)).simulate(to=3.0, rtol=1e-8, points=31)
    assert np.abs(corner(found) - pendulum(2, found.time)).max() < 3e-7
    assert "singular poses passed" in found.notes[0]


def test_bricard_moves_although_counting_says_it_cannot() -> None:
    """Five hinges in a row, and five constraints of the sixth, one of which follows from the others; energy is kept to 1e-8 J in 10 s."""
    model = bondgraph.load(PUBLISHED / "iftomm_A04_bricard.bg")
    assert (model.certificate.constraints, model.certificate.degrees_of_freedom) == (5, 1)
    (name,) = model.certificate.redundant
    assert name.startswith("ring.j4.")
    found = model.simulate(energy=True, points=21)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-8
    assert found["turn"].max() == pytest.approx(np.pi, abs=1e-3), "it falls, turns over and comes back"
    assert "follows from the others" in found.notes[0] and "mobility 1" in found.notes[0]


def test_certificates_count_what_closes() -> None:
    rows = compiled(PUBLISHED / "iftomm_A02_N_fourbar.bg", {"N": "3"}).certificate
    assert (rows.form, rows.index, rows.constraints, rows.degrees_of_freedom, rows.redundant) == (
        "linear-implicit ODE",
        3,
        6,
        1,
        (),
    )
    squeezer = compiled(PUBLISHED / "andrews.bg").certificate
    assert (squeezer.constraints, squeezer.degrees_of_freedom, squeezer.loops) == (6, 1, ())
    assert squeezer.to_json()["constraints"] == 6
