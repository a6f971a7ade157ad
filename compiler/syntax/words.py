"""The grammar as text, and the words that it names: read without lark."""

from __future__ import annotations

import re
from pathlib import Path

from ..steps import ANALYSIS_STEPS


def grammar() -> str:
    """Grammar in lark's notation: `grammar.lark`, and a rule of all analysis steps."""
    rows = {word.upper(): row for word, row in ANALYSIS_STEPS.items()}
    rule = "analysis: " + " | ".join(f"{name} {row.grammar}" for name, row in rows.items())
    text = Path(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    return "\n".join([text, rule, *(f'{name}: "{row.word}"' for name, row in rows.items()), ""])


def grammar_words() -> tuple[str, ...]:
    """Words of the language, without signs, in the order in which the grammar names them."""
    return tuple(dict.fromkeys(re.findall(r'"([a-z]+)"', re.sub(r"//.*", "", grammar()))))
