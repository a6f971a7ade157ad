"""A program at one instant, its unknowns solved for: functions of the states alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bondgraph.simulation.loops.loops import LoopSolver


@dataclass
class Running:
    """A program at one instant, its unknowns solved for: functions of the states alone."""

    program: Any
    time: float
    guess: Any = None  # where the search for the unknowns begins

    def __post_init__(self) -> None:
        program = self.program
        self.known: dict[bytes, Any] = {}
        self.constants = program.constants(np.array(program.defaults))
        self.inputs = np.array(program.input_defaults)
        self.mode = program.switches(self.time, self.constants)
        self.count = len(program.states.names)
        self.unknowns = len(program.unknowns.names)
        self.guess = np.zeros(self.unknowns) if self.guess is None else self.guess
        self.loops = LoopSolver(program, self.constants, self.inputs, np.ones(self.count + self.unknowns))

    def full(self, x: Any) -> Any:
        """States with the unknowns of nonlinear loops."""
        if x.ndim > 1:
            return np.stack([self.full(y) for y in x])
        if x.tobytes() not in self.known:
            self.known[x.tobytes()] = self.loops.solve(self.time, np.concatenate([x, self.guess]), self.mode)
        return self.known[x.tobytes()]

    def derivative(self, x: Any) -> Any:
        return self._call(self.program.derivative, self.full(x))[..., : self.count]

    def output(self, x: Any) -> Any:
        return self._call(self.program.output, self.full(x))

    def jacobian(self, x: Any) -> Any:
        """The derivatives of the rates by the states, with the unknowns following."""
        whole, count = self._call(self.program.jacobian, self.full(x)), self.count
        a, b, c, d = (
            whole[..., r, k] for r in (slice(count), slice(count, None)) for k in (slice(count), slice(count, None))
        )
        return a - b @ np.linalg.solve(d, c)

    def powers(self, x: Any) -> Any:
        return self._call(self.program.powers, self.full(x))

    def _call(self, function: Any, full: Any) -> Any:
        return function(self.time, full, self.inputs, self.constants, self.mode)
