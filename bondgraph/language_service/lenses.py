"""Commands above models and experiments: what one may run there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from compiler.api import name_span, tree

from .answers import Lens
from .workspace import Workspace, place_of


def lenses(workspace: Workspace, path: Path) -> list[Lens]:
    """Return the commands of a file, in the order of its text. The diagram is that of its last model."""
    models = [s for s in workspace.project.document(path).tree.statements if isinstance(s, tree.ModelSyntax)]
    listed: list[Lens] = []
    for model in models:
        is_last = model is models[-1]
        if is_last:
            listed.append(Lens(place_of(model.name_span), "Diagram"))
        for experiment in (s for s in model.statements if isinstance(s, tree.Experiment)):
            place = place_of(name_span(experiment.span, experiment.name))
            named = (str(path), "-e", experiment.name, *(() if is_last else ("--model", model.name)))
            listed += [Lens(place, title, (title.lower(), *named)) for title in _titles(model, experiment)]
    return [lens for lens in listed if lens.place.path == path.resolve()]


def _titles(model: tree.ModelSyntax, experiment: tree.Experiment) -> Iterator[str]:
    """Yield the commands that make sense: an experiment without a step cannot run, a model without an input has no frequency response."""
    if any(isinstance(step, tree.Simulate | tree.Analysis) for step in experiment.steps):
        yield "Run"
    yield "Modes"
    if any(isinstance(s, tree.Quantities) and s.role == "input" for s in model.statements):
        yield "Bode"
