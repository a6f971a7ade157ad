"""The noun of this room: steps in the order in which they are computed, for what a run needs and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..equations.system import Assignment, PowerPort, State, Storage, Validity, Variable
from ..source import Span

Entry = int | float  # a variable by number, or a number


@dataclass(frozen=True, slots=True)
class LinearLoop:
    """`matrix @ targets = right`: an algebraic loop, cut at `targets`; entries are variables or numbers."""

    targets: tuple[int, ...]
    matrix: tuple[tuple[Entry, ...], ...]
    right: tuple[Entry, ...]
    span: Span
    members: tuple[str, ...]


Step = Assignment | LinearLoop


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = f(x, t), y = g(x, t) as ordered steps over variables.

    `outputs` are the author's, `powers` and `stored` what an energy balance reads.
    """

    name: str
    variables: tuple[Variable, ...]
    steps: tuple[Step, ...]
    states: tuple[State, ...]
    outputs: Mapping[str, int]
    quantities: Mapping[str, int]
    ports: tuple[PowerPort, ...]
    storages: tuple[Storage, ...]
    stored: Mapping[str, int]
    dependent: tuple[str, ...]  # storages in derivative form
    limits: tuple[Validity, ...] = ()
