"""The one door to the compiler: everything that the product uses of it passes here.

Names are fetched when they are first used, so that opening the door loads no stage that is not needed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compiler.algebra.expression import evaluate
    from compiler.algebra.sympy_form import to_sympy
    from compiler.codegen.program import Program
    from compiler.driver import Compilation
    from compiler.driver import check as check_source
    from compiler.equations.system import Assignment, Storage
    from compiler.errors import CompilationFailed, Diagnostic, InternalError, render
    from compiler.graph.units import SECOND
    from compiler.reduction.state_space import LinearLoop, StateSpace
    from compiler.scene import Override, Plan, Reported, Scene
    from compiler.semantics.errors import Unsupported
    from compiler.semantics.typed import scale_of
    from compiler.source import Source, Span, read_text
    from compiler.syntax import parse_expression
    from compiler.syntax.format import format_text
    from compiler.syntax.tree import Literal

_HOMES = {
    "evaluate": "algebra.expression", "to_sympy": "algebra.sympy_form", "Program": "codegen.program", "Compilation": "driver", "check_source": "driver:check",
    "Assignment": "equations.system", "Storage": "equations.system", "CompilationFailed": "errors", "Diagnostic": "errors",
    "InternalError": "errors", "render": "errors", "SECOND": "graph.units", "LinearLoop": "reduction.state_space",
    "StateSpace": "reduction.state_space", "Override": "scene", "Plan": "scene", "Reported": "scene", "Scene": "scene",
    "Unsupported": "semantics.errors", "scale_of": "semantics.typed", "Source": "source", "Span": "source", "read_text": "source",
    "parse_expression": "syntax", "format_text": "syntax.format", "Literal": "syntax.tree",
}  # fmt: skip

__all__ = [
    "SECOND", "Assignment", "Compilation", "CompilationFailed", "Diagnostic", "InternalError", "LinearLoop", "Literal", "Override", "Plan",
    "Program", "Reported", "Scene", "Source", "Span", "StateSpace", "Storage", "Unsupported", "check_source", "evaluate", "format_text", "parse_expression",
    "read_text", "render", "scale_of", "to_sympy",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'bondgraph.door' has no attribute {name!r}")
    module, _, attribute = home.partition(":")
    try:
        return getattr(import_module(f"compiler.{module}"), attribute or name)
    except ModuleNotFoundError as error:
        raise _other_compiler(error) from error


def _other_compiler(error: ModuleNotFoundError) -> ImportError:
    """A file `compiler.py` beside the user's script hides ours: say so."""
    import sys

    found = getattr(sys.modules.get("compiler"), "__file__", None)
    if found is None or not (error.name or "").startswith("compiler"):
        return error
    return ImportError(f"bondgraph needs its own package `compiler`, but Python found {found} first: rename that file")
