"""Small texts through the compiler: queries of the tests of its rooms, by the author's names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.simulation.constraints.constraints import Constraints
from bondgraph.simulation.integration.integration_state import IntegrationState
from bondgraph.simulation.magnitudes.nominal_magnitudes import nominal_magnitudes
from bondgraph.simulation.segments.timeline import Segment
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed, Diagnostic
from compiler.examination import check
from compiler.graph.network import Bond, BondGraph, Node
from compiler.scene import Override, Scene
from compiler.source import Source, Span
from compiler.syntax import parse_expression

ROOT = Path(__file__).resolve().parent.parent
LIBRARY = ROOT / "bondgraph" / "library"
MODELS = ROOT / "models"

Setting = str | float


def override(name: str, value: Setting) -> Override:
    """Result of `--set name=value` on the command line; a float is in SI."""
    source = Source("setting", value if isinstance(value, str) else repr(value))
    return Override(
        name, parse_expression(source) if isinstance(value, str) else value, Span(source, 0, len(source.text))
    )


def compiled(
    text: str | Path,
    settings: Mapping[str, Setting] | None = None,
    *,
    model: str | None = None,
    experiment: str | None = None,
    free: tuple[str, ...] = (),
    outputs: tuple[str, ...] | None = None,
    everything: bool = False,
) -> Compilation:
    """The stages of a text (or file); nothing runs before it is asked for."""
    source = (
        Source(str(text), text.read_text(encoding="utf-8"), text) if isinstance(text, Path) else Source("text.bg", text)
    )
    overrides = tuple(override(n, v) for n, v in (settings or {}).items())
    return Compilation(source, Scene(model, experiment, overrides, frozenset(free), outputs), LIBRARY, everything)


def mistakes(text: str | Path, model: str | None = None) -> tuple[Diagnostic, ...]:
    """All that `check` finds."""
    source = (
        Source(str(text), text.read_text(encoding="utf-8"), text) if isinstance(text, Path) else Source("text.bg", text)
    )
    return check(source, model, LIBRARY)


def mistake(text: str | Path, code: str) -> Diagnostic:
    """The one thing that is wrong with a text."""
    found = mistakes(text)
    assert [d.code for d in found] == [code], (
        "\n".join(f"{d.code} {d.span.place} {d.sentence}" for d in found) or "nothing is wrong"
    )
    return found[0]


def refused(compilation: Compilation, code: str) -> Diagnostic:
    """The one thing for which a compilation fails."""
    try:
        _ = compilation.program
    except CompilationFailed as failed:
        assert [d.code for d in failed.diagnostics] == [code], str(failed)
        return failed.diagnostics[0]
    raise AssertionError(f"nothing is wrong, but {code} was expected")


def numbers(text: str) -> dict[str, float]:
    """Outputs of a model without states: `output y = 2*a` and similar."""
    return outputs_of(compiled(text))


class Running:
    """A program with its arrays, by names."""

    def __init__(self, compilation: Compilation) -> None:
        self.program = compilation.program
        self.parameters = np.array(self.program.defaults, dtype=float)
        self.constants = self.program.constants(self.parameters)
        self.inputs = np.array(self.program.input_defaults, dtype=float)
        self.start = np.array(self.program.start(self.constants), dtype=float)
        self.constraints = Constraints(
            self.program, self.parameters, self.inputs, np.ones(len(self.program.states.names))
        )

    def arguments(
        self, time: float, state: Mapping[str, float] | None, inputs: Mapping[str, float] | None
    ) -> tuple[Any, ...]:
        """Arguments of `derivative` and similar functions; missing values are those of the model's start."""
        x, u = self.start.copy(), self.inputs.copy()
        for name, value in (state or {}).items():
            x[self.program.states.names.index(name)] = value
        for name, value in (inputs or {}).items():
            u[self.program.inputs.names.index(name)] = value
        return time, x, u, self.constants, self.program.mode_at(time, x, u, self.constants)

    def rates(
        self, state: Mapping[str, float] | None = None, time: float = 0.0, inputs: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """State -> its rate."""
        return dict(
            zip(
                self.program.states.names,
                self.program.derivative(*self.arguments(time, state, inputs)).tolist(),
                strict=True,
            )
        )

    def outputs(
        self, state: Mapping[str, float] | None = None, time: float = 0.0, inputs: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Output -> its value."""
        return dict(
            zip(
                self.program.outputs.names,
                self.program.output(*self.arguments(time, state, inputs)).tolist(),
                strict=True,
            )
        )

    def starts(self) -> dict[str, float]:
        """State -> its value at the start."""
        return dict(zip(self.program.states.names, self.start.tolist(), strict=True))


def outputs_of(
    compilation: Compilation, state: Mapping[str, float] | None = None, time: float = 0.0
) -> dict[str, float]:
    """Output -> its value."""
    return Running(compilation).outputs(state, time)


def units_of(compilation: Compilation) -> dict[str, str]:
    """Output -> its SI unit."""
    outputs = compilation.program.outputs
    return dict(zip(outputs.names, outputs.units, strict=True))


def node_of(graph: BondGraph, name: str) -> Node:
    """The node of that name."""
    (found,) = [n for n in graph.nodes if n.name == name]
    return found


def bonds_of(graph: BondGraph) -> set[str]:
    """Every half arrow as `tail -> head`, with the port where the node has several."""
    return {f"{_end(graph, b, 'tail')} -> {_end(graph, b, 'head')}" for b in graph.bonds}


def _end(graph: BondGraph, bond: Bond, which: str) -> str:
    end = getattr(bond, which)
    node = graph.nodes[end.node]
    port = getattr(node, "ports", None)
    return f"{node.name}.{port[end.port].name}" if port and port[end.port].name else node.name


def magnitudes(running: Running, stretches: Sequence[Segment]) -> Any:
    """Magnitudes of the states and unknowns of a program that a run finds, from its start on; shape (n,)."""
    with np.errstate(all="ignore"):
        return nominal_magnitudes(running.constraints, (), running.start, stretches).values


def limit_steps(monkeypatch: pytest.MonkeyPatch, size: float) -> None:
    """No step of a run is longer than this, in s."""
    original = IntegrationState.__init__

    def limited(state: IntegrationState, *given: Any, **named: Any) -> None:
        original(state, *given, **named)
        state.longest = size

    monkeypatch.setattr(IntegrationState, "__init__", limited)
