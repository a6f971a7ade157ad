"""The native target against the numpy target: every function of every model in models/, then what operators mean at their edges."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from compiler.algebra.expression import Apply, Expression, Number, Symbol
from compiler.codegen.limits import Leaf
from compiler.codegen.llvm.evaluate import ROLES
from compiler.codegen.llvm.generate import generate_program
from compiler.codegen.lower import lower
from compiler.codegen.lowered import Lowered
from compiler.codegen.numpy import generate_program as reference_program
from compiler.codegen.program import Program
from compiler.compilation import Compilation
from tests.codegen.test_module import MODELS_OF_FILES
from tests.codegen.test_tables import LAWS, SPRINGS
from tests.compiling import compiled

FUNCTIONS = {
    "constants": ("parameters",), "start": ("constants",), "nominal": ("constants",), "instants": ("constants",), "periods": ("constants",),
    "switches": ("time", "constants"), "crossings": ("time", "constants", "mode"), "signals": ("time", "inputs", "constants", "mode"),
} | dict.fromkeys(
    ("derivative", "jacobian_entries", "jacobian", "output", "claims", "dependent", "sensitivities", "forced", "powers", "holds", "limit_values", "invariant", "invariant_slopes"), ROLES
)  # fmt: skip


def agree(compilation: Compilation, rtol: float = 1e-13) -> None:
    """Every function, single and in batches, at random states."""
    lowered = lower(compilation.state_space, located=False)  # where conditions on states are located, Python steps
    native, reference = generate_program(lowered), reference_program(lowered)
    with np.errstate(all="ignore"):
        for shape in ((), (3,), (2, 2)):
            arguments = somewhere(reference, shape)
            for name, wanted in FUNCTIONS.items() | ({"solved": ROLES}.items() if reference.solved else set()):
                given = [arguments[w] for w in wanted]
                found, expected = (np.asarray(getattr(p, name)(*given)) for p in (native, reference))
                assert found.shape == expected.shape, name
                same = (found == expected) | (np.isnan(found) & np.isnan(expected))
                found, expected = np.where(same, 1.0, found), np.where(same, 1.0, expected)
                cancelled = 0.01 * rtol * np.abs(expected).max(initial=0.0)
                np.testing.assert_allclose(found, expected, rtol=rtol, atol=cancelled, err_msg=name)


def somewhere(program: Program, shape: tuple[int, ...]) -> dict[str, Any]:
    generator = np.random.default_rng(len(shape))
    parameters = np.array(program.defaults, dtype=float)
    constants = program.constants(parameters)
    start = program.start(constants)
    state = generator.normal(size=(*shape, len(start))) * np.where(start != 0, np.abs(start), 1e-6)
    time = generator.uniform(0, 1e-2, size=shape)
    inputs = np.array(program.input_defaults, dtype=float)
    return {
        "parameters": parameters,
        "constants": constants,
        "time": time,
        "state": state,
        "inputs": inputs,
        "mode": program.switches(time, constants)
        if program.hybrid is None
        else program.hybrid.mode_at(time, state, inputs, constants),
    }


@pytest.mark.few(18)
@pytest.mark.parametrize(("path", "name"), MODELS_OF_FILES, ids=lambda x: x if isinstance(x, str) else x.name)
def test_models(path: Path, name: str) -> None:
    agree(compiled(path, model=name, experiment="", everything=True))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("free", [(), ("*",)])
def test_tables_and_noise(law: str, free: tuple[str, ...]) -> None:
    agree(compiled(SPRINGS.format(law=LAWS[law], ys="-4, 0, 0.5, 4"), free=free), rtol=1e-11)


EDGES = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, 1e-310, 1e200, np.inf, -np.inf, np.nan)
ONE_OPERAND = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log", "log10", "sqrt", "abs", "sign", "floor", "ceil")  # fmt: skip
TWO_OPERANDS = ("divide", "power", "atan2", "root", "min", "max")


def evaluated(nodes: list[Expression], states: Any) -> tuple[Any, Any]:
    """Expressions over the states by both targets; states (points, n)."""
    names = [f"x{i}" for i in range(states.shape[1])]
    integrals = "\n".join(f"signal {n} = integral(0 [1/s], 0)" for n in names)
    lowered = compiled(f"model A {{\n{integrals}\noutput y = {' + '.join(names)}\n}}").lowered
    lowered.outputs = {f"y{i}": node for i, node in enumerate(nodes)}
    return tuple(_outputs(make(lowered), states) for make in (generate_program, reference_program))  # type: ignore[return-value]


def _outputs(program: Program, states: Any) -> Any:
    with np.errstate(all="ignore"):
        return np.stack([program.output(0.0, x, (), np.zeros(0), np.zeros(0)) for x in states])


X, Y = (Symbol(Leaf("state", i)) for i in range(2))


@pytest.mark.parametrize("operator", [*ONE_OPERAND, *TWO_OPERANDS])
def test_operators_at_their_edges(operator: str) -> None:
    states = np.array([(a, b) for a in EDGES for b in EDGES])
    node = Apply(operator, (X,) if operator in ONE_OPERAND else (X, Y))
    if operator == "power":
        states = states[states[:, 0] != -np.inf]  # numpy takes some powers of arrays as roots
    native, numpy = evaluated([node], states)
    np.testing.assert_allclose(native, numpy, rtol=1e-14)
    if operator in ("abs", "sign", "floor", "ceil", "sqrt", "divide", "min", "max"):
        np.testing.assert_array_equal(native, numpy)


@pytest.mark.parametrize("exponent", [2.0, 3.0, -1.0, -4.0, 13.0, 40.0, 0.3])
def test_powers_with_numbers(exponent: float) -> None:
    states = np.random.default_rng(2).normal(size=(40, 2))
    native, numpy = evaluated([Apply("power", (Apply("abs", (X,)), Number(exponent)))], states)
    np.testing.assert_allclose(native, numpy, rtol=1e-14)


def test_conditions() -> None:
    states = np.array([(a, b) for a in EDGES for b in EDGES])
    less, equal = Apply("less", (X, Y)), Apply("equal", (X, Y))
    both = [Apply(o, (less, equal)) for o in ("and", "or")]
    nodes: list[Expression] = [
        Apply("select", (c, X, Number(7.0)))
        for c in (less, equal, *both, Apply("not", (less,)), Apply("less_equal", (X, Y)))
    ]
    native, numpy = evaluated([*nodes, less, Apply("not", (equal,))], states)
    np.testing.assert_array_equal(native, numpy)


def solved(count: int, matrix: Any, right: Any) -> tuple[Any, Any]:
    symbols = [Symbol(Leaf("state", i)) for i in range(count * count + count)]
    node = Apply("solve", tuple(symbols))
    items: list[Expression] = [Apply("item", (node, Number(float(i)))) for i in range(count)]
    return evaluated(items, np.array([[*np.ravel(matrix), *right]]))


@pytest.mark.parametrize("count", [2, 3, 7])
def test_linear_systems(count: int) -> None:
    generator = np.random.default_rng(count)
    for _ in range(5):
        scale = 10.0 ** generator.integers(-12, 12, size=(2, count))
        matrix, x = (
            generator.normal(size=(count, count)) * scale[0][:, None] * scale[1],
            generator.normal(size=count) / scale[1],
        )
        native, numpy = solved(count, matrix, matrix @ x)
        np.testing.assert_allclose(native, numpy, rtol=1e-9)
        np.testing.assert_allclose(native[0], x, rtol=1e-8)


def test_a_singular_system_has_no_solution() -> None:
    for matrix in ([[1.0, 2.0], [2.0, 4.0]], [[0.0, 0.0], [1.0, 1.0]], [[1.0, np.nan], [1.0, 2.0]]):
        native, numpy = solved(2, matrix, [1.0, 1.0])
        assert np.isnan(native).all() and np.isnan(numpy).all()


def test_units_make_no_system_singular() -> None:
    """As `test_units_of_unknowns_make_no_loop_singular` of the numpy target."""
    matrix = np.array([[1.0179, -561.1, 0.0], [1.788e-3, 1.0, -1.0], [0.0, 0.255, 1.0005]])
    scale = np.array([1e9, 1e-7, 1e12])[:, None] * np.array([1e-9, 1e5, 1e-12])
    right = (matrix @ [3.0, -0.25, 7.0]) * [1e9, 1e-7, 1e12]
    native, _ = solved(3, matrix * scale, right)
    np.testing.assert_allclose(native[0] * [1e-9, 1e5, 1e-12], [3.0, -0.25, 7.0], rtol=1e-12)


def test_a_program_stays_in_memory_as_long_as_its_functions() -> None:
    functions = [
        generate_program(compiled("model A {\nsignal x = integral(2 [1/s], 1)\noutput y = 3*x\n}").lowered).output
        for _ in range(20)
    ]
    assert [f(0.0, [2.0], (), np.zeros(0), np.zeros(0)).tolist() for f in functions] == [[6.0]] * 20


def test_what_is_not_hot_is_there_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long functions are compiled without optimisation: the numbers do not depend on it."""
    from compiler.codegen.llvm import generate

    monkeypatch.setattr(generate, "LEVELS", ())
    agree(compiled(SPRINGS.format(law=LAWS["monotone"], ys="-4, 0, 0.5, 4"), free=("*",)), rtol=1e-11)
    assert isinstance(compiled("model A {\noutput y = 1\n}").lowered, Lowered)
