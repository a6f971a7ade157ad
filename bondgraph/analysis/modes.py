"""Modes: frequency, damping, shape, and the distribution of their energy over the elements.

A storage's energy in a mode is half its effort times its displacement (its flow times its momentum), averaged over a cycle, by the derivatives
at its port: storages in derivative form count like others. A mechanism's is the second variation of its energy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray, IntArray, Leaf, letters

from ..errors import RunFailed
from ..numerics.scales import group_numbers, largest_of_group, nonzero
from ..rendering import OfModel, Plotted, Summarised
from ..results.json_values import entries, head
from .linear import Linearization, linearization, part_note, state_matrix
from .operating_point import OperatingPoint
from .spectrum import Spectrum, spectrum

SCHEMA = "bondgraph-modes/1"
WIDTH = 64  # modes whose energies are computed at once
STILL = 1e-12  # relative to the fastest: an eigenvalue that counts as zero
RESTING = 1e-8  # relative to the terms in a rate: a smaller rate is rounding
ROUNDED = 1e-13  # relative to the terms in a rate at one radian: what forces leave that cancel
CHANGING = 1e-6  # relative to the terms in a rate: a smaller change along the motion is none
SMALL = 1e-9  # relative to the largest energy: rounding
UNCERTAIN = 1e-2  # relative to an eigenvalue: a larger bound is told


@dataclass(frozen=True, eq=False)
class Names:
    """Names of states, outputs and elements that store energy, in the order of a mode's arrays."""

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    elements: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Mode:
    """One mode; for a conjugate pair the eigenvalue (1/s) with the positive imaginary part.

    `shape` and `outputs`: complex amplitudes of states and outputs in SI, for an energy of 1 J (without energy: a norm of 1); NaN for an output with a
    kink or a jump there.
    `energy`: the share of each element that stores some, sum 1, the largest first; a spring with negative stiffness has a negative one.
    """

    eigenvalue: complex
    names: Names
    amplitudes: Any  # amplitudes of the states (n,)
    seen: Any  # amplitudes of the outputs (m,)
    energies: Any  # shares of the elements (k,)

    @property
    def frequency(self) -> float:
        """Natural frequency, abs(eigenvalue)/2pi in Hz."""
        return abs(self.eigenvalue) / (2 * math.pi)

    @property
    def damped_frequency(self) -> float:
        """Damped frequency, abs(Im)/2pi in Hz."""
        return abs(self.eigenvalue.imag) / (2 * math.pi)

    @property
    def damping(self) -> float:
        """Damping ratio, -Re/abs; NaN for an eigenvalue of zero."""
        size = abs(self.eigenvalue)
        return 0.0 - self.eigenvalue.real / size if size else math.nan

    @property
    def shape(self) -> dict[str, complex]:
        """Amplitudes of the states."""
        return dict(zip(self.names.states, map(complex, self.amplitudes), strict=True))

    @property
    def outputs(self) -> dict[str, complex]:
        """Amplitudes of the outputs."""
        return dict(zip(self.names.outputs, map(complex, self.seen), strict=True))

    @property
    def energy(self) -> dict[str, float]:
        """Shares of the energy by element, without those that are rounding."""
        size = np.abs(self.energies)
        order = np.argsort(-size, kind="stable")
        shown = order[size[order] > SMALL * size.max(initial=0.0)]
        return {self.names.elements[i]: float(self.energies[i]) for i in shown}

    @property
    def where(self) -> str:
        """Element with the largest share of the energy; empty if none has any."""
        return next(iter(self.energy), "")

    def to_json(self) -> dict[str, Any]:
        """Return JSON values, a part of `bondgraph-modes/1`."""
        return entries(self, "eigenvalue", "frequency", "damped_frequency", "damping", "energy", "shape", "outputs")


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Sequence[Mode], OfModel, Summarised, Plotted):
    """Modes at a point, slowest first; `units` of states and outputs.

    `unneeded`: states that no requested output depends on. Modes of these alone are not among them, and energies are those of the part that is left.
    """

    time: float
    modes: tuple[Mode, ...]
    units: Mapping[str, str]
    note: str = ""  # of a point that is neither at rest nor in a steady motion, and of a part
    unneeded: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.modes)

    def __getitem__(self, place: int | slice) -> Any:
        return self.modes[place]

    @property
    def frequencies(self) -> Array:
        """Frequencies in Hz, slowest first."""
        return np.array([m.frequency for m in self.modes])

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-modes/1`, frequencies in Hz, all else in SI.

        {schema, model, experiment, time, units, modes: [{eigenvalue: {re, im}, frequency, damped_frequency, damping, energy: {element: share}, shape,
        outputs: {name: {re, im}}}]}; `note` where the point changes with time, and of a part of the model, with the states `unneeded`.
        """
        some = [word for word in ("note", "unneeded") if getattr(self, word)]
        return {**head(SCHEMA, self), **entries(self, "time", *some, "units", "modes")}


def modes(point: OperatingPoint) -> Modes:
    """Return all modes at a point, slowest first."""
    linear = linearization(point, partial=True)
    found = spectrum(linear.A)
    chosen = _slowest_first(found.values)
    values, shapes = found.values[chosen], point.reduced.whole(found.shapes)[:, chosen]
    names, energies = element_energies(point, values, shapes)
    total = energies.sum(axis=0)
    size = nonzero(np.where(np.abs(total) > SMALL * np.abs(energies).sum(axis=0), np.abs(total), 1.0))
    with_energy = np.abs(energies).sum(axis=0) > 0
    shapes = shapes / np.where(with_energy, np.sqrt(size), np.linalg.norm(shapes, axis=0))
    shapes = shapes * _turned(shapes)
    amplitudes = linear.C @ shapes[point.reduced.chosen]
    states = point.program.states.names
    units = dict(zip(states, point.program.states.units, strict=True)) | {n: linear.units[n] for n in linear.outputs}
    names_of_all = Names(states, linear.outputs, tuple(names))
    shares = energies / size
    made = tuple(
        Mode(complex(v), names_of_all, shapes[:, i], amplitudes[:, i], shares[:, i]) for i, v in enumerate(values)
    )  # fmt: skip
    part = part_note(linear.unneeded, "; their own modes are not shown, and shapes and energies are those of the rest")
    note = "; ".join(filter(None, (_note(linear), _uncertain(found, chosen), part, linear.held)))
    return Modes(linear.model, linear.experiment, point.time, made, units, note, linear.unneeded)


def _uncertain(found: Spectrum, chosen: IntArray) -> str:
    """Return the note on eigenvalues that rounding hides, or of which it keeps several from being told apart."""
    if found.bounds is None:
        return ""
    values, bounds = found.values[chosen], found.bounds[chosen]
    unsure = np.flatnonzero((values != 0) & (bounds > UNCERTAIN * np.abs(values)))
    if not len(unsure):
        return ""
    worst = unsure[np.argmax(bounds[unsure] / np.abs(values[unsure]))]
    which = "an eigenvalue is" if len(unsure) == 1 else f"{len(unsure)} eigenvalues are"
    return f"{which} uncertain by rounding: {values[worst]:.6g} 1/s by {bounds[worst]:.2g} 1/s"


def _note(linear: Linearization) -> str:
    """Return the note on a point whose rates change, so that its slopes are others an instant later. Empty at rest and in steady motion."""
    sizes, slopes = np.abs(linear.x), np.abs(linear.A)
    fastest = slopes.max(initial=0.0)
    if not fastest > 0:
        return ""
    terms = slopes @ np.maximum(sizes, slopes @ sizes / fastest)  # of which rounding leaves a share in each rate
    units = [linear.units[name] for name in linear.states]
    turned = largest_of_group(slopes @ np.array([unit == "1" for unit in units], dtype=float), group_numbers(units))
    rates = np.where(np.abs(linear.rates) > np.maximum(RESTING * terms, ROUNDED * turned), linear.rates, 0.0)
    change = np.abs(linear.A @ rates)
    pace = float(np.max(np.abs(rates) / np.where(sizes > 0, sizes, np.inf), initial=0.0))
    share = change / np.where(terms * pace > 0, terms * pace, np.where(change > 0, change, 1.0))
    worst = int(np.argmax(share))
    if share[worst] <= CHANGING:
        return ""
    return (
        f"here the model is neither at rest nor in a steady motion: the rate of `{linear.states[worst]}` changes, and the modes are those of "
        "slopes at one instant"
    )


def moving_frequencies(point: OperatingPoint) -> list[float]:
    """Return the frequencies of the moving modes, in Hz, slowest first, without computing shapes and energies.

    Raises `RunFailed` at a rest that a mode leaves without vibrating: beside those of other points it is no frequency.
    """
    moving = [v for v in eigenvalues(state_matrix(point)) if v]
    leaving = next((v.real for v in moving if v.imag == 0 and v.real > 0), None)
    if leaving is not None:
        raise RunFailed(
            "BR278", f"the rest is unstable, and is left at {leaving:.6g} 1/s without vibrating, which is no frequency",
        )  # fmt: skip
    return [abs(v) / (2 * math.pi) for v in moving]


def eigenvalues(A: Array) -> list[complex]:
    """Return the eigenvalues in 1/s, of a conjugate pair the one with the positive imaginary part; slowest first."""
    values = spectrum(A).values
    return [complex(v) for v in values[_slowest_first(values)]]


def _slowest_first(values: ComplexArray) -> Any:
    """Return the indices of eigenvalues, slowest first; of a conjugate pair only the one with the positive imaginary part."""
    chosen = np.flatnonzero(values.imag >= 0)
    return chosen[np.lexsort((values[chosen].real, np.abs(values[chosen])))]


def _turned(shapes: Array | ComplexArray) -> Any:
    """Return the factors that rotate the largest component of each column to the positive real axis."""
    largest = shapes[np.abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])] if len(shapes) else np.ones(0)
    return np.conj(largest) / np.where(largest != 0, np.abs(largest), 1.0)


def element_energies(point: OperatingPoint, values: ComplexArray, shapes: Array | ComplexArray) -> tuple[list[str], Any]:  # fmt: skip
    """Return names of elements and their energies (elements, modes) in J, for complex amplitudes of the states (n, modes).

    For a motion x exp(value t): averaged over a cycle for complex values, at t = 0 for real ones. Rigid motion has none.
    """
    space = point.compilation.state_space
    ports = [p for p in space.ports if p.kind in letters("storage")]
    full = _with_unknowns(point, shapes)
    efforts = point.sparse_slopes([p.effort for p in ports])[:, : point.all] @ full
    flows = point.sparse_slopes([p.flow for p in ports])[:, : point.all] @ full
    moving = np.abs(values) > STILL * np.abs(values).max(initial=0.0)
    rate = np.where(moving, values, 1.0)
    found: dict[str, Any] = {}
    for port, effort, flow in zip(ports, efforts, flows, strict=True):
        if port.kind == "C" or (port.kind == "IC" and _is_displacement(point, port)):
            energy = (np.conj(effort) * flow / rate).real
        else:
            energy = (np.conj(flow) * effort / rate).real
        found[port.element] = found.get(port.element, 0.0) + 0.5 * port.sign * np.where(moving, energy, 0.0)
    for name, variable in space.stored.items():
        found[name] = np.where(moving, _mechanism_energy(point, variable, full), 0.0)
    factor = np.where(values.imag != 0, 0.5, 1.0)
    names = list(found)
    return names, np.array([found[n] * factor for n in names]).reshape(len(names), len(values))


def _is_displacement(point: OperatingPoint, port: Any) -> bool:
    """Return True if a port of an IC field stores a displacement: its flow is the rate of the stored quantity, or of the state that it shares."""
    space = point.compilation.state_space
    storage = next((s for s in point.compilation.equations.storages if s.element == port.element), None)
    if storage is None:
        return False
    rates = {s.variable: s.rate for s in space.states}
    followed = {f.variable: rates[f.state] for f in space.following}
    own = [p for p in space.ports if p.element == port.element]
    rate = (rates | followed).get(storage.stored[own.index(port)])
    if rate in (port.flow, port.effort):
        return bool(rate == port.flow)
    units = space.variables  # of a shared state whose rate is another variable
    return rate is not None and bool(units[rate].unit == units[port.flow].unit)


def _with_unknowns(point: OperatingPoint, shapes: Array | ComplexArray) -> Any:
    """Return amplitudes of states and unknowns."""
    if point.all == point.count:
        return shapes
    return np.concatenate([shapes, point.reduced.unknowns[:, : point.count] @ shapes])


def _mechanism_energy(point: OperatingPoint, variable: int, full: Array | ComplexArray) -> Any:
    """Return half the second variation of a stored energy, for each column of amplitudes."""
    slopes = point.lowered.slopes.get(variable, {})
    tape, rows = point.tape(f"energy of {variable}", lambda: list(slopes.values())), list(slopes)
    result = np.zeros(full.shape[1])
    for first in range(0, full.shape[1], WIDTH):
        part = full[:, first : first + WIDTH]
        along = np.concatenate([part.real, part.imag], axis=1)
        directions = {Leaf("state", i): row for i, row in enumerate(along) if row.any()}
        _, moved = tape.slopes(point.lookup, directions, along.shape[1])
        second = np.zeros_like(along)
        for row, change in zip(rows, moved, strict=True):
            if change is not None and row < len(second):
                second[row] = change
        both = 0.5 * (along * second).sum(axis=0)
        result[first : first + WIDTH] = both[: part.shape[1]] + both[part.shape[1] :]
    return result
