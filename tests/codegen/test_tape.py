"""Tapes: values as the generated program has them, derivatives along directions against complex and high-order differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from compiler.algebra.expression import Apply, Expression, Number, Symbol, call, select
from compiler.codegen.limits import Leaf
from compiler.codegen.tape import Tape
from tests.compiling import MODELS, compiled

X, Y = Symbol(Leaf("state", 0)), Symbol(Leaf("state", 1))


def at(*values: float) -> Any:
    return lambda leaf: values[leaf.position]


EXPRESSIONS: dict[str, tuple[Expression, float, float, float]] = {  # at x = 0.6, y = 1.3: value, by x, by y
    "product": (X * Y * Y, 0.6 * 1.69, 1.69, 2 * 0.6 * 1.3),
    "quotient": (X / Y, 0.6 / 1.3, 1 / 1.3, -0.6 / 1.69),
    "power": (call("power", X, Y), 0.6**1.3, 1.3 * 0.6**0.3, 0.6**1.3 * np.log(0.6)),
    "angle": (call("atan2", Y, X), np.arctan2(1.3, 0.6), -1.3 / 2.05, 0.6 / 2.05),
    "choice": (select(call("less", X, Y), call("sin", X), call("sqrt", -X)), np.sin(0.6), np.cos(0.6), 0.0),
    "least": (call("min", X * Y, Y), 0.78, 1.3, 0.6),
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_operators(name: str) -> None:
    expression, value, by_x, by_y = EXPRESSIONS[name]
    directions = {Leaf("state", 0): np.array([1.0, 0.0, 2.0]), Leaf("state", 1): np.array([0.0, 1.0, -1.0])}
    (found,), (slopes,) = Tape([expression]).slopes(at(0.6, 1.3), directions, 3)
    assert found == pytest.approx(value, rel=1e-15)
    assert slopes == pytest.approx([by_x, by_y, 2 * by_x - by_y], rel=1e-14, abs=1e-15)
    assert Tape([expression]).values(at(0.6, 1.3)) == [found]


def test_linear_systems() -> None:
    """[[x, 1], [2, y]] t = [y, 1]: by Cramer's rule."""
    system = Apply("solve", (X, Number(1.0), Number(2.0), Y, Y, Number(1.0)))
    first, second = (Apply("item", (system, Number(float(i)))) for i in (0, 1))
    values, slopes = Tape([first, second]).slopes(at(0.6, 1.3), {Leaf("state", 0): np.array([1.0])}, 1)
    det = 0.6 * 1.3 - 2
    assert values == pytest.approx([(1.3 * 1.3 - 1) / det, (0.6 - 2 * 1.3) / det], rel=1e-14)
    assert np.ravel(slopes) == pytest.approx(
        [-(1.69 - 1) * 1.3 / det**2, 1 / det - (0.6 - 2.6) * 1.3 / det**2], rel=1e-13
    )


def test_what_stands_still_and_what_has_no_value() -> None:
    values, slopes = Tape([X, Number(3.0), call("log", X)]).slopes(at(-1.0, 0.0), {}, 2)
    assert values[:2] == [-1.0, 3.0] and np.isnan(values[2]) and slopes == [None, None, None]


def test_second_derivatives_of_the_manipulator() -> None:
    """The Jacobian's entries along a direction, against central differences of the generated program's entries."""
    made = compiled(MODELS / "manipulator.bg")
    lowered, program = made.lowered, made.program
    random = np.random.default_rng(5)
    state = random.normal(size=len(program.states.names)) * np.where(np.arange(12) % 2, 1e-2, 1e-6)
    way = random.normal(size=12) * np.where(np.arange(12) % 2, 1e-2, 1e-6)
    constants = program.constants(np.array(program.defaults))
    fixed = (np.array(program.input_defaults), constants, program.switches(0.0, constants))

    def lookup(leaf: Leaf) -> float:
        return {"state": state, "parameter": program.defaults, "input": program.input_defaults}[leaf.role][
            leaf.position
        ]

    places = sorted(lowered.jacobian)
    directions = {Leaf("state", i): np.array([w]) for i, w in enumerate(way)}
    values, slopes = Tape([lowered.jacobian[p] for p in places]).slopes(lookup, directions, 1)
    entries = program.jacobian_entries(0.0, state, *fixed)
    assert values == pytest.approx(entries, rel=1e-9, abs=1e-9 * np.abs(entries).max())
    ahead, behind = (program.jacobian_entries(0.0, state + h * way, *fixed) for h in (1e-4, -1e-4))
    wanted = (ahead - behind) / 2e-4
    found = np.array([0.0 if s is None else s[0] for s in slopes])
    assert found == pytest.approx(wanted, rel=1e-5, abs=1e-9 * np.abs(entries).max())
    assert np.abs(found).max() > 0
