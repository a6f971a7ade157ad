"""Single states and batches: the same functions over arrays with leading axes, pure, and equal to the last bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compiler.codegen.numpy.generate import load_module
from compiler.codegen.program import Program
from tests.codegen.test_module import OSCILLATOR, compiled_model, every_model
from tests.compiling import Running, compiled

FUNCTIONS = ("derivative", "jacobian", "output", "powers")


def states(running: Running, shape: tuple[int, ...], seed: int = 1) -> Any:
    """Random states near the start, small enough for every model."""
    generator = np.random.default_rng(seed)
    return running.start + 1e-6 * generator.standard_normal((*shape, len(running.start)))


def close(batch: Any, single: Any) -> None:
    """To 1e-15 of the largest entry: numpy may sum and call functions in another order for arrays."""
    scale = np.abs(single).max(initial=0.0)
    assert np.abs(np.asarray(batch) - single).max(initial=0.0) <= 4e-15 * scale


@pytest.mark.few(60)
@every_model
@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_batch_is_its_members(path: Path, name: str, function: str) -> None:
    running = Running(compiled_model(path, name, everything=True))
    f = getattr(running.program, function)
    time, _, inputs, constants, mode = running.arguments(1e-3, None, None)
    batch = states(running, (3, 2))
    found = f(time, batch, inputs, constants, mode)
    single = f(time, batch[0, 0], inputs, constants, mode)
    assert found.shape == (3, 2, *single.shape)
    for i in range(3):
        for j in range(2):
            close(found[i, j], f(time, batch[i, j], inputs, constants, mode))


def test_a_batch_of_parameters() -> None:
    """Constants, starts and rates for several parameter sets at once."""
    program = compiled(OSCILLATOR, free=("*",)).program
    sets = np.array(program.defaults) * np.array([1.0, 2.0, 5.0])[:, None]
    constants = program.constants(sets)
    start = program.start(constants)
    assert start.shape == (3, len(program.states.names))
    mode = program.switches(0.2, constants)
    inputs = np.array(program.input_defaults)
    rates = program.derivative(0.2, start + 1e-3, inputs, constants, mode)
    for i in range(3):
        one = program.constants(sets[i])
        close(rates[i], program.derivative(0.2, start[i] + 1e-3, inputs, one, program.switches(0.2, one)))


def test_a_batch_of_times_and_inputs() -> None:
    program = compiled(OSCILLATOR, free=("*",)).program
    constants = program.constants(np.array(program.defaults))
    times = np.array([0.0, 0.05, 0.2, 1.0])
    state = program.start(constants) + np.zeros((4, 1))
    inputs = np.array([[1.0], [2.0], [3.0], [4.0]])
    mode = program.switches(times, constants)
    rates = program.derivative(times, state, inputs, constants, mode)
    for i, time in enumerate(times):
        close(rates[i], program.derivative(time, state[i], inputs[i], constants, program.switches(time, constants)))
    assert rates[2, 0] - rates[1, 0] == pytest.approx(2.0), "one newton of the step, one of the input"


def test_an_empty_batch() -> None:
    running = Running(compiled(OSCILLATOR))
    time, x, inputs, constants, mode = running.arguments(0.0, None, None)
    assert running.program.derivative(time, np.empty((0, len(x))), inputs, constants, mode).shape == (0, len(x))


@pytest.mark.parametrize("path", [None], ids=["oscillator"])
def test_nothing_is_written_to(path: None) -> None:
    """Pure functions over the caller's arrays: read-only ones are as good as any, and a second call gives the same."""
    running = Running(compiled(OSCILLATOR, free=("*",)))
    arguments = running.arguments(0.2, {"spring.x": 1e-3}, None)
    for array in arguments[1:]:
        np.asarray(array).flags.writeable = False
    for function in FUNCTIONS:
        f = getattr(running.program, function)
        first = f(*arguments)
        assert np.array_equal(first, f(*arguments))
        first[...] = np.nan
        assert np.isfinite(f(*arguments)).all(), "a result is the caller's to change"


def test_two_programs_do_not_share_anything() -> None:
    a, b = (Running(compiled(OSCILLATOR, {"m": value})) for value in ("1 kg", "2 kg"))
    state = {"spring.x": 0.1}
    before = a.rates(state)
    b.rates(state)
    assert a.rates(state) == before


def pattern(program: Program) -> set[tuple[int, int]]:
    return set(zip(*(p.tolist() for p in program.pattern), strict=True))


@pytest.mark.few(28)
@every_model
def test_jacobian_entries_on_their_pattern(path: Path, name: str) -> None:
    """The sparse entries are those of the dense matrix, and outside of the pattern there is nothing."""
    running = Running(compiled_model(path, name, everything=True))
    arguments = list(running.arguments(1e-3, None, None))
    arguments[1] = states(running, ())
    dense, entries = running.program.jacobian(*arguments), running.program.jacobian_entries(*arguments)
    found = pattern(running.program)
    assert len(found) == entries.shape[-1]
    for (row, column), value in zip(zip(*running.program.pattern, strict=True), entries, strict=True):
        assert dense[row, column] == value
    assert {(int(r), int(c)) for r, c in zip(*np.nonzero(dense), strict=True)} <= found


def test_a_singular_member_spoils_no_other() -> None:
    """A member whose loop has no solution is not finite; the others of its batch are right."""
    module = load_module("solve", compiled(OSCILLATOR).program.source)
    singular, regular = [1.0, 1.0, 1.0, 1.0, 2.0, 3.0], [2.0, 1.0, 1.0, 3.0, 4.0, 7.0]
    with np.errstate(all="ignore"):
        assert module._solve(2, *regular).tolist() == pytest.approx([1.0, 2.0])
        assert not np.isfinite(module._solve(2, *singular)).any()
        found = module._solve(2, *np.array([regular, singular, regular]).T)
    assert found[:, 0].tolist() == found[:, 2].tolist() == pytest.approx([1.0, 2.0])
    assert not np.isfinite(found[:, 1]).any()


def test_units_of_unknowns_make_no_loop_singular() -> None:
    """A voltage beside currents, in volts or in any other unit: the solution is the same, and a singular system stays singular."""
    module = load_module("solve", compiled(OSCILLATOR).program.source)
    matrix = np.array([[1.0179, -561.1, 0.0], [1.788e-3, 1.0, -1.0], [0.0, 0.255, 1.0005]])
    singular = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [5.0, 7.0, 9.0]])
    solution = np.array([3.0, -0.25, 7.0])
    for rows, columns in (([1e-18, 1.0, 1.0], [1e18, 1.0, 1.0]), ([1e9, 1e-7, 1e12], [1e-9, 1e5, 1e-12])):
        scale = np.array(rows)[:, None] * np.array(columns)
        right = (matrix @ solution) * rows
        with np.errstate(all="ignore"):
            found = module._solve(3, *(matrix * scale).ravel(), *right)
            none = module._solve(3, *(singular * scale).ravel(), *right)
            both = module._solve(3, *np.array([[*(m * scale).ravel(), *right] for m in (singular, matrix)]).T)
        np.testing.assert_allclose(found * columns, solution, rtol=1e-12)
        assert not np.isfinite(none).any() and not np.isfinite(both[:, 0]).any()
        assert both[:, 1].tolist() == found.tolist()
