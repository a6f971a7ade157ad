"""Loop of the pilot run over steps of `step.py`, in the subset that becomes machine code.

It returns where Python must act: before the step that ends a segment, where even the shortest step fails, and where a condition no longer holds as it did.
Python then asks for the last step, of a size that resolves the signals of time.
"""

from __future__ import annotations

from math import sqrt

from compiler.api import Floats, Ints, Record, sized

from ..linear_algebra.sparse import ANEW, FINE, SINGULAR
from ..loop_newton import LoopSystem, solve_loops
from ..outcomes import CROSSED, REDUNDANT
from ..projection.projection import ProjectionWorkspace, project, put_multipliers
from ..selection import StateSelection, is_steep
from ..workspace import Function
from .schedule import AGAIN, CAREFUL, GROWN, NOTES, SAME, SETTLED, SLIGHT
from .step import Euler, euler


class PilotWorkspace(Record):
    """State of the pilot run. n states and unknowns."""

    euler: Euler
    roots: Function
    root_count: int  # 0 where conditions do not end the run
    root: Floats = sized("conditions")
    root_said: Ints = sized("conditions")  # 1 where the condition holds in the mode
    root_strict: Ints = sized("conditions")  # 1 where it does not hold at zero
    n: int
    state: Floats  # n
    time: float
    size: float  # of the next step
    usual: float
    smallest: float  # step at which it gives up
    stop: float
    begun: float  # where the whole run began
    noted: int
    far: Floats  # NOTES: times of the records
    until: Floats  # NOTES n: the magnitudes up to these times
    taken: int  # number of steps tried
    most_steps: int  # number of them at which it returns
    reaching: int  # 1 if the reach of a free motion counts
    amplitudes: Floats  # n n, or none
    inverse_re: Floats  # n n, or none
    inverse_im: Floats  # n n, or none
    unit: Floats  # n
    found: Floats = sized("n")
    most: Floats = sized("n")  # the largest of the unit after a step; then work space
    modes: Floats = sized("n")
    guessing: int  # 1 if there are unknowns of loops
    loops: LoopSystem
    multiplying: int  # 1 if they are multipliers of loop joints, which the program computes directly
    projecting: int  # 1 if a step ends on the constraints
    closed: ProjectionWorkspace
    selection: StateSelection


def coarse(c: PilotWorkspace) -> int:
    """Make steps; return `FINE` where Python must act, `ANEW` if the factors need another order, `SINGULAR` if no step is short enough, `CROSSED`,
    `REDUNDANT`."""
    while c.taken < c.most_steps:
        size = c.usual if c.taken + 1 == CAREFUL else c.size
        if c.time + 1.001 * size >= c.stop:
            return FINE
        c.size = size
        done = pilot_step(c)
        if done != FINE and (done != SINGULAR or c.size < c.smallest):
            return done
    return FINE


def pilot_step(c: PilotWorkspace) -> int:
    """Make one step, which may end the segment; return `FINE`, `CROSSED`, `ANEW` if the factors need another order, `SINGULAR` if it fails, or `REDUNDANT`
    where constraints depend on each other, and Python projects what was found."""
    done = sure_step(c, c.euler, c.taken + 1 < CAREFUL)
    if done == ANEW:
        return ANEW
    c.taken += 1
    if done != FINE:
        c.size *= 0.25
        return done
    ends = c.time + 1.001 * c.size >= c.stop
    go_on(c)
    if ends:
        c.time = c.stop
    if has_crossed(c, c.euler):
        return CROSSED
    for i in range(c.n):
        if i < c.euler.differential or has_settled(c.euler, i):
            c.euler.largest[i] = max(c.euler.largest[i], abs(c.found[i]))
    if c.reaching != 0:
        reached(c, c.euler)
    note(c, c.euler)
    return REDUNDANT if c.projecting != 0 and project(c.closed, c.time, c.state) > 0 else FINE


def has_settled(e: Euler, i: int) -> bool:
    """Return True if the last correction of an unknown was a small part of it: Newton's method ends by the states, far beyond a root of infinite slope."""
    return abs(e.slope[i]) <= SETTLED * max(e.largest[i], abs(e.x[i]))


def go_on(c: PilotWorkspace) -> None:
    """Go on from the accepted result."""
    c.time += c.size
    c.size = min(c.usual, 2.0 * c.size)
    for i in range(c.n):
        c.state[i] = c.found[i]


def has_crossed(c: PilotWorkspace, e: Euler) -> bool:
    """Return True if a condition differs from the mode, or if other states should be integrated."""
    if c.selection.slope_count > 0:
        if is_steep(c.selection, c.time, c.state, e.inputs, e.constants, e.mode):
            return True
    if c.root_count == 0:
        return False
    c.roots(c.time, c.state, e.inputs, e.constants, e.mode, c.root)
    for k in range(c.root_count):
        holds = 1 if c.root[k] < 0.0 or (c.root[k] == 0.0 and c.root_strict[k] == 0) else 0
        if holds != c.root_said[k]:
            return True
    return False


def note(c: PilotWorkspace, e: Euler) -> None:
    """Record the magnitudes so far, if the last record is not recent."""
    far = c.time - c.begun
    if c.noted < NOTES and (c.noted == 0 or far >= AGAIN * c.far[c.noted - 1]):
        c.far[c.noted] = far
        for i in range(c.n):
            c.until[c.noted * c.n + i] = e.largest[i]
        c.noted += 1


def reached(c: PilotWorkspace, e: Euler) -> None:
    """Raise the magnitudes by the reach of a free linear motion from here: the sum of its modes' amplitudes."""
    for j in range(c.n):
        c.most[j] = c.found[j] / c.unit[j]
    for i in range(c.n):
        real = 0.0
        imaginary = 0.0
        for j in range(c.n):
            real += c.inverse_re[i * c.n + j] * c.most[j]
            imaginary += c.inverse_im[i * c.n + j] * c.most[j]
        c.modes[i] = sqrt(real * real + imaginary * imaginary)
    for i in range(c.n):
        total = 0.0
        for j in range(c.n):
            total += c.amplitudes[i * c.n + j] * c.modes[j]
        e.largest[i] = max(e.largest[i], total * c.unit[i])


def sure_step(c: PilotWorkspace, e: Euler, careful: bool) -> int:
    """Compute the state after a step; where a state grows fast, two half steps must agree, because implicit Euler overshoots growth."""
    for i in range(c.n):
        e.start[i] = c.state[i]
    done = single_step(c, e, c.time + c.size, c.size)
    if done != FINE:
        return done
    grows = 0
    for i in range(c.n):
        e.most[i] = 0.0
    for i in range(e.differential):
        e.most[e.kinds[i]] = max(e.most[e.kinds[i]], max(abs(e.x[i]), e.largest[i]))
    for i in range(c.n):
        c.most[i] = e.most[e.kinds[i]]
        c.found[i] = e.x[i]
    for i in range(e.differential):
        grows += has_grown(c, e, i)
    if grows == 0 or not careful:
        return FINE
    done = single_step(c, e, c.time + 0.5 * c.size, 0.5 * c.size)
    if done != FINE:
        return done
    for i in range(c.n):
        e.start[i] = e.x[i]
    done = single_step(c, e, c.time + c.size, 0.5 * c.size)
    if done != FINE:
        return done
    for i in range(e.differential):
        if has_grown(c, e, i) and not abs(c.found[i]) > SAME * abs(e.x[i]):
            return FINE
    return SINGULAR


def has_grown(c: PilotWorkspace, e: Euler, i: int) -> bool:
    """Return True if a state grew much in a step and beyond its largest value so far; growth within that range is harmless."""
    beyond = max(max(GROWN * abs(c.state[i]), SAME * e.largest[i]), max(SLIGHT * c.most[i], e.smallest[i]))
    return abs(c.found[i]) > beyond and c.state[i] != 0.0


def single_step(c: PilotWorkspace, e: Euler, time: float, size: float) -> int:
    """Make one step from `start`, with the unknowns of loops for its end if they are near the known ones.

    The step solves for them anyway, and a search from far away would cost more than the whole run.
    """
    for i in range(e.n):
        e.x[i] = e.start[i]
    if c.multiplying != 0:
        put_multipliers(c.closed, time, e.x)
    if c.guessing != 0:
        guess_unknowns(c.loops, e, time)
    e.time = time
    e.size = size
    done = euler(e)
    e.pattern.tolerant = 0
    return done


def guess_unknowns(s: LoopSystem, e: Euler, time: float) -> None:
    """Put the unknowns that belong to the start at a time into the guess, if Newton's method finds them."""
    s.time = time
    s.unknown = 0
    for i in range(e.n):
        s.state[i] = e.start[i]
    for i in range(s.n):
        s.z[i] = e.start[s.places[i]]
        s.magnitude[i] = e.largest[s.places[i]]
        if not s.magnitude[i] > 0.0:
            s.unknown = 1
    if solve_loops(s, 0) != 0:
        for i in range(s.n):
            e.x[s.places[i]] = s.z[i]
