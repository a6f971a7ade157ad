"""Sets of parameters: `parameters Silicon { E = 130 GPa }`, handed over to instances as one, or read by name."""

from __future__ import annotations

from collections.abc import Iterable

from ...scene import Override
from ...source import Span
from ...syntax import tree
from ...syntax.blocks import flat
from ..names.domain_table import paths_of
from ..names.errors import AbsentName, DimensionMismatch, DuplicateName, ReservedName, UnknownName, WrongSet
from ..names.scope import (
    RESERVED,
    Absent,
    Broken,
    Entry,
    InstanceEntry,
    ModelDefinition,
    Pending,
    Scalar,
    Scope,
    SetDefinition,
)
from ..names.statement_errors import AlreadyTold, Wrong, describe, suggestion
from .elaboration_cache import ElaborationCache
from .quantities import QuantityResolver

Bindings = dict[str, tuple[tree.Attribute, Scope]]
WORD = "parameters"  # the attribute by which sets are handed over, and the unit of a parameter that stands for one


class ParameterSets(QuantityResolver):
    """Sets of parameters as scopes of constants, each made once."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        super().__init__(overrides, part, known)
        self._sets: dict[int, InstanceEntry] = {}

    def set_of(self, definition: SetDefinition) -> InstanceEntry:
        """A set as what its name denotes: a scope with constants."""
        if id(definition) not in self._sets:
            syntax = definition.syntax
            model = tree.ModelSyntax(syntax.span, syntax.name, syntax.span, False, ())
            scope = Scope(ModelDefinition(model, definition.file), f"{syntax.name}.")
            self._sets[id(definition)] = InstanceEntry(syntax.name, scope, syntax.span, "set")
            for item in syntax.items:
                self.guard(self._enter_member, scope, item)
        return self._sets[id(definition)]

    def set_scopes(self) -> list[Scope]:
        return [entry.scope for entry in self._sets.values()]

    def _enter_member(self, scope: Scope, item: tree.Item) -> None:
        if item.name in RESERVED:
            raise Wrong(ReservedName(item.span, item.name))
        before = scope.entries.get(item.name)
        if isinstance(before, Pending):
            raise Wrong(DuplicateName(item.span, item.name, before.item.span))
        if item.index is not None or item.choices or item.value is None:
            hint = "A set holds values: `E = 130 GPa`, `gap: um = 2`, `shape = (1, 2)`."
            raise Wrong(WrongSet(item.span, f"`{item.name}` has no value, or an index or words instead", hint))
        scope.entries[item.name] = Pending(item, "constant", scope.full(item.name), item.value, scope, scope, True)

    def check_sets(self, definitions: Iterable[SetDefinition]) -> None:
        """Resolve the members of sets. Errors are collected."""
        for definition in definitions:
            for entry in self.set_of(definition).scope.entries.values():
                if isinstance(entry, Pending) and not self._is_word(entry):
                    self.guard(self.quantity, entry)

    def _is_word(self, entry: Pending) -> bool:
        """Return True for a lone name that the file does not define: the word of a choice, or a model, of an instance."""
        value = entry.value
        if not isinstance(value, tree.PathSyntax) or value.steps:
            return False
        return (entry.scope.find(value.head) or self.file_entry(value.head, entry.scope)) is None

    def file_entry(self, name: str, scope: Scope) -> Entry | None:
        definition = scope.definition.file.sets.get(name)
        return super().file_entry(name, scope) if definition is None else self.set_of(definition)

    def set_named(self, value: tree.ExpressionSyntax | None, scope: Scope, span: Span) -> InstanceEntry:
        """The set that an expression names, directly or by a parameter that stands for one. Raises `Wrong`."""
        words = value.words if isinstance(value, tree.PathSyntax) else ""
        entry = scope.find(words) or self.file_entry(words, scope)
        if isinstance(entry, InstanceEntry) and entry.word == "set":
            return entry
        if isinstance(entry, Absent):
            raise Wrong(AbsentName(span, words, entry.branch, entry.span))
        file = scope.definition.file
        if isinstance(entry, Broken) or words in file.missing:
            raise AlreadyTold
        what = "the sets of parameters of the file"
        hint = suggestion(
            words, file.sets, "A set is defined or imported in the file: `parameters Silicon { E = 130 GPa }`."
        )
        raise Wrong(UnknownName(span if value is None else value.span, words or "this", what, hint))

    def stand_for_set(self, scope: Scope, item: tree.Item, bindings: Bindings) -> InstanceEntry:
        """The set of `parameter material: parameters = Silicon`: the default, or one with the same members that is set instead."""
        default = self.set_named(item.value, scope, item.span)
        chosen, span = default, item.span
        override = self.overrides.get(scope.full(item.name))
        if override is not None:
            self.used_overrides.add(override.path)
            value = None if isinstance(override.value, float) else override.value
            chosen, span = self.set_named(value, self.root, override.span), override.span
        elif item.name in bindings:
            attribute, where = bindings[item.name]
            chosen, span = self.set_named(attribute.value, where, attribute.span), attribute.span
        for name, wanted in default.scope.entries.items() if chosen is not default else ():
            self._check_member(name, wanted, chosen, default, span)
        return InstanceEntry(scope.full(item.name), chosen.scope, item.span, "set")

    def _check_member(
        self, name: str, wanted: Entry, chosen: InstanceEntry, default: InstanceEntry, span: Span
    ) -> None:
        """Raise `Wrong` unless a set has a member as the default has it: what reads it is compiled once for all instances."""
        member = chosen.scope.entries.get(name)
        if not isinstance(member, Pending) or not isinstance(wanted, Pending):
            what = f"`{chosen.name}` has no `{name}`, which `{default.name}` has"
            raise Wrong(WrongSet(span, what, "A set that stands for another has all its members."))
        first, second = self.quantity(wanted), self.quantity(member)
        one, other = (x.items[0] if not isinstance(x, Scalar) else x for x in (first, second))
        if type(first) is not type(second) or one.truth != other.truth:
            what = f"`{name}` of `{chosen.name}` is not what it is in `{default.name}`: a number, a list or a truth"
            raise Wrong(WrongSet(member.item.span, what, "Members of one name are of one kind."))
        if one.dimension is not None and other.dimension is not None and one.dimension != other.dimension:
            what = f"`{name}` is {describe(one.dimension)} in `{default.name}`, but {describe(other.dimension)} in `{chosen.name}`"
            raise Wrong(DimensionMismatch(member.item.span, what, "Members of one name have one unit."))

    def hand_over(
        self, attribute: tree.Attribute, definition: ModelDefinition, bindings: Bindings, scope: Scope
    ) -> None:
        """Bind the parameters of an instance that are members of sets, and are not set singly. Raises `Wrong`."""
        settable = [
            item.name
            for statement in flat(definition.model.statements)
            if isinstance(statement, tree.Quantities) and statement.role in ("parameter", "input")
            for item in statement.items
        ]
        value, singly = attribute.value, set(bindings)
        for named in value.items if isinstance(value, tree.VectorSyntax) else (value,):
            chosen = self.set_named(named, scope, attribute.span)
            members = {n: e.item for n, e in chosen.scope.entries.items() if isinstance(e, Pending)}
            if members and not members.keys() & set(settable):
                what = f"`{definition.name}` has no parameter that `{chosen.name}` gives"
                hint = f"Its parameters and inputs: {', '.join(settable) or 'none'}; the set has {', '.join(members)}."
                raise Wrong(WrongSet(named.span, what, hint))
            _check_set_singly(named.span, chosen.name, members, singly, settable)
            for name, item in members.items():
                if name in settable and name in bindings and name not in singly:
                    hint = f"Set it in the instance: `{name} = …`."
                    raise Wrong(WrongSet(named.span, f"Two sets give `{name}`", hint))
                if name in settable and name not in singly:
                    plain = item.value is not None and item.unit is None
                    path = tree.PathSyntax(item.span, 1, name, ())
                    bound = item.value if plain and item.value is not None else path
                    bindings[name] = (tree.Attribute(item.span, name, None, bound), chosen.scope)
            for name in members.keys() - set(settable):
                self._check_near(name, members[name], chosen.name, [n for n in settable if n not in bindings])

    def _check_near(self, name: str, item: tree.Item, set_name: str, left: list[str]) -> None:
        """Report a member that a model does not have, if a parameter of it has nearly that name and is not set."""
        near = [n for n in left if n.casefold() == name.casefold() or suggestion(name, [n])]
        if near:
            what = f"`{set_name}` gives `{name}`, which is no parameter of the instance, but `{near[0]}` is"
            self.tell(WrongSet(item.span, what, f"Rename one of the two, or set `{near[0]}` in the instance."))


def _check_set_singly(
    span: Span, set_name: str, members: dict[str, tree.Item], singly: set[str], settable: list[str]
) -> None:
    """Raise `Wrong` if a member that is handed over follows from one that is set singly: its value would be that of the set."""
    for name in [n for n in members if n in settable and n not in singly]:
        read, waiting = set[str](), [name]
        while waiting:
            value = members[waiting.pop()].value
            new = {p.head for p in paths_of(value) if p.head in members} - read if value is not None else set()
            read |= new
            waiting += new
        if changed := sorted(read & singly):
            what = f"`{name}` of `{set_name}` follows from `{changed[0]}`, which is set here"
            hint = f"Set `{name}` here too, or define a set with another `{changed[0]}`."
            raise Wrong(WrongSet(span, what, hint))
