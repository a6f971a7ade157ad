"""A lowered state space as a module of LLVM IR for a library: chosen functions of the program, and slopes by states and inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...fast_dataclass import dataclass
from ..lowered import Lowered
from ..numpy.write import Writer
from ..structure import slope_places, slopes_of
from .generate import level_of
from .module import Module


@dataclass(frozen=True, slots=True)
class LibraryModule:
    """Text of a module, optimization level, number of values of each function, and rows and columns of the slopes (see `structure.py`)."""

    text: str
    level: int
    counts: Mapping[str, int]
    slopes: tuple[tuple[int, int], ...]


def library_module(lowered: Lowered, names: Sequence[str]) -> LibraryModule:
    """Return the module with these functions of the program, as far as it has them, and `slopes`."""
    row, slopes = slopes_of(lowered)
    module = Module(Writer(lowered, ((row, slopes),)), True, frozenset((*names, row.name)))
    text = module.text()
    counts = {name: count for name, _, count in module.functions}
    return LibraryModule(text, level_of(module), counts, tuple(slope_places(lowered)))
