"""Presentation of a model: pictures, equations, stages, programs as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from compiler import api

from ..analysed_model import AnalysedModel
from ..errors import MissingPackage, UsageError
from ..keywords import checked

if TYPE_CHECKING:
    from types import ModuleType

    from ..analysis.symbolic import SymbolicEquations
    from ..exchange.variables import UnitIcon
    from ..presentation.diagram.figure import Figure

STAGES = ("syntax", "graph", "causality", "equations", "reduction", "state_equations", "code", "text")


class Shown(AnalysedModel):
    """Presentation methods of a model."""

    @checked
    def draw(
        self, path: str | Path | None = None, experiment: str | None = None, closed: bool = False, numbers: bool = False
    ) -> Figure:
        """Draw the bond graph in a textbook's notation, into a .svg, .png or .pdf file if a path is given.

        The whole text is drawn; with an experiment the part that remains in that run. `closed`: instances are boxes. `numbers`: with the numbers of the
        bonds. Raises `CompilationFailed`, `UsageError`, `MissingPackage`, OSError.
        """
        from ..presentation.diagram import draw, write_figure

        free = frozenset({"*"}) if experiment is None else frozenset[str]()  # no value counts as zero
        figure = draw(self.compilation(api.Scene(self.model, experiment, free=free)), closed, numbers)
        if path is not None:
            write_figure(figure, path)
        return figure

    @checked
    def draw_mechanism(
        self, path: str | Path | None = None, name: str | None = None, experiment: str | None = "", at: str | float | None = None, modes: int = 0,
    ) -> Figure:  # fmt: skip
        """Draw a mechanism of the model (by name, if there are several), into a .svg, .png or .pdf file if a path is given.

        It is drawn in the reference configuration, or with `at` at that time of an experiment (text with a unit, or s), or as displaced from equilibrium by
        its first `modes` modes. Raises `CompilationFailed`, `RunFailed`, `UsageError`, `MissingPackage`, OSError.
        """
        from ..presentation.diagram import mechanism_of, shapes_of, write_figure

        figure = shapes_of(self, experiment, name, modes) if modes else mechanism_of(self, name, experiment, at)
        if path is not None:
            write_figure(figure, path)
        return figure

    def _icon(self, ports: Mapping[str, str]) -> UnitIcon:
        """Return the diagram as an icon, with instances as boxes and sources in the place of open ports."""
        from ..exchange.variables import UnitIcon
        from ..presentation.diagram import draw, write_figure

        scene = api.Scene(self.model, None, free=frozenset({"*"}), ports=tuple(ports.items()))
        figure = draw(self.compilation(scene), closed=True)
        with TemporaryDirectory() as folder:
            paths = [Path(folder) / f"icon{ending}" for ending in (".png", ".svg")]
            for path in paths:
                write_figure(figure, path)
            png, svg = (path.read_bytes() for path in paths)
        return UnitIcon(png, svg, figure.width, figure.height)

    def _repr_html_(self) -> str:
        """Return certificate, bond graph and names for notebooks, or the errors."""
        from ..presentation.page.notebook import model_html

        return model_html(self)

    def _repr_svg_(self) -> str | None:
        """Return the bond graph for notebooks; None if it is too large to be drawn without a request."""
        from ..presentation.page.notebook import picture

        return picture(self) or None

    @checked
    def state_equations(self) -> SymbolicEquations:
        """Return the state equations in sympy: a mapping from state to the right-hand side, over parameters, states and inputs.

        Linear loops are solved symbolically. Unknowns of nonlinear loops remain, and `algebraic_equations` determines them.
        """
        from ..analysis.symbolic import state_equations

        with api.uncollected():
            return state_equations(self.with_inputs().state_space)

    @checked
    def algebraic_equations(self) -> SymbolicEquations:
        """Return the equations of nonlinear loops in sympy: a mapping from unknown to an expression that vanishes; often empty."""
        from ..analysis.symbolic import algebraic_equations

        return algebraic_equations(self.with_inputs().state_space)

    @checked
    def equations(self, latex: bool = False) -> str:
        """Return the causally ordered equations as text, or as LaTeX."""
        from ..presentation.text.equations import equations_text

        return equations_text(self.with_inputs().state_space, latex)

    @checked
    def show(self, stage: str, experiment: str | None = "") -> str:
        """Return one stage of the compiler as stable text; `STAGES` lists them."""
        if stage not in STAGES:
            raise UsageError("BR609", f"there is no stage `{stage}`; stages are {', '.join(STAGES)}")
        from ..presentation.text.stages import stage_text

        return stage_text(self.compilation(api.Scene(self.model, experiment)), stage)

    @checked
    def text(self, experiment: str | None = None) -> str:
        """Return the model as one flat model in the language, which compiles to an equal graph; with an experiment, with its settings.

        Instances and loops are expanded, numbers are in SI. Raises `CompilationFailed`, also if something cannot be written.
        """
        return api.write_text(self.compilation(api.Scene(self.model, experiment)).whole_graph)

    @checked
    def compile(
        self, target: str = "numpy", *, part: str | None = None, single: bool = False, steps: str = "fixed", experiment: str | None = None
    ) -> str:  # fmt: skip
        """Return the source of a separate program, with every input as an argument, and every parameter that decides no structure.

        Raises `CompilationFailed`, `UsageError`; with steps of variable size also `RunFailed`.

        `part`: an instance alone, such as a controller. `single`: C in `float` instead of `double`. `steps` of C: `fixed`, or `variable`, with the methods
        and events of a run; with an experiment, its settings are in it.
        """
        if target not in (targets := api.text_targets()):
            raise UsageError("BR602", f"there is no target `{target}`; targets are {', '.join(targets)}")
        if single and target != "c":
            raise UsageError("BR617", f"the target {target} has no `float`;", "that of C has")
        if steps not in (kinds := ("fixed", "variable")):
            raise UsageError("BR624", f"there are no `{steps}` steps; they are {' or '.join(kinds)}")
        if steps == "variable":
            if target != "c" or part is not None or single:
                raise UsageError("BR625", "steps of variable size belong to C in `double`, of a whole model")
            from ..exchange.embedded import c_with_own_steps

            return c_with_own_steps(self, experiment)
        if experiment is not None:
            raise UsageError("BR626", "an experiment is part of C with steps of variable size alone")
        scene = api.Scene(self.model, None, free=frozenset({"*"}))
        compilation = self.compilation(self.without_zero_divisors(scene))
        if target in ("c", "modelica") and part is None and compilation.whole_graph.switches:
            with suppress(api.NotJoined):
                compilation = self.compilation(self.without_zero_divisors(replace(scene, joined=True, off=())))
        text = compilation.text(target) if part is None else compilation.part_text(part, target)
        return api.in_single_precision(text) if single else text

    def to_casadi(self) -> ModuleType:
        """Return the functions of CasADi that `compile("casadi")` writes, as a module.

        `derivative`, `outputs` and `jacobian` of (t, x, p) or (t, x, z, p, u), as in `arguments`; `dae` for its integrators, `START`, `DEFAULTS`. Raises
        `CompilationFailed`, also for events, delays and tables, `MissingPackage`.
        """
        return self._functions("casadi")

    def to_jax(self) -> ModuleType:
        """Return the functions of JAX that `compile("jax")` writes, as a module, which turns on its 64 bits.

        `derivative` and `outputs` of (t, x, p) or (t, x, z, p, u); `start(p)`, `DEFAULTS`. Raises `CompilationFailed`, also for events, delays and
        tables, `MissingPackage`.
        """
        return self._functions("jax")

    def _functions(self, target: str) -> ModuleType:
        text = self.compile(target)
        try:
            return api.load_module(self.graph.name, text)
        except ImportError as error:
            raise MissingPackage(
                "BR619", f"functions of {target} need its package:", f'pip install "bondgraph-lang[{target}]"'
            ) from error

    @checked
    def to_fmu(
        self, path: str | Path, experiment: str | None = None, platforms: Sequence[str] = ("linux64",), fmi: str = "2",
        ports: Mapping[str, str] | None = None, icon: bool = False,
    ) -> None:  # fmt: skip
        """Write the model as a functional mock-up unit of FMI 2.0 or 3.0 for other tools: model exchange and co-simulation, without a C compiler.

        All parameters can be set, all inputs are free; with an experiment, its settings hold. Start, stop and tolerance are those of the experiment, or of
        the first one. `platforms`: `linux64`, `linux-aarch64`, `win64`. `ports`: open ports, as `{"tip": "effort"}`, which is an input then, `tip_F`,
        and the flow an output, `tip_v`; with FMI 2.0 `NAME_OspModelDescription.xml` beside the unit tells libcosim so. `icon`: with the diagram as its
        icon. Raises `CompilationFailed`, also for what a unit cannot hold, `UsageError`, `RunFailed`, `MissingPackage`, OSError.
        """
        from ..exchange.unit import fmu, zipped
        from ..files import replacing

        unit = fmu(self, experiment, platforms, fmi, ports, self._icon(ports or {}) if icon else None)
        for file, data in {Path(path).name: zipped(unit.files), **unit.beside}.items():
            with replacing(Path(path).with_name(file)) as stream:
                stream.write(data)

    @checked
    def to_ssp(
        self, path: str | Path, parts: Sequence[str] = (), experiment: str | None = None, platforms: Sequence[str] = ("linux64",), fmi: str = "2"
    ) -> None:  # fmt: skip
        """Write the model as a system of units for other tools, in the format System Structure and Parameterization (SSP) 1.0.

        Its units are the instances `parts` of the model, or all at its top, and the rest; it is cut at their ports, with the strokes of the whole.
        Parameters that an experiment sets are a set of its own. The rest is as in `to_fmu`. Raises `CompilationFailed`, also where a cut is not possible,
        `UsageError`, `RunFailed`, OSError.
        """
        from ..exchange.system_structure import ssp
        from ..files import replacing

        data = ssp(self, parts, experiment, platforms, fmi)
        with replacing(path) as stream:
            stream.write(data)
