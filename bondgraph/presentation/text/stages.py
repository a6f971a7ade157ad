"""Stages of the compiler as stable text: for debugging, for the golden files of the tests, for the examples of the documents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from compiler.api import Compilation, Mechanism, MechanismNode, write_text

from .tables import end_name, visible


def stage_text(compilation: Compilation, stage: str) -> str:
    writers: dict[str, Callable[[Compilation], Iterable[str]]] = {
        "syntax": _syntax, "graph": _graph, "causality": _causality, "equations": _equations, "reduction": _reduction,
        "state_equations": lambda c: [c.state_equations], "code": lambda c: [c.program.source], "text": lambda c: [write_text(c.whole_graph).rstrip()],
    }  # fmt: skip
    return "\n".join(visible(line) for text in writers[stage](compilation) for line in text.split("\n"))


def _syntax(compilation: Compilation) -> Iterator[str]:
    """Yield the tree, one node per line."""

    def walk(node: object, name: str, depth: int) -> Iterator[str]:
        pad = "  " * depth
        if is_dataclass(node) and not isinstance(node, type):
            simple: list[tuple[str, Any]] = []
            inner: list[tuple[str, Any]] = []
            for item in fields(node):
                value = getattr(node, item.name)
                if item.name in ("span", "name_span", "depth", "source"):
                    continue
                (inner if is_dataclass(value) or isinstance(value, tuple) else simple).append((item.name, value))
            words = " ".join(f"{n}={v}" for n, v in simple if v is not None)
            yield f"{pad}{name}{type(node).__name__.removesuffix('Syntax')}{' ' + words if words else ''}"
            for key, value in inner:
                yield from walk(value, f"{key}: ", depth + 1)
        elif isinstance(node, tuple):
            for i, item in enumerate(node):
                if is_dataclass(item) or isinstance(item, tuple):
                    yield from walk(item, name if len(node) == 1 else f"{name}{i + 1}: ", depth)
                elif item is not None:
                    yield f"{pad}{name}{item}"

    for statement in compilation.tree.statements:
        yield from walk(statement, "", 0)


def _graph(compilation: Compilation) -> Iterator[str]:
    """Yield nodes, bonds, quantities."""
    graph = compilation.whole_graph
    yield f"graph {graph.name}: {len(graph.nodes)} nodes, {len(graph.bonds)} bonds"
    for node in graph.nodes:
        ports = getattr(node, "ports", ())
        listed = ", ".join(f"{p.name}: {p.domain}" if p.name else p.domain for p in ports) or getattr(
            node, "domain", ""
        )
        yield f"  {node.kind.value} {node.name} ({listed})  # {node.span.file_and_line} {node.definition}"
        if isinstance(node, MechanismNode):
            yield from _parts(node.mechanism)
    for bond in graph.bonds:
        yield f"  {end_name(graph, bond.tail)} -> {end_name(graph, bond.head)} : {bond.domain}  # {bond.span.file_and_line}"
    for named in graph.quantities.values():
        value = f" = {named.value!r}" if named.value is not None else ""
        yield f"  {named.role} {named.name} [{named.unit}]{value}  # {named.span.file_and_line}"
    for named in graph.outputs.values():
        yield f"  reported {named.name} [{named.unit}]  # {named.span.file_and_line}"
    for required in graph.requirements:
        owner = f" of {required.name}" if required.name else ""
        yield f"  required{owner}: {required.words}  # {required.span.file_and_line} {required.text}".rstrip()
    for event in graph.events:
        word, owner = "when" if event.sampling is None else "every", f" of {event.name}" if event.name else ""
        sets = "ends the run" if event.stops else "sets " + ", ".join(action.words for action in event.actions)
        yield f"  {word} {event.words}{owner}: {sets}  # {event.span.file_and_line}"
    for switch in graph.switches:
        yield f"  switched {switch.junction}  # {switch.span.file_and_line}"


def _parts(mechanism: Mechanism) -> Iterator[str]:
    """Yield bodies, frames and joints, with the degrees of freedom of each joint."""
    yield f"    {'planar' if mechanism.planar else 'spatial'}: {len(mechanism.bodies)} bodies, {len(mechanism.joints)} joints"
    for body in mechanism.bodies:
        yield f"    body {body.name}  # {body.span.file_and_line}"
    for frame in mechanism.frames:
        yield f"    frame {frame.name} : {frame.body}  # {frame.span.file_and_line}"
    for joint in mechanism.joints:
        leaves = f" ({', '.join(joint.freedoms)})" if joint.freedoms else ""
        locked = " locked" if joint.locked else ""
        yield f"    {joint.kind} {joint.name} : {joint.first} to {joint.second}{leaves}{locked}  # {joint.span.file_and_line}"


def _causality(compilation: Compilation) -> Iterator[str]:
    """Yield every bond with its stroke (|) at the end that receives the effort, and its reason."""
    causal = compilation.causal
    graph = causal.graph
    gone = len(compilation.whole_graph.nodes) - len(graph.nodes)
    yield f"causality {graph.name}: {len(graph.bonds)} bonds, {len(causal.derivative)} in derivative form, {gone} nodes left out because they give nothing"
    for bond, effort_from, reason in zip(graph.bonds, causal.effort_from, causal.reasons, strict=True):
        arrow = "--|>" if effort_from == 0 else "|-->"
        source = graph.nodes[reason.node].name
        yield f"  {end_name(graph, bond.tail)} {arrow} {end_name(graph, bond.head)}  # {reason.because.value}: {source}"


def _equations(compilation: Compilation) -> Iterator[str]:
    """Yield all assignments, before reduction and ordering."""
    from compiler.api import to_sympy

    from .equations import symbols_of

    system = compilation.equations
    symbol = symbols_of([v.name for v in system.variables])
    formulas = {a.formula for a in system.assignments}
    yield f"equations {system.name}: {len(system.assignments)} assignments of {len(formulas)} formulas, {len(system.states)} states"
    for assignment in system.assignments:
        right = to_sympy(assignment.expression, symbol)
        if assignment.implicit:
            solved_for = f"solved for {system.variables[assignment.target].name}"
            yield f"  0 = {right}  # {assignment.span.file_and_line} {assignment.owner}, {solved_for}"
            continue
        yield f"  {system.variables[assignment.target].name} = {right}  # {assignment.span.file_and_line} {assignment.owner}"
    for item in system.derivatives:
        yield f"  {system.variables[item.target].name} = d/dt {system.variables[item.of].name}  # {item.span.file_and_line} {item.owner}"
    for state in system.states:
        yield f"  d/dt {system.variables[state.variable].name} = {system.variables[state.rate].name}  # {state.span.file_and_line}"


def _reduction(compilation: Compilation) -> Iterator[str]:
    """Yield the computations of this run, in order."""
    from .equations import equations_text

    space = compilation.state_space
    loops = sum(type(s).__name__ == "LinearLoop" for s in space.steps)
    unknowns = f"{len(space.unknowns)} unknowns of nonlinear loops, " if space.unknowns else ""
    assignments = len(space.steps) - loops - len(space.unknowns)
    counts = f"{len(space.states)} states, {unknowns}{assignments} assignments, {loops} linear loops"
    yield f"state space {space.name}: {counts}, outputs {', '.join(space.outputs)}"
    if space.dependent:
        yield f"in derivative form: {', '.join(space.dependent)}"
    if space.following:
        names = ((space.variables[v].name for v in (f.variable, f.state)) for f in space.following)
        yield "sharing a state: " + ", ".join("{} follows {}".format(*pair) for pair in names)
    yield equations_text(space, latex=False)
