"""The table of functions of a program: each is in every target, and what a program does not need is absent."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.codegen.c.write import write_c
from compiler.codegen.llvm.generate import generate_program as native_program
from compiler.codegen.numpy.generate import generate_program as numpy_program
from compiler.jit.machine import available
from tests.compiling import compiled

TEXT = """model Circuit {
  Se battery : u = 3 V
  R  line : u = 2 ohm*i
  C  store : u = q/0.5 [F] { start q = 0.25 C }
  I  coil : lambda = 0.1 [V*s/A]*i { start i = 0.4 [A] }
  GY motor : u1 = 0.2 [V*s]*omega2
  R  bearing : M = 0.3 [N*m*s]*omega^3/1 [1/s^2]
  I  rotor : L = 0.02 [kg*m^2]*omega { start omega = 1.5 [1/s] }
  1 loop : electric
  1 shaft : rotation
  battery -> loop -> line, store, coil, motor
  motor -> shaft -> rotor, bearing
  output i = coil.i
}"""


@pytest.mark.parametrize("target", [numpy_program, *([native_program] if available() else [])])
def test_power_balance(target) -> None:  # type: ignore[no-untyped-def]
    """Supplied, dissipated, and into the storages: 3 V 0.4 A; 2 ohm (0.4 A)^2 and 0.3 (1.5)^4; the rest. Also of a batch."""
    program = target(compiled(TEXT, everything=True).lowered)
    constants = program.constants(np.array(program.defaults))
    state, mode = program.start(constants), program.switches(0.0, constants)
    supplied, dissipated, stored = program.functions["power_balance"](0.0, state, (), constants, mode)
    assert supplied == pytest.approx(1.2, rel=1e-14)
    assert dissipated == pytest.approx(2 * 0.16 + 0.3 * 1.5**4, rel=1e-14)
    assert stored == pytest.approx(supplied - dissipated, rel=1e-13)
    states = np.random.default_rng(1).normal(size=(20, len(state)))
    balance = program.functions["power_balance"](0.0, states, (), constants, mode)
    np.testing.assert_allclose(balance[:, 0], balance[:, 1] + balance[:, 2], rtol=0, atol=1e-14 * np.abs(balance).max())


def test_absent() -> None:
    """Without the ports' powers, as in a run that reports no energy; no events, no delays."""
    found = numpy_program(compiled(TEXT).lowered).functions
    assert not {"power_balance", "roots", "triggers", "lags", "delayed", "solved"} & found.keys()
    assert found.keys() >= {"derivative", "output", "jacobian_entries"}


def test_in_c() -> None:
    text = write_c(compiled(TEXT, everything=True).lowered)
    assert "void Circuit_power_balance(" in text and "Circuit_power_balance_count = 3" in text
