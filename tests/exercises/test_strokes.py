"""Strokes by hand: right is what the rules allow with as many storages in integral form as there can be, and nothing else; each fault has its reason."""

from __future__ import annotations

import re
from itertools import product

import pytest

import bondgraph
from bondgraph import exercises
from bondgraph.exercises.answer import MarkedAnswer
from bondgraph.presentation.text.causality import arrow_of
from compiler.api import Scene, Source
from tests.compiling import MODELS

SERIES = "Se battery : u = 5 V\n1 loop\nR wire : u = 2 ohm*i\nI coil : lambda = 1 mH*i\nC plates : q = 1 uF*u\nbattery -> loop -> wire, coil, plates"
LEVER = "Se push : F = 1 N\n1 left\nI first : p = 1 kg*v\nTF lever : v1 = 2*v2\n1 right\nI second : p = 4 kg*v {}\npush -> left -> first, lever\nlever -> right -> second"
GRAPHS = [
    SERIES,
    LEVER.format(""),
    "Sf pump : i = 1 A\n0 node\nC a : q = 1 uF*u\nC b : q = 2 uF*u\nR r : u = 3 ohm*i\npump -> node -> a, b, r",
    "Se s : u = 1 V\n1 loop\nR a : u = 1 ohm*i\n0 node\nR b : u = 2 ohm*i\nR c : u = 4 ohm*i\ns -> loop -> a, node\nnode -> b, c",
    "Se s : u = 1 V\n1 near\nI a : lambda = 1 H*i\nGY g : u1 = 2 [ohm]*i2\n1 far\nI b : lambda = 3 H*i\nR r : u = 1 ohm*i\ns -> near -> a, g\ng -> far -> b, r",
]  # fmt: skip


def model(text: str) -> bondgraph.Model:
    return bondgraph.load(f"model M {{\n{text}\n}}")


def mark(of: bondgraph.Model, answer: str) -> MarkedAnswer:
    return exercises.mark(of, "strokes", Source("answer.txt", answer), None)


def integral(kinds: dict[str, str], bonds: list[list[str]], strokes: tuple[bool, ...]) -> int | None:
    """Number of storages in integral form by the textbook's rules; None if a rule is broken. `strokes`: True if the tail gives the effort."""
    count = 0
    for node, kind in kinds.items():
        gives = [
            tail is (a == node) for (a, b), tail in zip(bonds, strokes, strict=True) if node in (a, b)
        ]  # the effort, at each bond
        wrong = {
            "Se": gives != [True],
            "Sf": gives != [False],
            "0": gives.count(False) != 1,  # one bond brings the effort in
            "1": gives.count(True) != 1,  # one bond takes the effort, and brings the flow in
            "TF": gives.count(True) != 1,
            "GY": len(set(gives)) != 1,
        }
        if wrong.get(kind):
            return None
        count += gives == [True] if kind == "C" else gives == [False] if kind == "I" else 0
    return count


@pytest.mark.parametrize("text", GRAPHS)
def test_all_strokes_of_small_graphs(text: str) -> None:
    """Beside an enumeration by the rules of the textbook."""
    graph = model(text)
    kinds = {m[2]: m[1] for m in re.finditer(r"^(\w+) +(\w+)(?= :|$)", text, re.MULTILINE)}
    lines = [line for line in exercises.exercise(graph, "strokes", None).splitlines() if not line.startswith("#")]
    bonds = [[name.partition(".")[0] for name in line.split(" -> ")] for line in lines]
    assert {name for bond in bonds for name in bond} == set(kinds)
    counts = {}
    for strokes in product((True, False), repeat=len(bonds)):
        answer = "\n".join(
            line.replace("->", "->|" if tail else "|->") for line, tail in zip(lines, strokes, strict=True)
        )
        counts[answer] = integral(kinds, bonds, strokes)
    best = max(c for c in counts.values() if c is not None)
    assert {a for a in counts if mark(graph, a).right} == {a for a, count in counts.items() if count == best}


def test_reasons() -> None:
    """Of a source, of what follows, of a storage that could be integral, and of lines that are none; all at once, with places."""
    graph = model(SERIES)
    assert exercises.exercise(graph, "strokes", None).splitlines()[1:] == [
        "battery -> loop",
        "loop -> wire",
        "loop -> coil",
        "loop -> plates",
    ]
    wrong = "battery |-> loop  # a\n  loop ->| wire\nloop ->| coil\nloop -> plates\nplates |-> loop\nnothing\n"
    assert mark(graph, wrong).text().splitlines() == [
        "answer.txt:1:1: wrong: battery |-> loop: it is `->|` (`battery`: a source decides it)",
        "answer.txt:2:3: wrong: loop ->| wire: it is `|->` (it follows at `loop` from loop ->| coil)",
        "answer.txt:3:1: right: loop ->| coil",
        "answer.txt:4:1: wrong: loop -> plates: it has no stroke yet",
        "answer.txt:5:1: wrong: plates |-> loop: there is no such bond: its arrow leads the other way, and only the stroke is yours",
        "answer.txt:6:1: wrong: nothing: a line has two names and an arrow, `a ->| b` or `a |-> b`",
    ]
    derivative = "battery ->| loop\nloop ->| wire\nloop |-> coil\nloop |-> plates"
    assert [m.wrong for m in mark(graph, derivative).marks] == ["", "", "`coil` can be in integral form, too", ""]
    assert [m.wrong for m in mark(graph, "battery ->| loop").marks] == ["", *["this line is missing"] * 3]
    assert mark(graph, "").count == "0 of 4 are right"
    twice = [m.wrong for m in mark(graph, "loop ->| wire\n" * 2).marks if m.words == "loop ->| wire"]
    assert twice == ["there is no such bond left", ""]


def test_another_choice_is_told() -> None:
    """Of two masses on a lever either may be the state; what its author wants in derivative form may be so, or not."""
    first = "push ->| left\nleft ->| first\nleft |-> lever.1\nlever.2 |-> right\nright |-> second"
    second = "push ->| left\nleft |-> first\nleft ->| lever.1\nlever.2 ->| right\nright ->| second"
    for wish in ("", "{ prefer = integral }", "{ prefer = derivative }"):
        marks = [mark(model(LEVER.format(wish)), answer) for answer in (first, second)]
        assert all(m.right for m in marks), [m.text() for m in marks]
        assert sorted(bool(m.note) for m in marks) == [False, True]


def test_parts_of_a_model_that_is_one() -> None:
    """The compiler's own strokes are right, with names of instances, loops and numbered junctions, and a switch at its start."""
    for name in ("rc_ladder", "dc_motor", "step_down", "hydraulic_press"):
        graph = bondgraph.load(MODELS / f"{name}.bg")
        causal = graph.compilation(Scene(graph.model, "")).causal
        answer = "\n".join(arrow_of(causal.graph, bond, end) for bond, end in enumerate(causal.effort_from))
        marked = exercises.mark(graph, "strokes", Source("answer.txt", answer))
        assert marked.right and not marked.note and len(marked.marks) == len(causal.graph.bonds), marked.text()
