"""Outputs that are small differences of large numbers: what may be wrong as a whole is told."""

from __future__ import annotations

import math
import pickle
import re
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.results.later import Later
from tests.compiling import MODELS

TEXT = """model Filter {
  parameter tau = 1 ms
  Se s : u = 1 V*sin(2*pi*50 Hz*time)
  R r : u = 1 ohm*i
  C c : q = tau*1 [1/ohm]*u
  1 l : electric
  s -> l -> r, c
  output i = r.i, u = c.u
}"""
W = 2 * np.pi * 50


@pytest.fixture(scope="module")
def model() -> Any:
    return bondgraph.load(TEXT)


def error(result: Any, tau: float) -> float:
    """Largest error of the current, relative to its size: i = C u' behind a transient."""
    t = result.time
    exact = W * tau * (np.cos(W * t) + W * tau * np.sin(W * t) - np.exp(-t / tau)) / (1 + (W * tau) ** 2)
    return float(np.abs(result["i"] - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize("solver", ["automatic", "radau", "rodas"])
@pytest.mark.parametrize("tau", [1e-3, 1e-6, 1e-8, 1e-9, 1e-12, 1e-15])
def test_what_may_be_wrong_is_told(model: Any, solver: str, tau: float) -> None:
    result = model.simulate(settings={"tau": tau}, to="20 ms", points=101, solver=solver)
    told = [w for w in result.warnings if "terms that cancel" in w.condition]
    assert [w.owner for w in told] == ["i"] or error(result, tau) < 0.1
    assert not told or tau < 1e-7  # nothing is told of a current that is a thousandth of what its terms are


def test_the_advice_helps(model: Any) -> None:
    loose, tight = (model.simulate(settings={"tau": 1e-8}, to="20 ms", solver="rodas", rtol=r) for r in (1e-6, 1e-9))
    assert "set a smaller `rtol`" in str(loose.warnings[-1]) and error(loose, 1e-8) > 0.1
    assert not tight.warnings and error(tight, 1e-8) < 1e-2


def test_many_runs_tell_what_each_alone_tells(model: Any) -> None:
    settings = [{"tau": tau} for tau in (1e-3, 2e-3, 3e-3, 1e-15, 2e-15, 3e-15)]
    together = model.simulate_many(settings, to="20 ms", points=21)
    alone = [model.simulate(settings=s, to="20 ms", points=21) for s in settings]
    assert [[str(w) for w in r.warnings] for r in together] == [[str(w) for w in r.warnings] for r in alone]
    assert [bool(r.warnings) for r in alone] == [False] * 3 + [True] * 3


def test_what_is_found_when_read_is_that_of_the_run(model: Any) -> None:
    """Warnings and checkpoints are found at their first use, from what the run had, not from what is now in the arrays."""
    many = [{"tau": tau} for tau in (1e-15, 2e-15, 3e-15)]
    results = [
        model.simulate(settings={"tau": 1e-8}, to="20 ms", solver="rodas"),
        *model.simulate_many(many, to="20 ms", workers=1),
    ]
    for result in results:
        assert type(vars(result)["warnings"]) is type(vars(result)["checkpoint"]) is Later
        read = pickle.loads(pickle.dumps(result))
        result.values[:] = 1.0
        result.time[:] = 1.0
        assert str(result.warnings) == str(read.warnings) and [w.owner for w in read.warnings] == ["i"]
        assert result.checkpoint.to_json() == read.checkpoint.to_json()
        assert result.checkpoint is result.checkpoint and read.checkpoint.time == 20e-3


def test_zero_by_a_symmetry_is_no_doubt() -> None:
    """Two equal masses on equal springs: their difference is rounding."""
    text = "model Twins {\n  Se s : F = 1 N*sin(3 [1/s]*time)\n  0 ends\n"
    for k in (1, 2):
        text += f"  I m{k} : p = 1 kg*v\n  C c{k} : F = (2 [N/m])*x + 1 [N/m^3]*x^3\n  1 j{k}\n  s{k} -> j{k} -> m{k}, c{k}\n  Se s{k} : F = 1 N*sin(3 [1/s]*time)\n"
    text = (
        text.replace("  Se s : F = 1 N*sin(3 [1/s]*time)\n  0 ends\n", "") + "  output gap = c1.x - c2.x, x = c1.x\n}"
    )
    result = bondgraph.load(text).simulate(to="5 s")
    assert not result.warnings and np.abs(result["gap"]).max() < 1e-13


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "name",
    [
        "manipulator",
        "quarter_car",
        pytest.param("rectifier", marks=pytest.mark.machine_code),
        pytest.param("robot_arm", marks=pytest.mark.machine_code),
        "loudspeaker",
        "pid_dc_motor",
    ],
)
def test_models_of_the_gallery_have_no_doubt(name: str) -> None:
    model = bondgraph.load(MODELS / f"{name}.bg")
    assert not any("terms that cancel" in w.condition for w in model.simulate(model.experiments[0]).warnings)


# Conditions on what vanishes but for rounding, then two that are small and do cross zero, twice above it with the start.
CANCELLED = (
    "x/3 + x/7 - x*(10/21)", "sqrt(x^2) - abs(x)", "sin(x)^2 + cos(x)^2 - 1", "(x + y) - x - y", "(x + y)^2 - x^2 - 2*x*y - y^2",
    "(x + 1)^3 - x^3 - 3*x^2 - 3*x - 1", "x/3 + x/11 + x/7 - x*(131/231)", "x - twin",
    "1e-12*x", "x/3 + x/7 - x*(10/21) + 1e-12*x",
)  # fmt: skip


def test_conditions_that_are_rounding_count_as_zero() -> None:
    """Rounding of terms that cancel was counted as switching, or its changes did not end; the smallest crossing of what is no rounding counts."""
    text = "plain model A {\n  signal x = integral(v, 1), v = integral(-4*x, 0), twin = integral(v, 1)\n"
    text += "  signal y = integral(w, 0.3), w = integral(-9*y - 0.1*w, 1)\n"
    for i, condition in enumerate(CANCELLED):
        text += f"  mode n{i} = 0\n  when {condition} > 0 {{ n{i} = n{i} + 1 }}\n  output c{i} = n{i}\n"
    model = bondgraph.load(text + "}\n")
    for solver in ("automatic", "rodas"):
        found = model.simulate(to=4, points=3, solver=solver)
        assert [found.final(f"c{i}") for i in range(len(CANCELLED))] == [0] * (len(CANCELLED) - 2) + [2, 2]


def test_sampled_values_and_outputs_of_what_is_rounding_are_those_of_zero() -> None:
    """Each sample read the sign of rounding: 4 to 11 counts of 41, and -7 to -19 as the sum of `floor`; so did conditions in laws, after a sample."""
    text = "plain model A {\n  signal x = integral(v, 1), v = integral(-4*x, 0), twin = integral(v, 1)\n"
    text += "  signal y = integral(w, 0.3), w = integral(-9*y - 0.1*w, 1)\n"
    jumps = (
        "(1 if {} > 0 else 0)",
        "(1 if {} != 0 else 0)",
        "floor({})",
        "-ceil({})",
        "sign({})",
        "floor(mod({}, 1) + 0.5)",
        "floor(2*({})/3)",
        "(1 if 2*abs({}) > 0 else 0)",
    )
    several = [(i, j) for i in range(len(CANCELLED)) for j in range(len(jumps)) if j == 0 or (i + j) % 5 == 0]
    for i, j in several:
        jump = jumps[j].format(f"s{i}" if j % 2 else f"({CANCELLED[i]})")
        text += f"  mode n{i}_{j} = 0\n  every 0.1 {{ n{i}_{j} = n{i}_{j} + {jump} }}\n  output c{i}_{j} = n{i}_{j}, o{i}_{j} = {jump}\n"
    for i, condition in enumerate(CANCELLED):
        text += f"  signal s{i} = {condition}\n"
    text += "  signal k = integral(1 if s0 > 0 else 0, 0)\n  output l = k\n"
    model = bondgraph.load(text + "}\n")
    found = model.simulate(to=4, points=41)
    zero = [(i, j) for i, j in several if i < len(CANCELLED) - 2]
    assert [(i, j) for i, j in zero if found.final(f"c{i}_{j}") or found[f"o{i}_{j}"].any()] == []
    assert found.final("l") == 0
    positive = sum(np.cos(0.2 * np.arange(41)) > 0)
    assert [found.final(f"c{i}_0") for i in range(len(CANCELLED) - 2, len(CANCELLED))] == [positive, positive]


# Functions of x/3 + x/7 - x*(10/21), which is zero but for rounding, with their counts of 41: those of zero.
OF_CANCELLED = {
    "sin(c) > 0": 0, "tanh(c) < 0": 0, "atan2(c, 1) > 0": 0, "max(c, 0) > 0": 0, "sqrt(1 + x*c) != 1": 0, "floor(c/(2 + c)) < 0": 0,
    "sign(asin(c)) != 0": 0, "abs(c)^(1/3) > 1e-9": 0, "sqrt(abs(c)) > 1e-12": 0, "sqrt(abs(c)) < 1e-3": 41, "mod(sqrt(9 + 2*c), 3) > 1": 0,
    "(sin(c) if x > 0 else c) != 0": 0, "linear(c, (-1, 0, 1), (-2, 0, 1)) > 0": 0, "time/3 + time/7 - time*(10/21) > 0": 0,
    "sin(time/3 + time/7 - time*(10/21)) < 0": 0, "stored > 0": 0, "stored < 0": 0,
    "sin(c + 1e-12*v) > 0": 16,
    "k/3 + k/7 - k*(10/21) > 0": 0, "k/3 + k/7 < k*(10/21)": 0, "sign(k/3 + k/7 - k*(10/21)) != 0": 0, "floor(7 + k/3 + k/7 - k*(10/21)) < 7": 0,
    "k/3 + k/7 - k*(10/21) + 1e-12*k > 0": 40,
}  # fmt: skip


def test_functions_of_what_is_rounding_and_what_is_stored_of_it_are_those_of_zero() -> None:
    """Each sample read the sign of rounding: of 41 up to 19. A clock that is set by `time - last >= 0.1` ran 94 of 100 times."""
    text = (
        "plain model A {\n  signal x = integral(v, 1), v = integral(-4*x, 0)\n  mode stored = 0, last = 0, ticks = 0\n"
    )
    text += (
        "  every 0.1 { stored = x/3 + x/7 - x*(10/21) }\n  mode risen = 0\n  when stored > 0 { risen = risen + 1 }\n"
    )
    text += (
        "  mode k = 0, kept = 0\n  every 0.1 { k = k + 0.37 }\n  when k/3 + k/7 - k*(10/21) > 0 { kept = kept + 1 }\n"
    )
    text += "  every 0.01 { ticks = ticks + (1 if time - last >= 0.1 else 0); last = time if time - last >= 0.1 else last }\n"
    for i, condition in enumerate(OF_CANCELLED):
        condition = re.sub(r"\bc\b", "(x/3 + x/7 - x*(10/21))", condition)
        text += f"  mode n{i} = 0\n  every 0.1 {{ n{i} = n{i} + (1 if {condition} else 0) }}\n  output c{i} = n{i}\n"
    model = bondgraph.load(text + "  output clock = ticks, rises = risen, keeps = kept\n}\n")
    found = model.simulate(to=4, points=3)
    assert [found.final(f"c{i}") for i in range(len(OF_CANCELLED))] == list(OF_CANCELLED.values())
    assert (found.final("clock"), found.final("rises"), found.final("keeps")) == (40, 0, 0)


SMALL = """plain model Small {
  parameter share = 1e-3
  signal a = integral(-a, 1), b = integral(1e4*(share*a - b), 0)
  output whole = a, part = b
  experiment go { simulate 0 .. 2 { rtol = 1e-4, points = 21, solver = radau } }
}"""


def test_what_stays_below_its_tolerance_is_told_with_one_that_is_enough() -> None:
    """It is measured by the largest state of its unit, so that it had no digit, without a word: the reactor F1 of the stiff DETEST."""
    model, told = bondgraph.load(SMALL), {}
    shares = [1e-2, 1e-4, 1e-6, 3e-8, 1e-9, 1e-11, 1e-13]
    results = [model.simulate(settings={"share": share}) for share in shares]
    for share, result in zip(shares, results, strict=True):
        told[share] = [str(w) for w in result.warnings]
        exact = share * (np.exp(-result.time) - np.exp(-1e4 * result.time)) / (1 - 1e-4)
        assert told[share] or np.abs(result["part"] - exact).max() < 0.1 * share
    assert [len(told[share]) for share in shares] == [0, 0, 0, 1, 1, 1, 1]
    together = model.simulate_many([{"share": share} for share in shares])
    assert [[str(w) for w in r.warnings] for r in together] == list(told.values())
    advice = re.search(r"set `(tolerance b = [^`]*)` in `simulate`", told[1e-11][0])
    assert advice is not None
    helped = bondgraph.load(SMALL.replace("solver", f"{advice[1]}, solver")).simulate(settings={"share": 1e-11})
    assert not helped.warnings and abs(helped.final("part") / (1e-11 * np.exp(-2)) - 1) < 1e-2


def test_what_has_lost_digits_to_a_large_state_of_its_unit_is_told() -> None:
    """An integral over a long time gave the angle beside it, of the same unit, an absolute tolerance of 0.08: x was wrong by 0.01, without a word."""
    text = """plain model Long {
  signal x = integral(y/1e8, 1), y = integral(-x/1e8, 0)
  output out = x, on = integral(1 if x*y > 0 else 0, 0)
  experiment go { simulate 0 .. 20e8 { solver = explicit} }
}"""
    result = bondgraph.load(text).simulate()
    (told,) = (str(w) for w in result.warnings)
    advice = re.search(r"set `(tolerance x = [^`]*)` in `simulate`", told)
    assert advice is not None and told.startswith("`out` is 1 at most")
    fixed = text.replace("solver", f"{advice[1]}, {advice[1].replace('x', 'y')}, solver")
    # where a threshold shows what size of x matters, nothing has to be told
    for right in (fixed, text.replace("x*y > 0", "x*y > 0.1")):
        helped = bondgraph.load(right).simulate()
        assert not helped.warnings and helped.final("out") == pytest.approx(math.cos(20), abs=1e-5)
