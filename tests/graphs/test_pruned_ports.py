"""Elements of several ports of which some do nothing: those ports go, the others keep their laws, starts and magnitudes."""

from __future__ import annotations

import pytest

from compiler.algebra.expression import Symbol, evaluate
from compiler.graph.network import BondEnd, BondGraph, Element, PortVariable
from tests.compiling import Running, compiled

TEXT = """plain model A {
  parameter k = 0
  Se s : e = 6
  Se t : e = 8
  R a, b : e = 2*f
  1 m, n
  PART
  s -> m -> a
  t -> n -> b
  m -> part.x
  n -> part.y
  output f = m.f, g = n.f
}"""


def part_of(text: str) -> tuple[BondGraph, Element | None]:
    graph = compiled(text).graph
    found = [n for n in graph.nodes if n.name == "part"]
    assert all(isinstance(n, Element) for n in found)
    return graph, found[0] if found and isinstance(found[0], Element) else None


def bonds_at(graph: BondGraph, name: str) -> list[int]:
    """Ports of a node that have bonds."""
    number = next(i for i, n in enumerate(graph.nodes) if n.name == name)
    return sorted(end.port for b in graph.bonds for end in (b.tail, b.head) if end.node == number)


@pytest.mark.parametrize(
    ("law", "left", "f", "g"),
    [
        ("x.e = k*x.f, y.e = 3*y.f", ["y"], 3.0, 1.6),
        ("x.e = 4*x.f, y.e = k*y.f", ["x"], 1.0, 4.0),
        ("x.e = k*x.f, y.e = k*y.f", [], 3.0, 4.0),
        ("x.e = k*x.f, y.e = 3*y.f + x.f", ["x", "y"], 3.0, 1.0),
        ("x.e = 4*x.f + y.f/2, y.e = k*y.f", ["x", "y"], 2 / 3, 4.0),
        ("x.e = 4*x.f, y.e = 3*y.f", ["x", "y"], 1.0, 1.6),
    ],
)
def test_ports_of_a_resistor(law: str, left: list[str], f: float, g: float) -> None:
    """6 and 8 over 2 and what the part adds. A port whose flow another law reads stays."""
    text = TEXT.replace("PART", f"R part(x, y) : {law}")
    graph, part = part_of(text)
    assert ([p.name for p in part.ports] if part else []) == left
    if part:
        assert bonds_at(graph, "part") == [*range(len(left))]
        keys = {s.key for pair in part.law.equations for s in pair if isinstance(s, Symbol)}
        assert keys == {PortVariable(i, "e") for i in range(len(left))}
    assert Running(compiled(text)).outputs() == pytest.approx({"f": f, "g": g}, rel=1e-12)


def test_a_storage_keeps_the_starts_and_magnitudes_of_its_other_ports() -> None:
    body = "C part(x, y, z) : x.e = 2*x.q, y.e = k*y.q, z.e = 3*z.q { start x.q = 1; start y.q = 7; start z.q = 4; nominal z.q = 9; nominal y.q = 8 }"
    text = TEXT.replace("PART", f"{body}\n Se u : e = 20\n R c : e = 2*f\n 1 o\n u -> o -> c\n o -> part.z").replace(
        "g = n.f", "g = n.f, h = o.f"
    )
    _, part = part_of(text)
    assert part is not None
    assert [p.name for p in part.ports] == ["x", "z"] and part.stored == ("q", "q")
    assert {p: evaluate(b.formula.expression, float) for p, (_, b) in part.starts.items()} == {0: 1.0, 1: 4.0}
    assert {p: evaluate(b.formula.expression, float) for p, (_, b) in part.nominals.items()} == {1: 9.0}
    assert Running(compiled(text)).outputs() == pytest.approx(
        {"f": (6 - 2) / 2, "g": 4.0, "h": (20 - 12) / 2}, rel=1e-12
    )


def test_a_capacitor_without_energy_goes() -> None:
    text = TEXT.replace("PART", "C part(x, y) : energy = k*x.q^2 + k*x.q*y.q")
    graph, part = part_of(text)
    assert part is None and len(graph.bonds) == 4
    assert Running(compiled(text)).outputs() == pytest.approx({"f": 3.0, "g": 4.0}, rel=1e-12)


@pytest.mark.parametrize("energy", ["k*x.q^2 + y.q^2", "x.q*y.q"])
def test_a_capacitor_with_energy_stays_whole(energy: str) -> None:
    """Even if one of its ports gives no effort: its law is one."""
    _, part = part_of(TEXT.replace("PART", f"C part(x, y) : energy = {energy}"))
    assert part is not None and len(part.ports) == 2 and part.law.energy is not None


def test_bonds_keep_their_ends() -> None:
    graph, part = part_of(TEXT.replace("PART", "R part(x, y) : x.e = k*x.f, y.e = 3*y.f"))
    names = [n.name for n in graph.nodes]
    ends = {(names[b.tail.node], names[b.head.node]) for b in graph.bonds}
    assert ends == {("s", "m"), ("m", "a"), ("t", "n"), ("n", "b"), ("n", "part")}
    (bond,) = (b for b in graph.bonds if names[b.head.node] == "part")
    assert bond.head == BondEnd(names.index("part"), 0) and part is not None
