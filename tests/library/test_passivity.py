"""What dissipates takes power for any sign of what flows through it, and what conducts heat makes entropy: each resistor of each part at random points."""

from __future__ import annotations

import random

import pytest

from compiler.algebra.expression import Symbol, evaluate, symbols
from compiler.graph.elements import Kind
from compiler.graph.network import BondGraph, Element, PortVariable
from tests.library.test_examples import NAMES, example
from tests.library.test_parameters import value

POINTS = 40
# Laws that read what other elements have at the same instant, which no random number can be; and a fit for speeds forward alone.
BESIDE = {
    "DryFriction.surface",
    "Lugre.surface",
    "GroundPoint.damper",
    "GroundPoint.friction",
    "GroundBall.damper",
    "TorqueConverter.oil",
    *(f"{line}.{end}" for line in ("TransmissionLine", "WaveLine") for end in ("near", "far")),  # their waves come back
}


def at_random(graph: BondGraph, element: Element, rng: random.Random) -> dict[PortVariable, float]:
    """Efforts and flows at a point; what the law reads of signals and modes is a number between 0 and 1, often near an end."""
    read: dict[object, float] = {}
    known: dict[PortVariable, float] = {}

    def look(key: object) -> float:
        if isinstance(key, PortVariable):
            return known[key]
        assert isinstance(key, int)
        argument = element.arguments[key]
        try:
            return value(graph, argument, {})
        except LookupError:
            return read.setdefault(argument, rng.choice((1e-9, 1.0, rng.uniform(0.1, 1))))

    lefts = [left.key for left, _ in element.law.equations if isinstance(left, Symbol)]
    rights = {s.key for _, right in element.law.equations for s in symbols(right) if isinstance(s.key, PortVariable)}
    size = 10 ** rng.uniform(-4, 4)
    for key in sorted(rights - {*lefts}, key=str):
        is_temperature = element.ports[key.port].domain == "thermal" and key.variable == "e"
        known[key] = rng.uniform(250, 400) if is_temperature else rng.uniform(-size, size)
    for left, right in element.law.equations:
        assert isinstance(left, Symbol) and isinstance(left.key, PortVariable)
        known[left.key] = evaluate(right, look)
    return known


@pytest.mark.parametrize("name", NAMES)
def test_what_dissipates_takes_power(name: str) -> None:
    graph = example(name).compilation().whole_graph
    rng = random.Random(name)
    for element in graph.nodes:
        if (
            not isinstance(element, Element)
            or element.kind is not Kind.RESISTOR
            or not element.name.startswith("part.")
        ):
            continue
        if element.name.replace("part", name) in BESIDE:
            continue
        warm = [i for i, port in enumerate(element.ports) if port.domain == "thermal"]
        for _ in range(POINTS):
            at = at_random(graph, element, rng)
            power = [at[PortVariable(i, "e")] * at[PortVariable(i, "f")] for i in range(len(element.ports))]
            if len(warm) > 1:  # heat passes: all power that enters leaves by the last port, with more entropy
                entropy = [at[PortVariable(i, "f")] for i in warm]
                assert 2 * entropy[-1] - sum(entropy) >= -1e-12 * sum(map(abs, entropy)), at
                assert abs(2 * power[-1] - sum(power)) <= 1e-9 * sum(map(abs, power)), at
            else:
                taken = [p for i, p in enumerate(power) if i not in warm]
                assert sum(taken) >= -1e-9 * sum(map(abs, taken)), at
