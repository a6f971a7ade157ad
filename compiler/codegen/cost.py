"""Operation counts of a program, by how often they are done, taken from the shared graph before code is written.

An operation is counted where it is first needed: once per run if it depends on parameters alone, once per new time if it depends on
time and inputs alone, else once per evaluation of the rates. The additional operations of the Jacobian and the outputs follow.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from ..algebra.expression import MINUS_ONE, Apply, Expression
from ..algebra.systems import shape_of
from ..fast_dataclass import dataclass
from ..source import Span
from .dependence import INPUT, MODE, STATE, TIME
from .lowered import Lowered


@dataclass(frozen=True, slots=True)
class LineCost:
    """Operations of one line of the text in each evaluation of the rates, over all its instances."""

    span: Span
    owners: tuple[str, ...]  # elements, junctions or quantities of the line
    operations: int


@dataclass(frozen=True, slots=True)
class Cost:
    """Operation counts, by how often they are done."""

    once: int  # of parameters alone
    with_time: int  # of time and inputs
    rates: int  # of states: in each evaluation
    jacobian: int  # more, for the Jacobian
    entries: int  # of the Jacobian that are not zero
    outputs: int  # more, for the outputs at reported instants
    functions: tuple[tuple[str, int], ...]  # of the rates: sin, exp and their like, most frequent first
    lines: tuple[LineCost, ...]  # of the rates, most expensive first


PLAIN = frozenset(["add", "multiply", "divide", "negate", "power", "item", "less", "less_equal", "equal", "select"])


def cost(lowered: Lowered) -> Cost:
    """Count the operations of a lowered state space."""
    counter = _Counter(lowered)
    counter.visit(lowered.rates)
    rates = Counter(counter.found)
    functions = Counter(node.operator for node in counter.own if node.operator not in PLAIN)
    lines = counter.lines()
    counter.visit(lowered.jacobian.values())
    jacobian = counter.found - rates
    before = Counter(counter.found)
    counter.visit(lowered.outputs.values())
    outputs = counter.found - before
    return Cost(
        counter.found["once"], counter.found["time"], rates["state"], jacobian["state"], len(lowered.jacobian), outputs["state"],
        tuple(functions.most_common()), lines,
    )  # fmt: skip


class _Counter:
    """Traversal of the graph. Each operation counts once, for the line whose value first needs it."""

    def __init__(self, lowered: Lowered) -> None:
        self.lowered = lowered
        self.seen: set[Expression] = set()
        self.found: Counter[str] = Counter()
        self.own: list[Apply] = []  # operations that depend on states
        self.by_line: Counter[Span] = Counter()
        self.owners: dict[Span, dict[str, None]] = {}

    def visit(self, roots: Iterable[Expression]) -> None:
        """Count the operations behind some expressions that are not counted yet."""
        stack: list[tuple[Expression, Span | None]] = [(root, None) for root in roots]
        while stack:
            node, span = stack.pop()
            if not isinstance(node, Apply) or node in self.seen:
                continue
            self.seen.add(node)
            label = self.lowered.labels.get(node)
            if label is not None and label.span is not None:
                span = label.span
                self.owners.setdefault(span, {})[label.owner] = None
            count = _operations(node)
            often = self._often(node)
            self.found[often] += count
            if often == "state":
                self.own.append(node)
                if span is not None:
                    self.by_line[span] += count
            stack += [(operand, span) for operand in node.operands]

    def _often(self, node: Expression) -> str:
        bits = self.lowered.dependence(node)
        if bits & STATE:
            return "state"
        return "time" if bits & (TIME | INPUT | MODE) else "once"

    def lines(self) -> tuple[LineCost, ...]:
        """Lines, most expensive first; equal ones in the order of the text."""
        order = sorted(self.by_line.items(), key=lambda item: (-item[1], item[0].start))
        return tuple(LineCost(span, tuple(self.owners.get(span, ())), count) for span, count in order)


def _operations(node: Apply) -> int:
    """Additions and multiplications of one node; for a linear system those of the elimination."""
    if node.operator == "item":
        return 0
    if node.operator == "solve":
        size = int((len(node.operands) + 0.25) ** 0.5)  # n^2 + n operands
        return (2 * size**3 + 3 * size**2 - 5 * size) // 6 + size**2
    if node.operator == "banded":
        size, lower, upper = shape_of(node)
        return size * (lower * (2 * (lower + upper) + 1) + 2 * (lower + upper) + 1)
    if node.operator == "multiply" and node.operands[0] == MINUS_ONE:  # a sign costs nothing: the sum subtracts instead
        return len(node.operands) - 2
    return max(1, len(node.operands) - 1) if node.operator in ("add", "multiply") else 1
