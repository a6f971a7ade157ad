"""Image of an instance: the block of memory with which each instance of a unit begins, and the data that the interface reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import FLOATS, INTS, Fields, Record, record_of

from ..simulation.integrators.compiled.fields import given_at, room_of
from ..simulation.integrators.compiled.record_layout import RecordLayout
from ..simulation.integrators.methods import EXPLICIT, RADAU
from ..simulation.segments.context import SegmentContext
from ..simulation.segments.timeline import Segment, Signals
from .runtime.events import KEPT
from .runtime.instance import FmuInstance
from .runtime.segment import COLUMNS

if TYPE_CHECKING:
    from compiler.api import Hybrid, LibraryModule, Program

    from .start import StartValues

# Fields of an instance that are functions of the program under another name.
NAMES = {
    "find_constants": "constants", "find_start": "start", "find_instants": "instants", "find_recurring": "recurring", "find_periods": "periods",
    "find_switches": "switches", "find_output": "output", "find_slopes": "slopes", "find_limits": "limit_values",
    "entries": "jacobian_entries", "find_modes": "mode_start", "find_counts": "counts", "find_triggers": "triggers", "find_values": "values",
    "find_sampling": "sampling",
}  # fmt: skip
FUNCTIONS = (
    "constants", "start", "derivative", "jacobian_entries", "output", "instants", "periods", "switches", "holds", "limit_values", "bends", "peaks",
    "recurring", "mode_start", "roots", "counts", "triggers", "values", "sampling",
)  # fmt: skip
NOW = Segment(0.0, 1.0, np.empty(0))


@dataclass(frozen=True, slots=True)
class ModelImage:
    """Words of a block, its beginning, indices of the words that are addresses within it, and functions by their words."""

    size: int
    head: tuple[int, ...]
    inside: tuple[int, ...]
    functions: tuple[tuple[int, str], ...]

    def words(self, token: str) -> tuple[int, ...]:
        """Return the words that a library has of a model: see `runtime/memory.py`."""
        return (self.size, len(self.head), len(self.inside), *self.head, *self.inside, *token.encode(), 0)


def image_of(program: Program, module: LibraryModule, values: StartValues) -> ModelImage:
    """Return the image of the instances of a program."""
    form = RecordLayout(FmuInstance, _complete(record_of(FmuInstance), _fields(program, module, values)), {})
    functions = tuple((at, NAMES.get(field, field)) for at, field in form.functions)
    connected = tuple((at, name) for at, name in functions if name in module.counts)
    inside = [*form.inside.tolist(), *(at for at, _ in functions)]
    return ModelImage(form.size, tuple(form.head.tolist()), tuple(inside), connected)


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
            result[name] = _complete(kind, vars(inner) if isinstance(inner, Record) else inner)
        elif kind in (FLOATS, INTS):
            result.setdefault(name, np.zeros(0))
    return result


def _fields(program: Program, module: LibraryModule, values: StartValues) -> dict[str, Any]:
    """Return the fields of an instance; those that are not named begin as 0."""
    counts, n, hybrid = module.counts, len(program.states.names), program.hybrid
    recurring = counts.get("recurring", 0)
    timed = range(counts["switches"]) if hybrid is None else hybrid.timed
    slopes, limits = module.slopes, program.limits
    places = np.cumsum([0, *(len(note.values) for note in limits)])
    return {
        "solver": _solver(program, counts, values), "events": None if hybrid is None else _events(hybrid, n), "has_events": int(hybrid is not None),
        "parameter_count": len(values.parameters), "input_count": len(values.inputs), "output_count": counts["output"],
        "instant_count": counts["instants"], "period_count": counts["periods"], "recurring_count": recurring, "recurring": np.zeros(recurring),
        "mode_count": counts["switches"],
        "timed": np.array(timed, dtype=np.int64), "switches": np.zeros(counts["switches"]),
        "slope_count": len(slopes), "parameters": np.array(values.parameters, dtype=float), "state": np.zeros(n),
        "is_set": _whole(n), "starts": np.zeros(n), "rates": np.zeros(n), "outputs": np.zeros(counts["output"]),
        "instants": np.zeros(counts["instants"]), "periods": np.zeros(counts["periods"]),
        "slope_rows": np.array([row for row, _ in slopes], dtype=np.int64),
        "slope_columns": np.array([column for _, column in slopes], dtype=np.int64), "slopes": np.zeros(len(slopes)),
        "seed": np.zeros(n + len(values.inputs)),
        "is_table": np.array([note.kind == "table" for note in limits], dtype=np.int64), "limit_place": places[:-1].astype(np.int64),
        "limit_values": np.zeros(int(places[-1])), "relative": values.tolerances.relative,
        "own_method": EXPLICIT if program.bends is None else RADAU,
    }  # fmt: skip


def _solver(program: Program, counts: Mapping[str, int], values: StartValues) -> dict[str, Any]:
    """Return the fields of the workspace of the integration."""
    nothing = np.zeros(0)
    constants = np.zeros(counts["constants"])
    context = SegmentContext(program, constants, np.array(values.inputs, dtype=float), nothing, values.tolerances)
    signals = Signals(nothing, nothing, np.zeros((0, 0)), True)
    at_start = given_at(context, NOW, values.state, np.inf, signals)
    room = room_of(program, EXPLICIT, 0, counts.get("bends", 0), counts.get("peaks", 0))
    mode = {"mode": np.zeros(counts["switches"] if program.hybrid is None else program.hybrid.size), "root_narrow": 0}
    checked = {"limit_count": len(program.limits)}  # those of parameters alone too: whoever holds the unit may set them
    return room | at_start | mode | checked | {"closed": {}, "redundant": 0, "pattern": {"n": len(values.state)}}


def _events(hybrid: Hybrid, n: int) -> dict[str, Any]:
    """Return the fields of the events."""
    conditions, events = hybrid.conditions, hybrid.events
    settings = [(i, s) for i, event in enumerate(events) for s in event.settings]
    sampled = [i for i, event in enumerate(events) if event.sampled]
    m, c = len(conditions), len(events)
    lists = {
        "counted": hybrid.counted,
        "stops": [e.stops for e in events], "late": [e.late for e in events], "owner": [i for i, _ in settings],
        "position": [s.position for _, s in settings], "is_mode": [s.kind == "mode" for _, s in settings], "sampled": sampled,
    }  # fmt: skip
    whole = dict.fromkeys(("at_once", "was_true", "due", "acts", "acted", "left"), c)
    whole |= dict.fromkeys(("flips", "crossed"), m) | {"is_set": len(hybrid.modes.names)}
    sizes = {
        "floor": m,
        "counts": len(hybrid.counted), "starts": len(hybrid.modes.names), "values": len(settings), "sampling": COLUMNS * len(sampled),
        "number": len(sampled), "triggers": c, "when": c, "intervals": KEPT * c,
    }  # fmt: skip
    indicators: dict[str, Any] = {name: np.zeros(m) for name in ("root", "noise", "moved", "change", "again", "seen")}
    indicators |= {name: _whole(m) for name in ("truth", "sought")}
    indicators |= {name: np.zeros(n) for name in ("rate", "later", "slope")}
    indicators |= {"n": n, "count": n, "root_count": m, "bracket": {}}
    of_conditions = {"places": [x.position for x in conditions], "steers": [x.steers for x in conditions]}
    indicators |= {name: np.array(values, dtype=np.int64) for name, values in of_conditions.items()}
    return {
        "conditions": indicators,
        "discrete_count": len(hybrid.modes.names), "counted_count": len(hybrid.counted), "event_count": c, "setting_count": len(settings),
        "sample_count": len(sampled), **{k: np.array(v, dtype=np.int64) for k, v in lists.items()},
        **{k: _whole(v) for k, v in whole.items()}, **{k: np.zeros(v) for k, v in sizes.items()},
    }  # fmt: skip


def _whole(count: int) -> Any:
    return np.zeros(count, dtype=np.int64)
