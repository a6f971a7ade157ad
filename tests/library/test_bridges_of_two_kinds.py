"""Bridges of ideal diodes between sources of both kinds, whose valves cannot all block: textbook means, and the overlap of commutation in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph

U, I_D, L, W, E, C = 325.0, 10.0, 3e-3, 2 * np.pi * 50, 50.0, 100e-6
STIFF = "Sf load : i = 10 A\n  pos -> 1(load) -> neg"


def fed_by_voltages(angles: tuple[str, ...], line: str, load: str = STIFF) -> str:
    """A bridge with one leg for each phase; `line`: of phase k, from its source s to its node."""
    legs = "".join(
        f"  Se s{k} : u = 325 V*sin(2*pi*50 Hz*time + {angle})\n  0 a{k} : electric\n  {line.replace('#', str(k))}\n"
        f"  IdealDiode up{k}, low{k}\n  a{k} -> 1(up{k}.pins) -> pos\n  neg -> 1(low{k}.pins) -> a{k}\n"
        for k, angle in enumerate(angles)
    )
    return (
        f"import IdealDiode from electric\nmodel Bridge {{\n  0 pos, neg : electric\n{legs}  {load}\n"
        "  output sum = integral(pos.u - neg.u, 0 [V*s]), i = s0.i\n}\n"
    )


def fed_by_a_current(load: str) -> str:
    pairs = ("a -> 1(d1.pins) -> pos", "neg -> 1(d2.pins) -> a", "b -> 1(d3.pins) -> pos", "neg -> 1(d4.pins) -> b")
    return (
        "import IdealDiode from electric\nmodel Bridge {\n  0 pos, neg, a, b : electric\n  IdealDiode d1, d2, d3, d4\n  Se earth : u = 0 V\n"
        "  Sf s : i = 10 A*sin(2*pi*50 Hz*time)\n  1 loop : electric\n  earth -> neg\n  b -> loop -> a\n  s -> loop\n  "
        + "\n  ".join(pairs)
        + f"\n  {load}\n  output u = pos.u, across = s.u\n}}\n"
    )


LINE, COIL = "s# -> a#", "I l# : lambda = 3 mH*i\n  s# -> 1(l#) -> a#"
THREE, TWO = ("0", "-2*pi/3", "2*pi/3"), ("0", "pi")
BRIDGES = {  # phases, lines, mean voltage
    "three phases": (THREE, LINE, 3 * np.sqrt(3) * U / np.pi),
    "three phases with coils": (THREE, COIL, (3 * np.sqrt(3) * U - 3 * W * L * I_D) / np.pi),
    "two phases": (TWO, LINE, 4 * U / np.pi),
    "two phases with coils": (TWO, COIL, (4 * U - 4 * W * L * I_D) / np.pi),
}


def line_current(name: str, angle: np.ndarray) -> np.ndarray:
    """Current of the first phase after its zero: commutation takes u with cos u = 1 - 2 w L I/u_LL, or no time."""
    coils, three = "coils" in name, "three" in name
    rises = (np.sqrt(3) * U / (2 * W * L) if three else U / (W * L)) if coils else np.inf
    begins = (np.pi / 6, 5 * np.pi / 6) if three else (0.0,)
    height = I_D if three else 2 * I_D
    taken = [
        np.minimum(height, np.where(angle > b, 1 - np.cos(angle - b), 0) * rises) if coils else height * (angle > b)
        for b in begins
    ]
    return taken[0] - taken[1] if three else taken[0] - I_D  # type: ignore[no-any-return]


@pytest.mark.few(2)
@pytest.mark.parametrize("name", BRIDGES)
def test_a_bridge_into_a_stiff_inductive_load(name: str) -> None:
    angles, line, mean = BRIDGES[name]
    times = np.linspace(0, 0.03, 301)
    run = bondgraph.load(fed_by_voltages(angles, line)).simulate(to="30 ms", points=301, target="numpy", rtol=1e-8)
    assert (run["sum"][300] - run["sum"][200]) / 0.01 == pytest.approx(mean, rel=1e-7)
    assert run["i"][201:300] == pytest.approx(line_current(name, W * (times[201:300] - 0.02)), abs=1e-5)
    assert not run.warnings and not any("look ahead" in note for note in run.notes)


def test_a_bridge_that_a_current_feeds() -> None:
    """Into a capacitor, which takes the mean of the rectified current; into a battery, with a capacitor that the current turns round first."""
    stored = bondgraph.load(fed_by_a_current("C load : u = q/1 [mF]\n  pos -> 1(load) -> neg")).simulate(
        to="30 ms", target="numpy"
    )
    assert stored.final("u") == pytest.approx(6 * I_D / W / 1e-3, rel=1e-8)
    times = np.linspace(0, 0.03, 301)
    held = "Se load : u = 50 V\n  load -> pos\n  C turned : u = q/100 [uF]\n  a -> 1(turned) -> b"
    run = bondgraph.load(fed_by_a_current(held)).simulate(to="30 ms", points=301, target="numpy", rtol=1e-8)
    angle = W * (times[200:] - 0.02)
    assert run["across"][200:] == pytest.approx(np.minimum(E, I_D / (W * C) * (1 - np.cos(angle)) - E), abs=1e-5)
    assert not run.warnings and not run.notes
