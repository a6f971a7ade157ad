"""Heat that leaves a part through its thermal port is counted once: the energy of a run closes, and what a part loses is the heat that a body behind it stores."""

from __future__ import annotations

import re

import pytest

import bondgraph
from bondgraph.catalogue import example_of, interface_of
from tests.library.bench import RTOL
from tests.library.test_examples import PARTS, example

THERMAL = [p.name for p in PARTS if any(port.domain == "thermal" for port in interface_of(p).ports)]
SOURCES = {"Ambient", "HeatSource"}  # all others give what they get
HEATING = [p.name for p in PARTS if re.search(r"^part\.heat -> air$", p.example, re.MULTILINE)]


@pytest.mark.parametrize("name", THERMAL)
def test_a_part_with_heat_neither_loses_nor_supplies(name: str) -> None:
    energy = example(name).simulate(rtol=RTOL, points=3, energy=True).energy
    assert energy is not None
    turnover = max(abs(e.supplied) for e in energy.elements)
    assert turnover > 0 and abs(energy.residual) < 1e-7 * turnover
    inside = [e for e in energy.elements if e.name.startswith("part.")]
    assert all(abs(e.dissipated) < 1e-9 * turnover for e in inside)
    assert name in SOURCES or all(e.supplied == 0 for e in inside)


@pytest.mark.parametrize("name", HEATING)
def test_what_a_part_loses_is_stored_behind_it(name: str) -> None:
    """A body in place of the air, of the same temperature, stores the work that enters by the other ports."""
    (part,) = (p for p in PARTS if p.name == name)
    text = re.sub(
        r"Se air +: T = (.*)", r"C air : T = 293.15 K*exp(S/1 [kJ/K]) { start T = \1 }", example_of(part, PARTS)
    )
    work = " + ".join(f"{'-' * (not p.enters)}part.{p.name}.{'M*part.' + p.name + '.omega' if p.domain == 'rotation' else 'u*part.' + p.name + '.i'}"
                      for p in interface_of(part).ports if p.domain != "thermal")  # fmt: skip
    text = re.sub(
        r"report .*}", "}", text.replace("  experiment", f"  output work = integral({work}, 0 J)\n  experiment")
    )
    run = bondgraph.load(text).simulate(rtol=RTOL, points=3, energy=True)
    assert run.energy is not None
    (air,) = (e for e in run.energy.elements if e.name == "air")
    assert air.stored == pytest.approx(run.final("work"), rel=1e-6, abs=1e-9) and air.stored > 1e-6
