"""Lines of one function: expressions in numpy notation, with an assignment for each part that is clearer on its own line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import PurePath

from ...algebra.expression import Apply, Expression, Number
from ...algebra.operators import OPERATORS
from ...algebra.systems import LEADING, SYSTEMS, shape_of, size_of
from ...algebra.table import lists, order_of
from ...errors import printable
from ...fast_dataclass import dataclass
from ..lowered import Label
from ..order import in_order
from .names import Identifiers

_COMPARE = {name: OPERATORS[name].c for name in ("less", "less_equal", "equal")}


@dataclass(slots=True)
class NumpyNeeds:
    """Parts of a module that its functions need: operators, lists of numbers; and the labels of expressions."""

    labels: Mapping[Expression, Label]
    operators: set[str] = field(default_factory=set)  # that have been written
    arrays: dict[tuple[float, ...], str] = field(default_factory=dict)  # the lists of tables that are numbers

    def array(self, values: tuple[float, ...]) -> str:
        """Name of a list of numbers, which is written once per module."""
        return self.arrays.setdefault(values, f"_list_{len(self.arrays) + 1}")


class NumpyLines:
    """Lines of one function."""

    def __init__(self, needs: NumpyNeeds, known: dict[Expression, str], taken: set[str]) -> None:
        self.needs, self.known = needs, known
        self.identifiers = Identifiers()
        self.identifiers.taken = taken
        self.lines: list[str] = []
        self.used: set[str] = set()
        self.slopes: dict[tuple[str, tuple[Expression, ...]], str] = {}

    def write(self, roots: Sequence[Expression], names: dict[Expression, str]) -> list[str]:
        """Write lines for all operations that the roots need, and return the text of each root. `names` are names that are given already."""
        order, uses = in_order(roots, self.known)
        labels = self.needs.labels
        for node in order:
            label = labels.get(node)
            given = names.get(node)
            vector = node.operator in SYSTEMS
            if given is None and label is None and uses[node] < 2 and not vector and not _long(node):
                continue
            text = self._text(node, 0)
            name = given or self.identifiers.of(label.name if label is not None else "t")
            place = ""
            if label is not None and label.span is not None:
                owner = f" {printable(label.owner)}" if label.owner and label.owner != label.name else ""
                place = f"  # {printable(PurePath(label.span.source.name).name)}:{label.span.line}{owner}"
            self.lines.append(f"{name} = {text}{place}")
            self.known[node] = name
        return [self._text(root, 0) for root in roots]

    def _text(self, node: Expression, strength: int) -> str:
        """The node as Python. `strength` is the precedence of the operator around it (1 sum, 2 product, 3 power)."""
        if isinstance(node, Number):
            text = number(node.value)
            return f"({text})" if node.value < 0 and strength > 1 else text
        name = self.known.get(node)
        if name is not None:
            self.used.add(name)
            return name
        assert isinstance(node, Apply)
        operands = node.operands
        self.needs.operators.add(node.operator)
        match node.operator:
            case "linear" | "cubic" | "monotone" | "inverse":
                points = ", ".join(map(self._list, lists(node)))
                return f"{OPERATORS[node.operator].in_numpy}({order_of(node)}, {self._text(operands[1], 0)}, {points})"
            case "noise":
                place, seed = (self._text(o, 0) for o in operands[1:])
                return f"_noise({order_of(node)}, {place}, {seed})"
            case "natural_slope" | "monotone_slope":
                return self._slope(node)
            case "add":
                return _bracketed(self._sum(operands), strength > 1)
            case "multiply":
                if operands[0] == Number(-1.0):
                    first, *rest = operands[1:]
                    factors = (self._text(first, 2), *(self._text(o, 3) for o in rest))
                    return _bracketed("-" + " * ".join(factors), strength > 1)
                return _bracketed(" * ".join(self._text(o, 2) for o in operands), strength > 2)
            case "divide":
                bottom = self._text(operands[1], 4)
                if isinstance(operands[1], Number):  # a run reports numpy's division by zero; Python's would end it
                    bottom = f"np.float64({bottom})" if operands[1].value == 0.0 else bottom
                return _bracketed(f"{self._text(operands[0], 2)} / {bottom}", strength > 2)
            case "power" if isinstance(operands[1], Number) and operands[1].value == int(operands[1].value):
                return _bracketed(f"{self._text(operands[0], 4)} ** {int(operands[1].value)}", strength > 3)
            case "less" | "less_equal" | "equal":
                return f"({self._text(operands[0], 1)} {_COMPARE[node.operator]} {self._text(operands[1], 1)})"
            case "solve":
                return f"_solve({size_of(node)}, {', '.join(self._text(o, 0) for o in operands)})"
            case "banded":
                shape = ", ".join(map(str, shape_of(node)))
                return f"_banded({shape}, {', '.join(self._text(o, 0) for o in operands[LEADING:])})"
            case "item":
                index = operands[1]
                assert isinstance(index, Number)
                return f"{self._text(operands[0], 4)}[{int(index.value)}]"
        return f"{OPERATORS[node.operator].in_numpy}({', '.join(self._text(o, 0) for o in operands)})"

    def _list(self, items: Sequence[Expression]) -> str:
        """A list of a table: an array of the module if it is of numbers alone."""
        numbers = tuple(x.value for x in items if isinstance(x, Number))
        if len(numbers) == len(items):
            return self.needs.array(numbers)
        return f"({', '.join(self._text(x, 0) for x in items)})"

    def _slope(self, node: Apply) -> str:
        """One slope of a curve. All slopes of a curve are computed together, on a line of their own."""
        number, points = node.operands[0], node.operands[1:]
        assert isinstance(number, Number)
        key = (node.operator, points)
        if key not in self.slopes:
            n = len(points) // 2
            places, values = (f"({', '.join(self._text(x, 0) for x in part)})" for part in (points[:n], points[n:]))
            self.slopes[key] = self.identifiers.of("slopes")
            self.lines.append(f"{self.slopes[key]} = _{node.operator}({places}, {values})")
        return f"{self.slopes[key]}[{int(number.value)}]"

    def _sum(self, terms: Iterable[Expression]) -> str:
        text = ""
        for term in terms:
            part = self._text(term, 1)
            if not text:
                text = part
            elif part.startswith("-"):
                text += f" - {part[1:]}"
            else:
                text += f" + {part}"
        return text


def _long(node: Apply) -> bool:
    """Return True for a deep nest of unnamed operations, which is hard to read and to parse: it gets a line of its own."""
    depth, layer = 0, [node]
    while layer and depth < 6:
        layer = [o for n in layer for o in n.operands if isinstance(o, Apply)][:12]
        depth += 1
    return depth >= 6


def _bracketed(text: str, needed: bool) -> str:
    return f"({text})" if needed else text


def number(value: float | None) -> str:
    """A number in Python; NaN where there is none."""
    if value is None or not math.isfinite(value):
        return f"float('{value if value is not None else 'nan'}')"
    return repr(float(value))
