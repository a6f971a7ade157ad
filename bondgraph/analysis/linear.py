"""The linear model at a point: x' = f + A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0), exact.

Where terms cancel, the rounding of an entry is how far it is from a second evaluation, with all values moved in their last places.
Stairs of time whose instants move with a state or an input have no slope at one instant, while their mean has: a linear model of one instant would
say that nothing follows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Expression, Leaf, Symbol, operations, symbols

from ..errors import MissingPackage, UsageError
from ..numerics.scales import equilibrated
from ..quantities import listed
from ..rendering import OfModel, Summarised
from ..results.json_values import entries, head, named, with_units
from .operating_point import OperatingPoint

if TYPE_CHECKING:
    from compiler.api import Lowered


SCHEMA = "bondgraph-linearization/1"
EPS = float(np.finfo(float).eps)
SEED = 20
EVALUATIONS = 4
CANCELLED = 2.0  # in units of that rounding: smaller entries are nothing else
SUSPECT = 1e-9  # of the largest of its row and its column: only smaller entries may be rounding
LARGEST = 300  # most states of a model that is evaluated again
TIME = Symbol(Leaf("time", 0))
STAIRS = ("floor", "ceil")
COMPARISONS = ("less", "less_equal")


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(OfModel, Summarised):
    """Matrices A (n, n), B (n, k), C (m, n), D (m, k), in SI, for `states`, `inputs` and `outputs` by the author's names.

    `states` are the free ones: coordinates tied by loop joints follow them, unknowns of loops are eliminated. `x` (n,), `u` (k,), `y` (m,) are the
    values at the point, `rates` (n,) is x' there: zero at an equilibrium. `unneeded`: states that no requested output depends on.
    """

    time: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    A: Array
    B: Array
    C: Array
    D: Array
    x: Array
    u: Array
    y: Array
    rates: Array
    unneeded: tuple[str, ...] = ()
    held: str = ""  # note on a model that time moves

    @property
    def note(self) -> str:
        """Note on the states that are left out, and on a model that time moves; empty for the whole of one that it does not."""
        return "; ".join(filter(None, (part_note(self.unneeded), self.held)))

    def to_scipy(self) -> Any:
        """Return a continuous `scipy.signal.StateSpace`. Raises ValueError without an input or output, as that has no such form."""
        if not self.inputs or not self.outputs:
            raise ValueError("a state space of scipy has at least one input and one output")
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return a `control.StateSpace` of python-control, with the author's names. Raises MissingPackage without it, ValueError for what it cannot hold."""
        try:
            import control
        except ImportError as error:
            raise MissingPackage("BR208", "this needs python-control:", 'pip install "bondgraph-lang[control]"') from error  # fmt: skip
        if not self.inputs and 1 in (len(self.states), len(self.outputs)):
            raise ValueError("python-control holds no system without an input that has one state or one output")
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, **names)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-linearization/1`, in SI.

        {schema, model, experiment, time, states, inputs, outputs: {name: {value, unit}}, A, B, C, D (rows), rates}; and `unneeded`, states that no
        requested output depends on.
        """
        told = {
            **head(SCHEMA, self),
            **entries(self, "time", *"ABCD", "rates", *(["unneeded"] if self.unneeded else [])),
        }
        for word, names, values in (
            ("states", self.states, self.x), ("inputs", self.inputs, self.u), ("outputs", self.outputs, self.y)
        ):  # fmt: skip
            told[word] = with_units(named(names, values), self.units)
        return told


def linearization(point: OperatingPoint, partial: bool = False) -> Linearization:
    """Return the linear model at a point; its inputs are the quantities by which the point's derivatives are taken (`by`).

    `partial`: the slopes of an output that has a kink or a jump there are NaN; otherwise that is refused. Raises `RunFailed`.
    """
    refuse_moving_pulses(point)
    space, reduced, program = point.compilation.state_space, point.reduced, point.program
    chosen = reduced.chosen
    rates = [space.states[i].rate for i in chosen]
    state_slopes, by_slopes = without_rounding(point, rates, *reduced.through(point.rate_slopes(chosen)))
    names, jumping = list(space.outputs), point.jumping()
    point.refuse_kinks([n for n in jumping if n not in names or not partial], "jumps at")
    sided = point.one_sided() if partial else point
    outputs = list(space.outputs.values())
    output_slopes, through = without_rounding(sided, outputs, *sided.of_states(outputs))
    bent = {*jumping, *(sided.kinks or ())}
    output_slopes[[n in bent or space.variables[v].name in bent for n, v in space.outputs.items()]] = np.nan
    return Linearization(
        program.name, point.made.plan.experiment, point.time, tuple(program.states.names[i] for i in chosen), point.by,
        program.outputs.names, linear_units(point), state_slopes, by_slopes, output_slopes, through, point.state[chosen],
        point.values_of(point.by), point.outputs, point.rates[chosen], point.unneeded,
        held_note(point, linear=True),
    )  # fmt: skip


def linear_units(point: OperatingPoint) -> dict[str, str]:
    """Return the SI units of outputs, states and inputs by name."""
    program, space = point.program, point.compilation.state_space
    units = dict(zip(program.outputs.names, program.outputs.units, strict=True))
    units |= dict(zip(program.states.names, program.states.units, strict=True))
    units |= {n: q.unit for n, q in point.compilation.whole_graph.quantities.items() if n in point.by}
    return units | {n: space.variables[space.quantities[n]].unit for n in point.by if n in space.quantities}


def part_note(unneeded: Sequence[str], more: str = "") -> str:
    """Return the note on a part of a model: the states that are left out. Empty for the whole."""
    if not unneeded:
        return ""
    states, them = ("1 state is", "it") if len(unneeded) == 1 else (f"{len(unneeded)} states are", "them")
    return f"{states} left out, as no requested output depends on {them}: {listed(unneeded)}{more}"


def state_matrix(point: OperatingPoint) -> Array:
    """Return A alone."""
    matrix: Array = point.reduced.through(point.rate_slopes(point.reduced.chosen))[0]
    return matrix


def rounding_of(point: OperatingPoint, variables: Sequence[int]) -> tuple[Any, Any]:
    """Return the rounding of the derivatives of variables by the free coordinates (v, r) and by the point's `by` (v, k)."""
    reduced, n, size, count = point.reduced, point.count, point.all, len(variables)
    residuals = [u.residual for u in point.compilation.state_space.unknowns]
    slopes = point.slopes_of((*variables, *residuals))
    places, shape = (slopes.rows, slopes.columns), (count + len(residuals), size + len(point.by))
    random, base = np.random.default_rng(SEED), np.zeros(shape)
    np.add.at(base, places, np.asarray(slopes.tape.values(point.lookup), dtype=float))
    rates = {s.rate: i for i, s in enumerate(point.compilation.state_space.states)}
    for row, variable in enumerate(variables):
        if variable in rates:  # by another order of operations
            base[row, :size] = point.slopes_here[rates[variable]]
    base[count:, :size] = point.slopes_here[n:]
    largest = np.zeros((count, len(reduced.chosen) + len(point.by)))
    for _ in range(EVALUATIONS):
        change = -base
        values = slopes.tape.values(
            lambda leaf: point.lookup(leaf) * (1 + EPS * random.integers(-2, 3) * (leaf.role != "mode"))
        )
        np.add.at(change, places, np.asarray(values, dtype=float))
        moved = np.concatenate(reduced.through(change[:count]), axis=1)
        if residuals:
            loops = np.concatenate(reduced.through(change[count:]), axis=1)
            moved = moved - base[:count, n:size] @ np.linalg.lstsq(base[count:, n:size], loops, rcond=None)[0]
        largest = np.fmax(largest, np.abs(moved))
    return largest[:, : len(reduced.chosen)], largest[:, len(reduced.chosen) :]


def without_rounding(
    point: OperatingPoint, variables: Sequence[int], by_states: Array, moved: Array
) -> tuple[Any, Any]:
    """Return derivatives (v, r) and (v, k) with those that are rounding of terms that cancel as zeros."""
    whole = np.nan_to_num(np.concatenate([by_states, moved], axis=1))
    scaled = np.abs(equilibrated(whole)[0])
    if point.count > LARGEST or not ((scaled > 0) & (scaled < SUSPECT)).any():
        return by_states, moved
    of_states, of_moved = rounding_of(point, variables)
    return (
        np.where(np.abs(by_states) <= CANCELLED * of_states, 0.0, by_states),
        np.where(np.abs(moved) <= CANCELLED * of_moved, 0.0, moved),
    )


def held_note(point: OperatingPoint, linear: bool = False) -> str:
    """Return the note on a result that would be another at another instant, as time moves the rates (`linear`: their slopes). Empty if it would not."""
    lowered = point.lowered
    moving = {TIME, *(Symbol(Leaf("mode", place)) for place in lowered.events.timed)}
    rates = [*lowered.rates, *(item.root for item in lowered.events.located)]
    if not any(s in moving for root in rates for s in symbols(root)):
        return ""
    bent = {Symbol(Leaf("state", i)) for i in range(point.all)} | moving
    if linear and not any(s in bent for slope in lowered.jacobian.values() for s in symbols(slope)):
        return ""
    instant = f"t = {point.time:.6g} s"
    what = f"it would rest here if all that time moves kept its values of {instant}"
    if linear:
        what = f"slopes are those of {instant}"
    return f"time moves the equations: {what}; write means for pulses and oscillations, or simulate"


def refuse_moving_pulses(point: OperatingPoint) -> None:
    """Raise `UsageError` if a state, or one of the quantities by which derivatives are taken, moves the instants of stairs of time."""
    program, by = point.program, set(point.by)
    names = (*program.states.names, *program.unknowns.names)
    roles = (("parameter", program.parameters.names), ("input", program.inputs.names))
    moving = {(role, i): name for role, all_names in roles for i, name in enumerate(all_names) if name in by}
    for leaf in (symbol.key for root in _stairs_of_time(point.lowered) for symbol in symbols(root)):
        name = moving.get((leaf.role, leaf.position))
        if leaf.role == "state":
            name = names[leaf.position]
        if name is not None:
            raise UsageError(
                "BR268", f"`{name}` moves the instants at which a `pwm` or another stair of time jumps: its value at one instant has no slope;",
                "write the mean for a linear model, as `duty` for `pwm(time, period, duty)`, or simulate",
            )  # fmt: skip


def _stairs_of_time(lowered: Lowered) -> Iterator[Expression]:
    """Yield the stairs of time, and the comparisons with them, of a program."""
    events = lowered.events
    places = {
        Symbol(Leaf("mode", place))
        for place, root in zip(events.timed, lowered.switches, strict=True)
        if _has_stairs(root, set())
    }
    roots = [*lowered.switches, *(item.root for item in events.located), *(item.value for item in events.counts)]
    for root in (*lowered.rates, *lowered.outputs.values()):
        roots += [x for x in operations(root) if x.operator in (*STAIRS, *COMPARISONS)]
    yield from (root for root in roots if _has_stairs(root, places))


def _has_stairs(root: Expression, places: set[Symbol]) -> bool:
    """Return True if an expression has stairs of time; `places`: items of the mode that are such."""
    return any(s in places for s in symbols(root)) or any(
        x.operator in STAIRS and TIME in set(symbols(x)) for x in operations(root)
    )
