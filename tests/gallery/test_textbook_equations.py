"""State equations of textbook graphs, as sympy expressions, against derivations by hand.

The graphs are of the kinds that Karnopp, Margolis and Rosenberg (System Dynamics), Borutzky (Bond Graph Methodology) and Gawthrop
and Smith (Metamodelling) use to teach the procedure; the right sides are derived independently here, and each case shows the derivation.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import pytest
import sympy

import bondgraph


@dataclass(frozen=True, slots=True)
class Case:
    """A graph in bare numbers, and its equations by hand: state -> right side, over the names of the graph (`coil_p` is `coil.p`)."""

    name: str
    graph: str
    by_hand: Callable[..., Mapping[str, Any]]


CASES = [
    # One loop, integral causality all over: p' = sum of efforts.
    Case(
        "series RLC (Karnopp et al.)",
        """
        parameter U = 1, R = 2, L = 3, C = 4
        Se source : e = U
        R r : e = R*f
        I coil : p = L*f
        C cap : q = C*e
        1 loop
        source -> loop -> r, coil, cap
        """,
        lambda U, R, coil_p, L, cap_q, C: {"coil.p": U - R * coil_p / L - cap_q / C, "cap.q": coil_p / L},
    ),
    # The quarter car over a road velocity V: tyre k_t under the axle m_u, spring and damper between it and the body m_s.
    Case(
        "quarter car (Karnopp et al.)",
        """
        parameter V = 1, k_t = 2, k_s = 3, b = 4, m_u = 5, m_s = 6, g = 9
        Sf road : f = V
        C tyre : e = k_t*q
        C spring : e = k_s*q
        R damper : e = b*f
        I axle : p = m_u*f
        I body : p = m_s*f
        Se w_u : e = -m_u*g
        Se w_s : e = -m_s*g
        1 wheel, chassis
        road -> 0(tyre) -> wheel -> 0(1(spring, damper)) -> chassis -> body
        wheel -> axle
        w_u -> wheel
        w_s -> chassis
        """,
        lambda V, axle_p, m_u, body_p, m_s, k_t, tyre_q, k_s, spring_q, b, g: {
            "tyre.q": V - axle_p / m_u,
            "spring.q": axle_p / m_u - body_p / m_s,
            "axle.p": k_t * tyre_q - k_s * spring_q - b * (axle_p / m_u - body_p / m_s) - m_u * g,
            "body.p": k_s * spring_q + b * (axle_p / m_u - body_p / m_s) - m_s * g,
        },
    ),
    # Motor and load behind a rigid gear: the load is in derivative causality, p_L = J_L/N p/J. Torque balance at the rotor:
    # (J + J_L/N^2) omega' = K i - b omega/N^2, and p = J omega.
    Case(
        "DC motor with a geared load (Karnopp et al.; Borutzky, derivative causality)",
        """
        parameter U = 1, R = 2, L = 3, K = 4, J = 5, N = 6, J_L = 7, b = 8
        Se supply : e = U
        R r : e = R*f
        I coil : p = L*f
        GY motor : e1 = K*f2
        I rotor : p = J*f { prefer = integral }
        TF gear : f1 = N*f2
        I load : p = J_L*f { prefer = derivative }
        R drag : e = b*f
        supply -> 1(r, coil) -> motor -> 1(rotor) -> gear -> 1(load, drag)
        """,
        lambda U, R, coil_p, L, K, rotor_p, J, b, N, J_L: {
            "coil.p": U - R * coil_p / L - K * rotor_p / J,
            "rotor.p": (K * coil_p / L - b * rotor_p / (J * N**2)) * J / (J + J_L / N**2),
        },
    ),
    # An algebraic loop of two resistors: at the node u (R_1 + R_2) = R_2 (U - R_1 i) by Thevenin.
    Case(
        "voltage divider before a coil (Borutzky, algebraic loops)",
        """
        parameter U = 1, R_1 = 2, R_2 = 3, L = 4
        Se source : e = U
        R first : e = R_1*f
        R second : e = R_2*f
        I coil : p = L*f
        source -> 1(first) -> 0(second) -> 1(coil)
        """,
        lambda R_2, U, R_1, coil_p, L: {"coil.p": R_2 * (U - R_1 * coil_p / L) / (R_1 + R_2)},
    ),
    # A Wheatstone bridge with a capacitor across it: both node voltages a and b follow from the currents i = C u' from a to b.
    # (U - a)/R1 = a/R2 + i, (U - b)/R3 = b/R4 - i, a - b = q/C.
    Case(
        "Wheatstone bridge (Karnopp et al.)",
        """
        parameter U = 1, R_1 = 2, R_2 = 3, R_3 = 5, R_4 = 7, C = 11
        Se source : e = U
        R r1 : e = R_1*f
        R r2 : e = R_2*f
        R r3 : e = R_3*f
        R r4 : e = R_4*f
        C cap : q = C*e
        0 top, a, b
        source -> top
        top -> 1(r1) -> a -> r2
        top -> 1(r3) -> b -> r4
        a -> 1(cap) -> b
        """,
        # i = (U R2/(R1+R2) - U R4/(R3+R4) - q/C)/(R1 R2/(R1+R2) + R3 R4/(R3+R4)): Thevenin of both dividers
        lambda U, R_2, R_1, R_4, R_3, cap_q, C: {
            "cap.q": (U * R_2 / (R_1 + R_2) - U * R_4 / (R_3 + R_4) - cap_q / C)
            / (R_1 * R_2 / (R_1 + R_2) + R_3 * R_4 / (R_3 + R_4))
        },
    ),
    # The condenser microphone: E = q^2 (d - x)/(2 eps A) gives u = q (d - x)/(eps A) and pulls with q^2/(2 eps A).
    Case(
        "condenser microphone (Karnopp et al.: a C field of two domains)",
        """
        parameter U = 1, R = 2, eA = 3, d = 4, m = 5, k = 6, b = 7
        Se bias : e = U
        R lead : e = R*f
        C plates(el: electric, me: translation) : energy = el^2*(d - me)/(2*eA)
        I mass : p = m*f
        C spring : e = k*q
        R air : e = b*f
        bias -> 1(lead) -> plates.el
        1(mass, spring, air) -> plates.me
        """,
        lambda U, plates_el, d, plates_me, eA, R, mass_p, m, k, b: {
            "plates.el": (U - plates_el * (d - plates_me) / eA) / R,
            "plates.me": mass_p / m,
            "mass.p": plates_el**2 / (2 * eA) - k * plates_me - b * mass_p / m,
        },
    ),
    # Mutual inductance: i = Lambda^-1 lambda with Lambda = [[L1, M], [M, L2]].
    Case(
        "two coils on one core (Karnopp et al.: an I field)",
        """
        parameter U = 1, R_1 = 2, R_2 = 3, L_1 = 5, L_2 = 7, M = 4
        Se source : e = U
        R r1 : e = R_1*f
        R r2 : e = R_2*f
        I coils(a, b) : energy = (L_2*a^2 - 2*M*a*b + L_1*b^2)/(2*(L_1*L_2 - M^2))
        source -> 1(r1) -> coils.a
        1(r2) -> coils.b
        """,
        lambda U, R_1, L_2, coils_a, M, coils_b, L_1, R_2: {
            "coils.a": U - R_1 * (L_2 * coils_a - M * coils_b) / (L_1 * L_2 - M**2),
            "coils.b": -R_2 * (L_1 * coils_b - M * coils_a) / (L_1 * L_2 - M**2),
        },
    ),
    # Two tanks, Torricelli between them and out: V1' = Q - c sqrt(P1 - P2), V2' = c sqrt(P1 - P2) - c sqrt(P2), P = V/C.
    Case(
        "two tanks (Gawthrop and Smith)",
        """
        parameter Q = 1, c = 2, C_1 = 3, C_2 = 4
        Sf pump : f = Q
        C t1 : q = C_1*e
        C t2 : q = C_2*e
        R pipe : f = c*sqrt(e)
        R out : f = c*sqrt(e)
        pump -> 0(t1) -> 1(pipe) -> 0(t2, out)
        """,
        lambda Q, c, t1_q, C_1, t2_q, C_2: {
            "t1.q": Q - c * sympy.sqrt(t1_q / C_1 - t2_q / C_2),
            "t2.q": c * sympy.sqrt(t1_q / C_1 - t2_q / C_2) - c * sympy.sqrt(t2_q / C_2),
        },
    ),
    # A seesaw with a mass on each arm: one freedom. v1 = n v2 with n = -a/b, F2 = n F1. At 2: m2 v2' = F2 - m2 g = n F1 - m2 g; at 1: m1 v1' = F - F1, so
    # F1 = (m2 v1'/n + m2 g)/n and (m1 + m2/n^2) v1' = F - m2 g/n.
    Case(
        "lever with two masses (Borutzky, dependent inertia)",
        """
        parameter F = 1, m_1 = 2, m_2 = 3, a = 4, b = 5, g = 9
        Se push : e = F
        I first : p = m_1*f { prefer = integral }
        I second : p = m_2*f { prefer = derivative }
        TF lever : f1 = -a/b*f2
        Se weight : e = -m_2*g
        1 left, right
        push -> left -> first
        left -> lever -> right -> second
        weight -> right
        """,
        lambda m_1, F, m_2, g, b, a: {"first.p": m_1 * (F + m_2 * g * b / a) / (m_1 + m_2 * b**2 / a**2)},
    ),
    # Two capacitors in parallel behind a resistor: one charge, q1 = C1 u, u' = (U - u)/(R (C1 + C2)).
    Case(
        "capacitors in parallel (Borutzky, dependent storage)",
        """
        parameter U = 1, R = 2, C_1 = 3, C_2 = 4
        Se source : e = U
        R r : e = R*f
        C first : q = C_1*e { prefer = integral }
        C second : q = C_2*e { prefer = derivative }
        source -> 1(r) -> 0(first, second)
        """,
        lambda C_1, U, first_q, R, C_2: {"first.q": C_1 * (U - first_q / C_1) / (R * (C_1 + C_2))},
    ),
    # A hydraulic ram: P = q/C, area A. The oil that the piston takes is A v.
    Case(
        "hydraulic ram (Karnopp et al.: a transformer between domains)",
        """
        parameter Q = 1, C = 2, A = 3, m = 4, b = 5, k = 6, G = 7
        Sf pump : f = Q
        C oil : q = C*e
        R leak : f = G*e
        TF ram : e2 = A*e1
        I mass : p = m*f
        R friction : e = b*f
        C load : e = k*q
        pump -> 0(oil, leak) -> ram -> 1(mass, friction, load)
        """,
        lambda Q, G, oil_q, C, A, mass_p, m, b, k, load_q: {
            "oil.q": Q - G * oil_q / C - A * mass_p / m,
            "mass.p": A * oil_q / C - b * mass_p / m - k * load_q,
            "load.q": mass_p / m,
        },
    ),
    # A pendulum as a graph: the inertia m l^2 about the pin, and the weight through a transformer that the angle modulates:
    # v = -l cos(phi) omega is the weight's velocity downwards.
    Case(
        "pendulum with a modulated transformer (Karnopp et al.)",
        """
        parameter m = 1, l = 2, g = 9, b = 3
        I inertia : p = m*l^2*f
        R bearing : e = b*f
        Se weight : e = m*g
        MTF arm : f1 = -l*sin(phi)*f2
        1 turning
        signal phi = integral(turning.f, 1)
        weight -> arm -> turning -> inertia, bearing
        """,
        lambda inertia_p, m, l, g, phi, b: {
            "phi": inertia_p / (m * l**2),
            "inertia.p": -m * g * l * sympy.sin(phi) - b * inertia_p / (m * l**2),
        },
    ),
    # Two gyrators in a row are a transformer.
    Case(
        "two gyrators in a row (Karnopp et al.)",
        """
        parameter U = 1, k_1 = 2, k_2 = 3, m = 4, R = 5
        Se source : e = U
        GY g1 : e1 = k_1*f2
        GY g2 : e1 = k_2*f2
        I mass : p = m*f
        R r : e = R*f
        source -> g1 -> g2 -> 1(mass, r)
        """,
        # e1 = k1 f2 = U, e2 = k1 f1 = k2 f3, e3 = k2 f2 = k2 U/k1
        lambda k_2, U, k_1, R, mass_p, m: {"mass.p": k_2 * U / k_1 - R * mass_p / m},
    ),
]


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)
def test_state_equations(case: Case) -> None:
    found = bondgraph.load(f"plain model Textbook {{{case.graph}}}").state_equations()
    states = {name.replace(".", "_"): name for name in found}
    names = inspect.signature(case.by_hand).parameters
    expected = case.by_hand(*(sympy.Symbol(states.get(n, n), real=True) for n in names))
    assert set(found) == set(expected)
    for state, right in expected.items():
        assert sympy.simplify(found[state] - right) == 0, (state, found[state])
