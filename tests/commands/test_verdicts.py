"""All commands that read a model agree on whether it is right, and refuse it with the same code.

Each wrong file of `tests/errors` and some models go through `check`, `run`, and a part of the other commands that changes from file to file. With
BONDGRAPH_EVERY_VERDICT=1 all commands take all files (some minutes).
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bondgraph.commands import commands
from tests.compiling import MODELS

ERRORS = Path(__file__).parent.parent / "errors" / "cases"
WRONG = sorted(ERRORS.glob("*.bg"))
RIGHT = [path for path in sorted(MODELS.glob("*.bg")) if path.stem != "mems"]  # several models to choose from
EVERY = bool(os.environ.get("BONDGRAPH_EVERY_VERDICT"))

# The stage that a command reaches, and its arguments. FILE and OUT stand for paths.
TEXT, GRAPH, STROKES, EQUATIONS, PROGRAM = range(5)
COMMANDS = {
    "certificate": (PROGRAM, "certificate FILE"),
    "run": (PROGRAM, "run FILE --to 1e-9 --points 2 --target numpy"),
    "run --energy": (PROGRAM, "run FILE --energy --to 1e-9 --points 2 --target numpy"),
    "explain": (PROGRAM, "explain FILE"),
    "compile": (PROGRAM, "compile FILE -o OUT.py"),
    "show code": (PROGRAM, "show FILE --stage code -e none"),
    "equilibrium": (PROGRAM, "equilibrium FILE"),
    "linearize": (PROGRAM, "linearize FILE --at start"),
    "modes": (PROGRAM, "modes FILE --at start"),
    "sensitivity": (PROGRAM, "sensitivity FILE"),
    "bode": (PROGRAM, "bode FILE --points 2"),
    "equations": (EQUATIONS, "equations FILE"),
    "causality": (EQUATIONS, "causality FILE -e none"),
    "show reduction": (EQUATIONS, "show FILE --stage reduction -e none"),
    "draw": (STROKES, "draw FILE -o OUT.svg"),
    "report": (STROKES, "report FILE -o OUT.html"),  # tells the rest on the page
    "show text": (GRAPH, "show FILE --stage text -e none"),
    "show syntax": (TEXT, "show FILE --stage syntax -e none"),
}  # fmt: skip
WITH_AN_EXPERIMENT = ("run", "run --energy")
ALWAYS = ("certificate", "run")

# Compiled with every parameter as an argument: a value of zero is one of many.
ONLY_WITH_THIS_VALUE = {("law_nothing_left", name) for name in ("compile", "sensitivity", "bode")}


def stage_of(code: str) -> int:
    """The stage that finds a mistake with this code."""
    if code == "BG003":  # a number that its unit makes too large
        return GRAPH
    return {"0": TEXT, "1": GRAPH, "3": STROKES, "6": PROGRAM}.get(code[2], EQUATIONS)


def invoke(words: str, path: Path, out: Path) -> Result:
    arguments = [w.replace("FILE", str(path)).replace("OUT", str(out / "x")) for w in words.split()]
    done = CliRunner().invoke(commands, arguments)
    assert done.exit_code in (0, 1, 2, 3), (arguments, done.stderr)
    return done


def codes_of(done: Result) -> set[str]:
    return set(re.findall(r"^\S.*?:\d+:\d+: (BG\d{3}):", done.stderr, re.MULTILINE))


def lines_of_experiments(text: str) -> set[int]:
    """The lines inside the braces of experiments, by counting braces."""
    inside, depth, found = 0, 0, set()
    for number, line in enumerate(text.split("\n"), 1):
        bare = re.sub(r'"[^"]*"|#.*', "", line)
        if re.match(r"\s*experiment\b", bare):
            inside = depth + 1
        if inside:
            found.add(number)
        depth += bare.count("{") - bare.count("}")
        if inside and depth < inside:
            inside = 0
    return found


def chosen(number: int) -> Iterable[str]:
    """The commands that a file goes through: always some, and the others in turn."""
    others = [name for name in COMMANDS if name not in ALWAYS]
    turn = [others[(3 * number + i) % len(others)] for i in range(3)]
    return COMMANDS if EVERY else (*ALWAYS, *turn)


@pytest.mark.few(94)
@pytest.mark.parametrize("path", WRONG, ids=lambda p: p.stem)
def test_a_wrong_file_is_refused_by_all(path: Path, tmp_path: Path) -> None:
    checked = invoke("check FILE --json", path, tmp_path)
    assert checked.exit_code == 1
    mistakes = json.loads(checked.stdout)["diagnostics"]
    experiments = lines_of_experiments(path.read_text(encoding="utf-8"))
    for name in chosen(WRONG.index(path)):
        reach, words = COMMANDS[name]
        seen = {
            m["code"]
            for m in mistakes
            if stage_of(m["code"]) <= reach and (name in WITH_AN_EXPERIMENT or m["line"] not in experiments)
        }
        done = invoke(words, path, tmp_path)
        if not seen or (path.stem, name) in ONLY_WITH_THIS_VALUE:
            continue
        assert done.exit_code == 1, (name, seen, done.output)
        assert codes_of(done) & (seen | {"BG132"}), (name, seen, done.stderr)


SMALL = ("dc_motor", "duffing", "helmholtz", "lotka_volterra", "rlc", "transformer")


@pytest.mark.parametrize("path", [p for p in RIGHT if EVERY or p.stem in SMALL], ids=lambda p: p.stem)
def test_a_right_file_is_refused_by_none(path: Path, tmp_path: Path) -> None:
    """Numbers may fail, as where there is no rest (exit code 3), or what is asked may not be there (2); the file is not wrong (1)."""
    assert invoke("check FILE", path, tmp_path).exit_code == 0
    for name in chosen(RIGHT.index(path)):
        done = invoke(COMMANDS[name][1], path, tmp_path)
        if name == "fmt":
            continue
        assert done.exit_code != 1, (name, done.stderr)
