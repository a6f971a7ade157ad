"""Runs as data for a page: what an experiment reports, and besides it effort and flow of every bond and the poses of all bodies.

Plots get every instant in double precision. What is shown along a run gets some hundred instants in single precision.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..door import CompilationFailed, Scene
from ..views.tables import short, visible
from .bonds import BondColumns, bond_columns, powers
from .numbers import packed, thinned
from .scene import Scenes, scenes_of

if TYPE_CHECKING:
    from ..door import BondGraph
    from ..model import Model
    from ..results import Result

OUTPUTS = 24  # curves of one run
POINTS = 2001  # instants of a plot


@dataclass(frozen=True)
class Watched:
    """What a page looks at in every run of a model."""

    model: Model

    @cached_property
    def graph(self) -> BondGraph:
        """Everything that the text says, as the diagram shows it."""
        return self.model.compilation(Scene(self.model.model, None, free=frozenset({"*"}))).causal.graph

    @cached_property
    def bonds(self) -> BondColumns:
        return bond_columns(self.graph)

    @cached_property
    def scenes(self) -> Scenes:
        return scenes_of(self.graph)

    @cached_property
    def powers(self) -> tuple[tuple[str, str, tuple[tuple[int, float], ...]], ...]:
        return tuple(powers(self.graph))

    def outputs(self, experiment: str | None) -> tuple[str, ...]:
        """What is plotted: what the experiment reports, else the outputs of the model."""
        compilation = self.model.compilation(self.model.scene(experiment))
        return tuple(compilation.whole_graph.outputs)[:OUTPUTS]

    def names(self, experiment: str | None) -> tuple[str, ...]:
        """What a run must report."""
        return tuple(dict.fromkeys([*self.outputs(experiment), *self.bonds.names, *self.scenes.names]))

    def simulate(
        self, experiment: str | None, settings: Mapping[str, str | float] | None = None, energy: bool = False
    ) -> Result:
        """A run of an experiment. Raises as `Model.simulate`."""
        return self.model.simulate(experiment, settings, outputs=self.names(experiment), energy=energy)


def run_data(watched: Watched, experiment: str | None, result: Result) -> dict[str, Any]:
    """A run as data."""
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


def _along(watched: Watched, result: Result) -> dict[str, Any]:
    """What the diagram and the mechanisms show at each of some instants."""
    kept = thinned(len(result.time))
    columns = watched.bonds.values(result.to_numpy(), len(result.time))
    return {
        "time": packed(result.time[kept], single=False),
        "bonds": packed(columns[:, kept]),
        "poses": packed([result[name][kept] for name in watched.scenes.names], single=False),
        "energy": packed(energies(watched, result.time, columns)[:, kept]),
    }


def energies(watched: Watched, time: Any, columns: Any) -> Any:
    """Supplied, dissipated and stored energy from the start of a run on, shape (3, instants), in J: powers by the trapezoidal rule."""
    import numpy as np

    sums = np.zeros((3, len(time)))
    for _, kind, around in watched.powers:
        into = power_into(watched, columns, around)
        if into is not None:
            place, sign = {"Se": (0, -1.0), "Sf": (0, -1.0), "R": (1, 1.0)}.get(kind, (2, 1.0))
            if kind not in ("TF", "GY"):
                sums[place] += sign * into
    steps = np.diff(time) * (sums[:, 1:] + sums[:, :-1]) / 2
    return np.concatenate([np.zeros((3, 1)), np.cumsum(steps, axis=1)], axis=1)


def power_into(watched: Watched, columns: Any, around: Sequence[tuple[int, float]]) -> Any:
    """The power that some bonds bring; None where one of them is not known."""
    total: Any = 0.0
    for bond, sign in around:
        effort, flow = watched.bonds.places[bond]
        if effort is None or flow is None:
            return None
        total = total + sign * columns[effort] * columns[flow]
    return total


def problem_of(error: Exception) -> str:
    """What went wrong, in the author's words."""
    return str(error) if isinstance(error, CompilationFailed) else f"{error}"
