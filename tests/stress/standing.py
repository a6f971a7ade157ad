"""Failures that stay: each with its reason. One that is not here makes the stress tests fail; one that is gone is told, and goes from here."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tests.stress.report import Finding, Section

# A pattern for the place of the finding -> why it stays.
BANDWIDTH = "the error falls a little faster than wanted: the estimate is of order 3 and the method of order 5, so loose tolerances are held less well than tight ones"
PHASE = "the slope is as wanted; a single tolerance lies off the line, where the step before an instant of the run happens to be long or short"
STANDING: dict[str, str] = {
    r"^(car|crank_linkage|drag): slope": BANDWIDTH,
    r"^(pendulum|rectifier): scatter": PHASE,
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
