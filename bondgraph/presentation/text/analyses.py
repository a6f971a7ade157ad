"""Analyses as plain text for terminals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from .tables import aligned, digits_of_time, short, shown_unit, visible

if TYPE_CHECKING:
    from ...analysis.branch import Branch
    from ...analysis.equilibrium import Equilibrium
    from ...analysis.extrema import Extremum
    from ...analysis.inversion.feed_forward import FeedForward
    from ...analysis.inversion.static import Inversion
    from ...analysis.linear import Linearization
    from ...analysis.linear_sensitivity import ResponseSensitivity
    from ...analysis.modes import Mode, Modes
    from ...analysis.outcome import Outcome
    from ...analysis.response import Response
    from ...analysis.run_sensitivity import RunSensitivity
    from ...analysis.sensitivity import Sensitivity
    from ...analysis.verdict import Verdict

WIDEST = 12  # most columns of a matrix
LONGEST = 60  # most rows
PEAKS = 5  # most peaks of a response
SHOWN = 12  # most points of a branch
STRONGEST = 8  # most parameters of a quantity
ROUNDING = 1e-12  # percent per percent that is none
SHARES = 3  # most elements of a mode
INSTANTS = 11  # of a path


def title(model: str, experiment: str | None, what: str) -> str:
    """Return `Model: experiment, what`."""
    return visible(f"{model}{f': {experiment}' if experiment else ''}, {what}")


class ReportedUnits:
    """Unit, scale and offset of numbers by name: as the experiment reports them, else in SI."""

    def __init__(self, found: Equilibrium | Branch | Inversion | FeedForward | Sensitivity | RunSensitivity) -> None:
        self._units = found.units
        self._reported = {r.name: (r.unit, r.scale, r.offset) for r in found.report}

    def __call__(self, name: str) -> tuple[str, float, float]:
        return self._reported.get(name) or (self._units.get(name, "1"), 1.0, 0.0)

    def unit(self, name: str) -> str:
        """Unit as text."""
        return shown_unit(self(name)[0])

    def of(self, name: str, value: Any) -> Any:
        """Value in that unit."""
        _, scale, offset = self(name)
        return value * scale + offset


def equilibrium_text(found: Equilibrium) -> str:
    """Return outputs, states and unknowns, and the stability."""
    rows: list[tuple[str, ...]] = []
    shown = ReportedUnits(found)
    for word in ("outputs", "states", "unknowns"):
        values: Mapping[str, float] = getattr(found, word)
        rows += [(word, "", "")] if values else []
        for name, value in values.items():
            rows.append((f"  {short(name)}", f"{shown.of(name, value):.9g}", shown.unit(name)))
    turning = [f"`{short(n)}` turns steadily, by {rate:.9g} 1/s" for n, rate in found.steady.items()]
    parts = [title(found.model, found.experiment, f"at rest at t = {found.time:.9g} s"), aligned(rows, "<><")]
    notes = [f"note: {visible(found.note)}"] if found.note else []
    return "\n\n".join([*parts, *turning, stability_text(found.verdict), *notes])


def stability_text(found: Verdict) -> str:
    """Return the verdict as one line."""
    if found.stable is False:
        return f"unstable: it leaves with exp({found.growth:.6g} t/s)"
    if " " in found.kink:
        return f"not decided: {found.kink} is exactly at its threshold, and changes what the model does on one side of this state"
    if found.kink:
        return f"not decided: the equation of `{short(found.kink)}` has another slope on each side of this state, or jumps there"
    if found.stable is None and not found.undecided:
        return "not decided: samples at several rates or offsets, or late by a delay or a jitter, have no eigenvalues of one period"
    if found.stable is None:
        some = ", ".join(_eigenvalue(v) for v in found.undecided[:SHARES])
        return f"not decided: the real part of the eigenvalue {some} 1/s cannot be told from zero (within {found.bound:.2g} 1/s)"
    if found.undamped:
        return f"stable, undamped: {', '.join(f'{abs(v) / (2 * math.pi):.6g} Hz' for v in found.undamped[:SHARES])} never dies away"
    return "stable"


def _eigenvalue(value: complex) -> str:
    return f"{value.real:.6g}" if value.imag == 0 else f"{value.real:.6g} +- {value.imag:.6g}i"


def linearization_text(found: Linearization) -> str:
    """Return the matrices with the names of rows and columns."""
    head = title(found.model, found.experiment, f"linear at t = {found.time:.9g} s")
    parts = [head]
    for name, matrix, rows, columns in (
        ("A", found.A, found.states, found.states), ("B", found.B, found.states, found.inputs),
        ("C", found.C, found.outputs, found.states), ("D", found.D, found.outputs, found.inputs),
    ):  # fmt: skip
        if matrix.size:
            parts.append(_matrix(name, matrix, rows, columns))
    parts += [f"note: {visible(found.note)}"] if found.note else []
    return "\n\n".join(parts)


def _matrix(name: str, matrix: Array, rows: Sequence[str], columns: Sequence[str]) -> str:
    shown = columns[:WIDEST]
    table = [(name, *(short(c, 24) for c in shown))]
    table += [
        (short(r, 24), *(f"{x:.6g}" for x in line[:WIDEST])) for r, line in zip(rows[:LONGEST], matrix, strict=False)
    ]
    text = aligned(table, "<" + ">" * len(shown))
    left = (len(rows) - LONGEST, len(columns) - WIDEST)
    if max(left) > 0:
        text += f"\n({max(left[0], 0)} more rows, {max(left[1], 0)} more columns; --json has all)"
    return text


def modes_text(found: Modes) -> str:
    """Return a line for each mode, with the distribution of its energy."""
    rows = [("frequency", "damped", "damping", "where its energy is")]
    rows += [
        (f"{m.frequency:.9g} Hz", f"{m.damped_frequency:.9g} Hz", f"{m.damping:.4g}", _where(m)) for m in found.modes
    ]
    note = f"\n\nnote: {visible(found.note)}" if found.note else ""
    return (
        f"{title(found.model, found.experiment, f'modes at t = {found.time:.9g} s')}\n\n{aligned(rows, '>>><')}{note}"
    )


def _where(mode: Mode) -> str:
    named = [f"{short(n, 30)} {100 * share:.3g} %" for n, share in list(mode.energy.items())[:SHARES]]
    return ", ".join(named)


def response_text(found: Response) -> str:
    """Return for each pair of input and output the response at the ends, and peaks and dips in between."""
    size, phase = found.magnitude, found.phase
    rows: list[tuple[str, ...]] = [("from", "to", "frequency", "magnitude", "phase", "")]
    for j, given in enumerate(found.inputs):
        for i, seen in enumerate(found.outputs):
            unit, names = shown_unit(found.unit(given, seen)), (short(given, 24), short(seen, 24))
            ends = [
                (*names, *_at_frequency(found.frequencies[k], size[k, i, j], phase[k, i, j], unit), "") for k in (0, -1)
            ]
            inner = [_extremum_row(names, e, unit) for e in _largest(found.extrema_of(given, seen))]
            rows += [ends[0], *inner, ends[1]]
    head = title(found.model, found.experiment, "frequency response")
    return "\n\n".join([head, aligned(rows, "<<>>><"), *map(visible, found.notes)])


def _at_frequency(frequency: float, magnitude: float, phase: float, unit: str) -> tuple[str, str, str]:
    return f"{frequency:.6g} Hz", f"{magnitude:.6g} {unit}".rstrip(), f"{phase:.4g} deg"


def _extremum_row(names: tuple[str, str], found: Extremum, unit: str) -> tuple[str, ...]:
    if math.isinf(found.magnitude):
        return (*names, f"{found.frequency:.6g} Hz", "infinite", "", "peak: undamped")
    return (*names, *_at_frequency(found.frequency, found.magnitude, found.phase, unit), found.kind)


def _largest(found: Sequence[Extremum]) -> list[Extremum]:
    """Return the highest peaks and the deepest dips, rising in frequency."""
    peaks = sorted((e for e in found if e.kind == "peak"), key=lambda e: -e.magnitude)[:PEAKS]
    dips = sorted((e for e in found if e.kind == "dip"), key=lambda e: e.magnitude)[:PEAKS]
    return sorted([*peaks, *dips], key=lambda e: e.frequency)


def response_sensitivity_text(found: ResponseSensitivity) -> str:
    """Return for each pair of input and output, at the ends and at peaks, the effect of one percent of each parameter, the largest first."""
    told, relative, phase = found.response, np.nan_to_num(found.relative), found.phase * found.at / 100
    rows = [("from", "to", "frequency", "magnitude", "by", "percent per percent", "degrees per percent")]
    for j, given in enumerate(told.inputs):
        for i, seen in enumerate(told.outputs):
            column, unit = told.magnitude[:, i, j], told.unit(given, seen)
            peaks = [
                e.frequency
                for e in _largest(told.extrema_of(given, seen))
                if e.kind == "peak" and math.isfinite(e.magnitude)
            ]
            for k in (0, *np.searchsorted(told.frequencies, peaks).tolist(), len(column) - 1):
                size = f"{column[k]:.6g} {shown_unit(unit)}".rstrip()
                head = (short(given, 24), short(seen, 24), f"{told.frequencies[k]:.6g} Hz", size)
                order = sorted(range(len(found.parameters)), key=lambda q: -abs(relative[k, i, j, q]))
                for q in [q for q in order if relative[k, i, j, q] != 0][:STRONGEST]:
                    moves = f"{relative[k, i, j, q]:.4g}", f"{phase[k, i, j, q]:.4g}"
                    rows.append((*head, short(found.parameters[q], 30), *moves))
                    head = ("", "", "", "")
    return (
        f"{title(told.model, told.experiment, 'sensitivity of the frequency response')}\n\n{aligned(rows, '<<>><>>')}"
    )


def outcome_text(found: Outcome) -> str:
    """Return a row for each point of a sweep; for a single point all its results."""
    if not found.swept:
        (point,) = found.points
        made = (point.equilibrium, point.modes, *point.responses, *(found for _, found in point.analyses), point.run)
        parts = [p.summary() for p in made if p is not None]
        return "\n\n".join([*parts, *(f"warning: {visible(str(w))}" for w in found.warnings.get(0, ()))])
    names = found.names[:WIDEST]
    units = [visible(found.shown[n][0]) if n in found.shown else shown_unit(found.units[n]) for n in names]
    rows: list[tuple[str, ...]] = [tuple(short(n, 24) for n in names), tuple(units)]
    for line in found.table()[:LONGEST]:
        shown = [found.shown.get(n, ("", 1.0, 0.0)) for n in names]
        numbers = (f"{x * scale + offset:.7g}" for x, (_, scale, offset) in zip(line, shown, strict=False))
        cells = zip(names, line, numbers, strict=False)
        rows.append(tuple(found.words[n][int(x) - 1] if n in found.words else s for n, x, s in cells))
    text = f"{title(found.model, found.experiment, f'{len(found)} points')}\n\n{aligned(rows, '>' * len(names))}"
    left = len(found) - LONGEST
    text = f"{text}\n({left} more points; --json has all)" if left > 0 else text
    failures = found.failures
    if failures:
        first = next(iter(failures))
        text += f"\n\n{len(failures)} of {len(found)} points failed; point {first + 1}: {visible(failures[first])}"
    warned = found.warnings
    if warned:
        first = next(iter(warned))
        text += (
            f"\n\nwarnings at {len(warned)} of {len(found)} points; point {first + 1}: {visible(str(warned[first][0]))}"
        )
    return "\n\n".join([text, *map(visible, found.notes)])


def sensitivity_text(found: Sensitivity) -> str:
    """Return for each quantity its value, then the effect of one percent of each parameter, the largest first."""
    rows = [("", "value", "by", "slope in SI", "percent per percent")]
    relative, reported = np.nan_to_num(found.relative), ReportedUnits(found)
    for i, name in enumerate(found.quantities):
        order = sorted(range(len(found.parameters)), key=lambda j: -abs(relative[i, j] or found.slopes[i, j]))
        head = (short(name, 30), f"{reported.of(name, found.values[i]):.6g} {reported.unit(name)}".rstrip())
        for j in [j for j in order if found.slopes[i, j] != 0 and not 0 < abs(relative[i, j]) < ROUNDING][:STRONGEST]:
            share = f"{found.relative[i, j]:.4g}" if np.isfinite(found.relative[i, j]) else ""
            rows.append((*head, short(found.parameters[j], 30), f"{found.slopes[i, j]:.6g}", share))
            head = ("", "")
    still = [short(name, 30) for j, name in enumerate(found.parameters) if not found.slopes[:, j].any()][:STRONGEST]
    table = aligned(rows, "<><>>") if len(rows) > 1 else f"nothing here moves with {', '.join(still) or 'anything'}"
    return f"{title(found.model, found.experiment, 'sensitivity')}\n\n{table}"


def branch_text(found: Branch) -> str:
    """Return folds and losses of stability, and some points in between."""
    names = [found.parameter, *list(found.outputs)[: WIDEST - 1]]
    shown = ReportedUnits(found)
    rows: list[tuple[str, ...]] = [("", *(short(n, 24) for n in names)), ("", *map(shown.unit, names))]
    for s in found.special:
        rows.append((s.kind, f"{s.value:.9g}", *(f"{shown.of(n, s.outputs[n]):.9g}" for n in names[1:])))
    chosen = np.unique(np.linspace(0, len(found) - 1, min(len(found), SHOWN)).astype(int))
    for i in chosen:
        numbers = (f"{shown.of(n, found[n][i]):.6g}" for n in names)
        word = "stable" if found.stable[i] else "unstable" if found.unstable[i] else "not decided"
        rows.append((word, *numbers))
    head = title(found.model, found.experiment, f"rest against {found.parameter}, {len(found)} points: {found.ended}")
    parts = [head, aligned(rows, "<" + ">" * len(names))]
    crossing = [s for s in found.special if s.kind == "branch"]
    if crossing and not found.others:
        parts.append(
            "another branch of rest crosses where it says `branch`: `--branch` (in Python `branches=True`) follows it"
        )
    return "\n\n".join([*parts, *map(branch_text, found.others)])


def inversion_text(found: Inversion) -> str:
    """Return the inputs, and the outputs with their targets."""
    shown = ReportedUnits(found)
    rows: list[tuple[str, ...]] = [("input", "value", "", "")]
    rows += [(short(n), f"{shown.of(n, v):.9g}", shown.unit(n), "") for n, v in found.inputs.items()]
    rows.append(("output", "target", "", "off by"))
    for name, value in found.targets.items():
        off = shown.of(name, found.outputs[name]) - shown.of(name, value)
        rows.append((short(name), f"{shown.of(name, value):.9g}", shown.unit(name), f"{off:.2g}"))
    kind = "not decided" if found.stable is None else "stable" if found.stable else "unstable"
    return "\n\n".join([title(found.model, found.experiment, "inverted at rest"), aligned(rows, "<><>"), kind])


def feed_forward_text(found: FeedForward) -> str:
    """Return some instants of the inputs and outputs, the number of differentiations of the outputs, and notes."""
    shown = ReportedUnits(found)
    columns = {n: shown.of(n, v) for n, v in {**found.inputs, **found.outputs}.items()}
    rows: list[tuple[str, ...]] = [("time", *(short(n, 20) for n in columns)), ("s", *map(shown.unit, columns))]
    for i in np.unique(np.linspace(0, len(found.time) - 1, INSTANTS).astype(int)):
        rows.append((f"{found.time[i]:.{digits_of_time(found.time, 6)}g}", *(f"{v[i]:.6g}" for v in columns.values())))
    head = title(found.model, found.experiment, f"inverted along a path, {len(found.time)} points")
    orders = ", ".join(f"{visible(n)} {d}" for n, d in found.degrees.items())
    told = [f"derivatives taken: {orders}", *(visible(n) for n in found.notes)]
    return "\n\n".join([head, aligned(rows, ">" * len(rows[0])), "\n".join(told)])
