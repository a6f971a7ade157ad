"""The order of declarations decides no state: loops are cut at the same joints however a mechanism is written down."""

from __future__ import annotations

import itertools
from functools import cache
from pathlib import Path

import pytest

from bondgraph.model import Model
from bondgraph.results.result import Result
from compiler.metamorphosis.printing import text_of
from compiler.metamorphosis.renaming import parsed
from compiler.metamorphosis.text_changes import permuted
from compiler.source import Source

MODELS = Path(__file__).resolve().parents[2] / "models"
NAMES = ["spatial_slider_crank", "slider_crank", "crank_linkage", "published/andrews", "published/iftomm_A04_bricard"]


def states(text: str) -> set[str]:
    return set(Model(Source("made.bg", text)).states)


def loop(kinds: tuple[str, ...], swapped: bool = False) -> str:
    """A closed loop of these joints and the ground, of bodies that all differ; the middle ones hang on no bond, nor does anybody read them."""
    count = len(kinds) - 1
    places = [(0.3 * k, 0.1 * k * (count - k), 0.05 * k * k) for k in range(count + 1)]
    lines = [
        f"body b{k} {{ mass = {1 + k} kg, inertia = (1 [kg*m^2], 2 [kg*m^2], 3 [kg*m^2]), at = ({0.3 * k + 0.15} [m], 0.1 [m], 0) }}"
        for k in range(count)
    ]
    for k, kind in enumerate(kinds):
        first, second = ("ground" if k == 0 else f"b{k - 1}"), ("ground" if k == count else f"b{k}")
        way = {"hinge": ", about = (0, 0.2, 1)", "slide": ", along = (1, 0, 0.1)", "ball": ""}.get(
            kind, ", about = (1, 0, 0), then = (0, 1, 0)"
        )
        lines.append(
            f"{kind} j{k} : {first} to {second} {{ at = ({places[k][0]} [m], {places[k][1]} [m], {places[k][2]} [m]){way} }}"
        )
    body = "\n    ".join(reversed(lines) if swapped else lines)
    return f"model Loop {{\n  multibody m : spatial {{\n    {body}\n  }}\n  output turn = m.j0.{'x' if kinds[0] == 'slide' else 'phi'}\n}}\n"


LOOPS = [
    ("hinge", "ball", "ball", "hinge"),
    ("hinge", "ball", "universal", "slide"),
    ("hinge", "universal", "ball", "slide"),
    ("slide", "ball", "universal", "hinge"),
    ("hinge", "universal", "universal", "hinge", "hinge"),
    ("hinge", "hinge", "hinge", "hinge", "hinge", "hinge", "hinge"),
    ("hinge", "hinge", "ball", "hinge", "universal"),
    ("slide", "hinge", "ball", "hinge", "hinge"),
]


@pytest.mark.parametrize("name", NAMES)
def test_the_order_in_a_model_decides_no_state(name: str) -> None:
    text = (MODELS / f"{name}.bg").read_text(encoding="utf-8")
    first = states(text)
    assert all(states(text_of(permuted(parsed(text), seed))) == first for seed in (1, 2, 3))


@pytest.mark.few(4)
@pytest.mark.parametrize("kinds", LOOPS, ids="-".join)
def test_the_order_in_a_loop_decides_no_state(kinds: tuple[str, ...]) -> None:
    text = loop(kinds)
    first = states(text)
    assert states(loop(kinds, swapped=True)) == first
    assert all(states(text_of(permuted(parsed(text), seed))) == first for seed in (1, 2, 3, 4))


def test_loops_are_cut_at_the_joint_with_the_most_coordinates() -> None:
    """Of those that are as far from the ground: a ball in the tree is seven states, a universal joint four."""
    for kinds in (("hinge", "ball", "universal", "slide"), ("slide", "universal", "ball", "hinge")):
        assert len(states(loop(kinds))) == 8


FLOATING = {
    "frame": "body frame { mass = 12 kg, inertia = 1.8 [kg*m^2], at = (0, 0.5 m), start x.v = 2 [m/s], start phi.omega = 0.3 [rad/s] }",
    "arm": "body arm { mass = 2 kg, inertia = 0.1 [kg*m^2], at = (1 m, 0.5 m) }",
    "hub": "body hub { mass = 1 kg, inertia = 0.02 [kg*m^2], at = (-1 m, 0 m) }",
    "box": "body box { mass = 3 kg, inertia = 0.2 [kg*m^2], at = (0, 1 m) }",
}


@cache
def floating(order: tuple[str, ...]) -> Result:
    """A hinged arm, a sprung hub and a welded box on a frame, with these declarations of the bodies."""
    text = "\n    ".join(FLOATING[name] for name in order)
    text = f"""model Floats {{
  multibody M : planar {{
    gravity = (0, 0)
    {text}
    hinge elbow : frame to arm {{ at = (0.5 m, 0.5 m) }}
    slide leg : frame to hub {{ at = (-1 m, 0 m), along = 90 deg }}
    weld top : frame to box
  }}
  C spring : F = 50 [N/m]*x
  1(spring) -> M.leg
  output x = M.frame.x, y = M.frame.y, turn = M.elbow.phi, slip = M.leg.x, v = M.frame.x.v, omega = M.frame.phi.omega
  output turning = M.elbow.omega, slipping = M.leg.v
}}
"""
    return Model(Source("made.bg", text)).simulate(to=3, points=31, rtol=1e-10)


@pytest.mark.few(3)
@pytest.mark.parametrize("order", list(itertools.permutations(FLOATING))[1::2], ids="-".join)
def test_the_start_of_a_body_that_floats_moves_no_joint(order: tuple[str, ...]) -> None:
    found, first = floating(order), floating(tuple(FLOATING))
    assert [found[n][0] for n in ("turning", "slipping", "v", "omega")] == pytest.approx([0, 0, 2, 0.3], abs=1e-14)
    for name in ("x", "y", "turn", "slip"):
        assert found[name] == pytest.approx(first[name], abs=1e-7)


def test_the_order_does_not_decide_which_of_two_floating_bodies_a_start_moves() -> None:
    """A start of a joint from one body to another moves the other one."""
    a = "body a { mass = 1 kg, inertia = 1 [kg*m^2], at = (0, 0) }"
    b = "body b { mass = 2 kg, inertia = 3 [kg*m^2], at = (2 m, 0) }"
    joint = "hinge pin : a to b { at = (1 m, 0), start phi = 90 deg }"
    places = {
        tuple(
            round(float(Model(Source("made.bg", text)).simulate(to=1e-3, points=2)[name][0]), 12) for name in ("x", "y")
        )
        for parts in itertools.permutations((a, b, joint))
        for text in [f"model A {{\n multibody m : planar {{\n{'; '.join(parts)}\n }}\n output x = m.b.x, y = m.b.y }}"]
    }
    assert places == {(1.0, 1.0)}
