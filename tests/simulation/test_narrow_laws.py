"""Laws of states that are other than zero within a small part of a step alone, with kinks and without: no step passes them whole."""

from __future__ import annotations

from math import exp, gamma, pi, sqrt
from pathlib import Path

import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import bondgraph
from tests.compiling import MODELS

# Laws of area `width`, around a place.
LAWS = {
    "triangle": "max(0, 1 - abs(x - {c})/{w})",
    "wedge": "max(0, min((x - {c})/{w} + 1, 1 - (x - {c})/{w}))",
    "table": "linear(x, (-9, {c} - {w}, {c}, {c} + {w}, 9), (0, 0, 1, 0, 0))",
    "trapezoid": "2/3*(ramp(x, {c} - {w}, {c} - 0.5*{w}) - ramp(x, {c} + 0.5*{w}, {c} + {w}))",
}
# Laws without a kink, and their areas in widths.
SMOOTH = {
    "bell": ("exp(-((x - {c})/{w})^2)", sqrt(pi)),
    "bell of a product": ("exp((x - {c})*({c} - x)/{w}^2)", sqrt(pi)),
    "flat bell": ("exp(-((x - {c})/{w})^4)", 2 * gamma(1.25)),
    "ratio": ("{w}^4/({w}^2 + (x - {c})^2)^2", pi / 2),
    "power": ("(1 + ((x - {c})/{w})^2)^(-1.5)", 2.0),
    "slope of a step": ("(1 - tanh((x - {c})/{w})^2)", 2.0),
    "ramps": ("(tanh((x - {c})/{w} + 4) - tanh((x - {c})/{w} - 4))/2", 8.0),
    "error functions": ("(erf((x - {c})/{w} + 1) - erf((x - {c})/{w} - 1))/2", 2.0),
    "expanded bell": ("exp(-(x*x - 2*x*{c} + {c}*{c})/{w}^2)", sqrt(pi)),
    "factored bell": ("exp((x*(2*{c} - x) - {c}^2)/{w}^2)", sqrt(pi)),
    "expanded power": ("(1 + (x^2 - 2*{c}*x + {c}^2)/{w}^2)^(-1.5)", 2.0),
    "bell on a circle": ("exp(8*(cos((x - {c})/2) - 1)/{w}^2)", sqrt(pi)),
    "monotone": (
        "monotone(x, (-9, {c} - 2*{w}, {c} - {w}, {c}, {c} + {w}, {c} + 2*{w}, 20), (0, 0, 0, 1, 0, 0, 0))",
        1.0,
    ),
}
ROUNDED = {"expanded bell", "factored bell", "expanded power", "bell on a circle"}  # differences of large numbers
# The same whose functions overflow for widths below a hundredth.
STEEP = {
    "1/cosh": ("1/cosh((x - {c})/{w})^2", 2.0),
    "logistic": ("(1/(1 + exp(-(x - {c})/{w} - 2)) - 1/(1 + exp(2 - (x - {c})/{w})))", 4.0),
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


def passes(law: str, place: float, width: float, solver: str, way: str) -> float:
    """Return the integral of a smooth law beside its area, on a way to and fro, in units of what the way makes of it."""
    text, area = (SMOOTH | STEEP)[law]
    text = text.format(c=f"({place!r})", w=repr(width))
    if way == "straight":
        return passed(text, width, "1/1 s", solver, False) / area
    if way == "back":
        return passed(text, width, "-1/1 s", solver, True, 6.0) / area
    return passed(text, width, "(3 - time/1 s)/1 s", solver, False) / area * sqrt(9 - 2 * place) / 2


@pytest.mark.few(20)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("way", ["straight", "back", "thrown"])
@pytest.mark.parametrize(("place", "width"), [(3.7, 1e-7), (2.3, 1e-5), (3.3, 1e-3), (3.61, 0.004), (1.9, 0.02)])
@pytest.mark.parametrize("law", [*SMOOTH, *STEEP])
def test_what_has_no_kink_has_its_area(law: str, place: float, width: float, way: str, solver: str) -> None:
    width = max(width, 0.01 if law in STEEP else 1e-4 if law in ROUNDED else 0.0)
    allowed = 1e-5 + (5 * width if way == "thrown" else 0) + (width / 2 if "power" in law else 0)
    assert passes(
        law, place, width, "radau" if solver == "explicit" and way == "back" else solver, way
    ) == pytest.approx(1, abs=allowed)


@pytest.mark.parametrize(("law", "place", "solver"), [("expanded bell", 2.3, "radau"), ("factored bell", 4.1, "radau13"), ("expanded power", 2.3, "radau"), ("bell on a circle", 3.3, "explicit"), ("bell", 1.98, "rodas"), ("slope of a step", 1.9, "rodas")])  # fmt: skip
def test_what_only_touches_a_value_and_what_a_node_meets_has_its_area(law: str, place: float, solver: str) -> None:
    """An argument that turns crosses nothing, and a stage of a step that falls into a peak need not see it: both on the way there and back."""
    width = 0.02 if solver == "rodas" else 1e-3
    assert passes(law, place, width, solver, "thrown") == pytest.approx(1, abs=3 * width)


def test_a_bell_of_two_states_that_is_written_as_a_sum() -> None:
    """It is met where both are equal, with a difference of their speeds of 1/2."""
    text = """model Two {
      signal x = integral(1/1 s, 0), y = integral(0.5/1 s, 1.3)
      signal q = integral(exp(-(x^2 - 2*x*y + y*y)/1e-4^2)/1 s, 0)
      output last = q
    }"""
    for solver in SOLVERS:
        assert bondgraph.load(text).simulate(to=6, points=3, solver=solver).final("last") == pytest.approx(
            2e-4 * sqrt(pi), rel=1e-4
        )


def test_a_peak_that_is_never_met_costs_no_step_at_kinks() -> None:
    """A step behind a kink has the size planned before it, also in a model whose peaks are looked for."""
    text = "model A {{ signal x = integral(v, 1), v = integral(-(40*x + 30*abs(x - 0.3){more})/1 s, 0)/1 s; output y = x }}"
    plain, more = (
        bondgraph.load(text.format(more=m)).simulate(to=6, solver="explicit") for m in ("", " + exp(-((x - 50)/0.1)^2)")
    )
    assert (more.steps, more.final("y")) == (plain.steps, plain.final("y"))


@pytest.mark.few(4)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("width", [1e-6, 1e-3])
def test_a_barrier_throws_back_what_has_less_energy(width: float, solver: str) -> None:
    """A potential of E exp(-u^2), whose force is zero in the middle, met with an energy of 1/2: behind it or thrown back, the speed is as before."""
    text = f"""model Met {{
      parameter E = 1 J, w = {width!r} m
      I mass : p = 1 kg*v {{ start v = 1 [m/s] }}
      Se bump : F = 2*E*(x - 3.7 m)/w^2*exp(-((x - 3.7 m)/w)^2)
      signal x = integral(mass.v, 0 m)
      bump -> mass
      output place = x, v = mass.v
    }}""".replace("Se bump", "MSe bump")
    for energy, place, speed in ((0.3, 6.0, 1.0), (0.7, 1.4, -1.0)):
        found = bondgraph.load(text).simulate(settings={"E": energy}, to=6, points=2, solver=solver)
        assert found.final("v") == pytest.approx(speed, abs=1e-4)
        assert found.final("place") == pytest.approx(place, abs=1e-4 + 10 * width)


@pytest.mark.few(4)
@pytest.mark.parametrize("solver", ["automatic", "radau13", "rodas"])
@pytest.mark.parametrize("width", [1e-4, 3e-3, 0.03])
def test_a_narrow_law_within_a_loop(width: float, solver: str) -> None:
    """A resistor between two others conducts where a state passes: 1 = 2 (i + i^3) + i/g, of which a quadrature makes the charge."""
    text = f"""model Loop {{
      signal x = integral(1/1 s, 0)
      Se source : u = 1 V
      R a : u = 1 ohm*i + 1 [ohm/A^2]*i^3
      MR b : i = (1e-3 + exp(-((x - 3.7)/{width!r})^2))*1 [S]*u
      R c : u = 1 ohm*i + 1 [ohm/A^2]*i^3
      1 : electric
      source -> 1(a, b, c)
      output q = integral(a.i, 0 C)
    }}""".replace("      1 : electric\n", "")

    def current(u: float) -> float:
        return float(brentq(lambda i: 2 * (i + i**3) + i / (1e-3 + exp(-(u**2))) - 1, 0, 1))

    more = quad(lambda u: current(u) - current(99.0), -8, 8, limit=200)[0]
    found = bondgraph.load(text).simulate(to=6, points=2, solver=solver).final("q")
    assert found - 6 * current(99.0) == pytest.approx(width * more, rel=1e-3)


def test_a_narrow_law_of_a_closed_chain() -> None:
    """The integral of a bell of the crank's angle over that angle has its area for each passage, whatever the motion is."""
    text = Path("models/four_bar.bg").read_text(encoding="utf-8")
    bells = "; ".join(f"output q{n} = integral(exp(-((linkage.shaft.phi/1 rad - {7.3 + n})/{w!r})^2)/{w!r}*linkage.shaft.omega, 0 rad)" for n, w in ((0, 1e-6), (1, 1e-4)))  # fmt: skip
    found = bondgraph.load(text.replace("  output angle", f"  {bells}\n  output angle")).simulate(
        "start_up", outputs=("q0", "q1")
    )
    assert [found.final("q0"), found.final("q1")] == pytest.approx([sqrt(pi)] * 2, rel=1e-4)


@pytest.mark.parametrize("name", ["published/andrews", "crane", "flexure", "pendulum", "six_axes"])
def test_what_a_mechanism_divides_by_is_no_narrow_law(name: str) -> None:
    """Looking for peaks of it doubled the time of a run."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    assert model.compilation(model.scene()).lowered.peaks == ()
