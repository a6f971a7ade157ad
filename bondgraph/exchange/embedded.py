"""A model as one file of C that makes its own steps: the co-simulation of a unit in static memory, without an importer."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from compiler import api

from ..simulation.run_options import DEFAULT_POINTS
from .functions import LEFT_OUT
from .image import ModelImage
from .interface_c import LONGEST_LINE
from .runtime import exchange, stepping, values
from .runtime.instance import ENDED, FmuInstance
from .runtime.memory import MAKES_STEPS, MESSAGE
from .unit import instance_of

if TYPE_CHECKING:
    from ..compiled_model import CompiledModel

_RUNTIME = (
    exchange.set_up_and_start, exchange.end_initialization, stepping.do_step, values.get_values, values.set_values
)  # fmt: skip


def c_with_own_steps(model: CompiledModel, experiment: str | None = None) -> str:
    """Return the text of the file. Raises `CompilationFailed` for what no unit can hold, `RunFailed`."""
    instance = instance_of(model, api.Scene(model.model, experiment or ""), experiment)
    lowered, plan = instance.compilation.lowered, instance.plan
    program, prefix = api.write_library_c(lowered, _RUNTIME, LEFT_OUT)
    variables, first = lowered.space.variables, 1 + 2 * len(lowered.space.states)
    names = [variables[v].name.removeprefix(f"{lowered.space.name}.") for v in lowered.inputs]
    inputs, outputs = api.c_fields(names), api.c_fields(list(lowered.space.outputs))
    count = len(lowered.parameters)
    places = _image(instance.image, prefix) | {
        "inputs": len(inputs), "outputs": len(outputs), "parameters": count, "first_input": first, "first_parameter": first + len(inputs),
        "first_output": first + len(inputs) + count, "makes_steps": MAKES_STEPS, "message": MESSAGE, "ended": ENDED, "start": repr(plan.start),
        "stop": repr(plan.stop if plan.stop is not None else plan.start + 1.0), "tolerance": repr(instance.values.tolerances.relative),
        "fields": len(api.record_of(FmuInstance).fields), "points": round(plan.settings.get("points", DEFAULT_POINTS)),
        "input_fields": _lines(f"double {name};" for name in inputs) or "    int none;",
        "output_fields": _lines(f"double {name};" for name in outputs) or "    int none;",
        "inputs_default": _lines(f"in->{name} = {prefix}_input_defaults[{i}];" for i, name in enumerate(inputs)) or "    in->none = 0;",
        "inputs_in": _lines(f"value[{i}] = in->{name};" for i, name in enumerate(inputs)) or "    (void)in;",
        "outputs_out": _lines(f"out->{name} = value[{i}];" for i, name in enumerate(outputs)) or "    out->none = 0;",
        "printed": _lines(f'printf(",%.17g", out.{name});' for name in outputs),
    }  # fmt: skip
    template = Path(__file__).with_name("embedded.c").read_text(encoding="utf-8").replace("NAME", prefix)
    return program + re.sub(r"@(\w+)@", lambda match: str(places[match[1]]), template)


def _image(image: ModelImage, prefix: str) -> dict[str, object]:
    """Return what a model begins with, by places of the template."""
    words = [f"INT64_C({w})" if w > -(2**63) else "INT64_MIN" for w in image.head]
    return {
        "words": image.size, "image": _rows(words), "inside": _rows(map(str, image.inside)),
        "messages": _lines(f"{api.c_string(text)}," for text in image.sentences),
        "functions": _lines(f"own[{at}] = (int64_t)(intptr_t){prefix}_{name};" for at, name in image.functions),
    }  # fmt: skip


def _rows(words: Iterable[str]) -> str:
    items = [*words]
    return _lines(", ".join(items[i : i + LONGEST_LINE]) + "," for i in range(0, len(items), LONGEST_LINE))


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)
