"""Variables of a functional mock-up unit, in the order of their value references, with what each reads; and terminals: the variables of each open port."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from compiler.api import CHANGING, DOMAINS, Apply, Number, Source, read_unit

if TYPE_CHECKING:
    from compiler.api import Compilation, Expression, Lowered, ProgramStructure, Variable

    from .start import StartValues

# Names of the structured convention: a.b[1].c, and der(a.b) of them.
_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)*\])?)*", re.ASCII)


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """A variable; its value reference is its place among all, from 0. `reads`: places and kinds of what a rate or an output depends on."""

    name: str
    causality: str
    variability: str
    unit: str
    initial: str = ""
    start: float | None = None
    nominal: float | None = None
    description: str = ""
    derivative_of: int | None = None  # place
    reads: tuple[tuple[int, str], ...] | None = None
    reset: bool = False  # True for a state that events set
    is_indicator: bool = False
    is_clock: bool = False
    least: float | None = None
    most: float | None = None


def variables_of(
    lowered: Lowered, structure: ProgramStructure, values: StartValues, descriptions: Mapping[str, str], indicated: bool
) -> tuple[FmuVariable, ...]:
    """Return all variables. `descriptions`: the author's, by name. `indicated`: event indicators and clocks are among them."""
    groups = (
        [FmuVariable("time", "independent", "continuous", "s")], _states(lowered, values, descriptions), _rates(lowered, structure),
        _inputs(lowered, values, descriptions), _parameters(lowered, structure, values, descriptions),
        _outputs(lowered, structure, descriptions), _discretes(lowered, descriptions),
        _indicators(lowered, structure) if indicated else (), _clocks(lowered) if indicated else (),
    )  # fmt: skip
    requirements: dict[str, list[tuple[Expression, Apply]]] = {}
    for limit in lowered.limits:
        for value in limit.values:
            if limit.note.kind != "table" and isinstance(limit.condition, Apply):
                requirements.setdefault(value.name, []).append((value.expression, limit.condition))
    return tuple(_unique([_bounded(item, requirements.get(item.name, ())) for group in groups for item in group]))


def _bounded(item: FmuVariable, requirements: Sequence[tuple[Expression, Apply]]) -> FmuVariable:
    """Return a variable with what requirements compare it with, where that is a number and the start is not beyond it."""
    least, most = -math.inf, math.inf
    for own, condition in requirements:
        waiting = [*condition.operands[:1]]
        while waiting:
            match waiting.pop():
                case Apply(operator="and", operands=parts):
                    waiting += parts
                case Apply(operator="less" | "less_equal", operands=(Number(value=number), side)) if side == own:
                    least = max(least, number)
                case Apply(operator="less" | "less_equal", operands=(side, Number(value=number))) if side == own:
                    most = min(most, number)
    if item.start is not None and not least <= item.start <= most:
        return item
    return replace(item, least=None if least == -math.inf else least, most=None if most == math.inf else most)


def _states(lowered: Lowered, values: StartValues, descriptions: Mapping[str, str]) -> Iterator[FmuVariable]:
    """Yield the states. One whose start parameters decide is calculated, and others can be set; in a closed mechanism all, which begin assembled."""
    magnitudes, assembled = values.tolerances.magnitude, bool(lowered.space.invariants)
    reset = {s.position for event in lowered.events.events for s in event.settings if s.kind == "state"}
    rows = zip(_state_variables(lowered), lowered.starts, values.state, magnitudes, strict=False)
    for place, (state, start, value, magnitude) in enumerate(rows):
        number = float(value) if assembled or isinstance(start, Number) else None
        initial, description = "calculated" if number is None else "exact", descriptions.get(state.name, "")
        yield FmuVariable(
            _name(state, lowered), "local", "continuous", state.unit, initial, number, float(magnitude), description,
            reset=place in reset,
        )  # fmt: skip


def _rates(lowered: Lowered, structure: ProgramStructure) -> Iterator[FmuVariable]:
    for place, state in enumerate(_state_variables(lowered)):
        name, unit, reads = f"der({_name(state, lowered)})", _rate_unit(state.unit), _reads(lowered, structure, place)
        yield FmuVariable(name, "local", "continuous", unit, derivative_of=1 + place, reads=reads)


def _inputs(lowered: Lowered, values: StartValues, descriptions: Mapping[str, str]) -> Iterator[FmuVariable]:
    for number, value in zip(lowered.inputs, values.inputs, strict=True):
        item = lowered.space.variables[number]
        description = descriptions.get(item.name, "")
        yield FmuVariable(item.name, "input", "continuous", item.unit, "", float(value), None, description)


def _parameters(
    lowered: Lowered, structure: ProgramStructure, values: StartValues, descriptions: Mapping[str, str]
) -> Iterator[FmuVariable]:
    """Yield the parameters. Those that only starts read are fixed; which constraints take part is no choice of an importer."""
    parts = {i.part for i in lowered.space.invariants}
    for place, (number, value) in enumerate(zip(lowered.parameters, values.parameters, strict=True)):
        item, variability = lowered.space.variables[number], "tunable" if place in structure.read else "fixed"
        description = descriptions.get(item.name, "")
        if number in parts:
            yield FmuVariable(item.name, "local", "fixed", item.unit, "calculated")
        else:
            yield FmuVariable(item.name, "parameter", variability, item.unit, "exact", float(value), None, description)


def _outputs(lowered: Lowered, structure: ProgramStructure, descriptions: Mapping[str, str]) -> Iterator[FmuVariable]:
    for row, (name, number) in enumerate(lowered.space.outputs.items(), len(lowered.space.states)):
        unit, reads = lowered.space.variables[number].unit, _reads(lowered, structure, row)
        description = descriptions.get(name, "")
        variability = "discrete" if name in structure.discrete else "continuous"
        yield FmuVariable(name, "output", variability, unit, "calculated", description=description, reads=reads)


def _discretes(lowered: Lowered, descriptions: Mapping[str, str]) -> Iterator[FmuVariable]:
    """Yield what only events change. One whose start parameters decide is calculated, and others can be set."""
    for discrete, start in zip(lowered.space.discretes, lowered.events.starts, strict=True):
        item = lowered.space.variables[discrete.variable]
        number = float(start.value) if isinstance(start, Number) else None
        initial, description = "calculated" if number is None else "exact", descriptions.get(item.name, "")
        yield FmuVariable(
            _name(item, lowered, "mode"), "local", "discrete", item.unit, initial, number, None, description
        )


def _indicators(lowered: Lowered, structure: ProgramStructure) -> Iterator[FmuVariable]:
    for number, columns in enumerate(structure.conditions, 1):
        reads = tuple((_place(lowered, column), CHANGING) for column in columns)
        yield FmuVariable(f"when[{number}]", "local", "continuous", "", reads=reads, is_indicator=True)


def _clocks(lowered: Lowered) -> Iterator[FmuVariable]:
    """Yield the clocks, which tick where a sampled event acts."""
    for number, event in enumerate((e for e in lowered.events.events if e.sampled), 1):
        yield FmuVariable(
            f"every[{number}]", "output", "discrete", "", "calculated", description=str(event), is_clock=True
        )


def _state_variables(lowered: Lowered) -> list[Variable]:
    return [lowered.space.variables[s.variable] for s in lowered.space.states]


def _name(item: Variable, lowered: Lowered, kind: str = "state") -> str:
    """Return the name of a state; with `state.` before it, where an output is called so, as one that is an integral."""
    return f"{kind}.{item.name}" if item.name in lowered.space.outputs else item.name


def _reads(lowered: Lowered, structure: ProgramStructure, row: int) -> tuple[tuple[int, str], ...]:
    """Return the places of what a row reads among the variables, and how."""
    return tuple((_place(lowered, d.column), d.kind) for d in structure.dependencies if d.row == row)


def _place(lowered: Lowered, column: int) -> int:
    """Return the place of a state or an input among the variables, between which the rates stand."""
    count = len(lowered.space.states)
    return 1 + column if column < count else 1 + count + column


def _rate_unit(unit: str) -> str:
    second = read_unit(Source("unit", "s"))
    return str(read_unit(Source("unit", unit or "1")).dimension / second.dimension)


def _unique(variables: Sequence[FmuVariable]) -> Iterator[FmuVariable]:
    """Yield the variables, an output that has the name of another quantity with `output.` before it."""
    taken: set[str] = set()
    for item in variables:
        if item.name in taken:
            item = replace(item, name=f"output.{item.name}")
        taken.add(item.name)
        yield item


def own_names(variables: Sequence[FmuVariable], unit: tuple[str, tuple[str, ...]] | None) -> dict[str, str]:
    """Return the names that variables have in their unit, by those in the model: what belongs to it leaves out its name."""
    names = [item.name for item in variables]
    if unit is None:
        return dict(zip(names, names, strict=True))
    short = [re.sub(rf"^(der\(|state\.)?{re.escape(unit[0])}\.", r"\1", name) for name in names]
    return dict(zip(names, short if len({*short}) == len(short) else names, strict=True))


def is_structured(variables: Sequence[FmuVariable]) -> bool:
    """Return True if all names are of the structured convention."""
    names = (
        item.name.removeprefix("der(").removesuffix(")") if item.derivative_of else item.name for item in variables
    )
    return all(_STRUCTURED.fullmatch(name) for name in names)


@dataclass(frozen=True, slots=True)
class UnitTerminal:
    """Open port: its domain, the names of its effort and flow, and True if power that is positive comes in."""

    name: str
    domain: str
    effort: str
    flow: str
    inward: bool


@dataclass(frozen=True, slots=True)
class UnitIcon:
    """Picture of a unit, in both formats, and its size."""

    png: bytes
    svg: bytes
    width: float
    height: float


def terminals_of(compilation: Compilation, ports: Iterable[str]) -> tuple[UnitTerminal, ...]:
    """Return the terminals of ports that have sources in their place."""
    graph = compilation.whole_graph
    plain = compilation.tree.models[graph.name].plain
    places = {node.name: number for number, node in enumerate(graph.nodes)}
    terminals = []
    for port in ports:
        bond = next(b for b in graph.bonds if places[port] in (b.tail.node, b.head.node))
        effort, flow = (f"{port}_{v if plain else DOMAINS[bond.domain].letter(v)}" for v in ("e", "f"))
        terminals.append(UnitTerminal(port, bond.domain, effort, flow, bond.tail.node == places[port]))
    return tuple(terminals)
