"""Bonds: endpoints resolved, multibonds split, model ports and splitters passed through, directions checked."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import NamedTuple

from ...graph.domains import Domain, components_of, multibond_of
from ...graph.elements import ELEMENTS
from ...graph.network import Bond, BondEnd
from ...source import Span
from ...syntax import tree
from ..names.errors import AbsentName, DomainConflict, UnknownName, WrongConnection, WrongType
from ..names.scope import (
    Absent,
    Array,
    Broken,
    ElementEntry,
    Entry,
    InstanceEntry,
    PartEntry,
    Scope,
    WallEntry,
    indexed,
)
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from .elaborate import Elaborator


class Terminal(NamedTuple):
    """End of half a bond: a port of a node, or one side of a hole (model port or splitter)."""

    node: str
    port: str
    side: str  # "" for a node; "inside" or "outside" of a wall, "many" or "single" of a splitter
    domain: Domain


class DrawnBond(NamedTuple):
    """A bond as it is drawn, before model ports and splitters are passed through."""

    tail: Terminal
    head: Terminal
    span: Span


class Place(NamedTuple):
    """Endpoint of an arrow: terminals by component; `multi` is True for a multibond."""

    terminals: dict[str, Terminal]
    multi: bool
    kind: str
    written: tree.PathSyntax | tree.Nest
    ports: tuple[str, ...] = ()  # all ports of its node

    @property
    def words(self) -> str:
        """The endpoint as the author wrote it."""
        return self.written.words if isinstance(self.written, tree.PathSyntax) else f"{self.written.kind}(…)"

    @property
    def first(self) -> str:
        """The first bond of a multibond, as it is written."""
        component, terminal = next(iter(self.terminals.items()))
        steps = self.written.steps if isinstance(self.written, tree.PathSyntax) else ()
        named = not multibond_of(terminal.port) or any(isinstance(step, tree.Member) for step in steps)
        return _member(self.words, component if named else terminal.port)


class Connector:
    """Conversion of the bond statements of all instances to bonds between nodes."""

    def __init__(self, elaborator: Elaborator) -> None:
        self.elaborator = elaborator
        self.segments: list[DrawnBond] = []
        # junctions in place: name, kind, domain, scope, span, multibond junction that it is a part of
        self.anonymous: list[tuple[str, str, str, Scope, Span, str]] = []
        self.names: dict[str, int] = {}
        self.nests: dict[tuple[int, str, str], dict[str, Terminal]] = {}
        self.passed: dict[tuple[str, str], int] = {}  # port of a model and component -> the bond through it

    def connect(self) -> None:
        """Read every bond statement. Errors are collected in the elaborator."""
        before = len(self.elaborator.diagnostics)
        for scope, statement in self.elaborator.bonds:
            self.elaborator.guard(self._statement, scope, statement)
        if len(self.elaborator.diagnostics) > before:
            self.elaborator.structure_broken = True

    # ------------------------------------------------------------ one statement
    def _statement(self, scope: Scope, statement: tree.Bonds) -> None:
        for group in statement.places:
            for place in group:
                if isinstance(place, tree.Nest):
                    self.elaborator.guard(self._nest, scope, place)
        for arrow, first, second in zip(statement.arrows, statement.places, statement.places[1:], strict=False):
            if len(first) > 1 and len(second) > 1:
                hint = "Write one arrow for each pair: which goes to which is not guessed."
                raise Wrong(WrongConnection(statement.span, "An arrow from several places to several places", hint))
            for tail in first:
                for head in second:
                    self.elaborator.guard(self._arrow, scope, tail, head, arrow)

    def _arrow(
        self, scope: Scope, tail: tree.PathSyntax | tree.Nest, head: tree.PathSyntax | tree.Nest, arrow: str
    ) -> None:
        source, target = self._place(scope, tail, is_head=False), self._place(scope, head, is_head=True)
        span = head.span
        self._check_heat(source, target, tail.span, head.span)
        if source.kind in ELEMENTS and ELEMENTS[source.kind].receives:
            word = source.words
            hint = f"Power counts as positive into C, I and R: turn the arrow, `{target.words} {arrow} {word}`."
            if target.kind in ELEMENTS and ELEMENTS[target.kind].receives:
                both = f"({word}, {target.words})"
                hint = f"A chain of bonds ends there. What shares a flow stands at a 1-junction, `1{both}`, what shares an effort at a 0-junction, `0{both}`."
            elif {*source.terminals.values()} & {segment.head for segment in self.segments}:
                hint = f"A chain of bonds ends there. What lies between two places hangs on a 1-junction between them: `-> 1({word}) -> {target.words}`."
            raise Wrong(WrongConnection(tail.span, f"An arrow out of `{word}`", hint))
        multi = source.multi or target.multi
        if arrow == "->" and multi:
            word = source.words if source.multi else target.words
            hint = f"Use `=>` for all its ports, or name one: `{(source if source.multi else target).first}`."
            raise Wrong(WrongConnection(span, f"`{word}` is a multibond", hint))
        if arrow == "=>" and not (source.multi and target.multi):
            word = target.words if source.multi else source.words
            hint = "`=>` joins multibonds port by port; a single bond is `->`."
            raise Wrong(WrongConnection(span, f"`{word}` is not a multibond", hint))
        missing = source.terminals.keys() ^ target.terminals.keys()
        if missing:
            raise _different(source, target, span)
        for component, terminal in source.terminals.items():
            self.segments.append(DrawnBond(terminal, target.terminals[component], span))

    @staticmethod
    def _check_heat(source: Place, target: Place, tail: Span, head: Span) -> None:
        """Check the directions at an RS: power flows into all ports but the last, which gives off the heat."""
        for place, span, into in ((source, tail, False), (target, head, True)):
            if place.kind in ELEMENTS and ELEMENTS[place.kind].gives_heat:
                last = place.ports[-1]
                for terminal in place.terminals.values():
                    if (terminal.port == last) is into:
                        way = "out of" if into else "into"
                        hint = (
                            f"Power counts as positive into an RS, and out of its last port, `{last}`: turn the arrow."
                        )
                        raise Wrong(WrongConnection(span, f"The arrow at `{place.words}` should go {way} it", hint))

    def _nest(self, scope: Scope, nest: tree.Nest) -> None:
        place = self._place(scope, nest, is_head=True)
        for member in nest.members:
            if isinstance(member, tree.Nest):
                self._nest(scope, member)
            entry = None if isinstance(member, tree.Nest) else self._entry(scope, member)
            from_source = (
                isinstance(entry, ElementEntry) and entry.kind in ELEMENTS and bool(ELEMENTS[entry.kind].given)
            )
            other = self._place(scope, member, is_head=not from_source)
            if other.multi and not place.multi:
                hint = f"Name one of its ports: `{other.first}`."
                raise Wrong(WrongConnection(member.span, f"`{other.words}` is a multibond", hint))
            if place.terminals.keys() != other.terminals.keys():
                raise _different(place, other, member.span)
            for component, junction in place.terminals.items():
                terminal = other.terminals[component]
                tail, head = (terminal, junction) if from_source else (junction, terminal)
                self.segments.append(DrawnBond(tail, head, member.span))

    # ------------------------------------------------------------ places
    def _entry(self, scope: Scope, path: tree.PathSyntax) -> Entry:
        entry = scope.find(path.head)
        if entry is None:
            hint = suggestion(
                path.head, list(scope.names()), "Declare it first: `C name : law`, `1 name`, `ModelName name`."
            )
            raise Wrong(UnknownName(path.span, path.head, f"`{scope.definition.name}`", hint))
        return _present(entry, path, path.head)

    def _place(self, scope: Scope, place: tree.PathSyntax | tree.Nest, is_head: bool) -> Place:
        if isinstance(place, tree.Nest):
            return self._nest_place(scope, place)
        entry = self._entry(scope, place)
        steps = list(place.steps)
        first = True
        own_wall = _is_wall(entry)
        while steps:
            step = steps[0]
            if isinstance(step, tree.Index):
                if not isinstance(entry, Array):
                    name = place.head if first else place.words
                    raise Wrong(WrongType(place.span, f"No index after `{name}`", "one", "It is no array."))
                index = self.elaborator.index_of(step, scope)
                assert index is not None
                item = entry.at(index)
                if item is None:
                    hint = f"`{entry.name}` has the items {_some(entry)}."
                    raise Wrong(UnknownName(place.span, place.words, f"`{scope.definition.name}`", hint))
                entry = item
            elif isinstance(entry, InstanceEntry):
                entry = _wall_of(entry, step, place, first)
            elif isinstance(entry, Array) and isinstance(_one(entry), InstanceEntry):  # that port of each
                walls = {k: _wall_of(e, step, place, first) for k, e in entry.items.items()}
                entry = Array(f"{entry.name}.{step.name}", entry.span, walls)
            elif hasattr(entry, "parts"):
                inner_part = entry.parts.entries.get(step.name)
                if inner_part is None:
                    name = place.head if first else place.words
                    hint = suggestion(step.name, list(entry.parts.entries))
                    raise Wrong(UnknownName(place.span, step.name, f"the mechanism `{name}`", hint))
                entry = inner_part
            else:
                break
            entry = _present(entry, place, place.words)
            first = False
            steps.pop(0)
        component = None
        if steps:
            step = steps[0]
            if isinstance(entry, ElementEntry) and len(steps) > 1:  # one bond of a multibond of an element
                numbers = (self.elaborator.index_of(s, scope) if isinstance(s, tree.Index) else None for s in steps)
                words = (
                    f".{s.name}" if isinstance(s, tree.Member) else indexed("", n or ())
                    for s, n in zip(steps, numbers, strict=True)
                )
                return self._finish(entry, "".join(words)[1:], place, is_head, own_wall, scope)
            if len(steps) > 1 or isinstance(step, tree.Index):
                hint = "A bond reaches an element, a junction, or a port of one."
                raise Wrong(UnknownName(place.span, place.words, f"`{scope.definition.name}`", hint))
            component = step.name
        return self._finish(entry, component, place, is_head, own_wall, scope)

    def _finish(
        self, entry: Entry, component: str | None, place: tree.PathSyntax, is_head: bool, own_wall: bool, scope: Scope
    ) -> Place:
        match entry:
            case ElementEntry() if "1" in entry.ports and entry.kind in ELEMENTS and ELEMENTS[entry.kind].sides:
                side = "1" if is_head else "2"
                if component:
                    hint = "An arrow into a transducer reaches side 1, an arrow out of it leaves side 2."
                    raise Wrong(UnknownName(place.span, component, f"`{entry.name}`", hint))
                return Place({"": Terminal(entry.name, side, "", entry.ports[side])}, False, entry.kind, place)
            case ElementEntry():
                side = "" if entry.kind != "splitter" else ("single" if component is not None else "many")
                return self._ports(entry.name, entry.ports, component, side, entry.kind, place)
            case WallEntry():
                side = "inside" if own_wall else "outside"
                return self._ports(entry.name, entry.ports, component, side, "wall", place)
            case PartEntry():
                if entry.kind == "weld" or not entry.ports:
                    what = f"`{place.words}` has no freedom, so no bond can reach it"
                    hint = "A bond moves a joint with a freedom, or a body."
                    raise Wrong(WrongConnection(place.span, what, hint))
                prefixed = self._ports(entry.mechanism, entry.ports, component, "", "part", place)
                terminals = {c: t._replace(port=f"{entry.name}.{t.port}") for c, t in prefixed.terminals.items()}
                if len(entry.ports) == 1:
                    (terminal,) = terminals.values()
                    return Place({"": terminal}, False, "part", place)
                return prefixed._replace(terminals=terminals)
            case InstanceEntry():
                walls = _walls(entry)
                what = f"`{place.words}` is an instance of `{entry.scope.definition.name}`"
                hint = f"Name its port: {', '.join(f'`{place.words}.{w}`' for w in walls) or 'it has none'}."
                raise Wrong(WrongConnection(place.span, what, hint))
            case Array():  # a multibond of all its items
                parts = {k: self._finish(e, component, place, is_head, own_wall, scope) for k, e in entry.items.items()}
                ends = ((indexed("", k), c, t) for k, part in parts.items() for c, t in part.terminals.items())
                # the bonds of a port `p: electric[2]` of items are numbered as those of a junction `j[i] : electric[2]`
                terminals = {f"{k[:-1]}, {c[1:]}" if c[:1] == "[" else _member(k, c): t for k, c, t in ends}
                return next(iter(parts.values()))._replace(terminals=terminals, multi=True)
        if getattr(entry, "state", "") == "broken":
            raise AlreadyTold
        hint = "Bonds join elements, junctions, ports and the parts of mechanisms."
        raise Wrong(WrongConnection(place.span, f"`{place.words}` is no place for a bond", hint))

    def _ports(
        self,
        node: str,
        ports: Mapping[str, Domain],
        component: str | None,
        side: str,
        kind: str,
        place: tree.PathSyntax,
    ) -> Place:
        every = tuple(ports)
        wholes = {multibond_of(port) for port in every}
        whole = next(iter(wholes)) if component is None and len(wholes) == 1 else component  # its only port
        if group := components_of(every, whole or ""):
            terminals = {name: Terminal(node, port, side, ports[port]) for name, port in group.items()}
            return Place(terminals, True, kind, place, every)
        if component is not None:
            if component not in ports or component == "":
                names = [n for n in every if n]
                shown = ", ".join(names[:6]) + "…" * (len(names) > 6)
                hint = suggestion(component, names, f"Its ports: {shown or 'it has one, without a name'}.")
                raise Wrong(UnknownName(place.span, component, f"the ports of `{node}`", hint))
            return Place({"": Terminal(node, component, side, ports[component])}, False, kind, place, every)
        terminals = {name: Terminal(node, name, side, domain) for name, domain in ports.items()}
        return Place(terminals, every != ("",), kind, place, every)

    def _nest_place(self, scope: Scope, nest: tree.Nest) -> Place:
        key = (nest.span.start, scope.path, scope.suffix)
        if key not in self.nests:
            first, position = nest.members[0], len(self.anonymous)  # before those in it
            label = first.words if isinstance(first, tree.PathSyntax) else "…"
            name = scope.full(f"{nest.kind}({label})")
            self.names[name] = self.names.get(name, 0) + 1
            if self.names[name] > 1:
                name += f"#{self.names[name]}"
            components = self._place(scope, first, is_head=True).terminals
            self.nests[key] = terminals = {}
            junctions = []
            for component in components:
                key_of_port = (f"@{nest.span.start}", component.rpartition("]")[2].lstrip("."))
                domain = self.elaborator.domain_of(scope, key_of_port)
                if domain is None:
                    del self.nests[key]
                    raise self.elaborator.unknown_domain(scope, nest.span, key_of_port)
                whole = _member(name, component)
                terminals[component] = Terminal(whole, "", "", domain)
                bundle = name if component else ""
                junctions.append((whole, nest.kind, domain.name, scope, nest.span, bundle))
            self.anonymous[position:position] = junctions
        return Place(self.nests[key], "" not in self.nests[key], nest.kind, nest)

    # ------------------------------------------------------------ walls
    def bonds(self, numbers: dict[tuple[str, str], BondEnd]) -> list[Bond]:
        """Return the bonds between nodes, with model ports passed through. `numbers` maps a node's name and port to its end."""
        holes: dict[tuple[str, str], dict[str, list[DrawnBond]]] = defaultdict(lambda: defaultdict(list))
        for segment in self.segments:
            for terminal in (segment.tail, segment.head):
                if terminal.side:
                    holes[terminal.node, terminal.port][terminal.side].append(segment)
        for (node, port), sides in holes.items() if not self.elaborator.structure_broken else ():
            self._check_hole(f"{node}.{port}" if port else node, sides)
        result: list[Bond] = []
        for segment in self.segments:
            if not segment.tail.side:  # every chain begins at a node, if its arrows agree
                chain = self._follow(segment, holes)
                bond = None if chain is None else self._bond(segment, chain[-1], numbers)
                if chain is not None and bond is not None:
                    self.passed.update({(s.head.node, s.head.port): len(result) for s in chain[:-1]})
                    result.append(bond)
        return result

    def _check_hole(self, name: str, sides: dict[str, list[DrawnBond]]) -> None:
        for side, segments in sides.items():
            if len(segments) > 1:
                hint = "A port passes one bond on each side; put a junction there for more."
                what, other = f"Two bonds on one side of `{name}`", (segments[0].span, "the other one")
                self.elaborator.tell(WrongConnection(segments[1].span, what, hint, (other,)))
            if side in ("inside", "outside") and len(sides) < 2 and not self.elaborator.part:
                where = "inside its model" if side == "outside" else "outside"
                unit = side == "inside" and "." not in name
                opened = (
                    f", and one of a unit for other tools is opened: `compile --port {name}=effort`" if unit else ""
                )
                hint = f"Connect it on both sides; a port that is not needed is left out{opened}."
                inner = segments[0].span
                place = self.elaborator.stands.get(name.rpartition(".")[0]) if side == "inside" else None
                others = () if place is None else ((inner, "what waits for it inside"),)
                what = f"The port `{name}` is not connected {where}"
                self.elaborator.tell(WrongConnection(place or inner, what, hint, others))
            if side in ("single", "many") and len(sides) < 2:
                hint = "A splitter passes every bond through: `name =>` on one side, `name.x` on the other."
                what = f"The splitter's port `{name}` is connected on one side only"
                self.elaborator.tell(WrongConnection(segments[0].span, what, hint))
        if len(sides) == 2 and all(len(s) == 1 for s in sides.values()):
            # the arrow outside comes last: it may be turned
            (first,), (second,) = (sides[side] for side in sorted(sides))
            arrives = [s for s in (first, second) if s.head.side and _name(s.head) == name]
            if len(arrives) != 1:
                how = "head-on" if len(arrives) == 2 else "tail to tail"
                what, other = f"Two arrows meet {how} in `{name}`", (first.span, "the other arrow")
                hint = "The arrows on both sides of a port must agree: turn one of them, or join two such ports by a junction, `0 node`, an arrow for each."
                self.elaborator.tell(WrongConnection(second.span, what, hint, (other,)))

    def _follow(
        self, segment: DrawnBond, holes: dict[tuple[str, str], dict[str, list[DrawnBond]]]
    ) -> list[DrawnBond] | None:  # fmt: skip
        """Return the segments of one bond, starting at its node."""
        chain = [segment]
        for _ in range(len(self.segments) + 1):
            head = chain[-1].head
            if not head.side:
                return chain
            onward = [s for side, all_ in holes[head.node, head.port].items() if side != head.side for s in all_]
            onward = [s for s in onward if s.tail.side and s.tail.node == head.node and s.tail.port == head.port]
            if len(onward) != 1:
                return None  # reported by _check_hole, or an open port of a part
            chain.append(onward[0])
        return None

    def _bond(self, first: DrawnBond, last: DrawnBond, numbers: dict[tuple[str, str], BondEnd]) -> Bond | None:
        tail, head = first.tail, last.head
        if tail.domain != head.domain:
            if not any(isinstance(d, DomainConflict) for d in self.elaborator.diagnostics):
                self.elaborator.tell(
                    DomainConflict(last.span, _name(head), head.domain.name, _name(tail), tail.domain.name, first.span)
                )
            return None
        ends = numbers.get((tail.node, tail.port)), numbers.get((head.node, head.port))
        if ends[0] is None or ends[1] is None:
            return None  # the node has an error, which is already reported
        return Bond(ends[0], ends[1], tail.domain.name, last.span)


def _present(entry: Entry, path: tree.PathSyntax, name: str) -> Entry:
    """Return an entry. Raises `Wrong` for one in a branch that is not taken, and `AlreadyTold` for one with an error."""
    if isinstance(entry, Absent):
        raise Wrong(AbsentName(path.span, name, entry.branch, entry.span))
    if isinstance(entry, Broken):
        raise AlreadyTold
    return entry


def _is_wall(entry: Entry) -> bool:
    """Return True for a port of a model or an array of such ports."""
    first = _one(entry) if isinstance(entry, Array) else entry
    return isinstance(first, WallEntry)


def _wall_of(entry: Entry, step: tree.Member, place: tree.PathSyntax, first: bool) -> Entry:
    """Return the port of an instance that a step names. Raises `Wrong`."""
    assert isinstance(entry, InstanceEntry)
    inner, name = entry.scope.entries.get(step.name), place.head if first else place.words
    if isinstance(inner, Broken | Absent):
        _present(inner, place, f"{place.head}.{step.name}" if first else place.words)
    if inner is None or not _is_wall(inner):
        walls = _walls(entry)
        known = (
            f"Its ports: {', '.join(walls) or 'none'}. Bonds reach the inside of an instance only through its ports."
        )
        hint = suggestion(step.name, [w.partition("[")[0] for w in walls], known)
        raise Wrong(UnknownName(place.span, step.name, f"the ports of `{name}`", hint))
    return inner


def _member(name: str, component: str) -> str:
    """Return the name of one bond of a multibond: `body.x`, `body[2]`."""
    return name + ("." if component and component[0] != "[" else "") + component


def _different(first: Place, second: Place, span: Span) -> Wrong:
    """Error for two multibonds that do not fit."""
    sizes = [f"`{p.words}` ({', '.join(list(p.terminals)[:6])}{'…' * (len(p.terminals) > 6)})" for p in (first, second)]
    hint, widths = "`=>` joins ports of equal names.", {len(first.terminals), len(second.terminals)}
    if all(c.startswith("[") for c in (*first.terminals, *second.terminals)) and len(widths) > 1:
        hint = f"One has {len(first.terminals)} bonds, the other {len(second.terminals)}: both need one width, or a transformer between them."
    return Wrong(WrongConnection(span, f"The multibonds {sizes[0]} and {sizes[1]} have different ports", hint))


def _one(array: Array) -> Entry:
    return next(iter(array.items.values()))


def _walls(instance: InstanceEntry) -> list[str]:
    """Ports of an instance, by the names in its model. One item stands for all items of an array."""
    names = []
    for name, entry in instance.scope.entries.items():
        if _is_wall(entry):
            item = f"[{', '.join(map(str, min(entry.items)))}]" if isinstance(entry, Array) else ""
            names.append(f"{name}{item}")
    return names


def _name(terminal: Terminal) -> str:
    return f"{terminal.node}.{terminal.port}" if terminal.port else terminal.node


def _some(array: Array) -> str:
    keys = sorted(array.items)
    shown = [", ".join(map(str, k)) for k in keys]
    return ", ".join(shown[:6]) + ("…" if len(shown) > 6 else "")
