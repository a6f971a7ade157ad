"""What a run asks of a model: which experiment, what is set from outside, what must stay adjustable, what to report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from .nouns import dataclass
from .source import Span

if TYPE_CHECKING:
    from .algebra.expression import Expression as Formula
    from .graph.valves import Valve
    from .syntax.tree import Expression


# What an experiment may ask to solve with: the run chooses; matrix exponential, explicit pair, Radau, Rodas5P, a method that conserves energy.
SOLVERS = ("automatic", "exponential", "explicit", "radau", "rodas", "energy")


@dataclass(frozen=True, slots=True)
class Override:
    """A parameter or input set from outside: an expression of the text, a number in SI, or (None) a number that only a run knows.

    The latter is an argument of the program: no stage may depend on its value, so one program serves all its values.
    """

    path: str
    value: Expression | float | None
    span: Span = field(compare=False)
    role: str = "set"  # set or start


@dataclass(frozen=True, slots=True)
class Scene:
    """One use of a model.

    `experiment`: its name, "" for the first of the model, None for none. `free`: parameters and inputs that stay arguments
    of the program whatever their value ("*" for all of them). `outputs`: only these are needed (None: what the experiment
    reports, else all).
    """

    model: str | None = None
    experiment: str | None = ""
    overrides: tuple[Override, ...] = ()
    free: frozenset[str] = frozenset()
    outputs: tuple[str, ...] | None = None
    preferences: tuple[
        tuple[str, str], ...
    ] = ()  # storage -> integral or derivative, chosen anew in the middle of a run
    by: tuple[
        str, ...
    ] = ()  # quantities by which everything is differentiated as well; those that nothing reads are left out
    off: tuple[str, ...] | None = None  # junctions that are off; None: as at the start
    fixed: frozenset[str] = frozenset()  # of what is set: a zero there is one for the whole run, as if the text said so
    conserving: bool = False  # the run asks for the stored energy and its slopes at each step
    companion: bool = (
        False  # instead of the model itself its companion network; `off` are then its other switched junctions
    )
    opened: bool = (
        False  # loops are cut at both variables of each nonlinear law in them, for a solution that has to be looked for
    )


@dataclass(frozen=True, slots=True)
class Reported:
    """An output as a report shows it: value in SI * 1/scale - offset, in `unit`."""

    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Swept:
    """A parameter or input, or a name of the experiment's own, that takes several values in SI one after the other."""

    name: str
    values: tuple[float, ...]
    unit: str


@dataclass(frozen=True, slots=True)
class Study:
    """A step that is no simulation: `equilibrium`, `modes` or `response`, the last from an input to an output over frequencies in Hz."""

    role: str
    given: str = ""
    seen: str = ""
    low: float = 0.0
    high: float = 0.0
    points: int = 0


@dataclass(frozen=True, slots=True)
class Linearizing:
    """`linearize`: from these to those; the model's inputs and all outputs if none are named."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    role: str = "linearize"


@dataclass(frozen=True, slots=True)
class Differentiating:
    """`sensitivity`: of what the other steps find, by these; by all parameters if none are named."""

    by: tuple[str, ...]
    role: str = "sensitivity"


@dataclass(frozen=True, slots=True)
class Following:
    """`continue`: states of rest while a parameter or input goes from `low` to `high`. `points`: the range over the first step."""

    name: str
    low: float
    high: float
    points: int = 50
    most: int = 2000
    branches: bool = False
    role: str = "continue"


@dataclass(frozen=True, slots=True)
class Wish:
    """What an output shall be, in SI; along a path a `text` over time and numbers alone."""

    output: str
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True, slots=True)
class Inverting:
    """`invert`: the inputs, or pairs `push/pull`, that give what is wanted: at rest (`stop` None), or from `start` to `stop`."""

    inputs: tuple[str, ...]
    wanted: tuple[Wish, ...]
    start: float = 0.0
    stop: float | None = None
    points: int = 501
    moving: bool = False
    limits: tuple[tuple[str, float], ...] = ()
    role: str = "invert"


@dataclass(frozen=True, slots=True)
class Drawn:
    """A distribution of a quantity: one of `DISTRIBUTIONS`, cut off at `low` and `high`, in SI."""

    name: str
    kind: str
    numbers: tuple[float, ...]
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True)
class Varying:
    """`montecarlo`: what the other steps find at `samples` points. `indices`: rows that Sobol indices stand on."""

    vary: tuple[Drawn, ...]
    correlations: tuple[tuple[tuple[str, str], float], ...] = ()
    samples: int = 1000
    seed: int = 0
    indices: int | None = None
    role: str = "montecarlo"


@dataclass(frozen=True, slots=True)
class Unknown:
    """A parameter that a fit looks for between bounds in SI (None: it keeps its sign)."""

    name: str
    low: float | None = None
    high: float | None = None
    logarithmic: bool = False


@dataclass(frozen=True, slots=True)
class Fitting:
    """`fit`: the parameters that explain measured files. `measured`: what the headings name; `explain`: tell which few parameters
    would do alone (None: if some stay open)."""

    sought: tuple[Unknown, ...]
    files: tuple[str, ...]
    measured: tuple[str, ...]
    explain: bool | None = None
    role: str = "fit"


Analysis = Study | Linearizing | Differentiating | Following | Inverting | Varying | Fitting


@dataclass(frozen=True, slots=True)
class Plan:
    """What an experiment says about its run, in SI."""

    experiment: str | None
    start: float = 0.0
    stop: float | None = None
    settings: Mapping[str, float] = field(default_factory=dict)  # rtol, atol, points
    solver: str | None = None  # one of `SOLVERS`
    bandwidth: float | None = None  # in cycles per second: what is faster need not be followed
    tolerances: Mapping[str, float] = field(default_factory=dict)  # variable -> absolute tolerance
    report: tuple[Reported, ...] = ()
    equilibrium: bool = False  # the run starts where all rates vanish
    sweeps: tuple[Swept, ...] = ()  # the last runs fastest
    studies: tuple[Analysis, ...] = ()  # in the order of the experiment


@dataclass(frozen=True, slots=True)
class Facts:
    """What a run asks of a model besides its program and its plan."""

    mechanisms: tuple[str, ...]
    storages: tuple[str, ...]
    claims: bool  # whether the author gave starts to what is computed
    shown: Mapping[str, int]  # outputs that are states or unknowns -> which
    units: Mapping[str, str]  # of what is set when a run begins
    positive: tuple[tuple[str, Formula], ...]  # what is never negative, over parameters by name
    looped: frozenset[str]  # what is set when a run begins and decides whether a linear loop has a solution
    identity: str = ""  # of the equations: a run goes on only from what was computed with the same
    # What shares a state, and outputs that are: which state, and by what factor if no parameter decides it.
    following: Mapping[str, tuple[int, float | None]] = field(default_factory=dict)
    valves: tuple[Valve, ...] = ()  # switched junctions that act together
    gaps: tuple[str, ...] = ()  # all two-terminal switches, valves first
    integrals: tuple[str, ...] = ()  # signals with memory, where junctions switch: impulses pass into them
    laws: tuple[
        tuple[int, int, int, bool], ...
    ] = ()  # of opened loops: row, argument and value as places among the unknowns, and whether the argument is an effort
