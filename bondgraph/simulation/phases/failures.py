"""Failures of an integration in the words of the model: the line that makes a rate not finite, the elements that gain or lose energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...errors import NotLossless, RateNotFinite, RunFailed, StepsCollapsed, UsageError
from ..constraints.constraints import Constraints
from ..segments.timeline import discrete_variables

if TYPE_CHECKING:
    from collections.abc import Mapping

    from compiler.api import Array, StateSpace


def modes_in(constraints: Constraints, mode: Array) -> Mapping[str, float]:
    """Return the discrete variables that only events change, by name."""
    hybrid = constraints.program.hybrid
    return {} if hybrid is None or mode is None else discrete_variables(hybrid, mode)


def explained(
    failed: RateNotFinite | StepsCollapsed | NotLossless, constraints: Constraints, space: StateSpace
) -> RunFailed | UsageError:
    """Return the failure with its cause, if there is one to be found."""
    if isinstance(failed, NotLossless):
        return _lossy(failed, constraints, space)
    from ..monitors.finite import cause_ahead, cause_of

    program, modes = constraints.program, modes_in(constraints, failed.mode)
    if isinstance(failed, RateNotFinite):
        cause = cause_of(program, space, failed.time, failed.state, constraints.parameters, modes)
        return RunFailed("BR745", f"{failed}: {cause}")
    for ahead in failed.ahead:
        here = failed.time, failed.state
        divisor = cause_ahead(program, space, here, ahead, constraints.parameters, modes)
        if divisor is not None:
            return RunFailed("BR746", f"no step leads on from t = {failed.time:.9g} s: just ahead {divisor}")
    return failed


def _lossy(failed: NotLossless, constraints: Constraints, space: StateSpace) -> UsageError:
    """Return the error that names the elements that gain or lose energy, where an energy-conserving method was requested."""
    from compiler.api import letters

    fixed = constraints.inputs, constraints.constants, failed.mode
    powers = constraints.program.powers(failed.time, failed.state, *fixed)[: len(space.ports)]
    by_element: dict[str, float] = {}
    for port, power in zip(space.ports, powers, strict=True):
        if port.kind not in letters("storage", "transducer"):
            by_element[port.element] = by_element.get(port.element, 0.0) + float(power)
    largest = sorted(by_element.items(), key=lambda item: -abs(item[1]))[:3]
    names = (
        ", ".join(f"`{name}` takes {power:.6g} W" for name, power in largest if power)
        or "a law of its storages or joints does"
    )
    return UsageError(
        "BR718", f"no method keeps the energy of this model: at t = {failed.time:.9g} s it is not lossless ({names});",
        "leave the solver to choose, which holds the tolerance",
    )  # fmt: skip
