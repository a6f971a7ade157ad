"""Mechanisms by calls: bodies, frames and joints in one world frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..door import braces
from ..errors import UsageError
from .given import Value, is_number, mapping_of, name_of, path_of, value_of
from .parts import Part

if TYPE_CHECKING:
    from .graph import Graph

GROUND = "ground"
START_UNITS = {"x": "m", "y": "m", "phi": "rad", "v": "m/s", "omega": "rad/s"}  # of the last letter of what starts
Given = Mapping[str, tuple[Value, str]]  # attribute -> value and the unit of numbers
Starts = Mapping[str, Value] | None


@dataclass(frozen=True, slots=True, eq=False)
class Mechanism:
    """A planar mechanism. Numbers are in SI, angles in rad; texts have their own units."""

    graph: Graph
    path: str
    lines: list[str]
    _taken: set[str] = field(default_factory=set)

    def __str__(self) -> str:
        return self.path

    def __getitem__(self, part: str) -> Part:
        return Part(self.graph, f"{self.path}.{name_of(part)}")

    def body(
        self, name: str, *, mass: Value = None, inertia: Value = None, at: Value = None, angle: Value = None,
        start: Starts = None,
    ) -> Part:  # fmt: skip
        """A rigid body: kg, kg m^2 about its centre of mass, where that centre is (m) and its angle."""
        given = {"mass": (mass, "kg"), "inertia": (inertia, "kg*m^2"), "at": (at, "m"), "angle": (angle, "")}
        return self._part("body", name, "", given, start, ("x", "y", "phi"))

    def frame(self, name: str, body: Part, *, at: Value) -> Part:
        """A point that is fixed to a body."""
        return self._part("frame", name, f" : {self._local(body)}", {"at": (at, "m")}, None, ("x", "y", "phi"))

    def slide(
        self, name: str, first: Part | str, second: Part | str, *, along: Value, at: Value = None, start: Starts = None
    ) -> Part:
        """A joint that leaves `second` one translation against `first`; `"ground"` is the world."""
        return self._joint("slide", name, first, second, {"along": (along, ""), "at": (at, "m")}, start, ("x",))

    def hinge(
        self, name: str, first: Part | str, second: Part | str, *, at: Value = None, start: Starts = None
    ) -> Part:
        """A joint that leaves a rotation."""
        return self._joint("hinge", name, first, second, {"at": (at, "m")}, start, ("phi",))

    def free(
        self, name: str, first: Part | str, second: Part | str, *, at: Value = None, angle: Value = None,
        axes: str = "from", start: Starts = None,
    ) -> Part:  # fmt: skip
        """A joint that leaves all three freedoms, measured in the axes of a body (`from`, `to`) or between them (`middle`)."""
        if axes not in ("from", "to", "middle"):
            raise UsageError(f"axes are from, to or middle, not {axes!r}")
        given = {"at": (at, "m"), "angle": (angle, "")}
        more = [] if axes == "from" else [f"axes = {axes}"]
        return self._joint("free", name, first, second, given, start, ("x", "y", "phi"), more)

    def weld(self, name: str, first: Part | str, second: Part | str) -> Part:
        """A joint that leaves nothing."""
        return self._joint("weld", name, first, second, {}, None, ())

    def _joint(
        self, kind: str, name: str, first: Part | str, second: Part | str, given: Given, start: Starts,
        ports: tuple[str, ...], more: list[str] | None = None,
    ) -> Part:  # fmt: skip
        link = f" : {self._local(first)} to {self._local(second)}"
        return self._part(kind, name, link, given, start, ports, more)

    def _part(
        self, kind: str, name: str, definition: str, given: Given, start: Starts, ports: tuple[str, ...],
        more: list[str] | None = None,
    ) -> Part:  # fmt: skip
        own = name_of(name)
        if own in self._taken:
            raise UsageError(f"`{self.path}` already has `{own}`")
        inner = [
            f"{word} = {value_of(value, f'`{word}` of `{own}`', unit)}"
            for word, (value, unit) in given.items()
            if value is not None
        ]
        inner += [
            *(more or ()),
            *(_start(own, key, value) for key, value in mapping_of(start or {}, f"the start of `{own}`").items()),
        ]
        self._taken.add(own)
        self.lines.append(f"{kind} {own}{definition}{braces(inner)}")
        return Part(self.graph, f"{self.path}.{own}", ports)

    def _local(self, body: Part | str) -> str:
        """The name of a body inside the mechanism."""
        if isinstance(body, str) and body == GROUND:
            return GROUND
        name = str(body).removeprefix(f"{self.path}.")
        if name not in self._taken or (isinstance(body, Part) and body.graph is not self.graph):
            raise UsageError(f"`{self.path}` has no body `{body}`")
        return name

    def text(self) -> list[str]:
        """The lines of its block."""
        return [f"multibody {self.path} : planar {{", *(f"  {line}" for line in self.lines), "}"]


def _start(owner: str, key: str, value: Value) -> str:
    path = path_of(key)
    unit = START_UNITS.get(path.rpartition(".")[2], "")
    if is_number(value) and not unit:
        raise UsageError(f"the start of `{owner}`: numbers start {', '.join(START_UNITS)}, not `{path}`")
    return f"start {path} = {value_of(value, f'the start of `{owner}`', unit)}"
