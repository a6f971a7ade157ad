"""`every` acts line by line: against programs written in Python, on every target, and in the analyses of sampled loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.simulation.integration import event_integrator
from bondgraph.simulation.integrators import exponential
from bondgraph.simulation.segments.timeline import Segment
from compiler.unparse.write import write_text
from tests.compiling import compiled

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]
HEAD = """model Q {
  mode a = 0, b = 1, c = 2, on = false
  signal twice = 2*a, four = 2*twice, grown = integral(1 [1/s], 0), late = delay(a, 1 s)
  I mass : p = 2 kg*v
  Se push : F = 1 N
  push -> mass
"""


def run(lines: str, to: float = 3.5, target: str = "numpy") -> dict[str, list[float]]:
    """Values just behind the samples at 0, 1, 2 and 3 s."""
    text = f"{HEAD}  every 1 s {{ {lines} }}\n  output A = a, B = b, CC = c, v = mass.v, g = grown\n}}\n"
    found = bondgraph.load(text).simulate(to=to, points=8, target=target)
    return {name: found[name][1::2].tolist() for name in ("A", "B", "CC", "v", "g")}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("lines", "program"),
    [
        ("a = a + 1; b = a; c = b", "a = a + 1; b = a; c = b"),
        ("c = b; b = a; a = a + 1", "c = b; b = a; a = a + 1"),
        ("a = a + 1; b = four", "a = a + 1; b = 4*a"),
        ("a = a + 1; b = four; a = a + b; c = twice", "a = a + 1; b = 4*a; a = a + b; c = 2*a"),
        ("a = a + 1; a = 2*a; a = min(a, 9)", "a = a + 1; a = 2*a; a = min(a, 9)"),
        ("a = b; b = a", "a = b; b = a"),
        ("a = a + 1; b = 1 if a > 2 else 0; c = 1 if a == 2 else 0", "a = a + 1; b = float(a > 2); c = float(a == 2)"),
        ("a = a + 1; on = a >= 3; b = 5 if on else 6", "a = a + 1; b = 5 if a >= 3 else 6"),
        ("a = 5 if on else 6; on = not on; b = 5 if on else 6", "a = 5 if on else 6; on = not on; b = 5 if on else 6"),
        ("c = a; a = 2.5*a + 1; b = a - c", "c = a; a = 2.5*a + 1; b = a - c"),
        ("a = time/1 s + a; b = a*time/1 s", "a = t + a; b = a*t"),
    ],
)
def test_a_block_is_a_program(lines: str, program: str, target: str) -> None:
    found, here, expected = run(lines, target=target), {"a": 0.0, "b": 1.0, "c": 2.0, "on": False}, []
    for t in range(4):
        here["t"] = float(t)
        exec(program, here)
        expected.append([here["a"], here["b"], here["c"]])
    assert np.transpose([found["A"], found["B"], found["CC"]]).tolist() == expected


@pytest.mark.parametrize("count", [2, 3, 13, 300])
def test_a_chain_of_lines_has_no_delay(count: int) -> None:
    names = ", ".join(f"m{i} = 0" for i in range(count))
    lines = "\n    ".join(["m0 = m0 + 1", *(f"m{i} = m{i - 1}" for i in range(1, count))])
    text = f"model Q {{\n  mode {names}\n  every 1 s {{ {lines} }}\n  output last = m{count - 1}\n}}\n"
    assert bondgraph.load(text).simulate(to=8.5, points=18, target="numpy")["last"].tolist() == [
        math.floor(k / 2) + 1 for k in range(18)
    ]


def test_a_when_acts_at_once() -> None:
    text = "model Q {\n mode a = 1, b = 2\n when time > 1 s { a = b; b = a }\n output A = a, B = b\n}\n"
    found = bondgraph.load(text).simulate(to="2 s", target="numpy")
    assert (found.final("A"), found.final("B")) == (2, 1)


@pytest.mark.parametrize("solver", ["automatic", "explicit", "radau", "rodas"])
@pytest.mark.parametrize("target", TARGETS)
def test_a_when_and_a_sample_at_one_instant_do_not_see_each_other(solver: str, target: str) -> None:
    """x = t is 1 at the sample at 1 s but for rounding; what a sample makes true acts after it."""
    text = """model Q {
  signal x = integral(1 [1/s], 0)
  mode a = 0, b = 0, n = 0, late = 0
  when x >= 1 { a = a + 1 + n }
  when time >= 1 s { late = 5 + b }
  every 0.5 s { b = 10*b + a + late; n = n + 1 }
  when n > 2.5 { b = b + 0.25 }
  output A = a, B = b, L = late
}"""
    found = bondgraph.load(text).simulate(to=1.3, target=target, solver=solver)
    assert [found.final(name) for name in "ABL"] == [3, 0.25, 5]


def test_a_sampled_loop_that_grows_without_bound_ends_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_integrator, "MANY_EVENTS", 5)
    monkeypatch.setattr(event_integrator, "GROWING", 2)
    text = """model Q {
  mode u = 0
  signal y = integral((u - floor(y))/(0.1 s), 1.5)
  every 10 ms { u = -80*y }
  output Y = y
}"""
    with pytest.raises(RunFailed, match="grows without bound, `y` most of all"):
        bondgraph.load(text).simulate(to="1 s", target="numpy", points=2)


def test_storages_and_integrals_that_lines_set() -> None:
    """A line reads back what is set by the name it was set by; what the bond graph holds was measured."""
    found = run("b = mass.v/1 [m/s]; mass.v = 0.25 [m/s]; a = mass.v/1 [m/s]; grown = grown + a; c = grown")
    assert found["A"] == [0.25] * 4 and found["B"] == pytest.approx([0, 0.75, 0.75, 0.75], rel=1e-12)
    assert found["v"] == pytest.approx([0.5] * 4, rel=1e-12)
    assert found["CC"] == pytest.approx([0.25, 1.5, 2.75, 4.0], rel=1e-12)


PLANT = """model Q {
  mode volt = 0 V, seen = 0 V, k = 0, pair = [0 V, 0 V]
  MSe s : u = volt
  R r1 : u = 1 ohm*i
  C cap : q = 1 F*u
  s -> 1(r1, cap)
  every 1 s {
    LINES
  }
  output S = seen, u = cap.u, last = pair[2]
}
"""


@pytest.mark.parametrize(
    ("lines", "late"),
    [
        ("volt = volt + 1 V\n seen = r1.u", True), ("seen = r1.u\n volt = volt + 1 V", False), ("volt = volt + 1 V\n seen = cap.u", False),
        ("cap.u = 1 V\n seen = cap.q/1 F", True), ("cap.u = 1 V\n seen = cap.u", False), ("volt = 1 V*k\n k = k + 1\n seen = volt", False),
        ("k = k + 1\n volt = 1 V*k\n seen = volt if k > 2 else -volt", False), ("seen = volt\n volt = 2 V\n volt = volt + seen", False),
        ("pair = [0.5, 0.1]*(cap.u - pair[1])", False),
    ],
)  # fmt: skip
def test_what_was_measured_before_is_told(lines: str, late: bool) -> None:
    notes = compiled(PLANT.replace("LINES", lines)).certificate.notes
    assert len(notes) == late
    assert not late or (
        "line 9, `seen = …`, reads what follows `" in notes[0] and "measured when the block began" in notes[0]
    )


def test_what_is_measured_is_from_before_the_block() -> None:
    """The voltage over the resistor at a sample is that which the last command left."""
    found = bondgraph.load(PLANT.replace("LINES", "volt = volt + 1 V; seen = r1.u")).simulate(to=3.5, points=8)
    u, volt, expected = 0.0, 0.0, []
    for _ in range(4):
        seen, volt = volt - u, volt + 1
        expected.append(seen)
        u += (volt - u) * (1 - math.exp(-1))
    np.testing.assert_allclose(found["S"][1::2], expected, rtol=1e-11)


LOOP = """model Servo {
  parameter K = 0.5, T = 0.2 s
  input target = 1
  mode error = 0, sum = 0, u = 0
  signal x = integral((u - x)/(0.5 s), 0), y = integral(x/(1 s), 0)
  signal wanted = K*error + 0.1*sum
  every T {
    error = target - y
    sum   = sum + error
    u     = wanted - 0.2*x
  }
  output pos = y
}
"""


def closed_loop(T: float, K: float) -> np.ndarray:
    """Matrix of (x, y, sum) from one sample to the next: the program with the exact plant."""
    plant = expm(T * np.array([[-2.0, 0, 2], [1, 0, 0], [0, 0, 0]]))
    total = np.array([0.0, -1, 1])
    u = np.array([-0.2, -K, 0]) + 0.1 * total
    return np.vstack([plant[:2, :2] @ np.eye(2, 3) + np.outer(plant[:2, 2], u), total])


def test_a_run_of_a_cascade_against_its_recursion() -> None:
    T, K = 0.2, 0.5
    found = bondgraph.load(LOOP).simulate(to=4, points=21, rtol=1e-9)
    state, bias, expected = np.zeros(3), np.zeros(3), []
    plant = expm(T * np.array([[-2.0, 0, 2], [1, 0, 0], [0, 0, 0]]))
    bias[:2], bias[2] = plant[:2, 2] * (K + 0.1), 1.0
    for _ in range(21):
        expected.append(state[1])
        state = closed_loop(T, K) @ state + bias
    np.testing.assert_allclose(found["pos"], expected, atol=1e-10)


@pytest.mark.parametrize("K", [0.5, 6.0])
def test_the_stability_of_a_cascade(K: float) -> None:
    """The verdict and its growth are those of the program's matrix; with the hidden delays of `when` they were others."""
    found = bondgraph.load(LOOP).equilibrium(settings={"K": K})
    largest = np.abs(np.linalg.eigvals(closed_loop(0.2, K))).max()
    assert found.stable is bool(largest < 1)
    assert found.growth == pytest.approx(math.log(largest) / 0.2, rel=1e-6)


def test_the_response_of_a_cascade() -> None:
    """The part of a sampled output at the frequency of the target, with its hold, by z-transforms."""
    T, K = 0.2, 0.5
    plant = expm(T * np.array([[-2.0, 0, 2], [1, 0, 0], [0, 0, 0]]))
    bias = np.array([*(plant[:2, 2] * (K + 0.1)), 1.0])
    response = bondgraph.load(LOOP).response("target", "pos", 0.05, 0.5, points=5)
    for f, value in zip(response.frequencies, response.values, strict=True):
        z = np.exp(2j * np.pi * f * T)
        x, y, total = np.linalg.solve(z * np.eye(3) - closed_loop(T, K), bias)
        u = K * (1 - y) + 0.1 * (total + 1 - y) - 0.2 * x
        s = 2j * np.pi * f
        assert value == pytest.approx(u * (1 - 1 / z) / (s * T) * 2 / ((s + 2) * s), rel=1e-6)


def test_instances_arrays_and_loops() -> None:
    text = """model Q {
  Counter one { by = 1 }
  Counter two { by = other }
  signal other = 2*one.n
  for i in 1 .. 3 { mode m[i] = 0 }
  every 1 s { m[1] = m[1] + 1; m[2] = m[1] + one.n; m[3] = m[2] }
  output a = one.last, b = two.last, c = m[3]
}
model Counter {
  input by = 1
  mode n = 0, last = 0
  every 1 s { n = n + by; last = n }
}
"""
    found = bondgraph.load(text).simulate(to=2.5, points=6, target="numpy")
    assert found["a"][1::2].tolist() == [1, 2, 3]
    assert found["b"][1::2].tolist() == [0, 2, 6]  # another block, which does not see the first at one instant
    assert found["c"][1::2].tolist() == [1, 3, 5]


def test_the_flat_text_means_the_same() -> None:
    model = bondgraph.load(LOOP)
    again = bondgraph.load(model.text())
    found, other = model.simulate(to=2, points=11), again.simulate(to=2, points=11)
    np.testing.assert_allclose(found["pos"], other["pos"], rtol=0, atol=1e-14)


HELD = """model H {
  mode u = 0 N, r = 1 [N*s/m], k = 0
  MSe pull : F = u PUSH
  I mass   : p = 1 kg*v
  MR drag  : F = r*v
  pull -> 1(mass, drag)
  every 10 ms { LINES }
  output y = mass.p, w = u
}
"""


@pytest.mark.parametrize(
    ("push", "lines", "kept"),
    [
        ("", "u = 1 N - 1 [1/s]*mass.p", True),
        ("", "k = k + 1; u = 0 N if k < 3 else 1 N - 1 [1/s]*mass.p if k < 6 else 0 N", True),  # rows of b come and go
        ("", "u = 1 N; r = 1 [N*s/m] + 1 [1/m]*abs(mass.p)", False),  # another matrix each time
        ("", "k = k + 1; u = 1 N; r = (1 if mod(k, 2) > 0 else 3)*1 [N*s/m]", True),
        ("+ 1 N*step(time - 33 ms)", "u = 1 N - 1 [1/s]*mass.p", True),
        ("+ 1 [N/s]*time", "u = 1 N - 1 [1/s]*mass.p", False),  # which no signal shows, as a step cannot miss it
        ("+ u*time/1 s", "u = 1 N - 1 [1/s]*mass.p", False),
        ("+ 1 N*sin(30 [rad/s]*time)", "u = 1 N - 1 [1/s]*mass.p", False),
    ],
)
def test_a_form_kept_between_samples_is_the_one_built_anew(
    push: str, lines: str, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = bondgraph.load(HELD.replace("PUSH", push).replace("LINES", lines))
    found, held = [], exponential.Linear.held

    def counted(self: exponential.Linear, stretch: Segment) -> exponential.Linear | None:
        form = held(self, stretch)
        found.append(form)
        return form

    monkeypatch.setattr(exponential.Linear, "held", counted)
    results = [model.simulate(to=0.2, points=23, target="numpy", energy=energy) for energy in (False, True)]
    assert (sum(form is not None for form in found) >= 30) == kept
    monkeypatch.setattr(exponential.Linear, "held", lambda self, stretch: None)
    for energy, result in enumerate(results):
        anew = model.simulate(to=0.2, points=23, target="numpy", energy=bool(energy))
        assert [anew[name].tobytes() for name in "yw"] == [result[name].tobytes() for name in "yw"]
        assert anew.evaluations == result.evaluations


LISTS = """model L {
  constant A = [[0.5, 0.25], [-0.25, 0.5]], B = [1, 2]
  mode z = (1, 0), w: m = (1 m, 2 m), y = 0, M = [[1, 2], [3, 4]], on = (true, false)
  for i in 1..2 { C s[i] : F = 1 [N/m]*x { start x = i*1 m }; Sf hold[i] : v = 0 [m/s]; hold[i] -> s[i] }
  every 1 s { LINES }
  output a = z[1], b = z[2], p = w[1], q = w[2], y_1 = y, m = M[2, 1], n = M[1, 2], first = s[1].x, t = on[1]
}
"""


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("lines", "program"),
    [
        ("z = A*z + B", "z = A@z + B"),
        ("z = A*z + B; y = z[1]; z = z + y*B", "z = A@z + B; y = z[0]; z = z + y*B"),
        (
            "y = y + 1; z = [z[2], z[1] + y]; w = [w[2], w[1]]",
            "y += 1; z = np.array([z[1], z[0] + y]); w = w[::-1].copy()",
        ),
        ("M = transpose(M); z = M*z/4; M[1, 2] = z[1]", "M = M.T.copy(); z = M@z/4; M[0, 1] = z[0]"),
        ("s.x = [s[2].x, s[1].x]; w = [2*w[1], w[1]]", "x = x[::-1].copy(); w = np.array([2*w[0], w[0]])"),
        ("on = [on[2], on[1]]; y = y + 1 if on[1] > 0 else y", "on = on[::-1]; y += on[0]"),
    ],
)
def test_a_line_sets_the_items_of_a_list_together(lines: str, program: str, target: str) -> None:
    text = LISTS.replace("LINES", lines)
    found = bondgraph.load(text).simulate(to=3.5, points=8, target=target)
    here = {"np": np, "A": np.array([[0.5, 0.25], [-0.25, 0.5]]), "B": np.array([1.0, 2.0]), "z": np.array([1.0, 0.0])}
    here |= {
        "w": np.array([1.0, 2.0]),
        "y": 0,
        "M": np.array([[1.0, 2.0], [3.0, 4.0]]),
        "on": [True, False],
        "x": np.array([1.0, 2.0]),
    }
    for k in range(4):
        exec(program, here)
        z, w, M = here["z"], here["w"], here["M"]
        expected = [z[0], z[1], w[0], w[1], here["y"], M[1, 0], M[0, 1], here["x"][0], float(here["on"][0])]
        assert [found[name][2 * k + 1] for name in found.names] == pytest.approx(expected, rel=1e-15)


def test_the_flat_text_sets_the_items_of_a_list_together() -> None:
    text = LISTS.replace("LINES", "z = A*z + B; s.x = [s[2].x, s[1].x]; y = z[1] + w[1]/1 m; w = [w[2], w[1] + w[2]]")
    first, second = (bondgraph.load(t).simulate(to=3.5, points=8) for t in (text, write_text(compiled(text).graph)))
    assert all(np.array_equal(first[name], second[name]) for name in first.names)
