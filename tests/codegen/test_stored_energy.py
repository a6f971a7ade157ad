"""Stored energy and its gradient by the states, against integrals by hand and degrees by sympy."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any, cast

import pytest
import sympy

from compiler.algebra.expression import (
    ONE,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    divide,
    evaluate,
    multiply,
    power,
    substitute,
)
from compiler.codegen.stored_energy import _degree, _gauss, stored_energy
from compiler.equations.system import Storage

X, Y, K = Symbol(0), Symbol(1), Symbol(2)


def storage(
    stored: tuple[int, ...], arguments: tuple[Any, ...], *laws: Expression, energy: Expression | None = None
) -> Storage:
    return Storage("c", "C", stored, arguments, energy, laws)


def lowered(storages: tuple[Storage, ...], starts: tuple[float, ...], **more: Any) -> Any:
    """A program with a state for each start: state i is variable i, and its value the symbol i."""
    space = {"stored": {}, "following": (), "storages": storages} | more
    states = [SimpleNamespace(variable=i) for i in range(len(starts))]
    values = {i: Symbol(i) for i in range(10)}
    return SimpleNamespace(
        space=SimpleNamespace(states=states, **space), values=values, starts=[Number(s) for s in starts]
    )


def of(program: Any, slopes: dict[int, dict[int, Expression]], *at: float) -> list[float]:
    """Energy and gradient where variable i has the value `at[i]`."""
    return [evaluate(x, lambda i: at[i]) for x in stored_energy(program, slopes)]


OWN = {0: {0: cast(Expression, ONE)}, 1: {1: cast(Expression, ONE)}}


def test_a_polynomial_law_is_integrated_from_its_start() -> None:
    """A spring F = 7*x + 2*x^3 with its start at 0.5."""
    law = add(multiply(K, X), multiply(Number(2.0), power(X, Number(3.0))))
    spring = storage((0,), (7.0,), substituted(law, {2: 1}))
    x, start = 1.25, 0.5
    energy, force = of(lowered((spring,), (start,)), OWN, x)
    assert energy == pytest.approx(3.5 * (x**2 - start**2) + 0.5 * (x**4 - start**4), rel=1e-14)
    assert force == pytest.approx(7 * x + 2 * x**3, rel=1e-14)


def substituted(x: Expression, slots: dict[int, int]) -> Expression:
    """The expression with other slots."""
    return substitute(x, lambda s: Symbol(slots.get(s.key, s.key)))


def test_a_field_of_two_ports_has_the_energy_of_its_potential() -> None:
    """Efforts a*x + k*x*y^2 and k*x^2*y + 3*y of U = a*x^2/2 + k*x^2*y^2/2 + 3*y^2/2, with `k` a variable."""
    a = 5.0
    first = add(multiply(Number(a), X), multiply(K, X, Y, Y))
    second = add(multiply(K, X, X, Y), multiply(Number(3.0), Y))

    def potential(x: float, y: float, k: float) -> float:
        return a * x * x / 2 + k * x * x * y * y / 2 + 1.5 * y * y

    k, x, y = 1.75, -0.8, 2.5
    energy, *efforts = of(lowered((storage((0, 1), (4,), first, second),), (0.25, -1.5)), OWN, x, y, 0.0, 0.0, k)
    assert energy == pytest.approx(potential(x, y, k) - potential(0.25, -1.5, k), rel=1e-13)
    assert efforts == pytest.approx([a * x + k * x * y * y, k * x * x * y + 3 * y], rel=1e-13)


def test_a_law_that_is_no_polynomial_is_integrated_to_rounding() -> None:
    spring = storage((0,), (), call("sin", X))
    energy, force = of(lowered((spring,), (0.5,)), OWN, 2.5)
    assert energy == pytest.approx(float(sympy.cos(0.5) - sympy.cos(2.5)), rel=1e-14)
    assert force == pytest.approx(float(sympy.sin(2.5)), rel=1e-15)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4, 5, 30, 31, 32, 40])
def test_a_power_takes_the_fewest_places_that_are_exact(degree: int) -> None:
    law = power(X, Number(float(degree)))
    energy, _ = stored_energy(lowered((storage((0,), (), law),), (0.0,)), OWN)
    terms = energy.operands if isinstance(energy, Apply) and energy.operator == "add" else (energy,)
    assert len(terms) == min(degree // 2 + 1, 16)
    if degree < 32:
        assert evaluate(energy, lambda _: 1.5) == pytest.approx(1.5 ** (degree + 1) / (degree + 1), rel=1e-13)


def test_the_highest_degree_of_several_laws_counts() -> None:
    field = storage((0, 1), (), power(X, Number(5.0)), Y)
    energy, *_ = of(lowered((field,), (0.0, 0.0)), OWN, 2.0, 3.0)
    assert energy == pytest.approx(2.0**6 / 6 + 4.5, rel=1e-14)


def test_given_energies_and_followers_count_and_unknowns_do_not() -> None:
    """Variable 2 holds an energy; 3 = 2*x and 5 = 4*x follow the state 0 from a number and from a variable; column 2 is an unknown."""
    given = storage((1,), (6,), energy=substituted(multiply(K, X, X), {2: 1}))
    following = (SimpleNamespace(variable=3, start=0.5), SimpleNamespace(variable=5, start=7))
    program = lowered(
        (given, storage((3,), (), X), storage((5,), (), multiply(Number(2.0), X))),
        (9.0, 8.0),
        stored={"c": 2},
        following=following,
    )
    slopes: dict[int, dict[int, Expression]] = {
        1: {1: ONE},
        2: {0: Number(11.0), 2: Number(100.0)},
        3: {0: Number(2.0)},
        5: {0: Number(4.0), 1: Number(0.5), 2: Number(100.0)},
    }
    # variables: 0 to 7
    at = (0.0, 3.0, 13.0, 1.5, 0.0, 2.5, 6.0, 0.75)
    energy, *gradient = of(program, slopes, *at)
    assert energy == pytest.approx(13 + 6 * 3**2 + (1.5**2 - 0.5**2) / 2 + (2.5**2 - 0.75**2), rel=1e-14)
    assert gradient == pytest.approx([11 + 1.5 * 2 + 5 * 4, 2 * 6 * 3 + 5 * 0.5], rel=1e-14)


def test_a_state_that_stores_nothing_has_no_slope_and_a_content_that_is_no_state_begins_at_zero() -> None:
    program = lowered((storage((3,), (), X),), (1.0, 1.0))
    assert of(program, {3: {1: Number(2.0)}}, 0.0, 0.0, 0.0, 4.0) == [8.0, 0.0, 8.0]


@pytest.mark.parametrize("count", [1, 2, 5, 16])
def test_places_and_weights_integrate_powers_exactly(count: int) -> None:
    for degree in range(2 * count):
        assert sum(w * p**degree for p, w in _gauss(count)) == pytest.approx(1 / (degree + 1), rel=1e-13)


def _random_polynomial(rng: random.Random, depth: int) -> tuple[Expression, Any]:
    """A polynomial with positive coefficients, so that nothing cancels, and the same by sympy."""
    if depth == 0 or rng.random() < 0.15:
        i = rng.randrange(4)
        value = rng.uniform(1, 2)
        return (Symbol(i), sympy.Symbol(f"x{i}")) if i < 3 else (Number(value), sympy.Integer(3))
    (a, p), (b, q) = (_random_polynomial(rng, depth - 1) for _ in range(2))
    kind = rng.choice(["add", "multiply", "divide", "power"])
    if kind == "add":
        return add(a, b), p + q
    if kind == "multiply":
        return multiply(a, b), p * q
    if kind == "divide":
        return divide(a, add(K, ONE)), p / (sympy.Symbol("x2") + 1)
    n = rng.randrange(1, 4)
    return power(a, Number(float(n))), p**n


@pytest.mark.parametrize("seed", range(40))
def test_the_degree_of_a_polynomial_is_that_of_sympy(seed: int) -> None:
    mine, other = _random_polynomial(random.Random(seed), 3)
    assert _degree(mine, 2) == sympy.Poly(other, *sympy.symbols("x0 x1")).total_degree()


@pytest.mark.parametrize(
    "x",
    [
        call("sin", X),
        divide(ONE, X),
        divide(X, Y),
        power(X, Number(0.5)),
        power(X, Number(-1.0)),
        power(X, Number(2.5)),
        power(Number(2.0), X),
        power(X, K),
        add(X, call("exp", Y)),
        multiply(K, X, call("abs", Y)),
        power(call("sin", X), Number(2.0)),
    ],
)
def test_what_is_no_polynomial_has_no_degree(x: Expression) -> None:
    assert _degree(x, 2) is None


@pytest.mark.parametrize(
    "x", [call("sin", K), power(K, Number(0.5)), divide(ONE, K), Number(3.0), power(Number(2.0), K), K]
)
def test_what_has_no_slot_has_degree_zero(x: Expression) -> None:
    assert _degree(x, 2) == 0
