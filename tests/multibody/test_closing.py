"""Joints of every kind where they close a loop: rates of gaps, accelerations, and forces that do no work, at poses off the drawing.

A state of random coordinates and speeds keeps no constraint; the equations must be consistent there too: gaps change by their rates, rates by
what the multipliers let them accelerate, and the matrix of the multipliers is symmetric, as forces act by the transpose of slopes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running, compiled

PLANE = """
model A {
  multibody m : planar {
    gravity = (0.5 [m/s^2], -9.81 [m/s^2])
    body a { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0.1 m) }
    body b { mass = 2 kg, inertia = 0.3 [kg*m^2], at = (1.2 m, -0.4 m) }
    hinge one : ground to a { at = (0, 0) }
    %s
    frame p : a { at = (0.9 m, 0.3 m) }
    frame q : b { at = (1.1 m, -0.2 m) }
    %s
  }
  output x = m.b.x, y = m.b.y
}
"""
SPACE = """
model A {
  multibody m : spatial {
    gravity = (0, -9.81 [m/s^2], 1 [m/s^2])
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (0.5 m, 0.1 m, 0) }
    body b { mass = 2 kg, inertia = (0.3 [kg*m^2], 0.2 [kg*m^2], 0.25 [kg*m^2]), at = (1.2 m, -0.4 m, 0.3 m) }
    ball one : ground to a { at = (0, 0, 0) }
    frame p : a { at = (0.9 m, 0.3 m, 0.1 m) }
    frame q : b { at = (1.1 m, -0.2 m, 0.2 m) }
    %s
  }
  output x = m.b.x, y = m.b.y, z = m.b.z
}
"""
IN_PLANE = {
    "hinge": ("hinge two : ground to b { at = (2 m, 0) }", "hinge j : a to b { at = (1 m, -0.1 m) }"),
    "slide": ("hinge two : ground to b { at = (2 m, 0) }", "slide j : a to b { along = 30 deg, at = (1 m, -0.1 m) }"),
    "rod": ("hinge two : ground to b { at = (2 m, 0) }", "rod j : p to q"),
    "gear": ("hinge two : ground to b { at = (2 m, 0) }", "gear j : one to two { ratio = -2 }"),
    "rack": ("slide two : ground to b { along = 0 }", "rack j : one to two { radius = 20 mm }"),
}
AXIS = "(0.3, 1, 0.5)"
IN_SPACE = {
    "hinge": f"hinge j : a to b {{ at = (1 m, 0, 0.1 m), about = {AXIS} }}",
    "slide": f"slide j : a to b {{ at = (1 m, 0, 0.1 m), along = {AXIS} }}",
    "cylinder": f"cylinder j : a to b {{ at = (1 m, 0, 0.1 m), along = {AXIS} }}",
    "ball": "ball j : a to b { at = (1 m, 0, 0.1 m) }",
    "universal": f"universal j : a to b {{ at = (1 m, 0, 0.1 m), about = {AXIS}, then = (1, 0, -0.6) }}",
    "planar": "planar j : a to b { at = (1 m, 0, 0.1 m), turn = (0.3, 0.4, 0) }",
    "rod": "rod j : p to q",
}
TWO = "ball two : ground to b { at = (2 m, 0, 0) }"
LEANING = """
model A {
  multibody m : spatial {
    gravity = (0, -9.81 [m/s^2], 0)
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (0.5 m, 0, 0) }
    body b { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (1 m, -0.5 m, 0) }
    planar table : b to ground { at = (1 m, -1 m, 0.2 m), turn = (0.3, 0.2, 0) }
    ball one : ground to a { at = (0, 0, 0) }
    ball j : a to b { at = (1 m, 0, 0) }
  }
  output x = m.b.x, y = m.b.y, z = m.b.z
}
"""  # gravity has a part across the plane of b
CASES = {
    "ball in space, on a leaning plane": LEANING,
    **{f"{kind} in the plane": PLANE % text for kind, text in IN_PLANE.items()},
    **{f"{kind} in space": SPACE % f"{TWO}\n    {text}" for kind, text in IN_SPACE.items()},
}
LOST = {"hinge": 5, "slide": 5, "cylinder": 4, "ball": 3, "universal": 4, "planar": 3, "rod": 1}


class Anywhere:
    """A program at a random state, quaternions of length one."""

    def __init__(self, text: str) -> None:
        running = Running(compiled(text, everything=True))
        self.program, self.fixed = running.program, (running.inputs, running.constants, np.zeros(0))
        random = np.random.default_rng(3)
        self.count = len(self.program.states.names)
        self.state = running.start + 0.3 * random.normal(size=len(running.start))
        names = self.program.states.names
        for i, name in enumerate(names):
            if name.endswith("attitude.w"):
                self.state[i : i + 4] /= np.linalg.norm(self.state[i : i + 4])

    def of(self, function: Any, state: Any) -> Any:
        return np.asarray(function(0.0, state, *self.fixed))

    def along(self, function: Any) -> Any:
        """The rate of a function of the state, along the motion, by central differences."""
        rates = self.of(self.program.derivative, self.state)
        step = np.zeros(len(self.state))
        step[: self.count] = 1e-6 * rates[: self.count]
        return (self.of(function, self.state + step) - self.of(function, self.state - step)) / 2e-6


@pytest.mark.parametrize("name", CASES)
def test_gaps_rates_and_accelerations_belong_together(name: str) -> None:
    at = Anywhere(CASES[name])
    program = at.program
    values, changes = at.of(program.invariant, at.state), at.along(program.invariant)
    bound = [(i, rate, m) for i, (rate, m) in enumerate(zip(program.rates, program.multipliers, strict=True)) if m >= 0]
    kind, _, where = name.partition(" in ")
    if where.startswith("space"):
        assert len(bound) == LOST[kind]
    residuals = at.of(program.derivative, at.state)[at.count :]
    for gap, rate, multiplier in bound:
        assert changes[gap] == pytest.approx(values[rate], rel=1e-6, abs=1e-7)
        assert changes[rate] == pytest.approx(residuals[multiplier], rel=1e-5, abs=1e-5)
    norms = [i for i, m in enumerate(program.multipliers) if m < 0]
    assert np.abs(changes[norms]).max(initial=0.0) < 1e-8


@pytest.mark.parametrize("name", CASES)
def test_multipliers_do_no_work_of_their_own(name: str) -> None:
    """Their matrix is symmetric and positive, and what is solved for in the program makes all residuals vanish."""
    at = Anywhere(CASES[name])
    matrix = at.of(at.program.jacobian, at.state)[at.count :, at.count :]
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix).min() > 0
    solved = at.of(at.program.solved, at.state)
    state = at.state.copy()
    state[at.count :] = solved[len(at.state) :]
    rates = at.of(at.program.derivative, state)
    assert np.abs(rates[at.count :]).max() < 1e-9 * max(1.0, np.abs(state[at.count :]).max())
    assert np.abs(rates[: at.count] - solved[: at.count]).max() < 1e-9 * np.abs(rates).max()


def loaded(folder: Path, text: str) -> Any:
    path = folder / "model.bg"
    path.write_text(text, encoding="utf-8")
    return bondgraph.load(path)


@pytest.mark.parametrize("name", CASES)
def test_energy_is_kept(name: str, tmp_path: Path) -> None:
    found = loaded(tmp_path, CASES[name]).simulate(to=0.3, rtol=1e-8, points=4, energy=True)
    assert found.energy is not None
    assert abs(found.energy.residual) < 2e-6
