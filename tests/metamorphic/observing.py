"""Comparison of two texts of equal meaning: their certificates, rates and outputs at random states, results of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.compiled_model import LIBRARY
from bondgraph.model import Model
from bondgraph.simulation.constraints.constraints import Constraints
from bondgraph.simulation.magnitudes.nominal_magnitudes import nominal_magnitudes
from bondgraph.simulation.segments.timeline import segments
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from compiler.reduction.state_space import LinearLoop, StateSpace
from compiler.scene import Scene
from compiler.semantics.experiments.plan import experiments_of
from compiler.semantics.names.imports import Loader
from compiler.source import Source
from compiler.syntax import parse

CIRCUITS = Path("tests/metamorphic/circuits")
SAMPLES = 6  # random states
STEPS = 25  # of equal length
SPREAD = 0.3  # of the magnitudes of the states
NAMELESS = frozenset({"BG132"})  # several models to choose from: a file of parts


@dataclass(frozen=True, slots=True)
class Case:
    """One model of one file with one of its experiments."""

    path: Path
    experiment: str | None
    model: str | None = None

    @property
    def name(self) -> str:
        return f"{self.path.stem}-{self.experiment}"

    @property
    def source(self) -> Source:
        return Source(self.path.name, self.path.read_text(encoding="utf-8"), self.path)


HELD = frozenset(
    {"car", "coin", "crank_linkage", "end_stops", "four_bar", "side_instability", "six_axes", "spatial_slider_crank"}
)
"""What a march of the states alone does not hold: loops closed, quaternions at length 1, starts of parts that are no coordinates; and contacts of
microseconds."""


@cache
def cases(held: bool = False) -> tuple[Case, ...]:
    """Every model that can be run, once for each experiment, the first of them first. `held`: only those that a march does not hold."""
    found: list[Case] = []
    models = (p for p in sorted(Path("models").glob("*.bg")) if (p.stem in HELD) == held)
    for path in (*models, *(() if held else sorted(CIRCUITS.glob("*.bg")))):
        source = Source(str(path), path.read_text(encoding="utf-8"), path)
        try:
            compilation = Compilation(source, Scene(None, None), LIBRARY)
            if compilation.open_part:
                continue
        except CompilationFailed as failed:
            if {d.code for d in failed.diagnostics} <= NAMELESS:
                continue
            raise
        name = compilation.whole_graph.name
        definition = Loader(LIBRARY).load(parse(source)).models[name]
        found += [Case(path, e, name) for e in experiments_of(definition)] or [Case(path, None, name)]
    return tuple(found)


def first_cases(held: bool = False) -> list[Case]:
    """Each model once."""
    seen: set[Path] = set()
    return [c for c in cases(held) if c.path not in seen and not seen.add(c.path)]  # type: ignore[func-returns-value]


# ---------------------------------------------------------------- what is told without running


@dataclass(frozen=True, slots=True)
class Certificate:
    """The compiler's data on the form of a model."""

    states: int
    loops: int
    dependent: int
    conditions: int  # on time, at which a run stops
    outputs: int


def certificate(space: StateSpace, conditions: int) -> Certificate:
    """The certificate of a compiled model."""
    loops = sum(isinstance(s, LinearLoop) for s in space.steps)
    return Certificate(len(space.states), loops, len(space.dependent), conditions, len(space.outputs))


class Text:
    """One text, compiled for one experiment."""

    def __init__(self, source: Source, experiment: str | None, model: str | None = None) -> None:
        self.experiment = experiment
        self.model = Model(source, model)
        self.outputs = self.model.outputs
        scene = Scene(model, experiment, outputs=self.outputs)
        self.compilation = self.model.compilation(scene, everything=True)
        self.program = self.compilation.program
        self.constants = self.program.constants(np.array(self.program.defaults, dtype=float))
        self.inputs = np.array(self.program.input_defaults, dtype=float)
        self.start = np.asarray(self.program.start(self.constants), dtype=float)

    @property
    def runs(self) -> bool:
        """Return True if the experiment has an end of the run, and no step other than runs."""
        return self.compilation.plan.stop is not None and not self.compilation.plan.sweeps

    @property
    def horizon(self) -> float:
        plan = self.compilation.plan
        return plan.stop if plan.stop is not None else 1.0

    @property
    def certificate(self) -> Certificate:
        conditions = len(self.program.switches(0.0, self.constants))
        return certificate(self.compilation.state_space, conditions)

    def magnitudes(self) -> Any:
        """Of the states, as a run would take them."""
        stretches = segments(self.program, self.constants, 0.0, self.horizon)
        constraints = Constraints(
            self.program, self.program.defaults, self.inputs, np.ones(len(self.program.states.names))
        )
        return nominal_magnitudes(constraints, (), self.start, stretches).values

    def at(self, times: Any, states: Any) -> tuple[Any, Any]:
        """Rates and outputs at instants and states; (samples, n) and (samples, m)."""
        rates, outputs = [], []
        with np.errstate(all="ignore"):
            for time, x in zip(times, states, strict=True):
                mode = self.program.mode_at(time, x, self.inputs, self.constants)
                arguments = (time, x, self.inputs, self.constants, mode)
                rates.append(self.program.derivative(*arguments))
                outputs.append(self.program.output(*arguments))
        return np.array(rates), np.array(outputs)

    def samples(self) -> tuple[Any, Any]:
        """Random instants and states around the start, at which everything has a value."""
        random = np.random.default_rng(5)
        size = self.magnitudes() if len(self.start) else self.start
        times = random.uniform(0.05, 1.0, SAMPLES) * self.horizon
        pattern = random.uniform(-1, 1, (SAMPLES, len(self.start)))
        for spread in (SPREAD, SPREAD**3, SPREAD**6, 0.0):
            states = self.start + spread * pattern * size
            if all(np.isfinite(v).all() for v in self.at(times, states)):
                return times, states
        raise AssertionError("not even at the start has everything a value")

    def share(self) -> float:
        """Of the time of a run: how much of it can be gone in `STEPS` equal steps whose equations Newton's method solves."""
        for share in (
            0.1937,
            0.01937,
            1.937e-3,
            1.937e-4,
            1.937e-5,
            1.937e-6,
        ):  # no step ends or halves where a source jumps
            values, solved = self.march(share, self.horizon)
            if solved and np.isfinite(values).all():
                return share
        raise AssertionError("no step can be solved")

    def march(self, share: float, horizon: float) -> tuple[Any, bool]:
        """Outputs after each of some equal steps of the implicit midpoint rule, its equations solved to the last digits.

        Steps of their own length make results of two texts comparable to round-off: a solver with error control takes
        decisions, and where rounding tips one of them the results differ by as much as the tolerance.
        """
        x, size, step = self.start.copy(), self.magnitudes() if len(self.start) else None, share * horizon / STEPS
        times, states, solved = [0.0], [x], True
        with np.errstate(all="ignore"):
            for i in range(STEPS):
                if len(x):
                    change = self._middle((i + 0.5) * step, x, size, step)
                    x, solved = x + change[0], solved and change[1]
                times.append((i + 1) * step)
                states.append(x)
        return self.at(times, states)[1], solved

    def _middle(self, time: float, x: Any, size: Any, step: float) -> tuple[Any, bool]:
        """The change of the state in one step, by Newton's method, and whether it converged."""
        change, before = np.zeros_like(x), np.inf
        for _ in range(10):
            middle = x + change / 2
            mode = self.program.mode_at(time, middle, self.inputs, self.constants)
            fixed = (self.inputs, self.constants, mode)
            rest = (step * self.program.derivative(time, middle, *fixed) - change) / size
            slope = self.program.jacobian(time, middle, *fixed) * size / size[:, None]
            if not (np.isfinite(rest).all() and np.isfinite(slope).all()):
                return change, False
            update = np.linalg.solve(np.eye(len(x)) - step / 2 * slope, rest)
            change = change + update * size
            before = np.abs(update).max()
            if before < 1e-15:
                break
        return change, before < 1e-10

    def run(self, rtol: float, share: float = 1.0, points: int = 41) -> Any:
        """Results at equally spaced instants; (points, m)."""
        result = self.model.simulate(
            self.experiment, to=share * self.horizon, rtol=rtol, points=points, outputs=self.outputs
        )
        return np.array([result[name] for name in self.program.outputs.names]).T


# ---------------------------------------------------------------- comparing


CANCELS = 1e-2  # below this share of another output of its unit, what is left may be a difference; solvers use it, too


def largest(values: Any, units: Sequence[str]) -> Any:
    """Scale of differences in each column: the largest magnitude in it; 1 for a column of zeros."""
    found = np.abs(values).max(axis=0, initial=0.0)
    for unit in set(units):
        same = np.array([u == unit for u in units])
        found[same] = np.maximum(found[same], CANCELS * found[same].max())
    return np.where(found > 0, found, 1.0)


def difference(first: Any, second: Any, units: Sequence[str]) -> float:
    """The largest difference, relative to the largest magnitudes of its column."""
    assert first.shape == second.shape, f"{first.shape} against {second.shape}"
    same = np.isnan(first) & np.isnan(second)
    apart = np.where(same, 0.0, np.abs(first - second))
    return float((apart / largest(first, units)).max(initial=0.0))


def order(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Positions of the wanted names."""
    missing = set(wanted) - set(names)
    assert not missing, f"{sorted(missing)} not among {list(names)}"
    return [names.index(w) for w in wanted]
