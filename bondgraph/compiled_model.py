"""A model of a text with its compiled forms, the ground of everything that computes: stages, programs, names."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from compiler import api

from .errors import UsageError
from .memo import keep

if TYPE_CHECKING:
    import networkx

    from compiler.api import Certificate, Compilation, Diagnostic, Override, Scene, Source

    from .compiled_scene import CompiledScene

LIBRARY = Path(__file__).with_name("library")
PARTS = "BONDGRAPH_PARTS"  # environment variable: most instances, elements, junctions, quantities and rounds of a model
MOST_KEPT = 64  # most scenes whose stages and programs are kept
MOST_DIGITS = 15  # of that number
_Answer = TypeVar("_Answer")


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter or constant of a model, nested ones by their path: value in SI, unit, description."""

    value: float
    unit: str
    description: str


class CompiledModel:
    """One model of a text, compiled at its first use. Raises `CompilationFailed` with all errors."""

    def __init__(
        self, source: Source, model: str | None = None, extra_outputs: Mapping[str, str] | None = None
    ) -> None:
        if not isinstance(source, api.Source):
            raise UsageError(
                "BR616", f"a model is not made of {type(source).__name__}:", "read it by `bondgraph.load(PATH_OR_TEXT)`"
            )
        self.source = source
        self.model = model
        self.extra_outputs = tuple((extra_outputs or {}).items())
        self._compilations: dict[tuple[Scene, bool], Compilation] = {}
        self._prepared: dict[tuple[Scene, bool, str], CompiledScene] = {}
        self.kept: dict[object, Any] = {}  # answers that need no other run of the compiler, by all that decides them

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy begins with: compiled forms hold machine code, and are made again."""
        original = {name: vars(self)[name] for name in ("source", "model", "extra_outputs")}
        return {**original, "_compilations": {}, "_prepared": {}, "kept": {}}

    def __repr__(self) -> str:
        return f"<bondgraph model {self.model or ''} of {self.source.name}>"

    def compilation(self, scene: Scene | None = None, everything: bool = False) -> Compilation:
        """Return the compiler's stages for one scene (default: no experiment)."""
        scene = scene if scene is not None else api.Scene(self.model, None)
        key = (scene, everything)
        compilation = self._compilations.get(key)
        if compilation is None:
            compilation = api.Compilation(self.source, scene, LIBRARY, everything, most_parts())
            for other in list(self._compilations.values())[:1]:  # parse the text only once
                compilation.__dict__["tree"] = other.tree
            like = self._compilations.get((replace(scene, preferences=(), off=None), everything))
            if like is not None and "_built" in like.__dict__:  # expand it only once
                compilation.__dict__["_built"] = like.__dict__["_built"]
            keep(self._compilations, key, compilation, MOST_KEPT)
        return compilation

    @property
    def compiled(self) -> int:
        """Number of scenes held in compiled form."""
        return len(self._compilations)

    def forget(self) -> None:
        """Discard all compiled forms; they are made again, or taken from the cache, at the next use."""
        self._compilations.clear()
        self._prepared.clear()
        self.kept.clear()

    def recall(self, key: object, find: Callable[[], _Answer]) -> _Answer:
        """Return the answer for a key, which has all that decides it beside the text; found at its first use. Nobody changes it."""
        answer: _Answer | None = self.kept.get(key)
        if answer is None:
            answer = find()
            keep(self.kept, key, answer, MOST_KEPT)
        return answer

    def compiled_scene(self, scene: Scene, everything: bool, target: str) -> CompiledScene:
        """Return the compiled scene: its program and the data for a run; from the cache if it exists there."""
        key = (scene, everything, target)
        made = self._prepared.get(key)
        if made is None:
            from .compiled_scene import CompiledScene

            made = CompiledScene(
                self.source, scene, everything, target, lambda: self.compilation(scene, everything),
                lambda: self.compiled_scene(replace(scene, opened=True), everything, target),
            )  # fmt: skip
            keep(self._prepared, key, made, MOST_KEPT)
        return made

    @cached_property
    def name(self) -> str:
        """Name of the model."""
        return self.compilation().whole_graph.name

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """All parameters and constants by path, with those of instances, and their values in SI."""
        quantities = self.compilation().whole_graph.quantities
        return {
            n: Parameter(q.value, q.unit, q.description)
            for n, q in quantities.items()
            if q.value is not None and q.role in ("parameter", "constant")
        }

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the model itself."""
        return tuple(
            n for n, q in self.compilation().whole_graph.quantities.items() if q.role == "input" and "." not in n
        )

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Declared outputs."""
        return tuple(self.compilation().whole_graph.outputs)

    @cached_property
    def experiments(self) -> tuple[str, ...]:
        """Experiments of the model, in the order of the text."""
        from compiler.api import Experiment

        statements = self.compilation().tree.models[self.name].statements
        return tuple(dict.fromkeys(s.name for s in statements if isinstance(s, Experiment)))

    @cached_property
    def states(self) -> tuple[str, ...]:
        """All states, whatever the outputs need."""
        space = self.compilation(everything=True).state_space
        return tuple(space.variables[s.variable].name for s in space.states)

    @property
    def certificate(self) -> Certificate:
        """Kind of equations of the model, whatever the outputs need; `print` it, or read its fields.

        Raises `CompilationFailed`, also where only the program of the equations cannot be made.
        """
        compilation = self.compilation(everything=True)
        compilation.look_at_laws()
        return compilation.certificate

    @property
    def graph(self) -> networkx.MultiDiGraph:
        """Return the bond graph in networkx; nodes have `node=`, edges (half arrows) `bond=`."""
        return self.compilation().whole_graph.network

    def with_inputs(self) -> Compilation:
        """Return the equations with every input as a symbol; where a storage would need an input's derivative, with its default."""
        free = self.compilation(api.Scene(self.model, None, free=frozenset(self.inputs)), everything=True)
        try:
            _ = free.state_space
            return free
        except api.CompilationFailed as failed:
            if any(d.code != "BG503" for d in failed.diagnostics):
                raise
            return self.compilation(everything=True)

    def without_zero_divisors(self, scene: Scene, everything: bool = False) -> Scene:
        """Return a scene of a program for all values in which parameters stay zero, as in the text, where the program would divide by them."""
        while True:
            compilation = self.compilation(scene, everything)
            quantities = compilation.whole_graph.quantities
            zeros = frozenset(n for n, q in quantities.items() if q.role == "parameter" and q.value == 0.0)
            space = compilation.state_space if scene.joined else compilation.whole_space
            divisors = frozenset[str]().union(*api.zero_divisors(space, zeros))
            if not divisors:
                return scene
            scene = replace(scene, fixed=scene.fixed | divisors)

    def scene(
        self, experiment: str | None = "", settings: Mapping[str, str | float] | None = None, free: tuple[str, ...] = (),
        outputs: Sequence[str] | None = None,
    ) -> Scene:  # fmt: skip
        """Return a run's scene: an experiment ("": the first, None: none), settings (texts are expressions with units, numbers SI)."""
        refuse_twice([api.full_name(name) for name in settings or {}])
        overrides = tuple(_override(name, value) for name, value in (settings or {}).items())
        return api.Scene(
            self.model, experiment, overrides, frozenset(free), names_of(outputs), extra_outputs=self.extra_outputs
        )


def refuse_twice(names: Sequence[str]) -> None:
    """Raise `UsageError` for a quantity that is set twice, with spaces in its name."""
    if len({*names}) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError("BR623", f"`{twice}` is set twice, with other spaces in its name;", "leave one of both out")


def source_of(path_or_text: str | Path) -> Source:
    """Return the source of a file, or of a text with at least one line break or brace. Raises OSError, and `CompilationFailed` for a file that is not UTF-8."""
    if isinstance(path_or_text, str) and ("\n" in path_or_text or "{" in path_or_text):
        return api.Source("text", path_or_text)
    return api.read_source(path_or_text)


def check(path_or_text: str | Path, model: str | None = None) -> tuple[Diagnostic, ...]:
    """Return all errors of a file or text; empty if there are none."""
    return certify(path_or_text, model)[0]


def certify(path_or_text: str | Path, model: str | None = None) -> tuple[tuple[Diagnostic, ...], Certificate | None]:
    """Return the same as `check`; and, without errors, the kind of equations that a run solves (None for a file of parts)."""
    try:
        source = source_of(path_or_text)
    except api.CompilationFailed as failed:  # the file is no text
        return failed.diagnostics, None
    return api.examine(source, model, LIBRARY, most_parts())


def most_parts() -> int:
    """Return the limit of parts of a model, which the environment sets. Raises `UsageError`."""
    setting = os.environ.get(PARTS)
    if not setting:
        return api.MAXIMUM_PARTS
    if not setting.isdecimal() or len(setting) > MOST_DIGITS or int(setting) == 0:
        raise UsageError(
            "BR650", f"{PARTS} in the environment is {setting[:40]!r}:", "set it to a whole number from 1 on"
        )
    return int(setting)


def _override(name: str, value: str | float) -> Override:
    if isinstance(value, str):
        source = api.Source(f"setting of {name}", value)
        return api.Override(api.full_name(name), api.parse_expression(source), api.Span(source, 0, len(value)))
    source = api.Source(f"setting of {name}", repr(value))
    return api.Override(api.full_name(name), float(value), api.Span(source, 0, len(source.text)))


def named(values: Mapping[str, _Answer]) -> dict[str, _Answer]:
    """Return values by the full names of their quantities, which `K[1,2]` is not."""
    return {api.full_name(name): value for name, value in values.items()}


def names_of(names: Sequence[str] | None) -> tuple[str, ...] | None:
    """Return one name, or several, as a tuple."""
    return (names,) if isinstance(names, str) else None if names is None else tuple(names)
