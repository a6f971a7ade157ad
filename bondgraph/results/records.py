"""Records of a result: columns, energies, violated limits, events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .json_values import entries, finite


@dataclass(frozen=True, slots=True)
class Column:
    """A recorded quantity: the author's name and the SI unit of its values, as `N*m`; "1" for a bare number."""

    name: str
    unit: str


@dataclass(frozen=True, slots=True)
class Extremes:
    """Least and greatest value of an output in a run, in SI, each with the first instant in s at which it was found.

    NaN where a value is no number, infinite where an output that was searched has a pole.
    """

    minimum: float
    minimum_at: float
    maximum: float
    maximum_at: float


def widest(parts: Sequence[Extremes]) -> Extremes:
    """Return the extremes over successive parts of a run; a value that is no number outlasts all others."""
    low = min(parts, key=lambda e: -math.inf if math.isnan(e.minimum) else e.minimum)
    high = max(parts, key=lambda e: math.inf if math.isnan(e.maximum) else e.maximum)
    return Extremes(low.minimum, low.minimum_at, high.maximum, high.maximum_at)


@dataclass(frozen=True, slots=True)
class ElementEnergy:
    """Energy of one element in a run, in J: change of its stored energy, supplied as a source, dissipated.

    `residual`: work of its bonds that none of the three explains: the error of the run, or a law that creates energy.
    """

    name: str
    kind: str
    stored: float
    supplied: float
    dissipated: float
    residual: float = 0.0


@dataclass(frozen=True, slots=True)
class EnergyBalance:
    """Energy balance of a run, in J: each element, the sums, and `residual = supplied - stored - dissipated`."""

    elements: tuple[ElementEnergy, ...]
    stored: float
    supplied: float
    dissipated: float
    residual: float

    def to_json(self) -> dict[str, Any]:
        """Return JSON values, a part of `bondgraph-result/1`."""
        sums = ("stored", "supplied", "dissipated", "residual")
        return {
            "unit": "J",
            **entries(self, *sums),
            "elements": {e.name: entries(e, "kind", *sums) for e in self.elements},
        }


@dataclass(frozen=True, slots=True)
class LimitLeft:
    """Violation of a limit that a model requires: the first instant, and the values there in SI.

    `owner` is the instance ("" for the model itself), `place` the line of the limit, `stands` that of the instance.
    """

    time: float
    owner: str
    condition: str
    text: str
    values: tuple[tuple[str, float, str], ...]  # name, value, unit
    place: str
    stands: str = ""

    def __str__(self) -> str:
        return f"from t = {self.time:.9g} s {self.words_at_rest}"

    @property
    def words_at_rest(self) -> str:
        """Message without the instant."""
        who = f"`{self.owner}` ({self.stands})" if self.owner else "the model"
        shown = ", ".join(f"{name} = {value:.6g}{f' {unit}' * (unit != '1')}" for name, value, unit in self.values)
        about = f" ({self.text})" if self.text else ""
        where = f"{who} is outside of `{self.condition}`{about}, {self.place}"
        return f"{where}: {shown}" if shown else where

    def to_json(self) -> dict[str, Any]:
        """Return JSON values, a part of `bondgraph-result/1`."""
        values = {name: {"value": finite(value), "unit": unit} for name, value, unit in self.values}
        return {**entries(self, "time", "owner", "condition", "text", "place"), "values": values}


@dataclass(frozen=True, slots=True)
class ToleranceDoubt(LimitLeft):
    """A tolerance of a run that may not be meaningful; `text` gives the reason, `time` since when. The other fields have no meaning."""

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class EventRecord:
    """Record of an event in a run: its time, its condition as written, the instance ("" for the model itself), its line."""

    time: float
    condition: str
    owner: str
    place: str
    stops: bool = False  # True for the `stop when` at which the run ended

    def __str__(self) -> str:
        who = f" of `{self.owner}`" if self.owner else ""
        return f"t = {self.time:.9g} s: {'stop ' * self.stops}when {self.condition}{who}, {self.place}"
