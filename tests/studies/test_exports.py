"""Exports equal the computed results: NetCDF, MAT, npz and CSV read back by other readers, with units and names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph import UsageError
from bondgraph.results.exports import Arrays, write_arrays
from bondgraph.studies.workers import Workers

TEXT = """
model Two {
  parameter k: N/m = 100, m = 1 kg
  for i in 1..2 {
    1 body[i]
    I mass[i] : p = m*v
    C spring[i] : F = i*k*x { start x = 1 mm }
    body[i] -> mass[i], spring[i]
  }
  output x = spring[1].x, v = mass[2].v
}
"""


@pytest.fixture(scope="module")
def model() -> Any:
    return bondgraph.load(TEXT)


def test_a_run(model: Any, tmp_path: Path) -> None:
    from scipy.io import loadmat, netcdf_file

    run = model.simulate(None, to=0.1, points=11, outputs=("x", "mass[2].v"), target="numpy")
    for ending in ("csv", "npz", "nc", "mat"):
        run.write(tmp_path / f"r.{ending}")
    with netcdf_file(tmp_path / "r.nc", mmap=False) as file:
        np.testing.assert_array_equal(file.variables["mass[2].v"][:], run["mass[2].v"])
        assert (
            file.variables["x"].units == b"m"
            and file.variables["time"].units == b"s"
            and file.variables["x"].dimensions == ("time",)
        )
        assert file.model == b"Two"
    read = loadmat(tmp_path / "r.mat", simplify_cells=True)
    np.testing.assert_array_equal(read["mass_2_v"], run["mass[2].v"])
    assert read["names"]["mass_2_v"] == "mass[2].v" and read["units"]["mass_2_v"] == "m/s" and len(read["time"]) == 11
    np.testing.assert_array_equal(np.load(tmp_path / "r.npz")["x"], run["x"])
    assert bondgraph.read_result(tmp_path / "r.npz").final("x") == run.final("x")
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)[:, 1], run["x"])
    with pytest.raises(UsageError, match=r"ends in .csv, .npz, .nc, .mat"):
        run.write(tmp_path / "r.txt")


def test_xarray(model: Any, tmp_path: Path) -> None:
    """Grids have the swept names as dimensions; the file equals the returned object."""
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    run = model.simulate(None, to=0.1, points=11, target="numpy").to_xarray()
    assert (
        run.x.dims == ("time",)
        and run.x.units == "m"
        and float(run.x.sel(time=0.05)) == pytest.approx(1e-3 * np.cos(0.5), rel=1e-4)
    )
    sweep = model.sweep({"k": "50 N/m .. 150 N/m : 3", "m": [1.0, 4.0]}, of=("modes", "simulate"), to=0.1, points=5)
    data = sweep.to_xarray()
    assert data["frequency 1"].dims == ("k", "m") and data.x.dims == ("k", "m", "time") and data.k.units == "N/m"
    assert float(data["frequency 1"].sel(k=150, m=4)) == pytest.approx(np.sqrt(150 / 4) / (2 * np.pi), rel=1e-12)
    np.testing.assert_allclose(data.x.sel(k=50, m=1), 1e-3 * np.cos(np.sqrt(50) * data.time), rtol=1e-5, atol=1e-9)
    sweep.write(tmp_path / "s.nc")
    with xarray.open_dataset(tmp_path / "s.nc", engine="scipy") as again:
        xarray.testing.assert_identical(again.drop_attrs(), data.drop_attrs())
        assert again["frequency 1"].units == "Hz"
    together = model.sweep({"k": [1.0, 2.0], "m": [1.0, 4.0]}, of="modes", together=True).to_xarray()
    assert together["frequency 1"].dims == ("point",) and together.k.dims == ("point",)
    many = model.simulate_many([{"k": 50.0}, {"k": "1 kg"}, {"k": 100.0}], None, 0.1, 5, workers=1).to_xarray()
    assert many.x.dims == ("run", "time") and "set k" not in many and np.isnan(many.x[1]).all()
    study = model.montecarlo({"k": "uniform(50 N/m, 150 N/m)"}, samples=8, indices=0, workers=Workers(1))
    data = study.to_xarray()
    assert data.attrs["distribution of k"] == "uniform(50, 150)" and data["frequency 1"].dims == ("point",)
    study.write(tmp_path / "m.nc")
    with xarray.open_dataset(tmp_path / "m.nc", engine="scipy") as again:
        np.testing.assert_array_equal(again["frequency 1"], study("frequency 1"))


def test_names_that_files_do_not_take(tmp_path: Path) -> None:
    from scipy.io import loadmat

    one = np.array([1.0, 2.0])
    names = ["d[1]", "d.1", "d 1", "1x", "names", "é", "a" * 80, "a" * 80 + "b"]
    arrays = Arrays({"time": (one, "s")}, {n: (("time",), one + i, "m") for i, n in enumerate([*names, "time"])})
    write_arrays(tmp_path / "n.mat", arrays)
    read = loadmat(tmp_path / "n.mat", simplify_cells=True)
    back = {name: read[plain] for plain, name in read["names"].items()}
    assert {n: v[0] for n, v in back.items()} == {n: 1.0 + i for i, n in enumerate([*names, "time (output)"])} | {
        "time": 1.0
    }
    write_arrays(tmp_path / "n.nc", Arrays({}, {"a/b": (("row",), one, "1")}, {"what is it": "a table", "none": None}))
    square = Arrays({}, {"a": (("row", "column"), np.eye(2), "1")})
    with pytest.raises(UsageError, match="one dimension"):
        write_arrays(tmp_path / "n.csv", square)
    write_arrays(tmp_path / "n.npz", square)
    np.testing.assert_array_equal(np.load(tmp_path / "n.npz")["a"], np.eye(2))
