"""Usage of the function whose brackets the cursor is in."""

from __future__ import annotations

import re
from pathlib import Path

from compiler.api import file_names, tree

from .answers import CallUsage
from .completion import place_at
from .vocabulary import FUNCTION_TEXTS, USAGES
from .workspace import Workspace

_ARGUMENT = re.compile(r"(?:[^,()]|\([^()]*\))+")


def call_usage(workspace: Workspace, path: Path, at: int) -> CallUsage | None:
    """Return the call around a character, with the argument that is written there; None outside of calls."""
    place = place_at(workspace, path, at)
    words = place.context.statement
    for opening in reversed(place.context.brackets):
        name = words[opening - 1].text if opening else ""
        function = place.names.get(name) or file_names(place.file).get(name)
        usage = USAGES.get(name, "")
        if function is not None and isinstance(function.node, tree.FunctionSyntax):
            usage = f"{name}({', '.join(function.node.parameters)})"
        if words[opening].text == "(" and usage:
            inside = usage[len(name) + 1 : -1]
            arguments = tuple(a.strip() for a in _ARGUMENT.findall(inside))
            return CallUsage(
                usage, arguments, _commas(place.context.statement[opening + 1 :]), FUNCTION_TEXTS.get(name, "")
            )
    return None


def _commas(words: tuple[object, ...]) -> int:
    """Commas that are in no inner brackets."""
    depth = count = 0
    for word in words:
        sign = getattr(word, "text", "")
        depth += (sign in ("(", "[")) - (sign in (")", "]"))
        count += sign == "," and not depth
    return count
