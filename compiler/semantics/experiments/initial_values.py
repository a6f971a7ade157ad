"""`start NAME = …` in an experiment: it replaces the start that the model gives.

A path is read like any other. It must denote something that a `start` attribute can give: the stored quantity of a storage or
a variable that determines it, a coordinate or its rate in a mechanism, or an integral.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import TypeVar

from ...algebra.formula import Bound
from ...fast_dataclass import dataclass
from ...graph.mechanism import Body, Frame, Joint
from ...graph.network import Element, Integral, MechanismNode, Named, Node, Quantity, Reading
from ...graph.units import ONE
from ...source import Span
from ...syntax import tree
from ..mechanisms.part_attributes import attitude_bounds, static_bounds
from ..names.errors import WrongExperiment
from ..names.scope import Items, Scalar, Scope
from ..names.statement_errors import Wrong
from ..network.elaborate import Elaborator
from ..network.events import read_value, read_values, storage_advice

Given = tuple[str, Bound]
Part = TypeVar("Part", Body, Frame, Joint)


@dataclass(slots=True)
class InitialValues:
    """Start values of an experiment, which replace those of the model."""

    elements: dict[tuple[str, str], Given] = field(default_factory=dict)  # node and port -> variable and value
    parts: dict[tuple[str, str], Bound] = field(default_factory=dict)  # mechanism and `guide[1].x`, `guide[1].x.f`
    integrals: dict[str, Bound] = field(default_factory=dict)
    modes: dict[str, Bound] = field(default_factory=dict)
    places: dict[tuple[str, str], Span] = field(default_factory=dict)  # place of each

    def quantities(self, named: dict[str, Named]) -> dict[str, Named]:
        """Quantities with these starts of modes."""
        return {n: replace(q, definition=self.modes[n]) if n in self.modes else q for n, q in named.items()}

    def nodes(self, nodes: Sequence[Node]) -> list[Node]:
        """The nodes with these starts."""
        return [self._node(node) for node in nodes]

    def memories(self, integrals: dict[str, Integral]) -> dict[str, Integral]:
        """The integrals with these starts."""
        return {n: replace(i, start=self.integrals[n]) if n in self.integrals else i for n, i in integrals.items()}

    def _node(self, node: Node) -> Node:
        if isinstance(node, Element):
            own = {n: self.elements.get((node.name, port.name)) for n, port in enumerate(node.ports)}
            found = {n: given for n, given in own.items() if given is not None}
            return replace(node, starts={**node.starts, **found}) if found else node
        if isinstance(node, MechanismNode) and any(name == node.name for name, _ in self.parts):
            drawn = node.mechanism
            return replace(
                node,
                mechanism=replace(
                    drawn,
                    bodies=tuple(self._part(node.name, b) for b in drawn.bodies),
                    frames=tuple(self._part(node.name, f) for f in drawn.frames),
                    joints=tuple(self._part(node.name, j) for j in drawn.joints),
                ),
            )
        return node

    def _part(self, mechanism: str, part: Part) -> Part:
        before = f"{part.name}."
        found = {
            path.removeprefix(before): bound
            for (name, path), bound in self.parts.items()
            if name == mechanism and path.startswith(before)
        }
        kept = {k: b for k, b in part.starts.items() if not _says_the_same(k, found)}
        return replace(part, starts={**kept, **found}) if found else part


def read_initial_values(
    elaborator: Elaborator, experiment: tree.Experiment | None, root: Scope, nodes: Sequence[Node]
) -> InitialValues:  # fmt: skip
    """The starts that an experiment gives."""
    result = InitialValues()
    elements = {n.name: n for n in nodes if isinstance(n, Element)}
    for step in experiment.steps if experiment is not None else ():
        if isinstance(step, tree.Set) and step.role == "start":
            elaborator.guard(_read, elaborator, step, root, elements, result)
    return result


def _read(
    elaborator: Elaborator, step: tree.Set, root: Scope, elements: dict[str, Element], result: InitialValues
) -> None:  # fmt: skip
    words = step.target.words
    found = elaborator.lookup(step.target, root)
    if not isinstance(found, Scalar):
        if _is_attitude(found):
            _read_attitude(elaborator, step, root, found, result)
            return
        bounds = read_values(elaborator, step.value, root, found, f"`start {words}`", static=True)
        for item, bound in zip(found.items, bounds, strict=True):
            _enter(elaborator, step, item, bound, elements, result)
        return
    what = f"`start {words}`"
    if found.role == "mode":
        bound = read_value(elaborator, step.value, root, found, what, static=True)
    else:
        (bound,) = static_bounds(elaborator, step.value, root, found.dimension or ONE, what, 1)
    _enter(elaborator, step, found, bound, elements, result)


def _enter(
    elaborator: Elaborator, step: tree.Set, found: Scalar, bound: Bound, elements: dict[str, Element], result: InitialValues
) -> None:  # fmt: skip
    """Enter the start of one quantity."""
    words = step.target.words
    match found.reference:
        case Quantity(name) if found.role == "mode":
            _once(step, ("", name), result)
            result.modes[name] = bound
        case Quantity(name):
            if not elaborator.is_integral(name):
                hint = "Of signals, only those that are `integral(…)` have a start, and modes; parameters and inputs are given by `set`."
                raise Wrong(WrongExperiment(step.target.span, f"`{words}` has no start", hint))
            _once(step, ("", name), result)
            result.integrals[name] = bound
        case Reading(node, port) if node in elaborator.mechanism_parts and ".attitude." in port:
            raise Wrong(_no_start(step, "Start all four: `start … .attitude = (w, x, y, z)`."))
        case Reading(node, port, variable) if node in elaborator.mechanism_parts:
            if variable not in "qf":
                raise Wrong(_no_start(step, "A part of a mechanism starts at a place, `x` or `phi`, and with a rate."))
            path = port if variable == "q" else f"{port}.f"
            _once(step, (node, path), result)
            result.parts[node, path] = bound
        case Reading(node, port, variable):
            if advice := storage_advice(elements.get(node), port, variable, "start", "`start {} = …`"):
                raise Wrong(_no_start(step, advice))
            _once(step, (node, port), result)
            result.elements[node, port] = variable, bound
        case _:
            raise Wrong(_no_start(step, "Start a storage, a joint or body, or a signal that is `integral(…)`."))


def _says_the_same(key: str, found: Mapping[str, Bound]) -> bool:
    """Return True if the model starts the attitude of a body in one form (quaternion or rotation vector) and the experiment in the other."""
    if key.startswith("attitude."):
        return bool({"rx", "ry", "rz"} & found.keys())
    return key in ("rx", "ry", "rz") and "attitude.w" in found


def _is_attitude(found: Items) -> bool:
    """Return True if a list is the attitude of a body, not a quantity that reads it."""
    return all(isinstance(i.reference, Reading) and ".attitude." in i.reference.port for i in found.items)


def _read_attitude(elaborator: Elaborator, step: tree.Set, root: Scope, found: Items, result: InitialValues) -> None:
    """`start stage.top.attitude = (w, x, y, z)`."""
    bounds = attitude_bounds(elaborator, step.value, root)
    for item, bound in zip(found.items, bounds or (), strict=False):
        assert isinstance(item.reference, Reading)
        _once(step, item.reference[:2], result)
        result.parts[item.reference[:2]] = bound


def _no_start(step: tree.Set, hint: str) -> WrongExperiment:
    return WrongExperiment(step.target.span, f"`{step.target.words}` has no start", hint)


def _once(step: tree.Set, key: tuple[str, str], result: InitialValues) -> None:
    """Check that each state has one start."""
    before = result.places.setdefault(key, step.target.span)
    if before is not step.target.span:
        what = f"`{step.target.words}` already starts from line {before.line}"
        raise Wrong(WrongExperiment(step.target.span, what, "Leave one of the two out."))
