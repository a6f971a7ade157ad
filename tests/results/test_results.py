"""Results by the author's names, in SI, to files and tables."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.results.records import Column
from bondgraph.results.result import Result
from compiler.api import Reported


def made(values: object = ((0.0, 1.0), (2.0, math.nan))) -> Result:
    columns = (Column("x", "m"), Column('a, "b"', "1"))
    return Result(
        "M",
        "e",
        np.array([0.0, 0.5]),
        columns,
        np.array(values),
        (Reported("x", "mm", 1e3),),
        "s",
        3,
        {"derivative": 7},
        1e-6,
        0.1,
    )


def test_names_units_and_values() -> None:
    result = made()
    assert result["x"].tolist() == [0.0, 2.0]
    assert (result.unit("x"), result.unit("time"), result.final("x")) == ("m", "s", 2.0)
    assert "x" in result
    with pytest.raises(KeyError, match="did you mean `x`"):
        result["xx"]
    with pytest.raises(KeyError, match=r"`report speed` in the experiment, or `outputs=\('speed',\)`"):
        result["speed"]


def test_csv_quotes_and_keeps_seventeen_digits(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    made(((0.1, 1 / 3), (1e-300, 2.0))).to_csv(path)
    lines = path.read_bytes().decode().split("\n")
    assert lines[0] == 'time [s],x [m],"a, ""b"" [1]"'
    assert [float(v) for v in lines[1].split(",")] == [0.0, 0.1, 1 / 3]
    assert lines[-1] == ""


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("before")
    broken = made()
    object.__setattr__(broken, "values", None)
    with pytest.raises(Exception):  # noqa: B017  whatever goes wrong
        broken.to_csv(path)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_json_has_null_for_what_is_not_finite() -> None:
    told = made().to_json()
    assert told["outputs"]['a, "b"']["final"] is None
    assert told["outputs"]["x"] == {
        "unit": "m",
        "final": 2.0,
        "minimum": 0.0,
        "minimum_at": 0.0,
        "maximum": 2.0,
        "maximum_at": 0.5,
    }


@pytest.mark.machine_code
def test_pandas_and_plot(tmp_path: Path) -> None:
    result = bondgraph.load("models/rlc.bg").simulate(points=11)
    table = result.to_pandas()
    assert table.index.name == "time"
    assert table.attrs["units"] == {"time": "s", "u": "V", "i": "A"}
    for ending in ("png", "svg"):
        path = tmp_path / f"r.{ending}"
        result.plot(path)
        assert path.stat().st_size > 5000


def test_summary_is_in_the_units_of_the_report() -> None:
    text = bondgraph.load("models/rlc.bg").simulate(points=11, energy=True).summary()
    assert "mA" in text
    assert "residual" in text
    assert "matrix exponential" in text


def test_sparks() -> None:
    """A ramp goes from the lowest bar to the highest, a pulse is at its place, NaN is blank, a constant is in the middle."""
    from bondgraph.presentation.text.tables import spark

    time = np.linspace(0.0, 2.0, 801)
    assert spark(time, time, 8) == "▁▂▃▄▅▆▇█"
    assert spark(time, np.where((time > 0.5) & (time < 1.0), 1.0, 0.0), 8) in ("▁▁██▁▁▁▁", "▁▁▇█▁▁▁▁", "▁▁█▇▁▁▁▁")
    assert spark(time, np.where(time < 1.0, np.nan, time), 4) == "  ▂▇"
    assert spark(time, 0 * time, 3) == "▅▅▅"
    assert spark(np.array([0.0, 1.9, 2.0]), np.array([1.0, 2.0, 3.0]), 4) == "▁▁▁▇"  # long steps hold what was
    result = bondgraph.load("models/rlc.bg").simulate(points=11)
    plain, barred = result.summary().splitlines(), result.summary(sparks=True).splitlines()
    assert plain[2] == "".join(barred[2].partition("over time")[0]).rstrip()
    assert [a.startswith(b) for a, b in zip(barred[3:], plain[3:], strict=True)] == [True] * len(plain[3:])
