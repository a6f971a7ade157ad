"""One run: the plan with its overrides, the program, the integrator, the result."""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from operator import index
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import SOLVERS, CompilationFailed

from ..compiled_scene import chosen_target, many_runs
from ..errors import RunFailed, UsageError
from ..numerics.threads import one_thread
from ..quantities import behind
from ..results.records import EnergyBalance, EventRecord, LimitLeft
from ..results.result import Result
from .integrators.methods import chosen_solver
from .monitors.state_selection import WORST
from .phase import Phase, PhaseOptions, SwitchedStart
from .phases.start import no_rest
from .segments.transition import PhaseTransition
from .settings import Settings, refused_with_values, settle

if TYPE_CHECKING:
    from compiler.api import Array, Plan, Program, Scene

    from ..compiled_model import CompiledModel
    from ..compiled_scene import CompiledScene
    from ..results.truncation import TruncationReport
    from .events.complementarity import Companion
    from .events.impulse import StorageJump
    from .segments.timeline import Timeline

DEFAULT_RTOL = 1e-6
LEAST_RTOL = 1e-13
RTOL = LEAST_RTOL, 0.1
ACCURACY = 1e-12, 0.1
ATOL = 1e-200, 1e200  # range in SI units: squares of values relative to it must be finite
DEFAULT_POINTS = 501
MOST_CHOICES = 1000  # changes of the state selection in one run
MOST_AT_ONCE = 100  # phases that begin at one instant
RECENT = 4  # phases back within which one of the same program decides the method that goes on


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of a run; each value that is not None overrides the experiment."""

    to: str | float | None = None
    points: int | None = None
    rtol: float | None = None
    atol: float | None = None
    energy: bool = False
    target: str | None = None
    solver: str | None = None
    bandwidth: str | float | None = None  # a frequency as text, or in Hz
    accuracy: float | None = None  # largest error of an output relative to its magnitude
    check: bool = False
    error: bool = False
    parts: int = field(default=1, kw_only=True)  # number of parts; the integrator restarts between them


def check_run_options(wanted: RunOptions) -> None:
    """Raise `UsageError` for options with which no run is possible."""
    chosen_target(wanted.target)
    chosen_solver(wanted.solver)
    if isinstance(wanted.to, str):
        seconds(wanted.to)
    if wanted.bandwidth is not None:
        hertz(wanted.bandwidth)
    if wanted.rtol is not None:
        _checked("rtol", wanted.rtol, *RTOL)
    if wanted.atol is not None:
        _checked("atol", wanted.atol, *ATOL)
    if wanted.accuracy is not None:
        _checked("accuracy", wanted.accuracy, *ACCURACY)
    if wanted.points is not None:
        _count(wanted.points)


def simulate_once(
    model: CompiledModel, experiment: str | None, settings: Settings, outputs: tuple[str, ...] | None, wanted: RunOptions, start: Result | None = None
) -> Result:  # fmt: skip
    """Run a model with some settings. `start`: a result from which the run goes on.

    A `RunFailed` or `RunInterrupted` carries the result up to the instant at which it was raised.
    """
    energy = wanted.energy or (start is not None and start.energy is not None)
    wanted = replace(wanted, target=chosen_target(wanted.target), energy=energy)
    settled = settle(model, experiment, settings, outputs, energy, wanted.target or "")
    try:
        result = run(model, settled.scene, settled.values, wanted, start)
    except RunFailed:
        # Zeros that cancel (1 m + off beside 1 m) are no divisors to the eye: the equations in which they are zero decide.
        zeros = frozenset(name for name, value in settled.values.items() if value == 0)
        settled = replace(settled, scene=replace(model.scene(experiment, settings, (), outputs), fixed=zeros))
        found = _with_zeros(model, settled.scene, wanted, start) if zeros else None
        if found is None:
            if settled.values:
                refused_with_values(model, experiment, settings, outputs)
            raise
        result = found
    if not settled.scene.fixed:
        return result
    names = ", ".join(f"`{n} = 0`" for n in sorted(settled.scene.fixed))
    note = f"{names}: the equations are others than with values that are not zero, and were made for this run"
    return replace(result, notes=(*result.notes, note))


def _with_zeros(model: CompiledModel, scene: Scene, wanted: RunOptions, start: Result | None) -> Result | None:
    """Run the scene in which parameters set to zero are compiled in; return None if that fails as well."""
    try:
        return run(model, scene, {}, wanted, start)
    except (CompilationFailed, RunFailed):
        return None


def run(
    model: CompiledModel, scene: Scene, values: Mapping[str, float], wanted: RunOptions, start: Result | None = None
) -> Result:
    """Run a scene of a model; `values` are parameters set when it begins."""
    began = clock.perf_counter()
    energy, target = wanted.energy, chosen_target(wanted.target)

    def made(scene: Scene, everything: bool) -> CompiledScene:
        return model.compiled_scene(scene, everything or scene.conserving, target)

    scene = _conserving(scene, wanted.solver)
    plan = made(scene, energy).plan
    many = many_runs(plan, scene)
    if many is not None:
        raise many
    instants, options, accuracy = planned(plan, wanted, values)
    scene = _conserving(scene, options.solver)
    compiled_scene = made(scene, energy)
    before = None if start is None else start.checkpoint
    if before is not None and scene.from_start and before.identity != compiled_scene.facts.identity:
        scene = replace(scene, from_start=False)  # what nothing excites here may have moved in a run of other starts
        compiled_scene = made(scene, energy)
    run = PhaseSequence(made, scene, options, instants, began)
    run.accuracy = accuracy
    if start is not None:
        from .resume import resumed

        run.scene, run.begin, run.instants = resumed(start, made, scene, values, compiled_scene, energy, run.instants)
        run.before = start
    try:
        program = compiled_scene.program
        # values that are not finite are searched and reported by name
        with np.errstate(all="ignore"), one_thread(len(program.states.names) + len(program.unknowns.names)):
            run.go()
    except RunFailed as failed:
        failed.result = run.cut(f"it failed: {failed}")
        raise
    except KeyboardInterrupt:
        result = run.cut("it was interrupted")
        if result is None:
            raise
        from ..errors import RunInterrupted

        interrupted = RunInterrupted(f"interrupted at t = {run.reached:.9g} s")
        interrupted.result = result
        raise interrupted from None
    except UsageError:  # the requested solver cannot run this model
        raise
    except CompilationFailed as failed:
        if not run.legs:
            raise
        raise _uncompiled(run, failed) from failed
    except Exception as broken:
        if run.leg is None:  # no phase has begun: the exception passes on unchanged
            raise
        from ..errors import RunBroken

        what = f"{type(broken).__name__}: {broken}"
        result = run.cut(f"it broke off: {what}")
        error = RunBroken("BR710", f"{what}, after t = {run.reached:.9g} s")
        error.result = result
        raise error from broken
    return run.result("")


def planned(plan: Plan, wanted: RunOptions, values: Mapping[str, float]) -> tuple[Any, PhaseOptions, float | None]:
    """Return the reported instants of a run, the options of its phases, and its accuracy if there is one. Raises `UsageError`."""
    stop = _stop(plan, wanted.to)
    solver = chosen_solver(wanted.solver if wanted.solver is not None else plan.solver)
    rtol, accuracy = _rtol(plan, wanted)
    count = _count(wanted.points if wanted.points is not None else round(plan.settings.get("points", DEFAULT_POINTS)))
    atol = wanted.atol if wanted.atol is not None else plan.settings.get("atol")
    if atol is not None:
        _checked("atol", atol, *ATOL)
    bandwidth = plan.bandwidth if wanted.bandwidth is None else hertz(wanted.bandwidth)
    options = PhaseOptions(plan, rtol, atol, wanted.energy, values, solver, bandwidth, wanted.parts)
    return np.linspace(plan.start, stop, count), options, accuracy


def _rtol(plan: Plan, wanted: RunOptions) -> tuple[float, float | None]:
    """Return the tolerance of a run, and its accuracy if there is one, from which the tolerance is chosen."""
    rtol, accuracy = wanted.rtol, wanted.accuracy
    if accuracy is None:
        accuracy = plan.settings.get("accuracy")
    else:
        _checked("accuracy", accuracy, *ACCURACY)
    if rtol is None and accuracy is not None:
        rtol = max(min(accuracy / 10, plan.settings.get("rtol", accuracy)), LEAST_RTOL)
    return _checked("rtol", rtol if rtol is not None else plan.settings.get("rtol", DEFAULT_RTOL), *RTOL), accuracy


def _conserving(scene: Scene, solver: str | None) -> Scene:
    """Return the scene compiled for this solver: with or without the stored energy."""
    wanted = solver in SOLVERS and SOLVERS[solver].conserving
    return scene if scene.conserving == wanted else replace(scene, conserving=wanted)


def _uncompiled(run: PhaseSequence, failed: CompilationFailed) -> RunFailed:
    """Return the failure of a run whose model has no equations after junctions went on or off, or after another state selection."""
    begin = run.begins_now
    off = () if begin is None or begin.off is None else begin.off
    how = f" without {', '.join(f'`{name}`' for name in off)}" if off else " with other states"
    told = "; ".join(d.sentence for d in failed.diagnostics[:3])
    time = run.reached if begin is None else begin.time
    found = RunFailed("BR709", f"at t = {time:.9g} s the model goes on{how}, and then has no equations: {told}")
    found.result = run.cut(f"it failed: {found}")
    return found


class PhaseSequence:
    """One run: its phases so far, and the beginning of the next one."""

    def __init__(
        self, made: Callable[[Scene, bool], CompiledScene], scene: Scene, options: PhaseOptions, instants: Array, began: float
    ) -> None:  # fmt: skip
        self.made, self.scene, self.options, self.began = made, scene, options, began
        self.plan, self.values, self.energy = options.plan, options.values, options.energy
        self.instants, self.stop = instants, float(instants[-1])
        self.legs: list[Phase] = []
        self.leg: Phase | None = None  # the phase that is being integrated
        self.begin: PhaseTransition | None = None
        self.begins_now: PhaseTransition | None = None  # transition into the next phase
        self.accuracy: float | None = None
        self.before: Result | None = None  # the result from which this run goes on

    def go(self) -> None:
        """Integrate all phases, to the end. Raises `RunFailed`."""
        wishes, tried = dict(self.scene.preferences), set[SwitchedStart]()
        begin, left, legs = self.begin, self.instants, self.legs
        companion, modes = self._companion(), dict[str, float]()
        smooth: dict[Program, Timeline] = {}  # the segments of programs used before
        while not legs or begin is not None:
            self.leg = None
            preferences = tuple(sorted(wishes.items()))
            chosen = (
                self.scene if preferences == self.scene.preferences else replace(self.scene, preferences=preferences)
            )
            try:
                leg = Phase(
                    self.made(chosen, self.energy), left, self.options, begin, companion, modes, smooth
                )  # fmt: skip
            except RunFailed:
                if legs or modes or begin is not None or companion is None or not companion.valves:
                    raise
                # with the valves blocked as written, the start values may be impossible
                from .events.begin import conducting_at_start

                modes, off = conducting_at_start(self.made(self.scene, self.energy), companion, self.plan.start)
                self.scene = replace(self.scene, off=off)
                continue
            again = None if legs else leg.begins_again(self.plan.equilibrium)
            if again is not None and again not in tried:  # the first guess was wrong: start again
                tried.add(again)
                self.scene, modes = replace(self.scene, off=again[0]), dict(again[1])
                continue
            if again is not None and self.plan.equilibrium:
                raise no_rest()
            leg.held = legs[-1].held if legs else None
            alike = (other.trajectory.settled for other in reversed(legs[-RECENT:]) if other.program is leg.program)
            leg.trajectory.settled = next(alike, None)
            self.leg = leg
            leg.go()
            legs.append(leg)
            before, begin, left = begin, leg.trajectory.handover, left[len(leg.values) :]
            if begin is None:
                break
            if begin.dependent:
                wishes |= {begin.dependent: "integral", begin.state: "derivative"}
                _check_choice(self.made, self.scene, wishes, begin, len(legs))
            self.begins_now = begin
            if begin.off is not None:
                self.scene = replace(self.scene, off=begin.off)
            self._check_progress(begin)
            begin = _with_earlier(begin, before, leg)

    def _check_progress(self, begin: PhaseTransition) -> None:
        """Raise `RunFailed` where junctions go on and off without end at one instant."""
        last = self.legs[-MOST_AT_ONCE:]
        if len(last) == MOST_AT_ONCE and last[0].stretches[0].start == begin.time:
            names = ", ".join(f"`{n}`" for n in sorted({*(begin.off or ())} | {n for leg in last for n in leg.off}))
            raise RunFailed(
                "BR707", f"at t = {begin.time:.9g} s junctions go on and off without end ({names}): no set of them agrees with its own conditions;",
                "give them a hysteresis, or put a resistor or a storage beside them",
            )  # fmt: skip

    def _companion(self) -> Companion | None:
        """Return the companion model of the switched junctions, if valves or integrals need it."""
        facts = self.made(self.scene, self.energy).facts
        if not facts.valves and not facts.integrals:
            return None
        from .events.begin import companion_of

        return companion_of(self.made, self.scene, facts, self.values, (self.plan.start, self.stop))

    def cut(self, why: str) -> Result | None:
        """Return the certain part of a run that broke off; None if it had not begun."""
        leg = self.leg
        if leg is not None and (not self.legs or self.legs[-1] is not leg):
            try:
                with np.errstate(all="ignore"):
                    leg.cut()
            except RunFailed:
                leg.values = None
            if leg.values is not None:
                self.legs.append(leg)
        return self.result(why) if self.legs else None

    @property
    def reached(self) -> float:
        """Time that the run has reached."""
        kept = self.legs[-1].trajectory.kept if self.legs else None
        return self.plan.start if kept is None else kept.time

    def result(self, stopped: str) -> Result:
        """Return all phases as one result, joined with the result from which the run went on."""
        legs, plan = self.legs, self.plan
        program = legs[0].program
        columns = legs[0].compilation.columns
        evaluations: Counter[str] = Counter()
        for leg in legs:
            evaluations.update(leg.trajectory.evaluations)
        values = legs[0].values if len(legs) == 1 else np.concatenate([leg.values for leg in legs])
        with np.errstate(all="ignore"):  # a run may end where a quantity has no value
            end = legs[-1].end(self.stop)
        time, halted = self.instants[: len(values)], legs[-1].trajectory.stopped
        if halted is not None:
            time = np.append(time[:-1], halted)
        if 2 * len(time) < len(self.instants):  # the run broke off: do not keep the memory of the others
            time = time.copy()
        balance = None
        if self.energy:
            from .monitors.energy import added

            balance = added([leg.balance for leg in legs if leg.balance is not None])
        lacking, acted = _left_out(legs, balance), tuple(o for leg in legs for o in leg.occurrences)
        told = () if lacking is None else (lacking.sentence({column.name: column.unit for column in columns}),)
        found = Result(
            program.name, plan.experiment, time, columns, values, plan.report, _solver(program, legs),
            sum(leg.trajectory.steps for leg in legs), dict(evaluations), self.options.rtol, clock.perf_counter() - self.began,
            balance, _warnings(legs), legs[0].compilation.certificate,
            tuple(dict.fromkeys([*(note for leg in legs for note in (*leg.start_notes, *leg.notes)), *told, *_impulses(legs), *_halts(acted)])),
            acted, stopped, end, lacking, accuracy=self.accuracy,
        )  # fmt: skip
        if self.before is None:
            return found
        from .resume import joined

        return joined(self.before, found)


def _halts(acted: Sequence[EventRecord]) -> Iterator[str]:
    """Yield a note on each condition that ended the run."""
    for event in acted:
        if event.stops:
            yield f"at t = {event.time:.9g} s `stop when {event.condition}` ({event.place}) ended the run"


def _left_out(legs: Sequence[Phase], balance: EnergyBalance | None) -> TruncationReport | None:
    """Return the joined truncation report of all phases, with the removed energy; None if nothing was truncated."""
    from ..results.truncation import joined

    found = None
    for leg in legs:
        found = joined(found, leg.left_out)
    if found is None or balance is None:
        return found
    from .monitors.energy import LEFT_OUT

    return replace(found, energy=sum(e.dissipated for e in balance.elements if e.name == LEFT_OUT))


def _with_earlier(begin: PhaseTransition, before: PhaseTransition | None, leg: Phase) -> PhaseTransition:
    """Return a handover completed by data of earlier programs: a state that is constant in one program may move in the next."""
    begin = replace(begin, stored={**dict.fromkeys(leg.compilation.certificate.unexcited, 0.0), **begin.stored})
    if before is not None:
        begin = replace(begin, stored={**before.stored, **begin.stored}, peaks={**before.peaks, **begin.peaks})
    past = None if leg.history is None else leg.history.past()
    return replace(begin, magnitudes=leg.known, past=past)


def _impulses(legs: Sequence[Phase]) -> Iterator[str]:
    """Yield a note on each stored quantity that jumped where junctions went on or off, at its first instant."""
    told: dict[str, tuple[StorageJump, float, int]] = {}
    for leg in legs:
        for jump in leg.jumps:
            first, time, count = told.get(jump.name, (jump, leg.stretches[0].start, 0))
            told[jump.name] = first, time, count + 1
    for jump, time, count in told.values():
        often = f" ({count} times in all)" if count > 1 else ""
        unit = behind(jump.unit)
        yield (
            f"at t = {time:.9g} s an impulse takes `{jump.name}` from {jump.before:.6g}{unit} to {jump.after:.6g}{unit}"
            f"{often}: a junction that goes on or off ties it to other storages, or holds it"
        )


def _check_choice(
    made: Callable[[Scene, bool], CompiledScene],
    scene: Scene,
    wishes: Mapping[str, str],
    begin: PhaseTransition,
    times: int,
) -> None:
    """Raise `RunFailed` if the other state selection is not possible."""
    try:
        chosen = made(replace(scene, preferences=tuple(sorted(wishes.items()))), False)
        possible = times <= MOST_CHOICES and begin.dependent not in chosen.state_space.dependent
    except CompilationFailed:
        possible = False
    if not possible:
        raise RunFailed(
            "BR708", f"at t = {begin.time:.9g} s `{begin.dependent}` follows from `{begin.state}` so steeply that its error would be {WORST:g} times "
            f"that of `{begin.state}`, and no other choice of states is possible there",
        )  # fmt: skip


def _warnings(legs: Sequence[Phase]) -> tuple[LimitLeft, ...]:
    """Return each violated limit once, at its first instant, and the first doubt about tolerances."""
    first: dict[tuple[str, str, str], LimitLeft] = {}
    for item in (w for leg in legs for w in (*leg.doubts, *leg.watch.warnings)):
        first.setdefault((item.owner, item.condition, item.place), item)
    return tuple(first.values())


def _solver(program: Program, legs: Sequence[Phase]) -> str:
    if program.states.names:
        return " and ".join(dict.fromkeys(name for leg in legs for name in leg.trajectory.solvers))
    return "Newton" if program.unknowns.names else "none"


def _stop(plan: Plan, to: str | float | None) -> float:
    stop = plan.stop if to is None else seconds(to)
    if stop is None:
        raise UsageError(
            "BR701", "nothing says how long to run:", "give an end with --to, or an experiment with `simulate 0 .. 1 s`"
        )
    if not plan.start < stop < float("inf"):
        raise UsageError("BR702", f"the end of the run, {stop:g} s, does not lie after its start, {plan.start:g} s")
    return stop


def seconds(text: str | float) -> float:
    """Return the time in s of a text such as `20 ms`, or of a bare number of seconds. Raises `UsageError`."""
    found = _number("--to", text, "s") if isinstance(text, str) else float(text)
    if found is None:
        raise UsageError("BR703", f"`{text}` is no time:", "write `20 ms`, or a number of seconds")
    return found


def hertz(given: str | float) -> float:
    """Return the frequency in Hz of a text such as `50 kHz`, or of a bare number of Hz. Raises `UsageError`."""
    found = _number("--bandwidth", given, "Hz") if isinstance(given, str) else float(given)
    if found is None or not 0 < found < float("inf"):
        raise UsageError("BR704", f"`{given}` is no bandwidth:", "write `50 kHz`, or a number of Hz")
    return found


@lru_cache(maxsize=256)  # called again at each point of a sweep
def _number(where: str, text: str, unit: str) -> float | None:
    """Return a number in SI, written bare or in a unit of the same kind as `unit`; None if the text is not a number."""
    from compiler.api import CompilationFailed, Literal, Source, parse_expression, read_unit

    try:
        tree = parse_expression(Source(where, text))
        if isinstance(tree, Literal):
            if tree.unit is None:
                return float(tree.number)
            scale = read_unit(Source(where, tree.unit.span.text))
            if scale.dimension == read_unit(Source(where, unit)).dimension:
                return scale.to_si(tree.number)
    except CompilationFailed:
        pass  # no expression, or no unit: the same answer as for a number of another kind
    return None


def _count(points: int) -> int:
    try:
        count = index(points)
    except TypeError:
        count = 0
    if not 2 <= count <= 10_000_000:
        raise UsageError("BR705", "--points is a whole number from 2 to 10 000 000")
    return count


def _checked(name: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise UsageError("BR706", f"{name} = {value:g} is outside {low:g} to {high:g}")
    return value
