"""Operation counts of the generated derivative, against published counts and against the plane.

Sums, products, quotients and calls are counted, minus signs are not. Operations on parameters alone are done once and not counted.
"""

from __future__ import annotations

import math

import pytest

from compiler.algebra.expression import MINUS_ONE, Apply
from compiler.codegen.dependence import PARAMETER
from compiler.compilation import Compilation
from tests.compiling import MODELS, Running, compiled
from tests.multibody.drawing import Drawing


def operations(compilation: Compilation) -> tuple[int, int]:
    """Multiplications (with quotients and calls) and additions of all rates."""
    lowered = compilation.lowered
    seen, stack, found = set(), list(lowered.rates), [0, 0]
    while stack:
        node = stack.pop()
        if not isinstance(node, Apply) or node in seen or not lowered.dependence(node) & ~PARAMETER:
            continue
        seen.add(node)
        count = len(node.operands) - 1 if node.operator in ("add", "multiply") else 1
        count -= node.operator == "multiply" and MINUS_ONE in node.operands
        found[node.operator == "add"] += count
        stack.extend(node.operands)
    return found[0], found[1]


# Link frames by Denavit and Hartenberg's modified convention, a and d (m), alpha (deg); masses, centres and inertias about them: B. Armstrong,
# O. Khatib, J. Burdick, The explicit dynamic model and inertial parameters of the PUMA 560 arm, IEEE ICRA 1986, tables 4 to 6. The first
# link's mass rests on its axis and counts only with its inertia about it.
PUMA = [
    # a, alpha, d, mass, centre (x, y, z), principal inertias
    (0.0, 0, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.35)),
    (0.0, -90, 0.2435, 17.40, (0.068, 0.006, -0.016), (0.130, 0.524, 0.539)),
    (0.4318, 0, -0.0934, 4.80, (0.0, -0.070, 0.014), (0.066, 0.0125, 0.086)),
    (-0.0203, 90, 0.4331, 0.82, (0.0, 0.0, -0.019), (1.8e-3, 1.8e-3, 1.3e-3)),
    (0.0, -90, 0.0, 0.34, (0.0, 0.0, 0.0), (0.3e-3, 0.3e-3, 0.4e-3)),
    (0.0, 90, 0.0, 0.09, (0.0, 0.0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
]
PORTS = [f"j{i}.phi" for i in range(6)]


def arm(tilt: float = 0.0, solid: bool = False) -> Drawing:
    """The PUMA 560, drawn with all angles zero: its axes are directions in the world. `tilt` turns the whole arm about x (rad); `solid` gives
    every link a full inertia tensor and a centre of mass that lies on no axis."""
    drawn = Drawing(gravity=_turned((0, 0, -9.81), tilt))
    point, axes = [0.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for i, (a, alpha, d, mass, centre, inertia) in enumerate(PUMA):
        x, y, z = axes
        c, s = round(math.cos(math.radians(alpha)), 15), round(math.sin(math.radians(alpha)), 15)
        y, z = [c * p + s * q for p, q in zip(y, z, strict=True)], [c * q - s * p for p, q in zip(y, z, strict=True)]
        point = [p + a * u + d * w for p, u, w in zip(point, x, z, strict=True)]
        axes = [x, y, z]
        inside = (0.05, 0.03, 0.04) if solid else centre
        at = [p + sum(k * e[n] for k, e in zip(inside, axes, strict=True)) for n, p in enumerate(point)]
        tensor = [[sum(inertia[k] * axes[k][m] * axes[k][n] for k in range(3)) for n in range(3)] for m in range(3)]
        six = [tensor[0][0], tensor[1][1], tensor[2][2], tensor[0][1], tensor[0][2], tensor[1][2]]
        if solid:
            six = [v + w for v, w in zip(six, (0.1, 0.1, 0.1, 0.01, 0.02, 0.03), strict=True)]
        drawn.body(f"b{i}", mass + 0.1 * solid, six, _turned(at, tilt), (tilt, 0.0, 0.0))
        drawn.joint(f"j{i}", "hinge", f"b{i - 1}" if i else "ground", f"b{i}", _turned(point, tilt), _turned(z, tilt))
    return drawn


def _turned(v: object, tilt: float) -> list[float]:
    x, y, z = v  # type: ignore[misc]
    c, s = math.cos(tilt), math.sin(tilt)
    return [x, c * y - s * z, s * y + c * z]


def test_six_axes_against_published_counts() -> None:
    """The articulated-body recursion optimised by hand needs 250 n - 222 multiplications and 220 n - 198 additions.

    (H. Brandl, R. Johanni, M. Otter 1986.) That is 1278 and 1122 for six axes. Any links: no more than these. The PUMA 560: zeros of its
    geometry save operations.
    """
    brandl = 250 * 6 - 222, 220 * 6 - 198
    solid, puma = (operations(arm(solid=s).compiled((), PORTS, everything=True)) for s in (True, False))
    assert sum(solid) <= sum(brandl)
    assert solid[0] <= 750 and solid[1] <= 650
    assert puma[0] <= 560 and puma[1] <= 480
    assert sum(puma) < 0.5 * sum(brandl)


def test_growth_is_linear() -> None:
    """Each link of a chain costs the same."""
    counts = []
    for n in (4, 8, 12):
        drawn = Drawing(gravity=(0, 0, -9.81))
        for i in range(n):
            drawn.body(f"b{i}", 1.0, (0.3, 0.4, 0.5, 0.01, 0.02, 0.03), (i + 0.5, 0.1, 0.2))
            axis = [(0, 0, 1), (0, 1, 0), (1, 0, 0)][i % 3]
            drawn.joint(f"j{i}", "hinge", f"b{i - 1}" if i else "ground", f"b{i}", (i, 0, 0), axis)
        counts.append(sum(operations(drawn.compiled(everything=True))))
    assert counts[2] - counts[1] == pytest.approx(counts[1] - counts[0], rel=0.1)


def test_an_arm_drawn_askew() -> None:
    """Turned as a whole by 20 degrees no axis lies along the world's: constants take that up, not operations."""
    straight, tilted = (operations(arm(t).compiled((), PORTS, everything=True)) for t in (0.0, math.radians(20)))
    assert (
        sum(tilted) <= sum(straight) + 30 and sum(tilted) < 850
    )  # products that both share are fewer in the straight one
    state = {f"m.j{i}.phi": 0.3 * i - 0.5 for i in range(6)} | {f"m.j{i}.phi.omega": 1.0 - 0.4 * i for i in range(6)}
    rates = [Running(arm(t).compiled((), PORTS, everything=True)).rates(state) for t in (0.0, math.radians(20))]
    for i in range(6):
        assert rates[1][f"m.j{i}.phi.omega"] == pytest.approx(rates[0][f"m.j{i}.phi.omega"], rel=1e-9)


@pytest.mark.parametrize(
    ("model", "bound"),
    [("manipulator", 360), ("crane", 60), ("pendulum", 280), ("flexure", 1190), ("inverse_kinematics", 215)],
)
def test_models_in_the_plane(model: str, bound: int) -> None:
    """They cost no more than by a recursion that knows nothing but the plane: 356, 57, 278, 1187 and 212 operations."""
    assert compiled(MODELS / f"{model}.bg").program.operations <= bound


def chain(basis: object, planar: bool) -> Compilation:
    """A cart on a rail with two rods, in the plane of the first two vectors of a basis."""
    e = basis

    def place(x: float, y: float) -> list[float]:
        return [x * a + y * b for a, b in zip(e[0], e[1], strict=True)]  # type: ignore[index]

    normal = list(e[2])  # type: ignore[index]
    drawn = Drawing(planar, place(0.0, -9.81))
    about = 0.2
    tensor = [about * normal[i] * normal[j] for i in range(3) for j in range(3)]
    six = (tensor[0], tensor[4], tensor[8], tensor[1], tensor[2], tensor[5])
    drawn.body("cart", 3.0, at=place(0.1, 0))
    drawn.body("upper", 2.0, six, place(0.5, 0.3))
    drawn.body("lower", 1.0, six, place(1.2, -0.1))
    drawn.joint("rail", "slide", "ground", "cart", axis=place(1, 0.5))
    drawn.joint("one", "hinge", "cart", "upper", place(0.2, 0), normal)
    drawn.joint("two", "hinge", "lower", "upper", place(0.8, 0.1), normal)
    return drawn.compiled((), ["one.phi", "two.phi"], everything=True)


S, T = math.sin(0.7), math.cos(0.7)


@pytest.mark.parametrize(
    ("basis", "more"),
    [
        (((1, 0, 0), (0, 1, 0), (0, 0, 1)), 0),
        (((0, 0, 1), (1, 0, 0), (0, 1, 0)), 0),
        (((1, 0, 0), (0, 0, -1), (0, 1, 0)), 0),
        (((1, 0, 0), (0, T, S), (0, -S, T)), 0),
        (((T, -0.6 * S, 0.8 * S), (S, 0.6 * T, -0.8 * T), (0, 0.8, 0.6)), 6),
    ],
)
def test_a_plane_in_space(basis: object, more: int) -> None:
    """All axes parallel: the same states, operations and accelerations as in the plane, for any position of the plane."""
    plane = chain(((1, 0, 0), (0, 1, 0), (0, 0, 1)), True)
    space = chain(basis, False)
    names = plane.program.states.names
    assert space.program.states.names == names
    assert sum(operations(space)) <= sum(operations(plane)) + more
    state = {name: 0.3 * i - 0.7 for i, name in enumerate(names)}
    expected, found = Running(plane).rates(state), Running(space).rates(state)
    for name in names:
        assert found[name] == pytest.approx(expected[name], rel=1e-12)


def stage(planar: bool, axes: str) -> tuple[Compilation, dict[str, str]]:
    """A platform between three shuttles, each with efforts on the three freedoms of a chord; names of states in space -> in the plane."""
    drawn = Drawing(planar, (0.0, 0.0, 0.0))
    tensor = (0.0, 0.0, 2.9e-17, 0.0, 0.0, 0.0) if planar else (1e-17, 1e-17, 2.9e-17, 0.0, 0.0, 0.0)
    drawn.body("platform", 2.1e-9, tensor)
    if not planar:
        drawn.joint("held", "planar", "ground", "platform")
    ports = []
    for i in range(3):
        angle = math.radians(120 * i)
        c, s = math.cos(angle), math.sin(angle)
        drawn.body(f"shuttle{i}", 4e-8)
        drawn.joint(f"guide{i}", "slide", "ground", f"shuttle{i}", axis=(-s, c, 0.0))
        at = (1.7e-4 * c + 5e-4 * s, 1.7e-4 * s - 5e-4 * c, 0.0)
        drawn.joint(f"flex{i}", "free", f"shuttle{i}", "platform", at, turn=(0.0, 0.0, angle), axes=axes)
        ports += [f"flex{i}.{letter}" for letter in ("x", "y", "phi" if planar else "rz")]
    names = {f"m.held.{c}{v}": f"m.platform.{c}{v}" for c, v in (("x", ""), ("x", ".v"), ("y", ""), ("y", ".v"), ("phi", ""), ("phi", ".omega"))}  # fmt: skip
    return drawn.compiled([f"{p}{v}" for p in ports for v in ("", ":f")], ports, everything=True), names


@pytest.mark.parametrize("axes", ["from", "to", "middle", "world"])
def test_a_manipulator_in_space_that_moves_in_a_plane(axes: str) -> None:
    """A planar joint to the ground: the same states, operations and values, chords included."""
    (plane, _), (space, names) = stage(True, axes), stage(False, axes)
    assert sum(operations(space)) <= sum(operations(plane))
    in_plane, in_space = Running(plane), Running(space)
    assert {names.get(n, n) for n in in_space.program.states.names} == set(in_plane.program.states.names)
    state = {n: (0.1 * i - 0.5) * 1e-5 for i, n in enumerate(in_space.program.states.names)}
    efforts = {n: (0.3 * i - 1) * 1e-6 for i, n in enumerate(in_space.program.inputs.names)}
    flat = {names.get(n, n): v for n, v in state.items()}
    found = in_space.rates(state, inputs=efforts), in_space.outputs(state)
    expected = (
        in_plane.rates(flat, inputs={n.replace("rz", "phi"): v for n, v in efforts.items()}),
        in_plane.outputs(flat),
    )
    for name, value in found[0].items():
        assert value == pytest.approx(expected[0][names.get(name, name)], rel=1e-12)
    for name, value in found[1].items():
        assert value == pytest.approx(expected[1][name.replace("rz", "phi")], rel=1e-12, abs=1e-30)


def test_a_push_on_a_body_that_floats_needs_no_rotation() -> None:
    """At its centre of mass: three quotients by the mass and their sum with the gravity."""
    drawn = Drawing(gravity=(0.0, 0.0, -9.81))
    drawn.body("b", 2.0, (0.3, 0.4, 0.5, 0.01, 0.02, -0.03))
    free, pushed = (operations(drawn.compiled(efforts=ports)) for ports in ((), ("b.x", "b.y", "b.z")))
    assert (pushed[0] - free[0], pushed[1] - free[1]) == (3, 1)
