"""Walls put up and taken down: an element behind a port, an instance opened by hand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from compiler.graph.domains import DOMAINS
from compiler.graph.network import BondGraph
from compiler.metamorphosis.bonds import inner_statements
from compiler.metamorphosis.printing import path, path_text, rewrite, statement, unit
from compiler.metamorphosis.renaming import NamedText, as_file, in_other_words, parsed
from compiler.semantics.names.declared_names import DeclaredName, table_of
from compiler.semantics.names.domain_table import ELEMENT_KINDS, slot_defaults
from compiler.semantics.names.name_uses import name_uses
from compiler.semantics.names.scope import STATIC_ROLES, ModelDefinition
from compiler.syntax import tree
from compiler.syntax.blocks import Statements

ONE_PORTS = ("Se", "Sf", "MSe", "MSf", "C", "I", "R", "MR")


# ---------------------------------------------------------------- single elements


def walled(statements: Statements, model: str, graph: BondGraph) -> tuple[Statements, dict[str, str]]:
    """One-ports of the model, each in a model of its own behind a port; and how their states are called. Needs single bonds."""
    file = as_file(statements)
    definition = file.models[model]
    walls: dict[str, Statements] = {}
    for s in definition.model.statements:
        if isinstance(s, tree.Declaration) and s.kind in ONE_PORTS and not s.names[0].components:
            for declared in s.names:
                wall = _wall(replace(s, names=(declared,)), definition, graph)
                if wall is not None and declared.index is None:
                    walls[declared.name] = wall
    result: list[tree.SyntaxNode] = []
    for s in file.statements:
        if isinstance(s, tree.ModelSyntax) and s.name == model:
            result += [m for m, *_ in walls.values()]
            result.append(replace(s, statements=tuple(_use_walls(s.statements, walls))))
        else:
            result.append(s)
    words = {f"{name}.{v}": f"{name}.inside.{v}" for name in walls for v in _letters(graph, name)}
    return tuple(result), words


def _letters(graph: BondGraph, name: str) -> list[str]:
    node = next(n for n in graph.nodes if n.name == name)
    domain = DOMAINS[node.ports[0].domain]  # type: ignore[union-attr]
    return [domain.letter(v) for v in "efqp"]


def _wall(element: tree.Declaration, definition: ModelDefinition, graph: BondGraph) -> Statements | None:
    """The model around an element and its instance; None where something that its law reads has no unit that is known here."""
    name = element.names[0].name
    node = next((n for n in graph.nodes if n.name == name), None)
    if node is None or not isinstance(element.definition, tree.LawSyntax):
        return None
    plain, names = definition.model.plain, table_of(definition.model)
    domain = DOMAINS[node.ports[0].domain]  # type: ignore[union-attr]
    given: dict[str, tuple[str, str, str]] = {}  # words -> name inside, role, unit
    own = {letter for v in "efqp" for letter in (v, domain.letter(v))}

    def change(part: Any) -> Any:
        name = names.get(part.head) if isinstance(part, tree.PathSyntax) else None
        if name is None:
            return part
        numbers = ("parameter", "constant", "input", "signal", "mode")
        if part.head in own and not part.steps and name.kind not in numbers:
            return part
        words = path_text(part)
        if words not in given:
            given[words] = (f"given_{len(given)}", *_known(words, graph))
        return path(given[words][0])

    law = rewrite(element.definition, change)
    attributes = tuple(
        a if a.name in ("prefer", "require") else replace(a, value=rewrite(a.value, change)) for a in element.attributes
    )
    if any(not role for _, role, _ in given.values()):
        return None
    kind = f"Wall_{name}"
    inside = replace(element, names=(replace(element.names[0], name="inside"),), definition=law, attributes=attributes)
    lines = [f"  {role} {word}" + ("" if plain else f": {shown}") for word, role, shown in given.values()]
    lines += ["  port terminal" + ("" if plain else f": {domain.name}"), statement(inside, "  ")]
    lines.append("  inside -> terminal" if _gives(name, definition) else "  terminal -> inside")
    variables = {"C": "efq", "I": "efp"}.get(element.kind, "ef")
    lines += [f"  output {w} = inside.{w}" for w in dict.fromkeys(x for v in variables for x in (v, domain.letter(v)))]
    (model,) = parsed(f"{'plain ' * plain}model {kind} {{\n" + "\n".join(lines) + "\n}\n")
    bindings = ", ".join(f"{word} = {words}" for words, (word, _, _) in given.items())
    (instance,) = inner_statements([f"{kind} {name}" + (f" {{ {bindings} }}" if bindings else "")])
    return (model, instance)


def _known(words: str, graph: BondGraph) -> tuple[str, str]:
    """Role inside a wall and unit of something that a law reads."""
    named = graph.quantities.get(words.replace(" ", ""))
    if named is not None:
        return "parameter" if named.role in STATIC_ROLES else "input", named.unit
    head, _, letter = words.rpartition(".")
    node = next((n for n in graph.nodes if n.name == head), None)
    if node is None:
        return "", ""
    domain = DOMAINS[getattr(node, "domain", "") or node.ports[0].domain]  # type: ignore[union-attr]
    variable = domain.variable(letter)
    return ("", "") if variable is None else ("input", str(domain.dimension(variable)))


def _gives(name: str, definition: ModelDefinition) -> bool:
    """Return True if the arrow goes out of an element."""
    bonds = (s for s in definition.model.statements if isinstance(s, tree.Bonds))
    return any(isinstance(p, tree.PathSyntax) and p.head == name for b in bonds for p in b.places[0])


def _use_walls(statements: Statements, walls: dict[str, Statements]) -> Iterator[tree.SyntaxNode]:
    def reach(place: Any) -> Any:
        return path(f"{place.head}.terminal") if place.head in walls and not place.steps else place

    for s in statements:
        if isinstance(s, tree.Declaration):
            kept = tuple(d for d in s.names if d.name not in walls)
            yield from (walls[d.name][1] for d in s.names if d.name in walls)
            if kept:
                yield replace(s, names=kept)
        elif isinstance(s, tree.Bonds):
            yield replace(s, places=tuple(tuple(map(reach, group)) for group in s.places))
        elif isinstance(s, tree.LoopSyntax):
            inside = tuple(_use_walls(s.statements, walls))
            yield replace(s, statements=inside)
        else:
            yield s


# ---------------------------------------------------------------- instances opened


def opened(statements: Statements, model: str, graph: BondGraph) -> tuple[Statements, dict[str, str]]:
    """Instances of the model (no arrays) opened by hand: their statements with longer names; and these. Needs single bonds."""
    words: dict[str, str] = {}
    count = 0
    while True:
        file = as_file(statements)
        definition = file.models[model]
        done = next(
            (r for s in definition.model.statements if (r := _open(s, file, definition, graph, count)) is not None),
            None,
        )
        if done is None:
            return statements, words
        name, inside = done
        words[name] = f"opened_{count}_"
        statements = tuple(
            replace(s, statements=inside) if isinstance(s, tree.ModelSyntax) and s.name == model else s
            for s in file.statements
        )
        count += 1


def _open(
    node: Any, file: NamedText, definition: ModelDefinition, graph: BondGraph, count: int
) -> tuple[str, Statements] | None:
    """The statements of the model with this instance opened, if it can be."""
    if not isinstance(node, tree.Declaration) or node.kind in ELEMENT_KINDS or len(node.names) > 1:
        return None
    inner, name = file.models.get(node.kind), node.names[0].name
    if inner is None or node.names[0].index is not None or slot_defaults(inner.model.statements):
        return None
    prefix = f"opened_{count}_"
    ports = {i.name for s in inner.model.statements if isinstance(s, tree.PortsSyntax) for i in s.items}

    def choose(name: DeclaredName) -> str:
        return prefix + name.name if name.owner == (inner.name,) else name.name

    bound = {a.name: a.value for a in node.attributes}
    text = in_other_words(file.file.source.text, name_uses(file.file, (inner.model,)), choose)
    inside = next(s.statements for s in parsed(text) if isinstance(s, tree.ModelSyntax) and s.name == inner.name)

    def keep(statements: Statements) -> Iterator[tree.SyntaxNode]:
        for s in statements:
            if isinstance(s, tree.Quantities):
                items = tuple(_opened_item(i, s.role, i.name.removeprefix(prefix), bound, name, graph) for i in s.items)
                changed = replace(s, items=items, role={"output": "signal"}.get(s.role, s.role))
                yield from _opened_inputs(s, items, prefix, bound) if s.role == "input" else [changed]
            elif isinstance(s, tree.LoopSyntax):
                yield replace(s, statements=tuple(keep(s.statements)))
            elif not isinstance(s, tree.PortsSyntax | tree.Experiment | tree.Description):
                yield s

    def change(part: Any) -> Any:
        if (
            isinstance(part, tree.PathSyntax)
            and part.head == name
            and part.steps
            and isinstance(part.steps[0], tree.Member)
        ):
            return replace(part, head=prefix + part.steps[0].name, steps=part.steps[1:])
        return part

    rest = [rewrite(s, change) for s in definition.model.statements if s is not node]
    return (
        (name, joined) if (joined := _joined((*rest, *keep(inside)), {prefix + p for p in ports})) is not None else None
    )


def _opened_item(
    item: tree.Item, role: str, name: str, bound: dict[str, tree.ExpressionSyntax], instance: str, graph: BondGraph
) -> tree.Item:
    """A parameter or input with the value that the instance gave it."""
    if role not in ("parameter", "input") or name not in bound:
        return item
    value = bound[name]
    named = graph.quantities.get(f"{instance}.{name}")
    zero = isinstance(value, tree.Literal) and value.number == 0 and value.unit is None
    shown = unit(named.unit) if zero and named is not None and named.unit not in ("", "1") else None
    return replace(item, value=value, unit=shown)


def _opened_inputs(
    s: tree.Quantities, items: tuple[tree.Item, ...], prefix: str, bound: dict[str, tree.ExpressionSyntax]
) -> list[tree.SyntaxNode]:
    """A bound input becomes a signal, any other stays an input."""
    signals = tuple(i for i in items if i.name.removeprefix(prefix) in bound)
    inputs = tuple(i for i in items if i.name.removeprefix(prefix) not in bound)
    shown: list[tree.SyntaxNode] = [replace(s, role="signal", items=signals)] if signals else []
    return [*shown, replace(s, items=inputs)] if inputs else shown


def _joined(statements: Statements, ports: set[str]) -> Statements | None:
    """Bonds on both sides of a wall as one; None where a port has not exactly one on each side."""
    result = list(statements)
    for port in ports:
        ends: dict[str, list[tree.Bonds]] = {"in": [], "out": []}
        for s in result:
            if isinstance(s, tree.Bonds):
                for side, group in (("out", s.places[0]), ("in", s.places[1])):
                    if any(isinstance(p, tree.PathSyntax) and p.head == port for p in group):
                        ends[side].append(s)
        if len(ends["in"]) != 1 or len(ends["out"]) != 1:
            return None
        (arrives,), (leaves,) = ends["in"], ends["out"]
        ends_in, ends_out = arrives.places[1][0], leaves.places[0][0]
        if arrives.arrows != leaves.arrows or ends_in.steps or ends_out.steps:  # type: ignore[union-attr]
            return None
        result[result.index(arrives)] = replace(arrives, places=(arrives.places[0], leaves.places[1]))
        result.remove(leaves)
    return tuple(result)
