"""Sentences and advice on numbers, lists, joints and names, and the values beside them that are accepted."""

from __future__ import annotations

import math
import re

import pytest

import bondgraph
from compiler.compilation import Compilation
from compiler.errors import ValuesNeeded
from compiler.scene import Override, Scene
from compiler.semantics.names.part_kinds import instead_in_the_plane
from compiler.source import Source, Span
from tests.compiling import bonds_of, compiled, mistakes, node_of, numbers


def told(text: str) -> list[tuple[str, str, str, str]]:
    return [(d.code, d.span.text, d.sentence, d.help) for d in mistakes(text)]


def test_decibels_are_ratios_of_amplitudes() -> None:
    found = numbers("model A { output a = 20 dB, b = -6 dB, c = 5990 dB, d = 0 dB }")
    negated = numbers("model A { output a = -(20 dB), b = 2*-(-20 dB), c = -(20 degC), d = 300 K + -20 degC }")
    assert negated == pytest.approx({"a": -10, "b": -0.2, "c": -293.15, "d": 553.15})
    assert found == {"a": 10.0, "b": pytest.approx(10**-0.3, rel=1e-15), "c": pytest.approx(10**299.5), "d": 1.0}
    for number in ("6000 dB", "7000 dB"):
        ((code, place, sentence, _),) = told(f"model A {{ output a = {number} }}")
        assert (code, place) == ("BG003", number) and sentence.startswith(f"The number {number} is beyond")


@pytest.mark.parametrize(
    ("angle", "cycles"),
    [("10 rad/s", "1.591549431"), ("90 rpm", "1.5"), ("90 [deg/s]", "0.25"), ("2 [rev/min]", "0.03333333333")],
)
@pytest.mark.parametrize(
    "step", ["bandwidth {}; simulate 0 .. 1 s", "response a to b over {} .. 1 kHz", "response a to b over 1 mHz .. {}",
             "set a = chirp(time, {}, 1 kHz, 1 s)", "set a = chirp(time, 1 Hz, {}, 1 s)"],
)  # fmt: skip
def test_a_rate_of_an_angle_is_no_frequency_where_cycles_are_counted(angle: str, cycles: str, step: str) -> None:
    text = f"model A {{ input a = 0; output b = integral(a - b, 0 s)/1 s; experiment e {{ {step.format(angle)} }} }}"
    said = (f"A frequency counts cycles here, and `{angle}` an angle", f"Write `{cycles} Hz`.")
    assert told(text) == [("BG103", angle, *said)]


@pytest.mark.parametrize(
    ("rate", "cycles"),
    [("w", "w/(2*pi)"), ("-v", "-v/(2*pi)"), ("same", "same/(2*pi)"), ("v + 1 [1/s]", "(v + 1 [1/s])/(2*pi)")],
)
@pytest.mark.parametrize("step", ["bandwidth {}; simulate 0 .. 1 s", "response a to b over ({}) .. 1 kHz"])
def test_neither_is_a_name_of_one(rate: str, cycles: str, step: str) -> None:
    declared = "parameter w = 90 rpm, v: rad/s = 2, same = w"
    text = f"model A {{ input a = 0; {declared}; output b = integral(a - b, 0 s)/1 s; experiment e {{ {step.format(rate)} }} }}"
    (found,) = told(text)
    angle, cycles = (f"({x})" if step.startswith("response") else x for x in (rate, cycles))
    assert found[0] == "BG103" and found[2] == f"A frequency counts cycles here, and `{angle}` an angle"
    assert found[3] in (f"Write `{cycles}`.", f"Write `({rate})/(2*pi)`.")


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("parameter f: Hz = 3000 rpm, g: kHz = w, h: Hz = n*w, i: Hz = max(w, 1 rpm), o: rad/s = 50 Hz, l: rpm = -f0", ["3000 rpm", "w", "n*w", "max(w, 1 rpm)", "50 Hz", "-f0"]),
        ("parameter f: Hz = w/(2*pi), g: Hz = k*w, h: Hz = w*0.15915, i: rad/s = 2*pi*(3 Hz), l: rad/s = 3 [1/s], o: Hz = 3 [1/s]", []),
        ("signal a = chirp(time, w, 2*w, 1 s), b = chirp(time, 1 Hz, w/(2*pi), 1 s)", ["w"]),
        ("experiment e { bandwidth 2*w; simulate 0 .. 1 s }", ["2*w"]),
        ("experiment e { set v = 3 Hz; simulate 0 .. 1 s }", ["3 Hz"]),
        ("P a { f = w }; P b { f = w/(2*pi) }; P c { f = w if n > 2 else 1 Hz }", ["w", "w if n > 2 else 1 Hz"]),
        ("signal a = (1 if shaft.omega > 3 Hz else 0), b = w - 3 Hz, c = (1 if f0 > 3 Hz else 0)", ["shaft.omega", "w"]),
        ("Sf other : omega = 50 Hz; other -> shaft", ["50 Hz"]),
        ("signal a = off(w), b = off(shaft.omega), c = off(f0), d = off(w/(2*pi)), e = deep(v)", ["2*x", "w", "shaft.omega"]),
        ("signal a = beyond(w, f0), b = beyond(f0, 2 Hz), c = beyond(w, v), d = (1 if shaft.omega > 2*f0 else 0)", ["w", "shaft.omega"]),
        ("signal a = w - f0, b = max(w, 3 Hz), c = f0 - w/(2*pi), d = v - 2*pi*f0, e = shaft.omega - w", ["w", "w"]),
        ("parameter f: Hz = twice(w), g: rad/s = twice(f0), h: Hz = twice(f0), i: rad/s = 2*pi*twice(f0)", ["twice(w)", "twice(f0)"]),
        ("R r : M = D*(omega - 2 Hz); R s : M = D*off(omega); R t : M = D*(f - f0)", ["omega", "omega", "f"]),
        ("R r : M = (D*omega if omega > 2 Hz else D*w); R s : M = D*max(2*omega, f0)", ["omega", "2*omega"]),
        ("R r : M = D*(omega - w); R s : M = D*(omega/(2*pi) - f0); R t : M = D*(omega - 3 rpm)", []),
        ("Sf other : omega = twice(50 Hz); other -> shaft", ["twice(50 Hz)"]),
    ],
)  # fmt: skip
def test_no_quantity_is_in_both(text: str, places: list[str]) -> None:
    """A speed of 3000 rpm was a frequency of 314 Hz, and 50 Hz one of 50 rad/s."""
    own = "function off(w) = w - 50 Hz; function deep(x) = off(2*x); function twice(x) = 2*x; function beyond(w, f) = (1 if w > f else 0)"
    inside = f"{own}; parameter w = 3 rad/s, v: rad/s = 2, n = 3, k = 2 m/(3 m), f0 = 1 Hz, D = 1 [N*m*s]; 1 shaft : rotation; I m : p = 1 [kg*m^2]*omega; shaft -> m"
    inside += "; shaft -> " + ", ".join(re.findall(r"R (\w)", text)) if "R r" in text else ""
    found = told(f"model P {{ parameter f = 50 Hz; output x = f }}; model A {{ {inside}; {text} }}")
    assert [(code, place) for code, place, *_ in found] == [("BG103", place) for place in places]


@pytest.mark.parametrize(
    ("reading", "refused"),
    [("shaft.omega", True), ("speed", True), ("-speed", True), ("slip", True), ("w", True), ("turns", False), ("shaft.omega/(2*pi)", False), ("f", False)],
)  # fmt: skip
def test_the_flow_of_a_rotation_is_not_reported_in_hertz(reading: str, refused: bool) -> None:
    """3000 rpm were shown as 314.159 Hz."""
    text = f"""model Shaft {{
      parameter w = 3000 rpm, f = 50 Hz
      Sf drive : omega = w
      1 shaft
      R friction : M = 1 [N*m*s]*omega
      drive -> shaft -> friction
      output speed = shaft.omega, turns = shaft.omega/(2*pi), slip = w - shaft.omega
      experiment e {{ equilibrium; report {reading} in kHz }}
    }}"""
    said = [("BG103", "kHz", f"`{reading}` is the rate of an angle, and kHz counts cycles")]
    assert [found[:3] for found in told(text)] == (said if refused else [])


def test_a_number_that_is_too_large_is_quoted_by_its_beginning() -> None:
    ((code, place, sentence, _),) = told(f"model A {{ output a = 9{'0' * 60} dB }}")
    assert (code, place) == ("BG003", f"9{'0' * 60} dB")
    assert sentence.startswith(f"The number 9{'0' * 39} is beyond")


def test_a_point_is_rotated() -> None:
    text = "plain model A { parameter a = 2; signal p = rotate((a, 3), 0.5); output x = p[1], y = p[2] }"
    c, s = math.cos(0.5), math.sin(0.5)
    assert numbers(text) == pytest.approx({"x": 2 * c - 3 * s, "y": 2 * s + 3 * c}, rel=1e-15)
    for point, found in (("(1, 2, 3)", "a list of 3"), ("2", "a single number")):
        assert told(f"plain model A {{ output x = rotate({point}, 0.5) }}")[0][:3] == (
            "BG111",
            point,
            f"A vector of 2 components is expected here, this is {found}",
        )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "model P { parameter list: N = (1 N, 2 N, 3 N); output y = list[3] }\nmodel M { P a; P b { list = (1 N, 2 N) }; output z = a.y + b.y }",
            [("BG112", "list[3]", "`list` has no item 3", "Its items are 1 to 2.")],
        ),
        (
            "model M { signal x = 2 m*sin(time/1 s); signal y: m = delay(x, 0 s); output z = y }",
            [("BG111", "0 s", "A time is expected here, this is 0 s", "A delay is longer than nothing.")],
        ),
        (
            "model M { signal x = 2 m*sin(time/1 s); output z = 2*delay(x, 1 m) }",
            [("BG103", "1 m", "A delay is in [s], but `1 m` is in [m]", "Write a quantity in [s], as `2 [s]`.")],
        ),
    ],
)
def test_what_is_no_single_number(text: str, expected: list[tuple[str, str, str, str]]) -> None:
    assert told(text) == expected


SPATIAL = "model M {{ multibody arm : spatial {{ body b {{ mass = 1 kg, inertia = (1 [kg*m^2], 1 [kg*m^2], 1 [kg*m^2]) }}\n hinge h : ground to b {{ about = (0, 0, 1) }} }}; output x = {} }}"
PLANAR = "model M {{ multibody arm : planar {{ body b {{ mass = 1 kg }}\n hinge h : ground to b }}; output x = {} }}"


@pytest.mark.parametrize(("text", "last"), [(SPATIAL, "rz"), (PLANAR, "phi")])
def test_a_group_of_components_is_no_number(text: str, last: str) -> None:
    assert told(text.format("arm.h.reaction")) == [
        (
            "BG111",
            "arm.h.reaction",
            "A number is expected here, this is the reaction of `h`",
            f"Read one of its components: `arm.h.reaction.x` to `.{last}`.",
        )
    ]
    assert told(text.format("arm.h.reaction.x")) == []


def test_advice_for_a_joint_that_leaves_the_plane() -> None:
    assert instead_in_the_plane("planar") == (
        "In the plane it would leave everything, as `free` does: write that, or `multibody … : spatial`."
    )
    assert instead_in_the_plane("universal") == (
        "Write `multibody … : spatial`, or take a joint that the plane has: slide, hinge, free, weld, distance, rod, gear, rack, wheel, skate."
    )


def test_several_bonds_at_a_port_of_a_mechanism_share_its_flow() -> None:
    text = """model M {
      multibody arm : planar { body b { mass = 1 kg }
        free j : ground to b
      }
      C spring : F = 2 [N/m]*x
      R damper : F = 3 [N*s/m]*v
      Se push : F = 1 N
      arm.b.x -> spring
      arm.b.x -> damper
      push -> arm.b.x
      output v = spring.v
    }"""
    graph = compiled(text).whole_graph
    (junction,) = [n for n in graph.nodes if n.name not in ("arm", "spring", "damper", "push")]
    shared = node_of(graph, junction.name)
    assert bonds_of(graph) == {
        f"{shared.name} -> arm.{junction.name.removeprefix('arm.')}",
        f"{shared.name} -> spring",
        f"{shared.name} -> damper",
        f"push -> {shared.name}",
    }
    (inner,) = [b for b in graph.bonds if graph.nodes[b.head.node].name == "arm"]
    assert inner.span == next(b.span for b in graph.bonds if graph.nodes[b.head.node].name == "spring")
    assert shared.span.text == "arm" and str(getattr(shared, "kind", "")).endswith("ONE")


def later(text: str, name: str) -> Compilation:
    """The stages of a text with a number that only a run knows."""
    source = Source("text.bg", text)
    return Compilation(source, Scene(None, None, (Override(name, None, Span(source, 0, 5)),)))


def test_a_number_that_only_a_run_knows_keeps_its_unit_and_words() -> None:
    text = 'model M { parameter k: N/m = 2 "stiffness", many: N/m = (3, 4) "both"; C c : F = (k + many[2])*x; R r : F = 1 [N*s/m]*v; 1 j : translation; j -> r, c; output x = c.x }'
    for name, words in (("k", "stiffness"), ("many[2]", "both")):
        found = later(text, name).whole_graph.quantities[name]
        assert (found.name, found.role, found.unit, found.value, found.description) == (
            name,
            "parameter",
            "N/m",
            None,
            words,
        )
    plain = later("plain model M { parameter a = 1; output y = 2*a }", "a").whole_graph.quantities["a"]
    assert (plain.unit, plain.description) == ("1", "")


@pytest.mark.parametrize("length", [59, 60, 61, 75])
def test_a_decision_needs_the_value_and_says_where(length: int) -> None:
    """At most 60 characters of the line, its spaces made single."""
    line = "for i in 1..count { R r[i] : e = 2*f }  # ".ljust(length + 1, "x")
    with pytest.raises(ValuesNeeded) as needed:
        _ = later(f"plain model M {{\n  parameter count = 2\n  {line}\n}}", "count").program
    shown = line.replace("  ", " ")
    assert len(shown) == length
    assert needed.value.why == {"count": f"line 3, `{shown[:60]}{'…' if length > 60 else ''}`"}


GUARDED = (
    "model Ways {{ parameter L = {L}, n = {n}, P = {P}\n signal x = integral(1 [m/s], 0.25 m)\n output y = {law} }}"
)


@pytest.mark.parametrize(
    ("law", "left_out", "taken"),
    [
        ("mod(x, L) if L > 0 m else x", 1.25, 0.55), ("x if L == 0 m or x < 0 m else mod(x, L)", 1.25, 0.55),
        ("2*x if n > 9 else stairs(x, L) if L > 0 m else x", 1.25, 0.7), ("mod(x, 0.8 m/n) if n > 0 else x", 1.25, 0.05),
        ("x*(pwm(time, P, 0.5) if P > 0 s else 2)", 2.5, 1.25), ("x + (0*noise(time, P, n)*1 m if P > 0 s else 1 m)", 2.25, 1.25),
        ("x*(log(n) if n > 0 else 1) + sqrt(n - 1)*0 m*x/x if n >= 1 else x", 1.25, 1.25*math.log(2)),
    ],
)  # fmt: skip
def test_what_a_guard_leaves_out_is_not_refused(law: str, left_out: float, taken: float) -> None:
    """A length of zero in a branch that the parameters never take; with others it is taken."""
    model = bondgraph.load(GUARDED.format(L="0 m", n="0", P="0 s", law=law))
    assert model.simulate(to=1).final("y") == pytest.approx(left_out, rel=1e-9)
    settings = {"L": "0.7 m", "n": 2, "P": "0.45 s"}
    assert model.simulate(to=1, settings=settings).final("y") == pytest.approx(taken, rel=1e-9)


@pytest.mark.parametrize(
    "law", ["mod(x, L) if x > 0 m else x", "(mod(x, L) if L > 0 m else x) + mod(x, L)", "mod(x, L) if L < 1 m else x"]
)
def test_what_a_guard_may_take_is_refused(law: str) -> None:
    with pytest.raises(bondgraph.CompilationFailed, match="The length of `mod` is 0"):
        bondgraph.load(GUARDED.format(L="0 m", n="0", P="0 s", law=law)).simulate(to=1)
