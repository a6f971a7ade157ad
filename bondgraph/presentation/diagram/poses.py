"""Poses of the bodies of a mechanism in a run or an analysis.

Most models have no poses as outputs. So the model is written flat, as the experiment sets it, with its poses as outputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from compiler.api import BondGraph, MechanismNode, Scene, write_text

from ...compiled_model import CompiledModel, source_of
from .mechanism_geometry import Pose
from .vectors import Turn, Vector, numbers_of, quaternion

PLANE, SPACE = ("x", "y", "phi"), ("x", "y", "z", "attitude.w", "attitude.x", "attitude.y", "attitude.z")


@dataclass(frozen=True, slots=True)
class PosedModel:
    """A model written flat. `names`: the poses of all bodies, as outputs."""

    model: CompiledModel
    graph: BondGraph
    names: tuple[str, ...]

    def poses(self, node: MechanismNode, values: Mapping[str, float]) -> list[Pose]:
        """Return the poses of the bodies of a mechanism of the graph, from the values of their components."""
        numbers = [values[name] for name in pose_parts(node)]
        size = len(PLANE if node.mechanism.planar else SPACE)
        return [
            _pose(numbers_of(self.graph, body.turn), numbers[size * i : size * (i + 1)])
            for i, body in enumerate(node.mechanism.bodies)
        ]


def posed_model(model: CompiledModel, experiment: str | None) -> PosedModel:
    """Return the model as an experiment sets it. Raises `CompilationFailed`."""
    flat = CompiledModel(source_of(write_text(model.compilation(Scene(model.model, experiment)).whole_graph)))
    graph = flat.compilation().whole_graph
    return PosedModel(flat, graph, tuple(name for node in mechanisms_of(graph) for name in pose_parts(node)))


def mechanisms_of(graph: BondGraph) -> list[MechanismNode]:
    """Return the mechanisms in the order of the text."""
    return [node for node in graph.nodes if isinstance(node, MechanismNode)]


def pose_parts(node: MechanismNode) -> dict[str, str]:
    """Return the names of the components of the poses of all bodies, each with its part: x, phi, attitude.w and so on."""
    parts = PLANE if node.mechanism.planar else SPACE
    return {f"{node.name}.{body.name}.{part}": part for body in node.mechanism.bodies for part in parts}


def _pose(reference: Vector, values: list[float]) -> Pose:
    """Return the pose from the values of a body: they are absolute, and a picture rotates the body from its reference."""
    w, *axis = quaternion(reference)
    now: Sequence[float]
    if len(values) == len(PLANE):
        x, y, phi = values
        place, now = (x, y, 0.0), quaternion((0.0, 0.0, phi))
    else:
        length = math.hypot(*values[3:])
        x, y, z, *attitude = values
        place, now = (x, y, z), tuple(v / length for v in attitude)
    return Pose(place, _after(now, (w, *(-v for v in axis))))


def _after(p: Sequence[float], q: Sequence[float]) -> Turn:
    """Return the rotation p after the rotation q."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
