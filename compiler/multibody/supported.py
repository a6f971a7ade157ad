"""What of a mechanism this version can move. What it cannot is refused with its place, never left out."""

from __future__ import annotations

from collections.abc import Iterator, Set

from ..errors import Diagnostic
from ..graph.mechanism import Joint, Mechanism
from .errors import NotMovedYet

MOVED = frozenset({"slide", "hinge", "free", "weld"})


def unsupported(mechanism: Mechanism, ports: Set[str]) -> Iterator[Diagnostic]:
    """The parts that cannot be computed yet; `ports` are those that are driven or read."""
    if not mechanism.planar:
        yield NotMovedYet(mechanism.span, f"The spatial mechanism `{mechanism.name}`", "Planar mechanisms run.")
        return
    for joint in mechanism.joints:
        what = _of_a_joint(mechanism, joint)
        if what:
            yield NotMovedYet(joint.span, what, f"Joints that run are {', '.join(sorted(MOVED))}, between bodies.")
        if f"{joint.name}.reaction" in {p.rpartition(".")[0] for p in ports}:
            yield NotMovedYet(joint.span, f"The reaction of `{joint.name}`", "Its efforts of a bond can be read.")
    for frame in mechanism.frames:
        if frame.axes != "world":
            yield NotMovedYet(frame.span, f"The frame `{frame.name}` in axes of its body", "Leave `axes` out.")


def _of_a_joint(mechanism: Mechanism, joint: Joint) -> str:
    if joint.kind not in MOVED:
        return f"The {joint.kind} `{joint.name}`"
    if any(mechanism.body_of(end) != end for end in (joint.first, joint.second)):
        return f"The joint `{joint.name}` on a frame"
    if joint.axes == "world":
        return f"The joint `{joint.name}` in axes of the world"
    if joint.rest:
        return f"The rest of `{joint.name}`"
    return f"The locked joint `{joint.name}`" if joint.locked else ""
