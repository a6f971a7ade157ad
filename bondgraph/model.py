"""A model: its text, its stages, its runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from . import door
from .errors import UsageError

if TYPE_CHECKING:
    import networkx

    from .analysis.branch import Branch
    from .analysis.equilibrium import Equilibrium
    from .analysis.inversion.feed_forward import FeedForward
    from .analysis.inversion.static import Inversion
    from .analysis.linear import Linearization
    from .analysis.modes import Modes
    from .analysis.operating_point import Asked, OperatingPoint
    from .analysis.outcome import Outcome
    from .analysis.port_hamiltonian import PortHamiltonian, SymbolicPortHamiltonian
    from .analysis.response import Measured, Response
    from .analysis.run_sensitivity import RunSensitivity
    from .analysis.sensitivity import Sensitivity
    from .diagram.figure import Figure
    from .door import Certificate, Compilation, Diagnostic, Override, Scene, Source, StateSpace
    from .ensembles import Ensemble
    from .prepared import Prepared
    from .results import Result
    from .studies.distributions import Distribution
    from .studies.fit import Sought
    from .studies.fitted import Fit
    from .studies.journal import Journal
    from .studies.measured import Measurements
    from .studies.sharing import Sharing
    from .studies.tolerances import MonteCarlo
    from .views.equations import Equations

LIBRARY = Path(__file__).with_name("library")
MOST_KEPT = 64  # scenes of which stages and programs are kept
STAGES = ("syntax", "graph", "causality", "equations", "reduction", "code", "text")


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter or constant of a model, nested ones by their path: value in SI, unit, description."""

    value: float
    unit: str
    description: str


def load(path_or_text: str | Path, model: str | None = None) -> Model:
    """A model from a file, or from a text with at least one line break or brace.

    `model` names one of several. Nothing is compiled yet: mistakes are told when something is asked of the model, or by
    `check`. Raises OSError if the file cannot be read.
    """
    return Model(_source(path_or_text), model)


def check(path_or_text: str | Path, model: str | None = None) -> tuple[Diagnostic, ...]:
    """Everything that is wrong with a file or text; empty if nothing is."""
    return tuple(door.check_source(_source(path_or_text), model, LIBRARY))


def certify(path_or_text: str | Path, model: str | None = None) -> tuple[tuple[Diagnostic, ...], Certificate | None]:
    """As `check`; and if nothing is wrong, what kind of equations a run solves (None for a file of parts)."""
    return door.examine(_source(path_or_text), model, LIBRARY)


def _source(path_or_text: str | Path) -> Source:
    if isinstance(path_or_text, str) and ("\n" in path_or_text or "{" in path_or_text):
        return door.Source("text", path_or_text)
    path = Path(path_or_text)
    return door.Source(str(path_or_text), door.read_text(path), path)


class Model:
    """One model of a text. Compiled when it is first asked; raises `CompilationFailed` with all that is wrong."""

    def __init__(self, source: Source, model: str | None = None) -> None:
        self.source = source
        self.model = model
        self._compilations: dict[tuple[Scene, bool], Compilation] = {}
        self._prepared: dict[tuple[Scene, bool, str], Prepared] = {}

    def __repr__(self) -> str:
        return f"<bondgraph model {self.model or ''} of {self.source.name}>"

    def compilation(self, scene: Scene | None = None, everything: bool = False) -> Compilation:
        """The compiler's stages for one scene (default: no experiment)."""
        scene = scene if scene is not None else door.Scene(self.model, None)
        key = (scene, everything)
        if key not in self._compilations:
            compilation = door.Compilation(self.source, scene, LIBRARY, everything)
            if self._compilations:  # the text is parsed once
                compilation.__dict__["tree"] = next(iter(self._compilations.values())).tree
            like = self._compilations.get((replace(scene, preferences=(), off=None), everything))
            if like is not None and "_built" in like.__dict__:  # and opened once
                compilation.__dict__["_built"] = like.__dict__["_built"]
            _kept(self._compilations, key, compilation)
        return self._compilations[key]

    @property
    def compiled(self) -> int:
        """How many scenes are held in compiled form."""
        return len(self._compilations)

    def forget(self) -> None:
        """Let go of all that was compiled; it is made anew, or fetched from the cache, where it is asked for again."""
        self._compilations.clear()
        self._prepared.clear()

    def prepared(self, scene: Scene, everything: bool, target: str) -> Prepared:
        """The program for one scene and what a run asks besides; from the cache if it has been there before."""
        from .prepared import Prepared

        key = (scene, everything, target)
        if key not in self._prepared:
            made = Prepared(self.source, scene, everything, target, lambda: self.compilation(scene, everything))
            _kept(self._prepared, key, made)
        return self._prepared[key]

    @cached_property
    def name(self) -> str:
        """The model's name."""
        return self.compilation().whole_graph.name

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """All parameters and constants by path, those of instances included, with their values in SI."""
        quantities = self.compilation().whole_graph.quantities
        return {
            n: Parameter(q.value, q.unit, q.description)
            for n, q in quantities.items()
            if q.value is not None and q.role in ("parameter", "constant")
        }

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """The inputs of the model itself."""
        return tuple(
            n for n, q in self.compilation().whole_graph.quantities.items() if q.role == "input" and "." not in n
        )

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """The declared outputs."""
        return tuple(self.compilation().whole_graph.outputs)

    @cached_property
    def states(self) -> tuple[str, ...]:
        """All states, whatever the outputs need."""
        space = self.compilation(everything=True).state_space
        return tuple(space.variables[s.variable].name for s in space.states)

    @property
    def certificate(self) -> Certificate:
        """What kind of equations the model has, whatever the outputs need; `print` it, or read its fields."""
        return self.compilation(everything=True).certificate

    @property
    def graph(self) -> networkx.MultiDiGraph:
        """The bond graph in networkx; nodes carry `node=`, edges (half arrows) `bond=`."""
        return self.compilation().whole_graph.network

    def draw(
        self, path: str | Path | None = None, experiment: str | None = None, closed: bool = False, numbers: bool = False
    ) -> Figure:
        """The bond graph in a textbook's notation, into a .svg, .png or .pdf file if a path is given.

        Drawn is everything that the text says; with an experiment what is left of it in that run. `closed`: instances are
        boxes. `numbers`: with the numbers of the bonds. Raises `CompilationFailed`, `UsageError`, `MissingPackage`, OSError.
        """
        from .diagram import draw, write_figure

        free = frozenset({"*"}) if experiment is None else frozenset[str]()  # nothing counts as zero
        figure = draw(self.compilation(door.Scene(self.model, experiment, free=free)), closed, numbers)
        if path is not None:
            write_figure(figure, path)
        return figure

    def draw_mechanism(
        self,
        path: str | Path | None = None,
        name: str | None = None,
        experiment: str | None = "",
        at: str | float | None = None,
        modes: int = 0,
    ) -> Figure:
        """A mechanism of the model (by name, if there are several), into a .svg, .png or .pdf file if a path is given.

        Drawn in the reference configuration, or with `at` where an experiment has it at that time (text with a unit, or s), or as
        its first `modes` move it from rest. Raises `CompilationFailed`, `RunFailed`, `UsageError`, `MissingPackage`, OSError.
        """
        from .diagram import mechanism_of, shapes_of, write_figure

        figure = shapes_of(self, experiment or None, name, modes) if modes else mechanism_of(self, name, experiment, at)
        if path is not None:
            write_figure(figure, path)
        return figure

    def _repr_html_(self) -> str:
        """Certificate, bond graph and names, for notebooks; or what is wrong."""
        from .page.notebook import model_html

        return model_html(self)

    def _repr_svg_(self) -> str | None:
        """The bond graph, for notebooks; None of one that is too large to be drawn unasked."""
        from .page.notebook import picture

        return picture(self) or None

    # ------------------------------------------------------------ equations and stages
    def state_equations(self) -> Equations:
        """The state equations in sympy: a mapping from state to the right side, over parameters, states and inputs.

        Linear loops are solved symbolically. Unknowns of nonlinear loops stay, and `algebraic_equations` binds them.
        """
        from .views.equations import state_equations

        with door.uncollected():
            return state_equations(self._with_inputs().state_space)

    def algebraic_equations(self) -> Equations:
        """The equations of nonlinear loops in sympy: a mapping from unknown to an expression that vanishes; often empty."""
        from .views.equations import algebraic_equations

        return algebraic_equations(self._with_inputs().state_space)

    def port_hamiltonian(
        self,
        state: Mapping[str, float] | None = None,
        settings: Mapping[str, str | float] | None = None,
        time: float = 0.0,
    ) -> PortHamiltonian:
        """E x' = (J - R) z + G u with E' z = grad H at a state (by name, in SI; the rest at its start), J skew, R not negative.

        Raises `UsageError` for what has no such form (mechanisms, heat from loss) and where resistors create energy.
        """
        from .analysis.port_hamiltonian import port_hamiltonian

        compilation = self.compilation(self.scene(None, settings), everything=True)
        return port_hamiltonian(compilation, state or {}, time)

    def symbolic_port_hamiltonian(self) -> SymbolicPortHamiltonian:
        """J, R, G and H in sympy, for linear resistors and no storage in derivative form. Raises `UsageError`."""
        from .analysis.port_hamiltonian import symbolic_port_hamiltonian

        return symbolic_port_hamiltonian(self._with_inputs())

    def ordered_equations(self) -> StateSpace:
        """The equations step by step, in the order in which they are computed, with every input as a symbol."""
        return self._with_inputs().state_space

    def equations(self, latex: bool = False) -> str:
        """The causally ordered equations as text, or as LaTeX."""
        from .views.equations import equations_text

        return equations_text(self._with_inputs().state_space, latex)

    def _with_inputs(self) -> Compilation:
        """The equations with every input as a symbol; where a storage would need an input's derivative, with its default."""
        free = self.compilation(door.Scene(self.model, None, free=frozenset(self.inputs)), everything=True)
        try:
            _ = free.state_space
            return free
        except door.CompilationFailed as failed:
            if any(d.code != "BG503" for d in failed.diagnostics):
                raise
            return self.compilation(everything=True)

    def show(self, stage: str, experiment: str | None = "") -> str:
        """One stage of the compiler as stable text; `STAGES` lists them."""
        if stage not in STAGES:
            raise UsageError(f"there is no stage `{stage}`; stages are {', '.join(STAGES)}")
        from .views.stages import stage_text

        return stage_text(self.compilation(door.Scene(self.model, experiment)), stage)

    def text(self, experiment: str | None = None) -> str:
        """The model as one flat model in the language, which compiles to an equal graph; with an experiment, as it sets it.

        Instances and loops are opened, numbers stand in SI. Raises `CompilationFailed`, also if something cannot be written.
        """
        return door.write_text(self.compilation(door.Scene(self.model, experiment)).whole_graph)

    def compile(self, target: str = "numpy") -> str:
        """The source of a program of its own, numpy or C, with every parameter and input as an argument."""
        if target not in ("numpy", "c"):
            raise UsageError(f"there is no target `{target}`; targets are numpy, c")
        made = self.compilation(door.Scene(self.model, None, free=frozenset({"*"})))
        return made.c_source if target == "c" else made.program.source

    # ------------------------------------------------------------ analyses
    def operating_point(self, asked: Asked | None = None) -> OperatingPoint:
        """The model at one state and instant, with the slopes of everything; what the analyses below stand on.

        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if there is no such state.
        """
        from .analysis.operating_point import Asked, operating_point

        return operating_point(self, asked or Asked())

    def equilibrium(
        self, experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        outputs: tuple[str, ...] | None = None, time: float | None = None,
    ) -> Equilibrium:  # fmt: skip
        """The state of rest that is reached from the start, inputs held as they are at `time` (s; None: where the experiment begins).

        `experiment`: None none, "" the first; what it sets and where it starts counts. Raises as `operating_point`.
        """
        from .analysis.equilibrium import equilibrium
        from .analysis.operating_point import Asked

        return equilibrium(self.operating_point(Asked(experiment, settings, outputs, time=time)))

    def linearize(
        self, inputs: tuple[str, ...] | None = None, outputs: tuple[str, ...] | None = None,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        state: str | Mapping[str, float] = "equilibrium", time: float | None = None,
    ) -> Linearization:  # fmt: skip
        """A, B, C, D by the exact derivatives of the equations, from `inputs` (None: the model's; parameters and signals may be such,
        too) to `outputs` (None: all), at the equilibrium, the "start", or given states (by name, in SI). Raises as `operating_point`."""
        from .analysis.linear import linearization
        from .analysis.operating_point import Asked

        by = self.inputs if inputs is None else tuple(inputs)
        return linearization(self.operating_point(Asked(experiment, settings, outputs, by, state, time)))

    def modes(
        self, experiment: str | None = None, settings: Mapping[str, str | float] | None = None,
        state: str | Mapping[str, float] = "equilibrium", time: float | None = None,
    ) -> Modes:  # fmt: skip
        """Frequencies (Hz), damping, shapes and the energy of each element, at the equilibrium, the "start" or given states."""
        from .analysis.modes import modes
        from .analysis.operating_point import Asked

        return modes(self.operating_point(Asked(experiment, settings, state=state, time=time)))

    def sensitivity(
        self, parameters: tuple[str, ...] | str | None = None, of: str | tuple[str, ...] = ("equilibrium", "modes"),
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, outputs: tuple[str, ...] | None = None,
        time: float | None = None,
    ) -> Sensitivity:  # fmt: skip
        """Derivatives of outputs at rest and of frequencies and damping by parameters or inputs (None: all parameters that follow
        from no others), exact. One that follows from others is taken by itself, the others held. Raises as `operating_point`."""
        from .analysis.operating_point import Asked
        from .analysis.sensitivity import independent, sensitivity

        by, fixed = independent(self, _names(parameters), experiment, settings or {})
        point = self.operating_point(Asked(experiment, fixed, outputs, by, time=time))
        return sensitivity(point, (of,) if isinstance(of, str) else of)

    def sensitivity_of_run(
        self, parameters: tuple[str, ...] | str | None = None, experiment: str | None = "", settings: Mapping[str, str | float] | None = None,
        to: str | float | None = None, points: int = 101, outputs: tuple[str, ...] | None = None, rtol: float = 1e-8,
    ) -> RunSensitivity:  # fmt: skip
        """Derivatives of a run's outputs at all instants by parameters or inputs, integrated beside the states (no differences). Steps whose
        instants move with a parameter count. Raises as `simulate`, and `UsageError` for events, delays and closing joints."""
        from .analysis.run_sensitivity import run_sensitivity

        return run_sensitivity(self, _names(parameters), experiment, settings or {}, outputs, None, to, points, rtol)

    def continuation(
        self, parameter: str, low: str | float, high: str | float, points: int = 50, most: int = 2000, experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, outputs: tuple[str, ...] | None = None, branches: bool = False,
    ) -> Branch:  # fmt: skip
        """The branch of states of rest from `low` towards `high` of a parameter or input, round its folds, until it leaves that range
        or has `most` points; `points` is the range over the first step. `branches`: those that cross it too. Raises as `operating_point`."""
        from .analysis.branch import follow
        from .analysis.operating_point import Asked
        from .analysis.sensitivity import independent
        from .quantities import quantity

        _, fixed = independent(self, (parameter,), experiment, settings or {})
        unit = self.compilation(self.scene(experiment, settings)).whole_graph.quantities[parameter].unit
        first, last = (quantity(v, unit, parameter) if isinstance(v, str) else float(v) for v in (low, high))
        asked = Asked(experiment, {**fixed, parameter: first}, outputs, (parameter,))
        return follow(self.operating_point(asked), parameter, first, last, points, most, branches)

    @overload
    def invert(
        self, targets: Mapping[str, str | float], inputs: Sequence[str], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None,
    ) -> Inversion: ...  # fmt: skip

    @overload
    def invert(
        self, targets: Mapping[str, str | float], inputs: Sequence[str], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, *, to: str | float, start: str | float = 0.0, points: int = 501,
        moving: bool = False, limits: Mapping[str, str | float] | None = None,
    ) -> FeedForward: ...  # fmt: skip

    def invert(
        self, targets: Mapping[str, str | float], inputs: Sequence[str], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, *, to: str | float | None = None, start: str | float = 0.0, points: int = 501,
        moving: bool = False, limits: Mapping[str, str | float] | None = None,
    ) -> Inversion | FeedForward:  # fmt: skip
        """Inputs that give outputs. Of `inputs`, `push1/pull1` is a pair of which one is zero; there are as many inputs or pairs as targets.

        Without `to`: inputs that hold outputs at their `targets` (texts with units, or SI), at rest. With it: inputs over time, from `start`
        to `to`, with which outputs go along `targets`, expressions of time such as "8 um*smoothstep9(time, 0 s, 5 ms)"; from
        rest, unless the model is `moving`. `limits`: how large inputs may be. Raises as `operating_point`, `RunFailed` if there are none, and
        `UsageError` where a path is not smooth enough.
        """
        from .analysis.inversion.asking import inverted

        along = None if to is None else (start, to, points, moving, limits or {})
        return inverted(self, targets, inputs, experiment, dict(settings or {}), along)

    def response(
        self, inputs: tuple[str, ...] | str | None = None, outputs: tuple[str, ...] | str | None = None,
        low: float | None = None, high: float | None = None, points: int = 400, experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, state: str | Mapping[str, float] = "equilibrium", time: float | None = None,
    ) -> Response:  # fmt: skip
        """The frequency response, exact from the linear model, from `low` to `high` in Hz (None: a decade around its modes)."""
        from .analysis.response import response

        linear = self.linearize(_names(inputs), _names(outputs), experiment, settings, state, time)
        return response(linear, low, high, points)

    def excite(
        self, given: str, seen: str, frequency: float, amplitude: float, experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, rtol: float = 1e-9,
    ) -> Measured:  # fmt: skip
        """One point of a frequency response as an experimenter finds it: `given` moves harmonically about its value, by `amplitude` in
        SI, until all transients are gone, and `seen` is taken apart into harmonics. Raises as `simulate`, and `UsageError` if it never settles."""
        from .analysis.excitation import excite

        return excite(self, given, seen, frequency, amplitude, experiment, dict(settings or {}), rtol)

    # ------------------------------------------------------------ experiments and sweeps
    def run(
        self, experiment: str = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: tuple[str, ...] | None = None, target: str | None = None, executor: Any = None, solver: str | None = None,
        sharing: Sharing | None = None, bandwidth: str | float | None = None,
    ) -> Outcome:  # fmt: skip
        """All that an experiment says: its sweeps, analyses and simulation; "" the first. Arguments as `simulate` takes them.

        `executor`: of the standard interface (`concurrent.futures`, a Dask client): its workers make the points. `sharing`
        says more: workers of our own, a journal to go on from after a crash, progress.
        """
        from .studies.experiment import Options, run

        options = Options(to, points, rtol, atol, energy, target, solver, bandwidth, outputs)
        return run(self, experiment, settings or {}, options, _sharing(sharing, executor))

    def sweep(
        self, values: Mapping[str, str | Sequence[str | float]], of: str | tuple[str, ...] = "simulate", together: bool = False,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, outputs: tuple[str, ...] | None = None, executor: Any = None,
        solver: str | None = None, sharing: Sharing | None = None, bandwidth: str | float | None = None,
    ) -> Outcome:  # fmt: skip
        """`of` equilibrium, modes or simulate, or several of them, at each point of a grid of `values` (texts with units, numbers in SI, or
        one text, `1 mm .. 2 mm : 11`), the last name running fastest; `together`: the first of each, the second of each and
        so on. `executor` and `sharing` as in `run`. A point that fails is NaN in the table, and `failures` says why."""
        from .studies.experiment import Options
        from .studies.sweep import sweep

        steps = (of,) if isinstance(of, str) else tuple(of)
        options = Options(to, points, rtol, outputs=outputs, solver=solver, bandwidth=bandwidth)
        return sweep(self, values, steps, together, experiment, settings or {}, options, _sharing(sharing, executor))

    def montecarlo(
        self, vary: Mapping[str, str | Distribution], of: str | tuple[str, ...] = "modes", samples: int = 1000,
        correlations: Mapping[tuple[str, str], float] | None = None, seed: int = 0, indices: int | None = None,
        experiment: str | None = None, settings: Mapping[str, str | float] | None = None, outputs: tuple[str, ...] | None = None,
        to: str | float | None = None, rtol: float | None = None, sharing: Sharing | None = None,
    ) -> MonteCarlo:  # fmt: skip
        """What tolerances do: `of` equilibrium (outputs at rest), modes (frequencies) or simulate (outputs at the end) at `samples`
        quasi-random points, with statistics, Sobol indices and swings.

        `vary`: distributions by parameter, as texts: `normal(1.95 um, 50 nm)`, `lognormal(mean, standard deviation)`, `uniform(low, high)`,
        `triangular(low, most likely, high)`, `truncated(one of these, low, high)`. `correlations`: by pairs of names, of a Gaussian copula.
        `indices`: rows that Sobol indices stand on, a power of two (None: up to 1024; 0: none). `sharing`: who makes the points (None: all cores).
        Points that fail are told and in no statistic. Raises `UsageError`, `CompilationFailed`, and `RunFailed` if all fail.
        """
        from .simulation.run import Wanted
        from .studies.montecarlo import Chance, montecarlo
        from .studies.sharing import Sharing

        chance = Chance(vary, correlations or {}, samples, seed, indices)
        steps = (of,) if isinstance(of, str) else tuple(of)
        wanted = Wanted(to, 2 if "simulate" in steps else None, rtol)
        return montecarlo(self, chance, steps, experiment, settings or {}, outputs, wanted, sharing or Sharing())

    def fit(
        self, data: str | Path | Measurements | Sequence[str | Path | Measurements], parameters: Mapping[str, str | Sought], experiment: str | None = None,
        settings: Mapping[str, str | float] | None = None, explain: bool | None = None,
    ) -> Fit:  # fmt: skip
        """The `parameters` that explain measured data best, by weighted least squares with exact derivatives; 95 % intervals, and what the
        data leave open.

        `data`: CSV files with units in their headings: what was set, and outputs at rest, `frequency 1 [Hz]` of modes, or outputs over `time [s]`;
        `sigma NAME` is the standard deviation. `parameters`: by name bounds as text (`1.5 um .. 2.5 um`, `log 1 N/m .. 100 N/m`; "": it keeps its sign).
        The search begins where the model has them, or where `settings` do. `explain`: tell which few parameters would do alone (None: if
        the data leave some open). Raises `UsageError`, `CompilationFailed`, `RunFailed`, OSError.
        """
        from .studies.fit import fit
        from .studies.measured import Measurements

        files: Sequence[str | Path | Measurements] = (
            [data] if isinstance(data, str | Path | Measurements) else list(data)
        )
        return fit(self, files, parameters, experiment, settings or {}, explain)

    # ------------------------------------------------------------ runs
    def scene(
        self,
        experiment: str | None = "",
        settings: Mapping[str, str | float] | None = None,
        free: tuple[str, ...] = (),
        outputs: tuple[str, ...] | None = None,
    ) -> Scene:
        """What a run asks: an experiment ("" the first, None none), settings (texts are expressions with units, numbers SI)."""
        overrides = tuple(_override(name, value) for name, value in (settings or {}).items())
        return door.Scene(self.model, experiment, overrides, frozenset(free), outputs)

    def simulate(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: tuple[str, ...] | None = None, target: str | None = None, start: Result | str | Path | None = None, solver: str | None = None,
        bandwidth: str | float | None = None,
    ) -> Result:  # fmt: skip
        """Run an experiment ("" the first, None none); what is given here overrides what it says.

        `settings`: parameters and inputs by name, as texts with units or numbers in SI. `to`: the end, as text or s.
        `points`: equally spaced instants, both ends included (default 501). `outputs`: only these. `energy` adds the energy
        balance. `target`: native (machine code) or numpy; the first that this machine has. `solver`: automatic, exponential
        (linear models), explicit, radau (stiff models) or energy (lossless models).
        `bandwidth`: a frequency as text or in Hz; what is faster need not be followed, and the result's `left_out` says what was not.
        `start`: a result of the same model, or its .npz file, to go on from where that ended.
        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if the numbers fail; the latter, and the `RunInterrupted` that Ctrl-C raises, have
        the `result` up to then.
        """
        from .results import read_result
        from .simulation.run import Wanted, simulate

        before = read_result(start) if isinstance(start, str | Path) else start
        wanted = Wanted(to, points, rtol, atol, energy, target, solver, bandwidth)
        return simulate(self, experiment, settings or {}, outputs, wanted, before)

    def simulate_many(
        self, settings: Sequence[Mapping[str, str | float]], experiment: str | None = "", to: str | float | None = None,
        points: int | None = None, rtol: float | None = None, atol: float | None = None, energy: bool = False,
        outputs: tuple[str, ...] | None = None, target: str | None = None, solver: str | None = None,
        workers: int | None = None, executor: Any = None, progress: Callable[[int, int], None] | None = None,
        journal: Journal | None = None, bandwidth: str | float | None = None,
    ) -> Ensemble:  # fmt: skip
        """Run an experiment once for each of several settings; all else as in `simulate`, and so is each result, to the last bit.

        The model is compiled once. What goes wrong in a run is kept with it; the others go on. `workers`: how many at once (default: as many
        as there are cores), or an `executor` of your own, of the interface of `concurrent.futures`, or a Dask client. `progress` is told how many are
        done, and of how many; `journal` keeps what is done in a file, from which the same call goes on after a crash.
        Raises `UsageError` for what no run can be made with.
        """
        from .simulation.run import Wanted
        from .studies.runs import simulate_many
        from .studies.sharing import Sharing

        wanted = Wanted(to, points, rtol, atol, energy, target, solver, bandwidth)
        sharing = Sharing(workers, executor, progress, journal)
        return simulate_many(self, experiment, settings, outputs, wanted, sharing)


def _sharing(sharing: Sharing | None, executor: Any) -> Sharing:
    """Who makes the points: this process, if nothing is said."""
    from .studies.sharing import Sharing

    return sharing if sharing is not None else Sharing(workers=1, executor=executor)


def _kept(things: dict[Any, Any], key: object, thing: object) -> None:
    """Keep something by its key, and of all only the latest."""
    while len(things) >= MOST_KEPT:
        things.pop(next(iter(things)))
    things[key] = thing


def _names(names: tuple[str, ...] | str | None) -> tuple[str, ...] | None:
    """One name, or several."""
    return (names,) if isinstance(names, str) else names


def _override(name: str, value: str | float) -> Override:
    if isinstance(value, str):
        source = door.Source(f"setting of {name}", value)
        return door.Override(name.replace(" ", ""), door.parse_expression(source), door.Span(source, 0, len(value)))
    source = door.Source(f"setting of {name}", repr(value))
    return door.Override(name.replace(" ", ""), float(value), door.Span(source, 0, len(source.text)))
