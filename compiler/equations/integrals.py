"""Integrals of flows: sums of the coordinates of mechanisms whose rates they are."""

from __future__ import annotations

from ..algebra.affine import jointly_affine
from ..algebra.expression import ZERO, Symbol, add, multiply, symbols
from .collection import EquationCollection
from .system import Assignment


class FlowIntegrals:
    """Integrals of flows that are known so far. `bond_variables`: efforts and flows, which are not constant even if parameters alone compute them."""

    def __init__(self, equations: EquationCollection, bond_variables: frozenset[int]) -> None:
        self.equations, self.bond_variables = equations, bond_variables
        self.known: dict[int, int | None] = {}

    def know(self, flow: int, displacement: int) -> None:
        """Record that the rate of a displacement (zero in the drawing) is this flow."""
        self.known[self.equations.root(flow)] = displacement

    def integral(self, flow: int) -> int | None:
        """Variable whose rate is the given flow, from the coordinates of a mechanism; None if there is none."""
        flow = self.equations.root(flow)
        rows = [] if flow in self.known else [(flow, self._moving(flow))]
        while rows:  # not by recursion: a row of transformers may be longer than Python nests calls
            current, waiting = rows[-1]
            while waiting and self.known.get(waiting[-1]) is not None:
                waiting.pop()
            if waiting and waiting[-1] not in self.known:
                rows.append((waiting[-1], self._moving(waiting[-1])))
                continue
            rows.pop()
            if not waiting and self.equations.explicit(current) is not None:
                self.known[current] = self._linear_integral(current)
        return self.known[flow]

    def _moving(self, flow: int) -> list[int]:
        """Varying variables that a flow is computed from, last first. The flow is entered without integral until one is found."""
        self.known[flow] = None
        assignment = self.equations.explicit(flow)
        read = [] if assignment is None else [self.equations.root(v) for v in _read_by(assignment)]
        return [v for v in reversed(read) if not self._is_static(v)]

    def _linear_integral(self, flow: int) -> int | None:
        """Integral of a flow that is a sum of integrable flows with constant factors: the same sum over their integrals."""
        assignment = self.equations.assigned[flow]
        moving = [s for s in symbols(assignment.expression) if not self._is_static(s.key)]
        slopes = jointly_affine(assignment.expression, moving)
        if slopes is None or slopes[1] != ZERO:
            return None
        integrals = [self.known[self.equations.root(symbol.key)] for symbol in moving]
        parts = [multiply(slope, Symbol(integral)) for slope, integral in zip(slopes[0], integrals, strict=True)]
        variable = self.equations.variable(f"{self.equations.variables[flow].name} integrated", "computed")
        self.equations.assign(variable, add(*parts), assignment.span, assignment.owner)
        return variable

    def _is_static(self, variable: int) -> bool:
        """Return True for a variable computed from parameters alone."""
        waiting, seen = [variable], set[int]()
        while waiting:
            variable = self.equations.root(waiting.pop())
            if variable in seen or self.equations.variables[variable].role == "parameter":
                continue
            seen.add(variable)
            assignment = self.equations.explicit(variable)
            if assignment is None or variable in self.bond_variables:
                return False
            waiting += assignment.read
        return True


def _read_by(assignment: Assignment) -> list[int]:
    """Variables that an assignment reads. A number among its arguments may be zero and remove others."""
    if any(isinstance(a, float) for a in assignment.arguments):
        return [s.key for s in symbols(assignment.expression)]
    return list(dict.fromkeys(a for a in assignment.arguments if not isinstance(a, float)))
