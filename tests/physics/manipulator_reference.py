"""An independent numerical reference for the planar micro-manipulator: equations by hand, two integrators, digits.

Nothing here knows the compiler. The equations of motion are written out from the thesis (its equation numbers are
quoted as (3.10), (4.14), ...), the forces and the Jacobian are differentiated by hand, and every number is in SI units.

Coordinates q = (c1, c2, c3, x, y, phi): the three shuttles along their guides, then the pose of the platform. The
state is z = (q, dq/dt). Arm i points along e_r = (cos, sin) of 0, 120, 240 deg; its shuttle slides along
e_t = (-sin, cos). The flexure between shuttle and platform has its longitudinal axis along e_t (local y) and its
lateral axis along e_r (local x). Arrays may carry leading axes; the last axis is the arm, the coordinate or the state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import Radau

Array: TypeAlias = NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]

ZERO: Triple = (0.0, 0.0, 0.0)
COORDINATES = ("c1", "c2", "c3", "x", "y", "phi")

COSINE: Array = np.array([1.0, -0.5, -0.5])
"""Cosines of the arms' angles 0, 120, 240 deg."""
SINE: Array = np.array([0.0, math.sqrt(3) / 2, -math.sqrt(3) / 2])
"""Sines of the arms' angles."""

SCALE: Array = np.array([1e-5] * 5 + [1e-3] + [7e-2] * 5 + [7.0])
"""Magnitudes that make the state of order one: 10 um, 1 mrad, and these at about 1.1 kHz."""
ENERGY_SCALE = 1e-10
"""Magnitude of the energies, J."""


@dataclass(frozen=True)
class Parameters:
    """Dimensions of the manipulator in SI units: Table 4.1, (4.5)-(4.18), and inferred ones."""

    density: float = 2330.0
    "kg/m^3, silicon (4.3.2)"
    height: float = 38e-6
    "h, m (Table 4.1)"
    spring_length: float = 1e-3
    "l_s of the reinforced flexure, m (Table 4.1)"
    folded_length: float = 400e-6
    "l_f of the folded flexure, m (Table 4.1)"
    rigid: float = 0.72
    "p, share of the reinforced flexure that is thick (Table 4.1: 720 um of 1 mm)"
    thickness: Triple = (1.95e-6, 1.75e-6, 1.75e-6)
    "d of the thin beams, m (4.15)"
    young: Triple = (130e9, 158e9, 158e9)
    "E along the arms, Pa (4.18)"
    corner: float = 170e-6
    "a, centre of the platform to its corners, m (fitted to f_phi = 1353 Hz)"
    fingers: float = 100.0
    "n, combs' finger pairs (inferred)"
    pitch: float = 6e-6
    "finger and gap together, m (inferred; Table 4.1: 2 um + 4 um)"
    permittivity: float = 8.8541878128e-12
    "eps0, F/m"
    bare_shuttle_mass: float = 39.8e-9
    "kg (4.5), before its flexure's mass is added"
    blocks: float = 378.0
    "of 12 um by 12 um that make up the platform (4.3.4)"
    hole_factor: float = 0.4375
    "share of a block that the holes leave (4.3.2)"
    platform_inertia: float = 2.94e-17
    "I_z, kg m^2 (4.13)"
    damping: float = 2.5e-5
    "r per shuttle, N s/m (4.4.2)"

    @cached_property
    def spring_arm(self) -> float:
        """s, corner to the middle of the flexure, m: half of l_s."""
        return self.spring_length / 2

    @cached_property
    def second_moment(self) -> Array:
        """I = h d^3/12, m^4 (4.16)."""
        return self.height * np.array(self.thickness) ** 3 / 12

    @cached_property
    def area(self) -> Array:
        """A = h d, m^2 (4.17)."""
        return self.height * np.array(self.thickness)

    @cached_property
    def k_phi(self) -> Array:
        """E I/l_s/(1 - p), N m/rad (4.14)."""
        return np.array(self.young) * self.second_moment / self.spring_length / (1 - self.rigid)

    @cached_property
    def k_x(self) -> Array:
        """12 E I/l_s^3/(1 - p^3), N/m (4.14)."""
        return 12 * np.array(self.young) * self.second_moment / self.spring_length**3 / (1 - self.rigid**3)

    @cached_property
    def k_y(self) -> Array:
        """E A/l_s/(1 - p), N/m (4.14)."""
        return np.array(self.young) * self.area / self.spring_length / (1 - self.rigid)

    @cached_property
    def k_g(self) -> Array:
        """Guiding stiffness of a shuttle's folded flexures, 48 E I/l_f^3, N/m (4.20)."""
        return 48 * np.array(self.young) * self.second_moment / self.folded_length**3

    @cached_property
    def gap(self) -> Array:
        """Between the combs' fingers, m: the pitch less the thickness."""
        return self.pitch - np.array(self.thickness)

    @cached_property
    def comb(self) -> Array:
        """C = n eps0 h/gap, N/V^2 (4.1)."""
        return self.fingers * self.permittivity * self.height / self.gap

    @cached_property
    def flexure_mass(self) -> float:
        """m_f, kg (4.6)."""
        section = 14e-6 * 720e-6 * (14**2 - 9**2) / 14**2 + 2e-6 * 280e-6
        return self.density * self.height * section

    @cached_property
    def shuttle_mass(self) -> float:
        """m_s with its flexure, kg (4.5), (4.6)."""
        return self.bare_shuttle_mass + self.flexure_mass

    @cached_property
    def platform_mass(self) -> float:
        """m_p = 378 blocks, kg (4.8), (4.9): 2.10849156 ug; 2.108492 ug would move x(5 ms) of `push_x` by 3e-11."""
        return self.blocks * self.density * 12e-6 * 12e-6 * self.height * self.hole_factor

    @cached_property
    def mass(self) -> Array:
        """The constant diagonal of the mass matrix over q; kg, and kg m^2 for phi."""
        return np.array([self.shuttle_mass] * 3 + [self.platform_mass] * 2 + [self.platform_inertia])

    @cached_property
    def resistance(self) -> Array:
        """The diagonal of the damping matrix over q; N s/m: the air at the shuttles, nothing else."""
        return np.array([self.damping] * 3 + [0.0] * 3)


NOMINAL = Parameters()


class Loads(NamedTuple):
    """Loads at one instant: force (N) and torque (N m) on the platform, volts on the push and pull combs."""

    fx: float = 0.0
    fy: float = 0.0
    m: float = 0.0
    push: Triple = ZERO
    pull: Triple = ZERO


Forcing: TypeAlias = Callable[[float], Loads]


# --- the flexure ------------------------------------------------------------------------------------------------------


class Stiffness(NamedTuple):
    """Of one flexure, or of several as arrays: N m/rad, N/m, N/m."""

    phi: Array
    x: Array
    y: Array


def _symmetric(xa: Array, ya: Array, half: Array) -> tuple[Array, Array]:
    """(3.9), counter-clockwise: local deflections seen from a frame turned by `half`."""
    return xa * np.cos(half) + ya * np.sin(half), -xa * np.sin(half) + ya * np.cos(half)


def flexure_energy(xa: Array, ya: Array, phi: Array, stiffness: Stiffness, turn: float = 0.5) -> Array:
    """(3.10): E = k_phi phi^2/2 + k_x xc^2/2 + k_y yc^2/2 with xc, yc in the frame turned by turn*phi, J.

    `turn` is 1/2 for coordinates in the axes of the flexure's near end (3.10), -1/2 in those of its far end (3.15),
    and 0 for the plain quadratic energy (3.3).
    """
    xc, yc = _symmetric(xa, ya, turn * phi)
    return (stiffness.phi * phi**2 + stiffness.x * xc**2 + stiffness.y * yc**2) / 2


def flexure_effort(
    xa: Array, ya: Array, phi: Array, stiffness: Stiffness, turn: float = 0.5
) -> tuple[Array, Array, Array]:
    """(F_x, F_y, M) = dE/d(xa, ya, phi), N, N, N m: (3.12), (3.13), (3.11) before their products are multiplied out.

    With u = turn*phi: dxc/dphi = turn*yc and dyc/dphi = -turn*xc, hence M = k_phi phi + turn (k_x - k_y) xc yc.
    """
    xc, yc = _symmetric(xa, ya, turn * phi)
    cosine, sine = np.cos(turn * phi), np.sin(turn * phi)
    along_x, along_y = stiffness.x * xc, stiffness.y * yc
    torque = stiffness.phi * phi + turn * (stiffness.x - stiffness.y) * xc * yc
    return along_x * cosine - along_y * sine, along_x * sine + along_y * cosine, torque


def flexure_stiffness(xa: Array, ya: Array, phi: Array, stiffness: Stiffness, turn: float = 0.5) -> Array:
    """The second derivatives of (3.10) over (xa, ya, phi), as (..., 3, 3)."""
    xc, yc = _symmetric(xa, ya, turn * phi)
    cosine, sine = np.cos(turn * phi), np.sin(turn * phi)
    kx, ky = stiffness.x, stiffness.y
    xx = kx * cosine**2 + ky * sine**2
    yy = kx * sine**2 + ky * cosine**2
    xy = (kx - ky) * sine * cosine
    xp = turn * (kx - ky) * (cosine * yc - sine * xc)
    yp = turn * (kx - ky) * (sine * yc + cosine * xc)
    pp = stiffness.phi + turn**2 * (kx - ky) * (yc**2 - xc**2)
    rows = [np.stack([xx, xy, xp], -1), np.stack([xy, yy, yp], -1), np.stack([xp, yp, pp], -1)]
    return np.stack(rows, -2)


# --- the manipulator --------------------------------------------------------------------------------------------------


def _flexures(parameters: Parameters) -> Stiffness:
    return Stiffness(parameters.k_phi, parameters.k_x, parameters.k_y)


def flexure_coordinates(q: Array, parameters: Parameters = NOMINAL) -> tuple[Array, Array, Array]:
    """Relative coordinates (xa, ya, phia) of the three flexures in the axes of their shuttles; m, m, rad.

    xa = e_r.p + a (cos phi - 1) + s sin phi,  ya = e_t.p + a sin phi + s (1 - cos phi) - c,  phia = phi.
    """
    c, x, y, phi = q[..., :3], q[..., 3:4], q[..., 4:5], q[..., 5:6]
    a, s = parameters.corner, parameters.spring_arm
    sine, versine = np.sin(phi), 2 * np.sin(phi / 2) ** 2
    xa = x * COSINE + y * SINE - a * versine + s * sine
    ya = -x * SINE + y * COSINE + a * sine + s * versine - c
    return xa, ya, np.broadcast_to(phi, xa.shape)


def potential(q: Array, parameters: Parameters = NOMINAL) -> Array:
    """Energy in the three folded and the three reinforced flexures, J."""
    flexures = flexure_energy(*flexure_coordinates(q, parameters), _flexures(parameters))
    total: Array = np.sum(flexures + parameters.k_g * q[..., :3] ** 2 / 2, axis=-1)
    return total


def stored(z: Array, parameters: Parameters = NOMINAL) -> Array:
    """Potential and kinetic energy, J."""
    kinetic: Array = np.sum(parameters.mass * z[..., 6:] ** 2, axis=-1) / 2
    return potential(z[..., :6], parameters) + kinetic


def restoring(q: Array, parameters: Parameters = NOMINAL) -> Array:
    """Generalised forces of all springs over q, the gradient of `potential`, by virtual work; N, and N m for phi."""
    a, s = parameters.corner, parameters.spring_arm
    fx, fy, m = flexure_effort(*flexure_coordinates(q, parameters), _flexures(parameters))
    cosine, sine = np.cos(q[..., 5:6]), np.sin(q[..., 5:6])
    force = np.empty(q.shape)
    force[..., :3] = parameters.k_g * q[..., :3] - fy
    force[..., 3] = np.sum(fx * COSINE - fy * SINE, axis=-1)
    force[..., 4] = np.sum(fx * SINE + fy * COSINE, axis=-1)
    force[..., 5] = np.sum(m + fx * (s * cosine - a * sine) + fy * (a * cosine + s * sine), axis=-1)
    return force


def stiffness(q: Array, parameters: Parameters = NOMINAL) -> Array:
    """The 6 by 6 derivative of `restoring` at one q (no leading axes)."""
    a, s = parameters.corner, parameters.spring_arm
    local = flexure_coordinates(q, parameters)
    fx, fy, _ = flexure_effort(*local, _flexures(parameters))
    tangent = flexure_stiffness(*local, _flexures(parameters))
    cosine, sine = math.cos(q[5]), math.sin(q[5])
    total: Array = np.diag(np.concatenate([parameters.k_g, np.zeros(3)]))
    for arm in range(3):
        gradient = np.zeros((3, 6))  # d(xa, ya, phia)/dq
        gradient[1, arm] = -1.0
        gradient[0, 3:] = COSINE[arm], SINE[arm], s * cosine - a * sine
        gradient[1, 3:] = -SINE[arm], COSINE[arm], a * cosine + s * sine
        gradient[2, 5] = 1.0
        total += gradient.T @ tangent[arm] @ gradient
        total[5, 5] += fx[arm] * (-a * cosine - s * sine) + fy[arm] * (s * cosine - a * sine)
    return total


def applied(
    parameters: Parameters = NOMINAL,
    fx: float = 0.0,
    fy: float = 0.0,
    m: float = 0.0,
    push: Sequence[float] | Array = ZERO,
    pull: Sequence[float] | Array = ZERO,
) -> Array:
    """Generalised forces over q of the combs, C (V_push^2 - V_pull^2) by (4.1), and of the hand on the platform."""
    comb = parameters.comb * (np.square(push) - np.square(pull))
    return np.array([comb[0], comb[1], comb[2], fx, fy, m])


def _motion(z: Array, load: Array, parameters: Parameters) -> Array:
    q, rate = z[..., :6], z[..., 6:]
    force = load - parameters.resistance * rate - restoring(q, parameters)
    return np.concatenate([rate, force / parameters.mass], axis=-1)


def derivative(
    t: float,
    z: Array,
    parameters: Parameters = NOMINAL,
    fx: float = 0.0,
    fy: float = 0.0,
    m: float = 0.0,
    push: Sequence[float] | Array = ZERO,
    pull: Sequence[float] | Array = ZERO,
) -> Array:
    """dz/dt of the 12 states: M ddq = applied - r dq - restoring(q). The loads are values, so `t` does not enter."""
    return _motion(z, applied(parameters, fx, fy, m, push, pull), parameters)


def jacobian(z: Array, parameters: Parameters = NOMINAL) -> Array:
    """The 12 by 12 derivative of `derivative` over z; the loads do not enter."""
    matrix = np.zeros((12, 12))
    matrix[:6, 6:] = np.eye(6)
    matrix[6:, :6] = -stiffness(z[:6], parameters) / parameters.mass[:, None]
    matrix[6:, 6:] = np.diag(-parameters.resistance / parameters.mass)
    return matrix


# --- integrators ------------------------------------------------------------------------------------------------------


class Trajectory(NamedTuple):
    """States at the instants; the work that the loads have done and the energy that the air has taken since t = 0."""

    instants: Array
    "s, (n,)"
    states: Array
    "(n, 12)"
    work: Array
    "J, (n,)"
    dissipated: Array
    "J, (n,)"


class _Flow(NamedTuple):
    """State with its energies, at the end of a segment: 12 states, work, dissipation."""

    z: Array
    work: float
    dissipated: float


def _over_segments(
    advance: Callable[[float, float, _Flow], _Flow],
    t_end: float,
    instants: Sequence[float],
    breaks: Sequence[float],
    start: Array | None,
) -> Trajectory:
    """Go from 0 to t_end by segments that end at every break and every instant, so that no value is interpolated."""
    wanted = sorted(set(instants))
    if wanted and not 0 <= wanted[0] <= wanted[-1] <= t_end:
        raise ValueError(f"instants must lie in 0 .. {t_end}")
    ends = sorted({t for t in (*breaks, *wanted, t_end) if 0 < t <= t_end})
    flow = _Flow(np.zeros(12) if start is None else np.array(start, dtype=float), 0.0, 0.0)
    reached = {0.0: flow}
    begin = 0.0
    for end in ends:
        flow = advance(begin, end, flow)
        reached[end] = flow
        begin = end
    flows = [reached[t] for t in wanted]
    return Trajectory(
        np.array(wanted),
        np.array([flow.z for flow in flows]),
        np.array([flow.work for flow in flows]),
        np.array([flow.dissipated for flow in flows]),
    )


def integrate(
    forcing: Forcing,
    t_end: float,
    instants: Sequence[float],
    breaks: Sequence[float] = (),
    rtol: float = 1e-10,
    parameters: Parameters = NOMINAL,
    start: Array | None = None,
) -> Trajectory:
    """Radau IIA of order 5 with variable steps, on states and energies of order one, restarted at breaks and instants.

    The absolute tolerance is `rtol` of each state's magnitude in SCALE. `start` is the state at 0, rest if left out.
    Below 3e-11 round-off makes the steps collapse: minutes instead of a second.
    """
    scale = np.concatenate([SCALE, [ENERGY_SCALE, ENERGY_SCALE]])

    def slope(t: float, w: Array) -> Array:
        z = w[:12] * SCALE
        load, rate = applied(parameters, *forcing(t)), z[6:]
        energies = [load @ rate, rate @ (parameters.resistance * rate)]
        total: Array = np.concatenate([_motion(z, load, parameters), energies]) / scale
        return total

    def slope_jacobian(t: float, w: Array) -> Array:
        z = w[:12] * SCALE
        matrix = np.zeros((14, 14))
        matrix[:12, :12] = jacobian(z, parameters)
        matrix[12, 6:12] = applied(parameters, *forcing(t))
        matrix[13, 6:12] = 2 * parameters.resistance * z[6:]
        scaled: Array = matrix * scale / scale[:, None]
        return scaled

    def advance(begin: float, end: float, flow: _Flow) -> _Flow:
        w = np.concatenate([flow.z, [flow.work, flow.dissipated]]) / scale
        solver = Radau(slope, begin, w, end, rtol=rtol, atol=rtol, jac=slope_jacobian)
        while solver.status == "running":
            message = solver.step()
        if solver.status != "finished":
            raise ArithmeticError(f"Radau stopped at {solver.t} s: {message}")
        w = solver.y * scale
        return _Flow(w[:12], float(w[12]), float(w[13]))

    return _over_segments(advance, t_end, instants, breaks, start)


@cache
def _gauss(stages: int) -> tuple[Array, Array, Array, Array]:
    """Gauss-Legendre collocation on (0, 1): nodes c, weights b, matrix A, and d = b A^-1."""
    points, weights = np.polynomial.legendre.leggauss(stages)
    nodes: Array = np.asarray(points + 1, dtype=np.float64) / 2
    halves: Array = np.asarray(weights, dtype=np.float64) / 2
    powers = np.arange(stages)
    vandermonde = nodes[:, None] ** powers
    integrals = nodes[:, None] ** (powers + 1) / (powers + 1)
    matrix: Array = np.asarray(np.linalg.solve(vandermonde.T, integrals.T).T, dtype=np.float64)
    ends: Array = np.asarray(np.linalg.solve(matrix.T, halves), dtype=np.float64)
    return nodes, halves, matrix, ends


def integrate_gauss(
    forcing: Forcing,
    t_end: float,
    instants: Sequence[float],
    breaks: Sequence[float] = (),
    step: float = 2e-6,
    stages: int = 4,
    parameters: Parameters = NOMINAL,
    start: Array | None = None,
) -> Trajectory:
    """Gauss-Legendre collocation of order 2*stages with equal steps of at most `step` from break to break and instant.

    The unknowns are the stages' increments Z of the scaled state, Z = h A F(w + Z), solved by Newton's method with the
    Jacobian at the head of the step; the step ends at w + d Z, so that no stiff force is evaluated outside the stages.
    """
    nodes, weights, matrix, advance_weights = _gauss(stages)
    identity = np.eye(12 * stages)

    def one_step(t: float, h: float, flow: _Flow, guess: Array) -> tuple[_Flow, Array]:
        head = flow.z / SCALE
        loads = np.array([applied(parameters, *forcing(t + h * node)) for node in nodes])
        slope_jacobian = jacobian(flow.z, parameters) * SCALE / SCALE[:, None]
        inverse = np.linalg.inv(identity - h * np.kron(matrix, slope_jacobian))
        increments, last = guess, math.inf
        for _ in range(30):
            slope = _motion((head + increments) * SCALE, loads, parameters) / SCALE
            change = inverse @ (h * matrix @ slope - increments).ravel()
            increments = increments + change.reshape(stages, 12)
            size = float(np.max(np.abs(change)))
            if size < 1e-16 or (size < 1e-9 and size >= last / 2):  # at round-off it shrinks no further
                break
            last = size
        else:
            raise ArithmeticError(f"Newton's method did not converge at {t} s: {size}")
        rates = ((head + increments) * SCALE)[:, 6:]
        work = h * float(weights @ np.sum(loads * rates, axis=-1))
        loss = h * float(weights @ np.sum(parameters.resistance * rates**2, axis=-1))
        z = (head + advance_weights @ increments) * SCALE
        return _Flow(z, flow.work + work, flow.dissipated + loss), increments

    # The collocation polynomial of the step before, through its head and its stages, gives the first guess.
    known = np.concatenate([[0.0], nodes])
    powers = np.arange(stages + 1)
    extrapolate = np.linalg.solve(
        (known[:, None] ** powers).T, ((1 + nodes)[:, None] ** powers - np.ones(stages + 1)).T
    ).T[:, 1:]

    def advance(begin: float, end: float, flow: _Flow) -> _Flow:
        count = math.ceil((end - begin) / step * (1 - 1e-12))
        h = (end - begin) / count
        increments = np.zeros((stages, 12))
        for index in range(count):
            flow, increments = one_step(begin + index * h, h, flow, extrapolate @ increments)
        return flow

    return _over_segments(advance, t_end, instants, breaks, start)


# --- scenarios --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scenario:
    """A run from rest: its loads, its end, the instants of jumps in derivatives, and the instants of the reference digits."""

    forcing: Forcing
    t_end: float
    instants: tuple[float, ...]
    breaks: tuple[float, ...] = field(default=())


def smoothstep5(t: float, begin: float, end: float) -> float:
    """The quintic u^3 (10 - 15 u + 6 u^2) from 0 at `begin` to 1 at `end`."""
    u = min(max((t - begin) / (end - begin), 0.0), 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def push_x() -> Scenario:
    """A force on the platform in x that rises to 30 uN within 5 ms, then stays; 20 ms."""
    return Scenario(
        lambda t: Loads(fx=30e-6 * smoothstep5(t, 0.0, 5e-3)), 20e-3, (2.5e-3, 5e-3, 10e-3, 15e-3, 20e-3), (5e-3,)
    )


def drive_560() -> Scenario:
    """14 V at 560 Hz on pull 2 and push 3, so a force at 1120 Hz by (4.25), close to the resonance in x; 10 ms."""

    def forcing(t: float) -> Loads:
        volt = 14 * math.sin(2 * math.pi * 560 * t)
        return Loads(push=(0.0, 0.0, volt), pull=(0.0, volt, 0.0))

    return Scenario(forcing, 10e-3, (1e-3, 2.5e-3, 5e-3, 7.5e-3, 10e-3))


def inverse_kinematics(x: float, y: float, phi: float, parameters: Parameters = NOMINAL) -> Triple:
    """(5.9)-(5.15) for the symmetric flexure: shuttles that put the platform at (x, y, phi) with yc = 0, m.

    c_i = t_i - r_i tan(phi/2), where t_i is ya + c_i of `flexure_coordinates`, and r_i is xa.
    """
    radial, tangential, _ = flexure_coordinates(np.array([0.0, 0.0, 0.0, x, y, phi]), parameters)
    first, second, third = (float(value) for value in tangential - radial * math.tan(phi / 2))
    return first, second, third


def feed_forward() -> Scenario:
    """The feed-forward of 5.2 with the gains of Table 5.1, to x = 8 um within 10 ms; 20 ms in all."""
    gain = (19400.0, 18900.0, 18900.0)

    def forcing(t: float) -> Loads:
        shuttles = inverse_kinematics(0.735 * 8e-6 * smoothstep5(t, 0.0, 10e-3), 0.0, 0.0)
        volts = [g * math.sqrt(abs(c)) for g, c in zip(gain, shuttles, strict=True)]
        push = [volt if c > 0 else 0.0 for volt, c in zip(volts, shuttles, strict=True)]
        pull = [volt if c < 0 else 0.0 for volt, c in zip(volts, shuttles, strict=True)]
        return Loads(push=(push[0], push[1], push[2]), pull=(pull[0], pull[1], pull[2]))

    return Scenario(forcing, 20e-3, (5e-3, 10e-3, 15e-3, 20e-3), (10e-3,))


SCENARIOS: Mapping[str, Callable[[], Scenario]] = MappingProxyType(
    {"push_x": push_x, "drive_560": drive_560, "feed_forward": feed_forward}
)


OUTPUTS = (*COORDINATES, "stored", "work", "dissipated")
"""What a row of the reference holds, m, rad and J."""

# From `integrate_gauss` with 4 stages and steps of 2 us. Relative to each output's largest value in its run:
# - the same at 1 and 10 us, and 3 stages at 1 and 2 us, agree on x to 6e-13 (push_x, feed_forward: 5e-14), on c2, c3 to
#   2e-14, on the energies to 1e-13, on phi to 3e-11, on c1 (some nanometres) to 2e-12, on y (likewise) to 2e-10;
# - `integrate` at rtol = 1e-10 agrees on x, c2, c3 to 8e-12 (push_x), 3e-12 (drive_560), 1.1e-11 (feed_forward), on the
#   energies to 2e-11, on c1 and phi to 3e-10, on y to 3e-9; at rtol = 1e-8 on x to 4e-9, all else to 6e-7.
# fmt: off
_ROWS: dict[str, dict[float, tuple[float, ...]]] = {
    "push_x": {
        2.5e-3: (-1.029101948947e-08, -4.157022245574e-06, 4.133269566552e-06, 4.786661567454e-06,
                 8.970794277538e-10, -6.675624660917e-05, 3.594695395098e-11, 3.645081790989e-11, 5.038639589141e-13),
        5e-3: (-2.068982682823e-08, -8.405847436418e-06, 8.356852620309e-06, 9.678468044695e-06,
                 1.877090870490e-09, -1.366443957193e-04, 1.452193373741e-10, 1.462429359111e-10, 1.023598536930e-12),
        10e-3: (-2.070080710237e-08, -8.404537969699e-06, 8.355621582722e-06, 9.677001283843e-06,
                 1.844367703388e-09, -1.365121441690e-04, 1.451749822203e-10, 1.461989330855e-10, 1.023950865202e-12),
        15e-3: (-2.068873006448e-08, -8.402830435847e-06, 8.353920633757e-06, 9.675033394496e-06,
                 1.850535441016e-09, -1.364755507797e-04, 1.451159286768e-10, 1.461398964051e-10, 1.023967728287e-12),
        20e-3: (-2.068397588075e-08, -8.403548266412e-06, 8.354607091011e-06, 9.675844161760e-06,
                 1.863854856135e-09, -1.365277449756e-04, 1.451402508568e-10, 1.461642194230e-10, 1.023968566223e-12),
    },
    "drive_560": {
        1e-3: (9.942373930879e-10, 6.302438881767e-07, -6.299870389518e-07, -7.275952767355e-07,
                 5.763238863845e-10, 2.453871068244e-06, 1.905554998823e-12, 2.634856115676e-12, 7.293011168530e-13),
        2.5e-3: (-2.117404022309e-08, -2.553952569138e-06, 2.509391629380e-06, 2.923323523371e-06,
                 5.492151420152e-10, -1.288925938715e-04, 1.466521635662e-11, 2.107089536750e-11, 6.405679010883e-12),
        5e-3: (-2.342480872617e-08, -2.473163511346e-06, 2.461991612820e-06, 2.849312806043e-06,
                 -1.198924390808e-08, -6.783840216004e-05, 2.811991052455e-11, 6.299601886764e-11, 3.487610834309e-11),
        7.5e-3: (4.787289676141e-09, 1.957801962102e-06, -1.881481718057e-06, -2.216611359408e-06,
                 -2.242483329108e-08, 1.590334055787e-04, 2.877595214205e-11, 1.041927176884e-10, 7.541676554637e-11),
        10e-3: (2.785788246133e-08, 3.640612763090e-06, -3.577653565900e-06, -4.167470060818e-06,
                 -2.785528170176e-09, 1.780735095587e-04, 3.047206300390e-11, 1.597010762991e-10, 1.292290132952e-10),
    },
    "feed_forward": {
        5e-3: (-8.771309194038e-09, -3.477082636010e-06, 3.457181278420e-06, 4.003493177044e-06,
                 6.736664549129e-10, -5.622416560435e-05, 2.492075330287e-11, 2.509386431648e-11, 1.731110136126e-13),
        10e-3: (-1.767886425212e-08, -6.986740842754e-06, 6.946612989056e-06, 8.044413636276e-06,
                 1.134045665196e-09, -1.133530283288e-04, 1.003281638461e-10, 1.006765071664e-10, 3.483433202739e-13),
        15e-3: (-1.767899862153e-08, -6.986452200966e-06, 6.946333241073e-06, 8.044085476247e-06,
                 1.131079161548e-09, -1.133358529718e-04, 1.003199759654e-10, 1.006683221187e-10, 3.483461532203e-13),
        20e-3: (-1.767793601383e-08, -6.986335674745e-06, 6.946215450364e-06, 8.043950193268e-06,
                 1.132215139422e-09, -1.133362486558e-04, 1.003166015693e-10, 1.006649478580e-10, 3.483462887280e-13),
    },
}
# fmt: on

REFERENCE: Mapping[str, Mapping[float, Mapping[str, float]]] = MappingProxyType(
    {
        name: MappingProxyType(
            {instant: MappingProxyType(dict(zip(OUTPUTS, row, strict=True))) for instant, row in rows.items()}
        )
        for name, rows in _ROWS.items()
    }
)
"""REFERENCE[scenario][instant][output]: the digits that a compiled model must meet."""


# --- equilibrium and frequencies --------------------------------------------------------------------------------------


def _newton(system: Callable[[Array], tuple[Array, Array]], start: Array, scale: Array) -> Array:
    """The zero of `system`, which gives the residual and its derivative, to round-off; unknowns scaled to order one."""
    value = start
    for _ in range(60):
        residual, derivative_matrix = system(value)
        weighted = derivative_matrix * scale
        rows = 1 / np.max(np.abs(weighted), axis=1)
        change = np.linalg.solve(weighted * rows[:, None], residual * rows)
        value = value - change * scale
        if np.max(np.abs(change)) < 1e-13:
            return value
    raise ArithmeticError("Newton's method did not converge")


def static(
    fx: float = 0.0,
    fy: float = 0.0,
    m: float = 0.0,
    push: Sequence[float] | Array = ZERO,
    pull: Sequence[float] | Array = ZERO,
    parameters: Parameters = NOMINAL,
) -> Array:
    """The equilibrium q under constant loads: restoring(q) = applied; m, and rad for phi."""
    load = applied(parameters, fx, fy, m, push, pull)
    return _newton(lambda q: (restoring(q, parameters) - load, stiffness(q, parameters)), np.zeros(6), SCALE[:6])


def frequencies(parameters: Parameters = NOMINAL) -> Array:
    """The six natural frequencies abs(lambda)/(2 pi) of the damped model linearised at rest, rising, Hz."""
    matrix = jacobian(np.zeros(12), parameters) * SCALE / SCALE[:, None]
    found = np.sort(np.abs(np.linalg.eigvals(matrix))) / (2 * math.pi)
    return found[::2]


def undamped_frequencies(parameters: Parameters = NOMINAL) -> Array:
    """The six natural frequencies without the air, from the symmetric K and M at rest, rising, Hz."""
    root = np.sqrt(parameters.mass)
    values = np.linalg.eigvalsh(stiffness(np.zeros(6), parameters) / root / root[:, None])
    found: Array = np.sqrt(values) / (2 * math.pi)
    return found


# --- one flexure alone, section 3.4 -----------------------------------------------------------------------------------


class Deflection(NamedTuple):
    """Of the body at the flexure's end, in world axes, from where it was undeformed: m, m, rad."""

    x: float
    y: float
    phi: float


def flexure_static(
    order: Literal["world", "body"],
    symmetric: bool,
    fx: float,
    torque: float,
    matrix: Triple = (1.09e-8, 0.0584, 34404.0),
    length: float = 1e-3,
) -> Deflection:
    """The world-flexure and the body-flexure of section 3.4 in equilibrium under a force and a torque at the end.

    Geometry. The flexure of length l = 1 mm lies along the world's y axis. Its near end is clamped to the ground at the
    origin; a massless rod goes from there to (0, l/2). There the spring sits, between two frames that coincide and are
    parallel to the world's axes when it is undeformed: one fixed to the ground, the other to the body. The body (the
    platform; its mass and inertia do not matter here) has its frame at (0, l): the second rod, from (0, l/2) to (0, l),
    turns with it. phi is counter-clockwise. So the spring is a joint with all three freedoms from the ground to the
    body, at (0, l/2), at an angle of 0. `world` is the order (x, y, phi): the spring's x and y are measured along the
    ground's axes (`axes = from`). `body` is the order (phi, x, y): along the body's (`axes = to`). `matrix` is
    (k_phi, k_x, k_y) of (3.16), rounded as printed. The loads act on the body at (0, l): the force `fx` stays along the
    world's x axis and does not turn with the body (the text says body orientation, its numbers say world); `torque` is
    about z. `symmetric = False` takes the plain quadratic energy (3.17), `True` takes (3.20) in `world` and (3.21) in
    `body`, with k_y/2 = 1.72e4 in place of the misprint 1.72e5.

    With r = l/2 the body's deflection is, for `world` and for `body`,

        X = x - r sin(phi)                     Y = y + r (cos(phi) - 1)
        X = x cos(phi) - (y + r) sin(phi)      Y = x sin(phi) + y cos(phi) + r (cos(phi) - 1)

    and the equilibrium is stationary in E(x, y, phi) - fx X - torque phi. 0.8 uN turn the body by -2.10 deg.
    """
    r = length / 2
    stiff = Stiffness(*(np.array(value) for value in matrix))
    turn = 0.0 if not symmetric else 0.5 if order == "world" else -0.5
    world = order == "world"

    def system(q: Array) -> tuple[Array, Array]:
        x, y, phi = q
        cosine, sine = math.cos(phi), math.sin(phi)
        effort = np.array(flexure_effort(x, y, phi, stiff, turn))
        tangent = flexure_stiffness(x, y, phi, stiff, turn)
        if world:
            load = np.array([fx, 0.0, torque - fx * r * cosine])
            load_tangent = np.diag([0.0, 0.0, fx * r * sine])
        else:
            load = np.array([fx * cosine, -fx * sine, torque - fx * (x * sine + (y + r) * cosine)])
            xp, yp, pp = -fx * sine, -fx * cosine, fx * ((y + r) * sine - x * cosine)
            load_tangent = np.array([[0.0, 0.0, xp], [0.0, 0.0, yp], [xp, yp, pp]])
        return effort - load, tangent - load_tangent

    x, y, phi = _newton(system, np.zeros(3), np.array([1e-5, 1e-5, 1e-2]))
    versine = 2 * math.sin(phi / 2) ** 2
    if world:
        return Deflection(float(x - r * math.sin(phi)), float(y - r * versine), float(phi))
    cosine, sine = math.cos(phi), math.sin(phi)
    return Deflection(float(x * cosine - (y + r) * sine), float(x * sine + y * cosine - r * versine), float(phi))
