"""A file is data: nothing in it makes the parser hang, overflow or slow down more than in proportion to its length."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax import parse, parse_expression
from compiler.syntax import parse as parse_text
from compiler.syntax.parse import MAXIMUM_SIZE


def codes(text: str) -> list[str]:
    with pytest.raises(CompilationFailed) as failed:
        parse_text(Source("t.bg", text))
    return [d.code for d in failed.value.diagnostics]


def signal(expression: str) -> str:
    return f"model A {{\n signal s = {expression}\n}}\n"


@pytest.mark.parametrize(
    "expression",
    [
        "(" * 101 + "1" + ")" * 101,
        "(" * 5000,
        "f(" * 101 + "1" + ")" * 101,
        "a[" * 101 + "1" + "]" * 101,
        "-" * 200 + "1",
        "^".join(["2"] * 200),
        " if a > b else ".join(["1"] * 200),
        "1 if " + "not " * 200 + "a > b else 2",
        "1 if " + " and ".join(["a > b"] * 200) + " else 2",
    ],
    ids=["brackets", "open brackets", "calls", "indices", "signs", "powers", "choices", "negations", "conjunctions"],
)
def test_depth(expression: str) -> None:
    assert codes(signal(expression)) == ["BG004"]


@pytest.mark.parametrize("text", ["0(" * 200 + "a" + ")" * 200 + " -> b", "for i in 1..2 {" * 200 + "}" * 200])
def test_depth_of_statements(text: str) -> None:
    assert codes(f"model A {{\n{text}\n}}") == ["BG004"]


@pytest.mark.parametrize(
    "expression", ["(" * 90 + "1" + ")" * 90, "-" * 90 + "1", "^".join(["1"] * 90), " if a > b else ".join(["1"] * 90)]
)
def test_what_people_write_is_far_from_the_limit(expression: str) -> None:
    assert list(parse(Source("t.bg", signal(expression))).models) == ["A"]


def test_size() -> None:
    assert codes(" " * (MAXIMUM_SIZE + 1)) == ["BG005"]
    assert parse(Source("t.bg", " " * 1_000_000)).models == {}


@pytest.mark.parametrize("number", ["1e999999999", "9" * 100_000, "0." + "0" * 100_000 + "1", "1e-999999999"])
def test_numbers(number: str) -> None:
    assert codes(signal(number)) == ["BG003"]


def power_tower(levels: int) -> str:
    unit = "(2*m)"
    for _ in range(levels):
        unit = f"({unit}^20)"
    return f"3 [{unit}]"


@pytest.mark.parametrize(
    "unit",
    [power_tower(3), power_tower(6), "3 [" + "*".join(["(1e290*m)"] * 50) + "]", "3 [" + "*".join(["m"] * 5000) + "]"],
)
def test_units_stay_small(unit: str) -> None:
    """A unit is bounded while it is read: `((2*m)^20)^20…` must not become a number of a milliard digits."""
    with pytest.raises(CompilationFailed):
        parse_expression(Source("t.bg", unit))


def calls_while(action: Callable[[], object]) -> int:
    """The calls of Python and built-in functions that an action makes: its cost, the same on every machine."""
    count = 0

    def profile(frame: object, event: str, argument: object) -> None:
        nonlocal count
        if event in ("call", "c_call"):
            count += 1

    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        action()
    finally:
        sys.setprofile(before)
    return count


@pytest.mark.parametrize(
    "repeated",
    [
        lambda n: signal(" + ".join(["a*b"] * n)),
        lambda n: signal("*".join(["a"] * n)),
        lambda n: signal("(" + ", ".join(["1"] * n) + ")"),
        lambda n: signal("f(" + ", ".join(["a"] * n) + ")"),
        lambda n: "model A {\n" + "  parameter a: N/m = 2 [N/m] # comment\n" * n + "}",
        lambda n: "model A {\n" + "  1 body { }\n\n\n" * n + "}",
        lambda n: "model A {\n" + " -> ".join(["a[1].b"] * n) + "\n}",
        lambda n: "model A {\n a -> " + ", ".join(["b"] * n) + "\n}",
        lambda n: "model A {\n C c { " + ", ".join(["start x = 1"] * n) + " }\n}",
        lambda n: "model A {\n 1 a" + "; ;\n" * n + "\n}",
        lambda n: "model A { }\n" * n,
        lambda n: "model A { signal s = a" + ".b" * n + " }",
        lambda n: "model A {\n" + "# comment\n" * n + "}",
    ],
    ids=[
        "sum",
        "product",
        "list",
        "arguments",
        "statements",
        "blank lines",
        "chain",
        "fan",
        "attributes",
        "separators",
        "models",
        "path",
        "comments",
    ],
)
def test_parse_time_is_linear(repeated: Callable[[int], str]) -> None:
    """Twice the text costs twice the calls, not four times."""
    small, large = (Source("t.bg", repeated(n)) for n in (400, 1600))
    parse(small)
    few, many = calls_while(lambda: parse(small)), calls_while(lambda: parse(large))
    assert many < 4.4 * few


def test_a_megabyte_of_blank_lines_is_one_token() -> None:
    """Blank lines and comments are taken in one gulp: their number changes nothing."""
    small, large = (Source("t.bg", "model A {\n 1 a" + "\n  # comment" * n + "\n 1 b\n}") for n in (10, 50_000))
    parse(small)
    assert calls_while(lambda: parse(large)) <= calls_while(lambda: parse(small)) + 5
