"""Bonds one by one, and reversed bonds: the arrow, the readings of the bond, and the sides of the elements that it passes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from ..graph.domains import DOMAINS
from ..semantics.names.declared_names import table_of
from ..semantics.names.domain_table import domain_table
from ..semantics.names.name_uses import READ_BY_LAWS
from ..semantics.names.port_domains import DomainTable
from ..semantics.names.scope import ModelDefinition
from ..source import Span
from ..syntax import tree
from ..syntax.blocks import Statements, flat, with_inner_blocks
from .printing import NOWHERE, expression, path, path_text, rewrite
from .renaming import as_file, has_branches, parsed

SOURCES = ("Se", "Sf", "MSe", "MSf")
TWO_SIDED = ("TF", "GY", "MTF", "MGY")
LETTERS = {(d.letters[i] or v): v for d in reversed(tuple(DOMAINS.values())) for i, v in ((0, "e"), (1, "f"))}
LETTERS |= {"e": "e", "f": "f"}


def changed_models(statements: Statements, change: Callable[[ModelDefinition], Statements]) -> Statements:
    """Each model of a text changed, with its names looked up."""
    file = as_file(statements)
    return tuple(
        replace(s, statements=change(file.models[s.name])) if isinstance(s, tree.ModelSyntax) else s
        for s in file.statements
    )


# ---------------------------------------------------------------- one by one


def exploded(statements: Statements) -> Statements:
    """Every bond a statement of its own, every junction with a name."""
    return changed_models(statements, lambda definition: _Exploding(definition).statements())


@dataclass(eq=False)
class _Exploding:
    definition: ModelDefinition
    count: int = 0

    def statements(self) -> Statements:
        return self._all(self.definition.model.statements, ())

    def _all(self, statements: Statements, rounds: tuple[str, ...]) -> Statements:
        result: list[tree.SyntaxNode] = []
        for statement in statements:
            if isinstance(statement, tree.LoopSyntax):
                inside = self._all(statement.statements, (*rounds, statement.name))
                result.append(replace(statement, statements=inside))
            elif isinstance(statement, tree.ConditionalSyntax):
                result.append(with_inner_blocks(statement, lambda block: self._all(block, rounds)))
            elif isinstance(statement, tree.Bonds):
                lines: list[str] = []
                places = (place for group in statement.places for place in group)
                if "=>" in statement.arrows and any(isinstance(place, tree.Nest) for place in places):
                    result.append(statement)  # a junction in place there is as wide as what it joins
                    continue
                groups = [[self._place(p, rounds, lines) for p in group] for group in statement.places]
                for arrow, first, second in zip(statement.arrows, groups, groups[1:], strict=False):
                    lines += [f"{tail} {arrow} {head}" for tail in first for head in second]
                result += inner_statements(lines)
            else:
                result.append(statement)
        return tuple(result)

    def _place(self, place: tree.PathSyntax | tree.Nest, rounds: tuple[str, ...], lines: list[str]) -> str:
        if isinstance(place, tree.PathSyntax):
            return path_text(place)
        self.count += 1
        name = f"junction_{self.count}" + (f"[{', '.join(rounds)}]" if rounds else "")
        lines.append(f"{place.kind} {name}")
        for member in place.members:
            inner = self._place(member, rounds, lines)
            entry = declaration_of(self.definition, member)
            from_source = entry is not None and entry.kind in SOURCES
            lines.append(f"{inner} -> {name}" if from_source else f"{name} -> {inner}")
        return name


def declaration_of(definition: ModelDefinition, place: tree.SyntaxNode | str) -> tree.Declaration | None:
    """Declaration of a name, or of what a path begins with; None for anything else."""
    word = place if isinstance(place, str) else getattr(place, "head", "")
    name = table_of(definition.model).get(word)
    return name.node if name is not None and isinstance(name.node, tree.Declaration) else None


def inner_statements(lines: list[str]) -> Statements:
    """Lines of a model as statements."""
    (model,) = parsed("model M {\n" + "\n".join(lines) + "\n}\n")
    assert isinstance(model, tree.ModelSyntax)
    return model.statements


# ---------------------------------------------------------------- turned around


def turned(statements: Statements) -> Statements:
    """Reverse every bond that can be: between junctions, at sources, through transformers and gyrators. Needs single bonds.

    Between junctions of one kind only the arrow turns: its effort (or flow) belongs to no other bond. Between a 0 and a 1, which give
    both, the reversed bond carries the opposite power, so one of the two must change its sign, by a transformer of -1.
    At a source, the variable that the junction shares stays and the other changes its sign, in the law and in all readings.
    """
    outside = Counter(_members(statements))
    statements = with_domains(statements)
    return changed_models(statements, lambda definition: _Turning(definition, outside).statements())


def with_domains(statements: Statements) -> Statements:
    """Every junction with its domain, as a bond that is cut no longer passes it on."""
    tables: dict[str, DomainTable] = {}

    def domains_of(definition: ModelDefinition) -> DomainTable:
        if definition.name not in tables:
            tables[definition.name] = domain_table(definition, domains_of)
        return tables[definition.name]

    def change(definition: ModelDefinition) -> Statements:
        table = domains_of(definition)

        def with_domain(node: object) -> Any:
            if isinstance(node, tree.Declaration) and node.kind in ("0", "1") and node.definition is None:
                domain = table.of(node.names[0].name, "")
                if domain is not None and not definition.model.plain:
                    return replace(node, definition=path(domain.name))
            return node

        return tuple(rewrite(s, with_domain) for s in definition.model.statements)

    return changed_models(statements, change)


def _members(node: object) -> Iterator[str]:
    """All names after a dot."""
    if isinstance(node, tree.Member):
        yield node.name
    elif isinstance(node, tuple):
        for item in node:
            yield from _members(item)
    elif is_dataclass(node) and not isinstance(node, Span):
        for f in fields(node):
            yield from _members(getattr(node, f.name))


@dataclass(eq=False)
class _Turning:
    definition: ModelDefinition
    members: Counter[str]
    uses: dict[str, list[tree.Bonds]] = field(default_factory=dict)
    signs: dict[str, dict[str, str]] = field(default_factory=dict)  # element -> its variable -> what it is now
    laws: dict[str, str] = field(default_factory=dict)  # element -> its new law
    turned: set[str] = field(default_factory=set)
    count: int = 0

    def statements(self) -> Statements:
        model = self.definition.model
        if has_branches(model):
            return model.statements
        for bond in (s for s in flat(model.statements) if isinstance(s, tree.Bonds) and _is_single(s)):
            for place in bond.places[0] + bond.places[1]:
                self.uses.setdefault(place.head, []).append(bond)  # type: ignore[union-attr]
        for name, bonds in self.uses.items():
            entry = declaration_of(self.definition, name)
            lone = entry is not None and len(entry.names) == 1 and not entry.names[0].components
            if lone and entry is not None and name not in self.members:
                if entry.kind in SOURCES and len(bonds) == 1:
                    self._source(name, entry, bonds[0])
                elif entry.kind in TWO_SIDED and len(bonds) == 2:
                    self._two_sided(name, entry, bonds)
        changed = self._all(model.statements, ())
        return tuple(s if isinstance(s, tree.Bonds) else self._readings(s) for s in changed)

    def _junction(self, place: tree.SyntaxNode) -> str | None:
        """The kind of the junction at a place, if it is one of this model's own."""
        entry = declaration_of(self.definition, place)
        if not isinstance(place, tree.PathSyntax) or entry is None:
            return None
        own = entry.kind in ("0", "1") and all(isinstance(s, tree.Index) for s in place.steps)
        return entry.kind if own else None

    # ------------------------------------------------------------ elements
    def _source(self, name: str, entry: tree.Declaration, bond: tree.Bonds) -> None:
        ((tail,), (head,)) = bond.places
        kind = self._junction(head if tail.head == name else tail)  # type: ignore[union-attr]
        law = entry.definition
        if kind is None or not isinstance(law, tree.LawSyntax):
            return
        flips = "e" if kind == "1" else "f"
        (equation,) = law.equations
        if ("e" if entry.kind.endswith("e") else "f") == flips:
            self.laws[name] = f"{expression(equation.left)} = -({expression(equation.right)})"
        self.signs[name] = {letter: f"-{letter}" for letter, v in LETTERS.items() if v == flips}
        self.turned.add(name)

    def _two_sided(self, name: str, entry: tree.Declaration, bonds: list[tree.Bonds]) -> None:
        into = next(b for b in bonds if b.places[1][0].head == name)  # type: ignore[union-attr]
        out = next(b for b in bonds if b.places[0][0].head == name)  # type: ignore[union-attr]
        kinds = {"1": self._junction(into.places[0][0]), "2": self._junction(out.places[1][0])}
        law = entry.definition
        if None in kinds.values() or not isinstance(law, tree.LawSyntax):
            return
        now = {}
        for side, other in (("1", "2"), ("2", "1")):
            flips = "e" if kinds[side] == "1" else "f"
            for letter, variable in LETTERS.items():
                now[letter + side] = ("-" if variable == flips else "") + letter + other
        (equation,) = law.equations
        both = [self._own(side, now) for side in (equation.left, equation.right)]
        self.laws[name] = f"{expression(both[0])} = {expression(both[1])}"
        self.signs[name] = now
        self.turned.add(name)

    def _own(self, node: object, now: dict[str, str]) -> Any:
        """The law of a transducer with its sides exchanged."""

        def change(part: object) -> Any:
            if isinstance(part, tree.PathSyntax) and not part.steps and part.head in now:
                name = table_of(self.definition.model).get(part.head)
                if name is not None and name.kind in READ_BY_LAWS:
                    return part
                return signed(replace(part, head=now[part.head].lstrip("-")), now[part.head])
            return part

        return rewrite(node, change)

    # ------------------------------------------------------------ statements
    def _all(self, statements: Statements, rounds: tuple[str, ...]) -> Statements:
        result: list[tree.SyntaxNode] = []
        for s in statements:
            if isinstance(s, tree.LoopSyntax):
                result.append(replace(s, statements=self._all(s.statements, (*rounds, s.name))))
            elif isinstance(s, tree.Bonds) and _is_single(s):
                result += inner_statements(self._bond(s, rounds))
            elif isinstance(s, tree.Declaration) and s.names[0].name in self.laws:
                (line,) = inner_statements([f"{s.kind} {s.names[0].name} : {self.laws[s.names[0].name]}"])
                assert isinstance(line, tree.Declaration)
                result.append(replace(s, definition=line.definition))
            else:
                result.append(s)
        return tuple(result)

    def _bond(self, bond: tree.Bonds, rounds: tuple[str, ...]) -> list[str]:
        ((tail,), (head,)) = bond.places
        assert isinstance(tail, tree.PathSyntax) and isinstance(head, tree.PathSyntax)
        first, second = self._junction(tail), self._junction(head)
        names = path_text(tail), path_text(head)
        arrow = bond.arrows[0]
        if {tail.head, head.head} & self.turned or (first is not None and first == second):
            return [f"{names[1]} {arrow} {names[0]}"]
        if first is None or second is None or arrow == "=>":
            return [f"{names[0]} {arrow} {names[1]}"]
        self.count += 1
        name = f"turned_{self.count}" + (f"[{', '.join(rounds)}]" if rounds else "")
        return [f"TF {name} : f1 = -f2", f"{names[1]} -> {name}", f"{name} -> {names[0]}"]

    def _readings(self, node: object) -> Any:
        def change(part: object) -> Any:
            if isinstance(part, tree.PathSyntax) and part.head in self.signs and part.steps:
                last = part.steps[-1]
                now = self.signs[part.head].get(last.name) if isinstance(last, tree.Member) else None
                if now is not None:
                    return signed(replace(part, steps=(*part.steps[:-1], tree.Member(now.lstrip("-")))), now)
            return part

        if isinstance(node, tree.LoopSyntax):
            return replace(node, statements=tuple(map(self._readings, node.statements)))
        return node if isinstance(node, tree.Bonds) else rewrite(node, change)


def _is_single(bond: tree.Bonds) -> bool:
    return [[type(place) for place in group] for group in bond.places] == [[tree.PathSyntax]] * 2


def signed(node: tree.PathSyntax, words: str) -> tree.ExpressionSyntax:
    """A reading, with the sign of its new word."""
    return tree.Negative(NOWHERE, 2, node) if words.startswith("-") else node
