"""Analyses of models in other units: rest, modes, linear model, response, inversion and branches, each compared with those at scale 1.

A refusal counts as a result: what is refused at one scale is refused at every other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.errors import RunFailed
from compiler.api import CompilationFailed, Source, scene_of
from compiler.metamorphosis.scaling import Powers
from tests.compiling import LIBRARY
from tests.second_opinion.random_models import mechanism, network
from tests.second_opinion.scales import POWERS, in_other_units, texts, unscaled, with_units
from tests.second_opinion.trial import TooLong, limited

ALIKE = 1e-6  # of the largest of a unit: difference of numbers that are one
ZERO = 1e-9  # of the largest of a unit: rounding of zero
NOTHING = 1e-12  # at scale 1, whose models have parts of usual sizes
SETTLED = 1e-5  # of a parameter: difference of special points
STEP = 0.5  # of an input, by which an inversion changes it
RANGE = 3.0  # of a parameter: end of a branch that begins at its value
PARAMETERS, INPUTS = 8, 3  # of a model: these move a branch, or hold an output
Findings = dict[str, tuple[str, Any]]  # name -> unit and numbers
Factor = Callable[[str], float]


def rest(model: bondgraph.Model) -> Findings:
    """States, outputs and the verdict of the rest."""
    found = model.equilibrium()
    values = {n: (found.units.get(n, "1"), x) for n, x in {**found.states, **found.outputs}.items()}
    return values | {"stable": ("", found.stable)}


def modes(model: bondgraph.Model) -> Findings:
    """Eigenvalues."""
    return {"eigenvalues": ("1/s", np.array([m.eigenvalue for m in model.modes()]))}


def linear(model: bondgraph.Model) -> Findings:
    """A, B, C and D, entry by entry."""
    found, entries = model.linearize(), {}
    rows = {"A": found.states, "B": found.states, "C": found.outputs, "D": found.outputs}
    columns = {"A": found.states, "B": found.inputs, "C": found.states, "D": found.inputs}
    for word in rows:
        for i, row in enumerate(rows[word]):
            for j, column in enumerate(columns[word]):
                rate = "/s" if word in "AB" else ""
                unit = f"{found.units[row]}|{found.units[column]}|{rate}"
                entries[f"{word}[{row}, {column}]"] = unit, getattr(found, word)[i, j]
    return entries


def branch(name: str, low: float, high: float, factor: Factor, unit: str) -> Callable[[bondgraph.Model], Findings]:
    """Folds, crossings and stability along a parameter."""

    def followed(model: bondgraph.Model) -> Findings:
        found = model.continuation(name, low * factor(unit), high * factor(unit), points=20, most=400)
        special = found.special
        kinds = {"kinds": ("", tuple(s.kind for s in special)), "ended": ("", found.ended.split()[0])}
        last = (
            {n: (found.units.get(n, "1"), x[-1]) for n, x in found.outputs.items()} if "leaves" in found.ended else {}
        )
        sides = {"begins stable": ("", bool(found.stable[0])), "ends stable": ("", bool(found.stable[-1]))}
        return kinds | sides | last | {f"special {i}": (unit, s.value) for i, s in enumerate(special)}

    return followed


def inverted(targets: Mapping[str, tuple[str, float]], name: str, factor: Factor) -> Callable[[bondgraph.Model], Findings]:  # fmt: skip
    """The input for the values of outputs."""

    def found(model: bondgraph.Model) -> Findings:
        result = model.invert({n: x * factor(u) for n, (u, x) in targets.items()}, (name,))
        return {n: (result.units.get(n, "1"), x) for n, x in result.inputs.items()}

    return found


def attempted(analysis: Callable[[bondgraph.Model], Findings], model: bondgraph.Model) -> Findings | str:
    """The findings, or the code of the refusal."""
    try:
        return analysis(model)
    except (RunFailed, CompilationFailed, bondgraph.UsageError) as refused:
        return f"{type(refused).__name__} {str(refused)[:200]}"


def unit_factor(unit: str, factor: Factor) -> float:
    """Factor of a unit, or of `row|column|/s`."""
    if "|" not in unit:
        return factor(unit) if unit else 1.0
    row, column, rate = unit.split("|")
    return factor(row) / factor(column) / (factor("s") if rate else 1.0)


def differing(one: Findings | str, other: Findings | str, factor: Factor, alike: float = ALIKE) -> str:
    """What differs, "" if nothing. Refusals are alike if their codes are."""
    if isinstance(one, str) or isinstance(other, str):
        both = isinstance(one, str) and isinstance(other, str)
        return (
            ""
            if both
            else f"{one if isinstance(one, str) else 'found'} here, {other if isinstance(other, str) else 'found'} there"
        )
    if one.keys() != other.keys():
        return f"{sorted(one.keys() ^ other.keys())} only once"
    largest: dict[str, float] = {}
    for unit, x in one.values():
        if unit:
            largest[unit] = max(largest.get(unit, 0.0), float(np.abs(x).max(initial=0.0) if np.ndim(x) else abs(x)))
    for name, (unit, x) in one.items():
        y = other[name][1]
        if not unit:
            if x != y:
                return f"{name}: {x} and {y}"
            continue
        if np.shape(x) != np.shape(y):
            return f"{name}: {np.size(x)} numbers and {np.size(y)}"
        y = np.asarray(y) / unit_factor(unit, factor)
        allowed = alike * np.abs(x) + ZERO * largest[unit] + NOTHING
        if not (np.abs(y - x) <= allowed).all():
            off = np.ravel(np.abs(y - x) - allowed)
            k = int(off.argmax())
            return f"{name}: {np.ravel(x)[k]:.9g} and {np.ravel(y)[k]:.9g} {unit}"
    return ""


def compared(model: bondgraph.Model, other: bondgraph.Model, own: Powers, kept: dict[str, Any] | None = None) -> Iterator[tuple[str, str]]:  # fmt: skip
    """Each analysis with its difference. `kept`: findings at scale 1, made once."""
    kept = {} if kept is None else kept
    for name, make in requests(model):
        if name not in kept:
            kept[name] = attempted(make(unscaled), model)
        yield name, differing(kept[name], attempted(make(own.of_unit), other), own.of_unit)


def requests(model: bondgraph.Model) -> Iterator[tuple[str, Callable[[Factor], Callable[[bondgraph.Model], Findings]]]]:
    """Analyses by name: those of any model, then a branch by each of the first parameters, and an inversion by each input."""
    yield from ((f.__name__, lambda factor, f=f: f) for f in (rest, modes, linear))
    quantities = model.compilation().whole_graph.quantities
    moving = {
        n: (q.value, q.unit)
        for n, q in quantities.items()
        if q.role in ("parameter", "input") and "." not in n and q.value
    }
    moving = {n: (x, u) for n, (x, u) in moving.items() if isinstance(x, float)}
    for name, (value, unit) in list(moving.items())[:PARAMETERS]:
        yield f"branch {name}", lambda factor, a=(name, value, RANGE * value, unit): branch(*a[:3], factor, a[3])
    for name in model.inputs[:INPUTS]:
        value = quantities[name].value or 0.0
        try:
            gains = model.linearize(inputs=(name,))
            there = model.equilibrium(settings={name: value + STEP * (abs(value) or 1.0)})
        except (RunFailed, CompilationFailed, bondgraph.UsageError):
            continue
        moved = [n for n in gains.outputs if there.outputs.get(n)]
        for seen in moved[:1]:
            targets = {seen: (there.units.get(seen, "1"), there.outputs[seen])}
            yield f"inversion {name}", lambda factor, a=(targets, name): inverted(*a, factor)


def cases(name: str, text: str, path: Path | None = None, changes: Iterable[Mapping[str, int]] = POWERS) -> Iterator[tuple[str, str]]:  # fmt: skip
    """Each change of units of a text with units, and each analysis, with what differs."""
    scene = scene_of(Source(name, text, path), LIBRARY, (None, None), None, {})
    model, kept = bondgraph.load(in_other_units(scene.text, {})[0], model=scene.model), dict[str, Any]()
    for powers in () if scene.plain else changes:
        changed, own = in_other_units(scene.text, powers)
        for analysis, words in compared(model, bondgraph.load(changed, model=scene.model), own, kept):
            yield f"{name} {powers} {analysis}", words


def campaign(numbers: range, seconds: int) -> Iterator[tuple[str, str]]:
    """All cases that could be tried, with what differs: networks and mechanisms by number, then texts if the numbers begin with 0."""
    given: list[tuple[str, str, Path | None]] = []
    for n in numbers:
        circuit, linkage = network(n), mechanism(n)
        given.append((f"network {n}", with_units(circuit), None))
        given.append((f"mechanism {n}", linkage.written(linkage.parameters), None))
    for name, text, path in (*given, *(texts() if 0 in numbers else ())):
        try:
            with limited(seconds):
                yield from cases(name, text, path)
        except (TooLong, RunFailed, CompilationFailed, bondgraph.UsageError):
            continue
