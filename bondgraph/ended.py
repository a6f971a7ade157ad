"""Checkpoint of a run, from which another run goes on; and its form in a file with the numbers of the result."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import UsageError

if TYPE_CHECKING:
    from .left_out import LeftOut
    from .results import Result

SCHEMA = "bondgraph-run/1"
RUN, PAST, STARTS, STOPS = "the run", "past of delayed signals", "starts of that past", "stops of that past"
LARGEST = 4_000_000_000  # most bytes of a file that is read


@dataclass(frozen=True, slots=True, eq=False)
class Past:
    """History of delayed signals: on each [start, stop], a polynomial per signal."""

    names: tuple[str, ...]
    starts: list[float]
    stops: list[float]
    pieces: list[Any]  # (degree + 1, signals)
    cuts: list[float]  # instants at which a delayed signal will jump
    first: Any  # values before the run
    last: Any


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """Checkpoint at the end of a run, by the author's names, in SI.

    `identity`: that of the equations; `until`: planned end of the run, up to which `magnitudes` are valid.
    """

    identity: str
    parameters: Mapping[str, float]
    time: float
    until: float
    stored: Mapping[str, float]  # states and storages that depend on them
    peaks: Mapping[str, float]  # their largest values so far
    unknowns: Mapping[str, float]  # unknowns of algebraic loops
    magnitudes: Mapping[str, float]
    modes: Mapping[str, float]  # discrete variables that only events change
    on: tuple[tuple[str, int, bool], ...]  # instance and place of each event, and truth of its condition
    off: tuple[str, ...]  # junctions that are off
    preferences: tuple[tuple[str, str], ...]  # storage -> integral or derivative
    past: Past | None = None


def arrays_of(result: Result) -> dict[str, Any]:
    """Return the contents of a result's file besides its columns."""
    import numpy as np

    told: dict[str, Any] = {
        "schema": SCHEMA,
        "model": result.model,
        "experiment": result.experiment,
        "stopped": result.stopped,
    }
    told |= {
        "columns": [[c.name, c.unit] for c in result.columns],
        "report": [[r.name, r.unit, r.scale, r.offset] for r in result.report],
    }
    told |= {
        "solver": result.solver,
        "steps": result.steps,
        "evaluations": dict(result.evaluations),
        "rtol": result.rtol,
    }
    told |= {
        "notes": list(result.notes),
        "warnings": [asdict(w) for w in result.warnings],
        "events": [asdict(e) for e in result.events],
    }
    told["bandwidth"] = None if result.left_out is None else result.left_out.to_json()
    told["energy"] = None if result.energy is None else asdict(result.energy)
    arrays: dict[str, Any] = {}
    end = result.end
    told["end"] = None if end is None else {f.name: getattr(end, f.name) for f in fields(end) if f.name != "past"}
    if end is not None and end.past is not None:
        past = end.past
        told["past"] = {
            "names": past.names,
            "cuts": past.cuts,
            "first": list(map(float, past.first)),
            "last": list(map(float, past.last)),
        }
        arrays |= {PAST: np.array(past.pieces), STARTS: np.array(past.starts), STOPS: np.array(past.stops)}
    return {RUN: np.array(json.dumps(told)), **arrays}


def read(path: str | Path) -> Result:
    """Return a result from its file. Raises OSError, and `UsageError` if the file is not valid."""
    import numpy as np

    path = Path(path)
    if path.stat().st_size > LARGEST:
        raise UsageError(f"{path} is larger than a result can be")
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        told = json.loads(str(arrays[RUN].item()))
        if told["schema"] != SCHEMA:
            raise UsageError(f"{path} was written by another version of bondgraph ({told['schema']})")
        return _result(told, arrays)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, EOFError, zipfile.BadZipFile) as problem:
        raise UsageError(
            f"{path} is no result of a run, as `--out R.npz` writes it ({type(problem).__name__})"
        ) from None


def _result(told: Mapping[str, Any], arrays: Mapping[str, Any]) -> Result:
    import numpy as np

    from .results import Column, ElementEnergy, EnergyBalance, LimitLeft, Occurrence, Result, Shown, ToleranceDoubt

    columns = tuple(Column(name, unit) for name, unit in told["columns"])
    time = np.array(arrays["time"], dtype=float)
    values = np.array([arrays[c.name] for c in columns], dtype=float).reshape(len(columns), len(time)).T
    energy = told["energy"]
    if energy is not None:
        energy = EnergyBalance(**energy | {"elements": tuple(ElementEnergy(**e) for e in energy["elements"])})
    warnings = tuple(
        (LimitLeft if w["place"] else ToleranceDoubt)(**w | {"values": tuple(map(tuple, w["values"]))})
        for w in told["warnings"]
    )
    return Result(
        told["model"], told["experiment"], time, columns, values, tuple(Shown(*r) for r in told["report"]), told["solver"],
        told["steps"], told["evaluations"], told["rtol"], energy=energy, warnings=warnings, notes=tuple(told["notes"]),
        events=tuple(Occurrence(**e) for e in told["events"]), stopped=told["stopped"], end=_end(told, arrays), left_out=_left_out(told.get("bandwidth")),
    )  # fmt: skip


def _left_out(told: Mapping[str, Any] | None) -> LeftOut | None:
    from .left_out import read_left_out

    return None if told is None else read_left_out(told)


def _end(told: Mapping[str, Any], arrays: Mapping[str, Any]) -> End | None:
    import numpy as np

    end = told["end"]
    if end is None:
        return None
    past = None
    if "past" in told:
        kept = told["past"]
        past = Past(
            tuple(kept["names"]), list(map(float, arrays[STARTS])), list(map(float, arrays[STOPS])), list(arrays[PAST]),
            kept["cuts"], np.array(kept["first"], dtype=float), np.array(kept["last"], dtype=float),
        )  # fmt: skip
    pairs = {name: tuple(map(tuple, end[name])) for name in ("on", "preferences")}
    return End(**end | pairs | {"off": tuple(end["off"]), "past": past})
