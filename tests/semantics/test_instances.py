"""Models in models: parameters, inputs, ports, nesting, readings of them, and their limits."""

from __future__ import annotations

import pytest

from compiler.examination import examine
from compiler.source import Source
from tests.compiling import Running, bonds_of, compiled, mistake, mistakes, numbers

SPRING = """
model Spring {
  "A spring with a loss."
  parameter k: N/m = 100, r = k*0.1 s
  constant  twice = 2*k
  input     shift = 0 m
  port end: translation
  1 both
  C spring : F = k*x
  R loss   : F = r*v
  signal force = spring.F + k*shift
  output pull = force
  end -> both -> spring, loss
}
"""


def test_parameters_defaults_and_bindings() -> None:
    text = (
        SPRING
        + "model A {\n  parameter k: N/m = 7\n  Spring a\n  Spring b { k = k }\n  Spring c { k = 2*k, r = 5 [N*s/m] }\n  output a1 = a.k, a2 = a.r, b1 = b.k, b2 = b.r, b3 = b.twice, c1 = c.k, c2 = c.r\n"
    )
    text += "  1 j\n  I m : p = 1 kg*v\n  j -> m, a.end, b.end, c.end\n}\n"
    assert numbers(text) == pytest.approx({"a1": 100, "a2": 10, "b1": 7, "b2": 0.7, "b3": 14, "c1": 14, "c2": 5})


def test_left_its_name_right_the_surrounding_one() -> None:
    """`m = m`: nothing is captured by accident, three levels deep."""
    text = "model Inner { parameter m = 1; output y = m }\nmodel Outer { parameter m = 2\n  Inner c { m = m + 10 }\n  output y = c.y }\nmodel A { parameter m = 3\n  Outer b { m = m + 100 }\n  output y = b.y, z = b.c.m }\n"
    assert numbers(text) == {"y": 113.0, "z": 113.0}


def test_inputs_are_bound_like_parameters() -> None:
    text = (
        SPRING
        + "model A {\n  input u = 2 m\n  Spring s { shift = 3*u, k = 1 [N/m] }\n  output y = s.pull, z = s.force\n  1 j\n  I m : p = 1 kg*v\n  j -> m, s.end\n}\n"
    )
    assert Running(compiled(text)).outputs({"s.spring.x": 4.0}) == {"y": 10.0, "z": 10.0}


def test_one_bond_passes_through_the_wall() -> None:
    text = SPRING + "model A {\n  Spring s\n  1 j\n  I m : p = 1 kg*v\n  j -> m, s.end\n}\n"
    graph = compiled(text).whole_graph
    assert bonds_of(graph) == {"j -> m", "j -> s.both", "s.both -> s.spring", "s.both -> s.loss"}
    assert [n.name for n in graph.nodes] == ["s.both", "s.spring", "s.loss", "j", "m"]


def test_walls_within_walls() -> None:
    text = (
        SPRING
        + "model Box {\n  port rod: translation\n  Spring inner { k = 3 [N/m] }\n  rod -> inner.end\n}\nmodel Crate { port rod: translation\n  Box box\n  rod -> box.rod }\n"
    )
    text += "model A {\n  Crate crate\n  1 j\n  I m : p = 2 kg*v\n  j -> m, crate.rod\n  output F = crate.box.inner.spring.F\n}\n"
    assert "j -> crate.box.inner.both" in bonds_of(compiled(text).whole_graph)
    assert Running(compiled(text)).outputs({"crate.box.inner.spring.x": 2.0}) == {"F": 6.0}


def test_multibonds_through_walls() -> None:
    text = (
        "model Leaf {\n  port ends: planar\n  C c(x, y, phi) : energy = 1/2*1 [N/m]*x^2 + 1/2*2 [N/m]*y^2 + 1/2*3 [N*m]*phi^2\n  ends => c\n}\n"
        "model A {\n  Leaf leaf\n  splitter s(x, y, phi)\n  s => leaf.ends\n  1 a, b : translation\n  1 c : rotation\n  a -> s.x\n  b -> s.y\n  c -> s.phi\n"
        "  I m, n : p = 1 kg*v\n  I j : p = 1 [kg*m^2]*omega\n  a -> m\n  b -> n\n  c -> j\n}\n"
    )
    assert {"a -> leaf.c.x", "b -> leaf.c.y", "c -> leaf.c.phi"} <= bonds_of(compiled(text).whole_graph)
    rates = Running(compiled(text, everything=True)).rates({"leaf.c.x": 1.0, "leaf.c.y": 1.0, "leaf.c.phi": 1.0})
    assert (rates["m.p"], rates["n.p"], rates["j.L"]) == (-1.0, -2.0, -3.0)


def test_a_component_of_a_planar_port() -> None:
    text = "model Leaf {\n  port ends: planar\n  C c(x, y, phi) : energy = 1/2*1 [N/m]*x^2 + 1/2*2 [N/m]*y^2 + 1/2*3 [N*m]*phi^2\n  ends => c\n}\nmodel A {\n  Leaf leaf\n  1 a, b : translation\n  1 c : rotation\n  a -> leaf.ends.x\n  b -> leaf.ends.y\n  c -> leaf.ends.phi\n  I m, n : p = 1 kg*v\n  I j : p = 1 [kg*m^2]*omega\n  a -> m\n  b -> n\n  c -> j\n}\n"
    assert "b -> leaf.c.y" in bonds_of(compiled(text).whole_graph)


def test_the_arrow_decides_the_sign_and_the_port_has_none() -> None:
    """The same model, its port entered or left; efforts count along the arrows."""
    source = "model Push {\n  port out: translation\n  Se s : F = 5 N\n  s -> out\n}\nmodel A {\n  Push p\n  1 j\n  I m : p = 1 kg*v\n  p.out -> j -> m\n}\n"
    assert Running(compiled(source, everything=True)).rates() == {"m.p": 5.0}
    load = "model Push {\n  port out: translation\n  Se s : F = 5 N\n  out -> s\n}\nmodel A {\n  Push p\n  1 j\n  I m : p = 1 kg*v\n  j -> m, p.out\n}\n"
    assert Running(compiled(load, everything=True)).rates() == {"m.p": -5.0}


@pytest.mark.parametrize(
    ("inner", "outer", "how"), [("out -> r", "p.out -> j", "tail"), ("s -> out", "j -> p.out", "head-on")]
)
def test_arrows_that_do_not_agree(inner: str, outer: str, how: str) -> None:
    text = f"model Part {{\n  port out: translation\n  R r : F = 1 [N*s/m]*v\n  Se s : F = 1 N\n  {inner}\n}}\nmodel A {{\n  Part p\n  1 j\n  I m : p = 1 kg*v\n  j -> m\n  {outer}\n}}\n"
    text = (
        text.replace("  Se s : F = 1 N\n", "")
        if "r" in inner.split()
        else text.replace("  R r : F = 1 [N*s/m]*v\n", "")
    )
    found = mistake(text, "BG121")
    assert how in found.sentence and "`p.out`" in found.sentence
    assert len(found.related()) == 1


def test_reading_any_depth_down() -> None:
    text = (
        SPRING
        + "model Box {\n  port rod: translation\n  Spring inner\n  rod -> inner.end\n}\nmodel A {\n  Box box\n  1 j\n  I m : p = 2 kg*v\n  j -> m, box.rod\n  output a = box.inner.spring.x, b = box.inner.pull, c = box.inner.k, d = box.inner.both.v\n}\n"
    )
    assert Running(compiled(text)).outputs({"box.inner.spring.x": 2.0, "m.p": 6.0}) == {
        "a": 2.0,
        "b": 200.0,
        "c": 100.0,
        "d": 3.0,
    }


@pytest.mark.parametrize(
    ("attributes", "code"),
    [("stiffness = 2", "BG120"), ("twice = 2 [N/m]", "BG120"), ("force = 2 N", "BG120"), ("pull = 2 N", "BG120"), ("k = 1 [N/m], k = 2 [N/m]", "BG120"),
     ("start k = 2", "BG120"), ("k = 2 kg", "BG103"), ("k = nowhere", "BG101"), ("k = (1 [N/m], 2 [N/m])", "BG111"), ("k = time", "BG106"), ("shift = (1 m, 2 m)", "BG111")],
)  # fmt: skip
def test_attributes_that_are_wrong(attributes: str, code: str) -> None:
    text = (
        SPRING
        + f"model A {{\n  Spring s {{ {attributes} }}\n  1 j\n  I m : p = 1 kg*v\n  j -> m, s.end\n  output y = m.v\n}}\n"
    )
    found = mistake(text, code)
    assert found.span.line == 16


def test_a_parameter_may_not_become_a_signal() -> None:
    text = (
        SPRING
        + "model A {\n  input u = 3 [N/m]\n  Spring s { k = u }\n  1 j\n  I m : p = 1 kg*v\n  j -> m, s.end\n  output y = m.v\n}\n"
    )
    assert mistake(text, "BG106").span.text == "u"


def test_values_that_are_missing() -> None:
    """Reported where the value has to come from, for each instance that lacks it; a model alone may leave them open."""
    part = "model Part { parameter k: N/m, l = 1 m; output y = k*l }\n"
    found = mistakes(part + "model A {\n  Part p\n  Part q { k = 2 [N/m] }\n  output y = q.y + p.y\n}\n")
    assert [d.code for d in found] == ["BG110"] and "`p.k`" in found[0].sentence


def test_open_ports() -> None:
    text = SPRING + "model A {\n  Spring s\n  output y = s.pull\n}\n"
    found = mistakes(text)
    assert found and {d.code for d in found} == {"BG121"} and "`s.end`" in found[0].sentence
    assert mistakes(SPRING) == (), "a model of parts may have open ports"


def test_a_port_takes_one_bond_on_each_side() -> None:
    text = SPRING + "model A {\n  Spring s\n  1 j, l\n  I m, n : p = 1 kg*v\n  j -> m, s.end\n  l -> n, s.end\n}\n"
    found = mistake(text, "BG121")
    assert "Two bonds" in found.sentence and found.related()


def test_the_inside_is_closed_to_bonds() -> None:
    text = SPRING + "model A {\n  Spring s\n  1 j\n  I m : p = 1 kg*v\n  j -> m, s.both\n}\n"
    assert "`s`" in [d for d in mistakes(text) if d.code == "BG101"][0].sentence


@pytest.mark.parametrize("name", ["C", "R", "TF", "splitter"])
def test_a_model_is_not_named_like_a_kind(name: str) -> None:
    """It could never be used."""
    found = mistakes(
        f"model {name} {{ parameter a = 1; output y = a }}\nmodel A {{\n  {name} part {{ a = 2 }}\n  output y = part.y\n}}\n"
    )
    assert found and found[0].span.line == 1 and f"`{name}`" in found[0].sentence


def test_models_cannot_contain_themselves() -> None:
    found = mistakes("model A { B b; output y = 1 }\nmodel B { A a; output y = 1 }\n")
    assert {d.code for d in found} == {"BG107"}


def test_depth_is_limited() -> None:
    models = (
        "".join(f"model M{i} {{ M{i + 1} m; output y = m.y }}\n" for i in range(80)) + "model M80 { output y = 1 }\n"
    )
    assert "BG160" in {d.code for d in mistakes(models)}


class TestNumberOfParts:
    """One limit; its message says what the model would take, and how it is allowed."""

    ROW = "model A {\n  for k in 1..3000 { R r[k] : u = 1 ohm*i; 0 at[k]; at[k] -> r[k] }\n  output y = 1\n}\n"

    def test_five_levels_of_a_hundred_are_not_opened(self) -> None:
        models = (
            "".join(f"model M{i} {{ for i in 1..100 {{ M{i + 1} m[i] }} }}\n" for i in range(5))
            + "model M5 { output y = 1 }\n"
        )
        assert {d.code for d in examine(Source("text", models), most_parts=2000)[0]} == {"BG160"}

    def test_a_loop_foresees_its_parts(self) -> None:
        """3000 rounds, in each a resistor and a junction, and an output: 9001, of 17 kB each."""
        (found,) = examine(Source("text", self.ROW), most_parts=4000)[0]
        assert "more than 4000" in found.sentence
        assert "about 9000 of them, which take some 153 MB of memory" in found.help

    def test_rounds_are_parts(self) -> None:
        """They and the output, before a single one is opened."""
        (found,) = mistakes("model A { for i in 1..1e9 { signal s[i] = i }\n output y = 1 }\n")
        assert "at least 1000000001 of them" in found.help

    @pytest.mark.parametrize(("most", "refused"), [(9001, False), (9000, True)])
    def test_the_setting_is_the_limit(self, most: int, refused: bool) -> None:
        assert bool(examine(Source("text", self.ROW), most_parts=most)[0]) == refused


class TestWhichModelIsRun:
    def test_the_one_that_no_other_uses(self) -> None:
        assert compiled("model B { output y = 1 }\nmodel A { B b; output y = 2 }\n").whole_graph.name == "A"
        assert compiled("model A { B b; output y = 2 }\nmodel B { output y = 1 }\n").whole_graph.name == "A"

    def test_used_in_a_for(self) -> None:
        assert (
            compiled("model B { output y = 1 }\nmodel A { for i in 1..2 { B b[i] }\n output y = 2 }\n").whole_graph.name
            == "A"
        )

    def test_several(self) -> None:
        text = "model A { output y = 1 }\nmodel B { output y = 2 }\n"
        with pytest.raises(Exception, match="BG132"):
            _ = compiled(text).whole_graph
        assert compiled(text, model="B").whole_graph.name == "B"
        assert mistakes(text) == (), "a file of parts is no mistake"

    def test_several_of_which_one_has_no_ports(self) -> None:
        part = "model A {{ port p: electric\n R r : u = 1 ohm*i\n p -> r\n}}\nmodel B {{ {}output y = 2 }}\n"
        with pytest.raises(Exception, match="Name one: `--model B`"):
            _ = compiled(part.format("")).whole_graph
        with pytest.raises(Exception, match=r"is not connected outside(.|\n)*`compile --port p=effort`"):
            _ = compiled(part.format(""), model="A").whole_graph
        with pytest.raises(Exception, match="All are parts, with ports: `import A from"):
            _ = compiled(part.format("port q: electric\n ")).whole_graph

    def test_none_of_that_name(self) -> None:
        with pytest.raises(Exception, match="BG101"):
            _ = compiled("model A { output y = 1 }\n", model="B").whole_graph
