"""A functional mock-up unit as a model: `import Motor from "motor.fmu"`; and a system of them (SSP 1.0): `import Car from "car.ssp"`.

The description of a unit becomes a text of the language, a model with parameters, inputs and one `every`; nothing of the unit runs here. The run exchanges the
values that the block sets with the unit: see `bondgraph/simulation/segments/units.py`.

The structure of a system becomes a text of the language in which each unit is an instance; units are exchanged with as imported ones are.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from io import BytesIO
from math import inf, isfinite
from pathlib import Path
from xml.etree import ElementTree
from zipfile import BadZipFile, ZipFile

from ...errors import printable
from ...fast_dataclass import dataclass
from ...graph.domains import DOMAINS
from ...graph.units import Dimension
from ...source import MAXIMUM_BYTES, SYSTEM, Source
from .scope import RESERVED
from .statement_errors import NotImportable

STEP, HELD = "communication_step", "held_"
USUAL_TOLERANCE = 1e-6  # of a unit for model exchange that names none
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
_TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
_REAL = {"2.0": ("ScalarVariable", "SimpleType"), "3.0": ("Float64", "Float64Type")}  # elements of variables, of types
_BOUNDS = {"needsExecutionTool": "needs the tool that made it", "canBeInstantiatedOnlyOncePerProcess": "may be there only once"}  # fmt: skip
_UNIT = re.compile(r"[^\W\d_%][\w*/^() %.-]*|%|1|1/[\w*/^() .-]+")
_NAME = "{{http://ssp-standard.org/SSP1/SystemStructure{0}}}{1}".format
_REFUSED = {
    "System": "systems within it",
    "SignalDictionaryReference": "signal dictionaries",
    "ParameterMapping": "parameters with a mapping",
}
_UNIT_TYPE = "application/x-fmu-sharedlibrary"


@dataclass(frozen=True, slots=True)
class UnitVariable:
    """A variable of a unit: its name in the language, its own and its reference there, and its value in SI = factor*value + offset.

    `unit`: as the language writes it; a factor of None is that of this unit.
    """

    name: str
    own: str
    reference: int
    role: str
    unit: str
    factor: float | None
    offset: float
    start: float | None
    description: str


@dataclass(frozen=True, slots=True)
class UnitPort:
    """A terminal that is a power port: its name, its domain, its effort and flow, and True if power that is positive comes in."""

    name: str
    domain: str
    members: tuple[UnitVariable, UnitVariable]
    inward: bool


@dataclass(frozen=True, slots=True)
class UnitDescription:
    """All that a model and a run need of a unit. `step`: its own communication step in s, if it names one.

    `has_steps`: it is for co-simulation; of another one, for model exchange, FMI 2.0 has the numbers of states and event indicators here.
    """

    name: str
    version: str
    token: str
    identifier: str
    description: str
    step: float | None
    variables: tuple[UnitVariable, ...]
    has_steps: bool
    tolerance: float
    states: int
    indicators: int
    ports: tuple[UnitPort, ...] = ()

    def of(self, *roles: str) -> list[UnitVariable]:
        """Return the variables with one of these roles."""
        return [v for v in self.variables if v.role in roles]


def read_unit_description(path: Path) -> UnitDescription:
    """Return the description of a unit. Raises OSError, NotImportable."""
    try:
        with open_unit(path) as archive:
            if archive.getinfo("modelDescription.xml").file_size > MAXIMUM_BYTES:
                raise NotImportable("its description is too long", f"At most {MAXIMUM_BYTES} bytes are read.")
            text, terminals = archive.read("modelDescription.xml"), b""
            if _TERMINALS in archive.namelist() and archive.getinfo(_TERMINALS).file_size <= MAXIMUM_BYTES:
                terminals = archive.read(_TERMINALS)
        names = NewNames()
        unit = _described(parsed(text), path.stem, names)
        return replace(unit, ports=tuple(_ports(parsed(terminals), unit.variables, names))) if terminals else unit
    except (BadZipFile, KeyError, ValueError, RuntimeError, NotImplementedError, ElementTree.ParseError):
        hint = "It is an archive with a `modelDescription.xml` of FMI 2.0 or 3.0."
        raise NotImportable("it is no functional mock-up unit", hint) from None


def parsed(text: bytes) -> ElementTree.Element:
    """Return an XML text as a tree. Raises ValueError if it defines entities, ParseError."""
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError
    return ElementTree.fromstring(text)


def open_unit(path: Path) -> ZipFile:
    """Open the archive of a unit, which may lie in that of a system. Raises OSError, KeyError, BadZipFile."""
    system = next((outer for outer in path.parents if outer.suffix == SYSTEM and outer.is_file()), None)
    if system is None:
        return ZipFile(path)
    with ZipFile(system) as archive:
        return ZipFile(BytesIO(archive.read(path.relative_to(system).as_posix())))


def unit_model(unit: UnitDescription, name: str, path: Path, word: str = "") -> Source:
    """Return the text of a model that stands for a unit, under its own name or another one."""
    first = "" if unit.step is None else f" = {unit.step!r} s"
    yields, takes = unit.of("output"), unit.of("parameter", "input")
    joined = {item.name for port in unit.ports for item in port.members}
    lines = [f'  "{unit.description}"', f'  parameter {STEP}: s{first} "time between two exchanges"']
    for port in unit.ports:
        lines += _source(port)
    for item in takes:
        if item.name in joined:
            continue
        start = "" if item.start is None else f" = {value_of(item.start, item)}"
        lines.append(f'  {item.role} {declared(item)}{start} "{item.description}"')
    lines += [f"  mode {declared(v)} = 0" for v in yields]
    lines += [f"  mode {declared(v, HELD)} = 0" for v in takes]
    lines += [f"  every {STEP} {{", *(f"    {HELD}{v.name} = {v.name}" for v in takes)]
    lines += [f"    {v.name} = {v.name} + {value_of(1.0, v)}" for v in yields]  # something moves: the unit
    return Source(name, "\n".join([f"model {word or unit.name} {{", *lines, "  }", "}", ""]), path)


def _source(port: UnitPort) -> Iterator[str]:
    """Yield the source that gives a port what comes out of the unit, and the signal of what goes in."""
    rows = list(zip(port.members, ("e", "f"), strict=True))
    letters = {v.role: (DOMAINS[port.domain].letter(letter), v, f"MS{letter}") for v, letter in rows}
    (own, result, kind), (other, taken, _) = letters["output"], letters["input"]
    source = f"{port.name}_source"
    ends = (port.name, source) if port.inward else (source, port.name)
    yield f"  port {port.name}: {port.domain}"
    yield f"  {kind} {source} : {own} = {result.name}"
    yield f"  {ends[0]} -> {ends[1]}"
    yield f"  signal {taken.name} = {source}.{other}"


def declared(item: UnitVariable, before: str = "", word: str = "") -> str:
    """Return the name of a variable with its unit."""
    return f"{before}{word or item.name}" if item.unit == "1" else f"{before}{word or item.name}: {item.unit}"


def value_of(value: float, item: UnitVariable) -> str:
    """Return a number of a variable as the language writes it."""
    return repr(value) if item.unit == "1" else f"{value!r} [{item.unit}]"


def _described(root: ElementTree.Element, stem: str, names: NewNames) -> UnitDescription:
    version, head, stepper = root.get("fmiVersion", "")[:3], root.find("DefaultExperiment"), root.find("CoSimulation")
    has_steps = stepper is not None
    stepper = root.find("ModelExchange") if stepper is None else stepper
    if root.tag != "fmiModelDescription" or version not in _REAL or stepper is None:
        raise ValueError
    for flag, what in _BOUNDS.items():
        if stepper.get(flag) in ("true", "1"):
            raise NotImportable(f"it {what}", "Export it without that bound.")
    name, token = root.get("modelName") or stem, root.get("guid" if version == "2.0" else "instantiationToken", "")
    identifier, variables = stepper.get("modelIdentifier", ""), tuple(_variables(root, version, names))
    if not identifier.isidentifier():
        raise ValueError
    if not any(v.role == "output" for v in variables):
        raise NotImportable("it has no real output", "Nothing in a model could read it.")
    facts = {} if head is None else head.attrib
    step, tolerance = (float(facts.get(fact, "0")) for fact in ("stepSize", "tolerance"))
    own = step if 0 < step < inf else None
    states = len(root.findall("ModelStructure/Derivatives/Unknown"))
    indicators = int(root.get("numberOfEventIndicators", "0"))
    return UnitDescription(
        NewNames().new(name), version, token, identifier, _text(root), own, variables,
        has_steps, tolerance if 0 < tolerance < 1 else USUAL_TOLERANCE, states, indicators,
    )  # fmt: skip


def _variables(root: ElementTree.Element, version: str, names: NewNames) -> Iterator[UnitVariable]:
    """Yield the real numbers among the variables, and no arrays."""
    element, type_element = _REAL[version]
    units = {u.get("name", ""): u.find("BaseUnit") for u in root.iterfind("UnitDefinitions/Unit")}
    types = {t.get("name"): _real(t, version) for t in root.iterfind(f"TypeDefinitions/{type_element}")}
    for item in root.iterfind(f"ModelVariables/{element}"):
        role, real = item.get("causality", ""), _real(item, version)
        if role not in ("parameter", "input", "output") or real is None or item.find("Dimension") is not None:
            continue
        facts = {**(types.get(real.get("declaredType")) or {}), **real}
        unit, factor, offset = _scale(facts.get("unit", ""), units, facts.get("relativeQuantity") in ("true", "1"))
        name, own = names.new(item.get("name", "")), item.get("name", "")
        start = float(facts["start"]) if "start" in facts else 0.0 if role == "input" else None
        if start is not None and factor is not None:
            start = factor * start + offset
        if start is not None and not isfinite(start):
            raise NotImportable(f"its `{own}` starts at no finite value", "Give it one where the unit is made.")
        yield UnitVariable(
            name, own, int(item.get("valueReference", "")), role, unit, factor, offset, start, _text(item)
        )


def _ports(root: ElementTree.Element, variables: Iterable[UnitVariable], names: NewNames) -> Iterator[UnitPort]:
    """Yield the terminals of which an effort and a flow of one domain are the members: one comes in, the other goes out."""
    own = {v.own: v for v in variables}
    for terminal in root.iterfind("Terminals/Terminal"):
        rows = {m.get("variableName", ""): m.get("variableKind") for m in terminal.iterfind("TerminalMemberVariable")}
        members = [own[name] for name in rows if name in own]
        if len(rows) != 2 or sorted(v.role for v in members) != ["input", "output"]:
            continue
        word = terminal.get("terminalKind", "").removeprefix("_bondgraph_")
        for domain in sorted(DOMAINS.values(), key=lambda d: d.name != word):
            letters = (str(domain.effort), str(domain.flow))
            ordered = sorted(members, key=lambda v: v.unit != letters[0])
            if domain.has_power and tuple(v.unit for v in ordered) == letters:
                name = names.new(terminal.get("name", ""))
                names.taken.add(f"{name}_source")
                yield UnitPort(name, domain.name, (ordered[0], ordered[1]), "outflow" not in rows.values())
                break


def _real(item: ElementTree.Element, version: str) -> Mapping[str, str] | None:
    """Return the attributes of a real number; None for another kind."""
    inner = item.find("Real") if version == "2.0" else item
    return None if inner is None else inner.attrib


def _scale(name: str, units: Mapping[str, ElementTree.Element | None], is_difference: bool) -> tuple[str, float | None, float]:  # fmt: skip
    """Return a unit in the language, with its factor and offset."""
    base = units.get(name)
    if base is not None:
        powers = tuple(Fraction(int(base.get(b, "0"))) for b in _BASES)
        factor, offset = float(base.get("factor", "1")), 0.0 if is_difference else float(base.get("offset", "0"))
        if not isfinite(factor) or not isfinite(offset) or factor == 0 or any(abs(p) > 20 for p in powers):
            raise ValueError
        return str(Dimension(powers)), factor, offset
    if not name:
        return "1", 1.0, 0.0
    if not _UNIT.fullmatch(name):
        raise NotImportable(f"its unit `{printable(name)}` is none of the language", "Define it by base units there.")
    return name, None, 0.0


def _text(item: ElementTree.Element) -> str:
    return printable(item.get("description", "")).replace('"', "'").replace("\\", "/")


class NewNames:
    """Names of the language for names of units; no two are one."""

    def __init__(self, taken: Iterable[str] = (STEP,)) -> None:
        self.taken = set(taken)

    def new(self, name: str) -> str:
        """Return `mass.p` as `mass_p`."""
        word = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "x"
        word = f"x{word}" if word[0].isdigit() or word.startswith(HELD) else word
        while word in self.taken or word in RESERVED:
            word += "_"
        self.taken.add(word)
        return word


def read_system(path: Path, name: str) -> tuple[Source, dict[str, Source]]:
    """Return the text of the model, and those of its units by their names. Raises OSError, NotImportable."""
    try:
        with ZipFile(path) as archive:
            return _read(archive, path, name)
    except (BadZipFile, KeyError, ValueError, RuntimeError, NotImplementedError, ElementTree.ParseError):
        hint = "It is an archive with a `SystemStructure.ssd` of SSP 1.0, and its units."
        raise NotImportable("it is no system of units", hint) from None


def _part(archive: ZipFile, file: str) -> ElementTree.Element:
    return parsed(archive.read(file) if archive.getinfo(file).file_size <= MAXIMUM_BYTES else b"")


def _read(archive: ZipFile, path: Path, name: str) -> tuple[Source, dict[str, Source]]:
    """Return a model for the structure that holds, and one for each other, as those of experiments, with the name of its file."""
    names = NewNames()
    text, sources = _model(archive, path, name, "SystemStructure.ssd", names)
    for file in sorted(
        n for n in archive.namelist() if n.endswith(".ssd") and "/" not in n and n != "SystemStructure.ssd"
    ):
        try:
            other, own = _model(archive, path, name, file, names)
        except (NotImportable, KeyError, ValueError, ElementTree.ParseError):
            continue  # there is no model of that name then
        if all(sources.get(word, source).text == source.text for word, source in own.items()):
            text, sources = text + other, sources | own
    return Source(name, text, path), sources


def _model(archive: ZipFile, path: Path, name: str, file: str, models: NewNames) -> tuple[str, dict[str, Source]]:
    root = _part(archive, file)
    system = root.find(_NAME("Description", "System"))
    if system is None:
        raise ValueError
    for element, what in _REFUSED.items():
        if any(inner is not system for inner in system.iter(_NAME("Description", element))):
            raise NotImportable(f"it has {what}", "Systems of units, connections and sets of parameters are imported.")
    own_name = root.get("name", "") or path.stem if file == "SystemStructure.ssd" else file.removesuffix(".ssd")
    names, model = NewNames((STEP,)), models.new(own_name)
    units: dict[str, UnitDescription] = {}
    words, kinds, sources = {"": ""}, dict[str, str](), dict[str, Source]()
    for component in system.iter(_NAME("Description", "Component")):
        unit, place = component.get("name", ""), path / component.get("source", "")
        if component.get("type", _UNIT_TYPE) != _UNIT_TYPE:
            raise NotImportable(f"its `{unit}` is no unit", "Other kinds of components are not imported.")
        if not place.is_relative_to(path):
            raise NotImportable(f"its `{printable(unit)}` lies outside it", "Units of a system are in its archive.")
        try:
            units[unit], words[unit] = replace(read_unit_description(place), ports=()), names.new(unit)
        except NotImportable as error:
            raise NotImportable(f"of its `{printable(unit)}`: {error.args[0]}", *error.args[1:]) from None
        kinds[unit] = names.new(f"{unit} unit")
        sources[kinds[unit]] = unit_model(units[unit], f"{name}/{place.name}", place, kinds[unit])
    values = dict(_values(archive, system))
    connected, lines, outputs = defaultdict[str, dict[str, str]](dict), [], []
    own = {unit: {v.own: v for v in description.variables} for unit, description in units.items()}
    inputs: dict[str, str] = {}
    givers: dict[tuple[str, str], tuple[str, str]] = {}
    for link in system.iter(_NAME("Description", "Connection")):
        if len(link):
            raise NotImportable("a connection of it changes values", "Connect what is equal.")
        giver, given_name, taker, taken = (link.get(end, "") for end in ("startElement", "startConnector", "endElement", "endConnector"))  # fmt: skip
        if not taker:
            outputs.append(f"  output {names.new(taken)} = {words[giver]}.{own[giver][given_name].name}")
            continue
        item, end = own[taker][taken], (giver, given_name)
        if givers.setdefault((taker, taken), end) != end:
            raise NotImportable(f"two connections of it end at `{printable(taker)}.{printable(taken)}`", "Connect one.")
        if not giver and given_name not in inputs:
            inputs[given_name] = names.new(given_name)
            lines.append(f"  input {declared(item, word=inputs[given_name])} = {_start(item, values.get(given_name))}")
        connected[taker][item.name] = f"{words[giver]}.{own[giver][given_name].name}" if giver else inputs[given_name]
    for unit, description in units.items():
        set_values = {v.name: _start(v, values[f"{unit}.{v.own}"]) for v in description.variables if f"{unit}.{v.own}" in values}  # fmt: skip
        attributes = {STEP: STEP} | set_values | connected[unit]
        lines.append(f"  {kinds[unit]} {words[unit]} {{ {', '.join(f'{n} = {v}' for n, v in attributes.items())} }}")
    steps = [description.step for description in units.values() if description.step is not None]
    first = f" = {min(steps)!r} s" if steps else ""
    head = [f"model {model} {{", f'  parameter {STEP}: s{first} "time between two exchanges"']
    return "\n".join([*head, *lines, *outputs, "}", ""]), sources


def _start(item: UnitVariable, value: float | None) -> str:
    """Return a value of a variable in the language; None means its own start."""
    if value is None:
        return value_of(item.start or 0.0, item)
    return value_of(value if item.factor is None else item.factor * value + item.offset, item)


def _values(archive: ZipFile, system: ElementTree.Element) -> Iterator[tuple[str, float]]:
    """Yield what the sets of parameters set, by the names `unit.variable` and those of inputs."""
    for owner in (system, *system.iter(_NAME("Description", "Component"))):
        prefix = "" if owner is system else f"{owner.get('name')}."
        for binding in owner.iterfind(f"{_NAME('Description', 'ParameterBindings')}/*"):
            parameters = _part(archive, binding.get("source", "")) if "source" in binding.attrib else binding
            for item in parameters.iter(_NAME("ParameterValues", "Parameter")):
                real = item.find(_NAME("ParameterValues", "Real"))
                if real is not None:
                    yield f"{prefix}{binding.get('prefix', '')}{item.get('name')}", float(real.get("value", ""))
