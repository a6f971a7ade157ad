"""Domains spread along bonds from ports, junctions and the letters of laws; a conflict is reported with both causes."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.graph.domains import DOMAINS
from compiler.graph.network import BondGraph, Element, Junction
from tests.compiling import compiled, mistake, mistakes, node_of


def domain(graph: BondGraph, name: str) -> str:
    node = node_of(graph, name)
    if isinstance(node, Junction):
        return node.domain
    assert isinstance(node, Element)
    return ", ".join(p.domain for p in node.ports)


def graph(body: str) -> BondGraph:
    return compiled(f"model A {{\n{body}\n}}\n").whole_graph


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ("C c : F = 2 [N/m]*x", "translation"),
        ("I c : p = 2 kg*v", "translation"),
        ("R c : F = 2 [N*s/m]*v", "translation"),
        ("C c : M = 2 [N*m]*phi", "rotation"),
        ("I c : L = 2 [kg*m^2]*omega", "rotation"),
        ("I c : p = 2 [kg*m^2]*omega", "rotation"),
        ("R c : u = 2 ohm*i", "electric"),
        ("C c : q = 2 F*u", "electric"),
        ("C c : u = q/2 F", "electric"),
        ("I c : lambda = 2 H*i", "electric"),
        ("R c : Q = 2 [m^3/s/Pa]*P", "hydraulic"),
        ("C c : V = 2 [m^3/Pa]*P", "hydraulic"),
        ("R c : T = 2 [K^2/W]*S_dot", "thermal"),
        ("C c : T = 2 [K^2/J]*S", "thermal"),
        ("C c : mmf = 2 [A/Wb]*Phi", "magnetic"),
        ("R c : mu = 2 [J*s/mol^2]*n_dot", "chemical"),
    ],
)
def test_from_the_letters_of_a_law(law: str, expected: str) -> None:
    """The element, its junction, and the other elements bonded to it."""
    found = graph(f"  {law}\n  1 a\n  0 b\n  R r : e = f{_resistance(expected)}\n  a -> c, b\n  b -> r")
    assert {domain(found, n) for n in "abc"} == {expected}
    assert domain(found, "r") == expected


def _resistance(domain: str) -> str:
    return f"*1 [{DOMAINS[domain].effort / DOMAINS[domain].flow}]"


@pytest.mark.parametrize("name", [d.name for d in DOMAINS.values() if d.typed])
def test_every_domain_can_be_named(name: str) -> None:
    found = graph(f"  0 a : {name}\n  R r : e = f{_resistance(name)}\n  a -> r")
    assert (domain(found, "a"), domain(found, "r")) == (name, name)


@pytest.mark.parametrize("name", [d.name for d in DOMAINS.values() if d.has_power])
def test_power_is_a_power_in_every_domain(name: str) -> None:
    """effort * flow is in watts, displacement is the integral of flow and momentum that of effort."""
    d = DOMAINS[name]
    assert str(d.effort * d.flow) == "W"
    assert d.dimension("q") / d.flow == d.dimension("p") / d.effort
    assert str(d.dimension("q") / d.flow) == "s"


def test_a_chamber_is_filled_through_a_choked_orifice() -> None:
    """Isothermal: P = m R T/V, and a mass flow that does not depend on the pressure in the chamber, so the pressure rises linearly."""
    text = """model Chamber {
  parameter R = 287 [J/(kg*K)], T = 293 K, V = 1 L
  1 inlet : pneumatic
  Sf choked : m_dot = 1 [g/s]
  C chamber : P = m*R*T/V { start = 1.2 g }
  choked -> inlet -> chamber
  output P = chamber.P
  experiment fill { simulate 0 .. 2 s { points = 3 } }
}
"""
    found = bondgraph.load(text).simulate()
    assert found["P"] == pytest.approx([287 * 293 * m / 1e-3 for m in (1.2e-3, 2.2e-3, 3.2e-3)], rel=1e-12)


def test_domains_without_power() -> None:
    """Pseudo bonds: what flows is conserved, but effort times flow is no power."""
    assert [d.name for d in DOMAINS.values() if not d.has_power] == ["pseudothermal", "pneumatic", "untyped"]


def test_along_chains_fans_and_nests() -> None:
    found = graph(
        "  1 a : rotation\n  0 b, c\n  1 d\n  I m : p = f*1 [kg*m^2]\n"
        + "  C k : e = q*1 [N*m]\n  R r, s : e = f*1 [N*m*s]\n  a -> b -> d, c\n  d -> m\n  c -> 1(r, 0(k)), s"
    )
    names = [n.name for n in found.nodes]
    assert {domain(found, n) for n in names} == {"rotation"}
    assert {n.kind.value for n in found.nodes if "(" in n.name} == {"0", "1"}


def test_against_the_arrows() -> None:
    """A later bond, or one in the other direction, gives it as well."""
    found = graph(
        "  1 a, b\n  R r : e = f*1 ohm\n  I m : p = f*1 H\n  Se s : e = 1 V\n  s -> a\n  a -> b\n  b -> r, m\n  C k : u = q/1 F\n  a -> k"
    )
    assert {domain(found, n.name) for n in found.nodes} == {"electric"}


def test_not_through_transducers() -> None:
    body = "  1 a : rotation\n  1 b : translation\n  TF rack : v2 = 2 m*omega1\n  GY motor : u1 = 3 [V*s]*omega2\n  1 c\n  a -> rack -> b\n  c -> motor -> a\n  I m : p = f*1 kg\n  b -> m\n"
    found = graph(body + "  R r : e = f*1 ohm\n  c -> r")
    assert domain(found, "rack") == "rotation, translation"
    assert domain(found, "motor") == "electric, rotation"
    assert domain(found, "c") == "electric"


def test_both_sides_of_a_transducer_by_its_letters() -> None:
    found = graph(
        "  1 a, b\n  TF piston : Q1 = 2 [m^2]*v2\n  a -> piston -> b\n  R r : e = f*1 [N*s/m]\n  C c : e = q*1 [Pa/m^3]\n  a -> c\n  b -> r"
    )
    assert (domain(found, "a"), domain(found, "b")) == ("hydraulic", "translation")


def test_fields_port_by_port() -> None:
    found = graph(
        "  C plates(q: electric, x: translation) : energy = 1/2*q^2*(1 mm - x)/1e-15 [F*m]\n  1 wire, plate\n  wire -> plates.q\n  plate -> plates.x\n"
        "  R lead : e = f*1 ohm\n  I mass : p = f*1 kg\n  wire -> lead\n  plate -> mass"
    )
    assert domain(found, "plates") == "electric, translation"
    assert (domain(found, "wire"), domain(found, "plate")) == ("electric", "translation")


def test_fields_by_the_letters_behind_a_port() -> None:
    found = graph(
        "  R pair(a, b) : a.F = 2 [N*s/m]*a.v, b.M = 3 [N*m*s]*b.omega\n  1 c, d\n  c -> pair.a\n  d -> pair.b\n  I m : p = v*1 kg\n  I n : p = f*1 [kg*m^2]\n  c -> m\n  d -> n"
    )
    assert (domain(found, "pair"), domain(found, "c"), domain(found, "d")) == (
        "translation, rotation",
        "translation",
        "rotation",
    )


def test_a_splitter_of_x_y_phi_is_planar() -> None:
    found = graph(
        "  splitter hand(x, y, phi)\n  1 a, b, c\n  a -> hand.x\n  b -> hand.y\n  c -> hand.phi\n  R loss(x, y, phi) : x.F = 1 [N*s/m]*x.v, y.F = 2 [N*s/m]*y.v, phi.M = 3 [N*m*s]*phi.omega\n"
        "  hand => loss\n  I m1, m2 : p = f*1 kg\n  I m3 : p = f*1 [kg*m^2]\n  a -> m1\n  b -> m2\n  c -> m3"
    )
    assert [domain(found, n) for n in "abc"] == ["translation", "translation", "rotation"]


def test_through_the_walls_of_instances() -> None:
    text = (
        "model Part {\n  port shaft: rotation, wire(a: electric, b: electric)\n  1 hub\n  R r : e = f*1 [N*m*s]\n  R s : u = i*1 ohm\n  R t : u = i*1 ohm\n  shaft -> hub -> r\n  wire.a -> s\n  wire.b -> t\n}\n"
        "model A {\n  Part part\n  1 axle\n  1 line\n  I j : p = f*1 [kg*m^2]\n  axle -> part.shaft\n  axle -> j\n  line -> part.wire.a\n  0 other\n  other -> part.wire.b\n  I l : p = f*1 H\n  line -> l\n  C c : e = q/1 F\n  other -> c\n}\n"
    )
    found = compiled(text).whole_graph
    assert [domain(found, n) for n in ("axle", "part.hub", "line", "other")] == [
        "rotation",
        "rotation",
        "electric",
        "electric",
    ]


def test_from_a_mechanism() -> None:
    text = "model A {\n  multibody m : planar {\n    body b { mass = 1 kg, inertia = 1 [kg*m^2] }\n    hinge pin : ground to b { at = (0, 0) }\n  }\n  0 a, c\n  m.pin -> a -> r\n  c -> m.b.y\n  R r : e = f*1 [N*m*s]\n  Se s : e = 1 N\n  s -> c\n}\n"
    found = compiled(text).whole_graph
    assert (domain(found, "a"), domain(found, "c")) == ("rotation", "translation")


def test_inside_for() -> None:
    found = graph(
        "  for i in 1..3 {\n    1 a[i]\n    I m[i] : p = f*1 kg\n    a[i] -> m[i]\n  }\n  for i in 1..2 { 0 k[i]\n C c[i] : F = q*1 [N/m]\n a[i] -> k[i]\n k[i] -> c[i]\n k[i] -> a[i+1] }"
    )
    assert {domain(found, n.name) for n in found.nodes} == {"translation"}


def test_a_conflict_names_both_causes() -> None:
    text = "model A {\n  1 body : translation\n  I m : p = 1 kg*v\n  R lead : u = 2 ohm*i\n  body -> m\n  body -> lead\n}\n"
    found = mistake(text, "BG115")
    (other,) = found.related()
    assert found.span.line == 4
    assert "translation" in found.sentence and "electric" in found.sentence
    assert other[0].line in (2, 3)


@pytest.mark.parametrize(
    "body",
    [
        "1 a : translation\n1 b : rotation\na -> b\nI m : p = 1 kg*v\na -> m\nI n : p = 1 [kg*m^2]*omega\nb -> n",
        "C c : F = 2 [N/m]*phi",
        "1 a : translation\nTF gear : omega1 = 2*omega2\na -> gear\nR r : e = f*1 [N*m*s]\ngear -> r\nI m : p = v*1 kg\na -> m",
        "splitter s(x, y)\n1 a : rotation\na -> s.x\nI m : p = omega*1 [kg*m^2]\na -> m\n1 b : translation\nb -> s.y\nI n : p = v*1 kg\nb -> n\nR r(x, y) : x.F = 1 [N*s/m]*x.v, y.F = 1 [N*s/m]*y.v\ns => r",
    ],
)
def test_conflicts(body: str) -> None:
    codes = {d.code for d in mistakes(f"model A {{\n{body}\n}}\n")}
    assert codes & {"BG115", "BG101", "BG114"}, codes


def test_not_known() -> None:
    found = mistakes("model A {\n  1 a, b\n  R r : e = 2*f\n  a -> b -> r\n}\n")
    assert [(d.code, d.span.text) for d in found] == [("BG114", "a")]
    assert "`a`, `b` and `r`" in found[0].sentence and "`1 a : translation`" in found[0].help


def test_what_no_bond_reaches_is_told_so() -> None:
    """A bond is what lacks most; a name of several may be bonded to itself, and what a port meets is outside."""
    for loose, told in (
        *((loose, True) for loose in ("R x : e = 2*f", "R x", "TF x : e1 = 2*e2", "1 x", "R x(p, q) : p.e = p.f, q.e = q.f")),
        *((bonded, False) for bonded in ("1 x[2]\nx[1] -> x[2]", "for i in 1..2 { 1 x[i] }\nx[1] -> x[2]", "port x", "1 x, y\nx -> y")),
    ):  # fmt: skip
        found = mistakes(f"model A {{\nI mass : p = (1 kg)*v\n1 a\na -> mass\n{loose}\n}}\n")
        assert {(d.code, d.help.startswith("No bond reaches it: connect it. Give the domain")) for d in found} == {
            ("BG114", told)
        }


def test_an_unknown_domain_is_told_once() -> None:
    found = mistakes("model A {\n  1 a : mechanical\n  R r : e = 2*f\n  a -> r\n}\n")
    assert [(d.code, d.span.text) for d in found] == [("BG101", "mechanical")]


def test_letters_that_the_author_took_for_a_parameter_tell_nothing() -> None:
    """`V` is a parameter here, so the law of `c` is not hydraulic."""
    found = graph("  parameter V = 3 V\n  1 a : electric\n  C c : u = q/1 F + V*0\n  R r : u = 1 ohm*i\n  a -> c, r")
    assert domain(found, "c") == "electric"


def test_plain_models_have_no_domains() -> None:
    found = compiled("plain model A {\n  1 a\n  C c : e = q\n  R r : e = f\n  a -> c, r\n}\n").whole_graph
    assert {domain(found, n.name) for n in found.nodes} == {"untyped"}
