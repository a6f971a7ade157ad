"""Names after a point: variables of elements, their ports, and parts of mechanisms."""

from __future__ import annotations

from dataclasses import replace

from ...graph.domains import DOMAINS, GENERIC, Domain, components_of
from ...graph.elements import ELEMENTS
from ...graph.mechanism import domain_of
from ...graph.network import Quantity, Reading
from ...source import Span
from ...syntax import tree
from .domain_table import paths_of
from .errors import UnknownName, WrongIndex, WrongType
from .part_kinds import noun_of
from .scope import Array, ElementEntry, Entry, GroupEntry, InstanceEntry, Items, PartEntry, Scalar, WallEntry
from .statement_errors import Wrong, suggestion


def element_member(entry: ElementEntry, name: str, path: tree.PathSyntax) -> Scalar | Items | Array | ElementEntry:
    """`spring.x`: a variable of an element, or the stored quantity of its port of that name."""
    row = ELEMENTS.get(entry.kind)  # None: a junction
    stored = row.stored if row is not None and len(row.stored) == 1 else ""
    if "1" in entry.ports:
        letter, side = name[:-1], name[-1:]
        domain = entry.ports.get(side)
        variable = domain.variable(letter) if domain else None
        if domain is None or variable not in ("e", "f"):
            hint = "A transducer has efforts and flows with the number of the side: `e1`, `f2`."
            raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", hint))
        return _read(entry.name, side, domain, variable, f"{entry.name}.{name}")
    if "" not in entry.ports:
        name = entry.group + name
        if group := components_of(entry.ports, name):
            if "[1]" not in group:
                return replace(entry, group=f"{name}.")
            bonds = (element_member(entry, port, path) for port in group.values())
            return Array(f"{entry.name}.{name}", path.span, {(n,): r for n, r in enumerate(bonds, 1)})
        if row is None and name in entry.ports and entry.kind != "splitter":  # one of the junctions of a multibond
            return replace(entry, name=f"{entry.name}.{name}", ports={"": entry.ports[name]})
        letter = name.removeprefix(entry.group)
        allowed = stored + ("ef" if row is not None else {"0": "e", "1": "f"}.get(entry.kind, ""))
        ports = {p: d for p, d in entry.ports.items() if p.startswith(entry.group)}
        if row is not None and row.gives_heat and not entry.group:
            ports.popitem()  # as in its law
        variables = {d.variable(letter) or "" for d in ports.values()}
        if (
            name not in entry.ports and len(variables) == 1 and (letter := variables.pop()) and letter in allowed
        ):  # of all its bonds
            ends = ((entry.name, p) if row is not None else (f"{entry.name}.{p}", "") for p in ports)
            readings = [_read(*end, d, letter, path.words) for end, d in zip(ends, ports.values(), strict=True)]
            return Items(path.words, tuple(readings))
        if name not in entry.ports:
            hint = suggestion(name, list(entry.ports), f"Its ports: {', '.join(entry.ports)}.")
            raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", hint))
        variable = stored or "e"
        role = "reading" if stored else "port"
        return _read(entry.name, name, entry.ports[name], variable, f"{entry.name}.{name}", role)
    domain = entry.ports[""]
    variable = domain.variable(name)
    if row is not None and variable is not None and variable in row.remembered and _in_law(entry, variable):
        full = f"{entry.name}.{domain.letter(variable)}"
        return Scalar(Quantity(full), domain.dimension(variable), "signal", f"{entry.name}.{name}")
    allowed = row.readable if row is not None else {"0": "e", "1": "f"}.get(entry.kind, "ef")
    if variable is None or variable not in allowed:
        hint = "It has " + ", ".join(domain.letter(v) for v in allowed) + "."
        if entry.kind in "01" and variable is not None:
            hint += " The bonds of a junction share only that; integrate with a C, or read an element on it."
        raise Wrong(UnknownName(path.span, name, f"`{entry.name}`", hint))
    return _read(entry.name, "", domain, variable, f"{entry.name}.{name}")


def _read(node: str, port: str, domain: Domain, variable: str, name: str, role: str = "reading") -> Scalar:
    """A variable of a port of a node, under the name by which the author reads it."""
    return Scalar(Reading(node, port, variable), domain.dimension(variable), role, name)


def _in_law(entry: ElementEntry, variable: str) -> bool:
    """Return True if the law of a one-port reads one of its own variables."""
    law, words = entry.declaration.definition, {variable, entry.ports[""].letter(variable)}
    return law is not None and any(path.words in words for path in paths_of(law))


def part_member(part: PartEntry, name: str, path: tree.PathSyntax) -> Scalar | GroupEntry:
    """`arm.pin.phi`: a coordinate of a body, joint or frame; its reaction or attitude as a whole.

    A joint with one degree of freedom also has its rate and effort.
    """
    if name in part.groups:
        return GroupEntry(part, name)
    full = f"{part.mechanism}.{part.name}.{name}"
    if name in part.ports:
        return _read(part.mechanism, f"{part.name}.{name}", part.ports[name], "q", full)
    if len(part.ports) == 1:
        ((port, domain),) = part.ports.items()
        variable = domain.variable(name)
        if variable in ("e", "f", "q"):
            return _read(part.mechanism, f"{part.name}.{port}", domain, variable, full)
    known = [*part.ports, *part.groups]
    if name == "reaction":
        hint = (
            f"A {noun_of(part.kind)} holds nothing, so it has no reaction; what acts on it is read as {_efforts(part)}."
        )
    elif name == "attitude" and part.kind != "body":
        hint = "The attitude is a body's, in space."
    else:
        listed = ", ".join(known) or "no freedom"
        rates = [f"`{port}.{domain.letter('f')}`" for port, domain in part.ports.items()][
            :: max(1, len(part.ports) - 1)
        ]
        hint = suggestion(
            name, known, f"It has {listed}" + (f"; rates are read as {', '.join(rates)}." if rates else ".")
        )
    raise Wrong(UnknownName(path.span, name, f"`{part.mechanism}.{part.name}`", hint))


def _efforts(part: PartEntry) -> str:
    """The first and last effort of a part."""
    found = [f"`{port}.{domain.letter('e')}`" for port, domain in part.ports.items()]
    return ", ".join(dict.fromkeys((found[0], found[-1])))


def group_member(group: GroupEntry, name: str, path: tree.PathSyntax) -> Scalar:
    """`pin.reaction.x`, `top.attitude.w`."""
    components = group.part.groups[group.name]
    if name not in components:
        hint = suggestion(name, list(components), f"It has {', '.join(components)}.")
        where = f"`{group.part.mechanism}.{group.part.name}.{group.name}`"
        raise Wrong(UnknownName(path.span, name, where, hint))
    return group_members(group)[components.index(name)]


def group_members(group: GroupEntry) -> tuple[Scalar, ...]:
    """All components of a group: the efforts of a reaction, or the quaternion of an attitude."""
    variable = "e" if group.name == "reaction" else "q"
    found = []
    for component in group.part.groups[group.name]:
        port = f"{group.part.name}.{group.name}.{component}"
        mechanism = group.part.mechanism
        found.append(_read(mechanism, port, DOMAINS[domain_of(port)], variable, f"{mechanism}.{port}"))
    return tuple(found)


def wall_member(entry: WallEntry, name: str, path: tree.PathSyntax) -> Scalar:
    """`film.b.S_dot`: effort or flow of the bond that passes through a port of a model; of a multibond its component first."""
    if "" in entry.ports:
        return wall_variable(entry, "", name, path)
    domain = entry.ports.get(name)
    if domain is None:
        hint = suggestion(name, list(entry.ports), f"Its components: {', '.join(entry.ports)}.")
        raise Wrong(UnknownName(path.span, name, f"the port `{entry.name}`", hint))
    return _read(entry.name, name, domain, "e", f"{entry.name}.{name}", "port")


def wall_variable(entry: WallEntry, component: str, letter: str, path: tree.PathSyntax) -> Scalar:
    """`ends.phi.M`: effort or flow of the whole bond at a model port, the same from inside and outside."""
    domain, name = entry.ports[component], f"{entry.name}.{component}".rstrip(".")
    variable = domain.variable(letter)
    if variable not in ("e", "f"):
        hint = f"It has {domain.letter('e')}, {domain.letter('f')}: a port stores nothing."
        raise Wrong(UnknownName(path.span, letter, f"the port `{name}`", hint))
    return _read(entry.name, component, domain, variable, f"{name}.{letter}")


def port_variable(node: str, port: str, domain: Domain, letter: str, path: tree.PathSyntax) -> Scalar:
    """`plates.q.u`: a variable of one port of a node."""
    variable = domain.variable(letter)
    if variable is None:
        hint = "It has " + ", ".join(domain.letter(v) for v in GENERIC[:3]) + "."
        raise Wrong(UnknownName(path.span, letter, f"`{node}.{port}`", hint))
    return _read(node, port, domain, variable, f"{node}.{port}.{letter}")


def not_a_number(entry: Entry, path: tree.PathSyntax) -> Wrong:
    """Error for a name that denotes no number; its advice lists the names that could be read instead."""
    name = path.words
    what, hint = f"`{name}`, which is none", "Read one of its variables: `.x`, `.phi`, `.x.v`."
    match entry:
        case ElementEntry(kind=kind, ports=ports, group=group):
            port, domain = next((p, d) for p, d in ports.items() if p.startswith(group))
            name = f"{name}.{port.removeprefix(group)}" if group else name
            letters = ", ".join(f"`{name}.{domain.letter(v)}`" for v in {"0": "e", "1": "f"}.get(kind, "ef"))
            what, hint = f"the element `{name}`", f"Read one of its variables: {letters}."
        case WallEntry(ports=ports):
            component, domain = next(iter(ports.items()))
            full = f"{name}.{component}".rstrip(".")
            letters = f"`{full}.{domain.letter('e')}`, `{full}.{domain.letter('f')}`"
            what, hint = f"the port `{name}`", f"Read its effort or flow: {letters}."
        case InstanceEntry(word="set", scope=scope):
            what, hint = f"the set `{name}`", f"Read one of its members: `{name}.{next(iter(scope.entries), 'E')}`."
        case InstanceEntry(scope=scope):
            roles = [
                s for s in scope.definition.model.statements if isinstance(s, tree.Quantities) and s.role == "output"
            ]
            outputs = ", ".join([f"`{name}.{item.name}`" for s in roles for item in s.items][:5]) or "an output"
            what, hint = f"the instance `{name}`", f"Read something in it: {outputs}, or the variable of an element."
        case GroupEntry(part=part, name=group):
            first, last = part.groups[group][0], part.groups[group][-1]
            what, hint = f"the {group} of `{part.name}`", f"Read one of its components: `{name}.{first}` to `.{last}`."
    return Wrong(WrongType(path.span, "A number", what, hint))


def list_item(entry: Items, index: tuple[int, ...], name: str, span: Span) -> Scalar | Items:
    """Item of a list, entry or row of a matrix. Raises `Wrong`."""
    count, columns = len(entry.items), entry.columns
    size = (count // columns, columns) if columns else (count,)
    if len(index) > len(size) or not all(1 <= i <= most for i, most in zip(index, size, strict=False)):
        hint = f"Its items are 1 to {count}."
        if columns:
            hint = f"It has {size[0]} rows and {columns} columns: `{name}[1, 1]` to `{name}[{size[0]}, {columns}]`."
        raise Wrong(WrongIndex(span, name, ", ".join(map(str, index)), hint))
    if not columns:
        return entry.items[index[0] - 1]
    row = entry.items[(index[0] - 1) * columns : index[0] * columns]
    return row[index[1] - 1] if len(index) > 1 else Items(name, row)
