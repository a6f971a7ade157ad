"""What is asked of a model without running it: rest, linear models, modes, responses, branches, inputs for outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

from .compiled import Compiled, names_of

if TYPE_CHECKING:
    from pathlib import Path

    from ..analysis.branch import Branch
    from ..analysis.equilibrium import Equilibrium
    from ..analysis.inversion.feed_forward import FeedForward
    from ..analysis.inversion.static import Inversion
    from ..analysis.linear import Linearization
    from ..analysis.linear_sensitivity import ResponseSensitivity
    from ..analysis.modes import Modes
    from ..analysis.operating_point import Asked, OperatingPoint
    from ..analysis.outcome import Outcome
    from ..analysis.port_hamiltonian import PortHamiltonian, SymbolicPortHamiltonian
    from ..analysis.response import Measured, Response
    from ..analysis.run_sensitivity import RunSensitivity
    from ..analysis.sensitivity import Sensitivity
    from ..studies.sharing import Sharing


class Analysed(Compiled):
    """The part of a model that analyses it."""

    def port_hamiltonian(
        self,
        state: Mapping[str, float] | None = None,
        settings: Mapping[str, str | float] | None = None,
        time: float = 0.0,
    ) -> PortHamiltonian:
        """E x' = (J - R) z + G u with E' z = grad H at a state (by name, in SI; the rest at its start), J skew, R not negative.

        Raises `UsageError` for what has no such form (mechanisms, heat from loss) and where resistors create energy.
        """
        from ..analysis.port_hamiltonian import port_hamiltonian

        compilation = self.compilation(self.scene(None, settings), everything=True)
        return port_hamiltonian(compilation, state or {}, time)

    def symbolic_port_hamiltonian(self) -> SymbolicPortHamiltonian:
        """J, R, G and H in sympy, for linear resistors and no storage in derivative form. Raises `UsageError`."""
        from ..analysis.port_hamiltonian import symbolic_port_hamiltonian

        return symbolic_port_hamiltonian(self._with_inputs())

    def operating_point(self, asked: Asked | None = None) -> OperatingPoint:
        """The model at one state and instant, with the slopes of everything; what the analyses below stand on.

        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if there is no such state.
        """
        from ..analysis.operating_point import Asked, operating_point

        return operating_point(self._whole, asked or Asked())

    def equilibrium(
        self, experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        outputs: Sequence[str] | None = None, time: float | None = None,
    ) -> Equilibrium:  # fmt: skip
        """The state of rest that is reached from the start, inputs held as they are at `time` (s; None: where the experiment begins).

        `experiment`: None none, "" the first; what it sets and where it starts counts. Raises as `operating_point`.
        """
        from ..analysis.equilibrium import equilibrium
        from ..analysis.operating_point import Asked

        return equilibrium(self.operating_point(Asked(experiment, settings, names_of(outputs), time=time)))

    def linearize(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        state: str | Mapping[str, float] = "equilibrium", time: float | None = None,
    ) -> Linearization:  # fmt: skip
        """A, B, C, D by the exact derivatives of the equations, from `inputs` (None: the model's; parameters and signals may be such,
        too) to `outputs` (None: all), at the equilibrium, the "start", or given states (by name, in SI). Raises as `operating_point`."""
        from ..analysis.linear import linearization
        from ..analysis.operating_point import Asked

        by = self.inputs if inputs is None else tuple(inputs)
        return linearization(self.operating_point(Asked(experiment, settings, names_of(outputs), by, state, time)))

    def modes(
        self, experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        state: str | Mapping[str, float] = "equilibrium", time: float | None = None,
    ) -> Modes:  # fmt: skip
        """Frequencies (Hz), damping, shapes and the energy of each element, at the equilibrium, the "start" or given states."""
        from ..analysis.modes import modes
        from ..analysis.operating_point import Asked

        return modes(self.operating_point(Asked(experiment, settings, state=state, time=time)))

    def sensitivity(
        self, parameters: Sequence[str] | None = None, of: str | tuple[str, ...] = ("equilibrium", "modes"),
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, outputs: Sequence[str] | None = None,
        time: float | None = None,
    ) -> Sensitivity:  # fmt: skip
        """Derivatives of outputs at rest and of frequencies and damping by parameters or inputs (None: all parameters that follow
        from no others), exact. One that follows from others is taken by itself, the others held. Raises as `operating_point`."""
        from ..analysis.operating_point import Asked
        from ..analysis.sensitivity import independent, sensitivity

        by, fixed = independent(self._whole, names_of(parameters), experiment, settings or {})
        point = self.operating_point(Asked(experiment, fixed, names_of(outputs), by, time=time))
        return sensitivity(point, (of,) if isinstance(of, str) else of)

    def sensitivity_of_response(
        self, parameters: Sequence[str] | None = None, inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None, low: float | None = None, high: float | None = None, points: int = 400,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, time: float | None = None,
    ) -> ResponseSensitivity:  # fmt: skip
        """Derivatives of the frequency response at rest by parameters (None: all that follow from no others), exact, from `low` to `high` in Hz.
        Raises as `response`."""
        from ..analysis.linear_sensitivity import response_sensitivity

        point, given, by = self._moved_linear(
            names_of(parameters), names_of(inputs), names_of(outputs), experiment, settings, time
        )
        return response_sensitivity(point, given, by, low, high, points)

    def sensitivity_of_linearization(
        self, parameters: Sequence[str] | None = None, inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None, experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        time: float | None = None,
    ) -> Sensitivity:  # fmt: skip
        """Derivatives of the entries of A, B, C and D at rest, named `A[row, column]`, by parameters (None: all that follow from no others),
        exact. Raises as `linearize`, and `UsageError` where closing joints tie coordinates."""
        from ..analysis.linear_sensitivity import linear_sensitivity

        point, given, by = self._moved_linear(
            names_of(parameters), names_of(inputs), names_of(outputs), experiment, settings, time
        )
        return linear_sensitivity(point, given, by)

    def _moved_linear(
        self, parameters: tuple[str, ...] | None, inputs: tuple[str, ...] | None, outputs: tuple[str, ...] | None, experiment: str | None,
        settings: Mapping[str, str | float] | None, time: float | None,
    ) -> tuple[OperatingPoint, tuple[str, ...], tuple[str, ...]]:  # fmt: skip
        """The model at rest with the slopes by inputs and parameters, and what these are."""
        from ..analysis.operating_point import Asked
        from ..analysis.sensitivity import independent

        given = self.inputs if inputs is None else inputs
        by, fixed = independent(self._whole, parameters, experiment, settings or {})
        both = tuple(dict.fromkeys((*given, *by)))
        return self.operating_point(Asked(experiment, fixed, outputs, both, time=time)), given, by

    def sensitivity_of_run(
        self, parameters: Sequence[str] | None = None, experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        to: str | float | None = None, points: int = 101, outputs: Sequence[str] | None = None, rtol: float = 1e-8,
    ) -> RunSensitivity:  # fmt: skip
        """Derivatives of a run's outputs at all instants by parameters or inputs, integrated beside the states (no differences). Steps whose
        instants move with a parameter count. Raises as `simulate`, and `UsageError` for events and delays."""
        from ..analysis.run_sensitivity import run_sensitivity

        return run_sensitivity(
            self._whole, names_of(parameters), experiment, settings or {}, names_of(outputs), None, to, points, rtol
        )

    def continuation(
        self, parameter: str, low: str | float, high: str | float, points: int = 50, most: int = 2000, experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, outputs: Sequence[str] | None = None, branches: bool = False,
    ) -> Branch:  # fmt: skip
        """The branch of states of rest from `low` towards `high` of a parameter or input, round its folds, until it leaves that range
        or has `most` points; `points` is the range over the first step. `branches`: those that cross it too. Raises as `operating_point`."""
        from ..analysis.branch import follow
        from ..analysis.operating_point import Asked
        from ..analysis.sensitivity import independent
        from ..quantities import quantity

        _, fixed = independent(self._whole, (parameter,), experiment, settings or {})
        unit = self.compilation(self.scene(experiment, settings)).whole_graph.quantities[parameter].unit
        first, last = (quantity(v, unit, parameter) if isinstance(v, str) else float(v) for v in (low, high))
        asked = Asked(experiment, {**fixed, parameter: first}, names_of(outputs), (parameter,))
        return follow(self.operating_point(asked), parameter, first, last, points, most, branches)

    @overload
    def invert(
        self, targets: Mapping[str, str | float], inputs: Sequence[str], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None,
    ) -> Inversion: ...  # fmt: skip

    @overload
    def invert(
        self, targets: Mapping[str, Any], inputs: Sequence[str], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, *, to: str | float, start: str | float = 0.0, points: int = 501,
        moving: bool = False, limits: Mapping[str, str | float] | None = None,
    ) -> FeedForward: ...  # fmt: skip

    def invert(
        self, targets: Mapping[str, Any], inputs: Sequence[str], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, *, to: str | float | None = None, start: str | float = 0.0, points: int = 501,
        moving: bool = False, limits: Mapping[str, str | float] | None = None,
    ) -> Inversion | FeedForward:  # fmt: skip
        """Inputs that give outputs. Of `inputs`, `push1/pull1` is a pair of which one is zero; there are as many inputs or pairs as targets.

        Without `to`: inputs that hold outputs at their `targets` (texts with units, or SI), at rest. With it: inputs over time, from `start`
        to `to`, with which outputs go along `targets`: expressions of time such as "8 um*smoothstep9(time, 0 s, 5 ms)", or points
        (times, values); from rest, unless the model is `moving`. `limits`: how large inputs may be. Raises as `operating_point`,
        `RunFailed` if there are none, and `UsageError` where a path is not smooth enough.
        """
        from ..analysis.inversion.asking import inverted

        along = None if to is None else (start, to, points, moving, limits or {})
        return inverted(self._whole, targets, inputs, experiment, dict(settings or {}), along)

    def invert_file(
        self, file: str | Path, inputs: Sequence[str], experiment: str | None = None, settings: Mapping[str, str | float] | None = None, *,
        to: str | float | None = None, start: str | float | None = None, points: int = 501, moving: bool = False,
        limits: Mapping[str, str | float] | None = None, sharing: Sharing | None = None,
    ) -> Outcome | FeedForward:  # fmt: skip
        """`invert` with setpoints of a CSV file, whose headings are outputs with units: `x [um],phi [deg]`.

        Each line is held at rest: an `Outcome` with a row of inputs for each; columns of parameters or inputs are set in their line. With a
        column `time [s]` outputs go along the path through the lines (a spline, at rest at both ends), from the first to the last unless `start`
        and `to` say so. Raises as `invert`, and OSError.
        """
        from ..studies.setpoints import invert_file

        along = {"to": to, "start": start, "points": points, "moving": moving, "limits": limits or {}}
        return invert_file(self._whole, file, inputs, experiment, dict(settings or {}), along, sharing)

    def response(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None,
        low: float | None = None, high: float | None = None, points: int = 400, experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, state: str | Mapping[str, float] = "equilibrium", time: float | None = None,
    ) -> Response:  # fmt: skip
        """The frequency response, exact from the linear model, from `low` to `high` in Hz (None: a decade around its modes); of a sampled loop
        (`every`) with its hold, up to half the rate of its samples."""
        from ..analysis.linear import linearization
        from ..analysis.operating_point import Asked
        from ..analysis.response import response
        from ..analysis.sampled import is_sampled, sampled_response

        by = self.inputs if inputs is None else names_of(inputs) or ()
        point = self.operating_point(Asked(experiment, settings, names_of(outputs), by, state, time))
        if is_sampled(point):
            return sampled_response(point, low, high, points)
        return response(linearization(point), low, high, points)

    def excite(
        self, given: str, seen: str, frequency: float, amplitude: float, experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, rtol: float = 1e-9,
    ) -> Measured:  # fmt: skip
        """One point of a frequency response as an experimenter finds it: `given` moves harmonically about its value, by `amplitude` in
        SI, until all transients are gone, and `seen` is taken apart into harmonics. Raises as `simulate`, and `UsageError` if it never settles."""
        from ..analysis.excitation import excite

        return excite(self._whole, given, seen, frequency, amplitude, experiment, dict(settings or {}), rtol)
