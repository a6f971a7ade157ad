"""The manipulator written in four ways: chords, loops cut elsewhere, springs between bodies, in space. One motion.

Each way is the text of the gallery's model with its mechanism, or the connection of its flexures, written differently.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import chosen_target
from tests.compiling import MODELS

OUTPUTS = ("x", "y", "phi", "c1", "c2", "c3")
TIGHT = 1e-10
CHORDS = (MODELS / "manipulator.bg").read_text(encoding="utf-8")
HUNG = "    stage.flex[i]   => flexure[i].ends\n"
FIELD = re.search(r"    Flexure   flexure\[i\] \{.*?\}\n", CHORDS, re.DOTALL)
STAGE = re.search(r"  multibody stage.*?\n  \}\n", CHORDS, re.DOTALL)

# The flexure's freedoms as joints in a row: the shuttle carries a slide across, that one a slide along, that one the hinge that the platform turns on. Three
# chains that end in one platform are two loops. At the hinges the platform leaves a little of its mass to the chains; point masses
# there move the same on either side of a hinge, so nothing is changed, but every chain that is cut still has something with mass at its end.
JOINTS = """  multibody stage : planar {
    constant share = 0.02 ug
    body platform { mass = m_p - 3*share, inertia = I_z - 3*share*(a^2 + s^2) }
    for i in 1..3 {
      constant arm = 120 deg*(i - 1), middle = polar(a, arm) - polar(s, arm + 90 deg)
      body  shuttle[i] { mass = m_s }
      body  across[i]  { at = middle }
      body  along[i]   { mass = share, at = middle }
      slide guide[i] : ground to shuttle[i]    { along = arm + 90 deg }
      slide fx[i]    : shuttle[i] to across[i] { along = arm }
      slide fy[i]    : across[i] to along[i]   { along = arm + 90 deg }
      hinge fphi[i]  : along[i] to platform    { at = middle }
    }
  }
"""
ROW = """    splitter row[i](x, y, phi)
    stage.fx[i] -> row[i].x;  stage.fy[i] -> row[i].y;  stage.fphi[i] -> row[i].phi
    row[i] => flexure[i].ends
"""

SPACE = """  multibody stage : spatial {
    body platform { mass = m_p, inertia = (0, 0, I_z) }
    planar table : ground to platform
    for i in 1..3 {
      constant arm = 120 deg*(i - 1), out = (cos(arm), sin(arm), 0), side = (-sin(arm), cos(arm), 0)
      body  shuttle[i] { mass = m_s }
      slide guide[i] : ground to shuttle[i]   { along = side }
      free  flex[i]  : shuttle[i] to platform { at = a*out - s*side, turn = (0, 0, arm), axes = from }
    }
  }
"""
FLAT = """    splitter flat[i](x, y, phi)
    stage.flex[i].x -> flat[i].x;  stage.flex[i].y -> flat[i].y;  stage.flex[i].rz -> flat[i].phi
    flat[i] => flexure[i].ends
"""

# One energy in the relative pose, which is measured in the axes of the world, of the platform, and of half the turn between.
ACROSS_AND_ALONG = {
    "world": ("x*cos(arm + phi/2) + y*sin(arm + phi/2)", "y*cos(arm + phi/2) - x*sin(arm + phi/2)"),
    "to": ("x*cos(phi/2) - y*sin(phi/2)", "x*sin(phi/2) + y*cos(phi/2)"),
    "middle": ("x", "y"),
}
SPRING = """    constant arm = 120 deg*(i - 1)
    C spring[i](x, y, phi) : energy = E[i]*I/l_s/(1 - p)/2*phi^2
                                    + 12*E[i]*I/l_s^3/(1 - p^3)/2*(%s)^2
                                    + E[i]*A/l_s/(1 - p)/2*(%s)^2
    stage.flex[i] => spring[i]
"""


def instead(text: str, *changes: tuple[str, str]) -> str:
    """The text with each of these replaced; each occurs once."""
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} is no longer in the model once"
        text = text.replace(old, new)
    return text


def written() -> dict[str, str]:
    assert STAGE is not None and FIELD is not None
    stage, field = STAGE.group(), FIELD.group()
    ways = {"chords": CHORDS, "joints": instead(CHORDS, (stage, JOINTS), (HUNG, ROW))}
    for axes, directions in ACROSS_AND_ALONG.items():
        angle = "0 deg" if axes == "world" else "arm"
        ways[f"springs in {axes}"] = instead(
            CHORDS, ("angle = arm, axes = from", f"angle = {angle}, axes = {axes}"), (field, SPRING % directions), (HUNG, "")
        )  # fmt: skip
    ways["space"] = instead(
        CHORDS,
        (stage, SPACE),
        (HUNG, FLAT),
        ("  hand => stage.platform\n", ""),
        ("  splitter hand(x, y, phi)\n", ""),
        (
            "push_x -> hand.x;  push_y -> hand.y;  twist -> hand.phi",
            "push_x -> stage.platform.x;  push_y -> stage.platform.y;  twist -> stage.platform.rz",
        ),
        ("phi = stage.platform.phi", "phi = stage.platform.rz"),
    )
    return ways


WAYS = written()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All ways, beside the parts that they import."""
    place = tmp_path_factory.mktemp("ways")
    (place / "mems.bg").write_text((MODELS / "mems.bg").read_text(encoding="utf-8"), encoding="utf-8")
    for name, text in WAYS.items():
        (place / f"{name}.bg").write_text(text, encoding="utf-8")
    return place


@cache
def pushed(path: Path) -> bondgraph.Result:
    """The whole motion; without machine code its first fifth, as the rest takes minutes."""
    to = None if chosen_target(None) == "native" else "4 ms"
    return bondgraph.load(path).simulate("push_x", rtol=TIGHT, to=to, points=201, outputs=OUTPUTS)


@pytest.mark.parametrize("way", [w for w in WAYS if w != "chords"])
def test_the_same_motion(way: str, folder: Path) -> None:
    """At 201 instants; measured: 5e-10 of the largest angle for the joints, 1e-11 for the others."""
    one, other = pushed(folder / "chords.bg"), pushed(folder / f"{way}.bg")
    for kind in (("x", "y", "c1", "c2", "c3"), ("phi",)):
        largest = max(np.abs(one[n]).max() for n in kind)
        worst = max(np.abs(one[n] - other[n]).max() for n in kind)
        assert worst <= 1e-8 * largest


def test_equations(folder: Path) -> None:
    """Chords and springs leave the six freedoms alone; joints in a row bring four constraints with them; in space nothing is computed that does not move."""
    programs = {way: bondgraph.load(folder / f"{way}.bg").compilation().program for way in WAYS}
    for way, program in programs.items():
        assert len(program.states.names) == (20 if way == "joints" else 12), way
        assert bool(len(program.invariant_pattern[0])) is (way == "joints"), way
    assert set(programs["space"].states.names) == {
        n.replace("stage.platform", "stage.table") for n in programs["chords"].states.names
    }
    assert programs["space"].operations <= programs["chords"].operations * 1.05


def test_joints_close(folder: Path) -> None:
    """The hinges of the arms stay on the platform to round-off: 1 nm off would be 37 uN of false force."""
    gaps = "".join(
        f"  output gap_x{i} = stage.along[{i}].x - stage.platform.x - (a*cos(turn{i}) + s*sin(turn{i}))\n"
        f"  output gap_y{i} = stage.along[{i}].y - stage.platform.y - (a*sin(turn{i}) - s*cos(turn{i}))\n"
        f"  signal turn{i} = stage.platform.phi + {120 * (i - 1)} deg\n"
        for i in (1, 2, 3)
    )
    path = folder / "gaps.bg"
    path.write_text(instead(WAYS["joints"], ("  output x =", gaps + "  output x =")), encoding="utf-8")
    names = tuple(f"gap_{axis}{i}" for i in (1, 2, 3) for axis in "xy")
    found = bondgraph.load(path).simulate("push_x", rtol=1e-5, points=201, outputs=names)
    assert max(np.abs(found[n]).max() for n in names) <= 1e-12 * 0.5e-3
