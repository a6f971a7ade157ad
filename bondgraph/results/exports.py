"""Export of numbers with units: CSV, npz, NetCDF, MAT files, and xarray. In SI; each file is written completely or not at all."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compiler.api import Array

from ..errors import MissingPackage, UsageError
from ..files import replacing

if TYPE_CHECKING:
    import pandas
    import xarray

ENDINGS = (".csv", ".npz", ".nc", ".mat")
ROWS_AT_ONCE = 10_000  # CSV rows turned into text at a time
LONGEST = 63  # most letters of a name in MATLAB


@dataclass(frozen=True, eq=False)
class Arrays:
    """Data of an export.

    `coordinates`: values (n,) and unit by the name of a dimension; `variables`: by name the dimensions, an array over them, and the unit; `attributes`
    of the whole. A dimension without coordinates is numbered from 0.
    """

    coordinates: Mapping[str, tuple[Array, str]]
    variables: Mapping[str, tuple[tuple[str, ...], Array, str]]
    attributes: Mapping[str, str | int | float | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        clash = sorted(set(self.coordinates) & set(self.variables))
        if clash:  # an output may be called `time`
            renamed = {f"{n} (output)" if n in clash else n: v for n, v in self.variables.items()}
            object.__setattr__(self, "variables", renamed)


class Exported:
    """Result with named arrays."""

    __slots__ = ()

    def _arrays(self) -> Arrays:
        raise NotImplementedError

    def to_xarray(self) -> xarray.Dataset:
        """Return the arrays with their coordinates and `units`, in SI and Hz. Raises `MissingPackage` without xarray."""
        return dataset(self._arrays())

    def to_pandas(self) -> pandas.DataFrame:
        """Return the arrays as columns over their coordinates, in SI and Hz. Raises `MissingPackage` without xarray, which needs pandas."""
        return self.to_xarray().to_dataframe()

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the arrays into a .csv (of one dimension), .npz, .nc (NetCDF) or .mat (MATLAB) file; completely or not at all. Raises OSError, UsageError."""
        write_arrays(path, self._arrays())


def dataset(arrays: Arrays) -> Any:
    """Return an `xarray.Dataset`; each variable has its `units`. Raises `MissingPackage` without xarray."""
    try:
        import xarray
    except ImportError as error:
        raise MissingPackage("BR901", "this needs xarray:", 'pip install "bondgraph-lang[xarray]"') from error
    coordinates = {n: ((n,), v, {"units": unit}) for n, (v, unit) in arrays.coordinates.items()}
    variables = {n: (dims, v, {"units": unit}) for n, (dims, v, unit) in arrays.variables.items()}
    return xarray.Dataset(variables, coordinates, _attributes(arrays))


def write_arrays(path: str | os.PathLike[str], arrays: Arrays) -> None:
    """Write a file with one of `ENDINGS`; CSV for a single dimension only. Raises `UsageError`, OSError."""
    match Path(path).suffix.lower():
        case ".csv":
            if len({d for dims, _, _ in arrays.variables.values() for d in dims}) > 1:
                raise UsageError(
                    "BR903", "a CSV file has one dimension;", f"write `{path}` as {', '.join(ENDINGS[1:])}"
                )
            everything = dict(arrays.coordinates) | {n: (v, u) for n, (_, v, u) in arrays.variables.items()}
            write_csv(path, {n: v for n, (v, _) in everything.items()}, {n: u for n, (_, u) in everything.items()})
        case ".npz":
            write_npz(path, _plain(arrays))
        case ".nc":
            _netcdf(path, arrays)
        case ".mat":
            _matlab(path, arrays)
        case _:
            raise UsageError(
                "BR902", f"a table is written to a file that ends in {', '.join(ENDINGS)}, not to `{path}`"
            )


def write_columns(
    path: str | os.PathLike[str], columns: Mapping[str, Array], units: Mapping[str, str], along: str,
    attributes: Mapping[str, str | int | float | None],
) -> None:  # fmt: skip
    """Write columns of one length; `along` is the name of their common dimension. Raises as `write_arrays`."""
    write_arrays(path, Arrays({}, {n: ((along,), v, units[n]) for n, v in columns.items()}, attributes))


def write_csv(path: str | os.PathLike[str], columns: Mapping[str, Array], units: Mapping[str, str]) -> None:
    """Write CSV with 17 significant digits; a heading with a comma or a quote is quoted."""
    heads = ['"' + f"{n} [{units[n]}]".replace('"', '""') + '"' for n in columns]
    write_rows(path, heads, list(columns.values()))


def write_rows(path: str | os.PathLike[str], heads: Sequence[str], columns: Sequence[Array]) -> None:
    """Write CSV from headings, quoted where necessary, and columns of one length: numbers with 17 significant digits, or texts."""
    row = ",".join('"%s"' if column.dtype.kind == "U" else "%.17g" for column in columns) + "\n"
    with replacing(path) as stream:
        stream.write((",".join(heads) + "\n").encode("utf-8"))
        for first in range(0, len(columns[0]) if columns else 0, ROWS_AT_ONCE):
            rows = zip(*(column[first : first + ROWS_AT_ONCE].tolist() for column in columns), strict=True)
            stream.write("".join(row % cells for cells in rows).encode("utf-8"))


def write_npz(path: str | os.PathLike[str], arrays: Mapping[str, Any]) -> None:
    """Write arrays for `numpy.load`; equal arrays give equal bytes."""
    import zipfile

    import numpy as np

    # numpy.savez takes names as keywords: an output called `file` would be its own argument; and it stamps the time
    with replacing(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)


def _plain(arrays: Arrays) -> dict[str, Any]:
    import numpy as np

    found: dict[str, Any] = {n: v for n, (v, _) in arrays.coordinates.items()}
    found |= {n: v for n, (_, v, _) in arrays.variables.items()}
    units = {n: u for n, (_, u) in arrays.coordinates.items()} | {n: u for n, (_, _, u) in arrays.variables.items()}
    return {**found, **{f"unit of {n}": np.array(u) for n, u in units.items()}}


def _attributes(arrays: Arrays) -> dict[str, Any]:
    return {n: v for n, v in arrays.attributes.items() if v is not None}


def _netcdf(path: str | os.PathLike[str], arrays: Arrays) -> None:
    """Write NetCDF 3 with 64-bit offsets, which all readers support; by scipy."""
    from scipy.io import netcdf_file

    buffer = io.BytesIO()
    file = netcdf_file(buffer, "w", version=2)
    sizes = {n: len(v) for n, (v, _) in arrays.coordinates.items()}
    for dims, values, _ in arrays.variables.values():
        sizes |= dict(zip(dims, values.shape, strict=True))
    for name, size in sizes.items():
        file.createDimension(_netcdf_name(name), size)
    for name, value in _attributes(arrays).items():
        setattr(file, re.sub(r"\W", "_", name), value)
    variables = {n: ((n,), v, u) for n, (v, u) in arrays.coordinates.items()} | dict(arrays.variables)
    for name, (dims, values, unit) in variables.items():
        made = file.createVariable(_netcdf_name(name), "d", tuple(map(_netcdf_name, dims)))
        made[...] = values
        made.units = unit
    file.flush()
    content = buffer.getvalue()
    with replacing(path) as stream:
        stream.write(content)


def _netcdf_name(name: str) -> str:
    return name.replace("/", "|")


def _matlab(path: str | os.PathLike[str], arrays: Arrays) -> None:
    """Write a .mat file with names that MATLAB accepts; `names` and `units` are structures from these to the author's."""
    from scipy.io import savemat

    told = {n: (v, u) for n, (v, u) in arrays.coordinates.items()} | {
        n: (v, u) for n, (_, v, u) in arrays.variables.items()
    }
    made: dict[str, Any] = {}
    names: dict[str, str] = {}
    for name, (values, _) in told.items():
        plain = _matlab_name(name, {*made, "names", "units", "attributes"})
        made[plain], names[plain] = values, name
    made["names"], made["units"] = names, {plain: told[name][1] for plain, name in names.items()}
    made["attributes"] = {_matlab_name(n, set()): v for n, v in _attributes(arrays).items()} or {"none": ""}
    buffer = io.BytesIO()
    savemat(buffer, made, long_field_names=True, oned_as="column")
    with replacing(path) as stream:
        stream.write(buffer.getvalue())


def _matlab_name(name: str, taken: set[str]) -> str:
    """Return a name of letters, digits and underscores, beginning with a letter; `d[1]` is `d_1`."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "x"
    plain = plain if plain[0].isalpha() else f"x_{plain}"
    found, number = plain[:LONGEST], 1
    while found in taken:
        number += 1
        found = f"{plain[: LONGEST - 6]}_{number}"
    return found
