"""Refusals of the builder, and their places: at the wrong call, or with the compiler's own messages."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bondgraph
from bondgraph import Graph, UsageError
from compiler.errors import CompilationFailed
from compiler.semantics.names.scope import RESERVED
from compiler.source import Source
from compiler.syntax import parse, tree

WRONG_NAMES = [
    "",
    "1a",
    "a b",
    "a-b",
    "a.b",
    "é",
    "a\n",
    " a",
    "a}",
    "a[",
    "a[]",
    "a[x]",
    "a[-1]",
    "x[1][2]",
    'a"',
    "a#b",
    None,
    3,
]


def kinds(text: str) -> list[str]:
    """The kinds of the statements of the last model of a text."""
    model = parse(Source("text", text)).statements[-1]
    assert isinstance(model, tree.ModelSyntax)
    return [type(s).__name__ for s in model.statements]


@pytest.mark.parametrize("name", WRONG_NAMES)
def test_what_is_no_name(name: Any) -> None:
    g = Graph("M")
    for call in (
        g.parameter,
        g.one,
        g.zero,
        g.multibody,
        lambda n: g.C(n, "F = k*x"),
        lambda n: g.port(n, "planar"),
        Graph,
    ):
        with pytest.raises(UsageError, match="is no name"):
            call(name)
    assert kinds(g.text()) == []


@pytest.mark.parametrize("name", sorted(RESERVED))
def test_words_of_the_language(name: str) -> None:
    g = Graph("M")
    with pytest.raises(UsageError, match=f"`{name}` is a word of the language"):
        g.parameter(name, 1)
    with pytest.raises(UsageError, match="is a word of the language"):
        g.one("j")[name] if name == "" else g.splitter("s", [name])


@pytest.mark.parametrize("name", ["C", "TF", "splitter", "M[1]"])
def test_kinds_are_no_names_of_models(name: str) -> None:
    with pytest.raises(UsageError, match="cannot be the name of a model"):
        Graph(name)


def test_a_name_is_given_once() -> None:
    g = Graph("M")
    g.parameter("a", 1)
    g.one("j[1]")
    g.one("j[2]")
    before = g.text()
    for name in ("a", "j[1]", "j[ 1]".replace(" ", ""), "j[01]", "j", "a[1]"):
        with pytest.raises(UsageError, match=r"`M` already has `"):
            g.zero(name)
    assert g.text() == before


@pytest.mark.parametrize(
    "text", ['a "quote"', "two\nlines", "\r", "\x00", "\x1b[2J", "\u202eevil", "\u2028", "tab\t", "\ud800", 5]
)
def test_descriptions_stay_in_their_literals(text: Any) -> None:
    g = Graph("M")
    calls = [
        lambda: Graph("M", text),
        lambda: g.parameter("a", 1, "", text),
        lambda: g.one("j", description=text),
        lambda: g.C("c", "F = k*x", description=text),
    ]
    for call in calls:
        with pytest.raises(UsageError, match="a description has no quotation marks"):
            call()
    assert kinds(g.text()) == []


@settings(max_examples=150, deadline=None)
@given(st.text(max_size=30))
def test_any_description_is_kept_or_refused(text: str) -> None:
    g = Graph("M", plain=True)
    try:
        g.parameter("a", 1.5, description=text)
    except UsageError:
        assert '"' in text or not text.isprintable()
        return
    assert g.model().parameters["a"].description == text
    assert len(kinds(g.text())) == 1


@settings(max_examples=150, deadline=None)
@given(
    st.one_of(
        st.text(max_size=12),
        st.from_regex(r"[A-Za-z_][A-Za-z_0-9]{0,8}", fullmatch=True),
        st.sampled_from(sorted(RESERVED)),
    )
)
def test_any_name_is_kept_or_refused(name: str) -> None:
    g = Graph("M", plain=True)
    try:
        g.parameter(name, 2.5)
    except UsageError:
        assert not re.fullmatch(r"[A-Za-z_][A-Za-z_0-9]*", name) or name in RESERVED
        return
    assert g.model().parameters[name].value == 2.5


@settings(max_examples=150, deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["", "N*s/m", "V", "kg*m^2"]))
def test_any_number_comes_back(value: float, unit: str) -> None:
    g = Graph("M")
    g.parameter("a", value, unit)
    assert g.model().parameters["a"].value == value


TOKENS = ["F", "=", "k", "x", "*", "+", "1", "N", "m", ".", "(", ")", "[", "]", "{", "}", ",", ";", ":", "\n", "\r", "#", '"', "'", " ", "->", "=>",
          "model", "Se", "output", "y", " if ", " to ", " in ", "..", "\\", "\x00", "\u2028", "\u202e", "$", "^"]  # fmt: skip
HOSTILE = st.one_of(st.text(max_size=20), st.lists(st.sampled_from(TOKENS), max_size=14).map("".join))


def spots(g: Graph) -> dict[str, Any]:
    """Every place that takes a text -> a call that puts it there."""
    part = Graph("Inner")
    part.parameter("a")
    stage, j = g.multibody("stage"), g.one("j")
    return {
        "law": lambda t: g.C("c", t),
        "energy": lambda t: g.C("c", energy=t),
        "start": lambda t: g.C("c", "F = x", start={"x": t}),
        "what starts": lambda t: g.C("c", "F = x", start={t: "1 m"}),
        "prefer": lambda t: g.C("c", "F = x", prefer=t),
        "port": lambda t: g.C("c", "F = x", ports=(t, "b")),
        "port's domain": lambda t: g.C("c", "F = x", ports={"a": t}),
        "name": lambda t: g.R(t, "F = v"),
        "description": lambda t: g.zero("z", description=t),
        "domain": lambda t: g.zero("z", t),
        "value": lambda t: g.parameter("p", t),
        "item": lambda t: g.parameter("p", ("1", t)),
        "unit": lambda t: g.parameter("p", 1, t),
        "passed": lambda t: g.instance("i", part, a=t),
        "passed to": lambda t: g.instance("i", part, **{t: 1}),
        "model": lambda t: g.instance("i", t),
        "place": lambda t: g.bond(j, t),
        "where": lambda t: stage.body("b", at=(0, t)),
        "along": lambda t: stage.slide("s", "ground", "ground", along=t),
        "body": lambda t: stage.weld("w", t, "ground"),
        "settings": lambda t: g.experiment("e", 1, settings={"a": t}),
        "set": lambda t: g.experiment("e", 1, settings={t: 1}),
        "end": lambda t: g.experiment("e", t),
        "report": lambda t: g.experiment("e", 1, report=[t]),
        "report's unit": lambda t: g.experiment("e", 1, report={"a": t}),
    }


def shape(text: str) -> list[tuple[str, int]]:
    """Statements of all models of a text, with the number of statements in each."""
    found: list[tuple[str, int]] = []
    for outer in parse(Source("text", text)).statements:
        inner = outer.statements if isinstance(outer, tree.ModelSyntax) else ()
        found.append((type(outer).__name__, len(inner)))
        for s in inner:
            many = getattr(s, "statements", getattr(s, "steps", getattr(s, "attributes", getattr(s, "items", ()))))
            found.append((type(s).__name__, len(many)))
    return found


# What stands in each place when it is harmless: the text must have the same statements whatever is put there.
HARMLESS = {
    "law": "F = x", "prefer": "effort", "port": "a", "port's domain": "electric", "name": "r", "domain": "electric", "unit": "N",
    "description": "told", "model": "electric.Diode", "body": "ground", "report's unit": "mm", "place": "j",
}  # fmt: skip


@pytest.mark.few(12)
@pytest.mark.parametrize("spot", sorted(spots(Graph("M"))))
@settings(max_examples=60, deadline=None)
@given(HOSTILE)
def test_no_text_leaves_its_place(spot: str, text: str) -> None:
    expected, g = Graph("M"), Graph("M")
    before = shape(g.text())
    assert before == [("ModelSyntax", 0)]
    spots(expected)[spot](HARMLESS.get(spot, "a"))
    call = spots(g)[spot]
    before = shape(g.text())
    try:
        call(text)
    except (UsageError, CompilationFailed):
        assert shape(g.text()) == before
        return
    found, wanted = shape(g.text()), shape(expected.text())
    if spot in ("description", "domain", "port's domain") and text == "":
        return
    assert found == wanted, g.text()


BREAKING = [
    "F = k*x; Se evil : F = 1 N",
    "F = k*x\nSe evil : F = 1 N",
    "F = k*x }\nmodel Evil { C y : F = 1 N",
    "F = k*x } model Evil { C y : F = 1 N*x",
    "F = k*x { start x = 1 mm }",
    'F = k*x "told"',
    "F = k*x # and a comment",
    "F = k*x { } -> a",
    "translation",
    "k*x",
    "",
    "F = k*x,",
    "F = __import__('os')",
    "F = k*x \x00",
    "F = (k*x",
    "F = k*x)",
]


@pytest.mark.parametrize("law", BREAKING)
def test_a_law_is_one_law(law: str) -> None:
    g = Graph("M")
    for call in (g.C, g.I, g.R, g.Se, g.MSe, g.TF, g.GY):
        with pytest.raises((UsageError, CompilationFailed)):
            call("a", law)
    assert kinds(g.text()) == []


@pytest.mark.parametrize("law", [law for law in BREAKING if law not in ("translation", "k*x")])
def test_an_energy_is_one_expression(law: str) -> None:
    g = Graph("M")
    with pytest.raises((UsageError, CompilationFailed)):
        g.C("a", energy=law)
    assert kinds(g.text()) == []


@pytest.mark.parametrize(
    "value",
    [
        "1 N; output y = 2",
        "1\noutput y = 2",
        "1 }",
        "1, y = 2",
        '1 "text"',
        "1 # no",
        "= 1",
        "",
        "1 [N",
        "a -> b",
        "1..2",
    ],
)
def test_a_value_is_one_expression(value: str) -> None:
    g = Graph("M")
    part = Graph("Part")
    part.parameter("a")
    for call in (
        lambda: g.parameter("a", value),
        lambda: g.output("a", value),
        lambda: g.parameter("a", ("1", value)),
        lambda: g.C("c", "F = 1 [N/m]*x", start={"x": value}),
        lambda: g.instance("p", part, a=value),
        lambda: g.multibody("m", gravity=(0, value)),
    ):
        with pytest.raises((UsageError, CompilationFailed)):
            call()
    assert kinds(g.text()) == []


@pytest.mark.parametrize(
    "unit", ["N]*1 [N", "N = 5", "N\nm", "N, b", "N]", "[N]", "N; m", '"', "1 2", "N*", "foo", "N*foo", "degC*m"]
)
def test_a_unit_is_one_unit(unit: str) -> None:
    g = Graph("M")
    with pytest.raises((UsageError, CompilationFailed)):
        g.parameter("a", 1, unit)
    assert kinds(g.text()) == []


@pytest.mark.parametrize("place", ["a; b -> c", "a -> b", "a.b + 1", "", "a\n-> c", "1", "0(a, b)", "a."])
def test_a_place_is_one_place(place: str) -> None:
    g = Graph("M")
    j = g.one("j")
    with pytest.raises((UsageError, CompilationFailed)):
        g.bond(j, place)
    with pytest.raises((UsageError, CompilationFailed)):
        g.bond(place, j)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10**400])
def test_numbers_are_finite(value: float) -> None:
    with pytest.raises(UsageError, match="`a` is no finite number"):
        Graph("M").parameter("a", value)


@pytest.mark.parametrize("value", [True, b"12", {"a": 1}, object(), 1j, {1, 2}, lambda: 1])
def test_other_values(value: Any) -> None:
    with pytest.raises(UsageError, match="is a number, a text of the language, or a list"):
        Graph("M").parameter("a", value)


def test_calls_that_make_no_sense() -> None:
    g, other = Graph("M"), Graph("Other")
    j = g.one("j")
    spring = g.C("spring", "F = 1 [N/m]*x")
    plates = g.C("plates", energy="a^2", ports=("a", "b"))
    refusals: list[tuple[str, Any]] = [
        ("an energy stands in a storage (C, I, IC), in place of its law", lambda: g.I("c", "p = m*v", energy="p^2")),
        ("an energy stands in a storage", lambda: g.R("c", "", energy="p^2")),
        ("there is no domain 'mechanical'", lambda: g.one("k", "mechanical")),
        ("there is no domain", lambda: g.C("c", "a.F = a.x", ports={"a": "mechanical"})),
        ("have different names", lambda: g.C("c", "a.F = a.x", ports=["a", "a"])),
        ("have different names", lambda: g.C("c", "a.F = a.x", ports=["a[1]"])),
        ("`plates` has no port `c`; its ports: a, b", lambda: plates["c"]),
        ("`spring` has no port `x`; its ports: one, without a name", lambda: spring["x"]),
        ("a bond has two ends", lambda: g.bond(j)),
        ("which goes to which is not guessed", lambda: g.bond((j, spring), (j, spring))),
        ("belongs to the graph `Other`", lambda: j >> other.one("j")),
        ("is one of integral, derivative, effort, flow", lambda: g.R("r", "F = v", prefer="both")),
        ("`start x` of `c`: a number needs its unit here", lambda: g.C("c", "F = k*x", start={"x": 1e-3})),
        (
            "numbers are of x, y, z, d, v, omega, phi, phi1, phi2, rx, ry, rz, not `F`",
            lambda: g.multibody("m0").hinge("h", "ground", "ground", start={"F": 1}),
        ),
        (
            "already uses another model `Same`",
            lambda: (g.instance("s1", Graph("Same")), g.instance("s2", Graph("Same"))),
        ),
        ("an instance is one of a model, not of 5", lambda: g.instance("s3", 5)),
        ("`c` needs its law, or its energy", lambda: g.C("c")),
        ("`r` needs its law", lambda: g.R("r", "")),
        ("`start` of `c` is a mapping, {name: value}, not 5", lambda: g.C("c", "F = k*x", start=5)),
        ("`settings` is a mapping", lambda: g.experiment("e", 1, settings=["a"])),
        ("already has an experiment `twice`", lambda: [g.experiment("twice", 1) for _ in "12"]),
        ("a plain graph has no units", lambda: Graph("P", plain=True).parameter("a", 1, "m")),
        ("a list has an item or more", lambda: g.parameter("a", [])),
        ("axes are from, to, middle or world", lambda: g.multibody("m1").free("f", "ground", "ground", axes="x")),
        ("`m2` has no body `b`", lambda: g.multibody("m2").hinge("h", "ground", "b")),
        ("cannot contain itself", lambda: g.instance("i", g)),
        ("is no model of the library", lambda: g.instance("i", "Diode")),
        ("name one", lambda: g.instance("i", bondgraph.load("model A {\n}\nmodel B {\n}"))),
        ("defines no model `C`", lambda: g.instance("i", bondgraph.load("model A {\n}\nmodel B {\n}", "C"))),
        ("counted from 1", lambda: list(g.parameter("list", (1, 2)))),
    ]
    for message, call in refusals:
        with pytest.raises(UsageError, match=re.escape(message)):
            call()
    for wrong in (
        lambda: g.R("r", "F = v", begin={}),
        lambda: g.bond(j, 5),
        lambda: g.C("c", "F = x", ports="xy"),
        lambda: g.R("r", 5),
    ):
        with pytest.raises(UsageError):
            wrong()


def test_graphs_that_contain_each_other() -> None:
    a, b = Graph("A"), Graph("B")
    a.instance("b", b)
    with pytest.raises(UsageError, match="`B` cannot contain itself"):
        b.instance("a", a)


def test_mistakes_of_meaning_are_told_as_for_text() -> None:
    """The compiler's own messages, under the names that were given in Python."""
    g = Graph("M")
    g.parameter("k", 100, "N")
    g.Se("push", "F = speed") >> g.one("body") >> (g.C("spring", "F = k*x"), g.I("mass", "p = 1 kg*v"))
    g.input("speed", 0, "N")
    found = g.check()
    assert len(found) == 2
    said = "\n".join(d.sentence + d.help for d in found)
    assert "The two sides of the law of `spring` differ: `F` is in [N], but `k*x` is in [N*m]" in said
    assert "`speed`" in said and "`MSe push`" in said
    assert [d.span.place for d in found] == ["M.bg:5:17", "M.bg:7:14"]
    with pytest.raises(CompilationFailed, match="law of `spring`"):
        g.model().simulate(to=1.0)


def test_syntax_is_told_where_it_is_given() -> None:
    with pytest.raises(CompilationFailed, match=r"the law of `spring`:1:7: BG007: This `\(` is never closed"):
        Graph("M").C("spring", "F = k*(x")
    with pytest.raises(CompilationFailed, match="the value of `a`:1:"):
        Graph("M").parameter("a", "1 +")
