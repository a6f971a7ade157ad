"""A model: its text, its stages, its runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import door
from .errors import UsageError

if TYPE_CHECKING:
    import networkx

    from .analysis import PortHamiltonian, SymbolicPortHamiltonian
    from .door import Certificate, Compilation, Diagnostic, Override, Scene, Source
    from .prepared import Prepared
    from .results import Result

LIBRARY = Path(__file__).with_name("library")
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
            self._compilations[key] = compilation
        return self._compilations[key]

    def prepared(self, scene: Scene, everything: bool, target: str) -> Prepared:
        """The program for one scene and what a run asks besides; from the cache if it has been there before."""
        from .prepared import Prepared

        key = (scene, everything, target)
        if key not in self._prepared:
            self._prepared[key] = Prepared(
                self.source, scene, everything, target, lambda: self.compilation(scene, everything)
            )
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

    # ------------------------------------------------------------ equations and stages
    def state_equations(self) -> Any:
        """The state equations in sympy: a mapping from state to the right side, over parameters, states and inputs.

        Linear loops are solved symbolically. Unknowns of nonlinear loops stay, and `algebraic_equations` binds them.
        """
        from .views.equations import state_equations

        with door.uncollected():
            return state_equations(self._with_inputs().state_space)

    def algebraic_equations(self) -> Any:
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
        from .analysis import port_hamiltonian

        compilation = self.compilation(self.scene(None, settings), everything=True)
        return port_hamiltonian(compilation, state or {}, time)

    def symbolic_port_hamiltonian(self) -> SymbolicPortHamiltonian:
        """J, R, G and H in sympy, for linear resistors and no storage in derivative form. Raises `UsageError`."""
        from .analysis import symbolic_port_hamiltonian

        return symbolic_port_hamiltonian(self._with_inputs())

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
        outputs: tuple[str, ...] | None = None, target: str | None = None, solver: str | None = None,
    ) -> Result:  # fmt: skip
        """Run an experiment ("" the first, None none); what is given here overrides what it says.

        `settings`: parameters and inputs by name, as texts with units or numbers in SI. `to`: the end, as text or s.
        `points`: equally spaced instants, both ends included (default 501). `outputs`: only these. `energy` adds the energy
        balance. `target`: native (machine code) or numpy; the first that this machine has. `solver`: automatic, exponential
        (linear models), explicit, radau (stiff models) or energy (lossless models).
        Raises `CompilationFailed`, `UsageError`, or `RunFailed` if the numbers fail.
        """
        from .simulation.run import simulate

        return simulate(
            self, self.scene(experiment, settings, (), outputs), to, points, rtol, atol, energy, target, solver
        )


def _override(name: str, value: str | float) -> Override:
    if isinstance(value, str):
        source = door.Source(f"setting of {name}", value)
        return door.Override(name.replace(" ", ""), door.parse_expression(source), door.Span(source, 0, len(value)))
    source = door.Source(f"setting of {name}", repr(value))
    return door.Override(name.replace(" ", ""), float(value), door.Span(source, 0, len(source.text)))
