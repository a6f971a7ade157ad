"""Changes of a run that keep its results: solver, target, tolerance, search for events; its energy balance; settings at the corners of ranges."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from random import Random

import numpy as np

from compiler.api import AUTOMATIC, SOLVERS, CompilationFailed, Inapplicable, Kind

from ..compiled_scene import chosen_target
from ..errors import RunFailed, UsageError
from ..results.records import EnergyBalance
from ..results.result import Result
from ..results.run_check import FACTOR
from ..simulation.repetition import PARTS
from .stress_bench import CANCELS, ROUNDING, StressBench

TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8)
TARGETS = ("native", "numpy")
FALLS = 0.1  # of an energy balance that an error leaves unexplained, this much remains with a hundredth of the tolerance, or less
CORNERS = 64  # most corners that are listed in order
STATES = 16  # random states at which equations are compared with those of reversed time

Attempts = Iterator[tuple[str, Callable[[StressBench], str]]]


def other_solvers() -> Attempts:
    """Yield the run by each other solver. What a solver refuses is not tried."""
    for word in SOLVERS:
        if word != AUTOMATIC:
            yield word, _by_solver(word)


def _by_solver(word: str) -> Callable[[StressBench], str]:
    def check(bench: StressBench) -> str:
        base = bench.base()
        if base.solver.startswith(SOLVERS[word].name):
            raise Inapplicable(f"{word} is the solver of the unchanged run")
        other = accepted(bench, solver=word, rtol=base.rtol)
        return bench.compare_run(base, lambda: other, lambda: bench.run(solver=word, rtol=base.rtol, error=True).error)

    return check


def accepted(bench: StressBench, **changes: float | str) -> Result:
    """Return the run with other options. Raises `Inapplicable` if these refuse the model."""
    try:
        return bench.run(**changes)
    except (UsageError, CompilationFailed) as refused:
        raise Inapplicable(str(refused)) from refused


def other_targets() -> Attempts:
    """Yield the run by the other back-end."""

    def check(bench: StressBench) -> str:
        here = chosen_target(bench.request.options.target)
        base = bench.base()
        other = accepted(bench, target=TARGETS[here == TARGETS[0]], rtol=base.rtol)
        return bench.compare_run(base, lambda: other, lambda: None)

    yield "the other", check


def other_tolerances() -> Attempts:
    """Yield runs at tolerances over three decades."""
    for rtol in TOLERANCES:
        yield f"rtol {rtol:g}", _at_tolerance(rtol)


def _at_tolerance(rtol: float) -> Callable[[StressBench], str]:
    def check(bench: StressBench) -> str:
        base = bench.base()
        if rtol == base.rtol:
            return "" if base.error is None else base.error.failure
        return bench.compare_run(base, lambda: bench.run(rtol=rtol), lambda: bench.run(rtol=rtol, error=True).error)

    return check


def finer_events() -> Attempts:
    """Yield the run in parts, in each of which events are searched and the solver starts anew."""

    def check(bench: StressBench) -> str:
        base = bench.base()
        return bench.compare_run(
            base, lambda: bench.run(rtol=base.rtol, parts=PARTS), lambda: bench.run(rtol=base.rtol, parts=PARTS, error=True).error
        )  # fmt: skip

    yield f"{PARTS} parts", check


def energy_balances() -> Attempts:
    """Yield the energy balance at the tolerance of the run and at a hundredth of it."""

    def check(bench: StressBench) -> str:
        rtol = bench.base().rtol
        balance = _balance(bench, rtol)
        if sum(abs(e.stored) + abs(e.dissipated) for e in balance.elements) <= ROUNDING * _turnover(balance):
            raise Inapplicable("nothing stores or dissipates energy: what is supplied is rounding, or passes through")
        total, limit = abs(balance.residual), FACTOR * rtol * _turnover(balance)
        if total <= limit:
            return ""
        closer = _balance(bench, max(rtol / 100, 1e-13))
        if abs(closer.residual) <= max(FALLS * total, limit / 100, ROUNDING * bench.energy_at_start):
            return ""
        return (
            f"the energy balance leaves {balance.residual:.3g} J unexplained, and {closer.residual:.3g} J with a hundredth of the tolerance; "
            f"the tolerance covers {limit:.3g} J"
        )

    yield "whole run", check


def _balance(bench: StressBench, rtol: float) -> EnergyBalance:
    balance = bench.run(energy=True, rtol=rtol).energy
    if balance is None:
        raise Inapplicable("there is no energy balance")
    return balance


def reversed_time() -> Attempts:
    """Yield the way back: a run from the end with momenta and speeds reversed, where that satisfies the same equations."""

    def check(bench: StressBench) -> str:
        rtol = bench.base().rtol
        signs = _reversal(bench)
        off = _way_back(bench, rtol, signs)
        if off <= FACTOR * rtol or _way_back(bench, max(rtol / 100, 1e-13), signs) <= max(FALLS * off, ROUNDING):
            return ""
        return f"the way back ends {off:.3g} of the magnitudes from the start, also with a hundredth of the tolerance, which covers {FACTOR * rtol:.3g}"

    yield "way back", check


def _reversal(bench: StressBench) -> dict[str, float]:
    """Return the sign of each stored quantity in reversed time, R. Raises `Inapplicable` unless f(R x) = -R f(x) for the rates f, at random states x."""
    compiled_scene, end = bench.compiled_scene, bench.base().checkpoint
    program, names = compiled_scene.program, compiled_scene.program.states.names
    facts, starts_at_rest = compiled_scene.facts, compiled_scene.plan.equilibrium
    others = (
        program.hybrid,
        program.delays,
        program.unknowns.names,
        program.invariants.names,
        facts.claims,
        starts_at_rest,
    )
    if end is None or compiled_scene.certificate.driven or any(others):
        raise Inapplicable("its rates are no functions of its states alone, or it starts at rest")
    inertias = {
        node.name for node in compiled_scene.compilation.graph.nodes if getattr(node, "kind", None) is Kind.INERTIA
    }
    odd = inertias | set(names)  # what is named behind an inertia, or behind a coordinate, is a momentum or a speed
    signs = {name: -1.0 if name.rpartition(".")[0] in odd else 1.0 for name in end.stored}
    reverse = np.array([signs[name] for name in names])
    constants = bench.constants
    inputs, mode = np.array(program.input_defaults, dtype=float), np.zeros(0)
    scale = np.array([max(end.peaks.get(name, 0.0), abs(end.stored[name])) for name in names])
    random = np.random.default_rng(0)
    for _ in range(STATES):
        state = scale * random.uniform(-1.0, 1.0, len(names))
        there, back = (
            np.asarray(program.derivative(0.0, x, inputs, constants, mode)) for x in (state, reverse * state)
        )
        if not np.allclose(back, -reverse * there, rtol=ROUNDING, atol=ROUNDING * float(np.abs(there).max())):
            raise Inapplicable("its equations are others in reversed time")
    return signs


def _way_back(bench: StressBench, rtol: float, signs: Mapping[str, float]) -> float:
    """Return the largest distance of the end of the way back from the reversed start, relative to the magnitudes of the states."""
    there = bench.run(rtol=rtol)
    assert there.checkpoint is not None
    turned = {name: signs[name] * value for name, value in there.checkpoint.stored.items()}
    back = bench.run_on(replace(there, checkpoint=replace(there.checkpoint, stored=turned)), rtol).checkpoint
    assert back is not None
    states, largest = bench.compiled_scene.program.states, dict[str, float]()
    sizes = {name: max(back.peaks.get(name, 0.0), abs(value)) for name, value in bench.start.items()}
    for name, unit in zip(states.names, states.units, strict=True):
        largest[unit] = max(largest.get(unit, 0.0), CANCELS * sizes[name])
    return max(
        abs(back.stored[name] - signs[name] * bench.start[name]) / (max(sizes[name], largest[unit]) or 1.0)
        for name, unit in zip(states.names, states.units, strict=True)
    )


def _turnover(balance: EnergyBalance) -> float:
    """Sum of the energies of all elements in J, that which is stored, supplied and dissipated."""
    return sum(abs(e.stored) + abs(e.supplied) + abs(e.dissipated) for e in balance.elements)


def corners(vary: Mapping[str, str], seed: int) -> Attempts:
    """Yield, for each corner of the ranges, the run there by other solvers. Raises `UsageError` for a range that is none."""
    ends = {name: ends_of(name, text) for name, text in vary.items()}
    if not ends:
        return
    choices = list(itertools.islice(itertools.product(*ends.values()), CORNERS))
    Random(seed).shuffle(choices)
    for choice in choices:
        settings = dict(zip(ends, choice, strict=True))
        yield ", ".join(f"{n} = {v}" for n, v in settings.items()), _at_corner(settings)


def ends_of(name: str, text: str) -> tuple[str, str]:
    """Return both ends of `LOW .. HIGH`. Raises `UsageError`."""
    low, dots, high = (part.strip() for part in text.partition(".."))
    if not dots or not low or not high:
        raise UsageError("BR495", f"`{name}`: a range is written `LOW .. HIGH`; this is `{text}`")
    return low, high


def _at_corner(settings: Mapping[str, str]) -> Callable[[StressBench], str]:
    def check(bench: StressBench) -> str:
        corner = bench.at(settings)
        try:
            base = corner.base()
        except RunFailed as failed:
            raise Inapplicable(f"the run fails at a corner: {failed}") from failed
        tried = 0
        for word in next((row.others for row in SOLVERS.values() if row.name and base.solver.startswith(row.name)), ()):
            try:
                sentence = _by_solver(word)(corner)
            except Inapplicable:
                continue
            tried += 1
            if sentence:
                return f"{word}: {sentence}"
        if not tried:
            raise Inapplicable("no other solver can")
        return ""

    return check
