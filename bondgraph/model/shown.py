"""What people look at: pictures, equations, stages, programs as text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .. import door
from ..errors import UsageError
from .compiled import Compiled

if TYPE_CHECKING:
    from ..diagram.figure import Figure
    from ..door import StateSpace
    from ..views.equations import Equations

STAGES = ("syntax", "graph", "causality", "equations", "reduction", "code", "text")


class Shown(Compiled):
    """The part of a model that shows it."""

    def draw(
        self, path: str | Path | None = None, experiment: str | None = None, closed: bool = False, numbers: bool = False
    ) -> Figure:
        """The bond graph in a textbook's notation, into a .svg, .png or .pdf file if a path is given.

        Drawn is everything that the text says; with an experiment what is left of it in that run. `closed`: instances are
        boxes. `numbers`: with the numbers of the bonds. Raises `CompilationFailed`, `UsageError`, `MissingPackage`, OSError.
        """
        from ..diagram import draw, write_figure

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
        from ..diagram import mechanism_of, shapes_of, write_figure

        figure = (
            shapes_of(self._whole, experiment or None, name, modes)
            if modes
            else mechanism_of(self._whole, name, experiment, at)
        )
        if path is not None:
            write_figure(figure, path)
        return figure

    def _repr_html_(self) -> str:
        """Certificate, bond graph and names, for notebooks; or what is wrong."""
        from ..page.notebook import model_html

        return model_html(self._whole)

    def _repr_svg_(self) -> str | None:
        """The bond graph, for notebooks; None of one that is too large to be drawn unasked."""
        from ..page.notebook import picture

        return picture(self._whole) or None

    def state_equations(self) -> Equations:
        """The state equations in sympy: a mapping from state to the right side, over parameters, states and inputs.

        Linear loops are solved symbolically. Unknowns of nonlinear loops stay, and `algebraic_equations` binds them.
        """
        from ..views.equations import state_equations

        with door.uncollected():
            return state_equations(self._with_inputs().state_space)

    def algebraic_equations(self) -> Equations:
        """The equations of nonlinear loops in sympy: a mapping from unknown to an expression that vanishes; often empty."""
        from ..views.equations import algebraic_equations

        return algebraic_equations(self._with_inputs().state_space)

    def ordered_equations(self) -> StateSpace:
        """The equations step by step, in the order in which they are computed, with every input as a symbol."""
        return self._with_inputs().state_space

    def equations(self, latex: bool = False) -> str:
        """The causally ordered equations as text, or as LaTeX."""
        from ..views.equations import equations_text

        return equations_text(self._with_inputs().state_space, latex)

    def show(self, stage: str, experiment: str | None = "") -> str:
        """One stage of the compiler as stable text; `STAGES` lists them."""
        if stage not in STAGES:
            raise UsageError(f"there is no stage `{stage}`; stages are {', '.join(STAGES)}")
        from ..views.stages import stage_text

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
