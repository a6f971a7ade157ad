"""Runs as data for a page: reported outputs, and effort and flow of every bond and the poses of all bodies.

Plots get every instant in double precision. Data shown along a run get some hundred instants in single precision.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from compiler.api import Array, BondGraph, Compilation, Scene, letters

from ...analysed_model import AnalysedModel
from ...results.result import Result
from ..text.tables import short, visible
from .bonds import BondColumns, bond_columns, powers
from .numbers import packed, thinned
from .scene import Scenes, scenes_of

OUTPUTS = 24  # most curves of one run
POINTS = 2001  # most instants of a plot
COARSE = 0.03  # largest difference of energies by every second instant, relative to the largest
ROUNDING = 1e-6  # of what went to and fro
BETWEEN = 20  # most steps of the solver for an instant: else equal phases of a period may be all that is seen


@dataclass(frozen=True)
class PageModel:
    """A model with the data that a page needs of every run."""

    model: AnalysedModel

    @cached_property
    def graph(self) -> BondGraph:
        """Graph of the whole text, as the diagram shows it."""
        return self._compilation.causal.graph

    @property
    def _compilation(self) -> Compilation:
        return self.model.compilation(Scene(self.model.model, None, free=frozenset({"*"})))

    @cached_property
    def bonds(self) -> BondColumns:
        return bond_columns(self.graph, self._compilation.whole_graph)

    @cached_property
    def scenes(self) -> Scenes:
        return scenes_of(self.graph)

    @cached_property
    def powers(self) -> tuple[tuple[str, str, tuple[tuple[int, float], ...]], ...]:
        return tuple(powers(self.graph))

    def outputs(self, experiment: str | None) -> tuple[str, ...]:
        """Return the plotted names: those that the experiment reports, else the outputs of the model."""
        compilation = self.model.compilation(self.model.scene(experiment))
        return tuple(compilation.whole_graph.outputs)[:OUTPUTS]

    def names(self, experiment: str | None) -> tuple[str, ...]:
        """Return the names that a run must report."""
        return tuple(dict.fromkeys([*self.outputs(experiment), *self.bonds.names, *self.scenes.names]))

    def simulate(
        self, experiment: str | None, settings: Mapping[str, str | float] | None = None, energy: bool = False, error: bool = False
    ) -> Result:  # fmt: skip
        """Run an experiment. Raises as `Model.simulate`."""
        from ...simulation.repetition import simulate
        from ...simulation.run_options import RunOptions, RunRequest

        options = RunOptions(energy=energy, error=error)
        return simulate(self.model, RunRequest(experiment, settings or {}, self.names(experiment), options))


def run_data(watched: PageModel, experiment: str | None, result: Result) -> dict[str, Any]:
    outputs = set(watched.outputs(experiment))
    shown = [(item, values) for item, values in result.shown() if item.name in outputs]
    plotted = thinned(len(result.time), POINTS)
    return {
        "time": packed(result.time[plotted], single=False),
        "outputs": [{"name": short(i.name), "unit": "" if i.unit == "1" else visible(i.unit)} for i, _ in shown],
        "values": packed([v[plotted] for _, v in shown], single=False),
        "along": _along(watched, result),
        "steps": int(result.steps),
        "events": [float(e.time) for e in result.events[:200]],
        "notes": [visible(str(n)) for n in (*result.warnings, *result.notes)][:40],
    }  # fmt: skip


def _along(watched: PageModel, result: Result) -> dict[str, Any]:
    """Return the data of diagram and mechanisms at a selection of instants."""
    kept = thinned(len(result.time))
    columns = watched.bonds.values(result.to_numpy(), len(result.time))
    return {
        "time": packed(result.time[kept], single=False),
        "bonds": packed(columns[:, kept]),
        "poses": packed([result[name][kept] for name in watched.scenes.names], single=False),
        "energy": packed(shown_energies(watched, result, columns)[:, kept]),
    }


def shown_energies(watched: PageModel, result: Result, columns: Array) -> Array:
    """Return the energies of a run; NaN, which is not shown, where its instants are too few for the trapezoidal rule."""
    import numpy as np

    fine, coarse = (_integrals(watched, result.time[::n], columns[:, ::n]) for n in (1, 2))
    apart = np.abs(coarse[:3, -1] - fine[:3, ::2][:, -1]).max()
    least = COARSE * np.abs(fine[:3]).max() + ROUNDING * fine[3, -1]
    between = result.steps > BETWEEN * len(result.time)
    return np.full_like(fine[:3], np.nan) if between or apart > least else fine[:3]


def energies(watched: PageModel, time: Array, columns: Array) -> Array:
    """Return supplied, dissipated and stored energy since the start of a run, shape (3, instants), in J: powers by the trapezoidal rule."""
    return _integrals(watched, time, columns)[:3]


def _integrals(watched: PageModel, time: Array, columns: Array) -> Array:
    """Return the energies, and what went to and fro in all."""
    import numpy as np

    sums = np.zeros((4, len(time)))
    for _, kind, around in watched.powers:
        into = power_into(watched, columns, around)
        if into is not None:
            supplied, lost = kind in letters("source"), kind in letters("loss")
            place, sign = (0, -1.0) if supplied else (1 if lost else 2, 1.0)
            if kind not in letters("transducer"):
                sums[place] += sign * into
            sums[3] += np.abs(into)
    steps = np.diff(time) * (sums[:, 1:] + sums[:, :-1]) / 2
    return np.concatenate([np.zeros((4, 1)), np.cumsum(steps, axis=1)], axis=1)


def power_into(watched: PageModel, columns: Array, around: Sequence[tuple[int, float]]) -> Any:
    """Return the power that some bonds bring; None where one of them is not known."""
    total: Any = 0.0
    for bond, sign in around:
        effort, flow = watched.bonds.places[bond]
        if effort is None or flow is None:
            return None
        total = total + sign * columns[effort] * columns[flow]
    return total
