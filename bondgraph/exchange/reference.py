"""A reference run in a unit, with which other tools compare theirs: files as in the FMI cross-check, told by the layered standard FMI-LS-REF 1.0.0-alpha.1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from compiler.api import CompilationFailed

from ..errors import RunFailed
from ..simulation.run import run
from ..simulation.run_options import RunOptions
from .model_description import UnitHead, attributes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from compiler.api import Scene

    from ..compiled_model import CompiledModel

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
POINTS, MOST = 201, 40_000  # instants, and numbers: the cross-check takes files of 1 MB
_STANDARD = {
    "xmlns:fmi-ls": "http://fmi-standard.org/fmi-ls-manifest", "fmi-ls:fmi-ls-name": "org.fmi-standard.fmi-ls-ref", "fmi-ls:fmi-ls-version": "1.0.0-alpha.1",
    "fmi-ls:fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
}  # fmt: skip


def reference_run(model: CompiledModel, scene: Scene, head: UnitHead, outputs: Mapping[str, str]) -> dict[str, bytes]:
    """Return the files of a run of the scene of a unit, whose free inputs keep their starts, over its experiment; none if there is no such run.

    `outputs`: their names in the unit by those in the model.
    """
    points = min(head.points, POINTS, MOST // (len(outputs) + 1))
    if not outputs or points < 2 or head.stop is None or (scene.experiment is None and head.start != 0.0):
        return {}
    try:
        result = run(model, scene, {}, RunOptions(to=head.stop, points=points, rtol=head.tolerance, energy=True))
    except (CompilationFailed, RunFailed):
        return {}
    rows = np.column_stack([result.time, *(result[name] for name in outputs)]).tolist()
    header = ",".join('"' + name.replace('"', '""') + '"' for name in ("time", *outputs.values()))
    interval = (head.stop - head.start) / (points - 1)
    options = {"StartTime": head.start, "StopTime": head.stop, "StepSize": 0.0, "RelTol": head.tolerance, "OutputIntervalLength": interval}  # fmt: skip
    name = f"{head.identifier}_ref"
    files = {
        f"{name}.csv": "\n".join([header, *(",".join(f"{x:.10g}" for x in row) for row in rows), ""]),
        f"{name}.opt": "".join(f"{word}, {value!r}\n" for word, value in options.items()),
    }
    related = [
        {"type": "text/csv", "source": f"{name}.csv", "role": "result", "description": "Outputs of a run in which inputs keep their starts"},
        {"type": "text/csv", "source": f"{name}.opt", "role": "experiment/smoke-test", "description": "Times and tolerance of this run"},
    ]  # fmt: skip
    lines = [f"<fmiReferences{attributes(_STANDARD)}>", *(f"  <Related{attributes(file)}/>" for file in related)]
    files["fmi-ls-manifest.xml"] = "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *lines, "</fmiReferences>", ""])
    return {f"{FOLDER}/{file}": text.encode("utf-8") for file, text in files.items()}
