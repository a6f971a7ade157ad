"""Every model of the gallery, every part of the library, random graphs: to text and back they are the same."""

from __future__ import annotations

import os
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings

import bondgraph
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax import parse, tree
from compiler.syntax.format import format_text
from compiler.unparse import write_text
from tests.compiling import LIBRARY, MODELS, compiled
from tests.equations.random_network import Example, examples
from tests.unparse.same_graph import Same, same_motion

EXAMPLES = int(os.environ.get("BONDGRAPH_RANDOM", "60"))


def models(file: Path) -> dict[str, tree.ModelSyntax]:
    return parse(Source(file.name, file.read_text(encoding="utf-8"))).models


def whole(file: Path) -> list[tuple[str, str, str | None]]:
    """Models of a file that can run, without experiment and with each of their own."""
    found: list[tuple[str, str, str | None]] = []
    for name, model in models(file).items():
        if compiled(file, model=name).open_part or any(i.value is None for i in items(model)):
            continue
        experiments = [s.name for s in model.statements if isinstance(s, tree.Experiment)]
        found += [(file.name, name, e) for e in [None, *experiments]]
    return found


def items(model: tree.ModelSyntax) -> list[tree.Item]:
    """Its parameters."""
    return [i for s in model.statements if isinstance(s, tree.Quantities) and s.role == "parameter" for i in s.items]


GALLERY = [case for file in sorted(MODELS.glob("*.bg")) for case in whole(file)]
PARTS = [(file.stem, name) for file in sorted(LIBRARY.glob("*.bg")) for name in models(file)]


def again(original: Compilation) -> Compilation:
    """Compilation of the graph's text, after a check that the two graphs are the same."""
    reread = compiled(write_text(original.whole_graph), everything=True)
    Same(original.whole_graph, reread.whole_graph).check()
    return reread


def test_there_are_models_and_parts() -> None:
    assert {("manipulator.bg", "Manipulator", None), ("flexure.bg", "FlexureOrders", "force")} <= set(GALLERY)
    assert ("electric", "Diode") in PARTS and len(PARTS) > 40
    assert {f for f, _, _ in GALLERY} >= {f.name for f in MODELS.glob("*.bg")} - {"mems.bg"}


@pytest.mark.few(26)
@pytest.mark.parametrize(("file", "model", "experiment"), GALLERY)
def test_every_model_comes_back(file: str, model: str, experiment: str | None) -> None:
    original = compiled(MODELS / file, model=model, experiment=experiment, everything=True)
    same_motion(original, again(original))


@pytest.mark.few(25)
@pytest.mark.parametrize("file", sorted({f for f, _, _ in GALLERY}))
def test_the_text_is_formatted_and_stays(file: str) -> None:
    """`fmt` does not change it, and neither does a second round through a model, except for the former names."""
    for name in [n for f, n, e in GALLERY if f == file and e is None]:
        text = bondgraph.load(MODELS / file, name).text()
        assert format_text(Source("text", text)) == text
        assert re.sub(r" *#.*", "", bondgraph.load(text).text()) == re.sub(r" *#.*", "", text)


def test_a_run_of_the_text_is_the_run_of_the_model() -> None:
    model = bondgraph.load(MODELS / "oscillator.bg")
    first, second = (m.simulate(None, to="2 s", points=11) for m in (model, bondgraph.load(model.text())))
    np.testing.assert_array_equal(second["position"], first["position"])


def test_a_ladder_of_two_thousand_parts() -> None:
    """Writing takes the time of a few passes over the graph; names keep their indices."""
    steps = "b[i - 1] -> a[i] -> r[i], b[i];  b[i] -> c[i]"
    original = compiled(f"""
      plain model Ladder {{
        Se source : e = 1
        0 b[0]
        source -> b[0]
        for i in 1..500 {{ 1 a[i];  0 b[i];  R r[i] : e = i*f;  C c[i] : e = q;  {steps} }}
      }}
    """)
    text = write_text(original.whole_graph)
    assert "  R r[17] : e = 17*f\n" in text and len(original.whole_graph.nodes) == 2002
    Same(original.whole_graph, compiled(text).whole_graph).check()


WIDE = {
    "planar": {"x": "translation", "y": "translation", "phi": "rotation"},
    "spatial": {**dict.fromkeys("xyz", "translation"), **dict.fromkeys(("rx", "ry", "rz"), "rotation")},
}


def bench(library: str, name: str, inward: tuple[bool, ...]) -> str:
    """A part with a junction at each port, and a value for each parameter that has no default."""
    model = models(LIBRARY / f"{library}.bg")[name]
    values = ", ".join(f"{i.name} = 2 [{i.unit.span.text}]" for i in items(model) if i.value is None and i.unit)
    lines = [
        f"import {name} from {library}",
        "model Bench {",
        f"  {name} part {{ {values} }}" if values else f"  {name} part",
    ]
    for port, enters in zip(ports(model), inward, strict=True):
        outside, wide = f"outside_{port.name}", WIDE.get(port.domain or "", {})
        lines.append(f"  splitter {outside}({', '.join(wide)})" if wide else f"  0 {outside} : {port.domain}")
        first, second = (outside, f"part.{port.name}") if enters else (f"part.{port.name}", outside)
        lines.append(f"  {first} {'=>' if wide else '->'} {second}")
        lines += [f"  0 {outside}_{p} : {d}\n  {outside}_{p} -> {outside}.{p}" for p, d in wide.items()]
    return "\n".join([*lines, "}"])


def ports(model: tree.ModelSyntax) -> list[tree.PortItem]:
    return [p for s in model.statements if isinstance(s, tree.PortsSyntax) for p in s.items]


@pytest.mark.few(32)
@pytest.mark.parametrize(("library", "name"), PARTS)
def test_every_part_of_the_library_comes_back(library: str, name: str) -> None:
    """With arrows at its ports as they fit."""
    number = len(ports(models(LIBRARY / f"{library}.bg")[name]))
    refused: list[CompilationFailed] = []
    for inward in product((True, False), repeat=number):
        original = compiled(bench(library, name, inward), model="Bench", everything=True)
        try:
            graph = original.whole_graph
        except CompilationFailed as failed:
            refused.append(failed)
            continue
        assert any(n.startswith("part.") for n in [*graph.quantities, *(n.name for n in graph.nodes)])
        again(original)
        return
    raise refused[0]


@settings(
    max_examples=EXAMPLES, derandomize=True, deadline=None, database=None,
    phases=(Phase.explicit, Phase.generate, Phase.shrink), suppress_health_check=list(HealthCheck),
)  # fmt: skip
@given(examples())
def test_random_graphs_come_back(example: Example) -> None:
    original = compiled(example.text, example.settings, model="Root" if example.parts else None, everything=True)
    try:
        graph = original.whole_graph
    except CompilationFailed:
        assume(False)
    assume(graph.nodes)
    reread = again(original)
    try:
        _ = original.program
    except CompilationFailed as failed:
        with pytest.raises(CompilationFailed) as told:
            _ = reread.program
        assert {d.code for d in told.value.diagnostics} == {d.code for d in failed.diagnostics}
        return
    same_motion(original, reread, tries=2)
