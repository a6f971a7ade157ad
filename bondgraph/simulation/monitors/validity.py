"""Limits of a model in a run: ranges of tables, and requirements of the model.

They are checked where the run is accepted: at the stages and ends of the integrator's steps and at every reported instant; those of parameters alone
at its start. The first instant
of a violation is found by bisection on the dense output.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from compiler.api import Array, LimitNote, Program

from ...errors import RunFailed
from ...quantities import behind
from ...results.records import LimitLeft

BISECTIONS = 60

StateAt = Callable[[Any], Any]  # instants (k,) -> states (k, n)


def _places(program: Program) -> list[slice]:
    """Return the places of the values of each limit."""
    ends = accumulate((len(note.values) for note in program.limits), initial=0)
    places = program.kept["places of limits"] = [slice(a, b) for a, b in pairwise(ends)]
    return places


class ValidityMonitor:
    """Monitor of a program's limits during a run."""

    def __init__(self, program: Program, constants: Array, inputs: Array, rtol: float) -> None:
        self.program, self.fixed, self.rtol = program, (inputs, constants), rtol
        self.left: dict[int, LimitLeft] = {}
        self.moves, self.begun = program.watched, False
        places: list[slice] | None = program.kept.get("places of limits")
        self.places = _places(program) if places is None else places

    @property
    def warnings(self) -> tuple[LimitLeft, ...]:
        """Violated limits, in the order of time."""
        return tuple(sorted(self.left.values(), key=lambda item: item.time)) if self.left else ()

    def look(self, times: Array, mode: Array, state_at: StateAt, tables: bool = True) -> None:
        """Check rising instants of one smooth segment; the limits held before the first of them, or a run begins there.

        `tables`: True to check the ranges of tables too. Raises `RunFailed` for a table that is read outside its range.
        """
        if not self.program.limits or (self.begun and not self.moves):
            return
        self.begun = True
        truth = self._holds(times, state_at(times), mode)
        if truth.all():
            return
        found = []
        for number in np.flatnonzero(~truth.all(axis=0)):
            if int(number) not in self.left and (tables or self.program.limits[number].kind != "table"):
                first = int(np.argmin(truth[:, number]))
                before = times[first - 1] if first else times[first]
                found.append(
                    (self._bisected(int(number), float(before), float(times[first]), mode, state_at), int(number))
                )
        for time, limit in sorted(found):
            self._leave(limit, time, mode, state_at)

    def _holds(self, times: Array, states: Array, mode: Array) -> Any:
        """Return the truth of all limits; shape (times, limits)."""
        truth = self.program.holds(times, states, *self.fixed, mode) == 1.0
        if not truth.all():
            values = self.program.limit_values(times, states, *self.fixed, mode)
            for number, note in enumerate(self.program.limits):
                if note.kind == "table":  # a distance beyond an end within the run's own tolerance is accepted
                    x, low, high = values[:, self.places[number]].T
                    beyond = np.maximum(low - x, x - high)
                    truth[:, number] |= beyond <= self.rtol * (high - low)
        return truth

    def _bisected(self, number: int, good: float, bad: float, mode: Array, state_at: StateAt) -> float:
        """Return the first instant at which a limit does not hold, between one where it holds and one where it does not."""
        for _ in range(BISECTIONS):
            middle = 0.5 * (good + bad)
            if not good < middle < bad:
                break
            if self._holds(np.array([middle]), state_at(np.array([middle])), mode)[0, number]:
                good = middle
            else:
                bad = middle
        return float(bad)

    def _leave(self, number: int, time: float, mode: Array, state_at: StateAt) -> None:
        note = self.program.limits[number]
        at = np.array([time])
        values = self.program.limit_values(at, state_at(at), *self.fixed, mode)[0, self.places[number]]
        shown = tuple((name, float(v), unit) for (name, unit), v in zip(note.values, values, strict=True))
        if note.kind == "table":
            raise _outside(note, time, shown)
        stands = note.stands.file_and_line if note.stands is not None else ""
        left = LimitLeft(time, note.owner, note.words, note.text, shown, note.span.file_and_line, stands)
        self.left[number] = left


def _outside(note: LimitNote, time: float, values: tuple[tuple[str, float, str], ...]) -> RunFailed:
    (name, value, unit), (_, low, _), (_, high, _) = values
    suffix = behind(unit)
    asked = f"at {name} = {value:.9g}{suffix}" if unit else f"at {value:.9g} (SI)"
    kind = "a table" if note.words == "inverse" else f"the table `{note.words}(…)`"
    return RunFailed(
        "BR747", f"at t = {time:.9g} s {kind} of `{note.owner}` ({note.span.file_and_line}) is asked {asked}, but it goes from "
        f"{low:.9g} to {high:.9g}{suffix};", "give it more points, or keep what it is asked at within its ends (min, max)",
    )  # fmt: skip
