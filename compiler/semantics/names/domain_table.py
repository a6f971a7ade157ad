"""Domains spread along bonds, once per model definition: from declared ports, junctions and the letters of laws."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ...graph.domains import BUNDLES, COMPONENT_DOMAINS, DOMAINS, GENERIC, components_of
from ...graph.elements import ELEMENTS
from ...graph.mechanism import domain_of, freedoms_of
from ...source import Span
from ...syntax import tree
from ...syntax.blocks import flat, nodes_in
from .errors import UnknownName, WrongType
from .port_domains import DomainTable, Key
from .scope import ModelDefinition
from .statement_errors import no_law, suggestion

ELEMENT_KINDS = (*ELEMENTS, "0", "1", "splitter")


def domain_table(definition: ModelDefinition, table_of: Callable[[ModelDefinition], DomainTable]) -> DomainTable:
    """Spread the domains of one definition; `table_of` gives those of the models it uses."""
    return _Spreading(definition, table_of).table


class _Spreading:
    """Domains given by the declarations of one definition, then spread along its bonds."""

    def __init__(self, definition: ModelDefinition, table_of: Callable[[ModelDefinition], DomainTable]) -> None:
        self.table, self.table_of = DomainTable(), table_of
        self.file = definition.file
        self.kinds: dict[str, list[tree.Declaration]] = {}  # several in the branches of an `if`
        self.walls: dict[str, tree.PortItem] = {}
        model = definition.model
        self.slots = slot_defaults(model.statements)
        self.mechanisms = {m.name: _parts(m) for m in flat(model.statements) if isinstance(m, tree.MechanismSyntax)}
        names = set(_names(model.statements)) | set(definition.file.constants)
        told: Told = {}
        for statement in flat(model.statements):
            if isinstance(statement, tree.Declaration):
                for name in {d.name for d in statement.names}:
                    self.kinds.setdefault(name, []).append(statement)
                if statement.kind in ELEMENT_KINDS and not model.plain:
                    _learn_from_declaration(self.table, statement, names, told)
            elif isinstance(statement, tree.PortsSyntax):
                for item in statement.items:
                    self._wall(item)
        for statement in flat(model.statements):
            if isinstance(statement, tree.Bonds) and not model.plain:
                self._bonds(statement)
        self.table.guess()

    def _wall(self, item: tree.PortItem) -> None:
        """A port of the model itself."""
        self.walls[item.name] = item
        for component, domain in wall_components(item).items():
            if domain is not None:
                _learn(self.table, (item.name, component), domain, item.span, tuple(BUNDLES))

    def _bonds(self, statement: tree.Bonds) -> None:
        for group in statement.places:
            for place in group:
                self._nested(place)
        for first, second in zip(statement.places, statement.places[1:], strict=False):
            for tail in first:
                for head in second:
                    self._connect(self._ends(tail, False), self._ends(head, True), head.span)

    def _nested(self, place: tree.PathSyntax | tree.Nest) -> None:
        if isinstance(place, tree.Nest):
            for member in place.members:
                self._connect(self._ends(place, False), self._ends(member, True), member.span)
                self._nested(member)

    def _connect(self, tails: dict[str, Key], heads: dict[str, Key], span: Span) -> None:
        for component in tails.keys() & heads.keys():
            self.table.join(tails[component], heads[component], span)

    def _ends(self, place: tree.PathSyntax | tree.Nest, is_head: bool) -> dict[str, Key]:
        """Map from component to the key of the port that a bond reaches at a place."""
        if isinstance(place, tree.Nest):  # as wide as its members
            components = self._ends(place.members[0], True) or {"": ()}
            return {component: (f"@{place.span.start}", component) for component in components}
        members = [s.name for s in place.steps if isinstance(s, tree.Member)]
        if place.head in self.mechanisms:
            return _mechanism_ends(self.table, self.mechanisms[place.head], place, members)
        if place.head in self.walls:
            wanted = members[:1] or list(wall_components(self.walls[place.head]))
            return {("" if members else c): (place.head, c) for c in wanted}
        ends = (self._ends_of(d, place, members, is_head) for d in self.kinds.get(place.head, ()))
        return {component: key for keys in ends for component, key in keys.items()}

    def _ends_of(
        self, declaration: tree.Declaration, place: tree.PathSyntax, members: list[str], is_head: bool
    ) -> dict[str, Key]:
        """The same map for an element or an instance."""
        if is_two_sided(declaration):
            return {"": (place.head, "1" if is_head else "2")}
        if declaration.kind in ELEMENT_KINDS:
            ports = element_ports(declaration, place.head)
            whole = members[0] if len(members) == 1 else "" if members else lone_multibond(declaration, place.head)
            if group := components_of(ports, whole):
                return {component: (place.head, port) for component, port in group.items()}
            if members or whole:
                return {"": (place.head, ".".join(members[:2]) or whole)}
            return {port: (place.head, port) for port in ports}
        return self._ends_of_instance(place, declaration.kind, members)

    def _ends_of_instance(self, place: tree.PathSyntax, kind: str, members: list[str]) -> dict[str, Key]:
        """The same map for a port of an instance; the domain table of its model gives the domains."""
        inner = self.file.models.get(self.slots.get(kind, kind))
        if inner is None or not members:
            return {}
        item = next((i for i in wall_items(inner.model) if i.name == members[0]), None)
        if item is None:
            return {}
        inner_table = self.table_of(inner)
        result: dict[str, Key] = {}
        for component in members[1:2] or list(wall_components(item)):
            key = (place.head, members[0], component)
            domain = inner_table.of(members[0], component)
            if domain is not None:
                self.table.learn(key, domain.name, place.span)
            result["" if members[1:] else component] = key
        return result


def is_slot(item: tree.Item, word: str = "model") -> bool:
    """Return True if a parameter stands for a model; for a set of parameters with the word `parameters`."""
    return item.unit is not None and [name for name, _, _ in item.unit.factors] == [word]


def slot_defaults(statements: tuple[tree.SyntaxNode, ...]) -> dict[str, str]:
    """Default models of a model's slots, by slot name."""
    items = (i for s in flat(statements) if isinstance(s, tree.Quantities) for i in s.items if is_slot(i))
    return {i.name: i.value.words for i in items if isinstance(i.value, tree.PathSyntax)}


def wall_items(model: tree.ModelSyntax) -> Iterator[tree.PortItem]:
    """Declared ports of a model. Ports in loops occur once."""
    for statement in flat(model.statements):
        if isinstance(statement, tree.PortsSyntax):
            yield from statement.items


def wall_components(item: tree.PortItem) -> dict[str, str | None]:
    """The scalar ports of a port of a model, with their declared domains."""
    if item.domain is not None and item.domain in BUNDLES:
        return dict(BUNDLES[item.domain])
    if item.components:
        return {c.name: c.domain or COMPONENT_DOMAINS.get(c.name) for c in item.components}
    return {"": item.domain}


def is_two_sided(declaration: tree.Declaration) -> bool:
    """Return True for a transducer with sides 1 and 2; one that lists its ports has those instead."""
    row = ELEMENTS.get(declaration.kind)
    return row is not None and row.sides and not any(d.components for d in declaration.names)


def element_ports(declaration: tree.Declaration, name: str) -> tuple[str, ...]:
    """The names of an element's scalar ports; that of a port of a width, `p: translation[n]`, once."""
    if is_two_sided(declaration):
        return ("1", "2")
    declared = next(d for d in declaration.names if d.name == name)
    return tuple(port for port, _ in _components(declaration, declared)) or ("",)


def _components(declaration: tree.Declaration, declared: tree.Declared) -> Iterator[tuple[str, str | None]]:
    """The ports that an element lists, with their declared domains; of a multibond `a: planar` they are `a.x`, `a.y`, `a.phi`, of a junction `x`, …."""
    definition = declaration.definition
    if declaration.kind in ("0", "1") and isinstance(definition, tree.PathSyntax):
        yield from BUNDLES.get(definition.head, {}).items()
    for component in declared.components:
        bundle = BUNDLES.get(component.domain or "") if declaration.kind in ELEMENTS else None
        if bundle is None:
            yield component.name, component.domain
        else:
            yield from ((f"{component.name}.{name}", domain) for name, domain in bundle.items())


def lone_multibond(declaration: tree.Declaration, name: str) -> str:
    """The one port of an element if it is a multibond, which the element's name then stands for; else nothing."""
    declared = next(d for d in declaration.names if d.name == name)
    if len(declared.components) != 1 or declaration.kind not in ELEMENTS:
        return ""
    (component,) = declared.components
    return component.name if component.width is not None or component.domain in BUNDLES else ""


def junction_width(declaration: tree.Declaration) -> tree.Index | None:
    """The width of a junction, `1 body : translation[n]`."""
    definition = declaration.definition
    if declaration.kind not in ("0", "1") or not isinstance(definition, tree.PathSyntax) or len(definition.steps) != 1:
        return None
    return definition.steps[0] if isinstance(definition.steps[0], tree.Index) else None


def _names(statements: tuple[tree.SyntaxNode, ...]) -> Iterator[str]:
    for statement in flat(statements):
        if isinstance(statement, tree.Quantities) and statement.role != "output":
            yield from (i.name for i in statement.items)
        elif isinstance(statement, tree.LoopSyntax):
            yield statement.name


def _parts(mechanism: tree.MechanismSyntax) -> dict[str, tuple[str, ...]]:
    """The ports of a mechanism's parts."""
    parts = {}
    for statement in flat(mechanism.statements):
        if isinstance(statement, tree.Declaration):
            ports = freedoms_of(statement.kind, mechanism.space != "spatial")
            parts.update({d.name: ports for d in statement.names})
    return parts


def _mechanism_ends(
    table: DomainTable, parts: dict[str, tuple[str, ...]], place: tree.PathSyntax, members: list[str]
) -> dict[str, Key]:
    if not members:
        return {}
    freedoms = parts.get(members[0], ())
    wanted = members[1:2] or list(freedoms)
    result: dict[str, Key] = {}
    for component in wanted:
        if component not in freedoms:
            continue
        key = (place.head, members[0], component)
        table.learn(key, domain_of(f"{members[0]}.{component}"), place.span)
        result["" if members[1:] or len(freedoms) == 1 else component] = key
    return result


# Cache for the laws of one model: (words of the law, two-sided, port) -> letters used there, and the domain that they imply.
Told = dict[tuple[str, bool, str], tuple[set[str], str | None]]


def _learn(table: DomainTable, key: Key, domain: str, span: Span, bundles: tuple[str, ...] = ()) -> None:
    """Record the declared domain of a port; one that does not exist is an error."""
    if domain in DOMAINS:
        table.learn(key, domain, span)
        return
    known = [*DOMAINS, *bundles]
    hint = suggestion(domain, known, f"Domains: {', '.join(known)}.")
    if domain.replace("_", "").lower() in ("threephase", "abc"):
        hint = "Three phases are a bond of width three, `electric[3]`."
    if domain in BUNDLES and not bundles:
        hint = f"Its ports are listed one by one: `({', '.join(BUNDLES[domain])})`."
    table.diagnostics.append(UnknownName(span, domain, "the list of domains", hint))


def _learn_from_declaration(table: DomainTable, declaration: tree.Declaration, names: set[str], told: Told) -> None:
    definition = declaration.definition
    for declared in declaration.names:
        for port, domain in _components(declaration, declared):
            domain = domain or (COMPONENT_DOMAINS.get(port) if declaration.kind == "splitter" else None)
            if domain is not None:
                listed = (c.span for c in declared.components if c.name == port.split(".")[0])
                bundles = tuple(BUNDLES) if declaration.kind in ELEMENTS else ()
                _learn(table, (declared.name, port), domain, next(listed, declared.span), bundles)
        is_value = declaration.kind in ELEMENTS and isinstance(definition, tree.PathSyntax) and definition.head in names
        if (
            isinstance(definition, tree.PathSyntax)
            and not is_value
            and (not definition.steps or junction_width(declaration) is not None)
        ):
            bundles = tuple(BUNDLES) if declaration.kind in ("0", "1") else ()
            for port in element_ports(declaration, declared.name) if definition.head not in bundles else ():
                _learn(table, (declared.name, port), definition.head, definition.span, bundles)
        elif isinstance(definition, tree.ExpressionSyntax) and declaration.kind in ELEMENTS:
            table.diagnostics.append(no_law(declaration, declared.name))
        elif isinstance(definition, tree.ExpressionSyntax):
            hint = f"As in `{declaration.kind} {declared.name} : translation`."
            table.diagnostics.append(WrongType(definition.span, "A domain", f"`{definition.span.words}`", hint))
        elif isinstance(definition, tree.LawSyntax):
            for port in element_ports(declaration, declared.name):
                words = definition.span.text, is_two_sided(declaration), port
                if words not in told:
                    told[words] = _told_by(_letters(definition, declaration, port, names))
                letters, domain = told[words]
                if domain is not None:
                    table.guesses.append(((declared.name, port), domain, letters, definition.span))


def _told_by(letters: set[str]) -> tuple[set[str], str | None]:
    """The one domain that has all these letters; None if several have them, or none."""
    fitting = [
        d for d in DOMAINS.values() if d.typed and d.guessed and letters and all(w in d.letters or w in GENERIC for w in letters)
    ]  # fmt: skip
    return letters, fitting[0].name if len(fitting) == 1 else None


_LETTERS = frozenset(letter for d in DOMAINS.values() for letter in d.letters if letter) - set(GENERIC)


def _letters(law: tree.LawSyntax, declaration: tree.Declaration, port: str, names: set[str]) -> set[str]:
    """The specific letters that a law uses for one port."""
    found: set[str] = set()
    two_sided = is_two_sided(declaration)
    for path in paths_of(law):
        if two_sided:
            if not path.steps and path.head[-1:] == port:
                found.add(path.head[:-1])
        elif port:
            if path.head == port and len(path.steps) == 1 and isinstance(path.steps[0], tree.Member):
                found.add(path.steps[0].name)
            elif not path.steps and path.head not in names and not _is_port(declaration, path.head):
                found.add(path.head)  # the variable of all ports
        elif not path.steps and path.head not in names:
            found.add(path.head)
    return found & _LETTERS


def _is_port(declaration: tree.Declaration, name: str) -> bool:
    return any(c.name == name for d in declaration.names for c in d.components)


def paths_of(node: tree.SyntaxNode) -> Iterator[tree.PathSyntax]:
    """All paths that are read in an expression or law."""
    return (item for item in nodes_in(node) if isinstance(item, tree.PathSyntax))
