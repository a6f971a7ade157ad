"""Declarations of names in scopes: single names, indexed names, quantities, slots and the rounds of loops."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ...errors import CompilationFailed
from ...graph.domains import DOMAINS, Domain
from ...graph.network import Requirement
from ...graph.units import ONE
from ...scene import Override
from ...source import Span
from ...syntax import tree
from ...syntax.blocks import flat
from ..names.domain_table import domain_table, is_slot, wall_components, wall_items
from ..names.errors import DuplicateName, ReservedName, TooMany, UnknownDomain, UnknownKind, WrongConnection, WrongType
from ..names.port_domains import DomainTable, words_of
from ..names.scope import (
    RESERVED,
    Array,
    Broken,
    DeclaredPart,
    Entry,
    ModelDefinition,
    Pending,
    Scalar,
    Scope,
    SlotEntry,
    indexed,
)
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from .elaboration_cache import ElaborationCache
from .parameter_sets import WORD, ParameterSets

BYTES = 17_000  # memory of one part of flat text from text to result, as `tests/benchmarks/results/large_model_stages.md` has it; of an array half


class Declarations(ParameterSets):
    """Names of one model's instances, entered one by one and counted."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        super().__init__(overrides, part, known)
        # mechanism -> its parts, whose attributes are read later
        self.mechanism_parts: dict[str, list[DeclaredPart]] = {}
        self.limits: list[Requirement] = []  # those of joints
        self.count = 0
        self.most = known.most_parts
        self.progress: tuple[int, float] | None = None  # parts before the outermost loop; the share of it that is done
        self.structure_broken = False  # then missing connections would be reported for the wrong reason
        self._tables = known.tables

    def table_of(self, definition: ModelDefinition) -> DomainTable:
        """Domain table of a definition, computed once."""
        key = id(definition)
        if key not in self._tables:
            self._tables[key] = DomainTable()  # seen by a model that contains itself; the cycle is reported elsewhere
            self._tables[key] = domain_table(definition, self.table_of)
            self.diagnostics += self._tables[key].diagnostics
        return self._tables[key]

    def counted(self, span: Span, more: int = 1) -> None:
        """Count one more instance, element, junction, quantity or round, up to the limit."""
        self.count += more
        if self.count > self.most:
            before, done = self.progress or (0, 0.0)  # if the outermost loop goes on as it began
            parts = int(float(f"{before + (self.count - before) / done:.2g}")) if done else self.count
            what = "Instances, elements, junctions, quantities and rounds"
            raise CompilationFailed([*self.diagnostics, TooMany(span, what, self.most, _advice(parts, done > 0.0))])

    def domain_of(self, scope: Scope, key: tuple[str, ...]) -> Domain | None:
        if scope.plain:
            return DOMAINS["untyped"]
        return self.table_of(scope.definition).of(*key)

    def unknown_domain(self, scope: Scope, span: Span, key: tuple[str, ...], alone: bool = False) -> Exception:
        """Error for a port of unknown domain, one for all that is bonded. If it, or the domains of its model, have errors, these are already reported.

        `alone`: it is one element or junction, so that where no other name has its domain, no bond reaches it.
        """
        table = self.table_of(scope.definition)
        if table.diagnostics or (root := table.groups.of(key)) in table.told:
            return AlreadyTold()
        table.told.add(root)
        names = table.names_with(key) or [words_of(key)]
        shown = [f"`{name}`" for name in names[:5]] + [f"{len(names) - 5} more"] * (len(names) > 5)
        junctions = (
            s for s in flat(scope.definition.model.statements) if isinstance(s, tree.Declaration) and s.kind in "01"
        )
        junction = next((f"{j.kind} {d.name} : translation" for j in junctions for d in j.names if d.name in names), "")
        listed = f"{key[0]}({key[1]}: translation)" if key[1] and key[1] not in "12" else "1 body : translation"
        words = " and ".join(filter(None, (", ".join(shown[:-1]), shown[-1])))
        loose = alone and len(names) == 1
        return Wrong(
            UnknownDomain(span, words, junction or listed, "No bond reaches it: connect it. " if loose else "")
        )

    def enter(self, scope: Scope, name: str, entry: Entry, span: Span) -> None:
        """Enter a name in a scope. If it is declared twice, the later declaration in the text is the error."""
        if name in RESERVED:
            raise Wrong(ReservedName(span, name))
        if scope.vacant(name):
            scope.entries[name] = entry
            return
        before = scope.entries[name]
        first = before.item.span if isinstance(before, Pending) else getattr(before, "span", span)
        if isinstance(before, Broken):
            raise AlreadyTold
        if first.source is span.source and first.start > span.start:  # quantities are entered before elements
            scope.entries[name] = entry
            self.tell(DuplicateName(first, name, span))
            return
        if isinstance(entry, Pending) and entry.role == "output" and entry.value is None:
            hint = f"An experiment reads it as it is, `report {name}`; an output has a name of its own, `output {name}_out = {name}`."
            raise Wrong(DuplicateName(span, name, first, hint))
        raise Wrong(DuplicateName(span, name, first))

    def widths(self, width: tree.Index | None, scope: Scope, name: str) -> Sequence[tuple[int, ...]]:
        """Numbers of the bonds of a multibond of a width, each as the last index of its name; without a width there is one bond, which has none."""
        if width is None:
            return ((),)
        count = self.integer(width.items[0], scope)
        if count < 1 or len(width.items) > 1:
            words = ", ".join(item.span.words for item in width.items)
            hint = "`translation[3]` are three bonds; parts without any stand in an `if`."
            raise Wrong(WrongType(width.items[0].span, f"A width of 1 or more for `{name}`", f"[{words}]", hint))
        self.counted(width.items[0].span, count)
        return [(number,) for number in range(1, count + 1)]

    def enter_indexed(self, scope: Scope, name: str, index: tuple[int, ...] | None, entry: Entry, span: Span) -> None:
        if index is None:
            self.enter(scope, name, entry, span)
            return
        home = scope.base()
        array = home.entries.get(name)
        if isinstance(array, Broken):
            raise AlreadyTold
        if home.vacant(name):
            array = Array(name, span)
            self.enter(home, name, array, span)
        if not isinstance(array, Array) or index in array.items:
            first = array.item.span if isinstance(array, Pending) else getattr(array, "span", span)
            raise Wrong(DuplicateName(span, indexed(name, index), first))
        array.items[index] = entry

    def declare_quantities(
        self, scope: Scope, statement: tree.Quantities, bindings: Mapping[str, tuple[tree.Attribute, Scope]]
    ) -> None:
        first = len(self.pending)
        for item in statement.items:
            before = len(self.diagnostics)
            self.guard(self._declare_quantity, scope, statement.role, item, bindings)
            if len(self.diagnostics) > before and scope.vacant(item.name):
                scope.entries[item.name] = Broken(item.span)
        if statement.equations:
            self.solves.append((scope, statement, tuple(self.pending[first:])))

    def _declare_quantity(
        self, scope: Scope, role: str, item: tree.Item, bindings: Mapping[str, tuple[tree.Attribute, Scope]]
    ) -> None:
        if role == "parameter" and is_slot(item):
            self._declare_slot(scope, item, bindings)
            return
        if role == "parameter" and is_slot(item, WORD):
            self.enter(scope, item.name, self.stand_for_set(scope, item, dict(bindings)), item.span)
            return
        self.counted(item.span)
        index = self.index_of(item.index, scope)
        value, where, is_default = item.value, scope, True
        if item.name in bindings and role in ("parameter", "input") and index is None:
            value, where, is_default = bindings[item.name][0].value, bindings[item.name][1], False
        local = indexed(item.name, index) if index is not None else item.name + scope.suffix
        pending = Pending(item, role, scope.full(local), value, where, scope, is_default)
        self.enter_indexed(scope, item.name, index, pending, item.span)
        self.pending.append(pending)

    def _declare_slot(
        self, scope: Scope, item: tree.Item, bindings: Mapping[str, tuple[tree.Attribute, Scope]]
    ) -> None:
        """Declare a slot, `parameter Joint: model = Flexure`: a kind that an instance or a setting may replace by another model."""
        default = self._model_of(item.value, scope, item.span)
        found, span = default, item.span
        override = self.overrides.get(scope.full(item.name))
        if override is not None:
            self.used_overrides.add(override.path)
            value = None if isinstance(override.value, float) else override.value
            found, span = self._model_of(value, scope, override.span), override.span
        elif item.name in bindings:
            attribute, where = bindings[item.name]
            found, span = self._model_of(attribute.value, where, attribute.span), attribute.span
        wanted, given = self._walls(default), self._walls(found)
        if wanted != given:
            what = f"`{found.name}` cannot stand for `{default.name}`: its ports are {_listed(given)}, not {_listed(wanted)}"
            raise Wrong(WrongConnection(span, what, "A model in a slot has ports of the same names and domains."))
        self.enter(scope, item.name, SlotEntry(found, item.span), item.span)

    def _model_of(self, value: tree.ExpressionSyntax | None, scope: Scope, span: Span) -> ModelDefinition:
        """Return the model that the value of a slot names."""
        name = value.words if isinstance(value, tree.PathSyntax) else ""
        entry = scope.find(name)
        if isinstance(entry, SlotEntry):
            return entry.definition
        definition = scope.definition.file.models.get(name)
        if definition is None:
            hint = suggestion(
                name, list(scope.definition.file.models), "A slot names a model: `parameter Joint: model = Flexure`."
            )
            raise Wrong(UnknownKind(span if value is None else value.span, name or "this", hint))
        return definition

    def _walls(self, definition: ModelDefinition) -> dict[str, str]:
        """Ports of a model, by name, with the names of their domains."""
        table = self.table_of(definition)
        walls = {}
        for item in wall_items(definition.model):
            name = item.name if item.index is None and item.width is None else f"{item.name}[…]"
            for component in wall_components(item):
                domain = table.of(item.name, component)
                walls[f"{name}.{component}".rstrip(".")] = domain.name if domain else "unknown"
        return walls

    def rounds(self, loop: tree.LoopSyntax, scope: Scope) -> range:
        """The numbers that a loop runs over."""
        if loop.name in RESERVED:
            raise Wrong(ReservedName(loop.span, loop.name))
        first, last = self.integer(loop.range.first, scope), self.integer(loop.range.last, scope)
        self.counted(loop.range.span, max(0, last - first + 1))
        return range(first, last + 1)

    @staticmethod
    def round_scope(scope: Scope, name: str, number: int) -> Scope:
        inner = Scope(scope.definition, scope.path, f"{scope.suffix}[{number}]", scope)
        inner.entries[name] = Scalar(float(number), ONE, "index", name)
        return inner


def _advice(parts: int, foreseen: bool) -> str:
    """Say what so many parts cost, and how they are allowed."""
    return (
        f"The limit protects against files that never end. This model has {'about' if foreseen else 'at least'} {parts} of them, "
        f"which take some {max(1, round(parts * BYTES / 1e6))} MB of memory. "
        f"Where that is meant, set BONDGRAPH_PARTS={10 ** len(str(parts))} in the environment."
    )


def _listed(walls: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {domain}" for name, domain in walls.items()) or "none"
