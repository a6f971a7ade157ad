"""State equations to a Python module of functions of JAX: for gradients through runs, learning, batches and accelerators."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from sympy import Basic

from ...algebra.operators import Operator
from ...reduction import StateSpace
from ..symbolic.python_text import lines_text, needed_lines
from ..symbolic.state_equations import Entry
from .casadi_module import ArrayPrinter, FunctionModule, differentiable
from .targets import TextTarget

SOLVE = '''def _solve(rows, right):
    """Solution of a linear system."""
    return jnp.linalg.solve(jnp.array(rows), jnp.array(right))'''
ROOT = '''def _root(x, n):
    """The real number whose power n is x."""
    return jnp.where(jnp.fmod(jnp.abs(n), 2) == 1, jnp.sign(x) * jnp.abs(x) ** (1 / n), x ** (1 / n))'''


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the module. Raises `CompilationFailed` for events, delays and tables."""
    return _JaxModule(differentiable(space, descriptions, "JAX"), JaxPrinter, _name).text()


TARGET = TextTarget("jax", ".py", write, usual=False)


def _name(row: Operator) -> str:
    return "jax.scipy.special.erf" if row.name == "erf" else row.in_numpy.replace("np.", "jnp.")


class JaxPrinter(ArrayPrinter):
    """Expressions of arrays of JAX."""

    choice, negation = "jnp.where", "jnp.logical_not"

    def _print_And(self, x: Basic) -> str:
        return f"({' & '.join(f'({self.text(a)})' for a in x.args)})"

    def _print_Or(self, x: Basic) -> str:
        return f"({' | '.join(f'({self.text(a)})' for a in x.args)})"


class _JaxModule(FunctionModule):
    """Writer of one module."""

    def text(self) -> str:
        e = self.equations
        letters = [letter for letter, _ in self.groups]
        values = {"p": "p=DEFAULTS", "u": "u=INPUT_DEFAULTS"}
        arguments = ", ".join(["t", *(values.get(letter, letter) for letter in letters)])
        results = [*e.rates, *e.residuals, *e.outputs]
        body = [line for letter, group in self.groups for line in self.items(letter, group)]
        body += lines_text(needed_lines(e.lines, (r.value for r in results)), self.printer, "_solve")
        body.append(f"return {', '.join(self._array(group) for group in (e.rates, e.residuals, e.outputs))}")
        passed = ", ".join(["t", *letters])
        named = {"derivative": 0, **({"residual": 1} if e.unknowns else {}), "outputs": 2}
        parts = [_function("_equations", arguments, body)]
        parts += [_function(name, arguments, [f"return _equations({passed})[{i}]"]) for name, i in named.items()]
        start = [line for letter, group in self.groups if letter == "p" for line in self.items(letter, group)]
        start += lines_text(needed_lines(e.lines, (entry.value for entry in e.starts)), self.printer, "_solve")
        parts.append(_function("start", "p=DEFAULTS", [*start, f"return {self._array(e.starts)}"]))
        whole = "\n\n\n".join(parts)
        support = [text for name, text in (("_solve(", SOLVE), ("_root(", ROOT)) if name in whole]
        return "\n\n\n".join(["\n".join(self._beginning(passed)), *support, whole]) + "\n"

    def _beginning(self, passed: str) -> Iterator[str]:
        yield f'"""{self.equations.name}: state equations of a bond graph as functions of JAX, in SI units and in 64 bits, which this module turns on.'
        yield f"\n    rates = derivative({passed}); jax.jacfwd(derivative, 1) has their slopes, jax.jit makes them fast"
        if self.equations.indicators:
            yield "    Rates may jump where a condition changes (`if`, `sign`, `floor`): a solver that steps across depends on its steps there."
        yield '"""\n\nimport jax\nimport jax.numpy as jnp\n\njax.config.update("jax_enable_x64", True)'
        yield from (f"{heading} = jnp.array({numbers}, dtype=float)" for heading, numbers in self.defaults())

    def _array(self, entries: Iterable[Entry]) -> str:
        return f"jnp.array([{self.values(entries)}], dtype=float)"


def _function(name: str, arguments: str, body: Iterable[str]) -> str:
    return "\n".join([f"def {name}({arguments}):", *(f"    {line}" for line in body)])
