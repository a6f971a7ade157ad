"""Peaks of laws of states: operations that a law may do within a small part of a step alone, such as a bell, or what is between two kinks.

Each is a pair of a place and a value. A place is a function that is smooth however narrow the law is, as the argument of a bell without its exponential;
a peak is where it is zero or turns along a motion. A value is the operation that may be narrow there.
Steps (tanh, a logistic function) and kinks show in the error of a step. They have peaks where several of the same states are joined, or one is folded.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping

from ..algebra.derivative import NotDifferentiable, derivative
from ..algebra.expression import ONE, ZERO, Apply, Expression, Number, Symbol, divide, negate, never_negative, symbols
from ..algebra.operators import CONDITIONS, OPERATORS
from ..algebra.systems import SYSTEMS
from ..algebra.table import lists
from .limits import Leaf
from .switching import rough_knots
from .tape import operands_first

Places = tuple[Expression, ...]
STEPS = frozenset({"tanh", "atan", "erf"})
TABLES = frozenset({"linear", "cubic", "monotone"})
MONOTONE = frozenset({"add", "multiply", "divide", "power", "min", "max"})  # in one operand
POLYNOMIAL = frozenset({"add", "multiply", "divide", "power"})
OPAQUE = CONDITIONS | SYSTEMS | {"item"}
MOST = 8  # places of one operation
LARGE = 100  # operations, from which on a function is one of a mechanism rather than a law, and its slope costs more than it tells


class Peaks:
    """Search for peaks in operations, operands first. `moves` returns True for what changes within a step; `rates`: of symbols that have one."""

    def __init__(self, moves: Callable[[Expression], bool], rates: Mapping[Symbol, Expression]) -> None:
        self.moves, self.rates = moves, rates
        self.pairs: dict[tuple[Expression, Expression], None] = {}  # places and values
        self.affine: set[Expression] = set()
        self.steps: dict[Expression, Places] = {}  # operations with steps or kinks -> where
        self.folded: set[Expression] = set()  # of them those that are values already
        self.exponentials: dict[Expression, Places] = {}  # sums and products of them, which are steps in denominators
        # of arguments: quotients of a mechanism share their denominators
        self.places: dict[Expression, tuple[Places, int]] = {}
        self.slopes = defaultdict[Symbol, dict[Expression, Expression]](dict)

    def read(self, node: Expression) -> None:
        """Read an operation whose operands have been read."""
        if isinstance(node, Symbol):
            self.affine.add(node)
        if not isinstance(node, Apply) or node.operator in OPAQUE:
            return
        moving = [o for o in node.operands if self.moves(o)]
        proportional = node.operator == "multiply" or (node.operator == "divide" and moving == [node.operands[0]])
        linear = node.operator == "add" or (len(moving) == 1 and proportional)
        if not moving or (linear and all(o in self.affine for o in moving)):
            self.affine.add(node)
            return
        match node:
            case Apply(operator="exp"):
                places, turns = self.places_of(moving[0])
                if turns:
                    self._put(places, node)
                else:
                    self.exponentials[node] = places
            case Apply(operator=operator, operands=(x,)) if operator in STEPS:
                places, turns = self.places_of(x)
                self.steps[node] = places if turns == 2 else (x,)
                if turns == 2:
                    self._put(places, node)
            case Apply(operator=operator, operands=(order, at, *_)) if operator in TABLES and order == ZERO:
                places, heights, *_ = lists(node)
                self._put((at - places[k] for k in rough_knots(places, heights)), node)
            case Apply(operator="divide", operands=(_, below)) if below in moving:
                self._read_inverse(node, below, divide(ONE, below), moving)
            case Apply(operator="power", operands=(base, Number(n))) if n < 0:
                self._read_inverse(node, base, node, moving)
            case Apply(operator="abs", operands=(x,)):
                self._join(node, moving, linear, (x,))
            case Apply(operator="min" | "max", operands=(a, b)):
                self._join(node, moving, linear, (a - b,))
            case _:
                self._join(node, moving, linear)

    def places_of(self, x: Expression) -> tuple[Places, int]:
        """Return functions that are zero or turn where an argument turns, and 2 if that is a square or a sum of them, 1 if it turns for another reason.

        Monotone functions around it are left out: they may be as narrow as the law. An argument that does not turn is returned with 0.
        """
        if x not in self.places:
            self.places[x] = self._places_of(x)
        return self.places[x]

    def _places_of(self, x: Expression) -> tuple[Places, int]:
        while isinstance(x, Apply) and x not in self.affine:
            moving = [o for o in x.operands if self.moves(o)]
            squared = x.operator == "multiply" and len(moving) == 2 and moving[0] in (moving[1], negate(moving[1]))
            if squared or (len(moving) == 1 and _is_even(x)):
                return (moving[0], *self._slope(moving[0])[0]), 2
            rises = x.operator in OPERATORS and OPERATORS[x.operator].course in ("rising", "falling")
            if len(moving) != 1 or not (rises or x.operator in MONOTONE):
                waves = x.operator in ("sin", "cos") or any(
                    self.places_of(o)[1] == 2 for o in moving if x.operator == "add"
                )
                slopes, bends = self._slope(x)
                wide = not (waves or bends) or not self._is_small_polynomial(x)
                return slopes or (x,), int(waves or bends) if wide and not never_negative(x) else 2
            x = moving[0]
        return (x,), 0

    def _slope(self, x: Expression) -> tuple[Places, bool]:
        """Return the slope of a function along a motion, which crosses zero where the function only touches a value, and True if it may turn.

        By its only symbol, or with the rates of all of them: these may be as narrow as the law, so the function itself counts, too.
        """
        if x in self.affine or _is_large(x):
            return (), False
        names = [s for s in symbols(x) if self.moves(s) or s in self.rates]
        try:
            slopes = [derivative(x, s, self.slopes[s]) for s in names]
        except NotDifferentiable:
            return (), False
        if len(names) == 1 or not all(s in self.rates for s in names):
            bends = len(names) == 1 and self.moves(slopes[0])
            return tuple(slopes) if bends else (), bends
        return (x, sum((slope * self.rates[s] for slope, s in zip(slopes, names, strict=True)), ZERO)), False

    def _is_small_polynomial(self, x: Expression) -> bool:
        """Return True for a polynomial of one or two moving symbols: what mechanisms divide by has waves, or is of more, and is no narrow law."""
        if sum(self.moves(s) for s in symbols(x)) > 2 or _is_large(x):
            return False
        waiting = [x]
        while waiting:
            node = waiting.pop()
            if isinstance(node, Apply) and self.moves(node):
                if node.operator not in POLYNOMIAL:
                    return False
                waiting += node.operands
        return True

    def _put(self, places: Iterable[Expression], value: Expression) -> None:
        self.pairs |= dict.fromkeys((place, value) for place in places)

    def _read_inverse(self, node: Apply, below: Expression, value: Expression, moving: list[Expression]) -> None:
        """A quotient: a peak where its denominator is least, a step where that is a sum of exponentials."""
        if below in self.exponentials:
            self.steps[node] = self.exponentials[below]
            self._put(self.exponentials[below], node)
            return
        places, turns = self.places_of(below)
        if turns == 2:
            self._put(places, value)
        self._join(node, moving, False)

    def _join(self, node: Apply, moving: list[Expression], linear: bool, kinks: Places = ()) -> None:
        """An operation that joins steps of the same states, or folds one, may have a peak where each of them is."""
        carried = [self.steps[o] for o in moving if o in self.steps]
        raised = [self.exponentials[o] for o in moving if o in self.exponentials]
        if (
            raised
            and (linear or node.operator in ("multiply", "power"))
            and not set(_joined(carried)) & set(_joined(raised))
        ):
            self.exponentials[node] = _joined(raised)
        else:
            carried += raised
        if carried or kinks:
            self.steps[node] = _joined([*carried, kinks])
        if len(carried) > 1:
            every = _joined(carried)
            of = [frozenset(symbols(place)) for place in every]
            one = len(of) == 1 and node.operator != "add"
            self._put((p for p, names in zip(every, of, strict=True) if one or of.count(names) > 1), node)
        elif carried and not linear and node.operator not in ("multiply", "select"):
            if not all(o in self.folded for o in moving if o in self.steps):
                self._put(self.steps[node], node)
            self.folded.add(node)


def _joined(parts: Iterable[Places]) -> Places:
    return tuple(dict.fromkeys(place for places in parts for place in places))[:MOST]


def _is_even(x: Apply) -> bool:
    """Return True for a cosh, an absolute value, and an even power of what may be negative."""
    if x.operator == "power":
        return isinstance(n := x.operands[1], Number) and n.value % 2 == 0 and not never_negative(x.operands[0])
    return x.operator in ("cosh", "abs")


def _is_large(x: Expression) -> bool:
    waiting, seen = [x], set[Expression]()
    while waiting and len(seen) <= LARGE:
        node = waiting.pop()
        if node not in seen:
            seen.add(node)
            waiting += node.operands if isinstance(node, Apply) else ()
    return len(seen) > LARGE


def peaks(rates: Iterable[Expression], states: int, moves: Callable[[Expression], bool]) -> Places:
    """Return the places of all peaks behind rates, of some states and then residuals, and then the values there."""
    roots = tuple(rates)
    known = {Symbol(Leaf("state", i)): rate for i, rate in enumerate(roots[:states])}
    search = Peaks(moves, {Symbol(Leaf("time", 0)): ONE, **known})
    for node in operands_first(roots, {}):
        search.read(node)
    return (*(place for place, _ in search.pairs), *(value for _, value in search.pairs))
