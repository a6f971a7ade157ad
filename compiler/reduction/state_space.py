"""State space: the steps that a run needs, in order of computation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

from ..equations.system import Assignment, Claim, Equations
from ..fast_dataclass import dataclass
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
    gains: tuple[int, ...] = field(init=False, compare=False)  # the variables in the matrix, of which most is nothing

    def __post_init__(self) -> None:
        object.__setattr__(self, "gains", tuple(e for row in self.matrix for e in row if not isinstance(e, float)))

    @property
    def read(self) -> tuple[int, ...]:
        """All variables that the solution depends on."""
        return (*self.gains, *(e for e in self.right if not isinstance(e, float)))


Step = Assignment | LinearLoop


@dataclass(frozen=True, slots=True)
class TearingVariable:
    """A cut of a nonlinear algebraic loop: the variable makes the residual zero, together with all other unknowns."""

    variable: int
    residual: int
    span: Span
    members: tuple[str, ...]
    loop: int  # unknowns with the same number are of one loop
    multiplier: bool = False  # of a constraint, or a balance: the residual is affine in all of these together


@dataclass(frozen=True, slots=True)
class OpenedLaw:
    """A nonlinear law of two variables of a loop, both of which are unknowns: the residual of `row` is g(argument) - factor*value."""

    row: int
    argument: int
    value: int
    effort: bool  # True if the argument is an effort


@dataclass(frozen=True, slots=True)
class Dependent:
    """Stored quantity of a storage port in derivative form, computed from states."""

    variable: int
    element: str  # "" for a follower of another state, which may become a state if storages change their form
    quantity: int  # the same by its own name and unit: a law `p = f` makes `variable` that of the flow
    conjugate: int | None = None


@dataclass(frozen=True, slots=True)
class Forced:
    """Variable that a storage in derivative form, or `der`, differentiates and that may jump: there its rate is an impulse."""

    variable: int
    element: str
    span: Span


@dataclass(frozen=True, eq=False)
class StateSpace(Equations):
    """x' = f(x, z, t), 0 = g(x, z, t), y = h(x, z, t) as ordered steps over variables: states x, unknowns z of loops."""

    steps: tuple[Step, ...]
    unknowns: tuple[TearingVariable, ...]
    dependents: tuple[Dependent, ...]  # contents of storages in derivative form
    forced: tuple[Forced, ...]
    index: int  # of the equations as they were written: 0 explicit, 1 with loops, more with storages in derivative form
    momenta: tuple[Dependent, ...]  # of coordinates, where junctions switch
    laws: tuple[OpenedLaw, ...]  # of loops that are opened
    loops: Mapping[int, tuple[Assignment, ...]]  # all assignments of a loop, by its cut variables

    @property
    def inputs(self) -> list[tuple[int, ...]]:
        """Variables that each variable is computed from."""
        inputs: list[tuple[int, ...]] = [()] * len(self.variables)
        for step in self.steps:
            read = tuple(dict.fromkeys(step.read))
            for target in step.targets:
                inputs[target] = read
        return inputs

    @property
    def posed(self) -> tuple[Claim, ...]:
        """Claims on coordinates of mechanisms alone."""
        return tuple(c for c in self.claims if c.on_pose)

    @property
    def moved(self) -> tuple[int, ...]:
        """Places, among the states, of the coordinates with a start other than the drawing, which others have to follow."""
        if not self.posed and all(i.multiplier is None for i in self.invariants):
            return ()
        return tuple(i for i, s in enumerate(self.states) if s.drawn is not None and s.drawn != s.start)

    @property
    def dependent(self) -> tuple[str, ...]:
        """Storages in derivative form."""
        return tuple(dict.fromkeys(d.element for d in self.dependents if d.element))

    def is_field(self, elements: Sequence[str]) -> bool:
        """Return True for one storage with several ports, alone."""
        owners = [self.variables[s.variable].name.rpartition(".")[0] for s in self.states]
        return len(elements) == 1 and owners.count(elements[0]) > 1 and elements[0] not in self.stored
