"""Inputs for given outputs at equilibrium: the equations solved for states and inputs at once, by Newton's method with exact derivatives.

A pair pushes or pulls: one of its two inputs is zero. Where the force is proportional to the square (a comb drive), the unknown is the signed square
of the other, which keeps the equations smooth through zero. Targets are reached in as many stages as necessary.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, MechanismNode, Reported

from ...compiled_model import CompiledModel
from ...errors import RunFailed, UsageError
from ...keywords import AnalysisRequest
from ...numerics.scales import equilibrated
from ...quantities import quantity
from ...rendering import OfModel, Summarised
from ...results.json_values import head, named, with_units
from ...simulation.equilibrium.search import equilibrium, search_at
from ...simulation.segments.timeline import Segment
from ..equilibrium import units_of
from ..linear import without_rounding
from ..operating_point import OperatingPoint
from ..placement import operating_point
from ..sensitivity import balanced_step
from ..sizes import natural
from ..verdict import verdict
from .equations import PROBE, Drive

SCHEMA = "bondgraph-inversion/1"
ITERATIONS = 30
CLOSE = 1e-14  # relative to the magnitudes
ENOUGH = 1e-9
REFINED = 3  # solutions, each of what those before leave
BESIDE = (1.0, 1e-3, 1e-6)  # of a probe: values of inputs from which a search begins that gets nowhere from zero
LARGEST_TURN = 1.0  # rad: most by which an angle of a mechanism misses its tangent in a stage: more may be another branch, or whole turns
STAGES = 64  # most stages from the first equilibrium to the targets


@dataclass(frozen=True, eq=False, repr=False)
class Inversion(OfModel, Summarised):
    """The `inputs` that hold `outputs` at equilibrium, in SI by name; `missed`: the largest relative error of a target.

    `inputs` may be used as settings: `model.simulate(settings=found.inputs)`.
    """

    targets: Mapping[str, float]
    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    states: Mapping[str, float]
    stable: bool | None
    units: Mapping[str, str]
    report: Sequence[Reported] = ()  # units in which the experiment shows outputs

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-inversion/1`: {schema, model, experiment, targets, inputs, outputs, states, stable}."""
        words = ("targets", "inputs", "outputs", "states")
        values = {word: with_units(getattr(self, word), self.units) for word in words}
        return {**head(SCHEMA, self), "stable": self.stable, **values}


def invert(model: CompiledModel, asked: AnalysisRequest, targets: Mapping[str, float], drives: Sequence[Drive]) -> Inversion:  # fmt: skip
    """Return the inversion. Raises as `held_at`."""
    return _told(held_at(model, asked, targets, drives), targets)


def held_at(model: CompiledModel, asked: AnalysisRequest, targets: Mapping[str, float], drives: Sequence[Drive]) -> Search:  # fmt: skip
    """Return the search at an equilibrium with the outputs at their targets. Raises `UsageError`, `RunFailed`, `CompilationFailed`.

    A mechanism goes there from its start, on the branch that is drawn; all else from its rest. Where nothing is found, what remains is tried: the values
    that the text gives to the inputs may be beyond all rests, and zeros, too, as of a magnet that lifts.
    """
    zero = replace(asked, settings={**dict.fromkeys(asked.by, 0.0), **(asked.settings or {})})
    begins, start = [asked, zero], replace(asked, state="start")
    graph = model.compilation(model.scene(asked.experiment, asked.settings)).whole_graph
    begins.insert(0 if any(isinstance(node, MechanismNode) for node in graph.nodes) else 2, start)
    failures = {}
    for begin in begins:
        try:
            return rest_with(operating_point(model, begin), targets, drives)
        except (RunFailed, UsageError) as failed:
            failures[id(begin)] = failed
    raise failures[id(asked)]


def rest_with(point: OperatingPoint, targets: Mapping[str, float], drives: Sequence[Drive]) -> Search:
    """Return the search at an equilibrium with the outputs at their targets. Raises `UsageError`, `RunFailed`."""
    outputs = point.program.outputs.names
    if len(drives) != len(targets):
        raise UsageError("BR302", f"{len(targets)} outputs want as many inputs or pairs `push/pull`; there are {len(drives)}")  # fmt: skip
    search = Search(point, [outputs.index(name) for name in targets], drives)
    wanted = np.array(list(targets.values()), dtype=float)
    begun = search.point.outputs[search.rows]
    reached, step = 0.0, 1.0
    while reached < 1.0:
        step = min(step, 1.0 - reached)
        found = search.newton(begun + (reached + step) * (wanted - begun))
        if found is None:
            step *= 0.5
            if step < 1.0 / STAGES and not reached and search.begin_beside_zero():
                begun, step = search.point.outputs[search.rows], 1.0
            elif step < 1.0 / STAGES:
                share = f"{100 * reached:.3g} %"
                raise RunFailed(
                    "BR323", f"no inputs were found that bring {', '.join(f'`{n}`' for n in targets)} there; they came {share} of the way",
                )  # fmt: skip
            continue
        search.point, search.strengths = found
        reached, step = reached + step, 2 * step
    return search


class Search:
    """States and strengths, moved until the outputs have their target values."""

    def __init__(self, point: OperatingPoint, rows: Sequence[int], drives: Sequence[Drive]) -> None:
        self.point, self.rows = point.one_sided(), list(rows)
        self.drives = [self._with_power(self.point, d) for d in drives]
        self.strengths = np.array([self._strength(point, d) for d in self.drives])
        names, units = point.program.states.names, point.program.states.units
        of_mechanisms = tuple(f"{name}." for name in point.compilation.facts.mechanisms)
        self.angles = [i for i, n in enumerate(names) if units[i] == "1" and n.startswith(of_mechanisms)]
        self.conserved = point.conserved  # conserved sums of the states, which stay constant
        self.held = self.conserved @ point.state[: point.count]

    def begin_beside_zero(self) -> bool:
        """Move inputs from zero, where what acts through its square in a state has no slope, to a small value and its rest; False if there is none."""
        zero = [d for d, s in zip(self.drives, self.strengths, strict=True) if s == 0.0]
        at = Segment(self.point.time, self.point.time, self.point.mode)
        for share in BESIDE if zero else ():
            small = {d.push: share * self._probe(d) for d in zero}
            try:
                moved = self.point.elsewhere(small, self.point.state)
                rest = equilibrium(moved.constraints, moved.state, at)
            except (RunFailed, np.linalg.LinAlgError):
                continue
            self.point = self.point.elsewhere(small, rest)
            self.strengths = np.array([self._strength(self.point, d) for d in self.drives])
            return True
        return False

    @staticmethod
    def _value(point: OperatingPoint, name: str) -> float:
        role, place = point.set_at(name)
        return float((point.constraints.parameters if role == "parameter" else point.inputs)[place])

    def _with_power(self, point: OperatingPoint, drive: Drive) -> Drive:
        """Return the drive with power 2 (its square is the unknown) if its derivative at zero vanishes."""
        if drive.pull is None and self._value(point, drive.push) != 0.0:
            return drive
        both = {drive.push: 0.0} | ({} if drive.pull is None else {drive.pull: 0.0})
        still = point.elsewhere(both, point.state)
        column = self._columns(still)[0][drive.push]
        moving = point.elsewhere(both | {drive.push: self._probe(drive)}, point.state)
        square = not column.any() and self._columns(moving)[0][drive.push].any()
        return Drive(drive.push, drive.pull, 2 if square else 1)

    def _probe(self, drive: Drive) -> float:
        """Return a value of the drive's input that is small and not zero, the same in all units."""
        program = self.point.program
        role, place = self.point.set_at(drive.push)
        units = (program.parameters if role == "parameter" else program.inputs).units
        return PROBE * float(natural(program, self.point.constraints.parameters, units[place : place + 1])[0])

    def _strength(self, point: OperatingPoint, drive: Drive) -> float:
        value = self._value(point, drive.push)
        if drive.pull is None:
            return value
        other = self._value(point, drive.pull)
        return value**drive.power - other**drive.power

    def _columns(self, point: OperatingPoint) -> tuple[dict[str, Any], Any]:
        """Return the derivatives of rates and outputs by each input, and by the free coordinates."""
        space = point.compilation.state_space
        outputs = list(space.outputs.values())
        variables = [*(space.states[i].rate for i in point.reduced.chosen), *(outputs[i] for i in self.rows)]
        by_states, by_inputs = without_rounding(point, variables, *point.of_states(variables))
        return dict(zip(point.by, by_inputs.T, strict=True)), by_states

    def settings(self, strengths: Array) -> dict[str, float]:
        found: dict[str, float] = {}
        for drive, strength in zip(self.drives, strengths, strict=True):
            found |= drive.settings(float(strength))
        return found

    def newton(self, wanted: Array) -> tuple[OperatingPoint, Any] | None:
        """Return the point and strengths with these outputs; None if Newton's method does not find them from here."""
        strengths, state, before = np.array(self.strengths), np.array(self.point.state), math.inf
        tangent = state
        for i in range(ITERATIONS):
            try:
                point = self.point.elsewhere(self.settings(strengths), state)
                step = self._step(point, strengths, wanted)
            except (RunFailed, np.linalg.LinAlgError):
                return None
            if step is None:
                return None
            change, moved, norm = step
            state, strengths = point.state + change, strengths + moved
            tangent = tangent if i else state
            if any(s < 0 for s, d in zip(strengths, self.drives, strict=True) if d.pull is None and d.power == 2):
                return None  # a square cannot be negative
            if norm < CLOSE or (norm < ENOUGH and norm >= 0.5 * before):
                if (np.abs(state - tangent)[self.angles] > LARGEST_TURN).any():
                    return None
                return self._checked(self.settings(strengths), state, strengths, wanted)
            before = norm
        return None

    def _checked(
        self, settings: Mapping[str, float], state: Array, strengths: Array, wanted: Array
    ) -> tuple[OperatingPoint, Any] | None:
        """Return the point and strengths if outputs and rates have their values: a zero step may also mean that no input has an effect, or no state."""
        point = self.point.elsewhere(settings, state)
        by_states, by_strengths = self._slopes(point, strengths)
        chosen = point.reduced.chosen
        r = len(chosen)
        settling, _ = balanced_step(by_states[:r], point.rates[chosen][:, None])  # remaining step to the equilibrium
        seen = by_states[r:]
        missed = np.abs(point.outputs[self.rows] - wanted) + np.abs(seen @ settling)[:, 0]
        gains = by_strengths[r:] + seen @ balanced_step(by_states[:r], by_strengths[:r])[0]
        allowed = ENOUGH * (np.abs(gains) @ np.abs(strengths) + np.abs(wanted))
        return (point, strengths) if (missed <= allowed).all() and _rests(point) else None

    def _slopes(self, point: OperatingPoint, strengths: Array) -> tuple[Any, Any]:
        """Return the derivatives of rates and outputs by the free coordinates and by the strengths."""
        columns, by_states = self._columns(point)
        slopes = []
        for drive, strength in zip(self.drives, strengths, strict=True):
            least = self._probe(drive) ** 2 if drive.power == 2 else 0.0
            if abs(strength) < least:  # the square is smooth at zero, its root is not
                signed = math.copysign(least, strength)
                beside = point.elsewhere(drive.settings(signed), point.state)
                slopes.append(drive.slope(signed, self._columns(beside)[0]))
            else:
                slopes.append(drive.slope(float(strength), columns))
        return by_states, np.array(slopes).T

    def _step(self, point: OperatingPoint, strengths: Array, wanted: Array) -> tuple[Any, Any, float] | None:
        """Return changes of states and strengths, and their relative size."""
        by_states, by_strengths = self._slopes(point, strengths)
        matrix = np.concatenate([by_states, by_strengths], axis=1)
        chosen = point.reduced.chosen
        kept = self.conserved @ point.reduced.directions
        matrix = np.concatenate([matrix, np.pad(kept, ((0, 0), (0, len(self.drives))))])
        moved = self.conserved @ point.state[: point.count] - self.held
        right = np.concatenate([point.rates[chosen], point.outputs[self.rows] - wanted, moved])
        scaled, rows, columns = equilibrated(matrix)
        found = np.zeros(len(columns))
        for _ in range(
            REFINED
        ):  # a row may have terms far below its largest entry: they are right once the residual is
            found -= np.linalg.lstsq(scaled, (right + matrix @ found) / rows, rcond=1e-13)[0] / columns
        if not np.isfinite(found).all():
            return None
        change = np.zeros(point.all)
        change[: point.count] = point.reduced.directions @ found[: len(chosen)]
        moved = found[len(chosen) :]
        largest = np.maximum(np.abs(strengths), np.abs(strengths + moved))
        norm = float((np.abs(moved) / max(float(largest.max(initial=0.0)), 1e-300)).max(initial=0.0))
        return change, moved, norm


def _rests(point: OperatingPoint) -> bool:
    """Return True if a point is an equilibrium as the search for one would have it: at a limit a rate may read no state, and remain."""
    search = search_at(point.constraints, Segment(point.time, point.time, point.mode))
    try:
        search.rested(point.state)
    except (RunFailed, np.linalg.LinAlgError):
        return False
    return True


def _told(search: Search, targets: Mapping[str, float]) -> Inversion:
    point, program = search.point.check_limits(), search.point.program
    units = units_of(point)
    return Inversion(
        program.name, point.made.plan.experiment, dict(targets), search.settings(search.strengths),
        named(program.outputs.names, point.outputs), point.stored(point.state), verdict(point).stable, units, point.made.plan.report,
    )  # fmt: skip


def asked_for(model: CompiledModel, targets: Mapping[str, str | float], experiment: str | None) -> dict[str, float]:
    """Return targets in SI. Raises `UsageError` for names that are no outputs."""
    compilation = model.compilation(model.scene(experiment))
    outputs, shown = compilation.whole_graph.outputs, {r.name: r.unit for r in compilation.plan.report if r.scale != 1}
    unknown = [n for n in targets if n not in outputs]
    if unknown or not targets:
        raise UsageError("BR322", f"there is no output `{(*unknown, '')[0]}`; outputs are {', '.join(outputs) or 'none'}")  # fmt: skip
    for name, value in targets.items():
        if isinstance(value, str) and re.search(r"\btime\b", value):
            raise UsageError("BR324", f"what is wanted of `{name}` goes with time:", "say until when (`--to`, in Python `to=`)")  # fmt: skip
    kinds = {n: shown.get(n, "1") if outputs[n].kind == "1" else outputs[n].kind for n in targets}
    return {n: quantity(v, kinds[n], n) for n, v in targets.items()}
