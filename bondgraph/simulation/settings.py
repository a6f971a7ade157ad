"""Settings from outside: numbers are arguments of one program for all their values; settings that decide more than numbers are compiled in.

A setting is compiled into the program where it is an expression (of time, of other quantities), where the model needs its value before
there is a program (a length, a choice between laws), or where it cannot be an argument (the compiler then gives the reason). Where a zero changes
the equations of the model (a mass that divides), the run uses a program with the zero compiled in, as if the text said so.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import CompilationFailed, Override, Scene, Source, Span, ValuesNeeded, dataclass, full_name

from ..compiled_model import LIBRARY, MOST_KEPT, CompiledModel, most_parts, refuse_twice
from ..memo import keep

if TYPE_CHECKING:
    from compiler.api import Array, Compilation, Expression, RunMetadata, Scale

    from ..compiled_scene import CompiledScene

Settings = Mapping[str, str | float]
_PLAIN = re.compile(r"(-?)([0-9]{1,99}(?:\.[0-9]{1,99})?(?:[eE][+-]?[0-9]{1,2})?)([ \[].*|)")  # a sign, digits, a unit


@dataclass(frozen=True, slots=True)
class Settled:
    """A scene, and the numbers that are set when its run begins. Parameters fixed by the scene are zeros that change its equations."""

    scene: Scene
    values: Mapping[str, float]


def settle(
    model: CompiledModel, experiment: str | None, settings: Settings, outputs: tuple[str, ...] | None, everything: bool, target: str
) -> Settled:  # fmt: skip
    """Return the scene and the numbers for a run of a model with some settings. Raises `CompilationFailed` for settings that are not possible.

    `everything`: all states and powers are needed; a run without them leaves out what nothing excites.
    """

    def scene_with(settings: Settings, **others: Any) -> Scene:
        return replace(model.scene(experiment, settings, (), outputs), from_start=not everything, **others)

    def compiled() -> CompiledScene:
        scene = scene_with(written)
        overrides = [*scene.overrides, *(_argument(name) for name in sorted(later))]
        return model.compiled_scene(replace(scene, overrides=tuple(overrides)), everything, target)

    if not settings:
        return model.recall(("settings", experiment, outputs, everything), lambda: Settled(scene_with({}), {}))
    names = [full_name(name) for name in settings]
    refuse_twice(names)
    numbers = {
        name: found for name, x in zip(names, settings.values(), strict=True) if (found := _number(x)) is not None
    }
    later = frozenset(numbers)
    while later:
        written = {name: x for name, x in settings.items() if full_name(name) not in later}
        try:
            key = "settings", experiment, tuple(written.items()), later, outputs, everything, target
            compiled_scene = model.recall(key, compiled)
            scene, facts = compiled_scene.scene, compiled_scene.facts
            those = {n: numbers[n] for n in sorted(later)}
            values = {n: number.value for n, number in those.items()}
            accepted = "accepted", *key  # the numbers of the last run, which need no second look
            if model.kept.get(accepted) == those:
                return Settled(scene, values)
            zeros = frozenset(name for name, number in numbers.items() if number.value == 0)
            if any(names <= zeros for names in facts.zero_divisors):
                return Settled(scene_with(settings, fixed=zeros), {})
            if _fits(facts, those, values):
                if not facts.looped.isdisjoint(later):
                    compiled_scene.compilation.refuse_values(values)
                keep(model.kept, accepted, those, MOST_KEPT)
                return Settled(scene, values)
        except ValuesNeeded as needed:
            if later & needed.names:
                later -= needed.names
                continue
        except CompilationFailed:
            pass  # raised again below, with the values, if they are wrong too
        break
    return Settled(scene_with(settings), {})


@dataclass(frozen=True, slots=True)
class SettledPoints:
    """A scene that several settings have in common; the `rows` of those that are numbers for it, and the numbers by name, (rows,)."""

    scene: Scene
    rows: Any
    values: Mapping[str, Any]


def settle_all(
    model: CompiledModel,
    experiment: str | None,
    points: Sequence[Settings],
    outputs: tuple[str, ...] | None,
    target: str,
) -> SettledPoints | None:
    """Return the scene of several settings of the same names whose numbers are set when a run begins; None if those of the first are not.

    Settings that are no such numbers are left out: zeros, other units, values that would be refused.
    """
    settled = settle(model, experiment, points[0], outputs, False, target)
    names = [full_name(name) for name in points[0]]
    if settled.scene.fixed or {*settled.values} != {*names}:
        return None
    compiled_scene = model.compiled_scene(settled.scene, False, target)
    facts = compiled_scene.facts
    looped = any(name in facts.looped for name in names)
    rows, numbers = [], []
    for row, point in enumerate(points):
        some = [_number(point[name]) for name in points[0]] if point.keys() == points[0].keys() else []
        if some and all(
            n is not None and n.value and _is_allowed(facts, name, n) for name, n in zip(names, some, strict=True)
        ):
            these = [n.value for n in some if n is not None]
            if not looped or _solves_loops(compiled_scene.compilation, dict(zip(names, these, strict=True))):
                rows.append(row)
                numbers.append(these)
    values = np.array(numbers, dtype=float).reshape(len(rows), len(names))
    fits = _are_positive(facts, names, values)
    return SettledPoints(settled.scene, np.array(rows, dtype=int)[fits], dict(zip(names, values[fits].T, strict=True)))


def _solves_loops(compilation: Compilation, values: Mapping[str, float]) -> bool:
    """Return True if linear loops have a solution with these values."""
    try:
        compilation.refuse_values(values)
    except CompilationFailed:
        return False
    return True


def _are_positive(facts: RunMetadata, names: Sequence[str], values: Array) -> Any:
    """Return a mask of the points, whose numbers are the rows of `values`, at which quantities that must not be negative are not."""
    from compiler.api import interval_of

    every = np.ones(len(values), dtype=bool)
    if not len(values):
        return every
    ranges = dict(zip(names, zip(values.min(axis=0), values.max(axis=0), strict=True), strict=True))
    unsure = [x for _, x in facts.positive if not interval_of(x, ranges.__getitem__)[0] >= 0]
    if not unsure:
        return every
    return np.array([_stay_positive(unsure, dict(zip(names, row.tolist(), strict=True))) for row in values])


def _stay_positive(expressions: Iterable[Expression], values: Mapping[str, float]) -> bool:
    """Return True if no expression is negative."""
    from compiler.api import evaluate

    try:
        return all(evaluate(x, values.__getitem__) >= 0 for x in expressions)
    except (ArithmeticError, ValueError):
        return False


def _is_allowed(facts: RunMetadata, name: str, number: _Number) -> bool:
    """Return True if a number is finite, its unit is that of a quantity, and a truth is 0 or 1."""
    unit = facts.units[name]
    if not abs(number.value) < float("inf") or (name in facts.truths and number.value not in (0, 1)):
        return False
    if number.unit in ("", "1") and name in facts.counted:
        return False
    return not number.unit or number.unit == unit or _scale_of(number.unit).dimension == _scale_of(unit).dimension


def compiled_in(
    model: CompiledModel, experiment: str | None, settings: Settings, names: Iterable[str]
) -> dict[str, str]:
    """Return those of `names`, set to numbers, that must be compiled in instead of being arguments; for each the place that needs the value."""
    found: dict[str, str] = {}
    written = {name: x for name, x in settings.items() if name not in names}
    later = frozenset(full_name(name) for name in names)
    while later:
        scene = model.scene(experiment, written | {n: settings[n] for n in found}, (), None)
        scene = replace(scene, overrides=(*scene.overrides, *(_argument(name) for name in sorted(later))))
        try:
            _ = model.compilation(scene, True).state_space
        except ValuesNeeded as needed:
            why = {n: words for n, words in needed.why.items() if n in later}
            found |= why
            later -= frozenset(why)
            if why:
                continue
        except CompilationFailed:
            pass  # raised where the scene is compiled
        break
    return found


def refused_with_values(model: CompiledModel, experiment: str | None, settings: Settings, outputs: tuple[str, ...] | None) -> None:  # fmt: skip
    """Raise `CompilationFailed` if the compiler, which did not know the values, finds an error with them."""
    from compiler.api import Compilation

    _ = Compilation(
        model.source, model.scene(experiment, settings, (), outputs), LIBRARY, most_parts=most_parts()
    ).lowered


@dataclass(frozen=True, slots=True)
class _Number:
    """A number in SI, and the text of its unit; None if any unit is accepted, "" of a zero that is written without one."""

    value: float
    unit: str | None


def _number(given: str | float) -> _Number | None:
    """Return a setting that is a number; None for any other expression. What stands around the digits is read once for all numbers."""
    if not isinstance(given, str):
        return _Number(float(given), None)
    plain = _PLAIN.fullmatch(given)
    read = _signed(given) if plain is None else _signed(f"{plain[1]}1{plain[3]}")
    if read is None:
        return None
    sign, number, unit = read
    number = number if plain is None else Fraction(plain[2])
    if not unit:
        return _Number(sign * float(number), "" if number == 0 else "1")
    return _Number(sign * _scale_of(unit).to_si(number), unit)


@lru_cache(maxsize=1024)  # the same units at all points of a study
def _signed(text: str) -> tuple[float, Fraction, str] | None:
    """Return the sign, the number and the unit ("": none) of a text; None if it is anything else, or below a zero that its unit sets."""
    from compiler.api import Literal, Negative, parse_expression

    try:
        tree = parse_expression(Source("setting", text))
        sign, tree = (-1.0, tree.operand) if isinstance(tree, Negative) else (1.0, tree)
        if not isinstance(tree, Literal):
            return None
        unit = "" if tree.unit is None else tree.unit.span.text.strip("[]")
        shifted = bool(unit) and _scale_of(unit).offset != 0
        return None if shifted and sign < 0 else (sign, tree.number, unit)
    except CompilationFailed:
        return None  # raised where the scene is compiled


@lru_cache(maxsize=1024)
def _scale_of(unit: str) -> Scale:
    """Return the scale of a unit. Raises `CompilationFailed`."""
    from compiler.api import read_unit

    return read_unit(Source("unit", unit))


def _argument(name: str) -> Override:
    """Return the override that makes a name an argument of the program, set when a run begins; equal for all values."""
    return Override(name, None, Span(Source(f"setting of {name}", name), 0, len(name)))


def _fits(facts: RunMetadata, numbers: Mapping[str, _Number], values: Mapping[str, float]) -> bool:
    """Return True if the units are right, the numbers are finite, and quantities that must not be negative are not."""
    units = all(_is_allowed(facts, name, number) for name, number in numbers.items())
    return units and _stay_positive({x for _, x in facts.positive}, values)
