"""The bicycle of Meijaard, Papadopoulos, Ruina and Schwab, Proc. R. Soc. A 463, 2007: its modes while it rolls.

In `models/published/whipple.bg` the wheels roll without slip. Before there were wheels they rolled on stiff contacts, which moves eigenvalues by some 1e-5. The frame is the first body, so that the wheels' angles are those of hinges, on
which nothing depends: rolling is a steady motion. The witness are the paper's linear equations with its coefficients (table 1 and equations 5.1).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.model import Model

WHIPPLE = Path(__file__).parents[2] / "models" / "published" / "whipple.bg"
AS_LISTED = Path(__file__).parent.parent / "acceptance" / "defects" / "whipple_modes_rounding.bg"
MASSES = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
DAMPING = np.array([[0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
STIFFNESS = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
BY_SPEED = np.array([[0, 76.59734589573222], [0, 2.65431523794604]])


def eigenvalues(v: float) -> np.ndarray:
    """Of lean and steer at a forward speed (m/s), in 1/s."""
    rates = [
        -np.linalg.solve(MASSES, 9.81 * STIFFNESS + v**2 * BY_SPEED),
        -np.linalg.solve(MASSES, v * DAMPING),
    ]
    return np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], rates]))


def bicycle(frame_first: bool = True, wheel: str = "") -> Model:
    lines = AS_LISTED.read_text(encoding="utf-8").split("\n")
    rear, frame = (next(i for i, line in enumerate(lines) if f"body {name}" in line) for name in ("rear", "frame_"))
    if frame_first:
        start = ", start x.v = v, start rx.omega = kick"
        assert start in lines[rear]
        lines[rear] = lines[rear].replace(start, "")
        lines[frame] = lines[frame].replace(" }", f"{start} }}")
        lines[rear], lines[frame] = lines[frame], lines[rear]
    else:
        lines[rear] = lines[rear].replace("start rx.omega = kick", f"start rx.omega = kick{wheel}")
    return bondgraph.load("\n".join(lines))


@pytest.fixture(scope="module")
def rolling() -> Model:
    return bicycle()


PRINTED = {  # table 2 of the paper, in 1/s; of pairs the one above the real axis
    0.0: (-5.53094371765393, -3.13164324790656, 3.13164324790656, 5.53094371765393),
    2.0: (-8.67387984831735, -3.07158645641514, 2.68234517512745 + 1.68066296590675j),
    5.0: (-14.07838969279822, -0.77534188219585 + 4.46486771378823j, -0.32286642900409),
}


def test_the_witness_has_the_paper_s_numbers() -> None:
    for speed, values in PRINTED.items():
        found = eigenvalues(speed)
        assert all(np.abs(found - value).min() < 5e-14 * abs(value) + 5e-15 for value in values)


@pytest.fixture(scope="module")
def wheels() -> Model:
    return bondgraph.load(WHIPPLE)


@pytest.mark.parametrize("v", [0.0, 2.0, 5.0, 4.3, 9.5])
def test_modes_of_the_bicycle_that_rolls_without_slip(wheels: Model, v: float) -> None:
    """Four that the paper prints, and as many zeros as there are places and directions in which it may ride, with its speed."""
    modes = wheels.modes(None, settings={"v": f"{v} [m/s]"}, state="start")
    found = np.array([m.eigenvalue for m in modes])
    for value in PRINTED.get(v, eigenvalues(v)):
        if np.imag(value) >= 0:
            assert np.abs(found - value).min() < 1e-12 * max(abs(value), 1.0), value
    assert sum(1 + bool(x.imag) for x in found if abs(x) < 1e-6) == 6
    assert modes.note == ""


def test_a_knock_dies_away_as_the_linear_equations_say(wheels: Model) -> None:
    """Small, over 3 s, by the paper's equations of lean and steer, whose axis points down."""
    ride = wheels.simulate(settings={"knock": "1e-4 [1/s]"}, to=3.0, rtol=1e-9, points=31, outputs=wheels.outputs)
    speed = 5.0
    rates = np.hstack([
        -np.linalg.solve(MASSES, 9.81 * STIFFNESS + speed**2 * BY_SPEED), -np.linalg.solve(MASSES, speed * DAMPING),
    ])  # fmt: skip
    values, vectors = np.linalg.eig(np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), rates]))
    shares = np.linalg.solve(vectors, [0, 0, ride["lean_rate"][0], -ride["steer_rate"][0]])
    exact = np.real(vectors @ (shares[:, None] * np.exp(np.outer(values, ride.time))))
    for row, (name, sign) in enumerate((("lean", 1), ("steer", -1))):
        assert np.abs(sign * ride[name] - exact[row]).max() < 1e-6 * np.abs(exact[row]).max()


@pytest.mark.few(6)
@pytest.mark.parametrize("v", [0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 4.6, 5.0, 6.0, 8.0, 10.0])
def test_modes_of_the_rolling_bicycle(rolling: Model, v: float) -> None:
    modes = rolling.modes(settings={"v": f"{v} [m/s]"}, state="start")
    found = np.array([m.eigenvalue for m in modes])
    for value in eigenvalues(v):
        if value.imag >= 0:
            assert np.abs(found - value).min() < 1e-4 * max(abs(value), 1.0), value
    assert modes.note == "" and "note" not in modes.to_json()


@pytest.mark.parametrize("v", [0.5, 4.6, 10.0])
def test_rolling_is_no_rest_and_the_advice_works(rolling: Model, v: float) -> None:
    """A search for a rest would stop the bicycle, and tell the modes of one that stands."""
    for ask in (rolling.equilibrium, rolling.modes, rolling.linearize):
        with pytest.raises(RunFailed, match=r"steady motion, in which `bike.h[rf].phi` goes on .*--at start"):
            ask(settings={"v": f"{v} [m/s]"})


@pytest.mark.parametrize("wheel", ["", ", start ry.omega = v/(0.3 m)"], ids=["as listed", "wheel spins"])
def test_what_turns_with_a_wheel_changes(wheel: str) -> None:
    """The coordinates of the first body turn with it: there slopes at one instant are no modes of the motion, which is told."""
    made = bicycle(frame_first=False, wheel=wheel)
    with pytest.raises(RunFailed, match="no equilibrium was found"):
        made.modes(settings={"v": "4.6 [m/s]"})
    modes = made.modes(settings={"v": "4.6 [m/s]"}, state="start")
    assert "neither at rest nor in a steady motion" in modes.note
    assert modes.note in modes.summary() and modes.to_json()["note"] == modes.note


TURNING = """model A {{
  parameter r: N*m*s = {r}
  1 shaft : rotation
  I rotor : p = 2 [kg*m^2]*omega {{ start omega = {omega} }}
  signal angle = integral(shaft.omega, 0)
  MSe drive : M = 1 [N*m]*(cos(angle)^2 + sin(angle)^2)
  R air : M = r*omega
  drive -> shaft -> rotor, air
  output w = shaft.omega, a = angle
}}"""


@pytest.mark.parametrize("r", [1e-6, 0.25, 1e5])
@pytest.mark.parametrize("share", [1.0, 0.9])
def test_a_rotor_whose_angle_a_law_reads_for_nothing(r: float, share: float) -> None:
    made = bondgraph.load(TURNING.format(r=r, omega=f"{share / r!r} [1/s]"))
    with pytest.raises(RunFailed, match="steady motion" if share == 1 else "no equilibrium was found"):
        made.equilibrium()
    modes = made.modes(state="start")
    assert np.abs(np.array([m.eigenvalue for m in modes]) + r / 2).min() < 1e-9 * r
    assert bool(modes.note) is (share != 1)
