"""Products put together from common parts: the same values, fewer multiplications, the same parts for equal laws."""

from __future__ import annotations

import math

import pytest

from compiler.algebra.expression import MINUS_ONE, Expression, operations
from compiler.codegen.common_factors import with_shared_products
from compiler.codegen.limits import Leaf
from compiler.codegen.lower import count_operations, lower
from compiler.codegen.lowered import Lowered
from compiler.codegen.tape import Tape
from tests.compiling import MODELS, compiled


def values(lowered: Lowered, roots: list[Expression]) -> list[float]:
    """At states that are none in particular."""

    def lookup(leaf: Leaf) -> float:
        if leaf.role == "parameter":
            return lowered.parameter_values(leaf)
        return {"state": 1e-6 * math.sin(1.0 + leaf.position), "mode": 1.0}.get(leaf.role, 0.3 + 0.1 * leaf.position)

    return Tape(roots).values(lookup)


def work(roots: list[Expression]) -> int:
    """Operations without signs, which cost nothing: the sum subtracts instead."""
    met = {node for root in roots for node in operations(root)}
    signs = sum(node.operator == "multiply" and node.operands[0] == MINUS_ONE for node in met)
    return count_operations(roots) - signs


@pytest.mark.parametrize(
    "name", ["manipulator", "car", "crane", "robot_arm", "rectifier", "duffing", "hydraulic_press"]
)
def test_the_values_are_the_same(name: str) -> None:
    before = lower(compiled(MODELS / f"{name}.bg").state_space)
    after = with_shared_products(before)
    for old, new in (
        (before.rates, after.rates),
        (before.jacobian.values(), after.jacobian.values()),
        (before.outputs.values(), after.outputs.values()),
    ):
        expected, found = values(before, list(old)), values(after, list(new))
        scale = max((abs(e) for e in expected if math.isfinite(e)), default=1.0)
        for e, f in zip(expected, found, strict=True):
            assert (math.isnan(e) and math.isnan(f)) or math.isclose(e, f, rel_tol=1e-11, abs_tol=1e-14 * scale)
    assert work([*after.rates, *after.jacobian.values()]) <= work([*before.rates, *before.jacobian.values()])


@pytest.mark.parametrize("name, most", [("manipulator", 722), ("car", 1543), ("robot_arm", 9987)])
def test_jacobians_get_shorter(name: str, most: int) -> None:
    """At most the numbers measured when this was written: from 908, 2246 and 13 301 operations, which may become fewer."""
    before = lower(compiled(MODELS / f"{name}.bg").state_space)
    assert work(list(with_shared_products(before).jacobian.values())) <= most


def test_a_sign_and_what_parameters_decide_stand_apart() -> None:
    lowered = with_shared_products(lower(compiled(MODELS / "manipulator.bg").state_space))
    for root in (*lowered.rates, *lowered.jacobian.values()):
        for node in operations(root):
            if node.operator == "multiply" and MINUS_ONE in node.operands:
                assert len(node.operands) == 2 and node.operands[0] == MINUS_ONE
