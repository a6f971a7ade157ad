"""Reactions of tree joints: the total wrench through a joint on its second body, at the joint's point, in world axes.

It includes both the constraint wrench and the efforts on the joint's port. Only reactions that are read are written.
"""

from __future__ import annotations

from ..algebra.expression import Expression, add
from ..graph.mechanism import GROUND, PLANAR_POSE, POSE, Joint
from .kinematics import Kinematics
from .recursion import PLACES, Recursion
from .vectors import cross, minus, negated, plus

UNITS = ("N*m", "N*m", "N*m", "N", "N", "N")  # of a wrench


def reaction(kinematics: Kinematics, recursion: Recursion, index: int, joint: Joint) -> dict[str, Expression]:
    """`pin.reaction.x` and so on, for the joint whose last link is `index`."""
    script, name = kinematics.script, f"{joint.name}.reaction"
    moving = kinematics.moving[index]
    angular, linear = recursion.acceleration(index)
    a = (*angular, *linear)
    matrix, load = recursion.matrices[index], recursion.loads[index]
    wrench = [
        script.let(f"{name}.own{r}", add(load[r], *(matrix[r][k] * a[k] for k in PLACES)), UNITS[r]) for r in PLACES
    ]
    force = kinematics.world(index, (wrench[3], wrench[4], wrench[5]), f"{name}.f")
    about_reference = kinematics.world(index, (wrench[0], wrench[1], wrench[2]), f"{name}.t")
    # The point is where the second body has it: that of a slide may be far from where the first body does.
    point = script.place(joint.position, f"{joint.name} at")
    second = kinematics.on[joint.second]
    there = kinematics.moved(None if second == GROUND else kinematics.tree.place[second], point, f"{name}.point")
    arm = plus(minus(point, moving.origin), minus(there, kinematics.displacement(index)))
    torque = minus(about_reference, cross(script.vector(f"{name}.arm", arm, "m"), force))
    if moving.link.reverse:
        force, torque = negated(force), negated(torque)
    parts = dict(zip((*POSE, "phi"), (*force, *torque, torque[2]), strict=True))
    letters = PLANAR_POSE if joint.planar else POSE
    return {f"{name}.{c}": parts[c] for c in letters}
