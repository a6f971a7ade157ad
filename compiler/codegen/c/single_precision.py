"""A file of C in `float` instead of `double`: types, numbers and the functions of the mathematical library."""

from __future__ import annotations

import re

# texts and comments stay; then the words and numbers that change
_TOKENS = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/|\bdouble\b|<math\.h>|(?<![\w.])(?:\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)(?![\w.])',
    re.DOTALL,
)


def in_single_precision(text: str) -> str:
    """Return the same file for single precision. Functions of <tgmath.h> are those of their arguments."""
    return _TOKENS.sub(_changed, text)


def _changed(match: re.Match[str]) -> str:
    word = match[0]
    if word[0] in '"/':
        return word
    return {"double": "float", "<math.h>": "<tgmath.h>"}.get(word) or f"{word}f"
