"""Units of small texts, and their instances by FMPy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import bondgraph

fmpy = pytest.importorskip("fmpy")

from fmpy import extract, read_model_description, simulate_fmu  # noqa: E402
from fmpy.fmi1 import FMICallException  # noqa: E402, F401
from fmpy.fmi2 import FMU2Model, FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Model, FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

CLASSES = {"2.0": {"CoSimulation": FMU2Slave, "ModelExchange": FMU2Model}, "3.0": {"CoSimulation": FMU3Slave, "ModelExchange": FMU3Model}}  # fmt: skip


def exported(text: str | Path, path: Path, experiment: str | None = None, fmi: str = "2") -> Any:
    """Write the unit of a text into a folder; return its description. FMPy must find nothing wrong with it."""
    file = path / "unit.fmu"
    bondgraph.load(text).to_fmu(file, experiment, fmi=fmi)
    assert validate_fmu(str(file)) == []
    return read_model_description(str(file))


def run(path: Path, kind: str, **options: Any) -> Any:
    """Results of FMPy's own run. Model exchange is integrated by CVode, whose tolerance is met less closely."""
    return simulate_fmu(str(path / "unit.fmu"), fmi_type=kind, relative_tolerance=options.pop("rtol", 1e-6), **options)


@contextmanager
def instance(path: Path, kind: str = "CoSimulation", values: Mapping[str, float] | None = None, **options: Any) -> Iterator[tuple[Any, dict[str, int]]]:  # fmt: skip
    """An instance after its initialization, and its value references by name."""
    description = read_model_description(str(path / "unit.fmu"))
    folder = path / "extracted"
    if not folder.exists():
        extract(str(path / "unit.fmu"), str(folder))
    made = CLASSES[description.fmiVersion][kind](
        guid=description.guid, unzipDirectory=str(folder), modelIdentifier=description.coSimulation.modelIdentifier, instanceName="one"
    )  # fmt: skip
    references = {v.name: v.valueReference for v in description.modelVariables}
    experiment = {"tolerance": options.pop("tolerance", None), "startTime": 0.0}
    made.instantiate(**options)
    if description.fmiVersion == "2.0":
        made.setupExperiment(**experiment)
        made.enterInitializationMode()
    else:
        made.enterInitializationMode(**experiment)
        made.getReal, made.setReal = made.getFloat64, made.setFloat64
    for name, value in (values or {}).items():
        made.setReal([references[name]], [value])
    made.exitInitializationMode()
    yield made, references
    made.terminate()
    made.freeInstance()
