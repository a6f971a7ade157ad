"""The order of declarations does not matter: signals with memory whose units follow from one another, in every order."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

import pytest

import bondgraph
from tests.compiling import compiled, mistakes

RIGHT = {
    "relay": ("h = hysteresis(x, 0, 1)", "x = integral((-1.5 if h else 1)/1 s, 0)", "y = x"),
    "rate": ("x = integral(a, 0)", "a = der(z)", "z = integral(0.5*cos(time/1 s)/1 s, 0)", "y = x - z"),
    "rate of a rate": ("x = integral(a/1 s, 0)", "a = der(z)*1 s", "z = 2*der(w)", "w = integral(3 [m/s], 0 m)", "y = x"),
    "delay": ("x = integral(2*d, 0)", "d = delay(e, 0.5 s)", "e = 3 N - x/1 s", "y = x"),
    "memory within": ("x = integral(e/1 s, 0)", "e = 1 m - x - integral(x/1 s, 0)", "y = x"),
    "loop": ("x = integral((1 m - z)/1 s, 0)", "z = 0.5*z + 0.5*x", "y = z + x"),
}  # fmt: skip
WRONG = {
    "sum": ("x = integral(e/1 [s^2], 0)", "e = 1 m - x", "y = x"),
    "through a rate": ("x = integral(r, 0)", "r = 1 m - der(x)*1 s", "y = r"),
    "two": ("x = integral(z, 0)", "z = integral(x/1 s + 1 m, 0)", "y = x"),
}


def orders(signals: tuple[str, ...]) -> Iterator[str]:
    for order in permutations(signals):
        yield "\n".join(["model A {", *(f"  signal {s}" for s in order), "  output out = y", "}"])


@pytest.mark.parametrize("signals", RIGHT.values(), ids=RIGHT)
def test_every_order_gives_the_same(signals: tuple[str, ...]) -> None:
    """A signal that was read for its unit alone kept the placeholder: a defect of ours was told, in some orders."""
    stages = [compiled(text) for text in orders(signals)]
    assert len({stage.whole_graph.quantities["out"].unit for stage in stages}) == 1
    assert len({len(stage.state_space.states) for stage in stages}) == 1
    found = [bondgraph.load(text).simulate(to=0.4, points=3)["out"] for text in (*orders(signals),)[:: len(stages) - 1]]
    assert found[0] == pytest.approx(found[1], abs=1e-9)


@pytest.mark.parametrize("signals", WRONG.values(), ids=WRONG)
def test_every_order_is_refused(signals: tuple[str, ...]) -> None:
    """Units that contradict each other were taken, where the integral was read before its own unit was known."""
    for text in orders(signals):
        assert "BG103" in {m.code for m in mistakes(text)}, text
