"""What goes wrong at one of many points is its answer, and ends no other."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from typing import Any

from ..door import CompilationFailed
from ..errors import PointBroken, RunBroken, RunFailed, UnknownOutput, UsageError

OURS = (RunFailed, CompilationFailed, UsageError, UnknownOutput)  # told in the author's words already
OF_ALL = (ImportError, OSError, UnicodeError)  # a package or a file that is missing is missing at all points


def kept(problem: Exception) -> Exception:
    """What went wrong at a point, as it is kept: a defect, or what was too much for the machine, as a `RunFailed` that says so. It lets go of what
    was there when it was raised, all of the run. Raises what is wrong at all points."""
    if isinstance(problem, OF_ALL):
        raise problem
    if not isinstance(problem, OURS):
        problem = _broken(problem)
    problem.__traceback__ = problem.__context__ = problem.__cause__ = None
    return problem


def _broken(problem: Exception) -> PointBroken:
    within = isinstance(problem, RunBroken)
    what = str(problem) if within else f"{type(problem).__name__}: {problem}"
    if isinstance(problem.__cause__ if within else problem, MemoryError):
        found = PointBroken(f"there is not enough memory ({what})")
    else:
        found = PointBroken(f"a defect of ours, not of your file ({what})")
        found.add_note("".join(traceback.format_exception(problem)))
    found.result = getattr(problem, "result", None)
    return found


def check_some_stand(found: Sequence[Any]) -> None:
    """A defect everywhere is one of what is asked of all. Raises `RunBroken`."""
    if found and all(isinstance(x, PointBroken) for x in found):
        broken = RunBroken(str(found[0]), found[0].result)
        broken.__notes__ = list(getattr(found[0], "__notes__", ()))
        raise broken
