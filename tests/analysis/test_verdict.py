"""Verdicts of stability with bounds, rests at the scales of the start, steady rotations, and limits of a model in analyses."""

from __future__ import annotations

import json
import math

import mpmath
import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.analysis.eigenvalues import bounded_eigenvalues
from bondgraph.analysis.verdict import null_space
from bondgraph.commands import commands
from bondgraph.errors import RunFailed

GAP = """
model GapActuator {
  parameter A = 400 um*400 um, gap = 2 um, k = 5 [N/m], m = 2e-9 kg, mu = 1.8e-5 [Pa*s], R_s = 10 kohm
  constant eps0 = 8.8541878128e-12 [F/m]
  input volt = 0 V
  MSe supply : u = volt
  R lead : u = R_s*i
  C cap(q: electric, x: translation) : energy = q^2*(gap - x)/(2*eps0*A)
  I plate : p = m*v
  C spring : F = k*x
  MR film : F = mu*0.42*(400 um)^4/(gap - spring.x)^3*v
  supply -> 1(lead) -> cap.q
  1(plate, spring, film) -> cap.x
  output x = spring.x
  require spring.x < 0.95*gap "the plate touches"
}
"""


def stiff(kind: str, random: np.random.Generator) -> np.ndarray:
    """A random matrix whose eigenvalues span some fifteen decades: by rows, by rows and columns alike, or in states of other units."""
    n = int(random.integers(2, 8))
    rates = 10.0 ** random.uniform(-3, 12, n)
    plain = random.normal(size=(n, n))
    if kind == "rows":
        return plain * rates[:, None]
    if kind == "both":
        return plain * np.sqrt(rates[:, None] * rates)
    units = 10.0 ** random.uniform(-6, 6, n)
    return plain * rates[:, None] * units / units[:, None]


class TestEigenvalues:
    @pytest.mark.parametrize("kind", ["rows", "both", "units"])
    @pytest.mark.parametrize("seed", range(5))
    def test_bounds_hold_against_fifty_digits(self, kind: str, seed: int) -> None:
        """Each eigenvalue lies within its bound, and bounds are small beside the eigenvalues, fast and slow."""
        A = stiff(kind, np.random.default_rng([seed, len(kind)]))
        with mpmath.workdps(50):
            exact = [complex(v) for v in mpmath.eig(mpmath.matrix(A.tolist()), left=False, right=False)]
        found = bounded_eigenvalues(A)
        for value, bound in zip(found.values, found.bounds, strict=True):
            nearest = min(exact, key=lambda e: abs(e - value))
            assert abs(nearest - value) <= bound + 1e-300
            assert bound < 1e-3 * abs(value)
        assert found.growing == sum(e.real > 0 for e in exact)

    def test_a_slow_growth_beside_a_rate_1e16_times_as_large(self) -> None:
        """-1e16 with a state that it eliminates: 3.5 - 1 = 2.5 remains, which LAPACK does not see."""
        found = bounded_eigenvalues(np.array([[-1e16, 1e8], [-1e8, 3.5]]))
        assert found.growing == 1 and sorted(found.values.real)[1] == pytest.approx(2.5, rel=1e-12)

    @pytest.mark.parametrize("ratio", [1e14, 1e17])
    def test_what_the_entries_do_not_tell_is_not_decided(self, ratio: float) -> None:
        """x1' = -k (x1 - x2), x2' = k (x1 - x2) - x2 with k so large that k + 1 is hardly seen in a double."""
        found = bounded_eigenvalues(np.array([[-ratio, ratio], [ratio, -ratio - 1.0]]))
        assert found.growing == 0
        assert bool(found.undecided) == (ratio > 1e15)

    def test_null_vectors_have_the_zeros_of_the_space(self) -> None:
        vectors = null_space(np.array([[0.0, 1.0, 0.0], [0.0, -3.0, 0.0], [0.0, 1e9, -1e9]]))
        assert vectors.shape == (3, 1) and vectors[1:, 0].tolist() == [0.0, 0.0]


class TestStability:
    @pytest.mark.few(2)
    @pytest.mark.machine_code
    @pytest.mark.parametrize("resistance", ["1 ohm", "10 kohm", "1 Mohm"])
    @pytest.mark.parametrize("gap", ["1 um", "2 um", "5 um"])
    def test_a_plate_is_unstable_from_a_third_of_its_gap_on(self, gap: str, resistance: str) -> None:
        """However fast the lead is: by its static stiffness k - V^2 eps A/(g - x)^3; and the branch ends where the plate touches."""
        found = bondgraph.load(GAP).continuation(
            "volt", 0.0, "20 V", settings={"gap": gap, "R_s": resistance}, points=20
        )
        g = float(gap.split()[0]) * 1e-6
        assert [s.kind for s in found.special] == ["fold"]
        assert found.folds[0].outputs["x"] == pytest.approx(g / 3, rel=1e-8)
        inside = np.abs(found["x"] - g / 3) > 1e-3 * g
        assert (found.stable == (found["x"] < g / 3))[inside].all() and (found.unstable == (found["x"] > g / 3))[
            inside
        ].all()
        assert found["x"].max() == pytest.approx(0.95 * g, rel=1e-6) and "the plate touches" in found.ended

    @pytest.mark.parametrize("law", ["2 [N/m^3]*x^3", "2 [N/m^5]*x^5"])
    def test_a_spring_without_slope_is_not_decided(self, law: str) -> None:
        text = f"model A {{ I m : p = 1 kg*v\n C c : F = {law}\n R r : F = 1 [N*s/m]*v\n 1 b\n b -> m, c, r\n output x = c.x }}"
        found = bondgraph.load(text).equilibrium()
        assert found.stable is None and "not decided" in found.summary()
        told = found.to_json()
        assert told["stable"] is None and told["undecided"]

    @pytest.mark.parametrize("rate", [1e-3, 1.0, 1e6])
    def test_without_losses_it_is_stable_and_undamped(self, rate: float) -> None:
        text = f"model A {{ I m : p = 1 kg*v\n C c : F = {rate**2!r} [N/m]*x\n 1 b\n b -> m, c\n output x = c.x }}"
        found = bondgraph.load(text).equilibrium()
        assert found.stable and found.verdict.undamped == (pytest.approx(1j * rate),)
        assert "undamped" in found.summary()

    @pytest.mark.parametrize("damping", [1e-17, -1e-17, 1e-19])
    def test_a_damping_that_rounding_hides_is_not_decided(self, damping: float) -> None:
        text = f"model A {{ I m : p = 1 kg*v\n C c : F = 1 [N/m]*x\n R r : F = {damping!r} [N*s/m]*v\n 1 b\n b -> m, c, r\n output x = c.x }}"
        assert bondgraph.load(text).equilibrium().stable is None

    @pytest.mark.parametrize("damping", [1e-10, 1e-3])
    @pytest.mark.parametrize("sign", [1, -1])
    def test_a_small_damping_beside_a_fast_circuit_decides(self, damping: float, sign: int) -> None:
        """A pair at 1 1/s with a damping of 1e-10 beside a rate of 1e12 1/s."""
        text = f"""model A {{
          I m : p = 1 kg*v
          C c : F = 1 [N/m]*x
          R r : F = {sign * damping!r} [N*s/m]*v
          1 b
          b -> m, c, r
          C q : u = q/(1 pF)
          R s : u = 1 ohm*i
          Se e : u = 1 V
          e -> 1(s) -> q
          output x = c.x }}"""
        found = bondgraph.load(text).equilibrium()
        assert found.stable is (sign > 0) and found.growth == pytest.approx(-sign * damping / 2, rel=1e-4)

    def test_what_nothing_brings_back_has_no_part_in_it(self) -> None:
        """A free body in oil, two charges joined by a resistor (their sum stays), two masses joined by a damped spring (their momentum stays)."""
        for body in (
            "I m : p = 1 kg*v\n R r : F = 2 [N*s/m]*v\n 1 b\n b -> m, r\n signal x = integral(b.v, 7 m)\n output y = x",
            "C a : u = q/(1 uF) { start u = 3 V }\n C b : u = q/(2 uF)\n R r : u = 1 ohm*i\n 1 w\n w -> a, r, b\n output y = a.u",
            "I a, b : p = 1 kg*v\n C c : F = 5 [N/m]*x\n R r : F = 1 [N*s/m]*v\n 1 one, two, link\n one -> a\n two -> b\n"
            " 0 gap : translation\n one -> gap -> two\n gap -> link -> c, r\n output y = c.x",
        ):
            found = bondgraph.load(f"model A {{ {body} }}").equilibrium()
            assert found.stable, found.summary()


class TestRest:
    @pytest.mark.parametrize("start", [1.0, -3.0, 1e-6, 1e9])
    @pytest.mark.parametrize("length", [2, 3, 5])
    def test_a_chain_of_integrals_drifts(self, length: int, start: float) -> None:
        """The last is constant and not zero, so that the others grow for ever."""
        last = f"signal s{length} = integral(0, {start!r})"
        others = [f"signal s{i} = integral(s{i + 1}, 0)" for i in range(1, length)]
        text = "plain model A {\n" + "\n".join([last, *others]) + "\noutput y = s1\n}"
        with pytest.raises(RunFailed, match=r"no equilibrium was found: .*`s\d`"):
            bondgraph.load(text).equilibrium()

    @pytest.mark.parametrize(
        "body",
        [
            "I m : p = 2 kg*v { start v = 1 [m/s] }\n C c : F = 0 [N/m]*x\n 1 b\n b -> m, c\n output y = c.x",
            "Sf s : i = 1 mA\n C c : u = q/(1 uF)\n s -> 0(c)\n output y = c.u",
            "I m : p = 1 kg*v { start v = 1 [m/s] }\n 1 b\n b -> m\n output y = integral(b.v, 0 m)",
            "Se g : F = 9.81 N\n I m : p = 1 kg*v\n g -> 1(m)\n output y = m.v",
        ],
    )
    def test_what_is_driven_for_ever_is_refused(self, body: str) -> None:
        with pytest.raises(RunFailed, match="no equilibrium was found"):
            bondgraph.load(f"model A {{\n {body}\n }}").equilibrium()

    @pytest.mark.few(4)
    @pytest.mark.parametrize("volt", [1.0, 12.0, -400.0])
    @pytest.mark.parametrize("k", [0.05, 0.01, 2.0])
    def test_a_motor_turns_steadily(self, volt: float, k: float) -> None:
        """V = R i + k w and k i = b w; the angle goes on by w."""
        text = f"""model Mot {{
          input volt = {volt!r} V
          MSe s : u = volt
          R r : u = 1 ohm*i
          I l : lambda = 1 mH*i
          GY g : u1 = {k!r} [V*s]*omega2
          I j : L = 1e-4 [kg*m^2]*omega
          R b : M = 1e-4 [N*m*s]*omega
          s -> 1(r, l) -> g -> 1(j, b)
          output w = j.omega, phi = integral(j.omega, 0)
        }}"""
        model = bondgraph.load(text)
        found = model.equilibrium()
        speed = volt * k / (1e-4 + k**2)
        assert found["w"] == pytest.approx(speed, rel=1e-10) and found.stable
        assert found.steady == {"phi": pytest.approx(speed, rel=1e-10)} and "turns steadily" in found.summary()
        assert found.to_json()["steady"]["phi"]["value"] == pytest.approx(speed, rel=1e-10)
        moved = model.sensitivity(["volt"], "equilibrium")
        assert moved.of("w", "volt") == pytest.approx(k / (1e-4 + k**2), rel=1e-9)
        along = model.continuation("volt", volt, 2 * volt, points=3)
        assert along["w"] == pytest.approx(along.values * k / (1e-4 + k**2), rel=1e-9) and along.stable.all()
        assert {round(abs(m.eigenvalue)) for m in model.modes()} >= {0}

    @pytest.mark.parametrize("forces", [(0.1, 0.2, -0.3), (1.1, 2.2, -3.3), (1e6 + 0.1, -1e6, -0.1)])
    def test_forces_that_cancel_but_for_rounding_rest(self, forces: tuple[float, ...]) -> None:
        sources = "\n".join(f"parameter F{i} = {f!r} N\n Se s{i} : F = F{i}" for i, f in enumerate(forces))
        arrows = "\n".join(f"s{i} -> b" for i in range(len(forces)))
        text = (
            f"model A {{\n {sources}\n 1 b : translation\n I m : p = 1 kg*v\n {arrows}\n b -> m\n output y = m.v\n }}"
        )
        assert abs(bondgraph.load(text).equilibrium()["y"]) < 1e-9


class TestLimits:
    TEXT = """model A {
      input load = 10 N
      parameter k = 100 [N/m]
      MSe s : F = load
      C c : F = k*x
      R r : F = 2 [N*s/m]*v
      I m : p = 1 kg*v
      s -> 1(m, c, r)
      output x = c.x
      require c.x < 20 cm "the end of the rail"
    }"""

    @pytest.mark.parametrize(
        "ask", ["equilibrium", "modes", "linearize", "response", "sensitivity", "invert", "continuation"]
    )
    def test_no_analysis_beyond(self, ask: str) -> None:
        """At 10 N it holds, at 30 N it does not."""
        model = bondgraph.load(self.TEXT)
        asked = {
            "invert": lambda load: model.invert({"x": load / 100}, ["load"]),
            "continuation": lambda load: model.continuation("k", 100.0, 200.0, settings={"load": load}),
        }.get(ask, lambda load: getattr(model, ask)(settings={"load": load}))
        asked(10.0)
        with pytest.raises(RunFailed, match="the end of the rail"):
            asked(30.0)

    def test_a_branch_ends_there(self) -> None:
        found = bondgraph.load(self.TEXT).continuation("load", 0.0, "100 N")
        assert found["x"][-1] == pytest.approx(0.2, rel=1e-6) and "the end of the rail" in found.ended

    @pytest.mark.machine_code
    def test_points_of_a_study_fail_there(self) -> None:
        """Of loads from 10 N to 30 N half are beyond."""
        model = bondgraph.load(self.TEXT)
        for of in ("equilibrium", "simulate"):
            options = {"to": 20.0} if of == "simulate" else {}
            found = model.montecarlo({"load": "uniform(10 N, 30 N)"}, (of,), samples=16, indices=0, **options)
            beyond = int((found("load") >= 20).sum())
            assert 0 < beyond < 16 and len(found.failures) >= beyond
            assert all("the end of the rail" in why for why in found.failures.values())

    def test_from_the_command_line(self, tmp_path: object) -> None:
        from pathlib import Path

        file = Path(str(tmp_path)) / "rail.bg"
        file.write_text(self.TEXT, encoding="utf-8")
        done = CliRunner().invoke(
            commands, ["bode", str(file), "--input", "load", "--output", "x", "--set", "load=30 N"]
        )
        assert done.exit_code != 0
        told = json.loads(CliRunner().invoke(commands, ["equilibrium", str(file), "--json"]).stdout)
        assert told["stable"] is True and math.isclose(told["outputs"]["x"]["value"], 0.1, rel_tol=1e-9)


def test_rounding_of_terms_that_cancel_is_no_growth() -> None:
    """A ball that rolls without slip, held by a spring in one direction: along the other it may roll on for ever. The moment of its weight is
    m g r - m g r, whose last place would grow as its root, 9e-8 1/s."""
    text = """model Ball {
      parameter r = 0.1 m
      multibody s : spatial {
        gravity = (0, 0, -9.81 [m/s^2])
        body marble { mass = 2 kg, inertia = 0.4*2 kg*r^2*(1, 1, 1), at = (0, 0, r) }
        wheel w : ground to marble { at = (0, 0, r), radius = r }
      }
      C spring : F = 2 [N/m]*(x - 1 mm)
      s.marble.x -> spring
      output x = s.marble.x
    }"""
    found = bondgraph.load(text).equilibrium()
    assert found.stable is None and found.verdict.word == "not decided"
    assert max(v.imag for v in found.verdict.undamped) == pytest.approx(math.sqrt(2 / (1.4 * 2)))


@pytest.mark.parametrize("coupling", [0.0, 1.0, 1e-3])
def test_equal_oscillators_that_drive_one_another_in_a_row_are_not_stable(coupling: float) -> None:
    """Signals that keep no energy: the second one grows with t*sin(t), though both eigenvalues stand on the imaginary axis."""
    drive = f"{coupling!r}*c"
    found = bondgraph.load(
        f"""plain model Row {{
          parameter k = 1
          signal a = integral(b, 0), b = integral({drive} - k*a, 0), c = integral(d, 0), d = integral(-k*c, 0)
          output y = a, z = c
        }}"""
    ).equilibrium()
    assert found.stable is (None if coupling else True)
