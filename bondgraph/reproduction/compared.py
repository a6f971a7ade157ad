"""Result of a reproduction: published and computed values, computed tables, errata; as a page, as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..quantities import behind
from ..results.json_values import as_json, entries

SCHEMA = "bondgraph-reproduction/1"


@dataclass(frozen=True, slots=True)
class Compared:
    """A published value and the computed one in the printed unit; `digits` is the printed precision."""

    where: str
    what: str
    unit: str
    published: float
    computed: float
    digits: float
    note: str

    @property
    def error(self) -> float:
        """Error relative to the published value; absolute where that is zero."""
        off = self.computed - self.published
        return off / abs(self.published) if self.published else off

    @property
    def agrees(self) -> bool:
        """True if the error is within the printed precision."""
        return abs(self.computed - self.published) <= self.digits * (1 + 1e-9)


@dataclass(frozen=True, slots=True)
class Table:
    """A computed table that is not in print: `heads` with units, and rows of numbers (or of words, in the first column)."""

    where: str
    what: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    note: str


@dataclass(frozen=True, slots=True)
class PictureFile:
    """A picture file of the page."""

    where: str
    what: str
    file: str


@dataclass(frozen=True, slots=True)
class Erratum:
    """An error in print."""

    where: str
    text: str


@dataclass(frozen=True, eq=False)
class Reproduction:
    """All values of a folder, in the order of its list."""

    title: str
    source: str
    values: tuple[Compared, ...]
    errata: tuple[Erratum, ...]
    tables: tuple[Table, ...] = ()
    pictures: tuple[PictureFile, ...] = ()

    @property
    def agrees(self) -> bool:
        """True if all values agree."""
        return all(v.agrees for v in self.values)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-reproduction/1`.

        {schema, title, source, agrees, values: [{where, what, unit, published, computed, digits, error, agrees, note}], tables: [{where, what, heads, rows,
        note}], errata: [{where, text}]}.
        """
        values = [as_json(v) | entries(v, "error", "agrees") for v in self.values]
        return {"schema": SCHEMA, **entries(self, "title", "source", "agrees", "tables", "errata"), "values": values}

    def page(self) -> str:
        """Return a page in Markdown, with links to its pictures."""
        rows = ["| where | what | published | computed | relative error | |", "|---|---|---:|---:|---:|---|"]
        for v in self.values:
            error = f"{v.error:+.2g}" if v.published else f"{v.error:+.2g}{behind(v.unit)} off"
            verdict = "agrees" if v.agrees else f"**off by more than {v.digits:g}**"
            rows.append(
                f"| {_cell(v.where)} | {_cell(v.what)} | {v.published:g}{_cell(behind(v.unit))} | {v.computed:.7g} | {error} "
                f"| {verdict}{f'; {_cell(v.note)}' if v.note else ''} |"
            )
        count = sum(v.agrees for v in self.values)
        parts = [
            f"# {self.title}",
            self.source,
            f"{count} of {len(self.values)} published values agree.",
            "\n".join(rows),
        ]
        if self.tables:
            parts += ["## Computed, not in print", *(_table(t) for t in self.tables)]
        if self.pictures:
            parts += [
                "## Figures",
                *(f"{_cell(p.where)}: {_cell(p.what)}\n\n![{_cell(p.where)}]({p.file})" for p in self.pictures),
            ]
        if self.errata:
            parts += [
                "## Errata",
                "\n".join(f"{i}. {_cell(e.where)}: {_cell(e.text)}" for i, e in enumerate(self.errata, 1)),
            ]
        return "\n\n".join(parts) + "\n"

    def summary(self) -> str:
        """Return a table for terminals."""
        from ..presentation.text.tables import aligned, visible

        rows: list[tuple[str, ...]] = [("where", "what", "published", "computed", "error", "")]
        for v in self.values:
            numbers = (f"{v.published:g}{behind(v.unit)}", f"{v.computed:.7g}", f"{v.error:+.2g}")
            rows.append((visible(v.where), visible(v.what), *map(visible, numbers), "agrees" if v.agrees else "off"))
        count = sum(v.agrees for v in self.values)
        return f"{visible(self.title)}\n\n{aligned(rows, '<<>>><')}\n\n{count} of {len(self.values)} agree"


def _table(table: Table) -> str:
    head = f"| {' | '.join(map(_cell, table.heads))} |\n|{'---:|' * len(table.heads)}"
    rows = ["| " + " | ".join(x if isinstance(x, str) else f"{x:.6g}" for x in row) + " |" for row in table.rows]
    note = f"\n\n{_cell(table.note)}" if table.note else ""
    return f"**{_cell(table.where)}** {_cell(table.what)}\n\n" + "\n".join([head, *rows]) + note


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
