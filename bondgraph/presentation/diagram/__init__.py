"""Bond graphs as pictures: from a compilation to a figure in a textbook's notation."""

from __future__ import annotations

from compiler.api import Compilation

from ...compiled_model import CompiledModel
from ...errors import UsageError
from .compose import compose
from .diagram_model import diagram_model_of
from .figure import Figure
from .frames import place_framed
from .mechanism import draw_mechanism
from .mechanism_geometry import mechanism_geometry_of, mechanisms_of, posed_model
from .picture import write_figure
from .shapes import shapes_of
from .svg import svg_text

__all__ = ["draw", "mechanism_of", "shapes_of", "svg_text", "write_figure"]


def draw(compilation: Compilation, closed: bool = False, numbers: bool = False) -> Figure:
    """Return the diagram of a scene. `closed`: draw instances as boxes; `numbers`: show the numbers of the bonds. Raises `CompilationFailed`."""
    diagram_model = diagram_model_of(compilation, closed)
    named, layout, frames = place_framed(diagram_model)
    return compose(named, layout, frames, numbers)


def mechanism_of(model: CompiledModel, name: str | None, experiment: str | None, at: str | float | None) -> Figure:
    """Return the picture of a mechanism: in the reference, or at a time of an experiment. Raises as `Model.draw_mechanism`."""
    graph = model.compilation().whole_graph
    names = [node.name for node in mechanisms_of(graph)]
    if not names or (name is None and len(names) > 1) or (name is not None and name not in names):
        choice = f"it has {', '.join(f'`{n}`' for n in names)}: name one" if names else "it has none"
        raise UsageError("BR939", f"which mechanism of `{graph.name}` is to be drawn? {choice}")
    place = names.index(name or names[0])
    if at is None:
        return draw_mechanism(mechanism_geometry_of(graph, mechanisms_of(graph)[place]))
    from ...simulation.repetition import simulate
    from ...simulation.run_options import RunOptions, RunRequest

    posed = posed_model(model, experiment)
    run = simulate(posed.model, RunRequest(None, {}, posed.names, RunOptions(at, 2)))
    poses = posed.poses(mechanisms_of(posed.graph)[place], {n: run.final(n) for n in posed.names})
    graph = model.compilation(model.scene(experiment)).whole_graph  # the experiment may set parameters of positions
    return draw_mechanism(mechanism_geometry_of(graph, mechanisms_of(graph)[place], poses), f"at {run.time[-1]:.6g} s")
