"""Ensemble: runs of one model with many settings, each with its result or its error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from compiler.api import Array

from ..errors import RunFailed, UsageError
from ..rendering import Plotted
from .exports import Arrays, Exported

if TYPE_CHECKING:
    from .result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(Plotted, Exported):
    """Runs in the order of their settings.

    `ensemble[3]` is the result of the fourth run (raises its error), `ensemble["x"]` the output `x` of all of them, shape (runs, points), NaN where a run
    failed, and after the end of one that a `stop when` ended (that instant itself is in its own result, and in `final`). `failures` has the failed
    runs with their errors. `plot` draws all over time: a curve for each, or bands of many. Exports are over `run` and `time`, with the settings;
    they raise as `time`.
    """

    settings: tuple[Mapping[str, str | float], ...]
    outcomes: tuple[Result | Exception, ...]

    def __repr__(self) -> str:
        failed = f", {len(self.failures)} of them failed" if self.failures else ""
        return f"<Ensemble of {len(self)} runs{failed}>"

    def __len__(self) -> int:
        return len(self.outcomes)

    def __iter__(self) -> Iterator[Result | Exception]:
        return iter(self.outcomes)

    @cached_property
    def failures(self) -> Mapping[int, Exception]:
        """Index of each failed run, and its error."""
        return {i: o for i, o in enumerate(self.outcomes) if isinstance(o, Exception)}

    @cached_property
    def _first(self) -> Result:
        for outcome in self.outcomes:
            if not isinstance(outcome, Exception):
                return outcome
        first = f"; the first: {self.outcomes[0]}" if self.outcomes else ""
        raise RunFailed("BR904", f"none of {len(self)} runs has a result{first}")

    @property
    def time(self) -> Array:
        """Instants of all runs, shape (points,), in s. Raises `UsageError` if they differ, `RunFailed` if no run has a result."""
        import numpy as np

        times = [_regular(o) for o in self.outcomes if not isinstance(o, Exception)]
        time = max(times, key=len, default=self._first.time)
        if any(not np.array_equal(other, time[: len(other)]) for other in times):
            raise UsageError(
                "BR905", "the runs are reported at different instants: `to` and `points` make them the same"
            )
        return time

    def unit(self, name: str) -> str:
        """Return the SI unit of an output."""
        return self._first.unit(name)

    def __getitem__(self, key: int | str) -> Any:
        """Return a run by its index; or an output by its name, shape (runs, points), in SI."""
        if not isinstance(key, str):
            found = self.outcomes[key]
            if isinstance(found, Exception):
                raise found.with_traceback(None)  # the exception may have been raised before
            return found
        import numpy as np

        values = np.full((len(self), len(self.time)), np.nan)
        for number, outcome in enumerate(self.outcomes):
            if not isinstance(outcome, Exception):
                count = len(_regular(outcome))
                values[number, :count] = outcome[key][:count]
        return values

    def final(self, name: str) -> Array:
        """Return the last value of an output in each run, shape (runs,), in SI; NaN where a run failed."""
        import numpy as np

        self._first.unit(name)
        return np.array([np.nan if isinstance(o, Exception) else o.final(name) for o in self.outcomes])

    def _arrays(self) -> Arrays:
        """Return outputs over (run, time), and numeric settings over `run`. NaN where a run failed."""
        import numpy as np

        first, runs = self._first, np.arange(len(self), dtype=float)
        variables: dict[str, tuple[tuple[str, ...], Any, str]] = {
            n: (("run", "time"), self[n], first.unit(n)) for n in first.names
        }
        names = dict.fromkeys(n for s in self.settings for n in s)
        for name in names:
            values = [s.get(name, np.nan) for s in self.settings]
            if all(isinstance(v, int | float) for v in values):  # texts have their own units
                variables[f"set {name}"] = (("run",), np.array(values, dtype=float), "SI")
        return Arrays(
            {"run": (runs, "1"), "time": (self.time, "s")},
            variables,
            {"model": first.model, "failed": len(self.failures)},
        )


def _regular(result: Result) -> Array:
    """Return the instants of a run without that of a `stop when`, at which no other run is reported."""
    return result.time if result.stopped_by is None else result.time[:-1]
