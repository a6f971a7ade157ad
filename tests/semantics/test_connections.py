"""Bonds: endpoints, chains and fans, junctions in place, multibonds by name, splitters, and ambiguities that are refused."""

from __future__ import annotations

import pytest

from compiler.graph.network import Junction
from tests.compiling import Running, bonds_of, compiled, mistake, mistakes, node_of

PARTS = """
  1 body : translation
  I mass : p = 2 kg*v
  C spring : F = 8 [N/m]*x
  R damper : F = 3 [N*s/m]*v
  Se push : F = 5 N
"""


def model(bonds: str, parts: str = PARTS) -> str:
    return f"model A {{{parts}\n  {bonds}\n}}\n"


@pytest.mark.parametrize(
    "bonds",
    [
        "push -> body -> mass, spring, damper", "push -> body\n  body -> mass\n  body -> spring, damper", "body -> spring; push -> body; body -> damper\n  body -> mass", "push -> body ->\n mass,\n spring\n , damper",
        "push -> 1(mass, spring, damper)", "push -> body -> 1(mass, spring), damper", "push -> body\n  body -> damper, 1(1(mass), spring)",
    ],
)  # fmt: skip
def test_the_same_graph_in_many_ways(bonds: str) -> None:
    """Chains, fans and junctions in place are several bonds; the equations are the same."""
    parts = PARTS if "body" in bonds else PARTS.replace("  1 body : translation\n", "")
    rates = Running(compiled(model(bonds, parts), everything=True)).rates({"mass.p": 4.0, "spring.x": 0.5})
    assert rates == {"mass.p": 5.0 - 4.0 - 6.0, "spring.x": 2.0}


def test_fans_of_both_kinds() -> None:
    graph = compiled(
        "model A {\n  Se s, t : u = 1 V\n  1 a, b\n  R r, w : u = 2 ohm*i\n  0 c\n  C k : u = q/1 F\n  s -> a\n  t -> b\n  a, b -> c -> k\n  a -> r\n  b -> w\n}\n"
    ).whole_graph
    assert {"a -> c", "b -> c", "c -> k"} <= bonds_of(graph)


def test_several_to_several_is_not_guessed() -> None:
    assert (
        "several"
        in mistake(
            model(
                "push -> body -> mass, spring, damper\n  1 other\n  I n : p = v*1 kg\n  body, other -> n, spring2\n  C spring2 : F = 8 [N/m]*x"
            ),
            "BG121",
        ).sentence
    )


class TestJunctionsInPlace:
    def test_arrows_run_to_the_members_from_sources_to_the_junction(self) -> None:
        graph = compiled(model("body -> mass\n  body -> 1(push, spring, damper)")).whole_graph
        (junction,) = [n for n in graph.nodes if isinstance(n, Junction) and n.name != "body"]
        assert {
            f"push -> {junction.name}",
            f"{junction.name} -> spring",
            f"{junction.name} -> damper",
            f"body -> {junction.name}",
        } <= bonds_of(graph)
        rates = Running(compiled(model("body -> mass\n  body -> 1(push, spring, damper)"), everything=True)).rates(
            {"mass.p": 4.0, "spring.x": 0.5}
        )
        assert rates["mass.p"] == 5.0 - 4.0 - 6.0

    def test_every_one_is_its_own(self) -> None:
        text = "model A {\n  Se s : u = 1 V\n  R a, b, c, d : u = 2 ohm*i\n  C k, l : u = q/1 F\n  s -> 1(a) -> 0(k) -> 1(b) -> 0(l) -> 1(c, d)\n}\n"
        names = [n.name for n in compiled(text).whole_graph.nodes if isinstance(n, Junction)]
        assert len(names) == len(set(names)) == 5

    def test_equal_ones_get_different_names(self) -> None:
        text = "model A {\n  1 a, b\n  I m, n : p = v*1 kg\n  0 c\n  C k : F = x*1 [N/m]\n  a -> m, 0(k2)\n  b -> n, c\n  c -> k\n  C k2 : F = x*1 [N/m]\n  1(k3) -> a\n  C k3 : F = x*1 [N/m]\n}\n"
        names = [n.name for n in compiled(text).whole_graph.nodes]
        assert len(names) == len(set(names))

    def test_at_the_head_of_a_chain(self) -> None:
        text = "model A {\n  Se s : u = 6 V\n  R r : u = 2 ohm*i\n  C k : u = q/1 F\n  1(s, r) -> k\n}\n"
        assert "1(s) -> k" in bonds_of(compiled(text).whole_graph)
        assert Running(compiled(text, everything=True)).rates({"k.q": 2.0}) == {"k.q": 2.0}

    def test_a_multibond_does_not_hang_on_one(self) -> None:
        text = "model A {\n  C plates(q: electric, x: translation) : energy = q^2*x/1 [F*m]\n  Se s : u = 1 V\n  s -> 1(plates)\n}\n"
        assert "BG121" in {d.code for d in mistakes(text)}


class TestArrows:
    @pytest.mark.parametrize("element", ["spring", "mass", "damper"])
    def test_out_of_storage_and_loss(self, element: str) -> None:
        """Nothing is flipped in silence: the arrow to turn is named."""
        others = ", ".join({"spring", "mass", "damper"} - {element})
        found = mistake(model(f"push -> body\n  body -> {others}\n  {element} -> body"), "BG121")
        assert f"`body -> {element}`" in found.help and found.span.text == element

    def test_the_double_arrow_in_its_advice(self) -> None:
        text = "model A {\n  R loss(x, y) : x.F = x.v*1 [N*s/m], y.F = y.v*1 [N*s/m]\n  splitter s(x, y)\n  loss => s\n  1 a, b : translation\n  I m, n : p = v*1 kg\n  a -> m\n  b -> n\n  a -> s.x\n  b -> s.y\n}\n"
        found = [d for d in mistakes(text) if d.code == "BG121"]
        assert "`s => loss`" in found[0].help

    def test_into_or_out_of_sources(self) -> None:
        """An arrow into a source counts what it takes as positive: the same source, the other sign."""
        out = Running(compiled(model("push -> body -> mass, spring, damper"), everything=True)).rates()
        into = Running(compiled(model("body -> push, mass, spring, damper"), everything=True)).rates()
        assert (out["mass.p"], into["mass.p"]) == (5.0, -5.0)

    def test_between_junctions_either_way(self) -> None:
        text = "model A {{\n  1 a, b : translation\n  I m, n : p = 1 kg*v\n  0 j\n  C k : F = x*2 [N/m]\n  R r : F = 5 [N*s/m]*v\n  a -> m\n  b -> n, r\n  j -> k\n  a -> j\n  {}\n}}\n"
        along = Running(compiled(text.format("j -> b"), everything=True)).rates({"k.x": 1.0, "m.p": 3.0, "n.p": 1.0})
        against = Running(compiled(text.format("b -> j"), everything=True)).rates({"k.x": 1.0, "m.p": 3.0, "n.p": 1.0})
        assert along == {"m.p": -2.0, "n.p": 2.0 - 5.0, "k.x": 2.0}
        assert against == {"m.p": -2.0, "n.p": -2.0 - 5.0, "k.x": 4.0}


class TestMultibonds:
    LEAF = "  C leaf(x, y, phi) : energy = 1/2*(2 [N/m]*x^2 + 3 [N/m]*y^2 + 4 [N*m]*phi^2)\n"
    MASSES = "  1 a, b : translation\n  1 c : rotation\n  I m, n : p = v*1 kg\n  I j : p = omega*1 [kg*m^2]\n  a -> m\n  b -> n\n  c -> j\n"

    def test_a_splitter_joins_by_name(self) -> None:
        text = (
            "model A {\n"
            + self.LEAF
            + self.MASSES
            + "  splitter s(phi, y, x)\n  s => leaf\n  a -> s.x\n  b -> s.y\n  c -> s.phi\n}\n"
        )
        graph = compiled(text).whole_graph
        assert {"a -> leaf.x", "b -> leaf.y", "c -> leaf.phi"} <= bonds_of(graph)
        assert all(n.name != "s" for n in graph.nodes), "a splitter is no node of the graph"

    def test_ports_reached_one_by_one(self) -> None:
        text = "model A {\n" + self.LEAF + self.MASSES + "  a -> leaf.x\n  b -> leaf.y\n  c -> leaf.phi\n}\n"
        rates = Running(compiled(text, everything=True)).rates({"leaf.x": 1.0, "leaf.y": 1.0, "leaf.phi": 1.0})
        assert (rates["m.p"], rates["n.p"], rates["j.L"]) == (-2.0, -3.0, -4.0)

    @pytest.mark.parametrize(
        ("bonds", "word"),
        [
            ("s => leaf", "different ports"), ("a -> leaf", "multibond"), ("a => leaf.x", "not a multibond"), ("a => b", "not a multibond"), ("leaf => t", "out of"),
        ],
    )  # fmt: skip
    def test_what_is_refused(self, bonds: str, word: str) -> None:
        text = (
            "model A {\n"
            + self.LEAF.replace("(x, y, phi)", "(x: translation, y: translation, phi: rotation)")
            + self.MASSES
            + f"  splitter s(x, y)\n  splitter t(x, y, phi)\n  {bonds}\n}}\n"
        )
        found = [d for d in mistakes(text) if d.code == "BG121" and word in d.sentence]
        assert found and found[0].help

    def test_a_splitter_is_connected_on_both_sides(self) -> None:
        text = (
            "model A {\n"
            + self.LEAF
            + self.MASSES
            + "  splitter s(x, y, phi)\n  s => leaf\n  a -> s.x\n  b -> s.y\n}\n"
        )
        assert "`s.phi`" in mistake(text, "BG121").sentence

    def test_two_splitters_in_a_row(self) -> None:
        text = (
            "model A {\n"
            + self.LEAF
            + self.MASSES
            + "  splitter s(x, y, phi), t(x, y, phi)\n  s => t\n  t.x -> leaf.x\n  t.y -> leaf.y\n  t.phi -> leaf.phi\n  a -> s.x\n  b -> s.y\n  c -> s.phi\n}\n"
        )
        assert mistakes(text) == () or "splitter" in mistakes(text)[0].sentence


class TestWhatIsMissing:
    @pytest.mark.parametrize(
        ("bonds", "words"),
        [
            ("push -> body -> mass, spring", ["`damper`"]), ("body -> mass, spring, damper", ["`push`"]), ("push -> body -> mass, spring, damper\n  1 lonely : translation", ["`lonely`"]),
            ("push -> body -> mass, spring, damper\n  TF gear : v1 = 2*v2\n  body -> gear", ["side 2 of `gear`"]),
            ("push -> body -> mass, spring, damper\n  TF gear : v1 = 2*v2", ["side 1 of `gear`", "side 2 of `gear`"]),
            ("push -> body -> mass, spring, damper\n  R pair(a, b) : a.F = a.v*1 [N*s/m], b.F = b.v*1 [N*s/m]\n  body -> pair.a", ["`pair.b`"]),
        ],
    )  # fmt: skip
    def test_every_port_has_one_bond(self, bonds: str, words: list[str]) -> None:
        found = mistakes(model(bonds))
        assert {d.code for d in found} == {"BG121"}
        for word in words:
            assert any(word in d.sentence for d in found), [d.sentence for d in found]

    @pytest.mark.parametrize(
        "bonds",
        ["push -> body -> mass, spring, damper\n  body -> spring", "push -> body -> mass, spring, damper, damper"],
    )
    def test_but_not_two(self, bonds: str) -> None:
        found = mistake(model(bonds), "BG121")
        assert "2 bonds" in found.sentence and len(found.related()) == 1

    def test_two_bonds_into_one_side_of_a_transformer(self) -> None:
        text = model(
            "push -> body -> mass, spring, damper\n  TF gear : v1 = 2*v2\n  1 other : translation\n  I n : p = v*1 kg\n  other -> n\n  body -> gear\n  other -> gear"
        )
        assert any("`gear`" in d.sentence for d in mistakes(text))


@pytest.mark.parametrize(
    ("place", "code"),
    [
        ("nowhere", "BG101"),
        ("k", "BG121"),
        ("s", "BG121"),
        ("mass.x", "BG101"),
        ("body.mass", "BG101"),
        ("mass[1]", "BG111"),
        ("gear.1", None),
        ("gear.M1", "BG101"),
        ("A", "BG101"),
    ],
)
def test_places_that_are_none(place: str, code: str | None) -> None:
    text = model(
        f"push -> body -> mass, spring, damper\n  parameter k = 1\n  signal s = 2\n  TF gear : v1 = 2*v2\n  1 other : translation\n  body -> gear -> other\n  I n : p = v*1 kg\n  other -> n\n  body -> {place}"
    )
    found = mistakes(text)
    assert [d.code for d in found] == ([code] if code else ["BG001"])


def test_junctions_are_of_one_domain_and_keep_their_place() -> None:
    graph = compiled(model("push -> body -> mass, spring, damper")).whole_graph
    body = node_of(graph, "body")
    assert (body.span.line, body.span.column, body.definition) == (2, 5, "A.body")
    assert all(bond.span.line == 8 for bond in graph.bonds)


def test_the_graph_in_networkx() -> None:
    """Named as in the text, with the typed payloads on nodes and edges."""
    graph = compiled(model("push -> body -> mass, spring, damper")).whole_graph
    network = graph.network
    assert set(network.nodes) == {"push", "body", "mass", "spring", "damper"}
    assert sorted((a, b) for a, b in network.edges()) == [
        ("body", "damper"),
        ("body", "mass"),
        ("body", "spring"),
        ("push", "body"),
    ]
    assert network.nodes["mass"]["node"] is node_of(graph, "mass")
    assert {d["bond"] for _, _, d in network.edges(data=True)} == set(graph.bonds)
