"""Result of a run from a file of `Result.to_npz`."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from compiler.api import Reported

from ..errors import UsageError
from .checkpoint import read_checkpoint
from .records import Column, ElementEnergy, EnergyBalance, EventRecord, Extremes, LimitLeft, ToleranceDoubt
from .result import ARCHIVE, RUN, Result
from .truncation import read_truncation

LARGEST = 4_000_000_000  # most bytes of a file that is read


def read_result(path: str | os.PathLike[str]) -> Result:
    """Return a result from a file of `to_npz`. Raises OSError, and `UsageError` if the file is not valid."""
    path = Path(path)
    if path.stat().st_size > LARGEST:
        raise UsageError("BR907", f"{path} is larger than a result can be")
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        told = json.loads(str(arrays[RUN].item()))
        if told["schema"] != ARCHIVE:
            raise UsageError(
                "BR908", f"{path} was written by another version of bondgraph ({told['schema']});", "run it again with this version",
            )  # fmt: skip
        return _result(told, arrays)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, EOFError, zipfile.BadZipFile):
        raise UsageError(
            "BR909",
            f"{path} is no result of a run, as `--out R.npz` writes it;",
            "of a model `bondgraph run FILE` makes one",
        ) from None


def _result(told: Mapping[str, Any], arrays: Mapping[str, Any]) -> Result:
    columns = tuple(Column(name, unit) for name, unit in told["columns"])
    time = np.array(arrays["time"], dtype=float)
    values = np.array([arrays[c.name] for c in columns], dtype=float).reshape(len(columns), len(time)).T
    energy, truncation = told["energy"], told.get("bandwidth")
    if energy is not None:
        energy = EnergyBalance(**energy | {"elements": tuple(ElementEnergy(**e) for e in energy["elements"])})
    warnings = tuple(
        (LimitLeft if w["place"] else ToleranceDoubt)(**w | {"values": tuple(map(tuple, w["values"]))})
        for w in told["warnings"]
    )
    return Result(
        told["model"], told["experiment"], time, columns, values, tuple(Reported(*r) for r in told["report"]), told["solver"],
        told["steps"], told["evaluations"], told["rtol"], energy=energy, warnings=warnings, notes=tuple(told["notes"]),
        events=tuple(EventRecord(**e) for e in told["events"]), stopped=told["stopped"], checkpoint=read_checkpoint(told, arrays),
        truncation=None if truncation is None else read_truncation(truncation),
        searched=tuple(Extremes(**e) for e in told.get("extremes", ())),
    )  # fmt: skip
