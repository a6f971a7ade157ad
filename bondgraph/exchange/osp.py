"""Files of the Open Simulation Platform: ports of a unit of FMI 2.0, and a system whose power bonds libcosim steps by their energy (ECCO)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from .model_description import attributes

if TYPE_CHECKING:
    from compiler.api import Plan

    from .variables import UnitTerminal

Place = tuple[str, str]  # a unit and one of its variables; the name of the unit is empty for the system itself

_FIRST = '<?xml version="1.0" encoding="UTF-8"?>\n'
# Ports that the platform has words for, with those for effort and flow.
_PORTS = {
    "translation": ("LinearMechanicalPort", "Force", "LinearVelocity"),
    "rotation": ("AngularMechanicalPort", "Torque", "AngularVelocity"),
    "electric": ("ElectromagneticPort", "Voltage", "Current"),
    "hydraulic": ("HydraulicPort", "Pressure", "VolumeFlowRate"),
}
STEPS = 1000  # of an experiment, to begin with
LEAST, MOST = 1e-3, 10.0  # of these steps
RESIDUAL = 1e-3  # energy that a bond may make in a step, of the largest one that it carries in the first
_ECCO = {
    "SafetyFactor": 0.99, "MinimumChangeRate": 0.2, "MaximumChangeRate": 1.5, "ProportionalGain": 0.2, "IntegralGain": 0.15, "RelativeTolerance": 1e-6,
}  # fmt: skip


def osp_model_description(terminals: Sequence[UnitTerminal]) -> str:
    """Return the text of `OspModelDescription.xml`: a group of variables for each port."""
    lines = []
    for item in terminals:
        port, *words = _PORTS.get(item.domain, ("Generic", "", ""))
        members = [f"<Variable{attributes({'ref': name})}/>" for name in (item.effort, item.flow)]
        if port != "Generic":
            names = (attributes({"name": f"{item.name} {word}"}) for word in words)
            members = [f"<{w}{name}>{m}</{w}>" for w, name, m in zip(words, names, members, strict=True)]
        lines.append(f"    <{port}{attributes({'name': item.name})}>{''.join(members)}</{port}>")
    space = attributes({"xmlns": "https://open-simulation-platform.com/OspModelDescription/1.0.0", "version": "1.0"})
    return "\n".join([f"{_FIRST}<OspModelDescription{space}>", "  <VariableGroups>", *lines, "  </VariableGroups>", "</OspModelDescription>", ""])  # fmt: skip


def osp_system_structure(
    sources: Mapping[str, str], links: Sequence[tuple[Place, Place]], bonds: Mapping[tuple[Place, Place], str],
    values: Mapping[Place, float], plan: Plan, power: float,
) -> str:  # fmt: skip
    """Return the text of `OspSystemStructure.xml`. `bonds`: names by links; `values`: that begin; `power`: the largest of a bond."""
    stop = 1.0 if plan.stop is None else plan.stop
    step = (stop - plan.start) / STEPS
    rows = {
        "StartTime": plan.start,
        "EndTime": stop,
        "BaseStepSize": step,
        "Algorithm": "ecco" if bonds else "fixedStep",
    }
    lines = [*(f"  <{name}>{value}</{name}>" for name, value in rows.items()), "  <Simulators>"]
    for unit, source in sources.items():
        own = "".join(
            f"<InitialValue{attributes({'variable': name})}><Real{attributes({'value': repr(value)})}/></InitialValue>"
            for (owner, name), value in values.items() if owner == unit
        )  # fmt: skip
        head = attributes({"name": unit, "source": source.rpartition("/")[2]})
        lines.append(f"    <Simulator{head}><InitialValues>{own}</InitialValues></Simulator>")
    lines += ["  </Simulators>", "  <Connections>"]
    for link in links:
        ends = zip(link, ("output", "input"), strict=True)
        inner = "".join(
            f"<Variable{attributes({'simulator': unit, 'name': name, 'causality': way})}/>"
            for (unit, name), way in ends
        )
        bond = attributes({"powerBond": bonds[link]}) if link in bonds else ""
        lines.append(f"    <VariableConnection{bond}>{inner}</VariableConnection>")
    lines.append("  </Connections>")
    if bonds:
        sizes = {"StepSize": step, "MinimumStepSize": LEAST * step, "MaximumStepSize": MOST * step}
        limits = _ECCO | sizes | {"AbsoluteTolerance": RESIDUAL * power * step or RESIDUAL}
        inner = "".join(f"<{name}>{value!r}</{name}>" for name, value in limits.items())
        lines.append(f"  <EccoConfiguration>{inner}</EccoConfiguration>")
    space = attributes({"xmlns": "http://opensimulationplatform.com/MSMI/OSPSystemStructure", "version": "0.1"})
    return "\n".join([f"{_FIRST}<OspSystemStructure{space}>", *lines, "</OspSystemStructure>", ""])
