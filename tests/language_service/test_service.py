"""Texts, names, completion, hints and colours at places of small models, marked by `|`."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

from bondgraph.language_service.colours import marked_words
from bondgraph.language_service.completion import completion
from bondgraph.language_service.hints import inline_hints
from bondgraph.language_service.hover import call_usage, hover
from bondgraph.language_service.navigation import definition, edited, references, rename, workspace_symbols
from bondgraph.language_service.outline import folds, outline
from bondgraph.language_service.workspace import Workspace, formatted
from compiler.compilation import Compilation
from compiler.graph.mechanism import COLOURS
from compiler.scene import Scene
from compiler.source import Source
from tests.compiling import LIBRARY, ROOT

MODEL = """import Resistor from electric
constant g0 = 9.81 m/s^2
function twice(q) = 2*q

model Part {
  "A mass that is pushed."
  parameter m = 2 kg "its mass"
  input volt = 3 mV
  port a: translation
  I mass : p = m*v
  a -> mass
  output speed = mass.v
}

model Main {
  parameter k: N/m = 100, r = 0.5 [N*s/m]
  Se push : F = 1 N*step(time - 0.1 s)
  1 body
  Part part { m = 5 kg }
  C spring : F = k*x { start x = 1 mm }
  R damper : F = r*v
  Sf clock : i = 1 mA
  Resistor wire { R = 10 ohm }
  push -> body -> part.a, spring, damper
  clock -> wire.pins
  signal pull = twice(spring.F) + part.m*g0
  output position = spring.x
MARK
  experiment go {
    set k = 120 [N/m]
    simulate 0 .. 5 s
    report position in mm
  }
}
"""
TEXT = MODEL.replace("MARK\n", "")


@pytest.fixture
def workspace() -> Workspace:
    return Workspace()


def opened(workspace: Workspace, tmp_path: Path, text: str) -> tuple[Path, int]:
    path, at = tmp_path / "main.bg", text.find("|")
    path.touch()
    workspace.open(path, text.replace("|", "", 1))
    workspace.survey(path, True)
    return path, at


def offered(tmp_path: Path, line: str, model: str = MODEL) -> list[str]:
    workspace = Workspace()
    text = model.replace("MARK", line)
    assert text.count("|") == 1
    return [s.label for s in completion(workspace, *opened(workspace, tmp_path, text))]


# ---------------------------------------------------------------- texts


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("m = 5 kg", ["parameter m", "its mass", "2 kg"]),
        ("part.m*", ["Part part", "A mass that is pushed", "port `a: translation`", "parameter `m = 2 kg`"]),
        ("m*g0", ["parameter m", "5 kg"]),
        ("volt = 3", ["input volt", "mV"]),
        ("k: N", ["parameter k", "100 N/m"]),
        ("g0\n", ["constant g0", "9.81"]),
        (
            "spring :",
            [
                "C spring",
                "`F` in N",
                "`x` in m",
                "`F = k*x`",
                "`body |-> spring`",
                "storage in integral form",
                "it has a state",
            ],
        ),
        ("damper :", ["R damper", "`body |-> damper`", "follows at `body`"]),
        ("body -> part", ["1 body", "one flow", "`push ->| body`", "a source decides it"]),
        ("mass :", ["I mass", "`p` in N*s", "`p = m*v`"]),
        ("twice(s", ["twice(q) = 2*q"]),
        ("step(", ["step(time", "0 before"]),
        ("mA", ["mA", "0.001 A"]),
        ("Resistor wire", ["model Resistor", "parameter `R"]),
        ("F) +", ["spring.F", "effort in N"]),
        ("simulate", ["A run over time"]),
        ("Sf clock", ["Source of flow"]),
        ("position in", ["output position", "in m", "`position = spring.x`"]),
    ],
)
def test_hover(workspace: Workspace, tmp_path: Path, word: str, words: list[str]) -> None:
    path, _ = opened(workspace, tmp_path, TEXT)
    found = hover(workspace, path, TEXT.index(word))
    assert found is not None
    assert [w for w in words if w not in found.text] == []
    assert re.fullmatch(r"\w+", TEXT[found.place.start : found.place.end])


def test_a_text_is_no_bare_number(workspace: Workspace, tmp_path: Path) -> None:
    path, _ = opened(
        workspace, tmp_path, 'model A { parameter file: text "of the road"; output y = column(file, "y") }'
    )
    found = hover(workspace, path, 21)
    assert found is not None and found.text == "**parameter file** — of the road\n\na text"


def test_a_storage_in_derivative_form_says_why(workspace: Workspace) -> None:
    path = ROOT / "models/dc_motor.bg"
    workspace.survey(path, True)
    text = path.read_text(encoding="utf-8")
    found = hover(workspace, path, text.index("load  "))
    assert found is not None and "derivative form: it follows from `inertia`" in found.text
    hints = {text[h.at - 6 : h.at]: h.text for h in inline_hints(workspace, path)}
    assert hints["I   load"[-6:]] == " derivative form" and hints["0.5 mH"] == " = 0.0005 H"


def test_hints_are_the_strokes_of_the_compiler(workspace: Workspace) -> None:
    """One for each bond of the oscillator, with the stroke at the end that receives the effort."""
    path = ROOT / "models/oscillator.bg"
    workspace.survey(path, True)
    text = path.read_text(encoding="utf-8")
    strokes = {re.match(r"\w+", text[h.at :])[0]: h.text for h in inline_hints(workspace, path) if not h.is_unit}  # type: ignore[index]
    assert strokes == {"body": "→|", "mass": "→|", "spring": "|→", "damper": "|→"}
    causal = Compilation(Source("a", text), Scene(None, None), LIBRARY).causal
    ends = {causal.graph.nodes[b.head.node].name: causal.effort_from[i] for i, b in enumerate(causal.graph.bonds)}
    assert {n: "→|" if end == 0 else "|→" for n, end in ends.items()} == strokes


# ---------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("word", "declared"),
    [
        ("m = 5 kg", "m = 2 kg"),
        ("m*g0", "m = 2 kg"),
        ("g0\n", "g0 = 9.81"),
        ("spring, d", "spring : F"),
        ("Part part", "Part {"),
        ("a, spring", "a: trans"),
    ],
)
def test_definition(workspace: Workspace, tmp_path: Path, word: str, declared: str) -> None:
    path, _ = opened(workspace, tmp_path, TEXT)
    place = definition(workspace, path, TEXT.index(word))
    assert place is not None and (place.path, place.start) == (path, TEXT.index(declared))


def test_definitions_in_the_library(workspace: Workspace, tmp_path: Path) -> None:
    path, _ = opened(workspace, tmp_path, TEXT)
    for word, declared in (("pins\n", "port pins: electric"), ("R = 10", "R: ohm"), ("electric\n", '"')):
        place = definition(workspace, path, TEXT.index(word))
        assert place is not None and place.path == (LIBRARY / "electric.bg").resolve()
        text = place.path.read_text(encoding="utf-8")
        assert text[place.start :].startswith(declared.removeprefix("port ")) or declared == '"'


def test_references_and_renaming_in_all_files(workspace: Workspace, tmp_path: Path) -> None:
    """The names of the part, as another file uses them."""
    other = tmp_path / "other.bg"
    other.write_text(
        'import Part from "main.bg"\nmodel Two {\n  Part one { m = 1 kg }\n  Se f : F = 1 N\n  f -> one.a\n  output v = one.mass.v\n}\n',
        encoding="utf-8",
    )
    path, _ = opened(workspace, tmp_path, TEXT)
    at = TEXT.index("m = 2 kg")
    places = references(workspace, path, at)
    assert Counter(p.path.name for p in places) == {"main.bg": 4, "other.bg": 1}
    edits = rename(workspace, path, at, "mass_of_it")
    assert isinstance(edits, list) and len(edits) == 5
    assert "one { mass_of_it = 1 kg }" in edited(other.read_text(encoding="utf-8"), edits, other)
    edits = rename(workspace, path, TEXT.index("Part {"), "Piece")
    assert isinstance(edits, list)
    new = edited(TEXT, edits, path)
    assert "import Piece from" in edited(other.read_text(encoding="utf-8"), edits, other) and "Piece part" in new


def test_a_width_is_renamed_wherever_it_stands(workspace: Workspace, tmp_path: Path) -> None:
    text = """model Row {
  parameter n = 3
  port top: translation[n]
  1 body : translation[n]
  I mass(p: translation[n]) : p.p = 1 [kg]*p.v
  body => mass
}
"""
    path, _ = opened(workspace, tmp_path, text)
    edits = rename(workspace, path, text.index("n = 3"), "count")
    assert isinstance(edits, list)
    assert edited(text, edits, path) == text.replace("[n]", "[count]").replace("n = 3", "count = 3")


def test_words_of_a_choice_are_no_names(workspace: Workspace, tmp_path: Path) -> None:
    """A parameter that is called as a state of a mode, or as a word of a choice, is renamed where it is read as a number only."""
    text = """model Part {
  parameter kind: { a, b } = a
  output y = 1 if kind == a else 2
}
model Main {
  parameter a = 3
  mode s: { a, b } = a {
    b -> a when time > 0.5 s { n = n + a }
  }
  mode n = 0
  when time > 0.2 s { s = a if n > a else b }
  Part one { kind = a }
  output x = a if s == a else n
  experiment e { start s = a; set a = 4; simulate 0 .. 1 s }
}
"""
    path, _ = opened(workspace, tmp_path, text)
    edits = rename(workspace, path, text.index("a = 3"), "gain")
    assert isinstance(edits, list)
    new = text
    for read in ("parameter a", "n + a", "n > a", "= a if s", "set a"):
        new = new.replace(read, read.replace(" a", " gain"))
    assert edited(text, edits, path) == new


@pytest.mark.parametrize(
    ("word", "new", "why"),
    [("k: N", "r", "mean something else"), ("k: N", "F", "mean something else"), ("k: N", "x", "mean something else"), ("k: N", "s", "mean something else"), ("k: N", "2k", "no name"),
     ("k: N", "time", "reserved"), ("Part {", "C", "reserved"), ("step(", "jump", "no name here"), ("R = 10", "Ohms", "no name here")],
)  # fmt: skip
def test_a_name_that_would_mean_something_else_is_refused(
    workspace: Workspace, tmp_path: Path, word: str, new: str, why: str
) -> None:
    text = TEXT.replace("simulate 0 .. 5 s", "simulate 0 .. 5 s").replace("r = 0.5 [N*s/m]", "r = 0.5 N*s/m")
    path, _ = opened(workspace, tmp_path, text)
    answer = rename(workspace, path, text.index(word), new)
    assert isinstance(answer, str) and why in answer


@pytest.mark.parametrize("name", ["manipulator", "robot_arm", "car", "coupled_tanks"])
def test_renamed_models_are_the_same_models(workspace: Workspace, tmp_path: Path, name: str) -> None:
    """Some names of a model get others: no error, and the same number of nodes, bonds and quantities."""
    for file in [*(ROOT / "models").glob("*.bg")] if name == "manipulator" else [ROOT / f"models/{name}.bg"]:
        (tmp_path / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    path = tmp_path / f"{name}.bg"
    text = path.read_text(encoding="utf-8")
    whole = Compilation(Source(str(path), text, path), Scene(None, None), LIBRARY).whole_graph
    own = {
        o.name for o in workspace.occurrences(path) if o.name is not None and o.is_definition and o.name.path == path
    }
    for declared in sorted(own, key=lambda n: n.span.offset)[::7]:
        edits = rename(workspace, path, declared.span.offset, f"{declared.name}_renamed")
        assert isinstance(edits, list) and edits, declared.name
        new = edited(text, edits, path)
        graph = Compilation(Source(str(path), new, path), Scene(None, None), LIBRARY).whole_graph
        assert (len(graph.nodes), len(graph.bonds), len(graph.quantities)) == (
            len(whole.nodes),
            len(whole.bonds),
            len(whole.quantities),
        )
        assert new.replace(f"{declared.name}_renamed", declared.name) == text


# ---------------------------------------------------------------- completion


@pytest.mark.few(17)
@pytest.mark.parametrize(
    ("line", "first", "absent"),
    [
        ("  output z = spring.|", ["F", "v", "x"], ["p"]),
        ("  output z = part.|", ["m", "volt", "a", "mass", "speed"], ["spring"]),
        ("  body -> part.|", ["a"], ["m", "speed"]),
        ("  output z = body.|", ["v"], ["F"]),
        ("  body -> |", ["push", "body", "part", "spring"], ["k", "sin"]),
        ("  C other : F = 5 |", ["N", "kN", "mN"], ["m", "kg"]),
        ("  Resistor w2 { R = 5 |", ["ohm", "kohm"], ["N"]),
        ("  Resistor w2 { |", ["R"], ["k"]),
        ("  I other : p = 1 kg*v { start v = 2 |", ["m/s"], ["m", "N"]),
        ("  I other : p = 1 kg*v { |", ["start", "nominal", "prefer"], ["points"]),
        ("  parameter q: N/m = 5 |", ["N/m"], ["kg"]),
        ("  Se other : |", ["translation", "F"], []),
        ("  0 node : |", ["translation", "rotation", "electric"], ["sin"]),
        ("  output z = |", ["k", "r", "push", "part"], ["simulate"]),
        ("  |", ["push", "body", "parameter", "experiment", "MSe", "Part", "Capacitor"], ["simulate"]),
        ("  experiment e { |", ["set", "start", "simulate", "report", "modes", "montecarlo"], ["parameter"]),
        ("  experiment e { set |", ["k", "r", "part"], ["position", "sin"]),
        ("  experiment e { set k = 5 |", ["N/m"], ["kg"]),
        ("  experiment e { report position in |", ["m", "mm", "um"], ["N"]),
        ("  experiment e { report |", ["position", "spring"], ["k"]),
        ("  experiment e { simulate 0 .. 5 |", ["s", "ms"], ["m"]),
        ("  experiment e { simulate 0 .. 5 s { |", ["rtol", "points", "solver"], ["set"]),
        ("  experiment e { simulate 0 .. 5 s { solver = |", ["automatic", "radau", "energy"], ["rtol"]),
        ("  experiment e { response r to position over 1 Hz .. 2 Hz { |", ["points"], ["set"]),
        ("  experiment e { st|", ["set", "start", "stop"], ["parameter"]),
        ("  parameter z = 2 |", ["kg", "m", "N"], ["k"]),
        ("  parameter z: m = 2 |", ["m", "mm"], ["kg", "rad"]),
        ("  experiment e { simulate |", ["0 .. 1 s"], ["k"]),
        ("  output z = step(|)", ["k", "time"], ["simulate"]),
        ("  signal z = pulse(time, |)", ["k", "time"], ["simulate"]),
        ("  I load : p = 2 kg*v { start |}", ["p", "v"], ["start", "omega"]),
        ("  every 1 ms |", ["offset", "delay", "jitter", "seed"], ["simulate"]),
        ("  output z = 2*|", ["k", "dot", "cross", "norm", "mod", "stairs", "pwm"], ["simulate"]),
        ("  # |", [], ["k"]),
    ],
)  # fmt: skip
def test_completion(tmp_path: Path, line: str, first: list[str], absent: list[str]) -> None:
    labels = offered(tmp_path, line)
    assert [w for w in first if w not in labels] == [] and [w for w in absent if w in labels] == []
    assert not first or labels[0] in first
    assert bool(first) == bool(labels)


@pytest.mark.parametrize(
    ("line", "first", "absent"),
    [
        ("|", ["body", "hinge", "gravity"], ["cylinder", "parameter"]),
        ("hinge h2 : ground to |", ["ground", "bar"], []),
        ("body b2 { |", ["mass", "inertia", "at", "angle"], ["turn"]),
        ("body b2 { mass = 2 |", ["kg", "g"], ["m"]),
    ],
)
def test_completion_in_a_mechanism(tmp_path: Path, line: str, first: list[str], absent: list[str]) -> None:
    model = "model Arm {\n  multibody arm : planar {\n    body bar { mass = 1 kg, inertia = 1 [kg*m^2] }\n    hinge pin : ground to bar { at = (0, 0) }\n    MARK\n  }\n  output a = arm.pin.phi\n}\n"
    labels = offered(tmp_path, line, model)
    assert [w for w in first if w not in labels] == [] and [w for w in absent if w in labels] == []


def test_completion_at_the_top(tmp_path: Path) -> None:
    assert offered(tmp_path, "|", "MARK") == ["import", "model", "plain", "parameters", "constant", "function"]
    assert {"Resistor", "Gear"} <= set(offered(tmp_path, "import |", "MARK"))
    assert {"electric", "mems"} <= set(offered(tmp_path, "import Resistor from |", "MARK"))
    (tmp_path / "parts.bg").write_text("model A { output a = 1 }\n", encoding="utf-8")
    assert offered(tmp_path, 'import A from "|"', "MARK") == ["parts.bg"]


def test_a_part_of_the_library_brings_its_import(workspace: Workspace, tmp_path: Path) -> None:
    """With its import added, and with its snippet filled in as offered, the text has no unknown name."""
    for name in ("Capacitor", "Gear"):
        path, at = opened(workspace, tmp_path, MODEL.replace("MARK", "  |"))
        item = next(s for s in completion(workspace, path, at) if s.label == name and s.kind == "model")
        instance = re.sub(r"\$\{\d:([^}]*)\}", r"\1", item.insert)
        text = workspace.project.document(path).text
        text = text[:at] + instance + text[at:]
        workspace.open(path, edited(text, list(item.edits), path))
        codes = [d.code for d in workspace.survey(path, True).diagnostics]
        assert "BG105" not in codes and "BG131" not in codes and "BG120" not in codes
        assert (
            f"import {'Resistor, Capacitor from electric' if name == 'Capacitor' else 'Gear from mechanics'}"
            in workspace.project.document(path).text
        )


def test_call_usage(workspace: Workspace, tmp_path: Path) -> None:
    def usage(line: str) -> tuple[str, int] | None:
        found = call_usage(workspace, *opened(workspace, tmp_path, MODEL.replace("MARK", line)))
        return None if found is None else (found.label, found.active)

    assert usage("  output z = ramp(time, max(1 s, 2 s), |)") == ("ramp(time, 1 s, 2 s)", 2)
    assert usage("  output z = ramp(time, max(1 s, |") == ("max(a, b)", 1)
    assert usage("  output z = twice(|)") == ("twice(q)", 0)
    assert usage("  output z = (1 + |") is None


# ---------------------------------------------------------------- structure


def test_outline_and_folds(workspace: Workspace, tmp_path: Path) -> None:
    path, _ = opened(workspace, tmp_path, TEXT)
    nodes = outline(workspace, path)
    assert [(n.name, n.kind) for n in nodes] == [
        ("g0", "constant"),
        ("twice", "function"),
        ("Part", "model"),
        ("Main", "model"),
    ]
    main = nodes[-1]
    assert TEXT[main.place.start : main.place.end].startswith("Main {") and main.place.end == len(TEXT) - 1
    assert [c.name for c in main.children][:4] == ["k", "r", "push", "body"] and main.children[-1].kind == "experiment"
    lines = TEXT.split("\n")
    folded = [(lines[a].strip(), lines[b].strip()) for a, b in folds(workspace.project.document(path))]
    assert folded == [("model Part {", "}"), ("model Main {", "}"), ("experiment go {", "}")]


def test_symbols_of_the_workspace(workspace: Workspace, tmp_path: Path) -> None:
    (tmp_path / "other.bg").write_text("model Gearbox { output a = 1 }\n", encoding="utf-8")
    workspace.folders.append(tmp_path)
    opened(workspace, tmp_path, TEXT)
    assert [(n.name, n.place.path.name) for n in workspace_symbols(workspace, "grbx")] == [("Gearbox", "other.bg")]
    assert {n.name for n in workspace_symbols(workspace, "part")} >= {"Part", "part"}


def test_every_word_of_the_models_has_a_class(workspace: Workspace) -> None:
    """Of all words of all models, only words of the text itself (in braces of attributes) have none."""
    files = sorted(p for p in (ROOT / "models").glob("*.bg") if p.stem != "resonators")  # members of sets have none
    for path in files[::4]:
        text = path.read_text(encoding="utf-8")
        marked = list(marked_words(workspace, path))
        assert all(a.end <= b.start for a, b in pairwise(marked))
        inside = {w.start for w in marked}
        words = re.finditer(r'"[^"\n]*"|#[^\n]*|(?<![\w.])[A-Za-z_]\w*', text)
        left = {m[0] for m in words if m.start() not in inside and m[0][0] not in '"#'}
        assert left <= {
            "integral",
            "derivative",
            "effort",
            "flow",
            "from",
            "middle",
            "body",
            "world",
            "x",
            "y",
            "phi",
            *COLOURS,
        }, path.name


def test_formatting(workspace: Workspace, tmp_path: Path) -> None:
    path, _ = opened(workspace, tmp_path, "model A {\n output   a=1\n}\n")
    assert formatted(workspace, path) == "model A {\n  output a = 1\n}\n"
    path, _ = opened(workspace, tmp_path, "model A {\n output   a=\n}\n")
    assert formatted(workspace, path) is None


def test_words_that_hold_in_one_place(workspace: Workspace, tmp_path: Path) -> None:
    """`delay` behind a period is a keyword, in an expression a function; `stop` and its like have classes and texts."""
    text = (
        "parameters Steel { E = 210 GPa }\nmodel A {\n  input u = 0\n  mode y = 0\n  every 1 ms offset 0.2 ms delay 0.1 ms { y = u }\n"
        "  output late = delay(u, 1 ms)\n  multibody car : planar {\n    body hull { mass = 1 kg, inertia = 1 [kg*m^2] }\n"
        "    wheel w : hull { radius = 1 m }\n  }\n  experiment e { simulate 0 .. 1 s; stop when y > 1 }\n}\n"
    )
    path, _ = opened(workspace, tmp_path, text)
    kinds = {w.start: w.kind for w in marked_words(workspace, path)}
    found = {
        word: [kinds.get(m.start()) for m in re.finditer(rf"\b{word}\b", text)]
        for word in ("delay", "offset", "wheel", "stop", "when")
    }
    assert found == {
        "delay": ["keyword", "function"],
        "offset": ["keyword"],
        "wheel": ["kind"],
        "stop": ["keyword"],
        "when": ["keyword"],
    }
    assert kinds[0] == "keyword"
    for word, words in (("stop", "Ends the run"), ("offset", "later"), ("parameters", "Named values")):
        answer = hover(workspace, path, text.index(word) + 1)
        assert answer is not None and words in answer.text


@pytest.mark.parametrize("line", ["weight -> ", "weight -> top, ", "output y = ", "C spring : F = ", "signal s = 2*", "weight -> 0(", "experiment e { report "])  # fmt: skip
def test_completion_before_any_brace_is_closed(tmp_path: Path, line: str) -> None:
    """A model that is written from nothing has no end yet, and its last line is half-typed."""
    head = "model Car {\n  parameter g = 9.81 [m/s^2]\n  Se weight : F = -3 kg*g\n  I body : p = 3 kg*v\n  1 top\n  "
    workspace, path = Workspace(), tmp_path / "car.bg"

    def offered(end: str) -> list[str]:
        workspace.open(path, head + line + end)
        return [item.label for item in completion(workspace, path, len(head + line))]

    assert offered("") == offered("\n") == offered("\n}" * (1 + line.count("{"))) and {"body", "top"} <= {*offered("")}
