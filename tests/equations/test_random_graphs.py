"""Random bond graphs: what the compiled program computes against a numerical solution of all equations at once.

BONDGRAPH_RANDOM=2000 in the environment asks for that many examples; the default is 100, always the same.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, note, settings

import bondgraph
from bondgraph.simulation.loops import LoopSolver
from compiler.errors import CompilationFailed, Diagnostic, render
from tests.equations.network_oracle import Solution, constraints, is_regular, solve
from tests.equations.random_network import Example, Flat, examples

EXAMPLES = int(os.environ.get("BONDGRAPH_RANDOM", "100"))
KINDS: Counter[str] = Counter()


@pytest.fixture(scope="module", autouse=True)
def _summary() -> Iterator[None]:
    """What was tried, told at the end of the run (`-s` shows it)."""
    yield
    print(f"\n{EXAMPLES} random graphs: " + ", ".join(f"{k} {n}" for k, n in sorted(KINDS.items())))


@settings(
    max_examples=EXAMPLES,
    derandomize=True,
    deadline=None,
    database=None,
    phases=(Phase.explicit, Phase.generate, Phase.shrink),
    suppress_health_check=list(HealthCheck),
)
@given(examples())
def test_program_against_all_equations_at_once(example: Example) -> None:
    flat = example.flat
    assume(flat.network.bonds > 0)
    note(example.text)
    note(f"settings {example.settings}")
    KINDS["tried"] += 1
    compilation, refused = _compiled(example, example.text)
    if refused and all(d.code == "BG403" for d in refused):  # the start of a dependent storage: leave all starts out
        _check_refusals(example, refused)
        flat.starts.clear()
        compilation, refused = _compiled(
            example, re.sub(r"start [a-zA-Z.]+ = [0-9.]+( \[[^\]]*\])?,? ?", "", example.text)
        )
    if refused:
        _check_refusals(example, refused)
        KINDS["refused"] += 1
        return
    _count(example, compilation)
    with np.errstate(all="raise"):
        _check_program(example, compilation)


def _compiled(example: Example, text: str) -> tuple[Any, tuple[Diagnostic, ...]]:
    model = bondgraph.load(text + "\n")
    compilation = model.compilation(model.scene(None, example.settings), everything=True)
    try:
        _ = compilation.program
    except CompilationFailed as failed:
        return compilation, failed.diagnostics
    return compilation, ()


# ---------------------------------------------------------------- numbers
def _check_program(example: Example, compilation: Any) -> None:
    flat, program = example.flat, compilation.program
    names = {port.name: i for i, port in enumerate(flat.network.storages)}
    numbers = [names[n] for n in program.states.names]
    parameters = np.array(program.defaults)
    constants, inputs = program.constants(parameters), np.array(program.input_defaults)
    mode = program.switches(example.time, constants)

    count = len(program.states.names)
    loops = LoopSolver(program, constants, inputs, np.ones(count + len(program.unknowns.names)))
    KINDS["unknowns"] += len(program.unknowns.names)

    def full(x: Any) -> Any:
        """States with the unknowns of nonlinear loops."""
        if x.ndim > 1:
            return np.stack([full(y) for y in x])
        return loops.solve(example.time, np.concatenate([x, np.zeros(len(program.unknowns.names))]), mode)

    def derivative(x: Any) -> Any:
        return program.derivative(example.time, full(x), inputs, constants, mode)[..., :count]

    def jacobian(x: Any) -> Any:
        """The derivatives of the rates by the states, with the unknowns following."""
        whole = program.jacobian(example.time, full(x), inputs, constants, mode)
        a, b, c, d = (
            whole[..., r, k] for r in (slice(count), slice(count, None)) for k in (slice(count), slice(count, None))
        )
        return a - b @ np.linalg.solve(d, c)

    start = np.asarray(program.start(constants))[:count]
    claimed = {c.element for c in compilation.state_space.claims}
    for number, value in zip(numbers, start, strict=True):
        if flat.network.storages[number].name.split(".")[0] not in claimed:
            assert value == pytest.approx(flat.starts.get(number, 0.0), rel=1e-15)
    states = _states(example, len(numbers))
    for x in states:
        found = _solution(flat, dict(zip(numbers, x, strict=True)), example.time)
        assert found.converged, f"the states {program.states.names} contradict each other, by {found.error:.3g}"
        scale = max(1.0, float(np.abs(found.w).max(initial=0.0)))
        _check_rates(found, program, numbers, derivative(x), scale)
        _check_outputs(
            found, example, program.output(example.time, full(x), inputs, constants, mode), program.outputs.names, scale
        )
        powers = program.powers(example.time, full(x), inputs, constants, mode)[: len(compilation.state_space.ports)]
        assert abs(powers.sum()) <= 1e-9 * scale**2, "junctions and transducers keep power (Tellegen)"
        if len(x):
            step = 1e-6
            shifts = step * np.eye(len(x))
            quotient = np.array([(derivative(x + h) - derivative(x - h)) / (2 * step) for h in shifts]).T
            size = max(1.0, float(np.abs(quotient).max()))
            np.testing.assert_allclose(jacobian(x), quotient, rtol=1e-6, atol=1e-6 * size)
    if states.shape[-1]:
        _check_batch(states, derivative, jacobian)


def _solution(flat: Flat, given: dict[int, float], time: float) -> Solution:
    """What the equations say; a storage that they leave open and that nothing flows into stays at its start."""
    found = solve(flat.network, given, time)
    idle = [s for i, s in enumerate(found.free) if not found.determined(2 * flat.network.bonds + i)]
    rates = flat.network.rates(found.w)
    idle = [s for s in idle if abs(rates[s]) < 1e-9 and found.determined(flat.network.rate_of(s))]
    if not idle:
        return found
    return solve(flat.network, given | {s: flat.starts.get(s, 0.0) for s in idle}, time)


def _states(example: Example, count: int) -> Any:
    """Three states: spread over some numbers; never all zero."""
    numbers = np.array(example.numbers)
    return np.array([[numbers[(k + i) % len(numbers)] * (1 - 0.4 * k) for i in range(count)] for k in range(3)])


def _check_rates(found: Solution, program: Any, numbers: list[int], rates: Any, scale: float) -> None:
    network = found.network
    for name, number, rate in zip(program.states.names, numbers, rates, strict=True):
        unknown = network.rate_of(number)
        assert found.determined(unknown), f"the equations do not determine the rate of {name}, the program gives {rate}"
        assert abs(found.w[unknown] - rate) <= 1e-9 * scale, f"rate of {name}: {rate}, oracle {found.w[unknown]}"


def _check_outputs(found: Solution, example: Example, values: Any, names: Any, scale: float) -> None:
    network, flat = found.network, example.flat
    for (name, element, port, variable), shown, value in zip(example.read, names, values, strict=True):
        assert name == shown
        if variable in "ef":
            unknown = flat.bond_at[element, port] + (network.bonds if variable == "f" else 0)
            expected = found.w[unknown]
        else:
            number = flat.stored[element, port]
            expected = found.stored[number]
            if number not in found.free:
                assert abs(expected - value) <= 1e-14 * max(1.0, abs(expected))
                continue
            unknown = 2 * network.bonds + found.free.index(number)
        if not found.determined(unknown):
            KINDS["undetermined readings"] += 1
            continue
        assert abs(expected - value) <= 1e-9 * scale, f"{element}.{variable}{port}: {value}, oracle {expected}"


def _check_batch(states: Any, derivative: Any, jacobian: Any) -> None:
    for function in (derivative, jacobian):
        single = np.array([function(x) for x in states])
        for batch in (function(states), function(np.stack([states, states[::-1]]))[0]):
            assert batch.shape == single.shape
            size = max(1.0, float(np.abs(single).max()))
            np.testing.assert_allclose(batch, single, rtol=1e-13, atol=1e-13 * size)


# ---------------------------------------------------------------- refusals
def _check_refusals(example: Example, diagnostics: tuple[Diagnostic, ...]) -> None:
    KINDS.update(f"refused {code}" for code in {d.code for d in diagnostics})
    for diagnostic in diagnostics:
        _check_refusal(example, diagnostic)


def _check_refusal(example: Example, diagnostic: Diagnostic) -> None:
    """A refusal is right if the equations have no unique solution, or need what this version says it does not do."""
    flat, rng = example.flat, np.random.default_rng(1)
    told = render(diagnostic)
    note(told)
    assert diagnostic.span.text, told
    match diagnostic.code:
        case "BG301" | "BG404" | "BG502":
            assert not is_regular(flat.network, rng), f"refused, but the equations have one solution:\n{told}"
        case "BG401" | "BG501":
            nonlinear = {"nonlinear", "nonlinear storage", "modulated"} & flat.traits.keys()
            assert nonlinear, f"refused, but every law is linear:\n{told}"
        case "BG402":
            assert _field_is_bound(flat, rng), f"refused, but the fields could be integral:\n{told}"
        case "BG403" | "BG504":
            stored, _ = constraints(flat.network, rng)
            depends = np.abs(stored).max(initial=0.0) > 1e-8 or not is_regular(flat.network, rng)
            assert depends, f"refused, but no storage depends on another:\n{told}"
        case "BG503":
            _, forced = constraints(flat.network, rng)
            assert np.abs(forced).max(initial=0.0) > 1e-8, f"refused, but time forces no storage:\n{told}"
        case "BG505":
            assert not example.read
            assert all(not e.stores or "zero" in e.traits for e in flat.elements.values()), told
        case _:
            raise AssertionError(f"an unexpected refusal:\n{told}")


def _field_is_bound(flat: Flat, rng: np.random.Generator) -> bool:
    """Whether the equations bind what fields store, even if every one-port storage gives way."""
    in_fields = [i for (name, _), i in flat.stored.items() if len(flat.elements[name].ports) > 1]
    stored, _ = constraints(flat.network, rng)
    others = [i for i in range(len(flat.network.storages)) if i not in in_fields]
    if not in_fields or not len(stored):
        return False
    u, sizes, _ = np.linalg.svd(stored[:, others]) if others else (np.eye(len(stored)), np.zeros(0), None)
    rank = int((sizes > 1e-8).sum())
    alone = u[:, rank:].T @ stored[:, in_fields]  # demands that no other storage enters
    return bool(np.abs(alone).max(initial=0.0) > 1e-8) or not is_regular(flat.network, rng)


def _count(example: Example, compilation: Any) -> None:
    space = compilation.state_space
    KINDS["compiled"] += 1
    KINDS.update(example.flat.traits)
    KINDS["plain" if example.plain else "with units"] += 1
    KINDS["submodels"] += example.parts
    KINDS["dependent storages"] += len(space.dependent)
    KINDS["linear loops"] += sum(type(s).__name__ == "LinearLoop" for s in space.steps)
    KINDS["states"] += len(space.states)
    KINDS["set from outside"] += len(example.settings)
