"""The author's names as Python identifiers, one to one."""

from __future__ import annotations

import builtins
import keyword
import re

RESERVED = frozenset(
    {*keyword.kwlist, *keyword.softkwlist, *dir(builtins), "np", "batch"}
    | {"time", "state", "inputs", "constants", "mode", "parameters"}
)


class Identifiers:
    """Unique identifiers for names."""

    def __init__(self) -> None:
        self.taken: set[str] = set()
        # of the names that were asked for, so that the thousandth costs no thousand tries
        self.counts: dict[str, int] = {}

    def of(self, name: str) -> str:
        """A new identifier similar to the name."""
        word = re.sub(r"[^A-Za-z0-9_]+", "_", name.replace("]", "")).strip("_") or "value"
        if word[0].isdigit() or word in RESERVED or word.startswith("_"):
            word = f"v_{word}"
        candidate, count = word, self.counts.get(word, 1)
        while candidate in self.taken:
            count += 1
            candidate = f"{word}_{count}"
        self.counts[word] = count
        self.taken.add(candidate)
        return candidate
