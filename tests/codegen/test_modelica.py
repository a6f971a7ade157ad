"""Flat Modelica, read by a small reader of its own: equations against the module for numpy, structure, events; and by rumoca where it is installed."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lark import Lark, Transformer

import bondgraph
from compiler.errors import CompilationFailed
from tests.codegen.test_casadi_text import MODEL
from tests.codegen.test_numpy_text import module_of, values
from tests.codegen.test_tables import LAWS, SPRINGS
from tests.compiling import MODELS, compiled
from tests.event_models import BALL, CHAIN, HEATER, height, servo

GRAMMAR = r"""
?start: "if" either "then" start "else" start -> choice | either
?either: both ("or" both)* -> any
?both: truth ("and" truth)* -> all
?truth: "not" truth -> negated | sum | sum ORDER sum -> compared
?sum: product | sum SIGN product -> binary | "-" product -> minus
?product: power | product FACTOR power -> binary
?power: atom | atom "^" atom -> raised
?atom: NUMBER -> number | NAME -> named | NAME "(" start ("," start)* ")" -> called | "(" start ")"
ORDER: "<=" | ">=" | "<" | ">"
SIGN: "+" | "-"
FACTOR: "*" | "/"
NAME: /(?!(if|then|else|and|or|not)\b)[A-Za-z_]\w*/
%import common.NUMBER
%ignore " "
"""
OPERATIONS = {
    "+": float.__add__, "-": float.__sub__, "*": float.__mul__, "/": float.__truediv__,
    "<": float.__lt__, "<=": float.__le__, ">": float.__gt__, ">=": float.__ge__,
}  # fmt: skip
FUNCTIONS = {**vars(math), "abs": abs, "min": min, "max": max, "sign": lambda x: float(np.sign(x))}


class Reader(Transformer[Any, Any]):
    """Value of an expression; both sides of a choice are computed."""

    def __init__(self, names: dict[str, float]) -> None:
        super().__init__()
        self.names = names

    number = lambda self, x: float(x[0])  # noqa: E731
    named = lambda self, x: self.names[x[0]]  # noqa: E731
    called = lambda self, x: float(FUNCTIONS[x[0]](*x[1:]))  # noqa: E731
    binary = compared = lambda self, x: OPERATIONS[x[1]](float(x[0]), float(x[2]))
    raised = lambda self, x: x[0] ** x[1]  # noqa: E731
    minus = lambda self, x: -x[0]  # noqa: E731
    negated = lambda self, x: not x[0]  # noqa: E731
    any = lambda self, x: x[0] if len(x) == 1 else any(x)  # noqa: E731
    all = lambda self, x: x[0] if len(x) == 1 else all(x)  # noqa: E731
    choice = lambda self, x: x[1] if x[0] else x[2]  # noqa: E731


PARSER = Lark(GRAMMAR, parser="earley")
LINE = re.compile(r"(?:final )?(?:parameter|input) (?:Real|Boolean) (\w+)(?:\([^)]*\))? = (.*);")
LOOP = """plain model Loop {
  parameter r = 2
  input u = 3 "from outside"
  MSe s : e = 3*u
  for i in 1..3 { R a[i] : e = r*i*f }
  C c : e = q { start q = 3*r }
  R d : e = DAMPER
  s -> 1(a[1]) -> 0(a[2]) -> 1(a[3]) -> 0(b) -> 1(c, d)
  R b : e = f + f^5/7
  output f = a[1].f
}
"""
ROLLING = """model Rolling {
  parameter slope = 0.3 rad, m = 1 kg, g = 9.81 [m/s^2]
  multibody plane : planar {
    gravity = (g*sin(slope), -g*cos(slope))
    body hub { mass = m, inertia = m*(0.2 m)^2/2, at = (0, 0.2 m) }
    free way : ground to hub { at = (0, 0.2 m) }
    wheel rim : ground to hub { radius = 0.2 m, normal = (0, 1) }
  }
  output x = plane.hub.x, turn = plane.hub.phi
}"""


def evaluated(text: str, values: dict[str, float]) -> tuple[dict[str, float], dict[str, str]]:
    """Values of all that a text defines, from those of states and unknowns, and the equations of rates and residuals; linear systems are solved."""
    head, _, body = re.sub(r'//.*|"[^"]*"', "", text).partition("equation\n")
    names, rows, late = dict(values), list[tuple[str, str]](), dict[str, str]()
    for line in head.splitlines():
        if found := LINE.match(line.strip()):
            names.setdefault(found[1], value(found[2], names))
    for line in [*body.partition("  event_")[0].splitlines(), "end = 0;"]:
        left, _, right = line.strip().rstrip(" ;").partition(" = ")
        if right and re.fullmatch(r"[a-zA-Z_]\w*", left):
            if rows:
                _solve(rows, names)
            names[left] = value(right, names)
        elif left.startswith("der(") or left == "0":
            late[left if left != "0" else f"0 {len(late)}"] = right
        elif right:
            rows.append((left, right))
    return names, late


def _solve(rows: list[tuple[str, str]], names: dict[str, float]) -> None:
    """Solve rows that are linear in the names that have no value yet."""
    unknown = [n for n in dict.fromkeys(re.findall(r"[A-Za-z_]\w*", " ".join(r[0] for r in rows))) if n not in names]
    units = np.eye(len(unknown))
    matrix = [
        [value(left, names | dict(zip(unknown, unit.tolist(), strict=True))) for unit in units] for left, _ in rows
    ]
    names.update(zip(unknown, np.linalg.solve(matrix, [value(right, names) for _, right in rows]), strict=True))
    rows.clear()


def value(text: str, names: dict[str, float]) -> float:
    return float(Reader(names).transform(PARSER.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        MODEL,
        LOOP.replace("DAMPER", "f"),
        LOOP.replace("DAMPER", "f + f^3"),
        MODELS / "pid_dc_motor.bg",
        MODELS / "four_bar.bg",
    ],
)
def test_equations_are_those_of_the_module_for_numpy(text: str | Path) -> None:
    compilation = compiled(text, free=("*",))
    written, module = compilation.text("modelica"), module_of(compilation)
    p, n = module.Parameters(), len(module.STATES)
    states = re.findall(r"^  Real (\w+)\(.*start = (.*), fixed = true\)", written, re.MULTILINE)
    unknowns = re.findall(r"^  Real (\w+)\((?:unit = \S+, )?start = [^,]*\) ", written, re.MULTILINE)
    outputs = re.findall(r"^  output Real (\w+)", written, re.MULTILINE)
    assert len(states) == n and len(outputs) == len(module.OUTPUTS)
    x = np.random.default_rng(1).uniform(0.2, 0.9, n + len(unknowns))
    names, late = evaluated(written, {"time": 0.3} | dict(zip([*(s for s, _ in states), *unknowns], x.tolist(), strict=True)))  # fmt: skip
    u = np.array(module.INPUT_DEFAULTS) if hasattr(module, "INPUT_DEFAULTS") else None
    rates, results, _ = values(module, 0.3, x, p, u)
    assert [value(right, names) for right in late.values()] == pytest.approx(rates, rel=1e-11, abs=1e-13)
    assert [names[name] for name in outputs] == pytest.approx(results, rel=1e-11)
    assert [value(start, names) for _, start in states] == pytest.approx(module.start(p)[:n], rel=1e-14)
    # As many equations as variables that are no parameters or inputs.
    declared = re.findall(r"^  (?:output )?(?:Real|Boolean) \w+", written, re.MULTILINE)
    assert len(declared) == len(re.findall(r"^  [^\n]* = [^\n]*;", written.partition("\nequation\n")[2], re.MULTILINE))


def test_names_units_and_words() -> None:
    text = """model flow {
      parameter k: N/m = 8 "of 'the' spring", real: J/(kg*K) = 2
      input pull: N = 3
      I mass : p = 2 kg*v
      C spring : F = k*x { start x = 0.1 m }
      MSe s : F = pull + real*(1 [kg*K/m])
      s -> 1(mass, spring)
      output x = spring.x, der = mass.v
      require spring.x < 1 m "it breaks"
    }"""
    written = bondgraph.load(text).compile("modelica")
    assert written.startswith("model flow_2 ")
    assert """parameter Real k(unit = "N/m") = 8.0 "k, of 'the' spring";""" in written
    assert 'unit = "m2/(s2.K)"' in written and 'input Real pull(unit = "N") = 3.0 "pull";' in written
    assert 'Real spring_x(unit = "m", start = 0.1, fixed = true) "spring.x";' in written
    assert "AssertionLevel.warning);" in written and "  output Real der(" not in written


def test_events_are_when_clauses() -> None:
    written = bondgraph.load(BALL).compile("modelica")
    assert "event_1 = ((height <= 0) and (mass_p < 0));" in written
    assert "reinit(mass_p, if v_min <= -e*pre(mass_p) then -e*pre(mass_p) else 0);" in written
    assert "discrete Real falls(" in written and 'start = 1, fixed = true) "falls";' in written
    assert "event_1 = sample(0.003, period);" in bondgraph.load(PLAIN_SERVO).compile("modelica")


PLAIN_SERVO = servo(" offset 3 ms")
TRIANGLE = """model Triangle {
  multibody M : planar {
    body bar { mass = 1 kg, inertia = 1 [kg*m^2], at = (0.5 m, 0 m) }
    body rod { mass = 1 kg, inertia = 1 [kg*m^2], at = (0.5 m, 0.5 m) }
    hinge pin : ground to bar { at = (0 m, 0 m), start phi.omega = 1 [1/s] }
    hinge top : bar to rod { at = (1 m, 0 m) }
    hinge end : rod to ground { at = (0 m, 1 m) }
  }
  output angle = M.pin.phi
}"""
REFUSED = {
    "condition holds at the start": HEATER,
    "delay or jitter": servo(" offset 3 ms delay 2 ms"),
    "holds at the start": CHAIN,
    "Switched junctions": BALL.replace("1 body : translation", "1 body : translation { active = falls > 0.5 }"),
    "Delays": MODEL.replace("output q", "output late = delay(mass.f, 1), q"),
    "`erf`": MODEL.replace("2*f)", "erf(f))"),
    "tables and noise": SPRINGS.format(law=next(iter(LAWS.values())), ys="-4, 0, 0.5, 4"),
    "The constraint `rate of M.top.y`, which a run assembles first,": TRIANGLE,
    "Constraints that depend on others at the start": ROLLING.replace(" }\n  }", " }\n wheel rim_2 : ground to hub { radius = 0.2 m, normal = (0, 1) }\n  }"),
    "Events that set a state beside constraints": ROLLING.replace("  output", " I spin : L = 2 [kg*m^2]*omega\n Se t : M = 1 [N*m]\n t -> 1(spin)\n when plane.hub.x > 1 m { spin.L = 0 [N*m*s] }\n output spun = spin.omega\n output"),
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_it_cannot_hold_is_named(words: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        bondgraph.load(REFUSED[words]).compile("modelica")
    assert {d.code for d in failed.value.diagnostics} == {"BG605"}
    assert words in " ".join(d.sentence for d in failed.value.diagnostics)


def test_rumoca_runs_it(tmp_path: Path) -> None:
    rumoca = pytest.importorskip("rumoca")
    exact = rumoca.SimConfig(rtol=1e-10, atol=1e-12)
    ways = {"ball": BALL, "servo": PLAIN_SERVO, "heater": HEATER.replace("290 K", "294 K"), "rolling": ROLLING}
    for name, text in ways.items():
        (tmp_path / name).mkdir()
        model, file = bondgraph.load(text), tmp_path / name / "m.mo"
        file.write_text(written := model.compile("modelica"), encoding="utf-8")
        end = {"heater": 60.0}.get(name, 1.4)
        theirs = (
            rumoca.Session()
            .load(str(file), model=written.split()[1])
            .simulate(t=(0.0, end), dt=end / 100, config=exact)
        )
        last = np.searchsorted(theirs.time, end - 1e-9)
        mine = model.simulate(None, to=end, points=2, rtol=1e-10)
        for output in set(mine.names) - {"stairs"}:
            assert theirs[output][last] == pytest.approx(mine[output][-1], rel=1e-7), (name, output)
        if name == "ball":
            assert theirs["h"][last] == pytest.approx(height(np.array([end]), 0.7, 0.1)[0], abs=1e-9)
