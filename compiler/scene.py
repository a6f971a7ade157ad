"""Scene: a run's request to a model. Experiment, settings from outside, adjustable quantities, outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from .fast_dataclass import dataclass
from .source import Span

if TYPE_CHECKING:
    from .algebra.expression import Expression as Formula
    from .chance import Distribution
    from .equations.products import Integrand
    from .graph.valves import Valve
    from .syntax.tree import ExpressionSyntax


def full_name(words: str) -> str:
    """Return the name of a quantity, however its spaces are written: `K[1,2]` is `K[1, 2]`."""
    return words.replace(" ", "").replace(",", ", ")


@dataclass(frozen=True, slots=True)
class Override:
    """A parameter or input set from outside: an expression of the text, a number in SI, or (None) a number that only a run knows.

    The last one is an argument of the program: no stage may depend on its value, so one program serves all its values.
    """

    path: str
    value: ExpressionSyntax | float | None
    span: Span = field(compare=False)
    role: str = "set"  # set or start


@dataclass(frozen=True, slots=True)
class Scene:
    """One use of a model.

    `experiment`: its name, "" for the first of the model, None for none. `free`: parameters and inputs that stay arguments
    of the program for all values ("*" for all of them). `outputs`: only these are needed (None: those that the experiment
    reports, else all).
    """

    model: str | None = None
    experiment: str | None = ""
    overrides: tuple[Override, ...] = ()
    free: frozenset[str] = frozenset()
    outputs: tuple[str, ...] | None = None
    # name -> expression of the model that is an output in this scene alone
    extra_outputs: tuple[tuple[str, str], ...] = ()
    # port of the model -> `effort` or `flow`, which comes from outside by an input; the other one is an output
    ports: tuple[tuple[str, str], ...] = ()
    # one unit of the model cut at the ports of some instances: its name, and the instances
    unit: tuple[str, tuple[str, ...]] | None = None
    # storage -> integral or derivative, chosen again in the middle of a run
    preferences: tuple[tuple[str, str], ...] = ()
    by: tuple[str, ...] = ()  # additional quantities to differentiate by; those that nothing reads are left out
    off: tuple[str, ...] | None = None  # junctions that are off; None: as at the start
    # of the settings, and of what is free: a zero is fixed for the whole run, as in the text
    fixed: frozenset[str] = frozenset()
    conserving: bool = False  # the run asks for the stored energy and its slopes at each step
    companion: bool = False  # the companion network instead of the model; `off` are then its other switched junctions
    # loops are cut at both variables of each nonlinear law in them, for a solution that has to be looked for
    opened: bool = False
    steep: bool = False  # roots that pass through zero are unknowns of the steps
    from_start: bool = False  # a run from the starts, which leaves out states that nothing excites
    joined: bool = False  # all sets of switched junctions in one program, as `off=()`
    upstream: bool = False  # an analysis without the states on which none of `outputs` depends


@dataclass(frozen=True, slots=True)
class Reported:
    """An output as a report shows it: value in SI * 1/scale - offset, in `unit`."""

    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Swept:
    """A parameter or input, or a name of the experiment, that takes several values in SI one after the other."""

    name: str
    values: tuple[float, ...]
    unit: str
    words: tuple[str, ...] = ()  # of a choice, or the texts: then the values are places among them, from 1


@dataclass(frozen=True, slots=True)
class Study:
    """An analysis step without names of its own, as `equilibrium`; or a `response` from an input to an output over frequencies in Hz."""

    role: str
    given: str = ""
    seen: str = ""
    low: float = 0.0
    high: float = 0.0
    points: int = 0


@dataclass(frozen=True, slots=True)
class Linearizing:
    """`linearize`: inputs and outputs of the linear model; without names, the model's inputs and all outputs."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    role: str = "linearize"


@dataclass(frozen=True, slots=True)
class Differentiating:
    """`sensitivity`: parameters by which the results of the other steps are differentiated; all if none are named."""

    by: tuple[str, ...]
    role: str = "sensitivity"


@dataclass(frozen=True, slots=True)
class ContinuationRequest:
    """`continue`: equilibria while a parameter or input goes from `low` to `high`. `points`: the range over the first step."""

    name: str
    low: float
    high: float
    points: int = 50
    most: int = 2000
    branches: bool = False
    role: str = "continue"


@dataclass(frozen=True, slots=True)
class TargetValue:
    """Target value of an output, in SI; along a path a `text` over time and numbers alone."""

    output: str
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True, slots=True)
class Inverting:
    """`invert`: inputs, or pairs `push/pull`, that produce the targets: at rest (`stop` None), or from `start` to `stop`."""

    inputs: tuple[str, ...]
    wanted: tuple[TargetValue, ...]
    start: float = 0.0
    stop: float | None = None
    points: int = 501
    moving: bool = False
    limits: tuple[tuple[str, float], ...] = ()
    role: str = "invert"


@dataclass(frozen=True, slots=True)
class MonteCarloRequest:
    """`montecarlo`: the results of the other steps at `samples` points.

    `vary`: parameters and their distributions (from Python also as texts). `indices`: number of rows for Sobol indices, a power of two; 0: none,
    None: as many as samples up to 1024.
    """

    vary: tuple[tuple[str, Distribution | str], ...]
    correlations: tuple[tuple[tuple[str, str], float], ...] = ()
    samples: int = 1000
    seed: int = 0
    indices: int | None = None
    role: str = "montecarlo"


@dataclass(frozen=True, slots=True)
class BoundedParameter:
    """A parameter that a fit determines between bounds in SI (None: it keeps its sign); `start` None: its value in the model."""

    name: str
    low: float | None = None
    high: float | None = None
    logarithmic: bool = False
    start: float | None = None


@dataclass(frozen=True, slots=True)
class Fitting:
    """`fit`: the parameters that explain measured files. `measured`: quantities in the headings.

    `explain`: report which few parameters would suffice (None: if some remain undetermined).
    """

    sought: tuple[BoundedParameter, ...]
    files: tuple[str, ...]
    measured: tuple[str, ...]
    explain: bool | None = None
    role: str = "fit"


Analysis = Study | Linearizing | Differentiating | ContinuationRequest | Inverting | MonteCarloRequest | Fitting


@dataclass(frozen=True, slots=True)
class Plan:
    """Plan of a run, as its experiment gives it, in SI."""

    experiment: str | None
    start: float = 0.0
    stop: float | None = None
    settings: Mapping[str, float] = field(default_factory=dict)  # rtol, atol, points
    solver: str | None = None  # one of `solvers.SOLVERS`
    bandwidth: float | None = None  # in cycles per second: faster modes need not be followed
    tolerances: Mapping[str, float] = field(default_factory=dict)  # variable -> absolute tolerance
    report: tuple[Reported, ...] = ()
    equilibrium: bool = False  # the run starts where all rates vanish
    sweeps: tuple[Swept, ...] = ()  # the last runs fastest
    studies: tuple[Analysis, ...] = ()  # in the order of the experiment


@dataclass(frozen=True, slots=True)
class RunMetadata:
    """Data that a run needs in addition to the program and the plan."""

    mechanisms: tuple[str, ...]
    storages: tuple[str, ...]
    claims: bool  # True if the author gave starts to computed variables
    shown: Mapping[str, int]  # outputs that are states or unknowns -> which
    units: Mapping[str, str]  # of quantities set when a run begins
    positive: tuple[tuple[str, Formula], ...]  # expressions that must not be negative, over parameters by name
    truths: frozenset[str]
    counted: frozenset[str]  # set with a unit, though a bare number would fit
    looped: frozenset[str]  # quantities set when a run begins, on which the solution of a linear loop depends
    identity: str = ""  # of the equations: a run continues only from a result of the same
    # Variables and outputs that share a state: the state, and the factor if no parameter determines it.
    following: Mapping[str, tuple[int, float | None]] = field(default_factory=dict)
    valves: tuple[Valve, ...] = ()  # switched junctions that act together
    gaps: tuple[str, ...] = ()  # all two-terminal switches, valves first
    # rates of signals with memory, where junctions switch: impulses pass into them
    integrals: tuple[Integrand, ...] = ()
    # of opened loops: row, argument and value as places among the unknowns, and whether the argument is an effort
    laws: tuple[tuple[int, int, int, bool], ...] = ()
    zero_divisors: frozenset[frozenset[str]] = frozenset()  # where all of a set are zero, the equations divide by zero
    steep: bool = False  # a root passes through zero, where it is infinitely steep
    undetermined: tuple[str, ...] = ()  # notes on shares of switches that conditions or laws read
