"""Energy over time: supplied by sources, increase of the stored energy, dissipated in resistors.

The work of every port is integrated along with the run: the model is written flat with one more integral for each element, under the error
control of the run. A mechanism gets the rest of the balance: its motion, and gravity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import DOMAINS, Array, Element, MechanismNode, letters, write_text

from ..compiled_model import CompiledModel, source_of
from ..errors import UsageError
from ..rendering import OfModel, Plotted

POINTS = 501


@dataclass(frozen=True, eq=False)
class Energies(OfModel, Plotted):
    """Work of each element at `time` (N,), name -> (N,) in J, and its kind. Positive: supplied by sources, received by all others."""

    time: Array
    elements: Mapping[str, Array]
    kinds: Mapping[str, str]

    def sum_of(self, kinds: tuple[str, ...]) -> Array:
        """Return the sum over all elements of some kinds."""
        found = [v for n, v in self.elements.items() if self.kinds[n] in kinds]
        return np.sum(found, axis=0) if found else np.zeros_like(self.time)

    @property
    def supplied(self) -> Array:
        """Energy from sources."""
        return self.sum_of(letters("source"))

    @property
    def dissipated(self) -> Array:
        """Energy lost in resistors; one that passes its loss on as heat counts zero."""
        return self.sum_of(letters("loss"))

    @property
    def stored(self) -> Array:
        """Increase of the energy in storages since the start, without that of `motion`."""
        return self.sum_of(letters("storage"))

    @property
    def motion(self) -> Array:
        """Energy of mechanisms: supplied and neither stored nor dissipated; zero without a mechanism."""
        if "multibody" not in self.kinds.values():
            return np.zeros_like(self.time)
        return self.supplied - self.stored - self.dissipated


def energies(
    model: CompiledModel, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
    points: int | None = None, rtol: float | None = None,
) -> Energies:  # fmt: skip
    """Return the energies of a run of an experiment ("": the first, None: none), from t = 0. Raises as `Model.simulate`."""
    from ..simulation.repetition import simulate
    from ..simulation.run_options import RunOptions, RunRequest

    made = model.compilation(model.scene(experiment, settings))
    plan = made.plan
    if plan.sweeps or (plan.stop is None and to is None):
        raise UsageError("BR203", "energy over time is that of one simulation:", "name an experiment that makes one")
    flat = source_of(write_text(made.whole_graph))
    graph = CompiledModel(flat).compilation().whole_graph
    wanted = {
        n.name: n
        for n in graph.nodes
        if isinstance(n, Element) and n.kind.value in letters("source", "storage", "loss") and _power(n)
    }
    names = {name: f"work_of_element_{i}" for i, name in enumerate(wanted)}
    powered = CompiledModel(flat, extra_outputs={names[n]: f"integral({_power(e)}, 0)" for n, e in wanted.items()})
    start, stop = plan.start, plan.stop if to is None else to
    assert stop is not None
    if start or plan.equilibrium:
        raise UsageError("BR204", "energy over time is that of a run from t = 0 and the model's own start")
    wanted_run = RunOptions(
        stop, points or int(plan.settings.get("points", POINTS)), rtol if rtol is not None else 1e-8
    )
    run = simulate(powered, RunRequest(None, {}, tuple(names.values()) or None, wanted_run))
    found = {n: run[o] * (-1.0 if _into_source(graph, wanted[n]) else 1.0) for n, o in names.items()}
    kinds = {n: e.kind.value for n, e in wanted.items()}
    mechanisms = [n.name for n in graph.nodes if isinstance(n, MechanismNode)]
    return Energies(model.name, plan.experiment, run.time, found, kinds | dict.fromkeys(mechanisms, "multibody"))


def _power(element: Element) -> str:
    """Return the power along the arrows of its ports where effort times flow is one, as text of the language."""
    several, balanced = len(element.ports) > 1, (p for p in element.ports if DOMAINS[p.domain].is_balanced)
    dotted = [f"{element.name}.{p.name}." if several else f"{element.name}." for p in balanced]
    return " + ".join(f"{d}e*{d}f" for d in dotted)


def _into_source(graph: Any, element: Element) -> bool:
    """Return True if the arrow of a source points into it, so that its power is received."""
    if element.kind.value not in letters("source"):
        return False
    (bond,) = graph.incident[graph.nodes.index(element)]
    return bool(graph.bonds[bond].head.node == graph.nodes.index(element))
