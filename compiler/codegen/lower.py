"""State space to expressions of parameters, time, inputs and states: one shared graph of operations, with its Jacobian.

Every law is differentiated once, as a formula; an assignment only puts its arguments into the formula's partial derivatives.
Equal subexpressions are one node, even from different assignments.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

from ..algebra.derivative import derivative
from ..algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    closed,
    divide,
    multiply,
    negate,
    operations,
    substitute,
    symbols,
)
from ..algebra.formula import Formula
from ..algebra.operators import CONDITIONS
from ..algebra.systems import BandLayout, band_of, solutions
from ..equations.system import Assignment
from ..reduction import LinearLoop, StateSpace
from .dependence import MODE, PARAMETER, STATE, TIME
from .events import behind_the_run, event_notes, event_variables
from .limits import Leaf, Limit, ranges, requirement, sides
from .lowered import Label, Lowered
from .multipliers import solve_multipliers
from .order import operations_in_order
from .peaks import peaks
from .stored_energy import stored_energy
from .switching import Switching
from .time_functions import narrow_operations, time_roots


def lower(
    space: StateSpace, located: bool = True, by: tuple[int, ...] = (), conserving: bool = False, whole: bool = True
) -> Lowered:
    """Substitute the steps, find jumps in time and (`located`) in states, form the Jacobian.

    `by`: additional variables to differentiate by; for a computed variable, by an addition to it. `conserving`: also form the stored
    energy and its gradient. Without `whole`, errors are looked for but no derivatives are multiplied.
    """
    result = Lowered(space, by=by, whole=whole)
    _put_leaves(result)
    slopes: dict[int, dict[int, Expression]] = {}
    for position, number in enumerate(moving(space)):
        result.values[number] = Symbol(Leaf("state", position))
        slopes[number] = {position: ONE}
    count = len(slopes)
    seeds = {number: position for position, number in enumerate(by, count)}
    slopes |= {number: {seeds[number]: ONE} for number in by if number in result.values}
    switching = Switching(result, len(space.discretes))
    behind = behind_the_run(space) if located else set[int]()
    forced = {f.variable for f in space.forced}
    formulas: set[Formula] = set()
    uses = Counter(a for step in space.steps if isinstance(step, Assignment) for a in step.arguments)
    for step in space.steps:
        if isinstance(step, LinearLoop):
            _lower_loop(result, step, slopes)
        else:
            switching.at(step, step.target in behind, step.target in space.pieced - forced)
            _lower_assignment(result, step, slopes, switching, formulas)
            if uses[step.target] > 1:
                result.values[step.target] = closed(result.values[step.target])
        for target in (seeds.keys() & set(step.targets)) if seeds else ():
            slopes.setdefault(target, {})[seeds[target]] = ONE
    if not whole:
        slopes = {}
    result.slopes = slopes
    result.differentiated = len(formulas)
    rates = [*(s.rate for s in space.states), *(u.residual for u in space.unknowns)]
    result.rates = tuple(result.values[v] for v in rates)
    result.signals = tuple(_signals(result))
    for row, rate in enumerate(rates):
        for column, entry in slopes.get(rate, {}).items():
            if entry != ZERO and column < count:
                result.jacobian[row, column] = entry
    guesses = (Number(space.variables[u.variable].value or 0.0) for u in space.unknowns)
    result.starts = (*(_entry(result, s.start) for s in space.states), *guesses)
    _lower_claims(result)
    _lower_invariants(result, slopes)
    result.dependents = tuple(result.values[d.variable] for d in (*space.dependents, *space.momenta))
    for row, dependent in enumerate(space.dependents):
        for column, slope in slopes.get(dependent.variable, {}).items():
            if column < len(space.states) and result.dependence(slope) & ~PARAMETER:
                result.sensitivities[row, column] = slope
    result.forced = tuple(result.values[f.variable] for f in space.forced)
    nominals = [*(s.nominal for s in space.states), *(None for _ in space.unknowns)]
    result.nominals = tuple(None if n is None else _entry(result, n) for n in nominals)
    result.outputs = {name: result.values[v] for name, v in space.outputs.items()}
    result.solved = solve_multipliers(result) if whole else None
    if conserving:
        result.energy = stored_energy(result, slopes)
    result.limits += [
        requirement(limit, lambda x: _entry(result, x), lambda x: not result.dependence(x) & ~PARAMETER)
        for limit in space.limits
    ]
    result.delayed = tuple(result.values[d.value] for d in space.delays)
    _lower_events(result, switching)
    result.lags = tuple(_entry(result, d.lag) for d in space.delays)
    if whole:
        result.peaks = peaks(result.rates, len(space.states), result.moves)
        narrow = narrow_operations(result.signals, lambda node: bool(result.dependence(node) & TIME))
        result.time_roots = (*time_roots(result.crossings), *narrow)
    return result


def _put_leaves(result: Lowered) -> None:
    """Enter the variables that are not computed: parameters, inputs, delayed signals, time, discrete variables."""
    space = result.space
    roles: dict[str, list[int]] = {"parameter": [], "input": [], "time": []}
    used = _used(space)
    for number, variable in enumerate(space.variables):
        if variable.role in roles and number in used:
            position = len(roles[variable.role])
            roles[variable.role].append(number)
            result.values[number] = Symbol(Leaf(variable.role, position))
    for position, delay in enumerate(space.delays, len(roles["input"])):
        result.values[delay.variable] = result.delayed_symbol(position)
    result.parameters = tuple(roles["parameter"])
    result.inputs = (*roles["input"], *(d.variable for d in space.delays))
    for position, discrete in enumerate(space.discretes):
        result.values[discrete.variable] = result.event_symbol(position)


def _lower_claims(result: Lowered) -> None:
    """Starts of what is computed and those of the drawing, differences that vanish where they hold; and the values of the former."""
    space = result.space
    said = [(c.variable, c.start) for c in space.claims]
    drawn = [(s.variable, s.drawn) for s in (space.states[i] for i in space.moved) if s.drawn is not None]
    values = [(c.variable, 0.0) for c in space.claims]
    result.claims = tuple(result.values[v] - _entry(result, start) for v, start in (*said, *drawn, *values))


def _lower_invariants(result: Lowered, slopes: dict[int, dict[int, Expression]]) -> None:
    """Derivatives of the constraint residuals by positions, and of their rates by velocities, as a projection needs them."""
    invariants, count = result.space.invariants, len(result.space.states)
    gaps = [i.position for i in invariants if i.position is not None]
    rates = [i.velocity for i in invariants if i.velocity is not None]
    result.invariants = tuple(result.values[v] for v in (*gaps, *rates))
    positions = {c for gap in gaps for c in slopes.get(gap, {})}
    positions |= {c for c, state in enumerate(result.space.states) if state.drawn is not None}
    for row, variable in enumerate((*gaps, *rates)):
        for column, slope in slopes.get(variable, {}).items():
            if column < count and slope != ZERO and (row < len(gaps) or column not in positions):
                result.invariant_slopes[row, column] = slope


def _lower_events(result: Lowered, switching: Switching) -> None:
    """Form the expressions of the events from the lowered variables."""
    space, events, values = result.space, result.events, result.values
    events.events, computed = event_notes(space, {v: i for i, v in enumerate(moving(space))})
    events.starts = tuple(_entry(result, d.start) for d in space.discretes)
    events.sampling = tuple(_entry(result, x) for e in space.events for x in e.sampling)
    events.triggers = tuple(values[e.condition] for e in space.events)
    events.values = tuple(switching.stored(values[s.value]) for e in space.events for s in e.settings)
    events.targets = tuple(values[v] for v in computed)
    moved = (*result.rates, *result.delayed)  # what is delayed jumps in a step that it does not end
    steering = {s for e in moved for s in symbols(e)} if events.located else set()
    grown = bool(events.located)
    while grown:  # a condition may be asked under another
        items = [(i.symbol, i.root) for i in events.located] + [(i.symbol, i.value) for i in events.counts]
        more = {s for symbol, root in items if symbol in steering for s in symbols(root)} - steering
        steering, grown = steering | more, bool(more)
    events.located = [replace(i, note=replace(i.note, steers=i.symbol in steering)) for i in events.located]
    events.actives = tuple(values[s.condition] for s in space.switches)
    if space.switches:
        conjugates = [s.conjugate for s in space.states] + [d.conjugate for d in (*space.dependents, *space.momenta)]
        events.conjugates = tuple(ZERO if c is None else values[c] for c in conjugates)
    events.junctions = tuple((s.junction, s.span) for s in space.switches)
    if switching.partial:
        result.limits += _sides(result, switching)


def _sides(result: Lowered, switching: Switching) -> Iterable[Limit]:
    """Limits for what is compared where outputs, rates and events read it."""
    space, steps = result.space, {step.target: step for step in result.space.steps if isinstance(step, Assignment)}
    read = [*space.outputs.values(), *(s.rate for s in space.states), *(s.condition for s in space.switches)]
    read += [v for e in space.events for v in (e.condition, *(s.value for s in e.settings))]
    opened: dict[Expression, Expression] = {Symbol(Leaf("mode", i)): x for i, x in switching.opened.items()}
    for number in dict.fromkeys(read):
        if number in steps:
            name = space.variables[number].name
            yield from sides(
                result.values[number], steps[number], name, lambda x: not result.dependence(x) & ~PARAMETER, opened
            )


def _signals(result: Lowered) -> Iterable[Expression]:
    """Largest expressions behind the rates that depend on time but on no state. Those linear in time are left out."""
    time = Symbol(Leaf("time", 0))
    seen: set[Expression] = set()
    stack = list(result.rates)
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        bits = result.dependence(node)
        if not bits & TIME:
            continue
        if not bits & STATE:
            if node != time and result.dependence(derivative(node, time)) & (TIME | MODE):
                yield node
        elif isinstance(node, Apply):
            stack.extend(node.operands)


def moving(space: StateSpace) -> list[int]:
    """Variables in the state of a program: the states, then the unknowns of its loops."""
    return [*(s.variable for s in space.states), *(u.variable for u in space.unknowns)]


def following(space: StateSpace, places: Mapping[int, int]) -> dict[str, tuple[int, float | None]]:
    """Place of the state that a content follows, and the factor, by the names of the content."""
    names: dict[int, list[str]] = {}
    for name, variable in space.outputs.items():
        names.setdefault(variable, []).append(name)
    return {
        name: (places[f.state], f.factor)
        for f in space.following
        for name in (space.variables[f.variable].name, *names.get(f.variable, ()))
    }


def _used(space: StateSpace) -> set[int]:
    used: set[int] = set(space.outputs.values())
    for limit in space.limits:
        used.add(limit.condition)
        used.update(entry for _, entry, _ in limit.values if isinstance(entry, int))
    for step in space.steps:
        used.update(step.read)
    for state in space.states:
        used.add(state.rate)
        used.update(e for e in (state.start, state.nominal, state.drawn) if isinstance(e, int))
    used.update(v for c in space.claims for v in (c.variable, c.start) if isinstance(v, int))
    used.update(event_variables(space))
    used.update(v for d in space.delays for v in (d.value, d.lag) if isinstance(v, int))
    if space.switches:
        conjugates = [s.conjugate for s in space.states] + [d.conjugate for d in (*space.dependents, *space.momenta)]
        used.update(v for v in (*conjugates, *(m.variable for m in space.momenta)) if v is not None)
    used.update(d.start for d in space.discretes if isinstance(d.start, int))
    used.update(x for e in space.events for x in e.sampling if isinstance(x, int))
    used.update(v for port in space.ports for v in (port.effort, port.flow))
    used.update(space.stored.values())
    used.update(v for i in space.invariants for v in (i.position, i.velocity) if v is not None)
    for storage in space.storages:
        used.update(storage.stored)
        used.update(a for a in storage.arguments if not isinstance(a, float))
    return used


def _entry(result: Lowered, entry: int | float) -> Expression:
    return Number(entry) if isinstance(entry, float) else result.values[entry]


@lru_cache(maxsize=65536)
def partial(formula: Formula, slot: int) -> Expression:
    """Partial derivative of a formula by one of its slots, formed once for all its uses."""
    terms = _terms(formula)
    if terms is not None:
        return add(*(derivative(term, Symbol(slot)) for term in terms.get(slot, ())))
    return derivative(formula.expression, Symbol(slot))


@lru_cache(maxsize=4096)
def _terms(formula: Formula) -> Mapping[int, Sequence[Expression]] | None:
    """Terms of a sum by slot; None if the formula is no sum. At a junction with thousands of terms, each slot is in only one."""
    if not isinstance(formula.expression, Apply) or formula.expression.operator != "add":
        return None
    found: dict[int, list[Expression]] = {}
    for term in formula.expression.operands:
        for symbol in symbols(term):
            found.setdefault(symbol.key, []).append(term)
    return found


def _lower_assignment(
    result: Lowered,
    step: Assignment,
    slopes: dict[int, dict[int, Expression]],
    switching: Switching,
    formulas: set[Formula],
) -> None:
    arguments = [_entry(result, a) for a in step.arguments]

    def put(symbol: Symbol) -> Expression:
        slot: int = symbol.key
        return arguments[slot]

    quiet = switching.has_nothing_in(step.formula, arguments)
    value = substitute(step.formula.expression, put)
    if not quiet and not switching.pieced:
        own = (node for node in operations(step.formula.expression) if node.operator in CONDITIONS)
        switching.wrote({substitute(node, put) for node in own})
    value = value if quiet else switching.replaced(value)
    result.values[step.target] = value
    result.limits += ranges(step, put, result.space.variables, result.parameter_values)
    if isinstance(value, Apply):
        result.labels.setdefault(value, Label(result.space.variables[step.target].name, step.span, step.owner))
    moving = [(slot, a) for slot, a in enumerate(step.arguments) if isinstance(a, int) and slopes.get(a)]
    if not moving:
        return
    formulas.add(step.formula)
    switching.at(step, False, True)  # a slope jumps where its law does, and at bends, which are no events
    terms: dict[int, list[Expression]] = {}
    for slot, argument in moving:
        slope = substitute(partial(step.formula, slot), put)
        if slope == ZERO:
            continue
        if not quiet:
            slope = switching.replaced(slope)
        if not result.whole:
            terms[0] = [ONE]
            continue
        for column, inner in slopes[argument].items():
            terms.setdefault(column, []).append(multiply(slope, inner))
    found = {column: add(*parts) for column, parts in terms.items()}
    slopes[step.target] = {c: x for c, x in found.items() if x != ZERO}


def _lower_loop(result: Lowered, loop: LinearLoop, slopes: dict[int, dict[int, Expression]]) -> None:
    matrix = [{j: _entry(result, e) for j, e in enumerate(row) if e != 0.0} for row in loop.matrix]
    right = [_entry(result, e) for e in loop.right]
    layout = band_of([list(row) for row in matrix])
    targets = _solution(matrix, right, layout)
    for variable, value in zip(loop.targets, targets, strict=True):
        result.values[variable] = value
        if isinstance(value, Apply):
            result.labels.setdefault(
                value, Label(result.space.variables[variable].name, loop.span, ", ".join(loop.members))
            )
    if not result.whole:
        slopes |= {v: {0: ONE} for v in loop.targets if any(slopes.get(e) for e in loop.read)}
        return
    loop_slopes(loop, matrix, targets, slopes, layout)


def loop_slopes(
    loop: LinearLoop, matrix: Sequence[dict[int, Expression]], targets: Sequence[Expression], slopes: dict[int, dict[int, Expression]],
    layout: BandLayout | None,
) -> None:  # fmt: skip
    """Enter the slopes of a linear loop's solution `targets`: A t = r, so A dt = dr - dA t, with the same matrix for every column."""
    columns = {c for e in loop.read for c in slopes.get(e, {})}
    moving = [
        [(e, targets[j]) for j in entries if isinstance(e := row[j], int) and slopes.get(e)]
        for row, entries in zip(loop.matrix, matrix, strict=True)
    ]

    def slope(entry: int | float, column: int) -> Expression:
        return slopes.get(entry, {}).get(column, ZERO) if isinstance(entry, int) else ZERO

    for column in columns:
        rights = [
            add(slope(r, column), *(negate(multiply(slope(e, column), t)) for e, t in row))
            for row, r in zip(moving, loop.right, strict=True)
        ]
        if all(r == ZERO for r in rights):
            continue
        for variable, value in zip(loop.targets, _solution(matrix, rights, layout), strict=True):
            if value != ZERO:
                slopes.setdefault(variable, {})[column] = value


def _solution(
    matrix: Sequence[dict[int, Expression]], right: Sequence[Expression], layout: BandLayout | None
) -> list[Expression]:
    """Solution of a linear system: a quotient, or items of one node."""
    return [divide(right[0], matrix[0][0])] if len(right) == 1 else solutions(matrix, right, layout)


def count_operations(roots: Iterable[Expression]) -> int:
    """Number of distinct operations behind some expressions."""
    order = operations_in_order(tuple(roots), {})
    return sum(max(1, len(node.operands) - 1) if node.operator in ("add", "multiply") else 1 for node in order)
