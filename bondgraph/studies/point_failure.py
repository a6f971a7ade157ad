"""Point failure: an error at one of many points is its result, and does not end the others."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from typing import Any

from compiler.api import CompilationFailed

from ..errors import PointBroken, RunBroken, RunFailed, UnknownOutput, UsageError

OURS = (RunFailed, CompilationFailed, UsageError, UnknownOutput)  # errors with a message for the author
OF_ALL = (ImportError, OSError, UnicodeError)  # a missing package or file is missing at all points


def kept(problem: Exception) -> Exception:
    """Return the error at a point as it is stored: a defect, or a lack of resources, as a `RunFailed` that says so.

    References to the run are removed from it. Raises errors that concern all points.
    """
    if isinstance(problem, OF_ALL):
        raise problem
    if not isinstance(problem, OURS):
        problem = _broken(problem)
    problem.__traceback__ = problem.__context__ = problem.__cause__ = None
    return problem


def why(problem: Exception) -> str:
    """Return an error as one line."""
    if isinstance(problem, CompilationFailed):
        return "; ".join(f"{d.code} {d.sentence}" for d in problem.diagnostics) or "the model does not compile"
    return str(problem)


def _broken(problem: Exception) -> PointBroken:
    within = isinstance(problem, RunBroken)
    what = str(problem) if within else f"{type(problem).__name__}: {problem}"
    if isinstance(problem.__cause__ if within else problem, MemoryError):
        found = PointBroken("BR463", f"there is not enough memory ({what})")
    else:
        found = PointBroken("BR464", f"a defect of ours, not of your file ({what})")
        found.add_note("".join(traceback.format_exception(problem)))
    found.result = getattr(problem, "result", None)
    return found


def check_some_stand(found: Sequence[Any]) -> None:
    """Raise `RunBroken` if all points failed by a defect, which then concerns the request."""
    if found and all(isinstance(x, PointBroken) for x in found):
        broken = RunBroken("BR465", f"no point could be computed: {found[0]}")
        broken.result = found[0].result
        broken.__notes__ = list(getattr(found[0], "__notes__", ()))
        raise broken
