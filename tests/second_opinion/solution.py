"""A run of a system: Radau IIA of three stages with equal steps, Newton, and events found by looking at the truth of conditions.

Steps are halved for Richardson's estimate; at a change of a branch the step is cut, by bisection on whole steps, just behind the change. After each event
a tiny implicit Euler step carries the state over: it lets impulses pass where junctions tie storages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs, qr, solve_triangular

from tests.second_opinion.assembly import Assembly, System, stored_law
from tests.second_opinion.linkage import Linkage
from tests.second_opinion.shares import admissible
from tests.second_opinion.writer import COMPLEX, Writer, function

Array = Any
ROOT6 = math.sqrt(6.0)
NODES = np.array([(4 - ROOT6) / 10, (4 + ROOT6) / 10, 1.0])
COEFFICIENTS = np.array(
    [
        [(88 - 7 * ROOT6) / 360, (296 - 169 * ROOT6) / 1800, (-2 + 3 * ROOT6) / 225],
        [(296 + 169 * ROOT6) / 1800, (88 + 7 * ROOT6) / 360, (-2 - 3 * ROOT6) / 225],
        [(16 - ROOT6) / 36, (16 + ROOT6) / 36, 1 / 9],
    ]
)  # Hairer and Wanner, Solving Ordinary Differential Equations II, table IV.5.6
FROM_0 = np.array([0.0, *NODES])
EULER = (np.array([1.0]), np.array([[1.0]]))
RADAU = (NODES, COEFFICIENTS)
TINY = 1e-40  # complex step
BEHIND = 1e-10  # of the span: how far behind a change of a branch a step ends
PEEK = 1e-6  # of the span: a step that only looks
INSTANT = 1e-9  # of the span: the Euler step behind an event
LOOKS = tuple(i / 8 for i in range(1, 8))  # where within a step the branches are looked at
UNSURE = 12  # turns at one instant, after which what is zero but for rounding is looked at a little later
COARSEST = 16  # steps
NAUGHT = 1e-25  # of the largest number: a gap that is less has no sign but that of rounding, and counts as none
AT_NAUGHT = {"less": 0.0, "less_equal": 1.0, "equal": 1.0, "sign": 0.0, "abs": 1.0, "min": 1.0, "max": 1.0, "floor": 0.0, "ceil": 0.0}  # fmt: skip
SWEEPS = 20  # over rows and columns, for their scales
MOST = 400  # events
PILED = 8  # intervals of an event that shrink, to a ten-thousandth of the span: the next ones have no end
CERTAIN = 4  # of order five, halved steps are 31 times better; where constraints hold the order is lower, and so much is believed
getrf, getrs = get_lapack_funcs(("getrf", "getrs"), (np.zeros((1, 1)),))


def _weights(nodes: Array, places: Any) -> Array:
    """Lagrange's weights of values at nodes for the polynomial at places; shape (places, nodes)."""
    found: Array = (np.asarray(places)[..., None] ** np.arange(len(nodes))) @ BASES[len(nodes)]
    return found


BASES = {len(nodes): np.linalg.inv(np.vander(nodes, increasing=True)) for nodes in (NODES, FROM_0)}
AT_0 = _weights(NODES, 0.0)
LOOK_STATES, LOOK_UNKNOWNS = _weights(FROM_0, LOOKS), _weights(NODES, LOOKS)


class Undecided(Exception):
    """The second opinion has no answer; the text is the reason."""


@dataclass
class Run:
    """The state of a run."""

    system: System
    span: float
    t: float
    x: Array
    w: Array
    m: list[float]
    b: list[float]
    events: list[tuple[float, int]] = field(default_factory=list)
    true: list[bool] = field(default_factory=list)
    ticks: list[int] = field(default_factory=list)  # sampled events that act at the start
    factors: dict[Any, Any] = field(default_factory=dict)
    jacobian: Any = None
    count: int = 0
    budget: int = 200_000  # iterations of Newton's method
    largest: Any = 0.0
    end: float = math.inf  # of the run
    before: tuple[float, Array, Array] | None = None  # the last step's begin
    weights: Any = 1.0  # how readily an impulse moves each state
    blur: float = 1.0  # of `INSTANT` and `BEHIND`: what depends on it is not certain
    fresh: float = math.nan  # when branches changed last
    parts: int = 1  # of the first step behind that: an error of it that two runs have alike would not be seen

    @property
    def peek(self) -> float:
        """Length of a trial step, relative to the span. Index three needs a longer one: rounding counts by its inverse, squared."""
        return 1e-3 if self.system.assembly.linkages else PEEK

    @property
    def instant(self) -> float:
        """Length of the Euler step behind an event."""
        return self.blur * INSTANT * self.span

    # ------------------------------------------------------------ Newton
    def linearized(self, t: float, x: Array, w: Array) -> Array:
        """The slopes of rates and residuals by x and w, by complex steps in all directions at once."""
        n, here = len(x), np.concatenate([x, w])
        steps = list(here[:, None] + 1j * TINY * np.eye(len(here)))
        rates, residuals = self.system.complex_derivative(t, steps[:n], steps[n:], self.m, self.b)
        jac = np.zeros((len(here), len(here)))
        for row, value in zip(jac, (*rates, *residuals), strict=True):
            row[:] = np.imag(value)
        if not np.isfinite(jac).all():
            raise ArithmeticError("no slope")
        return jac / TINY

    def factored(self, h: float, method: Any) -> Any:
        """The Newton matrix of a step, in equilibrated unknowns; that of a step as long to a thousandth is as good."""
        key = (f"{h:.3e}", len(method[0]))
        if key not in self.factors:
            jac, n = self.jacobian, len(self.x)
            s, size = len(method[0]), len(jac)
            blocks = np.zeros((s, size, s, size))
            slopes = np.reshape(self.weights * np.ones(n), (n, 1)) * jac[:n]
            blocks[:, :n] = -h * method[1][:, None, :, None] * slopes[None, :, None, :]
            for i in range(s):
                blocks[i, :n, i, :n] += np.eye(n)
                blocks[i, n:, i] = jac[n:]
            matrix = blocks.reshape(s * size, s * size)
            for scales in (_means, _largest):  # what is singular is shared out by the largest entries
                rows, columns = (np.tile(side, s) for side in scales(np.abs(blocks[-1, :, -1])))
                scaled = rows[:, None] * matrix * columns
                lu, pivots, _ = getrf(scaled)
                if np.abs(np.diag(lu)).min(initial=1.0) > 1e-13:
                    self.factors[key] = (lambda rest, lu=lu, pivots=pivots: getrs(lu, pivots, rest)[0], rows, columns)
                    break
            else:  # something is not determined, or said twice
                self.factors[key] = (_least(scaled).__matmul__, rows, columns)
        return self.factors[key]

    def renewed(self, x: Array, w: Array, t: float) -> None:
        self.jacobian = self.linearized(t, x, w)
        self.factors.clear()

    def step(self, h: float, method: Any = RADAU) -> tuple[Array, Array]:
        """States and unknowns at the stages of one step; shapes (stages, n), (stages, k)."""
        for attempt in range(3):
            try:
                if self.jacobian is None or attempt:
                    self.renewed(self.x, self.w, self.t)
                found = self._newton(h, method, self._guess(h, method, attempt), patient=attempt == 2)
            except (ArithmeticError, ValueError):
                continue
            if found is not None:
                if method is RADAU:
                    self.path = (self.t, h, np.vstack([self.x, found[0]]), found[1])
                return found
        self.jacobian = None
        raise Undecided("Newton's method does not converge")

    def _guess(self, h: float, method: Any, attempt: int) -> Array:
        """Stages as the polynomials of the step before have them, or as it is now."""
        if self.path is None or attempt or method is not RADAU or not 1e-2 < h / self.path[1] < 10:
            return np.tile(np.concatenate([self.x, self.w]), (len(method[0]), 1))
        begin, length, states, unknowns = self.path
        places = (self.t - begin + NODES * h) / length
        return np.hstack([_weights(FROM_0, places) @ states, _weights(NODES, places) @ unknowns])

    def _newton(self, h: float, method: Any, y: Array, patient: bool) -> tuple[Array, Array] | None:
        """Simplified Newton iterations; patient ones look at the slopes each time, and never go where a law has no value."""
        (s, size), n = y.shape, len(self.x)
        before, rest = math.inf, self._rest(h, method, y)
        for turn in range(400 if patient else 30):
            if patient and turn:
                self.renewed(y[-1, :n], y[-1, n:], self.t + h)
            solve, rows, columns = self.factored(h, method)
            change = solve(rows * rest)
            now = float(np.abs(change).max(initial=0.0))
            share = 1.0
            while True:
                trial = y - share * (columns * change).reshape(s, size)
                try:
                    rest = self._rest(h, method, trial)
                    break
                except (ArithmeticError, ValueError):
                    if not patient or share < 1e-6:
                        return None
                share *= 0.5
            y = trial
            scale = float(np.abs(y.ravel() / columns).max(initial=0.0))
            self.count += 1
            if self.count > self.budget:
                raise Undecided("very many iterations")
            done = now <= 1e-12 * scale or now == 0.0
            if share == 1.0 and (done or (now >= 0.5 * before and now <= 1e-8 * scale and turn > 1)):
                return y[:, :n], y[:, n:]
            if turn > 3 and now > 0.9 * before and not patient:
                return None
            before = now
        return None

    def _rest(self, h: float, method: Any, y: Array) -> Array:
        """Residual of the equations of all stages. Raises ArithmeticError or ValueError if a law has no value."""
        nodes, a = method
        s, n = len(nodes), len(self.x)
        values = [
            self.system.derivative(self.t + c * h, v[:n], v[n:], self.m, self.b)
            for c, v in zip(nodes, y.tolist(), strict=True)
        ]
        rates = np.array([v[0] for v in values], dtype=float).reshape(s, n)
        residuals = np.array([v[1] for v in values], dtype=float).reshape(s, -1)
        rest = np.concatenate([y[:, :n] - self.x - h * (a @ rates) * self.weights, residuals], 1)
        if not np.isfinite(rest).all():
            raise ArithmeticError("no number")
        return rest.ravel()

    # ------------------------------------------------------------ what happens
    def looked(self, t: float, x: Array, w: Array) -> tuple[list[float], list[float]]:
        try:
            branches, gaps = self.system.watch(t, x.tolist(), w.tolist(), self.m, self.b)
        except (ArithmeticError, ValueError):
            raise Undecided("a law without a value") from None
        nothing = NAUGHT * max(np.abs(x).max(initial=0.0), np.abs(w).max(initial=0.0))
        naught = [
            AT_NAUGHT[o] if abs(g) <= nothing else b
            for o, b, g in zip(self.system.operators, branches, gaps, strict=True)
        ]
        return naught, gaps

    def settle(self) -> None:
        """The instant behind a change: branches, junctions and events until nothing changes any more.

        Where junctions switched or storages were set, an implicit Euler step lets impulses pass; else a tiny step only looks.
        """
        self.jacobian, impulse, was_set = None, False, False
        for turn in range(60):
            self.path = None
            if impulse:
                xs, ws = self.step(self.instant, EULER)
                x, w = xs[-1], ws[-1]
                if was_set:
                    self._check_jump(x)
                    was_set = False
            else:
                xs, ws = self.step(self.peek * self.span)
                x, w = (self.x, AT_0 @ ws) if turn < UNSURE else (xs[-1], ws[-1])
            branches, _ = self.looked(self.t, x, w)
            if branches != self.b:
                self.b, self.jacobian, self.w = branches, None, w
                continue
            truth, on = self.system.conditions(self.t, x.tolist(), w.tolist(), self.m, self.b)
            modes = len(self.m) - len(on)
            if [float(v) for v in on] != self.m[modes:]:
                self.m[modes:] = [float(v) for v in on]
                self.jacobian, self.w, impulse = None, w, True
                continue
            if impulse:  # it passes before anything is read: an effort within this step is the impulse over its length
                self.x, self.w, impulse = x.copy(), w, False
                self.t += self.instant
                continue
            acting = [i for i, v in enumerate(truth) if v and not self.true[i]]
            if acting and (other := admissible(self, self.x, w, self.before)) is not None:
                w, self.b = other
                truth, acting = self.system.conditions(self.t, self.x.tolist(), w.tolist(), self.m, self.b)[0], []
                self.before = self.jacobian = None
            self.true = [bool(v) for v in truth]
            self.w = w
            self.fresh = self.t
            acting, self.ticks = [*acting, *self.ticks], []
            if not acting:
                return
            self.jacobian = None
            impulse = was_set = self.act(acting)
        raise Undecided("events without end at one instant")

    def _check_jump(self, x: Array) -> None:
        """Before a junction switches, only variables that an event sets may jump.

        Otherwise the event would change other variables too, in one of several possible ways.
        """
        size = np.maximum(np.maximum(np.abs(x), np.abs(self.x)), self.largest)
        most = 1e-4 * size + 1e-12 * size.max(initial=0.0) + 1e-300
        if (np.abs(x - self.x) > most).any():
            twice = self.step(2 * self.instant, EULER)[0][-1]  # what grows with the length of the step is no jump
            if (np.abs(2 * x - twice - self.x) > most).any():
                raise Undecided("an event sets what follows from other states")

    def act(self, acting: Sequence[int], late: Sequence[tuple[Any, float]] = ()) -> bool:
        """Do the assignments of events, and those that samples have computed before. Return True if a storage is among the targets."""
        values: list[tuple[Any, float]] = [*late]
        for i in acting:
            values += self._at_once(i) if self.system.assembly.graph.events[i].sampling is None else self.lines(i)
            self.events.append((self.t, i))
            apart = np.diff([t for t, j in self.events if j == i])[-PILED:]
            if len(apart) == PILED and (np.diff(apart) < 0).all() and apart[-1] < 1e-4 * self.span:
                raise Undecided("events that accumulate")
        for action, value in values:
            if action.kind == "m":
                self.m[action.number] = float(value)
            else:
                self.x[action.number] = (
                    value
                    if action.law is None
                    else solved(self.system.assembly, action.law, value, self.x[action.number])
                )
        if len(self.events) > MOST:
            raise Undecided("very many events")
        return any(action.kind == "x" for action, _ in values)

    def _at_once(self, event: int) -> list[tuple[Any, float]]:
        """The assignments of a `when`: all values are read before any is set."""
        numbers = self.system.action_values[event](self.t, self.x.tolist(), self.w.tolist(), self.m)
        return list(zip(self.system.actions[event], numbers, strict=True))

    def lines(self, event: int) -> list[tuple[Any, float]]:
        """The assignments of an `every`, one after the other: a line reads the modes that the lines before it have set."""
        modes, actions = [*self.m], self.system.actions[event]
        if len(actions) > 1 and any(action.kind == "x" for action in actions):
            raise Undecided("lines of a sampled event that set a storage")
        done: dict[int, tuple[Any, float]] = {}
        spans = [action.span for action in self.system.assembly.graph.events[event].actions]
        for place, action in enumerate(actions):
            if not place or spans[place] != spans[place - 1]:  # the items of a list are set together
                for number, (_, value) in done.items():
                    modes[number] = value
                values = self.system.action_values[event](self.t, self.x.tolist(), self.w.tolist(), modes)
            done[action.number] = action, float(values[place])
        return list(done.values())

    def advance(self, h: float) -> None:
        """A step of this length, cut where a branch changes. Behind such a change, runs of halved steps have a first step that is halved too."""
        end = self.t + h
        while end - self.t > 2 * self.instant:
            h = (end - self.t) / (self.parts if self.t == self.fresh else 1)
            self.before = self.t, self.x, self.w
            try:
                xs, ws = self.step(h)
                if (theta := self._changed(h, xs, ws)) is not None:
                    self._cut(h, theta)
            except Undecided:
                if h < 1e-6 * self.span:
                    raise
                self.advance(h / 2)
                continue
            if theta is None:
                self.t, self.x, self.w = self.t + h, xs[-1], ws[-1]
                self.largest = np.maximum(self.largest, np.abs(self.x))
                continue
            self.settle()
            self.cuts += 1
            if self.cuts > MOST:
                raise Undecided("very many changes of branches")
        self.t = end if abs(end - self.t) < 1e-15 * self.span else self.t

    cuts: int = 0
    path: Any = None  # of the step before: begin, length, states at its begin and stages, unknowns at stages

    def _changed(self, h: float, xs: Array, ws: Array) -> tuple[float, float] | None:
        """Between which places in the step a branch changes first, by the polynomial through the stages."""
        if not self.b:
            return None
        states, last = np.vstack([self.x, xs]), self.looked(self.t + h, xs[-1], ws[-1])[0]
        before = 0.0
        for place, x, w in zip(LOOKS, LOOK_STATES @ states, LOOK_UNKNOWNS @ ws, strict=True):
            if self._differs(self.t + place * h, x, w):
                return before, place
            before = place
        return (before, 1.0) if last != self.b else None

    def _differs(self, t: float, x: Array, w: Array) -> bool:
        try:
            return self.looked(t, x, w)[0] != self.b
        except Undecided:
            return False

    def _cut(self, h: float, bracket: tuple[float, float]) -> None:
        """Go just behind the change of a branch: by the polynomial, then by whole steps."""
        _, _, states, unknowns = self.path

        def drawn(place: float) -> Look:
            x, w = _weights(FROM_0, place) @ states, _weights(NODES, place) @ unknowns
            try:
                branches, gaps = self.looked(self.t + place * h, x, w)
            except Undecided:
                branches, gaps = self.b, [math.nan] * len(self.b)
            return Look(place, x, w, branches, np.array(gaps))

        def gone(place: float) -> Look:
            xs, ws = self.step(place * h)
            branches, gaps = self.looked(self.t + place * h, xs[-1], ws[-1])
            return Look(place, xs[-1], ws[-1], branches, np.array(gaps))

        ends = [drawn(place) for place in bracket]
        rate = (ends[1].gaps - ends[0].gaps) / (bracket[1] - bracket[0])
        *ends, rate = self._narrowed(drawn, *ends, 0.5 * sum(bracket), rate, 1e-7)
        bounds = replace(ends[0], place=0.0), replace(ends[1], place=bracket[1])
        low, high, _ = self._narrowed(gone, *bounds, ends[1].place, rate, self.blur * BEHIND * self.span / h)
        there = low if high is bounds[1] else high  # the polynomial was wrong where all is as before
        self.t, self.jacobian = self.t + there.place * h, None
        self.x, self.w = there.x, there.w
        self.b = self.looked(self.t, self.x, self.w)[0]

    def _narrowed(
        self, look: Any, low: Look, high: Look, guess: float, rate: Array, width: float
    ) -> tuple[Look, Look, Array]:
        """The looks before and behind the change of a branch, no further apart than `width`, and the rates of gaps: by their secants, or halfway."""
        near, last, sizes = 0.4 * width, None, [math.inf] * 3
        for _ in range(60):
            here = look(guess)
            behind = here.branches != self.b
            low, high = (low, here) if behind else (here, high)
            if last is not None:
                rate = (here.gaps - last.gaps) / (here.place - last.place)
            last = here
            sizes.append(high.place - low.place)
            if sizes[-1] <= width:
                break
            guess = 0.5 * (low.place + high.place)
            roots = (here.place - here.gaps / rate)[np.not_equal(high.branches, self.b)]
            roots = roots[(low.place - near <= roots) & (roots <= high.place + near)]
            if len(roots) and sizes[-1] < 0.1 * sizes[-4]:
                root = roots.min() + (-near if behind else near)
                guess = min(max(root, low.place + 0.5 * near), high.place - 0.5 * near)
        return low, high, rate


@dataclass
class Look:
    """A look at the branches within a step: the place in it, state and unknowns there, the branches and their indicators."""

    place: float
    x: Array
    w: Array
    branches: list[float]
    gaps: Array


def _least(matrix: Array) -> Array:
    """The inverse of what is not singular: the shortest answer to what can be answered, by two orthogonal decompositions."""
    left, upper, order = qr(matrix, pivoting=True)
    sizes = np.abs(np.diag(upper))
    rank = int((sizes > 1e-14 * sizes.max(initial=0.0)).sum())
    right, lower = qr(upper[:rank].T, mode="economic")
    found = np.empty_like(matrix)
    found[order] = right @ solve_triangular(lower, left[:, :rank].T, trans="T")
    return found


def _means(matrix: Array) -> tuple[Array, Array]:
    """Scales of rows and columns: geometric means of what is not zero, so that units of any size give one matrix; then the largest of each row is one."""
    there = matrix > 0
    logs, ones = np.log(np.where(there, matrix, 1.0)), there.astype(float)
    totals, counts = (logs.sum(axis=1), logs.sum(axis=0)), [np.maximum(ones.sum(axis=i), 1) for i in (1, 0)]
    columns = np.zeros(len(matrix))
    for _ in range(SWEEPS):
        rows = -(totals[0] + ones @ columns) / counts[0]
        columns = -(totals[1] + rows @ ones) / counts[1]
    largest = np.where(there, logs + rows[:, None] + columns, -np.inf).max(axis=1, initial=-np.inf)
    return np.exp(rows - np.where(np.isfinite(largest), largest, 0.0)), np.exp(columns)


def _largest(matrix: Array) -> tuple[Array, Array]:
    """Scales of rows and columns by their largest entries, in a few sweeps."""
    scaled, rows, columns = matrix.copy(), np.ones(len(matrix)), np.ones(len(matrix))
    for _ in range(3):
        for axis, factors in ((1, rows), (0, columns)):
            share = np.sqrt(np.where((most := scaled.max(axis=axis, initial=0.0)) == 0, 1.0, most))
            factors /= share
            scaled /= np.expand_dims(share, axis)
    return rows, columns


def solved(a: Assembly, law: Any, value: float, guess: float) -> float:
    """The number that makes a law vanish, by Newton's method."""
    if law not in a.values:
        writer = Writer(lambda key: f"p[{key.number}]" if key.kind == "p" else ("y", "value")[key.number], frozen=False)
        a.values[law] = a.function("y, value", writer.lines, writer.write(law), COMPLEX)
    y = guess
    for _ in range(60):
        rest = complex(a.values[law](complex(y, TINY), value))
        if rest.imag == 0:
            break
        y, before = y - rest.real / (rest.imag / TINY), y
        if abs(y - before) <= 1e-15 * abs(y):
            return float(y)
    raise Undecided("the law of a start")


# ---------------------------------------------------------------- starts
def start_of(system: System, t: float) -> Array:
    """Stored quantities, integrals and poses at the start. Raises `Undecided`."""
    a = system.assembly
    values: list[float] = []
    for number, start in enumerate(a.starts):
        if isinstance(start, float):
            values.append(start)
        elif isinstance(start, tuple):
            values.append(_stored(system, start[1], start[2], t))
        else:
            values.append(_number(a, start, t))
        del number
    x = np.array(values, dtype=float)
    for linkage in a.linkages.values():
        _pose(linkage, x)
    _unstressed(system, x)
    return x


def _number(a: Assembly, x: Any, t: float, states: Sequence[float] = ()) -> float:
    try:
        return a.number(x, t, states)
    except NameError:
        raise Undecided("a start that reads what moves") from None


def _stored(system: System, number: int, port: int, t: float) -> float:
    a = system.assembly
    node: Any = a.graph.nodes[number]
    if port not in node.starts:
        return 0.0
    letter, bound = node.starts[port]
    value = _number(a, a.opened(bound), t)
    if letter == node.stored[port]:
        return value
    return solved(a, stored_law(a, number, node, port, letter), value, 0.0)


def _unstressed(system: System, x: Array) -> None:
    """A storage on a coordinate stores what it reads, unless it starts otherwise."""
    a = system.assembly
    graph = a.graph
    for (name, port), place in a.stored.items():
        number, node = next((i, n) for i, n in enumerate(graph.nodes) if n.name == name)
        if node.stored[port] != "q":  # type: ignore[union-attr]
            continue
        for path, linkage, sign in _shared(system, number, port):
            if port in node.starts:  # type: ignore[union-attr]
                raise Undecided("a preload of a storage on a coordinate")
            x[place] = sign * _number(a, linkage.coordinate(path), 0.0, x.tolist())


def _shared(system: System, number: int, port: int) -> list[tuple[str, Linkage, float]]:
    """The coordinates of mechanisms whose flow the storage shares, through 1-junctions."""
    a = system.assembly
    graph = a.graph
    found, seen, bonds = [], {number}, [a.bond_at[number, port]]
    while bonds:
        bond = graph.bonds[bonds.pop()]
        for end in (bond.tail, bond.head):
            node: Any = graph.nodes[end.node]
            if node.kind.value == "multibody":
                found.append((node.ports[end.port].name, a.linkages[node.name], 1.0))
            elif node.kind.value == "1" and end.node not in seen:
                seen.add(end.node)
                bonds += graph.incident[end.node]
    return found


def _pose(linkage: Linkage, x: Array) -> None:
    """Poses, then rates: given starts, constraints; joints without a start are as drawn and at rest."""
    if not linkage.places:
        return
    said = [(linkage.posed(linkage.coordinate(path)), linkage.flow(path), v, rate) for path, v, rate in linkage.said()]
    targets = [(c, v) for c, _, v, rate in said if not rate]
    unsaid = [linkage.posed(linkage.coordinate(path)) for path in linkage.unsaid(rate=False)]
    drawn = list(zip(unsaid, _slopes(unsaid, [], x)[1], strict=True))
    closed = [(c, 0.0) for c in linkage.closed()]
    if targets:
        for extra in (drawn, []):
            trial = x.copy()
            if _moved(trial, linkage.places, [*closed, *targets, *extra]):
                x[:] = trial
                break
        else:
            raise Undecided("a start that does not say all poses")
    x[[s.key.number for s in linkage.turns]] = _slopes(list(linkage.turns.values()), [], x)[1]  # type: ignore[attr-defined]
    asked = [0.0] * len(linkage.rates) + [v for _, _, v, rate in said if rate]
    if not any(asked):
        return
    flows = [*linkage.rates, *(flow for _, flow, _, rate in said if rate)]
    for extra in ([linkage.flow(path) for path in linkage.unsaid(rate=True)], []):
        matrix = _slopes([*flows, *extra], linkage.speeds, x)[0]
        right = np.array([*asked, *(0.0 for _ in extra)])
        v, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=1e-10)
        if np.abs(matrix @ v - right).max() < 1e-9 * (1 + np.abs(right).max()) and rank == len(v):
            x[linkage.speeds] = v
            return
    raise Undecided("a start that does not say all rates")


def _slopes(coordinates: Sequence[Any], places: Sequence[int], x: Array) -> tuple[Array, Array]:
    """The slopes of coordinates by states, and their values."""
    return _sloped(_evaluated(coordinates), places, x)


def _evaluated(coordinates: Sequence[Any]) -> Any:
    writer = Writer(lambda key: f"x[{key.number}]", frozen=False)
    names = ", ".join(writer.write(c) for c in coordinates)
    return function("value", "x", writer.lines, f"[{names}]", COMPLEX)


def _sloped(value: Any, places: Sequence[int], x: Array) -> tuple[Array, Array]:
    columns = []
    for p in places:
        shifted = x.astype(complex)
        shifted[p] += 1j * TINY
        columns.append([complex(v).imag / TINY for v in value(shifted.tolist())])
    here = np.array([complex(v).real for v in value(x.astype(complex).tolist())])
    return np.array(columns).T.reshape(len(here), len(places)), here


def _moved(x: Array, places: Sequence[int], wanted: Sequence[Any]) -> bool:
    """Go from the drawing to the wanted values, in small steps. Return True if they are reached, and all poses are given."""
    coordinates = _evaluated([c for c, _ in wanted])
    goal = np.array([v for _, v in wanted])
    begin = _sloped(coordinates, places, x)[1]
    for share in np.linspace(0, 1, 41)[1:]:
        aim = begin + share * (goal - begin)
        for _ in range(20):
            jac, here = _sloped(coordinates, places, x)
            change, _, rank, _ = np.linalg.lstsq(jac, aim - here, rcond=1e-10)
            x[places] += change
            if np.abs(change).max() < 1e-14:
                break
    missed = np.abs(_sloped(coordinates, places, x)[1] - goal).max(initial=0.0)
    return bool(missed < 1e-10 and rank == len(places))


# ---------------------------------------------------------------- runs
@dataclass
class Opinion:
    """Outputs at instants, with Richardson's estimate of their error; shape (outputs, instants)."""

    names: tuple[str, ...]
    times: Array
    values: Array
    error: Array
    events: list[tuple[float, int]]


@dataclass
class Course:
    """Course of a run: state at the start, instants to stop at (of the report, or of a change of a branch on time), samples."""

    state: Run
    stops: list[tuple[float, bool]]
    timers: list[Timer]


@dataclass
class Timer:
    """Instants of a sampled event, the number of the next, and what was computed but not yet set, with its instants."""

    event: int
    period: float
    offset: float
    delay: float
    number: int = 0
    waiting: list[tuple[float, list[tuple[Any, float]]]] = field(default_factory=list)

    @property
    def next(self) -> float:
        return min([self.number * self.period + self.offset, *(at for at, _ in self.waiting)])


def course(system: System, begin: float, times: Sequence[float], budget: int, blur: float = 1.0) -> Course:
    """Start of a run, for all of its step lengths."""
    a, span = system.assembly, times[-1] - begin
    modes = [_mode(system, name, begin) for name in a.modes]
    state = Run(
        system,
        span,
        begin,
        start_of(system, begin),
        np.zeros(a.unknowns),
        [*modes, *[1.0] * len(a.graph.switches)],
        [1.0] * system.atoms,
        blur=blur,
    )
    state.true, state.budget, state.end = [False] * len(a.graph.events), budget, times[-1]
    timers = []
    for i, event in enumerate(a.graph.events):
        if (sampling := event.sampling) is not None:
            if sampling.jitter is not None:
                raise Undecided("samples with jitter")
            bounds = sampling.period, sampling.offset, sampling.delay
            timers.append(Timer(i, *(0.0 if b is None else _number(a, a.opened(b), begin) for b in bounds)))
    first = [timer for timer in timers if not timer.offset and not timer.delay]
    _begin(state, [timer.event for timer in first])
    for timer in first:  # the first tick is a part of the start
        timer.number = 1
    return Course(state, _stops(system, begin, times, span), timers)


def run(it: Course, steps: int) -> tuple[Array, Run]:
    """The outputs at instants, with so many steps in all."""
    state = replace(
        it.state,
        x=it.state.x.copy(),
        m=[*it.state.m],
        true=[*it.state.true],
        events=[*it.state.events],
        factors={},
        jacobian=None,
        parts=steps // COARSEST,
    )
    span, found = state.span, []
    timers = [replace(timer, waiting=[*timer.waiting]) for timer in it.timers]
    _sample(state, timers)
    for stop, report in it.stops:
        while state.t < stop - 3 * state.instant:
            goal = min([stop, *(t.next for t in timers if t.next > state.t + 3 * state.instant)])
            parts = max(1, math.ceil((goal - state.t) / span * steps - 1e-9))
            h = (goal - state.t) / parts
            for i in range(parts):
                state.advance(goal - (parts - 1 - i) * h - state.t)
            _sample(state, timers)
        if report:
            found.append(state.system.look(state.t, state.x.tolist(), state.w.tolist(), state.m))
        else:
            state.b = state.looked(stop + 1e-13 * span, state.x, state.w)[0]
            state.settle()
    return np.array(found).T, state


def _sample(state: Run, timers: Sequence[Timer]) -> None:
    """Sampled events whose instant has come, and what such with a delay have computed before."""
    now = state.t + 3 * state.instant
    late = [pair for timer in timers for at, values in timer.waiting if at <= now for pair in values]
    acting = []
    for timer in timers:
        timer.waiting = [item for item in timer.waiting if item[0] > now]
        at = timer.number * timer.period + timer.offset
        if at <= now:
            timer.number += 1
            if timer.delay:
                timer.waiting.append((at + timer.delay, state.lines(timer.event)))
            else:
                acting.append(timer.event)
    if acting or late:
        state.act(acting, late)
        state.b = state.looked(state.t, state.x, state.w)[0]
        state.settle()


def _begin(state: Run, ticks: Sequence[int]) -> None:
    """Storages of whose start nothing is said follow those of which something is: an impulse moves the former alone. Samples act with what is true at the start."""
    a = state.system.assembly
    nodes = {n.name: n for n in a.graph.nodes}
    free = [place for (name, port), place in a.stored.items() if port not in nodes[name].starts]  # type: ignore[union-attr]
    start = state.x.copy(), list(state.m), state.t
    rng = np.random.default_rng(1)
    for guess in (np.zeros(a.unknowns), np.ones(a.unknowns), rng.uniform(0.5, 2.0, a.unknowns)):
        state.x, state.m, state.t = start[0].copy(), list(start[1]), start[2]
        state.w, state.true, state.ticks = guess, [False] * len(a.graph.events), [*ticks]
        try:
            state.b = _first_branches(state)
            if free and not a.linkages:
                state.weights = np.full(len(state.x), 1e-9)
                state.weights[free] = 1.0
                for _ in range(20):
                    state.jacobian = None
                    xs, ws = state.step(state.instant, EULER)
                    branches = state.looked(state.t, xs[-1], ws[-1])[0]
                    _, on = state.system.conditions(state.t, xs[-1].tolist(), ws[-1].tolist(), state.m, state.b)
                    modes = [*state.m[: len(a.modes)], *map(float, on)]
                    if branches == state.b and modes == state.m:
                        break
                    state.b, state.w, state.m = branches, ws[-1], modes
                state.x, state.w, state.weights = xs[-1], ws[-1], 1.0
            state.settle()
        except (Undecided, ArithmeticError, ValueError) as lack:
            why = str(lack)
            state.weights = 1.0
            if state.count > state.budget:
                raise
            continue
        return
    raise Undecided(f"no solution at the start: {why}")


def _first_branches(state: Run) -> list[float]:
    b = [1.0] * state.system.atoms
    for _ in range(5):
        state.b = b
        try:
            b = state.looked(state.t, state.x, state.w)[0]
        except Undecided:
            return b
    return b


def _mode(system: System, name: str, t: float) -> float:
    named = system.assembly.graph.quantities[name]
    if named.definition is None:
        return float(named.value or 0.0)
    return _number(system.assembly, system.assembly.opened(named.definition), t)


def _stops(system: System, begin: float, times: Sequence[float], span: float) -> list[tuple[float, bool]]:
    """Instants of the report, and those at which a branch on time alone changes: looked for at many places, then bisected."""
    stops = [(t, True) for t in times if t > begin]
    for branch in system.timed:
        if branch is None:
            continue
        grid = [begin + span * i / 3000 for i in range(3001)]
        values = [branch(t) for t in grid]
        for low, high, a, b in zip(grid, grid[1:], values, values[1:], strict=False):
            if a == b:
                continue
            while True:
                middle = 0.5 * (low + high)
                if middle in (low, high):
                    break
                low, high = (middle, high) if branch(middle) == a else (low, middle)
            stops.append((high, False))
    return sorted(set(stops))


def opinion(
    system: System,
    begin: float,
    times: Sequence[float],
    goal: float = 1e-7,
    most: int = 512,
    budget: int = 200_000,
    same: Any = None,
    blur: float = 1.0,
) -> Opinion:
    """Steps are halved until the outputs change by less than `goal` of their magnitude, or are the `same` as others. Raises `Undecided` where they never do."""
    with np.errstate(all="ignore"):  # what is no number is looked for
        it, steps, spent, before = course(system, begin, times, budget, blur), COARSEST, 0, None
        while True:
            it.state.budget = budget - spent
            values, state = run(it, steps)
            spent += state.count
            if before is not None or (same is not None and same(system.outputs, values)):
                apart = np.abs(values - before) if before is not None else np.zeros_like(values)
                scale = np.abs(values).max(axis=1, initial=0.0, keepdims=True)
                enough = (apart <= goal * scale + 1e-14 * scale.max(initial=0.0) + 1e-300).all()
                if enough or steps >= most or spent + 2 * state.count > budget:
                    return Opinion(
                        system.outputs, np.array([t for t in times if t > begin]), values, apart / CERTAIN, state.events
                    )
            before = values
            steps *= 2
