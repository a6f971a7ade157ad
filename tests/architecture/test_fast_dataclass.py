"""The compiler's `dataclass` beside the standard library's: the same things said of the same classes, but later."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from typing import Any

import pytest

from compiler import fast_dataclass

Decorator = Callable[..., Any]


def classes(dataclass: Decorator) -> dict[str, Any]:
    """Dataclass with all that those of the product have."""

    @dataclass(frozen=True, slots=True)
    class Root:
        span: int

    @dataclass(frozen=True, slots=True)
    class Leaf(Root):
        name: str = "leaf"
        parts: dict[str, int] = dataclasses.field(default_factory=dict, compare=False)
        sum: int = dataclasses.field(init=False, repr=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "sum", self.span + len(self.parts))

    @dataclass(slots=True)
    class Open:
        known: list[int] = dataclasses.field(default_factory=list)
        told: int = 0

    @dataclass(frozen=True, slots=True)
    class Named(Root):
        stands: tuple[int, ...] = dataclasses.field(default=(), kw_only=True, compare=False)
        found: str

    @dataclass(frozen=True, eq=False)
    class Itself:
        value: int

        def __repr__(self) -> str:
            return "itself"

    @dataclass(frozen=True, slots=True)
    class Hashed:
        value: int

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Hashed) and self.value % 7 == other.value % 7

        def __hash__(self) -> int:
            return self.value % 7

    return {c.__name__: c for c in (Root, Leaf, Open, Named, Itself, Hashed)}


OURS, THEIRS = classes(fast_dataclass.dataclass), classes(dataclasses.dataclass)


def outcome(what: Callable[[dict[str, Any]], Any], of: dict[str, Any]) -> Any:
    try:
        return what(of)
    except Exception as problem:
        return type(problem), str(problem)


def changed(thing: Any, name: str, value: Any) -> Any:
    setattr(thing, name, value)
    return getattr(thing, name)


def without(thing: Any, name: str) -> Any:
    delattr(thing, name)
    return hasattr(thing, name)


@pytest.mark.parametrize(
    "what",
    [
        lambda c: repr(c["Leaf"](1)),
        lambda c: repr(c["Leaf"](1, parts={"a": 2}, name="b")),
        lambda c: c["Leaf"](1, parts={"a": 2}).sum,
        lambda c: c["Leaf"](1) == c["Leaf"](1, parts={"a": 2}),  # not what is not compared, but `sum`
        lambda c: c["Leaf"](1) == c["Leaf"](1, "leaf", {}),
        lambda c: c["Leaf"](1) == c["Root"](1),
        lambda c: hash(c["Root"](5)) == hash((5,)),
        lambda c: len({c["Leaf"](1), c["Leaf"](1), c["Leaf"](2)}),
        lambda c: repr(c["Named"](1, "x", stands=(2,))),
        lambda c: c["Named"](1, "x", (2,)),
        lambda c: c["Named"](1, "x", stands=(2,)) == c["Named"](1, found="x"),
        lambda c: hash(c["Open"]()),
        lambda c: c["Open"]().known is not c["Open"]().known,
        lambda c: changed(c["Open"](), "told", 3),
        lambda c: changed(c["Root"](1), "span", 2),
        lambda c: changed(c["Itself"](1), "value", 2),
        lambda c: without(c["Root"](1), "span"),
        lambda c: repr(c["Itself"](1)),
        lambda c: c["Itself"](1) == c["Itself"](1),
        lambda c: (c["Hashed"](1) == c["Hashed"](8), hash(c["Hashed"](8))),
        lambda c: dataclasses.replace(c["Leaf"](1), span=4).sum,
        lambda c: dataclasses.asdict(c["Leaf"](1)),
        lambda c: c["Leaf"].__match_args__,
        lambda c: hasattr(c["Leaf"](1), "__dict__"),
        lambda c: copy.copy(c["Leaf"](1, "x")) == c["Leaf"](1, "x"),
        lambda c: c["Root"].__init__.__qualname__ if c["Root"](1) else "",
    ],
)
def test_it_does_what_the_standard_one_does(what: Callable[[dict[str, Any]], Any]) -> None:
    for _ in range(2):  # before and after its methods are written
        assert outcome(what, OURS) == outcome(what, THEIRS)


@pytest.mark.parametrize("given", [(), (1, "a", {}, 4), (1, 2, 3)])
def test_wrong_arguments_are_refused_in_the_same_words(given: tuple[Any, ...]) -> None:
    assert outcome(lambda c: repr(c["Leaf"](*given)), OURS) == outcome(lambda c: repr(c["Leaf"](*given)), THEIRS)


def test_fast_dataclasses_go_through_pickle() -> None:
    from compiler.source import Source, Span

    span = Span(Source("a", "b\nc"), 1, 2)
    back = pickle.loads(pickle.dumps(span))
    assert (back.start, back.end, back.source.line_starts) == (1, 2, (0, 2))
    with pytest.raises(dataclasses.FrozenInstanceError):
        back.start = 3
