"""Limits in a run: ends of tables, requirements of a model, and steps bounded by random numbers."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from compiler.algebra import interpolate

DRIVEN = """
model Driven {{
  Sf drive : v = {speed}
  C  spring : F = {law}
  drive -> spring
  {more}
  output x = spring.x, F = spring.F
}}
"""
TABLE = "monotone(x, (0, 1 m, 2 m), (0, 3 N, 4 N))"


def driven(speed: str, law: str = TABLE, more: str = "", to: float = 1.0, **options: object) -> bondgraph.Result:
    text = DRIVEN.format(speed=speed, law=law, more=more)
    return bondgraph.load(text).simulate(to=to, **options)  # type: ignore[arg-type]


class TestTables:
    def test_a_run_stops_where_a_table_ends(self) -> None:
        """At 1.5 m/s the end at 2 m is reached after 4/3 s."""
        driven("1.5 [m/s]", to=1.333)
        with pytest.raises(
            bondgraph.RunFailed, match=r"`monotone\(…\)` of `spring` \(text:4\).* spring.x = 2.00000\d+ m.* 0 to 2 m"
        ) as told:
            driven("1.5 [m/s]", to=2)
        assert float(str(told.value).split("t = ")[1].split(" s")[0]) == pytest.approx(4 / 3, rel=1e-5)

    def test_the_start_counts_too(self) -> None:
        with pytest.raises(bondgraph.RunFailed, match=r"t = 0 s .* spring.x = -1 m"):
            driven("1 [m/s]", TABLE + " { start x = -1 m }")

    def test_a_branch_that_is_not_taken_is_not_asked(self) -> None:
        result = driven("3 [m/s]", f"{TABLE} if x < 2 m else 4 N + 0.5 [N/m]*(x - 2 m)")
        assert result.final("F") == pytest.approx(4.5)
        result = driven("3 [m/s]", "monotone(min(x, 2 m), (0, 1 m, 2 m), (0, 3 N, 4 N))")
        assert result.final("F") == pytest.approx(4.0)

    def test_trial_points_beyond_the_end_do_not_count(self) -> None:
        """A fall onto a place where the table ends: the solver tries beyond, the run comes to rest within."""
        text = """
        model Fall {
          I mass : p = 1 kg*v  { start v = 1 [m/s] }
          R loss : F = 20 [N*s/m]*v
          C wall : F = 1 [N/m]*linear(x, (-1 m, 0.0501 m), (-1 m, 0.0501 m))
          1(mass) -> loss
          output x = wall.x
        }""".replace("1(mass) -> loss", "1(mass, wall) -> loss")
        result = bondgraph.load(text).simulate(to=0.5, rtol=1e-3)
        assert result["x"].max() <= 0.0501

    def test_what_only_the_tolerance_lies_beyond_is_no_end(self) -> None:
        """A valve that opens to 1, the last point of its table, as closely as a coarse run knows it."""
        text = """
        model A {
          signal rise = integral((1 - rise)/1 ms + 20 [1/s]*(0.5 - rise)*rise*(1 - rise), 0)
          output y = linear(rise, (0, 1), (0, 1))
        }"""
        for rtol in (1e-2, 1e-3, 1e-6):
            result = bondgraph.load(text).simulate(to=0.1, rtol=rtol)
            assert result.final("y") == pytest.approx(1, abs=10 * rtol)

    @pytest.mark.machine_code
    def test_corners_in_time_are_instants(self) -> None:
        """A needle of 2 us: no step runs over it, and its area is exact."""
        speed = "1 [m/s]*linear(time, (0 s, 0.4 s, 0.400001 s, 0.400002 s, 1 s), (0, 0, 1e6, 0, 0))"
        assert driven(speed, "1 [N/m]*x").final("x") == pytest.approx(1.0, rel=1e-9)
        smooth = "1 [m/s]*monotone(time, (0 s, 0.4 s, 0.400001 s, 0.400002 s, 1 s), (0, 0, 1e6, 0, 0))"
        assert driven(smooth, "1 [N/m]*x").final("x") == pytest.approx(1.0, rel=1e-6)

    def test_a_record_is_integrated_exactly(self) -> None:
        """The integral of straight lines is the trapezoidal sum."""
        values = np.sin(np.arange(21.0)) * 3
        places = ", ".join(f"{0.05 * i:g} s" for i in range(21))
        speed = f"1 [m/s]*linear(time, ({places}), ({', '.join(map(str, values))}))"
        assert driven(speed, "1 [N/m]*x").final("x") == pytest.approx(np.trapezoid(values, dx=0.05), rel=1e-9)

    def test_a_setting_outside_of_the_points(self) -> None:
        text = "model A {\n  parameter T = 250\n  constant c = linear(T, (200, 300), (1, 3))\n  output y = c\n}\n"
        assert bondgraph.load(text).simulate(to=1).final("y") == 2
        with pytest.raises(
            bondgraph.CompilationFailed, match="310 lies outside of the table, which goes from 200 to 300"
        ):
            bondgraph.load(text).simulate(to=1, settings={"T": "310"})


class TestRequirements:
    def test_when_and_with_what(self) -> None:
        """x = t^2/2 m passes 0.08 m at 0.4 s."""
        result = driven("1 [m/s^2]*time", "1 [N/m]*x", 'require spring.x < 80 mm "short"')
        (left,) = result.warnings
        assert left.time == pytest.approx(0.4, rel=1e-6)
        assert (left.owner, left.condition, left.text, left.place) == ("", "spring.x < 80 mm", "short", "text:6")
        assert left.values == (("spring.x", pytest.approx(0.08, rel=1e-6), "m"),)
        assert str(left).startswith("from t = 0.4") and "`spring.x < 80 mm` (short), text:6: spring.x = 0.08 m" in str(
            left
        )
        assert result.final("x") == pytest.approx(0.5), "the run goes on"
        assert result.to_json()["warnings"][0]["values"]["spring.x"]["unit"] == "m"

    def test_silence_where_all_is_well(self) -> None:
        result = driven("1 [m/s]", "1 [N/m]*x", "require spring.x < 1.1 m and (spring.x > 2 m or not spring.F > 3 N)")
        assert result.warnings == () and result.to_json()["warnings"] == []

    def test_what_is_left_and_entered_again_within_a_run(self) -> None:
        """Half a period of a sine, for any reported instants."""
        result = driven("pi*cos(pi*time/1 s)*1 [m/s]", "1 [N/m]*x", "require spring.x < 0.5 m", points=2)
        (left,) = result.warnings
        assert left.time == pytest.approx(math.asin(0.5) / math.pi, rel=1e-4)

    def test_parameters_alone_at_once(self) -> None:
        result = driven("1 [m/s]", "k*x", 'parameter k = 2 [N/m], most = 1 [N/m]\n  require k < most "soft"')
        (left,) = result.warnings
        assert left.time == 0 and [(n, v) for n, v, _ in left.values] == [("k", 2.0), ("most", 1.0)]
        settings = {"k": "0.5 [N/m]"}
        text = DRIVEN.format(speed="1 [m/s]", law="k*x", more="parameter k = 2 [N/m]\n  require k < 1 [N/m]")
        assert bondgraph.load(text).simulate(to=1, settings=settings).warnings == ()

    def test_a_limit_belongs_to_every_run(self) -> None:
        """Nothing that is reported needs the angle: it is computed for the limit."""
        more = "signal way = integral(2 [1/s]*spring.x, 0 m)\n  require way < 0.25 m"
        result = driven("1 [m/s]", "1 [N/m]*x", more, outputs=("F",))
        assert result.names == ("F",)
        assert [left.time for left in result.warnings] == [pytest.approx(0.5, rel=1e-5)]

    def test_each_instance_says_its_name_and_where_it_stands(self) -> None:
        text = """model Half { input u = 0; require u < 0.5 "half"; output y = u }
model Both {
  for i in 1..2 { Half part[i] { u = i*time/1 s } }
  output y = part[1].y + part[2].y
}"""
        left = bondgraph.load(text).simulate(to=1, points=11).warnings
        assert [(w.owner, w.stands) for w in left] == [("part[2]", "text:3"), ("part[1]", "text:3")]
        assert [w.time for w in left] == pytest.approx([0.25, 0.5], rel=1e-9)

    def test_a_jump_in_time(self) -> None:
        (left,) = driven("1 [m/s]*step(time - 0.3 s)", "1 [N/m]*x", "require drive.v < 0.5 [m/s]").warnings
        assert left.time == 0.3

    def test_the_energy_balance_sees_the_same(self) -> None:
        plain = driven("1 [m/s]", "1 [N/m]*x", "require spring.x < 0.5 m")
        balanced = driven("1 [m/s]", "1 [N/m]*x", "require spring.x < 0.5 m", energy=True)
        assert plain.steps == balanced.steps and plain.warnings[0].time == pytest.approx(balanced.warnings[0].time)

    def test_on_the_command_line(self, tmp_path: Path) -> None:
        file = tmp_path / "a.bg"
        text = DRIVEN.format(speed="1 [m/s]", law="1 [N/m]*x", more='require spring.x < 0.5 m "short"')
        file.write_text(text, encoding="utf-8")
        done = CliRunner().invoke(commands, ["run", str(file), "--to", "1", "--json"])
        assert done.exit_code == 0
        assert done.stderr.startswith("warning: from t = 0.5") and "(short)" in done.stderr
        assert json.loads(done.stdout)["warnings"][0]["text"] == "short"


class TestNoise:
    def test_no_step_is_longer_than_a_period(self) -> None:
        """The integral of noise over whole periods is the mean of neighbours, for any tolerance."""
        result = driven("1 [m/s]*noise(time, 10 ms, 4)", "1 [N/m]*x", rtol=1e-3, points=2)
        numbers = [interpolate.random_number(k, 4) for k in range(101)]
        assert result.steps >= 100
        assert result.final("x") == pytest.approx(np.trapezoid(numbers, dx=0.01), abs=2e-3)

    def test_values_are_those_of_the_stream(self) -> None:
        result = driven("0 [m/s]", "1 [N/m]*x", "output n = noise(time, 0.1 s, 9)", points=11)
        assert result["n"] == pytest.approx([interpolate.random_number(k, 9) for k in range(11)], abs=1e-9)

    def test_seeds_differ(self) -> None:
        outputs = ", ".join(f"n{i} = noise(time, 0.01 s, {i})" for i in (1, 2))
        result = driven("0 [m/s]", "1 [N/m]*x", f"output {outputs}", points=1001)
        assert abs(np.corrcoef(result["n1"], result["n2"])[0, 1]) < 0.3

    def test_a_condition_on_noise_switches_in_every_period(self) -> None:
        """2000 periods: the share of time above zero is that of the stream, each crossing found."""
        result = driven("1 [m/s]*step(noise(time, 0.5 ms, 6))", "1 [N/m]*x", points=2)
        numbers = np.array([interpolate.random_number(k, 6) for k in range(2001)])
        inside = np.arange(0.5, 64) / 64
        smooth = 10 * inside**3 - 15 * inside**4 + 6 * inside**5
        values = numbers[:-1, None] + np.diff(numbers)[:, None] * smooth
        assert result.final("x") == pytest.approx(np.mean(values >= 0), abs=3e-4)

    def test_a_condition_on_noise_that_changes_too_often(self) -> None:
        with pytest.raises(bondgraph.RunFailed, match="changes too often"):
            driven("1 [m/s]*step(noise(time, 1 us, 6))", "1 [N/m]*x", to=10)

    def test_a_place_that_moves_and_time(self) -> None:
        """A wave that runs along a road: its rate in time bounds the steps, the error from the moving place is controlled by the solver."""
        result = driven("1 [um/s]", "1 [N/m]*x", "output n = noise(time + spring.x/(1 [m/s]), 5 ms, 1)", points=2)
        assert result.steps >= 200

    def test_over_a_place(self) -> None:
        result = driven("2 [m/s]", "1 [N/m]*x", "output road = noise(spring.x, 0.1 m, 3)")
        expected = [interpolate.noise_at(0, 20 * t, 3) for t in result.time]
        assert result["road"] == pytest.approx(expected, abs=1e-5)
