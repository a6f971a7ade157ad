"""Image of an instance: the block of memory with which each instance of a unit begins, and the data that the interface reads.

Among these are sentences by which a unit tells an importer why it refuses something; the numbers are those of `runtime/instance.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import FLOATS, INTS, Fields, LimitNote, record_of, zeros_of

from ..simulation.integrators.acceptance.event_indicators import IndicatorWorkspace
from ..simulation.integrators.acceptance.first_crossing import MOST_PARTS
from ..simulation.integrators.compiled.constraint_functions import fields_of
from ..simulation.integrators.compiled.fields import given_at, room_of
from ..simulation.integrators.compiled.record_layout import RecordLayout
from ..simulation.integrators.linear_algebra.factors import Factors
from ..simulation.integrators.methods import EXPLICIT, RADAU
from ..simulation.loops.loops import LoopSolver
from ..simulation.segments.timeline import Segment, Signals
from ..simulation.segments.trajectory import SegmentContext
from .runtime import instance
from .runtime.instance import EventData, FmuInstance

if TYPE_CHECKING:
    from compiler.api import Hybrid, LibraryModule, Program

    from .start import StartValues

# Fields of an instance that are functions of the program under another name.
NAMES = {
    "find_constants": "constants", "find_start": "start", "find_instants": "instants", "find_recurring": "recurring", "find_periods": "periods",
    "find_switches": "switches", "find_output": "output", "find_slopes": "slopes", "find_limits": "limit_values",
    "entries": "jacobian_entries", "find_modes": "mode_start", "find_counts": "counts", "find_triggers": "triggers", "find_values": "values",
    "find_sampling": "sampling", "find_claims": "claims", "solve": "completed",
}  # fmt: skip
FUNCTIONS = (
    "constants", "start", "derivative", "jacobian_entries", "output", "instants", "periods", "switches", "holds", "limit_values", "bends", "peaks",
    "recurring", "mode_start", "roots", "counts", "triggers", "values", "sampling", "solved", "invariant", "invariant_slopes", "claims",
)  # fmt: skip
NOW = Segment(0.0, 1.0, np.empty(0))
_SENTENCES = {
    instance.NO_VALUE: "There is no such value reference, or it cannot be set.",
    instance.NOT_NOW: "This is not possible in this state of the instance.",
    instance.TOO_MANY_STEPS: "The communication step needs too many steps: make it shorter.",
    instance.NO_STEP: "No step is short enough for the tolerance: the values grow without bound, or the model is singular here.",
    instance.NOT_FINITE: "A value or a rate is not finite.",
    instance.WRONG_TIME: "The communication point is not the time that the instance has reached.",
    instance.NO_SLOPE: "There are directional derivatives of outputs and rates by inputs and states alone.",
    instance.SLIDES: "Conditions can neither hold nor fail: either side leads back to the other. Give the model a mode that sticks, or a smooth law.",
    instance.WITHOUT_END: "Events cause each other without end.",
    instance.PILED_UP: "Events accumulate: end them by a mode that an event sets where little is left.",
    instance.SET_TWICE: "Two events set one quantity at one instant.",
    instance.WRONG_SAMPLING: "The period, offset, delay, jitter or seed of a sampled event is out of its range.",
    instance.CROWDED: "A condition changes too often within a step to be followed: it may be nothing but the rounding of terms that cancel.",
    instance.SINGULAR: "The mechanism comes to a singular pose: its constraints depend on each other there, and it may go on in several ways.",
    instance.OPEN: "The loops of the mechanism are not closed with these values: set the starts of all its states so that they are.",
    instance.NO_SOLUTION: "An algebraic loop has no solution near the last one.",
    instance.NO_TRUTH: "What a condition compares has no value: a root or a logarithm of a negative number, say.",
    instance.MISSED_RATES: "A step has missed rates: a law is so steep, as a root at zero, that its slope tells nothing of where the solution is.",
    instance.ENDED: "An event has ended the run.",
}  # fmt: skip
MESSAGES = tuple(_SENTENCES.get(number, "") for number in range(instance.LIMITS))
# Kinds of limits, in the order of their numbers, and sentences on them.
_LIMITS = {
    "require": "The requirement `{0.words}` (line {0.span.line}) does not hold any more.",
    "table": "The table `{0.words}(...)` of `{0.owner}` (line {0.span.line}) is asked outside of its range.",
    "start": "With these parameters the model has no meaning: {0.words} is out of its range.",
}
KINDS = tuple(_LIMITS)


@dataclass(frozen=True, slots=True)
class ModelImage:
    """Words of a block, its beginning, indices of the words that are addresses within it, and functions by their words."""

    size: int
    head: tuple[int, ...]
    inside: tuple[int, ...]
    functions: tuple[tuple[int, str], ...]
    sentences: tuple[str, ...]  # by the numbers of messages

    def words(self, token: str) -> tuple[int, ...]:
        """Return the words that a library has of a model: see `runtime/memory.py`."""
        return (self.size, len(self.head), len(self.inside), *self.head, *self.inside, *token.encode(), 0)


def image_of(program: Program, module: LibraryModule, values: StartValues) -> ModelImage:
    """Return the image of the instances of a program."""
    form = RecordLayout(FmuInstance, _complete(record_of(FmuInstance), _fields(program, module, values)), {})
    functions = tuple((at, NAMES.get(field, field)) for at, field in form.functions)
    connected = tuple((at, name) for at, name in functions if name in module.counts)
    inside = [*form.inside.tolist(), *(at for at, _ in functions)]
    sentences = (*MESSAGES, *(sentence_of(note) for note in program.limits))
    return ModelImage(form.size, tuple(form.head.tolist()), tuple(inside), connected, sentences)


def _complete(record: Fields, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a record with empty ones for the records and arrays that are not among them, so that no address is missing.

    One that is None has no address.
    """
    result = dict(values)
    for name, kind in record.fields.items():
        if values.get(name, ...) is None:
            del result[name]
        elif isinstance(kind, Fields):
            inner = values.get(name, {})
            result[name] = _complete(kind, inner)
        elif kind in (FLOATS, INTS):
            result.setdefault(name, np.zeros(0))
    return result


def _fields(program: Program, module: LibraryModule, values: StartValues) -> dict[str, Any]:
    """Return the fields of an instance."""
    counts, hybrid, constants = module.counts, program.hybrid, program.constants(values.parameters)
    differential, unknowns = len(program.states.names), len(program.unknowns.names)
    n, solved = differential + unknowns, unknowns == len(program.eliminated)
    loops = LoopSolver(program, constants, values.inputs, values.tolerances.magnitude)
    timed = range(counts["switches"]) if hybrid is None else hybrid.timed
    slopes, limits = module.slopes, program.limits
    places = np.cumsum([0, *(len(note.values) for note in limits)])
    return zeros_of(
        FmuInstance, n=n, has_events=int(hybrid is not None), parameter_count=len(values.parameters), input_count=len(values.inputs),
        output_count=counts["output"], instant_count=counts["instants"], period_count=counts["periods"], recurring_count=counts.get("recurring", 0),
        mode_count=counts["switches"], slope_count=len(slopes), seeds=n + len(values.inputs), limit_numbers=int(places[-1]),
        own_method=EXPLICIT if program.bends is None and solved else RADAU, claim_count=counts.get("claims", 0),
    ) | {
        "solver": _solver(program, counts, values), "written": values.written, "assembled": values.state,
        "claimed": program.claims(0.0, values.state, values.inputs, constants, np.zeros(counts["switches"])) if "claims" in counts else np.zeros(0),
        "parts": _whole(p for p in program.parts if p >= 0), "part_count": sum(p >= 0 for p in program.parts),
        "loops": {} if solved else loops.room(np.arange(unknowns)) | {"magnitude": loops.magnitude, "unknown": int(loops.unknown), "state": np.zeros(n)},
        "behind": zeros_of(Factors, n=unknowns), "events": None if hybrid is None else _events(hybrid, n, differential), "relative": values.tolerances.relative,
        "parameters": np.array(values.parameters, dtype=float), "timed": _whole(timed), "slope_rows": _whole(row for row, _ in slopes),
        "slope_columns": _whole(column for _, column in slopes), "limit_kind": _whole(KINDS.index(note.kind) for note in limits),
        "limit_place": _whole(places[:-1]),
    }  # fmt: skip


def _solver(program: Program, counts: Mapping[str, int], values: StartValues) -> dict[str, Any]:
    """Return the fields of the workspace of the integration."""
    nothing = np.zeros(0)
    constants = np.zeros(counts["constants"])
    context = SegmentContext(program, constants, np.array(values.inputs, dtype=float), nothing, values.tolerances)
    signals = Signals(nothing, nothing, np.zeros((0, 0)), True)
    at_start = given_at(context, NOW, values.state, np.inf, signals)
    room = room_of(program, EXPLICIT, 0, counts.get("bends", 0), counts.get("peaks", 0), dense=True)
    magnitude, closed = np.asarray(values.tolerances.magnitude, dtype=float), {}
    if program.invariants.names:
        own = program.constants(values.parameters)
        closed = fields_of(program, nothing, own, magnitude, values.taking) | {"constants": nothing, "mode": nothing}
    redundant = int(not values.taking[: closed.get("gaps", 0)].all())
    mode = {"mode": np.zeros(counts["switches"] if program.hybrid is None else program.hybrid.size), "root_narrow": 0}
    checked = {"limit_count": len(program.limits)}  # those of parameters alone too: whoever holds the unit may set them
    pattern = {"n": len(values.state)}
    return room | at_start | mode | checked | {"closed": closed, "redundant": redundant, "pattern": pattern}


def _events(hybrid: Hybrid, n: int, differential: int) -> dict[str, Any]:
    """Return the fields of the events."""
    conditions, events = hybrid.conditions, hybrid.events
    settings = [(i, s) for i, event in enumerate(events) for s in event.settings]
    sampled = [i for i, event in enumerate(events) if event.sampled]
    m = len(conditions)
    indicators = zeros_of(IndicatorWorkspace, n=n, count=differential, root_count=m) | {
        "bracket": {}, "spacing": np.inf, "most_parts": MOST_PARTS, "places": _whole(x.position for x in conditions),
        "steers": _whole(x.steers for x in conditions),
    }  # fmt: skip
    return zeros_of(
        EventData, discrete_count=len(hybrid.modes.names), counted_count=len(hybrid.counted), event_count=len(events), setting_count=len(settings),
        sample_count=len(sampled), root_count=m,
    ) | {
        "conditions": indicators, "counted": _whole(hybrid.counted), "stops": _whole(e.stops for e in events), "late": _whole(e.late for e in events),
        "owner": _whole(i for i, _ in settings), "position": _whole(s.position for _, s in settings),
        "is_mode": _whole(s.kind == "mode" for _, s in settings), "sampled": _whole(sampled),
    }  # fmt: skip


def _whole(numbers: Iterable[int]) -> Any:
    return np.array([*numbers], dtype=np.int64)


def sentence_of(note: LimitNote) -> str:
    """Return the sentence by which a unit tells an importer that a limit is left."""
    return _LIMITS[note.kind].format(note)
