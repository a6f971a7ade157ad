"""Coordinates of joints that close a loop: read, driven by springs and losses, and counted over whole turns, as in the tree.

The author picks no joint that closes a loop: what joints are decides it. So each mechanism is compiled twice, as it is, and with its loop cut at a joint that a test
names; nothing else may differ.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.multibody.tree import _Growth

TEXT = """
model A {
  multibody m : spatial {
    gravity = (0, -9.81 [m/s^2], 1 [m/s^2])
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (0.5 m, 0.1 m, 0) }
    body b { mass = 2 kg, inertia = (0.3 [kg*m^2], 0.2 [kg*m^2], 0.25 [kg*m^2]), at = (1.2 m, -0.4 m, 0.3 m) }
    %s
  }
  R one(rx, ry, rz) : rx.M = 0.1 [N*m*s]*rx.omega, ry.M = 0.1 [N*m*s]*ry.omega, rz.M = 0.1 [N*m*s]*rz.omega
  R two(rx, ry, rz) : rx.M = 0.2 [N*m*s]*rx.omega, ry.M = 0.1 [N*m*s]*ry.omega, rz.M = 0.1 [N*m*s]*rz.omega
  m.one => one
  m.two => two
  %s
  output x = m.b.x, y = m.b.y, z = m.b.z, f = m.j.reaction.x, t = m.j.reaction.ry, %s
}
"""
BALLS = ("ball one : ground to a { at = (0, 0, 0) }", "ball two : ground to b { at = (2 m, 0, 0) }")
AXIS = "at = (1 m, 0, 0.1 m), along = (0.3, 1, 0.5)"
TURNING = AXIS.replace("along", "about")
JOINTS = {
    "cylinder": (AXIS, ("x", "phi")), "universal": (f"{TURNING}, then = (1, 0.2, -0.6)", ("phi1", "phi2")),
    "planar": ("at = (1 m, 0, 0.1 m), turn = (0.3, 0.4, 0)", ("x", "y", "phi")), "ball": ("at = (1 m, 0, 0.1 m)", ("rx", "ry", "rz")),
}  # fmt: skip


def loaded(folder: Path, text: str) -> Any:
    path = folder / "model.bg"
    path.write_text(text, encoding="utf-8")
    return bondgraph.load(path)


def cut_at(joint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have loops cut at a joint, as if all others had better not close one."""
    order = _Growth._order

    def others_first(growth: Any, *arguments: Any) -> list[str]:
        names = order(growth, *arguments)
        growth.kept_in = ({name for name in names if name != joint},)
        return names

    monkeypatch.setattr(_Growth, "_order", others_first)


def written(kind: str, closes: bool) -> str:
    """Springs and losses on all freedoms of the joint. A text for each cut, as what is compiled is cached by the text."""
    where, letters = JOINTS[kind]
    joints = [f"{kind} j : a to b {{ {where} }}", *BALLS]
    lines = [f"# j {'closes' if closes else 'leads'} a loop"]
    for c in letters:
        law = "F = 40 [N/m]*x + 900 [N/m^3]*x^3" if c in "xy" else "M = 4 [N*m]*phi + 2 [N*m]*phi^3"
        loss = "F = 3 [N*s/m]*v" if c in "xy" else "M = 0.3 [N*m*s]*omega"
        lines += [f"C c_{c} : {law}", f"R r_{c} : {loss}", f"m.j.{c} -> c_{c}", f"m.j.{c} -> r_{c}"]
    outputs = ", ".join(f"q{k} = m.j.{c}" for k, c in enumerate(letters))
    return TEXT % ("\n    ".join(joints), "\n  ".join(lines), outputs)


@pytest.mark.few(1)
@pytest.mark.machine_code
@pytest.mark.parametrize("kind", JOINTS)
def test_any_joint_may_be_the_one_that_closes(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leads = written(kind, False)
    second = loaded(tmp_path, leads).simulate(to=0.3, rtol=1e-8, points=4, energy=True)
    assert "j" not in closing(leads, tmp_path)
    cut_at("j", monkeypatch)
    closes = written(kind, True)
    first = loaded(tmp_path, closes).simulate(to=0.3, rtol=1e-8, points=4, energy=True)
    assert closing(closes, tmp_path) == {"j"}
    names = ["x", "y", "z", "f", "t", *(f"q{k}" for k in range(len(JOINTS[kind][1])))]
    for name in names:
        assert np.abs(first[name] - second[name]).max() < 1e-6 * max(1.0, np.abs(second[name]).max()), name
    assert max(np.abs(second[n]).max() for n in names[5:]) > 0.02, "the joint moves"
    for run in (first, second):
        assert run.energy is not None
        assert abs(run.energy.residual) < 1e-7


def closing(text: str, folder: Path) -> set[str]:
    """The joints that close loops, by the names of their multipliers."""
    names = loaded(folder, text).compilation().program.unknowns.names
    return {n.split(".")[1] for n in names if n.endswith("multiplier")}


CRANK = """
model Crank {
  multibody space : spatial {
    body crank { mass = 1 kg, inertia = 0.01 [kg*m^2]*(1, 1, 1) }
    body rod { mass = 1 kg, inertia = 0.01 [kg*m^2]*(1, 1, 1), at = (0.25 m, 0.05 m, 0) }
    body slider { mass = 1 kg, inertia = 0.01 [kg*m^2]*(1, 1, 1), at = (0.5 m, 0, 0) }
    %s
  }
  output x = space.slider.x, %s
}
"""
MAIN = "hinge main : crank to ground { at = (0, 0, 0), about = (0, 0.2, 1), start phi = -1, start phi.omega = -30 [1/s], rest phi = 0.5 }"
REST = """ball big : crank to rod { at = (0, 0.1 m, 0) }
    universal eye : rod to slider { at = (0.5 m, 0, 0), about = (0, 0, 1), then = (0, 1, 0) }
    slide way : ground to slider { along = (1, 0, 0) }"""


@pytest.mark.machine_code
def test_a_closing_hinge_counts_its_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A crank with its hinge drawn from it; all joints are read, so any may close the loop."""
    every = "phi = space.main.phi, tilt = space.eye.phi1, r = space.big.rx, s = space.way.x"
    closes = CRANK % (f"{REST}\n    {MAIN}", every)
    leads = CRANK % (f"{MAIN}\n    {REST}", "phi = space.main.phi, tilt = space.eye.phi1")
    assert "main" not in closing(leads, tmp_path)
    second = loaded(tmp_path, leads).simulate(to=1.0, rtol=1e-9, points=50)
    cut_at("main", monkeypatch)
    closes += "# main closes a loop\n"
    assert closing(closes, tmp_path) == {"main"}
    first = loaded(tmp_path, closes).simulate(to=1.0, rtol=1e-9, points=50)
    assert second["phi"][0] == pytest.approx(-1.0, abs=1e-12)
    assert np.ptp(second["phi"]) > 3 * 2 * np.pi
    for name in ("phi", "x", "tilt"):
        assert np.abs(first[name] - second[name]).max() < 1e-5


def test_a_screw_that_closes_a_loop_lifts_its_nut(tmp_path: Path) -> None:
    """A spindle turned by a torque, its nut on a rail, friction in all three joints: over many turns, against a formula."""
    text = """
model Jack {
  multibody press : spatial {
    gravity = (0, 0, -9.81 [m/s^2])
    body spindle { mass = 1 kg, inertia = (0.02 [kg*m^2], 0.02 [kg*m^2], 0.01 [kg*m^2]) }
    body nut { mass = 3 kg, inertia = (0.02 [kg*m^2], 0.02 [kg*m^2], 0.01 [kg*m^2]), at = (0.1 m, 0, 0.2 m) }
    hinge axle : ground to spindle { about = (0, 0, 1) }
    slide rail : ground to nut { along = (0, 0, 1), at = (0.1 m, 0, 0) }
    screw thread : spindle to nut { along = (0, 0, 1), at = (0, 0, 0.2 m), lead = 5 mm }
  }
  Se motor : M = 0.2 [N*m]
  R bearing, flank : M = 1e-3 [N*m*s]*omega
  R guide : F = 2 [N*s/m]*v
  motor -> press.axle -> bearing
  press.rail -> guide
  press.thread -> flank
  output z = press.rail.x, turns = press.axle.phi, thread = press.thread.phi
}
"""
    found = loaded(tmp_path, text).simulate(to=5.0, rtol=1e-9, points=5)
    assert closing(text, tmp_path) == {"thread"}
    lead = 5e-3 / (2 * np.pi)  # the nut goes down as the spindle turns forward
    inertia, loss, torque = 0.01 + 3 * lead**2, 2e-3 + 2 * lead**2, 0.2 + 3 * 9.81 * lead
    expected = torque / loss * (5.0 - inertia / loss * (1 - np.exp(-5.0 * loss / inertia)))
    assert found.final("turns") == pytest.approx(expected, rel=1e-7)
    assert found.final("turns") > 30 * 2 * np.pi
    assert np.abs(found["z"] + lead * found["turns"]).max() < 1e-13
    assert np.abs(found["thread"] + found["turns"]).max() < 1e-9


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_loops_in_space_stay_closed_at_every_reported_instant(rtol: float, tmp_path: Path) -> None:
    """Positions and velocities of the common point of crank and rod, and the coordinates of their joint, between steps as well."""
    shared = "frame p : crank { at = (0, 0.1 m, 0) }; frame q : rod { at = (0, 0.1 m, 0) }"
    gaps = ", ".join(f"g{c} = space.p.{c} - space.q.{c}, s{c} = space.p.{c}.v - space.q.{c}.v" for c in "xyz")
    text = CRANK % (f"{MAIN}\n    {REST.replace('ball big', f'{shared}; ball big')}", gaps)
    assert closing(text, tmp_path) & {"big", "eye"}
    found = loaded(tmp_path, text).simulate(to=0.3, rtol=rtol, points=203)
    assert np.abs([found[f"g{c}"] for c in "xyz"]).max() < 1e-12 * 0.5
    assert np.abs([found[f"s{c}"] for c in "xyz"]).max() < 1e-12 * 0.5 * 30
