"""Bond graphs as text: load a model, look at its equations, simulate it.

    import bondgraph
    model = bondgraph.load("oscillator.bg")
    result = model.simulate(to="10 s")
    result["position"]          # a numpy array, in SI

`Graph` builds a model by calls instead.

Nothing heavy is imported before it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import rendering
from .presentation.renderers import RENDERERS
from .version import VERSION

if TYPE_CHECKING:
    from compiler.api import CacheBackend
    from compiler.api import CompilationFailed as CompilationFailed

    from .builder import Graph as Graph
    from .compiled_model import check as check
    from .errors import BondgraphError as BondgraphError
    from .errors import RunFailed as RunFailed
    from .errors import RunInterrupted as RunInterrupted
    from .errors import UsageError as UsageError
    from .model import Model as Model
    from .model import load as load
    from .model.cell import load_ipython_extension as load_ipython_extension
    from .results.archive import read_result as read_result
    from .results.ensemble import Ensemble as Ensemble
    from .results.result import Result as Result
    from .studies.comparison import compare as compare
    from .studies.journal import Journal as Journal
    from .studies.workers import Workers as Workers

_HOMES = {
    "BondgraphError": "errors",
    "CompilationFailed": "compiler.api",
    "Ensemble": "results.ensemble",
    "Graph": "builder",
    "Journal": "studies.journal",
    "Model": "model",
    "Result": "results.result",
    "RunFailed": "errors",
    "RunInterrupted": "errors",
    "UsageError": "errors",
    "Workers": "studies.workers",
    "check": "compiled_model",
    "compare": "studies.comparison",
    "load": "model",
    "load_ipython_extension": "model.cell",
    "read_result": "results.archive",
}
__version__ = VERSION
__all__ = [name for name in _HOMES if name != "load_ipython_extension"]  # which IPython calls


def _connect_compiler() -> None:
    """Give the compiler the user's cache. Raises `ImportError` if a file `compiler.py` beside the user's script hides our package."""
    from importlib.machinery import PathFinder

    found = PathFinder.find_spec("compiler")
    if found is not None and PathFinder.find_spec("compiler.api", found.submodule_search_locations or []) is None:
        raise ImportError(
            f"bondgraph needs its own package `compiler`, but Python found {found.origin} first: rename that file"
        )
    from compiler.api import keep_on

    keep_on(_cache)


def _cache() -> CacheBackend:
    from . import cache

    return cache


rendering.install(RENDERERS)
_connect_compiler()


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'bondgraph' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{home}" if home != "compiler.api" else home, __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
