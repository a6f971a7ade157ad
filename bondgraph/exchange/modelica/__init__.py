"""Import of flat Modelica: a text of the language that means the same."""

from __future__ import annotations

from compiler.api import Source, format_text

from .events import EventFinder
from .normal_form import Normalizer
from .parse import FlatModel, parse
from .start import StartEvaluator, find_starts
from .system import sort_equations
from .write import ModelWriter


def import_modelica(source: Source) -> str:
    """Return the model of a flat Modelica text in the language. Raises `CompilationFailed` with all that is not in the subset."""
    model = parse(source)
    try:
        text = _translated(model)
    except RecursionError:  # of terms into which others were put
        model.refuse(
            (0, 0), "expressions are nested too deep, with what they read in the place of names", "Name their parts."
        )
    model.stop()
    return format_text(Source(f"{source.name}, imported", text))


def _translated(model: FlatModel) -> str:
    form = Normalizer(model).form
    model.stop()
    system = sort_equations(model, form)
    starts = find_starts(model, form, system)
    values = StartEvaluator(model, form, system, starts)
    events = EventFinder(model, form, system, values).result()
    model.stop()
    return ModelWriter(model, form, system, starts, events).text()
