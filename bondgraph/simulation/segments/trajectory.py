"""Input and output of an integrator: its unchanging data, tolerances, checkpoints, the trajectory, and the transition to another program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from compiler.api import SOLVERS, Array, Program, dataclass

from .timeline import Segment

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


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative tolerance, and absolute tolerance and magnitude per state, in SI; shape (n,).

    `held` marks the absolute tolerances that the author gave; the others grow with a state that exceeds its magnitude. `guessed` marks magnitudes
    of what nothing has moved.
    """

    relative: float
    absolute: Any
    magnitude: Any
    held: Any
    guessed: Any = False
    kept: dict[object, Any] = field(
        default_factory=dict, compare=False
    )  # what steps with them leave to other phases of the program

    @property
    def scaled(self) -> Any:
        """Absolute tolerances of the states divided by their magnitudes, as the solver uses them."""
        return self.absolute / self.magnitude


@dataclass(frozen=True, slots=True)
class Kept:
    """Checkpoint of a run after an accepted step: data to go on from there, and to discard the results of later steps."""

    time: float
    state: Any  # with the unknowns of loops; shape (n,)
    mode: Any
    begun: float  # where the current piece begins
    position: int  # number of reported instants that have been passed
    pieces: int  # number of finished segments
    jumps: int  # number of jumps of energy
    happened: int  # number of events in the log
    remembered: int  # number of steps whose delayed signals are stored
    work: Any
    on: Mapping[tuple[str, int], bool]  # conditions of events, with their truth values


@dataclass(frozen=True, slots=True)
class SingularPose:
    """A singular pose that the run has passed."""

    time: float
    lost: int  # number of constraints without effect there
    joints: tuple[str, ...]
    rounding: float = 0.0  # that is left of the crossing, in magnitudes; 0 where the tolerance covers it


@dataclass(slots=True)
class Trajectory:
    """States at the requested instants, and statistics of the integrator."""

    states: Any  # (points, n)
    steps: int = 0
    evaluations: dict[str, int] = field(default_factory=dict)
    work: Any = None  # integral of the powers, if asked
    final: Any = None
    rounded: float = 0.0  # the most tolerances of rounding that a step was accepted with
    missed: Any = 0.0  # most tolerances by which rates that a step has missed would move each state
    poses: list[SingularPose] = field(default_factory=list)  # singular poses passed on the way
    # transition at which the phase ends: other states are integrated from there on
    handover: PhaseTransition | None = None
    stopped: float | None = None  # the instant at which a condition of the experiment has ended the run
    settled: int | None = None  # the method kept for all further segments, and for the next phase of this program
    solvers: dict[str, None] = field(default_factory=dict)  # used, in the order of their first use
    pieces: list[Segment] = field(default_factory=list)  # the segments, with their modes, as they were integrated
    peak: Any = None  # the largest magnitudes on the way
    notes: list[str] = field(default_factory=list)  # on the causes of short steps
    # powers and stored energies, before and after each event
    jumps: list[tuple[Any, Any]] = field(default_factory=list)
    kept: Kept | None = None  # after the last accepted step

    @property
    def exact(self) -> bool:
        """True if all steps are matrix exponentials."""
        return list(self.solvers) == [SOLVERS["exponential"].name]

    def cut(self, stretches: Sequence[Segment]) -> Kept | None:
        """Keep only the part before the last accepted step and return its checkpoint, or None if no step was accepted.

        An exception may leave the step after it half processed.
        """
        kept = self.kept
        if kept is None:
            self.states = self.states[:0]
            return None
        self.states, self.work, self.final = self.states[: kept.position], kept.work, kept.state
        self.jumps = self.jumps[: kept.jumps]
        if self.pieces or kept.pieces:
            self.pieces = [*self.pieces[: kept.pieces], Segment(kept.begun, kept.time, kept.mode)]
        else:
            passed = (s for s in stretches if s.start < kept.time)
            self.pieces = [Segment(s.start, min(s.stop, kept.time), s.mode) for s in passed]
            self.pieces = self.pieces or [Segment(kept.time, kept.time, kept.mode)]
        return kept


def empty(program: Program, instants: Array) -> Trajectory:
    """Return a trajectory in which no instant has been reached yet."""
    return Trajectory(np.empty((len(instants), len(program.states.names) + len(program.unknowns.names))))


@dataclass(frozen=True, slots=True)
class SegmentContext:
    """A program with the constants (…,), inputs (…,) and reported instants (points,) of a phase, and its tolerances, in SI."""

    program: Program
    constants: Any
    inputs: Any
    instants: Any
    tolerances: Tolerances

    @property
    def whole(self) -> float:
        """Length of the phase, s."""
        return float(self.instants[-1] - self.instants[0])


class LastStep(Protocol):
    """Data of a method's last step that diagnoses read: scaled states (n,), and errors in units of the tolerance (n,)."""

    @property
    def time(self) -> Any: ...

    @property
    def state(self) -> Any: ...

    @property
    def error(self) -> Any: ...

    @property
    def last_step(self) -> tuple[Any, Any]: ...
