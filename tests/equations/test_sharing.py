"""One state for one displacement: which storages share a state, and that every number is that of separate ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from bondgraph.keywords import AnalysisRequest

SPRINGS = """model T {
  input load: N = 0
  MSe p : F = load
  C a : F = 10 [N/m]*x
  C b : F = 30 [N/m]*x
  I m : p = 1 kg*v
  R r : F = 1 [N*s/m]*v
  p -> 1(a, b, m, r)
  output xa = a.x, xb = b.x
}
"""
RATIOS = """model T {{
  input load: N = 0
  parameter n = 2, k_b: N/m = 30
  MSe p : F = load
  C a : F = 10 [N/m]*x {{ start x = {a} mm }}
  C b : F = k_b*x {{ start x = {b} mm }}
  TF lever : {ratio}
  I m : p = 1 kg*v
  R r : F = 4 [N*s/m]*v
  p -> 1(a, m, r) -> lever -> b
  output xa = a.x, xb = b.x, v = m.v
  experiment go {{ set load = 0.1 N; simulate 0 .. 3 s {{ rtol = 1e-10 }} }}
}}
"""


def states(text: str) -> tuple[str, ...]:
    return bondgraph.load(text).certificate.states


def test_two_springs_on_one_junction_have_one_state() -> None:
    certificate = bondgraph.load(SPRINGS).certificate
    assert certificate.states == ("a.x", "m.p")
    assert certificate.following == ("b.x follows a.x",)
    assert "sharing a state: b.x follows a.x" in str(certificate)
    assert certificate.to_json()["following"] == ["b.x follows a.x"]


@pytest.mark.few(12)
@pytest.mark.parametrize("b", [0.0, 2.0, -3.0])
@pytest.mark.parametrize("a", [0.0, 1.0])
@pytest.mark.parametrize("ratio", ["v2 = n*v1", "v1 = n*v2", "v2 = 3*v1", "F1 = -2*F2"])
def test_through_a_transformer_with_starts(ratio: str, a: float, b: float) -> None:
    """Against the closed form of the damped oscillator: m v' = load - r v - k_a x_a - n k_b x_b with x_b = b + n (x_a - a)."""
    n = {"v2 = n*v1": 2.0, "v1 = n*v2": 0.5, "v2 = 3*v1": 3.0, "F1 = -2*F2": -2.0}[ratio]
    model = bondgraph.load(RATIOS.format(a=a, b=b, ratio=ratio))
    assert len(model.certificate.states) == (3 if n < 0 and (a or b) else 2)
    found = model.simulate("go")
    a, b = a * 1e-3, b * 1e-3
    stiffness = 10 + 30 * n**2
    rest = a + (0.1 - 10 * a - 30 * n * b) / stiffness
    decay, turn = 2.0, np.sqrt(stiffness - 4.0)
    t, begun = found.time, a - rest
    x = rest + np.exp(-decay * t) * begun * (np.cos(turn * t) + decay / turn * np.sin(turn * t))
    size = max(abs(begun), abs(b), 1e-3)
    np.testing.assert_allclose(found["xa"], x, atol=2e-8 * size, rtol=0)
    np.testing.assert_allclose(found["xb"], b + n * (x - a), atol=2e-8 * size * max(abs(n), 1), rtol=0)
    settled = model.equilibrium("go", {"load": 0.1})
    assert settled["xa"] == pytest.approx(rest, rel=1e-9)
    assert settled["xb"] == pytest.approx(b + n * (rest - a), rel=1e-9, abs=1e-15)
    wanted = model.invert({"xb": b + n * (rest - a)}, ["load"])
    assert wanted.inputs["load"] == pytest.approx(0.1, rel=1e-9)


def test_a_ratio_that_is_set_to_zero_holds_what_is_behind_it() -> None:
    model = bondgraph.load(RATIOS.format(a=0, b=2, ratio="v2 = n*v1"))
    found = model.simulate("go", settings={"n": 0})
    np.testing.assert_allclose(found["xb"], 2e-3, rtol=1e-15)
    assert found["xa"][-1] == pytest.approx(0.01, rel=1e-2)


SHARED = {
    "masses at one effort": "Se s : F = 1 N\n0 j : translation\nI m, n : p = 2 kg*v\nR r : F = 1 [N*s/m]*v\ns -> 1(r) -> j -> m, n\noutput y = m.v",
    "inductors at one voltage": "Se s : u = 1 V\nR r : u = 2 ohm*i\nI l, k : lambda = 1 mH*i\n0 j\ns -> 1(r) -> j -> l, k\noutput y = l.i",
    "capacitors in one current": "Se s : u = 1 V\nC a : u = q/1 [uF]\nC b : u = q/3 [uF]\nR r : u = 1 ohm*i\ns -> 1(a, b, r)\noutput y = a.u",
    "an arrow turned": "Se s : u = 1 V\nC a : u = q/1 [uF]\nC b : u = q/3 [uF]\nR r : u = 1 ohm*i\n1 j\n0 d\ns -> j -> a, r\nd -> j, b\noutput y = a.u",
    "springs over two junctions": "Se s : F = 1 N\nI m, n : p = 1 kg*v\nC a, b : F = 5 [N/m]*x\nR r : F = 1 [N*s/m]*v\n1 j, k : translation\n0 d, e\ns -> j -> m\nk -> n, r\nj -> d -> k\nj -> e -> k\nd -> a\ne -> b\noutput y = m.v",
    "behind a gyrator": "Se s : u = 1 V\nI l : lambda = 1 mH*i\nR r : u = 2 ohm*i\nGY g : u1 = 3 [N/A]*v2\nC c : F = 5 [N/m]*x\nC d : F = 7 [N/m]*x\nI m : p = 1 kg*v\ns -> 1(l, r) -> g -> 1(m, c, d)\noutput y = m.v",
    "an integral of a speed": "Se s : F = 1 N\nI m : p = 1 kg*v\nC a : F = 5 [N/m]*x\nR r : F = 1 [N*s/m]*v\ns -> 1(m, a, r)\nsignal w = integral(2*m.v, 3 m)\noutput y = w",
    "two integrals": "Se s : F = 1 N\nI m : p = 1 kg*v\nR r : F = 1 [N*s/m]*v\ns -> 1(m, r)\nsignal w = integral(2*m.v, 0 m)\nsignal q = integral(-m.v, 0 m)\noutput y = w, z = q",
    "a field's port": "Se s : F = 1 N\nI m : p = 1 kg*v\nC g(x: translation, y: translation) : energy = 5 [N/m]*x^2 + 3 [N/m]*x*y + 4 [N/m]*y^2\nR r, o : F = 1 [N*s/m]*v\nC a : F = 5 [N/m]*x\nI n : p = 2 kg*v\ns -> 1(m, a, r) -> g.x\n1(n, o) -> g.y\noutput y = m.v",
    "a splitter": "Se s : F = 1 N\nI m : p = 1 kg*v\nR r : F = 1 [N*s/m]*v\nC a, b, c, d, e : F = 5 [N/m]*x\ns -> 1(m, r, a, b, c, d, e)\noutput y = m.v",
}
APART = {
    "a modulated lever": "Se s : F = 1 N\nI m : p = 1 kg*v\nC a, b : F = 5 [N/m]*x\nR r : F = 1 [N*s/m]*v\nMTF l : v2 = (1 + a.x/1 [m])*v1\ns -> 1(m, a, r) -> l -> b\noutput y = m.v",
    "one that an event sets": "Se s : F = 1 N\nI m : p = 1 kg*v\nC a, b : F = 5 [N/m]*x\nR r : F = 1 [N*s/m]*v\ns -> 1(m, a, r, b)\nwhen time > 0.5 s { b.x = 0 m }\noutput y = m.v",
    "one that gives to the other": "C a : u = q/1 [uF] { start q = 1 uC }\nC b : u = q/3 [uF]\nR r : u = 1 ohm*i\n0 d\nd -> a\nd -> 1(r) -> b\noutput y = a.u",
    "a stiff spring between two": "Se s : F = 1 N\nI m, n : p = 1 kg*v\nC a, b, c : F = 5 [N/m]*x\nR r, o : F = 1 [N*s/m]*v\n0 d\ns -> 1(m, a, r) -> d -> 1(n, b, o)\nd -> c\noutput y = m.v",
}


@pytest.mark.parametrize("name", SHARED)
def test_what_shares_a_state_moves_as_if_it_did_not(name: str) -> None:
    """Against the same text with an event that never comes, which keeps all apart."""
    text = "model T {\n" + SHARED[name] + "\n}\n"
    one = bondgraph.load(text)
    following = [f.split(" ")[0] for f in one.certificate.following]
    assert following
    sets = "\n".join(f"when time > 1e6 s {{ {n} = 2*{n} }}" for n in following)
    other = bondgraph.load("model T {\n" + SHARED[name] + f"\n{sets}\n}}\n")
    assert len(other.certificate.states) == len(one.certificate.states) + len(following)
    stop = 1e-5 if "ohm" in text and "lambda" not in text else 1.0
    first, second = (m.simulate(to=stop, rtol=1e-10) for m in (one, other))
    for output in first.names:
        size = np.abs(second[output]).max()
        np.testing.assert_allclose(first[output], second[output], rtol=0, atol=1e-8 * size)


@pytest.mark.parametrize("name", APART)
def test_what_stays_apart(name: str) -> None:
    assert not bondgraph.load("model T {\n" + APART[name] + "\n}\n").certificate.following


def test_what_never_starts_at_zero_follows_what_does() -> None:
    """A small displacement computed from a large one would lose its digits."""
    text = SPRINGS.replace("C a : F = 10 [N/m]*x", "C a : F = 10 [N/m]*x { start x = 1 km }")
    assert states(text) == ("b.x", "m.p")


def test_a_tolerance_of_what_follows_is_that_of_its_state() -> None:
    text = (
        RATIOS.format(a=0, b=0, ratio="v2 = 10*v1")
        .replace("rtol = 1e-10", "rtol = 1e-6, tolerance {0} = {1}")
        .replace("{", "{{")
        .replace("}", "}}")
        .replace("{{0}}", "{0}")
        .replace("{{1}}", "{1}")
    )
    steps = [bondgraph.load(text.format(n, v)).simulate("go").steps for n, v in (("b.x", "1 pm"), ("a.x", "0.1 pm"))]
    assert steps[0] == steps[1]
    with pytest.raises(UsageError, match=r"`b.x` cannot be held.*it follows `a.x`"):
        bondgraph.load(text.replace("10*v1", "n*v1").format("b.x", "1 pm")).simulate("go")


def test_a_point_is_given_by_what_follows() -> None:
    model = bondgraph.load(RATIOS.format(a=1, b=2, ratio="v2 = n*v1"))
    by: Any = {"b.x": 8e-3}
    asked = AnalysisRequest(None, state=by)
    assert model.operating_point(asked).outputs == pytest.approx([4e-3, 8e-3, 0.0], rel=1e-14)
    with pytest.raises(UsageError, match=r"`b.x` follows `a.x`: their values contradict each other"):
        model.linearize(state=by | {"a.x": 5e-3})


def test_fifty_springs_on_one_junction_step_as_one() -> None:
    head = "model P {\nSe f : F = 1 N\nI m : p = 1 kg*v\nR d : F = 1 [N*s/m]*v\n1 j\nf -> j -> m, d\n"
    many = "".join(f"C k{i} : F = {i + 1} [N/m]*x + 1 [N/m^3]*x^3\nj -> k{i}\n" for i in range(50))
    one = "C k0 : F = 1275 [N/m]*x + 50 [N/m^3]*x^3\nj -> k0\n"
    found = [bondgraph.load(head + k + "output x = k0.x, v = m.v\n}\n").simulate(to="3 s") for k in (many, one)]
    assert found[0].steps == found[1].steps
    np.testing.assert_allclose(found[0]["x"], found[1]["x"], rtol=0, atol=1e-12)
