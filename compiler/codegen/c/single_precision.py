"""A file of C in `float` instead of `double`: types, numbers and the functions of the mathematical library."""

from __future__ import annotations

import re

_WORDS = {"double": "float", "<math.h>": "<tgmath.h>"}
# A number below the second would be zero: what guards a divisor becomes the smallest normal one.
SMALLEST, VANISHING = "1.17549435e-38", 1.4e-45
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
    if word in _WORDS:
        return _WORDS[word]
    return f"{SMALLEST if 0 < float(word) < VANISHING else word}f"
