"""Description of a functional mock-up unit, `modelDescription.xml` of FMI 2.0."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from compiler.api import CompilationFailed, Source, printable, read_unit

from .variables import FmuVariable, is_structured

if TYPE_CHECKING:
    from compiler.api import Reported

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
_ABILITIES = {
    "canNotUseMemoryManagementFunctions": "true", "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "providesDirectionalDerivative": "true",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class UnitHead:
    """Facts of a unit: name of its model, file name of its libraries, token, description, and the experiment."""

    name: str
    identifier: str
    token: str
    description: str
    start: float
    stop: float | None
    tolerance: float
    points: int
    indicators: int  # number of event indicators
    sources: tuple[str, ...]  # files in the folder `sources`


def model_description(head: UnitHead, variables: Sequence[FmuVariable], reports: Sequence[Reported]) -> str:
    """Return the text of the file. `reports`: outputs with the units in which the author reads them."""
    shown = {r.name: r for r in reports if r.unit}
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *_lines(head, variables, shown), ""])


def _lines(head: UnitHead, variables: Sequence[FmuVariable], shown: Mapping[str, Reported]) -> Iterator[str]:
    convention = "structured" if is_structured(variables) else "flat"
    top = {
        "fmiVersion": "2.0", "modelName": head.name, "guid": head.token, "description": head.description, "generationTool": "bondgraph",
        "variableNamingConvention": convention, "numberOfEventIndicators": str(head.indicators),
    }  # fmt: skip
    yield f"<fmiModelDescription{_attributes(top)}>"
    kinds = {
        "ModelExchange": _ABILITIES,
        "CoSimulation": {"canHandleVariableCommunicationStepSize": "true", **_ABILITIES},
    }
    for kind, abilities in kinds.items():
        yield f"  <{kind}{_attributes({'modelIdentifier': head.identifier, **abilities})}>"
        files = "".join(f"<File{_attributes({'name': name})}/>" for name in head.sources)
        yield f"    <SourceFiles>{files}</SourceFiles>"
        yield f"  </{kind}>"
    yield from _units(variables, shown)
    yield '  <LogCategories><Category name="logStatus"/></LogCategories>'
    yield f"  <DefaultExperiment{_attributes(_experiment(head))}/>"
    yield "  <ModelVariables>"
    for place, item in enumerate(variables):
        yield from _variable(place, item, shown.get(item.name) if item.causality == "output" else None)
    yield "  </ModelVariables>"
    yield from _structure(variables)
    yield "</fmiModelDescription>"


def _experiment(head: UnitHead) -> dict[str, str]:
    experiment = {"startTime": repr(head.start), "tolerance": repr(head.tolerance)}
    if head.stop is not None:
        step = (head.stop - head.start) / max(head.points - 1, 1)
        experiment |= {"stopTime": repr(head.stop), "stepSize": repr(step)}
    return experiment


def _units(variables: Sequence[FmuVariable], shown: Mapping[str, Reported]) -> Iterator[str]:
    """Yield the units, each as powers of base units; those that are no whole powers by their names alone."""
    names = sorted({item.unit for item in variables if item.unit})
    if not names:
        return
    yield "  <UnitDefinitions>"
    for name in names:
        powers = _powers(name)
        inner = "" if powers is None else f"<BaseUnit{_attributes(powers)}/>"
        outputs = [shown[v.name] for v in variables if v.unit == name and v.causality == "output" and v.name in shown]
        for unit, report in {r.unit: r for r in outputs}.items():
            scale = {"name": unit, "factor": repr(report.scale), "offset": repr(report.offset)}
            inner += f"<DisplayUnit{_attributes(scale)}/>"
        yield f"    <Unit name={_quoted(name)}>{inner}</Unit>" if inner else f"    <Unit name={_quoted(name)}/>"
    yield "  </UnitDefinitions>"


def _powers(unit: str) -> Mapping[str, str] | None:
    try:
        exponents = read_unit(Source("unit", unit)).dimension.exponents
    except CompilationFailed:
        return None
    if any(e.denominator != 1 for e in exponents):
        return None
    return {base: str(e) for base, e in zip(_BASES, exponents, strict=True) if e}


def _variable(place: int, item: FmuVariable, report: Reported | None) -> Iterator[str]:
    head = {"name": item.name, "valueReference": str(place)}
    head |= {"description": item.description} if item.description else {}
    head |= {"causality": item.causality, "variability": item.variability}
    head |= {"initial": item.initial} if item.initial else {}
    real: dict[str, str] = {}
    real |= {"unit": item.unit} if item.unit else {}
    real |= {"displayUnit": report.unit} if report is not None else {}
    real |= {"nominal": repr(item.nominal)} if item.nominal is not None and item.nominal > 0 else {}
    real |= {"start": repr(item.start)} if item.start is not None else {}
    real |= {"derivative": str(item.derivative_of + 1)} if item.derivative_of is not None else {}
    yield f"    <ScalarVariable{_attributes(head)}><Real{_attributes(real)}/></ScalarVariable>"


def _structure(variables: Sequence[FmuVariable]) -> Iterator[str]:
    """Yield what rates and outputs depend on, and what an initialization computes. Variables count from 1 here."""
    groups = {
        "Outputs": [(i, v) for i, v in enumerate(variables) if v.causality == "output"],
        "Derivatives": [(i, v) for i, v in enumerate(variables) if v.derivative_of is not None],
    }
    yield "  <ModelStructure>"
    for name, members in groups.items():
        if members:
            yield f"    <{name}>"
            yield from (f"      <Unknown{_attributes(_reads(i, v))}/>" for i, v in members)
            yield f"    </{name}>"
    initial = [i for i, v in enumerate(variables) if v.initial == "calculated" or v.derivative_of is not None]
    if initial:
        yield "    <InitialUnknowns>"
        yield from (f'      <Unknown index="{i + 1}"/>' for i in initial)
        yield "    </InitialUnknowns>"
    yield "  </ModelStructure>"


def _reads(place: int, item: FmuVariable) -> dict[str, str]:
    reads = item.reads or ()
    attributes = {"index": str(place + 1), "dependencies": " ".join(str(i + 1) for i, _ in reads)}
    return attributes | ({"dependenciesKind": " ".join(kind for _, kind in reads)} if reads else {})


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f" {name}={_quoted(value)}" for name, value in values.items())


def _quoted(text: str) -> str:
    return quoteattr(printable(text))
