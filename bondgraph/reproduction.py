"""A folder of models with a list of published values: everything is computed again, and a page says how well it agrees.

`published.toml` has a `title`, a `source`, and

    [[value]]                    one published number
    where, what                  the place in print, and what it is
    model, experiment            a file of the folder and one of its experiments ("" none: the model at rest)
    of                           a column of its outcome: an output at rest or at the end of a run, `frequency 1`
    point                        which point of a sweep (0 the first; left out: 0)
    published, unit              the number as printed
    digits                       half a unit of its last digit, or what print allows, in the same unit
    note                         why it differs, if it does

    [[erratum]]                  what is wrong in print: where, text
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import UsageError
from .quantities import behind

if TYPE_CHECKING:
    from .analysis.outcome import Outcome

SCHEMA = "bondgraph-reproduction/1"
FILE = "published.toml"
MOST = 10_000  # values
WORDS = {
    "where": str,
    "what": str,
    "model": str,
    "experiment": str,
    "of": str,
    "published": float,
    "unit": str,
    "digits": float,
}


@dataclass(frozen=True, slots=True)
class Compared:
    """A published value and the computed one in the printed unit; `digits` is what print allows."""

    where: str
    what: str
    unit: str
    published: float
    computed: float
    digits: float
    note: str

    @property
    def error(self) -> float:
        """Relative to what is published; absolute where that is zero."""
        off = self.computed - self.published
        return off / abs(self.published) if self.published else off

    @property
    def agrees(self) -> bool:
        """Whether it is within what print allows."""
        return abs(self.computed - self.published) <= self.digits * (1 + 1e-9)


@dataclass(frozen=True, slots=True)
class Erratum:
    """What is wrong in print."""

    where: str
    text: str


@dataclass(frozen=True, eq=False)
class Reproduction:
    """All values of a folder, in the order of its list."""

    title: str
    source: str
    values: tuple[Compared, ...]
    errata: tuple[Erratum, ...]

    @property
    def agrees(self) -> bool:
        """Whether all values agree."""
        return all(v.agrees for v in self.values)

    def to_json(self) -> dict[str, Any]:
        """By the schema `bondgraph-reproduction/1`: {schema, title, source, agrees, values: [{where, what, unit, published, computed, digits,
        error, agrees, note}], errata: [{where, text}]}."""
        values = [
            {
                "where": v.where, "what": v.what, "unit": v.unit, "published": v.published,
                "computed": v.computed if math.isfinite(v.computed) else None, "digits": v.digits,
                "error": v.error if math.isfinite(v.error) else None, "agrees": v.agrees, "note": v.note,
            }
            for v in self.values
        ]  # fmt: skip
        told = {"schema": SCHEMA, "title": self.title, "source": self.source, "agrees": self.agrees, "values": values}
        return {**told, "errata": [{"where": e.where, "text": e.text} for e in self.errata]}

    def page(self) -> str:
        """A page in Markdown."""
        rows = ["| where | what | published | computed | relative error | |", "|---|---|---:|---:|---:|---|"]
        for v in self.values:
            error = f"{v.error:+.2g}" if v.published else f"{v.error:+.2g}{behind(v.unit)} off"
            verdict = "agrees" if v.agrees else f"**off by more than {v.digits:g}**"
            rows.append(
                f"| {_cell(v.where)} | {_cell(v.what)} | {v.published:g}{_cell(behind(v.unit))} | {v.computed:.7g} | {error} "
                f"| {verdict}{f'; {_cell(v.note)}' if v.note else ''} |"
            )
        parts = [f"# {self.title}", self.source, "\n".join(rows)]
        if self.errata:
            parts += [
                "## Errata",
                "\n".join(f"{i}. {_cell(e.where)}: {_cell(e.text)}" for i, e in enumerate(self.errata, 1)),
            ]
        return "\n\n".join(parts) + "\n"

    def summary(self) -> str:
        """A table for terminals."""
        from .views.tables import aligned, visible

        rows: list[tuple[str, ...]] = [("where", "what", "published", "computed", "error", "")]
        for v in self.values:
            numbers = (f"{v.published:g}{behind(v.unit)}", f"{v.computed:.7g}", f"{v.error:+.2g}")
            rows.append((visible(v.where), visible(v.what), *map(visible, numbers), "agrees" if v.agrees else "off"))
        count = sum(v.agrees for v in self.values)
        return f"{visible(self.title)}\n\n{aligned(rows, '<<>>><')}\n\n{count} of {len(self.values)} agree"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def reproduce(folder: str | os.PathLike[str]) -> Reproduction:
    """Run all that `published.toml` of a folder names. Raises `UsageError` for a list that makes no sense, and as `Model.run`."""
    place = Path(folder)
    listed = _listed(place / FILE)
    outcomes: dict[tuple[str, str], Outcome] = {}
    values = []
    for entry in listed.get("value", ()):
        key = entry["model"], entry["experiment"]
        if key not in outcomes:
            outcomes[key] = _outcome(place, *key)
        values.append(_compared(outcomes[key], entry))
    errata = tuple(Erratum(str(e.get("where", "")), str(e.get("text", ""))) for e in listed.get("erratum", ()))
    return Reproduction(str(listed.get("title", place.name)), str(listed.get("source", "")), tuple(values), errata)


def _listed(path: Path) -> Mapping[str, Any]:
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as problem:
        raise UsageError(f"{path}: {problem}") from None
    values = found.get("value", [])
    if not isinstance(values, list) or len(values) > MOST:
        raise UsageError(f"{path}: `[[value]]` begins each published value, at most {MOST} of them")
    for number, entry in enumerate(values, 1):
        for word, kind in WORDS.items():
            value = entry.get(word)
            if not isinstance(value, kind) and not (
                kind is float and isinstance(value, int) and not isinstance(value, bool)
            ):
                raise UsageError(
                    f"{path}: value {number} ({entry.get('what', '')}) has no `{word}`, or one of another kind"
                )
    return found


def _outcome(place: Path, file: str, experiment: str) -> Outcome:
    from .model import load
    from .studies.experiment import Options, run
    from .studies.sweep import sweep

    path = (place / file).resolve()
    if not path.is_relative_to(place.resolve()):
        raise UsageError(f"`{file}` lies outside of {place}")
    model = load(path)
    if not experiment:
        return sweep(model, {}, ("equilibrium",), False, None, {}, Options())
    return run(model, experiment, {}, Options())


def _compared(outcome: Outcome, entry: Mapping[str, Any]) -> Compared:
    from .quantities import in_unit

    name, point = entry["of"], entry.get("point", 0)
    if name not in outcome.names or not isinstance(point, int) or not 0 <= point < len(outcome):
        known: Sequence[str] = outcome.names
        raise UsageError(
            f"{entry['what']}: there is no `{name}` at point {point} of `{entry['experiment']}`; there is {', '.join(known)}"
        )
    computed = in_unit(float(outcome(name)[point]), entry["unit"], outcome.units[name], entry["what"])
    return Compared(
        entry["where"], entry["what"], entry["unit"], float(entry["published"]), computed, float(entry["digits"]), str(entry.get("note", ""))
    )  # fmt: skip
