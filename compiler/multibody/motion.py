"""What the graph sees of a mechanism."""

from __future__ import annotations

from dataclasses import field

from ..algebra.expression import Expression
from ..errors import Diagnostic
from ..nouns import dataclass


@dataclass(frozen=True, slots=True)
class Motion:
    """One port: its flow, its pose (absolute for a body, relative for a joint), and the variable of its displacement from the
    reference, whose rate the flow is."""

    flow: Expression
    pose: Expression
    displacement: int | None


@dataclass(slots=True)
class MechanismEquations:
    """Motions by port (`guide[1].x`), what else may be read (`pin.reaction.x`, `top.attitude.w`), the efforts of ports
    whose flow the network decides, the variable of the mechanism's energy, and what is wrong."""

    motions: dict[str, Motion] = field(default_factory=dict)
    readings: dict[str, Expression] = field(default_factory=dict)
    efforts: dict[str, Expression] = field(default_factory=dict)
    energy: int | None = None
    diagnostics: list[Diagnostic] = field(default_factory=list)
