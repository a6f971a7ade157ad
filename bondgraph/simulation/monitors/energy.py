"""Energy balance of a run: energy from sources, losses in resistors, and the increase of stored energy.

Work is integrated; the stored energy is computed from the state alone (the storage's energy, or the integral of its law), so the residual is an
independent measure of the error of the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, letters

from ...results.records import ElementEnergy, EnergyBalance

if TYPE_CHECKING:
    from compiler.api import StateSpace, Storage

LEFT_OUT = "left out"
DELAY = "delay"
UNEXPLAINED = 1e4  # in units of rtol times the energy turnover: larger residuals are reported
# relative to the largest power of a resistor, and to the mean of all: delivered power below this is ignored
GIVEN = 1e-6
ROUNDING = 1e-12  # relative to the energy of a mechanism


def energy_balance(
    space: StateSpace, work: Array, before: Array, after: Array, arguments: dict[int, float], jumps: Sequence[tuple[Any, Any]] = (),
    left: Sequence[tuple[Any, Any]] = (),
) -> EnergyBalance:  # fmt: skip
    """Return the balance from the integrated powers and the stored quantities before and after.

    `work` has one item per port; `before` and `after` are the mechanisms' energies and then the stored quantities, as the program's `powers` gives
    them; `arguments`: the values of the storages' parameters. `jumps`: the same before and after each event, which dissipates the decrease of stored
    energy; `left`: the same before and after each removal of fast modes.
    """
    elements: list[ElementEnergy] = []
    by_element: dict[str, tuple[str, float]] = {}
    for port, joules in zip(space.ports, work[: len(space.ports)], strict=True):
        if not port.is_balanced:
            continue
        # the law of an end of a line adds what was at its other end: its bond takes what is on its way
        own = DELAY if port.delayed and port.kind in letters("loss") else port.kind
        kind, total = by_element.get(port.element, (own, 0.0))
        by_element[port.element] = (kind, total + float(joules))
    for name, (kind, joules) in by_element.items():
        if kind in letters("source"):
            elements.append(ElementEnergy(name, kind, 0.0, -joules, 0.0))
        elif kind in letters("loss"):
            elements.append(ElementEnergy(name, kind, 0.0, 0.0, joules))
        elif kind == DELAY:
            elements.append(ElementEnergy(name, kind, joules, 0.0, 0.0))
        elif kind in letters("transducer"):
            elements.append(ElementEnergy(name, kind, 0.0, 0.0, 0.0, joules))
    jumped: dict[str, float] = {}  # change of each storage's energy by events, which its bonds do not carry
    for pair in (*jumps, *left):
        for storage, change in _changes(space, *pair, arguments):
            jumped[storage.element] = jumped.get(storage.element, 0.0) + change
    for place, name in enumerate(space.stored, len(space.ports)):
        elements.append(ElementEnergy(name, "multibody", float(after[place] - before[place]), 0.0, 0.0))
    for storage, change in _changes(space, before, after, arguments):
        brought = by_element.get(storage.element, (storage.kind, change))[1]
        residual = brought - change + jumped.get(storage.element, 0.0)
        elements.append(ElementEnergy(storage.element, storage.kind, change, 0.0, 0.0, residual))
    for name, (kind, joules) in by_element.items():  # storages in derivative form: their work is their stored energy
        if kind in letters("storage") and not any(s.element == name for s, _ in _contents(space)):
            elements.append(ElementEnergy(name, kind, joules, 0.0, 0.0))
    if jumps:
        lost = -sum(_change(space, *jump, arguments) for jump in jumps)
        elements.append(ElementEnergy("when", "event", 0.0, 0.0, lost))
    if left:
        elements.append(
            ElementEnergy(LEFT_OUT, "bandwidth", 0.0, 0.0, -sum(_change(space, *pair, arguments) for pair in left))
        )
    stored, supplied, dissipated = (
        float(sum(getattr(e, f) for e in elements)) for f in ("stored", "supplied", "dissipated")
    )
    residual = supplied - dissipated - stored
    if len(space.stored) == 1:  # the mechanism's own bonds are not recorded: it gets the rest of the balance
        others = sum(e.residual for e in elements)
        elements = [replace(e, residual=residual - others) if e.kind == "multibody" else e for e in elements]
    return EnergyBalance(tuple(elements), stored, supplied, dissipated, residual)


def _contents(space: StateSpace) -> Iterator[tuple[Storage, slice]]:
    """Yield each storage that a balance counts, with the places of its content among the values of the program's `powers`."""
    stop = len(space.ports) + len(space.stored)
    others = unbalanced(space)
    for storage in space.storages:
        start, stop = stop, stop + len(storage.stored)
        if storage.element not in others:
            yield storage, slice(start, stop)


def unbalanced(space: StateSpace) -> tuple[str, ...]:
    """Return the elements with a port at which effort times flow is no power."""
    return tuple(dict.fromkeys(p.element for p in space.ports if not p.is_balanced))


def _changes(space: StateSpace, before: Array, after: Array, arguments: dict[int, float]) -> Iterator[tuple[Storage, float]]:  # fmt: skip
    """Yield each storage with the change of its energy in J."""
    for storage, places in _contents(space):
        yield storage, stored_change(storage, before[places], after[places], arguments)


def givers(space: StateSpace, instants: Array, powers: Array, turnover: float) -> list[str]:
    """Return resistors that deliver power at reported instants, as sentences.

    `powers`: shape (instants, ports …); `turnover`: total energy turnover in J.
    """
    by_element: dict[str, Any] = {}
    for column, port in enumerate(space.ports):
        if port.kind in letters("loss") and port.is_balanced and not port.delayed:
            by_element[port.element] = by_element.get(port.element, 0.0) + powers[:, column]
    span = float(instants[-1] - instants[0]) if len(instants) > 1 else 1.0
    sentences = []
    for name, watts in by_element.items():
        worst = int(np.argmin(watts))
        if watts[worst] < -GIVEN * max(float(np.abs(watts).max()), turnover / max(span, 1e-300)):
            first = int(np.flatnonzero(watts < -GIVEN * np.abs(watts).max())[0])
            sentences.append(
                f"`{name}` gives energy where a resistor takes it: from t = {instants[first]:.9g} s on, most of it "
                f"({-watts[worst]:.6g} W) at t = {instants[worst]:.9g} s"
            )
    return sentences


def unexplained(balance: EnergyBalance, turnover: float, rtol: float) -> list[str]:
    """Return elements whose work differs from their stored and dissipated energy by more than the tolerance explains; as sentences."""
    return [
        f"`{e.name}` {'loses' if e.residual > 0 else 'creates'} {abs(e.residual):.6g} J that its law does not explain: what its bonds brought is "
        "not what it stores more"
        for e in balance.elements
        if abs(e.residual) > UNEXPLAINED * rtol * turnover
    ]


def _change(space: StateSpace, before: Array, after: Array, arguments: dict[int, float]) -> float:
    """Return the change of all stored energy, in J."""
    mechanisms = slice(len(space.ports), len(space.ports) + len(space.stored))
    changes = (change for _, change in _changes(space, before, after, arguments))
    return sum(changes, start=float(np.sum(after[mechanisms] - before[mechanisms])))


def impulse_loss(
    space: StateSpace, held: Mapping[str, Any], after: Array, arguments: dict[int, float]
) -> EnergyBalance | None:  # fmt: skip
    """Return the energy dissipated by impulses where junctions switch; None if it is zero. `held`: content of each storage, and energy of each
    mechanism before, by its name."""
    elements = [
        ElementEnergy(s.element, s.kind, stored_change(s, held[s.element], after[places], arguments), 0.0, 0.0)
        for s, places in _contents(space)
        if s.element in held
    ]
    for place, name in enumerate(space.stored, len(space.ports)):
        change = float(after[place] - held.get(name, after[place]))
        if abs(change) > ROUNDING * abs(after[place]):  # the sum of the same energies in another program
            elements.append(ElementEnergy(name, "multibody", change, 0.0, 0.0))
    total = sum(element.stored for element in elements)
    if total == 0:
        return None
    return EnergyBalance((*elements, ElementEnergy("active", "event", 0.0, 0.0, -total)), total, 0.0, -total, 0.0)


def held_in(space: StateSpace, powers: Array) -> dict[str, Any]:
    """Return the content of each storage and the energy of each mechanism, by its name, from the program's `powers`."""
    mechanisms = {name: powers[place] for place, name in enumerate(space.stored, len(space.ports))}
    return mechanisms | {storage.element: powers[places] for storage, places in _contents(space)}


def added(balances: Sequence[EnergyBalance]) -> EnergyBalance | None:
    """Return the balance of a run as the sum over its phases; None if there are none."""
    if len(balances) < 2:
        return balances[0] if balances else None
    sums: dict[tuple[str, str], Any] = {}
    for element in (e for balance in balances for e in balance.elements):
        earlier = sums.get((element.name, element.kind), np.zeros(4))
        energies = (element.stored, element.supplied, element.dissipated, element.residual)
        sums[element.name, element.kind] = np.add(earlier, energies)
    elements = tuple(ElementEnergy(name, kind, *map(float, total)) for (name, kind), total in sums.items())
    totals = (sum(getattr(b, word) for b in balances) for word in ("stored", "supplied", "dissipated", "residual"))
    return EnergyBalance(elements, *totals)


def stored_change(storage: Storage, before: Array, after: Array, arguments: dict[int, float]) -> float:
    """Return the change of a storage's energy in J: from its energy function, or the integral of its law between the two states."""
    from compiler.api import evaluate

    count = len(before)
    values = [a if isinstance(a, float) else arguments[a] for a in storage.arguments]

    def at(expression: Any, stored: Array) -> float:
        return evaluate(expression, lambda slot: float(stored[slot]) if slot < count else values[slot - count])

    if storage.energy is not None:
        return at(storage.energy, after) - at(storage.energy, before)
    change = np.asarray(after, dtype=float) - np.asarray(before, dtype=float)
    if not change.any():
        return 0.0
    from scipy.integrate import quad

    def slope(s: float) -> float:
        return float(sum(at(law, before + s * change) * d for law, d in zip(storage.laws, change, strict=True)))

    return float(quad(slope, 0.0, 1.0, epsrel=1e-12, epsabs=0.0, limit=200, full_output=1)[0])
