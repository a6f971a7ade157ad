"""Conduction state of ideal valves just after an instant: one linear complementarity problem for all of them.

The companion network (`compiler/equations/companion.py`) is the model over one short step h of the implicit Euler method. Seen from its
valves it is b = S a + c, with waves a = e - z f into it and b = e + z f out of it. Each valve requires -e >= 0, z f >= 0 and one of them zero:
(1 + S) z f = (1 - S)(-e) + c. For a network that creates no energy this is monotone, so block principal pivoting finds the conducting set
(Judice and Pires, Computers and Operations Research 21, 1994). Loops of conducting valves, and parts that float between blocking valves, leave
combinations undetermined: there the smallest waves are taken, as equal small resistances and leakages would give.
As h goes to zero this is the state just after the instant: impulses decide where the network ties storages, then values, then derivatives
where the values are zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from operator import sub
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, Program, RunMetadata

from ...compiled_scene import CompiledScene
from ...errors import RunFailed
from ..constraints.constraints import Constraints
from ..loops.loops import LoopSolver
from ..segments.timeline import with_discrete_variables

# fractions of the time between switching instants: the steps h in the order of their trial
STEPS = (1e-5, 1e-6, 1e-4, 1e-7, 1e-3, 1e-9)
RECENT = 8  # number of last switching instants from which their distance is estimated
OPEN = 1e-13  # relative singular value below which a combination is undetermined
MET = 1e-9  # relative to the waves: largest misfit of an undetermined combination
FIRM = 1e-12  # relative weight that gives an undetermined combination that does not fit its sign
ZERO = 1e-13  # relative to the largest wave: smaller waves count as zero, and the valve keeps its state
MOST_PIVOTS = 1000
PATIENCE = 4  # block pivots without progress before one valve at a time changes
SETTLED = 1e-6  # relative to the waves: end of the iteration for nonlinear laws
NEWTON = 30  # iterations for networks with nonlinear laws
LEAST_WAVE = 1e-6  # relative to the largest so far: differences over less are the rounding of the unknowns of loops
IMPEDANCES = 6  # rounds in which the impedance of the waves is chosen
# Its first values, in SI, from below: above the network's own all is rounding.
BEGINNINGS = (1.0, *(10.0 ** np.arange(-30, 31, 6)).tolist())
STEP, IMPEDANCE = "step of the companion", "impedance of the valves"  # its inputs, besides the waves
CONDUCTS = ", which conducts"  # end of the label of a port whose state is fixed
# of stored quantities: an input where a law is nonlinear, and an output
JUMP, PASSED = "jump of ", "rate of what passes to "
BALANCED = 1e-6  # relative to a jump: largest misfit of the impulse that passes, which steps of 1e-7 and 1e-8 show
IMPULSES = (1e-7, 1e-8)  # as `STEPS`: the two steps that reveal an impulse


Outputs = Callable[[], Any]  # outputs of the companion at a solution, shape (outputs,)
# time, state, mode -> the mode with its conditions on states as evaluated
ConditionFunction = Callable[[float, Any, Any], Any]


@dataclass(frozen=True, slots=True)
class Instant:
    """A time with all stored quantities and all discrete variables, by name; `off`: switched junctions that are no valves; `closed`: valves that cannot begin
    to conduct."""

    time: float
    stored: Mapping[str, float]
    modes: Mapping[str, float]
    off: tuple[str, ...]
    delayed: Mapping[str, float] = field(default_factory=dict)
    closed: tuple[str, ...] = ()


@dataclass(slots=True)
class CompanionNetwork:
    """A companion program with the values of this run."""

    program: Program
    constraints: Constraints
    places: Mapping[str, int]  # indices of its inputs
    fixed: tuple[
        bool, ...
    ]  # of the ports behind the two-terminal switches, which share with these: True where one conducts
    waves: tuple[tuple[int, int], ...]  # indices of the ports whose waves it reads, each with that of the input
    conditions: ConditionFunction | None  # None without discrete variables
    linear: bool  # True if one row of difference quotients is exact
    curved: tuple[str, ...]  # stored quantities with nonlinear laws
    start: Any  # its state at the start, with the unknowns of its loops
    last: Any  # the last of these unknowns that were found: the first guess of the next
    largest: Any  # the largest that they were, zeros for the state
    impedance: float = 0.0  # impedance of the waves; chosen at the first use
    wave: float = 0.0  # the largest wave so far


class Companion:
    """Valves of a run, and its other two-terminal switches.

    `made`: the companion program for given junctions off. `values`: parameters set when the run begins. `conditions`: those of a program with
    its values.
    """

    def __init__(
        self, facts: RunMetadata, made: Callable[[tuple[str, ...]], CompiledScene], values: Mapping[str, float], horizon: float,
        conditions: Callable[[Constraints], ConditionFunction],
    ) -> None:  # fmt: skip
        self.valves, self.gaps = facts.valves, facts.gaps
        self.junctions = frozenset(v.junction for v in self.valves)
        self.signs = np.array([*(v.sign for v in self.valves), *(1.0 for _ in self.gaps[len(self.valves) :])])
        self.integrals = {i.name: i for i in facts.integrals}
        self.mechanisms = tuple(f"{name}." for name in facts.mechanisms)
        self.made, self.values, self.horizon, self.conditions = made, values, horizon, conditions
        self.networks: dict[tuple[str, ...], CompanionNetwork] = {}
        self.instants: list[float] = []  # the start, and the switching instants of valves
        self.stored: dict[str, float] = {}  # by name: last known values of stored quantities
        # sets refuted at an instant, each with the problem in which it was
        self.against: tuple[float, frozenset[tuple[bytes, tuple[object, ...]]]] = (np.nan, frozenset())
        self.decided: tuple[object, ...] = ()  # the last problem, and the set that solves it
        # the last instant, and which valves conducted before it
        self.before: tuple[float, BoolArray] = np.nan, np.zeros(len(self.valves), dtype=bool)
        self.shut: BoolArray | None = None  # which gates were closed there, each where its valve last blocked

    # ------------------------------------------------------------ valves
    def another(self, at: Instant, guess: BoolArray) -> Any:
        """Return a conducting set for a longer or shorter step, where this set was refuted by its own program; None if all steps lead to refuted sets."""
        before = self.against[1] if self.against[0] == at.time else frozenset()
        self.against = at.time, before | {(guess.tobytes(), self._problem(at))}
        return self._not_refused(at, guess, self._refused(at.time))

    def again(self, at: Instant, guess: BoolArray) -> Any:
        """Return a conducting set that was not refuted with these stored quantities: an impulse may have changed them since it was.

        Raises `RunFailed` if there is none.
        """
        problem = self._problem(at)
        found = self._not_refused(at, guess, self._refused(at.time, problem))
        if found is None:
            raise self.without_a_set(at.time)
        return found

    def conducting(self, at: Instant, guess: BoolArray) -> Any:
        """Return a mask of the valves that conduct just after an instant; `guess`: those that do now. Raises `RunFailed`."""
        found = self._not_refused(at, guess, self._refused(at.time))
        return self.again(at, guess) if found is None else found

    def _not_refused(self, at: Instant, guess: BoolArray, refused: frozenset[bytes]) -> Any:
        """Return the first conducting set, over the steps to try, that is not among refuted ones; None if there is none."""
        problem, guessed = self._problem(at), guess.tobytes()
        if self.decided == (*problem, guessed) and guessed not in refused:
            return guess  # the program of this set asks again
        for step in self.steps(at.time):
            solved = self._solved(at, guess, step)
            if solved is not None and (key := solved[0].tobytes()) not in refused:
                self.decided = *problem, key
                return solved[0]
        self.decided = ()
        return None

    def _problem(self, at: Instant) -> tuple[object, ...]:
        """Return all that decides the conducting sets at an instant."""
        program = self._network(at.off).program
        modes = () if program.hybrid is None else program.hybrid.modes.names
        return at.time, at.off, at.closed, *map(at.stored.get, program.states.names), *map(at.modes.get, modes)

    def without_a_set(self, time: float) -> RunFailed:
        """Return the error that no conducting set is consistent."""
        names = ", ".join(f"`{v.junction.rpartition('.')[0] or v.junction}`" for v in self.valves)
        return RunFailed(
            "BR766", f"at t = {time:.9g} s no set of conducting and blocking valves among {names} goes on: none of them keeps every effort at or below zero "
            "and every flow at or above zero;",
            "look for a source that works against another through valves, put a resistor in line with one of them, or open the gate of one",
        )  # fmt: skip

    def _refused(self, time: float, problem: tuple[object, ...] | None = None) -> frozenset[bytes]:
        """Return the sets that were refuted at an instant; `problem`: only those that were refuted in it."""
        if self.against[0] != time:
            return frozenset()
        return frozenset(on for on, refuted_in in self.against[1] if problem in (None, refuted_in))

    def begin(self, time: float, off: tuple[str, ...]) -> dict[str, float]:
        """Return the modes of the valves at the beginning of a run, as far as the written start values decide them. `off`: other junctions that are off."""
        on = self.again(Instant(time, {}, {}, off), np.zeros(len(self.valves), dtype=bool))
        return {v.mode: v.conducting if c else 1.0 - v.conducting for v, c in zip(self.valves, on, strict=True)}

    def step(self, share: float, time: float) -> float:
        """Return a step h: a fraction of the time between the last switching instants, long enough to be resolved in rounded time."""
        recent = self.instants[-RECENT:]
        usual = max(map(sub, recent[1:], recent), default=0.0) or self.horizon
        return max(share * min(usual, self.horizon), 1e3 * float(np.spacing(abs(time))))

    def steps(self, time: float) -> Iterator[float]:
        """Yield the steps h to try: fractions of the time between the last switching instants, then of the run."""
        yield from (self.step(share, time) for share in STEPS)
        yield from (max(share * self.horizon, 1e3 * float(np.spacing(abs(time)))) for share in STEPS)

    def ahead(self) -> Companion:
        """Return a copy for a pilot run, which leaves the original unchanged."""
        other = copy(self)
        other.stored = dict(self.stored)
        return other

    def switched(self, time: float) -> None:
        """Store an instant at which valves switched."""
        if not self.instants or time > self.instants[-1]:
            self.instants = [*self.instants[-RECENT:], time]

    # ------------------------------------------------------------ impulses
    def impulses(self, at: Instant, jumps: Mapping[str, float]) -> dict[str, float]:
        """Return the jumps of integrals caused by impulses between storages at an instant. `at`: with the stored quantities before, and the junctions off
        after; `jumps`: of stored quantities, by name.

        Raises `RunFailed` where an impulse has no integral (the square of a current, a current times a voltage that jumps).
        """
        on = np.array([v.junction in at.off for v in self.valves], dtype=bool)
        network = self._network(at.off)
        outputs = network.program.outputs.names
        names = tuple(self.integrals)
        chosen = [outputs.index(f"rate of {name}") for name in names]
        passing = {n.removeprefix(PASSED): k for k, n in enumerate(outputs) if n.startswith(PASSED)}
        self._refuse_unseen(at, jumps, passing)
        moved = np.array([jumps.get(n, 0.0) for n in network.curved])
        passed = []
        for share in IMPULSES:
            step = self.step(share, at.time)
            found = self._solved(at, on, step, 0, moved)
            outputs_here = None if found is None else found[1]()
            if outputs_here is None or not np.isfinite(outputs_here[chosen]).all():
                raise RunFailed(
                    "BR768", f"at t = {at.time:.9g} s an impulse passes, and nothing determines what it adds to `{names[0]}`:",
                    "put a resistor or a damper where the storages are tied",
                )  # fmt: skip
            passed.append(step * outputs_here)
        long, short = passed
        ratio = IMPULSES[0] / IMPULSES[1]
        limit = np.where(np.abs(short) < np.abs(long) / 2, 0.0, (ratio * short - long) / (ratio - 1))
        self._check_passed(at, jumps, {n: float(limit[k]) for n, k in passing.items()})
        grows = ~(np.abs(short - long) <= 0.5 * np.abs(long) + 1e-300) & (np.abs(short) > np.abs(long))
        bad = np.flatnonzero(grows[chosen])
        if len(bad):
            raise RunFailed(
                "BR767", f"at t = {at.time:.9g} s an impulse passes, and what `{names[bad[0]]}` integrates has no integral across it: it is not proportional "
                "to the current or force of the impulse;", "put a resistor or a damper where the storages are tied",
            )  # fmt: skip
        known = dict(zip(outputs, limit.tolist(), strict=True))
        self._refuse_products(at, jumps, known)
        return {n: known[f"rate of {n}"] for n in names}

    def _refuse_unseen(self, at: Instant, jumps: Mapping[str, float], passing: Mapping[str, int]) -> None:
        """Refuse an impulse into what the companion leaves as it is (a mechanism), if an integral reads forces or currents."""
        for name in jumps.keys() - passing.keys():
            among = "e" if name.startswith(self.mechanisms) else "ef"
            reading = [n for n, i in self.integrals.items() if any(v in among for v in i.reads)]
            if reading:
                raise RunFailed(
                    "BR769", f"at t = {at.time:.9g} s an impulse changes `{name}`, and what it adds to `{reading[0]}` is not known:",
                    "put a spring or a damper where a junction ties it",
                )  # fmt: skip

    def _check_passed(self, at: Instant, jumps: Mapping[str, float], passed: Mapping[str, float]) -> None:
        """Refuse an impulse whose charges or momenta are not the jumps of the storages that they pass to."""
        size = max(map(abs, jumps.values()), default=0.0)
        for name, jump in jumps.items():
            if name in passed and not abs(passed[name] - jump) <= BALANCED * max(
                abs(jump), abs(at.stored.get(name, 0.0)), 1e-6 * size
            ):
                raise RunFailed(
                    "BR770", f"at t = {at.time:.9g} s an impulse changes `{name}` by {jump:.6g}, but the currents or forces across it add {passed[name]:.6g}: "
                    "what integrals take of it is not known;", "put a resistor or a damper where the storages are tied",
                )  # fmt: skip

    def _refuse_products(self, at: Instant, jumps: Mapping[str, float], passed: Mapping[str, float]) -> None:
        """Refuse integrals of an impulse times what jumps with it."""
        jumped = {*jumps, *(n for n in self.integrals if passed[f"rate of {n}"])}
        for name, k, factor in ((n, k, f) for n, i in self.integrals.items() for k, f in enumerate(i.factors)):
            if passed[f"factor {k} of {name}"] and (factor.moving or not jumped.isdisjoint(factor.coefficients)):
                raise RunFailed(
                    "BR771", f"at t = {at.time:.9g} s an impulse passes, and what `{name}` integrates has no integral across it: it multiplies the current or "
                    "force of the impulse by what may jump with it;",
                    "integrate the current or force alone, compute energies from what is stored, or put a resistor or a damper where the storages "
                    "are tied",
                )  # fmt: skip

    def _solved(
        self, at: Instant, guess: BoolArray, step: float, valves: int | None = None, moved: Array | None = None
    ) -> tuple[Any, Outputs] | None:
        """Return the mask of conducting valves and the outputs of the companion; None if no set is found. `valves`: how many of them may change;
        `moved`: jumps of the storages with nonlinear laws, shape (n,), if they are known; else Newton's method finds them."""
        network = self._network(at.off)
        if moved is not None or not network.curved:
            return self._solved_about(
                at, guess, step, valves, np.zeros(len(network.curved)) if moved is None else moved
            )
        rates = [network.program.outputs.names.index(PASSED + n) for n in network.curved]
        before = np.array([at.stored.get(n, 0.0) for n in network.curved])
        moved, first = np.zeros(len(network.curved)), None
        for _ in range(NEWTON):
            found = self._solved_about(at, guess, step, valves, moved)
            if found is None:
                break
            first = first or found
            last, moved = moved, step * found[1]()[rates]
            size = np.maximum(np.abs(before), np.abs(moved)).max(initial=0.0)
            if not np.isfinite(moved).all():
                break
            if (np.abs(moved - last) <= SETTLED * size).all():
                return found
        return first  # its set still has to hold in its own program

    def _solved_about(
        self, at: Instant, guess: BoolArray, step: float, valves: int | None, moved: Array
    ) -> tuple[Any, Outputs] | None:
        """Return the same with nonlinear laws linearized at these jumps."""
        network = self._network(at.off)
        count = len(self.gaps) + len(network.fixed)
        jumped = dict(zip(network.curved, moved.tolist(), strict=True))
        at = replace(
            at, stored={**at.stored, **{n: at.stored.get(n, 0.0) + x for n, x in jumped.items()}},
            delayed={**at.delayed, **{JUMP + n: x for n, x in jumped.items()}},
        ) if jumped else at  # fmt: skip
        network.impedance = z = network.impedance or self._impedance(network, at)
        where = self._state(network, at, step)
        others = [name in at.off for name in self.gaps[len(self.valves) :]]  # a switch whose junction is off conducts
        waves, on = np.zeros(count), np.array([*guess, *others, *network.fixed], dtype=bool)
        free = np.arange(count) < (len(self.valves) if valves is None else valves)
        if at.closed:
            stays = np.flatnonzero([v.junction in at.closed for v in self.valves])
            free[stays] = on[stays] = False
        signs, seen, size = np.concatenate([self.signs, np.ones(len(network.fixed))]), None, network.wave
        if size and not len(network.last):  # that it is still the largest is seen beside the rest
            seen = self._outputs(network, at, where, (step, z, np.concatenate([waves[None], size * np.eye(count)])))
        here = self._outputs(network, at, where, (step, z, waves[None])) if seen is None else seen[:1]
        # quotients over less are the rounding of what is stored
        network.wave = max(network.wave, _largest_wave(here, z, count))
        if size != network.wave:
            seen, size = None, network.wave or 1.0
        for _ in range(NEWTON):
            if seen is None:
                rows = np.concatenate([waves[None], waves + size * np.eye(count)])
                seen = self._outputs(network, at, where, (step, z, rows))
            if not np.isfinite(seen).all():
                return None
            back, seen = seen[:, :count] + z * seen[:, count : 2 * count], None
            slopes = (back[1:] - back[0]).T / size
            offset = signs * (back[0] - slopes @ waves)
            slopes = signs[:, None] * slopes * signs
            found = complementary(slopes, offset, on, free)
            if found is None:
                return None
            before, waves, on = waves, signs * found[1], found[0]
            if network.linear or np.abs(waves - before).max(initial=0.0) <= SETTLED * np.abs(waves).max(initial=0.0):
                break
            network.wave = max(network.wave, float(np.abs(waves).max()))
            size = 1e-4 * max(float(np.abs(waves).max()), LEAST_WAVE * network.wave)
        return on[: len(self.valves)], lambda: self._outputs(network, at, where, (step, z, waves[None]))[0]

    def _outputs(self, network: CompanionNetwork, at: Instant, where: tuple[Any, Any], values: tuple[float, float, Any]) -> Any:  # fmt: skip
        """Return the outputs of the companion for rows of waves, shape (rows, outputs)."""
        program, constraints = network.program, network.constraints
        (state, mode), (step, z, rows), count = where, values, len(program.states.names)
        inputs, states = np.empty((len(rows), len(constraints.inputs))), np.empty((len(rows), len(state)))
        inputs[:], states[:] = constraints.inputs, state
        for name, value in {STEP: step, IMPEDANCE: z, **at.delayed}.items():
            if name in network.places:
                inputs[:, network.places[name]] = value
        for port, place in network.waves:
            inputs[:, place] = rows[:, port]
        times = np.full(len(rows), at.time + step)
        if len(program.unknowns.names):
            states[:, count:] = network.last
            loops = LoopSolver(program, constraints.constants, inputs, network.largest, constraints.parameters)
            states = loops.solve_all(times, states, mode)
            network.last = states[0, count:]
            network.largest[count:] = np.maximum(network.largest[count:], np.abs(network.last))
        return np.asarray(program.output(times, states, inputs, constraints.constants, mode))

    def _network(self, off: tuple[str, ...]) -> CompanionNetwork:
        """Return the companion with these junctions off (no two-terminal switches), compiled at the first use."""
        off = tuple([name for name in off if name not in self.gaps])
        if off not in self.networks:
            made = self.made(off)
            program = made.program
            given = zip(program.parameters.names, program.defaults, strict=True)
            parameters = np.array([self.values.get(n, d) for n, d in given])
            inputs = np.array(program.input_defaults, dtype=float)
            constraints = Constraints(program, parameters, inputs, np.ones(len(program.states.names)))
            places = {n: i for i, n in enumerate(program.inputs.names)}
            curved = tuple(n.removeprefix(JUMP) for n in program.inputs.names if n.startswith(JUMP))
            ports = [n.removesuffix(" e") for n in program.outputs.names if n.endswith(" e")]
            named = (places.get(f"wave of {name}") for name in ports)
            waves = tuple((port, place) for port, place in enumerate(named) if place is not None)
            start = np.array(program.start(constraints.constants), dtype=float)
            self.networks[off] = CompanionNetwork(
                program, constraints, places, tuple(p.endswith(CONDUCTS) for p in ports[len(self.gaps) :]), waves,
                None if program.hybrid is None else self.conditions(constraints), made.certificate.linear,
                curved, start, start[len(program.states.names) :], np.zeros(len(start)),
            )  # fmt: skip
        return self.networks[off]

    def _impedance(self, network: CompanionNetwork, at: Instant) -> float:
        """Return the reference impedance of the waves: the geometric mean, over all valves, of the network's impedance for a long time step."""
        step = 1e-3 * self.horizon
        where = self._state(network, at, step)
        beginnings = ((z, self._mismatch(network, at, where, (step, z))) for z in BEGINNINGS)
        z, factor = next(((z, f) for z, f in beginnings if f), (1.0, 1.0))
        for _ in range(IMPEDANCES):
            z *= factor
            if 0.1 < factor < 10:
                break
            factor = self._mismatch(network, at, where, (step, z)) or 1.0
        return z

    def _mismatch(
        self, network: CompanionNetwork, at: Instant, where: tuple[Any, Any], values: tuple[float, float]
    ) -> float | None:
        """Return the ratio of the network's impedance to that of the waves; None if all that it shows is that one is far larger than the other."""
        (step, z), count = values, len(self.gaps) + len(network.fixed)
        here = self._outputs(network, at, where, (step, z, np.zeros((1, count))))
        size = _largest_wave(here, z, count) or 1.0  # smaller waves are lost in those of the sources
        waves = size * np.concatenate([np.zeros((1, count)), np.eye(count), 2 * np.eye(count)])
        moved = self._outputs(network, at, where, (step, z, waves))[1:] - here
        back = (moved[:, :count] + z * moved[:, count : 2 * count]).reshape(2, count, count)
        change, again = (np.diagonal(b) / (k * size) for k, b in enumerate(back, 1))
        # without sources and floating parts, which have no impedance, and without what is rounding
        own = change[(np.abs(change) < 1 - 1e-6) & (np.abs(again - change) < 0.5 * (1 - np.abs(change)))]
        return float(np.exp(np.mean(np.log((1 + own) / (1 - own))))) if len(own) else None

    def _state(self, network: CompanionNetwork, at: Instant, step: float) -> tuple[Any, Any]:
        """Return the state and the mode of a companion program at an instant."""
        program, constraints = network.program, network.constraints
        state = network.start.copy()
        for place, name in enumerate(program.states.names):
            state[place] = at.stored.get(name, state[place])
        mode = np.array(program.mode_at(at.time + step, state, constraints.inputs, constraints.constants), dtype=float)
        if program.hybrid is not None and network.conditions is not None:
            mode = with_discrete_variables(program.hybrid, mode, at.modes)
            mode = network.conditions(at.time + step, state, mode)
        return state, mode


def _largest_wave(seen: Array, z: float, count: int) -> float:
    """Return the largest effort, or flow times the impedance, at the first ports; 0 if it is not finite."""
    size = float(np.maximum(np.abs(seen[:, :count]), np.abs(z * seen[:, count : 2 * count])).max(initial=0.0))
    return size if np.isfinite(size) else 0.0


def complementary(slopes: Array, offset: Array, guess: BoolArray, free: BoolArray) -> tuple[Any, Any, Any] | None:
    """Return the conducting ports, and the waves a into and b out of a network b = S a + c, shapes (n,); None if no set fits.

    `guess`: the set tried first. It is kept where both sides are zero, and for all ports that are not `free` to change.
    """
    count = len(offset)
    matrix, diagonal = slopes.copy(), slopes.diagonal()
    on, best, patience = np.array(guess, dtype=bool), count + 1, PATIENCE
    if not np.abs(offset).max(initial=0.0) > 0:
        return on, np.zeros(count), np.zeros(count)
    for _ in range(MOST_PIVOTS):
        matrix.reshape(-1)[:: count + 1] = np.where(on, diagonal + 1, diagonal - 1)
        sizes, firm = _least(matrix, offset, slopes)
        wrong = (free & (sizes < -ZERO * np.abs(sizes).max())).nonzero()[0]
        if not len(wrong):
            return (on, -sizes, np.where(on, sizes, -sizes)) if firm else None
        if len(wrong) < best:
            best, patience = len(wrong), PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            wrong = wrong[-1:]
        on = on.copy()
        on[wrong] = ~on[wrong]
    return None


def _least(matrix: Array, right: Array, slopes: Array) -> tuple[Any, bool]:
    """Return the minimum-norm solution of a square system, and True if it fits; ports of a singular row that does not fit get a small loss."""
    left, values, rows = np.linalg.svd(matrix)
    share, size = left.T @ right, np.abs(right).max()
    values, size = values / 2, size / 2  # without energy creation no singular value exceeds 2
    if values[-1] > OPEN:
        return rows.T @ (1 / values * share / 2), True
    small = values <= OPEN
    misfit = small & (np.abs(share) > MET * size)
    inverse = np.where(small, 0.0, 1 / np.where(small, 1.0, values))
    if misfit.any():
        losses = -np.einsum("ij,ij->j", left, slopes @ rows.T)
        inverse = np.where(misfit, np.sign(losses) / FIRM, inverse)
    return rows.T @ (inverse * share / 2), not misfit.any()
