"""Contents of `bondgraph explain`: omitted parts of a run with reasons, the remaining ones, their evaluations, and expensive lines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from compiler.api import Compilation, cost

from ...rendering import OfModel
from ...results.json_values import as_json, entries, head
from ...results.truncation import frequency_text
from .tables import columns, counted, short, some_of, visible

if TYPE_CHECKING:
    from compiler.api import Certificate, Cost, Lowered

    from ...analysis.prices import Price, Prices

SCHEMA = "bondgraph-explanation/1"
SHOWN = 10  # most lines of the table of expensive lines
LISTED = 6  # most names in one line of the text


@dataclass(frozen=True, slots=True)
class OmittedNode:
    """A node without effect in this run, and the quantities that cause it."""

    name: str
    place: str
    because: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunExplanation(OfModel):
    """Contents of `bondgraph explain` for one scene."""

    outputs: tuple[str, ...]
    left_out: tuple[OmittedNode, ...]
    certificate: Certificate
    cost: Cost
    arguments: tuple[str, ...]  # parameters that stay arguments of the program
    conditions: tuple[str, ...] = ()  # lines of conditions on states, which are located in a run
    bends: int = 0  # number of kinks in laws of states, at which steps may end
    bandwidth: float | None = None  # in Hz

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by `bondgraph-explanation/1`."""
        kind, count = self.certificate, self.cost
        words = ("once", "with_time", "rates", "jacobian", "outputs")
        return {
            **head(SCHEMA, self), **entries(self, "outputs", "certificate", "conditions", "bends", "bandwidth"), **entries(kind, "unneeded", "unexcited"),
            "gives_nothing": as_json(self.left_out), "operations": entries(count, *words) | {"jacobian_entries": count.entries},
            "functions": dict(count.functions),
            "lines": [entries(x, "owners", "operations") | {"place": x.span.file_and_line} for x in count.lines],
        }  # fmt: skip

    def text(self) -> str:
        """Return text for readers."""
        return "\n".join(visible(line) for line in self._lines())

    def _lines(self) -> Iterator[str]:
        title = self.model if self.experiment is None else f"{self.model}, {self.experiment}"
        yield f"{title}: {counted(len(self.outputs), 'output')} asked for: {_some(self.outputs)}"
        yield self.certificate.line
        yield from ("", "left out")
        if self.bandwidth is not None:
            yield f"  what rings faster than {frequency_text(self.bandwidth)}, if it does: the run tells what that was, and what it would have done"
        elif not (self.left_out or self.certificate.unneeded or self.certificate.unexcited):
            yield "  nothing: all of the model is needed"
        for item in self.left_out:
            yield f"  {item.name} ({item.place}) gives nothing" + (
                f": {_some(item.because)} = 0" if item.because else ""
            )
        if self.certificate.unneeded:
            yield f"  no output needs {counted(len(self.certificate.unneeded), 'state')}: {_some(self.certificate.unneeded)}"
        if self.certificate.unexcited:
            yield f"  nothing excites {counted(len(self.certificate.unexcited), 'state')}, at zero in the whole run: {_some(self.certificate.unexcited)}"
        if self.certificate.following:
            yield from ("", "what shares a state", *(f"  {told}" for told in self.certificate.following))
        if self.certificate.events or self.conditions or self.bends:
            yield from ("", "what happens at instants")
            yield from (f"  {event}" for event in self.certificate.events)
            yield from (f"  a condition on states in {place}" for place in self.conditions)
            if self.bends:
                yield f"  {counted(self.bends, 'bend')} of laws (min, max, abs, points of a table), at which steps may end"
        yield from ("", "what remains")
        yield from self._remaining()
        yield from ("", "most operations in an evaluation")
        yield from self._expensive()

    def _remaining(self) -> Iterator[str]:
        loops = sum(x.size for x in self.certificate.loops if not x.linear)
        count, order = self.cost, len(self.certificate.states) + loops
        rows = [
            ("once in a run, of parameters", count.once, ""),
            ("with each new time, of time and inputs", count.with_time, ""),
            ("in each evaluation, of states", count.rates, ", ".join(f"{n} {f}" for f, n in count.functions)),
            ("more for the Jacobian", count.jacobian, f"{count.entries} of {order * order} entries are not zero"),
            ("more for the outputs, at reported instants", count.outputs, ""),
        ]
        yield from (
            f"  {line}" for line in columns([(name, f"{number} operations", note) for name, number, note in rows])
        )

    def _expensive(self) -> Iterator[str]:
        whole = max(1, self.cost.rates)
        rows = [
            (f"{100 * x.operations / whole:3.0f} %", f"{x.span.file_and_line}", _some(x.owners))
            for x in self.cost.lines[:SHOWN]
        ]
        yield from (f"  {line}" for line in columns(rows))


def explain(compilation: Compilation) -> RunExplanation:
    """Return the explanation of a scene. Raises `CompilationFailed`."""
    certificate = compilation.certificate
    lowered = compilation.lowered
    names = [lowered.space.variables[v].name for v in lowered.parameters]
    return RunExplanation(
        certificate.model, compilation.plan.experiment, tuple(lowered.space.outputs), tuple(_left_out(compilation)),
        certificate, cost(lowered), tuple(names), tuple(_conditions(lowered)), len(lowered.bends),
        compilation.plan.bandwidth,
    )  # fmt: skip


def prices_text(found: Prices) -> str:
    """Return the price list as text: rows of states and operations of an evaluation, with those that a zero saves."""
    headings = ("", "states", "operations of an evaluation", "and of the Jacobian")
    lines = ["price of each output alone"]
    lines += columns([headings, *(_row(short(name), price) for name, price in found.outputs.items()), _row("all", found.whole)])  # fmt: skip
    lines += ["", "price where the text or the experiment sets to zero"]
    rows = [_row(short(name), price) for name, price in list(found.zeros.items())[:SHOWN]]
    lines += columns([headings, *rows]) if rows else ["nothing: no zero saves any"]
    if len(found.zeros) > SHOWN:
        lines.append(f"and {len(found.zeros) - SHOWN} that save less")
    if found.untried:
        lines.append(f"not tried: {_some(found.untried)}")
    return "\n".join(visible(line) for line in lines)


def _row(name: str, price: Price) -> tuple[str, ...]:
    return name, str(price.states), str(price.rates), str(price.jacobian)


def _conditions(lowered: Lowered) -> dict[str, None]:
    """Return the lines of conditions on states, each once; those of `when` are reported as events."""
    told = {(e.span.source.name, e.span.line) for e in lowered.space.events}
    notes = (item.note for item in lowered.events.located)
    return {
        f"`{n.owner}` ({n.span.file_and_line})": None for n in notes if (n.span.source.name, n.span.line) not in told
    }


def _left_out(compilation: Compilation) -> Iterator[OmittedNode]:
    kept = {node.name for node in compilation.graph.nodes}
    for node in compilation.whole_graph.nodes:
        if node.name not in kept:
            yield OmittedNode(
                node.name, node.span.file_and_line, tuple(_zeros_behind(compilation, getattr(node, "arguments", ())))
            )


def _zeros_behind(compilation: Compilation, references: Iterable[Any]) -> dict[str, None]:
    """Return the parameters and inputs that are zero among the dependencies of some references, in the order of reading."""
    found: dict[str, None] = {}
    waiting, seen = list(references), set[str]()
    while waiting:
        name = getattr(waiting.pop(0), "name", None)
        if name not in compilation.zeros or name in seen:
            continue
        seen.add(name)
        definition = compilation.whole_graph.quantities[name].definition
        inner = [a for a in definition.arguments if getattr(a, "name", None) in compilation.zeros] if definition else []
        if inner:
            waiting += inner
        else:
            found[name] = None
    return found


def _some(names: Sequence[str]) -> str:
    return some_of(list(map(short, names)), LISTED)
