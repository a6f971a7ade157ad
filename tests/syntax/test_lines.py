"""Ends of statements: the rules of "Words, numbers, lines", and every trap of sketches/traps.bg."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import pytest

from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax import parse, tree

N = TypeVar("N", bound=tree.SyntaxNode)


def statements(body: str) -> tuple[tree.SyntaxNode, ...]:
    (model,) = parse(Source("t.bg", f"model A {{\n{body}\n}}")).statements
    assert isinstance(model, tree.ModelSyntax)
    return model.statements


def only(kind: type[N], body: str) -> N:
    (found,) = statements(body)
    assert isinstance(found, kind)
    return found


@pytest.mark.parametrize(
    "body",
    [
        "signal s = a +\n b",
        "signal s = a -\n\n\n b",
        "signal s = a *   # a comment\n b",
        "signal s = a /\n # a comment\n\n b",
        "signal s = a ^\n 2",
        "signal s =\n a",
        "signal s:\n N/m = a",
        "signal s = a\n + b",
        "signal s = a\n\n  # a comment\n\n - b",
        "signal s = a\n * b\n / c\n ^ 2",
        "signal s\n = a",
        "signal s\n : N = a",
        "signal s = a\n if b > c\n else d",
        "signal s = a if b > c and\n d > e or\n f > g else\n h",
        "signal s = 1 if a\n < b else 0",
        "signal s = 1 if a\n != b else 0",
        "signal s = a if b\n >= c\n and d == e\n or f < g else h",
        "signal s = (a\n b_is_missing_no +\n c)".replace("b_is_missing_no +", "+ b +"),
        "signal s = f(a,\n\n b\n , c\n )",
        "signal s = gap[\n i\n +1\n]",
        "signal s = (\n a\n ,\n b\n)",
        "signal s = 2 [\n N\n / m\n]",
        "signal s = a  # + not an operator\n",
    ],
)
def test_goes_on(body: str) -> None:
    """One statement, with one name, for any line breaks."""
    found = only(tree.Quantities, body)
    assert [i.name for i in found.items] == ["s"]
    assert found.items[0].value is not None


@pytest.mark.parametrize(
    ("body", "names"),
    [
        ("signal s = a\nsignal t = b", ["s", "t"]),
        ("signal s = a; signal t = b", ["s", "t"]),
        ("signal s = a;;\n;\n signal t = b;", ["s", "t"]),
        ("signal s = a # comment ; +\nsignal t = b", ["s", "t"]),
        ("signal s = a,\n  t = b", ["s", "t"]),
        ("signal s = a\n, t = b", ["s", "t"]),
        ("signal s = a\r\nsignal t = b\r\n\r\n , u = c", ["s", "t", "u"]),
        ("signal s = a\n\t\tsignal\tt\t=\tb", ["s", "t"]),
    ],
)
def test_ends(body: str, names: list[str]) -> None:
    items = [i.name for q in statements(body) if isinstance(q, tree.Quantities) for i in q.items]
    assert items == names


@pytest.mark.parametrize("name", ["iff", "if_", "order", "andy", "else_1", "or2", "If"])
def test_names_that_begin_like_an_operator(name: str) -> None:
    """`if else and or` go on with a line, names that begin with these letters do not."""
    first, second = statements(f"signal s = a\n{name} -> b")
    assert isinstance(first, tree.Quantities)
    assert isinstance(second, tree.Bonds)
    assert [p.head for group in second.places for p in group if isinstance(p, tree.PathSyntax)] == [name, "b"]


def test_bonds_go_on() -> None:
    bonds = only(tree.Bonds, "a\n  -> b ->\n\n c,  # fan\n d\n\n , e\n => f")
    assert bonds.arrows == ("->", "->", "=>")
    assert [[p.head for p in group if isinstance(p, tree.PathSyntax)] for group in bonds.places] == [
        ["a"],
        ["b"],
        ["c", "d", "e"],
        ["f"],
    ]


def test_a_negative_number_on_its_own_line_is_a_difference() -> None:
    """No statement begins with an operator, so this is not a choice."""
    found = only(tree.Quantities, "signal s = a\n -1")
    assert isinstance(found.items[0].value, tree.Sum)


def test_junctions_are_no_numbers() -> None:
    one, zero, quantities, bonds = statements("1 body\n0 line : electric; parameter one = 1\nbody -> 0(1(a, b))")
    assert isinstance(one, tree.Declaration) and (one.kind, one.names[0].name) == ("1", "body")
    assert isinstance(zero, tree.Declaration) and (zero.kind, zero.names[0].name) == ("0", "line")
    assert isinstance(quantities, tree.Quantities) and isinstance(quantities.items[0].value, tree.Literal)
    assert isinstance(bonds, tree.Bonds)
    nest = bonds.places[1][0]
    assert isinstance(nest, tree.Nest) and nest.kind == "0"
    (inner,) = nest.members
    assert isinstance(inner, tree.Nest) and inner.kind == "1" and len(inner.members) == 2


def test_attributes_by_commas_lines_and_semicolons() -> None:
    (found,) = statements("C c : F = k*x { start x = 1\n nominal x = 2; prefer = integral, require = effort\n\n}")
    assert isinstance(found, tree.Declaration)
    assert [(a.name, a.target.words if a.target else None) for a in found.attributes] == [
        ("start", "x"), ("nominal", "x"), ("prefer", None), ("require", None),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "body", ["signal s = a b", "signal s = 2 um um", "signal s = 3 (4)", "a -> b c", "signal s = 3 [N] m", "1 a 0 b"]
)
def test_what_needs_a_line_break(body: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        statements(body)
    assert [d.code for d in failed.value.diagnostics] == ["BG001"]


class TestTraps:
    """sketches/traps.bg, trap by trap."""

    models = parse(
        Source("traps.bg", (Path(__file__).parent / "sketches" / "traps.bg").read_text(encoding="utf-8"))
    ).models
    traps = models["Traps"].statements
    more = models["MoreTraps"].statements

    def items(self) -> dict[str, tree.Item]:
        return {i.name: i for q in self.traps if isinstance(q, tree.Quantities) for i in q.items}

    def test_a_kind_is_a_name_too(self) -> None:
        first = self.traps[1]
        assert isinstance(first, tree.Declaration) and (first.kind, first.names[0].name) == ("C", "C")
        assert isinstance(self.items()["C"].value, tree.Literal)

    def test_a_number_before_a_line_break_takes_no_unit_from_the_next_line(self) -> None:
        value = self.items()["n"].value
        assert isinstance(value, tree.Literal) and value.number == 100 and value.unit is None
        folded = self.traps[3]
        assert isinstance(folded, tree.Declaration) and (folded.kind, folded.names[0].name) == ("C", "folded")

    def test_a_list_over_two_lines(self) -> None:
        items = self.items()
        assert {"m", "k", "to", "if_"} <= items.keys()
        value = items["m"].value
        assert isinstance(value, tree.Literal) and value.unit is not None and value.unit.factors[0][0] == "kg"

    def test_one_unit_symbol_and_no_more(self) -> None:
        """`3 N*m` is three newtons times the parameter m."""
        total = self.items()["a"].value
        assert isinstance(total, tree.Sum) and len(total.terms) == 2
        for (_, term), number in zip(total.terms, (3, 4), strict=True):
            assert isinstance(term, tree.Product)
            (_, literal), (direction, path) = term.factors
            assert isinstance(literal, tree.Literal) and literal.number == number and literal.unit is not None
            assert literal.unit.factors[0][0] == "N" and direction == 1
            assert isinstance(path, tree.PathSyntax) and path.head == "m"

    def test_lines_that_go_on(self) -> None:
        items = self.items()
        b, c, d, w = (items[n].value for n in "bcdw")
        assert isinstance(b, tree.Sum) and [s for s, _ in b.terms] == [1, -1]
        assert isinstance(c, tree.Negative) and isinstance(c.operand, tree.Power)
        assert isinstance(d, tree.Power) and isinstance(d.exponent, tree.Negative)
        assert (
            isinstance(w, tree.ChoiceSyntax) and isinstance(w.condition, tree.Logical) and w.condition.operator == "and"
        )
        inner = w.condition.operands[1]
        assert (
            isinstance(inner, tree.Logical)
            and inner.operator == "not"
            and isinstance(inner.operands[0], tree.Comparison)
        )

    def test_junctions_between_semicolons(self) -> None:
        junctions = [s for s in self.traps if isinstance(s, tree.Declaration) and s.kind in "01"]
        assert [(j.kind, j.names[0].name) for j in junctions] == [("1", "body"), ("0", "in_line"), ("1", "I")]

    def test_a_chain_over_a_comment(self) -> None:
        (bonds,) = (s for s in self.traps if isinstance(s, tree.Bonds))
        assert [[p.head for p in g if isinstance(p, tree.PathSyntax)] for g in bonds.places] == [
            ["C"],
            ["I"],
            ["body", "folded"],
        ]

    def test_an_experiment_in_one_line(self) -> None:
        (experiment,) = (s for s in self.traps if isinstance(s, tree.Experiment))
        sweep, simulate, report = experiment.steps
        assert isinstance(sweep, tree.SweepSyntax) and len(sweep.values) == 2 and sweep.unit is not None
        assert isinstance(simulate, tree.Simulate) and [a.name for a in simulate.attributes] == ["steps", "rtol"]
        assert isinstance(report, tree.Report) and report.readings[1].unit is not None
        assert report.readings[0].unit is None and len(report.readings[1].unit.factors) == 3

    def test_units_with_brackets_and_roots(self) -> None:
        first = self.more[0]
        assert isinstance(first, tree.Quantities)
        c, gain, temperature = first.items
        assert c.unit is not None and {(n, e) for n, e, _ in c.unit.factors} == {("J", 1), ("kg", -1), ("K", -1)}
        assert gain.unit is not None and {(n, e) for n, e, _ in gain.unit.factors} == {("V", 1), ("m", Fraction(-1, 2))}
        assert isinstance(temperature.value, tree.Literal) and temperature.value.unit is not None

    def test_names_that_share_the_rest(self) -> None:
        declaration = self.more[1]
        assert isinstance(declaration, tree.Declaration) and isinstance(declaration.definition, tree.LawSyntax)
        a, b = declaration.names
        assert a.index is None and b.index is not None and [c.name for c in b.components] == ["x", "y"]

    def test_nests(self) -> None:
        first, second = (s for s in self.more if isinstance(s, tree.Bonds))
        assert first.arrows == ("->", "->")
        assert isinstance(second.places[0][0], tree.Nest)

    def test_a_condition_as_attribute(self) -> None:
        last = self.more[-1]
        assert isinstance(last, tree.Declaration) and isinstance(last.attributes[0].value, tree.Comparison)
