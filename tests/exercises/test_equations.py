"""State equations by hand: other forms of the right function are right, each wrong term, unit or name is told with its place."""

from __future__ import annotations

import pytest

import bondgraph
from bondgraph import exercises
from bondgraph.exercises.answer import MarkedAnswer
from compiler.api import Source
from tests.compiling import MODELS

PLATES = """model Plates {
  parameter k: N/m = 1, m = 1 ug, area = 1e4 um^2, gap = 2 um, volt = 3 V
  C plate : F = k*x - 8.8541878128e-12 [F/m]*area*volt^2/(2*(gap - x)^2)
  I mass : p = m*v
  1 body
  body -> plate, mass
}"""


def mark(of: bondgraph.Model, *lines: str) -> MarkedAnswer:
    return exercises.mark(of, "equations", Source("answer.txt", "\n".join(lines)))


@pytest.fixture(scope="module")
def rlc() -> bondgraph.Model:
    return bondgraph.load(MODELS / "rlc.bg")


CHARGE = "d/dt capacitor.q = inductor.lambda/L"


@pytest.mark.parametrize(
    "right",
    [
        "U*step(time - 1 ms) - R*inductor.lambda/L - capacitor.q/C",
        "battery.u - (R*C*inductor.lambda + L*capacitor.q)/(L*C)",
        "-capacitor.q/C+battery.u-inductor.lambda*(R/L)",
        "battery.u - capacitor.q/C - R*(inductor.lambda/(2*L) + inductor.lambda/(2*L))",
        "(U if time >= 1 ms else 0 V) - R*inductor.lambda/L - capacitor.q/C",
        "battery.u + exp(log(R/1 ohm))*-1 ohm*inductor.lambda/L - capacitor.q/C",
    ],
)
def test_other_forms_are_right(rlc: bondgraph.Model, right: str) -> None:
    marked = mark(rlc, CHARGE, f"d/dt inductor.lambda = {right}  # by hand")
    assert marked.right and marked.count == "2 of 2 are right", marked.text()


@pytest.mark.parametrize(
    ("wrong", "column", "reason"),
    [
        ("battery.u - R*inductor.lambda/L", 1, "the term with `capacitor.q` and `C` is missing"),
        ("battery.u + R*inductor.lambda/L - capacitor.q/C", 1, "the term with `inductor.lambda` and `R` and `L` has the other sign"),
        ("U - R*inductor.lambda/L - capacitor.q/C", 1, "it gives "),  # without its step
        ("battery.u - R*inductor.lambda/L - capacitor.q/C*1.000001", 1, "it "),
        ("battery.u - R*inductor.lambda - capacitor.q/C", 36, "These cannot be added: `battery.u` is in [V], but `R*inductor.lambda` "),
        ("inductor.lambda/L", 24, "its unit is A, and that of the rate V"),
        ("inductor.u", 24, "`inductor.u` is not given: write it with inductor.lambda, capacitor.q, battery.u, "),
        ("battery.u - resistor.u - capacitor.q/C", 36, "`resistor.u` is not given"),
        ("der(inductor.lambda)", 24, "`der` is no function of the states at one instant"),
        ("battery.u - (", 36, "This `(` is never closed"),
        ("battery.u - x", 36, "`x` is not given"),
        ("__import__('os')", 35, ""),
        ("0 V", 1, ""),
        ("?", 1, "it has no right side yet"),
        ("", 1, "it has no right side yet"),
    ],
)  # fmt: skip
def test_faults_have_place_and_reason(rlc: bondgraph.Model, wrong: str, column: int, reason: str) -> None:
    (fault,) = [m for m in mark(rlc, CHARGE, f"d/dt inductor.lambda = {wrong}").marks if m.wrong]
    assert fault.wrong.startswith(reason) and (fault.span.line, fault.span.column) == (2, column), fault.text()


def test_all_is_told_at_once(rlc: bondgraph.Model) -> None:
    text = mark(
        rlc,
        "# mine",
        "d/dt capacitor.q = -inductor.lambda/L",
        "capacitor.q' = 0",
        "d/dt capacitor.q = 0 A",
        "d/dt i = 0 A",
    ).text()
    assert text.splitlines() == [
        "answer.txt:2:1: wrong: d/dt capacitor.q = -inductor.lambda/L: the term with `inductor.lambda` and `L` has the other sign",
        "answer.txt:3:1: wrong: capacitor.q' = 0: a line has the form `d/dt STATE = RIGHT SIDE`",
        "answer.txt:4:1: wrong: d/dt capacitor.q = 0 A: there is no state `capacitor.q` left",
        "answer.txt:5:1: wrong: d/dt i = 0 A: there is no state `i` left",
        "answer.txt:5:13: wrong: d/dt inductor.lambda =: this line is missing",
    ]


def test_a_term_far_below_the_others_counts() -> None:
    """The pull of a comb's plates is some 1e-7 N; beside k*x at x = 1 m nobody would see it."""
    plates = bondgraph.load(PLATES)
    force = "8.8541878128e-12 [F/m]*area*volt^2/(2*(gap - plate.x)^2)"
    moved = "d/dt plate.x = mass.p/m"
    assert mark(plates, moved, f"d/dt mass.p = {force} - k*plate.x").right
    assert mark(
        plates,
        moved,
        f"d/dt mass.p = -k*plate.x + {force.replace('8.8541878128', '17.7083756256').replace('(2*', '(4*')}",
    ).right
    for wrong in ("0 N", f"-({force})", f"2*{force}", force.replace("gap - ", "gap + ")):
        assert not mark(plates, moved, f"d/dt mass.p = -k*plate.x + {wrong}").right


def test_a_storage_in_derivative_form_and_a_plain_model() -> None:
    motor = bondgraph.load(MODELS / "dc_motor.bg")
    turned = "d/dt inertia.L = (K*coil.lambda/L - b*inertia.L/(J*N^2))/(1 + J_load/(J*N^2))"
    assert mark(motor, "d/dt coil.lambda = volt - K*inertia.L/J - R*coil.lambda/L", turned).right
    assert mark(motor, "d/dt coil.lambda = supply.u - K*inertia.L/J - R*coil.lambda/L", turned).right
    assert not mark(
        motor, "d/dt coil.lambda = volt - K*inertia.L/J - R*coil.lambda/L", turned.replace("1 +", "2 +")
    ).right
    plain = bondgraph.load("plain model P { C c : e = 2*q^3\nR r : e = 5*f\n1 j\nj -> c, r }")
    assert exercises.exercise(plain, "equations").splitlines()[2:] == ["d/dt c.q = ?"]
    assert mark(plain, "d/dt c.q = -2*c.q*c.q^2/5").right and not mark(plain, "d/dt c.q = -2*c.q^2/5").right


def test_models_without_state_equations() -> None:
    for text in (
        "model A { Se s : F = 1 N\nR r : F = 1 [N*s/m]*v\ns -> r\noutput v = r.v }",
        "model A { Se s : u = 1 V\nR a : u = 1 ohm*i\nR d : i = 1 A*(exp(u/1 V) - 1)\nC c : q = 1 F*u\ns -> 1(a, d, c) }",
    ):
        with pytest.raises(bondgraph.UsageError, match="there are no state equations to write"):
            exercises.exercise(bondgraph.load(text), "equations")
