"""A mechanism from the tree to its equations: poses and rates, wrenches, accelerations, and the quantities that are read.

Starts may also be those of parts that are computed from the coordinates: chords, bodies that are carried by others, frames.
The author does not choose the tree, so any part may have a start. Each such start is a claim, and the coordinates
without a start of their own move as little as necessary to satisfy it.

Kinetic and gravitational energy is for the energy balance. Programs that do not read it do not compute it.
Momenta of coordinates are what an impulse within a mechanism balances: the momentum of all that a coordinate carries, along its freedom.
One pass inwards: each link adds the momentum of what it carries, about its point of reference, to that of its parent (R. Featherstone, Rigid Body
Dynamics Algorithms, 2008, section 2.10). Inertias that help the recursion and belong to no body have no momentum.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import replace

from ..algebra.expression import ZERO, Expression, Symbol, add, multiply, negate
from ..fast_dataclass import dataclass
from ..graph.mechanism import Body, Frame, Joint, Mechanism
from .assignment_emitter import AssignmentEmitter, EquationWriter
from .chords import Chords
from .closure import Closure
from .fictitious_inertia import lent_around
from .idle_rotations import idle_turns, survey
from .kinematics import Kinematics
from .link_state import LinkState, Spatial
from .motion import MechanismEquations, PortMotion
from .planar_chains import PlanarChain, merged, planar_chains, write_chain
from .ports import PortWriter, reaction
from .recursion import PLACES, Recursion
from .rotations import HALF
from .tree import Tree, bonded_joints, is_weld, spanning_tree
from .vectors import applied, cross, dot, is_null, plus


def mechanism_equations(
    mechanism: Mechanism, efforts: Mapping[str, Expression], flows: Mapping[str, Expression], wanted: Set[str],
    states: Set[str], builder: EquationWriter,
) -> MechanismEquations:  # fmt: skip
    """Write the equations of a mechanism.

    `efforts` act on its ports; `flows` are determined by the network; `wanted` are the ports that are read elsewhere; those of `states` may
    belong to no chain, as events set them or the structure may switch.
    """
    script = AssignmentEmitter(mechanism, builder)
    bonded = bonded_joints((*efforts, *flows))
    reacting = {n.partition(".")[0] for n in wanted if n.partition(".")[2].startswith("reaction.")}
    read = {j.name for j in mechanism.joints if any(f"{j.name}.{letter}" in wanted for letter in j.freedoms)}
    chains = planar_chains(mechanism, script, bonded, bonded_joints((*flows, *states)))
    acting = merged(mechanism, chains)
    tree = spanning_tree(acting, bonded, reacting, read)
    if chains and not flows.keys() <= {c for link in tree.links for c in link.coordinates}:
        chains, acting, tree = (), mechanism, spanning_tree(mechanism, bonded, reacting, read)
    whole = WholeMechanism(mechanism, chains, wanted | efforts.keys() | flows.keys(), reacting)
    return Mechanics(acting, tree, efforts, flows, whole, script).write()


@dataclass(frozen=True, slots=True)
class WholeMechanism:
    """The mechanism of the text, its chains that act as one joint each, the ports in use, and the joints whose reactions are read."""

    mechanism: Mechanism
    chains: tuple[PlanarChain, ...]
    ports: Set[str]
    reacting: Set[str]


class Mechanics:
    """Writer of one mechanism."""

    def __init__(
        self, mechanism: Mechanism, tree: Tree, efforts: Mapping[str, Expression], flows: Mapping[str, Expression],
        whole: WholeMechanism, script: AssignmentEmitter,
    ) -> None:  # fmt: skip
        """`mechanism`: with a free joint for each chain."""
        self.mechanism, self.tree, self.script, self.whole = mechanism, tree, script, whole
        inside = {port for chain in whole.chains for port in chain.ports}
        self.efforts = {port: e for port, e in efforts.items() if port not in inside}
        for chain in whole.chains:
            self.efforts |= chain.efforts_on_free(efforts)
        self.driving = frozenset((*self.efforts, *flows))
        self.result = MechanismEquations()
        self.claimed = claimed_parts(whole.mechanism, tree)
        self.used = {name.partition(".")[0] for name in whole.ports} | set(self.claimed)
        self.reacting = [j for j in whole.mechanism.joints if j.name in whole.reacting]
        self.kinematics = Kinematics(mechanism, tree, self.script, flows, bool(self.reacting) and not mechanism.planar)
        self.recursion = Recursion(self.kinematics, self.efforts)
        self.closure = Closure(self.kinematics, self.recursion, self.efforts, self.result, self.used)

    def write(self) -> MechanismEquations:
        self._ports()
        self.closure.begin()
        if self.result.diagnostics:
            return self.result
        claim_starts(self.script, self.claimed, self.result)
        self.recursion.idle = idle_turns(self.kinematics, self.recursion, self.driving)
        found = survey(self.kinematics, self.recursion, lent_around(self.kinematics, self.recursion))
        self.recursion.lend(found.lent)
        self.recursion.run()
        if not self.recursion.diagnostics and found.lost is not None:
            self.recursion.nothing(*found.lost)
        self.result.diagnostics += self.recursion.diagnostics
        if not self.result.diagnostics:
            self.closure.end(self.reacting)
            self._reactions()
            self._driven()
            if self.script.builder.switching:
                write_momenta(self.kinematics, self.recursion)
            total = energy(self.kinematics, self.recursion)
            self.result.energy = self.script.held("energy", total, "J") if total != ZERO else None
        return self.result

    # ------------------------------------------------------------ what the graph sees
    def _ports(self) -> None:
        ports, chords = PortWriter(self.kinematics, self.efforts, self.result), Chords(self.kinematics)
        for chain in self.whole.chains:
            self._chain(chain)
        for moving in self.kinematics.moving:
            ports.tree_joint(moving)
        for body in self.whole.mechanism.bodies:
            if body.name in self.used:
                ports.body(body)
        for frame in self.whole.mechanism.frames:
            if frame.name in self.used:
                ports.frame(frame)
        for joint in self.tree.chords:
            if joint.name in self.used:
                self.result.motions |= self._chord(chords, joint)
        for joint in self.mechanism.joints:
            if is_weld(joint):
                self._locked(joint)

    def _chain(self, chain: PlanarChain) -> None:
        """Ports of a chain's joints and their reactions, if any is used; the poses of its bodies follow."""
        bodies = {body.name for body in chain.bodies}
        names = (
            {j.name for j in chain.joints} | bodies | {f.name for f in self.whole.mechanism.frames if f.body in bodies}
        )
        if names & self.used:
            motions, wrenches = write_chain(chain, self.kinematics, self.efforts, self.whole.reacting)
            self.result.motions |= motions
            self.closure.wrenches |= wrenches

    def _locked(self, joint: Joint) -> None:
        """Readings of a joint that is locked in the position of the drawing."""
        for letter in joint.freedoms:
            rest: Expression = ZERO
            if letter in joint.rest:
                rest = self.script.constant(joint.rest[letter], f"{joint.name}.{letter} rest")
            held = self.script.held(f"{joint.name}.{letter}", rest)
            self.result.motions[f"{joint.name}.{letter}"] = PortMotion(ZERO, rest, held)

    def _chord(self, chords: Chords, joint: Joint) -> Mapping[str, PortMotion]:
        if joint.kind == "free":
            return chords.free(joint, self.efforts)
        first, second = (
            self.script.place(self.mechanism.point_of(end), f"{end} at") for end in (joint.first, joint.second)
        )
        return chords.distance(joint, (first, second), self.efforts)

    def _reactions(self) -> None:
        """Reactions of tree joints: their last link carries the second body."""
        last = {link.part.name: index for index, link in enumerate(self.tree.links)}
        for joint in self.reacting:
            if joint.name in last:
                self.result.readings |= reaction(self.kinematics, self.recursion, last[joint.name], joint)

    def _driven(self) -> None:
        """Efforts of driven coordinates: the load of their joint along the freedom."""
        for index, moving in enumerate(self.kinematics.moving):
            for column, coordinate in zip(moving.columns, moving.coordinates, strict=False):
                if coordinate.driven:
                    angular, linear = self.recursion.acceleration(index)
                    a, axis = (*angular, *linear), (*column[0], *column[1])
                    matrix, load = self.recursion.matrices[index], self.recursion.loads[index]
                    wrench = [add(load[r], *(multiply(matrix[r][k], a[k]) for k in PLACES)) for r in PLACES]
                    effort = add(*(multiply(axis[r], wrench[r]) for r in PLACES if axis[r] != ZERO))
                    self.result.efforts[coordinate.name] = self.script.let(f"{coordinate.name} effort", effort)


def claimed_parts(mechanism: Mechanism, tree: Tree) -> Mapping[str, Body | Frame | Joint]:
    """Parts with the starts of what are no coordinates of their own, if there are any."""
    own = {link.part.name: link.part.starts for link in tree.links}
    every: tuple[Body | Frame | Joint, ...] = (*mechanism.joints, *mechanism.bodies, *mechanism.frames)
    parts = {part.name: part for part in every if part.starts != own.get(part.name, {})}
    left = {n: {k: v for k, v in part.starts.items() if k not in own.get(n, {})} for n, part in parts.items()}
    return {name: replace(part, starts=left[name]) for name, part in parts.items()}


def claim_starts(
    script: AssignmentEmitter, claimed: Mapping[str, Body | Frame | Joint], result: MechanismEquations
) -> None:
    """Add each of their starts as a claim."""
    for part in claimed.values():
        for key, bound in part.starts.items():
            freedom, is_rate = (key[:-2], True) if key.endswith(".f") else (key, False)
            port = f"{part.name}.{freedom}"
            if port in result.motions:
                motion = result.motions[port]
                value = motion.flow if is_rate else motion.pose
            else:
                value = result.readings[port]
            script.builder.claim(value, script.builder.folded(bound), script.named(port), part.span)


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
