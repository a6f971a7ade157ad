"""A lowered state space to the data of a program: everything except its functions, the same for every target."""

from __future__ import annotations

from collections.abc import Sequence

from ..algebra.expression import Apply, operations
from ..algebra.operators import OPERATORS
from .dependence import EVENT, STATE, TIME
from .lower import count_operations
from .lowered import Lowered
from .multipliers import solved_for
from .program import HybridNote, NameTable, TimeFunctions
from .program_image import KernelRows, ProgramImage


def image_of(lowered: Lowered, text: str, functions: tuple[tuple[str, tuple[str, ...], int], ...], rows: tuple[KernelRows, ...],
             timed: tuple[TimeFunctions | None, tuple[int, ...]]) -> ProgramImage:  # fmt: skip
    """Data of a program. `functions`: name, arguments and number of values of each; `timed`: functions of time, and the constants of signals."""
    space = lowered.space
    tables = {
        heading: NameTable(tuple(r[0] for r in rows), tuple(r[1] for r in rows))
        for heading, rows in name_tables(lowered)
    }
    values = [space.variables[v].value or 0.0 for v in (*lowered.parameters, *lowered.inputs)]
    count = len(lowered.parameters)
    return ProgramImage(
        space.name, text, tables, tuple(values[:count]), tuple(values[count:]), _places(sorted(lowered.jacobian)),
        _places(sorted(lowered.sensitivities)), _places(sorted(lowered.invariant_slopes)), _of_invariants(lowered),
        tuple(limit.note for limit in lowered.limits), count_operations(lowered.rates),
        lowered.differentiated, functions, rows, _hybrid_note(lowered), *timed,
    )  # fmt: skip


def _places(places: Sequence[tuple[int, int]]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return tuple(p[0] for p in places), tuple(p[1] for p in places)


def _hybrid_note(lowered: Lowered) -> HybridNote | None:
    """Data of the events that depend on states; None if there are none."""
    events = lowered.events
    if not events.present:
        return None
    variables = [lowered.space.variables[d.variable] for d in lowered.space.discretes]
    modes = NameTable(tuple(v.name for v in variables), tuple(v.unit for v in variables))
    conditions = tuple(item.note for item in events.located)
    switched = any(lowered.dependence(signal) & EVENT for signal in lowered.signals)
    timed, affine = tuple(events.timed), _is_affine(lowered)
    rates = {m.conjugate for m in lowered.space.momenta}
    jumping = tuple(i for i, s in enumerate(lowered.space.states) if s.conjugate is not None or s.variable in rates)
    poses = tuple(i for i, s in enumerate(lowered.space.states) if s.drawn is not None)
    counted = tuple(item.position for item in events.counts)
    return HybridNote(
        events.size, modes, timed, counted, conditions, events.events, events.junctions, switched, jumping, poses, len(lowered.space.momenta), affine
    )  # fmt: skip


def _is_affine(lowered: Lowered) -> bool:
    """Return True if the slopes of the rates depend on no state and not on time, and nothing that jumps or has a kink in a state is outside the mode."""
    if any(lowered.dependence(slope) & (STATE | TIME) for slope in lowered.jacobian.values()):
        return False
    nodes = operations(Apply("add", lowered.rates))
    rough = (node for node in nodes if node.operator in OPERATORS and not OPERATORS[node.operator].smooth)
    parts = (node.operands[0] if node.operator == "select" else node for node in rough)
    return not any(lowered.dependence(part) & STATE for part in parts)


def _of_invariants(lowered: Lowered) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """For each constraint (of rates alone last): index of its multiplier among the unknowns, its rate among the invariants, its part among the parameters.

    The index is -1 if there is none. A fourth tuple holds the unknowns that the program solves for.
    """
    invariants = lowered.space.invariants
    unknowns = {u.variable: i for i, u in enumerate(lowered.space.unknowns)}
    parameters = {v: i for i, v in enumerate(lowered.parameters)}
    rates, row = [], sum(i.position is not None for i in invariants)
    for invariant in invariants:
        rates.append(-1 if invariant.velocity is None else row)
        row += invariant.velocity is not None
    return (
        tuple(-1 if i.multiplier is None else unknowns[i.multiplier] for i in invariants),
        tuple(rates),
        tuple(-1 if i.part is None else parameters[i.part] for i in invariants),
        tuple(unknowns[v] for v in solved_for(lowered.space)),
    )


def name_tables(lowered: Lowered) -> list[tuple[str, list[tuple[str, str]]]]:
    """Heading, names and units of each array of a program."""
    variables = lowered.space.variables

    def rows(numbers: object) -> list[tuple[str, str]]:
        return [(variables[v].name, variables[v].unit) for v in numbers]  # type: ignore[attr-defined]

    outputs = [(name, variables[v].unit) for name, v in lowered.space.outputs.items()]
    invariants = [(i.name, variables[i.position].unit) for i in lowered.space.invariants if i.position is not None]
    rates = [
        (f"rate of {i.name}", variables[i.velocity].unit) for i in lowered.space.invariants if i.velocity is not None
    ]
    return [
        ("STATES", rows([s.variable for s in lowered.space.states])),
        ("UNKNOWNS", rows([u.variable for u in lowered.space.unknowns])),
        ("DEPENDENTS", rows([d.quantity for d in (*lowered.space.dependents, *lowered.space.momenta)])),
        ("OUTPUTS", outputs),
        ("INPUTS", rows(lowered.inputs)),
        ("PARAMETERS", rows(lowered.parameters)),
        ("INVARIANTS", [*invariants, *rates]),
        *([("FORCED", rows([f.variable for f in lowered.space.forced]))] if lowered.space.forced else []),
    ]
