"""Certificates against graphs that were counted by hand, and that they do not depend on order and names."""

from __future__ import annotations

import random
import re
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings

import bondgraph
from compiler.reduction import Certificate, LoopSummary
from tests.compiling import MODELS, compiled
from tests.equations.random_network import Example, examples


def certificate(text: str) -> Certificate:
    return bondgraph.load(text).certificate


OSCILLATOR = [
    "Se push : F = 1 N",
    "1 body",
    "I mass : p = 2 kg*v",
    "C spring : F = 3 [N/m]*x",
    "R damper : F = 0.1 [N*s/m]*v",
    "push -> body -> mass, spring, damper",
]
FILTER = [
    "Se s : u = 6 V*sin(time*1 [1/s])",
    "0 a",
    "R r : u = 2 ohm*i",
    "R t : u = 3 ohm*i",
    "C c : u = q/1 F",
    "s -> 1(r) -> a -> t, c",
]
# Two resistors in series into a capacitor: the middle node has nothing that decides its effort but the resistors.
LOOP = [
    "Se s : u = 6 V",
    "0 middle",
    "R first : u = 2 ohm*i",
    "R shunt : u = 3 ohm*i",
    "R second : u = 4 ohm*i",
    "C c : u = q/1 F",
    "s -> 1(first) -> middle -> shunt",
    "middle -> 1(second, c)",
]
LEVER = [
    "Se s : F = 10 N",
    "1 a, b : translation",
    "TF lever : v1 = 3*v2",
    "I m : p = 2 kg*v",
    "I n : p = 9 kg*v",
    "C k : F = 4 [N/m]*x",
    "s -> a -> m, lever",
    "lever -> b -> n, k",
]
CAPACITORS = [
    "Se s : u = 9 V",
    "0 a",
    "R r : u = 3 ohm*i",
    "C c : u = q/2 F",
    "C d : u = q/4 F",
    "s -> 1(r) -> a -> c, d",
]
DIODE = [
    "Se s : u = 2 V*cos(time*1 [1/s])",
    "1 loop",
    "R series : u = 3 ohm*i",
    "R diode : i = 1 uA*(exp(u/26 mV) - 1)",
    "C c : u = q/1 F",
    "s -> loop -> series, diode, c",
]
# A spring that time alone moves and an inertia that time alone moves: one is differentiated once, one stands alone.
FORCED = ["Sf s : v = 1 [m/s]*sin(time*1 [1/s])", "I m : p = 2 kg*v", "C k : F = 3 [N/m]*x", "s -> 1(m, k)"]
VARYING = [
    "MR r : F = 1 [N*s/m]*(2 + sin(time*1 [1/s]))*v",
    "I m : p = 2 kg*v",
    "C k : F = 3 [N/m]*x",
    "1 body",
    "body -> r, m, k",
]
PARTLY_NOTHING = [*OSCILLATOR, "R none : F = 0 [N*s/m]*v", "body -> none"]
STATIC = ["Se s : u = 6 V", "R r : u = 2 ohm*i", "R t : u = 3 ohm*i", "s -> 1(r, t)", "output i = r.i"]
BILINEAR = ["MSe s : F = -1 [N*s/m^2]*k.x*m.v", "I m : p = 2 kg*v", "C k : F = 3 [N/m]*x", "s -> 1(m, k)"]


def text_of(lines: list[str]) -> str:
    return "model A {\n  " + "\n  ".join(lines) + "\n}\n"


# lines, form, index, states, degrees of freedom, dependent, loops (linear, size), linear, time-varying, driven, left out
CASES: dict[str, tuple[list[str], str, int, set[str], int, set[str], list[tuple[bool, int]], bool, bool, bool, set[str]]] = {
    "oscillator": (OSCILLATOR, "explicit ODE", 0, {"mass.p", "spring.x"}, 1, set(), [], True, False, False, set()),
    "filter": (FILTER, "explicit ODE", 0, {"c.q"}, 0, set(), [], True, False, True, set()),
    "loop": (LOOP, "linear-implicit ODE", 1, {"c.q"}, 0, set(), [(True, 1)], True, False, False, set()),
    "lever": (LEVER, "linear-implicit ODE", 2, {"m.p", "k.x"}, 1, {"n"}, [(True, 1)], True, False, False, set()),
    "capacitors": (CAPACITORS, "linear-implicit ODE", 2, {"c.q"}, 0, {"d"}, [(True, 1)], True, False, False, set()),
    "diode": (DIODE, "index-1 DAE", 1, {"c.q"}, 0, set(), [(False, 1)], False, False, True, set()),
    "forced": (FORCED, "explicit ODE", 2, {"k.x"}, 0, {"m"}, [], True, False, True, set()),
    "varying": (VARYING, "explicit ODE", 0, {"m.p", "k.x"}, 1, set(), [], True, True, True, set()),
    "nothing": (PARTLY_NOTHING, "explicit ODE", 0, {"mass.p", "spring.x"}, 1, set(), [], True, False, False, {"none"}),
    "static": (STATIC, "algebraic", 1, set(), 0, set(), [(True, 1)], True, False, False, set()),
    "bilinear": (BILINEAR, "explicit ODE", 0, {"m.p", "k.x"}, 1, set(), [], False, False, False, set()),
}  # fmt: skip


def told(found: Certificate) -> tuple[Any, ...]:
    loops = sorted((x.linear, x.size) for x in found.loops)
    return (
        found.form, found.index, set(found.states), found.degrees_of_freedom, set(found.dependent), loops, found.linear,
        found.time_varying, found.driven, set(found.left_out),
    )  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_counted_by_hand(name: str) -> None:
    lines, *expected = CASES[name]
    assert told(certificate(text_of(lines))) == tuple(expected)


@pytest.mark.parametrize("name", CASES)
def test_neither_order_nor_names_matter(name: str) -> None:
    """But for which of several equal storages is the dependent one."""
    first = certificate(text_of(CASES[name][0]))
    for seed in range(5):
        lines = list(CASES[name][0])
        random.Random(seed).shuffle(lines)
        found = certificate(text_of(lines))
        counts = (len(found.states), len(found.dependent), found.degrees_of_freedom)
        assert counts == (len(first.states), len(first.dependent), first.degrees_of_freedom)
        assert (found.form, found.index, found.linear, found.time_varying, found.driven) == (
            first.form, first.index, first.linear, first.time_varying, first.driven,
        )  # fmt: skip
        assert [(x.linear, x.size, set(x.members)) for x in found.loops] == [
            (x.linear, x.size, set(x.members)) for x in first.loops
        ]
        assert set(found.left_out) == set(first.left_out)


@settings(max_examples=30, phases=(Phase.explicit, Phase.generate), suppress_health_check=list(HealthCheck))
@given(examples())
def test_random_graphs_in_another_order(example: Example) -> None:
    """Statements of each model shuffled: the same form, index, counts and loops; where these are cut is a greedy choice."""
    blocks = re.split(r"(?m)^(?=\S)", example.text)  # heads, bodies and ends of models
    assume(not re.search(r"(?m)^ .*\{\s*$", example.text))  # statements of several lines stay out
    moved = []
    for block in blocks:
        head, *body = block.splitlines() or [""]
        random.Random(7).shuffle(body)
        moved += [head, *body]
    try:
        first = certificate(example.text + "\n")
    except bondgraph.CompilationFailed:
        return
    found = certificate("\n".join(moved) + "\n")
    assert told(found)[:2] == told(first)[:2] and told(found)[6:] == told(first)[6:]
    assert sorted(x.linear for x in found.loops) == sorted(x.linear for x in first.loops)
    assert (len(found.states), len(found.dependent), found.degrees_of_freedom) == (
        len(first.states), len(first.dependent), first.degrees_of_freedom,
    )  # fmt: skip


def test_members_of_loops() -> None:
    (linear,) = certificate(text_of(LOOP)).loops
    assert set(linear.members) == {"first", "1(first)", "middle", "shunt", "second", "1(second)"}
    (nonlinear,) = certificate(text_of(DIODE)).loops
    assert nonlinear == LoopSummary(False, 1, nonlinear.members, True) and set(nonlinear.members) == {
        "loop",
        "series",
        "diode",
    }


def test_two_nonlinear_loops_are_two() -> None:
    other = [line.replace("loop", "ring").replace("series", "wire").replace("diode", "lamp").replace("s ", "t ").replace("C c", "C d") for line in DIODE]  # fmt: skip
    other[-1] = "t -> ring -> wire, lamp, d"
    found = certificate(text_of([*DIODE, *other]))
    assert [(x.linear, x.size) for x in found.loops] == [(False, 1), (False, 1)]
    assert {frozenset(x.members) for x in found.loops} == {
        frozenset({"loop", "series", "diode"}), frozenset({"ring", "wire", "lamp"}),
    }  # fmt: skip


def test_a_mechanism_has_the_freedoms_that_engineers_count() -> None:
    """Three guides and a platform in the plane; a double pendulum."""
    found = bondgraph.load(MODELS / "manipulator.bg").certificate
    assert (found.form, len(found.states), found.degrees_of_freedom, found.linear) == ("explicit ODE", 12, 6, False)
    assert {"push_x", "push_y", "twist"} <= set(found.left_out)
    assert bondgraph.load(MODELS / "pendulum.bg").certificate.degrees_of_freedom == 2


def test_what_no_output_needs() -> None:
    """Two oscillators, one looked at."""
    text = text_of(
        [*OSCILLATOR, "C c : u = q/1 F", "R leak : u = 1 ohm*i", "0 k", "k -> c, leak", "output x = spring.x"]
    )
    lean = compiled(text).certificate
    assert (set(lean.states), lean.unneeded) == ({"mass.p", "spring.x"}, ("c.q",))
    assert set(certificate(text).states) == {"mass.p", "spring.x", "c.q"} and certificate(text).unneeded == ()


def test_what_outputs_alone_read_does_not_make_a_model_nonlinear() -> None:
    assert certificate(text_of([*OSCILLATOR, "output power = mass.F*mass.v*sin(time*1 [1/s])"])).linear
    assert not certificate(text_of([*OSCILLATOR, "output power = mass.F*mass.v"])).driven


def test_inputs_drive_and_modulate() -> None:
    """An input adds to the forces, or multiplies a flow."""
    base = ["input w = 2", *VARYING[1:]]
    added = compiled(text_of([*base, "MSe f : F = 1 N*w^2", "f -> body", "MR r : F = 1 [N*s/m]*1*v*(1 + 0*w)"][:-1]).replace("body -> r, m, k", "body -> m, k"), free=("w",), everything=True).certificate  # fmt: skip
    assert (added.linear, added.time_varying, added.driven) == (True, False, True)
    factor = compiled(text_of(["MR r : F = 1 [N*s/m]*w*v", *base]), free=("w",), everything=True).certificate
    assert (factor.linear, factor.time_varying, factor.driven) == (True, True, True)


def test_the_line_and_the_page() -> None:
    found = certificate(text_of(LEVER))
    assert found.line == (
        "A: linear-implicit ODE, reduced from index 2; 2 states; linear; autonomous; 1 storage in derivative form; "
        "1 linear loop (1 unknown)"
    )
    page = str(found).splitlines()
    assert page[0] == found.line
    assert page[1] == "  states, of 1 degree of freedom: m.p, k.x" and page[2] == "  in derivative form: n"
    assert found.to_json()["loops"][0]["size"] == 1


@pytest.mark.parametrize(
    ("law", "told"),
    [
        ("z.e", "linear"), ("2*z.f", "linear"), ("3*z.e + 1", "linear"), ("z.e^2", "nonlinear"), ("z.e*z.f", "nonlinear"), ("sin(z.e)", "nonlinear"),
        ("z.e*time", "linear, time-varying"),
    ],
)  # fmt: skip
def test_a_source_that_reads_a_linear_loop(law: str, told: str) -> None:
    """The unknown of the loop a, z, y moves with the state of c, and so does what reads it."""
    made = bondgraph.load(
        "plain model A {\n  Se s : e = 1\n  R a : e = 2*f\n  R z : e = 3*f\n  R y : e = 4*f\n  C c : e = q\n  R r : e = f\n  C d : e = q\n"
        f"  MSe u : e = {law}\n  s -> 1(a) -> 0(z) -> 1(y) -> c\n  u -> 1(r) -> d\n  output w = d.e, v = c.e\n}}"
    )
    assert f"2 states; {told};" in made.certificate.line and "1 linear loop" in made.certificate.line
