"""Outline of a file: its models by name and place, found without parsing, so that of an imported file only the models in use are parsed."""

from __future__ import annotations

import re
from collections.abc import Iterable

# Texts and comments hide what is in them; a semicolon that ends a model goes with it.
_MARK = re.compile(r'"[^"\n]*"|#[^\n]*|\{|\}(?:[ \t]*;)*|\b(?:plain\s+)?model\s+([A-Za-z_]\w*)', re.ASCII)
_WORD = re.compile(r"[A-Za-z_]\w*", re.ASCII)

Place = tuple[int, int]  # first character, and the one behind the last


class Outline:
    """Models of a text by name, with their places: several where a name is defined twice. None if the braces do not match: then all is parsed."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.models: dict[str, list[Place]] = {}
        self.waiting: list[Place] = []  # beside models: parsed first
        depth, last, start, name = 0, 0, 0, ""
        for mark in _MARK.finditer(text):
            if mark[1]:
                if not depth and not name:
                    start, name = mark.start(), mark[1]
            elif mark[0] == "{":
                depth += 1
            elif mark[0][0] == "}":
                depth -= 1
                if not depth and name:
                    self.models.setdefault(name, []).append((start, mark.end()))
                    self.waiting.append((last, start))
                    last, name = mark.end(), ""
                if depth < 0:
                    break
        if depth or name:
            self.models, self.waiting, last = {}, [], 0
        self.waiting.append((last, len(text)))
        self.unused = dict(self.models)

    def next_text(self, names: Iterable[str]) -> str:
        """Return the text of these models and, the first time, of what is no model, with the models that these texts name.

        Spaces stand for the rest, and for what was returned before.
        """
        places, new, self.waiting = [], self.waiting, []
        words = set(names)
        while new or words:
            places += new
            words.update(word for start, end in new for word in _WORD.findall(self.text[start:end]))
            new = [place for name in words & self.unused.keys() for place in self.unused.pop(name)]
            words = set()
        pieces, last = [], 0
        for start, end in sorted(places):
            gap = start - last
            pieces += ["\n" * (gap > 0), " " * (gap - 1), self.text[start:end]]
            last = end
        return "".join(pieces)
