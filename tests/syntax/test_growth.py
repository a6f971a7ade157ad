"""Work grows with the length of a file and no faster: counted in calls, which do not depend on the machine."""

from __future__ import annotations

import gc
import math
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from compiler.examination import check
from compiler.garbage_collection import FEW, uncollected
from compiler.source import Source
from compiler.syntax import parse
from compiler.syntax.format import format_text
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


def test_calls_for_one_character_are_few() -> None:
    """A rule of the grammar for each precedence, or a second tree, would be seen here."""
    text = KINDS["ladder"](20_000)
    parse(Source("warm", text))
    assert calls(parse, text) < 12 * len(text)


@pytest.mark.parametrize("kind", KINDS)
def test_the_large_files_are_right(kind: str) -> None:
    assert check(Source("large", KINDS[kind](4_000))) == ()


class TestCollection:
    """Collections of cycles after work that makes many objects: the most new objects that one of them walks through."""

    @staticmethod
    def walked_through(objects: int) -> int:
        walked = [0]

        def seen(phase: str, info: dict[str, int]) -> None:
            if phase == "start":
                walked.append(len(gc.get_objects(generation=0)))

        with uncollected():
            kept = [[number] for number in range(objects)]
            gc.callbacks.append(seen)
        try:
            kept += [[number] for number in range(10_000)]
        finally:
            gc.callbacks.remove(seen)
        return max(walked)

    def test_objects_of_one_large_model_are_not_walked_through(self) -> None:
        frozen = gc.get_freeze_count() > 0  # as long runs of tests have it
        gc.unfreeze()
        try:
            many = len(gc.get_objects(generation=2)) + 2 * FEW
            assert self.walked_through(many) < FEW
            assert gc.isenabled()
            assert gc.get_freeze_count() == 0
        finally:
            if frozen:
                gc.freeze()

    def test_those_of_small_models_are(self) -> None:
        """What is left of one of many models in a row is found soon."""
        assert self.walked_through(FEW // 2) > FEW // 2

    def test_what_a_process_has_frozen_stays_so(self) -> None:
        before = gc.get_freeze_count()
        gc.freeze()
        frozen = gc.get_freeze_count()
        assert self.walked_through(2 * FEW) > 2 * FEW
        assert gc.get_freeze_count() == frozen
        if not before:
            gc.unfreeze()
