"""One instance of a model alone: its inputs become inputs of a model of its own. A controller, for the machine that it is made for."""

from __future__ import annotations

from dataclasses import replace

from .algebra.expression import Number
from .algebra.formula import bind
from .codegen.errors import NoPart, PartWithElements, PartWithoutOutputs
from .errors import CompilationFailed
from .graph.network import BondGraph, Named


def part_alone(graph: BondGraph, name: str) -> BondGraph:
    """The graph of one instance, with values of its parameters as they are in the whole. Raises `CompilationFailed`."""
    prefix = f"{name}."
    if name not in graph.stands:
        names = ", ".join(f"`{n}`" for n in sorted(graph.stands)[:12])
        hint = f"Its instances are {names}." if names else "A part is an instance, such as `Pid pid { … }`."
        raise CompilationFailed([NoPart(graph.span, name, hint)])
    element = next((node.name for node in graph.nodes if node.name.startswith(prefix)), None)
    if element is not None:
        raise CompilationFailed([PartWithElements(graph.stands[name], name, element)])
    own = {n: q for n, q in graph.quantities.items() if n.startswith(prefix)}
    direct = {n.removeprefix(prefix): q for n, q in own.items() if "." not in n.removeprefix(prefix)}
    outputs = {n: q for n, q in direct.items() if q.role == "output"}
    if not outputs:
        raise CompilationFailed([PartWithoutOutputs(graph.stands[name], name)])
    opened = {q.name: _opened(q) for q in direct.values() if q.role == "input"}
    return replace(
        graph, name=name, nodes=(), bonds=(), quantities={**graph.quantities, **opened}, outputs=outputs,
        requirements=tuple(r for r in graph.requirements if _is_inside(r.name, name)), events=tuple(e for e in graph.events if _is_inside(e.name, name)),
        switches=(), walls={}, undetermined=(),
    )  # fmt: skip


def _is_inside(owner: str, name: str) -> bool:
    return owner == name or owner.startswith(f"{name}.")


def _opened(named: Named) -> Named:
    """An input that comes from outside: zero, or its value where that is known."""
    value = named.value if named.value is not None else 0.0
    return replace(named, definition=bind(Number(value)), value=value)
