"""Fictitious inertia for coordinates that move no inertia of their own within a closed loop.

A strut without mass, a massless coupler, two slides and a hinge that close a loop: the mass matrix M of the tree is singular there, but
not on the motions that the closing joints leave (J v = 0), so that [M J'; J 0] has one solution. The recursion needs an inertia along
each coordinate that it eliminates. So such a coordinate gets a fictitious inertia d = r^2, and an unknown effort r s cancels its
effect: s makes r q'' - s zero, with q'' the coordinate's second derivative. The fictitious inertia cancels for any size; with the size of
the inertias around the loop, it cancels without loss of digits. With the multipliers l of the closing joints the unknowns solve

    [ J (M + d)^-1 J'     J (M + d)^-1 r     ] [l]
    [ r (M + d)^-1 J'     r (M + d)^-1 r - 1 ] [s]

which is positive definite in l, and negative definite in s once l is eliminated, if and only if all motions that J leaves move an inertia.
So it is solved without exchanging rows, multipliers first (`codegen/multipliers.py`).

The alternative is to merge a chain of joints through massless bodies into one joint between the bodies with mass. In the plane two slides and
a hinge in a row are (`planar_chains.py`); a ball and a universal joint would be a rod. There are closed forms for few chains, and none for
branching ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import frexp, inf

from ..fast_dataclass import dataclass
from ..graph.mechanism import COUPLINGS, GROUND, SPANS, Joint
from .kinematics import Kinematics
from .recursion import Recursion
from .tree import Tree
from .values import SampleValues


@dataclass(frozen=True, slots=True)
class FictitiousInertia:
    """Fictitious inertia in a loop: for slides a mass (kg), for rotations an inertia (kg m^2)."""

    mass: float
    inertia: float

    def of(self, turns: bool) -> float:
        """An even power of two, so that its square root is exact."""
        _, exponent = frexp(self.inertia if turns else self.mass)
        return 2.0 ** (exponent - exponent % 2)


def lent_around(kinematics: Kinematics, recursion: Recursion) -> Mapping[int, FictitiousInertia]:
    """Fictitious inertia for each link within a closed loop: that of the smallest loop, if there are several."""
    tree = kinematics.tree
    if not tree.closing:
        return {}
    values = SampleValues(kinematics.script, kinematics.length)
    whole = measured(kinematics, recursion, values, set(range(len(tree.links))))
    result: dict[int, FictitiousInertia] = {}
    for joint in tree.closing:
        loop = links_around(tree, joint, kinematics.on)
        if joint.kind in COUPLINGS:
            loop |= _outside(tree, loop)
        found = (
            measured(kinematics, recursion, values, loop)
            or whole
            or _reached(kinematics, recursion, values, joint, loop)
        )
        for index in loop if found else ():
            assert found is not None
            if index not in result or found.inertia < result[index].inertia:
                result[index] = found
    return result


def links_around(tree: Tree, joint: Joint, on: Mapping[str, str]) -> set[int]:
    """Links whose coordinates a closing joint couples."""
    if joint.kind not in COUPLINGS:
        first, second = (
            _inwards(tree, None if on[e] == GROUND else tree.place[on[e]]) for e in (joint.first, joint.second)
        )
        return first ^ second
    tied = {joint.first, joint.second}
    loop = {i for i, link in enumerate(tree.links) if link.part.name in tied}
    return loop.union(*(links_around(tree, other, on) for other in tree.closing if other.name in tied))


def _inwards(tree: Tree, link: int | None) -> set[int]:
    found = set()
    while link is not None:
        found.add(link)
        link = tree.links[link].parent
    return found


def _outside(tree: Tree, links: set[int]) -> set[int]:
    found = set(links)
    for index, link in enumerate(tree.links):  # parents come first
        if link.parent in found:
            found.add(index)
    return found


def _reached(
    kinematics: Kinematics, recursion: Recursion, values: SampleValues, joint: Joint, links: set[int]
) -> FictitiousInertia | None:
    """Mass, and inertia from the distance of the closing joint, of links that all turn about one point; None as in `measured`."""
    if joint.kind in COUPLINGS:
        return None
    script = kinematics.script
    if joint.kind in SPANS:
        ends = [script.place(kinematics.mechanism.point_of(e), f"{e} at") for e in (joint.first, joint.second)]
    else:
        ends = [script.place(joint.position, f"{joint.name} at")]
    mass = sum(values.of(recursion.inertias[i].mass) for i in links)
    pins = [kinematics.moving[i].origin for i in links]
    arms = [sum(values.of(a - b) ** 2 for a, b in zip(end, pin, strict=True)) for end in ends for pin in pins]
    if joint.kind == "wheel":  # it is its radius away from its centre
        arms.append(values.of(script.constant(joint.ratio, f"{joint.name} radius", "m")) ** 2)
    turning = mass * max(arms, default=0.0)
    return FictitiousInertia(mass, turning) if 0 < mass < inf and 0 < turning < inf else None


def measured(
    kinematics: Kinematics, recursion: Recursion, values: SampleValues, links: set[int]
) -> FictitiousInertia | None:
    """Mass of some links, and their inertia about each other; None if both are zero."""
    mass = turning = 0.0
    points = []
    for index in links:
        inertia, moving = recursion.inertias[index], kinematics.moving[index]
        mass += values.of(inertia.mass)
        turning += sum(values.of(inertia.tensor[i][i]) for i in range(3)) / 2
        points += [[values.of(x) for x in point] for point in (moving.origin, kinematics.pin(moving.link))]
    size = max((sum((a - b) * (a - b) for a, b in zip(p, points[0], strict=True)) for p in points), default=0.0)
    turning += mass * size
    if not mass:
        mass = turning / size if size else 0.0
    return FictitiousInertia(mass, turning) if 0 < mass < inf and 0 < turning < inf else None
