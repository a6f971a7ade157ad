"""Momenta of coordinates, which an impulse within a mechanism balances: the momentum of all that a coordinate carries, along its freedom.

One pass inwards: each link adds the momentum of what it carries, about its point of reference, to that of its parent (R. Featherstone, Rigid Body
Dynamics Algorithms, 2008, section 2.10). Inertias that help the recursion and belong to no body have no momentum.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..algebra.expression import ZERO, Expression, Symbol, add, multiply
from .kinematics import Kinematics
from .link_state import LinkState, Spatial
from .recursion import PLACES, Recursion
from .vectors import cross, dot, plus


def write_momenta(kinematics: Kinematics, recursion: Recursion) -> None:
    """Write the momentum of each coordinate that moves (N s, or N m s for a rotation): what its rate is conjugate to."""
    script = kinematics.script
    whole = [_of_bodies(kinematics, recursion, moving) for moving in kinematics.moving]
    for moving in reversed(kinematics.moving):
        name = moving.link.name
        turn, push = (
            script.vector(f"{name} {word}", v)
            for word, v in zip(("angular momentum", "momentum"), whole[moving.index], strict=True)
        )
        for coordinate, rate, momentum in _along(kinematics, moving, (turn, push)):
            if isinstance(rate, Symbol):
                script.builder.momentum(script.computed(f"{coordinate} momentum", momentum), rate.key)
        if moving.parent is not None:
            turn, push = (moving.out(script, v, f"{name} momentum out") for v in (turn, push))
            around, onto = whole[moving.parent]
            whole[moving.parent] = plus(around, turn, cross(moving.shift, push)), plus(onto, push)


def _of_bodies(kinematics: Kinematics, recursion: Recursion, moving: LinkState) -> Spatial:
    """Momentum of a link's bodies about its point of reference, in link axes."""
    matrix = recursion.own_matrix(moving)
    rates = (*moving.spin, *(kinematics.velocity(moving.index) if moving.link.bodies else (ZERO, ZERO, ZERO)))
    h = [add(*(multiply(matrix[r][k], rates[k]) for k in PLACES)) for r in PLACES]
    return (h[0], h[1], h[2]), (h[3], h[4], h[5])


def _along(kinematics: Kinematics, moving: LinkState, whole: Spatial) -> Iterator[tuple[str, Expression, Expression]]:
    """Yield the name, the rate and the momentum of each coordinate of a link."""
    turn, push = whole
    own = zip(moving.coordinates, moving.columns, strict=False)
    momenta = [dot(column[0], turn) + dot(column[1], push) for _, column in own]
    if moving.link.step.kind == "float":  # its coordinates are in world axes
        momenta = [*kinematics.world(moving.index, push, f"{moving.link.name} momentum in world axes")]
    for coordinate, momentum in zip(moving.coordinates, momenta, strict=True):
        if coordinate.target is not None:
            yield coordinate.name, coordinate.rate, momentum
    if moving.attitude is not None and moving.attitude.targets:
        for letter, rate, momentum in zip("xyz", moving.attitude.spin, turn, strict=True):
            yield f"{moving.link.part.name}.spin.{letter}", rate, momentum
