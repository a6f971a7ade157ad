"""Outputs of a scene alone: equal to the same outputs written in the model, and errors in them are told at their own text."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_model import CompiledModel, source_of
from bondgraph.simulation.repetition import simulate
from bondgraph.simulation.run_options import RunOptions, RunRequest

TEXT = """
model A {{
  1 body : translation
  I mass : p = 2 [kg]*v
  C spring : F = 50 [N/m]*x {{ start = 0.1 m }}
  R loss : F = 1 [N*s/m]*v
  body -> mass, spring, loss
  {outputs}
}}
"""
OUTPUTS = {"work": "integral(loss.F*loss.v, 0 J)", "twice": "2*spring.x"}


def test_equal_to_written_ones() -> None:
    written = bondgraph.load(TEXT.format(outputs="\n  ".join(f"output {n} = {x}" for n, x in OUTPUTS.items())))
    extra = CompiledModel(source_of(TEXT.format(outputs="")), extra_outputs=OUTPUTS)
    one, other = (simulate(m, RunRequest(None, {}, ("work", "twice"), RunOptions(1.0, 11))) for m in (written, extra))
    np.testing.assert_array_equal(one.values, other.values)
    assert one.unit("work") == other.unit("work") == "N*m" and one["work"][-1] > 0


@pytest.mark.parametrize(("text", "code"), [("2*", "BG0"), ("no_such", "BG1")])
def test_errors_are_told_at_their_text(text: str, code: str) -> None:
    model = CompiledModel(source_of(TEXT.format(outputs="")), extra_outputs={"o": text})
    with pytest.raises(bondgraph.CompilationFailed) as caught:
        _ = model.compilation(model.scene(None)).whole_graph
    first = caught.value.diagnostics[0]
    assert first.code.startswith(code) and first.span.source.name == "output o"
