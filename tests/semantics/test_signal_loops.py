"""Signals that depend on themselves: linear loops exactly, others by Newton's method, across instances; and what has no solution."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import mistake, numbers


def test_linear_loops() -> None:
    found = numbers(
        "model A {\n  parameter K = 4\n  output y = K*(1 m - y)\n  signal a = 2*b, b = a/4 + 1 [m/s], c: N = 0.5*c + 3 N\n"
        "  output p = a, q = b, r = c\n"
        "  signal u = 1e3*(1 V - v), v = w/10, w = u\n  output gain = u\n}\n"
    )
    assert found == pytest.approx({"y": 0.8, "p": 4.0, "q": 2.0, "r": 6.0, "gain": 1e3 / 101}, rel=1e-14)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_keplers_equation(target: str) -> None:
    """E - e sin(E) = t, and its rate 1/(1 - e cos(E)) by the implicit law; Dottie's number."""
    text = "plain model A {\n  signal E = time + 0.3*sin(E)\n  output e = E, rate = der(E), z = cos(z)\n}\n"
    found = bondgraph.load(text).simulate(to=6, points=25, target=target)
    assert found["e"] - 0.3 * np.sin(found["e"]) == pytest.approx(found.time, abs=1e-9)
    assert found["rate"] == pytest.approx(1 / (1 - 0.3 * np.cos(found["e"])), rel=1e-8)
    assert found.final("z") == pytest.approx(0.7390851332151607, rel=1e-12)


def test_an_equation_written_as_a_signal() -> None:
    """z exp(z) = 1 + t: Lambert's function, 0.5671432904097838 at 1."""
    text = "plain model A {\n  signal z = z - (z*exp(z) - 1 - time)\n  output w = z\n}\n"
    found = bondgraph.load(text).simulate(to=3, points=4)
    assert found["w"][0] == pytest.approx(0.5671432904097838, rel=1e-9)
    assert found["w"] * np.exp(found["w"]) == pytest.approx(1 + found.time, rel=1e-9)


def test_a_loop_behind_a_state() -> None:
    """v' = -y, y = v + 0.5 sin(y): dv = (1 - 0.5 cos y) dy, so ln tan(y/2) falls as -t + …: checked as dy/dt (1 - 0.5 cos y) = -y."""
    text = "plain model A {\n  signal v = integral(-y, 1), y = v + 0.5*sin(y)\n  output a = v, b = y, c = der(y)\n}\n"
    found = bondgraph.load(text).simulate(to=3, points=13, rtol=1e-9)
    assert found["c"] * (1 - 0.5 * np.cos(found["b"])) == pytest.approx(-found["b"], rel=1e-8)
    assert found["b"] - 0.5 * np.sin(found["b"]) == pytest.approx(found["a"], rel=1e-8)
    inside = np.linspace(*np.log(found["b"][[-1, 0]]), 4001)
    assert np.trapezoid(1 - 0.5 * np.cos(np.exp(inside)), inside) == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize("order", ["b = 1 - a/2, a = b > 0.7", "a = b > 0.7, b = 1 - a/2"])
def test_a_truth_in_a_loop(order: str) -> None:
    """b = 1 is above 0.7, and 1/2 is not: nothing holds, in any order of the text."""
    with pytest.raises(RunFailed):
        bondgraph.load(f"plain model A {{\n  signal {order}\n  output y = b\n}}\n").simulate(to=1)


def test_between_instances_and_bonds() -> None:
    text = (
        "model Gain { input u = 0 V; parameter k = 2; output y = k*u }\n"
        "model M {\n  Gain a { u = 1 V*time/1 s - b.y }\n  Gain b { u = a.y, k = 3 }\n"
        "  MSe s : F = 10 N - 2 [N*s/m]*f\n  signal f = r.v + 0.5*g, g = f - 1 [m/s]\n  R r : F = 3 [N*s/m]*v\n  s -> r\n  output y = a.y, v = r.v\n}\n"
    )
    model = bondgraph.load(text)
    for m in (model, bondgraph.load(model.text())):
        found = m.simulate(settings={"b_k" if m is not model else "b.k": 3}, to="7 s")
        assert found.final("y") == pytest.approx(2 * 7 / 7, rel=1e-12)
        assert found.final("v") == pytest.approx(12 / 7, rel=1e-12)  # f = 2 v - 1, so 3 v = 10 - 4 v + 2


def test_several_solutions_are_told() -> None:
    with pytest.raises(RunFailed, match=r"more than one solution: `x` = 0\.112702; `x` = 0\.887298"):
        bondgraph.load("plain model A {\n  signal x = x^2 + 0.1\n  output y = x\n}\n").simulate(to=1)


@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ("signal x = x + 1 m; output y = x", "BG502", "`x`"),
        ("signal x = x; output y = x", "BG407", "unchanged"),
        ("signal a = b, b = a; output y = a", "BG407", "unchanged"),
        ("signal x = 2 m*x/1 s; output y = x", "BG103", "depends on itself"),
        ("signal x: m = 2*x/1 s; output y = x", "BG103", "[m/s]"),
        ("signal a = (b[1], 2), b = (a[1], 3); output y = b[1]", "BG107", "a -> b"),
        ("parameter a = b, b = a; output y = a", "BG107", "depend on each other"),
    ],
)
def test_refusals(body: str, code: str, words: str) -> None:
    found = mistake(f"model M {{\n{body}\n}}", code)
    assert words in f"{found.sentence} {found.help}"


def test_a_loop_in_a_block_of_samples_is_that_of_its_beginning() -> None:
    """m = 3 m + 1 each time: the second line reads what the loop x = 0.5 x + m, so 2 m, was when the block began."""
    text = "plain model A {\n  mode m = 0\n  signal x = 0.5*x + m\n  every 1 {\n    m = m + 1\n    m = m + x\n  }\n  output n = m\n}\n"
    assert bondgraph.load(text).simulate(to=3).final("n") == 40.0
    assert math.isclose(numbers("plain model A {\n  signal x = 0.5*x + 1\n  output y = x\n}\n")["y"], 2.0)


def solved(body: str, plain: str = "plain ", **what: object) -> bondgraph.Result:
    return bondgraph.load(f"{plain}model A {{\n{body}\n}}\n").simulate(to=1, points=3, **what)  # type: ignore[arg-type]


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_equations_are_solved(target: str) -> None:
    """x^3 + x = 2 + t and its rate 1/(3 x^2 + 1); x y = 6 with x + y = 5; Hilbert's matrix of order 5, whose inverse has row sums known in whole numbers."""
    found = solved(
        "  solve x^3 + x = 2 + time for x = 1\n  output a = x, rate = der(x)\n"
        "  solve p*q = 6, p + q = 5 for p = 1.5, q = 4\n  output b = p, c = q\n"
        "  for i in 1..5 { for j in 1..5 { constant H[i, j] = 1/(i + j - 1) } }\n"
        "  solve H*z = [1, 1, 1, 1, 1] for z = [0, 0, 0, 0, 0]\n  output d = z[1], e = z[5]",
        target=target,
    )
    assert found["a"] ** 3 + found["a"] == pytest.approx(2 + found.time, rel=1e-12)
    assert found["rate"] == pytest.approx(1 / (3 * found["a"] ** 2 + 1), rel=1e-9)
    assert [found.final(n) for n in "bcde"] == pytest.approx([2, 3, 5, 630], rel=1e-9)


@pytest.mark.parametrize(("guess", "x"), [("-1.5", -2), ("0.1", 0), ("1.2", 2), ("c", 2)])
def test_the_solution_nearest_to_the_guess_holds(guess: str, x: float) -> None:
    """x^3 = 4 x, and a second equation behind it, whose own guess decides on its own."""
    body = f"  parameter c = 3\n  solve x^3 = 4*x for x = {guess}\n  solve y^2 = x^2 + 1 for y = -0.5\n  output a = x, b = y"
    found = solved(body)
    assert (found.final("a"), found.final("b")) == pytest.approx((x, -math.sqrt(x**2 + 1)), abs=1e-12)
    assert "`x`" in " ".join(found.notes) and "nearest to its guess" in found.notes[0]


def test_a_guess_that_a_run_sets() -> None:
    model = bondgraph.load("plain model A {\n  parameter c = 3\n  solve x^2 = 4 for x = c\n  output a = x\n}\n")
    assert [model.simulate(to=1, settings={"c": c}).final("a") for c in (3.0, -3.0)] == [2.0, -2.0]


def test_equations_in_units_loops_branches_and_instances() -> None:
    found = bondgraph.load(
        "model Root { input u: m^2 = 1; solve y^2 = u for y: mm = 1500 }\nmodel A {\n  parameter deep = 1\n  Root r { u = 9 [m^2] }\n"
        "  for i in 1..2 { solve w^3 = i*8 [N^3] for w = 1 N; signal cube[i] = w^3 }\n"
        "  if deep == 1 { solve k + 1 m = 3 m for k = 0 m } else { solve k = 1 for k }\n"
        "  output a = r.y, b = cube[2], c = k\n}\n"
    ).simulate(to=1, points=2)
    assert [found.final(n) for n in "abc"] == pytest.approx([3.0, 16.0, 2.0], rel=1e-9)


def test_equations_that_a_run_refuses() -> None:
    with pytest.raises(RunFailed, match="more than one solution"):
        solved("  solve x^2 = 4 for x\n  output a = x")
    with pytest.raises(RunFailed, match="no solution"):
        solved("  solve x^2 + 4 = 0 for x = 1\n  output a = x")
    with pytest.raises(RunFailed, match="more than one solution"):  # as near to the one as to the other
        solved("  solve x^2 = 4 for x = 0\n  output a = x")


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("solve x = 1, x = 2 for x = 1", "BG119"),
        ("solve x = 1 for x = 1, y = 2", "BG119"),
        ("solve x = 1 m for x = 1", "BG103"),
        ("solve x = 1 for x = time/1 s", "BG106"),
        ("solve x = 1 for x = integral(1 [1/s], 0)", "BG106"),
        ("solve x^2 = 4 for x = true", "BG111"),
        ("solve x[1] = 1 m, x[2] = 1 N for x = [1 m, 2 N, 0]", "BG111"),
        ("solve 3 = 4 for x = 1", "BG502"),
        ("solve x^2 = 1, x^3 = 1 for x = 1, y = 1", "BG502"),
        ("solve x = y, y = x + 1 for x = 0, y = 0", "BG502"),
    ],
)
def test_wrong_equations(line: str, code: str) -> None:
    name = "x[1]" if "[1" in line else "x"
    mistake(f"model A {{\n  {line}\n  output a = {name}\n}}\n", code)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_rates_of_what_equations_give(target: str) -> None:
    """z = 1 + t twice: read through its sine alone, and beside a slope of its own that goes through zero."""
    found = solved(
        "  signal at = 1 + time, s = sin(y/4), c = z^3 + 2*z, f = time - 0.5\n"
        "  solve s = sin(at/4) for y = 1\n  solve f*z + c = f*at + at^3 + 2*at for z = 1\n  output a = der(y), b = der(z)",
        target=target,
    )
    assert [*found["a"], *found["b"]] == pytest.approx([1.0] * 6, rel=1e-12)


@pytest.mark.parametrize("order", ["sqtdr", "qtdsr", "rdtqs", "dqrts"])
def test_rates_in_a_loop_that_is_cut_anywhere(order: str) -> None:
    """A place on a round rail, which its equation reads by the slope there alone."""
    lines = {
        "q": "signal q = -d/t",
        "t": "signal t = sqrt(1 - d^2)",
        "d": "signal d = x*c + r*s - 1",
        "r": "signal r = 0.1 + 0.03*(x - 1)",
        "s": "solve q*(0.1*s + c) + 0.2*c - s = 0 for x = 1",
    }
    found = solved(
        "  signal h = 0.3*sin(2*time), s = sin(h), c = cos(h)\n  "
        + "\n  ".join(lines[k] for k in order)
        + "\n  output a = der(q), b = der((s - 0.2*c)/(0.1*s + c))"
    )
    assert found["a"] == pytest.approx(found["b"], rel=1e-9)


@pytest.mark.parametrize(("power", "points"), [(3, 3), (3, 101), (5, 7)])
def test_a_root_that_begins_where_it_has_no_slope(power: int, points: int) -> None:
    """The equation says nothing of the size of w at the start, where its slope is zero."""
    run = bondgraph.load(f"plain model A {{\n  solve w^{power} = time for w = 0\n  output y = w\n}}\n").simulate(
        to=3, points=points
    )
    np.testing.assert_allclose(run["y"][1:], run.time[1:] ** (1 / power), rtol=1e-7)


ROOTS = {  # laws with a root of third order, and each with w added
    "sinh(w) - w": np.sinh, "w - sin(w)": lambda w: 2 * w - np.sin(w), "tan(w) - w": np.tan, "w^3/(1 + w^2)": lambda w: w**3 / (1 + w**2) + w,
}  # fmt: skip


@pytest.mark.parametrize("drive", ["time", "time^2", "time - 1.5"])
@pytest.mark.parametrize("law", ROOTS)
@pytest.mark.few(3)
def test_a_root_of_several_orders_by_rounding(law: str, drive: str) -> None:
    """Terms of the law cancel about w = 0, where Newton's method ends anywhere, and no derivative tells the residuals."""
    text = f"plain model A {{\n  solve {law} = {drive} for w = 0\n  output y = w\n}}\n"
    run = bondgraph.load(text).simulate(to=3, points=7, target="numpy")
    given = {"time": run.time, "time^2": run.time**2, "time - 1.5": run.time - 1.5}[drive]
    np.testing.assert_allclose(ROOTS[law](run["y"]) - run["y"], given, atol=1e-9)


@pytest.mark.parametrize("equation", ["(z - time)^3*(z + 2) = 0", "0 = -3*(z + 2)*(z - time)^2/4", "(z - time)*(z + 2)*(z - time) = 0", "abs(z - time)*(z + 2)^2 = 0"])  # fmt: skip
def test_a_factor_of_several_orders_counts_once(equation: str) -> None:
    found = bondgraph.load(f"plain model A {{\n  solve {equation} for z = 0.1\n  output x = z, v = der(z)\n}}\n").simulate(to=1, points=5, target="numpy")  # fmt: skip
    assert found["x"] == pytest.approx(found.time, abs=1e-12)
    assert found["v"] == pytest.approx(1, abs=1e-9)


def test_a_declared_unit_of_a_loop_is_read_in_it() -> None:
    assert solved("  signal z: m = z - ((z + 1 m)^3 - 8 [m^3])/(40 [m^2])\n  output a = z", "").final(
        "a"
    ) == pytest.approx(1.0)


def test_equations_in_flat_text_builder_and_exports() -> None:
    """The same numbers, and the same branch, from the flat text, from calls and from a module of numpy."""
    g = bondgraph.Graph("A")
    a = g.parameter("a", 4, "m^2")
    x = g.solve("x", f"x^2 = {a}", -1.5, "m", "side")
    g.output("b", f"{x}*1", "m")
    model = g.model()
    assert "solve x^2 = a for x: m = -1.5" in g.text()
    assert model.simulate(to=1).final("b") == bondgraph.load(model.text()).simulate(to=1).final("b") == -2.0
    pair = bondgraph.load('model B {\n  solve y = 2 m, x = y + 1 m for x = 0 m "a", y = 0 m "b"\n  output z = x\n}\n')
    flat = bondgraph.load(pair.text())
    assert flat.text() == pair.text() and flat.simulate(to=1).final("z") == 3.0
    assert "np.array([-1.5])" in model.compile("numpy")
    assert "start = -1.5" in model.compile("modelica")


def test_a_solution_is_kept_where_junctions_switch() -> None:
    """z = 3 t + 1 is nearest to the guess at the start, z = 3 t - 1 is at 2 s, where another program goes on."""
    text = (
        "model A {\n  solve (z - 3*time/1 s)^2 = 1 for z = 1\n  signal w = integral(z*1 [1/s], 0)\n  output a = z, b = w, c = mass.v\n"
        "  mode on = false\n  when time > 2 s { on = true }\n  1 way : translation { active = not on }\n  Se push : F = 1 N\n"
        "  I mass : p = 1 kg*v\n  push -> way -> mass\n}\n"
    )
    found = bondgraph.load(text).simulate(to=4, points=9)
    assert found["a"] == pytest.approx(3 * found.time + 1, rel=1e-6)


FOLLOWED = [  # equations, and the branch nearest to the guess
    ("solve (z - 3*time)^2 = 1 for z = 1", lambda t: 3 * t + 1),
    ("solve (z - 30*sin(time))^2 = 1 for z = -2", lambda t: 30 * np.sin(t) - 1),
    ("solve abs(z - 3*sin(time)) = 1 for z = 1.2", lambda t: 3 * np.sin(t) + 1),
    ("signal u = z - 2*sin(time)\n  solve u^3 = u for z = 0.1", lambda t: 2 * np.sin(t)),
    ("solve sin(z - 2*time) = 0.5 for z = 0.5", lambda t: 2 * t + np.pi / 6),
    ("solve (z - 2*time)*(y + time) = 6, (z - 2*time) + (y + time) = 5 for z = 2.9, y = 2.1", lambda t: 2 * t + 3),
    ("for i in 1..2 { solve (x[i] - i*sin(time))^2 = 1 for x[i] = 1.2 }\n  signal z = x[1] + x[2]", lambda t: 3 * np.sin(t) + 2),
    ("solve (z - 3*sin(time))^2 = (1 if z > 0 else 1) for z = 1.2", lambda t: 3 * np.sin(t) + 1),
    ("solve z + (sqrt(z) if z > 0 else z) = 2 - time for z = 1", lambda t: np.where(t < 2, (np.sqrt(np.abs(2.25 - t)) - 0.5) ** 2, 1 - t / 2)),
    ("mode k = 1\n  when time > 4 { k = 2 }\n  solve (u - 3*k*time)^2 = 1 for u = 1.2\n  signal z = u - 3*k*time", lambda t: 0 * t + 1),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(FOLLOWED)))
def test_a_model_without_states_stays_on_its_branch(case: int) -> None:
    """Solutions that move past each other: the numbers do not depend on the reported instants."""
    equations, branch = FOLLOWED[case]
    model = bondgraph.load(f"plain model A {{\n  {equations}\n  output a = z\n}}\n")
    for points in (2, 24):
        found = model.simulate(
            to=3.9 if "when" in equations or "sqrt" in equations else 10, points=points, target="numpy"
        )
        assert found["a"] == pytest.approx(branch(found.time), rel=1e-9, abs=1e-9)


def test_extremes_and_runs_with_other_values_along_a_branch() -> None:
    model = bondgraph.load(
        "plain model A {\n  parameter w = 3\n  solve (z - w*sin(time))^2 = 1 for z = 1.2\n  output a = z\n}\n"
    )
    found = model.simulate(to=9, points=3, extremes=True, target="numpy")
    extremes = found.extremes("a")
    assert (extremes.minimum, extremes.maximum) == pytest.approx((-2.0, 4.0), rel=1e-9)
    runs = model.simulate_many([{"w": float(w)} for w in (-4, 5)], to=9, points=2, target="numpy")
    assert [r.final("a") for r in runs] == pytest.approx([w * math.sin(9) + 1 for w in (-4, 5)])


PASSING = [  # branches that pass near each other at 0.37 s, the guess, the sign of the root that is followed, and c
    ("(z - s)*(z + s) = c for z = 0.37", 1, (1e-4, 1e-9, 1e-11, 1e-15)),
    ("1e6*(z^2 - s^2) = 1e6*c for z = -0.37", -1, (1e-6, 1e-12)),
    ("z = (s^2 + c)/z for z = 0.37", 1, (1e-3, 1e-8, 1e-13)),  # between them a pole
    ("y = z - s, (z + s)*y = c for z = -0.37, y = 0", -1, (1e-5, 1e-11)),
    ("(z - s)*(z + s) = c for z = 0.37", 0, (-1e-4,)),  # no solution between
    ("z*(z^2 - s^2) = c for z = 0", 0, (1e-9,)),  # a fold with one beside
]


@pytest.mark.parametrize(("equation", "sign", "distances"), PASSING)
def test_branches_that_pass_near_each_other(equation: str, sign: int, distances: tuple[float, ...]) -> None:
    """Where they are nearest the branch turns, within a time much shorter than a step: a straight line would arrive at the other one to rounding."""
    text = f"plain model A {{\n  parameter c = 1e-3\n  signal s = time - 0.37\n  solve {equation}\n  output a = z\n}}\n"
    model = bondgraph.load(text)
    for c in distances:
        if sign:
            found = model.simulate(to=1, points=4, settings={"c": c}, target="numpy")
            assert found["a"] == pytest.approx(sign * np.sqrt((found.time - 0.37) ** 2 + c), rel=1e-6)
        else:
            with pytest.raises(RunFailed, match="ends, or meets others"):
                model.simulate(to=1, points=4, settings={"c": c}, target="numpy")


@pytest.mark.parametrize(("equation", "line"), [("(z - s)*(z + s) = 0", 0.0), ("(z - 10)^2 = s^2", 10.0)])
def test_branches_that_cross_are_passed(equation: str, line: float) -> None:
    text = f"plain model A {{\n  signal s = time - 0.37\n  solve {equation} for z = {line + 0.37}\n  output a = z\n}}\n"
    found = bondgraph.load(text).simulate(to=1, points=4, target="numpy")
    assert found["a"] == pytest.approx(line + 0.37 - found.time, abs=1e-9)


@pytest.mark.parametrize(
    ("equation", "end"),
    [
        ("solve z^3 - 3*z = time - 1 for z = -2", 3),  # a fold, with another solution far away
        ("solve cosh(z) - 1 = time for z = 0", 0),  # two begin there
        ("solve z^2 = (time - 1)^2 for z = 1", 1),  # two branches cross where a segment ends
    ],
)
def test_a_branch_that_ends_or_meets_another(equation: str, end: float) -> None:
    for points in (2, 9):
        with pytest.raises(RunFailed, match="ends, or meets others") as caught:
            solved_in(equation, points)
        assert float(str(caught.value).split("t = ")[1].split(" s")[0]) == pytest.approx(end, abs=1e-6)


def solved_in(equation: str, points: int) -> bondgraph.Result:
    model = bondgraph.load(f"plain model A {{\n  {equation}\n  output a = z\n}}\n")
    return model.simulate(to=5, points=points, target="numpy")
