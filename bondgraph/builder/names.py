"""Names that the builder accepts: those of the language, with an index where there is one."""

from __future__ import annotations

import re

from compiler.api import ELEMENT_KINDS, RESERVED

from ..errors import UsageError

_NAME = re.compile(r"([A-Za-z_][A-Za-z_0-9]*)(?:\[([0-9]{1,9}(?:, ?[0-9]{1,9})*)\])?")


def name_of(name: object) -> str:
    """Return a name of the language, with an index if it has one."""
    match = _NAME.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise UsageError(
            "BR535", f"{name!r} is no name: letters a-z, digits and _, not a digit first, and perhaps an index, `mass[2]`",
        )  # fmt: skip
    word, index = match.groups()
    if word in RESERVED:
        raise UsageError("BR536", f"`{word}` is a word of the language and cannot be a name")
    return word if index is None else f"{word}[{', '.join(str(int(i)) for i in index.split(','))}]"


def model_name_of(name: object) -> str:
    """Return a name for a model."""
    own = name_of(name)
    if own in ELEMENT_KINDS or "[" in own:
        raise UsageError("BR537", f"`{name}` cannot be the name of a model")
    return own
