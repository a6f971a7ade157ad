"""Lists, indices, `for`: rounds, names that belong to a round, ranges that parameters decide."""

from __future__ import annotations

import pytest

from compiler.graph.network import Element
from tests.compiling import Running, bonds_of, compiled, mistake, mistakes, node_of, numbers


def values(body: str) -> dict[str, float]:
    return numbers(f"model A {{\n{body}\n}}\n")


class TestLists:
    def test_items_from_one(self) -> None:
        assert values("parameter gap: um = (4, 5, 6)\noutput y = gap[1], z = gap[3], w = gap[1 + 1]") == {
            "y": 4e-6,
            "z": 6e-6,
            "w": 5e-6,
        }

    def test_arithmetic(self) -> None:
        text = "parameter a = (1, 2, 3), b = (10, 20, 30)\nsignal c = 2*a + b/10 - a*1\noutput y = c[1], z = c[3], w = (-a)[2]"
        assert values(text.replace(", w = (-a)[2]", "")) == {"y": 2.0, "z": 6.0}

    def test_lists_of_signals_and_of_inputs(self) -> None:
        text = "input p = 1 V, q = 2 V\nsignal both = (p, 2*q)\noutput y = both[2]"
        assert values(text) == {"y": 4.0}

    def test_an_output_that_is_a_list_reports_its_items(self) -> None:
        assert values("parameter a = 3\noutput y = (a, 2*a)") == {"y[1]": 3.0, "y[2]": 6.0}

    def test_points_for_polar_and_rotate(self) -> None:
        text = "constant p = polar(2 m, 90 deg), r = rotate((1 m, 0), 180 deg), s = rotate(p, 90 deg)\noutput x = p[1], y = p[2], u = r[1], v = r[2], w = s[1]"
        found = values(text)
        assert found == pytest.approx({"x": 0.0, "y": 2.0, "u": -1.0, "v": 0.0, "w": -2.0}, abs=1e-15)
        assert found["x"] == 0.0, "a multiple of 90 deg couples nothing"

    @pytest.mark.parametrize("index", ["0", "4", "-1", "1, 1", "1.5", "a[1]"])
    def test_items_that_are_not_there(self, index: str) -> None:
        found = mistakes(f"model A {{\n  parameter gap: um = (4, 5, 6), a = (1.5, 2)\n  output y = gap[{index}]\n}}\n")
        assert [d.code for d in found] in (["BG112"], ["BG111"])
        assert found[0].span.line == 3

    def test_what_is_no_list(self) -> None:
        mistake("model A {\n  parameter a = 3\n  output y = a[1]\n}\n", "BG112")

    def test_an_item_as_index(self) -> None:
        assert values("parameter order = (3, 1, 2), gap = (10, 20, 30)\noutput y = gap[order[1]]") == {"y": 30.0}

    def test_the_length_may_change_with_an_override(self) -> None:
        text = "model A {\n  parameter gap: um = (4, 5)\n  output y = gap\n}\n"
        assert numbers(text) == {"y[1]": 4e-6, "y[2]": 5e-6}
        assert Running(compiled(text, {"gap": "(1 mm, 2 mm, 3 mm)"})).outputs() == {
            "y[1]": 1e-3,
            "y[2]": 2e-3,
            "y[3]": 3e-3,
        }


class TestRounds:
    def test_elements_carry_the_index(self) -> None:
        text = "model A {\n  parameter k: N/m = (1, 2, 3)\n  for i in 1..3 {\n    1 a[i]\n    I m[i] : p = i*1 kg*v\n    C c[i] : F = k[i]*x\n    a[i] -> m[i], c[i]\n  }\n  output y = c[2].x\n}\n"
        graph = compiled(text).whole_graph
        assert [n.name for n in graph.nodes] == [f"{n}[{i}]" for i in (1, 2, 3) for n in "amc"]
        running = Running(compiled(text, everything=True))
        rates = running.rates({"c[1].x": 1.0, "c[2].x": 1.0, "c[3].x": 1.0, "m[3].p": 9.0})
        assert (rates["m[1].p"], rates["m[2].p"], rates["m[3].p"], rates["c[3].x"]) == (-1.0, -2.0, -3.0, 3.0)

    def test_one_law_for_all_rounds(self) -> None:
        text = "model A {\n  for i in 1..5 {\n    1 a[i]\n    I m[i] : p = i*1 kg*v\n    a[i] -> m[i]\n  }\n}\n"
        laws = {n.law for n in compiled(text).whole_graph.nodes if isinstance(n, Element)}
        assert len(laws) == 1

    def test_constants_and_signals_without_an_index_belong_to_their_round(self) -> None:
        text = "parameter h = 2, d = (3, 4)\nfor i in 1..2 {\n  constant J = h*d[i]^2\n  signal s = J + i\n  output y[i] = s\n}"
        assert values(text) == {"y[1]": 19.0, "y[2]": 34.0}

    def test_nested_rounds(self) -> None:
        text = "for i in 1..2 {\n  constant a = 10*i\n  for j in i..3 {\n    constant b = a + j\n    output y[i, j] = b\n  }\n}"
        assert values(text) == {"y[1, 1]": 11.0, "y[1, 2]": 12.0, "y[1, 3]": 13.0, "y[2, 2]": 22.0, "y[2, 3]": 23.0}

    def test_a_constant_of_a_round_is_not_known_outside(self) -> None:
        assert (
            mistake(
                "model A {\n  for i in 1..2 { constant c = i\n output y[i] = c }\n  output z = c\n}\n", "BG101"
            ).span.text
            == "c"
        )

    def test_reading_another_round(self) -> None:
        text = "for i in 1..3 { signal s[i] = i^2 }\nfor i in 2..3 { output d[i] = s[i] - s[i - 1] }"
        assert values(text) == {"d[2]": 3.0, "d[3]": 5.0}

    def test_ranges_by_parameters(self) -> None:
        text = "model A {\n  parameter n = 3\n  constant last = n - 1\n  for i in 0..last { output y[i] = 2*i }\n}\n"
        assert numbers(text) == {"y[0]": 0.0, "y[1]": 2.0, "y[2]": 4.0}
        assert set(Running(compiled(text, {"n": "5"})).outputs()) == {f"y[{i}]" for i in range(5)}
        assert set(Running(compiled(text, {"n": 1.0})).outputs()) == {"y[0]"}

    def test_an_empty_range_does_nothing(self) -> None:
        assert values("parameter n = 0\nfor i in 1..n { output y[i] = i }\noutput z = 1") == {"z": 1.0}

    def test_a_chain_across_rounds(self) -> None:
        text = (
            "model A {\n  parameter n = 4\n  for i in 1..n {\n    1 a[i]\n    I m[i] : p = 1 kg*v\n    a[i] -> m[i]\n  }\n"
            "  for i in 1..n-1 {\n    0 k[i]\n    C c[i] : F = 1 [N/m]*x\n    a[i] -> k[i] -> c[i]\n    k[i] -> a[i+1]\n  }\n}\n"
        )
        graph = compiled(text).whole_graph
        assert {f"k[{i}] -> a[{i + 1}]" for i in (1, 2, 3)} <= bonds_of(graph)
        rates = Running(compiled(text, everything=True)).rates({"c[1].x": 1.0, "c[2].x": 3.0})
        assert [rates[f"m[{i}].p"] for i in (1, 2, 3, 4)] == [-1.0, -2.0, 3.0, 0.0]

    def test_nests_in_a_round_are_several(self) -> None:
        text = "model A {\n  0 line : translation\n  for i in 1..3 {\n    C c[i] : F = i*1 [N/m]*x\n    R r[i] : F = 1 [N*s/m]*v\n    line -> 1(c[i], r[i])\n  }\n  Se s : F = 1 N\n  s -> 1(drive) -> line\n  R drive : F = 1 [N*s/m]*v\n}\n"
        graph = compiled(text).whole_graph
        assert sum(n.kind.value == "1" for n in graph.nodes) == 4
        assert len({n.name for n in graph.nodes}) == len(graph.nodes)

    def test_what_stands_in_a_for_carries_an_index(self) -> None:
        for kind in ("I m : p = 1 kg*v", "1 m : translation", "Part m"):
            found = [
                d
                for d in mistakes(
                    f"model Part {{ output y = 1 }}\nmodel A {{\n  for i in 1..2 {{\n    {kind}\n  }}\n}}\n"
                )
                if d.code == "BG111"
            ]
            assert len(found) == 1 and "`m[i]`" in found[0].help

    @pytest.mark.parametrize("bounds", ["1..2.5", "1..spring", "1..time", "1..u", "1..(2 m)", "1..1e9", "1..nothing"])
    def test_ranges_that_are_none(self, bounds: str) -> None:
        found = mistakes(f"model A {{\n  input u = 3\n  for i in {bounds} {{ output y[i] = i }}\n}}\n")
        assert len(found) == 1 and found[0].span.line == 3

    def test_the_same_item_twice(self) -> None:
        found = mistake("model A {\n  for i in 1..2 { output y[1] = i }\n}\n", "BG104")
        assert "y[1]" in found.sentence

    def test_a_missing_item(self) -> None:
        found = mistake("model A {\n  for i in 1..3 { signal s[i] = i }\n  output y = s[4]\n}\n", "BG112")
        assert "s[1]" in found.help and "s[3]" in found.help

    def test_an_array_is_no_number(self) -> None:
        text = "model A {\n  for i in 1..3 {\n    1 a[i]\n    I m[i] : p = 1 kg*v\n    a[i] -> m[i]\n  }\n  output y = %s\n}\n"
        for expression in ("m", "m + 1", "2*a"):
            found = mistakes(text % expression)
            assert len(found) == 1 and found[0].span.line == 7
        assert compiled(text % "m[2].p").program.outputs.names == ("y",)
        for expression in ("m.p", "2*a.v"):  # of each of its items: a list
            assert compiled(text % expression).program.outputs.names == ("y[1]", "y[2]", "y[3]")

    def test_an_array_of_signals_is_a_list(self) -> None:
        assert values("for i in 1..3 { signal s[i] = i^2 }\nsignal t = 2*s\noutput y = t[3]") == {"y": 18.0}


def test_spaces_in_an_index_change_nothing() -> None:
    text = "model A {\n  parameter gap = (1, 2, 3)\n  output y = gap[ 2 ] + gap [ 1+1 ] + gap[\n    3\n  ]\n}\n"
    assert numbers(text) == {"y": 7.0}


def test_indexed_fields_have_index_and_ports() -> None:
    text = "model A {\n  for i in 1..2 {\n    R pair[i](a, b) : a.F = i*1 [N*s/m]*a.v, b.F = 2 [N*s/m]*b.v\n    1 x[i], y[i] : translation\n    I m[i], n[i] : p = v*1 kg\n    x[i] -> m[i], pair[i].a\n    y[i] -> n[i], pair[i].b\n  }\n}\n"
    pair = node_of(compiled(text).whole_graph, "pair[2]")
    assert isinstance(pair, Element) and [p.name for p in pair.ports] == ["a", "b"]
    rates = Running(compiled(text, everything=True)).rates({"m[2].p": 1.0, "n[2].p": 1.0})
    assert (rates["m[2].p"], rates["n[2].p"]) == (-2.0, -2.0)


def test_instances_in_rounds_with_lists_of_parameters() -> None:
    text = (
        "model Spring {\n  parameter k: N/m\n  port end: translation\n  C c : F = k*x\n  end -> c\n}\n"
        "model A {\n  parameter k: N/m = (1, 2, 3)\n  1 body\n  I m : p = 1 kg*v\n  body -> m\n  for i in 1..3 {\n    Spring s[i] { k = k[i] }\n    body -> s[i].end\n  }\n  output y = s[3].c.F, z = s[1].k\n}\n"
    )
    running = Running(compiled(text))
    found = running.outputs({"s[1].c.x": 5.0})  # whose state the others share
    assert found == {"y": 15.0, "z": 1.0}
