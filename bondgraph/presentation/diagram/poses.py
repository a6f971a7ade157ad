"""Poses of the bodies of a model's mechanisms at some time of a run.

Most models have no poses as outputs. So the model is written flat, as the experiment sets it, with its poses as outputs, and that model is run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from compiler.api import MechanismNode

from ...compiled_model import CompiledModel, source_of
from .mechanism_geometry import Pose, Turn, Vector, numbers_of

if TYPE_CHECKING:
    from compiler.api import BondGraph, Bound, Mechanism

PLANE, SPACE = ("x", "y", "phi"), ("x", "y", "z", "attitude.w", "attitude.x", "attitude.y", "attitude.z")


def poses_at(model: CompiledModel, experiment: str | None, at: str | float) -> tuple[Sequence[Sequence[Pose]], float]:
    """Return the poses of the bodies of each mechanism, in the order of the text, at a time; and that time in s.

    Raises `CompilationFailed`, `UsageError`, or `RunFailed`.
    """
    from compiler.api import Scene, write_text

    from ...simulation.run import RunOptions, simulate

    flat = CompiledModel(source_of(write_text(model.compilation(Scene(model.model, experiment)).whole_graph)))
    graph = flat.compilation().whole_graph
    wanted = [(m, body.name, part) for m in mechanisms(graph) for body in m.bodies for part in parts(m)]
    names = tuple(f"{m.name}.{body}.{part}" for m, body, part in wanted)
    run = simulate(flat, None, {}, names, RunOptions(at, 2))
    values: dict[tuple[str, str], list[float]] = {}
    for name, (mechanism, body, _) in zip(names, wanted, strict=True):
        values.setdefault((mechanism.name, body), []).append(float(run[name][-1]))
    poses = [[pose_of(b.turn, values[m.name, b.name], graph) for b in m.bodies] for m in mechanisms(graph)]
    return poses, float(run.time[-1])


def mechanisms(graph: BondGraph) -> Iterator[Mechanism]:
    """Return the mechanisms in the order of the text."""
    return (node.mechanism for node in graph.nodes if isinstance(node, MechanismNode))


def parts(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the components of a body's pose."""
    return PLANE if mechanism.planar else SPACE


def pose_of(reference: Sequence[Bound], values: list[float], graph: BondGraph) -> Pose:
    """Return the pose from the values of a body: they are absolute, and a picture rotates the body from its reference."""
    before = quaternion(numbers_of(graph, reference))
    if len(values) == len(PLANE):
        x, y, phi = values
        place, now = (x, y, 0.0), quaternion((0.0, 0.0, phi))
    else:
        place, now = (values[0], values[1], values[2]), (values[3], values[4], values[5], values[6])
    return Pose(place, _after(now, (before[0], -before[1], -before[2], -before[3])))


def quaternion(turn: Vector) -> Turn:
    """Return the unit quaternion of a rotation vector."""
    angle = math.hypot(*turn)
    share = math.sin(angle / 2) / angle if angle else 0.5
    return math.cos(angle / 2), share * turn[0], share * turn[1], share * turn[2]


def _after(p: Turn, q: Turn) -> Turn:
    """Return the rotation p after the rotation q."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
