"""The text of a numbered circuit, written in many equivalent ways: branches and arrows turned, junctions split, valves in their dual forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from tests.library.ideal_circuits import Circuit

VALVES = ("gap", "turned gap", "line")


def text(
    circuit: Circuit, seed: int | None, columns: Sequence[str], stop: float, valves: Sequence[str] = VALVES
) -> str:
    """A plain model of a circuit; `seed` decides how it is written, None: as it is numbered. `columns`: its outputs."""
    numbers = np.random.default_rng(seed)
    plain = seed is None

    def turned() -> bool:
        return not plain and bool(numbers.integers(2))

    lines, pieces = [], list[str]()
    lines += [f"0 n{k}" for k in range(circuit.nodes + 1)]
    lines += ["Se earth : e = 0", "earth -> n0"]

    def branch(name: str, a: int, b: int) -> tuple[str, int]:
        """A line between two nodes, and the sign of its flow from a to b."""
        sign = -1 if turned() else 1
        ends = [f"n{a}", f"n{b}"][::sign]
        if turned():
            kind, place = ("0", "1")[int(numbers.integers(2))], int(numbers.integers(2))
            lines.append(f"{kind} {name}_more")
            ends[place] = f"{ends[0]} -> {name}_more" if place == 0 else f"{name}_more -> {ends[1]}"
        lines.append(f"1 {name}")
        pieces.append(f"{ends[0]} -> {name} -> {ends[1]}")
        return name, sign

    def element(line: str, declaration: Callable[[int], str], name: str) -> None:
        """An element on a line; the law of a source has the sign of its arrow, which points into all others."""
        turn = name.startswith("s") and turned()
        lines.append(declaration(-1 if turn else 1))
        pieces.append(f"{name} -> {line}" if turn else f"{line} -> {name}")

    for k, (a, b, r) in enumerate(circuit.resistors):
        line, _ = branch(f"line_r{k}", a, b)
        element(line, lambda s, k=k, r=r: f"R r{k} : e = {s * r!r}*f", f"r{k}")  # type: ignore[misc]
    for k, (a, b, c, u) in enumerate(circuit.capacitors):
        line, sign = branch(f"line_c{k}", a, b)
        start = f"{{ start q = {sign * c * u!r} }}"
        element(line, lambda s, k=k, c=c, t=start: f"C c{k} : e = {s / c!r}*q {t}", f"c{k}")  # type: ignore[misc]
    for k, (a, b, inductance, i) in enumerate(circuit.inductors):
        line, sign = branch(f"line_l{k}", a, b)
        element(
            line,
            lambda s, k=k, v=inductance, f=sign * i: f"I l{k} : p = {s * v!r}*f {{ start p = {s * v * f!r} }}",  # type: ignore[misc]
            f"l{k}",
        )
    for k, (a, b, offset, amplitude, omega, phase) in enumerate(circuit.sources):
        line, sign = branch(f"line_s{k}", a, b)
        law = f"({offset!r} + {amplitude!r}*sin({omega!r}*time + {phase!r}))"
        element(line, lambda s, k=k, g=sign, w=law: f"Se s{k} : e = {s * g}*{w}", f"s{k}")  # type: ignore[misc]
    for k, (a, b) in enumerate(circuit.diodes):
        line, sign = branch(f"line_d{k}", a, b)
        form = "gap" if plain else str(numbers.choice(valves))
        forward = "<" if sign > 0 else ">"  # of a flow that ends conduction
        lines.append(f"mode d{k} = false")
        pieces.append(f"when d{k} and {line}.f {forward} 0 {{ d{k} = false }}")
        if form == "line":
            lines.remove(f"1 {line}")
            lines.append(f"1 {line} {{ active = d{k} }}")
            pieces.append(f"when not d{k} and n{a}.e > n{b}.e {{ d{k} = true }}")
            continue
        lines.append(f"0 gap{k} {{ active = not d{k} }}")
        arrow = 1 if form == "gap" else -1
        pieces.append(f"{line} -> gap{k}" if arrow > 0 else f"gap{k} -> {line}")
        pieces.append(f"when not d{k} and gap{k}.e {'>' if arrow * sign > 0 else '<'} 0 {{ d{k} = true }}")
    edges = [0.0, *circuit.instants, 2 * stop]
    for k, (a, b, closed) in enumerate(circuit.switches):
        line, _ = branch(f"line_w{k}", a, b)
        shut = [f"(time >= {p!r} and time < {q!r})" for n, (p, q) in enumerate(pairwise(edges)) if closed(n)]
        lines.append(f"0 hole{k} {{ active = not ({' or '.join(shut)}) }}")
        pieces.append(f"{line} -> hole{k}")
    body = [
        *(numbers.permutation(lines) if not plain else lines),
        *(numbers.permutation(pieces) if not plain else pieces),
    ]
    outputs = [f"output {name} = {value}" for name, value in (c.split(" = ") for c in columns)]
    return "plain model Circuit {\n  " + "\n  ".join([*body, *outputs]) + "\n}"
