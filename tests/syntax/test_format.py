"""The formatter: it changes spaces and nothing else, twice is once, and tables stay tables."""

from __future__ import annotations

import random
import re
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from bondgraph.starter import starter_text
from compiler.errors import CompilationFailed, InternalError
from compiler.source import Source
from compiler.syntax import format as module
from compiler.syntax import parse
from compiler.syntax.format import _equal, _parse_with_tokens, format_text
from tests.compiling import LIBRARY, MODELS, ROOT

SKETCHES = sorted((Path(__file__).parent / "sketches").glob("*.bg"))
FILES = [*sorted(MODELS.glob("*.bg")), *sorted(LIBRARY.glob("*.bg")), *SKETCHES]
CASES = sorted((ROOT / "tests" / "errors" / "cases").glob("*.bg"))


def source(text: str) -> Source:
    return Source("t.bg", text)


def formatted(text: str) -> str:
    return format_text(source(text))


def body(text: str) -> str:
    """The statements of a model, formatted."""
    lines = formatted(f"model A {{\n{text}\n}}\n").splitlines()
    assert lines[0] == "model A {" and lines[-1] == "}"
    return "\n".join(line.removeprefix("  ") for line in lines[1:-1])


def comments(text: str) -> list[str]:
    """All comments, without what ends their lines."""
    without_texts = re.sub(r'"[^"\n]*"|(#[^\n]*)', lambda m: m.group(1) or '""', text)
    return [c.rstrip() for c in re.findall(r"#[^\n]*", without_texts)]


def words(text: str) -> list[str]:
    """All tokens but line breaks."""
    return [str(t) for t in _parse_with_tokens(source(text))[1] if t.type != "_NL"]


def keeps_everything(before: str, after: str) -> None:
    assert words(after) == words(before)
    assert comments(after) == comments(before)
    assert _equal(parse(source(before)).statements, parse(source(after)).statements)
    assert after == "" or (after.endswith("\n") and not after.endswith("\n\n"))
    assert "\n\n\n" not in after and not re.search(r"[ \t]\n", after)


# ---------------------------------------------------------------- whole files


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.bg")), ids=lambda p: p.stem)
def test_models_stay_as_they_are(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert formatted(text) == text


@pytest.mark.few(30)
@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_twice_is_once(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    once = formatted(text)
    keeps_everything(text, once)
    assert formatted(once) == once


@pytest.mark.parametrize("path", [p for p in SKETCHES if p.stem != "traps"], ids=lambda p: p.stem)
def test_sketches_stay_as_they_are(path: Path) -> None:
    """Carefully written files need no change; traps.bg is not one of them."""
    text = path.read_text(encoding="utf-8")
    assert formatted(text) == text


@pytest.mark.parametrize("path", CASES, ids=lambda p: p.stem)
def test_wrong_files(path: Path) -> None:
    """A file with syntax errors is refused with them; one with other mistakes is formatted."""
    text = path.read_text(encoding="utf-8")
    try:
        parse(source(text))
    except CompilationFailed as failed:
        with pytest.raises(CompilationFailed) as refused:
            formatted(text)
        assert [d.code for d in refused.value.diagnostics] == [d.code for d in failed.diagnostics]
    else:
        keeps_everything(text, once := formatted(text))
        assert formatted(once) == once


@pytest.mark.parametrize("name", ["oscillator", "mass-spring 2", "C", "2nd", "ü", "", "../x", "model"])
def test_the_first_file_of_a_new_user_is_formatted(name: str) -> None:
    text = starter_text(name)
    assert formatted(text) == text


# ---------------------------------------------------------------- spaces


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("parameter a=1,b:N/m=2 , c : um=( 1,2 )", "parameter a = 1, b: N/m = 2, c: um = (1, 2)"),
        ("input u:V=0V", "input u: V = 0 V"),
        ("signal s=2[ N * m / s ^ 2 ]*x ^ - 2", "signal s = 2 [N*m/s^2]*x^-2"),
        ("signal s=- x-- y+( -z ) *-2", "signal s = -x - -y + (-z)*-2"),
        ("signal s=a if b>c and(not(d<=e))else f", "signal s = a if b > c and (not (d <= e)) else f"),
        ("signal s=f ( a+b,g( ) )", "signal s = f(a + b, g())"),
        ("signal s=x [ i - 1 , j+1 ]. y . z", "signal s = x[i-1, j+1].y.z"),
        ("signal s=x[ f( i - 1 ) ]", "signal s = x[f(i - 1)]"),
        ('signal s = 1 kg"text"  ,t=2', 'signal s = 1 kg "text", t = 2'),
        ("1   body", "1 body"),
        ("1 a,b:translation{active=x>0}", "1 a, b : translation { active = x > 0 }"),
        ("C c( x:translation,y ):energy=x^2", "C c(x: translation, y) : energy = x^2"),
        ("R r[ 2 ] (a,b):a.F=b.v,b.F=a.v", "R r[2](a, b) : a.F = b.v, b.F = a.v"),
        (
            "C c:F=k*x{start x=1mm,nominal x=2;prefer=integral}",
            "C c : F = k*x { start x = 1 mm, nominal x = 2; prefer = integral }",
        ),
        ("Comb c{}", "Comb c {}"),
        ("a->b=>c,d", "a -> b => c, d"),
        ("0( a,1( b ) )->c[ 1 ]", "0(a, 1(b)) -> c[1]"),
        ("a -> b;c -> d;   e -> f;  g -> h", "a -> b; c -> d;  e -> f;  g -> h"),
        ("port a:electric,b( x:translation,y ),c:planar", "port a: electric, b(x: translation, y), c: planar"),
        ("for i in 1 .. n - 1{0 n[ i ]:electric}", "for i in 1..n-1 { 0 n[i] : electric }"),
        ("for i in f( 1 + 2 )..3{ }", "for i in f(1 + 2)..3 {}"),
        ("multibody m:planar{body a{mass=1kg}}", "multibody m : planar { body a { mass = 1 kg } }"),
        ("when h<0 m{v=-v}", "when h < 0 m { v = -v }"),
        (
            "experiment e{simulate 0..1s{rtol=1e-8};report( x-y )in um,z}",
            "experiment e { simulate 0 .. 1 s { rtol = 1e-8 }; report (x - y) in um, z }",
        ),
        (
            "experiment e{sweep l:uN=-1,2;response a to b over 1 Hz..2 kHz}",
            "experiment e { sweep l: uN = -1, 2; response a to b over 1 Hz .. 2 kHz }",
        ),
        ("signal s = a # b", "signal s = a  # b"),
        ("signal s = a# b", "signal s = a  # b"),
        ("\tsignal\ts\t=\ta", "signal s = a"),
    ],
)
def test_spaces(before: str, after: str) -> None:
    assert body(before) == after
    assert body(after) == after


def test_outside_of_models() -> None:
    text = 'import    A ,B   from "x.bg"\nimport C from  electric\nconstant c=1\nfunction f( x,y )=x+y\n\nplain   model  P{}'
    assert (
        formatted(text)
        == 'import A, B from "x.bg"\nimport C from electric\nconstant c = 1\nfunction f(x, y) = x + y\n\nplain model P {}\n'
    )


# ---------------------------------------------------------------- lines


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("\n\n\nmodel A {\n\n\n  1 a\n\n\n\n  1 b\n\n}\n\n\n", "model A {\n\n  1 a\n\n  1 b\n\n}\n"),
        ("# a\n\n\n  # b\nmodel A {\n# c\n1 a # d\n    # e\n}\n   # f", "# a\n\n# b\nmodel A {\n  # c\n  1 a  # d\n       # e\n}\n# f\n"),
        ("model A {\n1 a   # one\n      # goes on\n      # and on\n# two\n1 b\n}", "model A {\n  1 a   # one\n        # goes on\n        # and on\n  # two\n  1 b\n}\n"),
        ("model A { 1 a\n1 b\n}", "model A { 1 a\n  1 b\n}\n"),
        ("model A {\n for i in 1..2 { for j in 1..2 {\n1 a[i, j]\n } }\n}", "model A {\n  for i in 1..2 { for j in 1..2 {\n    1 a[i, j]\n  } }\n}\n"),
        ("model A {\n  a\n-> b,\n c\n}", "model A {\n  a\n    -> b,\n    c\n}\n"),
        ("model A {\n  a -> b\n    -> c\n    => d\n}", "model A {\n  a -> b\n    -> c\n    => d\n}\n"),
        ("model A {\n   a->b\n     ->c\n}", "model A {\n  a -> b\n    -> c\n}\n"),
        ("model A {\n signal s = f(\n1,\n g(\n2\n )\n)\n}", "model A {\n  signal s = f(\n    1,\n    g(\n      2\n    )\n  )\n}\n"),
        ("model A {\n D d { a = 1\n       b = 2 }\n D e {\na = 1\nb = 2 }\n}", "model A {\n  D d { a = 1\n        b = 2 }\n  D e {\n    a = 1\n    b = 2 }\n}\n"),
        ("model A {\n C c :\n  F = k*x {\nstart x = 1\n}\n}", "model A {\n  C c :\n    F = k*x {\n      start x = 1\n    }\n}\n"),
        ("", ""),
        ("\n\n", ""),
        ("# only a comment", "# only a comment\n"),
    ],
)  # fmt: skip
def test_lines(before: str, after: str) -> None:
    assert formatted(before) == after
    assert formatted(after) == after


def test_line_ends_are_kept() -> None:
    assert formatted("model A {\r\n1 a # x\r\n\r\n\r\n\r\n1 b\r\n}") == "model A {\r\n  1 a  # x\r\n\r\n  1 b\r\n}\r\n"


# ---------------------------------------------------------------- tables


TABLES = [
    """Se push   : F = 1 N
1  body
I  mass   : p = m*v
C  spring : F = k*x      { start x = 1 mm }
R  damper : F = r*v""",
    """parameter rho    = 2330 [kg/m^3]       "silicon"
parameter d: um  = (1.95, 1.75, 1.75)  "thickness"
parameter r_phi: N*m*s = 0, r_x: N*s/m = 0, r_y: N*s/m = 0  "losses"
parameter m_f    = rho                 "a flexure\"""",
    """signal radial     =  x*cos(arm) + y*sin(arm)
signal tangential = -x*sin(arm) + y*cos(arm)""",
    """arm.x   -> joints.x;  arm.y -> joints.y
arm.phi => joints.phi""",
    """Comb    comb[i]    { n = 1, h = 2 }
Flexure flexure[i] { k_phi = 1           # (4.14)
                     k_x   = 2 + 3
                     k_y   = 3 }         # (4.15)""",
    """C spring(x, y) :
  energy = 1/2*k_x*( x*cos(a) + y*sin(a))^2
         + 1/2*k_y*(-x*sin(a) + y*cos(a))^2""",
    """C spring : F = k1*x if x < x_0
               else k1*x_0 + k2*(x - x_0)    { start x = 1 }""",
    """output y1 = integral(-1.71*y1 + 0.43*y2, 1)
output y2 = integral( 1.71*y1 - 8.75*y2, 0)""",
    """parameter m = 3 kg, k: N/m = 2,
          to = 4, if_ = 5""",
    "constant eps0 = 8.8541878128e-12 [F/m]               # alone, but it has its place",
]


@pytest.mark.parametrize("text", TABLES)
def test_tables_stay(text: str) -> None:
    assert body(text) == text


def test_tables_keep_together_when_something_grows() -> None:
    assert body('parameter a   =1  "one"\nparameter bb  =2  "two"\nparameter ccc =f(1,2)  "three"') == (
        'parameter a   = 1  "one"\nparameter bb  = 2  "two"\nparameter ccc = f(1, 2)  "three"'
    )
    assert body("Se push : F=1\nI  mass : p=m*v   # one\nC  s    : F=k*x   # two") == (
        "Se push : F = 1\nI  mass : p = m*v   # one\nC  s    : F = k*x   # two"
    )
    first = "model A{ }     # one\nmodel BBB { }  # two\n"  # from the first line on
    assert formatted(first) == "model A {}    # one\nmodel BBB {}  # two\n"


def test_what_is_no_table_is_tidied() -> None:
    assert body("Se push  :   F = 1\nI mass :  p =  m*v") == "Se push : F = 1\nI mass : p = m*v"
    assert body("signal a = ( x )\nsignal b = ( y )") == "signal a = (x)\nsignal b = (y)"
    far = "1  a\n" + "signal s = 1\n" * 6 + "1  b"
    assert body(far).splitlines()[0] == "1 a"


def test_columns_do_not_move_with_the_indentation() -> None:
    shifted = "\n".join(" " * 5 + line for line in TABLES[0].splitlines())
    assert body(shifted) == TABLES[0]


# ---------------------------------------------------------------- whatever the spaces were

SPACES = [" ", " ", "  ", "   ", "\t", "        "]


def shaken(text: str, share: float, rng: random.Random) -> str:
    """The text with other spaces, blank lines and indentation; comments and line breaks stay."""
    parts: list[str] = []
    position = 0
    for token in _parse_with_tokens(source(text))[1]:
        gap = text[position : token.start_pos]
        if token.type == "_NL":
            parts.append(gap + _shaken_break(str(token), share, rng))
        else:
            parts.append((_shaken_break(gap, share, rng) if "\n" in gap else _shaken_gap(gap, share, rng)) + str(token))
        position = token.end_pos or 0
    return "".join(parts) + text[position:]


def _shaken_gap(gap: str, share: float, rng: random.Random) -> str:
    return rng.choice(SPACES) if gap and rng.random() < share else gap


def _shaken_break(text: str, share: float, rng: random.Random) -> str:
    def other(match: re.Match[str]) -> str:
        if rng.random() >= share:
            return match.group()
        return rng.choice(["", " ", "\t"]) + "\n" * rng.choice([1, 1, 1, 2, 4]) + " " * rng.randrange(12)

    return re.sub(r"[ \t]*\n[ \t]*", other, text)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(FILES), st.sampled_from([0.01, 0.1, 0.5, 1.0]), st.integers(0, 2**32))
@example(MODELS / "manipulator.bg", 1.0, 0)
def test_shaken_files(path: Path, share: float, seed: int) -> None:
    text = shaken(path.read_text(encoding="utf-8"), share, random.Random(seed))
    once = formatted(text)
    keeps_everything(text, once)
    assert formatted(once) == once


@settings(deadline=None, max_examples=300)
@given(
    st.lists(
        st.sampled_from(
            [
                "a",
                "1",
                "+",
                "-",
                "(",
                ")",
                "\n",
                " ",
                "  ",
                "#",
                "{",
                "}",
                "[",
                "]",
                "=",
                "->",
                ";",
                ",",
                "x:",
                "C",
                "signal ",
            ]
        ),
        max_size=14,
    )
)
def test_any_text(parts: list[str]) -> None:
    """Formatted, or refused with errors: never another meaning, never an exception of another kind."""
    text = "model A {\n" + "".join(parts) + "\n}"
    try:
        once = formatted(text)
    except CompilationFailed:
        return
    keeps_everything(text, once)
    assert formatted(once) == once


# ---------------------------------------------------------------- it looks at what it did


def test_a_defect_is_found_before_anything_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_write", lambda lines: "model A { 1 c }\n")
    with pytest.raises(InternalError, match="mean something else"):
        formatted("model A { 1 b }")
    monkeypatch.setattr(module, "_write", lambda lines: "model A {")
    with pytest.raises(InternalError, match="no longer be read"):
        formatted("model A { 1 b }")


def test_time_grows_with_the_length() -> None:
    """Eight times the text takes at most twelve times as long (lark and its garbage aside, it is linear)."""
    text = (MODELS / "mems.bg").read_text(encoding="utf-8")
    head, models = text[: text.index("model ")], text[text.index("model ") :]

    def seconds(copies: int) -> float:
        long = head + "".join(models.replace("model ", f"model M{i}_") for i in range(copies))
        began = time.process_time()
        assert formatted(long) == long
        return time.process_time() - began

    seconds(1)
    short = min(seconds(10) for _ in range(3))
    assert seconds(80) < 12 * short + 0.5


def test_a_bandwidth() -> None:
    assert "  experiment e { bandwidth 50 kHz; simulate 0 .. 1 s }" in formatted(
        "model A {\n  experiment e{bandwidth   50   kHz;simulate 0..1 s}\n}\n"
    )
