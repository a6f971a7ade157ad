"""One run: the plan and what overrides it, the program, the solver, the result."""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..errors import RunFailed, UsageError
from ..prepared import chosen_target
from ..results import Column, EnergyBalance, LimitLeft, Result
from .leg import Leg
from .steps.methods import chosen_solver
from .watch.choice import WORST, Handover

if TYPE_CHECKING:
    from ..door import Plan, Program, Scene
    from ..model import Model
    from ..prepared import Prepared
    from .events.impulse import Jump

DEFAULT_RTOL = 1e-6
DEFAULT_POINTS = 501
MOST_CHOICES = 1000  # of states in one run


def simulate(
    model: Model,
    scene: Scene,
    to: str | float | None,
    points: int | None,
    rtol: float | None,
    atol: float | None,
    energy: bool,
    target: str | None = None,
    solver: str | None = None,
) -> Result:
    """Run a scene of a model; arguments that are not None override the experiment."""
    began = clock.perf_counter()
    made = partial(model.prepared, target=chosen_target(target))
    scene = replace(scene, conserving=solver == "energy")
    plan = made(scene, energy or scene.conserving).plan
    _check_supported(plan)
    stop = _stop(plan, to)
    solver = chosen_solver(solver if solver is not None else plan.solver)
    scene = replace(scene, conserving=solver == "energy")
    everything = energy or scene.conserving
    rtol = _checked("rtol", rtol if rtol is not None else plan.settings.get("rtol", DEFAULT_RTOL), 1e-13, 0.1)
    count = points if points is not None else round(plan.settings.get("points", DEFAULT_POINTS))
    if count < 2 or count > 10_000_000:
        raise UsageError("--points is a whole number from 2 to 10 000 000")
    if atol is None:
        atol = plan.settings.get("atol")
    instants = left = np.linspace(plan.start, stop, count)
    legs: list[Leg] = []
    wishes: dict[str, str] = {}
    tried: set[tuple[str, ...]] = set()
    with np.errstate(all="ignore"):  # what is not finite is looked for, and told with its name
        begin: Handover | None = None
        while not legs or begin is not None:
            chosen = replace(scene, preferences=tuple(sorted(wishes.items())))
            leg = Leg(made(chosen, everything), plan, left, rtol, atol, energy, begin, solver)
            if not legs and leg.begins_without != leg.off and leg.begins_without not in tried:
                tried.add(leg.begins_without)  # the first guess was wrong: begin anew
                scene = replace(scene, off=leg.begins_without)
                continue
            leg.held = legs[-1].held if legs else None
            leg.go()
            legs.append(leg)
            before, begin, left = begin, leg.trajectory.handover, left[len(leg.values) :]
            if begin is None:
                break
            if begin.dependent:
                wishes |= {begin.dependent: "integral", begin.state: "derivative"}
                _check_choice(made, scene, wishes, begin, len(legs))
            if begin.off is not None:
                scene = replace(scene, off=begin.off)
            begin = _with_earlier(begin, before, leg)
    program = legs[0].program
    columns = tuple(Column(n, u) for n, u in zip(program.outputs.names, program.outputs.units, strict=True))
    evaluations: Counter[str] = Counter()
    for leg in legs:
        evaluations.update(leg.trajectory.evaluations)
    return Result(
        program.name, plan.experiment, instants, columns, np.concatenate([leg.values for leg in legs]), plan.report, _solver(program, legs),
        sum(leg.trajectory.steps for leg in legs), dict(evaluations), rtol, clock.perf_counter() - began,
        _balance(legs) if energy else None, _warnings(legs), legs[0].compilation.certificate,
        tuple(dict.fromkeys([*(note for leg in legs for note in leg.notes), *_impulses(legs)])),
        tuple(o for leg in legs for o in leg.occurrences),
    )  # fmt: skip


def _balance(legs: Sequence[Leg]) -> EnergyBalance | None:
    from .watch.energy import added

    return added([leg.balance for leg in legs if leg.balance is not None])


def _with_earlier(begin: Handover, before: Handover | None, leg: Leg) -> Handover:
    """A handover with what earlier programs knew: what stands still in one may move in the next."""
    if before is not None:
        begin = replace(begin, stored=before.stored | begin.stored, peaks=before.peaks | begin.peaks)
    return replace(begin, magnitudes=leg.known, history=leg.history)


def _impulses(legs: Sequence[Leg]) -> Iterator[str]:
    """What jumped where junctions went on or off: each storage at its first instant."""
    told: dict[str, tuple[Jump, float, int]] = {}
    for leg in legs:
        for jump in leg.jumps:
            first, time, count = told.get(jump.name, (jump, leg.stretches[0].start, 0))
            told[jump.name] = first, time, count + 1
    for jump, time, count in told.values():
        often = f" ({count} times in all)" if count > 1 else ""
        unit = f" {jump.unit}" if jump.unit not in ("", "1") else ""
        yield (
            f"at t = {time:.9g} s an impulse takes `{jump.name}` from {jump.before:.6g}{unit} to {jump.after:.6g}{unit}"
            f"{often}: a junction that goes on or off ties it to other storages, or holds it"
        )


def _check_supported(plan: Plan) -> None:
    """Raises `CompilationFailed` for what only later versions run."""
    if plan.unsupported:
        from ..door import CompilationFailed, Unsupported

        advice = "Run another experiment with -e, or none with `-e none`."
        raise CompilationFailed(
            [Unsupported(span, f"`{word}` in an experiment", advice) for span, word in plan.unsupported]
        )


def _check_choice(
    made: Callable[[Scene, bool], Prepared], scene: Scene, wishes: Mapping[str, str], begin: Handover, times: int
) -> None:
    """Whether the other choice of states can be made. Raises `RunFailed`."""
    from ..door import CompilationFailed

    try:
        chosen = made(replace(scene, preferences=tuple(sorted(wishes.items()))), False)
        possible = times <= MOST_CHOICES and begin.dependent not in chosen.state_space.dependent
    except CompilationFailed:
        possible = False
    if not possible:
        raise RunFailed(
            f"at t = {begin.time:.9g} s `{begin.dependent}` follows from `{begin.state}` so steeply that its error would be "
            f"{WORST:g} times that of `{begin.state}`, and no other choice of states is possible there"
        )


def _warnings(legs: Sequence[Leg]) -> tuple[LimitLeft, ...]:
    """Each limit that was left once, at its first instant."""
    first: dict[tuple[str, str, str], LimitLeft] = {}
    for item in (w for leg in legs for w in leg.watch.warnings):
        first.setdefault((item.owner, item.condition, item.place), item)
    return tuple(first.values())


def _solver(program: Program, legs: Sequence[Leg]) -> str:
    if program.states.names:
        return " and ".join(dict.fromkeys(name for leg in legs for name in leg.trajectory.solvers))
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
    from ..door import SECOND, CompilationFailed, Literal, Source, parse_expression, read_unit

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
