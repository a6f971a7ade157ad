"""Interface of a mechanism to the graph."""

from __future__ import annotations

from dataclasses import field

from ..algebra.expression import Expression
from ..errors import Diagnostic
from ..fast_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class PortMotion:
    """One port: its flow, its pose (absolute for a body, relative for a joint), and the variable of its displacement from the drawing.

    The flow is the rate of that displacement.
    """

    flow: Expression
    pose: Expression
    displacement: int | None


@dataclass(slots=True)
class MechanismEquations:
    """Result for one mechanism.

    Motions by port (`guide[1].x`), further quantities that may be read (`pin.reaction.x`, `top.attitude.w`), efforts of ports
    whose flow the network determines, variable of the mechanism's energy, and errors.
    """

    motions: dict[str, PortMotion] = field(default_factory=dict)
    readings: dict[str, Expression] = field(default_factory=dict)
    efforts: dict[str, Expression] = field(default_factory=dict)
    energy: int | None = None
    diagnostics: list[Diagnostic] = field(default_factory=list)
