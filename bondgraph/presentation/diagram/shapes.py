"""Modes drawn on a mechanism: bodies at equilibrium in grey, and as displaced by a mode.

The amplitudes of the poses move the bodies. A mode has no size; it is drawn large enough to be seen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ...errors import UsageError
from .compose import group_at
from .figure import Figure, Group
from .mechanism import draw_mechanism
from .mechanism_geometry import (
    MechanismGeometry,
    PosedModel,
    mechanism_geometry_of,
    mechanisms_of,
    pose_parts,
    posed_model,
)

if TYPE_CHECKING:
    from compiler.api import MechanismNode

    from ...analysis.modes import Mode
    from ...compiled_model import CompiledModel

SHARE = 0.06  # fraction of the mechanism's size: largest displacement
SMALL = 1e-6  # fraction of the size: displacement of a first evaluation
WIDEST = 0.6  # rad: largest angle, since small rotations are shown
LENGTHS = ("x", "y", "z")
GAP = 30.0  # px between pictures
COLUMNS = 3


def shapes_of(model: CompiledModel, experiment: str | None, name: str | None, count: int) -> Figure:
    """Return the first `count` modes that move the mechanism, slowest first, in rows of three. Raises as `Model.draw_mechanism`."""
    from ...analysis.equilibrium import equilibrium
    from ...analysis.modes import modes
    from ...analysis.placement import operating_point
    from ...keywords import AnalysisRequest

    posed = posed_model(model, experiment)
    point = operating_point(posed.model, AnalysisRequest(outputs=posed.names))
    at_rest, moving = equilibrium(point).outputs, [m for m in modes(point) if m.frequency > 0]
    nodes = mechanisms_of(posed.graph)
    node = next((n for n in nodes if name is None or n.name == name), None)
    if node is None or (name is None and len(nodes) > 1):
        raise UsageError(
            "BR935", f"which mechanism is to be drawn? there is {', '.join(f'`{n.name}`' for n in nodes) or 'none'}"
        )
    rest = mechanism_geometry_of(posed.graph, node, posed.poses(node, at_rest))
    pictures = []
    for mode in moving:
        moved = _displaced(posed, node, rest, at_rest, mode)
        if moved is not None:
            text = f"{mode.frequency:.6g} Hz, damping {mode.damping:.3g}"
            pictures.append(draw_mechanism(moved, text, behind=rest))
        if len(pictures) == count:
            break
    if not pictures:
        raise UsageError("BR938", f"no mode moves the mechanism `{node.name}`")
    return _sheet(pictures, f"modes of {node.name}")


def _displaced(
    posed: PosedModel, node: MechanismNode, rest: MechanismGeometry, at_rest: Mapping[str, float], mode: Mode
) -> MechanismGeometry | None:
    """Return the mechanism at the instant of its largest displacement; None if the mode does not move it."""
    size, parts = _size(rest), pose_parts(node)
    amplitudes = {name: mode.outputs[name] for name in parts}
    lengths = {n: a if parts[n] in LENGTHS else a * size / 2 for n, a in amplitudes.items()}
    largest = max(lengths.values(), key=abs, default=0j)
    if largest == 0:
        return None
    turn, first = largest.conjugate() / abs(largest), SMALL * size / abs(largest)

    def at(scale: float) -> MechanismGeometry:
        values = {n: at_rest[n] + scale * (a * turn).real for n, a in amplitudes.items()}
        return mechanism_geometry_of(posed.graph, node, posed.poses(node, values))

    far = _distance(rest, at(first)) / first
    angle = max((abs(a) for n, a in amplitudes.items() if parts[n] not in LENGTHS), default=0.0)
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
