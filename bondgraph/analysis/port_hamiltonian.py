"""Port-Hamiltonian form E x' = (J - R) z + G u with E^T z = grad H, as in van der Schaft and Jeltsema (2014), chapter 2.

z are the co-energy variables of the storages in integral form (effort of a displacement, flow of a momentum), u the values of the sources. J is
skew: junctions, transducers and gyrating resistors conserve power; R is symmetric: resistors dissipate z' R z. E is the identity unless storages
depend on others: with x_d their stored quantities, whose co-energy variables are z_d = C z, power gives x' = A z - C^T x_d' + G u, so
E = 1 + C^T dx_d/dx (Mehrmann and Unger, Acta Numerica 32, 2023).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import (
    Array,
    Compilation,
    InternalError,
    LinearLoop,
    StateSpace,
    Symbol,
    derivative,
    evaluate,
    letters,
)

from ..errors import RunFailed, UsageError
from ..simulation.loops.loops import LoopSolver
from ..simulation.monitors.energy import stored_change
from ..simulation.monitors.finite import given_values, linear_loop
from ..simulation.segments.units import refused
from .reduced import led
from .structure import Network, StoragePort, network

ROUND_OFF = 1e-9  # relative to the summed terms
EQUILIBRATIONS = 10  # Ruiz, RAL-TR-2001-034: each halves the distance to rows whose largest entry is one


@dataclass(frozen=True, eq=False)
class PortHamiltonian:
    """E x' = (J - R) z + G u at one state and time; n states, m sources, all in SI.

    `E`, `J`, `R` (n, n), `G` (n, m); `slopes` (n,) are z with E' z = grad H (E is the identity without dependent storages); `given` (m,) is u;
    `energy` is H in J, and `hamiltonian` computes it at any other state by name.
    """

    states: tuple[str, ...]
    slope_names: tuple[str, ...]
    sources: tuple[str, ...]  # elements, in the order of u
    E: Array
    J: Array
    R: Array
    G: Array
    slopes: Array
    given: Array
    energy: float
    hamiltonian: Callable[[Mapping[str, float]], float]

    @property
    def gradient(self) -> Array:
        """Gradient of H (n,)."""
        return np.asarray(self.E.T @ self.slopes)

    @property
    def rates(self) -> Array:
        """Rates x' (n,)."""
        return np.asarray(np.linalg.solve(self.E, (self.J - self.R) @ self.slopes + self.G @ self.given))


@dataclass(frozen=True, eq=False)
class SymbolicPortHamiltonian:
    """x' = (J - R) grad H + G u in sympy, for models with linear resistors and all storages in integral form."""

    states: tuple[str, ...]
    sources: tuple[str, ...]
    J: Any
    R: Any
    G: Any
    H: Any


def port_hamiltonian(compilation: Compilation, state: Mapping[str, float], time: float) -> PortHamiltonian:
    """Return the form at a state (states that are not given have their initial values) and time.

    Raises `UsageError` for models without such a form, or where resistors create energy, with their names; `RunFailed` for one with an imported unit.
    """
    for event in compilation.equations.events:
        if event.span.unit is not None:
            raise refused(event)
    values = values_at(compilation, state, time)
    net = network(compilation, lambda x: evaluate(x, values.__getitem__), values)
    form = _Form(net, float)
    R = form.losses() / 2
    J = form.A + R
    _check_skew(J, np.maximum(np.abs(form.A), np.abs(R)))
    _check_positive(R, form)
    E = np.eye(len(net.states))
    if net.dependent:
        _check_dependent(compilation, net, form)
        E = E + form.C.T @ _follow(compilation, net, form, values)

    def hamiltonian(other: Mapping[str, float]) -> float:
        return _energy(compilation, values_at(compilation, other, time))

    names = compilation.equations.variables
    return PortHamiltonian(
        tuple(s.name for s in net.states), tuple(names[s.slope].name for s in net.states),
        tuple(p.element for p in net.sources), E, (J - J.T) / 2, R, form.G, np.array([values[s.slope] for s in net.states]),
        np.array([values[v] for v in net.given]), _energy(compilation, values), hamiltonian,
    )  # fmt: skip


class _Form:
    """Network as matrices over co-energy variables of states (z), rates of dependent storages (w) and sources (u)."""

    def __init__(self, net: Network, entries: type) -> None:
        self.columns = [*(s.slope for s in net.states), *(d.rate for d in net.dependent), *net.given]
        n, k = len(net.states), len(net.dependent)
        self.net, self.entries = net, entries
        rates = self._matrix([s.rate for s in net.states])
        self.A, self.B, self.G = rates[:, :n], rates[:, n : n + k], rates[:, n + k :]
        tied = self._matrix([d.slope for d in net.dependent])
        self.C, self.others = tied[:, :n], tied[:, n:]
        self.efforts, self.flows = (self._matrix([getattr(p, v) for p in net.resistors]) for v in ("effort", "flow"))
        tied_to = np.concatenate([self.efforts[:, n : n + k], self.flows[:, n : n + k]])
        self.reached = bool((tied_to != 0).any())  # True if a resistor depends on the rate of a dependent storage
        signs = np.array([p.sign for p in net.resistors], dtype=int).reshape(-1, 1)
        self.efforts, self.flows = self.efforts[:, :n] * signs, self.flows[:, :n]

    def losses(self, chosen: list[int] | slice = slice(None)) -> Any:
        """Return twice the power into the chosen ports of resistors, as a symmetric form in the co-energy variables of the states."""
        product = self.efforts[chosen].T @ self.flows[chosen]
        return product + product.T

    def parts(self) -> dict[str, Any]:
        """Return element -> its own losses."""
        names = [p.element for p in self.net.resistors]
        return {name: self.losses([i for i, n in enumerate(names) if n == name]) for name in dict.fromkeys(names)}

    def _matrix(self, variables: list[int]) -> Any:
        rows = []
        for variable in variables:
            row = self.net.row(variable)
            outside = [v for v, c in row.items() if v not in self.columns and c != 0]
            if outside:
                raise UsageError(
                    "BR226", "something that is neither storage, resistor nor source decides a flow: no port-Hamiltonian form is made",
                )  # fmt: skip
            rows.append([row.get(c, 0) for c in self.columns])
        return np.array(rows, dtype=self.entries).reshape(len(rows), len(self.columns))


def _check_skew(J: Array, size: Array) -> None:
    """Check that all elements except resistors conserve power: an error in this program otherwise.

    Round-off is relative to the largest entries of its row and column: units are scaled from both sides.
    """
    size = np.maximum(size, size.T)
    scale = np.ones(len(J))
    for _ in range(EQUILIBRATIONS):
        largest = (scale[:, None] * size * scale).max(axis=1, initial=0.0)
        scale /= np.sqrt(np.where(largest > 0, largest, 1.0))
    if (scale[:, None] * np.abs(J + J.T) * scale > ROUND_OFF).any():
        raise InternalError("the junction structure of a port-Hamiltonian form is not skew")


def _check_positive(R: Array, form: _Form) -> None:
    """Check that R is positive semidefinite; otherwise name the resistors that create energy."""
    size = np.sqrt(np.abs(form.efforts * form.flows).sum(axis=0))
    scale = np.where(size > 0, size, 1.0)

    def least(matrix: Array) -> float:
        return float(np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min(initial=0.0))

    try:  # much faster than eigenvalues, and nearly always sufficient
        np.linalg.cholesky(R / np.outer(scale, scale) + ROUND_OFF * np.eye(len(R)))
        return
    except np.linalg.LinAlgError:
        pass
    if least(R) < -ROUND_OFF:
        guilty = [f"`{name}`" for name, loss in form.parts().items() if least(loss) < -ROUND_OFF]
        raise UsageError(
            "BR227", f"{', '.join(guilty)} creates energy at this state: R would not be positive semidefinite"
        )


def _check_dependent(compilation: Compilation, net: Network, form: _Form) -> None:
    names = ", ".join(f"`{d.element}`" for d in net.dependent)
    if (form.others != 0).any() or form.reached:
        why = "forced by a source, tied to each other or seen by a resistor"
        raise UsageError("BR228", f"storages in derivative form ({names}) are {why}: no port-Hamiltonian form is made")
    moved = [
        n.name
        for n in compilation.graph.nodes
        if n.kind.value in letters("transducer") and getattr(n, "modulated", False)
    ]
    if moved:
        raise UsageError(
            "BR229", f"storages in derivative form ({names}) beside `{moved[0]}`, whose ratio moves: no port-Hamiltonian form is made",
        )  # fmt: skip
    if (np.abs(form.B + form.C.T) > ROUND_OFF * (np.abs(form.B) + np.abs(form.C.T))).any():
        raise InternalError("the ties of dependent storages do not conserve power")


def _follow(compilation: Compilation, net: Network, form: _Form, values: Mapping[int, float]) -> Array:
    """Return dx_d/dx: from the dependent storages' derivatives, the ties, and the states' derivatives."""
    both = {d.element for d in net.dependent} & {s.element for s in net.states}
    if both:
        raise UsageError(
            "BR230", f"`{min(both)}` is in derivative form in some of its ports: no port-Hamiltonian form is made"
        )

    def slopes(ports: tuple[StoragePort, ...], of: str, over: str) -> Array:
        result = np.zeros((len(ports), len(ports)))
        for i, one in enumerate(ports):
            for j, other in enumerate(ports):
                if one.element == other.element:
                    result[i, j] = _slope(compilation, getattr(one, of), getattr(other, over), values)
        return result

    outer, inner = slopes(net.dependent, "stored", "slope"), slopes(net.states, "slope", "stored")
    return np.asarray(outer @ form.C @ inner)


def _slope(compilation: Compilation, target: int, over: int, values: Mapping[int, float]) -> float:
    """Return the partial derivative of one variable of a storage by another, from its law."""
    if target == over:  # a law such as e = q
        return 1.0
    law = next((a for a in compilation.equations.assignments if a.target == target), None)
    if law is None:
        return 0.0
    slope = evaluate(derivative(law.expression, Symbol(over)), values.__getitem__)
    return -slope / evaluate(derivative(law.expression, Symbol(target)), values.__getitem__) if law.implicit else slope


def _energy(compilation: Compilation, values: Mapping[int, float]) -> float:
    """Return H: the energy of all storages; for one that is given by equations the work from zero."""
    values_by_variable = dict(values)
    return float(
        sum(
            stored_change(s, np.zeros(len(s.stored)), np.array([values[v] for v in s.stored]), values_by_variable)
            if s.energy is None
            else evaluate(s.energy, _slots(s, values))
            for s in compilation.equations.storages
        )
    )


def _slots(storage: Any, values: Mapping[int, float]) -> Callable[[int], float]:
    count = len(storage.stored)

    def value(slot: int) -> float:
        entry = storage.stored[slot] if slot < count else storage.arguments[slot - count]
        return entry if isinstance(entry, float) else values[entry]

    return value


# ---------------------------------------------------------------- in symbols


def symbolic_port_hamiltonian(compilation: Compilation) -> SymbolicPortHamiltonian:
    """Return the form in sympy, over parameters, inputs, time and states. Raises `UsageError` for models without one."""
    import sympy

    from compiler.api import to_sympy

    from .symbolic import symbolic_values

    if compilation.state_space.dependent:
        raise UsageError(
            "BR231", f"`{compilation.state_space.dependent[0]}` depends on other storages: there is no form in symbols, but one at each state",
        )  # fmt: skip
    entry = symbolic_values(compilation.state_space)
    # Rational numbers, because sums must vanish exactly here.
    net = network(compilation, lambda x: sympy.nsimplify(to_sympy(x, entry), rational=True), None)
    form = _Form(net, object)
    A, G = sympy.Matrix(form.A.tolist()), sympy.Matrix(len(net.states), len(net.given), form.G.ravel().tolist())
    R = sympy.Matrix(len(net.states), len(net.states), form.losses().ravel().tolist()) / 2
    R = R.applyfunc(sympy.simplify)
    J = (A + R).applyfunc(sympy.simplify)
    if (J + J.T).applyfunc(sympy.simplify) != sympy.zeros(*J.shape):
        raise InternalError("the junction structure of a port-Hamiltonian form is not skew")
    stored = {s.stored: sympy.Symbol(s.name, real=True) for s in net.states}
    H = sum((_symbolic_energy(s, stored, entry) for s in compilation.equations.storages), sympy.Integer(0))
    return SymbolicPortHamiltonian(
        tuple(s.name for s in net.states), tuple(p.element for p in net.sources), J, R,
        G.applyfunc(sympy.simplify), H,
    )  # fmt: skip


def _symbolic_energy(storage: Any, stored: Mapping[int, Any], entry: Callable[[int | float], Any]) -> Any:
    """Return the energy of a storage; for linear laws half of derivative times stored quantity squared, else the work from zero as an integral."""
    import sympy

    from compiler.api import to_sympy

    count = len(storage.stored)
    slots = [stored[v] for v in storage.stored] + [entry(v) for v in storage.arguments]
    if storage.energy is not None:
        return to_sympy(storage.energy, slots.__getitem__)
    share = sympy.Symbol("share", positive=True)
    along = [share * x for x in slots[:count]] + slots[count:]
    work = sympy.expand(sum(to_sympy(law, along.__getitem__) * x for law, x in zip(storage.laws, slots, strict=False)))
    if work.is_polynomial(share):
        return sympy.integrate(work, (share, 0, 1))
    return sympy.Integral(work, (share, 0, 1))


def values_at(compilation: Compilation, state: Mapping[str, float], time: float) -> dict[int, float]:
    """Return variable -> value; states that are not given have their initial values. Raises `UsageError`, `RunFailed`."""
    space, program = compilation.state_space, compilation.program
    state = led(compilation, program.defaults, state)
    unknown = sorted(set(state) - set(program.states.names))
    if unknown:
        raise UsageError("BR221", f"`{unknown[0]}` is no state; states are {', '.join(program.states.names) or 'none'}")
    constants, inputs = program.constants(np.array(program.defaults)), np.array(program.input_defaults)
    x = np.array(program.start(constants), dtype=float)
    for i, name in enumerate(program.states.names):
        x[i] = state.get(name, x[i])
    mode = program.mode_at(time, x, inputs, constants)
    with np.errstate(all="ignore"):
        x = LoopSolver(program, constants, inputs).solve(time, x, mode)
    values = given_values(space, dict(zip(program.parameters.names, program.defaults, strict=True)), time, x)
    _steps(space, values)
    return values


def _steps(space: StateSpace, values: dict[int, float]) -> None:
    """Evaluate the computed variables, in order."""

    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix, right = linear_loop(step, values)
            size = np.abs(matrix).max(axis=1)
            try:
                solution = np.linalg.solve(matrix / size[:, None], right / size)
            except np.linalg.LinAlgError as problem:
                raise RunFailed("BR224", f"the loop of {', '.join(step.members)} has no unique solution") from problem
            values.update(zip(step.targets, map(float, solution), strict=True))
            continue
        try:
            values[step.target] = evaluate(step.expression, values.__getitem__)
        except (ArithmeticError, ValueError) as problem:
            name = space.variables[step.target].name
            raise RunFailed("BR225", f"`{name}` has no value at this state: {problem}") from problem
