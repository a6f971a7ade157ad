"""What a run asks of a model: which experiment, what is set from outside, what must stay adjustable, what to report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .source import Span

if TYPE_CHECKING:
    from .syntax.tree import Expression


# What an experiment may ask to solve with: the run chooses; matrix exponential, explicit pair, Radau, a method that conserves energy.
SOLVERS = ("automatic", "exponential", "explicit", "radau", "energy")


@dataclass(frozen=True, slots=True)
class Override:
    """A parameter or input set from outside: an expression of the text, or a number in SI."""

    path: str
    value: Expression | float
    span: Span
    role: str = "set"  # set or start


@dataclass(frozen=True, slots=True)
class Scene:
    """One use of a model.

    `experiment`: its name, "" for the first of the model, None for none. `free`: parameters and inputs that stay arguments
    of the program whatever their value ("*" for all of them). `outputs`: only these are needed (None: what the experiment
    reports, else all).
    """

    model: str | None = None
    experiment: str | None = ""
    overrides: tuple[Override, ...] = ()
    free: frozenset[str] = frozenset()
    outputs: tuple[str, ...] | None = None
    preferences: tuple[
        tuple[str, str], ...
    ] = ()  # storage -> integral or derivative, chosen anew in the middle of a run
    off: tuple[str, ...] | None = None  # junctions that are off; None: as at the start
    conserving: bool = False  # the run asks for the stored energy and its slopes at each step


@dataclass(frozen=True, slots=True)
class Reported:
    """An output as a report shows it: value in SI * 1/scale - offset, in `unit`."""

    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Plan:
    """What an experiment says about its run, in SI."""

    experiment: str | None
    start: float = 0.0
    stop: float | None = None
    settings: Mapping[str, float] = field(default_factory=dict)  # rtol, atol, points
    solver: str | None = None  # one of `SOLVERS`
    tolerances: Mapping[str, float] = field(default_factory=dict)  # variable -> absolute tolerance
    report: tuple[Reported, ...] = ()
    equilibrium: bool = False  # the run starts where all rates vanish
    unsupported: tuple[tuple[Span, str], ...] = ()  # steps that only later versions run


@dataclass(frozen=True, slots=True)
class Facts:
    """What a run asks of a model besides its program and its plan."""

    mechanisms: tuple[str, ...]
    storages: tuple[str, ...]
    claims: bool  # whether the author gave starts to what is computed
    shown: Mapping[str, int]  # outputs that are states or unknowns -> which
