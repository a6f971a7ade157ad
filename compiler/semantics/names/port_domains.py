"""Domains of the ports of one model definition: ports joined by bonds form classes, and each class has one domain."""

from __future__ import annotations

from dataclasses import field

from ...errors import Diagnostic
from ...fast_dataclass import dataclass
from ...graph.domains import DOMAINS, GENERIC, Domain
from ...graph.groups import Groups
from ...source import Span
from .errors import DomainConflict

Key = tuple[str, ...]  # ("spring", "x"), ("body", ""), ("comb", "shuttle", "")


@dataclass(slots=True)
class DomainTable:
    """Domains of all ports in one definition. Keys name parts without their indices."""

    diagnostics: list[Diagnostic] = field(default_factory=list)
    groups: Groups[Key] = field(default_factory=Groups)
    known: dict[Key, tuple[str, Span, Key]] = field(default_factory=dict)
    guesses: list[tuple[Key, str, set[str], Span]] = field(default_factory=list)  # implied by letters of laws
    told: set[Key] = field(default_factory=set)  # classes that met another domain: once is enough

    def learn(self, key: Key, domain: str, span: Span) -> None:
        """Record the domain of a port; `span` is the place that determines it."""
        root = self.groups.of(key)
        before = self.known.setdefault(root, (domain, span, key))
        if before[0] != domain and root not in self.told:
            self.told.add(root)
            self.diagnostics.append(
                DomainConflict(span, words_of(key), domain, words_of(before[2]), before[0], before[1])
            )

    def join(self, a: Key, b: Key, span: Span) -> None:
        """Record that two ports share a bond."""
        first, second = self.groups.of(a), self.groups.of(b)
        if first == second:
            return
        one, two = self.known.get(first), self.known.get(second)
        if one is not None and two is not None and one[0] != two[0]:
            if not self.told & {first, second}:
                self.diagnostics.append(DomainConflict(span, words_of(b), two[0], words_of(a), one[0], one[1]))
            self.told |= {first, second}
            return
        self.groups.join(second, first)
        if one is None and two is not None:
            self.known[first] = two

    def guess(self) -> None:
        """Set the domains that no declaration gives from the letters of laws. Letters of another domain are a conflict."""
        for key, domain, letters, span in self.guesses:
            known = self.known.get(self.groups.of(key))
            if known is None or not letters <= {*DOMAINS[known[0]].letters, *GENERIC}:
                self.learn(key, domain, span)

    def of(self, *key: str) -> Domain | None:
        """Domain of a port; None if it is undetermined."""
        found = self.known.get(self.groups.of(key))
        return None if found is None else DOMAINS[found[0]]

    def names_with(self, key: Key) -> list[str]:
        """Names of what has the domain of a port, in the order in which it occurs in the text."""
        root = self.groups.of(key)
        keys = (k for k in list(self.groups) if self.groups.of(k) == root and not k[0].startswith("@"))
        return list(dict.fromkeys(words_of(tuple(part for part in k if part not in ("1", "2"))) for k in keys))


def words_of(key: Key) -> str:
    """Name of a key as the author writes it."""
    return "a junction in place" if key[0].startswith("@") else ".".join(k for k in key if k)
