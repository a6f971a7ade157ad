"""Sensitivity of an equilibrium and its modes to parameters: derivatives through the compiled equations, no differences.

At equilibrium 0 = f(x, p), so dx/dp = -A^-1 B with the linear model's matrices. The derivative of an eigenvalue is w^H dF v / w^H M v (Lancaster,
Numer. Math. 6, 1964), with left and right vectors of the whole system in states and unknowns of loops, M = diag(1 .. 1, 0 .. 0). dF is the
derivative of the Jacobian's entries along the common change of parameter, states and unknowns: second derivatives, by a tape. Loop joints need
nothing more: the whole Jacobian preserves the directions that they allow, for every value of the parameter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Leaf, Reported

from ..errors import RunFailed, UsageError
from ..numerics.scales import EPS, nonzero
from ..rendering import OfModel, Summarised
from ..results.json_values import as_json, finite, head, named, with_units
from .linear import Linearization, linearization
from .modes import STILL, eigenvalues
from .movable import refuse_choice
from .operating_point import OperatingPoint
from .spectrum import left_shapes

if TYPE_CHECKING:
    from compiler.api import Compilation

    from ..compiled_model import CompiledModel

SCHEMA = "bondgraph-sensitivity/1"
SINGULAR = 1e-11  # relative to the largest singular value
LOST = 1e-9  # relative to the effect of a parameter: part that no state can balance
NEAR = 64 * math.sqrt(EPS)  # relative distance of two equal eigenvalues: rounding parts a double one by its root
SEPARATE = 1e3  # condition number of an eigenvalue among equal ones: more where vectors nearly coincide


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(OfModel, Summarised):
    """Derivatives `slopes` (m, k) of `quantities` (m) by `parameters` (k), in SI, with the values of both.

    Quantities are outputs at equilibrium, `frequency i` (Hz) and `damping i` of the moving modes, slowest first.
    """

    quantities: tuple[str, ...]
    parameters: tuple[str, ...]
    values: Array
    at: Array
    slopes: Array
    units: Mapping[str, str]
    report: tuple[Reported, ...]

    def of(self, quantity: str, parameter: str) -> float:
        """Return one derivative. Raises `UsageError`."""
        return float(self.slopes[place_in(quantity, self.quantities), place_in(parameter, self.parameters)])

    @property
    def relative(self) -> Array:
        """Change of a quantity in percent per percent of a parameter; NaN where the quantity is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio: Array = self.slopes * self.at / self.values[:, None]
        return np.where(np.isfinite(ratio), ratio, np.nan)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-sensitivity/1`.

        {schema, model, experiment, parameters: {name: {value, unit}}, quantities: {name: {value, unit, slopes: {parameter: SI over SI}, relative:
        {parameter: number}}}}.
        """
        relative = self.relative
        quantities = {
            name: {
                "value": finite(self.values[i]), "unit": self.units[name],
                "slopes": as_json(named(self.parameters, self.slopes[i])),
                "relative": as_json(named(self.parameters, relative[i])),
            }
            for i, name in enumerate(self.quantities)
        }  # fmt: skip
        parameters = with_units(named(self.parameters, self.at), self.units)
        return {**head(SCHEMA, self), "parameters": parameters, "quantities": quantities}


def place_in(name: str, names: Sequence[str]) -> int:
    """Return the place of a quantity or a parameter of a sensitivity. Raises `UsageError`."""
    if name not in names:
        raise UsageError("BR209", f"there is no `{name}` in this sensitivity; there is {', '.join(names) or 'none'}")
    return names.index(name)


def independent(
    model: CompiledModel, parameters: tuple[str, ...] | None, experiment: str | None, settings: Mapping[str, str | float]
) -> tuple[tuple[str, ...], dict[str, str | float]]:  # fmt: skip
    """Return the parameters to differentiate by (None: all independent ones), and settings that make them independent."""
    compilation = model.compilation(model.scene(experiment, settings))
    graph = compilation.whole_graph
    free = {
        n for n, q in graph.quantities.items()
        if q.role in ("parameter", "input") and (q.definition is None or not q.definition.arguments)
    }  # fmt: skip
    if parameters is None:
        numbers = (n for n, q in graph.quantities.items() if n in free and q.role == "parameter")
        between = compilation.structural | compilation.truths | compilation.choices.keys()
        return tuple(n for n in numbers if n not in between), dict(settings)
    fixed = dict(settings)
    for name in parameters:
        named = graph.quantities.get(name)
        refuse_choice(name, compilation)
        if named is None or named.role not in ("parameter", "input"):
            some = ", ".join(n for n, q in graph.quantities.items() if q.role == "parameter" and "." not in n)
            raise UsageError(
                "BR250", f"`{name}` is no parameter or input of the model; it has {some or 'none'}, and those of its parts",
            )  # fmt: skip
        if name not in free:
            if named.value is None:
                raise UsageError(
                    "BR251", f"`{name}` moves with time:",
                    "give it a value to differentiate by it; if an experiment moves it, `-e none` (in Python `experiment=None`) takes the model without",
                )  # fmt: skip
            fixed[name] = named.value
    return parameters, fixed


def sensitivity(point: OperatingPoint, of: tuple[str, ...]) -> Sensitivity:
    """Return the sensitivity of "equilibrium", "modes" or both, by the point's `by`."""
    linear = linearization(point)
    moved = _moved(linear)
    names: list[str] = []
    values: list[float] = []
    slopes: list[Any] = []
    units = dict(linear.units)
    if "equilibrium" in of:
        names += linear.outputs
        values += linear.y.tolist()
        slopes += list(linear.C @ moved + linear.D)
    if "modes" in of:
        changes = eigenvalue_slopes(point, eigenvalues(linear.A), moved)
        for i, (value, change) in enumerate(changes, 1):
            size = abs(value)
            growth = (value.conjugate() * change).real / size
            names += [f"frequency {i}", f"damping {i}"]
            values += [size / (2 * math.pi), 0.0 - value.real / size]
            slopes += [growth / (2 * math.pi), (value.real * growth / size - change.real) / size]
            units |= {f"frequency {i}": "Hz", f"damping {i}": "1"}
    units |= {n: q.unit for n, q in point.compilation.whole_graph.quantities.items() if n in point.by}
    return Sensitivity(
        linear.model, linear.experiment, tuple(names), point.by, np.array(values), linear.u,
        np.array(slopes, dtype=float).reshape(len(names), len(point.by)), units, point.compilation.plan.report,
    )  # fmt: skip


def rest_moves(point: OperatingPoint, linear: Linearization, by: Sequence[int]) -> Any:
    """Return derivatives of all states and unknowns at equilibrium by some of `by`, the inputs of the linear model, (n + m, k). Raises `RunFailed`."""
    return _followed(point, _moved(linear), by)


def _followed(point: OperatingPoint, moved: Array, by: Sequence[int]) -> Any:
    """Return derivatives of all states and unknowns by some of `by`, from those of the free coordinates."""
    n, reduced, places = point.count, point.reduced, list(by)
    states = reduced.directions @ moved + reduced.following[:, places]
    follow = reduced.unknowns
    return np.concatenate([states, follow[:, :n] @ states + follow[:, [n + p for p in places]]])


def _moved(linear: Linearization) -> Any:
    """Return derivatives of the free coordinates at equilibrium by the parameters (r, k); an angle that rotates steadily stays fixed."""
    turning = (linear.rates != 0) & ~linear.A.any(axis=0)
    A, B = (np.where(turning[:, None], 0.0, matrix) for matrix in (linear.A, linear.B))
    found, left = balanced_step(A, B)
    lost = np.flatnonzero(left > LOST)
    if len(lost):
        name = linear.inputs[lost[0]]
        raise RunFailed(
            "BR252", f"the state of rest does not follow `{name}`: it ends or branches there (`continue` goes through such points)",
        )  # fmt: skip
    return found


def balanced_step(A: Array, B: Array) -> tuple[Any, Any]:
    """Return the x (r, k) with A x + B = 0, and the residual relative to B (k,).

    Where A is singular, conserved quantities (w with w A = 0: the difference of two displacements on one flow) stay unchanged, and so do coordinates
    without restoring force: the minimum-norm solution.
    """
    if not len(A):
        return np.zeros((0, B.shape[1])), np.zeros(B.shape[1])
    rows = nonzero(np.abs(np.concatenate([A, B], axis=1)).max(axis=1))[:, None]
    columns = nonzero(np.abs(A / rows).max(axis=0))
    scaled, right = A / rows / columns, B / rows
    u, sizes, _ = np.linalg.svd(scaled)
    rank = int((sizes > SINGULAR * sizes.max(initial=0.0)).sum())
    if rank == len(A):
        return -np.linalg.solve(scaled, right) / columns[:, None], np.zeros(B.shape[1])
    conserved = u[:, rank:].T / rows[:, 0] / columns
    conserved = conserved / np.linalg.norm(conserved, axis=1, keepdims=True)
    whole = np.concatenate([scaled, conserved])
    step = -np.linalg.lstsq(whole, np.concatenate([right, np.zeros((len(conserved), B.shape[1]))]), rcond=SINGULAR)[0]
    left = np.abs(scaled @ step + right).max(axis=0)
    return step / columns[:, None], left / nonzero(np.abs(right).max(axis=0))


def eigenvalue_slopes(point: OperatingPoint, found: Sequence[complex], moved: Array) -> list[tuple[complex, Any]]:
    """Return eigenvalues that are not zero, slowest first, each with its derivatives (k,) by the point's `by`. Raises `RunFailed`."""
    n, size, k = point.count, point.all, len(point.by)
    space = point.compilation.state_space
    whole = point.slopes([*(s.rate for s in space.states), *(u.residual for u in space.unknowns)])[:, :size]
    follow = point.reduced.unknowns
    A = whole[:n, :n] + (whole[:n, n:] @ follow[:, :n] if size > n else 0.0)
    values, left, right = left_shapes(A)
    changes = _jacobian_changes(point, _followed(point, moved, range(k)))
    rows, columns = (np.array(part, dtype=int) for part in zip(*changes, strict=True)) if changes else ([], [])
    entries = np.array(list(changes.values())).reshape(len(changes), k)
    fastest = max((abs(value) for value in found), default=0.0)
    result = []
    for value in found:
        if abs(value) <= STILL * fastest:
            continue
        equal = np.abs(values - value) <= NEAR * abs(value)
        w, v = left[:, equal], right[:, equal]
        try:
            w = w @ np.linalg.inv(v.conj().T @ w)
        except np.linalg.LinAlgError:  # fewer vectors than eigenvalues
            w = np.full_like(w, np.inf)
        independent = equal.sum() == 1 or (np.abs(w * v).sum(axis=0) < SEPARATE).all()
        if size > n:
            w = np.concatenate([w, -np.linalg.solve(whole[n:, n:].T, whole[:n, n:].T @ w)])
            v = np.concatenate([v, follow[:, :n] @ v])
        with np.errstate(invalid="ignore"):
            change = np.einsum("ei,ek,ej->ijk", w[rows].conj(), entries, v[columns])
            terms = np.einsum("ei,ek,ej->k", np.abs(w[rows]), np.abs(entries), np.abs(v[columns]))
        mean = np.einsum("iik->k", change) / max(len(change), 1)
        apart = np.abs(change - np.eye(len(change))[:, :, None] * mean).max(axis=(0, 1), initial=0.0)
        # of equal ones each has its own derivative if it goes with other vectors, and none if these are too few
        if not len(change) or not independent or not (apart <= NEAR * terms).all():
            raise RunFailed(
                "BR253", f"the mode at {abs(value) / (2 * math.pi):.6g} Hz coincides with another: it has no derivative of its own",
            )  # fmt: skip
        result.append((value, mean))
    return result


def _jacobian_changes(point: OperatingPoint, moved: Array) -> dict[tuple[int, int], Any]:
    """Return the derivatives of the Jacobian's entries by `by`, with states and unknowns following: place -> (k,)."""
    lowered = point.lowered
    tape = point.tape("jacobian", lambda: list(lowered.jacobian.values()))
    _, slopes = tape.slopes(point.lookup, directions_of(point, moved, point.by), len(point.by))
    return {place: s for place, s in zip(lowered.jacobian, slopes, strict=True) if s is not None}


def directions_of(point: OperatingPoint, moved: Array, names: Sequence[str]) -> dict[Leaf, Any]:
    """Return the derivatives of the program's symbols by parameters or inputs of these names (k); states and unknowns as in `moved` (n + m, k)."""
    directions: dict[Leaf, Any] = {Leaf("state", i): row for i, row in enumerate(moved) if row.any()}
    return directions | unit_directions(point.compilation, names, len(names))


def unit_directions(compilation: Compilation, names: Sequence[str], width: int, first: int = 0) -> dict[Leaf, Any]:
    """Return the symbols of parameters or inputs of these names in expressions, each with a unit vector (width,), from the place `first` on."""
    lowered, quantities = compilation.lowered, compilation.state_space.quantities
    places = {v: Leaf("parameter", i) for i, v in enumerate(lowered.parameters)}
    places |= {v: Leaf("input", i) for i, v in enumerate(lowered.inputs)}
    numbers = [(j, quantities.get(name)) for j, name in enumerate(names, first)]
    return {places[v]: np.eye(width)[j] for j, v in numbers if v is not None and v in places}
