"""List of a folder: reading, and check of its words and kinds."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import UsageError

FILE = "published.toml"
MOST = 10_000  # most entries of a kind
TAKES = ("final", "minimum", "maximum", "peak to peak")
KINDS = ("time", "phase", "energy", "response", "sweep", "surface", "modes")
Words = Mapping[str, type | tuple[type, ...]]
NUMBER = (float, int)
SECTIONS: Mapping[str, Words] = {
    "value": {
        "where": str, "what": str, "model": str, "experiment": str, "of": str, "published": (float, int, list), "unit": str, "digits": NUMBER,
    },
    "table": {"where": str, "what": str, "model": str, "experiment": str},
    "inversion": {"where": str, "what": str, "model": str, "by": list, "outputs": list, "setpoints": list},
    "picture": {"where": str, "what": str, "model": str, "experiment": str, "kind": str},
    "erratum": {"where": str, "text": str},
}  # fmt: skip


def listed(folder: Path) -> Mapping[str, Any]:
    """Return the list as read from TOML. Raises `UsageError`, OSError."""
    path = folder / FILE
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as problem:
        raise UsageError("BR806", f"{path}: {problem}") from None
    for section, words in SECTIONS.items():
        entries = found.get(section, [])
        if not isinstance(entries, list) or len(entries) > MOST:
            raise UsageError("BR807", f"{path}: `[[{section}]]` begins each {section}, at most {MOST} of them")
        for number, entry in enumerate(entries, 1):
            _check(path, section, number, entry, words)
    return found


def _check(path: Path, section: str, number: int, entry: Mapping[str, Any], words: Words) -> None:
    told = f"{path}: {section} {number} ({entry.get('what', '')})"
    for word, kind in words.items():
        if not isinstance(entry.get(word), kind) or isinstance(entry.get(word), bool):
            raise UsageError("BR808", f"{told} has no `{word}`, or one of another kind")
    for word, known in (("take", TAKES), ("kind", KINDS)):
        if entry.get(word, known[0]) not in known:
            raise UsageError("BR809", f"{told}: `{word}` is {', '.join(known)}; not `{entry[word]}`")


def inside(folder: Path, file: str) -> Path:
    """Return the path of a file in the folder. Raises `UsageError`."""
    path = (folder / file).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise UsageError("BR810", f"`{file}` lies outside of {folder}")
    return path
