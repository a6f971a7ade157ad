"""Effort and flow of every bond along a run: no junction loses power, and the power of sources is stored or dissipated."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.presentation.page.bonds import bond_columns
from bondgraph.presentation.page.runs import PageModel, energies, shown_energies
from compiler.api import Element, Junction
from tests.compiling import MODELS

FILES = sorted(p for p in MODELS.glob("*.bg") if p.name != "mems.bg")
# Ones, zeros, junctions beside junctions, transformers, a mechanism that bonds enter and leave.
RUN = ["oscillator", "dc_motor", "quarter_car", "four_bar"]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.stem))
def test_every_bond_is_known(path) -> None:
    """But for those inside a lever of axes, whose transformers have no names to be read by."""
    watched = PageModel(bondgraph.load(path))
    unnamed = {n for n, node in enumerate(watched.graph.nodes) if isinstance(node, Element) and "(" in node.name}
    for bond, place in zip(watched.graph.bonds, watched.bonds.places, strict=True):
        assert None not in place or unnamed & {bond.tail.node, bond.head.node}


def test_a_lever_of_axes_runs() -> None:
    """Its transformers are asked for nothing."""
    assert PageModel(bondgraph.load(MODELS / "stiffness_frames.bg")).simulate("").steps > 0


@pytest.mark.parametrize("name", RUN)
def test_no_junction_keeps_power(name: str) -> None:
    watched = PageModel(bondgraph.load(MODELS / f"{name}.bg"))
    result = watched.simulate("")
    columns = watched.bonds.values(result.to_numpy(), len(result.time))
    graph = watched.graph
    power = [columns[e] * columns[f] for e, f in watched.bonds.places]
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction):
            around = graph.incident[number]
            total = sum(power[b] * (1 if graph.bonds[b].head.node == number else -1) for b in around)
            assert np.abs(total).max() <= 1e-9 * max(np.abs(power[b]).max() for b in around)
    supplied, dissipated, stored = energies(watched, result.time, columns)
    assert np.abs(power).max() > 0
    assert np.abs(supplied - dissipated - stored).max() <= 1e-9 * np.abs(power).max() * result.time[-1]


def test_the_energy_is_that_of_the_balance() -> None:
    watched = PageModel(bondgraph.load(MODELS / "oscillator.bg"))
    result = watched.simulate("", energy=True)
    columns = watched.bonds.values(result.to_numpy(), len(result.time))
    found = shown_energies(watched, result, columns)[:, -1]
    balance = result.energy
    assert found == pytest.approx([balance.supplied, balance.dissipated, balance.stored], rel=0.02, abs=2e-4)


SWITCHED = """import Switch from electric
model A {
  Se src : u = 12 V
  I coil : lambda = 1 mH*i
  R load : u = 10 ohm*i
  C cap : q = 10 uF*u
  Switch s { closed = WHEN }
  1 a : electric
  0 b : electric
  src -> a -> coil
  a -> b -> s.pins
  b -> cap, load
  output current = s.current
  experiment go { simulate 0 .. 1 ms }
}
"""


@pytest.mark.parametrize("when", ["pwm(time, 200 us, 0.5)", "1 - pwm(time, 200 us, 0.5)", "1", "0"])
def test_a_junction_that_goes_on_and_off(when: str) -> None:
    """Off, each of its bonds ends at a source, which has no name to be read by; on, its balance would not hold for the whole run."""
    watched = PageModel(bondgraph.load(SWITCHED.replace("WHEN", when)))
    result = watched.simulate("")
    columns, nodes = watched.bonds.values(result.to_numpy(), len(result.time)), watched.graph.nodes
    ((effort, flow),) = (p for b, p in zip(watched.graph.bonds, watched.bonds.places, strict=True) if nodes[b.head.node].name == "s.gap")  # fmt: skip
    assert np.abs(columns[flow] - result["current"]).max() <= 1e-12
    assert np.abs(columns[effort] * columns[flow]).max() <= 1e-12
    assert np.abs(result["current"]).max() > 1 or when == "0"
    assert np.isfinite(shown_energies(watched, result, columns)).all()


def test_energies_that_the_instants_do_not_resolve_are_not_shown() -> None:
    """One instant for each period of a switch sees one phase of it, and every power a wrong mean; a few instants of a swing are too few."""
    fast = SWITCHED.replace("WHEN", "pwm(time, 4 us, 0.5)").replace("1 ms }", "0.4 ms { points = 11 } }")
    fast = fast.replace("10 ohm*i", "10 ohm*i + 1 [ohm/A]*i*abs(i)")
    swing = (MODELS / "oscillator.bg").read_text(encoding="utf-8").replace("0 .. 5 s", "0 .. 5 s { points = 6 }")
    for text in (fast, swing):
        watched = PageModel(bondgraph.load(text))
        result = watched.simulate("")
        columns = watched.bonds.values(result.to_numpy(), len(result.time))
        assert np.isnan(shown_energies(watched, result, columns)).all()


def test_graphs_too_large_for_a_page_have_no_columns() -> None:
    parts = "\n".join(f"  1 a{i}; R r{i} : F = 1 [N*s/m]*v; a{i} -> r{i}" for i in range(401))
    model = bondgraph.load(f"model M {{\n{parts}\n}}")
    compilation = PageModel(model).model.compilation(model.scene(None, free=("*",)))
    assert bond_columns(compilation.causal.graph, compilation.whole_graph).columns == ()
