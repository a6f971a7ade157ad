"""Table of the text targets: each module of this folder with a `TARGET` is one, so a new target is one file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from ...errors import CompilationFailed
from ...fast_dataclass import dataclass
from ...reduction import StateSpace
from ..errors import UnitInText


@dataclass(frozen=True, slots=True)
class TextTarget:
    """A target: its name, the ending of its files, and its writer, from a state space and the author's descriptions of quantities.

    Of several targets with one ending, the `usual` one is written where none is named.
    """

    name: str
    ending: str
    write: Callable[[StateSpace, Mapping[str, str]], str]
    usual: bool = True


@cache
def text_targets() -> Mapping[str, TextTarget]:
    """Targets by name."""
    modules = (import_module(f"{__package__}.{found.name}") for found in iter_modules([str(Path(__file__).parent)]))
    targets: list[TextTarget] = [module.TARGET for module in modules if hasattr(module, "TARGET")]
    return {target.name: target for target in targets}


def target_text(target: str, space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Return the program as a text for others. Raises `CompilationFailed`."""
    if refusals := [UnitInText(e.span, e.owner, e.span.source.name) for e in space.events if e.span.unit is not None]:
        raise CompilationFailed(refusals)
    return text_targets()[target].write(space, descriptions)


def target_of(ending: str) -> str:
    """Name of the usual target of files with this ending, which must be one of a target."""
    return next(t.name for t in text_targets().values() if t.usual and t.ending == ending)
