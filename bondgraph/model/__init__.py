"""A model: its text, its stages, its runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..analysed_model import AnalysedModel
from ..compiled_model import names_of, source_of
from .shown import STAGES, Shown

if TYPE_CHECKING:
    from ..analysis.inversion.feed_forward import FeedForward
    from ..analysis.outcome import Outcome
    from ..results.ensemble import Ensemble
    from ..results.result import Result
    from ..studies.distributions import Distribution
    from ..studies.fit_problem import Sought
    from ..studies.fitted import Fit
    from ..studies.journal import Journal
    from ..studies.measured import Measurements
    from ..studies.sharing import Sharing
    from ..studies.tolerances import MonteCarlo

__all__ = ["STAGES", "Model", "load"]


def load(path_or_text: str | Path, model: str | None = None) -> Model:
    """Return a model from a file, or from a text with at least one line break or brace.

    `model` names one of several. Nothing is compiled yet: errors are raised at the first use of the model, or by `check`. Raises OSError if the file
    cannot be read, `CompilationFailed` if it is not UTF-8.
    """
    return Model(source_of(path_or_text), model)


class Model(Shown, AnalysedModel):
    """One model of a text, compiled at its first use. Raises `CompilationFailed` with all errors."""

    def run(
        self, experiment: str = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: Sequence[str] | None = None, target: str | None = None, executor: Any = None, solver: str | None = None,
        sharing: Sharing | None = None, bandwidth: str | float | None = None,
    ) -> Outcome:  # fmt: skip
        """Execute an experiment: its sweeps, analyses and simulation; "": the first. Arguments as for `simulate`.

        `executor`: with the standard interface (`concurrent.futures`, a Dask client): its workers compute the points. `sharing` has more options: our own
        workers, a journal to go on from after a crash, progress.
        """
        from ..studies.experiment import Options, run

        options = Options(to, points, rtol, atol, energy, target, solver, bandwidth, names_of(outputs))
        return run(self, experiment, settings or {}, options, _sharing(sharing, executor))

    def sweep(
        self, values: Mapping[str, str | Sequence[str | float]], of: str | tuple[str, ...] = "simulate", together: bool = False,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, outputs: Sequence[str] | None = None, executor: Any = None,
        solver: str | None = None, sharing: Sharing | None = None, bandwidth: str | float | None = None,
    ) -> Outcome:  # fmt: skip
        """Compute equilibrium, modes or simulate, or several of them (`of`), at each point of a grid of `values`.

        `values`: texts with units, numbers in SI, or one text, `1 mm .. 2 mm : 11`; the last name runs fastest. `together`: the first of each, the second of
        each and so on. `executor` and `sharing` as in `run`. A failed point is NaN in the table, with its reason in `failures`.
        """
        from ..studies.experiment import Options
        from ..studies.sweep import sweep

        steps = (of,) if isinstance(of, str) else tuple(of)
        options = Options(to, points, rtol, outputs=names_of(outputs), solver=solver, bandwidth=bandwidth)
        return sweep(self, values, steps, together, experiment, settings or {}, options, _sharing(sharing, executor))

    def montecarlo(
        self, vary: Mapping[str, str | Distribution], of: str | tuple[str, ...] = "modes", samples: int = 1000,
        correlations: Mapping[tuple[str, str], float] | None = None, seed: int = 0, indices: int | None = None,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, outputs: Sequence[str] | None = None,
        to: str | float | None = None, rtol: float | None = None, sharing: Sharing | None = None,
    ) -> MonteCarlo:  # fmt: skip
        """Compute the effect of tolerances at `samples` quasi-random points, with statistics, Sobol indices and swings.

        `of`: equilibrium (outputs at equilibrium), modes (frequencies) or simulate (outputs at the end). `vary`: distributions by parameter, as texts:
        `normal(1.95 um, 50 nm)`, `lognormal(mean, standard deviation)`, `uniform(low, high)`, `triangular(low, most likely, high)`,
        `truncated(one of these, low, high)`. `correlations`: by pairs of names, of a Gaussian copula. `indices`: number of rows for Sobol indices, a power
        of two (None: up to 1024; 0: none). `sharing`: the workers (None: all cores).
        Failed points are reported and not in the statistics. Raises `UsageError`, `CompilationFailed`, and `RunFailed` if all fail.
        """
        from ..simulation.run import Wanted
        from ..studies.montecarlo import Chance, montecarlo
        from ..studies.sharing import Sharing

        chance = Chance(vary, correlations or {}, samples, seed, indices)
        steps = (of,) if isinstance(of, str) else tuple(of)
        wanted = Wanted(to, 2 if "simulate" in steps else None, rtol)
        return montecarlo(
            self, chance, steps, experiment, settings or {}, names_of(outputs), wanted, sharing or Sharing()
        )

    def fit(
        self, data: str | Path | Measurements | Sequence[str | Path | Measurements], parameters: Mapping[str, str | Sought], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, explain: bool | None = None,
    ) -> Fit:  # fmt: skip
        """Fit `parameters` to measured data by weighted least squares with exact derivatives; with 95 % intervals and undetermined directions.

        `data`: CSV files with units in their headings: settings, and outputs at equilibrium, `frequency 1 [Hz]` of modes, or outputs over `time [s]`;
        `sigma NAME` is the standard deviation. `parameters`: bounds by name as text (`1.5 um .. 2.5 um`, `log 1 N/m .. 100 N/m`; "": it keeps its sign).
        The search begins at the values of the model or of `settings`. `explain`: also fit small sets of parameters alone (None: if the data leave some
        undetermined). Raises `UsageError`, `CompilationFailed`, `RunFailed`, OSError.
        """
        from ..studies.fit import fit
        from ..studies.measured import Measurements

        files: Sequence[str | Path | Measurements] = (
            [data] if isinstance(data, str | Path | Measurements) else list(data)
        )
        return fit(self, files, parameters, experiment, settings or {}, explain)

    def invert_file(
        self, file: str | Path, inputs: Sequence[str], experiment: str | None = None, settings: Mapping[str, str | float] | None = None, *,
        to: str | float | None = None, start: str | float | None = None, points: int = 501, moving: bool = False,
        limits: Mapping[str, str | float] | None = None, sharing: Sharing | None = None,
    ) -> Outcome | FeedForward:  # fmt: skip
        """Apply `invert` to setpoints of a CSV file, whose headings are outputs with units: `x [um],phi [deg]`.

        Each line is held at equilibrium: an `Outcome` with a row of inputs for each; columns of parameters or inputs are settings of their line. With a
        column `time [s]` outputs follow the path through the lines (a spline, at rest at both ends), from the first to the last unless `start` and `to` are
        given. Raises as `invert`, and OSError.
        """
        from ..studies.setpoints import invert_file

        along = {"to": to, "start": start, "points": points, "moving": moving, "limits": limits or {}}
        return invert_file(self, file, inputs, experiment, dict(settings or {}), along, sharing)

    def simulate(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: Sequence[str] | None = None, target: str | None = None, start: Result | str | Path | None = None, solver: str | None = None,
        bandwidth: str | float | None = None, check: bool = False,
    ) -> Result:  # fmt: skip
        """Run an experiment ("": the first, None: none); arguments override it.

        `settings`: parameters and inputs by name, as texts with units or numbers in SI. `to`: the end, as text or s.
        `points`: equally spaced instants, both ends included (default 501). `outputs`: only these. `energy` adds the energy balance. `target`: native
        (machine code) or numpy; by default the first that this machine has. `solver`: automatic, exponential (linear models), explicit, radau, rodas (stiff
        models) or energy (lossless models).
        `bandwidth`: a frequency as text or in Hz; faster modes need not be followed, and the result's `truncation` reports the truncated ones.
        `start`: a result of the same model, or its .npz file, from whose end the run goes on.
        `check`: repeat the run by another method, with a tenth of the tolerance and a finer search for events; the result's `check` has the differences.
        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if the numbers fail; the latter, and the `RunInterrupted` that Ctrl-C raises, have the
        `result` up to then.
        """
        from ..errors import UsageError
        from ..results.archive import read_result
        from ..simulation.run import Wanted, simulate

        before = read_result(start) if isinstance(start, str | Path) else start
        if check and before is not None:
            raise UsageError("a run that goes on from a result cannot be checked: check the whole run")
        wanted = Wanted(to, points, rtol, atol, energy, target, solver, bandwidth)
        result = simulate(self, experiment, settings or {}, names_of(outputs), wanted, before)
        if not check:
            return result
        from dataclasses import replace

        from ..simulation.repetition import check_run

        def repeat(wanted: Wanted) -> Result:
            return simulate(self, experiment, settings or {}, names_of(outputs), wanted)

        return replace(result, check=check_run(result, repeat, wanted))

    def simulate_many(
        self, settings: Sequence[Mapping[str, str | float]], experiment: str | None = "", to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: Sequence[str] | None = None, target: str | None = None, solver: str | None = None,
        workers: int | None = None, executor: Any = None, progress: Callable[[int, int], None] | None = None,
        journal: Journal | None = None, bandwidth: str | float | None = None,
    ) -> Ensemble:  # fmt: skip
        """Run an experiment once for each of several settings; otherwise as `simulate`, with equal results to the last bit.

        The model is compiled once. An error in a run is stored with it; the others go on. `workers`: number of parallel runs (default: number of cores), or
        an `executor` with the interface of `concurrent.futures`, or a Dask client. `progress` is called with the number of finished runs and of all;
        `journal` stores results in a file, from which the same call goes on after a crash.
        Raises `UsageError` for arguments with which no run is possible, `RunBroken` if a defect ended all.
        """
        from ..simulation.run import Wanted
        from ..studies.runs import simulate_many
        from ..studies.sharing import Sharing

        wanted = Wanted(to, points, rtol, atol, energy, target, solver, bandwidth)
        sharing = Sharing(workers, executor, progress, journal)
        return simulate_many(self, experiment, settings, names_of(outputs), wanted, sharing)


def _sharing(sharing: Sharing | None, executor: Any) -> Sharing:
    """Return the workers; by default this process alone."""
    from ..studies.sharing import Sharing

    return sharing if sharing is not None else Sharing(workers=1, executor=executor)
