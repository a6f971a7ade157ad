"""Mechanisms by calls: bodies, frames and joints in one world frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypedDict, Unpack

from compiler.api import braces, freedoms_of

from ..errors import UsageError
from ..keywords import check_keywords
from .argument_checks import Value, expression_of, is_number, mapping_of, path_of, value_of
from .parts import Bonding, Part, name_of

GROUND = "ground"
# Units by the last letter of a coordinate with start, limit or rest value.
UNITS = {"x": "m", "y": "m", "z": "m", "d": "m", "v": "m/s", "omega": "rad/s"} | dict.fromkeys(
    ("phi", "phi1", "phi2", "rx", "ry", "rz"), "rad"
)
AXES = ("from", "to", "middle", "world")
ElementOptions = Mapping[str, tuple[Value, str]]  # attribute -> value and the unit of numbers
ByCoordinate = Mapping[str, Value] | Value  # a mapping, or the value alone for a joint with one degree of freedom
Starts = Mapping[str, Value] | None
End = Part | str


class JointOptions(TypedDict, total=False):
    """Options of a joint: the place where it is drawn (m), and properties of its coordinates."""

    at: Value
    start: Starts
    limits: ByCoordinate
    rest: ByCoordinate
    locked: str | bool


class BodyOptions(TypedDict, total=False):
    """Options of a body: its start, and how pictures show it."""

    start: Starts
    shape: str
    colour: str


@dataclass(frozen=True, slots=True, eq=False)
class Multibody:
    """A planar or spatial mechanism. Numbers are in SI, angles in rad; texts have their own units.

    A position or direction has two components in the plane, three in space. All joints accept `at` and `start={"phi": 0.1}`; those with degrees of freedom
    also `limits=(low, high)` (for several coordinates `limits={"x": (low, high)}`), `rest=0.1` (the value of a coordinate in the drawing) and `locked=True`,
    or a condition of parameters as text.
    """

    graph: Bonding
    path: str
    lines: list[str]
    spatial: bool = False
    _taken: set[str] = field(default_factory=set)

    def __str__(self) -> str:
        return self.path

    def __getitem__(self, part: str) -> Part:
        return Part(self.graph, f"{self.path}.{name_of(part)}")

    # ------------------------------------------------------------ bodies
    def body(
        self, name: str, *, mass: Value = None, inertia: Value = None, at: Value = None, angle: Value = None,
        turn: Value = None, **options: Unpack[BodyOptions],
    ) -> Part:  # fmt: skip
        """Add a rigid body: kg, kg m^2 about its centre of mass, position of that centre (m), rotation; `start`; `shape` and `colour` for pictures.

        In space `inertia` is (Ixx, Iyy, Izz), or six with Ixy, Ixz, Iyz, in the body's own axes, and `turn` a rotation vector. A shape is a text, such as
        `"box(20 cm, 4 cm, 2 cm)"`.
        """
        check_keywords(self.body, options, BodyOptions.__optional_keys__)
        given = {
            "mass": (mass, "kg"), "inertia": (inertia, "kg*m^2"), "at": (at, "m"), "angle": (angle, ""), "turn": (turn, ""),
            "shape": (options.get("shape"), ""), "colour": (options.get("colour"), ""),
        }  # fmt: skip
        return self._part("body", name, "", given, {"start": options.get("start")})

    def frame(self, name: str, body: End, *, at: Value, axes: str = "world", start: Starts = None) -> Part:
        """Add a point fixed to a body or the ground; its force, torque and pose in axes of the `world` or the `body`."""
        more = _axes(axes, ("world", "body"))
        return self._part("frame", name, f" : {self._local(body)}", {"at": (at, "m")}, {"start": start}, more)

    # ------------------------------------------------------------ joints
    def slide(self, name: str, first: End, second: End, *, along: Value, **options: Unpack[JointOptions]) -> Part:
        """Add a joint with one translation of `second` relative to `first`; `"ground"` is the world."""
        return self._joint("slide", name, first, second, {"along": (along, "")}, options)

    def hinge(self, name: str, first: End, second: End, *, about: Value = None, **options: Unpack[JointOptions]) -> Part:  # fmt: skip
        """Add a joint with one rotation, in space `about` an axis."""
        return self._joint("hinge", name, first, second, {"about": (about, "")}, options)

    def planar(self, name: str, first: End, second: End, *, turn: Value = None, **options: Unpack[JointOptions]) -> Part:  # fmt: skip
        """Add a joint in space with two translations and a rotation in the plane x y, rotated by a rotation vector."""
        return self._joint("planar", name, first, second, {"turn": (turn, "")}, options)

    def cylinder(self, name: str, first: End, second: End, *, along: Value, **options: Unpack[JointOptions]) -> Part:
        """Add a joint in space with a translation along an axis and a rotation about it."""
        return self._joint("cylinder", name, first, second, {"along": (along, "")}, options)

    def screw(self, name: str, first: End, second: End, *, along: Value, lead: Value, **options: Unpack[JointOptions]) -> Part:  # fmt: skip
        """Add a joint in space with a rotation about an axis and a translation along it, by the lead (m) per turn."""
        return self._joint("screw", name, first, second, {"along": (along, ""), "lead": (lead, "m")}, options)

    def universal(self, name: str, first: End, second: End, *, about: Value, then: Value, **options: Unpack[JointOptions]) -> Part:  # fmt: skip
        """Add a joint in space with a rotation about an axis of `first`, then about one of `second`."""
        return self._joint("universal", name, first, second, {"about": (about, ""), "then": (then, "")}, options)

    def ball(
        self, name: str, first: End, second: End, *, at: Value = None, start: Starts = None,
        limits: ByCoordinate = None, locked: str | bool = False,
    ) -> Part:  # fmt: skip
        """Add a joint in space with all rotations, measured by a rotation vector."""
        options: JointOptions = {"at": at, "start": start, "limits": limits, "locked": locked}
        return self._joint("ball", name, first, second, {}, options)

    def free(
        self, name: str, first: End, second: End, *, angle: Value = None, turn: Value = None, axes: str = "from", **options: Unpack[JointOptions]
    ) -> Part:  # fmt: skip
        """Add a joint with all motions, measured in the axes of a body (`from`, `to`), between them (`middle`), or of the `world`."""
        given = {"at": (options.get("at"), "m"), "angle": (angle, ""), "turn": (turn, "")}
        return self._joint("free", name, first, second, given, options, _axes(axes, AXES))

    def weld(self, name: str, first: End, second: End, *, at: Value = None) -> Part:
        """Add a joint without motion."""
        return self._joint("weld", name, first, second, {}, {"at": at})

    def distance(self, name: str, first: End, second: End, *, start: Starts = None, limits: ByCoordinate = None) -> Part:  # fmt: skip
        """Add a measured distance between two points of bodies: it is no constraint, springs can be attached to it."""
        return self._joint("distance", name, first, second, {}, {"start": start, "limits": limits})

    def rod(self, name: str, first: End, second: End) -> Part:
        """Add a rod without mass between two points: their distance stays as drawn."""
        return self._joint("rod", name, first, second, {}, {})

    def gear(self, name: str, first: End, second: End, *, ratio: Value) -> Part:
        """Couple two hinges: the second rotates by `ratio` times the first."""
        return self._joint("gear", name, first, second, {"ratio": (ratio, "")}, {})

    def rack(self, name: str, first: End, second: End, *, radius: Value) -> Part:
        """Couple a hinge and a slide, which moves by `radius` (m) per radian."""
        return self._joint("rack", name, first, second, {"radius": (radius, "m")}, {})

    # ------------------------------------------------------------ rolling
    def wheel(
        self, name: str, first: End, second: End, *, radius: Value, about: Value = None, normal: Value = None, at: Value = None
    ) -> Part:  # fmt: skip
        """Add a wheel with its centre `at` a point of `second`, which rolls on a plane of `first` without slip; in space without `about` a sphere."""
        attributes = {"radius": (radius, "m"), "about": (about, ""), "normal": (normal, "")}
        return self._joint("wheel", name, first, second, attributes, {"at": at})

    def skate(
        self, name: str, first: End, second: End, *, along: Value, normal: Value = None, at: Value = None
    ) -> Part:
        """Add an edge at a point of `second`, which slides on a plane of `first` along a direction, and not across it."""
        return self._joint("skate", name, first, second, {"along": (along, ""), "normal": (normal, "")}, {"at": at})

    # ------------------------------------------------------------ writing
    def _joint(
        self, kind: str, name: str, first: End, second: End, given: ElementOptions, options: JointOptions, more: list[str] | None = None
    ) -> Part:  # fmt: skip
        check_keywords(getattr(self, kind), options, JointOptions.__optional_keys__)
        given = {**given, "at": (options.get("at"), "m")}
        link = f" : {self._local(first)} to {self._local(second)}"
        return self._part(kind, name, link, given, options, more)

    def _part(
        self, kind: str, name: str, definition: str, given: ElementOptions, options: JointOptions, more: list[str] | None = None
    ) -> Part:  # fmt: skip
        own = name_of(name)
        if own in self._taken:
            raise UsageError("BR528", f"`{self.path}` already has `{own}`")
        inner = [
            f"{word} = {value_of(value, f'`{word}` of `{own}`', unit)}"
            for word, (value, unit) in given.items()
            if value is not None
        ]
        ports = freedoms_of(kind, not self.spatial)
        inner += [*(more or ()), *_coordinates(own, ports, options)]
        self._taken.add(own)
        self.lines.append(f"{kind} {own}{definition}{braces(inner)}")
        return Part(self.graph, f"{self.path}.{own}", ports)

    def _local(self, body: End) -> str:
        """Return the name of a body, frame or joint inside the mechanism."""
        if isinstance(body, str) and body == GROUND:
            return GROUND
        name = str(body).removeprefix(f"{self.path}.")
        if name not in self._taken or (isinstance(body, Part) and body.graph is not self.graph):
            raise UsageError("BR531", f"`{self.path}` has no body `{body}`")
        return name

    def text(self) -> list[str]:
        """Return the lines of its block."""
        space = "spatial" if self.spatial else "planar"
        return [f"multibody {self.path} : {space} {{", *(f"  {line}" for line in self.lines), "}"]


def _axes(axes: str, allowed: tuple[str, ...]) -> list[str]:
    if axes not in allowed:
        raise UsageError("BR532", f"axes are {', '.join(allowed[:-1])} or {allowed[-1]}, not {axes!r}")
    return [] if axes == allowed[0] else [f"axes = {axes}"]


def _coordinates(owner: str, ports: tuple[str, ...], options: JointOptions) -> Iterator[str]:
    """Yield the attributes of a joint's coordinates."""
    for word, given in (("limits", options.get("limits")), ("rest", options.get("rest"))):
        if given is not None:
            by_name = given if isinstance(given, Mapping) else dict.fromkeys(ports[:1], given)
            if by_name is not given and len(ports) != 1:
                raise UsageError("BR533", f"`{owner}` has several coordinates: {word}={{{ports[0]!r}: …}}")
            for key, value in by_name.items():
                yield _assigned(owner, word, key, value)
    locked = options.get("locked", False)
    if locked:
        yield f"locked = {'true' if locked is True else expression_of(locked, f'`locked` of `{owner}`')}"
    for key, value in mapping_of(options.get("start") or {}, f"the start of `{owner}`").items():
        yield _assigned(owner, "start", key, value)


def _assigned(owner: str, word: str, key: str, value: Value) -> str:
    path = path_of(key)
    unit = UNITS.get(path.rpartition(".")[2], "")
    if is_number(value) and not unit:
        raise UsageError("BR534", f"the {word} of `{owner}`: numbers are of {', '.join(UNITS)}, not `{path}`")
    return f"{word} {path} = {value_of(value, f'the {word} of `{owner}`', unit)}"
