"""Parameters that are one of several words: the model with a word is the model with that word's branch."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from compiler.unparse import write_text
from tests.compiling import compiled, mistakes, outputs_of

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]
SPRINGS = """
model Spring {
  parameter kind: { soft, hard, none } = soft, k: N/m = 100
  port end: translation
  if kind != none { C coil : F = k*x*(1 if kind == soft else 4); end -> coil }
  else { R rest : F = 0*v; end -> rest }
}
model Hung {
  parameter spring: { soft, hard, none } = soft, kind: { hard, soft } = soft
  Spring own { kind = spring }
  I mass : p = 1 kg*v { start v = 1 [m/s] }
  1(mass) -> own.end
  function pick(x, what) = x if what == hard else 2*x
  function here(x) = x if spring == hard else 2*x
  output v = mass.v, p = pick(1, spring), h = here(1), same = spring != hard and kind == soft
  experiment swing { simulate 0 .. 1 s }
  experiment all { sweep spring = none, hard; simulate 0 .. 1 s }
}
"""


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("word", "number", "omega"), [("soft", 1, 10.0), ("hard", 2, 20.0), ("none", 3, 0.0)])
def test_against_closed_forms(target: str, word: str, number: int, omega: float) -> None:
    model = bondgraph.load(SPRINGS, "Hung")
    for spring in (word, number):
        result = model.simulate("swing", settings={"spring": spring}, target=target, rtol=1e-10, points=6)
        assert result["v"] == pytest.approx(np.cos(omega * result.time), abs=1e-8)
        assert result.final("p") == result.final("h") == (1.0 if word == "hard" else 2.0)
        assert result.final("same") == (word != "hard")


def test_a_sweep_goes_through_truths() -> None:
    """In a call as in an experiment."""
    text = "model A {{ parameter soft = true\n output k = 1 if soft else 4\n experiment e {{ {step} simulate 0 .. 1 s }} }}"
    swept = bondgraph.load(text.format(step="")).sweep({"soft": "false, true"})
    assert [p.run.final("k") for p in swept] == [4, 1]
    assert [p.run.final("k") for p in bondgraph.load(text.format(step="sweep soft = false, true;")).run()] == [4, 1]
    with pytest.raises(UsageError, match="`soft` cannot be `maybe`; it can be false, true"):
        bondgraph.load(text.format(step="")).sweep({"soft": ["maybe"]})


def test_a_sweep_goes_through_words() -> None:
    points = bondgraph.load(SPRINGS, "Hung").run("all")
    assert [p.settings["spring"] for p in points] == [3.0, 2.0]
    assert [p.numbers()["v"] for p in points] == pytest.approx([1.0, np.cos(20)], abs=1e-5)


def test_an_item_of_an_array_and_an_instance_within_an_instance() -> None:
    text = "model P { parameter kind: { a, b }; output y = 1 if kind == a else 2 }\n"
    text += "model Q { parameter kind: { a, b } = b; P p { kind = kind }; output y = p.y }\n"
    text += "model A { for i in 1..2 { parameter w[i]: { a, b } = a }\n parameter a = 7\n P r { kind = w[2] }; Q q; Q s { kind = a }\n"
    text += " output x = r.y, y = q.y, z = s.y, n = 1 if w[1] == a else a }\n"
    assert mistakes(text) == ()
    assert outputs_of(compiled(text, model="A")) == {"x": 1.0, "y": 2.0, "z": 1.0, "n": 1.0}
    assert outputs_of(compiled(text, {"w[2]": "b", "q.p.kind": "a"}, model="A"))["x"] == 2.0


def test_the_flat_text_has_numbers_in_its_place() -> None:
    text = "model A { parameter kind: { a, b } = b, k = 3\n output y = k if kind == a else 2*k }"
    flat = write_text(compiled(text).whole_graph)
    assert "kind" not in flat.replace("# ", "")
    assert outputs_of(compiled(flat)) == {"y": 6.0}


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"spring": "hart"}, "Did you mean `hard`"),
        ({"spring": 4}, "It can be"),
        ({"spring": 1.5}, "It can be"),
        ({"spring": "kind"}, "It can be"),
    ],
)
def test_a_wrong_word_is_told(settings: dict[str, str | float], told: str) -> None:
    with pytest.raises(bondgraph.CompilationFailed, match="BG122") as failed:
        bondgraph.load(SPRINGS, "Hung").simulate("swing", settings=settings)
    assert told in str(failed.value)
