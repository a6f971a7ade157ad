"""Random models whose storages share flows: inverse, equilibrium and a long run of each must agree.

A model is a tree of junctions, series and parallel in turn, below a source: storages with linear and hardening laws and starts of their
own, resistors, inertias with losses, transformers, storage fields of two ports, integrals of flows. Storages in one loop or on one node
without a leak keep the sums of their contents, so that the equilibrium depends on the starts.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import bondgraph

DECAYS = 45.0  # time constants of the slowest motion
CLOSE = 1e-8


@dataclass
class Tree:
    """The text of a model, while it grows."""

    chance: random.Random
    lines: list[str] = field(default_factory=list)
    seen: list[str] = field(default_factory=list)  # what may be wanted: what storages and integrals hold
    series: list[str] = field(default_factory=list)  # junctions of one flow
    number: int = 0

    def name(self, letter: str) -> str:
        self.number += 1
        return f"{letter}{self.number}"

    def size(self) -> str:
        return f"{self.chance.uniform(0.5, 2.0):.4f}"

    def storage(self, junction: str) -> None:
        c, start = (
            self.name("c"),
            self.chance.choice(["", "", f" {{ start q = {self.chance.uniform(-0.5, 0.5):.3f} }}"]),
        )
        law = self.chance.choice(["{}*q", "{}*q", "{}*q + 0.3*q^3", "sinh({}*q)"]).format(self.size())
        self.lines += [f"C {c} : e = {law}{start}", f"{junction} -> {c}"]
        self.seen.append(f"{c}.q")

    def resistor(self, junction: str) -> None:
        r = self.name("r")
        law = self.chance.choice(["{}*f", "{}*f", "{}*f + 0.2*f^3"]).format(self.size())
        self.lines += [f"R {r} : e = {law}", f"{junction} -> {r}"]

    def loop(self, depth: int) -> str:
        """A junction of one flow with its elements, always with a resistor, so that all motion decays."""
        j, chance = self.name("j"), self.chance
        self.lines.append(f"1 {j}")
        self.series.append(j)
        self.resistor(j)
        for _ in range(chance.choice([0, 1, 1, 2, 3])):
            self.storage(j)
        if chance.random() < 0.4:
            i = self.name("i")
            self.lines += [f"I {i} : p = {self.size()}*f", f"{j} -> {i}"]
        if chance.random() < 0.4:
            s = self.name("s")
            self.lines.append(f"signal {s} = integral({self.size()}*{j}.f, {chance.uniform(-1, 1):.3f})")
        for _ in range(chance.choice([0, 1, 2]) if depth else 0):
            self.lines.append(f"{j} -> {self.turned(self.node(depth - 1))}")
        return j

    def node(self, depth: int) -> str:
        """A junction of one effort, with a storage and perhaps a leak."""
        j, chance = self.name("n"), self.chance
        self.lines.append(f"0 {j}")
        self.storage(j)
        if chance.random() < 0.3:
            self.resistor(j)
        for _ in range(chance.choice([1, 1, 2])):
            self.lines.append(f"{j} -> {self.turned(self.loop(depth - 1 if depth else 0))}")
        return j

    def turned(self, junction: str) -> str:
        """The junction, perhaps behind a transformer."""
        if self.chance.random() > 0.35:
            return junction
        t, ratio = self.name("t"), self.chance.choice([self.size(), "-" + self.size(), "n"])
        self.lines += [f"TF {t} : f2 = {ratio}*f1", f"{t} -> {junction}"]
        return t

    def field(self) -> None:
        """A storage of two ports between two loops."""
        if len(self.series) > 1 and self.chance.random() < 0.5:
            f, (a, b) = self.name("c"), self.chance.sample(self.series, 2)
            self.lines += [f"C {f}(a, b) : energy = {self.size()}*a^2 + 0.4*a*b + {self.size()}*b^2 + 0.1*(a - b)^4"]
            self.lines += [f"{a} -> {f}.a", f"{b} -> {f}.b"]
            self.seen += [f"{f}.a", f"{f}.b"]


def random_text(seed: int) -> str:
    """A plain model with the input `load` and the output `y`, which is stored somewhere."""
    tree = Tree(random.Random(seed))
    first = tree.loop(2)
    tree.storage(first)
    tree.field()
    lines = [*tree.lines, f"output y = {tree.chance.choice(tree.seen)}"]
    return (
        "plain model T {\n  input load = 0\n  parameter n = 1.3\n  MSe u : e = load\n  u -> "
        + first
        + "\n  "
        + "\n  ".join(lines)
        + "\n}\n"
    )


@dataclass(frozen=True)
class Agreement:
    """Results for one model: the wanted output, the output at rest and at the end of a long run; None if no input moves it there."""

    wanted: float
    rest: float | None
    final: float | None
    shared: int
    conserved: int
    told: str = ""


def agreement(model: Any, source: str, output: str, wanted: float, target: str | None = None) -> Agreement:
    """Inverse, equilibrium and run of a model. Only errors other than refusals are raised."""
    shared = len(model.certificate.following)
    try:
        given = model.invert({output: wanted}, [source]).inputs
    except bondgraph.RunFailed as refused:
        return Agreement(wanted, None, None, shared, 0, str(refused))
    rest = model.equilibrium(settings=given)
    A = model.linearize(settings=given).A
    rates = -np.linalg.eigvals(A).real
    slow = rates[rates > 1e-7 * max(1e-300, np.abs(rates).max())]
    stop = DECAYS / slow.min()
    ran = model.simulate(to=stop, points=2, rtol=1e-10, settings=given, target=target)
    return Agreement(
        wanted, rest[output], float(ran.final(output)), shared, int((np.abs(rates) < 1e-7 * np.abs(rates).max()).sum())
    )
