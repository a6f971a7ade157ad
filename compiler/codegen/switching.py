"""Jumps and kinks: conditions on time and on states become items of the mode; instants of time are found in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import pi, prod

from ..algebra.derivative import derivative
from ..algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    divide,
    negate,
    operations,
    rebuild,
    select,
    substitute,
)
from ..algebra.formula import Formula
from ..algebra.operators import CONDITIONS, OPERATORS
from ..algebra.systems import SYSTEMS
from ..algebra.table import counted, domain, is_stepped, is_table, jumps_at_knots, last_derivative, lists, table
from ..equations.system import Assignment
from ..errors import CompilationFailed
from ..source import Span
from .dependence import EVENT, INPUT, MODE, PARAMETER, STATE, TIME
from .errors import NoiseOutOfStep
from .events import Count, Located
from .indicators import count_parts, factors_of, indicator, parts_of, rounding, window
from .limits import COMPARISONS, Leaf, is_partial
from .lowered import Lowered
from .program import ConditionNote

HALF = Number(0.5)
FEW_KNOTS = 32  # of a table: each has a kink function of its own; more would cost more than its law
# What a knot may be off the line between its neighbours: of the range of its table, and of that of the three, unless it is rounding of the largest value.
# A smaller one is no step or spike, but the bend of a smooth curve, which the error of a step shows.
ROUGH, ROUGH_HERE, ROUNDED = 1e-4, 0.1, 1e-12
JUMPING = frozenset({"less", "less_equal", "equal", "floor", "ceil", "sign"})
MOST_PIECES = 8  # of a function of time that is affine in pieces


class Switching:
    """Search for jumps and kinks in time.

    A condition on time becomes an item of the mode, which is constant between two instants: a solver that evaluates at the
    end of a step uses the value from before it. Kinks (min, max, abs) only give instants. A condition on states behind the rates is an
    item of the mode too, but its instants are located in the run. Elsewhere, as in an output, it is evaluated where it is used.
    """

    def __init__(self, result: Lowered, first: int) -> None:
        self.result, self.next = result, first  # the next place in the mode
        self.modes: dict[Expression, Expression] = {}
        self.opened: dict[int, Expression] = {}  # items of the mode -> their conditions on time
        self.bends: set[Expression] = set()
        self.places: dict[Expression, int] = {}  # of functions among the crossings
        self._quiet: dict[Formula, bool] = {}
        self.all_quiet = True  # so far no law has jumps or kinks
        self._memories: dict[tuple[bool, bool], dict[Expression, Expression]] = {}
        self.behind = False  # True if the run reads what is treated
        self.located = False  # True if conditions on states become items of the mode
        self.guards: set[Expression] = set()  # conditions that only keep a slope finite: nobody wrote them
        self.authored: set[Expression] = set()  # conditions that a law or an event has itself
        self.partial = False  # True if a condition that is evaluated where it is used may compare what has no value
        self.counts: dict[Expression, Expression] = {}  # located floors and ceilings -> their items of the mode

    def has_nothing_in(self, formula: Formula, arguments: Sequence[Expression]) -> bool:
        """Return True if a law and its arguments, which are treated already, have no jump or kink in time: then nothing is replaced."""
        if formula not in self._quiet:
            self._quiet[formula] = all(
                n.operator in OPERATORS and OPERATORS[n.operator].smooth for n in operations(formula.expression)
            )
        self.all_quiet &= self._quiet[formula]
        return self.all_quiet and not any(self.result.dependence(a) & TIME for a in arguments)

    def at(self, step: Assignment, behind: bool, pieced: bool) -> None:
        """Set the properties of the next expression.

        `behind`: the run reads it, so its conditions on states are located. `pieced`: it is a derivative of another expression or joined
        smoothly from pieces; then its conditions are the author's only if they are known already.
        """
        self.span, self.owner, self.behind, self.pieced = step.span, step.owner, behind, pieced
        self.located = behind and not pieced
        self._done = self._memories.setdefault((behind, pieced), {})

    def wrote(self, conditions: set[Expression]) -> None:
        """Record the author's own conditions. They are no guards, even if derivatives contain them too: `abs(f)` has a kink where a valve closes."""
        self.authored |= conditions
        if self.guards & conditions:
            self.guards -= conditions
            self._memories.clear()
            self._done = self._memories.setdefault((self.behind, self.pieced), {})

    def replaced(self, x: Expression) -> Expression:
        """The expression with conditions on time, and on states if these are located, replaced by items of the mode."""
        done = self._done
        found = done.get(x)
        if found is None:
            bits = self.result.dependence(x)
            found = x if not bits & (TIME | STATE | EVENT) or not isinstance(x, Apply) else self._apply(x)
            if not bits & (TIME | STATE):
                self._note_partial(x)
            done[x] = found
            done[found] = found
        return found

    def _apply(self, x: Apply) -> Expression:
        span, bits = self.span, self.result.dependence(x)
        if not bits & (
            TIME | STATE
        ):  # stored modes alone: constant between two events, but no rounding of terms that cancel counts
            operands = self._unrounded(x.operator, tuple(map(self.replaced, x.operands)))
            return x if operands == x.operands else _rebuilt(x.operator, operands)
        alone = not bits & (INPUT | STATE | EVENT)
        if x.operator in CONDITIONS:
            return self._mode(x, alone)
        if x.operator == "sign" and (alone or self.located or call("less", ZERO, x.operands[0]) in self.modes):
            g = x.operands[0]  # the slope of a law has the sign that the law has: both rest where a mode says zero
            return self.replaced(select(call("less", ZERO, g), ONE, select(call("less", g, ZERO), Number(-1.0), ZERO)))
        operands = tuple(map(self.replaced, x.operands))
        if x.operator in ("floor", "ceil") and (alone or self.located or x in self.counts):
            return self._count(x, operands[0], alone)
        if alone and is_table(x):
            for knot in domain(x):  # kinks of the curve or of one of its derivatives
                self._instant(self.replaced(x.operands[1] - knot))
            if jumps_at_knots(x):
                return self._of_segments(x, operands[1])
        elif self.behind and is_stepped(x):  # also of a rate, which jumps where the curve only bends
            located, self.located = self.located, True
            middle = self._between_knots(x, operands[1])
            self.located = located
            return middle
        if x.operator == "noise":
            self._period(x.operands[1], alone, span)
        if alone and x.operator in OPERATORS and OPERATORS[x.operator].narrow:
            self._centres(x)
        if alone and x.operator in ("min", "max", "abs"):
            g = x.operands[0] if x.operator == "abs" else x.operands[0] - x.operands[1]
            self._instant(self.replaced(g))
        operands = self._unrounded(x.operator, operands)
        found = x if operands == x.operands else _rebuilt(x.operator, operands)
        if self.located and not alone:
            self._bend(x, operands)
        return found

    def _count(self, x: Apply, g: Expression, alone: bool) -> Expression:
        """`floor` or `ceil` of an expression as an item of the mode, so that it is constant between two instants. `g`: its operand, replaced.

        Of states it is found anew where one of two conditions changes, which are both true where `g` is an integer: they tell on which side of
        an integer the last event left `g`, so what rounding makes of `g` beside an integer does not change the number.
        """
        if alone:
            self._integers(g)
            return self._item(substitute(call(x.operator, g), self._opened))
        if x in self.counts:
            return self.counts[x]
        if not self.result.dependence(g) & (TIME | STATE):  # a count of counts
            return call(x.operator, g)
        if x.operator == "ceil":
            self.counts[x] = negate(self.replaced(call("floor", negate(x.operands[0]))))
            return self.counts[x]
        wave = call("sin", Number(pi) * x.operands[0])  # positive from an even integer to the next
        sides = call("less_equal", ZERO, wave), call("less_equal", wave, ZERO)
        self.authored.update(sides)
        even, odd = (self.replaced(side) for side in sides)
        above = 2.0 * call("floor", HALF * (g + HALF))
        below = 1.0 + 2.0 * call("floor", HALF * (g - HALF))
        number = select(call("and", even, odd), call("floor", g + HALF), select(even, above, below))
        self.counts[x] = symbol = self.result.event_symbol(self.next)
        self.result.events.counts.append(Count(symbol, self.next, number))
        self.next += 1
        return symbol

    def _between_knots(self, x: Apply, place: Expression) -> Expression:
        """Derivative of a curve of states that is constant between knots, in the middle of the interval of which the number is an item of the mode."""
        interval = self._count(Apply("floor", (counted(x, x.operands[1]),)), counted(x, place), False)
        knots = domain(x)
        middle = table("linear", interval + HALF, [Number(float(i)) for i in range(len(knots))], knots)
        return _rebuilt(x.operator, (x.operands[0], middle, *x.operands[2:]))

    def _integers(self, g: Expression) -> None:
        """Record the instants at which a function of time is an integer."""
        time = Symbol(Leaf("time", 0))
        slope = derivative(g, time)
        if self.result.dependence(slope) & TIME or self.result.dependence(g) & MODE:
            self._instant(call("sin", Number(pi) * g), "floor")
        elif slope != ZERO:
            pair = substitute(g, lambda s: ZERO if s == time else s), slope
            if pair not in self.result.recurring:
                self.result.recurring.append(pair)

    def _bend(self, x: Apply, operands: tuple[Expression, ...]) -> None:
        """Record a kink of a law of states: no event, but a point at which a step may have to end."""
        if x.operator == "abs":
            kinks = [operands[0]]
        elif x.operator in ("min", "max"):
            kinks = [operands[0] - operands[1]]
        elif x.operator == "linear" and x.operands[0] == ZERO:
            kinks = self._knots(x, operands[1])
        else:
            return
        for g in kinks:
            if self.result.dependence(g) & STATE and g not in self.result.bends:
                self.result.bends.append(g)

    def _knots(self, x: Apply, place: Expression) -> list[Expression]:
        """Zeros at the knots of a table: a function for each knot of a short one, and of a long one for each that is off the line between its neighbours.

        All others of a long one have a function together: what it is between two of them, it is beside them, too.
        """
        places, heights = lists(x)
        if len(places) <= FEW_KNOTS:
            return [place - knot for knot in places]
        rough = [place - places[k] for k in rough_knots(places, heights)]
        return [*rough, call("sin", Number(pi) * counted(x, place))]

    def _parted(self, condition: Apply) -> Expression | None:
        """The condition on a sum with max, min, abs or a choice, or on the sign of a product, as conditions on parts; None for others, and for too many."""
        if not self.located or condition.operator not in ("less", "less_equal") or condition in self.guards:
            return None
        for i, side in enumerate(condition.operands):
            if condition.operands[1 - i] == ZERO and (split := factors_of(side, self._is_fixed, MOST_PIECES)):
                below, above = (
                    [call(condition.operator, *pair) for pair in ((factor, ZERO), (ZERO, factor))] for factor in split
                )
                self.authored.update((*below, *above))
                (a_below, a_above), (b_below, b_above) = (tuple(map(self.replaced, x)) for x in (below, above))
                if i == 1:
                    b_below, b_above = b_above, b_below
                return call("or", call("and", a_below, b_above), call("and", a_above, b_below))
            parts = parts_of(side, self._is_fixed)
            if parts is None or count_parts(side, self._is_fixed, MOST_PIECES) > MOST_PIECES:
                continue
            both = [
                call(condition.operator, *condition.operands[:i], p, *condition.operands[i + 1 :]) for p in parts[:2]
            ]
            self.authored.update(both)
            of_a, of_b = map(self.replaced, both)
            if not self._is_fixed(parts[2]):
                where = self.replaced(parts[2])
                return call("or", call("and", where, of_a), call("and", call("not", where), of_b))
            sign = parts[2] if i == 0 else negate(parts[2])
            every, some = call("and", of_a, of_b), call("or", of_a, of_b)
            if isinstance(sign, Number):
                return every if sign.value > 0 else some
            return call("or", every, call("and", call("less", sign, ZERO), some))
        return None

    def _mode(self, condition: Apply, alone: bool) -> Expression:
        if not alone and condition not in self.modes and (parted := self._parted(condition)) is not None:
            self.modes[condition] = parted
            return parted
        operands = tuple(map(self.replaced, condition.operands))
        if condition in self.modes:
            return self.modes[condition]
        if self.pieced and not alone and condition not in self.authored:
            self.guards.add(condition)
        moves = any(self.result.dependence(operand) & (TIME | STATE) for operand in operands)  # not with counts alone
        locatable = (
            self.located and moves and condition.operator in ("less", "less_equal") and condition not in self.guards
        )
        if condition.operator == "equal" and not alone and self.located and moves and condition not in self.guards:
            both = [call("less_equal", *pair) for pair in (condition.operands, condition.operands[::-1])]
            self.authored.update(both)
            self.modes[condition] = call("and", *map(self.replaced, both))
            return self.modes[condition]
        if condition.operator in ("and", "or", "not") or not (alone or locatable):
            if condition not in self.guards:
                operands = self._unrounded(condition.operator, operands)
                self._note_partial(condition)
            return _rebuilt(condition.operator, operands)
        events, a, b = self.result.events, *condition.operands
        if not alone and (parts := window(operands[0], operands[1], self._is_fixed)) is not None:
            self.modes[condition] = self._within(condition.operator, *parts)
            return self.modes[condition]
        if alone:
            self._instant(self.replaced(a - b), condition.operator)
            self.modes[condition] = Symbol(Leaf("mode", self.next))
            exact = call(condition.operator, *self._unrounded(condition.operator, operands))
            self.opened[self.next] = substitute(exact, self._opened)
            self._note_partial(self.opened[self.next])
            self.result.switches.append(self.opened[self.next])
            events.timed.append(self.next)
        else:
            symbol = self.result.event_symbol(self.next)
            note = ConditionNote(self.next, condition.operator == "less", True, self.owner, self.span)
            self.modes[condition] = symbol
            events.located.append(Located(symbol, indicator(operands[0], operands[1], self._is_fixed), note))
        self.next += 1
        return self.modes[condition]

    def _unrounded(self, operator: str, operands: tuple[Expression, ...]) -> tuple[Expression, ...]:
        """Operands of a function that jumps, and is evaluated where it is used, with zero in place of the rounding of terms that cancel."""
        if self.pieced or operator not in JUMPING:
            return operands
        x = operands[0] - operands[1] if len(operands) > 1 else operands[0]
        if (most := rounding(x, self._is_known)) == ZERO:
            return operands
        if operator in ("floor", "ceil"):
            return (x + (most if operator == "floor" else negate(most)),)
        return (_or_zero(x, most), ZERO) if len(operands) > 1 else (_or_zero(x, most),)

    def stored(self, x: Expression) -> Expression:
        """A new value of an event, with zero in place of the rounding of terms that cancel: later conditions read what is stored as exact."""
        return _or_zero(x, rounding(x, self._is_fixed))

    def _note_partial(self, condition: Expression) -> None:
        """See whether an expression with a condition, evaluated where it is used, may have no value."""
        if not self.partial and not self.pieced:
            nodes = list(operations(condition))
            self.partial = any(n.operator in COMPARISONS for n in nodes) and any(map(is_partial, nodes))

    def _within(self, operator: str, u: Expression, r: Expression, sign: Expression, rest: Expression) -> Expression:
        """The condition of a `window`, with `operator` less or less_equal, as two: each crosses zero straight."""
        sides = [call(operator, sign * u, sign * r), call(operator, negate(sign * r), sign * u)]
        self.authored.update(sides)
        low, high = (self._mode(x, False) if isinstance(x, Apply) else x for x in sides)
        inside, outside = call("and", low, high), call("or", low, high)
        if isinstance(sign, Number):
            return inside if sign.value > 0 else outside
        return call(
            "or",
            call("and", call("less", ZERO, sign), inside),
            call(
                "or",
                call("and", call("less", sign, ZERO), outside),
                call("and", call("equal", sign, ZERO), call(operator, ZERO, rest)),
            ),
        )

    def _is_fixed(self, x: Expression) -> bool:
        """Return True if an expression is constant between two events."""
        return not self.result.dependence(x) & (TIME | STATE)

    def _is_known(self, x: Expression) -> bool:
        """Return True if an expression is constant in a run."""
        return not self.result.dependence(x) & (TIME | STATE | EVENT)

    def _of_segments(self, x: Apply, place: Expression) -> Expression:
        """Derivative of a curve in time that jumps at knots, from two numbers that are constant between instants.

        The numbers are its last derivative and the remainder at zero. At a knot the value is then that of the side that a run comes from.
        """
        last = self._item(last_derivative(x))
        if is_stepped(x):
            return last
        return add(self._item(x - last_derivative(x) * x.operands[1]), last * place)

    def _item(self, number: Expression) -> Expression:
        """An expression of time alone that is constant between two instants, as an item of the mode."""
        if number not in self.modes:
            self.modes[number] = Symbol(Leaf("mode", self.next))
            self.opened[self.next] = number
            self.result.switches.append(number)
            self.result.events.timed.append(self.next)
            self.next += 1
        return self.modes[number]

    def _centres(self, x: Apply) -> None:
        """End a step where an affine argument is zero, so that no narrow pulse `exp(-((time - t0)/w)^2)` is stepped over.

        A product counts only if it has several such factors, as `(time - t0)*(time - t0)`.
        """
        operands = [o for o in x.operands if self.result.dependence(o) & TIME]
        if x.operator == "multiply" and len(operands) < 2:
            return
        for g in operands:
            if self._is_affine(g, {}):
                self._instant(self.replaced(g))

    def _is_affine(self, x: Expression, known: dict[Expression, bool]) -> bool:
        """Return True if the form of an expression that depends on time shows that it is affine in time."""
        if not isinstance(x, Apply):
            return True
        if x not in known:
            moving = [o for o in x.operands if self.result.dependence(o) & TIME]
            linear = x.operator == "add" or (
                len(moving) == 1
                and (x.operator == "multiply" or (x.operator == "divide" and moving[0] is x.operands[0]))
            )
            known[x] = linear and all(self._is_affine(o, known) for o in moving)
        return known[x]

    def _pieces(self, x: Expression, known: dict[Expression, tuple[Expression, ...]]) -> tuple[Expression, ...]:
        """Affine functions of time of which an expression is one at each instant, as `max(time/T, 0) - 1` is; empty if it is another, or of too many."""
        if not isinstance(x, Apply) or not self.result.dependence(x) & TIME or self._is_affine(x, {}):
            return (x,)
        if x not in known:
            choices = [self._pieces(o, known) for o in x.operands]
            moving = [o for o in x.operands if self.result.dependence(o) & TIME]
            linear = x.operator == "add" or (x.operator == "multiply" and len(moving) == 1)
            every: list[Expression] = []
            if x.operator in ("min", "max") and all(choices):
                every = [piece for pieces in choices for piece in pieces]
            elif (linear or (x.operator == "divide" and moving == [x.operands[0]])) and prod(
                map(len, choices)
            ) <= MOST_PIECES:
                every = [_rebuilt(x.operator, operands) for operands in product(*choices)]
            known[x] = tuple(dict.fromkeys(every)) if len(every) <= MOST_PIECES else ()
        return known[x]

    def _opened(self, symbol: Symbol) -> Expression:
        """Condition behind an item of the mode: the mode can then be computed from time alone."""
        leaf: Leaf = symbol.key
        return self.opened[leaf.position] if leaf.role == "mode" else symbol

    def _period(self, place: Expression, alone: bool, span: Span) -> None:
        """Limit the step to one integer of the argument of a noise.

        If the argument also depends on states, only its rate in time is known before the run.
        """
        slope = derivative(place, Symbol(Leaf("time", 0)))
        if self.result.dependence(slope) & ~PARAMETER:
            if alone:
                raise CompilationFailed([NoiseOutOfStep(span)])
            return
        period = divide(ONE, call("abs", slope))
        if slope != ZERO and period not in self.result.periods:
            self.result.periods.append(period)

    def _instant(self, g: Expression, condition: str = "") -> None:
        """Record the zeros of a function of time: in closed form if it is affine, else as a crossing that the run searches for.

        `condition`: operator whose truth changes there; its owner is recorded, for a warning if zeros may be missed.
        """
        if condition and g in self.places:
            self.result.crossing_places[self.places[g]] = self.owner, self.span, condition
        if g in self.bends or not self.result.dependence(g) & TIME:
            return
        self.bends.add(g)
        if not condition and not self.result.dependence(g) & MODE and len(pieces := self._pieces(g, {})) > 1:
            for piece in pieces:
                self._instant(piece)
            return
        time = Symbol(Leaf("time", 0))
        slope = derivative(g, time)
        formula = not (self.result.dependence(slope) & TIME or self.result.dependence(g) & MODE)
        if formula and condition != "equal":  # an event on equality is reported
            if slope != ZERO:
                at_zero = substitute(g, lambda s: ZERO if s == time else s)
                self.result.instants.append(negate(divide(at_zero, slope)))
            return
        self.result.crossings.append(g)
        self.places[g] = len(self.result.crossing_places)
        self.result.crossing_places.append((self.owner, self.span, condition))


def rough_knots(places: Sequence[Expression], heights: Sequence[Expression]) -> list[int]:
    """Numbers of the knots of a table that are off the line between their neighbours, and of those of which it is not known."""
    numbers = [
        (p.value, h.value)
        for p, h in zip(places, heights, strict=True)
        if isinstance(p, Number) and isinstance(h, Number)
    ]
    if len(numbers) < len(places):
        return list(range(len(places)))
    highest, lowest = max(h for _, h in numbers), min(h for _, h in numbers)
    most, rounded = ROUGH * (highest - lowest), ROUNDED * max(abs(highest), abs(lowest))
    off = [
        abs(b - a - (c - a) * (q - p) / (r - p)) > max(rounded, min(most, ROUGH_HERE * (max(a, b, c) - min(a, b, c))))
        for (p, a), (q, b), (r, c) in zip(numbers, numbers[1:], numbers[2:], strict=False)
    ]
    return [k + 1 for k, is_off in enumerate(off) if is_off]


def _rebuilt(operator: str, operands: tuple[Expression, ...]) -> Expression:
    return Apply(operator, operands) if operator in SYSTEMS or operator == "item" else rebuild(operator, operands)


def _or_zero(x: Expression, most: Expression) -> Expression:
    return x if most == ZERO else select(call("less", call("abs", x), most), ZERO, x)
