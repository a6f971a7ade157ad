"""The row of four-bars in other programs, each with what it brings for closed loops: state at the end and time of the run alone.

exudyn: planar bodies in redundant coordinates and its generalized-alpha solver with the settings of the IFToMM example that
comes with it (constraints on positions; those on velocities do not pass a singular pose). pinocchio: hinges of a tree, loops closed by point constraints, its forward dynamics with proximal iterations; it has no integrator, so steps are those
of Dormand and Prince (order 8, fixed) with a projection of positions and velocities after each.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

STOP, GRAVITY = 10.0, 9.81
SPECTRAL_RADIUS = 0.95  # as in that example
Run = tuple[Any, float]  # x, y, vx, vy of the first corner; s


def exudyn_run(loops: int, steps: int) -> Run:
    """One run with so many steps."""
    import exudyn as exu
    from exudyn import itemInterface as items

    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.AddObject(items.ObjectGround())

    def body(at: tuple[float, float, float], velocity: tuple[float, float, float]) -> int:
        node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*at], initialVelocities=[*velocity]))
        found: int = mbs.AddObject(items.ObjectRigidBody2D(physicsMass=1, physicsInertia=1 / 12, nodeNumber=node))
        weight = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=found))
        mbs.AddLoad(items.LoadMassProportional(markerNumber=weight, loadVector=[0, -GRAVITY, 0]))
        return found

    def joint(one: int, at: list[float], other: int, there: list[float]) -> None:
        ends = [
            mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=b, localPosition=p))
            for b, p in ((one, at), (other, there))
        ]
        mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends))

    half = [0.5, 0, 0]
    back = [-0.5, 0, 0]
    uprights = [body((i, 0.5, np.pi / 2), (0.5, 0, -1)) for i in range(loops + 1)]
    for i, upright in enumerate(uprights):
        joint(ground, [i, 0, 0], upright, back)
    for i in range(1, loops + 1):
        coupler = body((i - 0.5, 1, 0), (1, 0, 0))
        joint(uprights[i - 1], half, coupler, back)
        joint(coupler, half, uprights[i], half)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = STOP, steps
    settings.timeIntegration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
    settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    if loops > 4:
        settings.linearSolverType = exu.LinearSolverType.EigenSparse
    began = time.perf_counter()
    mbs.SolveDynamic(settings)
    took = time.perf_counter() - began
    kinds = exu.OutputVariableType
    place, speed = (mbs.GetObjectOutputBody(uprights[0], k, half) for k in (kinds.Position, kinds.Velocity))
    return np.array([*place[:2], *speed[:2]]), took


class PinocchioRow:
    """The row as a tree of hinges with point constraints."""

    def __init__(self, loops: int) -> None:
        import pinocchio as pin

        self.pin, self.model = pin, pin.Model()
        self.model.gravity.linear = np.array([0, -GRAVITY, 0])
        shape = pin.Inertia(1.0, np.array([0.5, 0, 0]), np.diag([1e-3, 1 / 12, 1 / 12]))
        foot, couplers = [], []
        for i in range(
            loops + 1
        ):  # each coupler after the upright that carries it: the library wants subtrees in one piece
            foot.append(self._hinge(0, (float(i), 0.0), f"foot{i}", np.pi / 2, shape))
            if i < loops:
                couplers.append(self._hinge(foot[i], (1.0, 0.0), f"left{i + 1}", -np.pi / 2, shape))
        top = pin.SE3(np.eye(3), np.array([1.0, 0, 0]))
        closing = [(coupler, top, upright, top) for coupler, upright in zip(couplers, foot[1:], strict=True)]
        kind, frame = pin.ContactType.CONTACT_3D, pin.ReferenceFrame.LOCAL
        self.constraints = pin.StdVec_RigidConstraintModel()
        for one, at, other, there in closing:
            self.constraints.append(pin.RigidConstraintModel(kind, self.model, one, at, other, there, frame))
        self.closing = closing
        self.data = self.model.createData()
        self.found = pin.StdVec_RigidConstraintData()
        for each in self.constraints:
            self.found.append(each.createData())
        pin.initConstraintDynamics(self.model, self.data, self.constraints, self.found)
        self.settings: Any = None
        self.still = np.zeros(self.model.nv)
        self.uprights = [self.model.joints[j].idx_v for j in foot]

    def _hinge(self, parent: int, at: tuple[float, float], name: str, angle: float, shape: Any) -> int:
        pin = self.pin
        place = pin.SE3(pin.utils.rotate("z", angle), np.array([*at, 0.0]))
        found: int = self.model.addJoint(parent, pin.JointModelRZ(), place, name)
        self.model.appendBodyToJoint(found, shape, pin.SE3.Identity())
        return found

    def start(self) -> Any:
        """Angles and rates, one after the other."""
        rates = np.zeros(self.model.nv)
        rates[:] = 1.0  # couplers do not turn: against their uprights
        rates[self.uprights] = -1.0
        return np.concatenate([np.zeros(self.model.nq), rates])

    def rates(self, y: Any) -> Any:
        """Of angles and rates, by the library's forward dynamics."""
        n = self.model.nq
        there = self.pin.constraintDynamics(
            self.model, self.data, y[:n], y[n:], self.still, self.constraints, self.found, self.settings
        )
        return np.concatenate([y[n:], there])

    def projected(self, y: Any) -> Any:
        """Nearest state with closed loops and no velocity across them."""
        pin, n = self.pin, self.model.nq
        y = y.copy()
        for _ in range(3):
            pin.computeJointJacobians(self.model, self.data, y[:n])
            gaps = []
            for one, at, other, there in self.closing:
                a, b = self.data.oMi[one] * at, self.data.oMi[other] * there
                gaps.append(a.rotation.T @ (a.translation - b.translation))
            gap = np.array(gaps)[:, :2].ravel()
            slopes = pin.getConstraintsJacobian(self.model, self.data, self.constraints, self.found)
            slopes = slopes.reshape(-1, 3, n)[:, :2].reshape(-1, n)
            step, *_ = np.linalg.lstsq(slopes, gap, rcond=1e-10)
            y[:n] -= step
            if np.abs(gap).max() < 1e-13:
                break
        y[n:] -= np.linalg.lstsq(slopes, slopes @ y[n:], rcond=1e-10)[0]
        return y

    def run(self, steps: int, regularised: float) -> Run:
        """Dormand and Prince's method of order 8 with steps of one length. `regularised`: damping of singular systems by the library."""
        from scipy.integrate._ivp import dop853_coefficients as method

        self.settings = self.pin.ProximalSettings(1e-12, regularised, 10)
        stages = method.N_STAGES
        weights, matrix = method.B, method.A[:stages, :stages]
        y, size = self.start(), STOP / steps
        slopes = np.zeros((stages, len(y)))
        began = time.perf_counter()
        for _ in range(steps):
            for k in range(stages):
                slopes[k] = self.rates(y + size * (matrix[k, :k] @ slopes[:k]))
            y = self.projected(y + size * (weights @ slopes))
            if not np.isfinite(y).all():
                break
        took = time.perf_counter() - began
        turned, rate = y[0] + np.pi / 2, y[self.model.nq]
        c, s = np.cos(turned), np.sin(turned)
        return np.array([c, s, -s * rate, c * rate]), took
