"""The language reference says what is so: its examples run, its tables are those of the code. README.md's examples too."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.starter import starter_text
from compiler.errors import Diagnostic
from compiler.graph.domains import BUNDLES, DOMAINS
from compiler.graph.network import MechanismNode
from compiler.graph.units import UNITS, Scale
from compiler.semantics.expressions.functions import FUNCTIONS
from compiler.semantics.names.scope import RESERVED
from compiler.source import Source
from compiler.syntax import parse
from compiler.syntax.format import format_text
from compiler.syntax.tree import Experiment
from tests.compiling import LIBRARY, ROOT
from tests.conftest import Golden

LANGUAGE = ROOT / "bondgraph" / "language.md"
README = ROOT / "README.md"
TEXT = LANGUAGE.read_text(encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Fence:
    """A fenced example: `kind` is bg (a whole text), bg-part (statements of a model), bg-drawn (a mechanism that may not move yet),
    bg-later or csv; `name` that of a file."""

    kind: str
    name: str
    text: str
    place: str


def fences(file: Path) -> Iterator[Fence]:
    for match in re.finditer(
        r"^```(\S+)[ ]?(\S*)\n(.*?)^```$", text := file.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ):
        kind, name, body = match.groups()
        yield Fence(kind, name, body, f"{file.name}:{text.count(chr(10), 0, match.start()) + 1}")


ALL = [*fences(LANGUAGE), *fences(README)]
EXAMPLES = [f for f in ALL if f.kind in ("bg", "bg-part")]
DRAWN = [f for f in ALL if f.kind == "bg-drawn"]
LATER = [f for f in ALL if f.kind == "bg-later"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A project folder with the files that examples import or read."""
    for fence in ALL:
        if fence.name:
            (tmp_path / fence.name).write_text(fence.text, encoding="utf-8")
    return tmp_path


def saved(fence: Fence, folder: Path) -> Path:
    file = folder / (fence.name or "example.bg")
    file.write_text(f"model Part {{\n{fence.text}}}\n" if fence.kind == "bg-part" else fence.text, encoding="utf-8")
    return file


class TestExamples:
    @pytest.mark.parametrize("fence", EXAMPLES, ids=lambda f: f.place)
    def test_checks_and_runs(self, fence: Fence, folder: Path) -> None:
        """Every experiment of every example, each shown quantity a number."""
        file = saved(fence, folder)
        assert [f"line {d.span.line}: {d.code} {d.sentence}" for d in bondgraph.check(file)] == []
        for model in parse(Source("example", file.read_text(encoding="utf-8"))).models.values():
            for experiment in (s.name for s in model.statements if isinstance(s, Experiment)):
                for point in bondgraph.load(file, model.name).run(experiment):
                    assert point.numbers() or point.responses
                    assert np.isfinite(list(point.numbers().values())).all()
                    assert point.run is None or np.isfinite(point.run.values).all()

    @pytest.mark.parametrize("fence", DRAWN, ids=lambda f: f.place)
    def test_mechanisms_are_drawn(self, fence: Fence, folder: Path) -> None:
        """They become part of the graph. Those that cannot move yet are refused with their place; the others run."""
        file = saved(fence, folder)
        assert MechanismNode in {type(n) for n in bondgraph.load(file).compilation().whole_graph.nodes}
        found = bondgraph.check(file)
        assert {d.code for d in found} <= {"BG201"}
        if not found:
            self.test_checks_and_runs(fence, folder)

    @pytest.mark.parametrize("fence", LATER, ids=lambda f: f.place)
    def test_what_is_not_available_yet_is_refused_so(self, fence: Fence, folder: Path) -> None:
        """If this fails, something has become available: describe it, with an example that runs."""
        file = saved(fence, folder)
        codes = {d.code for d in bondgraph.check(file)}
        if not codes:
            with pytest.raises(bondgraph.CompilationFailed) as failed:
                bondgraph.load(file).simulate()
            codes = {d.code for d in failed.value.diagnostics}
        assert codes == {"BG130"}

    def test_there_are_examples(self) -> None:
        assert len(EXAMPLES) >= 20 and len(LATER) >= 1

    @pytest.mark.parametrize("fence", [f for f in (*EXAMPLES, *DRAWN) if f.kind != "bg-part"], ids=lambda f: f.place)
    def test_they_are_formatted(self, fence: Fence) -> None:
        assert format_text(Source("example", fence.text)) == fence.text


# ---------------------------------------------------------------- tables made from the code

PREFIXES = {"f": -15, "p": -12, "n": -9, "u": -6, "m": -3, "c": -2, "d": -1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12}


def _prefixes(symbol: str) -> str:
    """The prefixes that a symbol takes."""
    scale = UNITS[symbol]
    found = []
    for prefix, exponent in PREFIXES.items():
        prefixed = UNITS.get(prefix + symbol)
        if prefixed == Scale(scale.dimension, scale.number * Fraction(10) ** exponent, scale.pi_power, scale.offset):
            found.append(prefix)
    return " ".join(found)


def _plain_symbols() -> list[str]:
    """The symbols that are not another one with a prefix."""
    return [
        s
        for s in UNITS
        if not any(s[1:] and s[0] in PREFIXES and s[1:] in UNITS and s[0] in _prefixes(s[1:]).split() for _ in "x")
    ]


def _value(symbol: str) -> str:
    """Value of a unit in SI: `60 s`, `pi/180`; empty for a unit that SI has."""
    scale = UNITS[symbol]
    if scale.offset:
        return f"a temperature, zero at {float(scale.offset):g} K"
    number = scale.number
    if scale.pi_power:
        text = ("pi" if number.numerator == 1 else f"{number.numerator}*pi") + (
            f"/{number.denominator}" if number.denominator > 1 else ""
        )
    else:
        text = f"{float(number):.10g}"
    dimension = str(scale.dimension)
    if dimension == "1":
        return text
    if number == 1 and not scale.pi_power:
        return "" if dimension == symbol else dimension
    return f"{text} {dimension}"


def units_table() -> str:
    """Symbols by the prefixes that they take."""
    groups: dict[str, list[str]] = {}
    for symbol in _plain_symbols():
        groups.setdefault(_prefixes(symbol), []).append(symbol)
    lines = ["| units, with their value in SI | prefixes |", "|---|---|"]
    for prefixes, symbols in groups.items():
        shown = ", ".join(f"`{s}`" + f" = {_value(s)}" * bool(_value(s)) for s in symbols)
        lines.append(f"| {shown} | {f'`{prefixes}`' if prefixes else 'none'} |")
    return "\n".join(lines)


def domains_table() -> str:
    lines = ["| domain | `e f q p` | in |", "|---|---|---|"]
    for domain in DOMAINS.values():
        letters = " ".join(f"`{x}`" if x else "-" for x in domain.letters)
        lines.append(f"| `{domain.name}` | {letters} | {', '.join(str(domain.dimension(v)) for v in 'ef')} |")
    return "\n".join(lines)


LIMITS = [
    ("bytes of a file", "compiler.source:MAXIMUM_BYTES"),
    ("characters of a file", "compiler.syntax.parse:MAXIMUM_SIZE"),
    ("brackets within brackets", "compiler.syntax.grammar:MAXIMUM_NESTING"),
    ("height of an expression", "compiler.syntax.operators:MAXIMUM_DEPTH"),
    ("syntax mistakes told of one file", "compiler.syntax.parse:MAXIMUM_MISTAKES"),
    ("files that are imported", "compiler.semantics.names.imports:MAXIMUM_FILES"),
    (
        "instances, elements, junctions, quantities and rounds",
        "compiler.semantics.resolution.elaboration_cache:MAXIMUM_PARTS",
    ),
    ("models within models", "compiler.semantics.network.elaborate:MAXIMUM_HIERARCHY"),
    ("items of a list", "compiler.semantics.expressions.expression_compiler:MAXIMUM_ITEMS"),
    ("terms of a product of matrices", "compiler.semantics.expressions.lists:MAXIMUM_TERMS"),
    ("quantities that read each other in a ring", "compiler.semantics.resolution.quantities:MAXIMUM_ROW"),
    ("mistakes told of one file", "compiler.semantics.names.statement_errors:MAXIMUM_MISTAKES"),
    ("calls of your functions in one expression", "compiler.semantics.expressions.expression_compiler:MAXIMUM_CALLS"),
    ("bytes of a file of columns", "compiler.semantics.names.column_file:MAXIMUM_SIZE"),
    ("rows of a file of columns", "compiler.semantics.names.column_file:MAXIMUM_ROWS"),
    ("points of a table that are parameters", "compiler.semantics.expressions.tables:MAXIMUM_POINTS"),
    (
        "places along the shorter side of a table of two variables",
        "compiler.semantics.expressions.tables:MAXIMUM_CURVES",
    ),
]


def limits_table() -> str:
    lines = ["| what | at most |", "|---|---|"]
    for what, where in LIMITS:
        module, name = where.split(":")
        number = f"{getattr(import_module(module), name):,}".replace(",", " ")
        lines.append(f"| {what} | {number} |")
    return "\n".join(lines)


ROOMS = {
    "syntax": "how the text is written",
    "semantics.names": "names, units, laws, connections, experiments",
    "multibody": "mechanisms as a whole",
    "causality": "who decides effort and flow",
    "equations": "laws in the direction that causality asks for",
    "reduction": "the equations as a whole",
    "codegen": "what cannot be turned into a program",
}


def diagnostics(room: str) -> list[type[Diagnostic]]:
    module = import_module(f"compiler.{room}.errors")
    return sorted(
        (
            k
            for k in vars(module).values()
            if isinstance(k, type) and issubclass(k, Diagnostic) and k.code != Diagnostic.code
        ),
        key=lambda k: k.code,
    )


def codes_table() -> str:
    lines = ["| codes | about | in use |", "|---|---|---|"]
    for room, about in ROOMS.items():
        codes = [k.code for k in diagnostics(room)]
        lines.append(f"| {codes[0][:3]}xx | {about} | {' '.join(c[2:] for c in codes)} |")
    return "\n".join(lines)


def library_table() -> str:
    lines = ["| library | models |", "|---|---|"]
    for file in sorted(LIBRARY.glob("*.bg")):
        names = parse(Source(file.name, file.read_text(encoding="utf-8"))).models
        lines.append(f"| `{file.stem}` | {', '.join(names)} |")
    return "\n".join(lines)


TABLES = {
    "units": units_table,
    "domains": domains_table,
    "limits": limits_table,
    "codes": codes_table,
    "library": library_table,
}


def test_tables_are_those_of_the_code(golden: Golden) -> None:
    """`--update-golden` renews them."""
    text = TEXT
    for name, table in TABLES.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        assert mark, name
        text = before + mark + table() + "\n" + rest[rest.index("<!-- end -->") :]
    golden(LANGUAGE, text)


def test_the_units_of_the_table_are_all_units() -> None:
    """Symbols with and without prefixes, as a reader would build them from the table, and no others."""
    section = re.search(r"<!-- units -->\n(.*?)<!-- end -->", TEXT, re.DOTALL)
    assert section is not None
    built = {"dB"} & set(UNITS)
    for line in section.group(1).splitlines()[2:]:
        symbols, prefixes = line.strip("|").split("|")
        for symbol in re.findall(r"`(\w+|%)`", symbols):
            built |= {symbol, *(p + symbol for p in re.findall(r"\b[a-zA-Z]\b", prefixes.replace("none", "")))}
    assert built == set(UNITS)


def test_codes_lie_in_the_range_of_their_room() -> None:
    ranges = {
        "syntax": "0",
        "semantics.names": "1",
        "multibody": "2",
        "causality": "3",
        "equations": "4",
        "reduction": "5",
        "codegen": "6",
    }
    seen: set[str] = set()
    for room, digit in ranges.items():
        for kind in diagnostics(room):
            assert re.fullmatch(rf"BG{digit}\d\d", kind.code), kind
            assert kind.code not in seen
            seen.add(kind.code)


def test_every_function_is_described() -> None:
    """The table of functions names what the compiler knows, and nothing that it does not."""
    section = TEXT[TEXT.index("| functions |") :].split("\n\n")[0]
    described = {name for line in section.splitlines()[2:] for name in re.findall(r"\w+", line.split("|")[1])}
    assert described >= set(FUNCTIONS)
    for name in sorted(described):
        codes = {d.code for d in bondgraph.check(f"model A {{\n  output y = {name}(1)\n}}\n")}
        assert not codes & {"BG109", "BG130"}, name


def test_reserved_words() -> None:
    (words,) = re.findall(r"- Reserved are (.*?)\. Letters", TEXT, re.DOTALL)
    assert set(re.findall(r"[a-z]+", " ".join(re.findall(r"`([^`]*)`", words)))) == set(RESERVED)


def test_bundles() -> None:
    (sentence,) = re.findall(r"`planar` has the ports (.*?)\.", TEXT, re.DOTALL)
    planar, spatial = sentence.split("`spatial`")
    for name, text in (("planar", planar), ("spatial", spatial)):
        assert " ".join(re.findall(r"`([^`]*)`", text)).split() == list(BUNDLES[name])


def test_numbers_of_the_units() -> None:
    """The table's text is what the scales mean."""
    for symbol in ("rpm", "deg", "bar", "eV", "inch"):
        (shown,) = re.findall(rf"`{symbol}` = ([^ ,|]*)", TEXT)
        factors = [math.pi if word == "pi" else float(word) for word in re.split(r"[*/]", shown)]
        value = factors[0] / factors[1] if "/" in shown else math.prod(factors)
        assert math.isclose(value, UNITS[symbol].to_si(Fraction(1)), rel_tol=1e-9), symbol


@pytest.mark.parametrize("name", ["oscillator", "mass-spring 2", "C", "2nd", "ü", ""])
def test_the_first_file_of_a_new_user(name: str) -> None:
    """Nothing is wrong with it, and it does what its text says: from 1 cm to 2 N/(100 N/m)."""
    text = starter_text(name)
    assert bondgraph.check(text) == ()
    result = bondgraph.load(text).simulate()
    assert result["position"][0] == pytest.approx(0.01)
    assert result.final("position") == pytest.approx(0.02, rel=0.06)
    assert 0 < len([line for line in text.splitlines() if "#" in line]) <= 14
