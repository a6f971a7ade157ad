"""One run: the plan and what overrides it, the program, the solver, the result."""

from __future__ import annotations

import time as clock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..door import (
    SECOND,
    Assignment,
    Compilation,
    CompilationFailed,
    Literal,
    Plan,
    Program,
    Scene,
    Source,
    Unsupported,
    evaluate,
    parse_expression,
    read_unit,
)
from ..errors import RunFailed, UsageError
from ..results import Column, EnergyBalance, Result
from .energy import energy_balance
from .finite import check_finite
from .integrate import Tolerances, Trajectory, integrate
from .nominal import nominal_magnitudes
from .rest import equilibrium
from .segments import mode_after, segments
from .start import consistent_start
from .validity import Watch

if TYPE_CHECKING:
    from ..model import Model

DEFAULT_RTOL = 1e-6
DEFAULT_POINTS = 501


def simulate(
    model: Model,
    scene: Scene,
    to: str | float | None,
    points: int | None,
    rtol: float | None,
    atol: float | None,
    energy: bool,
) -> Result:
    """Run a scene of a model; arguments that are not None override the experiment."""
    began = clock.perf_counter()
    compilation = model.compilation(scene, everything=energy)
    plan = compilation.plan
    if plan.unsupported:
        raise CompilationFailed(
            [
                Unsupported(
                    span, f"`{word}` in an experiment", "Run another experiment with -e, or none with `-e none`."
                )
                for span, word in plan.unsupported
            ]
        )
    stop = _stop(plan, to)
    rtol = _checked("rtol", rtol if rtol is not None else plan.settings.get("rtol", DEFAULT_RTOL), 1e-13, 0.1)
    count = points if points is not None else round(plan.settings.get("points", DEFAULT_POINTS))
    if count < 2 or count > 10_000_000:
        raise UsageError("--points is a whole number from 2 to 10 000 000")
    program = compilation.program
    instants = np.linspace(plan.start, stop, count)
    if atol is None:
        atol = plan.settings.get("atol")
    with np.errstate(all="ignore"):  # what is not finite is looked for, and told with its name
        run = _Run(compilation, model.compilation(scene), program, plan, instants, rtol, atol, energy)
        values, balance = run.go()
    columns = tuple(Column(n, u) for n, u in zip(program.outputs.names, program.outputs.units, strict=True))
    return Result(
        model.name, plan.experiment, instants, columns, values, plan.report, _solver(program), run.trajectory.steps,
        dict(run.trajectory.evaluations), rtol, clock.perf_counter() - began, balance, run.watch.warnings, compilation.certificate,
    )  # fmt: skip


def _solver(program: Program) -> str:
    if program.states.names:
        return "Radau IIA 5"
    return "Newton" if program.unknowns.names else "none"


def _stop(plan: Plan, to: str | float | None) -> float:
    stop = plan.stop if to is None else (seconds(to) if isinstance(to, str) else float(to))
    if stop is None:
        raise UsageError(
            "nothing says how long to run: give an end with --to, or an experiment with `simulate 0 .. 1 s`"
        )
    if not plan.start < stop < float("inf"):
        raise UsageError(f"the end of the run, {stop:g} s, does not lie after its start, {plan.start:g} s")
    return stop


def seconds(text: str) -> float:
    """A time as text, `20 ms`, or a bare number of seconds."""
    try:
        tree = parse_expression(Source("--to", text))
        if isinstance(tree, Literal):
            if tree.unit is None:
                return float(tree.number)
            scale = read_unit(Source("--to", tree.unit.span.text))
            if scale.dimension == SECOND:
                return scale.to_si(tree.number)
    except CompilationFailed:
        pass  # no expression, or no unit: the same answer as for a number of anything but seconds
    raise UsageError(f"`{text}` is no time: write `20 ms`, or a number of seconds")


def _checked(name: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise UsageError(f"{name} = {value:g} is outside {low:g} to {high:g}")
    return value


class _Run:
    """What one run holds while it goes."""

    def __init__(
        self,
        compilation: Compilation,
        lean: Compilation,
        program: Program,
        plan: Plan,
        instants: Any,
        rtol: float,
        atol: float | None,
        energy: bool,
    ) -> None:
        self.compilation, self.lean, self.program, self.plan = compilation, lean, program, plan
        self.instants, self.rtol, self.energy = instants, rtol, energy
        self.parameters = np.array(program.defaults, dtype=float)
        self.constants = program.constants(self.parameters)
        self.inputs = np.array(program.input_defaults, dtype=float)
        self.stretches = segments(program, self.constants, instants[0], instants[-1])
        self.state, self.moved = self._start(program, compilation)
        self.needed = self._needed()
        self.magnitude = self._magnitudes()
        self.atol, self.held = self._tolerances(atol)
        self.trajectory = Trajectory(np.empty((0, 0)))
        self.watch = Watch(program, self.constants, self.inputs, rtol)

    def _start(self, program: Program, compilation: Compilation) -> tuple[Any, tuple[str, ...]]:
        """The state at the start, unknowns of loops included, and what the author's starts moved."""
        constants = program.constants(np.array(program.defaults, dtype=float))
        state = np.asarray(program.start(constants), dtype=float)
        names = program.states.names
        if not np.isfinite(state).all():
            bad = [n for n, x in zip(names, state, strict=False) if not np.isfinite(x)]
            raise RunFailed(f"the start of {', '.join(f'`{b}`' for b in bad)} is not finite: a parameter makes it so")
        first = self.stretches[0]
        full, moved = consistent_start(program, compilation.state_space, constants, self.inputs, state, first)
        if self.plan.equilibrium:
            full = equilibrium(program, constants, self.inputs, full, first)
        return full, moved

    def _tolerances(self, atol: float | None) -> tuple[Any, Any]:
        """Absolute tolerances per state: what is given, else rtol times the magnitude; and whether it was given."""
        result = np.full(len(self.state), atol) if atol is not None else self.rtol * self.magnitude
        held = np.full(len(self.state), atol is not None)
        outputs = self.compilation.state_space.outputs
        space = self.compilation.state_space
        numbers = {
            v: i for i, v in enumerate([*(s.variable for s in space.states), *(u.variable for u in space.unknowns)])
        }
        variables = {space.variables[v].name: i for v, i in numbers.items()}
        for name, value in self.plan.tolerances.items():
            index = variables.get(name, numbers.get(outputs.get(name, -1)))
            if index is None:
                raise UsageError(
                    f"the tolerance of `{name}` cannot be held: it is no state of this run; states are {', '.join(variables)}"
                )
            result[index], held[index] = value, True
        return result, held

    def _magnitudes(self) -> Any:
        """Magnitudes of all states; those of the needed ones as in a run without an energy balance."""
        mechanisms = [n.name for n in self.compilation.graph.nodes if n.kind.value == "multibody"]
        result = nominal_magnitudes(self.program, mechanisms, self.constants, self.state, self.inputs, self.stretches)
        if not self.needed.all():
            lean = self.lean.program
            constants = lean.constants(np.array(lean.defaults, dtype=float))
            start, _ = self._start(lean, self.lean)
            result[self.needed] = nominal_magnitudes(lean, mechanisms, constants, start, self.inputs, self.stretches)
        return result

    def _needed(self) -> Any:
        """Which states and unknowns the outputs need; all of them, unless more are there for the energy balance."""
        names = (*self.program.states.names, *self.program.unknowns.names)
        if not self.energy:
            return np.ones(len(names), dtype=bool)
        lean = self.lean.program
        known = {*lean.states.names, *lean.unknowns.names}
        return np.array([n in known for n in names], dtype=bool)

    def go(self) -> tuple[Any, EnergyBalance | None]:
        """Integrate and evaluate the outputs; shape (points, outputs)."""
        program = self.program
        powers = self._powers if self.energy else None
        tolerances = Tolerances(self.rtol, self.atol, self.magnitude, self.needed, self.held)
        self.trajectory = integrate(
            program,
            self.constants,
            self.inputs,
            self.state,
            self.stretches,
            self.instants,
            tolerances,
            powers,
            self.watch,
        )
        values = self._outputs()
        space, states = self.compilation.state_space, self.trajectory.states
        check_finite(program, space, self.instants, values, states, self.parameters)
        return values, self._balance() if self.energy else None

    def _outputs(self) -> Any:
        values = np.empty((len(self.instants), len(self.program.outputs.names)))
        for stretch in self.stretches:
            chosen = (self.instants >= stretch.start) & (self.instants < stretch.stop)
            if chosen.any():
                values[chosen] = self._output(self.instants[chosen], self.trajectory.states[chosen], stretch.mode)
        last = self.stretches[-1]
        mode = mode_after(self.program, self.constants, last.stop, last)
        final = self.trajectory.states[-1:]
        self.watch.look(self.instants[-1:], mode, lambda times: np.repeat(final, len(times), axis=0))
        values[-1] = self._output(self.instants[-1], self.trajectory.states[-1], mode)
        return values

    def _output(self, times: Any, states: Any, mode: Any) -> Any:
        return self.program.output(times, states, self.inputs, self.constants, mode)

    def _powers(self, times: Any, states: Any, mode: Any) -> Any:
        return self.program.powers(times, states, self.inputs, self.constants, mode)

    def _balance(self) -> EnergyBalance:
        space, first, last = self.compilation.state_space, self.stretches[0], self.stretches[-1]
        before = self._powers(first.start, self.state, first.mode)
        after = self._powers(last.stop, self.trajectory.final, last.mode)
        work = self.trajectory.work if self.trajectory.work is not None else np.zeros(len(before))
        return energy_balance(space, work, before, after, self._arguments())

    def _arguments(self) -> dict[int, float]:
        """The values of the storages' parameters."""
        space = self.compilation.state_space
        known = dict(zip(self.program.parameters.names, self.parameters, strict=True))
        parameters = [(i, v) for i, v in enumerate(space.variables) if v.role == "parameter"]
        values: dict[Any, float] = {i: known.get(v.name, v.value or 0.0) for i, v in parameters}
        for step in space.steps:
            if isinstance(step, Assignment) and all(isinstance(a, float) or a in values for a in step.arguments):
                values[step.target] = evaluate(step.expression, values.__getitem__)
        return values
