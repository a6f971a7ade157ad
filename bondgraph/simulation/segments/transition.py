"""Phase transition: data of a run at the instant at which another program goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ...results.checkpoint import DelayHistory
    from .units import CoSimulatedUnits


@dataclass(frozen=True, slots=True)
class PhaseTransition:
    """The instant, all stored quantities, and the reason, from which another program can go on.

    Either two storages are exchanged, or junctions switch, or the run ended there and is to be resumed.
    """

    time: float
    stored: Mapping[str, float]  # by name: states and dependent storages
    peaks: Mapping[str, float]  # their largest values so far
    dependent: str = ""  # the element that was in derivative form
    state: str = ""  # the element that was a state
    off: tuple[str, ...] | None = None  # the junctions that are off from now on; None: as before
    modes: Mapping[str, float] = field(default_factory=dict)  # by name: discrete variables that only events change
    on: Mapping[tuple[str, int], bool] = field(default_factory=dict)  # truth of the events' conditions
    past: DelayHistory | None = None  # history of delayed signals
    magnitudes: Mapping[str, float] = field(default_factory=dict)  # magnitudes of states and unknowns
    guessed: frozenset[str] = frozenset()  # those of states that nothing has moved
    unknowns: Mapping[str, float] = field(default_factory=dict)  # unknowns of loops
    units: CoSimulatedUnits | None = None  # imported ones, within a run
    left: tuple[Any, Any] | None = None  # the events that switched junctions, and the hybrid state before them
