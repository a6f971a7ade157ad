"""Planar chains: two slides and a hinge in series over bodies without mass, as one joint with all three planar freedoms.

Such a chain constrains nothing. Within a closed loop its coordinates would be states, with as many constraints more. As a chord they are
explicit functions of the poses of its two ends: a `free` joint at the hinge measures the gap in the axes of the body that both slides are
fixed to, and the displacements s of the slides, along unit vectors d and e, solve s[0] d + s[1] e = gap. The inverse is constant, so the
efforts follow from power by its transpose. A chain that is not in a loop stays in the tree, where its coordinates are states without a constraint.

All else is left as it is: a slide on each side of the hinge, as where these are parallel the chain does constrain; directions of parameters,
as a run may change them; starts, imposed and reset rates, and structures that switch, which need the coordinates as states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from math import atan2, pi

from ..algebra.expression import ZERO, Expression, Number, Symbol, add, multiply
from ..fast_dataclass import dataclass
from ..graph.groups import Groups
from ..graph.mechanism import COUPLINGS, Body, Frame, Joint, Mechanism
from .assignment_emitter import AssignmentEmitter
from .axes import snapped
from .chords import Chords
from .kinematics import Kinematics
from .link_state import Carried, Marker
from .motion import PortMotion
from .rotations import AxialTurn, unit
from .tree import CLOSING, ends_of, is_chord
from .vectors import NULL, Vector, cross, minus, negated, plus, scaled

STEEP = 0.01  # least sine of the angle between the slides
Wrench = tuple[Vector, Vector]  # force and torque, world axes


@dataclass(frozen=True, slots=True)
class PlanarChain:
    """Two slides and a hinge, from the body that both slides are fixed to, and the two bodies without mass between.

    `senses`: 1 for a joint whose second end is nearer to the hinge's far side, else -1. `shares`: each slide's displacement from x and y of
    the gap; `ways`: unit vectors of the slides; both in the axes of `free`, which are turned by `angle` from the world's in the drawing.
    """

    free: Joint  # the joint that it acts as
    joints: tuple[Joint, Joint, Joint]
    bodies: tuple[Body, Body]
    senses: tuple[float, float, float]
    angle: float
    shares: tuple[tuple[float, float], ...]
    ways: tuple[tuple[float, float], ...]

    @property
    def ports(self) -> tuple[str, str, str]:
        """Names of the coordinates."""
        x, y, phi = (f"{joint.name}.{joint.freedoms[0]}" for joint in self.joints)
        return x, y, phi

    def efforts_on_free(self, efforts: Mapping[str, Expression]) -> dict[str, Expression]:
        """Efforts on the coordinates of the free joint that have the power of those on the chain's."""
        first, second, turning = (efforts.get(port, ZERO) for port in self.ports)
        dual = {
            f"{self.free.name}.{letter}": add(*(multiply(Number(s[i]), e) for s, e in zip(self.shares, (first, second), strict=True)))
            for i, letter in enumerate("xy")
        } | {f"{self.free.name}.phi": multiply(Number(self.senses[2]), turning)}  # fmt: skip
        return {port: effort for port, effort in dual.items() if effort != ZERO}


# ---------------------------------------------------------------- chains of a mechanism
def planar_chains(
    mechanism: Mechanism, script: AssignmentEmitter, bonded: Set[str], apart: Set[str]
) -> tuple[PlanarChain, ...]:
    """Chains within closed loops. `bonded`: parts with bonds; `apart`: parts that may belong to no chain."""
    if not mechanism.planar:
        return ()
    on = ends_of(mechanism)
    at: dict[str, list[Joint]] = {}
    for joint in mechanism.joints:
        for end in (joint.first, joint.second) if joint.kind not in COUPLINGS else ():
            at.setdefault(on[end], []).append(joint)
    coupled = {end for j in mechanism.joints if j.kind in COUPLINGS for end in (j.first, j.second)}
    simple = {
        j.name
        for j in mechanism.joints
        if j.kind in ("slide", "hinge") and not (j.locked or j.starts) and j.name not in coupled | apart
    }
    placed: tuple[Body | Frame, ...] = (*mechanism.bodies, *mechanism.frames)
    started = {part.name for part in placed if part.starts}
    busy = {on[name] for name in (bonded | apart | started) & set(on)}
    between = {
        body.name: body
        for body in mechanism.bodies
        if body.name not in busy
        and len(joints := {j.name for j in at.get(body.name, ())}) == len(at.get(body.name, ())) == 2
        and joints <= simple
        and all(script.builder.folded(x) == ZERO for x in (body.mass, body.inertia.zz))
    }
    chains: dict[frozenset[str], PlanarChain | None] = {}
    for joint in mechanism.joints if between else ():
        path = _path(joint, on, at, between)
        names = frozenset(j.name for j, *_ in path)
        if len(path) == 3 and names not in chains:
            chains[names] = _chain(path, between, script)
    return tuple(_in_loops(mechanism, on, [chain for chain in chains.values() if chain is not None]))


def _path(
    joint: Joint, on: Mapping[str, str], at: Mapping[str, Sequence[Joint]], between: Mapping[str, Body]
) -> list[tuple[Joint, str, str]]:
    """Joints in series with their nearer and further body, from a joint that begins at a body which is not `between`; empty if it does not."""
    ends = () if joint.kind in COUPLINGS else (on[joint.first], on[joint.second])
    outside = [end for end in ends if end not in between]
    path: list[tuple[Joint, str, str]] = []
    near = outside[0] if len(outside) == 1 else None
    while near is not None:
        first, second = on[joint.first], on[joint.second]
        far = second if first == near else first
        path.append((replace(joint, first=first, second=second), near, far))
        near = far if far in between else None
        if near is not None:
            joint = next(j for j in at[near] if j.name != joint.name)
    return path


def _chain(
    path: Sequence[tuple[Joint, str, str]], between: Mapping[str, Body], script: AssignmentEmitter
) -> PlanarChain | None:
    """The chain of three joints in series, from its slides to its hinge; None if it has no such form."""
    if path[0][0].kind == "hinge":
        path = [(joint, far, near) for joint, near, far in reversed(path)]
    (a, start, first), (b, _, second), (hinge, _, end) = path
    plane = None if (a.kind, b.kind, hinge.kind) != ("slide", "slide", "hinge") else _plane(a, b, script)
    if start == end or plane is None:
        return None
    angle, ways = plane
    one, other, last = (1.0 if joint.first == near else -1.0 for joint, near, _ in path)
    (ax, ay), (bx, by) = ways
    sine = ax * by - ay * bx
    shares = ((one * by / sine, -one * bx / sine), (-other * ay / sine, other * ax / sine))
    name = f"{hinge.name} chain"  # no name of the text has a space
    free = replace(hinge, name=name, kind="free", first=start, second=end, starts={}, rest={}, axes="from")
    return PlanarChain(free, (a, b, hinge), (between[first], between[second]), (one, other, last), angle, shares, ways)


def _plane(a: Joint, b: Joint, script: AssignmentEmitter) -> tuple[float, tuple[tuple[float, float], ...]] | None:
    """Angle of axes in which a slide is along x or y, and the unit vectors of two slides in them.

    None if they are nearly parallel, or if a direction depends on parameters, which a run may change.
    """
    ways = [snapped(unit(script.place(j.axis, f"{j.name}.axis", "1"))) for j in (a, b)]
    numbers = [[c.value for c in way if isinstance(c, Number)] for way in ways]
    if any(len(way) < 3 for way in numbers):
        return None
    (x, y, _), (p, q, _) = numbers
    angle = atan2(y, x)
    quarter = round(angle / (pi / 2))
    along = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter % 4]
    between = snapped((Number(x * p + y * q), Number(x * q - y * p), ZERO))
    cosine, sine = (c.value for c in between[:2] if isinstance(c, Number))
    if abs(sine) < STEEP:
        return None
    other = (cosine * along[0] - sine * along[1], cosine * along[1] + sine * along[0])
    return angle - quarter * pi / 2, (along, other)


def _in_loops(mechanism: Mechanism, on: Mapping[str, str], chains: Sequence[PlanarChain]) -> list[PlanarChain]:
    """Chains whose ends are connected without them, by joints of the tree or by other chains."""
    inside = {j.name for chain in chains for j in chain.joints}
    others = [j for j in mechanism.joints if not (j.kind in CLOSING or is_chord(j) or j.name in inside)]
    fixed = [(on[j.first], on[j.second]) for j in others]
    closing = []
    for chain in chains:
        group = Groups[str]()
        for one, other in [*fixed, *((c.free.first, c.free.second) for c in chains if c is not chain)]:
            group.join(one, other)
        if group.of(chain.free.first) == group.of(chain.free.second):
            closing.append(chain)
    return closing


def merged(mechanism: Mechanism, chains: Sequence[PlanarChain]) -> Mechanism:
    """The mechanism with a free joint for each chain."""
    bodies = {body.name for chain in chains for body in chain.bodies}
    joints = {j.name for chain in chains for j in chain.joints}
    return replace(
        mechanism,
        bodies=tuple(b for b in mechanism.bodies if b.name not in bodies),
        frames=tuple(f for f in mechanism.frames if f.body not in bodies),
        joints=(*(j for j in mechanism.joints if j.name not in joints), *(chain.free for chain in chains)),
    )


# ---------------------------------------------------------------- equations
def write_chain(
    chain: PlanarChain, kinematics: Kinematics, efforts: Mapping[str, Expression], reacting: Set[str]
) -> tuple[dict[str, PortMotion], dict[str, Wrench]]:
    """Motions of the chain's ports, and the wrenches of the joints `reacting` on their second bodies. `efforts`: on the free joint.

    The poses of the bodies between become known to the kinematics.
    """
    script, name = kinematics.script, chain.free.name
    kinematics.drawn[name] = AxialTurn(2, Number(chain.angle))
    motion = Chords(kinematics).relative_motion(chain.free, efforts)
    gap, rates = motion.gap, motion.rates
    shares = [(Number(a), Number(b)) for a, b in chain.shares]
    moved = [add(multiply(a, gap[0]), multiply(b, gap[1])) for a, b in shares]
    flows = [add(multiply(a, rates[0]), multiply(b, rates[1])) for a, b in shares]
    sense = Number(chain.senses[2])
    moved, flows = [*moved, multiply(sense, motion.turned[2])], [*flows, multiply(sense, motion.turning[2])]
    motions = {}
    slid: list[tuple[Expression, Expression]] = []
    for joint, port, q, f in zip(chain.joints, chain.ports, moved, flows, strict=True):
        turns = joint.kind == "hinge"
        letter = joint.freedoms[0]
        q = script.let(f"{port} moved" if letter in joint.rest else port, q, "1" if turns else "m")
        rest = script.constant(joint.rest[letter], f"{port} rest") if letter in joint.rest else ZERO
        pose = script.held(port, add(q, rest), "1" if turns else "m")
        flow = script.let(f"{port}.{'omega' if turns else 'v'}", f, "1/s" if turns else "m/s")
        motions[port] = PortMotion(flow, Symbol(pose), pose)
        slid.append((q, flow))
    _carry(chain, kinematics, slid)
    torque = efforts.get(f"{name}.phi", ZERO)
    wrenches = {
        joint.name: _wrench(kinematics, joint, sense, motion.second, (motion.force, (ZERO, ZERO, torque)))
        for joint, sense in zip(chain.joints, chain.senses, strict=True)
        if joint.name in reacting
    }
    return motions, wrenches


def _carry(chain: PlanarChain, kinematics: Kinematics, slid: Sequence[tuple[Expression, Expression]]) -> None:
    """Let the poses of the bodies between follow from that of the body that both slides are fixed to."""
    drawn = kinematics.drawn[chain.free.name]
    script = kinematics.script
    shift, drift = NULL, NULL
    for body, sense, way, (q, flow) in zip(chain.bodies, chain.senses, chain.ways, slid, strict=False):
        v = drawn.apply(script, (Number(way[0]), Number(way[1]), ZERO), f"{body.name}.way")
        shift, drift = (plus(old, scaled(multiply(Number(sense), c), v)) for old, c in ((shift, q), (drift, flow)))
        kinematics.carried[body.name] = Carried(chain.free.first, shift, drift)


def _wrench(kinematics: Kinematics, joint: Joint, sense: float, hinge: Marker, through: Wrench) -> Wrench:
    """Wrench of a joint on its second body at the joint's point there. `through`: of the chain on its far end, at the hinge."""
    script, (force, torque) = kinematics.script, through
    point = script.place(joint.position, f"{joint.name} at")
    seat = kinematics.placed(joint.second, point, f"{joint.name}.seat")
    arm = plus(minus(hinge.point, seat.point), minus(hinge.displacement, seat.displacement))
    torque = plus(torque, cross(script.vector(f"{joint.name}.arm", arm, "m"), force))
    return (force, torque) if sense > 0 else (negated(force), negated(torque))
