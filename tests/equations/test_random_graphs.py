"""Random bond graphs: the results of the compiled program against a numerical solution of all equations at once.

A hundred by hypothesis, always the same. BONDGRAPH_RANDOM=2000 in the environment adds that many, BONDGRAPH_SEED=7 takes
others; each has a number by which it can be made again. `-s` shows their kinds.
"""

from __future__ import annotations

import os
import re
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, note, settings

import bondgraph
from bondgraph.errors import RunFailed
from compiler.algebra.expression import evaluate
from compiler.errors import CompilationFailed, Diagnostic, render
from tests.equations.network_oracle import Solution, completed, constraints, is_regular, solve
from tests.equations.random_network import Example, Flat, ManyChoices, example_of, examples
from tests.equations.running import Running

EXAMPLES = 100
MORE = int(os.environ.get("BONDGRAPH_RANDOM", "0"))
SEED = os.environ.get("BONDGRAPH_SEED", "0")
LONGEST = 120  # s of computing for one example: what takes longer hangs
CANCELLED = 1e-13  # of the largest effort or flow: rounding where such numbers cancel
UNDECIDED = 1e-3  # where such rounding is larger, numbers near 1 are not compared at all: counted, and few
KINDS: Counter[str] = Counter()
SIGNAL = re.compile(r"sin\([\w.\[\]]+\.(?:F|v|M|omega|u|i|P|Q|e|f)\d?(?:/1 \[[^\]]*\])?\)")  # of an effort or a flow
# What a hundred examples must at least have had among them, compiled and compared.
LEAST = {
    "dependent storages": 60, "linear loops": 30, "nonlinear loops": 8, "mixed fields": 5, "C field": 8, "I field": 4, "IC field": 4,
    "R field": 5, "modulated TF/GY": 10, "modulated": 20, "index 2": 15, "index 3": 2, "splitter": 8,
    "submodels": 12, "for": 20, "nonlinear": 15, "nonlinear storage": 10, "time": 10,
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _summary() -> Iterator[None]:
    """Summary of the tested graphs at the end of the run (`-s` shows it)."""
    yield
    print(f"\n{KINDS['tried']} random graphs: " + ", ".join(f"{k} {n}" for k, n in sorted(KINDS.items())))


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
    assume(example.flat.network.bonds > 0)
    note(example.text)
    note(f"settings {example.settings}")
    with _no_hanging():
        check_example(example)


# Graphs that were once wrong, each for another reason: a solution far away or behind a crest, one loop that disturbs another, a
# resistance too steep for differences, bonds that cancel, a force that only a double solution decides, a loop that time drives.
ONCE_WRONG = (
    "2/315",
    "2/41",
    "3/73",
    "3/274",
    "2/12",
    "2/33",
    "1/256",
    "2/436",
    "0/753",
    "0/24",
    "4/373",
    "6/315",
    "5/359",
    "3/261",
)


@pytest.mark.few(6)
@pytest.mark.parametrize("number", ONCE_WRONG)
def test_what_was_once_wrong(number: str) -> None:
    before = Counter(KINDS)
    try:
        with _no_hanging():
            check_example(example_of(ManyChoices(number)))
    finally:  # they are no sample
        KINDS.clear()
        KINDS.update(before)


@pytest.mark.skipif(not MORE, reason="BONDGRAPH_RANDOM says how many")
def test_many_more() -> None:
    wrong = {}
    for number in range(MORE):
        example = example_of(ManyChoices(f"{SEED}/{number}"))
        if not example.flat.network.bonds:  # a graph without a bond says nothing, as above
            continue
        try:
            with _no_hanging():
                check_example(example)
        except Exception as error:  # all of them are told, each with its number
            wrong[f"{SEED}/{number}"] = f"{type(error).__name__}: {error}"[:300]
    assert not wrong, "\n".join(f"{n}: {told}" for n, told in wrong.items())


def test_the_examples_had_everything_among_them() -> None:
    """Minima per hundred examples; at least nine in ten of the regular ones compile, and hardly any are left undecided."""
    if KINDS["tried"] < EXAMPLES // 2:
        pytest.skip("the examples did not run")
    share = KINDS["tried"] / 100
    missing = {kind: (KINDS[kind], least) for kind, least in LEAST.items() if KINDS[kind] < int(least * share)}
    assert not missing, f"found, least per hundred: {missing}"
    assert KINDS["regular and compiled"] >= 0.9 * KINDS["regular"]
    assert KINDS["undecided"] <= 0.01 * 3 * KINDS["tried"]  # of the states, three of each


def check_example(example: Example) -> None:
    """One random graph: compiled and compared, or refused for a reason."""
    KINDS["tried"] += 1
    regular = is_regular(example.flat.network, np.random.default_rng(1))
    compilation, refused = _compiled(example, example.text)
    KINDS["regular"] += regular and [d.code for d in refused] != ["BG505"]  # nothing to compute is no failure
    if refused:
        _check_refusals(example, refused)
        KINDS["refused"] += 1
        return
    KINDS["regular and compiled"] += regular
    _count(example, compilation)
    with np.errstate(all="ignore"):
        _check_program(example, compilation)


@contextmanager
def _no_hanging() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"no answer within {LONGEST} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


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
    running = Running(program, example.time)
    start = np.asarray(program.start(running.constants))[: running.count]
    claimed = {c.element for c in compilation.state_space.claims}
    for number, value in zip(numbers, start, strict=True):
        if flat.network.storages[number].name.split(".")[0] not in claimed:
            assert value == pytest.approx(flat.starts.get(number, 0.0), rel=1e-15)
    states = _states(example, len(numbers))
    solved = np.array([x for x in states if _check_state(example, compilation, running, numbers, x)])
    if solved.size:
        try:
            for x in solved:
                _check_jacobian(running, x)
            _check_batch(solved, running.derivative, running.jacobian)
        except np.linalg.LinAlgError:  # a loop has a double solution there, which has no slope
            KINDS["undecided"] += 1


def _check_state(example: Example, compilation: Any, running: Running, numbers: list[int], x: Any) -> bool:
    """Compare rates, outputs and powers in one state. Return False if there is no solution, or none that doubles can distinguish."""
    try:
        rates, outputs = running.derivative(x), running.output(x)
    except (
        RunFailed
    ) as failed:  # of loops with several or no solutions; never of one that is linear, or without modulation
        KINDS["loops without a solution"] += 1
        assert running.unknowns, failed
        found = solve(example.flat.network, dict(zip(numbers, x, strict=True)), example.time)
        assert not found.converged, f"{failed}\nbut there is one"
        return False
    found = _agreeing(example, compilation.state_space, running, numbers, x, rates, outputs)
    scale = np.inf if found is None else max(1.0, float(np.abs(found.w).max(initial=0.0)))
    if CANCELLED * scale > UNDECIDED:
        KINDS["undecided"] += 1
        return False
    powers = running.powers(x)[: len(compilation.state_space.ports)]
    assert abs(powers.sum()) <= 1e-9 * scale**2, "junctions and transducers keep power (Tellegen)"
    return True


def _check_jacobian(running: Running, x: Any) -> None:
    """Compare with central differences. At a sharp bend only a shorter step gives the slope of a loop, in an ill-conditioned case only a longer one."""
    running = Running(running.program, running.time, running.full(x)[running.count :])  # of several solutions the same
    exact = running.jacobian(x)
    for step, last in ((1e-6, False), (1e-7, False), (1e-5, True)):
        shifts = step * np.eye(len(x))
        quotient = np.array([(running.derivative(x + h) - running.derivative(x - h)) / (2 * step) for h in shifts]).T
        size = max(1.0, float(np.abs(quotient).max()))
        if last or np.allclose(exact, quotient, rtol=1e-6, atol=1e-6 * size):
            break
    np.testing.assert_allclose(exact, quotient, rtol=1e-6, atol=1e-6 * size)


def _agreeing(
    example: Example, space: Any, running: Running, numbers: list[int], x: Any, rates: Any, outputs: Any
) -> Solution | None:
    """The solution of all equations that the program has found; where loops have several, another start finds it. None where
    doubles cannot decide."""
    found, told = _compared(example, space, running, numbers, x, rates, outputs, None)
    if told:
        guess = _own_solution(example, running, x)
        if guess is not None and np.isfinite([*guess[0], *guess[1]]).all():
            KINDS["another start for the oracle"] += 1
            found, again = _compared(example, space, running, numbers, x, rates, outputs, guess)
            told = again and told
        if told and guess is not None and _is_undecided(example, guess):
            return None
    assert not told, told
    return found


def _is_undecided(example: Example, own: Any) -> bool:
    """Return True if the program's own solution is singular, so that it reports undetermined efforts or flows, or nearly singular.

    In the second case rounding of the largest hides the others; then it must satisfy all equations of the network as far as doubles can.
    """
    w, stored = own
    if not np.isfinite([*w, *stored]).all():
        return True
    network = example.flat.network
    largest = float(np.abs(w).max(initial=0.0))
    return CANCELLED * largest > UNDECIDED and network.missed(w, stored, example.time) < 1e-9


def _compared(
    example: Example, space: Any, running: Running, numbers: list[int], x: Any, rates: Any, outputs: Any, guess: Any
) -> tuple[Solution, str]:
    """Solution of all equations, and the difference of the program from it."""
    network, bond_at = example.flat.network, example.flat.bond_at
    given = dict(zip(numbers, x, strict=True))
    shared = _shared(example.flat, space, given)
    wanted = [network.rate_of(n) for n in (*numbers, *shared)]
    wanted += [bond_at[e, port] + network.bonds * (v == "f") for _, e, port, v in example.read if v in "ef"]
    given |= {n: value for n, (_, _, value) in shared.items()}
    found = _solution(example.flat, given, example.time, space, wanted, guess)
    scale = max(1.0, float(np.abs(found.w).max(initial=0.0)))
    try:
        assert found.converged, f"the states {running.program.states.names} contradict each other, by {found.error:.3g}"
        _check_rates(found, running.program, numbers, rates, scale)
        for number, (leader, factor, _) in shared.items():
            rate, led = (found.w[network.rate_of(n)] for n in (number, leader))
            assert abs(rate - factor * led) <= _tolerance(scale, rate), (
                "what shares a state has its rate times a factor"
            )
        _check_outputs(found, example, outputs, running.program.outputs.names, scale)
    except AssertionError as error:
        return found, str(error)
    return found, ""


def _shared(flat: Flat, space: Any, given: dict[int, float]) -> dict[int, tuple[int, float, float]]:
    """Storages that share the state of another: leader, factor of the rate, and content, from the starts of both."""
    names = {port.name: i for i, port in enumerate(flat.network.storages)}
    found = {}
    for f in space.following:
        number, leader = (names[space.variables[v].name] for v in (f.variable, f.state))
        factor = f.factor if f.factor is not None else _of_parameters(space, f.variable, f.state)
        moved = given[leader] - flat.starts.get(leader, 0.0)
        found[number] = leader, factor, flat.starts.get(number, 0.0) + factor * moved
    return found


def _of_parameters(space: Any, variable: int, state: int) -> float:
    """Slope of a variable by a state, if it depends on parameters alone."""
    assigned = {s.target: s for s in space.steps if hasattr(s, "target")}

    def value(v: Any, at: float) -> float:
        if v == state:
            return at
        known = space.variables[v].value
        return known if known is not None else evaluate(assigned[v].expression, lambda key: value(key, at))

    return value(variable, 1.0) - value(variable, 0.0)


def _own_solution(example: Example, running: Running, x: Any) -> Any:
    """Values of all elements in the program, as start for the oracle: a loop may have several solutions."""
    flat = example.flat
    places = [
        (name, port, v)
        for name, e in flat.elements.items()
        for port in range(len(e.ports))
        for v in "ef" + e.stored[port : port + 1]
    ]
    lines = []
    for number, (name, port, variable) in enumerate(places):
        element = flat.elements[name]
        path = name[: len(name) - len(element.name)] + element.path(port, variable)
        lines.append(f"  output zz{number} = {path}\n")
    text = example.text.replace("model Root {\n", "model Root {\n" + "".join(lines))
    compilation, refused = _compiled(example, text)
    if refused:
        return None
    other = Running(compilation.program, example.time)
    known = dict(zip(running.program.states.names, x, strict=True))
    more = [
        n for n in other.program.states.names if n not in known
    ]  # of storages that give nothing, unless they are read
    if len(known) + len(more) != len(other.program.states.names):
        return None
    begin = dict(zip(other.program.states.names, other.program.start(other.constants), strict=False))
    here = np.array([known.get(n, begin[n]) for n in other.program.states.names])
    values = dict(zip(other.program.outputs.names, other.output(here), strict=True))
    guess, stored = np.zeros(2 * flat.network.bonds), np.zeros(len(flat.network.storages))
    for number, (name, port, variable) in enumerate(places):
        value = values[f"zz{number}"]
        if variable in "qp":
            stored[flat.stored[name, port]] = value
        else:
            guess[flat.bond_at[name, port] + (flat.network.bonds if variable == "f" else 0)] = value
    if not (np.isfinite(guess).all() and np.isfinite(stored).all()):
        return guess, stored
    unnamed = sorted(set(range(flat.network.bonds)) - set(flat.bond_at.values()))
    return completed(flat.network, guess, stored, example.time, unnamed), stored


def _solution(flat: Flat, given: dict[int, float], time: float, space: Any, wanted: list[int], guess: Any) -> Solution:
    """Solution of the equations, with as many derivatives as the rates of the states and the outputs need.

    A storage that they leave undetermined and that nothing flows into stays at its start, unless it is dependent.
    """
    for order in (1, 2, 3):
        found = solve(flat.network, given, time, order, guess)
        if not found.converged or all(map(found.determined, wanted)):
            break
    idle = [s for i, s in enumerate(found.free) if not found.determined(2 * flat.network.bonds + i)]
    rates = flat.network.rates(found.w)
    dependent = {space.variables[d.variable].name for d in space.dependents}
    idle = [s for s in idle if abs(rates[s]) < 1e-9 and found.determined(flat.network.rate_of(s))]
    idle = [s for s in idle if flat.network.storages[s].name not in dependent]
    if not idle:
        return found
    return solve(flat.network, given | {s: flat.starts.get(s, 0.0) for s in idle}, time, order, guess)


def _states(example: Example, count: int) -> Any:
    """Three states: spread over some numbers; never all zero."""
    numbers = np.array(example.numbers)
    return np.array([[numbers[(k + i) % len(numbers)] * (1 - 0.4 * k) for i in range(count)] for k in range(3)])


def _check_rates(found: Solution, program: Any, numbers: list[int], rates: Any, scale: float) -> None:
    network = found.network
    for name, number, rate in zip(program.states.names, numbers, rates, strict=True):
        unknown = network.rate_of(number)
        assert found.determined(unknown), f"the equations do not determine the rate of {name}, the program gives {rate}"
        assert abs(found.w[unknown] - rate) <= _tolerance(scale, rate), (
            f"rate of {name}: {rate}, oracle {found.w[unknown]}"
        )


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
        assert abs(expected - value) <= _tolerance(scale, value), (
            f"{element}.{variable}{port}: {value}, oracle {expected}"
        )


def _tolerance(scale: float, value: float) -> float:
    """Tolerance of a number, with `scale` the largest effort or flow: nine digits, and the remainder where larger ones cancel."""
    return 1e-9 * max(1.0, abs(value)) + CANCELLED * scale


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
    if diagnostic.code in ("BG301", "BG401", "BG404", "BG502", "BG504") and _only_by_signals(flat):
        KINDS["regular only by what modulates"] += 1
        return
    assert diagnostic.span.text, told
    match diagnostic.code:
        case "BG301" | "BG401" | "BG404" | "BG502":
            assert not is_regular(flat.network, rng), f"refused, but the equations have one solution:\n{told}"
        case "BG504":  # a law that reads an effort or a flow may bind what is behind its own storage's derivative
            without = SIGNAL.sub("sin(0.3)", example.text)
            alone = without != example.text and "BG504" not in [d.code for d in _compiled(example, without)[1]]
            assert alone or not is_regular(flat.network, rng), f"refused, but the equations have one solution:\n{told}"
        case "BG503":
            assert "input" in flat.traits, f"refused, but nothing comes from outside:\n{told}"
            stored, _ = constraints(flat.network, rng)
            assert np.abs(stored).max(initial=0.0) > 1e-8, f"refused, but nothing binds a storage:\n{told}"
        case "BG505":
            assert not example.read
            assert all(not e.stores or "zero" in e.traits for e in flat.elements.values()), told
        case _:
            raise AssertionError(f"an unexpected refusal:\n{told}")


def _only_by_signals(flat: Flat) -> bool:
    """Return True if the equations have one solution, but none with given signals.

    Then an effort or a flow is determined by the law that it modulates, which is no bond, and no stroke can express it.
    """
    if not is_regular(flat.network, np.random.default_rng(1)):
        return False
    flat.signals_given = True
    try:
        return not is_regular(flat.network, np.random.default_rng(1))
    finally:
        flat.signals_given = False


def _count(example: Example, compilation: Any) -> None:
    space, graph = compilation.state_space, compilation.graph
    KINDS["compiled"] += 1
    KINDS.update(example.flat.traits)
    KINDS["plain" if example.plain else "with units"] += 1
    KINDS["submodels"] += example.parts
    KINDS["dependent storages"] += len(space.dependent)
    KINDS["linear loops"] += sum(type(s).__name__ == "LinearLoop" for s in space.steps)
    KINDS["nonlinear loops"] += bool(space.unknowns)
    KINDS["unknowns"] += len(space.unknowns)
    KINDS["states"] += len(space.states)
    KINDS["claims"] += len(space.claims)
    KINDS["set from outside"] += len(example.settings)
    KINDS[f"index {space.index}"] += 1
    derivative = Counter(end.node for end in compilation.causal.derivative)
    KINDS["mixed fields"] += sum(0 < n < len(graph.nodes[node].ports) for node, n in derivative.items())
    KINDS["modulated TF/GY"] += sum(
        1 for e in example.flat.elements.values() if e.kind in ("TF", "GY") and "modulated" in e.traits
    )
