"""State equations to a Python module that builds functions of CasADi: for optimal control, sensitivities and its integrators."""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import reduce

from sympy import Basic
from sympy.core.function import AppliedUndef

from ...algebra.operators import CURVES, SLOPES, Operator
from ...errors import CompilationFailed, printable
from ...reduction import StateSpace
from ..errors import NumpyAlone
from ..numpy.body import number
from ..numpy.names import Identifiers
from ..symbolic.formulate import formulate
from ..symbolic.python_text import PythonPrinter, function_names, lines_text, needed_lines, results_of, targets_of
from ..symbolic.state_equations import Entry, NamedSymbol, StateEquations
from .c_file import refuse_hybrid
from .targets import TextTarget

OTHER_NAMES = {"abs": "ca.fabs", "min": "ca.fmin", "max": "ca.fmax", "root": "_root"}
OWN = tuple("derivative residual jacobian outputs start dae arguments ca jax jnp t x z p u".split())  # noqa: SIM905
SOLVE = '''def _solve(rows, right):
    """Solution of a linear system."""
    return ca.vertsplit(ca.solve(ca.vertcat(*(ca.horzcat(*row) for row in rows)), ca.vertcat(*right)))'''
ROOT = '''def _root(x, n):
    """The real number whose power n is x."""
    return ca.if_else(ca.fmod(ca.fabs(n), 2) == 1, ca.sign(x) * ca.fabs(x) ** (1 / n), x ** (1 / n))'''


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the module. Raises `CompilationFailed` for events, delays and tables."""
    return _CasadiModule(differentiable(space, descriptions, "CasADi"), CasadiPrinter, _name).text()


TARGET = TextTarget("casadi", ".py", write, usual=False)


def _name(row: Operator) -> str:
    return OTHER_NAMES.get(row.name, f"ca.{row.name}")


class ArrayPrinter(PythonPrinter):
    """Expressions of a library's own numbers, on which `if`, `and`, `or` and `not` are functions: `choice` and `negation` are their names there."""

    choice = negation = ""

    def _choice(self, x: Basic) -> str:
        (value, condition), (otherwise, _) = x.args
        return f"{self.choice}({', '.join(map(self.text, (condition, value, otherwise)))})"

    def _print_Piecewise(self, x: Basic) -> str:
        return self._choice(x)

    def _print_Not(self, x: Basic) -> str:
        return f"{self.negation}({self.text(x.args[0])})"


class CasadiPrinter(ArrayPrinter):
    """Expressions of symbols of CasADi."""

    choice, negation = "ca.if_else", "ca.logic_not"

    def _print_And(self, x: Basic) -> str:
        return reduce("ca.logic_and({}, {})".format, map(self.text, x.args))

    def _print_Or(self, x: Basic) -> str:
        return reduce("ca.logic_or({}, {})".format, map(self.text, x.args))


def differentiable(space: StateSpace, descriptions: Mapping[str, str], library: str) -> StateEquations:
    """State equations for a library that differentiates. Raises `CompilationFailed` for events, delays and tables."""
    refuse_hybrid(space, library)
    equations = formulate(space, descriptions)
    for line in equations.lines:
        called = {type(x).__name__ for result in results_of(line) for x in result.atoms(AppliedUndef)}
        if called & (CURVES | SLOPES) and line.span is not None:
            raise CompilationFailed([NumpyAlone(line.span, library, "Tables and noise")])
    return equations


class FunctionModule:
    """Names of a module whose functions take arrays: t, states x, unknowns z, parameters p, inputs u."""

    def __init__(
        self, equations: StateEquations, printer: type[PythonPrinter], name: Callable[[Operator], str]
    ) -> None:
        self.equations = e = equations
        identifiers = Identifiers()
        identifiers.taken |= {*OWN, *keyword.kwlist}
        groups = (("x", e.states), ("z", e.unknowns), ("p", e.parameters), ("u", e.inputs))
        self.groups: list[tuple[str, Sequence[NamedSymbol]]] = [
            (letter, group) for letter, group in groups if group or letter in "xp"
        ]
        symbols = [q.symbol for _, group in self.groups for q in group] + [
            t for line in e.lines for t in targets_of(line)
        ]
        names = {e.time: "t"} | {symbol: identifiers.of(str(symbol)) for symbol in symbols}
        self.printer, self.names = printer(names, function_names(name)), names

    def defaults(self) -> Iterator[tuple[str, str]]:
        """Names of the values of parameters and inputs, and their numbers."""
        for heading, quantities in (("DEFAULTS", self.equations.parameters), ("INPUT_DEFAULTS", self.equations.inputs)):
            yield heading, f"[{', '.join(number(q.value) for q in quantities)}]"

    def items(self, letter: str, group: Sequence[NamedSymbol]) -> Iterator[str]:
        """Lines that name the items of an array."""
        for i, q in enumerate(group):
            words = ", ".join(w for w in (q.name, q.unit, q.description) if w)
            yield f"{self.names[q.symbol]} = {letter}[{i}]  # {printable(words)}"

    def values(self, entries: Iterable[Entry]) -> str:
        """Values of a result, separated by commas."""
        return ", ".join(self.printer.text(entry.value) for entry in entries)


class _CasadiModule(FunctionModule):
    """Writer of one module."""

    def text(self) -> str:
        e = self.equations
        results = [*e.rates, *e.residuals, *e.outputs]
        lines = lines_text(needed_lines(e.lines, (r.value for r in results)), self.printer, "_solve")
        equations = "\n".join([*self._symbols(), "", *lines])
        whole = "\n".join([equations, "", *self._functions_of_casadi()])
        support = [text for name, text in (("_solve(", SOLVE), ("_root(", ROOT)) if name in whole]
        return "\n\n\n".join([self._beginning(), *support, whole]) + "\n"

    def _beginning(self) -> str:
        e = self.equations
        return (
            f'"""{e.name}: state equations of a bond graph as functions of CasADi, in SI units.\n\n'
            "    rates = derivative(t, x, …), with the arguments in the order of `arguments`; `jacobian` has the slopes of rates and residuals\n"
            + (
                "    Rates may jump where a condition changes (`if`, `sign`, `floor`): an integrator that steps across depends on its steps there.\n"
                if e.indicators
                else ""
            )
            + "    run = ca.integrator('run', 'idas' if 'alg' in dae else 'cvodes', dae, 0.0, 1.0)(x0=START, p=DEFAULTS + INPUT_DEFAULTS)\n"
            '"""\n\nimport casadi as ca'
        )

    def _symbols(self) -> Iterator[str]:
        yield "t = ca.SX.sym('t')"
        for letter, group in self.groups:
            yield f"{letter} = ca.SX.sym({letter!r}, {len(group)})"
            yield from self.items(letter, group)
        yield from (f"{heading} = {numbers}" for heading, numbers in self.defaults())

    def _functions_of_casadi(self) -> Iterator[str]:
        e = self.equations
        letters = ["t", *(letter for letter, _ in self.groups)]
        moving = f"ca.vertcat({', '.join(letter for letter, group in self.groups if letter in 'xz')})"
        yield f"arguments = [{', '.join(letters)}]"
        yield f"ode = {self._vector(e.rates)}"
        yield f"alg = {self._vector(e.residuals)}"
        yield "derivative = ca.Function('derivative', arguments, [ode])"
        if e.unknowns:
            yield "residual = ca.Function('residual', arguments, [alg])"
        yield f"jacobian = ca.Function('jacobian', arguments, [ca.jacobian(ca.vertcat(ode, alg), {moving})])"
        yield f"outputs = ca.Function('outputs', arguments, [{self._vector(e.outputs)}])"
        needed = needed_lines(e.lines, (entry.value for entry in e.starts))
        yield from lines_text(needed, self.printer, "_solve")
        yield f"start = ca.Function('start', [p], [{self._vector(e.starts)}])"
        yield "START = start(DEFAULTS)"
        values = ", ".join(letter for letter, _ in self.groups if letter in "pu")
        unknown = ", 'z': z, 'alg': alg" if e.unknowns else ""
        yield f"dae = {{'t': t, 'x': x, 'p': ca.vertcat({values}), 'ode': ode{unknown}}}"

    def _vector(self, entries: Iterable[Entry]) -> str:
        return f"ca.vertcat({self.values(entries)})"
