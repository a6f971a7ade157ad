"""Loop rolling: the operations of a function are cut into trees; trees of one shape share one kernel.

A shape is an expression with numbered places for its operands, items of arrays or numbers. It has no names, bonds or indices, so the
sections of a ladder have the same few shapes, written as an array or one by one. The difference between instances is a row of integers:
the place of the value, and the places of its operands. A function is then a list of runs over such rows, in an order in which every
operand is computed before it is read.

Trees are cut at values with several uses, at the value of a law once a tree has grown, and at long sums: a sum of a thousand terms is
one row of a thousand numbers and no code.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import NamedTuple, Self

from ..algebra.expression import MINUS_ONE, Apply, Expression, Number, Symbol, operations
from ..algebra.operators import CURVES, SLOPES
from ..algebra.systems import LEADING, SYSTEMS, size_of
from ..fast_dataclass import dataclass
from .limits import Leaf
from .lowered import Lowered
from .order import operations_in_order

Place = tuple[str, int]  # an array and an index in it
LONGEST_TREE, LONG_TREE = 40, 12  # operations in a tree; and in one that ends with the value of a law
LONG_SUM = 4  # terms; longer ones are rows of numbers
SAVING = 2  # by how much shorter the kernels must be
LONGEST_IN_LINES = 1500  # operations and values of a module that are written one after the other
ARRAYS = ("state", "inputs", "constants", "mode", "out", "work", "numbers")
_LITERAL = frozenset((*CURVES, *SLOPES))  # operators whose numbers are part of the shape

_PLACES: dict[tuple[str, int], Symbol] = {}


def read(array: str, number: int) -> Symbol:
    """Symbol of the place with this number in a shape, which is read from the array."""
    found = _PLACES.get((array, number))
    if found is None:
        found = _PLACES[array, number] = Symbol((array, number))
    return found


@dataclass(eq=False)
class Kernel:
    """A shape, and the numbers of its instances. `expression` is None for the kernel of long sums."""

    number: int
    expression: Expression | None
    reads: tuple[str, ...] = ()  # the array that each place is read from
    count: int = 1  # values: of a linear system there are several
    literals: list[float | None] = field(default_factory=list)  # of its numbers: None where instances differ


class Instance(NamedTuple):
    """Place of the value (in `out`, or ~place in work), places of its operands, numbers."""

    target: int
    places: tuple[int, ...]
    numbers: tuple[float, ...]


@dataclass(eq=False)
class KernelSchedule:
    """Sequence of a function: runs of instances of one kernel each, and the size of its working array."""

    runs: list[tuple[Kernel, list[Instance]]]
    work: int


class KernelCollection:
    """Kernels of a module, collected function by function."""

    def __init__(self, time: Expression, labelled: Mapping[Expression, object]) -> None:
        self.time, self.labelled = time, labelled
        self.kernels: dict[Expression | None, Kernel] = {}
        self.numbers: dict[float | tuple[str, float], int] = {}

    def plan(
        self, roots: Sequence[Expression], order: Sequence[Apply], known: Mapping[Expression, Place]
    ) -> KernelSchedule:
        """Plan of a function. `order` holds the operations behind the roots, operands first, without those in `known`."""
        return _Planner(self, order, known).plan(roots)

    def kernel(self, expression: Expression | None, reads: tuple[str, ...], numbers: Sequence[float], count: int) -> Kernel:  # fmt: skip
        """Kernel of a shape."""
        found = self.kernels.get(expression)
        if found is None:
            found = Kernel(len(self.kernels), expression, reads, count, list(numbers))
            self.kernels[expression] = found
            return found
        literals = found.literals
        for i, value in enumerate(numbers):
            if literals[i] is not None and not _same(literals[i], value):
                literals[i] = None
        return found

    def place_of(self, value: float) -> int:
        """Place of a number in the table of numbers in which instances differ."""
        return self.numbers.setdefault(value or ("zero", math.copysign(1.0, value)), len(self.numbers))

    def table(self) -> list[float]:
        """The table of these numbers."""
        return [math.copysign(0.0, key[1]) if isinstance(key, tuple) else key for key in self.numbers]

    def stream(self, plan: KernelSchedule) -> list[int]:
        """A plan as integers: kernel, number of instances, their rows; -1 ends it."""
        found: list[int] = []
        for kernel, instances in plan.runs:
            found += (kernel.number, len(instances))
            differ = [i for i, value in enumerate(kernel.literals) if value is None]
            for instance in instances:
                found.append(instance.target)
                if kernel.expression is None:
                    found.append(len(instance.places))
                found += instance.places
                if differ:
                    found += [self.place_of(instance.numbers[i]) for i in differ]
        found.append(-1)
        return found


def encoded(place: Place, negative: bool) -> int:
    """Encode a term of a long sum as one integer."""
    array, index = place
    return index * 16 + ARRAYS.index(array) * 2 + negative


def _same(a: float | None, b: float) -> bool:
    return a == b and a is not None and math.copysign(1.0, a) == math.copysign(1.0, b)


class _Planner:
    """Cutting of the operations of one function into trees."""

    def __init__(self, shapes: KernelCollection, order: Sequence[Apply], known: Mapping[Expression, Place]) -> None:
        self.shapes, self.order, self.known = shapes, order, known
        self.index: dict[Expression, int] = {node: i for i, node in enumerate(order)}
        find = self.index.get
        self.operands = [[find(o, -1) if isinstance(o, Apply) else -1 for o in node.operands] for node in order]
        self.where: dict[int, Place] = {}  # of stored values
        self.level: dict[int, int] = {}
        self.runs: dict[tuple[int, int], tuple[Kernel, list[Instance]]] = {}
        self.work = 0

    def plan(self, roots: Sequence[Expression]) -> KernelSchedule:
        """Runs in an order in which operands are computed before they are read."""
        first: dict[int, int] = {}  # operation -> the first value that is it
        others: list[tuple[int, Expression]] = []
        for place, root in enumerate(roots):
            number = self.index.get(root) if isinstance(root, Apply) and root.operator != "item" else None
            if number is None or number in first:
                others.append((place, root))
            else:
                first[number] = place
        kept = self._cut(set(first))
        for number in kept:
            self._tree(number, first.get(number), kept)
        for place, root in others:
            self._copy(place, root)
        runs = [self.runs[key] for key in sorted(self.runs)]
        return KernelSchedule(runs, self.work)

    # ------------------------------------------------------------ where trees end
    def _cut(self, ends: set[int]) -> dict[int, None]:
        """Operations whose values are stored, operands first."""
        for number, node in enumerate(self.order):
            if node.operator in SYSTEMS:
                ends.add(number)
            elif _is_long(node):
                ends.add(number)
                ends.update(self._terms(number))
        owner = self._owners(ends)
        size = [0] * len(self.order)
        grown = False
        for number, node in enumerate(self.order):
            own = 1
            for operand in self.operands[number]:
                if operand >= 0 and owner[operand] != operand:
                    own += size[operand]
            if own > LONG_TREE and owner[number] != number and (own > LONGEST_TREE or node in self.shapes.labelled):
                ends.add(number)
                own, grown = 0, True
            size[number] = own
        if grown:
            owner = self._owners(ends)
        # an item of a solution is computed with the solution
        return {n: None for n, node in enumerate(self.order) if owner[n] == n and node.operator != "item"}

    def _owners(self, ends: set[int]) -> list[int]:
        """For each operation, the root of the tree that it belongs to. An operation that two trees read is a root of its own."""
        unknown, several = -1, -2
        owner = [unknown] * len(self.order)
        for number in range(len(self.order) - 1, -1, -1):
            if number in ends or owner[number] in (unknown, several):
                owner[number] = number
            own = owner[number]
            for operand in self.operands[number]:
                if operand >= 0 and owner[operand] != own:
                    owner[operand] = own if owner[operand] == unknown else several
        return owner

    def _terms(self, number: int) -> list[int]:
        """Operations that a long sum adds or subtracts."""
        found = []
        for node, operand in zip(self.order[number].operands, self.operands[number], strict=True):
            inner = self._negated(node)
            if inner is not None:
                operand = self.index.get(inner, -1) if isinstance(inner, Apply) else -1
            if operand >= 0:
                found.append(operand)
        return found

    def _negated(self, node: Expression) -> Expression | None:
        """x, if the node is -x and its value is not stored."""
        if not isinstance(node, Apply) or node.operator != "multiply" or len(node.operands) != 2 or node in self.known:
            return None
        return node.operands[1] if node.operands[0] == MINUS_ONE else None

    # ------------------------------------------------------------ instances
    def _add(self, kernel: Kernel, level: int, instance: Instance) -> None:
        self.runs.setdefault((level, kernel.number), (kernel, []))[1].append(instance)

    def _target(self, number: int, place: int | None, count: int) -> int:
        """Allocate a place for a value, and record it there."""
        if place is not None:
            self.where[number] = ("out", place)
            return place
        self.where[number] = ("work", self.work)
        self.work += count
        return ~self.where[number][1]

    def _place(self, node: Expression) -> tuple[Place | None, int]:
        """Place of a computed value, and the level from which on it is valid; None for a value that is no item of an array."""
        number = self.index.get(node) if isinstance(node, Apply) else None
        if number is None:
            return self.known.get(node), -1
        if self.order[number].operator == "item":
            system, item = self.order[number].operands
            assert isinstance(item, Number)
            array, start = self.where[self.index[system]]
            return (array, start + int(item.value)), self.level[self.index[system]]
        return self.where.get(number), self.level.get(number, -1)

    def _tree(self, number: int, place: int | None, kept: Mapping[int, None]) -> None:
        node = self.order[number]
        if _is_long(node):
            self._sum(number, place)
            return
        shape = _Shape(self, kept)
        expression = shape.of(number, True)
        count = size_of(node) if node.operator in SYSTEMS else 1
        kernel = self.shapes.kernel(expression, shape.reads, shape.numbers, count)
        self.level[number] = shape.level + 1
        target = self._target(number, place, count)
        self._add(kernel, shape.level + 1, Instance(target, tuple(shape.places), tuple(shape.numbers)))

    def _sum(self, number: int, place: int | None) -> None:
        """A row of terms."""
        terms, level = [], -1
        for node in self.order[number].operands:
            inner = self._negated(node)
            found, before = self._term(node if inner is None else inner)
            terms.append(encoded(found, inner is not None))
            level = max(level, before)
        self.level[number] = level + 1
        self._add(
            self.shapes.kernel(None, (), (), 1), level + 1, Instance(self._target(number, place, 1), tuple(terms), ())
        )

    def _term(self, node: Expression) -> tuple[Place, int]:
        if isinstance(node, Number):
            return ("numbers", self.shapes.place_of(node.value)), -1
        found, level = self._place(node)
        if found is None:  # the time
            assert node == self.shapes.time
            found = ("work", self.work)
            self._add(self.shapes.kernel(node, (), (), 1), 0, Instance(~self.work, (), ()))
            self.work, level = self.work + 1, 0
        return found, level

    def _copy(self, place: int, root: Expression) -> None:
        """Copy a value to its place: a number, an item of an array, or a value computed for another place."""
        shape = _Shape(self, {})
        expression = shape.leaf(root)
        kernel = self.shapes.kernel(expression, shape.reads, shape.numbers, 1)
        self._add(kernel, shape.level + 1, Instance(place, tuple(shape.places), tuple(shape.numbers)))


class _Shape:
    """Shape of one tree, with the operands for its places."""

    def __init__(self, planner: _Planner, kept: Mapping[int, None]) -> None:
        self.planner, self.kept = planner, kept
        self.found: dict[Place, Symbol] = {}
        self.inner: dict[int, Expression] = {}
        self.numbers: list[float] = []
        self.level = -1

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(array for array, _ in self.found)

    @property
    def places(self) -> list[int]:
        return [index for _, index in self.found]

    def of(self, number: int, top: bool = False) -> Expression:
        """An operation of the tree."""
        planner = self.planner
        node = planner.order[number]
        if not top and (number in self.kept or node.operator == "item"):
            return self.leaf(node)
        result = self.inner.get(number)
        if result is None:
            operator, literal = node.operator, node.operator in _LITERAL
            parts: list[Expression] = []
            for i, (operand, at) in enumerate(zip(node.operands, planner.operands[number], strict=True)):
                if at >= 0:
                    parts.append(self.of(at))
                elif isinstance(operand, Number) and (
                    literal
                    or (operator == "multiply" and operand == MINUS_ONE)
                    or (operator == "power" and i == 1)
                    or (operator == "banded" and i < LEADING)
                ):
                    parts.append(operand)
                else:
                    parts.append(self.leaf(operand))
            result = self.inner[number] = Apply(operator, tuple(parts))
        return result

    def leaf(self, node: Expression) -> Expression:
        """Operand of the tree that is already computed."""
        if isinstance(node, Number):
            self.numbers.append(node.value)
            return read("number", len(self.numbers) - 1)
        if node == self.planner.shapes.time:
            return node
        place, level = self.planner._place(node)
        assert place is not None
        if level > self.level:
            self.level = level
        symbol = self.found.get(place)
        if symbol is None:
            symbol = self.found[place] = read(place[0], len(self.found))
        return symbol


def _is_long(node: Apply) -> bool:
    return node.operator == "add" and len(node.operands) > LONG_SUM


@dataclass(frozen=True, slots=True)
class OrderedFunction:
    """Input for the writing of one function."""

    name: str
    roots: Sequence[Expression]
    order: Sequence[Apply]
    known: Mapping[Expression, Place]


def ordered(name: str, roots: Sequence[Expression], known: Mapping[Expression, Place]) -> OrderedFunction:
    """Return a function with the operations behind its roots in an order in which they can be computed."""
    here: dict[Expression, object] = {**known, Symbol(Leaf("time", 0)): ""}
    return OrderedFunction(name, roots, operations_in_order(roots, here), known)


class RolledFunctions:
    """Functions of a module over shared kernels, and their rows one after the other. A target adds the text."""

    def __init__(self, lowered: Lowered, functions: Sequence[OrderedFunction]) -> None:
        self.shapes = KernelCollection(Symbol(Leaf("time", 0)), lowered.labels)
        self.plans: dict[str, KernelSchedule] = {}
        for function in functions:
            self.plans[function.name] = self.shapes.plan(function.roots, function.order, function.known)
        self.streams: list[int] = []
        self.starts: dict[str, int] = {}
        for name, plan in self.plans.items():
            self.starts[name] = len(self.streams)
            self.streams += self.shapes.stream(plan)

    @classmethod
    def of(cls, lowered: Lowered, functions: Sequence[OrderedFunction]) -> Self | None:
        """Return them; None where straight-line code is short or has few equal parts."""
        straight = sum(len(f.order) + len(f.roots) for f in functions)
        rolled = cls(lowered, functions) if straight > LONGEST_IN_LINES else None
        return rolled if rolled is not None and SAVING * rolled.size() < straight else None

    def size(self) -> int:
        """Operations in all shapes."""
        kernels = self.shapes.kernels.values()
        return len(kernels) + sum(len([*operations(k.expression)]) for k in kernels if k.expression is not None)
