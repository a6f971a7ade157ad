"""Zero divisors, against expressions that are evaluated with parameters of zero."""

from __future__ import annotations

import random
from dataclasses import replace
from itertools import chain, combinations

import pytest

from compiler.algebra.expression import (
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
    select,
)
from compiler.codegen.zero_divisors import ALWAYS, MOST, NEVER, _divisors, _smallest, _vanishing, zero_divisors
from tests.compiling import compiled

NAMES = "abcd"
SETS = [frozenset({frozenset({n})}) for n in NAMES]
A, B, C, D = (Symbol(i) for i in range(4))
FUNCTIONS = ("sin", "abs", "tanh", "sign", "sinh", "atan", "erf", "asinh", "tan", "exp", "cos", "cosh")


def sets(*words: str) -> frozenset[frozenset[str]]:
    return frozenset(map(frozenset, words))


def _random(rng: random.Random, depth: int) -> Expression:
    """An expression in which nothing cancels: each term has a factor of its own."""
    if depth == 0:
        return Symbol(rng.randrange(4))

    def inner() -> Expression:
        return _random(rng, depth - 1)

    match rng.randrange(6):
        case 0 | 1:
            return multiply(inner(), inner())
        case 2:
            return add(multiply(Number(rng.uniform(1, 2)), inner()), multiply(Number(rng.uniform(-2, -1)), inner()))
        case 3:
            return divide(inner(), Number(rng.uniform(1, 2)))
        case 4:
            return power(inner(), Number(float(rng.randrange(2, 4))))
    return call(rng.choice(FUNCTIONS), multiply(Number(rng.uniform(0.2, 0.3)), inner()))


def _by_values(x: Expression, rng: random.Random) -> frozenset[frozenset[str]]:
    """The smallest sets of names whose zeros make an expression zero for any values of the others."""
    found: list[frozenset[str]] = []
    for chosen in chain.from_iterable(combinations(range(4), n) for n in range(5)):
        names = frozenset(NAMES[i] for i in chosen)
        samples = [
            [0.0 if i in chosen else rng.choice([-1, 1]) * rng.uniform(0.5, 1.5) for i in range(4)] for _ in range(24)
        ]
        if not any(f <= names for f in found) and all(evaluate(x, s.__getitem__) == 0.0 for s in samples):
            found.append(names)
    return frozenset(found)


@pytest.mark.parametrize("seed", range(60))
def test_the_sets_of_an_expression_are_those_of_its_values(seed: int) -> None:
    rng = random.Random(seed)
    x = _random(rng, 2)
    assert _vanishing(x, SETS, {}) == _by_values(x, rng)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (Number(0.0), ALWAYS),
        (Number(-2.0), NEVER),
        (power(A, Number(0.3)), sets("a")),
        (power(A, Number(-0.3)), NEVER),
        (power(A, Number(-1.0)), NEVER),
        (power(A, B), NEVER),
        (call("sqrt", A), sets("a")),
        (call("exp", A), NEVER),
        (divide(multiply(A, B), add(C, D)), sets("a", "b")),
        (add(A, Number(1.0)), NEVER),
        (multiply(A, add(A, B)), sets("a")),
        (multiply(add(A, B), add(C, D)), sets("ab", "cd")),
        (call("min", A, multiply(B, C)), sets("ab", "ac")),
        (call("max", A, B), sets("ab")),
        (add(multiply(A, B), multiply(C, D)), sets("ac", "ad", "bc", "bd")),
    ],
)
def test_the_sets_of_an_expression(x: Expression, expected: frozenset[frozenset[str]]) -> None:
    assert _vanishing(x, SETS, {}) == expected


def test_a_quantity_of_more_sets_than_are_kept_counts_as_never_zero() -> None:
    each = [frozenset({str(i)}) for i in range(MOST + 1)]
    assert _smallest(each[:MOST]) == frozenset(each[:MOST]) and len(each) == 65
    assert _smallest(each) == NEVER


def test_a_set_that_contains_another_is_left_out() -> None:
    assert _smallest([frozenset("abc"), frozenset("a"), frozenset("bc"), frozenset("ab")]) == sets("a", "bc")
    assert _smallest([frozenset("a"), frozenset("a")]) == sets("a")


def test_divisors_lie_outside_of_an_if() -> None:
    """Quotients and negative powers, inside of others too."""
    guarded = select(call("less", A, B), divide(A, B), divide(B, A))
    x = add(
        divide(A, divide(B, C)),
        call("sin", power(D, Number(-2.0))),
        guarded,
        power(A, Number(0.3)),
        power(A, B),
        power(B, Number(-0.3)),
    )
    assert sorted(map(str, _divisors(x))) == sorted(map(str, (divide(B, C), C, D, B)))
    assert [*_divisors(A)] == [] == [*_divisors(guarded)]
    assert isinstance(guarded, Apply) and guarded.operator == "select"


TEXT = """plain model M {
  parameter a = 1, b = 2, c = 3, d = 4, g = 5, h = 6
  signal product = a*b
  signal s = integral(1/product + 1/(c + d) + 1/(time*g) + 1/exp(h), 0)
  C spring : e = q/g
  R damper : e = 2*f
  MSe push : e = s
  push -> 1(spring, damper)
  output y = spring.q + s + 1/h
}
"""


def test_divisors_of_the_rates_of_a_model() -> None:
    """`exp(h)` never vanishes, and `1/h` is a divisor of the output alone."""
    space = compiled(TEXT, free=("*",)).state_space
    assert zero_divisors(space, frozenset("abcdgh")) == sets("a", "b", "cd", "g")
    assert zero_divisors(space, frozenset("ac")) == sets("a")
    assert zero_divisors(space, frozenset("cd")) == sets("cd")
    assert zero_divisors(space, frozenset()) == NEVER


@pytest.mark.parametrize(("number", "expected"), [(0.0, sets("d")), (2.0, NEVER)])
def test_a_number_among_the_arguments_vanishes_if_it_is_zero(
    number: float, expected: frozenset[frozenset[str]]
) -> None:
    text = "plain model M { parameter c = 3, d = 4; signal s = integral(1/(c + d), 0); output y = s }"
    space = compiled(text, free=("*",)).state_space
    c = next(i for i, v in enumerate(space.variables) if v.name == "c")
    steps = tuple(
        replace(s, arguments=tuple(number if a == c else a for a in s.arguments))  # type: ignore[union-attr]
        for s in space.steps
    )
    assert zero_divisors(space, frozenset("cd")) == sets("cd")
    assert zero_divisors(replace(space, steps=steps), frozenset("cd")) == expected


def test_terms_are_joined_one_by_one() -> None:
    """All combinations of these 40 terms of two factors would be 2^40."""
    terms = [multiply(Symbol(i), Symbol(40)) for i in range(40)]
    names = [frozenset({frozenset({f"p{i}"})}) for i in range(41)]
    whole = frozenset({frozenset({"p40"}), frozenset(f"p{i}" for i in range(40))})
    assert _vanishing(Apply("add", tuple(terms)), names, {}) == whole
    assert _vanishing(Apply("add", (*terms, Number(2.0))), names, {}) == NEVER
