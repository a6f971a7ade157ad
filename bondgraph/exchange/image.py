"""Image of an instance: the block of memory with which each instance of a unit begins, and the data that the interface reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import FLOATS, INTS, Fields, Record, record_of

from ..simulation.integrators.compiled.fields import given_at, room_of
from ..simulation.integrators.compiled.record_layout import RecordLayout
from ..simulation.integrators.methods import EXPLICIT, RADAU
from ..simulation.segments.context import SegmentContext
from ..simulation.segments.timeline import Segment, Signals
from .runtime.instance import FmuInstance

if TYPE_CHECKING:
    from compiler.api import LibraryModule, Program

    from .start import StartValues

# Fields of an instance that are functions of the program under another name.
NAMES = {
    "find_constants": "constants", "find_start": "start", "find_instants": "instants", "find_periods": "periods",
    "find_switches": "switches", "find_output": "output", "find_slopes": "slopes", "find_limits": "limit_values",
    "entries": "jacobian_entries",
}  # fmt: skip
FUNCTIONS = (
    "constants", "start", "derivative", "jacobian_entries", "output", "instants", "periods", "switches", "holds", "limit_values", "bends",
)  # fmt: skip
NOW = Segment(0.0, 1.0, np.empty(0))


@dataclass(frozen=True, slots=True)
class ModelImage:
    """ShortInts of a block, its beginning, indices of the words that are addresses within it, and functions by their words."""

    size: int
    head: tuple[int, ...]
    inside: tuple[int, ...]
    functions: tuple[tuple[int, str], ...]


def image_of(program: Program, module: LibraryModule, values: StartValues) -> ModelImage:
    """Return the image of the instances of a program."""
    form = RecordLayout(FmuInstance, _complete(record_of(FmuInstance), _fields(program, module, values)), {})
    functions = tuple((at, NAMES.get(field, field)) for at, field in form.functions)
    connected = tuple((at, name) for at, name in functions if name in module.counts)
    inside = [*form.inside.tolist(), *(at for at, _ in functions)]
    return ModelImage(form.size, tuple(form.head.tolist()), tuple(inside), connected)


def _complete(record: Fields, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a record with empty ones for the records and arrays that are not among them, so that no address is missing."""
    result = dict(values)
    for name, kind in record.fields.items():
        if isinstance(kind, Fields):
            inner = values.get(name, {})
            result[name] = _complete(kind, vars(inner) if isinstance(inner, Record) else inner)
        elif kind in (FLOATS, INTS):
            result.setdefault(name, np.zeros(0))
    return result


def _fields(program: Program, module: LibraryModule, values: StartValues) -> dict[str, Any]:
    """Return the fields of an instance; those that are not named begin as 0."""
    counts, n = module.counts, len(program.states.names)
    slopes, limits = module.slopes, program.limits
    places = np.cumsum([0, *(len(note.values) for note in limits)])
    return {
        "solver": _solver(program, counts, values),
        "parameter_count": len(values.parameters), "input_count": len(values.inputs), "output_count": counts["output"],
        "instant_count": counts["instants"], "period_count": counts["periods"], "mode_count": counts["switches"],
        "slope_count": len(slopes), "parameters": np.array(values.parameters, dtype=float), "state": np.zeros(n),
        "is_set": _whole(n), "starts": np.zeros(n), "rates": np.zeros(n), "outputs": np.zeros(counts["output"]),
        "instants": np.zeros(counts["instants"]), "periods": np.zeros(counts["periods"]),
        "slope_rows": np.array([row for row, _ in slopes], dtype=np.int64),
        "slope_columns": np.array([column for _, column in slopes], dtype=np.int64), "slopes": np.zeros(len(slopes)),
        "seed": np.zeros(n + len(values.inputs)),
        "is_table": np.array([note.kind == "table" for note in limits], dtype=np.int64), "limit_place": places[:-1].astype(np.int64),
        "limit_values": np.zeros(int(places[-1])), "relative": values.tolerances.relative,
        "own_method": EXPLICIT if program.bends is None else RADAU,
    }  # fmt: skip


def _solver(program: Program, counts: Mapping[str, int], values: StartValues) -> dict[str, Any]:
    """Return the fields of the workspace of the integration."""
    nothing = np.zeros(0)
    constants = np.zeros(counts["constants"])
    context = SegmentContext(program, constants, np.array(values.inputs, dtype=float), nothing, values.tolerances)
    signals = Signals(nothing, nothing, np.zeros((0, 0)), True)
    at_start = given_at(context, NOW, values.state, np.inf, signals)
    room = room_of(program, EXPLICIT, 0, counts.get("bends", 0))
    mode = {"mode": np.zeros(counts["switches"])}
    checked = {"limit_count": len(program.limits)}  # those of parameters alone too: whoever holds the unit may set them
    return room | at_start | mode | checked | {"closed": {}, "redundant": 0, "pattern": {"n": len(values.state)}}


def _whole(count: int) -> Any:
    return np.zeros(count, dtype=np.int64)


def llvm_data(image: ModelImage, token: str) -> str:
    """Return the image as LLVM IR, with the function that puts the addresses of functions into a block."""
    lines = [
        _array("fmu_image", image.head), _array("fmu_inside", image.inside),
        _array("fmu_sizes", (image.size, len(image.head), len(image.inside))),
        f'@fmu_guid = constant [{len(token) + 1} x i8] c"{token}\\00"', "define void @fmu_connect(ptr %block) {",
    ]  # fmt: skip
    for at, name in image.functions:
        lines += [f"  %p{at} = getelementptr inbounds i64, ptr %block, i64 {at}", f"  store ptr @{name}, ptr %p{at}"]
    return "\n".join([*lines, "  ret void", "}", ""])


def _array(name: str, words: tuple[int, ...]) -> str:
    return f"@{name} = constant [{len(words)} x i64] [{', '.join(f'i64 {w}' for w in words)}]"
