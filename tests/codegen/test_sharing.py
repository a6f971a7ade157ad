"""One definition with many instances: each law is solved and differentiated once, for any number of instances."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.algebra import derivative as room
from compiler.codegen import lower
from compiler.compilation import Compilation
from compiler.equations import laws
from compiler.graph.network import Element
from tests.compiling import MODELS, compiled
from tests.conftest import Golden

SECTIONS = """
model Section {
  parameter k: N/m = 100, m = 1 kg, r: N*s/m = 0.5
  port left: translation, right: translation
  1 body
  0 joint
  I mass : p = m*v
  C spring : F = k*x + 3*k*x^3/1 [m^2]
  R damper : F = r*v*abs(v)/1 [m/s]
  left -> body -> mass, joint
  joint -> 1(spring, damper)
  joint -> right
}
model Chain {
  parameter n = 10
  Se push : F = 1 N*sin(time/1 s)
  1 first
  push -> first
  for i in 1..n { Section section[i] { k = (90 + i)*1 [N/m] } }
  first -> section[1].left
  for i in 2..n { section[i - 1].right -> section[i].left }
  1 last
  I tip : p = 2 kg*v
  R end : F = 2 [N*s/m]*v
  section[n].right -> last -> tip, end
}
"""


@pytest.fixture(scope="module")
def chains() -> dict[int, Compilation]:
    return {n: compiled(SECTIONS, {"n": str(n)}) for n in (10, 1000)}


def test_every_law_is_differentiated_once(chains: dict[int, Compilation], golden: Golden) -> None:
    """The golden count of 10 and of 1000 instances."""
    small, large = chains[10].program, chains[1000].program
    assert small.differentiated == large.differentiated
    assert len(large.states.names) == 2001
    assert len(small.states.names) == 21
    golden(Path(__file__).with_name("differentiated.txt"), f"laws differentiated: {large.differentiated}")


def test_every_formula_is_made_once(chains: dict[int, Compilation]) -> None:
    small, large = ({a.formula for a in chains[n].equations.assignments} for n in (10, 1000))
    assert len(small) == len(large)
    # the first and the last section have neighbours of their own; the rest is the same
    assert len(chains[1000].equations.assignments) > 90 * len(chains[10].equations.assignments)


def test_equal_formulas_are_one_object(chains: dict[int, Compilation]) -> None:
    assignments = chains[1000].equations.assignments
    springs = {id(a.formula) for a in assignments if a.owner.endswith(".spring")}
    assert len(springs) <= 2


def test_laws_are_shared_by_the_graph(chains: dict[int, Compilation]) -> None:
    kinds = {}
    for node in chains[1000].whole_graph.nodes:
        if isinstance(node, Element):
            kinds.setdefault(node.name.split(".")[-1], set()).add(id(node.law))
    assert {name: len(found) for name, found in kinds.items()} == {
        "mass": 1,
        "spring": 1,
        "damper": 1,
        "push": 1,
        "tip": 1,
        "end": 1,
    }


def test_nothing_is_solved_or_differentiated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted calls: of `solved` per law and direction, of `derivative` per formula and slot."""
    counts: dict[int, tuple[int, int]] = {}
    for n in (5, 50):
        laws.solved.cache_clear()
        lower.partial.cache_clear()
        made = 0
        plain = room.derivative

        def counted(*arguments: object, plain: object = plain) -> object:
            nonlocal made
            made += 1
            return plain(*arguments)  # type: ignore[operator]

        monkeypatch.setattr(lower, "derivative", counted)
        _ = compiled(SECTIONS, {"n": str(n)}, everything=True).program
        counts[n] = (laws.solved.cache_info().misses, made)
        monkeypatch.undo()
    assert counts[5] == counts[50]
    assert counts[5][1] > 0


def test_the_three_arms_of_the_manipulator_share_theirs() -> None:
    """Three combs and three flexures: the energy of a flexure is differentiated once for all."""
    compilation = compiled(MODELS / "manipulator.bg")
    springs = {
        id(n.law)
        for n in compilation.whole_graph.nodes
        if isinstance(n, Element) and n.name.startswith("flexure") and n.name.endswith(".spring")
    }
    assert len(springs) == 1


def test_source_grows_with_the_number_of_instances(chains: dict[int, Compilation]) -> None:
    """Linear: nothing is substituted into anything else."""
    small, large = (len(chains[n].program.source) for n in (10, 1000))
    assert large < 130 * small
    assert chains[1000].program.operations < 130 * chains[10].program.operations
