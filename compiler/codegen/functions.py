"""Table of the functions of a program: name, arguments, description, and results, one row per function.

Every target writes and binds what stands here; a function without a row exists in none, and one whose results are None is absent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from ..algebra.expression import Apply, Expression, Number, add, call, multiply, never_negative
from ..fast_dataclass import dataclass
from .events import LoweredEvents
from .lowered import Lowered

FIXED, FULL = "constants", "time, state, inputs, constants, mode"
Results = Sequence[Expression]


@dataclass(frozen=True, slots=True)
class ProgramFunction:
    """A row. `results` gives the values from the lowered state space, or None if the program has no such function."""

    name: str
    words: str  # a sentence; `{unknowns}` stands for an addition where the run solves loops
    results: Callable[[Lowered], Results | None]
    arguments: str = FULL
    hot: bool = False  # True if it is called at every step of a run, so that its compilation is worth some time

    def description(self, lowered: Lowered) -> str:
        """The sentence for one program."""
        return self.words.format(unknowns=", then what the unknowns make vanish" * bool(lowered.space.unknowns))


def _sorted(entries: Callable[[Lowered], dict[tuple[int, int], Expression]]) -> Callable[[Lowered], Results]:
    return lambda lowered: [value for _, value in sorted(entries(lowered).items(), key=lambda item: item[0])]


def _solved(lowered: Lowered) -> Results | None:
    return None if lowered.solved is None else [*lowered.solved.rates, *lowered.solved.multipliers]


def _powers(lowered: Lowered) -> Results:
    space, values = lowered.space, lowered.values
    powers = [multiply(Number(float(p.sign)), values[p.effort], values[p.flow]) for p in space.ports]
    return [
        *powers,
        *(values[v] for v in space.stored.values()),
        *(values[v] for s in space.storages for v in s.stored),
    ]


def _power_balance(lowered: Lowered) -> Results | None:
    """Sums of the ports' powers; None if the program has no powers, or a mechanism, whose power is not that of its ports alone."""
    space, values = lowered.space, lowered.values
    if not space.ports or space.stored:
        return None

    def total(group: str, sign: float) -> Expression:
        ports = [p for p in space.ports if p.group == group]
        return add(*(multiply(Number(sign * p.sign), values[p.effort], values[p.flow]) for p in ports))

    return total("source", -1.0), total("loss", 1.0), total("storage", 1.0)


def _poles(lowered: Lowered) -> Results | None:
    return poles(() if lowered.space.states else lowered.rates, lowered.moves) or None


def _of_events(results: Callable[[LoweredEvents], Results]) -> Callable[[Lowered], Results | None]:
    return lambda lowered: results(lowered.events) if lowered.events.present else None


_ROWS = (
    # Start of a run and the equations that it solves
    ProgramFunction("start", "The state at the start, from the constants.", lambda low: low.starts, FIXED),
    ProgramFunction("nominal", "Nominal magnitudes that the author gave; 0 where there is none.",
                    lambda low: [x or Number(0.0) for x in low.nominals], FIXED),
    ProgramFunction("derivative", "The rates of the states{unknowns}.", lambda low: low.rates, hot=True),
    ProgramFunction("jacobian_entries", "The entries of the Jacobian at PATTERN: derivatives of the rates (rows) by the states (columns).",
                    _sorted(lambda low: low.jacobian), hot=True),
    ProgramFunction("output", "The outputs.", lambda low: list(low.outputs.values())),
    ProgramFunction("claims", "By how much the starts that the author gave to computed quantities are missed.", lambda low: low.claims),
    ProgramFunction("forced", "Quantities that are differentiated: none may jump.", lambda low: low.forced),
    ProgramFunction("dependent", "What storages in derivative form hold.", lambda low: low.dependents),
    ProgramFunction("sensitivities", "Slopes of what storages in derivative form hold by the states, where they change in a run.",
                    _sorted(lambda low: low.sensitivities)),
    ProgramFunction("moving_slopes", "Slopes of the rates, what must vanish, the invariants and the outputs by states, unknowns and further quantities.",
                    lambda low: [slope for _, slope in low.moving_slopes()] if low.by else None),
    ProgramFunction("solved", "The rates with the multipliers solved for, and then these.", _solved, hot=True),
    # Energies, constraints, and signals that a step must follow
    ProgramFunction("stored_energy", "All energy that is stored, and its slopes by the states.", lambda low: low.energy or None, hot=True),
    ProgramFunction("invariant", "What every state of a run keeps at zero.", lambda low: low.invariants, hot=True),
    ProgramFunction("invariant_slopes", "The slopes of the invariants by the states at INVARIANT_PATTERN.",
                    _sorted(lambda low: low.invariant_slopes), hot=True),
    ProgramFunction("signals", "What the rates read of time alone.", lambda low: low.signals, "time, inputs, constants, mode", hot=True),
    ProgramFunction("bends", "Zero where a law of states bends.", lambda low: low.bends or None, hot=True),
    ProgramFunction("peaks", "What turns where a law of states may have a narrow peak, then what may be narrow there.",
                    lambda low: low.peaks or None, hot=True),
    ProgramFunction("poles", "Divisors of the equations of loops, where there are no states.", _poles),
    ProgramFunction("powers", "Power into each port, energies of mechanisms, stored quantities: for an energy balance.", _powers),
    ProgramFunction("power_balance", "Power that sources supply, that resistors dissipate, and that storages take: the first is the sum of the others.",
                    _power_balance),
    # Instants of time events, and validity limits
    ProgramFunction("instants", "Known instants at which an expression of time jumps or bends.", lambda low: low.instants, FIXED),
    ProgramFunction("recurring", "Values at time 0, each with its slope, of functions linear in time at whose integer values an expression jumps.",
                    lambda low: [x for pair in low.recurring for x in pair] or None, FIXED),
    ProgramFunction("periods", "No step may be longer than any of these, or it would miss what changes with time.", lambda low: low.periods, FIXED),
    ProgramFunction("holds", "The truth of the limits of the model.", lambda low: [limit.condition for limit in low.limits]),
    ProgramFunction("limit_values", "What the limits of the model are about.", lambda low: [v.expression for limit in low.limits for v in limit.values]),
    ProgramFunction("crossings", "Functions of time at whose zeros an expression jumps or bends.", lambda low: low.crossings, "time, constants, mode"),
    ProgramFunction("switches", "The truth of the conditions on time.", lambda low: low.switches, "time, constants"),
    ProgramFunction("lags", "By how much delayed signals are late.", lambda low: low.lags or None, FIXED),
    ProgramFunction("delayed", "What delayed signals will be.", lambda low: low.delayed if low.lags else None),
    # Events that depend on states
    ProgramFunction("mode_start", "What only events change, at the start.", _of_events(lambda events: events.starts), FIXED),
    ProgramFunction("roots", "Conditions on states, left side less right side: each flips where this changes sign.",
                    _of_events(lambda events: [item.root for item in events.located]), hot=True),
    ProgramFunction("counts", "Whole numbers of states, as they are on the sides of integers that the conditions tell.",
                    _of_events(lambda events: [item.value for item in events.counts])),
    ProgramFunction("triggers", "The truth of the conditions of events.", _of_events(lambda events: events.triggers)),
    ProgramFunction("values", "What events set.", _of_events(lambda events: events.values)),
    ProgramFunction("targets", "What is computed from states and set by events, as it is.", _of_events(lambda events: events.targets)),
    ProgramFunction("sampling", "Of each sampled event its period, offset, delay, jitter and seed.", _of_events(lambda events: events.sampling), FIXED),
    ProgramFunction("actives", "Whether switched junctions are on.", _of_events(lambda events: events.actives)),
    ProgramFunction("conjugates", "Efforts for displacements and flows for momenta, where junctions switch.", _of_events(lambda events: events.conjugates)),
)  # fmt: skip


def functions_of(lowered: Lowered) -> Iterator[tuple[ProgramFunction, Results]]:
    """Functions that a program has, with their results."""
    for row in _ROWS:
        results = row.results(lowered)
        if results is not None:
            yield row, results


def poles(residuals: Iterable[Expression], moves: Callable[[Expression], bool]) -> tuple[Expression, ...]:
    """Return what residuals divide by that moves and may change its sign, except where a condition decides: the author may divide by no zero there."""
    found, seen, waiting = dict[Expression, None](), set[Expression](), list(residuals)
    while waiting:
        node = waiting.pop()
        if node in seen or not isinstance(node, Apply) or node.operator == "select" or not moves(node):
            continue
        seen.add(node)
        waiting += node.operands
        match node:
            case Apply(operator="divide", operands=(_, below)):
                found[below] = None
            case Apply(operator="power", operands=(below, Number(value=n))) if n < 0 and n % 2 == 1:
                found[below] = None
            case Apply(operator="tan", operands=(x,)):
                found[call("cos", x)] = None
    return tuple(x for x in found if moves(x) and not never_negative(x))
