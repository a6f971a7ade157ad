"""Failures that stay: each with its reason. One that is not here makes the stress tests fail; one that is gone is told, and goes from here."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tests.stress.report import Finding, Section

# A pattern for the place of the finding -> why it stays.
PHASE = "the slope is as wanted; a single tolerance lies off the line, where the step before an instant of the run happens to be long or short"
BETWEEN = (
    "what is stiff and follows at once is exact at the ends of steps; between them it lies on a polynomial of order 3, or on one of order 5 through three ends, whose "
    "error no step is held to: a diode's current, or the state of a resistance of 1e-3, where the stiff method was asked for by name"
)
SLOPE = "the explicit pair, asked for by name, meets a slope that is 1e-8 of the speed wide; the product's own choice and the stiff method hold the tolerance"
STANDING: dict[str, str] = {
    r"^(inverse_kinematics|slider_crank|van_der_pol): scatter": PHASE,
    r"^rectifier: slope": BETWEEN,
    r"^resistances that nearly cancel, what is left \S+ \(radau": BETWEEN,
    r"^stick and slip, friction falls within 1e-09 m/s, cycles 5 \(explicit": SLOPE,
}


def unknown(sections: Sequence[Section]) -> list[Finding]:
    """The failures that are not known to stay."""
    return [f for s in sections for f in s.failed if reason(f) is None]


def reason(finding: Finding) -> str | None:
    """Why a failure stays; None if it must not."""
    return next((why for pattern, why in STANDING.items() if re.search(pattern, finding.where)), None)


def told(sections: Sequence[Section]) -> list[str]:
    """Paragraphs for the page."""
    failed = [f for s in sections for f in s.failed]
    if not failed:
        return ["Nothing failed."]
    lines = [f"- {f.where}: {reason(f) or 'NOT KNOWN BEFORE: see below'}" for f in failed]
    return ["Failures that stay, and why:", "\n".join(lines)]
