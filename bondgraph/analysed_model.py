"""Analyses of a model without a run: equilibria, linear models, modes, responses, branches, inversion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Unpack, overload

from .compiled_model import CompiledModel, named, names_of
from .keywords import AnalysisKeywords, AnalysisRequest, ExperimentKeywords, PathKeywords, PointKeywords, checked
from .numerics.threads import on_one_thread

if TYPE_CHECKING:
    from .analysis.branch import Branch
    from .analysis.equilibrium import Equilibrium
    from .analysis.inversion.feed_forward import FeedForward
    from .analysis.inversion.static import Inversion
    from .analysis.linear import Linearization
    from .analysis.linear_sensitivity import ResponseSensitivity
    from .analysis.modes import Modes
    from .analysis.operating_point import OperatingPoint
    from .analysis.port_hamiltonian import PortHamiltonian, SymbolicPortHamiltonian
    from .analysis.prices import Prices
    from .analysis.response import Measured, Response
    from .analysis.run_sensitivity import RunSensitivity
    from .analysis.sensitivity import Sensitivity


class AnalysedModel(CompiledModel):
    """A compiled model with its analyses as methods."""

    @checked
    def prices(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, outputs: Sequence[str] | None = None, seconds: float = 5.0,
    ) -> Prices:  # fmt: skip
        """Return states and operations of a run, of each of its outputs alone, and of the run where a parameter or input is zero.

        Zeros are compiled one by one, as long as `seconds` last.
        """
        from .analysis.prices import prices

        return prices(self, experiment, settings or {}, names_of(outputs), seconds)

    @checked
    def port_hamiltonian(
        self,
        state: Mapping[str, float] | None = None,
        settings: Mapping[str, str | float] | None = None,
        time: float = 0.0,
    ) -> PortHamiltonian:
        """Return E x' = (J - R) z + G u with E' z = grad H at a state (by name, in SI; the rest at its start), J skew, R positive semidefinite.

        Raises `UsageError` for models without such a form (mechanisms, heat from loss) and where resistors create energy.
        """
        from .analysis.port_hamiltonian import port_hamiltonian

        compilation = self.compilation(self.scene(None, settings), everything=True)
        return port_hamiltonian(compilation, state or {}, time)

    @checked
    def symbolic_port_hamiltonian(self) -> SymbolicPortHamiltonian:
        """Return J, R, G and H in sympy, for linear resistors and no storage in derivative form. Raises `UsageError`."""
        from .analysis.port_hamiltonian import symbolic_port_hamiltonian

        return symbolic_port_hamiltonian(self.with_inputs())

    @checked
    @on_one_thread
    def operating_point(self, asked: AnalysisRequest | None = None) -> OperatingPoint:
        """Return the model at one state and instant, with all derivatives; the analyses below use it.

        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if there is no such state.
        """
        from .analysis.placement import operating_point

        return operating_point(self, asked or AnalysisRequest())

    @checked
    @on_one_thread
    def equilibrium(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        outputs: Sequence[str] | None = None, time: float | None = None,
    ) -> Equilibrium:  # fmt: skip
        """Return the equilibrium reached from the start, with inputs held as at `time` (s; None: begin of the experiment).

        `experiment`: "": the first, None: none; its settings and start values are used. Raises as `operating_point`.
        """
        from .analysis.equilibrium import equilibrium

        return equilibrium(self.operating_point(AnalysisRequest(experiment, settings, names_of(outputs), time=time)))

    @checked
    @on_one_thread
    def linearize(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None, **options: Unpack[PointKeywords],
    ) -> Linearization:  # fmt: skip
        """Return A, B, C, D by exact derivatives of the equations, at the equilibrium, the "start", or given states (by name, in SI).

        From `inputs` (None: the model's; parameters and signals are allowed too) to `outputs` (None: all, and all states; else without the states that none of
        them depends on). `options`: `experiment`, `settings`, `state`, `time` as for `modes`. Raises as `operating_point`.
        """
        from .analysis.linear import linearization

        by = self.inputs if inputs is None else names_of(inputs) or ()
        request = AnalysisRequest(outputs=names_of(outputs), by=by, upstream=outputs is not None, **options)
        return linearization(self.operating_point(request))

    @checked
    @on_one_thread
    def modes(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        state: str | Mapping[str, float] = "equilibrium", time: float | None = None, outputs: Sequence[str] | None = None,
    ) -> Modes:  # fmt: skip
        """Return frequencies (Hz), damping, shapes and the energy of each element, at the equilibrium, the "start" or given states (`state`).

        `experiment`: its settings and start values are used ("": the first, None: none). `settings`: parameters and inputs by name. `time`: the instant at
        which inputs are held (s; None: begin of the experiment). `outputs`: only these, and only modes of the states that they depend on (None: all).
        """
        from .analysis.modes import modes

        request = AnalysisRequest(experiment, settings, names_of(outputs), (), state, time, outputs is not None)
        return modes(self.operating_point(request))

    @checked
    @on_one_thread
    def sensitivity(
        self, parameters: Sequence[str] | None = None, of: str | tuple[str, ...] = ("equilibrium", "modes"),
        outputs: Sequence[str] | None = None, **options: Unpack[AnalysisKeywords],
    ) -> Sensitivity:  # fmt: skip
        """Return exact derivatives of outputs at equilibrium, frequencies and damping by parameters or inputs (None: all independent parameters).

        A dependent parameter is treated as independent, with the others fixed. `options`: `experiment`, `settings`, `time` as for `modes`. Raises as
        `operating_point`.
        """
        from .analysis.sensitivity import sensitivity

        point, _, _ = self._moved(names_of(parameters), (), names_of(outputs), options)
        return sensitivity(point, (of,) if isinstance(of, str) else of)

    @checked
    @on_one_thread
    def sensitivity_of_response(
        self, parameters: Sequence[str] | None = None, inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None, low: float | None = None, high: float | None = None, points: int = 400,
        **options: Unpack[AnalysisKeywords],
    ) -> ResponseSensitivity:  # fmt: skip
        """Return exact derivatives of the frequency response at equilibrium by parameters (None: all independent ones), from `low` to `high` in Hz.

        `options`: `experiment`, `settings`, `time` as for `modes`. Raises as `response`.
        """
        from .analysis.linear_sensitivity import response_sensitivity

        point, given, by = self._moved(names_of(parameters), names_of(inputs), names_of(outputs), options)
        return response_sensitivity(point, given, by, low, high, points)

    @checked
    @on_one_thread
    def sensitivity_of_linearization(
        self, parameters: Sequence[str] | None = None, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None,
        **options: Unpack[AnalysisKeywords],
    ) -> Sensitivity:  # fmt: skip
        """Return exact derivatives of the entries of A, B, C and D at equilibrium, named `A[row, column]`, by parameters (None: all independent ones).

        `options`: `experiment`, `settings`, `time` as for `modes`. Raises as `linearize`, and `UsageError` where loop joints tie coordinates.
        """
        from .analysis.linear_sensitivity import linear_sensitivity

        point, given, by = self._moved(names_of(parameters), names_of(inputs), names_of(outputs), options)
        return linear_sensitivity(point, given, by)

    def _moved(
        self, parameters: tuple[str, ...] | None, inputs: tuple[str, ...] | None, outputs: tuple[str, ...] | None, options: AnalysisKeywords
    ) -> tuple[OperatingPoint, tuple[str, ...], tuple[str, ...]]:  # fmt: skip
        """Return the model at equilibrium with the derivatives by inputs and parameters, and the names of both."""
        from .analysis.sensitivity import independent

        given = self.inputs if inputs is None else inputs
        by, fixed = independent(self, parameters, options.get("experiment", ""), options.get("settings") or {})
        both = tuple(dict.fromkeys((*given, *by)))
        asked = AnalysisRequest(options.get("experiment", ""), fixed, outputs, both, time=options.get("time"))
        return self.operating_point(asked), given, by

    @checked
    @on_one_thread
    def sensitivity_of_run(
        self, parameters: Sequence[str] | None = None, experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        to: str | float | None = None, points: int = 101, outputs: Sequence[str] | None = None, rtol: float = 1e-8,
    ) -> RunSensitivity:  # fmt: skip
        """Return derivatives of a run's outputs at all instants by parameters or inputs, integrated together with the states (no differences).

        Steps at instants that depend on a parameter are included. Raises as `simulate`, and `UsageError` for events and delays.
        """
        from .analysis.run_sensitivity import run_sensitivity

        asked = AnalysisRequest(experiment, settings, names_of(outputs))
        return run_sensitivity(self, names_of(parameters), asked, (to, points), rtol)

    @checked
    @on_one_thread
    def continuation(
        self, parameter: str, low: str | float, high: str | float, points: int = 50, most: int = 2000, outputs: Sequence[str] | None = None,
        branches: bool = False, **options: Unpack[ExperimentKeywords],
    ) -> Branch:  # fmt: skip
        """Follow the branch of equilibria from `low` towards `high` of a parameter or input, through its folds, until it leaves the range.

        `most`: largest number of points; `points`: the range over the first step. `branches`: also the branches that cross it. `options`: `experiment`,
        `settings` as for `modes`. Raises as `operating_point`.
        """
        from .analysis.branch import follow
        from .analysis.sensitivity import independent
        from .quantities import quantity, refuse_two_readings

        experiment, settings = options.get("experiment", ""), options.get("settings") or {}
        (parameter,) = named({parameter: None})
        quantities = self.compilation(self.scene(experiment, settings)).whole_graph.quantities
        refuse_two_readings({parameter: (low, high)}, quantities)
        if parameter not in quantities or quantities[parameter].role != "input":
            independent(self, (parameter,), experiment, settings)  # refuses what is none
        first, last = (quantity(v, quantities[parameter].kind, parameter) for v in (low, high))
        _, fixed = independent(self, (parameter,), experiment, {**settings, parameter: first})
        asked = AnalysisRequest(experiment, {**fixed, parameter: first}, names_of(outputs), (parameter,))
        return follow(self.operating_point(asked), parameter, first, last, points, most, branches)

    @overload
    def invert(
        self, targets: Mapping[str, str | float], inputs: Sequence[str], experiment: str | None = "",
        settings: Mapping[str, str | float] | None = None,
    ) -> Inversion: ...  # fmt: skip

    @overload
    def invert(
        self, targets: Mapping[str, Any], inputs: Sequence[str], experiment: str | None = "",
        settings: Mapping[str, str | float] | None = None, *, to: str | float, **options: Unpack[PathKeywords],
    ) -> FeedForward: ...  # fmt: skip

    @checked
    @on_one_thread
    def invert(
        self, targets: Mapping[str, Any], inputs: Sequence[str], experiment: str | None = "",
        settings: Mapping[str, str | float] | None = None, *, to: str | float | None = None, **options: Unpack[PathKeywords],
    ) -> Inversion | FeedForward:  # fmt: skip
        """Return inputs for given outputs. In `inputs`, `push1/pull1` is a pair with one of them zero; there are as many inputs or pairs as targets.

        Without `to`: inputs that hold outputs at their `targets` (texts with units, or SI), at equilibrium. With it: inputs over time, from `start` (0 s) to
        `to`, at `points` (501) instants, with which outputs follow `targets`: expressions of time such as "8 um*smoothstep9(time, 0 s, 5 ms)", or points
        (times, values); from rest, unless the model is `moving`. `limits`: largest inputs. Raises as `operating_point`, `RunFailed` if there are none, and
        `UsageError` where a path is not smooth enough.
        """
        from .analysis.inversion.request import inverted

        return inverted(self, targets, inputs, AnalysisRequest(experiment, dict(settings or {})), to, options)

    @checked
    @on_one_thread
    def response(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None,
        low: float | None = None, high: float | None = None, points: int = 400, **options: Unpack[PointKeywords],
    ) -> Response:  # fmt: skip
        """Return the frequency response, exact from the linear model, from `low` to `high` in Hz (None: a decade around its modes).

        For a sampled loop (`every`) with its hold, up to half the sampling rate. `options`: `experiment`, `settings`, `state`, `time` as for `modes`.
        """
        from .analysis.linear import linearization
        from .analysis.response import response
        from .analysis.sampled import is_sampled, sampled_response

        by = self.inputs if inputs is None else names_of(inputs) or ()
        request = AnalysisRequest(outputs=names_of(outputs), by=by, upstream=outputs is not None, **options)
        point = self.operating_point(request)
        if is_sampled(point):
            return sampled_response(point, low, high, points)
        return response(linearization(point), low, high, points)

    @checked
    @on_one_thread
    def excite(
        self, given: str, seen: str, frequency: float, amplitude: float, experiment: str | None = "",
        settings: Mapping[str, str | float] | None = None, rtol: float = 1e-9,
    ) -> Measured:  # fmt: skip
        """Measure one point of a frequency response: `given` moves harmonically about its value, by `amplitude` in SI, until all transients have decayed.

        Then `seen` is decomposed into harmonics. Raises as `simulate`, and `UsageError` if it never settles.
        """
        from .analysis.excitation import excite

        asked = AnalysisRequest(experiment, dict(settings or {}), (seen,), (given,))
        return excite(self, asked, frequency, amplitude, rtol)
