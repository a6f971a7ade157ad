"""Storages and integrals that share a state: their values from the states, and the states from theirs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Tape

from ..errors import UsageError

if TYPE_CHECKING:
    from compiler.api import Compilation

SAME = 1e-9  # relative difference of values that share a state


@dataclass(frozen=True, slots=True)
class Follower:
    """A quantity equal to `slope` times the state at index `place`, plus `offset`; `unit` in SI."""

    place: int
    slope: float
    offset: float
    unit: str

    def at(self, state: Array) -> float:
        """Return its value for states (n, ...)."""
        return float(self.slope * state[self.place] + self.offset)


def followers(compilation: Compilation, parameters: Array | tuple[float, ...]) -> dict[str, Follower]:
    """Return the followers by name, with the parameters (p,) of the program."""
    space, lowered = compilation.state_space, compilation.lowered
    if not space.following:
        return {}
    tape = Tape([lowered.values[f.variable] for f in space.following])

    def at(state: float) -> Any:
        return np.array(
            tape.values(lambda leaf: state if leaf.role == "state" else float(parameters[leaf.position])), dtype=float
        )

    offsets, places = at(0.0), {s.variable: i for i, s in enumerate(space.states)}
    variables = [space.variables[f.variable] for f in space.following]
    return {
        v.name: Follower(places[f.state], float(slope), float(offset), v.unit)
        for v, f, slope, offset in zip(variables, space.following, at(1.0) - offsets, offsets, strict=True)
    }


def led(
    compilation: Compilation, parameters: Array | tuple[float, ...], given: Mapping[str, float]
) -> dict[str, float]:
    """Return given values by name, with those of followers converted to the states that they share.

    Raises `UsageError` where two of them contradict each other.
    """
    if all(name in compilation.program.states.names for name in given):
        return dict(given)
    names, all_followers = compilation.program.states.names, followers(compilation, parameters)
    leaders = {n: v for n, v in given.items() if n not in all_followers}
    for name, follower in ((n, all_followers[n]) for n in given if n in all_followers):
        leader, value = names[follower.place], (given[name] - follower.offset) / follower.slope
        other = leaders.setdefault(leader, value)
        if abs(other - value) > SAME * max(abs(other), abs(value), abs(follower.offset / follower.slope)):
            raise UsageError("BR207", f"`{name}` follows `{leader}`: their values contradict each other")
    return leaders
