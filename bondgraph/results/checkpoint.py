"""Checkpoint of a run, from which another run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

HISTORY, STARTS, STOPS = "past of delayed signals", "starts of that past", "stops of that past"  # arrays of a file


@dataclass(frozen=True, slots=True, eq=False)
class DelayHistory:
    """History of delayed signals: on each [start, stop], a polynomial per signal."""

    names: tuple[str, ...]
    starts: list[float]
    stops: list[float]
    pieces: list[Any]  # (degree + 1, signals)
    cuts: list[float]  # instants at which a delayed signal will jump
    first: Any  # values before the run
    last: Any


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Checkpoint at the end of a run, by the author's names, in SI.

    `identity`: that of the equations; `until`: planned end of the run, up to which `magnitudes` are valid.
    """

    identity: str
    parameters: Mapping[str, float]
    time: float
    until: float
    stored: Mapping[str, float]  # states and storages that depend on them
    peaks: Mapping[str, float]  # their largest values so far
    unknowns: Mapping[str, float]  # unknowns of algebraic loops
    magnitudes: Mapping[str, float]
    modes: Mapping[str, float]  # discrete variables that only events change
    on: tuple[tuple[str, int, bool], ...]  # instance and place of each event, and truth of its condition
    off: tuple[str, ...]  # junctions that are off
    preferences: tuple[tuple[str, str], ...]  # storage -> integral or derivative
    past: DelayHistory | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the values other than arrays; `read_checkpoint` reads them."""
        told: dict[str, Any] = {"end": {f.name: getattr(self, f.name) for f in fields(self) if f.name != "past"}}
        if self.past is not None:
            first, last = list(map(float, self.past.first)), list(map(float, self.past.last))
            told["past"] = {"names": self.past.names, "cuts": self.past.cuts, "first": first, "last": last}
        return told

    def arrays(self) -> dict[str, Any]:
        """Return the arrays for a file."""
        import numpy as np

        past = self.past
        if past is None:
            return {}
        return {HISTORY: np.array(past.pieces), STARTS: np.array(past.starts), STOPS: np.array(past.stops)}


def read_checkpoint(told: Mapping[str, Any], arrays: Mapping[str, Any]) -> Checkpoint | None:
    """Return a checkpoint from the values and arrays of a file."""
    import numpy as np

    end = told["end"]
    if end is None:
        return None
    past = None
    if "past" in told:
        kept = told["past"]
        past = DelayHistory(
            tuple(kept["names"]), list(map(float, arrays[STARTS])), list(map(float, arrays[STOPS])), list(arrays[HISTORY]),
            kept["cuts"], np.array(kept["first"], dtype=float), np.array(kept["last"], dtype=float),
        )  # fmt: skip
    pairs = {name: tuple(map(tuple, end[name])) for name in ("on", "preferences")}
    return Checkpoint(**end | pairs | {"off": tuple(end["off"]), "past": past})
