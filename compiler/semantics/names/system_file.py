"""A system of functional mock-up units (SSP 1.0) as a model: `import Car from "car.ssp"`.

Its structure becomes a text of the language in which each unit is an instance; units are exchanged with as imported ones are.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from zipfile import BadZipFile, ZipFile

from ...source import MAXIMUM_BYTES, Source
from .statement_errors import NotImportable
from .unit_file import (
    STEP,
    NewNames,
    UnitDescription,
    UnitVariable,
    declared,
    parsed,
    read_unit_description,
    unit_model,
    value_of,
)

_NAME = "{{http://ssp-standard.org/SSP1/SystemStructure{0}}}{1}".format
_REFUSED = {
    "System": "systems within it",
    "SignalDictionaryReference": "signal dictionaries",
    "ParameterMapping": "parameters with a mapping",
}
_UNIT_TYPE = "application/x-fmu-sharedlibrary"


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
        units[unit], words[unit] = replace(read_unit_description(place), ports=()), names.new(unit)
        kinds[unit] = names.new(f"{unit} unit")
        sources[kinds[unit]] = unit_model(units[unit], f"{name}/{place.name}", place, kinds[unit])
    values = dict(_values(archive, system))
    connected, lines, outputs = defaultdict[str, dict[str, str]](dict), [], []
    own = {unit: {v.own: v for v in description.variables} for unit, description in units.items()}
    inputs: dict[str, str] = {}
    for link in system.iter(_NAME("Description", "Connection")):
        if len(link):
            raise NotImportable("a connection of it changes values", "Connect what is equal.")
        giver, given_name, taker, taken = (link.get(end, "") for end in ("startElement", "startConnector", "endElement", "endConnector"))  # fmt: skip
        if not taker:
            outputs.append(f"  output {names.new(taken)} = {words[giver]}.{own[giver][given_name].name}")
            continue
        item = own[taker][taken]
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
