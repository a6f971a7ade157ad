"""Two slides and a hinge over bodies without mass, in loops: one joint, without states and constraints.

Each mechanism against itself with all joints in the tree or closing loops (the same text, as if no chain were found), against the
second opinion, and the thesis's manipulator as it was built against the one with `free` joints.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.multibody import mechanics
from tests.compiling import MODELS, compiled
from tests.multibody.test_counts import operations
from tests.second_opinion.comparison import compared

TEXT = """
model Chained {
  parameter tilt = 75 deg, lean = 20 deg, little = 0 kg
  multibody m : planar {
    gravity = (0.3 [m/s^2], -9.81 [m/s^2])
    body p { mass = 2 kg, inertia = 0.2 [kg*m^2], at = (1 m, 0) }
    body q { QDATA, at = (1.5 m, 1 m), QSTART }
    hinge top : ground to p { at = (0, 0), start phi.omega = 0.5 [rad/s] }
    body s { SDATA at = (0.7 m, 0.3 m), angle = 10 deg }
    body t { at = (0.9 m, 0.4 m) }
    frame edge : s { at = (0.75 m, 0.2 m) }
    JOINTS
  }
  BONDS
  output x = m.p.x, phi = m.p.phi, qx = m.q.x, qphi = m.q.phi
  output ax = m.a.x, av = m.a.x.v, bx = m.b.x, bv = m.b.x.v, c = m.c.phi, w = m.c.phi.omega
  output sx = m.s.x, sy = m.s.y, sphi = m.s.phi, sv = m.s.y.v, tx = m.t.x, tphi = m.t.phi, ex = m.edge.x, ev = m.edge.x.v
  READINGS
}
"""
REACTIONS = "output " + ", ".join(f"r{j}{c} = m.{j}.reaction.{c}" for j in "abc" for c in ("x", "y", "phi"))
GUIDED = "slide far : ground to q { along = 30 deg }"
BONDS = {
    "a": "C ka : F = 40 [N/m]*x; R ra : F = 3 [N*s/m]*v; Se fa : F = 2 N*sin(5 [rad/s]*time); m.a -> ka; m.a -> ra; fa -> m.a",
    "b": "C kb : F = 70 [N/m]*x + 500 [N/m^3]*x^3; R rb : F = 1 [N*s/m]*v; m.b -> kb; m.b -> rb",
    "c": "C kc : M = 3 [N*m]*phi; R rc : M = 0.1 [N*m*s]*omega; m.c -> kc; m.c -> rc",
}
ATTRIBUTES = {
    "a": "along = lean0, at = (0.6 m, 0.1 m)",
    "b": "along = tilt0, at = (0.6 m, 0.25 m)",
    "c": "at = (0.8 m, 0.35 m)",
}
SECOND = """
    body u; body w
    slide d : ground to u { along = 15 deg }
    slide e : u to w { along = 100 deg }
    hinge f : w to q { at = (1.9 m, 1.2 m) }"""


def chain(order: str = "abc", backward: str = "", ends: str = "p q", lean: str = "20 deg", tilt: str = "75 deg", **more: str) -> str:  # fmt: skip
    """The joints a, b (slides) and c (a hinge) in an order, some drawn from their second body; `more`: further attributes."""
    first, last = ends.split()
    lines = []
    for name, near, far in zip(order, (first, "s", "t"), ("s", "t", last), strict=True):
        near, far = (far, near) if name in backward else (near, far)
        given = ATTRIBUTES[name].replace("lean0", lean).replace("tilt0", tilt) + more.get(name, "")
        lines.append(f"{'hinge' if name == 'c' else 'slide'} {name} : {near} to {far} {{ {given} }}")
    return "\n    ".join(lines)


def text(joints: str, bonds: str = "abc", readings: str = REACTIONS, more: str = "", **data: str) -> str:
    given = {
        "JOINTS": joints, "BONDS": "\n  ".join([*("\n  ".join(BONDS[b].split("; ")) for b in bonds), more]), "READINGS": readings,
        "QDATA": data.get("q", "mass = 1 kg, inertia = 0.1 [kg*m^2]"), "QSTART": data.get("start", ""), "SDATA": data.get("s", ""),
    }  # fmt: skip
    found = TEXT
    for word, value in given.items():
        found = found.replace(word, value)
    return found.replace(", }", " }")


SLIDING = "\n    slide far : ground to q { along = 30 deg, start x.v = 0.1 [m/s] }"
ALONE = "start x.v = 0.1 [m/s], start y.v = -0.05 [m/s], start phi.omega = 0.3 [rad/s]"
RESTS = {"a": ", rest = 0.1 m", "b": ", rest = -0.05 m", "c": ", rest = 10 deg, limits = (-200 deg, 200 deg)"}
SWITCHED = "mode on = true\n  1 clamp { active = on }\n  R slip : F = 20 [N*s/m]*v\n  m.a -> clamp -> slip\n  when time > 0.2 s { on = false }"
STOP = "Stops st { low = -20 mm, high = 2 mm, k = 4e4 [N/m], r = 10 [N*s/m] }\n  m.a -> st.ends"
TWO = "C kd : F = 30 [N/m]*x\n  C kf : M = 2 [N*m]*phi\n  m.d -> kd\n  m.f -> kf"
WAYS = [("abc", ""), ("abc", "abc"), ("bac", "ac"), ("cab", "b"), ("cba", "abc"), ("cba", "")]
CASES = {
    **{f"{order}, {backward or 'none'} from its second body": text(chain(order, backward) + SLIDING) for order, backward in WAYS},
    "at right angles": text(chain(lean="0 deg", tilt="90 deg") + SLIDING),
    "at right angles, turned": text(chain(lean="220 deg", tilt="130 deg") + SLIDING),
    "to the ground": text(chain(ends="p ground") + SLIDING),
    "from the ground, hinge first": text(chain("cab", ends="ground p") + SLIDING),
    "readings in the drawing, limits": text(chain(**RESTS) + SLIDING),
    "without bonds": text(chain() + SLIDING, ""),
    "a bond on one joint": text(chain() + SLIDING, "b"),
    "a hinge that reads much": text(chain(c=", rest = 270 deg") + SLIDING),
    "a hinge that turns by more than half a turn": text(chain() + SLIDING, "ab").replace("0.5 [rad/s]", "14 [rad/s]"),
    "a law with a jump": text(chain() + SLIDING, "bc", more="R sa : F = 0.5 N*sign(v - 10 [m/s])\n  m.a -> sa"),
    "an inertia on a slide of it": text(chain() + SLIDING, "bc", more="I mass : v = p/(0.5 kg)\n  m.a -> mass"),
    "a stop on a slide of it": f"import Stops from mechanics\n{text(chain() + SLIDING, 'bc', more=STOP)}",
    "to a body welded to another": text(chain(ends="p u") + SLIDING + "\n    body u\n    weld j : q to u { at = (1 m, 1 m) }"),
    "two chains hold a body": text(chain() + SECOND, more=TWO, start=ALONE),
    "two chains hold a point mass": text(
        chain(c="") + SECOND.replace("1.9 m, 1.2 m", "1.5 m, 1 m"), "ab", more=TWO.split("\n  C kf")[0] + "\n  m.d -> kd", q="mass = 1 kg",
        start=ALONE,
    ).replace("0.8 m, 0.35 m", "1.5 m, 1 m"),
}  # fmt: skip


def loaded(folder: Path, written: str) -> Any:
    path = folder / "model.bg"
    path.write_text(written, encoding="utf-8")
    return bondgraph.load(path)


def as_written(written: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The model with all joints in the tree or closing loops. Another text, as what is compiled is cached by the text."""
    monkeypatch.setattr(mechanics, "planar_chains", lambda *_: ())
    return loaded(folder, f"# joints as they are written\n{written}")


def size(model: Any) -> tuple[int, int]:
    """Numbers of states and of constraints."""
    return len(model.certificate.states), model.certificate.constraints


@pytest.mark.few(5)
@pytest.mark.machine_code
@pytest.mark.parametrize("name", CASES)
def test_a_chain_moves_as_its_joints_do(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four states and two constraints less for each loop; all readings the same, also those of reactions and of bodies between."""
    model = loaded(tmp_path, CASES[name])
    sizes = [size(model)]
    runs = [model.simulate(to=0.4, rtol=1e-11, points=4, energy=True)]
    plain = as_written(CASES[name], tmp_path, monkeypatch)
    sizes.append(size(plain))
    runs.append(plain.simulate(to=0.4, rtol=1e-11, points=4, energy=True))
    assert sizes[1] == (sizes[0][0] + 4, sizes[0][1] + 2)
    assert sizes[0][1] == 0
    outputs = [c for c in runs[0].names if c != "time"]
    for output in outputs:
        assert np.abs(runs[0][output] - runs[1][output]).max() < 1e-10 * max(1.0, np.abs(runs[1][output]).max()), output
    assert len(outputs) > 24
    assert max(np.ptp(runs[0][o]) for o in ("ax", "bx", "c")) > 0.02, "the joints move"
    assert all(abs(run.energy.residual) < 1e-10 for run in runs)


@pytest.mark.parametrize("name", ["cab, b from its second body", "two chains hold a body"])
def test_a_chain_by_the_interpreter(name: str, tmp_path: Path) -> None:
    model = loaded(tmp_path, CASES[name])
    runs = [model.simulate(to=0.1, rtol=1e-10, points=3, target=target) for target in ("numpy", None)]
    assert all(np.abs(runs[0][o] - runs[1][o]).max() < 1e-9 for o in ("ax", "bx", "c", "sx", "raphi", "rbx", "rcy"))


@pytest.mark.machine_code
@pytest.mark.parametrize("solver", ["explicit", "radau", "radau13", "rodas"])
def test_a_chain_by_each_solver(solver: str, tmp_path: Path) -> None:
    model = loaded(tmp_path, CASES["abc, none from its second body"])
    runs = [model.simulate(to=0.2, rtol=1e-8, points=3, **given) for given in ({"solver": solver}, {})]
    assert all(np.abs(runs[0][o] - runs[1][o]).max() < 1e-6 for o in ("ax", "bx", "c", "sx"))


@pytest.mark.machine_code
def test_a_chain_is_the_limit_of_small_masses(tmp_path: Path) -> None:
    """Bodies between with less and less mass, which are no chain: what is left goes down with the mass."""
    little = [text(chain() + SLIDING, s=f"mass = {m} kg, inertia = {m} [kg*m^2],") for m in (0.01, 0.001)]
    runs = [loaded(tmp_path, w).simulate(to=0.3, rtol=1e-10, points=4) for w in (*little, text(chain() + SLIDING))]
    assert [r.certificate.constraints for r in runs] == [2, 2, 0]
    for output in ("x", "qx", "ax", "bx", "c"):
        far, near = (np.abs(run[output] - runs[2][output]).max() for run in runs[:2])
        assert 1e-6 < far < 5e-3
        assert near == pytest.approx(far / 10, rel=0.1)


@pytest.mark.machine_code
def test_an_event_moves_only_what_it_sets(tmp_path: Path) -> None:
    """A chain without mass passes on no jump of a rate: the body beyond keeps its own, and the slides take the difference."""
    event = "when time > 0.2 s { m.p.phi.omega = 2 [rad/s] }\n  output qv = m.q.x.v, omega = m.p.phi.omega"
    run = loaded(tmp_path, text(chain() + SLIDING, more=event)).simulate(to=0.2001, rtol=1e-9, points=2002)
    jumps = [np.abs(np.diff(run[o])).max() for o in ("omega", "qv", "av")]
    assert jumps[0] > 1
    assert jumps[1] < 0.01
    assert jumps[2] > 0.1


# order, backward, joints with bonds, joint of which the reaction is read
OPINIONS = [
    ("abc", "", "bc", "a"),
    ("abc", "ac", "ac", "b"),
    ("abc", "b", "ab", "b"),
    ("cba", "", "bc", "c"),
    ("cab", "abc", "ab", "a"),
]


@pytest.mark.parametrize(("order", "backward", "bonds", "read"), OPINIONS)
def test_a_chain_has_a_second_opinion(order: str, backward: str, bonds: str, read: str) -> None:
    """Absolute coordinates, and each joint with its constraints."""
    reactions = ", ".join(f"r{c} = m.{read}.reaction.{c}" for c in ("x", "y", "phi"))
    verdict = compared(text(chain(order, backward) + SLIDING, bonds, f"output {reactions}"), 0.2)
    assert verdict.kind == "agreed", verdict.words


# text, and settings: outside of the form, and left as they are
OUTSIDE = {
    "a slide on each side of the hinge": (text(chain("acb") + SLIDING), {}),
    "an angle between the slides that a run may change": (text(chain(tilt="tilt") + SLIDING), {}),
    "two angles that a run may change": (text(chain(lean="lean", tilt="tilt") + SLIDING), {"lean": "5 [deg]", "tilt": "160 [deg]"}),
    "slides nearly parallel": (text(chain(tilt="20.1 deg") + SLIDING), {}),
    "a direction that a run may change": (text(chain(lean="0 deg", tilt="max(tilt, 75 deg)") + SLIDING), {"tilt": "85 [deg]"}),
    "both directions of one parameter": (text(chain(lean="tilt", tilt="tilt + 60 deg") + SLIDING), {"tilt": "-75 [deg]"}),
    "a start of a joint": (text(chain(a=", start x = 0.05 m") + SLIDING), {}),
    "a start of a body between": (text(chain() + SLIDING).replace("angle = 10 deg }", "angle = 10 deg, start x = 0.72 m }"), {}),
    "a start of a frame between": (text(chain() + SLIDING).replace("at = (0.75 m, 0.2 m)", "at = (0.75 m, 0.2 m), start x = 0.77 m"), {}),
    "a mass between": (text(chain() + SLIDING, s="mass = 0.1 kg,"), {}),
    "a mass between, that the run gives": (text(chain() + SLIDING, s="mass = little,"), {"little": "0.1 [kg]"}),
    "a force on a body between": (text(chain() + SLIDING, more="Se fs : F = 1 N\n  fs -> m.s.x"), {}),
    "a force on a frame between": (text(chain() + SLIDING, more="Se fs : F = 1 N\n  fs -> m.edge.x"), {}),
    "a structure that switches": (text(chain() + SLIDING, "bc", more=SWITCHED), {}),
    "an event sets the rate of a body between": (text(chain() + SLIDING, more="when time > 0.2 s { m.s.x.v = 0.1 [m/s] }"), {}),
    "an event sets a rate": (text(chain() + SLIDING, more="when time > 0.2 s { m.a.x.v = 0.1 [m/s] }"), {}),
    "a third joint on a body between": (text(chain() + SLIDING + "\n    frame g : ground { at = (0, 2 m) }\n    distance d : edge to g"), {}),
}  # fmt: skip


@pytest.mark.few(4)
@pytest.mark.machine_code
@pytest.mark.parametrize("name", OUTSIDE)
def test_what_is_no_such_chain_stays(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, settings = OUTSIDE[name]
    runs = [loaded(tmp_path, written).simulate(to=0.3, rtol=1e-9, points=3, settings=settings)]
    assert runs[0].certificate.constraints == 2
    runs.append(as_written(written, tmp_path, monkeypatch).simulate(to=0.3, rtol=1e-9, points=3, settings=settings))
    assert all((runs[0][o] == runs[1][o]).all() for o in ("ax", "bx", "c", "raphi", "sx"))


def test_a_chain_that_closes_no_loop_stays_in_the_tree(tmp_path: Path) -> None:
    model = loaded(tmp_path, text(chain(), start=ALONE.split(",")[2].strip()))
    assert {"m.a.x", "m.b.x", "m.c.phi"} <= set(model.certificate.states)
    assert size(model) == (8, 0)


def test_a_flow_on_a_joint_of_a_chain(tmp_path: Path) -> None:
    """A slide that the network drives needs a coordinate of its own; one beside the chain does not."""
    still = (
        text(chain() + SLIDING, "bc")
        .replace(", start x.v = 0.1 [m/s]", "")
        .replace(", start phi.omega = 0.5 [rad/s]", "")
    )
    driven = {n: still.replace("READ", "") .replace("\n  output x", f"\n  Sf drive : v = 0.2 [m/s]*sin(3 [rad/s]*time)\n  drive -> m.{n}\n  output x", 1) for n in ("a", "far")}  # fmt: skip
    assert size(loaded(tmp_path, driven["a"]))[1] == 2
    assert size(loaded(tmp_path, driven["far"])) == (3, 0)
    run = loaded(tmp_path, driven["a"]).simulate(to=0.3, rtol=1e-9)
    assert run.final("ax") == pytest.approx(0.2 / 3 * (1 - np.cos(0.9)), rel=1e-7)


def test_a_start_of_one_joint_moves_what_hangs_on_it(tmp_path: Path) -> None:
    """Of two chains the one with a start stays in the tree: the body goes along its slide and does not turn."""
    model = loaded(
        tmp_path, text(chain() + SECOND.replace("along = 15 deg", "along = 15 deg, start x = 0.05 m"), more=TWO)
    )
    assert size(model) == (8, 0)
    run = model.simulate(to=0.1, points=3)
    assert run["qx"][0] == pytest.approx(1.5 + 0.05 * np.cos(np.radians(15)), rel=1e-14)
    assert abs(run["qphi"][0]) < 1e-15


FREE = "      free  flex[i]  : shuttle[i] to platform { at = polar(a, arm) - polar(s, arm + 90 deg), angle = arm, axes = from }"
BUILT = """      body  carriage[i]
      body  tip[i]
      slide lateral[i] : shuttle[i] to carriage[i] { along = arm }
      slide axial[i]   : carriage[i] to tip[i]     { along = arm + 90 deg }
      hinge bend[i]    : tip[i] to platform        { at = polar(a, arm) - polar(s, arm + 90 deg) }"""
FIELD = "    stage.flex[i]   => flexure[i].ends"
JOINED = """    splitter leaf[i](x, y, phi)
    leaf[i] => flexure[i].ends
    stage.lateral[i] -> leaf[i].x
    stage.axial[i]   -> leaf[i].y
    stage.bend[i]    -> leaf[i].phi"""


@pytest.mark.machine_code
def test_the_manipulator_as_it_was_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each arm three joints over bodies without mass: the 12 states and the operations of the one with `free` joints."""
    manipulator = (MODELS / "manipulator.bg").read_text(encoding="utf-8")
    assert FREE in manipulator
    assert FIELD in manipulator
    built = manipulator.replace(FREE, BUILT).replace(FIELD, JOINED)
    shutil.copy(MODELS / "mems.bg", tmp_path)
    model, known = loaded(tmp_path, built), bondgraph.load(MODELS / "manipulator.bg")
    assert size(model) == size(known) == (12, 0)
    assert set(model.certificate.states) == set(known.certificate.states)
    assert operations(compiled(tmp_path / "model.bg")) == operations(compiled(MODELS / "manipulator.bg"))
    runs = [m.simulate("push_x", rtol=1e-10) for m in (model, known)]
    for output in ("x", "y", "phi", "c1", "c2", "c3"):
        assert np.abs(runs[0][output] - runs[1][output]).max() < 1e-9 * np.abs(runs[1][output]).max(), output
    assert runs[0].final("x") == pytest.approx(9.675844161760e-6, rel=1e-9)
    modes = [[mode.frequency for mode in m.modes()] for m in (model, known)]
    assert modes[0] == pytest.approx(modes[1], rel=1e-9)
    plain = as_written(built, tmp_path, monkeypatch)
    assert size(plain) == (20, 4)
    assert plain.simulate("push_x", rtol=1e-10).final("x") == pytest.approx(9.675844161760e-6, rel=1e-8)
