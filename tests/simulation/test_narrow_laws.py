"""Laws of states that are other than zero within a small part of a step alone: a step that passes them whole sees them at their kinks."""

from __future__ import annotations

from math import sqrt

import pytest

import bondgraph

# Laws of area `width`, around a place.
LAWS = {
    "triangle": "max(0, 1 - abs(x - {c})/{w})",
    "wedge": "max(0, min((x - {c})/{w} + 1, 1 - (x - {c})/{w}))",
    "table": "linear(x, (-9, {c} - {w}, {c}, {c} + {w}, 9), (0, 0, 1, 0, 0))",
    "trapezoid": "2/3*(ramp(x, {c} - {w}, {c} - 0.5*{w}) - ramp(x, {c} + 0.5*{w}, {c} + {w}))",
}
SOLVERS = ["automatic", "radau", "radau13", "explicit", "rodas"]


def passed(law: str, width: float, rate: str, solver: str, stiff: bool, start: float = 0.0) -> float:
    """Return the integral of a law over six seconds, divided by its area, where x starts at `start` and has a rate."""
    fast = "signal z = integral(-1e6*(z - sin(time/1 s))/1 s, 0); output other = z" if stiff else ""
    text = f"""model Passes {{
      signal x = integral({rate}, {start!r}), y = integral({law}/{width!r}/1 s, 0)
      {fast}
      output last = y
    }}"""
    return bondgraph.load(text).simulate(to=6, points=3, solver=solver).final("last")


@pytest.mark.few(16)
@pytest.mark.parametrize(
    ("solver", "stiff"), [(s, stiff) for s in SOLVERS for stiff in (False, True) if s != "explicit" or not stiff]
)
@pytest.mark.parametrize(
    ("place", "width"), [(3.7, 1e-7), (3.7, 1e-5), (3.3, 1e-3), (3.7, 1.1e-3), (2.2, 0.005), (1.1, 0.03), (5.9, 0.01)]
)
@pytest.mark.parametrize("law", LAWS)
def test_what_is_passed_has_its_area(law: str, place: float, width: float, solver: str, stiff: bool) -> None:
    text = LAWS[law].format(c=place, w=repr(width))
    assert passed(text, width, "1/1 s", solver, stiff) == pytest.approx(1, abs=1e-5)
    assert passed(text, width, "-1/1 s", solver, stiff, 6.0) == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("solver", ["automatic", "radau13"])
@pytest.mark.parametrize("width", [1e-6, 1e-3])
def test_what_swings_passes_it_twice_in_each_turn(width: float, solver: str) -> None:
    """x = sin t is at 0.6 at two instants of a turn, with speeds of 0.8."""
    for law in LAWS.values():
        y = passed(law.format(c=0.6, w=repr(width)), width, "cos(time/1 s)/1 s", solver, False)
        assert y == pytest.approx(2 / sqrt(1 - 0.6**2), rel=max(1e-5, 3 * width))


@pytest.mark.few(6)
@pytest.mark.parametrize("solver", ["automatic", "radau13", "rodas"])
@pytest.mark.parametrize("spike", [7, 8, 12, 16, 31, 33])
@pytest.mark.parametrize(("rows", "end"), [(20, 0.0), (45, 0.0), (45, 1e6)])
def test_a_spike_among_many_rows(rows: int, spike: int, end: float, solver: str) -> None:
    """A measured table of a constant with one row that is off, close to its neighbours, whichever its number is, beside a large value elsewhere."""
    width = 1e-4
    spike = spike % (rows - 2)
    places = [6 * k / (rows - 3) for k in range(rows - 2)]
    peak = places[spike] + 2 * width
    places = sorted([*places[: spike + 1], peak - width, peak, peak + width, *places[spike + 1 :]])
    values = [1.0 if place == peak else 0.0 for place in places]
    law = f"linear(x, (-1.0, {', '.join(map(repr, places))}), ({end}, {', '.join(map(repr, values))}))"
    assert passed(law, width, "1/1 s", solver, False) == pytest.approx(1, abs=1e-5)


@pytest.mark.few(8)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("height", [1.0, 3.0, 4.4, 4.499])
@pytest.mark.parametrize("law", LAWS)
def test_what_is_thrown_passes_it_twice_in_one_step(law: str, height: float, solver: str) -> None:
    """A parabola up to 4.5: any step is exact, and one over the whole flight ends on the side on which it began."""
    width = 1e-5
    y = passed(LAWS[law].format(c=height, w=repr(width)), width, "(3 - time/1 s)/1 s", solver, False)
    assert y == pytest.approx(2 / sqrt(9 - 2 * height), rel=1e-4)
