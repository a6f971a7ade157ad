"""A model: its text, its stages, its runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import door
from .analysed import Analysed
from .compiled import LIBRARY, Parameter, names_of
from .shown import STAGES, Shown

if TYPE_CHECKING:
    from ..analysis.outcome import Outcome
    from ..door import Certificate, Diagnostic, Source
    from ..ensembles import Ensemble
    from ..results import Result
    from ..studies.distributions import Distribution
    from ..studies.fit import Sought
    from ..studies.fitted import Fit
    from ..studies.journal import Journal
    from ..studies.measured import Measurements
    from ..studies.sharing import Sharing
    from ..studies.tolerances import MonteCarlo

__all__ = ["LIBRARY", "STAGES", "Model", "Parameter", "certify", "check", "load"]


def load(path_or_text: str | Path, model: str | None = None) -> Model:
    """A model from a file, or from a text with at least one line break or brace.

    `model` names one of several. Nothing is compiled yet: mistakes are told when something is asked of the model, or by
    `check`. Raises OSError if the file cannot be read, `CompilationFailed` if it is not UTF-8.
    """
    return Model(_source(path_or_text), model)


def check(path_or_text: str | Path, model: str | None = None) -> tuple[Diagnostic, ...]:
    """Everything that is wrong with a file or text; empty if nothing is."""
    return certify(path_or_text, model)[0]


def certify(path_or_text: str | Path, model: str | None = None) -> tuple[tuple[Diagnostic, ...], Certificate | None]:
    """As `check`; and if nothing is wrong, what kind of equations a run solves (None for a file of parts)."""
    try:
        source = _source(path_or_text)
    except door.CompilationFailed as failed:  # it is no text
        return failed.diagnostics, None
    return door.examine(source, model, LIBRARY)


def _source(path_or_text: str | Path) -> Source:
    if isinstance(path_or_text, str) and ("\n" in path_or_text or "{" in path_or_text):
        return door.Source("text", path_or_text)
    return door.read_source(path_or_text)


class Model(Shown, Analysed):
    """One model of a text. Compiled when it is first asked; raises `CompilationFailed` with all that is wrong."""

    def run(
        self, experiment: str = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: Sequence[str] | None = None, target: str | None = None, executor: Any = None, solver: str | None = None,
        sharing: Sharing | None = None, bandwidth: str | float | None = None,
    ) -> Outcome:  # fmt: skip
        """All that an experiment says: its sweeps, analyses and simulation; "" the first. Arguments as `simulate` takes them.

        `executor`: of the standard interface (`concurrent.futures`, a Dask client): its workers make the points. `sharing`
        says more: workers of our own, a journal to go on from after a crash, progress.
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
        """`of` equilibrium, modes or simulate, or several of them, at each point of a grid of `values` (texts with units, numbers in SI, or
        one text, `1 mm .. 2 mm : 11`), the last name running fastest; `together`: the first of each, the second of each and
        so on. `executor` and `sharing` as in `run`. A point that fails is NaN in the table, and `failures` says why."""
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
        """What tolerances do: `of` equilibrium (outputs at rest), modes (frequencies) or simulate (outputs at the end) at `samples`
        quasi-random points, with statistics, Sobol indices and swings.

        `vary`: distributions by parameter, as texts: `normal(1.95 um, 50 nm)`, `lognormal(mean, standard deviation)`, `uniform(low, high)`,
        `triangular(low, most likely, high)`, `truncated(one of these, low, high)`. `correlations`: by pairs of names, of a Gaussian copula.
        `indices`: rows that Sobol indices stand on, a power of two (None: up to 1024; 0: none). `sharing`: who makes the points (None: all cores).
        Points that fail are told and in no statistic. Raises `UsageError`, `CompilationFailed`, and `RunFailed` if all fail.
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
        """The `parameters` that explain measured data best, by weighted least squares with exact derivatives; 95 % intervals, and what the
        data leave open.

        `data`: CSV files with units in their headings: what was set, and outputs at rest, `frequency 1 [Hz]` of modes, or outputs over `time [s]`;
        `sigma NAME` is the standard deviation. `parameters`: by name bounds as text (`1.5 um .. 2.5 um`, `log 1 N/m .. 100 N/m`; "": it keeps its sign).
        The search begins where the model has them, or where `settings` do. `explain`: tell which few parameters would do alone (None: if
        the data leave some open). Raises `UsageError`, `CompilationFailed`, `RunFailed`, OSError.
        """
        from ..studies.fit import fit
        from ..studies.measured import Measurements

        files: Sequence[str | Path | Measurements] = (
            [data] if isinstance(data, str | Path | Measurements) else list(data)
        )
        return fit(self, files, parameters, experiment, settings or {}, explain)

    def simulate(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: Sequence[str] | None = None, target: str | None = None, start: Result | str | Path | None = None, solver: str | None = None,
        bandwidth: str | float | None = None, check: bool = False,
    ) -> Result:  # fmt: skip
        """Run an experiment ("" the first, None none); what is given here overrides what it says.

        `settings`: parameters and inputs by name, as texts with units or numbers in SI. `to`: the end, as text or s.
        `points`: equally spaced instants, both ends included (default 501). `outputs`: only these. `energy` adds the energy
        balance. `target`: native (machine code) or numpy; the first that this machine has. `solver`: automatic, exponential
        (linear models), explicit, radau, rodas (stiff models) or energy (lossless models).
        `bandwidth`: a frequency as text or in Hz; what is faster need not be followed, and the result's `left_out` says what was not.
        `start`: a result of the same model, or its .npz file, to go on from where that ended.
        `check`: repeat the run by another method, with a tenth of the tolerance and a finer search of events; the result's `check` says what differs.
        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if the numbers fail; the latter, and the `RunInterrupted` that Ctrl-C raises, have
        the `result` up to then.
        """
        from ..errors import UsageError
        from ..results import read_result
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
        """Run an experiment once for each of several settings; all else as in `simulate`, and so is each result, to the last bit.

        The model is compiled once. What goes wrong in a run is kept with it; the others go on. `workers`: how many at once (default: as many
        as there are cores), or an `executor` of your own, of the interface of `concurrent.futures`, or a Dask client. `progress` is told how many are
        done, and of how many; `journal` keeps what is done in a file, from which the same call goes on after a crash.
        Raises `UsageError` for what no run can be made with, `RunBroken` if a defect broke all.
        """
        from ..simulation.run import Wanted
        from ..studies.runs import simulate_many
        from ..studies.sharing import Sharing

        wanted = Wanted(to, points, rtol, atol, energy, target, solver, bandwidth)
        sharing = Sharing(workers, executor, progress, journal)
        return simulate_many(self, experiment, settings, names_of(outputs), wanted, sharing)


def _sharing(sharing: Sharing | None, executor: Any) -> Sharing:
    """Who makes the points: this process, if nothing is said."""
    from ..studies.sharing import Sharing

    return sharing if sharing is not None else Sharing(workers=1, executor=executor)
