"""`bondgraph stress` on every model of the gallery: what must not change a result changes none."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import bondgraph
from tests.stress.report import Section

MODELS = Path(__file__).resolve().parents[2] / "models"
SECONDS = 60.0  # for each model
SHORT = {"oscillator": 2.0}


def section(short: bool) -> Section:
    """One row for each model: changes that were tried of each kind, and those that broke it."""
    found = Section("11. The gallery, by `bondgraph stress`")
    rows: list[list[object]] = []
    for path in sorted(MODELS.glob("*.bg")):
        if short and path.stem not in SHORT:
            continue
        try:
            test = bondgraph.load(path).stress(seconds=SHORT[path.stem] if short else SECONDS)
        except (bondgraph.CompilationFailed, bondgraph.UsageError, bondgraph.RunFailed) as problem:
            found.refuse(path.stem, str(problem))
            continue
        tried = Counter({row.kind: row.tried for row in test.rows})
        found.tried += tried.total()
        rows.append([path.stem, tried.total(), len(test.breaks), ", ".join(f"{n} {kind}" for kind, n in tried.items())])
        for broken in test.breaks:
            found.fail(f"{path.stem}, {broken.kind}", f"{broken.change}: {broken.sentence}")
    found.table(("model", "tried", "broke", "changes of each kind"), rows)
    return found
