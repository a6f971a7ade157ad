"""Findings of a stress test, as data, and the page that reports them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as promised: `where` is the row of the table, `what` a sentence."""

    where: str
    what: str


@dataclass(slots=True)
class Section:
    """One section of the page: paragraphs and tables in Markdown, failures, and refusals in words."""

    title: str
    parts: list[str] = field(default_factory=list)
    failed: list[Finding] = field(default_factory=list)
    refused: list[Finding] = field(default_factory=list)
    unsuited: Counter[str] = field(
        default_factory=Counter
    )  # why a solver that was named is not one for a model -> how often
    tried: int = 0
    seconds: float = 0.0

    def say(self, text: str) -> None:
        """A paragraph."""
        self.parts.append(text)

    def table(self, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """A table; numbers are shown with two digits."""
        lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
        lines += ["| " + " | ".join(map(shown, row)) + " |" for row in rows]
        self.parts.append("\n".join(lines))

    def picture(self, path: Path, text: str) -> None:
        """A picture that lies beside the page."""
        self.parts.append(f"![{text}]({path.name})")

    def fail(self, where: str, what: str) -> None:
        """Something is not as promised."""
        self.failed.append(Finding(where, " ".join(what.split())))

    def refuse(self, where: str, what: str) -> None:
        """Record a refused run, with the reason that it gave."""
        self.refused.append(Finding(where, " ".join(what.split())))

    def text(self) -> str:
        """The section as Markdown."""
        told = [
            f"## {self.title}",
            f"{self.tried} tried, {len(self.failed)} failed, {len(self.refused)} refused; {self.seconds:.0f} s of computing.",
        ]
        told += self.parts
        if self.unsuited:
            told.append("Solvers that were named for models that they are not for (`-`), and what they told:")
            told.append("\n".join(f"- {count} times: {why}" for why, count in self.unsuited.most_common()))
        for title, findings in (("Refused", self.refused), ("Failed", self.failed)):
            if findings:
                told.append(f"{title}:")
                told.append("\n".join(f"- {f.where}: {_plain(f.what)}" for f in findings))
        return "\n\n".join(told)


def shown(cell: object) -> str:
    """A cell of a table."""
    if isinstance(cell, float):
        return "" if cell != cell else f"{cell:.2g}"
    return str(cell).replace("|", "\\|").replace("\n", " ")


def page(sections: Sequence[Section], heading: str, about: Sequence[str]) -> str:
    """The whole page."""
    rows = [(s.title, s.tried, len(s.failed), len(s.refused), f"{s.seconds:.0f}") for s in sections]
    summary = Section("")
    summary.table(("section", "tried", "failed", "refused", "s of computing"), rows)
    return "\n\n".join([f"# {heading}", *about, *summary.parts, *(s.text() for s in sections)]) + "\n"


def _plain(text: str) -> str:
    return text if len(text) < 600 else text[:600] + " …"
