"""A model as a system of units: System Structure and Parameterization (SSP) 1.0, with its units and its experiments as sets of parameters."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

import numpy as np

from compiler import api

from ..errors import RunFailed
from ..simulation.run import run
from ..simulation.run_options import RunOptions
from .model_description import attributes, powers
from .osp import Place, osp_system_structure
from .unit import FmuUnit, unit_of, zipped

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from compiler.api import BondGraph, Compilation, Named, Plan

    from ..compiled_model import CompiledModel
    from .variables import FmuVariable

_SPACES = 'xmlns:{0}="http://ssp-standard.org/SSP1/SystemStructure{1}" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"'
_FIRST = '<?xml version="1.0" encoding="UTF-8"?>\n'

SHORT = 1e-9  # part of the experiment that is run for the values at its start
Values = Mapping[str, float]


def ssp(
    model: CompiledModel, parts: Sequence[str] = (), experiment: str | None = None, platforms: Sequence[str] = ("linux64",), fmi: str = "2"
) -> bytes:  # fmt: skip
    """Return the bytes of a system. Its units are the instances `parts`, or all at the top of the model, and the rest of the model.

    With an experiment its settings are in the units. Raises `CompilationFailed`, `UsageError`, `RunFailed`.
    """
    whole = model.compilation(api.Scene(model.model, experiment, free=frozenset({"*"})))
    parts = tuple(parts) or tuple(name for name in whole.whole_graph.stands if "." not in name)
    cut = whole.system(parts)
    courses = _courses(model, experiment, parts, {k.given for k in cut.links}, whole.plan, SHORT)
    units = {}
    for name in cut.units:
        starts = {k.taken: float(courses[k.given][0]) for k in cut.links if k.taker == name and k.given in courses}
        scene = api.Scene(model.model, experiment or "", unit=(name, parts))
        units[name] = unit_of(model, scene, experiment, platforms, fmi, starts=starts)
    ends = {k: ((k.giver, units[k.giver].names[k.given]), (k.taker, units[k.taker].names[k.taken])) for k in cut.links}
    links = list(ends.values())
    _refuse_loops(units, links, whole)
    taken = {place for _, place in links}
    links += [
        (("", full), (name, own)) for name, unit in units.items() for full, own in _inputs(unit) if (name, own) not in taken
    ]  # fmt: skip
    sources = _sources(units)
    files = {sources[name]: zipped(unit.files) for name, unit in units.items()}
    for chosen in (None, *model.experiments):
        compilation = model.compilation(api.Scene(model.model, chosen or experiment, free=frozenset({"*"})))
        values = _values(compilation.whole_graph, whole.whole_graph, units, taken)
        plan = model.compilation(api.Scene(model.model, chosen or experiment or "")).plan
        name = chosen or "SystemStructure"
        text = _structure(whole.whole_graph.name, units, sources, links, plan, name if values else "")
        files[f"{name}.ssd"] = text.encode("utf-8")
        if values:
            files[f"resources/{name}.ssv"] = _parameter_set(name, values).encode("utf-8")
        if fmi == "2" and chosen is None:
            pairs = cut.bonds if len(cut.bonds) == 1 and plan.stop is not None else ()  # libcosim's files may have one
            efforts_and_flows = {k.given for pair in pairs for k in pair}
            course = _courses(model, experiment, parts, efforts_and_flows, whole.plan, 1.0) if pairs else {}
            power = float(np.abs(np.prod(list(course.values()), axis=0)).max()) if course else 0.0
            bonds = {ends[k]: pair[0].given for pair in pairs for k in pair}
            first = {taken: values[shown] for (giver, shown), taken in links if not giver and shown in values}
            structure = osp_system_structure(sources, [k for k in links if k[0][0]], bonds, first, plan, power)
            files["resources/OspSystemStructure.xml"] = structure.encode("utf-8")
    return zipped(files)


def _courses(
    model: CompiledModel, experiment: str | None, parts: tuple[str, ...], names: Collection[str], plan: Plan, share: float
) -> Mapping[str, NDArray[np.float64]]:  # fmt: skip
    """Return the courses of what goes between units, over a share of the experiment: nothing if the model does not run."""
    scene = api.Scene(model.model, experiment, unit=("", parts))
    to = plan.start + share * ((1.0 if plan.stop is None else plan.stop) - plan.start)
    try:
        result = run(model, scene, {}, RunOptions(to=to, points=2 if share == SHORT else None))
    except (RunFailed, api.CompilationFailed):
        return {}
    return {name: result[name] for name in names}


def _inputs(unit: FmuUnit) -> Iterator[tuple[str, str]]:
    """Yield the inputs of a unit by the names that they have in the model, and in it."""
    own = {item.name for item in unit.variables if item.causality == "input"}
    return ((full, name) for full, name in unit.names.items() if name in own)


def _sources(units: Mapping[str, FmuUnit]) -> dict[str, str]:
    """Return the files of units, with names that need no quotation in an address."""
    sources: dict[str, str] = {}
    for name in units:
        word = re.sub(r"\W", "_", name, flags=re.ASCII)
        while f"resources/{word}.fmu" in sources.values():
            word += "_"
        sources[name] = f"resources/{word}.fmu"
    return sources


def _refuse_loops(units: Mapping[str, FmuUnit], links: Sequence[tuple[Place, Place]], whole: Compilation) -> None:
    """Raise `CompilationFailed` if a value at a cut depends on itself at the same instant: no exchange of values would find it."""
    reads = TopologicalSorter[Place]()
    for start, end in links:
        reads.add(end, start)
    for name, unit in units.items():
        for item in unit.variables:
            if item.causality == "output":
                sources = (unit.variables[place] for place, _ in item.reads or ())
                reads.add((name, item.name), *((name, v.name) for v in sources if v.causality == "input"))
    try:
        reads.prepare()
    except CycleError as error:
        around = ", ".join(f"`{name}` of `{unit}`" for unit, name in error.args[1][1:])
        advice = "Cut elsewhere, with `--part`, or put a storage at the port: a compliance between masses, a mass between compliances."
        what = f"a loop without a state around a cut ({around})"
        raise api.CompilationFailed([api.NotInUnit(whole.whole_graph.span, what, advice)]) from None


def _values(graph: BondGraph, before: BondGraph, units: Mapping[str, FmuUnit], taken: Collection[Place]) -> Values:
    """Return what an experiment sets: parameters, by the names `unit.variable`, and inputs of the system. What changes with time is left out."""
    values = {}
    for name, unit in units.items():
        roles = {v.name: v.causality for v in unit.variables if (name, v.name) not in taken}
        for full, own in unit.names.items():
            value = _number(graph.quantities.get(full))
            if value is None:
                continue
            if roles.get(own) == "input" and value:
                values[full] = value
            elif roles.get(own) == "parameter" and value != _number(before.quantities.get(full)):
                values[f"{name}.{own}"] = value
    return values


def _number(named: Named | None) -> float | None:
    """Return the value of a quantity; None if it is not one number."""
    if named is None:
        return None
    definition = named.definition
    if named.value is None and definition is not None and isinstance(definition.formula.expression, api.Number):
        return float(definition.formula.expression.value)
    return named.value


def _structure(
    name: str, units: Mapping[str, FmuUnit], sources: Mapping[str, str], links: Sequence[tuple[Place, Place]], plan: Plan, chosen: str
) -> str:  # fmt: skip
    """Return the text of a structure. Connectors are what is linked, and all outputs and parameters. `chosen`: the set that holds."""
    variables = {(unit, v.name): v for unit, content in units.items() for v in content.variables}
    linked = {place for link in links for place in link}
    names = {item.unit for item in variables.values() if item.unit and powers(item.unit)}

    def connector(shown: str, item: FmuVariable) -> str:
        unit = attributes({"unit": item.unit}) if item.unit in names else ""
        return f"<ssd:Connector{attributes({'name': shown, 'kind': item.causality})}><ssc:Real{unit}/></ssd:Connector>"

    head = attributes({"version": "1.0", "name": name, "generationTool": "bondgraph"})
    lines = [f"<ssd:SystemStructureDescription {_SPACES.format('ssd', 'Description')}{head}>"]
    lines.append(f"  <ssd:System{attributes({'name': name})}>")
    inputs = {start[1]: variables[end] for start, end in links if not start[0]}
    if inputs:
        inner = "".join(f"      {connector(shown, item)}\n" for shown, item in inputs.items())
        lines.append(f"    <ssd:Connectors>\n{inner}    </ssd:Connectors>")
    if chosen:
        source = attributes({"source": f"resources/{chosen}.ssv"})
        lines.append(f"    <ssd:ParameterBindings><ssd:ParameterBinding{source}/></ssd:ParameterBindings>")
    lines.append("    <ssd:Elements>")
    for unit, content in units.items():
        place = attributes({"name": unit, "type": "application/x-fmu-sharedlibrary", "source": sources[unit]})
        lines.append(f'      <ssd:Component{place} implementation="CoSimulation">\n        <ssd:Connectors>')
        lines += [
            f"          {connector(item.name, item)}"
            for item in content.variables
            if (unit, item.name) in linked or (item.causality in ("output", "parameter") and not item.is_clock)
        ]
        lines.append("        </ssd:Connectors>\n      </ssd:Component>")
    lines.append("    </ssd:Elements>")
    if links:
        lines.append("    <ssd:Connections>")
        for (giver, given), (taker, taken) in links:
            start = {"startElement": giver} if giver else {}
            ends = attributes(start | {"startConnector": given, "endElement": taker, "endConnector": taken})
            lines.append(f"      <ssd:Connection{ends}/>")
        lines.append("    </ssd:Connections>")
    lines.append("  </ssd:System>")
    if names:
        lines.append("  <ssd:Units>")
        lines += [f"    <ssc:Unit{attributes({'name': n})}><ssc:BaseUnit{attributes(powers(n) or {})}/></ssc:Unit>" for n in sorted(names)]  # fmt: skip
        lines.append("  </ssd:Units>")
    stop = {} if plan.stop is None else {"stopTime": repr(plan.stop)}
    lines.append(f"  <ssd:DefaultExperiment{attributes({'startTime': repr(plan.start)} | stop)}/>")
    return _FIRST + "\n".join([*lines, "</ssd:SystemStructureDescription>", ""])


def _parameter_set(name: str, values: Values) -> str:
    """Return the text of a set of parameters."""
    rows = "".join(
        f"    <ssv:Parameter{attributes({'name': full})}><ssv:Real{attributes({'value': repr(value)})}/></ssv:Parameter>\n"
        for full, value in values.items()
    )
    head = (
        f"<ssv:ParameterSet {_SPACES.format('ssv', 'ParameterValues')}{attributes({'version': '1.0', 'name': name})}>"
    )
    return f"{_FIRST}{head}\n  <ssv:Parameters>\n{rows}  </ssv:Parameters>\n</ssv:ParameterSet>\n"
