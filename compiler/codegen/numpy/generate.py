"""A lowered state space to a numpy program: written and loaded as a Python module."""

from __future__ import annotations

import importlib.machinery
import importlib.util
from dataclasses import replace
from importlib.abc import InspectLoader
from types import ModuleType

from ..description import image_of, name_tables
from ..lowered import Lowered
from ..program import Program
from ..program_image import program_of
from ..time_functions import constants_of_signals, time_functions_of
from .write import Writer


def generate_program(lowered: Lowered) -> Program:
    """A program of the numpy target."""
    writer = Writer(lowered)
    source = _text(writer)
    module = vars(load_module(lowered.space.name, source))
    rows = tuple((row.name, (row.arguments,), len(results)) for row, results in writer.functions)
    timed = time_functions_of(lowered, writer.constants), constants_of_signals(lowered, writer.constants)
    image = image_of(lowered, source, rows, (), timed)
    image = replace(image, defaults=module["DEFAULTS"], input_defaults=module["INPUT_DEFAULTS"])
    others = ("constants", "jacobian", *(["mode_at"] if image.hybrid is not None else []))
    return program_of(image, {name: module[name] for name in (*others, *(name for name, _, _ in rows))})


def _text(writer: Writer) -> str:
    lowered = writer.lowered
    mode = "mode_at(0.0, x, INPUT_DEFAULTS, c)" if lowered.events.present else "switches(0.0, c)"
    note = (
        f"{lowered.space.name}: generated from a bond graph; needs numpy alone.\n\n"
        f"c = constants(DEFAULTS); x = start(c); derivative(0.0, x, INPUT_DEFAULTS, c, {mode}).\n"
        "All quantities are in SI; arrays may have leading axes (batches). Both sides of an `if` are evaluated: where that warns of\n"
        "a division by zero, `with numpy.errstate(all='ignore')` around the call keeps it quiet.\n"
    )
    return writer.module(name_tables(lowered), note)


class _Generated(InspectLoader):
    """Loader of a module from its generated text."""

    def __init__(self, source: str) -> None:
        self.source = source

    def get_source(self, fullname: str) -> str:
        return self.source


def load_module(name: str, source: str) -> ModuleType:
    """Module of a generated text."""
    full = f"bondgraph_program_{name}"
    spec = importlib.machinery.ModuleSpec(full, _Generated(source), origin=f"<{name}>")
    module = importlib.util.module_from_spec(spec)
    assert spec.loader is not None
    spec.loader.exec_module(module)
    return module
