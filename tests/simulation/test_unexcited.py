"""A run leaves out states that nothing excites; the results are those of a run that computes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph import RunFailed, UsageError
from bondgraph.compiled_scene import chosen_target
from bondgraph.model import Model
from bondgraph.results.result import Result
from bondgraph.simulation.run import run
from bondgraph.simulation.run_options import RunOptions
from bondgraph.simulation.settings import settle
from compiler.codegen.cost import cost

PAIR = """
model Pair {
  parameter x0 = 0 m, k = 8 [N/m]
  input push = 3 N, pull = 0 N
  for i in 1..2 {
    1 body[i]
    I mass[i]   : p = i*1 kg*v
    C spring[i] : F = k*x + 5 [N/m^3]*x^3
    R damper[i] : F = 0.4 [N*s/m]*v
    body[i] -> mass[i], spring[i], damper[i]
  }
  MSe drive[1] : F = push*cos(2 [1/s]*time)
  MSe drive[2] : F = pull
  drive[1] -> body[1]
  drive[2] -> body[2]
  # more
  output x = spring[1].x, y = spring[2].x, power = damper[2].F*damper[2].v
  experiment go { simulate 0 .. 2 s }
}
"""
SECOND = ("mass[2].p", "spring[2].x")


def with_more(lines: str, text: str = PAIR) -> str:
    return text.replace("# more", lines)


def both(text: str, settings: Mapping[str, str | float] | None = None, **options: Any) -> tuple[Result, Result]:
    """A run, and the same with all states."""
    model = bondgraph.load(text)
    lean = model.simulate(settings=dict(settings or {}), **options)
    target = chosen_target(options.get("target"))
    settled = settle(model, "", settings or {}, None, False, target)
    return lean, run(model, replace(settled.scene, from_start=False), settled.values, RunOptions(target=target))


def unexcited(text: str, settings: Mapping[str, str | float] | None = None, **options: Any) -> tuple[str, ...]:
    """The states that a run leaves out, after a look at its results beside those of all states."""
    lean, whole = both(text, settings, **options)
    assert whole.certificate.unexcited == ()
    assert np.allclose(lean.values, whole.values, rtol=0, atol=3e-6 * np.abs(whole.values).max(initial=1e-300))
    return lean.certificate.unexcited


def operations(model: Model, lean: bool) -> int:
    scene = replace(model.scene("go"), from_start=lean)
    return cost(model.compilation(scene).lowered).rates


def test_a_second_oscillator_that_nothing_drives() -> None:
    lean, whole = both(PAIR)
    assert (len(lean.certificate.states), len(whole.certificate.states)) == (2, 4)
    assert lean.certificate.unexcited == SECOND and lean.certificate.unneeded == ()
    assert (lean.certificate.driven, whole.certificate.driven) == (True, True)
    assert not lean["y"].any() and not lean["power"].any() and not whole["y"].any()
    assert (
        np.abs(lean["x"] - whole["x"]).max() < 1e-7
    )  # the steps are others: a norm of errors is over two states, not four
    model = bondgraph.load(PAIR)
    assert (operations(model, True), operations(model, False)) == (7, 14)


def test_linear_oscillators_have_the_same_digits() -> None:
    lean, whole = both(PAIR.replace(" + 5 [N/m^3]*x^3", ""))
    assert (len(lean.certificate.states), len(whole.certificate.states)) == (2, 4)
    assert lean.solver == whole.solver == "matrix exponential"
    assert np.abs(lean.values - whole.values).max() < 1e-12


def test_a_nonlinear_part_at_rest_leaves_the_matrix_exponential() -> None:
    """A nonlinear law that stays at rest does not keep the run from it."""
    text = with_more("C hard : F = 5 [N/m^3]*x^3\n  body[2] -> hard", PAIR.replace(" + 5 [N/m^3]*x^3", ""))
    lean, whole = both(text)
    assert lean.certificate.linear and not whole.certificate.linear
    assert lean.solver == "matrix exponential" != whole.solver
    assert np.abs(lean["x"] - whole["x"]).max() < 1e-6


LAWS = {
    "signal alone": "MR drag : F = mass[1].v*1 [N*s^2/m^2]*v\n  body[2] -> drag",
    "product": "MSe also : F = spring[1].x*spring[2].x*1 [N/m^2]\n  also -> body[2]",
    "quotient of a number": "R drag : F = tanh(v/0.1 [m/s])*1 N\n  body[2] -> drag",
    "exponential": "R diode : F = 1 N*(exp(v/1 [m/s]) - 1)\n  body[2] -> diode",
    "square": "R drag : F = 1 [N*s^2/m^2]*v*abs(v)\n  body[2] -> drag",
    "choice of a factor": "MSe also : F = spring[2].x*(1 [N/m] if spring[1].x > 0.1 m else 2 [N/m])\n  also -> body[2]",
    "stop": "parameter gap = 1 mm\n  C stop : F = 1e3 [N/m]*max(x - gap, 0)\n  MR film : F = stop.F*max(v/1 [m/s], -1)\n  body[2] -> stop, film",
    "backlash": "parameter play = 1 mm\n  C flank : F = 1e3 [N/m]*(x - play) if x > play else 1e3 [N/m]*(x + play) if x < -play else 0 N\n  body[2] -> flank",
    "shared displacement": "C also : F = 2 [N/m]*x\n  body[2] -> also",
    "transformer": "TF lever : F1 = 3*F2\n  1 far\n  I also : p = 2 kg*v\n  body[2] -> lever -> far -> also",
    "algebraic loop": "0 j\n  R a : F = 1 [N*s/m]*v\n  R b : F = 2 [N*s/m]*v\n  1 e\n  R c : F = 1 [N*s/m]*v\n  body[2] -> j -> a, e\n  e -> b, c",
    "sensor": "signal far = integral(spring[2].x, 0 [m*s])\n  output far2 = far",
}


@pytest.mark.machine_code
@pytest.mark.parametrize("lines", LAWS.values(), ids=list(LAWS))
def test_what_is_joined_by_signals_or_vanishes_at_zero_stays_at_rest(lines: str) -> None:
    assert set(SECOND) <= set(unexcited(with_more(lines)))


EXCITED = {
    "a spring between": "0 j\n  C link : F = 1 [N/m]*x\n  body[1] -> j -> body[2]\n  j -> link",
    "a start": "C also : F = 2 [N/m]*x { start x = 1 mm }\n  body[2] -> also",
    "a preload": "R load : F = 1 N + 1 [N*s/m]*v\n  body[2] -> load",
    "a signal of the other": "MSe also : F = spring[1].x*1 [N/m]\n  also -> body[2]",
    "a delayed signal": "signal late = delay(spring[1].x, 0.1 s)\n  MSe also : F = late*1 [N/m]\n  also -> body[2]",
    "an event that sets it": "when time > 0.5 s { mass[2].v = 1 [m/s] }",
    "an event that reads it": "mode count = 0\n  when spring[2].x > 1 mm { count = count + 1 }\n  output n = count",
    "a sampled force": "mode force = 0 N\n  every 0.1 s { force = force + 0.1 N }\n  MSe also : F = force\n  also -> body[2]",
    "noise": "Se also : F = 1 N*noise(time, 0.1 s, 1)\n  also -> body[2]",
    "a switched junction": "mode on = true\n  when time > 0.3 s { on = false }\n  1 gate { active = on }\n  R brake : F = 1 [N*s/m]*v\n  C soft : F = 1 [N/m]*x\n  gate -> brake, soft\n  0 j\n  body[2] -> j -> gate",
    "a jump at rest": "R dry : F = 0.1 N*sign(v)\n  body[2] -> dry",
    "a quotient by a state": "MSe also : F = spring[2].x*1 [N*m]/(spring[1].x + 9 m)/1 m\n  also -> body[2]",
    "a root": "MSe also : F = 1 N*sqrt(spring[2].x/1 m)\n  also -> body[2]",
    "a stop that is reached": "C stop : F = 1e3 [N/m]*(x - 1 mm) if x > -1 mm else 0 N\n  body[2] -> stop",
}  # fmt: skip


@pytest.mark.machine_code
@pytest.mark.parametrize("lines", EXCITED.values(), ids=list(EXCITED))
def test_where_something_moves_it_or_may_nothing_is_left_out(lines: str) -> None:
    assert unexcited(with_more(lines)) == ()


READINGS = {
    "a condition at its bound": "MSe also : F = 1 N if spring[2].x >= 0 m else 2 N\n  also -> body[1]",
    "a strict one": "MSe also : F = 1 N if spring[2].x < 0 m else 2 N\n  also -> body[1]",
    "a kink": "MSe also : F = 1 N*abs(spring[2].x/1 m) + 1 N*sqrt(spring[2].x/1 m)\n  also -> body[1]",
    "a table": "output z = linear(spring[2].x, (-1 m, 2 m), (2, 3))",
    "a requirement": 'require spring[2].x > 1 mm "too near"',
}


@pytest.mark.machine_code
@pytest.mark.parametrize("lines", READINGS.values(), ids=list(READINGS))
def test_what_reads_a_state_at_rest_reads_zero(lines: str) -> None:
    assert unexcited(with_more(lines)) == SECOND
    lean, whole = both(with_more(lines))
    assert [str(w) for w in lean.warnings] == [str(w) for w in whole.warnings]
    assert len(lean.warnings) == ("require" in lines)


@pytest.mark.parametrize(
    "lines",
    [
        "output z = 1 m/spring[2].x",
        "output z = linear(spring[2].x, (1 m, 2 m), (2, 3))",
        "MSe also : F = 1 N*linear(spring[2].x, (1 m, 2 m), (2, 3))\n  also -> body[1]",
        "MSe also : F = 1 N*acosh(1 + spring[2].x/1 m)\n  also -> body[2]",  # as steep as a root
        "MSe also : F = 1 N*acos(1 - spring[2].x/1 m)\n  also -> body[2]",
        "R dry : F = 0.1 N if v > 0 [m/s] else -0.1 N\n  body[2] -> dry",  # slides along its condition
        "MSe also : F = 1 N*linear(spring[1].x, (-0.1 m, 0 m, 0.1 m), (-2, 0, 3))*spring[2].x/1 m\n  also -> body[2]",
    ],
)
def test_what_fails_with_all_states_fails_without(lines: str) -> None:
    model = bondgraph.load(with_more(lines))
    with pytest.raises(RunFailed) as lean:
        model.simulate()
    scene = replace(settle(model, "", {}, None, False, "numpy").scene, from_start=False)
    with pytest.raises(RunFailed) as whole:
        run(model, scene, {}, RunOptions(target="numpy"))
    assert str(lean.value)[:60] == str(whole.value)[:60]


def test_settings_decide() -> None:
    """A number that a run sets is an argument of its program, for all values; so is a start that reads one."""
    assert unexcited(PAIR, {"k": 3.0}) == SECOND
    assert unexcited(PAIR, {"pull": 1.0}) == ()
    assert unexcited(PAIR, {"pull": 0.0}) == ()
    assert unexcited(PAIR, {"pull": "1 N*time/1 s"}) == ()
    text = PAIR.replace("experiment go {", "experiment go { start spring[2].x = x0;")
    assert unexcited(text) == SECOND
    assert unexcited(text, {"x0": 0.1}) == () and unexcited(text, {"x0": 0.0}) == ()
    assert unexcited(text.replace("x0 = 0 m", "x0 = 1 m")) == ()
    assert unexcited(PAIR.replace("i*1 kg*v", "i*1 kg*v*k/8 [N/m]"), {"k": 3.0}) == ()  # divides by what is set


@pytest.mark.parametrize("target", ["numpy", None])
def test_with_and_without_machine_code(target: str | None) -> None:
    assert unexcited(PAIR, target=target) == SECOND


def test_plans_that_read_or_place_states_keep_them() -> None:
    assert unexcited(PAIR.replace("simulate", "equilibrium; simulate")) == ()
    kept = bondgraph.load(PAIR.replace("2 s }", "2 s { tolerance spring[2].x = 1 nm } }")).simulate()
    assert kept.certificate.unexcited == ()


def test_an_energy_balance_has_all_elements() -> None:
    result = bondgraph.load(PAIR).simulate(energy=True)
    assert result.certificate.unexcited == () and result.energy is not None
    assert "spring[2]" in {e.name for e in result.energy.elements}
    lossless = with_more("", PAIR).replace("R damper[i] : F = 0.4 [N*s/m]*v", "R damper[i] : F = 0 [N*s/m]*v")
    assert bondgraph.load(lossless.replace("push = 3 N", "push = 0 N")).simulate(solver="energy").certificate.unexcited == ()  # fmt: skip


def test_linear_analyses_have_the_modes_of_what_is_at_rest() -> None:
    model = bondgraph.load(PAIR)
    assert len(model.modes(state="start")) == 2 and len(model.linearize(state="start").states) == 4
    assert set(model.equilibrium(settings={"push": 0.0}).states) >= set(SECOND)


def test_derivatives_by_what_would_excite_it() -> None:
    found = bondgraph.load(PAIR).sensitivity_of_run(["pull"], outputs=("y",))
    assert np.abs(found.slopes).max() > 0.01


def test_a_run_goes_on_with_the_same_states(tmp_path: Path) -> None:
    whole = bondgraph.load(PAIR).simulate(points=21)
    bondgraph.load(PAIR).simulate(to=1.0, points=11).to_npz(tmp_path / "part.npz")
    result = bondgraph.load(PAIR).simulate(points=21, start=tmp_path / "part.npz")
    assert result.certificate.unexcited == SECOND
    assert np.abs(result.values - whole.values).max() < 1e-5


def test_what_moved_before_goes_on_moving(tmp_path: Path) -> None:
    """A start in the text of the first part alone: the second one has the same equations."""
    started = PAIR.replace("experiment go {", "experiment go { start spring[2].x = 1 m;")
    whole = bondgraph.load(started).simulate(points=21)
    bondgraph.load(started).simulate(to=1.0, points=11).to_npz(tmp_path / "part.npz")
    result = bondgraph.load(PAIR).simulate(points=21, start=tmp_path / "part.npz")
    assert result.certificate.unexcited == () and np.abs(result.values - whole.values).max() < 1e-5
    bondgraph.load(PAIR).simulate(to=1.0, points=11).to_npz(tmp_path / "rest.npz")
    with pytest.raises(UsageError, match="other equations"):
        bondgraph.load(started).simulate(points=21, start=tmp_path / "rest.npz")


def test_a_model_at_rest_is_all_left_out() -> None:
    idle, _ = both(PAIR.replace("push = 3 N", "push = 0 N"))
    assert (idle.certificate.states, idle.steps, idle.solver) == ((), 0, "none") and not idle.values.any()
    assert len(idle.certificate.unexcited) == 4 and "4 states that nothing excites" in idle.summary()


def test_sweeps_from_rest() -> None:
    found = bondgraph.load(PAIR).sweep({"pull": [0.0, 1.0]}, experiment="go")
    single = bondgraph.load(PAIR).simulate(settings={"pull": 1.0})
    table, column = found.table(), list(found.names).index("y")
    assert (table[0, column], table[1, column]) == (0.0, single["y"][-1])


def test_noise_does_not_hide_a_rest() -> None:
    """A noise at the driven one alone."""
    assert unexcited(with_more("Se also : F = 1 N*noise(time, 0.1 s, 1)\n  also -> body[1]")) == SECOND


def test_another_choice_of_states_has_those_at_rest() -> None:
    """Two capacitors exchange their places as state; the program after that has all states, from what they are there."""
    text = """
model Exchange {
  signal n = exp(12*sin(time/1 s))
  0 left, right : electric
  C a : q = 2 F*u { start u = 1 V }
  C b : q = 3 F*u
  MTF t : u1 = n*u2
  left -> t -> right
  left -> a
  right -> b
  1 idle
  I coil : lambda = 1 H*i
  C store : q = 1 F*u
  R wire : u = 1 ohm*i
  idle -> coil, store, wire
  output ua = a.u, ub = b.u, rest = store.u
  experiment go { simulate 0 .. 6 s; report ua, ub, rest }
}
"""
    lean, whole = both(text)
    assert set(lean.certificate.unexcited) == {"coil.lambda", "store.q"}
    assert not lean["rest"].any() and np.abs(lean["ua"] - whole["ua"]).max() < 1e-4 * np.abs(whole["ua"]).max()


LINKS = (  # from a body `a` to a body `b`, by the number of the link
    "0 j{j} : translation\n  C k{j} : F = 1.5 [N/m]*x\n  b{a} -> j{j} -> b{b}\n  j{j} -> k{j}",
    "MR d{j} : F = 1 [N*s/m]*cos(c{a}.x/1 m)*v\n  b{b} -> d{j}",
    "MSe s{j} : F = 0.7 [N/m^2]*c{a}.x*c{b}.x\n  s{j} -> b{b}",
    "MSe s{j} : F = 0.4 [N*s/m]*m{a}.v\n  s{j} -> b{b}",
    "MSe s{j} : F = off*cos(time/1 s)\n  s{j} -> b{b}",
    "Se s{j} : F = 1 N*sin(2 [1/s]*time)\n  s{j} -> b{b}",
    "signal w{j} = integral(c{a}.x/1 m, 0 s)\n  MSe s{j} : F = 0.2 [N/s]*w{j}\n  s{j} -> b{b}",
    "TF t{j} : F1 = 2*F2\n  1 e{j} : translation\n  I n{j} : p = 0.3 kg*v\n  b{b} -> t{j} -> e{j} -> n{j}",
)
SPRINGS = ("3 [N/m]*x + 2 [N/m^3]*x^3", "2 N*sin(x/1 m)", "1 N*(exp(x/1 m) - 1)", "5 [N/m]*x + 1 [N/m^2]*x*abs(x)")


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(8))
def test_random_couplings(seed: int) -> None:
    """Exactly the oscillators that stay at zero in a run of all states are left out."""
    dice = np.random.default_rng(seed)
    count, lines = int(dice.integers(3, 6)), ["model Many {", "  input off = 0 N"]
    for k in range(count):
        start = " { start x = 0.2 m }" if dice.random() < 0.15 else ""
        lines += [f"  1 b{k} : translation", f"  I m{k} : p = 2 kg*v", f"  C c{k} : F = {dice.choice(SPRINGS)}{start}"]
        lines += [f"  R r{k} : F = 0.3 N*tanh(v/1 [m/s])", f"  b{k} -> m{k}, c{k}, r{k}"]
    for j in range(dice.integers(1, 2 * count)):
        a, b = dice.choice(count, 2, replace=False)
        lines.append("  " + str(dice.choice(LINKS)).format(a=a, b=b, j=j))
    lines += [f"  output x{k} = c{k}.x" for k in range(count)]
    lean, whole = both(
        "\n".join([*lines, "  experiment go { simulate 0 .. 1 s { rtol = 1e-8 } }\n}\n"]), target="numpy"
    )
    still = {f"c{k}.x" for k in range(count) if not whole[f"x{k}"].any()}
    assert {n for n in lean.certificate.unexcited if n.startswith("c")} == still
    assert np.abs(lean.values - whole.values).max() < 1e-7
