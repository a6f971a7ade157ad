"""Description of a functional mock-up unit: `modelDescription.xml` of FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from compiler.api import CompilationFailed, Reported, Source, printable, read_unit

from .variables import FmuVariable, UnitIcon, UnitTerminal, is_structured

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
# Abilities by the version of FMI: of both kinds of a unit, then of each.
_BOTH = {
    "2.0": ("canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"),
    "3.0": ("canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives", "providesAdjointDerivatives"),
}  # fmt: skip
_ALONE: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "ModelExchange": {"2.0": (), "3.0": ("needsCompletedIntegratorStep",)},
    "CoSimulation": {
        "2.0": ("canHandleVariableCommunicationStepSize",),
        "3.0": ("canHandleVariableCommunicationStepSize", "hasEventMode", "mightReturnEarlyFromDoStep"),
    },
}


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


def model_description(
    head: UnitHead, variables: Sequence[FmuVariable], reports: Sequence[Reported], version: str
) -> str:
    """Return the text of the file. `reports`: outputs with the units in which the author reads them."""
    shown = {r.name: r for r in reports if r.unit}
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *_lines(head, variables, shown, version), ""])


def build_description(head: UnitHead) -> str:
    """Return the text of `buildDescription.xml` of FMI 3.0."""
    files = "".join(f"<SourceFile{attributes({'name': name})}/>" for name in head.sources)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f"  <BuildConfiguration{attributes({'modelIdentifier': head.identifier})}>\n"
        f'    <SourceFileSet language="C11">{files}</SourceFileSet>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def terminals_and_icons(terminals: Sequence[UnitTerminal], icon: UnitIcon | None) -> str:
    """Return the text of `terminalsAndIcons.xml` of FMI 3.0: efforts of connected ports are equal, flows sum up to zero."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<fmiTerminalsAndIcons fmiVersion="3.0">']
    if icon is not None:
        scale = 200 / max(icon.width, icon.height) / 2  # the longer side is that of the usual system of coordinates
        x, y = icon.width * scale, icon.height * scale
        place = {"x1": repr(-x), "y1": repr(-y), "x2": repr(x), "y2": repr(y)}
        system = attributes(place | {"suggestedScalingFactorTo_mm": "0.1"})
        lines.append(f"  <GraphicalRepresentation><CoordinateSystem{system}/><Icon{attributes(place)}/></GraphicalRepresentation>")  # fmt: skip
    lines += ["  <Terminals>"] if terminals else []
    for item in terminals:
        head = {"name": item.name, "matchingRule": "plug", "terminalKind": f"_bondgraph_{item.domain}"}
        lines.append(f"    <Terminal{attributes(head)}>")
        for member, name in (("effort", item.effort), ("flow", item.flow)):
            kind = "signal" if member == "effort" else "inflow" if item.inward else "outflow"
            row = {"variableName": name, "memberName": member, "variableKind": kind}
            lines.append(f"      <TerminalMemberVariable{attributes(row)}/>")
        lines.append("    </Terminal>")
    lines += ["  </Terminals>"] if terminals else []
    return "\n".join([*lines, "</fmiTerminalsAndIcons>", ""])


def _lines(
    head: UnitHead, variables: Sequence[FmuVariable], shown: Mapping[str, Reported], version: str
) -> Iterator[str]:
    older = version == "2.0"
    top = {
        "fmiVersion": version, "modelName": head.name, "guid" if older else "instantiationToken": head.token, "description": head.description,
        "generationTool": "bondgraph", "variableNamingConvention": "structured" if is_structured(variables) else "flat",
    }  # fmt: skip
    if older:
        top["numberOfEventIndicators"] = str(head.indicators)
    yield f"<fmiModelDescription{attributes(top)}>"
    files = "".join(f"<File{attributes({'name': name})}/>" for name in head.sources)
    inner = f">\n    <SourceFiles>{files}</SourceFiles>\n  </" if older else "></"
    for kind, alone in _ALONE.items():
        abilities = dict.fromkeys((*alone[version], *_BOTH[version]), "true")
        yield f"  <{kind}{attributes({'modelIdentifier': head.identifier, **abilities})}{inner}{kind}>"
    yield from _units(variables, shown)
    yield '  <LogCategories><Category name="logStatus"/></LogCategories>'
    yield f"  <DefaultExperiment{attributes(_experiment(head))}/>"
    yield "  <ModelVariables>"
    for place, item in enumerate(variables):
        yield _variable(place, item, shown.get(item.name) if item.causality == "output" else None, older)
    yield "  </ModelVariables>"
    yield "  <ModelStructure>"
    yield from _structure_2(variables) if older else _structure_3(variables)
    yield "  </ModelStructure>"
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
        base = powers(name)
        inner = "" if base is None else f"<BaseUnit{attributes(base)}/>"
        outputs = [shown[v.name] for v in variables if v.unit == name and v.causality == "output" and v.name in shown]
        for unit, report in {r.unit: r for r in outputs}.items():
            scale = {"name": unit, "factor": repr(report.scale), "offset": repr(report.offset)}
            inner += f"<DisplayUnit{attributes(scale)}/>"
        yield f"    <Unit name={_quoted(name)}>{inner}</Unit>" if inner else f"    <Unit name={_quoted(name)}/>"
    yield "  </UnitDefinitions>"


def powers(unit: str) -> Mapping[str, str] | None:
    """Return the powers of the base units in a unit; None if they are no whole numbers."""
    try:
        exponents = read_unit(Source("unit", unit)).dimension.exponents
    except CompilationFailed:
        return None
    if any(e.denominator != 1 for e in exponents):
        return None
    return {base: str(e) for base, e in zip(_BASES, exponents, strict=True) if e}


def _variable(place: int, item: FmuVariable, report: Reported | None, older: bool) -> str:
    head = {"name": item.name, "valueReference": str(place)}
    head |= {"description": item.description} if item.description else {}
    if item.is_clock:
        return f"    <Clock{attributes(head | {'causality': item.causality, 'intervalVariability': 'triggered'})}/>"
    head |= {"causality": item.causality, "variability": item.variability}
    head |= {"initial": item.initial} if item.initial else {}
    real: dict[str, str] = {}
    real |= {"unit": item.unit} if item.unit else {}
    real |= {"displayUnit": report.unit} if report is not None else {}
    real |= {word: repr(bound) for word, bound in (("min", item.least), ("max", item.most)) if bound is not None}
    real |= {"nominal": repr(item.nominal)} if item.nominal is not None and item.nominal > 0 else {}
    real |= {"start": repr(item.start)} if item.start is not None else {}
    real |= {"derivative": str(item.derivative_of + older)} if item.derivative_of is not None else {}
    real |= {"reinit": "true"} if item.reset else {}
    if older:
        return f"    <ScalarVariable{attributes(head)}><Real{attributes(real)}/></ScalarVariable>"
    return f"    <Float64{attributes(head | real)}/>"


def _structure_2(variables: Sequence[FmuVariable]) -> Iterator[str]:
    """Yield what rates and outputs depend on, and what an initialization computes. Variables count from 1 here."""
    for name, members in _unknowns(variables).items():
        if members:
            yield f"    <{name}s>"
            for place, item in members:
                reads = {} if name == "InitialUnknown" else _reads(item, 1)
                yield f"      <Unknown{attributes({'index': str(place + 1)} | reads)}/>"
            yield f"    </{name}s>"


def _structure_3(variables: Sequence[FmuVariable]) -> Iterator[str]:
    """Yield the same, by value references, and the event indicators. There are importers that want all dependencies."""
    unknowns = _unknowns(variables)
    unknowns["EventIndicator"] = [(i, v) for i, v in enumerate(variables) if v.is_indicator]
    parameters = [i for i, v in enumerate(variables) if v.causality == "parameter"]
    for name, members in unknowns.items():
        element = name.replace("Derivative", "ContinuousStateDerivative")
        for place, item in members:
            at_start = [i for i, _ in item.reads or () if variables[i].initial != "calculated"] + parameters
            reads = {"dependencies": " ".join(map(str, at_start))} if name == "InitialUnknown" else _reads(item, 0)
            yield f"    <{element}{attributes({'valueReference': str(place)} | reads)}/>"


def _unknowns(variables: Sequence[FmuVariable]) -> dict[str, list[tuple[int, FmuVariable]]]:
    """Return outputs, rates, and what an initialization computes, each with its place."""
    items = list(enumerate(variables))
    return {
        "Output": [(i, v) for i, v in items if v.causality == "output"],
        "Derivative": [(i, v) for i, v in items if v.derivative_of is not None],
        "InitialUnknown": [
            (i, v)
            for i, v in items
            if (v.initial == "calculated" and (v.causality == "output" or v.variability == "continuous"))
            or v.derivative_of is not None
        ],
    }


def _reads(item: FmuVariable, first: int) -> dict[str, str]:
    """Return what a variable depends on, where variables count from `first`."""
    reads = item.reads or ()
    places = {"dependencies": " ".join(str(i + first) for i, _ in reads)}
    return places | ({"dependenciesKind": " ".join(kind for _, kind in reads)} if reads else {})


def attributes(values: Mapping[str, str]) -> str:
    """Return attributes as they stand in a file."""
    return "".join(f" {name}={_quoted(value)}" for name, value in values.items())


def _quoted(text: str) -> str:
    return quoteattr(printable(text))
