"""Any text of a file is answered with diagnostics: no exception escapes, and a text that passes `check` compiles."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from compiler.errors import CompilationFailed, render
from compiler.examination import check
from compiler.source import Source
from tests.compiling import LIBRARY, ROOT, compiled

FOLDERS = [
    ROOT / "tests" / "errors" / "cases",
    ROOT / "tests" / "golden",
    ROOT / "tests" / "syntax" / "sketches",
    ROOT / "models",
]
FILES = [p for folder in FOLDERS for p in sorted(folder.glob("*.bg")) if p.stat().st_size < 2600]
WORDS = (
    "C I R Se Sf TF GY MSe MSf MR MTF RS IC splitter body frame slide hinge free weld ground x phi F v p e f q time pi true if "
    "translation rotation electric thermal hydraulic parameter constant signal output input port for experiment um kg N"
)
TOKENS = re.compile(r"\s+|\w+|[^\w\s]")


def mutated(text: str, chance: random.Random) -> str:
    """The text with some words exchanged, doubled, dropped or replaced: mostly still of the grammar, mostly wrong."""
    tokens = TOKENS.findall(text)
    for _ in range(chance.choice([1, 1, 2, 3])):
        words = [i for i, t in enumerate(tokens) if re.match(r"[A-Za-z]", t)]
        numbers = [i for i, t in enumerate(tokens) if t.isdigit()]
        if not words:
            return text
        here, there = chance.choice(words), chance.choice(words)
        match chance.randrange(6):
            case 0:
                tokens[here] = tokens[there]
            case 1:
                tokens[here] = chance.choice(WORDS.split())
            case 2:
                tokens[here], tokens[there] = tokens[there], tokens[here]
            case 3 if numbers:
                tokens[chance.choice(numbers)] = chance.choice(["0", "1", "2", "-1", "1e-12", "3"])
            case 4:
                del tokens[chance.randrange(len(tokens))]
            case _:
                tokens.insert(chance.randrange(len(tokens)), chance.choice(tokens))
    return "".join(tokens)


@pytest.mark.few(6)
@pytest.mark.parametrize("seed", range(12))
def test_no_text_breaks_the_compiler(seed: int) -> None:
    """Twelve times thirty mutated files; every message can be rendered."""
    chance = random.Random(seed)
    for _ in range(30):
        path = chance.choice(FILES)
        text = mutated(path.read_text(encoding="utf-8"), chance)
        try:
            found = check(Source("text.bg", text), None, LIBRARY)
            assert all(render(d) for d in found)
            if not found:
                _ = compiled(text).program
        except CompilationFailed as failed:
            assert {d.code for d in failed.diagnostics} == {"BG132"}, f"check passed it:\n{text}\n{failed}"
        except Exception as error:
            raise AssertionError(f"{path.name} mutated:\n{text}") from error


def test_there_is_something_to_mutate() -> None:
    assert len(FILES) > 80 and all(isinstance(p, Path) for p in FILES)
    assert mutated("model A { }", random.Random(1)) != mutated("model A { }", random.Random(2))
