"""Compiled scene: the program of a model for one scene, and the data for a run.

It comes from the cache if it exists there; then no stage of the compiler is loaded, except for an error message in the author's terms.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from compiler import api

from . import cache
from .errors import ManyRuns, UsageError
from .results.records import Column

if TYPE_CHECKING:
    from compiler.api import Certificate, Compilation, Plan, Program, RunMetadata, Scene, Source, StateSpace

TARGETS = ("native", "numpy")
HIDDEN = "BONDGRAPH_WITHOUT_LLVM"  # environment variable: any value disables LLVM


def chosen_target(target: str | None) -> str:
    """Return the requested target, or the fastest that this machine has. Raises `UsageError`."""
    possible = not os.environ.get(HIDDEN) and api.native_available()
    if target is None:
        return "native" if possible else "numpy"
    if target not in TARGETS:
        raise UsageError("BR602", f"there is no target `{target}`; targets are {', '.join(TARGETS)}")
    if target == "native" and not possible:
        raise UsageError("BR603", "the target native needs the package `llvmlite`; `pip install llvmlite` brings it")
    return target


def many_runs(plan: Plan, scene: Scene) -> ManyRuns | None:
    """Return the error of an experiment of a scene that is more than one run, or none; None if it is one. Settings are not swept."""
    set_here = {o.path for o in scene.overrides}
    names = ", ".join(f"`{s.name}`" for s in plan.sweeps if s.name not in set_here)
    if names:
        return ManyRuns(
            "BR611", f"the experiment `{plan.experiment}` sweeps {names}: it is many runs, which `Model.run` makes"
        )
    varied = {name for s in plan.studies if isinstance(s, api.MonteCarloRequest) for name, _ in s.vary}
    if not varied <= set_here:
        return ManyRuns(
            "BR612", f"the experiment `{plan.experiment}` is a `montecarlo`: it is many runs, which `Model.run` makes"
        )
    if plan.studies and plan.stop is None:
        steps = ", ".join(f"`{s.role}`" for s in plan.studies)
        return ManyRuns(
            "BR613", f"the experiment `{plan.experiment}` simulates nothing, but has {steps}: `Model.run` does that"
        )
    return None


class CompiledParts(NamedTuple):
    """Program of a scene, with the plan of its experiment, further data for a run, and the kind of its equations."""

    program: Program
    plan: Plan
    metadata: RunMetadata
    certificate: Certificate


class CompiledScene:
    """Compiled scene. `compilation` makes the stages of the compiler when needed; `opened` the same with opened loops."""

    def __init__(
        self, source: Source, scene: Scene, everything: bool, target: str, compilation: Callable[[], Compilation],
        opened: Callable[[], CompiledScene],
    ) -> None:  # fmt: skip
        self.source, self.scene, self.everything, self.target = source, scene, everything, target
        self._compilation, self._opened = compilation, opened
        self.kept: dict[object, Any] = {}  # cached results of analyses, for use at other values

    @cached_property
    def compilation(self) -> Compilation:
        """Stages of the compiler, made again."""
        return self._compilation()

    @property
    def state_space(self) -> StateSpace:
        """Equations for messages and energies."""
        return self.compilation.state_space

    @cached_property
    def program(self) -> Program:
        """Program of the target. One with loops has a reference to the program with opened loops."""
        program = self._parts.program
        if program.unknowns.names and not self.scene.opened:
            program.kept["opened"] = self._opened
        return program

    @property
    def plan(self) -> Plan:
        """Plan of the experiment."""
        return self._parts.plan

    @property
    def facts(self) -> RunMetadata:
        """Further data for a run."""
        return self._parts.metadata

    @property
    def certificate(self) -> Certificate:
        """Kind of the equations."""
        return self._parts.certificate

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the results, common to all of them."""
        outputs = self.program.outputs
        return tuple(Column(n, u) for n, u in zip(outputs.names, outputs.units, strict=True))

    @cached_property
    def _parts(self) -> CompiledParts:
        if self.target == "numpy":
            return _interpreted(self.compilation)
        key = self._key()
        cached = cache.fetch(key)
        if cached is not None and all(_unchanged(*file) for file in cached["files"]):
            if "needed" in cached:
                from compiler.api import ValuesNeeded

                raise ValuesNeeded(cached["needed"])
            from compiler.api import bind

            return CompiledParts(
                bind(cached["described"], cached["codes"]), cached["plan"], cached["facts"], cached["certificate"]
            )
        return self._compiled_now(key)

    def _compiled_now(self, key: str) -> CompiledParts:
        from compiler.api import ValuesNeeded, uncollected

        compilation = self.compilation
        with uncollected():
            try:
                if many_runs(compilation.plan, self.scene) is not None:  # reported before any other error
                    return _interpreted(compilation)
                _ = compilation.lowered
            except ValuesNeeded as needed:
                cache.keep(key, {"needed": needed.why, "files": ()})
                raise
            return _native(key, compilation)

    def _key(self) -> str:
        from compiler.api import processor

        path = self.source.path.resolve() if self.source.path is not None else None
        return cache.key_of(
            "program", processor(), self.source.name, path, self.source.text, repr(self.scene), self.everything
        )


def _interpreted(compilation: Compilation) -> CompiledParts:
    return CompiledParts(compilation.program, compilation.plan, compilation.facts, compilation.certificate)


def _native(key: str, compilation: Compilation) -> CompiledParts:
    """Return the parts with machine code, and keep them in the cache; interpreted where that is not possible."""
    from compiler.api import bind

    from .native import CannotCompile, compiled_safely

    if compilation.lowered.lags:  # delayed signals are filled in by Python
        return _interpreted(compilation)
    try:
        described, codes = compilation.native(compiled_safely)
    except CannotCompile:
        return _interpreted(compilation)
    parts = CompiledParts(bind(described, codes), compilation.plan, compilation.facts, compilation.certificate)
    files = tuple((str(s.path), _digest(s.path)) for s in compilation.files if s.path is not None)
    others = {"plan": parts.plan, "facts": parts.metadata, "certificate": parts.certificate, "files": files}
    cache.keep(key, {"described": described.without_source(), "codes": codes, **others})
    return parts


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _unchanged(path: str, digest: str) -> bool:
    try:
        return _digest(Path(path)) == digest
    except OSError:
        return False
