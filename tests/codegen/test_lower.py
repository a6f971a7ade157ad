"""What a program has of switched junctions: the conjugate of all that is stored, for the impulses that pass where they switch."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.reduction.state_space import LinearLoop
from tests.compiling import Running, compiled

TEXT = """plain model M {
  parameter k = 4
  I one : p = 2*f
  I two : p = 3*f
  C spring : e = k*q^3
  R damper : e = f
  Se push : e = 1
  1 ball { active = not resting }
  push -> ball -> one, two, spring, damper
  mode resting = false
  when count > 3 { resting = true }
  signal count = integral(spring.q, 0)
  output c = count
}"""


@pytest.mark.parametrize("everything", [False, True])
def test_conjugates_of_all_that_is_stored(everything: bool) -> None:
    """The effort of a spring and the flows of masses, also of one that is computed; of an integral none."""
    running = Running(compiled(TEXT, everything=everything))
    program = running.program
    state = {"one.p": 2.5, "two.p": 3.75, "spring.q": 1.5, "count": 0.75}
    values = running.arguments(0.0, {n: v for n, v in state.items() if n in program.states.names}, None)
    expected = {"one.p": 1.25, "two.p": 1.25, "spring.q": 4 * 1.5**3, "count": 0.0}
    names = [*program.states.names]
    (dependent,) = {"one.p", "two.p"} - {*names}
    found = program.hybrid.conjugates(*values)
    assert np.ravel(found) == pytest.approx([expected[n] for n in (*names, dependent)], rel=1e-14)


def test_a_loop_has_several_targets_and_an_assignment_one() -> None:
    space = compiled(TEXT).state_space
    assert {s.targets for s in space.steps if not isinstance(s, LinearLoop)} == {
        (s.target,) for s in space.steps if not isinstance(s, LinearLoop)
    }
    ladder = compiled(
        """plain model L {
      parameter r = 1
      Se s : e = 3
      for i in 1..5 { R a[i] : e = i*r*f }
      C c : e = q
      s -> 1(a[1]) -> 0(a[2]) -> 1(a[3]) -> 0(a[4]) -> 1(a[5]) -> 1(c)
      output f = a[1].f
    }""",
        free=("*",),
    ).state_space
    (loop,) = [s for s in ladder.steps if isinstance(s, LinearLoop)]
    assert len(loop.targets) == 2
