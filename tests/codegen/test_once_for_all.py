"""Flat text costs as little as arrays: of elements that have a law in the same words, only the first has it compiled and solved.

Counted in calls, which do not depend on the machine."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from types import FrameType

import pytest

from compiler.compilation import Compilation
from compiler.examination import check
from compiler.scene import Scene
from compiler.source import Source
from tests.benchmarks import large_models

WORK = {"compile_law", "_energy", "_balance"}  # a law read, its energy found, a junction's sum written


def calls(text: str) -> tuple[dict[str, int], int]:
    """Numbers of calls of the functions of `WORK` on the way from text to a lowered program, and the number of all calls."""
    counts, total = dict.fromkeys(WORK, 0), 0

    def counted(frame: FrameType, event: str, argument: object) -> None:
        nonlocal total
        if event == "call":
            total += 1
            name = frame.f_code.co_name
            if name in counts:
                counts[name] += 1

    compilation = Compilation(Source("ladder.bg", text), Scene(None, ""))
    before = sys.getprofile()
    sys.setprofile(counted)
    try:
        _ = compilation.lowered
    finally:
        sys.setprofile(before)
    return counts, total


@pytest.mark.parametrize("make", [large_models.rc_ladder, large_models.lc_ladder], ids=["RC", "LC"])
def test_laws_are_made_once(make: Callable[[int], str]) -> None:
    calls(make(5))  # imports, units that are remembered
    (few, small), (many, large) = calls(make(20)), calls(make(80))
    assert few == many
    assert 0 < many["compile_law"] <= 6
    assert math.log(large / small) / math.log(4) <= 1.05


def test_other_words_are_another_law() -> None:
    text = large_models.rc_ladder(6).replace("R wire_3 : u = 10 ohm*i", "R wire_3 : u = 11 ohm*i")
    usual, changed = (calls(t)[0]["compile_law"] for t in (large_models.rc_ladder(6), text))
    assert changed == usual + 1


def test_equal_words_in_another_domain() -> None:
    """A law that is right beside a coil is wrong beside a mass, and is reported there."""
    text = """model M {
  Se a : u = 1 V
  Se b : F = 1 N
  R r : e = 2 [ohm]*f
  R d : e = 2 [ohm]*f
  I l : lambda = 1 mH*i
  I m : p = 1 kg*v
  a -> 1(r, l)
  b -> 1(d, m)
  output x = r.i, y = d.v
}"""
    (found,) = check(Source("two.bg", text))
    assert (found.code, found.span.line) == ("BG103", 5)
    assert "`d`" in found.sentence
