"""Bench of a stress test: one model with its unchanged runs, and the comparison of changed ones with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from compiler.api import Array, CompilationFailed, Inapplicable, Source, TextChange, TextScene, scene_of

from ..compiled_model import LIBRARY, CompiledModel
from ..compiled_scene import CompiledScene, chosen_target
from ..errors import RunFailed, UsageError
from ..quantities import behind
from ..results.result import Result
from ..results.run_check import FACTOR, ErrorEstimate
from ..simulation.repetition import compare, simulate
from ..simulation.run_options import RunRequest
from ..simulation.settings import settle

POINTS = 488  # in 487 equal parts, a prime number: no instant but the ends is where a source may jump
ROUNDING = 1e-9  # of the magnitude of an output
UNLIKE = 300  # ratio of two estimates of one error that units do not explain
CANCELS = 1e-2  # share of another output of its unit below which an output may be a difference

Estimate = Callable[[], ErrorEstimate | None]


class StressBench:
    """A model and a run of it, which is called unchanged."""

    def __init__(self, model: CompiledModel, request: RunRequest) -> None:
        options = replace(request.options, points=POINTS)
        self.model = model
        self.request = replace(request, outputs=request.outputs or model.outputs or None, options=options)
        self._bases: dict[float | None, Result] = {}

    def run(self, **changes: float | str | bool) -> Result:
        """Run with other options. Raises `RunFailed`, `UsageError`, `CompilationFailed`."""
        options = replace(self.request.options, **changes)  # type: ignore[arg-type]
        return simulate(self.model, replace(self.request, options=options))

    def base(self, rtol: float | None = None) -> Result:
        """Return the unchanged run at a tolerance (None: its own), with an estimate of its error. Raises `Inapplicable` if there is none."""
        if rtol not in self._bases:
            try:
                result = self.run(error=True) if rtol is None else self.run(error=True, rtol=rtol)
            except RunFailed as failed:
                if rtol is None:
                    raise
                raise Inapplicable(f"the unchanged run fails at rtol = {rtol:g}: {failed}") from failed
            self._bases[rtol] = self._bases[result.rtol] = result
        return self._bases[rtol]

    @cached_property
    def scene(self) -> TextScene:
        """The model as one text with the settings in it. Raises `Inapplicable`."""
        return self._scene_at({})

    def _scene_at(self, settings: Mapping[str, str]) -> TextScene:
        """Return the model as one text, with the settings of the bench and others in it. Raises `Inapplicable`."""
        base = self.base()
        if self.model.extra_outputs:
            raise Inapplicable("outputs were added to the text")
        if any(event.span.unit is not None for event in self.model.compilation().whole_graph.events):
            raise Inapplicable("an imported unit is no text")
        units = {name: p.unit for name, p in self.model.parameters.items()}
        own = self.request.settings
        texts = {n: v if isinstance(v, str) else f"{v!r} [{units.get(n, '1')}]" for n, v in own.items()}
        try:
            return scene_of(
                self.model.source, LIBRARY, (base.model, base.experiment), base.names, {**texts, **settings}
            )
        except (CompilationFailed, OSError, AssertionError) as refused:
            raise Inapplicable(f"the model cannot be written as one text: {refused}") from refused

    def run_on(self, before: Result, rtol: float) -> Result:
        """Run on from a result, for as long again."""
        options = replace(self.request.options, rtol=rtol, to=float(2 * before.time[-1] - before.time[0]))
        return simulate(self.model, replace(self.request, options=options), before)

    @cached_property
    def _target(self) -> str:
        return chosen_target(self.request.options.target)

    @cached_property
    def compiled_scene(self) -> CompiledScene:
        """The program of the unchanged run."""
        run = self.request
        settled = settle(self.model, run.experiment, run.settings, run.outputs, False, self._target)
        return self.model.compiled_scene(settled.scene, False, self._target)

    @cached_property
    def constants(self) -> Array:
        """Constants of that program, shape (K,)."""
        end, program = self.base().checkpoint, self.compiled_scene.program
        assert end is not None
        return program.constants(np.array([end.parameters[name] for name in program.parameters.names]))

    @property
    def start(self) -> Mapping[str, float]:
        """States where the unchanged run begins."""
        program = self.compiled_scene.program
        return dict(zip(program.states.names, np.asarray(program.start(self.constants)).tolist(), strict=True))

    @cached_property
    def energy_at_start(self) -> float:
        """Magnitude in J of what the storages hold where the run begins; zero where it is no function of the states."""
        run = self.request
        scene = replace(self.model.scene(run.experiment, run.settings, (), run.outputs), conserving=True)
        program = self.model.compiled_scene(scene, True, self._target).program
        if program.stored_energy is None:
            return 0.0
        constants = program.constants(np.array(program.defaults, dtype=float))
        inputs = np.array(program.input_defaults, dtype=float)
        state = np.asarray(program.start(constants), dtype=float)
        mode = program.mode_at(0.0, state, inputs, constants)
        energy = program.stored_energy(np.zeros(1), state[None, :], inputs, constants, mode)
        return float(abs(energy[0, 0]))

    def at(self, settings: Mapping[str, str]) -> StressBench:
        """Return the bench at other settings; that of `start NAME` is a start of the experiment. Raises `Inapplicable`."""
        if any(name.startswith("start ") for name in settings):
            return self.of_scene(self._scene_at(settings))
        return StressBench(self.model, self.request.at(settings))

    def of_scene(self, scene: TextScene) -> StressBench:
        """Return the bench of a text, whose settings are in it."""
        request = RunRequest(scene.experiment, {}, scene.outputs, self.request.options)
        bench = StressBench(self._model(scene.text, scene.model), request)
        bench.__dict__["scene"] = scene
        return bench

    def _model(self, text: str, name: str) -> CompiledModel:
        return CompiledModel(Source("changed text", text, self.model.source.path), name)

    # ------------------------------------------------------------ comparison
    def compare_text(self, base: Result, change: TextChange) -> str:
        """Return the difference of the run of a changed text, "" if there is none."""
        text, second = change.changed, change.factor("s")
        names = tuple(text.outputs(name)[0] for name in base.names)
        options = self.request.options
        options = replace(options, to=options.to if options.to is None else float(base.time[-1]) * second)
        bench = StressBench(self._model(text.text, text.model), RunRequest(text.experiment, {}, names, options))

        def changed_run() -> Result:
            result = bench.run(rtol=base.rtol)
            values = [result[n] / change.factor(c.unit) for n, c in zip(names, base.columns, strict=True)]
            events = tuple(replace(e, time=e.time / second) for e in result.events)
            return replace(result, columns=base.columns, values=np.transpose(values), time=base.time, events=events)

        def estimate() -> ErrorEstimate | None:
            own = bench.run(rtol=base.rtol, error=True).error
            if own is None:
                return None
            rows = [
                replace(row, name=c.name, difference=own.of(n) / change.factor(c.unit))
                for n, c in zip(names, base.columns, strict=True)
                for row in own.outputs
                if row.name == n
            ]
            return replace(own, outputs=tuple(rows))

        sentence = self.compare_run(base, changed_run, estimate, FACTOR * base.rtol)
        certain, own = (base.error, estimate()) if second != 1.0 and not sentence else (None, None)
        return sentence if certain is None or own is None else _other_errors(certain, own, FACTOR * base.rtol)

    def compare_run(self, base: Result, run: Callable[[], Result], estimate: Estimate, cap: float = math.inf) -> str:
        """Return the difference of a changed run, "" if there is none; a run that fails where the unchanged one succeeds is a difference.

        `cap`: largest relative difference that the `estimate` of the changed run's error can excuse.
        """
        try:
            other = run()
        except (RunFailed, UsageError) as failed:
            return f"the run fails: {failed}"
        except CompilationFailed as failed:
            return f"the text does not compile: {str(failed).splitlines()[0]}"
        return difference(base, other, estimate, cap)


def _other_errors(certain: ErrorEstimate, own: ErrorEstimate, cap: float) -> str:
    """Return a sentence on an output whose estimated error changes far with the units and is larger than the tolerance covers, "" if there is none."""
    if certain.failure or own.failure:
        return ""
    for row in certain.outputs:
        errors = sorted((row.difference, own.of(row.name)))
        if (
            0 < errors[0] < errors[1] / UNLIKE and errors[1] > cap * row.magnitude
        ):  # 0: it rests there, to rounding here
            return f"the estimated error of `{row.name}` is {errors[0]:.3g}{behind(row.unit)} in some units and {errors[1]:.3g} in others"
    return ""


def difference(base: Result, other: Result, estimate: Estimate, cap: float = math.inf) -> str:
    """Return a sentence on the largest difference of two runs that their errors do not cover, "" if there is none."""
    certain = base.error
    assert certain is not None
    if certain.failure:
        return ""
    last = -1 if min(len(base.time), len(other.time)) > 1 else None  # sources may jump at the end
    inner = [replace(r, time=r.time[:last], values=r.values[:last]) for r in (base, other)]
    check = compare(inner[0], inner[1], other.rtol)
    if check.events[0] != check.events[1]:
        return f"{check.events[0]} events acted in the unchanged run and {check.events[1]} in the changed one"
    largest = {c.unit: max(r.magnitude for r in check.outputs if r.unit == c.unit) for c in base.columns}
    own: ErrorEstimate | None = None
    for row in check.outputs:
        allowed = FACTOR * certain.of(row.name) + ROUNDING * max(row.magnitude, CANCELS * largest[row.unit])
        if not row.difference <= allowed:
            own = own or estimate()
            excused = 0.0 if own is None or own.failure else FACTOR * own.of(row.name)
            allowed = max(allowed, min(excused, cap * max(row.magnitude, CANCELS * largest[row.unit])))
        if not row.difference <= allowed:
            return (
                f"`{row.name}` differs by {row.difference:.3g}{behind(row.unit)}, {row.share:.2g} of its magnitude; the errors of both runs cover "
                f"{allowed:.3g}{behind(row.unit)}"
            )
    if check.shift > check.allowed:
        return f"an event acted {check.shift:.3g} s earlier or later; the tolerance covers {check.allowed:.3g} s"
    return ""
