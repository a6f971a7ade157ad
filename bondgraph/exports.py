"""Tables of numbers with units, written to files that others read: CSV, npz, NetCDF, MAT. Each is written whole or not at all, in SI."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import UsageError
from .files import replacing, write_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

ENDINGS = (".csv", ".npz", ".nc", ".mat")


def write_columns(
    path: str | os.PathLike[str], columns: Mapping[str, Array], units: Mapping[str, str], along: str,
    attributes: Mapping[str, str | int | float | None],
) -> None:  # fmt: skip
    """Columns of one length; `along` names what they are numbered by. Raises `UsageError` for another ending, OSError, `MissingPackage`."""
    match Path(path).suffix.lower():
        case ".csv":
            write_csv(path, columns, units)
        case ".npz":
            write_npz(path, {**columns, **{f"unit of {n}": _text(units[n]) for n in columns}})
        case _:
            raise UsageError(f"a table is written to a file that ends in {', '.join(ENDINGS)}, not to `{path}`")


def write_csv(path: str | os.PathLike[str], columns: Mapping[str, Array], units: Mapping[str, str]) -> None:
    """17 significant digits; a heading with a comma or a quote stands in quotes."""
    import numpy as np

    heads = ['"' + f"{n} [{units[n]}]".replace('"', '""') + '"' for n in columns]
    table = np.column_stack(list(columns.values())) if columns else np.zeros((0, 0))
    row = ",".join(["%.17g"] * len(columns))
    write_text(path, "\n".join([",".join(heads), *(row % tuple(line) for line in table.tolist())]) + "\n")


def write_npz(path: str | os.PathLike[str], arrays: Mapping[str, Any]) -> None:
    """Arrays for `numpy.load`; equal ones give equal bytes."""
    import zipfile

    import numpy as np

    # numpy.savez takes names as keywords: an output called `file` would be its own argument; and it stamps the time
    with replacing(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)


def _text(unit: str) -> Any:
    import numpy as np

    return np.array(unit)
