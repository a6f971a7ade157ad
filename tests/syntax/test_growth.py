"""Work grows with the length of a file and no faster: counted in calls, which do not depend on the machine."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from compiler.examination import check
from compiler.source import Source
from compiler.syntax import parse
from compiler.syntax.blocks import nodes_in
from compiler.syntax.format import format_text
from compiler.syntax.tree import SyntaxNode
from tests.benchmarks.large_files import KINDS

SIZES = (5_000, 20_000)


def calls(action: Callable[[Source], object], text: str) -> int:
    """Number of calls of Python and built-in functions during an action."""
    count = 0

    def counted(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(counted)
    try:
        action(Source("large", text))
    finally:
        sys.setprofile(before)
    return count


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("action", [parse, check, format_text], ids=["parse", "check", "fmt"])
def test_calls_grow_with_the_length(action: Callable[[Source], object], kind: str) -> None:
    texts = [KINDS[kind](size) for size in SIZES]
    action(Source("warm", texts[0]))  # imports, tables of the parser, units that are remembered
    few, many = (calls(action, text) for text in texts)
    assert math.log(many / few) / math.log(len(texts[1]) / len(texts[0])) <= 1.05


@pytest.mark.parametrize(("action", "most"), [(parse, 12), (check, 40)], ids=["parse", "check"])
def test_calls_for_one_character_are_few(action: Callable[[Source], object], most: int) -> None:
    """A rule of the grammar for each precedence, a second tree, or a walk through it whose result nobody reads would be seen here."""
    text = KINDS["ladder"](20_000)
    action(Source("warm", text))
    assert calls(action, text) < most * len(text)


def test_a_walk_meets_all_nodes() -> None:
    """It looks only into fields whose type may hold nodes."""
    text = (Path(__file__).parents[2] / "models" / "four_bar.bg").read_text(encoding="utf-8")
    syntax = parse(Source("four_bar", text))
    stack: list[object] = [syntax.statements]
    every = 0
    while stack:
        item = stack.pop()
        if isinstance(item, tuple):
            stack += item
        elif isinstance(item, SyntaxNode):
            every += 1
            stack += [getattr(item, f.name) for f in fields(item)]  # type: ignore[arg-type]
    assert every == len([*nodes_in(syntax.statements)]) > 200


@pytest.mark.parametrize("kind", KINDS)
def test_the_large_files_are_right(kind: str) -> None:
    assert check(Source("large", KINDS[kind](4_000))) == ()
