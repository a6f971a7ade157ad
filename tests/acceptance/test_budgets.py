"""Modules, graphs and derivatives that must not be loaded, built or formed more than once."""

from __future__ import annotations

import subprocess
import sys

import pytest

import bondgraph

HEAVY = ("numpy", "sympy", "scipy", "networkx", "lark")


def loaded(code: str) -> set[str]:
    """The heavy packages that a fresh interpreter has loaded after some code."""
    tail = f"import sys; print(' '.join(m for m in {HEAVY} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{tail}"], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_importing_loads_nothing_heavy() -> None:
    assert loaded("import bondgraph, bondgraph.commands.run") == set()


def test_check_loads_no_solver() -> None:
    assert loaded("import bondgraph; assert not bondgraph.check('models/manipulator.bg')") <= {"lark", "networkx"}


def test_a_run_of_explicit_laws_loads_no_sympy() -> None:
    assert "sympy" not in loaded("import bondgraph; bondgraph.load('models/rlc.bg').simulate()")


CHAIN = """
model Cell {{
  parameter k: N/m = 2, r: N*s/m = 0.1
  port left: translation, right: translation
  C spring : F = k*x + 3 [N/m^3]*x^3
  R damper : F = r*v
  I mass   : p = 1 kg*v
  left -> 0(1(spring, damper)) -> 1(mass) -> right
}}
model Chain {{
  Sf drive : v = 1 [m/s]*sin(time*1 [1/s])
  for i in 1..{n} {{ Cell cell[i] }}
  drive -> cell[1].left
  for i in 1..{n} - 1 {{ cell[i].right -> cell[i+1].left }}
  Se end : F = 1 N
  cell[{n}].right -> end
  output x = cell[{n}].spring.x
}}
"""


@pytest.mark.machine_code
@pytest.mark.parametrize("n", [3, 1000])
def test_a_law_is_built_and_differentiated_once(n: int) -> None:
    compilation = bondgraph.load(CHAIN.format(n=n)).compilation()
    laws = {node.law for node in compilation.graph.nodes if hasattr(node, "law")}
    assert len(laws) == 5  # spring, damper, mass, drive, end
    # Spring, damper and mass, and the sums of two and of three terms at junctions.
    assert compilation.program.differentiated == 5
    formulas = {a.formula for a in compilation.equations.assignments}
    assert len(formulas) <= 9
    assert len({id(f) for f in formulas}) == len(formulas)
    assert len(compilation.program.states.names) == 2 * n
