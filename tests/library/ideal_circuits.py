"""Circuits with ideal diodes and switches, solved exactly and independently of the product.

Node voltages and branch currents as E z' = A z (sources are states of oscillators), one pencil for each set of conducting elements; its
finite part (Weierstrass form, by an ordered Schur decomposition) is stepped by matrix exponentials. Switching instants are roots of the
voltages of blocking diodes and the currents of conducting diodes, by Brent's method. After an instant the new set is the one for which
all of these have the right sign a little later; stored quantities pass over by the projector along the infinite part (charge and flux
are conserved).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm, schur
from scipy.optimize import brentq


@dataclass
class Circuit:
    """Branches between numbered nodes; 0 is the ground. The positive direction of a current is from `a` to `b`."""

    resistors: list[tuple[int, int, float]] = field(default_factory=list)
    capacitors: list[tuple[int, int, float, float]] = field(default_factory=list)  # value and start
    inductors: list[tuple[int, int, float, float]] = field(default_factory=list)
    sources: list[tuple[int, int, float, float, float, float]] = field(
        default_factory=list
    )  # offset, amplitude, omega, phase
    diodes: list[tuple[int, int]] = field(default_factory=list)
    switches: list[tuple[int, int, Callable[[int], bool]]] = field(default_factory=list)  # closed in which interval
    instants: Sequence[float] = ()  # of the switches: interval k lies before instant k
    leak: float | None = None  # ohm across each diode, where something floats

    def __post_init__(self) -> None:
        branches = [*self.resistors, *self.capacitors, *self.inductors, *self.sources, *self.diodes, *self.switches]
        self.nodes = max(max(b[:2]) for b in branches)
        self.kinds = [len(self.inductors), len(self.sources), len(self.diodes), len(self.switches)]
        self.first = np.cumsum([self.nodes, *self.kinds])
        self.size = int(self.first[-1]) + 2 * len(self.sources) + 1
        self.volts = max(
            abs(x)
            for x in [*(s[2] for s in self.sources), *(s[3] for s in self.sources), *(c[3] for c in self.capacitors)]
        )
        self.pencils: dict[tuple[bytes, int], tuple[np.ndarray, np.ndarray, np.ndarray] | None] = {}

    def start(self) -> np.ndarray:
        """Values before the run, consistent or not: E z holds the stored quantities."""
        z = np.zeros(self.size)
        z[-1] = 1.0
        for k, (*_, phase) in enumerate(self.sources):
            z[self.first[4] + 2 * k : self.first[4] + 2 * k + 2] = np.sin(phase), np.cos(phase)
        z[self.first[0] : self.first[1]] = [i for *_, i in self.inductors]
        if self.capacitors:
            rows = np.array([self._difference(a, b) for a, b, *_ in self.capacitors])
            z[: self.nodes] = np.linalg.lstsq(rows, np.array([u for *_, u in self.capacitors]), rcond=None)[0]
        return z

    def _difference(self, a: int, b: int) -> np.ndarray:
        row = np.zeros(self.nodes)
        if a:
            row[a - 1] += 1
        if b:
            row[b - 1] -= 1
        return row

    def matrices(self, on: np.ndarray, interval: int) -> tuple[np.ndarray, np.ndarray]:
        """E and A of E z' = A z."""
        n, size = self.nodes, self.size
        e, a = np.zeros((size, size)), np.zeros((size, size))
        for p, q, r in [*self.resistors, *((p, q, self.leak) for p, q in self.diodes if self.leak)]:
            d = self._difference(p, q)
            a[:n, :n] -= np.outer(d, d) / r
        for p, q, c, _ in self.capacitors:
            d = self._difference(p, q)
            e[:n, :n] += np.outer(d, d) * c
        own = n
        for p, q, inductance, _ in self.inductors:
            d = self._difference(p, q)
            a[:n, own] -= d
            a[own, :n], e[own, own] = d, inductance
            own += 1
        oscillator = int(self.first[4])
        for p, q, offset, amplitude, omega, _ in self.sources:
            d = self._difference(p, q)
            a[:n, own] -= d
            a[own, :n], a[own, oscillator], a[own, -1] = d, -amplitude, -offset
            e[oscillator, oscillator] = e[oscillator + 1, oscillator + 1] = 1.0
            a[oscillator, oscillator + 1], a[oscillator + 1, oscillator] = omega, -omega
            own, oscillator = own + 1, oscillator + 2
        closed = [*on, *(s(interval) for *_, s in self.switches)]
        for (p, q, *_), c in zip([*self.diodes, *self.switches], closed, strict=True):
            d = self._difference(p, q)
            a[:n, own] -= d
            if c:
                a[own, :n] = d
            else:
                a[own, own] = 1.0
            own += 1
        e[-1, -1] = 1.0
        return e, a

    def pencil(self, on: np.ndarray, interval: int) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Basis of the finite part, its rates, and the projector onto its coordinates; None for a singular pencil."""
        key = on.tobytes(), interval if self.switches else 0
        if key not in self.pencils:
            self.pencils[key] = self._pencil(*self.matrices(on, interval))
        return self.pencils[key]

    def _pencil(self, e: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        shift = 1.2345 * max((w for *_, w, _ in self.sources), default=1.0) + 345.6
        matrix = a - shift * e
        rows = np.abs(matrix).max(axis=1)
        if (rows == 0).any():
            return None
        matrix = matrix / rows[:, None]
        columns = np.abs(matrix).max(axis=0)
        if (columns == 0).any() or np.linalg.cond(matrix / columns) > 1e14:
            return None
        m = np.linalg.solve(matrix / columns, e / rows[:, None]) / columns[:, None]
        scale = np.abs(np.linalg.eigvals(m)).max()
        t, q, count = schur(m, output="real", sort=lambda x, y: np.hypot(x, y) > 1e-7 * scale)
        left = np.linalg.solve
        # [X1 X2] block-diagonalises: the projector onto the first part along the second.
        t11, t12, t22 = t[:count, :count], t[:count, count:], t[count:, count:]
        from scipy.linalg import solve_sylvester

        y = solve_sylvester(t11, -t22, -t12) if count < len(t) else np.zeros((count, 0))
        project = np.concatenate([np.eye(count), -y], axis=1) @ q.T
        rates = shift * np.eye(count) + left(t11, np.eye(count))
        return q[:, :count], rates, project

    def sides(self, z: np.ndarray, on: np.ndarray) -> np.ndarray:
        """Per diode what must not be negative: -u where it blocks, i where it conducts."""
        own = self.first[2]
        voltages = np.array([self._difference(p, q) @ z[: self.nodes] for p, q in self.diodes])
        return np.where(on, z[own : own + len(self.diodes)], -voltages)


def solve(circuit: Circuit, times: np.ndarray, grid: float, guess: Sequence[int] = ()) -> tuple[np.ndarray, int]:
    """z at the times (values just after instants), and how often diodes switched. `grid`: how densely roots are looked for."""
    z, now, interval = circuit.start(), 0.0, 0
    on = np.array([k in guess for k in range(len(circuit.diodes))])
    result, changes = np.empty((len(times), circuit.size)), 0
    on, z = selected(circuit, z, on, interval, grid)
    place = 0
    stop = times[-1]
    while True:
        end = min(circuit.instants[interval] if interval < len(circuit.instants) else stop, stop)
        found = circuit.pencil(on, interval)
        assert found is not None
        basis, rates, project = found
        y = project @ z
        flip = _first_flip(circuit, on, basis, rates, y, end - now, grid)
        reach = end - now if flip is None else flip
        while place < len(times) and (
            times[place] < now + reach or (flip is None and end == stop and times[place] <= stop)
        ):
            result[place] = basis @ (expm(rates * (times[place] - now)) @ y)
            place += 1
        z, now = basis @ (expm(rates * reach) @ y), now + reach
        if flip is None and end == stop:
            return result, changes
        if flip is None:
            interval += 1
        else:
            changes += 1
        on, z = selected(circuit, z, on, interval, grid)


def _first_flip(
    circuit: Circuit, on: np.ndarray, basis: np.ndarray, rates: np.ndarray, y: np.ndarray, span: float, grid: float
) -> float | None:
    """The first instant, from now, at which a diode's side becomes negative; None within the span."""
    if not len(on):
        return None
    count = max(2, int(np.ceil(span / grid)))
    step = span / count
    matrix, states = expm(rates * step), [y]
    for _ in range(count):
        states.append(matrix @ states[-1])
    sides = np.array([circuit.sides(basis @ s, on) for s in states])
    size = np.abs(sides).max() + 1e-30
    for k in range(1, count + 1):
        bad = np.flatnonzero(sides[k] < -2e-8 * np.where(on, circuit.volts / 100, circuit.volts))
        if not len(bad):
            continue

        def side(t: float, d: int, origin: np.ndarray = states[k - 1]) -> float:
            return float(circuit.sides(basis @ (expm(rates * t) @ origin), on)[d])

        roots = []
        for d in bad:
            if side(0.0, d) <= 1e-9 * size:  # it left zero within this step
                lows = [step * 0.5**j for j in range(1, 40) if side(step * 0.5**j, d) > 0]
                low = lows[0] if lows else step
            else:
                low = 0.0
            roots.append(brentq(lambda t, d=d: side(t, d), low, step, xtol=1e-18, rtol=1e-14) if low < step else 0.0)
        return float((k - 1) * step + min(roots))
    return None


def selected(
    circuit: Circuit, z: np.ndarray, on: np.ndarray, interval: int, grid: float
) -> tuple[np.ndarray, np.ndarray]:
    """Set of conducting diodes for which all signs are right a little later, the nearest first, and the quantities that pass over."""

    def wrong(trial: np.ndarray) -> np.ndarray | None:
        found = circuit.pencil(trial, interval)
        if found is None:
            return None
        basis, rates, project = found
        y = project @ z
        low = np.zeros(len(trial), dtype=bool)
        for share in (1e-3, 1e-2):
            sides = circuit.sides(basis @ (expm(rates * share * grid) @ y), trial)
            low |= sides < -1e-8 * np.where(trial, circuit.volts / 100, circuit.volts)
        return low

    if not len(on):
        found = circuit.pencil(on, interval)
        assert found is not None
        return on, found[0] @ (found[2] @ z)
    everything: Iterable[np.ndarray] = (
        np.array(x, dtype=bool) for x in itertools.product((False, True), repeat=len(on))
    )
    if len(on) > 7:  # then those with few flips
        flips = (np.isin(np.arange(len(on)), x) for k in (1, 2, 3) for x in itertools.combinations(range(len(on)), k))
        everything = (on ^ x for x in flips)
    stored = circuit.matrices(on, interval)[0] @ z
    trial, order = on.copy(), []
    while trial is not None and not any((trial == x).all() for x in order):
        order.append(trial)
        low = wrong(trial)
        trial = (
            None
            if low is None or not low.any()
            else np.where(np.arange(len(on)) == np.flatnonzero(low)[0], ~trial, trial)
        )
    rest = everything if len(on) > 7 else sorted(everything, key=lambda x: int((x != on).sum()))
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    for trial in itertools.chain(order, rest):
        low = wrong(trial)
        if low is None or low.any():
            continue
        after = _passed(circuit, z, trial, interval)
        jump = float(np.abs(circuit.matrices(on, interval)[0] @ after - stored)[: circuit.first[2]].max())
        if jump <= 1e-9 * np.abs(stored).max():
            return trial, after
        if best is None or jump < best[0]:
            best = jump, trial, after
    assert best is not None, "the reference finds no consistent set"
    return best[1], best[2]


def _passed(circuit: Circuit, z: np.ndarray, on: np.ndarray, interval: int) -> np.ndarray:
    found = circuit.pencil(on, interval)
    assert found is not None
    return found[0] @ (found[2] @ z)
