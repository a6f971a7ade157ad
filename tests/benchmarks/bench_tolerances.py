"""A tolerance study of 10 000 manipulators with frequencies and Sobol indices, shared out among the cores; less than a minute on two.

    python -m tests.benchmarks tolerances

Ends with an error if it takes longer on a machine that has nothing else to do, or if points depend on who makes them.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

import bondgraph
from tests.compiling import MODELS

RESULTS = Path(__file__).with_name("results")
SAMPLES, CHECKED, LONGEST = 10_000, 20, 60.0
VARY = {
    "d[1]": "normal(1.95 um, 20 nm)",
    "E[1]": "normal(130 GPa, 4 GPa)",
    "a": "normal(170 um, 0.5 um)",
    "f": "triangular(0.4, 0.44, 0.47)",
}


def main() -> None:
    load = os.getloadavg()[0]
    model = bondgraph.load(MODELS / "manipulator.bg")
    begun = time.perf_counter()
    study = model.montecarlo(VARY, of="modes", samples=SAMPLES)
    took = time.perf_counter() - begun
    for i in range(0, SAMPLES, SAMPLES // CHECKED):
        alone = [m.frequency for m in model.modes(settings={n: float(study(n)[i]) for n in VARY}) if m.frequency > 0]
        assert np.allclose(study.values[i], alone[: study.values.shape[1]], rtol=1e-12, atol=0), (
            "points depend on who makes them"
        )
    assert not study.failures and study.indices is not None
    spread = [study.statistics(f"frequency {i}") for i in (1, 2, 3)]
    lines = [
        "# Tolerances", "", f"{len(study)} manipulators with Sobol indices on {study.indices.count} rows: {took:.1f} s on {os.cpu_count()} cores "
        f"with a load of {load:.1f}.", "", "| | mean, Hz | standard deviation, Hz | the most of its variance |", "|---|---:|---:|---|",
    ]  # fmt: skip
    for i, told in enumerate(spread):
        most = int(np.argmax(study.indices.total[i]))
        share = f"{study.parameters[most]}, {100 * study.indices.total[i, most]:.0f} %"
        lines.append(f"| frequency {i + 1} | {told['mean']:.2f} | {told['standard deviation']:.2f} | {share} |")
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "tolerances.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))
    if took > LONGEST and load < 1:
        sys.exit(f"{took:.0f} s is longer than {LONGEST:.0f} s")
