"""Known failures, each with its reason. A failure that is not listed makes the stress tests fail; one that no longer occurs is reported."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tests.stress.report import Finding, Section

# A pattern for the place of the finding -> why it stays.
PHASE = "the slope is as wanted; a single tolerance lies off the line, where the step before an instant of the run happens to be long or short"
BETWEEN = (
    "what is stiff is brought to its place between the ends of steps where polynomials are not sure of it; what is only ten times as fast as a step lies on a polynomial "
    "whose error no step is held to: the state of a resistance of 1e-3, where the stiff method was asked for by name, errs by 13 tolerances"
)
SNAP = (
    "the fingers snap together after 1.25 ms, within microseconds; one of the 41 instants lies in that, where runs at 1e-6 … 1e-8 come later by 2e-11 s each, "
    "2e-8 of the time; all other instants are right to a tolerance"
)
GAIN = (
    "torques are what 2000 N m/rad and 400 N m s make of differences of angles and speeds: those are right to a tolerance of what they would be if the arm swung "
    "back freely, and how much of it is left differs from one instant to the next"
)
TURNS = (
    "a crank that turns on and on is measured by the speed at which it would swing back from so many turns, 40 times its own: tolerances of speeds are as much "
    "looser than they should be, and how much of that is used differs"
)
SLOPE = (
    "friction falls within 1e-8 of the speed, which is 1e-2 of the tolerance of the speed: off by 10.5 tolerances; the explicit pair, asked for by name, is told that the block "
    "breaks away and sticks again and again in no time"
)
STRIDES = (
    "each stride ends with a strike, whose instant shifts all that follow: errors of single strides add up, 2.4 tolerances after 10 of them and 26 after 100, in some 19 steps each "
    "(32 of Radau, which comes to 4.9)"
)
STANDING: dict[str, str] = {
    r"^(inverse_kinematics|slider_crank|van_der_pol): scatter": PHASE,
    r"^side_instability: (slope|scatter)": SNAP,
    r"^robot_arm: scatter": GAIN,
    r"^spatial_slider_crank: scatter": TURNS,
    r"^resistances that nearly cancel, what is left 0.001 \(radau": BETWEEN,
    r"^the simplest walking model .*, steps 100 \(rodas": STRIDES,
    r"^stick and slip, friction falls within 1e-09 m/s, cycles 5 \(": SLOPE,
}


def unknown(sections: Sequence[Section]) -> list[Finding]:
    """The failures that are not known to stay."""
    return [f for s in sections for f in s.failed if reason(f) is None]


def reason(finding: Finding) -> str | None:
    """Reason of a known failure; None if it is not allowed."""
    return next((why for pattern, why in STANDING.items() if re.search(pattern, finding.where)), None)


def told(sections: Sequence[Section]) -> list[str]:
    """Paragraphs for the page."""
    failed = [f for s in sections for f in s.failed]
    if not failed:
        return ["Nothing failed."]
    lines = [f"- {f.where}: {reason(f) or 'NOT KNOWN BEFORE: see below'}" for f in failed]
    return ["Failures that stay, and why:", "\n".join(lines)]
