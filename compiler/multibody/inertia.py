"""Inertia of a link: all bodies that it carries, in its own axes about its point of reference."""

from __future__ import annotations

from ..algebra.expression import ZERO, Expression, add, multiply, negate
from ..fast_dataclass import dataclass
from ..graph.mechanism import Body
from .assignment_emitter import AssignmentEmitter
from .axes import to_own
from .kinematics import Kinematics
from .link_state import LinkState
from .rotations import AxialTurn, of_rotation_vector
from .vectors import NO_MATRIX, NULL, Matrix, Vector, dot, is_null, matrix_of, minus, plus, scaled, summed

Square = list[list[Expression]]  # 6 x 6: torque and force by the rates of spin and velocity; symmetric


@dataclass(frozen=True, slots=True)
class LinkInertia:
    """Mass (kg), mass times the vector to the centre of mass (kg m), and the tensor about the point of reference (kg m^2)."""

    mass: Expression
    moment: Vector
    tensor: Matrix

    def matrix(self, active: tuple[int, ...]) -> Square:
        """Spatial inertia matrix over the active components."""
        x, y, z = self.moment
        coupling = ((ZERO, negate(z), y), (z, ZERO, negate(x)), (negate(y), x, ZERO))
        full = [[*self.tensor[r], *coupling[r]] for r in range(3)]
        full += [[*(coupling[c][r] for c in range(3)), *(self.mass if c == r else ZERO for c in range(3))] for r in range(3)]  # fmt: skip
        return [[full[r][c] if r in active and c in active else ZERO for c in range(6)] for r in range(6)]


def link_inertia(kinematics: Kinematics, moving: LinkState) -> LinkInertia:
    """Sum over the bodies of a link."""
    script, link = kinematics.script, moving.link
    mass: Expression = ZERO
    moment, tensor = NULL, NO_MATRIX
    for body in link.bodies:
        m = script.constant(body.mass, f"{body.name} mass", "kg")
        arm = to_own(moving.basis, minus(kinematics.centres[body.name], moving.origin))
        mass, moment = mass + m, plus(moment, scaled(m, arm))
        tensor = summed(tensor, summed(_own_tensor(kinematics, body, moving), _steiner(m, arm)))
    if not link.bodies:
        return LinkInertia(ZERO, NULL, NO_MATRIX)
    name = link.bodies[0].name
    if any(x != ZERO for row in tensor for x in row):
        tensor = script.matrix(f"{name} inertia", tensor)
    mass = script.let(f"{name} mass", mass, "kg")
    moment = script.vector(f"{name} moment", moment, "kg*m")
    if moving.branch.still and moving.angle != ZERO:
        moment = moving.inner(script, moment, f"{name} moment now")
        if 0 in moving.branch.active:
            tensor = AxialTurn(2, moving.angle).symmetric(script, tensor, f"{name} inertia now")
    return LinkInertia(mass, moment, tensor)


def tensor_entries(script: AssignmentEmitter, body: Body) -> list[Expression]:
    """Entries xx, yy, zz, xy, xz, yz about the centre of mass."""
    letters = ("xx", "yy", "zz", "xy", "xz", "yz")
    return [script.constant(getattr(body.inertia, c), f"{body.name} inertia {c}", "kg*m^2") for c in letters]


def _own_tensor(kinematics: Kinematics, body: Body, moving: LinkState) -> Matrix:
    """Inertia tensor about the centre of mass, in the axes of the link, as drawn."""
    script = kinematics.script
    xx, yy, zz, xy, xz, yz = tensor_entries(script, body)
    tensor: Matrix = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    if moving.branch.still and moving.branch.active == (2, 3, 4) and xx == yy == xy == xz == yz == ZERO:
        return tensor  # planar: the drawn angle does not change it
    drawn = of_rotation_vector(script, script.place(body.turn, f"{body.name} turn", "1"), f"{body.name} drawn")
    tensor = drawn.symmetric(script, tensor, f"{body.name} inertia drawn")
    columns = [to_own(moving.basis, row) for row in tensor]  # the rows of T B
    rows = [to_own(moving.basis, (columns[0][c], columns[1][c], columns[2][c])) for c in range(3)]  # and of B^T T B
    return rows[0], rows[1], rows[2]


def _steiner(m: Expression, arm: Vector) -> Matrix:
    """Parallel-axis term m (a.a - a a^T)."""
    if is_null(arm):
        return NO_MATRIX
    square = dot(arm, arm)
    rows = [[multiply(m, add(square if r == c else ZERO, negate(arm[r] * arm[c]))) for c in range(3)] for r in range(3)]
    return matrix_of(rows)
