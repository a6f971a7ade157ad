"""Every node has its place: line, column and text, after any line ends, tabs and comments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

from compiler.source import Source, Span
from compiler.syntax import parse, tree

SKETCHES = sorted((Path(__file__).parent / "sketches").glob("*.bg"))

TEXT = """\
"Füße — a description with letters of two bytes."
# a comment: ä ö ü
model Oscillator {
  parameter mass = 1 kg,
            k: N/m = 2*(3 + 4)
\tC spring[2] : F = k*x + 1/2*sin(phi)   { start x = 1 mm }
  a -> 0(b.c[1], spring[2])
}
"""


def nodes(node: Any) -> Iterator[tree.SyntaxNode]:
    if isinstance(node, tree.SyntaxNode):
        yield node
    if isinstance(node, tuple):
        for item in node:
            yield from nodes(item)
    elif is_dataclass(node) and not isinstance(node, Source | Span):
        for item in fields(node):
            yield from nodes(getattr(node, item.name))


def places(text: str, kind: type[tree.SyntaxNode]) -> list[tuple[int, int, str]]:
    statements = parse(Source("t.bg", text)).statements
    return [(n.span.line, n.span.column, n.span.text) for n in nodes(statements) if type(n) is kind]


def test_lines_and_columns() -> None:
    """Columns count characters from 1; a tab and an umlaut are one each."""
    assert [p[:2] for p in places(TEXT, tree.Item)] == [(4, 13), (5, 13)]
    assert places(TEXT, tree.Item)[0] == (4, 13, "mass = 1 kg")
    assert places(TEXT, tree.Declared) == [(6, 4, "spring")]
    assert (6, 20, "k") in places(TEXT, tree.PathSyntax) and (7, 10, "b.c[1]") in places(TEXT, tree.PathSyntax)
    assert places(TEXT, tree.Attribute) == [(6, 43, "start x = 1 mm")]
    assert (4, 20, "1 kg") in places(TEXT, tree.Literal)
    assert (5, 16, "N/m") in places(TEXT, tree.Unit) and (6, 55, "mm") in places(TEXT, tree.Unit)
    assert [p[:2] for p in places(TEXT, tree.Description)] == [(1, 1)]
    assert [p[:2] for p in places(TEXT, tree.Bonds)] == [(7, 3)]


def test_windows_line_ends() -> None:
    windows = TEXT.replace("\n", "\r\n")
    for kind in (tree.Item, tree.Declared, tree.Attribute, tree.Literal):
        assert [p[:2] for p in places(windows, kind)] == [p[:2] for p in places(TEXT, kind)]


@pytest.mark.parametrize("path", SKETCHES, ids=lambda p: p.stem)
def test_spans_of_the_sketches(path: Path) -> None:
    """Names are at their spans, numbers begin with their digit, operands lie within their operator."""
    source = Source(path.name, path.read_text(encoding="utf-8"))
    count = 0
    for node in nodes(parse(source).statements):
        span = node.span
        count += 1
        assert span.source is source and 0 <= span.start < span.end <= len(source.text)
        text = span.text
        assert source.line(span.line)[span.column - 1 :].startswith(text.split("\n")[0])
        match node:
            case tree.PathSyntax():
                assert text.startswith(node.head) and node.words == "".join(text.split())
            case tree.Declared() | tree.Item() | tree.PortItem() | tree.FunctionSyntax():
                assert text.startswith(node.name)
            case tree.Literal():
                assert text[0].isdigit()
            case tree.Call():
                assert text.startswith(node.function + "(")
            case tree.ModelSyntax():
                assert node.name_span.text == node.name
        if isinstance(node, tree.ExpressionSyntax):
            for child in nodes(tuple(getattr(node, f.name) for f in fields(node) if f.name != "span")):
                assert span.start <= child.span.start and child.span.end <= span.end
    assert count > 20


@pytest.mark.parametrize("text", ["a, b -> c", "a -> b, c", "a, b.x -> 1(r, s) -> c, d[1]"])
def test_bonds_go_from_their_first_place_to_their_last(text: str) -> None:
    statements = parse(Source("t.bg", f"model A {{ {text} }}")).statements
    assert [n.span.text for n in nodes(statements) if isinstance(n, tree.Bonds)] == [text]


def expression_texts(text: str) -> set[str]:
    statements = parse(Source("t.bg", f"model A {{ signal s = {text} }}")).statements
    return {n.span.text for n in nodes(statements) if isinstance(n, tree.ExpressionSyntax)}


@pytest.mark.parametrize(
    "text",
    [
        "(a + b)*c",
        "c*(a + b)",
        "max(a, b) + c",
        "-(a + b)",
        "-a^2",
        "(a, b)",
        "sin(a)",
        "f(g(a), (b))",
        "1 if (a > b) else (c)",
        "gap[(i)]",
        "not_(a)",
    ],
)
def test_a_quoted_expression_is_whole(text: str) -> None:
    """Messages quote expressions: no bracket is lost."""
    found = expression_texts(text)
    assert text in found
    assert all(part.count("(") == part.count(")") for part in found), found


@pytest.mark.parametrize("number", ["2 [N/m]", "2 [ N/m ]", "2 mm", "2"])
def test_a_number_is_whole_with_the_bracket_of_its_unit(number: str) -> None:
    assert [text for _, _, text in places(f"model M {{ parameter a = {number}, b = 1 }}", tree.Literal)] == [
        number,
        "1",
    ]
    assert f"3*{number}" in expression_texts(f"3*{number}")


def test_a_line_on_request() -> None:
    source = Source("t", "one\ntwo\r\n\nfour")
    assert [source.line(i) for i in (1, 2, 3, 4)] == ["one", "two", "", "four"]
    span = Span(source, 10, 14)
    assert (span.place, span.text) == ("t:4:1", "four")
    assert Span(source, 0, 3).to(span).text == source.text
