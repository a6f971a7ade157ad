"""Six ideal diodes between three sources in star and a floating load, with lines of several kinds, in two drawings; and the advice where a drawing is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import bondgraph
from bondgraph.errors import RunFailed
from compiler.errors import CompilationFailed

LINES = {"": (), "L": ("I", "lambda = 1 mH*i"), "R": ("R", "u = 0.1 ohm*i")}
LOADS = {
    "R": "R r : u = 10 ohm*i\n  out -> r",
    "RL": "R r : u = 10 ohm*i\n  I l : lambda = 20 mH*i\n  out -> r, l",
    "RC": "0 across : electric\n  R r : u = 10 ohm*i\n  C store : u = q/1 [mF]\n  out -> across -> r, store",
    "two branches": "R r : u = 10 ohm*i\n  C store : u = q/1 [mF]\n  plus -> 1(store) -> minus\n  out -> r",
}
LEAK = "R leak : u = 1e6 ohm*i\n  minus -> leak"  # what the advice of BG502 asks for: the rails float while all diodes block


def bridge(load: str, line: str, more: str = "") -> str:
    parts = ["import IdealDiode from electric", "model Bridge {", "  0 plus, minus : electric"]
    for k, phase in enumerate("abc"):
        inner = [(f"{kind.lower()}{phase}", *LINES[kind]) for kind in line]
        parts += [f"  Se {phase} : u = 10 V*sin(2*pi*50*time/1 s - {k}*2*pi/3)", f"  0 n{phase} : electric"]
        parts += [f"  {letter} {name} : {law}" for name, letter, law in inner]
        through = f"1({', '.join(name for name, *_ in inner)}) -> " if inner else ""
        parts += [f"  {phase} -> {through}n{phase}", f"  IdealDiode up{phase}, down{phase}"]
        parts += [f"  n{phase} -> 1(up{phase}.pins) -> plus", f"  minus -> 1(down{phase}.pins) -> n{phase}"]
    return "\n".join(
        [
            *parts,
            "  1 out : electric",
            "  plus -> out -> minus",
            f"  {LOADS[load]}",
            f"  {more}",
            "  output u = r.u",
            "}",
        ]
    )


def run(load: str, line: str, more: str = "", target: str = "native") -> np.ndarray:
    result = bondgraph.load(bridge(load, line, more)).simulate(to="40 ms", points=41, rtol=1e-7, target=target)
    return np.asarray(result["u"])


def rectified(time: float, current: float, resistance: float) -> float:
    """Voltage between the rails at a current: of each side the phases that lie furthest out share it over the resistances of their lines."""
    phases = np.sort([10 * np.sin(2 * np.pi * 50 * time - k * 2 * np.pi / 3) for k in range(3)])
    highest = max((phases[-n:].sum() - resistance * current) / n for n in (1, 2, 3))
    lowest = min((phases[:n].sum() + resistance * current) / n for n in (1, 2, 3))
    return float(highest - lowest)


TIMES = np.linspace(0, 0.04, 41)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
@pytest.mark.parametrize(("line", "resistance"), [("", 0.0), ("R", 0.1)])
def test_a_resistor(line: str, resistance: float, target: str) -> None:
    """The current for which rails and load agree, at each instant."""
    currents = [brentq(lambda i, t=t: rectified(t, i, resistance) - 10 * i, 0, 3, xtol=1e-14) for t in TIMES]
    assert run("R", line, target=target) == pytest.approx(10 * np.array(currents), abs=1e-9)


@pytest.mark.few(1)
@pytest.mark.parametrize(("line", "resistance"), [("", 0.0), ("R", 0.1)])
def test_a_coil(line: str, resistance: float) -> None:
    """L i' = rectified - R i, whose current never returns to zero."""
    solved = solve_ivp(
        lambda t, i: [(rectified(t, i[0], resistance) - 10 * i[0]) / 0.02], (0, 0.04), [0.0], "DOP853", TIMES, rtol=1e-11, atol=1e-13, max_step=2e-5
    )  # fmt: skip
    assert run("RL", line) == pytest.approx(10 * solved.y[0], abs=2e-5)


@pytest.mark.few(1)
@pytest.mark.parametrize("line", ["", "R"])
def test_two_drawings_of_one_load(line: str) -> None:
    assert run("two branches", line) == pytest.approx(run("RC", line), abs=2e-5)


@pytest.mark.few(1)
@pytest.mark.parametrize("line", ["L", "RL"])
def test_the_advice_where_a_drawing_is_refused(line: str) -> None:
    """Resistor and capacitor as branches of their own behind coils: no stroke shows that the rails' equations are one. A resistor from a rail to earth,
    as the message says, gives what the other drawing gives."""
    with pytest.raises(CompilationFailed) as refused:
        run("two branches", line)
    assert {d.code for d in refused.value.diagnostics} == {"BG502"}
    assert "Put a resistor or a storage into it" in str(refused.value)
    assert run("two branches", line, LEAK) == pytest.approx(run("RC", line), abs=1e-3)


def test_the_advice_where_a_run_ends() -> None:
    """A star with a leakage and capacitor straight behind the diodes; resistors in the lines are what helps."""
    star = "0 star : electric\n  R leak : u = 1e6 ohm*i\n  star -> leak"

    def in_star(line: str) -> str:
        text = bridge("RC", line, star)
        for phase in "abc":
            head = f"  {phase} -> 1(r{phase}) -> n{phase}" if line else f"  {phase} -> n{phase}"
            text = text.replace(head, f"  star -> 1({phase}{', r' + phase if line else ''}) -> n{phase}")
        return text

    with pytest.raises(RunFailed, match="has no equations") as ended:
        bondgraph.load(in_star("")).simulate(to="40 ms")
    assert ended.value.code == "BR709"
    helped = bondgraph.load(in_star("R")).simulate(to="40 ms", points=41, rtol=1e-7)
    assert np.abs(np.abs(helped["u"]) - run("RC", "R")).max() < 1e-3
