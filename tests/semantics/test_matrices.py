"""Matrices: against numpy, units of each entry, zeros that fit any unit, errors with the entry, on every back-end."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph import BondgraphError, CompilationFailed
from compiler.metamorphosis.printing import text_of
from compiler.source import Source
from compiler.syntax import parse
from compiler.syntax.format import format_text
from tests.compiling import compiled, mistake, mistakes, numbers, outputs_of

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]
Array = np.ndarray  # type: ignore[type-arg]


def written(values: Array) -> str:
    if values.ndim:
        return f"[{', '.join(map(written, values))}]"
    return repr(float(values))


def read(found: dict[str, float], name: str, shape: tuple[int, ...]) -> Array:
    """An output that is a list or matrix."""
    return np.array([found[f"{name}[{', '.join(str(i + 1) for i in index)}]"] for index in np.ndindex(shape)]).reshape(
        shape
    )


@pytest.mark.parametrize("role", ["constant", "parameter", "signal"])
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_against_numpy(n: int, role: str) -> None:
    """Numbers of the text, parameters of the program, and what changes during a run are three ways through the compiler."""
    rng = np.random.default_rng(n)
    a, b, c, x = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=(n, n + 1)), rng.normal(size=n)
    late = "*(1 + time/1 s)" if role == "signal" else ""
    lines = f"{role} a = {written(a)}{late}, b = {written(b)}, c = {written(c)}, x = {written(x)}\n"
    text = f"model A {{ {lines} output product = a*b*c, inner = 2*a - transpose(b)/4, inverted = inverse(a), solved = solve(a, x)\n"
    text += "output several = solve(a, c), d = det(a), back = a*inverse(a), energy = transpose(x)*a*x, row = transpose(x)*a, second = c[1]\n"
    found = numbers(text + f"output last = c[{n}, {n + 1}], listed = b*x {'' if n > 1 else '*[1]'} }}")
    near = {"rel": 1e-11, "abs": 1e-12}
    assert read(found, "product", (n, n + 1)) == pytest.approx(a @ b @ c, **near)
    assert read(found, "inner", (n, n)) == pytest.approx(2 * a - b.T / 4, **near)
    assert read(found, "inverted", (n, n)) == pytest.approx(np.linalg.inv(a), **near)
    assert read(found, "several", (n, n + 1)) == pytest.approx(np.linalg.solve(a, c), **near)
    assert read(found, "back", (n, n)) == pytest.approx(np.eye(n), **near)
    assert read(found, "row", (1, n)) == pytest.approx(x[None] @ a, **near)
    assert read(found, "second", (n + 1,)) == pytest.approx(c[0])
    assert (found["d"], found["energy"], found["last"]) == pytest.approx(
        (np.linalg.det(a), x @ a @ x, c[-1, -1]), **near
    )
    if n > 1:
        assert read(found, "solved", (n,)) == pytest.approx(np.linalg.solve(a, x), **near)
        assert read(found, "listed", (n,)) == pytest.approx(b @ x, **near)


def test_rotations() -> None:
    """Rodrigues' formula: about z as in the plane, the axis stays, and R R' = 1; the matrix of a vector product."""
    text = "model A { constant axis = (1, -2, 0.5), R = rotation(axis, 40 deg), z = rotation((0, 0, 3 m), 25 deg), p = rotation(25 deg)\n"
    text += "output orthogonal = transpose(R)*R - identity(3), stays = R*axis - axis, trace = R[1, 1] + R[2, 2] + R[3, 3], d = det(R)\n"
    text += "output plane = z - [[p[1, 1], p[1, 2], 0], [p[2, 1], p[2, 2], 0], [0, 0, 1]], turned = rotate((1, 2), 25 deg) - p*(1, 2)\n"
    text += "output crossed = skew(axis)*[4, 5, 6] - cross(axis, [4, 5, 6]) }"
    found = numbers(text)
    assert found.pop("trace") == pytest.approx(1 + 2 * np.cos(np.radians(40)))
    assert found.pop("d") == pytest.approx(1)
    assert max(map(abs, found.values())) < 1e-15


def test_units_of_each_entry() -> None:
    """A homogeneous matrix; a stiffness with three units. Zeros without a unit fit wherever they meet one."""
    text = "model A { constant c = cos(30 deg), s = sin(30 deg), H = [[c, -s, 2 mm], [s, c, 3 mm], [0, 0, 1]], K = [[10 [N/m], 0], [0, 2 [N*m]]]\n"
    text += "constant J = [[1, 5 mm], [0, 1]], E = identity(2)\n"
    text += "constant G = inverse(H), L = E*transpose(J)*K*J\n"
    text += "output p = H*[1 mm, 0 mm, 1], back = G[1, 3], moved = L, d = det(K), e = (transpose((1 mm, 0.1))*K*(1 mm, 0.1))/2 }"
    compilation = compiled(text)
    found, units = outputs_of(compilation), list(compilation.program.outputs.units)
    assert units == ["m", "m", "1", "m", "N/m", "N", "N", "N*m", "kg^2*m^2/s^4", "N*m"]
    half = np.sqrt(3) / 2
    assert read(found, "p", (3,)) == pytest.approx([2e-3 + half * 1e-3, 3.5e-3, 1])
    assert found["back"] == pytest.approx(-half * 2e-3 - 0.5 * 3e-3)
    assert read(found, "moved", (2, 2)) == pytest.approx(np.array([[10, 0.05], [0.05, 2 + 10 * 25e-6]]))
    assert (found["d"], found["e"]) == pytest.approx((20, (10e-6 + 0.02) / 2))


def test_the_rate_of_a_matrix() -> None:
    """The twist of a turning and moving body, H^-1 dH/dt and dH/dt H^-1."""
    text = "model A { signal a = time*2 [1/s], H = [[cos(a), -sin(a), a*1 m], [sin(a), cos(a), a^2*1 m], [0, 0, 1]]\n"
    text += "signal own = inverse(H)*der(H), world = der(H)*inverse(H)\n"
    text += "output turn = own[2, 1], u = own[1, 3], v = own[2, 3], turn_0 = world[2, 1], u_0 = world[1, 3], v_0 = world[2, 3], zero = own[3, 3], second = der(der((a^2, a^3)))\n }"
    found = bondgraph.load(text).simulate(to=1, points=5)
    a, rate = 2 * found.time, 2.0
    for name in ("turn", "turn_0"):
        assert found[name] == pytest.approx(rate)
    assert found["u"] == pytest.approx(np.cos(a) * 2 + np.sin(a) * 4 * a)
    assert found["v"] == pytest.approx(-np.sin(a) * 2 + np.cos(a) * 4 * a)
    assert found["u_0"] == pytest.approx(2 + 2 * a**2)  # the point of the body that passes the origin
    assert found["v_0"] == pytest.approx(4 * a - 2 * a)
    assert found["second[2]"] == pytest.approx(24 * a)
    assert not any(found["zero"])


PART = "model Part { parameter K = [[1 [N/m], 0], [0, 2 [N*m]]], S = [[1, 0], [0, 1]]\n output y = K*[1 m, 2] + S[1, 2]*[1 N, 1 [N*m]] }\n"


@pytest.mark.parametrize("target", TARGETS)
def test_parameters_are_set_entry_by_entry_and_whole(target: str) -> None:
    model = bondgraph.load(PART)
    assert model.simulate(to=1, points=2, target=target).final("y[1]") == 1
    found = model.simulate(to=1, points=2, target=target, settings={"K[1, 1]": 5.0, "S[1, 2]": 0.5})
    assert (found.final("y[1]"), found.final("y[2]")) == (5.5, 4.5)
    whole = PART + "model A { Part part { K = [[3 [N/m], 0], [0, 4 [N*m]]] }\n output a = part.y[1], b = part.y[2] }"
    found = bondgraph.load(whole).simulate(to=1, points=2, target=target)
    assert (found.final("a"), found.final("b")) == (3, 8)


def test_a_zero_without_a_unit_stays_zero() -> None:
    """It fits any unit where it is read, so nothing else may be put in its place."""
    for value in ("[[3 [N/m], 1 [N]], [0, 4 [N*m]]]", "[[3 [N/m], 1], [0, 4 [N*m]]]"):
        assert "0 [" in mistake(PART + f"model A {{ Part part {{ K = {value} }} }}", "BG103").help
    with pytest.raises(CompilationFailed, match=r"Zero for `K\[1, 2\]`"):
        bondgraph.load(PART).simulate(to=1, settings={"K[1, 2]": 3.0})


def test_branches_with_other_zeros_are_read_anew() -> None:
    text = "model Part { parameter n = 1\n if n > 1 { constant A = [[1, 0], [0, 1]] } else { constant A = [[1, 2], [3, 4]] }\n output y = A*[1, 1], d = det(A) }\n"
    found = numbers(text + "model A { Part a\n Part b { n = 2 }\n output p = a.y[1], q = b.y[1], r = a.d, s = b.d }")
    assert (found["p"], found["q"], found["r"], found["s"]) == (3, 1, -2, 1)


def test_arrays_are_lists_and_matrices() -> None:
    text = "model A { for i in 1..2 { constant row[i] = (i, 2*i, 1)\n for j in 1..3 { signal a[i, j] = 10*i + j } }\n"
    found = numbers(text + "output y = a*[1, 1, 1], z = row*[1, 1, 1], one = a[2, 3], second = row[2] }")
    assert [found[k] for k in ("y[1]", "y[2]", "z[1]", "z[2]", "one", "second[2]")] == [36, 66, 4, 7, 23, 4]


def test_in_functions_branches_and_tables() -> None:
    text = "model A { parameter Z = [[1, 2], [3, 5]]\n function form(A, x) = dot(x, A*x) + A[2, 1] + A[1]*0\n"
    text = text.replace(" + A[1]*0", "")
    found = numbers(
        text
        + "signal B = Z if time < 1 s else transpose(Z)\n output f = form(Z, (1, 1)), b = B[1, 2], t = linear(0.5, (0, 1), 0.5, (0, 1), Z) }"
    )
    assert (found["f"], found["b"], found["t"]) == (14, 2, 2.75)


def test_singular_to_rounding_or_for_the_values_of_an_instance() -> None:
    assert "up to rounding" in mistake("model A { output y = inverse([[0.1, 0.3], [0.3, 0.9]]) }", "BG151").sentence
    assert not mistakes("model A { output y = inverse([[1e-9, 0], [0, 1e9]]) }")  # no scale is small
    part = "model Part { parameter a = 2\n output y = solve([[a, 2], [2, 4]], (1, 1)) }\n"
    assert not mistakes(part + "model A { Part part\n output y = part.y[1] }")
    mistake(part + "model A { Part part { a = 1 }\n output y = part.y[1] }", "BG151")


def test_a_matrix_that_becomes_singular_ends_a_run() -> None:
    text = "model A { signal y = solve([[time - 0.5 s, 2 s], [0.25 s, 0.5 s]], (1, 1))\n output a = y[1] }"
    with pytest.raises(BondgraphError):
        bondgraph.load(text.replace("- 0.5 s", "+ 0.5 s")).simulate(to=1, points=11)


def test_formatted_and_printed() -> None:
    text = "model A {\nparameter A=[ [1,-2 [m]] ,[ a-1 , b[ 1 ]+2] ],B = 2*[1 ,2]\n}"
    text = text.replace("a-1", "3 - 1").replace("b[ 1 ]+2", "d[ 1-0 ]+2").replace("\n}", ", d=[ 5 ]\n}")
    once = format_text(Source("a.bg", text))
    assert once == "model A {\n  parameter A = [[1, -2 [m]], [3 - 1, d[1-0] + 2]], B = 2*[1, 2], d = [5]\n}\n"
    assert format_text(Source("a.bg", once)) == once
    again = text_of(parse(Source("a.bg", once)).statements)
    assert compiled(once).whole_graph.quantities.keys() == compiled(again).whole_graph.quantities.keys()
