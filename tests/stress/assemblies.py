"""Starts of closed mechanisms with random dimensions: on the branch that is drawn to 1e-9, or refused where no way leads there, by closed forms or a
continuation by hand."""

from __future__ import annotations

from collections import Counter

import numpy as np

import bondgraph
from bondgraph.errors import RunFailed
from tests.simulation.linkages import LINKAGES, Case
from tests.stress.report import Section

EXACT = 1e-9
LONG = {"slider-crank": 200, "four-bar": 200, "five-bar": 200, "Stephenson": 150, "RSSR": 150, "Bricard": 100}
SHORT = {"slider-crank": 10, "four-bar": 2, "RSSR": 2}


def section(short: bool) -> Section:
    """Random cases of each linkage, with counts of right and refused starts."""
    found = Section("Starts of closed mechanisms")
    rows = []
    for name, count in (SHORT if short else LONG).items():
        linkage, rng, counts = LINKAGES[name], np.random.default_rng(5), Counter[str]()
        model = bondgraph.load(linkage.text())
        for number in range(count):
            case = linkage.case(rng)
            kind, words = _tried(model, case)
            counts[kind] += 1
            found.tried += 1
            if kind in ("wrong", "refused though reachable"):
                found.fail(f"{name} {number}", f"{kind}: {words}; {dict(case.settings)}")
        rows.append([name, count, counts["right"], counts["refused"], counts["refused near a singular pose"]])
    found.table(["mechanism", "tried", "right to 1e-9", "refused, no way there", "refused near a singular pose"], rows)
    return found


def _tried(model: bondgraph.Model, case: Case) -> tuple[str, str]:
    """The kind of an outcome, and words about it."""
    try:
        found = model.simulate("go", case.settings, target="numpy")
    except RunFailed as failed:
        if case.wanted is None:
            return "refused", ""
        return "refused near a singular pose" if case.open_ else "refused though reachable", str(failed)
    if case.wanted is None:
        return "wrong", "no way leads there"
    off = max(abs(found[n][0] - v) / max(1.0, abs(v)) for n, v in case.wanted.items())
    return ("right", "") if off <= EXACT else ("wrong", f"off by {off:.3g}")
