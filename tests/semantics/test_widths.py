"""Multibonds of a width: junctions, ports and elements of n bonds, against closed forms, single bonds and the errors of wrong ones."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from compiler.source import Source
from compiler.syntax.format import format_text
from compiler.unparse import write_text
from tests.compiling import compiled, mistakes

CHAIN = """
model Chain {
  parameter n = 5, m = 2 kg, k: N/m = 100
  for i in 1..n + 1 {
    for j in 1..n { constant D[i, j] = 1 if i == j else (-1 if i == j + 1 else 0) }
  }
  1  body                                         : translation[n]
  I  mass(p: translation[n])                      : p.p = m*p.v           { start p[1].v = 1 [m/s] }
  TF ends(a: translation[n], b: translation[n+1]) : b.f = D*a.f
  C  springs(s: translation[n + 1])               : e = k*q
  body => mass, ends.a
  ends.b => springs
  output first = springs.s.x[1], energy = m*dot(body.v, body.v)/2 + k/2*dot(springs.s.x, springs.s.x)
  experiment swing { simulate 0 .. 1 s }
}
"""


@pytest.mark.parametrize("n", [1, 2, 7])
def test_a_chain_has_the_frequencies_of_the_closed_form(n: int) -> None:
    model = bondgraph.load(CHAIN)
    modes = [mode.frequency for mode in model.modes(settings={"n": n})]
    expected = [np.sqrt(100 / 2) / np.pi * np.sin(i * np.pi / (2 * (n + 1))) for i in range(1, n + 1)]
    assert sorted(f for f in modes if f > 1e-9) == pytest.approx(expected, rel=1e-9)


def test_a_chain_keeps_its_energy_and_is_that_of_single_bonds() -> None:
    wide = bondgraph.load(CHAIN).simulate(settings={"n": 2})
    single = bondgraph.load(
        """model Two {
          1 a, b : translation
          I left : p = 2 kg*v { start v = 1 [m/s] }
          I right : p = 2 kg*v
          C s1, s2, s3 : F = 100 [N/m]*x
          a -> left, s1
          b -> right
          a -> 0(s2) -> b -> s3
          output first = s1.x, energy = left.p*left.v
          experiment swing { simulate 0 .. 1 s }
        }"""
    ).simulate()
    assert wide.final("first") == pytest.approx(single.final("first"), rel=1e-5)
    assert wide["energy"] == pytest.approx(1.0, rel=1e-5)


FIELDS = """
model Leg {
  parameter n = 2
  port top: translation[n]
  C pad(p: translation[n]) : e = 50 [N/m]*q
  top => pad
}
model Three {
  parameter n = 3
  constant M = [[1 kg, 0, 0], [0, 2 kg, 0], [0, 0, 4 kg]]
  Leg leg { n = n }
  Leg two
  1 body : translation[n]
  Sf pair(p: translation[2]) : f = [1 [m/s], 2 [m/s]]
  pair => two.top
  I mass(p: translation[n]) : p = M*f
  R loss(p: translation[n]) : e = 1e-9 [N*s/m]*f
  for i in 1..n { Se push[i] : F = i*1 N }
  push => body => mass, loss, leg.top
  output v = body.v[2], F = leg.top.F[3], stretched = two.pad.p.x[2], same = two.pad.p[2].x, speed = norm(body.v), P = dot(push.F, body.v), x = leg.pad.p
  experiment go { simulate 0 .. 1 s }
}
"""


def test_readings_of_one_bond_and_of_all_of_instances_of_several_widths() -> None:
    result = bondgraph.load(FIELDS).simulate(rtol=1e-9)
    rates = np.sqrt(50 / np.array([1.0, 2.0, 4.0]))
    forces = np.array([1.0, 2.0, 3.0])
    speeds = forces * rates / 50 * np.sin(rates)
    places = forces / 50 * (1 - np.cos(rates))
    assert result.final("v") == pytest.approx(speeds[1], rel=1e-6)
    assert result.final("F") == pytest.approx(50 * places[2], rel=1e-6)
    assert result.final("speed") == pytest.approx(np.linalg.norm(speeds), rel=1e-6)
    assert result.final("P") == pytest.approx(forces @ speeds, rel=1e-6)
    assert [result.final(f"x[{i}]") for i in (1, 2, 3)] == pytest.approx(places, rel=1e-6)
    assert result.final("stretched") == result.final("same") == pytest.approx(2.0)


PLANAR = """
model Held {
  parameter l = 40 mm, K = [[2 [kN/m], 0, 0], [0, 5 [kN/m], 0], [0, 0, 3 [N*m]]]
  I plate(p: planar) : energy = (p.x^2 + p.y^2)/(2*0.5 kg) + p.phi^2/(2*2e-4 [kg*m^2])   { start p = [0.1 [N*s], 0, 0] }
  TF arm(a: planar, b: planar) : b.f = [[1, 0, -l], [0, 1, 0], [0, 0, 1]]*a.f
  C spring(s: planar) : e = K*q
  %s
  output x = spring.s.x, turn = spring.s.phi, M = arm.a.phi.M, v = plate.p.f[1]
  experiment swing { simulate 0 .. 0.2 s }
}
"""


@pytest.mark.parametrize(
    "bonds", ["1 body : planar\n  body => plate, arm.a\n  arm.b => spring", "1(plate) => arm.a\n  arm.b => spring.s"]
)
def test_junctions_of_a_multibond_are_those_of_single_bonds(bonds: str) -> None:
    single = "splitter hand(x, y, phi)\n  hand => arm.a\n  arm.b => spring\n"
    single += "".join(f"  1(plate.p.{c}) -> hand.{c}\n" for c in ("x", "y", "phi"))
    first, second = (bondgraph.load(PLANAR % b).simulate(rtol=1e-9) for b in (bonds, single))
    for name in ("x", "turn", "M", "v"):
        assert first[name] == pytest.approx(second[name], abs=1e-9)


def test_a_gyrator_of_a_width_and_a_source_of_three_phases() -> None:
    text = """model Grid {
      Se grid(p: electric[3]) : e = [1 V, 2 V, 4 V]
      GY motor(a: electric[3], b: rotation) : a.e = [1, 2, 3]*(0.5 [V*s]*b.f)
      R wires(p: electric[3]) : u = 2 ohm*i
      I rotor : L = 1 [kg*m^2]*omega
      grid => 1(wires) => motor.a
      motor.b -> rotor
      output omega = rotor.omega
      experiment go { simulate 0 .. 2 s }
    }"""
    a, b = 0.5**2 * 14 / 2, 0.5 * (1 + 4 + 12) / 2  # omega' = b - a*omega
    assert bondgraph.load(text).simulate(rtol=1e-9).final("omega") == pytest.approx(
        b / a * (1 - np.exp(-2 * a)), rel=1e-6
    )


def test_a_width_in_a_loop_is_a_further_index() -> None:
    text = """model A {
      parameter n = 3
      for i in 1..n {
        C k[i](p: translation[2]) : e = i*2 [N/m]*q
        I m[i](p: translation[2]) : p = 1 kg*f  { start p = [1 [N*s], 2 [N*s]] }
        1 node[i] : translation[2]
        node[i] => k[i], m[i]
      }
      output x = k[2].p.x[2], y = k.p.x[3, 1], w = node[2].v[1], all = k.p.x*[0, 1]
      experiment go { simulate 0 .. 1 s }
    }"""
    result = bondgraph.load(text).simulate(rtol=1e-9)
    assert result.final("x") == pytest.approx(2 * np.sin(2) / 2)
    assert result.final("y") == pytest.approx(np.sin(np.sqrt(6)) / np.sqrt(6))
    assert result.final("w") == pytest.approx(np.cos(2))
    assert result.final("all[3]") == pytest.approx(2 * np.sin(np.sqrt(6)) / np.sqrt(6))


@pytest.mark.parametrize(
    ("name", "law"), [("F", "Se s(p: translation[2]) : e = F"), ("x", "C s(p: translation[2]) : energy = dot(x, x)/2")]
)
def test_an_array_with_the_name_of_a_letter_is_a_clash(name: str, law: str) -> None:
    """As a single name is; the law read its own variables without a word."""
    found = mistakes(line(f"for i in 1..2 {{ constant {name}[i] = i }}\n  {law}"))
    assert any(d.code == "BG116" and f"`{name}` could be a variable of `s`" in d.sentence for d in found), found


def test_arrays_of_multibonds_of_a_width_are_joined_by_both_indices() -> None:
    """n cells with the voltages i V and 2 V over R and C: 1 - exp(-t/RC) of each."""
    text = """model Cell {
      port top: electric[2]
      C c(p: electric[2]) : e = q/(1 uF)
      R r(p: electric[2]) : e = 1 [kohm]*f
      top => 1(c, r)
      output u = c.p.u
    }
    model Cells {
      for i in 1..3 {
        Cell cell[i]
        0 node[i] : electric[2]
        Se supply[i](p: electric[2]) : e = [i*1 V, 2 V]
      }
      supply => node => cell.top
      output last = cell[3].u[1], other = cell[1].u[2]
    }"""
    result = bondgraph.load(text).simulate(to=2e-3, points=2, rtol=1e-9)
    share = 1 - np.exp(-2)
    assert (result.final("last"), result.final("other")) == pytest.approx((3 * share, 2 * share), rel=1e-7)


def test_the_flat_text_and_the_formatted_one_are_the_same_model() -> None:
    flat = bondgraph.load(write_text(compiled(CHAIN).graph))
    expected = bondgraph.load(CHAIN).simulate(points=3).final("first")
    assert flat.simulate(to=1.0, points=3).final("first") == pytest.approx(expected, rel=1e-9)
    tidy = format_text(Source("a.bg", CHAIN))
    assert format_text(Source("a.bg", tidy)) == tidy
    assert "translation[n+1]) : b.f = D*a.f" in tidy


def line(statement: str) -> str:
    return f"model A {{\n  parameter n = 2\n  {statement}\n}}\n"


@pytest.mark.parametrize(
    ("statement", "code", "words"),
    [
        ("1 body : translation[0]", "BG111", "1 or more"),
        ("1 body : translation[n - 5]", "BG111", "1 or more"),
        ("1 body : translation[1.5]", "BG111", "whole number"),
        ("1 body : translation[2, 3]", "BG111", "1 or more"),
        ("1 body : translation[time/1 s]", "BG106", "time"),
        ("1 body : translat[2]", "BG101", "translation"),
        ("C k(p: planar[2]) : e = 1 [N/m]*q", "BG111", "is expected here, this is several"),
        ("splitter s(p: translation[2])", "BG111", "is expected here, this is several"),
        ("IC k(p: translation[1]) : p.e = p.q*1 [N/m]", "BG111", "`p` alone"),
        ("1 body : translation[100001]", "BG160", ""),
    ],
)
def test_wrong_widths_are_refused(statement: str, code: str, words: str) -> None:
    found = mistakes(line(statement))
    assert code in [d.code for d in found] and words in str(found[0].sentence) + found[0].help, found


@pytest.mark.parametrize(
    ("bonds", "words"),
    [
        ("push => a", "One has 3 bonds, the other 2: both need one width, or a transformer between them."),
        ("push -> a", "Use `=>` for all its ports, or name one: `push.p[1]`."),
        ("push.p[1] => a[1]", "`=>` joins multibonds port by port; a single bond is `->`."),
        ("push.p[4] -> a[1]", "Did you mean `p[3]` or `p[2]`?"),
        ("push.p[1] -> a[3]", "`a` has the items 1, 2."),
        ("push => 1(a, b)", "One has 3 bonds, the other 2: both need one width, or a transformer between them."),
        ("push => frame", "`=>` joins ports of equal names."),
        ("1(a[1], push) -> a[2]", "Name one of its ports: `push.p[1]`."),
    ],
)
def test_bonds_that_do_not_fit_are_told_with_their_widths(bonds: str, words: str) -> None:
    declared = "Se push(p: translation[3]) : e = [1 N, 2 N, 3 N]\n  1 a, b : translation[2]\n  1 frame : planar"
    found = [d for d in mistakes(line(f"{declared}\n  {bonds}")) if d.code in ("BG101", "BG121")]
    assert words in [d.help for d in found], found


@pytest.mark.parametrize(
    ("reading", "code", "words"),
    [
        ("body.F", "BG101", "It has v."),
        ("body", "BG111", "`body[1]`"),
        ("k.p[3].x", "BG112", "k.p[1] to k.p[2]"),
        ("body[3].v", "BG112", "body[1] to body[2]"),
        ("t.a", "BG111", "as `t.a.e`, `.f`"),
        ("k.z", "BG101", "p[1], p[2]"),
        ("k.p.M", "BG101", "F, v, x"),
    ],
)
def test_wrong_readings_of_a_multibond_are_told(reading: str, code: str, words: str) -> None:
    declared = "1 body : translation[2]\n  C k(p: translation[2]) : e = 1 [N/m]*q\n"
    declared += "  TF t(a: translation[2], b: translation[2]) : b.f = [[1, 2], [3, 4]]*a.f\n  body => t.a\n  t.b => k"
    (found,) = mistakes(line(f"{declared}\n  output y = {reading}"))
    assert found.code == code and words in found.sentence + found.help, found


@pytest.mark.parametrize(
    "law", ["p.F = 2 [N/m]*p.x", "F = 2 [N/m]*x", "e = 2 [N/m]*p", "p.F[1] = 2 [N/m]*p.x[1], p[2].F = 2 [N/m]*p[2]"]
)
def test_a_law_has_the_letters_of_one_bond_and_of_all(law: str) -> None:
    text = f"Se push(p: translation[2]) : e = [1 N, 3 N]\n  C k(p: translation[2]) : {law}\n  R r(p: translation[2]) : e = 1 [N*s/m]*f"
    text = line(f"{text}\n  push => 1(r) => k\n  output x = k.p.x[2]\n  experiment go {{ simulate 0 .. 1 s }}")
    assert bondgraph.load(text).simulate(rtol=1e-9).final("x") == pytest.approx(1.5 * (1 - np.exp(-2)), rel=1e-7)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("p.F = 2 [N/m]*p.x[i]", "An item of a list"),
        ("p.F[i] = 2 [N/m]*p.x[1]", "An item of a list"),
        ("p.F[3] = 2 [N/m]*p.x[1], p.F[2] = p.x[2]*1 [N/m]", "An item of a list of 2"),
        ("p.M = 2 [N/m]*p.x", "Write `p.f`, all its flows, or `p[1].v`"),
        ("p.F = [1 [N/m], 2 [N/m], 3 [N/m]]*p.x[1]", "A list of 2"),
    ],
)
def test_wrong_items_in_a_law_are_told(law: str, words: str) -> None:
    text = f"for i in 1..2 {{\n    C k[i](p: translation[2]) : {law}\n  }}"
    found = mistakes(line(text))
    assert any(words in d.sentence + d.help for d in found), found


def test_a_field_of_named_ports_is_read_as_its_law_reads_it() -> None:
    text = """model Coils {
      I coils(a, b) : lambda = [[10 mH, 4 mH], [4 mH, 5 mH]]*i    { start a.i = 1 A, start b.i = 2 A }
      RS wires(a, b, heat: thermal) : e = [[2 ohm, 0], [0, 1 ohm]]*f
      Se cold : T = 300 K
      1 first, second : electric
      first -> coils.a, wires.a
      second -> coils.b, wires.b
      wires.heat -> cold
      output i = coils.i, same = coils.f, flux = coils.lambda[2], loss = dot(wires.u, wires.i)
      experiment go { simulate 0 .. 1 us }
    }"""
    result = bondgraph.load(text).simulate(points=2)
    assert [result[f"i[{n}]"][0] for n in (1, 2)] == pytest.approx([1, 2]) == [result[f"same[{n}]"][0] for n in (1, 2)]
    assert result["flux"][0] == pytest.approx(4e-3 + 10e-3) and result["loss"][0] == pytest.approx(2 + 4)


@pytest.mark.parametrize("n", [1, 2])
def test_matrices_of_any_width_down_to_one(n: int) -> None:
    """A matrix of one row times a list is a number, which stands where a list of one is meant: in laws, equations, sums, branches, rates and events."""
    items = ", ".join("1" * n)
    text = f"""plain model Wide {{
      for i in 1..{n} {{ for j in 1..{n} {{ constant A[i, j] = 2 if i == j else 0 }} }}
      constant u = [{items}]
      1 j : untyped[{n}]
      I m(b: untyped[{n}]) : b.p = A*b.f {{ start b.p = [{items}] }}
      TF t(a: untyped[{n}], b: untyped[{n}]) : b.f = A*a.f
      C c(b: untyped[{n}]) : e = A*q
      j => m, t.a
      t.b => c
      solve A*z = 3*u for z = u
      signal w = integral(A*u - u, [{", ".join("0" * n)}]), y = A*c.b.q + c.b.q, v = A*z if time < 2 else u
      when time > 0.5 {{ m.b.p = A*m.b.f }}
      output q = c.b[1].q, z1 = z[1], w1 = w[1], y1 = y[1], v1 = v[1]
      experiment go {{ simulate 0 .. 1 }}
    }}"""
    found = bondgraph.load(text).simulate(rtol=1e-8)
    assert found.final("q") == pytest.approx(np.sin(2.0) / 2, rel=1e-6)  # 2 v' = -8 x
    assert [found.final(name) for name in ("z1", "w1", "v1")] == pytest.approx([1.5, 1.0, 3.0], rel=1e-7)
    assert found.final("y1") == pytest.approx(3 * found.final("q"), rel=1e-12)
