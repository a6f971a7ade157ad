"""Kinetic and gravitational energy, for the energy balance. Programs that do not read it do not compute it."""

from __future__ import annotations

from ..algebra.expression import Expression, add, multiply, negate
from .kinematics import Kinematics
from .link_state import LinkState
from .recursion import Recursion
from .rotations import HALF
from .vectors import applied, cross, dot, is_null, plus


def energy(kinematics: Kinematics, recursion: Recursion) -> Expression:
    """Energy of all bodies, J."""
    terms = []
    for index, moving in enumerate(kinematics.moving):
        if not moving.link.bodies:
            continue
        terms.append(_kinetic(kinematics, recursion, moving, index))
        for body in moving.link.bodies if not is_null(recursion.gravity) else ():
            centre = kinematics.centres[body.name]
            mass = kinematics.script.constant(body.mass, f"{body.name} mass", "kg")
            place = plus(centre, kinematics.moved(index, centre, f"{body.name} centre"))
            terms.append(negate(multiply(mass, dot(recursion.gravity, place))))
    return add(*terms)


def _kinetic(kinematics: Kinematics, recursion: Recursion, moving: LinkState, index: int) -> Expression:
    """1/2 m v.v + v.(w x moment) + 1/2 w.J w, with v of the point of reference and w the angular velocity."""
    inertia, spin = recursion.inertias[index], moving.spin
    floats = moving.link.step.kind == "float"
    v = tuple(c.rate for c in moving.coordinates) if floats else kinematics.velocity(index)
    terms = [multiply(HALF, inertia.mass, dot((v[0], v[1], v[2]), (v[0], v[1], v[2])))]
    if not is_null(spin):
        terms.append(multiply(HALF, dot(spin, applied(inertia.tensor, spin))))
        swept = cross(spin, inertia.moment)
        if not is_null(swept):
            terms.append(dot(kinematics.velocity(index), swept))
    return add(*terms)
