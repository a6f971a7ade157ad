"""Sets of parameters: an instance that is handed one is the instance with its members set one by one."""

from __future__ import annotations

from pathlib import Path

import pytest

import bondgraph
from compiler.source import Source
from compiler.syntax.format import format_text
from tests.compiling import compiled, mistake, mistakes, outputs_of

SETS = """
constant GPA = 1e9 Pa
parameters Silicon {
  "Single crystal."
  E = 130*GPA       "Young's modulus"
  rho: kg/m^3 = 2330
  nu = 0.28; G = E/(2*(1 + nu))
  widths: um = (1, 2)
}
parameters Steel { E = 210 GPa; rho = 7850 [kg/m^3]; nu = 0.3; G = E/(2*(1 + nu)); widths: um = (3, 4) }
parameters Thick { h: um = 4; b = 2*h; law = cubic }
"""
BEAM = """
model Beam {
  parameter E = 100 GPa, l = 100 um, h = 2 um, b = 3 um, law: { linear, cubic } = linear
  output k = E*b*h^3/l^3*(1 if law == linear else 10)
}
model Frame {
  parameter stuff: parameters = Silicon
  Beam beam { parameters = stuff }
  output k = beam.k, G = stuff.G, w = stuff.widths[2]
}
"""
WHOLE = """
model A {
  Beam a { parameters = Silicon }
  Beam b { parameters = (Silicon, Thick), E = 1 GPa, l = 1 mm }
  Beam c
  Frame f
  Frame g { stuff = Steel }
  output ka = a.k, kb = b.k, kc = c.k, kf = f.k, kg = g.k, Gf = f.G, Gg = g.G, wf = f.w, wg = g.w, E = Silicon.E
}
"""


def stiffness(E: float, b: float, h: float, l: float) -> float:
    return E * b * h**3 / l**3


STIFF = {
    "ka": stiffness(130e9, 3e-6, 2e-6, 1e-4), "kb": 10 * stiffness(1e9, 8e-6, 4e-6, 1e-3), "kc": stiffness(1e11, 3e-6, 2e-6, 1e-4),
    "kf": stiffness(130e9, 3e-6, 2e-6, 1e-4), "kg": stiffness(210e9, 3e-6, 2e-6, 1e-4), "Gf": 130e9 / 2.56, "Gg": 210e9 / 2.6,
    "wf": 2e-6, "wg": 4e-6, "E": 130e9,
}  # fmt: skip


def test_handed_over_set_singly_and_read() -> None:
    text = SETS + BEAM + WHOLE
    assert mistakes(text, "A") == ()
    assert outputs_of(compiled(text, model="A")) == pytest.approx(STIFF, rel=1e-14)


def test_from_a_file_and_from_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "materials.bg").write_text(SETS, encoding="utf-8")
    main = tmp_path / "main.bg"
    main.write_text('import Silicon, Steel, Thick from "materials.bg"\n' + BEAM + WHOLE, encoding="utf-8")
    assert bondgraph.check(tmp_path / "materials.bg") == () == bondgraph.check(main)
    assert outputs_of(compiled(main, model="A")) == pytest.approx(STIFF, rel=1e-14)
    found = outputs_of(compiled(main, {"f.stuff": "Steel", "a.E": "1 GPa"}, model="A"))
    assert found["kf"] == pytest.approx(STIFF["kg"]) and found["ka"] == pytest.approx(STIFF["ka"] / 130)
    model = bondgraph.load(main, "A")
    assert model.simulate(settings={"f.stuff": "Steel"}, to=1.0).final("Gf") == pytest.approx(210e9 / 2.6)
    with pytest.raises(bondgraph.CompilationFailed, match="Did you mean `Steel`"):
        model.simulate(settings={"f.stuff": "Stel"}, to=1.0)


def test_units_beside_members_mean_what_they_meant() -> None:
    """A member is no name of the file: `3 N*m` stays a torque where a set has an `m`, except in the set itself."""
    text = "parameters Plate { m = 2 kg; F = 3 N*m }\nmodel A { output y = 3 N*m/(1 [N*m]), z = Plate.F/(1 [N*kg]) }"
    assert outputs_of(compiled(text)) == {"y": 3.0, "z": 6.0}


def test_in_a_loop_and_with_conditional_parameters() -> None:
    text = """
    parameters Two { a = 2; b = 3 }
    model P { parameter a = 0, on = true
      if on { parameter b = 1; output y = a + b } else { output y = a } }
    model A { for i in 1..2 { P p[i] { parameters = Two, on = i > 1 } }
      output y = p[1].y, z = p[2].y }
    """
    assert outputs_of(compiled(text, model="A")) == {"y": 2.0, "z": 5.0}


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("Beam x { parameters = Silico }", "BG101"),
        ("Beam x { parameters = 3 }", "BG101"),
        ("Beam x { parameters = (Silicon, Steel) }", "BG172"),  # two sets give E
        ("Beam x { parameters = Odd }", "BG172"),  # nothing fits
        ("Beam x { parameters = Silicon, parameters = Thick }", "BG120"),
        ("Beam x { parameters = Wrong }", "BG103"),  # its E is a length
        ("Beam x { parameters = Near }", "BG172"),  # it has an H, the beam an h
        ("Sheared x { parameters = Silicon, E = 1 GPa }", "BG172"),  # G follows from E
        ("Frame x { stuff = Thick }", "BG172"),  # it has no E
        ("Frame x { stuff = Wrong }", "BG103"),  # E of another unit
        ("Frame x { stuff = Short }", "BG172"),  # G is missing
        ("output y = Silicon", "BG111"),
        ("output y = Silicon.x", "BG101"),
        ("C c : F = 1 [N/m]*x { parameters = Silicon }", "BG120"),
    ],
)
def test_what_does_not_fit_is_told(line: str, code: str) -> None:
    more = "parameters Odd { x = 1 }\nparameters Wrong { E = 1 mm; rho = 1 [kg/m^3]; nu = 1; G = 1 Pa; widths: um = (1, 2) }\n"
    more += "parameters Near { E = 1 GPa; H = 1 um }\nparameters Short { E = 1 GPa; rho = 1 [kg/m^3]; nu = 1; widths: um = (1, 2) }\n"
    more += "model Sheared { parameter E = 1 GPa, G = 1 GPa }\n"
    found = mistakes(SETS + more + BEAM + f"model A {{ {line} }}", "A")
    assert code in {d.code for d in found} and {d.code for d in found} <= {code, "BG121"}, [str(d) for d in found]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("parameters X { a = b; b = a }", "BG107"),
        ("parameters X { a = 1; a = 2 }", "BG104"),
        ("parameters X { a = nothing + 1 }", "BG101"),
        ("parameters X { a[1] = 1 }", "BG172"),
        ("parameters X { a }", "BG172"),
        ("parameters X { a = 1 m + 1 s }", "BG103"),
        ("parameters X { time = 1 }", "BG134"),
        ("parameters X { a = 1 }\nparameters X { a = 2 }", "BG104"),
        ("parameters M { a = 1 }\nmodel M { output y = 1 }", "BG104"),
    ],
)
def test_a_wrong_set_is_told_where_it_stands(line: str, code: str) -> None:
    mistake(line, code)


def test_formatting() -> None:
    before = (
        "parameters   Silicon{\nE=130 GPa\n  rho : kg/m^3=2330;nu=0.28\n}\nmodel A{\nP p{parameters=(A,B);E=1}\n}\n"
    )
    after = "parameters Silicon {\n  E = 130 GPa\n  rho: kg/m^3 = 2330; nu = 0.28\n}\nmodel A {\n  P p { parameters = (A, B); E = 1 }\n}\n"
    assert format_text(Source("t", before)) == after == format_text(Source("t", after))
