"""Rows of quantities and of elements, one computed from the other: as long as they like, no stage nests with their length."""

from __future__ import annotations

import math

import pytest

import bondgraph

LENGTH = 3000


def last(text: str, to: float = 1.0) -> float:
    """The output y at the end of a run."""
    return float(bondgraph.load(f"model A {{\n{text}\n}}").simulate(to=to, points=2).final("y"))


@pytest.mark.parametrize(
    "first, index", [("u[0]", "u[i] = sin(u[i-1])"), (f"u[{LENGTH}]", f"u[{LENGTH}-i] = sin(u[{LENGTH}-i+1])")]
)
def test_signals(first: str, index: str) -> None:
    """sin(sin(… sin(1))), declared from its beginning or from its end."""
    expected = 1.0
    for _ in range(LENGTH):
        expected = math.sin(expected)
    end = f"u[{LENGTH}]" if first == "u[0]" else "u[0]"
    found = last(f"signal {first} = time/1 s\nfor i in 1..{LENGTH} {{ signal {index} }}\noutput y = {end}")
    assert found == pytest.approx(expected, rel=1e-12)


def test_a_state_behind_signals() -> None:
    """dz/dt = -z, where z comes back through a row of copies with a factor."""
    text = f"""
      signal z = integral(-u[{LENGTH}]/1 s, 1)
      signal u[0] = z
      for i in 1..{LENGTH} {{ signal u[i] = 0.9999*u[i-1] }}
      output y = z"""
    assert last(text) == pytest.approx(math.exp(-(0.9999**LENGTH)), rel=1e-6)


def test_integrals() -> None:
    """Each reads the one before: the first of a row that starts at 1 decays exponentially."""
    text = f"""
      signal u[0] : 1 = integral(-u[0]/1 s, 1)
      for i in 1..{LENGTH // 10} {{ signal u[i] : 1 = integral((u[i-1] - u[i])/1 s, 0) }}
      output y = u[1]"""
    assert last(text) == pytest.approx(math.exp(-1), rel=1e-6)  # t exp(-t)


def test_parameters() -> None:
    rows = "\n".join(f"parameter p{i} = 0.999*p{i - 1}" for i in range(1, LENGTH))
    assert last(f"parameter p0 = 1\n{rows}\noutput y = p{LENGTH - 1}*time/1 s") == pytest.approx(0.999 ** (LENGTH - 1))


def test_transformers_behind_a_mechanism() -> None:
    """The displacement of a spring is known from the body's, through every transformer: no state is added."""
    text = f"""
      multibody r : planar {{ body p {{ mass = 1 kg, inertia = 1 [kg*m^2] }} }}
      C spring : F = 1 [N/m]*x
      for i in 1..{LENGTH} {{
        TF t[i] : v2 = 1.0001*v1
        1 j[i] : translation
      }}
      Se push : F = 1 N
      push -> r.p.x -> t[1]
      for i in 1..{LENGTH - 1} {{ t[i] -> j[i] -> t[i+1] }}
      t[{LENGTH}] -> j[{LENGTH}] -> spring
      output y = spring.x"""
    model = bondgraph.load(f"model A {{\n{text}\n}}")
    assert not any("spring" in state for state in model.states)
    n = 1.0001**LENGTH
    result = model.simulate(to=1.0, points=2)
    assert result.final("y") == pytest.approx(
        (1 - math.cos(n)) / n, rel=1e-5
    )  # k = n^2, x = (1 - cos(n t))/n^2, times n
