"""Options of a call for the runs of an experiment; a single run loads this file alone of the studies."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ..simulation.run_options import RunOptions


@dataclass(frozen=True, slots=True)
class Options(RunOptions):
    """Options of a call for the runs of an experiment, as for `Model.simulate`."""

    outputs: tuple[str, ...] | None = None

    @property
    def wanted(self) -> RunOptions:
        """Options of the runs."""
        return RunOptions(**{f.name: getattr(self, f.name) for f in fields(RunOptions)})
