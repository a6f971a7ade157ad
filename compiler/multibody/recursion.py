"""Accelerations by articulated inertias: a pass inwards and a pass outwards, O(links) assignments, no mass matrix.

R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 7; with accelerations of points instead of spatial ones, in axes of
the links, about the points where they turn, as H. Brandl, R. Johanni, M. Otter, A very efficient algorithm for the simulation of
robots and similar multibody systems without inversion of the mass matrix (1986). Columns of a link are eliminated one after the other, so
there is no 3 x 3 inverse. Gravity is an upward acceleration of the ground: all accelerations here are relative to free fall.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

from ..algebra.expression import MINUS_ONE, ONE, ZERO, Expression, Number, Symbol, add, divide, multiply, negate
from ..graph.mechanism import GROUND
from .axes import to_own, to_world
from .coordinates import is_turning
from .errors import NothingMoves
from .inertia import LinkInertia, Square, link_inertia
from .kinematics import Kinematics
from .link_state import LinkState, Marker
from .vectors import NULL, Matrix, Vector, cross, difference, is_null, matrix_of, negated, plus, summed

Row = list[Expression]  # of six
PLACES = range(6)


class Elimination:
    """One eliminated coordinate of a link: its column, U = I S (over D: `share`), and u = effort - S p."""

    __slots__ = ("column", "inertia", "loan", "number", "pull", "push", "unit", "whole")

    def __init__(self, number: int, column: Row, unit: int | None, push: Row, inertia: Expression) -> None:
        self.number, self.column, self.unit, self.push, self.inertia = number, column, unit, push, inertia
        self.pull: Expression = ZERO
        self.whole: Row = push
        self.loan: tuple[Expression, int] | None = None  # the root of an inertia that it is lent, and the unknown


class Recursion:
    """Accelerations from the poses, rates and wrenches of all links."""

    def __init__(self, kinematics: Kinematics, efforts: Mapping[str, Expression]) -> None:
        self.kinematics, self.script, self.efforts = kinematics, kinematics.script, efforts
        self.moving = kinematics.moving
        self.diagnostics: list[NothingMoves] = []
        self.inertias: list[LinkInertia] = [link_inertia(kinematics, m) for m in self.moving]
        self.matrices: list[Square] = []
        self.loads: list[Row] = []
        self.steps: list[list[Elimination]] = [[] for _ in self.moving]
        self.lent: dict[tuple[int, int], tuple[Expression, int]] = {}
        # links with turns that move nothing: an inertia about these (`idle_turns.py`)
        self.idle: Mapping[int, Matrix] = {}
        self.known: dict[int, Row] = {}  # accelerations of points of reference and axes
        self.pushed: dict[int, Vector] = {}  # loads not in these yet: world forces on floating bodies
        self.gravity = self.script.place(kinematics.mechanism.gravity, "gravity", "m/s^2")
        self._parents = {m.parent for m in self.moving}

    def run(self) -> None:
        """Write the accelerations of all coordinates."""
        for moving, inertia in zip(self.moving, self.inertias, strict=True):
            self.matrices.append(self.own_matrix(moving))
            self.loads.append(self._load(moving, inertia))
        for index in reversed(range(len(self.moving))):
            self._inwards(index)
        if not self.diagnostics:
            for index in range(len(self.moving)):
                self._outwards(index)

    def own_matrix(self, moving: LinkState) -> Square:
        """Inertia matrix of a link's bodies, with the addition about idle rotations."""
        inertia, added = self.inertias[moving.index], self.idle.get(moving.index)
        if added is not None:
            inertia = replace(inertia, tensor=summed(inertia.tensor, added))
        return inertia.matrix(moving.branch.active)

    def lend(self, inertias: Mapping[tuple[int, int], float]) -> None:
        """Give coordinates (links, and their numbers) a fictitious inertia, which an unknown cancels: see `fictitious_inertia.py`."""
        for (index, number), inertia in sorted(inertias.items()):
            told = self._nothing(self.moving[index], number)
            unit = "N" if told.what == "mass" else "N*m"
            unknown = self.script.builder.variable(self.script.named(f"{told.coordinate} balance"), "computed", unit)
            self.script.builder.balance(unknown, told)
            self.lent[index, number] = Number(sqrt(inertia)), unknown

    # ------------------------------------------------------------ inwards
    def _load(self, moving: LinkState, inertia: LinkInertia) -> Row:
        """Bias torque and force at zero acceleration: velocity-dependent terms minus the applied wrench."""
        torque, force = NULL, NULL
        active = moving.branch.active
        if not is_null(moving.spin):
            force = self.kinematics.centripetal(moving, inertia.moment)
            if 0 in active:
                torque = _gyroscopic(self.kinematics.squares(moving), inertia)
        torque, force = plus(torque, negated(moving.torque)), plus(force, negated(moving.force))
        name = f"{moving.link.name} load"
        return [self._let(f"{name}{i}", x) if i in active else ZERO for i, x in enumerate((*torque, *force))]

    def _let(self, name: str, x: Expression) -> Expression:
        return self.script.let(name, x)

    def _inwards(self, index: int) -> None:
        """Eliminate the coordinates of one link and add the remaining inertia and load to its parent."""
        moving = self.moving[index]
        link = moving.link
        name = link.name
        matrix, load = [list(row) for row in self.matrices[index]], list(self.loads[index])
        self._world_load(moving, load)
        prescribed: Row = [*moving.bias[0], *moving.bias[1]]
        for number, column in enumerate(_rows(moving)):
            coordinate = moving.coordinates[number] if number < len(moving.coordinates) else None
            if coordinate is not None and (coordinate.driven or coordinate.target is None):
                prescribed = [add(a, multiply(c, coordinate.acceleration)) for a, c in zip(prescribed, column, strict=True)]  # fmt: skip
                continue
            is_last = moving.parent is None and number == len(moving.columns) - 1
            if not self._eliminate(index, number, column, matrix, load, f"{name} {number}", is_last):
                return
        if moving.parent is not None:
            self._hand_over(index, matrix, load, prescribed, name)

    def _world_load(self, moving: LinkState, load: Row) -> None:
        """Rotate a force in world axes on a floating body to body axes, unless nothing depends on the rotation."""
        if is_null(moving.world_force) or self._is_alone(moving):
            return
        force = self.kinematics.own(moving.index, self.script.vector("push", moving.world_force), "push own")
        for i in range(3):
            load[3 + i] = load[3 + i] - force[i]

    def _is_alone(self, moving: LinkState) -> bool:
        """Return True if a floating link has no children and its centre of mass is its point of reference."""
        floats, has_arm = moving.link.step.kind == "float", not is_null(self.inertias[moving.index].moment)
        return floats and moving.index not in self._parents and not has_arm

    def _effort(self, moving: LinkState, number: int) -> Expression:
        if moving.link.step.kind == "float":
            return ZERO
        if moving.attitude is not None:
            return moving.drive[number]
        name = moving.link.coordinates[number]
        return ZERO if name.rpartition(".")[0] in self.kinematics.centres else self.efforts.get(name, ZERO)

    def _eliminate(
        self, index: int, number: int, column: Row, matrix: Square, load: Row, name: str, is_last: bool
    ) -> bool:  # fmt: skip
        moving = self.moving[index]
        effort = self._effort(moving, number)
        places = [i for i in PLACES if column[i] != ZERO]
        loan = self.lent.get((index, number))
        unit = places[0] if loan is None and len(places) == 1 and column[places[0]] in (ONE, MINUS_ONE) else None
        if unit is not None and column[unit] == MINUS_ONE:  # the coordinate counted the other way round
            column, effort = [negate(c) for c in column], negate(effort)
        push = [self._let(f"{name}.u{r}", add(*(matrix[r][k] * column[k] for k in places))) for r in PLACES]
        inertia = add(*(column[k] * push[k] for k in places))
        if loan is not None:
            root, unknown = loan
            inertia, effort = inertia + root * root, effort + root * Symbol(unknown)
        inertia = self._let(f"{name}.d", inertia)
        if inertia == ZERO:
            self.nothing(moving, number)
            return False
        step = Elimination(number, column, unit, push, inertia)
        step.loan = loan
        step.pull = self._let(f"{name}.drive", effort - add(*(column[k] * load[k] for k in places)))
        self.steps[index].append(step)
        if is_last:
            return True
        step.whole = [self._let(f"{name}.share{r}", divide(push[r], inertia)) if r != unit else ONE for r in PLACES]
        for r in PLACES:
            for c in range(r, 6):
                if r == unit or c == unit:
                    value: Expression = ZERO
                elif push[r] == ZERO or push[c] == ZERO:
                    continue
                elif push[r] == inertia and push[c] == inertia and matrix[r][c] == inertia:
                    value = ZERO  # the axis itself, projected out
                else:
                    value = self._let(f"{name}.i{r}{c}", matrix[r][c] - push[r] * step.whole[c])
                matrix[r][c] = matrix[c][r] = value
        if step.pull != ZERO:
            for r in PLACES:
                if r == unit:
                    load[r] = effort
                elif push[r] != ZERO:
                    load[r] = self._let(f"{name}.b{r}", load[r] + step.whole[r] * step.pull)
        return True

    def nothing(self, moving: LinkState, number: int) -> None:
        """Report that nothing moves along a coordinate."""
        self.diagnostics.append(self._nothing(moving, number))

    def _nothing(self, moving: LinkState, number: int) -> NothingMoves:
        link = moving.link
        name = link.coordinates[number]
        what = "inertia" if is_turning(name.rpartition(".")[2]) else "mass"
        outside = {moving.index}
        for index, other in enumerate(self.moving):
            if other.parent in outside:
                outside.add(index)
        found = [b for i in sorted(outside) for b in self.kinematics.tree.links[i].bodies]
        body = found[0] if found else self.kinematics.mechanism.bodies[0]
        return NothingMoves(body.span, name, body.name, what)

    def _hand_over(self, index: int, matrix: Square, load: Row, prescribed: Row, name: str) -> None:
        """Add the remaining inertia and load of a link to its parent, about the parent's point."""
        moving, script = self.moving[index], self.script
        assert moving.parent is not None
        if any(x != ZERO for x in prescribed):
            load = [
                self._let(f"{name}.p{r}", add(load[r], *(matrix[r][k] * prescribed[k] for k in PLACES))) for r in PLACES
            ]
        turn, couple, mass = _blocks(matrix)
        torque, force = (load[0], load[1], load[2]), (load[3], load[4], load[5])
        for number, passage in enumerate(reversed(moving.passage)):
            tag = f"{name}.turned{number}"
            turn = passage.symmetric(script, turn, f"{tag}.j")
            couple = passage.similar(script, couple, f"{tag}.h")
            mass = passage.symmetric(script, mass, f"{tag}.m")
            torque, force = passage.apply(script, torque, f"{tag}.t"), passage.apply(script, force, f"{tag}.f")
        r = moving.shift
        if not is_null(r):
            # about the parent's point: H + r x M, and J + r x H^T + (r x (H + r x M)^T)^T
            first = [cross(r, column) for column in couple]  # rows: r x H^T by columns of H^T, which are rows of H
            across = [cross(r, (mass[0][c], mass[1][c], mass[2][c])) for c in range(3)]  # columns of r x M
            couple_new = [
                [self._let(f"{name}.h{a}{b}", couple[a][b] + across[b][a]) for b in range(3)] for a in range(3)
            ]
            second = [cross(r, (row[0], row[1], row[2])) for row in couple_new]
            turn_new: list[list[Expression]] = [[ZERO] * 3 for _ in range(3)]
            for a in range(3):
                for b in range(a, 3):
                    value = add(turn[a][b], first[a][b], second[b][a])
                    turn_new[a][b] = turn_new[b][a] = self._let(f"{name}.j{a}{b}", value)
            torque = plus(torque, cross(r, force))
            turn, couple = matrix_of(turn_new), matrix_of(couple_new)
        added = _square(turn, couple, mass)
        to, active = self.matrices[moving.parent], self.moving[moving.parent].branch.active
        for a in active:
            for b in (c for c in active if c >= a):
                to[a][b] = to[b][a] = self._let(f"{name}.up{a}{b}", to[a][b] + added[a][b])
        rest = (*torque, *force)
        loads = self.loads[moving.parent]
        for a in active:
            loads[a] = self._let(f"{name}.down{a}", loads[a] + rest[a])

    # ------------------------------------------------------------ outwards
    def _carried(self, moving: LinkState, name: str) -> Row:
        """Acceleration of a link's point and axes with zero second derivatives of its own coordinates."""
        script = self.script
        if moving.parent is None:
            linear = negated(to_own(self.kinematics.ground(moving.branch).basis, self.gravity))
            angular = NULL
        else:
            a = self.acceleration(moving.parent)
            angular, linear = a[0], plus(a[1], cross(a[0], moving.shift))
            linear = script.vector(f"{name}.swept", linear)
        angular = plus(moving.back(script, angular, f"{name}.carried turn"), moving.bias[0])
        linear = plus(moving.back(script, linear, f"{name}.carried"), moving.bias[1])
        row = [*script.vector(f"{name}.from turn", angular), *script.vector(f"{name}.from", linear)]
        return [x if i in moving.branch.active else ZERO for i, x in enumerate(row)]

    def _outwards(self, index: int) -> None:
        """Second derivatives of one link's coordinates."""
        moving = self.moving[index]
        link = moving.link
        name = link.name
        floats = link.step.kind == "float"
        known: Row = [ZERO] * 6 if floats else self._carried(moving, name)
        for column, coordinate in zip(_rows(moving), moving.coordinates, strict=False):
            if not floats and coordinate.driven:
                known = [add(k, multiply(c, coordinate.acceleration)) for k, c in zip(known, column, strict=True)]
        # The coordinates were eliminated first to last, so they come back last to first; each sees the parent's
        # acceleration and those of the coordinates eliminated after it.
        for step in reversed(self.steps[index]):
            inward = add(*(step.push[k] * known[k] for k in PLACES))
            if step.whole is step.push:
                rate = divide(step.pull - inward, step.inertia)
            else:
                rate = divide(step.pull, step.inertia) - add(*(step.whole[k] * known[k] for k in PLACES))
            value = self._assigned(index, step, rate)
            if step.loan is not None:
                self._taken_back(index, step, value)
            known = [add(known[k], multiply(step.column[k], value)) for k in PLACES]
        self.known[index] = known
        if floats:
            self._float_rates(index, known)

    def _assigned(self, index: int, step: Elimination, rate: Expression) -> Expression:
        """Assign a second derivative to its state. Returns the acceleration along the column as it was eliminated."""
        moving = self.moving[index]
        link = moving.link
        sign = _rows(moving)[step.number] != step.column
        floats = link.step.kind == "float"
        targets: list[int | None] = [None if floats else c.target for c in moving.coordinates]
        if moving.attitude is not None:
            targets += list(moving.attitude.targets)
        target = targets[step.number]
        if target is None:
            return self._let(f"{link.coordinates[step.number]}.own rate", rate)
        self.script.builder.assign(target, negate(rate) if sign else rate, self.script.span, self.script.owner)
        return negate(Symbol(target)) if sign else Symbol(target)

    def _taken_back(self, index: int, step: Elimination, value: Expression) -> None:
        """Unknown effort that cancels a fictitious inertia."""
        assert step.loan is not None
        root, unknown = step.loan
        part = self.moving[index].link.part
        self.script.builder.vanishing(unknown, root * value - Symbol(unknown), part.span, self.script.named(part.name))

    def _float_rates(self, index: int, known: Row) -> None:
        """Second derivatives of a floating body's position: its acceleration in world axes."""
        moving = self.moving[index]
        script = self.script
        linear: Vector = (known[3], known[4], known[5])
        there = self.kinematics.world(index, linear, f"{moving.coordinates[0].name} world")
        pushed = NULL
        if self._is_alone(moving) and not is_null(moving.world_force):
            x, y, z = (divide(f, self.inertias[index].mass) for f in moving.world_force)
            pushed = self.pushed[index] = script.vector(f"{moving.coordinates[0].name} pushed", (x, y, z), "m/s^2")
        for coordinate, value in zip(moving.coordinates, plus(there, pushed, self.gravity), strict=True):
            assert coordinate.target is not None
            script.builder.assign(coordinate.target, value, script.span, script.owner)

    def acceleration(self, index: int) -> tuple[Vector, Vector]:
        """Acceleration of a link's axes and point of reference, link axes, relative to free fall."""
        k = self.known[index]
        name = f"{self.kinematics.tree.links[index].name}.a"
        if index in self.pushed:
            own = self.kinematics.own(index, self.pushed.pop(index), f"{name} pushed")
            k = [*k[:3], *(add(x, y) for x, y in zip(k[3:], own, strict=True))]
        row = self.known[index] = [self._let(f"{name}{i}", x) for i, x in enumerate(k)]
        return (row[0], row[1], row[2]), (row[3], row[4], row[5])

    def seen(self, placed: Marker, name: str) -> tuple[Vector, Vector]:
        """Acceleration of a marker and angular acceleration of its body, in the inertial frame, world axes."""
        index = None if placed.body == GROUND else self.kinematics.tree.place[placed.body]
        if index is None:
            return NULL, NULL
        moving = self.moving[index]
        angular, linear = self.acceleration(index)
        linear = plus(linear, cross(angular, placed.arm), self.kinematics.centripetal(moving, placed.arm))
        there = self.kinematics.world(index, self.script.vector(f"{name}.own", linear), f"{name}.world")
        turning = self.kinematics.world(index, angular, f"{name}.turning")
        return plus(there, self._fall(moving)), turning

    def _fall(self, moving: LinkState) -> Vector:
        """Gravity, without the component across the plane of a planar branch, in which nothing accelerates."""
        branch = moving.branch
        if all(i in branch.active for i in (3, 4, 5)):
            return self.gravity
        own = to_own(branch.basis, self.gravity)
        x, y, z = (g if i in branch.active else ZERO for i, g in zip((3, 4, 5), own, strict=True))
        return to_world(branch.basis, (x, y, z))


def _rows(moving: LinkState) -> list[Row]:
    return [[*turn, *slip] for turn, slip in moving.columns]


def _gyroscopic(squares: tuple[Expression, ...], inertia: LinkInertia) -> Vector:
    """w x (J w), by products of the components of the angular velocity w."""
    xx, yy, zz, xy, xz, yz = squares
    j = inertia.tensor
    return (
        add(difference(j[2][2], j[1][1]) * yz, j[1][2] * difference(yy, zz), j[0][2] * xy, negate(j[0][1] * xz)),
        add(difference(j[0][0], j[2][2]) * xz, j[0][2] * difference(zz, xx), j[0][1] * yz, negate(j[1][2] * xy)),
        add(difference(j[1][1], j[0][0]) * xy, j[0][1] * difference(xx, yy), j[1][2] * xz, negate(j[0][2] * yz)),
    )


def _blocks(m: Square) -> tuple[Matrix, Matrix, Matrix]:
    """Blocks J, H and M of the matrix."""
    j, h, mass = (matrix_of([row[c : c + 3] for row in m[r : r + 3]]) for r, c in ((0, 0), (0, 3), (3, 3)))
    return j, h, mass


def _square(turn: Matrix, couple: Matrix, mass: Matrix) -> Square:
    top = [[*turn[r], *couple[r]] for r in range(3)]
    return [*top, *([*(couple[c][r] for c in range(3)), *mass[r]] for r in range(3))]
