"""The syntax tree: the text node by node, each with its span. Names are not looked up here."""

from __future__ import annotations

from fractions import Fraction

from ..nouns import dataclass
from ..source import Source, Span


@dataclass(frozen=True, slots=True)
class Node:
    """Anything with a place in the text."""

    span: Span


# ---------------------------------------------------------------- expressions


@dataclass(frozen=True, slots=True)
class Expression(Node):
    """Anything with a value; `depth` is the height of its tree, which the parser limits."""

    depth: int


@dataclass(frozen=True, slots=True)
class Unit(Node):
    """A product of powers of unit symbols: `kg*m/s^2`."""

    factors: tuple[tuple[str, Fraction, Span], ...]
    number: Fraction


@dataclass(frozen=True, slots=True)
class Literal(Expression):
    """A number, with the unit that follows it if there is one."""

    number: Fraction
    unit: Unit | None


@dataclass(frozen=True, slots=True)
class Member:
    """`.name` in a path."""

    name: str


@dataclass(frozen=True, slots=True)
class Index:
    """`[i, j]` in a path."""

    items: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Path(Expression):
    """A dotted name: `comb[2].folded.x`; read as an expression, or an endpoint of a bond."""

    head: str
    steps: tuple[Member | Index, ...]

    @property
    def words(self) -> str:
        """The path as written, without spaces."""
        text = self.head
        if not self.steps:
            return text
        for step in self.steps:
            if isinstance(step, Member):
                text += f".{step.name}"
            else:
                text += f"[{','.join([_without_spaces(i.span) for i in step.items])}]"
        return text


def _without_spaces(span: Span) -> str:
    text = span.text
    return text if text.isalnum() else "".join(span.words.split())


@dataclass(frozen=True, slots=True)
class Text(Expression):
    """A text among the arguments of a call: the name of a file or of a column."""

    value: str


@dataclass(frozen=True, slots=True)
class Call(Expression):
    """A function applied to arguments."""

    function: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Sum(Expression):
    """Terms, each with its sign +1 or -1."""

    terms: tuple[tuple[int, Expression], ...]


@dataclass(frozen=True, slots=True)
class Product(Expression):
    """Factors, each with +1 (multiplied) or -1 (divided by)."""

    factors: tuple[tuple[int, Expression], ...]


@dataclass(frozen=True, slots=True)
class Negative(Expression):
    """`-x`."""

    operand: Expression


@dataclass(frozen=True, slots=True)
class Power(Expression):
    """`base ^ exponent`."""

    base: Expression
    exponent: Expression


@dataclass(frozen=True, slots=True)
class Comparison(Expression):
    """`left < right`; the operator is one of `< <= > >= == !=`."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Logical(Expression):
    """`and`, `or` of several conditions, `not` of one."""

    operator: str
    operands: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Choice(Expression):
    """`value if condition else otherwise`."""

    value: Expression
    condition: Expression
    otherwise: Expression


@dataclass(frozen=True, slots=True)
class Vector(Expression):
    """`(a, b, c)`: a list or a point."""

    items: tuple[Expression, ...]


# ---------------------------------------------------------------- statements


@dataclass(frozen=True, slots=True)
class Item(Node):
    """One name of a `parameter`, `constant`, `input`, `output`, `signal` or `mode` statement."""

    name: str
    index: Index | None
    unit: Unit | None
    value: Expression | None
    description: str | None


@dataclass(frozen=True, slots=True)
class Quantities(Node):
    """A statement that introduces named quantities; `role` is its first word."""

    role: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class Function(Node):
    """`function f(x) = …`."""

    name: str
    parameters: tuple[str, ...]
    body: Expression


@dataclass(frozen=True, slots=True)
class Component(Node):
    """One port in parentheses, with its domain if it is given: `(q: electric, x)`."""

    name: str
    domain: str | None


@dataclass(frozen=True, slots=True)
class PortItem(Node):
    """One port of a model."""

    name: str
    index: Index | None
    components: tuple[Component, ...]
    domain: str | None
    description: str | None


@dataclass(frozen=True, slots=True)
class Ports(Node):
    """`port a: electric, b: planar`."""

    items: tuple[PortItem, ...]


@dataclass(frozen=True, slots=True)
class Equation(Node):
    """`left = right`."""

    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Law(Node):
    """One or more equations, with commas between."""

    equations: tuple[Equation, ...]


@dataclass(frozen=True, slots=True)
class Link(Node):
    """`A to B`: the two parts of a joint."""

    first: Expression
    second: Expression


@dataclass(frozen=True, slots=True)
class Attribute(Node):
    """`mass = 1 kg`, or with a target: `start v = 2 [m/s]`."""

    name: str
    target: Path | None
    value: Expression


@dataclass(frozen=True, slots=True)
class Declared(Node):
    """One name that a declaration introduces."""

    name: str
    index: Index | None
    components: tuple[Component, ...]


@dataclass(frozen=True, slots=True)
class Declaration(Node):
    """`kind name : definition { attributes }`."""

    kind: str
    names: tuple[Declared, ...]
    definition: Law | Link | Expression | None
    attributes: tuple[Attribute, ...]
    description: str | None


@dataclass(frozen=True, slots=True)
class Nest(Node):
    """A junction written in place, `0(…)` or `1(…)`, with the endpoints bonded to it."""

    kind: str
    members: tuple[Path | Nest, ...]


@dataclass(frozen=True, slots=True)
class Bonds(Node):
    """A chain of places: `a -> b -> c, d`. `arrows` has one item fewer than `places`: `->` or `=>`."""

    places: tuple[tuple[Path | Nest, ...], ...]
    arrows: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Range(Node):
    """`first .. last`."""

    first: Expression
    last: Expression


@dataclass(frozen=True, slots=True)
class Setting(Node):
    """A setting of a mechanism: `gravity = …`."""

    name: str
    value: Expression


@dataclass(frozen=True, slots=True)
class Loop(Node):
    """`for name in range { … }`."""

    name: str
    range: Range
    statements: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Mechanism(Node):
    """A `multibody` block."""

    name: str
    space: str | None
    statements: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Reset(Node):
    """An assignment of an event."""

    target: Path
    value: Expression


@dataclass(frozen=True, slots=True)
class Event(Node):
    """`when condition { … }`; or `every period { … }`, which is `sampled`."""

    condition: Expression
    resets: tuple[Reset, ...]
    sampled: bool


@dataclass(frozen=True, slots=True)
class Requirement(Node):
    """`require condition "text"`: the condition under which the model is valid."""

    condition: Expression
    text: str


@dataclass(frozen=True, slots=True)
class Description(Node):
    """A string as a statement of its own."""

    text: str


# ---------------------------------------------------------------- experiments


@dataclass(frozen=True, slots=True)
class Set(Node):
    """`set path = expression`, and `start path = expression` with `role` start."""

    role: str
    target: Path
    value: Expression


@dataclass(frozen=True, slots=True)
class Simulate(Node):
    """`simulate from .. to { attributes }`."""

    range: Range
    attributes: tuple[Attribute, ...]


@dataclass(frozen=True, slots=True)
class Bandwidth(Node):
    """`bandwidth 50 kHz`: faster modes need not be followed."""

    value: Expression


@dataclass(frozen=True, slots=True)
class Reading(Node):
    """A quantity of a report, and its unit."""

    value: Expression
    unit: Unit | None


@dataclass(frozen=True, slots=True)
class Report(Node):
    """`report x in um, y`."""

    readings: tuple[Reading, ...]


@dataclass(frozen=True, slots=True)
class Study(Node):
    """A step of an experiment that is not a simulation: `sweep`, `equilibrium`, `modes`, `response`."""

    role: str
    paths: tuple[Path, ...]
    unit: Unit | None
    values: tuple[Expression, ...]
    range: Range | None
    attributes: tuple[Attribute, ...]


@dataclass(frozen=True, slots=True)
class Given(Node):
    """One item of an analysis: `path`, `push/pull`, `path = value`, `path = low .. high`, `correlation(path, other) = value`."""

    path: Path
    other: Path | None = None
    value: Expression | None = None
    range: Range | None = None
    word: str = ""


@dataclass(frozen=True, slots=True)
class Analysis(Node):
    """A step with names of its own: `linearize`, `sensitivity`, `continue`, `invert`, `montecarlo`, `fit`.

    `given`: the quantities that are moved, found or varied; `wanted`: the results; `files`: of measurements.
    """

    role: str
    given: tuple[Given, ...]
    wanted: tuple[Given, ...]
    files: tuple[Text, ...]
    range: Range | None
    attributes: tuple[Attribute, ...]


@dataclass(frozen=True, slots=True)
class Experiment(Node):
    """A named experiment with its steps in order."""

    name: str
    steps: tuple[Node, ...]


# ---------------------------------------------------------------- files


@dataclass(frozen=True, slots=True)
class Import(Node):
    """`import A, B from "path.bg"` (`place` is a string) or from a library (`place` is a name)."""

    names: tuple[tuple[str, Span], ...]
    place: str
    is_file: bool


@dataclass(frozen=True, slots=True)
class Model(Node):
    """A model definition."""

    name: str
    name_span: Span
    plain: bool
    statements: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class SyntaxTree:
    """One file, parsed."""

    source: Source
    statements: tuple[Node, ...]

    @property
    def models(self) -> dict[str, Model]:
        """Models of the file by name, in the order of the text."""
        return {s.name: s for s in self.statements if isinstance(s, Model)}
