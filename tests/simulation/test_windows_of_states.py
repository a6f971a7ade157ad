"""Windows |u| < r on states, down to 1e-13 of the range: even powers, products of them, max, min, absolute values, choices, roots, and what is fixed beside them."""

from __future__ import annotations

from itertools import product
from math import acos, pi

import pytest

import bondgraph
from bondgraph.errors import RunFailed

TEXT = """plain model Window {{
  parameter w = {width}, k = 2.5
  signal x = integral({rate}, {start})
  signal open = integral(1 if {condition} else 0, 0)
  mode n = 0
  when {condition} {{ n = n + 1 }}
  output hits = n, time_open = open
  experiment go {{ simulate 0 .. 3 }}
}}
"""
FORMS = {  # condition: the places that it surrounds
    "x^2 < w^2": [0.0],
    "x*x < w*w": [0.0],
    "x^4 < w^4": [0.0],
    "(x - 0.1)^6 <= w^6": [0.1],
    "abs(x) < w": [0.0],
    "abs(x - 0.1) - w < 0": [0.1],
    "w^2 > x^2": [0.0],
    "not (x^2 >= w^2)": [0.0],
    "x^2 - w^2 < 0": [0.0],
    "sqrt(x^2) < w": [0.0],
    "3*x^2 < 3*w^2": [0.0],
    "k*x^2 < k*w^2": [0.0],
    "-k*x^2 > -k*w^2": [0.0],
    "-k*abs(x) > -k*w": [0.0],
    "(x/w)^2 < 1": [0.0],
    "(x - 0.2)^2*(x + 0.3)^2 < w^2": [0.2, -0.3],
    "(x - 0.2)^4*(x + 0.3)^2 < w^2": [0.2, -0.3],
    "abs(x - 0.2)*abs(x + 0.3) < w": [0.2, -0.3],
    "(x*cos(x))^2 < w^2": [0.0],
    "max(x, -x) < w": [0.0],
    "min(x - 0.1, 0.1 - x) > -w": [0.1],
    "-k*max(3*x, -x) > -k*w": [0.0],
    "max(0, 1 - abs(x)/w) > 0.5": [0.0],
    "max(x, 0) + max(-2*x, 0) <= w": [0.0],
    "tanh(max(abs(x - 0.2), x - 0.2)) < w": [0.2],
    "(x if x > 0 else -x) < w": [0.0],
    "abs(abs(x) - 0.3) < w": [-0.3, 0.3],
    "x^2 < w^2 or (x - 0.5)^2 < w^2": [0.0, 0.5],
}


@pytest.mark.parametrize("start", [-3, -2.5])
def test_what_fails_at_one_instant_alone_stays_true(start: float) -> None:
    """Both sides of a corner that touches zero, as they may be written: x is zero exactly at one instant, at which nothing acts."""
    forms = (
        "abs(x) > 0",
        "max(x, -x) > 0",
        "(x if x > 0 else -x) > 0",
        "(-x if x < 0 else x) > 0",
        "(x if x > 1 else 2 - x) > 1",
    )
    events = "; ".join(f"mode n{i} = 0; when {form} {{ n{i} = n{i} + 1 }}" for i, form in enumerate(forms))
    text = f"model Touches {{ signal x = integral(1/1 s, {start}); {events}; output hits = {' + '.join(f'n{i}' for i in range(len(forms)))} }}"
    for solver in ("explicit", "radau", "rodas"):
        assert bondgraph.load(text).simulate(to=10, points=3, solver=solver).final("hits") == len(
            forms
        )  # each at the start


@pytest.mark.parametrize("condition", ["max(x, -x) < w", "max(0, 1 - abs(x)/w) > 0.5", "tanh(max(3*x, -x)) < w"])
def test_no_corner_is_passed_over(condition: str) -> None:
    model = bondgraph.load(TEXT.format(width=1, condition=condition, rate=0.61, start=-0.7))
    for width, solver in ((1e-9, "radau"), (3e-12, "explicit"), (3e-12, "radau")):
        assert model.simulate(settings={"w": width}, points=3, solver=solver).final("hits") == 1


@pytest.mark.few(6)
@pytest.mark.machine_code
@pytest.mark.parametrize("condition", FORMS)
def test_no_window_is_passed_over(condition: str) -> None:
    """Along a line, and to and fro on a sine: each passage acts once, by all solvers and both ways of stepping."""
    places, widths = FORMS[condition], (1e-6, 1e-9, 1e-12, 1e-13)
    line = bondgraph.load(TEXT.format(width=1, condition=condition, rate=0.61, start=-0.7))
    ways = ({}, {"solver": "radau"}, {"solver": "explicit"}, {"solver": "rodas"}, {"target": "numpy"})
    for width, way in product(widths, ways):
        try:
            found = line.simulate(settings={"w": width}, points=3, **way)
        except RunFailed:
            assert width < 1e-12  # a few hundred units in the last place: right, or refused
            continue
        assert found.final("hits") == len(places)
    if "4" in condition:  # of unlike powers the windows have other widths
        return
    sine = bondgraph.load(TEXT.format(width=1, condition=condition, rate="2.1*cos(2.1*time)", start=0.05))
    found = sine.simulate(settings={"w": 1e-9}, points=3, rtol=1e-6)
    assert found.final("hits") == 2 * len(places)


TWO = """plain model Window {{
  parameter w = {width}
  signal u = integral({first}, {start})
  signal v = integral({second}, {start}*{share})
  mode n = 0
  when {condition} {{ n = n + 1 }}
  output hits = n
  experiment go {{ simulate 0 .. 3 }}
}}
"""
OF_TWO = [
    "u^2 + v^2 < w^2",
    "sqrt(u^2 + v^2) < w",
    "abs(u) + abs(v) < w",
    "max(abs(u), abs(v)) < w",
    "max(u, -u) < w",
    "not (max(u, -u) >= w)",
    "u^2*(1 + v^2) < w^2",
    "u^2 + 2*u*v + v^2 < w^2",
    "u^2 + 3*v^4 < w^2",
    "(u + v)^2 + (u - v)^2 < w^2",
    "u^2 + v^2 - 2*w*u < 0",
    "abs(u) + v^2 < w",
    "abs(abs(u) - abs(v)) + abs(u) < w",
    "1/(u^2 + v^2) > 1/w^2",
    "sqrt(u^2) + sqrt(v^2) < w",
    "sqrt(u^2 + v^2) < w and u < 1",
]


@pytest.mark.few(5)
@pytest.mark.machine_code
@pytest.mark.parametrize("condition", OF_TWO)
def test_windows_of_two_states(condition: str) -> None:
    """Minima of sums, roots and kinks: each passage acts once, or, within rounding of the threshold, a note says that it is not decided."""
    for first, share, passages in (("0.61", 0.3, 1), ("cos(time)", 0.5, 2)):
        text = TWO.format(width=1, condition=condition, first=first, second=f"{share}*{first}", share=share, start=-0.7)
        model = bondgraph.load(text)
        for width, way in product((1e-6, 1e-9, 1e-11), ({}, {"solver": "explicit"}, {"target": "numpy"})):
            result = model.simulate(settings={"w": width}, points=3, **way)
            if width > 1e-10 or not any("not decided" in note for note in result.notes):
                assert result.final("hits") == passages


@pytest.mark.parametrize("condition", ["x^2 < w^2", "abs(x) < w", "-k*x^4 > -k*w^4", "(2*x)^2 < 4*w^2"])
@pytest.mark.parametrize("width", [0.3, 1e-3, 1e-6])
def test_a_window_is_open_as_long_as_it_is_wide(condition: str, width: float) -> None:
    found = bondgraph.load(TEXT.format(width=width, condition=condition, rate=0.61, start=-0.7)).simulate(points=3)
    assert found.final("time_open") == pytest.approx(2 * width / 0.61, rel=1e-6)


@pytest.mark.few(12)
@pytest.mark.parametrize("factor", [2.0, -2.0, 0.0])
@pytest.mark.parametrize("level", [0.25, -0.25])
@pytest.mark.parametrize("condition", ["k*x^2 < c", "c > k*x^2", "not (k*x^2 >= c)", "k*x^2 - c < 0"])
def test_signs_of_factor_and_level(factor: float, level: float, condition: str) -> None:
    """Factor and level are parameters: what the window is, a run decides."""
    text = TEXT.format(width=1, condition=condition, rate=0.61, start=-0.7).replace(
        "w = 1, k = 2.5", f"k = {factor}, c = {level}"
    )
    half = (abs(level) / 2) ** 0.5 / 0.61
    if factor == 0.0 or factor * level < 0:
        exact = 3.0 if level > 0 else 0.0
    else:
        exact = 2 * half if factor > 0 else 3.0 - 2 * half
    assert bondgraph.load(text).simulate(points=3).final("time_open") == pytest.approx(exact, abs=1e-7)


PRODUCTS = (
    (1e-2, (1.3585749814084667, 1.4872182438574346)), (1e-3, (0.746426316314756, 0.7526364607212033)),
    (1e-4, (1.523594167099949, 1.5586275693168066, 2.279639322000408)), (1e-6, (2.3318731753793895, 2.335629033616793, 2.3860246375699345)),
    (1e-7, (0.5469514691427729, 0.5708058494227991, 1.576665117334436)),
)  # fmt: skip


@pytest.mark.parametrize(
    "form",
    [
        "{p} < 0",
        "{q} < 0",
        *(
            pytest.param(form, marks=pytest.mark.machine_code)
            for form in ("0 >= {p}", "-2*{p} > 0", "not (0 <= 3*{p})", "(x - 5)*{p}/(x - 5) < 0")
        ),
    ],
)
@pytest.mark.parametrize("solver", ["automatic", "explicit"])
def test_windows_of_one_product(form: str, solver: str) -> None:
    """Several windows of one state, as the sign of a product or quotient: each is seen, at its instant."""
    for width, places in PRODUCTS:
        ends = [(f"(x - {p!r})", f"(2*x - {2 * (p + width)!r})") for p in places]
        condition = form.format(p="*".join(f"{a}*{b}" for a, b in ends), q="*".join(f"{a}/{b}" for a, b in ends))
        text = TEXT.format(width=width, rate=1, start=0, condition=condition)
        run = bondgraph.load(text).simulate(points=2, solver=solver)
        assert run.final("hits") == len(places)
        assert [e.time for e in run.events] == pytest.approx(places, rel=1e-9)
        assert run.final("time_open") == pytest.approx(len(places) * width, rel=1e-6, abs=1e-14)


@pytest.mark.parametrize("solver", ["automatic", "radau", "explicit"])
@pytest.mark.parametrize(
    ("width", "places"),
    [(1e-2, (1.3585749814084667, 1.4872182438574346)), (1e-3, (0.7125869045455281, 0.746426316314756, 1.386889704065654)),
     (1e-5, (1.1491684574045928, 1.3290925641247768)), (1e-5, (0.18280989910733977, 0.22176441299827682, 2.0694698480907405))],
)  # fmt: skip
def test_windows_of_one_product_of_two_states(width: float, places: tuple[float, ...], solver: str) -> None:
    """Two windows between two places of a polynomial: the first is found before the other, though neither shows."""
    factors = [f"({v} - {p!r})*({v} - {p + width!r})" for v, p in zip("xzx", places, strict=False)]
    text = TEXT.format(width=width, rate=1, start=0, condition="*".join(factors) + " < 0")
    text = text.replace("  signal open", "  signal z = integral(1, 0)\n  signal open")
    assert bondgraph.load(text).simulate(points=2, solver=solver).final("hits") == len(places)


@pytest.mark.parametrize(
    ("frequency", "depth"),
    [
        (169.69789017968307, 7.704893943201164e-08),
        pytest.param(390.1359035339354, 2.1418090112265494e-07, marks=pytest.mark.machine_code),
    ],
)
def test_a_window_just_behind_the_start_of_a_step(frequency: float, depth: float) -> None:
    """Between the end of a polynomial and the place beside it, a thousandth of the step, lay one of some hundred maxima."""
    level = 1 - depth
    half = acos(level) / frequency
    count = sum((pi / 2 + 2 * pi * i) / frequency + half < 3 for i in range(1000))
    text = TEXT.format(width=half, rate=1, start=0, condition=f"sin({frequency!r}*x) > {level!r}")
    run = bondgraph.load(text).simulate(points=2, solver="explicit")
    assert run.final("hits") == count and run.final("time_open") == pytest.approx(2 * half * count, rel=1e-4)


@pytest.mark.parametrize("solver", ["automatic", "radau"])
def test_a_bell_is_seen_beside_a_condition_that_nearly_touches(solver: str) -> None:
    """The search for a touch leaves the smallest part, to which a bell is followed, as it is."""
    text = TEXT.replace("  signal open = integral(1 if {condition} else 0, 0)\n", "").replace(
        "time_open = open", "touched = touches"
    )
    text = text.replace(
        "  output", "  mode touches = 0\n  when cos(5*x) < -1.0000001 {{ touches = touches + 1 }}\n  output"
    )
    for place, width in ((1.234567, 1e-3), (2.3456789, 1e-7)):
        condition = f"1/(1 + ((x - {place})/w)^2) > 0.3 + 0.1*sin(x)"
        run = bondgraph.load(text.format(width=width, rate=1, start=0, condition=condition)).simulate(
            points=2, solver=solver
        )
        assert (run.final("hits"), run.final("touched")) == (1, 0)
