"""Files made to exhaust the machine: each is refused in words, after a bounded amount of work.

Work is counted in calls, which are the same on every machine; a million calls take less than a second. Building the tree of a
large text is linear (`tests/syntax/test_growth.py`), so texts here are short and need much work.
"""

from __future__ import annotations

import json
import os
import random
import re
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands
from compiler.examination import check
from compiler.semantics.names.imports import MAXIMUM_FILES
from compiler.semantics.names.statement_errors import MAXIMUM_MISTAKES
from compiler.source import Source

MAXIMUM_CALLS = 15_000_000


def body(text: str) -> str:
    return f"model A {{\n{text}\n}}\n"


def models(last: str, parts: str, count: int = 40) -> str:
    return "".join(f"model M{i} {{ {parts.format(i + 1)} }}\n" for i in range(count)) + f"model M{count} {{ {last} }}\n"


def rows(line: str, count: int) -> str:
    return "\n".join(line.format(i, i + 1) for i in range(count))


LARGE = {
    "power of python": (body("output y = 9**9**9**9"), "BG001"),
    "power": (body("parameter y = 9^9^9^9\noutput z = y"), "BG111"),
    "power of a signal": (body("output z = time/1 s*9^9^9^9"), "BG111"),
    "powers in a row": (body("parameter b0 = 9^9\n" + rows("parameter b{1} = b{0}^9", 30) + "\noutput y = b30"), "BG133"),
    "power of a unit": (body("parameter a = 3 [m^99999999999999999999]"), "BG008"),
    "brackets": (body("output y = " + "(" * 60_000), "BG004"),
    "brackets alone": ("(" * 60_000, "BG001"),
    "braces": ("{" * 60_000, "BG001"),
    "range": (body("for i in 1..1000000000000 { 1 a[i] : rotation }"), "BG111"),
    "rounds": (body("parameter n = 9^9\nfor i in 1..n { 1 a[i] : rotation }"), "BG160"),
    "empty rounds": (body("for i in 1..100000 { for j in 1..100000 { } }"), "BG160"),
    "rounds of a mechanism": (body("multibody b { for i in 1..100000 { for j in 1..100000 { } } }"), "BG160"),
    "quantities": (body("for i in 1..1000 { for j in 1..1000 { parameter x = 1 } }"), "BG160"),
    "instances": (models("1 x : rotation", "M{0} a, b, c, d, e, f, g, h"), "BG160"),
    "empty instances": (models("", "M{0} a, b, c, d, e, f, g, h"), "BG160"),
    "arrays of arrays": (models("", "for i in 1..1000 {{ M{0} a[i] }}", 3), "BG160"),
    "parameters of instances": ("model B { parameter " + ", ".join(f"p{i} = 1" for i in range(1000)) + " }\n"
                                + body("for i in 1..100000 { B b[i] }"), "BG160"),
    "deep hierarchy": (models("", "M{0} a", 300), "BG160"),
    "functions": ("function f0(x) = x*x\n" + rows("function f{1}(x) = f{0}(f{0}(x))", 59) + "\n" + body("output y = f59(time/1 s)"), "BG160"),
    "ring of quantities": (body(rows("parameter a{0} = a{1}", 2000) + "\nparameter a2000 = a0"), "BG160"),
    "row of units to find": (body("output y = u[60]\nsignal u[0] = time\nfor i in 1..60 { signal u[i] = integral((u[i-1] - u[i])/1 s, 0) }"), "BG160"),
    "long list": (body("parameter a = (" + ",".join(["1"] * 20_000) + ")"), "BG160"),
    "nul": ("model A {\x00}", "BG002"),
    "calls of python": (body("output y = __import__('os').system('touch canary')"), "BG001"),
    "attributes of python": (body("output y = time.__class__.__bases__"), "BG101"),
}  # fmt: skip


@pytest.fixture
def counted() -> Any:
    """Ends a test that makes too many calls."""
    count = 0

    def profile(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")
        if count > MAXIMUM_CALLS:
            sys.setprofile(None)
            pytest.fail(f"more than {MAXIMUM_CALLS} calls")

    before = sys.getprofile()
    sys.setprofile(profile)
    yield
    sys.setprofile(before)


@pytest.mark.few(12)
@pytest.mark.parametrize("name", LARGE)
def test_refused_in_words(name: str, counted: None) -> None:
    text, code = LARGE[name]
    found = check(Source("hostile.bg", text))
    assert code in {d.code for d in found}, [d.sentence for d in found]
    assert len(found) <= MAXIMUM_MISTAKES + 1


def test_a_product_that_doubles_is_no_bomb(counted: None) -> None:
    text = body(rows("signal a{0} = a{1}*a{1}", 90) + "\nsignal a90 = time/1 s\noutput y = a0")
    assert check(Source("doubling.bg", text)) == ()


def test_a_long_row_of_quantities_is_read() -> None:
    """The dependences of a quantity are resolved first, so that long chains do not recurse."""
    text = body(rows("parameter a{0} = a{1} + 1", 3000) + "\nparameter a3000 = 1\noutput y = a0")
    assert check(Source("row.bg", text)) == ()


@pytest.mark.parametrize(
    "line",
    ["Se s{0} : F = q{0}", "output x{0} = nothing", "a{0} -> b{0}", "Kind{0} b{0}", "parameter a = 1"],
    ids=["laws", "names", "bonds", "kinds", "taken"],
)
def test_mistakes_are_capped(line: str) -> None:
    found = check(Source("wrong.bg", body(rows(line, 2000))))
    assert len(found) == MAXIMUM_MISTAKES + 1
    (closing,) = [d for d in found if d.code == "BG161"]
    assert closing.sentence == f"More than {MAXIMUM_MISTAKES} mistakes: what else is wrong is not told"


def test_mistakes_of_syntax_are_capped() -> None:
    assert 1 < len(check(Source("wrong.bg", body(rows("1 1 1", 2000))))) <= 20


# ---------------------------------------------------------------- files


def told(path: Path | str) -> tuple[int, str]:
    result = CliRunner().invoke(commands, ["check", str(path)])
    return result.exit_code, result.output


def test_a_folder(tmp_path: Path) -> None:
    code, text = told(tmp_path)
    assert code == 2 and "it is a folder" in text


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_what_never_ends(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bg")
    (tmp_path / "zero.bg").symlink_to("/dev/zero")
    for name in ("pipe.bg", "zero.bg"):
        code, text = told(tmp_path / name)
        assert code == 2 and "it is no regular file" in text
        (tmp_path / "main.bg").write_text(f'import X from "{name}"\nmodel A {{ }}\n')
        code, text = told(tmp_path / "main.bg")
        assert code == 1 and "BG131" in text


def test_a_file_without_end(tmp_path: Path) -> None:
    with open(tmp_path / "huge.bg", "wb") as stream:
        stream.truncate(10**12)  # a hole: it takes no room
    code, text = told(tmp_path / "huge.bg")
    assert code == 2 and "the limit is 32000000" in text
    (tmp_path / "main.bg").write_text('import X from "huge.bg"\nmodel A { }\n')
    code, text = told(tmp_path / "main.bg")
    assert code == 1 and "the limit is 32000000" in text


def test_what_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "noise.bg"
    noise = random.Random(1)
    for data in ("model A { }".encode("utf-16"), noise.randbytes(100_000), b"\xff\xfe", b"model A { \xc3\x28 }"):
        path.write_bytes(data)
        code, text = told(path)
        assert code == 1 and "not a text in UTF-8" in text
        assert re.search(r"noise\.bg:\d+:\d+: BG009: ", text)
    path.write_bytes(bytes(noise.choice(b' \n{}()[]=:,.#"abc019') for _ in range(20_000)))
    assert told(path)[0] == 1


HIDDEN = "\0\a\b\x1b\f\v\x7f\x85\x9b\u061c\u200e\u200f\u2028\u202a\u202e\u2066\u2069\ufeff"


@pytest.mark.parametrize("character", HIDDEN, ids=[f"U+{ord(c):04X}" for c in HIDDEN])
@pytest.mark.parametrize(
    "text",
    [
        "model A {\n  # a @ comment\n  output y = 1\n}\n",
        "# a @\nmodel A { output y = 1 }\n",
        "model A { output y = 1 }\n# at the end @",
        'model A {\n  "described @"\n  output y = 1\n}\n',
        "model A {\n  output y@ = 1\n}\n",
        "model A {\r\n  output y = 1 # @\r\n}\r\n",
    ],
)
def test_what_cannot_be_seen(text: str, character: str, tmp_path: Path) -> None:
    """In comments and texts too: it would rewrite a terminal, or the reader's eye. Without it nothing is wrong."""
    path = tmp_path / "hidden.bg"
    path.write_bytes(text.replace("@", "").encode())
    assert told(path)[0] == 0
    path.write_bytes(text.replace("@", character).encode())
    line = text[: text.index("@")].count("\n") + 1
    for command in ("check", "run", "fmt", "equations"):
        done = CliRunner().invoke(commands, [command, str(path)])
        assert done.exit_code == 1
        assert re.search(rf"hidden\.bg:{line}:\d+: BG002: .*U\+{ord(character):04X}", done.stderr)
        assert character not in done.output


def test_a_real_mistake_beside_what_cannot_be_seen() -> None:
    found = check(Source("a.bg", "model A {\n  # \x1b[2J\n  output y = = 1\n  # \u202e\n}\n"))
    assert [(d.code, d.span.line) for d in found] == [("BG002", 2), ("BG001", 3), ("BG002", 4)]


def test_letters_of_other_scripts_in_comments() -> None:
    assert not check(Source("a.bg", "model A {\n  # Ωμέγα, Länge ‒ 長さ, \u05d0\u05d1, 🙂\n  output y = 1\n}\n"))


@pytest.mark.parametrize(
    "content",
    [b"", b" ", b"\n\n", b"# nothing\n", b"\xef\xbb\xbf", b"\t\r\n", b"constant a = 1\n", b"function f(x) = x\n"],
)
def test_a_file_without_a_model(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "nothing.bg"
    path.write_bytes(content)
    for command in ("check", "run", "certificate", "equations"):
        done = CliRunner().invoke(commands, [command, str(path)])
        assert done.exit_code == 1 and "nothing.bg:1:1: BG132: The file defines no model" in done.stderr


@pytest.mark.parametrize("value", ["0", "1e-20", "9e-14", "0.11", "0.5", "1", "3", "1e300"])
def test_the_limits_of_a_relative_tolerance(value: str) -> None:
    text = "model A {\n  output y = 1\n  experiment e { simulate 0 .. 1 s { rtol = @ } }\n}\n"
    found = check(Source("a.bg", text.replace("@", value)))
    assert [(d.code, d.span.line) for d in found] == [("BG150", 3)]
    assert "between 1e-13 and 0.1" in found[0].help
    for fine in ("1e-13", "1e-6", "0.1"):
        assert not check(Source("a.bg", text.replace("@", fine)))


BAD_BYTES = [
    (b"\xff\xfem\0", 1, 1, "UTF-16"),
    (b"\xfe\xff\0m", 1, 1, "UTF-16"),
    (b"PK\3\4\n\xba", 2, 1, "a model imports it"),
    (b"model A { # caf\xe9 }\n", 1, 16, "0xe9"),
    (b"model A {\n  output l = 1 \xb5m\n}\n", 2, 16, "0xb5"),
    (b"model A {\r\n\r\n  # \xc3\xa9 \xc3\x28\r\n}\r\n", 3, 7, "0xc3"),
    (b"\xef\xbb\xbfmodel A {\n# \x80\n}", 2, 3, "0x80"),
    (b"model A { }\n# \xed\xa0\x80", 2, 3, "0xed"),
    (b"model A { }\n# \xf4\x90\x80\x80", 2, 3, "0xf4"),
    (b"model A { }\n# \xe2\x82", 2, 3, "0xe2"),
    (bytes(range(128, 256)), 1, 1, "0x80"),
]


@pytest.mark.parametrize(("data", "line", "column", "words"), BAD_BYTES, ids=range(len(BAD_BYTES)))
def test_the_place_of_a_byte_that_is_no_text(data: bytes, line: int, column: int, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bytes.bg"
    path.write_bytes(data)
    for command in ("check", "run", "fmt"):
        done = CliRunner().invoke(commands, [command, str(path)])
        assert done.exit_code == 1
        assert f"bytes.bg:{line}:{column}: BG009: " in done.stderr and words in done.stderr
    found = json.loads(CliRunner().invoke(commands, ["check", "--json", str(path)]).stdout)["diagnostics"]
    assert [(d["code"], d["line"], d["column"]) for d in found] == [("BG009", line, column)]


@pytest.mark.parametrize(
    "place", ["../outside.bg", "/etc/passwd", "../../../../etc/passwd", "link.bg", "inner/../../outside.bg"]
)
def test_nothing_outside_of_the_folder_is_read(place: str, tmp_path: Path) -> None:
    project = tmp_path / "project"
    (project / "inner").mkdir(parents=True)
    (tmp_path / "outside.bg").write_text("model Secret { }\nthis is a secret\n")
    (project / "link.bg").symlink_to(tmp_path / "outside.bg")
    (project / "main.bg").write_text(f'import Secret from "{place}"\nmodel A {{ }}\n')
    code, text = told(project / "main.bg")
    assert code == 1 and "lies outside the project folder" in text
    assert "this is" not in text


def test_imports_of_imports(tmp_path: Path) -> None:
    """Each file imports the next two: 2^60 paths, each file read once; and a fan of more files than are read."""
    for i in range(60):
        (tmp_path / f"f{i}.bg").write_text(
            f'import M{i + 1} from "f{i + 1}.bg"\nimport M{i + 2} from "f{i + 2}.bg"\nmodel M{i} {{ 1 a : rotation }}\n'
        )
    for i in (60, 61):
        (tmp_path / f"f{i}.bg").write_text(f"model M{i} {{ }}\n")
    assert told(tmp_path / "f0.bg")[0] == 1
    fan = MAXIMUM_FILES + 5
    for i in range(fan):
        (tmp_path / f"g{i}.bg").write_text(f"model G{i} {{ }}\n")
    (tmp_path / "fan.bg").write_text("".join(f'import G{i} from "g{i}.bg"\n' for i in range(fan)) + "model A { }\n")
    code, text = told(tmp_path / "fan.bg")
    assert code == 1 and f"BG160: Imported files: more than {MAXIMUM_FILES}" in text


def test_signals_with_memory_are_no_ring() -> None:
    """The rate of an integral is read when all names are known, even if another quantity is resolved before it."""
    text = body(
        "input target = 0\nsignal place = integral(speed, 0)\nsignal speed = integral((force - speed*1 s)/1 s, 0)/1 s\n"
        "signal error = target - place\nsignal force = 3*error + 2*integral(error/1 s, 0)\noutput y = place"
    )
    assert [d.sentence for d in check(Source("loop.bg", text))] == []


@pytest.mark.parametrize(
    "line",
    [
        'import X from "{}.bg"\nmodel A {{ output y = time }}',
        'model A {{ output y = linear(0.5, column("{}.csv", "a"), column("{}.csv", "b")) }}',
    ],
)
def test_a_name_that_no_disk_can_hold_names_no_file(line: str, tmp_path: Path) -> None:
    (tmp_path / "main.bg").write_text(line.format("x" * 5000, "x" * 5000))
    code, text = told(tmp_path / "main.bg")
    assert code == 1 and "There is no file" in text
