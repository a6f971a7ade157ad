"""7. Random edits of valid files and nonsense by a grammar: each an answer in time, within memory; harmless edits change nothing.

`python -m tests.stress.edits FIRST COUNT` is the child that tries the edits with these numbers and prints what was wrong, one JSON a line.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import traceback
from collections import Counter
from functools import lru_cache
from pathlib import Path
from random import Random
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from bondgraph.compiled_model import LIBRARY  # noqa: E402
from compiler import api  # noqa: E402
from compiler.errors import CompilationFailed  # noqa: E402
from tests.stress.report import Section  # noqa: E402
from tests.stress.trial import TooLong, within  # noqa: E402

LONGEST = 2.0  # s of computing for one text
MEMORY = 500_000  # kB
BATCH = 2500
FOLDERS = (
    "models",
    "models/published",
    "bondgraph/library",
    "tests/syntax/sketches",
    "tests/metamorphic/circuits",
    "tests/errors/cases",
)
TOKEN = re.compile(r"[A-Za-z_]\w*|\d+\.?\d*(?:[eE][+-]?\d+)?|->|=>|\.\.|[<>=!]=|\s+|.", re.DOTALL)
EXTREME = (
    "0", "-1", "1e300", "1e-300", "1e400", "99999999999999999999", "1e5", "0.1", "2^-1", "1/0", "0*0", "pi", "time", "true", "1 kg", "1 m^99", "-0.0",
)  # fmt: skip
ODD = (
    "\u00b5",
    "\u2192",
    "\u2212",
    "\u00d7",
    "\u221e",
    "\u00a0",
    "\ufeff",
    "\u200b",
    "\t",
    "\r",
    "\0",
    "\u202e",
    "\u03c9",
    "''",
    '"',
    "\\",
    "`",
    "$",
    "@",
    "´",
)


@lru_cache
def seeds() -> tuple[tuple[str, str], ...]:
    """Names and texts to edit."""
    found = [(str(p), p.read_text(encoding="utf-8")) for f in FOLDERS for p in sorted((ROOT / f).glob("*.bg"))]
    return tuple((name, text) for name, text in found if len(text) < 5000)


@lru_cache
def words() -> tuple[str, ...]:
    """All that is written anywhere."""
    return tuple(sorted({t for _, text in seeds() for t in TOKEN.findall(text) if not t.isspace()}))


# ---------------------------------------------------------------- edits
def edited(number: int) -> tuple[str, str]:
    """The text with this number, and the name of the file that it came from."""
    rng = Random(number)
    if number % 8 == 7:
        return "nonsense.bg", nonsense(rng)
    valid = [seed for seed in seeds() if "errors" not in Path(seed[0]).parts]
    name, text = rng.choice(valid if rng.random() < 0.8 else seeds())
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        text = rng.choice(EDITS)(text, rng)
    return name, text


def _character(text: str, rng: Random) -> str:
    at = rng.randrange(len(text) + 1)
    new = rng.choice([*'(){}[]:;,.=<>-+*/^"#\n abcxyzIRC0129', *ODD])
    return rng.choice((text[:at] + new + text[at:], text[:at] + text[at + 1 :], text[:at] + new + text[at + 1 :]))


def _token(text: str, rng: Random) -> str:
    tokens = TOKEN.findall(text)
    places = [i for i, t in enumerate(tokens) if not t.isspace()]
    if not places:
        return text
    i, j = rng.choice(places), rng.choice(places)
    match rng.randrange(5):
        case 0:
            tokens[i] = rng.choice(words())
        case 1:
            tokens[i] = ""
        case 2:
            tokens[i] = f"{tokens[i]} {tokens[i]}"
        case 3:
            tokens[i], tokens[j] = tokens[j], tokens[i]
        case _:
            tokens[i] = tokens[j]
    return "".join(tokens)


def _number(text: str, rng: Random) -> str:
    found = list(re.finditer(r"\b\d+\.?\d*(?:[eE][+-]?\d+)?\b", text))
    if not found:
        return text
    match = rng.choice(found)
    return text[: match.start()] + rng.choice(EXTREME) + text[match.end() :]


def _line(text: str, rng: Random) -> str:
    lines = text.split("\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case _:
            other = rng.choice(seeds())[1].split("\n")
            lines.insert(i, rng.choice(other))
    return "\n".join(lines)


def _cut(text: str, rng: Random) -> str:
    at, to = sorted((rng.randrange(len(text) + 1), rng.randrange(len(text) + 1)))
    return rng.choice((text[:at], text[at:], text[:at] + text[to:], text[:to] + text[at:]))


def _splice(text: str, rng: Random) -> str:
    other = rng.choice(seeds())[1]
    return text[: rng.randrange(len(text) + 1)] + other[rng.randrange(len(other) + 1) :]


def _nested(text: str, rng: Random) -> str:
    at, depth = rng.randrange(len(text) + 1), rng.choice((3, 50, 500))
    opening = rng.choice(("(", "[", "{", "-", "not ", "a.", "1+", "for i in 1..9 {", "1 if 1 > 2 else "))
    return text[:at] + opening * depth + text[at:]


EDITS = (_character, _character, _token, _token, _token, _number, _line, _line, _cut, _splice, _nested)


# ---------------------------------------------------------------- nonsense by a grammar
KINDS = (
    "Se",
    "Sf",
    "C",
    "I",
    "IC",
    "R",
    "RS",
    "TF",
    "GY",
    "MSe",
    "MSf",
    "MR",
    "MTF",
    "MGY",
    "0",
    "1",
    "splitter",
    "Diode",
    "Thing",
)
NAMES = ("a", "b", "c", "m", "k", "spring", "mass", "body", "node[1]", "arm.pin", "x", "time", "pi")
UNITS = ("kg", "N", "m/s", "N*s/m", "V", "A", "1/s", "m^2", "K", "degC", "dB", "nothing", "(N*m)^(1/2)")
DOMAINS = ("translation", "rotation", "electric", "planar", "spatial", "thermal", "untyped", "strange")


def expression(rng: Random, depth: int = 0) -> str:
    """Any expression."""
    again = lambda: expression(rng, depth + 1)  # noqa: E731
    if depth > 4 or rng.random() < 0.3:
        return rng.choice((rng.choice(NAMES), rng.choice(NAMES) + ".v", str(rng.choice((0, 1, 2.5, 1e-9, 1e12))), f"{rng.choice((1, 3, 0.1))} {rng.choice(UNITS)}",
                           f"{rng.choice((1, 3))} [{rng.choice(UNITS)}]"))  # fmt: skip
    match rng.randrange(6):
        case 0 | 1:
            return f"{again()} {rng.choice(('+', '-', '*', '/', '^', '<', '==', 'and', 'or'))} {again()}"
        case 2:
            function = rng.choice(
                (
                    "sin",
                    "sqrt",
                    "abs",
                    "min",
                    "atan2",
                    "step",
                    "ramp",
                    "integral",
                    "delay",
                    "linear",
                    "noise",
                    "polar",
                    "column",
                    "f",
                )
            )
            return f"{function}({', '.join(again() for _ in range(rng.randrange(4)))})"
        case 3:
            return f"({again()})"
        case 4:
            return f"{again()} if {again()} else {again()}"
        case _:
            return f"-{again()}"


def statement(rng: Random, depth: int = 0) -> str:
    """Any statement."""
    e, n = lambda: expression(rng), lambda: rng.choice(NAMES)
    kinds = [
        lambda: f"{rng.choice(KINDS)} {n()} : {rng.choice('FvxpuieqfM')} = {e()}",
        lambda: f"{rng.choice(KINDS)} {n()}(x, y: {rng.choice(DOMAINS)}) : energy = {e()}",
        lambda: f"{rng.choice('01')} {n()}, {n()} : {rng.choice(DOMAINS)}",
        lambda: f"{rng.choice(('parameter', 'constant', 'input', 'signal', 'output', 'mode'))} {n()} = {e()}",
        lambda: f"parameter {n()}: {rng.choice(UNITS)} = {e()}",
        lambda: f"{n()} {rng.choice(('->', '=>'))} {n()}, {n()}",
        lambda: f"{n()} -> {rng.choice('01')}({n()}, {n()}) -> {n()}",
        lambda: f"when {e()} {{ {n()} = {e()}; {n()} = {e()} }}",
        lambda: f"every {e()} {{ {n()} = {e()} }}",
        lambda: f"require {e()}",
        lambda: f"experiment e {{ set {n()} = {e()}; simulate 0 .. {e()} {{ rtol = {e()} }}; report {e()} }}",
        lambda: f"port {n()}: {rng.choice(DOMAINS)}",
        lambda: f"import {n()} from {rng.choice(('mechanics', 'electric', chr(34) + 'none.bg' + chr(34)))}",
        lambda: f"function f({n()}) = {e()}",
        lambda: (
            f"multibody {n()} : {rng.choice(('planar', 'spatial'))} {{ body {n()} {{ mass = {e()}, at = ({e()}, {e()}) }}\nhinge {n()} : ground to {n()} {{ at = (0, 0) }}\n}}"
        ),
    ]
    if depth < 3:
        kinds += [lambda: f"for i in 1..{rng.choice((0, 2, 3, 200000, 'n'))} {{\n{statement(rng, depth + 1)}\n}}",
                  lambda: f"model {rng.choice('ABC')} {{\n" + "\n".join(statement(rng, depth + 1) for _ in range(rng.randrange(9))) + "\n}"]  # fmt: skip
    return rng.choice(kinds)()


def nonsense(rng: Random) -> str:
    """A file that the grammar may allow."""
    lines = "\n".join(statement(rng, 1) for _ in range(rng.randrange(1, 15)))
    return f"{rng.choice(('', 'plain '))}model Root {{\n{lines}\n}}\n"


# ---------------------------------------------------------------- one text
def answer(name: str, text: str) -> tuple[str, str]:
    """Outcome for a text: a word that is counted, and the fault of the answer."""
    source = api.Source(name, text, Path(name) if os.path.isabs(name) else None)
    try:
        with within(LONGEST):
            diagnostics = tuple(api.check_source(source, None, LIBRARY))
    except TooLong:
        return "hangs", f"no answer within {LONGEST:g} s"
    except RecursionError:
        return "crashes", "RecursionError"
    except Exception as error:
        return "crashes", f"{type(error).__name__}: {error}; {traceback.format_exc(limit=-2)[-300:]}"
    for diagnostic in diagnostics:
        told = api.render(diagnostic)
        span = diagnostic.span
        if not told.strip() or not diagnostic.code or span.line < 1 or span.column < 1:
            return "no place", f"{diagnostic.code} has no place: {told[:200]}"
        if span.source.text == text and not 0 <= span.start <= len(text):
            return "no place", f"{diagnostic.code} lies outside of the text"
        if "InternalError" in type(diagnostic).__name__:
            return "crashes", told[:300]
    return ("refused" if diagnostics else "accepted"), ""


def child(first: int, count: int) -> None:
    """Try edits and print what was wrong; the last line counts."""
    counted: Counter[str] = Counter()
    before = 0
    api.check_source(api.Source("first.bg", seeds()[0][1]), None, LIBRARY)  # what is imported once counts for no text
    for number in range(first, first + count):
        name, text = edited(number)
        word, wrong = answer(name, text)
        counted[word] += 1
        if wrong:
            print(json.dumps({"number": number, "word": word, "wrong": wrong}), flush=True)
        now = _most_memory()
        if now > MEMORY >= before:
            print(json.dumps({"number": number, "word": "memory", "wrong": f"{now // 1000} MB"}), flush=True)
        before = now
    print(json.dumps({"counted": counted, "memory": before}), flush=True)


def _most_memory() -> int:
    """Peak memory of this process, in kB. The system's own figure includes the parent's, from before it was another program."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(re.search(r"VmHWM:\s*(\d+)", status)[1])  # type: ignore[index]
    except (OSError, TypeError):
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def section(short: bool, count: int | None = None, first: int = 0) -> Section:
    """Batches of edits in children of their own, and harmless edits."""
    found = Section("7. Random edits and nonsense")
    total = count or (250 if short else 100_000)
    counted: Counter[str] = Counter()
    memory = 0
    for begin in range(first, first + total, BATCH):
        size = min(BATCH, first + total - begin)
        told = _batch(found, begin, size)
        counted.update(told.get("counted", {}))
        memory = max(memory, told.get("memory", 0))
    found.tried += sum(counted.values())
    found.say(
        f"{total} texts: seven in eight a file of the gallery, the library or the tests with up to six random edits, one in eight by a grammar of nonsense. "
        f"Each gets at most {LONGEST:g} s and {MEMORY // 1000} MB, and each refusal must have a code and a place."
    )
    found.table(("answer", "texts"), sorted(counted.items()))
    found.say(f"The largest process had {memory // 1000} MB.")
    _harmless(found, short)
    return found


def _batch(found: Section, begin: int, size: int) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "tests.stress.edits", str(begin), str(size)], capture_output=True, text=True, cwd=ROOT, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    last: dict[str, Any] = {}
    for line in done.stdout.splitlines():
        told = json.loads(line)
        if "number" in told:
            found.fail(f"edit {told['number']}: {told['word']}", told["wrong"])
        else:
            last = told
    if done.returncode or not last:
        found.fail(
            f"edits {begin} to {begin + size}", f"the process ended with {done.returncode}: {done.stderr[-300:]}"
        )
    return last


# ---------------------------------------------------------------- harmless edits
def harmless(text: str, rng: Random) -> str:
    """Comments, empty lines and spaces anywhere between words of a line."""
    lines = []
    for line in text.split("\n"):
        quoted = '"' in line or "#" in line
        if not quoted:
            tokens = TOKEN.findall(line)
            line = "".join(t * rng.choice((1, 1, 2)) if t.isspace() else t for t in tokens)
            line += rng.choice(("", "", "   ", "  # a word", " #"))
        lines += [line] + [rng.choice(("", "# nothing -> to { see", "   "))] * rng.choice((0, 0, 1))
    return "\n".join(lines)


def _harmless(found: Section, short: bool) -> None:
    """Runs that must give the same numbers to the last digit."""
    import bondgraph

    tried = same = 0
    for path in sorted((ROOT / "models").glob("*.bg")):
        if short and path.stem not in ("oscillator", "duffing", "rc_driven"):
            continue
        text = path.read_text(encoding="utf-8")
        changed = harmless(text, Random(path.stem))
        found.tried += 1
        tried += 1
        try:
            first = bondgraph.load(path).simulate(points=5)
            source = api.Source(str(path), changed, path)
            second = bondgraph.Model(source).simulate(points=5)
        except bondgraph.errors.UsageError:
            continue
        except CompilationFailed as failed:  # of several models none is named: a file of parts
            if {d.code for d in failed.diagnostics} != {"BG132"}:
                found.fail(f"harmless edit of {path.stem}", str(failed))
            continue
        except Exception as error:
            found.fail(f"harmless edit of {path.stem}", f"{type(error).__name__}: {error}")
            continue
        if first.names == second.names and (first.values == second.values).all():
            same += 1
        else:
            found.fail(f"harmless edit of {path.stem}", "other numbers")
    found.say(
        f"Comments, empty lines and spaces put into {tried} models of the gallery: {same} runs with the same numbers to the last digit."
    )


if __name__ == "__main__":
    child(int(sys.argv[1]), int(sys.argv[2]))
