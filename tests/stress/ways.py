"""The ways in which a run can be made here: every solver that the product offers, on every back-end that this machine has."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import bondgraph
from bondgraph import compiled_scene
from bondgraph.model import Model
from compiler.api import SOLVERS


@dataclass(frozen=True, slots=True)
class Way:
    """A back-end and a solver, if one is named; `arguments` of `Model.simulate`."""

    name: str
    target: str
    solver: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def chooses(self) -> bool:
        """True if the product chooses the solver, so that it has no excuse."""
        return not self.solver


def targets() -> tuple[str, ...]:
    """The back-ends of this machine, the fastest first."""
    if os.environ.get(compiled_scene.HIDDEN) or compiled_scene.chosen_target(None) != "native":
        return ("numpy",)
    return ("native", "numpy")


def solvers() -> tuple[str, ...]:
    """The solvers that can be asked for by name, and none for the product's own choice, which comes first."""
    return ("", *(name for name in SOLVERS if name != "automatic"))


def ways(only: tuple[str, ...] | None = None) -> list[Way]:
    """All ways, the product's own choices first, or those on these back-ends."""
    found = []
    for solver in solvers():
        for target in only if only is not None else targets():
            arguments = {"target": target} | ({"solver": solver} if solver else {})
            found.append(Way(" ".join(filter(None, (solver, target))), target, solver, arguments))
    return found


def run(text: str, way: Way, **what: Any) -> bondgraph.Result:
    """A text run in one way."""
    return loaded(text).simulate(**{**what, **way.arguments})


def loaded(text: str) -> Model:
    """The model of a text; the same object for the same text, so that it is compiled once."""
    if text not in _LOADED:
        _LOADED[text] = bondgraph.load(text)
    return _LOADED[text]


_LOADED: dict[str, Model] = {}
