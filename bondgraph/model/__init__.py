"""A model: its text, its stages, its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from compiler.api import MonteCarloRequest

from ..analysed_model import AnalysedModel
from ..compiled_model import named, names_of, source_of
from ..keywords import (
    BenchmarkKeywords,
    MonteCarloKeywords,
    PathKeywords,
    RunKeywords,
    StressKeywords,
    SweepKeywords,
    checked,
)
from .shown import STAGES, Shown

if TYPE_CHECKING:
    from ipywidgets import VBox

    from compiler.api import BoundedParameter, Distribution

    from ..analysis.inversion.feed_forward import FeedForward
    from ..analysis.outcome import Outcome
    from ..results.ensemble import Ensemble
    from ..results.result import Result
    from ..simulation.run_options import RunRequest
    from ..studies.fitted import Fit
    from ..studies.measured import Measurements
    from ..studies.scalar_study import ScalarStudy
    from ..studies.stressed import StressTest
    from ..studies.tolerances import MonteCarlo
    from ..studies.work_precision import WorkPrecision
    from ..studies.workers import Submitting, Workers

__all__ = ["STAGES", "Model", "load"]


@checked
def load(path_or_text: str | Path, model: str | None = None) -> Model:
    """Return a model from a file, or from a text with at least one line break or brace.

    `model` names one of several. Nothing is compiled yet: errors are raised at the first use of the model, or by `check`. Raises OSError if the file
    cannot be read, `CompilationFailed` if it is not UTF-8.
    """
    return Model(source_of(path_or_text), model)


class Model(Shown, AnalysedModel):
    """One model of a text, compiled at its first use. Raises `CompilationFailed` with all errors."""

    @checked
    def run(
        self, experiment: str = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, workers: Workers | Submitting | int | None = None, **options: Unpack[RunKeywords],
    ) -> Outcome:  # fmt: skip
        """Execute an experiment: its sweeps, analyses and simulation; "": the first. Arguments as for `simulate`.

        `workers` compute the points (None: this process): a number of our own, an executor of `concurrent.futures`, a Dask client, or a `Workers`, which
        also has a journal to go on from after a crash, and progress.
        """
        from ..studies.experiment import run
        from ..studies.workers import ALONE, workers_of

        request = _request(experiment, settings, {**options, "to": to, "points": points})
        return run(self, request, workers_of(workers, ALONE))

    @checked
    def sweep(
        self, values: Mapping[str, str | Sequence[str | float]], of: str | tuple[str, ...] = "simulate", together: bool = False,
        experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        workers: Workers | Submitting | int | None = None, **options: Unpack[SweepKeywords],
    ) -> Outcome:  # fmt: skip
        """Compute equilibrium, modes or simulate, or several of them (`of`), at each point of a grid of `values`.

        `values`: texts with units, numbers in SI, or one text, `1 mm .. 2 mm : 11`; the last name runs fastest. `together`: the first of each, the second of
        each and so on. `workers` as in `run`, `to`, `points` and the other options as in `simulate`. A failed point is NaN in the table, with its reason in
        `failures`.
        """
        from ..studies.experiment import sweep
        from ..studies.workers import ALONE, workers_of

        study = _study(of, _request(experiment, settings, options))
        return sweep(self, named(values), study, together, workers_of(workers, ALONE))

    @checked
    def montecarlo(
        self, vary: Mapping[str, str | Distribution], of: str | tuple[str, ...] = "modes", samples: int = 1000,
        experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        workers: Workers | Submitting | int | None = None, **options: Unpack[MonteCarloKeywords],
    ) -> MonteCarlo:  # fmt: skip
        """Compute the effect of tolerances at `samples` quasi-random points, with statistics, Sobol indices and swings.

        `of`: equilibrium (outputs at equilibrium), modes (frequencies) or simulate (outputs at the end). `vary`: distributions by parameter, as texts:
        `normal(1.95 um, 50 nm)`, `lognormal(mean, standard deviation)`, `uniform(low, high)`, `triangular(low, most likely, high)`,
        `truncated(one of these, low, high)`. `correlations`: by pairs of names, of a Gaussian copula. `seed` of the sample. `indices`: number of rows for
        Sobol indices, a power of two (None: up to 1024; 0: none). `workers` as in `run` (None: all cores).
        `outputs`: only these; `to`: where runs end; `rtol`: their tolerance.
        Failed points are reported and not in the statistics. Raises `UsageError`, `CompilationFailed`, and `RunFailed` if all fail.
        """
        from ..studies.montecarlo import montecarlo
        from ..studies.workers import Workers, workers_of

        pairs = tuple((options.get("correlations") or {}).items())
        chance = MonteCarloRequest(
            tuple(named(vary).items()), pairs, samples, options.get("seed", 0), options.get("indices")
        )
        chosen = {name: options.get(name) for name in ("to", "rtol", "outputs")}
        request = _request(experiment, settings, chosen | {"points": 2 if "simulate" in of else None})
        return montecarlo(self, chance, _study(of, request), workers_of(workers, Workers()))

    @checked
    def benchmark(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, error: float = 1e-6, to: str | float | None = None,
        **options: Unpack[BenchmarkKeywords],
    ) -> WorkPrecision:  # fmt: skip
        """Run an experiment with every solver at tolerances from 1e-3 to 1e-12: times, errors beside a reference, and the fastest with the wanted `error`.

        `error` is relative to the largest magnitude of each output. `rounds` (3) of each run, in turns, whose median time counts. `peers` (True): also
        solvers of scipy, SUNDIALS and CasADi, where they can run the same equations. `outputs`: only these. `progress` is called with what is being run. Raises
        as `simulate`.
        """
        from ..studies.benchmark import BenchmarkRequest, benchmark

        run = _request(experiment, settings, {"outputs": options.get("outputs"), "to": to})
        request = BenchmarkRequest(run, error, options.get("rounds", 3), options.get("peers", True))
        return benchmark(self, request, options.get("progress", lambda text: None))

    @checked
    def stress(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, seconds: float = 30.0, to: str | float | None = None,
        **options: Unpack[StressKeywords],
    ) -> StressTest:  # fmt: skip
        """Try an experiment with changes that must keep its results, for some `seconds`: what was tried, what held, what broke.

        The text: other units, order, names, bonds, wrapped as an instance; the run: other solvers, back-ends, tolerances, a finer search for events, the
        energy balance. `vary`: ranges by name, as texts (`1 N/m .. 2 N/m`), at whose corners other solvers run, too; `start NAME` is a start. `seed` of what
        is drawn. `out`: a folder for small files that show what broke. `outputs`: only these.
        `progress` is called with what is being tried. Raises as `simulate`, and OSError.
        """
        from ..studies.stress import StressRequest, stress

        run, out = _request(experiment, settings, {"outputs": options.get("outputs"), "to": to}), options.get("out")
        folder = None if out is None else Path(out)
        request = StressRequest(run, seconds, options.get("seed", 0), options.get("vary", {}), folder)
        return stress(self, request, options.get("progress", lambda text: None))

    @checked
    def fit(
        self, data: str | Path | Measurements | Sequence[str | Path | Measurements], parameters: Mapping[str, str | BoundedParameter],
        experiment: str | None = "",
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
        return fit(self, files, named(parameters), experiment, settings or {}, explain)

    @checked
    def invert_file(
        self, file: str | Path, inputs: Sequence[str], experiment: str | None = "", settings: Mapping[str, str | float] | None = None, *,
        to: str | float | None = None, workers: Workers | Submitting | int | None = None, **options: Unpack[PathKeywords],
    ) -> Outcome | FeedForward:  # fmt: skip
        """Apply `invert` to setpoints of a CSV file, whose headings are outputs with units: `x [um],phi [deg]`.

        Each line is held at equilibrium: an `Outcome` with a row of inputs for each; columns of parameters or inputs are settings of their line. With a
        column `time [s]` outputs follow the path through the lines (a spline, at rest at both ends), from the first to the last unless `start` and `to` are
        given. `start`, `points`, `moving`, `limits` as for `invert`. Raises as that, and OSError.
        """
        from ..studies.setpoints import invert_file
        from ..studies.workers import ALONE, workers_of

        along = {"to": to, **options}
        return invert_file(self, file, inputs, experiment, dict(settings or {}), along, workers_of(workers, ALONE))

    @checked
    def simulate(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, start: Result | str | Path | None = None, check: bool = False, error: bool = False,
        **options: Unpack[RunKeywords],
    ) -> Result:  # fmt: skip
        """Run an experiment ("": the first, None: none); arguments override it.

        `settings`: parameters and inputs by name, as texts with units or numbers in SI. `to`: the end, as text or s.
        `points`: equally spaced instants, both ends included (default 501).
        `start`: a result of the same model, or its .npz file, from whose end the run goes on.
        `check`: repeat the run by another method, with a tenth of the tolerance and a finer search for events; the result's `check` has the differences.
        `error`: repeat it with a tenth of the tolerance; the result's `error` has an estimate of the error of each output.
        `options`: `rtol`, `atol`, `accuracy`, `energy`, `outputs`, `target`, `solver`, `bandwidth`, `extremes`, as `RunKeywords` describes them.
        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if the numbers fail; the latter, and the `RunInterrupted` that Ctrl-C raises, have the
        `result` up to then.
        """
        from ..simulation.repetition import simulate

        if isinstance(start, str | Path):
            from ..results.archive import read_result

            before: Result | None = read_result(start)
        else:
            before = start
        if before is not None and (check or error):
            from ..errors import UsageError

            raise UsageError(
                "BR608",
                "a run that goes on from a result cannot be checked, and its error is not known:",
                "check the whole run",
            )
        chosen = {**options, "to": to, "points": points, "check": check, "error": error}
        return simulate(self, _request(experiment, settings, chosen), before)

    @checked
    def explore(
        self, vary: Mapping[str, str], experiment: str | None = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        **options: Unpack[RunKeywords],
    ) -> VBox:  # fmt: skip
        """Show a notebook's sliders for the settings to `vary`, with the plot and the summary of the run at their values.

        `vary`: ranges by name, as texts (`50 N/m .. 200 N/m`, `log 1 Hz .. 1 kHz`); a slider has the unit of its upper end. The rest is as in `simulate`.
        Raises as that, and `MissingPackage` without ipywidgets or matplotlib.
        """
        from ..presentation.explorer import SliderRange, explorer
        from ..quantities import unit_written
        from ..studies.fit_problem import sought
        from ..studies.scalar_study import quantities_of

        fixed = dict(settings or {})
        quantities = quantities_of(self, named(vary), experiment, fixed)
        ranges = [
            SliderRange(
                sought(text, quantities[name].kind, name),
                quantities[name].value,
                unit_written(text.partition("..")[2]),
                quantities[name].unit,
            )
            for name, text in named(vary).items()
        ]

        def simulate(values: Mapping[str, str | float]) -> Result:
            return self.simulate(experiment, {**fixed, **values}, to, **options)

        return explorer(simulate, ranges)

    @checked
    def simulate_many(
        self, settings: Sequence[Mapping[str, str | float]], experiment: str | None = "", to: str | float | None = None,
        points: int | None = None, workers: Workers | Submitting | int | None = None, **options: Unpack[RunKeywords],
    ) -> Ensemble:  # fmt: skip
        """Run an experiment once for each of several settings; otherwise as `simulate`, with equal results to the last bit.

        The model is compiled once. An error in a run is stored with it; the others go on. `workers` as in `run` (None: all cores); its progress counts
        finished runs, and its journal stores results in a file, from which the same call goes on after a crash.
        Raises `UsageError` for arguments with which no run is possible, `RunBroken` if a defect ended all.
        """
        from ..studies.runs import simulate_many
        from ..studies.workers import Workers, workers_of

        request = _request(experiment, None, {**options, "to": to, "points": points})
        return simulate_many(self, request, settings, workers_of(workers, Workers()))


def _request(
    experiment: str | None, settings: Mapping[str, str | float] | None, keywords: Mapping[str, Any]
) -> RunRequest:
    """Return the runs of a call with these keywords."""
    from ..simulation.run_options import RunRequest, options_of

    options = options_of(**{name: value for name, value in keywords.items() if name != "outputs"})
    return RunRequest(experiment, dict(settings or {}), names_of(keywords.get("outputs")), options)


def _study(of: str | tuple[str, ...], run: RunRequest) -> ScalarStudy:
    from ..studies.scalar_study import ScalarStudy

    return ScalarStudy((of,) if isinstance(of, str) else tuple(of), run)
