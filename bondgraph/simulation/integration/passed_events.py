"""Events that the loop over steps passes in machine code, and what Python then has to know of them: see `acceptance/event_passing.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC, SOLVERS, Array, Program, zeros_of

from ..events.events import EventInstant, Events
from ..integrators.acceptance.event_passing import KNOWN, ROOM, EventWorkspace
from ..integrators.acceptance.first_crossing import FOUND
from ..integrators.compiled.record_layout import RecordArray, form_of
from ..integrators.methods import METHODS
from ..monitors import step_size_diagnosis
from ..segments.timeline import Segment, mode_size

if TYPE_CHECKING:
    from ..integrators.compiled.run import CompiledMethod
    from .integration_state import IntegrationState

TOTALS = {"derivative": "derivatives", "jacobian": "jacobians", "factorisation": "factorisations"}


def _room(program: Program, events: Events) -> dict[str, Any]:
    """Return the fields that depend on the program alone."""
    hybrid = events.hybrid
    settings = [(number, s) for number, event in enumerate(hybrid.events) for s in event.settings]
    tables = {
        "stops": [e.stops or e.sampled for e in hybrid.events], "owner": [number for number, _ in settings],
        "position": [s.position for _, s in settings], "is_mode": [s.kind == "mode" for _, s in settings],
    }  # fmt: skip
    return zeros_of(
        EventWorkspace, mode_size=mode_size(program, events.constants), event_count=len(hybrid.events), setting_count=len(settings),
        junction_count=len(hybrid.junctions), root_count=len(hybrid.conditions), n=len(program.states.names),
    ) | {name: np.array(values, dtype=np.int64) for name, values in tables.items()}  # fmt: skip


def is_passable(stepper: IntegrationState) -> bool:
    """Return True if machine code may pass the usual events of a run: nothing but states, modes and conditions changes at them, and nobody looks on."""
    program, events = stepper.program, stepper.events
    if events is None or events.valves is not None or program.native is None or not len(events.places):
        return False
    hybrid = events.hybrid
    looks_on = stepper.powers is not None or stepper.extremes is not None or stepper.history is not None
    looks_on = looks_on or bool(stepper.choice) or program.watched or events.bounds is not None
    ties = bool(program.unknowns.names) or bool(stepper.constraints) or bool(program.jumping.names)
    special = bool(events.counted) or hybrid.switches_signals
    computed = any(s.kind == "computed" for event in hybrid.events for s in event.settings)
    return not (looks_on or ties or special or computed) and len(set(events.keys)) == len(events.keys)


def _method_in_any_mode(stepper: IntegrationState) -> int:
    """Return the method that goes on in a mode that has not been examined, if no mode would be; else -1."""
    if stepper.solver != AUTOMATIC:
        return -1 if SOLVERS[stepper.solver].exact else METHODS.index(SOLVERS[stepper.solver])
    return -1 if stepper.result.settled is None else stepper.result.settled


def _marked(rows: Array) -> list[tuple[int, ...]]:
    """Return the places of each row, shape (rows, places), that are not zero."""
    places: dict[bytes, tuple[int, ...]] = {}  # most events are alike
    block, width = rows.tobytes(), rows.strides[0]
    keys = [block[k * width : (k + 1) * width] for k in range(len(rows))]
    for key, row in zip(keys, rows, strict=True):
        if key not in places:
            places[key] = tuple(row.nonzero()[0].tolist())
    return [places[key] for key in keys]


class PassedEvents:
    """Record of the events of a run that machine code passes, beside the solver."""

    def __init__(self, stepper: IntegrationState, solver: CompiledMethod) -> None:
        program, events = stepper.program, stepper.events
        assert events is not None
        self.stepper, self.events, self.solver = stepper, events, solver
        fields = {
            "solver": solver.values, "conditions": events.record, "many": step_size_diagnosis.MANY, "automatic": int(stepper.solver == AUTOMATIC),
        }  # fmt: skip
        self.values = RecordArray(form_of(EventWorkspace, program, "", lambda: _room(program, events)), fields)
        self.record = self.values.record
        names = [name for name, _ in events.hybrid.junctions]
        self.values["is_active"][:] = [name not in stepper.off for name in names]

    def begin(self, mode: Any, method: int) -> None:
        """Take note of the method with which Python has begun a segment in a mode."""
        record, values, size = self.record, self.values, self.record.mode_size
        record.otherwise = _method_in_any_mode(self.stepper)
        if record.otherwise >= 0:
            record.known_count = 0
        elif record.known_count < KNOWN:
            here = record.known_count
            values["known_mode"][here * size : (here + 1) * size] = mode
            values["known_method"][here] = method
            record.known_count += 1

    def hand_over(self) -> None:
        """Put what Python knows of the events into the record."""
        events, record, values = self.events, self.record, self.values
        values["on"][:] = [events.on.get(key, False) for key in events.keys]
        values["left"][:] = [events.left.get(key, 0) for key in events.keys]
        record.recent = events.log[-1].time if events.log else -np.inf
        record.most_events = self.stepper.most_events - len(events.log)

    def advance(self, most: int) -> int:
        """Make steps, through events; see `compiled/advance.py`."""
        return self.values.call("advance_through", most)

    def take_over(self) -> Segment:
        """Tell the integrator what has happened since `hand_over`; return its present segment."""
        stepper, events, record, values = self.stepper, self.events, self.record, self.values
        events.last = None  # the record of the conditions has been used
        self.solver.forget_mode()
        if not record.logged:
            return stepper.piece
        modes = [*values["log_mode"].reshape(ROOM, -1)[: record.logged].copy()]
        crossed, acted = (_marked(values[n].reshape(ROOM, -1)[: record.logged]) for n in ("log_crossed", "log_acted"))
        kinds, times = (values[n][: record.logged].tolist() for n in ("log_kind", "log_time"))
        piece, log = stepper.piece, zip(kinds, times, crossed, acted, strict=True)
        starts, before = [piece.start, *times[:-1]], [piece.mode, *modes[:-1]]
        stepper.result.pieces += [Segment(a, b, mode) for a, b, mode in zip(starts, times, before, strict=True)]
        events.log += [EventInstant(time, zeros, acts) for kind, time, zeros, acts in log if kind == FOUND]
        stepper.piece = Segment(times[-1], piece.stop, modes[-1], piece.resolution)
        stepper.mode = modes[-1]
        events.on |= dict(zip(events.keys, (values["on"] != 0).tolist(), strict=True))
        events.left |= dict(zip(events.keys, values["left"].tolist(), strict=True))
        record.logged = 0
        if record.passed:
            self._count_passed()
        return stepper.piece

    def _count_passed(self) -> None:
        """Count the steps of segments that have ended, and keep a checkpoint at the start of the last one."""
        stepper, record, values = self.stepper, self.record, self.values
        self.events.floor = self.solver.values["root_floor"].copy()
        stepper.steps += record.steps
        stepper.result.steps += record.steps
        stepper.count({kind: getattr(record, name) for kind, name in TOTALS.items()})
        stepper.grow(values["peak"].copy())
        stepper.position = record.begun_position
        stepper.keep(record.begun, values["begun_state"].copy(), stepper.mode, stepper.piece.start)
        for name in ("passed", "steps", *TOTALS.values()):
            setattr(record, name, 0)
