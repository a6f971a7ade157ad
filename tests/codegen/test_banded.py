"""Long linear loops: a band of the matrix is eliminated, with the same result as all of it, in work that grows as the loop does."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

import bondgraph
from compiler.algebra.derivative import derivative
from compiler.algebra.expression import Apply, Expression, Number, Symbol
from compiler.algebra.systems import LEAST, SYSTEMS, band_of, entries_of, shape_of, solutions
from compiler.codegen.cost import _operations
from compiler.codegen.limits import Leaf
from compiler.codegen.llvm import runtime
from compiler.codegen.lowered import Lowered
from compiler.codegen.order import operations_in_order
from compiler.codegen.tape import Tape
from compiler.compilation import Compilation
from compiler.scene import Scene
from compiler.source import Source


def banded_matrix(count: int, lower: int, upper: int, seed: int = 1) -> np.ndarray:
    """Random, with rows of many magnitudes, so that pivots are exchanged."""
    draw = np.random.default_rng(seed)
    full = draw.normal(size=(count, count)) * 10.0 ** draw.integers(-3, 4, size=(count, 1))
    i, j = np.indices(full.shape)
    full[(j - i > upper) | (i - j > lower)] = 0.0
    return full


def stored(full: np.ndarray, right: np.ndarray, lower: int, upper: int) -> np.ndarray:
    """The band row by row, then the right side."""
    count, width = len(full), lower + upper + 1
    entries = np.zeros(count * width + count)
    for i in range(count):
        for j in range(max(0, i - lower), min(count, i + upper + 1)):
            entries[i * width + j - i + lower] = full[i, j]
    entries[count * width :] = right
    return entries


def banded(full: np.ndarray, right: np.ndarray, lower: int, upper: int) -> np.ndarray:
    """`runtime.solve` of the band, as plain Python."""
    count, entries, out = len(full), stored(full, right, lower, upper), np.zeros(len(full))
    with np.errstate(all="ignore"):
        runtime.solve(count, lower, upper, 1, entries, np.zeros(runtime.room(count, lower, upper, 1)), out)
    return out


def dense(full: np.ndarray, right: np.ndarray) -> np.ndarray:
    count, out = len(full), np.zeros(len(full))
    with np.errstate(all="ignore"):
        room, entries = runtime.room(count, count - 1, count - 1, 0), np.concatenate([full.ravel(), right])
        runtime.solve(count, count - 1, count - 1, 0, entries, np.zeros(room), out)
    return out


@pytest.mark.parametrize("lower, upper", [(1, 1), (2, 3), (0, 2), (4, 0), (5, 5)])
def test_the_same_as_all_of_it(lower: int, upper: int) -> None:
    full, right = banded_matrix(20, lower, upper), np.arange(20.0) - 7
    expected = np.linalg.solve(full, right)
    assert np.allclose(banded(full, right, lower, upper), expected, rtol=1e-9)
    assert np.array_equal(banded(full, right, lower, upper), dense(full, right))  # one after the other, bit by bit


@pytest.mark.parametrize("lower, upper", [(1, 1), (2, 3), (0, 2), (4, 0)])
def test_a_band_is_scaled_as_the_whole(lower: int, upper: int) -> None:
    """Rows and columns of many magnitudes: each sees its own entries alone, and what is left of them is near 1 in the mean."""
    full = banded_matrix(9, lower, upper) * 10.0 ** np.random.default_rng(2).integers(-6, 7, size=9)
    of_band, of_all = np.zeros(9 * (lower + upper + 1) + 18), np.zeros(9 * 9 + 18)
    runtime.balance(9, lower, upper, 1, stored(full, np.zeros(9), lower, upper), of_band)
    runtime.balance(9, 8, 8, 0, full.ravel(), of_all)
    np.testing.assert_array_equal(of_band[-18:], of_all[-18:])
    rows, columns = np.split(of_all[-18:], 2)
    sizes = np.where(full != 0, np.log2(np.abs(full) + (full == 0)) - np.log2(rows)[:, None] - np.log2(columns), np.nan)
    assert np.abs(np.nanmean(sizes, axis=0)).max() < 1.1 and np.abs(np.nanmean(sizes, axis=1)).max() < 2.1


def test_units_do_not_make_it_singular() -> None:
    """Columns in ohms and in siemens, twelve decades apart: means of magnitudes bring them together, as in a dense matrix."""
    full = banded_matrix(16, 2, 2, 3) * 10.0 ** np.where(np.arange(16) % 2, 14.0, -14.0)
    right = np.ones(16)
    assert np.allclose(full @ banded(full, right, 2, 2), right, rtol=1e-6)


def test_a_singular_one_is_no_number() -> None:
    full = banded_matrix(14, 2, 2)
    full[7] = 0.0
    full[7, 6:9] = 2 * full[6, 6:9]
    full[6, 4:6] = 0.0
    full[6, 9:] = 0.0
    assert np.isnan(banded(full, np.ones(14), 2, 2)).all()
    assert np.isnan(dense(full, np.ones(14))).all()


def test_an_order_is_found() -> None:
    """A chain with shuffled numbers becomes a chain again; a node connected with all others gives no band."""
    count, numbers = 40, list(range(40))
    random.Random(2).shuffle(numbers)
    rows: list[list[int]] = [[] for _ in numbers]
    for i in range(count):
        rows[numbers[i]] = [numbers[j] for j in (i - 1, i, i + 1) if 0 <= j < count]
    layout = band_of(rows)
    assert layout is not None and layout.shape == (40, 1, 1)
    assert sorted(layout.order) == list(range(count))
    assert band_of([list(range(count))] * count) is None
    assert band_of(rows[: LEAST - 1]) is None


def symbol(i: int) -> Symbol:
    return Symbol(Leaf("parameter", i))


def test_items_and_their_derivatives() -> None:
    """Through every permutation the unknowns keep their places; A dt = dr - dA t."""
    count = 15
    full = banded_matrix(count, 1, 1, 5)
    order = random.Random(4).sample(range(count), count)
    full = full[np.ix_(order, order)]
    matrix: list[dict[int, Expression]] = [
        {j: Number(float(full[i, j])) for j in range(count) if full[i, j]} for i in range(count)
    ]
    row, column = 3, next(j for j in matrix[3] if j != 3)
    matrix[row][column] = symbol(0)
    layout = band_of([list(r) for r in matrix])
    assert layout is not None
    right = [Number(1.0)] * (count - 1) + [symbol(1)]
    unknowns = solutions(matrix, right, layout)
    slopes = [derivative(x, symbol(k)) for k in (0, 1) for x in unknowns]
    values = {Leaf("parameter", 0): full[row, column], Leaf("parameter", 1): 2.0}
    found = np.array(Tape([*unknowns, *slopes]).values(values.__getitem__)).reshape(3, count)
    expected = np.linalg.solve(full, [1.0] * (count - 1) + [2.0])
    assert np.allclose(found[0], expected)
    turned = np.zeros((count, count))
    turned[row, column] = 1.0
    assert np.allclose(found[1], np.linalg.solve(full, -turned @ expected))
    assert np.allclose(found[2], np.linalg.solve(full, np.eye(count)[-1]))
    (node,) = {x.operands[0] for x in unknowns if isinstance(x, Apply)}
    assert isinstance(node, Apply) and node.operator == "banded"
    rows, rights = entries_of(node)
    assert [len(r) for r in rows] == [2, *[3] * (count - 2), 2] and len(rights) == count
    forward = Tape(unknowns).slopes(values.__getitem__, {Leaf("parameter", 0): np.array([1.0])}, 1)[1]
    assert np.allclose(np.ravel([0.0 if m is None else m[0] for m in forward]), found[1])


RESISTORS = """model Row {{
  parameter r = 10 ohm
  Se source : u = 1 V*sin(2*pi*1000 [1/s]*time)
  0 node_0 : electric
  source -> node_0
{sections}  C plates : q = 1 uF*u
  node_{count} -> plates
  output last = node_{count}.u
  experiment go {{ simulate 0 .. 1 ms; report last }}
}}
"""
SECTION = """  R wire_{i} : u = r*i
  R leak_{i} : i = 1e-3 [A/V]*u
  0 node_{i} : electric
  node_{before} -> 1(wire_{i}) -> node_{i} -> leak_{i}
"""


def row_of_resistors(count: int) -> str:
    sections = "".join(SECTION.format(i=i, before=i - 1) for i in range(1, count + 1))
    return RESISTORS.format(sections=sections, count=count)


def compiled(count: int) -> Compilation:
    return Compilation(Source("row.bg", row_of_resistors(count)), Scene(None, ""))


def systems(lowered: Lowered) -> list[Apply]:
    found = operations_in_order([*lowered.rates, *lowered.outputs.values(), *lowered.jacobian.values()], {})
    return [node for node in found if node.operator in SYSTEMS]


def test_a_row_of_resistors() -> None:
    """Against a loop of transfer matrices by hand: voltages along a ladder are a recursion."""
    count = 40
    made = compiled(count)
    shapes = {shape_of(node) for node in systems(made.lowered)}
    assert shapes and all(s.unknowns == count - 1 and s.lower <= 2 and s.upper <= 2 for s in shapes)
    program = made.program
    parameters, inputs = np.array(program.defaults), np.array(program.input_defaults)
    for r in (10.0, 3.0):
        constants = program.constants(np.where(np.array(program.parameters.names) == "r", r, parameters))
        charge, time = 2e-6, 1.7e-4
        rate = float(
            program.derivative(time, np.array([charge]), inputs, constants, program.switches(time, constants))[0]
        )
        # From the end: u and i before a section are u + r i' and i', with i' = i + u g; what flows into the plates is the unknown.
        u, i = np.array([charge / 1e-6, 0.0]), np.array([0.0, 1.0])
        for _ in range(count):
            i = i + 1e-3 * u
            u = u + r * i
        source = math.sin(2 * math.pi * 1000 * time)
        assert rate == pytest.approx((source - u[0]) / u[1], rel=1e-9)


def test_its_work_grows_as_it_is_long() -> None:
    few, many = (sum(map(_operations, systems(compiled(n).lowered))) for n in (30, 120))
    assert math.log(many / few) / math.log(119 / 29) <= 1.05
    sizes = [sum(len(node.operands) for node in systems(compiled(n).lowered)) for n in (30, 120)]
    assert math.log(sizes[1] / sizes[0]) / math.log(4) <= 1.05


@pytest.mark.machine_code
def test_machine_code_and_c_solve_it_too() -> None:
    program = bondgraph.Model(Source("row.bg", row_of_resistors(30)))
    found = [program.simulate(target=t, rtol=1e-8).final("last") for t in ("native", "numpy")]
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    assert "solve(29, 2, 2, 1, " in program.compile(target="c")
