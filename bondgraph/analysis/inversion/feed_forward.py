"""Result of an inversion along a path: inputs over time, as numbers, as a table, as a model that can be run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunFailed, UsageError
from ...quantities import behind
from ...rendering import draw, text_of
from ..told import finite, pair
from .drives import Drive

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SCHEMA = "bondgraph-feed-forward/1"
NEAR = 1e-12  # relative to the largest of its unit: difference of a start that equals the model's own


@dataclass(frozen=True, eq=False)
class FeedForward:
    """The `inputs` with which `outputs` follow the path `wanted`, at `time` (N,), name -> (N,) in SI.

    `strengths`: of each input, or of each pair the signed value (`powers` 1) or square (2), which is smooth where the pair changes sides.
    `degrees`: number of derivatives of each output in the inverse. `internal`: eigenvalues (1/s) of the internal dynamics, empty if there are none.
    `start`: states in which it begins, where they differ from the model's own. `notes` name the jumps of inputs.
    """

    model: str
    experiment: str | None
    wanted: Mapping[str, str]
    settings: Mapping[str, float]
    time: Array
    inputs: Mapping[str, Array]
    outputs: Mapping[str, Array]
    states: Mapping[str, Array]
    strengths: Mapping[str, Array]
    drives: tuple[Drive, ...]
    degrees: Mapping[str, int]
    internal: tuple[complex, ...]
    start: Mapping[str, float]
    units: Mapping[str, str]
    notes: tuple[str, ...]
    file: Path | None = None
    plain: bool = False  # a model of bare numbers, without units

    def __getitem__(self, name: str) -> Array:
        """Return an input, output or state over time. Raises KeyError."""
        for values in (self.inputs, self.outputs, self.states):
            if name in values:
                return values[name]
        raise KeyError(f"there is no `{name}` here; there is {', '.join((*self.inputs, *self.outputs, *self.states))}")

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-feed-forward/1`, in SI.

        {schema, model, experiment, wanted, time, inputs, outputs: {name: {unit, values}}, degrees, internal: [{re, im}], start: {name: {value, unit}},
        notes}.
        """
        told: dict[str, Any] = {
            "schema": SCHEMA, "model": self.model, "experiment": self.experiment, "wanted": dict(self.wanted),
            "time": {"unit": "s", "values": self.time.tolist()},
        }  # fmt: skip
        for word in ("inputs", "outputs"):
            some: Mapping[str, Array] = getattr(self, word)
            told[word] = {n: {"unit": self.units.get(n, "1"), "values": v.tolist()} for n, v in some.items()}
        told |= {"degrees": dict(self.degrees), "internal": [pair(v) for v in self.internal]}
        start = {n: {"value": finite(v), "unit": self.units.get(n, "1")} for n, v in self.start.items()}
        return {**told, "start": start, "notes": list(self.notes)}

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write time, inputs and outputs, in SI, with the units in the header; the file is written completely or not at all."""
        columns = {**self.inputs, **self.outputs}
        heads = ["time [s]", *(_head(name, self.units.get(name, "1")) for name in columns)]
        _write_columns(path, heads, [self.time, *columns.values()])

    def to_model(self, path: str | os.PathLike[str]) -> None:
        """Write a model (.bg) of the plant with its controller, and the controller's table (.csv) beside it; both completely or not at all.

        Raises `UsageError` if the model has no file, or if the new one would lie outside its project folder.
        """
        from .writing import model_text, table_of

        target = Path(path)
        text = model_text(self, target)
        heads, columns = table_of(self)
        _write_columns(target.with_suffix(".csv"), heads, columns)
        from ...files import write_text

        write_text(target, text)

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Plot inputs and outputs over time (.png, .svg or .pdf)."""
        draw(self, path)

    def summary(self) -> str:
        """Return a table for terminals."""
        return text_of(self)


def _head(name: str, unit: str) -> str:
    text = name if unit == "1" else f"{name} [{unit}]"
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text


def _write_columns(path: str | os.PathLike[str], heads: Sequence[str], columns: Sequence[Any]) -> None:
    from ...files import write_text

    rows = [",".join(f"{x:.17g}" for x in row) for row in np.column_stack(columns).tolist()]
    write_text(path, "\n".join([", ".join(heads), *rows]) + "\n")


def within_limits(
    found: Mapping[str, Array], times: Array, limits: Mapping[str, float], units: Mapping[str, str]
) -> None:
    """Raise `RunFailed` where an input exceeds its limit."""
    for name, limit in limits.items():
        if name not in found:
            raise UsageError(f"`{name}` is none of the inputs that are looked for: {', '.join(found)}")
        size = np.abs(found[name])
        worst = int(size.argmax())
        if size[worst] > limit:
            unit = behind(units.get(name, "1"))
            raise RunFailed(
                f"the path needs {size[worst]:.6g}{unit} of `{name}` at t = {times[worst]:.6g} s; it may have {limit:.6g}{unit}"
            )
