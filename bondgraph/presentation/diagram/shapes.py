"""Modes drawn on a mechanism: bodies at equilibrium in grey, and as displaced by a mode.

Most models have no poses as outputs. So the model is written flat with its poses as outputs, and the modes of that model are computed: their
amplitudes there move the bodies. A mode has no size; it is drawn large enough to be seen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from compiler.api import MechanismNode

from ...compiled_model import CompiledModel, source_of
from ...errors import UsageError
from .compose import group_at
from .figure import Figure, Group
from .mechanism import draw_mechanism
from .mechanism_geometry import MechanismGeometry, Pose, mechanism_geometry_of
from .poses import mechanisms, parts, pose_of

if TYPE_CHECKING:
    from compiler.api import BondGraph

    from ...analysis.modes import Mode

SHARE = 0.06  # fraction of the mechanism's size: largest displacement
SMALL = 1e-6  # fraction of the size: displacement of a first evaluation
WIDEST = 0.6  # rad: largest angle, since small rotations are shown
LENGTHS = ("x", "y", "z")
GAP = 30.0  # px between pictures
COLUMNS = 3


@dataclass(frozen=True, slots=True)
class PosedModes:
    """A model with its poses as outputs: at equilibrium and displaced by its modes. `names`: (mechanism, body, part) -> output."""

    graph: BondGraph
    names: Mapping[tuple[str, str, str], str]
    rest: Mapping[str, float]
    modes: Sequence[Mode]


def shapes_of(model: CompiledModel, experiment: str | None, name: str | None, count: int) -> Figure:
    """Return the first `count` modes that move the mechanism, slowest first, in rows of three. Raises as `Model.draw_mechanism`."""
    found = _found(model, experiment)
    nodes = [n for n in found.graph.nodes if isinstance(n, MechanismNode)]
    node = next((n for n in nodes if name is None or n.name == name), None)
    if node is None or (name is None and len(nodes) > 1):
        raise UsageError(
            "BR935", f"which mechanism is to be drawn? there is {', '.join(f'`{n.name}`' for n in nodes) or 'none'}"
        )
    rest = mechanism_geometry_of(found.graph, node, _poses(found, node, found.rest))
    pictures = []
    for mode in found.modes:
        moved = _displaced(found, node, rest, mode)
        if moved is not None:
            text = f"{mode.frequency:.6g} Hz, damping {mode.damping:.3g}"
            pictures.append(draw_mechanism(moved, text, behind=rest))
        if len(pictures) == count:
            break
    if not pictures:
        raise UsageError("BR938", f"no mode moves the mechanism `{node.name}`")
    return _sheet(pictures, f"modes of {node.name}")


def _found(model: CompiledModel, experiment: str | None) -> PosedModes:
    from compiler.api import Scene, write_text

    from ...analysis.equilibrium import equilibrium
    from ...analysis.modes import modes as modes_at
    from ...analysis.operating_point import AnalysisRequest, operating_point

    flat = CompiledModel(source_of(write_text(model.compilation(Scene(model.model, experiment)).whole_graph)))
    graph = flat.compilation().whole_graph
    wanted = [(m.name, body.name, part) for m in mechanisms(graph) for body in m.bodies for part in parts(m)]
    names = {key: ".".join(key) for key in wanted}
    point = operating_point(flat, AnalysisRequest(outputs=tuple(names.values())))
    rest, modes = equilibrium(point), [m for m in modes_at(point) if m.frequency > 0]
    return PosedModes(graph, names, rest.outputs, modes)


def _poses(found: PosedModes, node: MechanismNode, values: Mapping[str, float]) -> dict[str, Pose]:
    mechanism = node.mechanism
    told = {}
    for body in mechanism.bodies:
        numbers = [values[found.names[node.name, body.name, part]] for part in parts(mechanism)]
        told[body.name] = pose_of(body.turn, _unit(numbers), found.graph)
    return told


def _unit(numbers: Sequence[float]) -> list[float]:
    """Return the numbers with the quaternion at the end, if there is one, normalised to length 1."""
    if len(numbers) == 3:
        return list(numbers)
    length = math.hypot(*numbers[3:])
    return [*numbers[:3], *(x / length for x in numbers[3:])]


def _displaced(found: PosedModes, node: MechanismNode, rest: MechanismGeometry, mode: Mode) -> MechanismGeometry | None:
    """Return the mechanism at the instant of its largest displacement; None if the mode does not move it."""
    amplitudes, size = mode.outputs, _size(rest)
    ours = {key: amplitudes[o] for key, o in found.names.items() if key[0] == node.name}
    lengths = {key: a if key[2] in LENGTHS else a * size / 2 for key, a in ours.items()}
    largest = max(lengths.values(), key=abs, default=0j)
    if largest == 0:
        return None
    turn, first = largest.conjugate() / abs(largest), SMALL * size / abs(largest)

    def at(scale: float) -> MechanismGeometry:
        values = dict(found.rest) | {
            found.names[key]: found.rest[found.names[key]] + scale * (a * turn).real for key, a in ours.items()
        }
        return mechanism_geometry_of(found.graph, node, _poses(found, node, values))

    far = _distance(rest, at(first)) / first
    angle = max((abs(a) for key, a in ours.items() if key[2] not in LENGTHS), default=0.0)
    scale = min(SHARE * size / max(far, 1e-300), WIDEST / max(angle, 1e-300))
    return at(scale)


def _size(geometry: MechanismGeometry) -> float:
    points = [p for limb in geometry.limbs for p in (limb.centre, *limb.points)]
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    return max(max(xs) - min(xs), max(ys) - min(ys), 1e-300)


def _distance(rest: MechanismGeometry, moved: MechanismGeometry) -> float:
    """Return the largest displacement of a point."""
    return max(
        math.dist(a, b)
        for one, other in zip(rest.limbs, moved.limbs, strict=True)
        for a, b in zip((one.centre, *one.points), (other.centre, *other.points), strict=True)
    )


def _sheet(pictures: Sequence[Figure], title: str) -> Figure:
    """Return pictures in rows of three."""
    width, height = max(p.width for p in pictures), max(p.height for p in pictures)
    groups: list[Group] = []
    for i, picture in enumerate(pictures):
        dx, dy = (i % COLUMNS) * (width + GAP), (i // COLUMNS) * (height + GAP)
        groups += [group_at(g, dx, dy) for g in picture.groups]
    columns, rows = min(COLUMNS, len(pictures)), -(-len(pictures) // COLUMNS)
    return replace(pictures[0], width=columns * (width + GAP) - GAP, height=rows * (height + GAP) - GAP, title=title, groups=tuple(groups))  # fmt: skip
