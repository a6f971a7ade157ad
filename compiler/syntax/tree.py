"""The syntax tree: the text node by node, each with its span. Names are not looked up here."""

from __future__ import annotations

from fractions import Fraction

from ..fast_dataclass import dataclass
from ..source import Source, Span


@dataclass(frozen=True, slots=True)
class SyntaxNode:
    """Anything with a place in the text."""

    span: Span


# ---------------------------------------------------------------- expressions


@dataclass(frozen=True, slots=True)
class ExpressionSyntax(SyntaxNode):
    """Anything with a value; `depth` is the height of its tree, which the parser limits."""

    depth: int


@dataclass(frozen=True, slots=True)
class Unit(SyntaxNode):
    """A product of powers of unit symbols: `kg*m/s^2`."""

    factors: tuple[tuple[str, Fraction, Span], ...]
    number: Fraction


@dataclass(frozen=True, slots=True)
class Literal(ExpressionSyntax):
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

    items: tuple[ExpressionSyntax, ...]


@dataclass(frozen=True, slots=True)
class PathSyntax(ExpressionSyntax):
    """A dotted name: `comb[2].folded.x`; read as an expression, or an endpoint of a bond."""

    head: str
    steps: tuple[Member | Index, ...]

    @property
    def words(self) -> str:
        """The path as written, without spaces."""
        text = self.head
        for step in self.steps:
            items = "" if isinstance(step, Member) else ",".join([_without_spaces(i.span) for i in step.items])
            text += f".{step.name}" if isinstance(step, Member) else f"[{items}]"
        return text


def _without_spaces(span: Span) -> str:
    text = span.text
    return text if text.isalnum() else "".join(span.words.split())


@dataclass(frozen=True, slots=True)
class TextSyntax(ExpressionSyntax):
    """A text in an expression: the name of a file or of a column, or what such a parameter is compared with."""

    value: str


@dataclass(frozen=True, slots=True)
class Call(ExpressionSyntax):
    """A function applied to arguments."""

    function: str
    arguments: tuple[ExpressionSyntax, ...]


@dataclass(frozen=True, slots=True)
class Sum(ExpressionSyntax):
    """Terms, each with its sign +1 or -1."""

    terms: tuple[tuple[int, ExpressionSyntax], ...]


@dataclass(frozen=True, slots=True)
class Product(ExpressionSyntax):
    """Factors, each with +1 (multiplied) or -1 (divided by)."""

    factors: tuple[tuple[int, ExpressionSyntax], ...]


@dataclass(frozen=True, slots=True)
class Negative(ExpressionSyntax):
    """`-x`."""

    operand: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Power(ExpressionSyntax):
    """`base ^ exponent`."""

    base: ExpressionSyntax
    exponent: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Comparison(ExpressionSyntax):
    """`left < right`; the operator is one of `< <= > >= == !=`."""

    operator: str
    left: ExpressionSyntax
    right: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Logical(ExpressionSyntax):
    """`and`, `or` of several conditions, `not` of one."""

    operator: str
    operands: tuple[ExpressionSyntax, ...]


@dataclass(frozen=True, slots=True)
class ChoiceSyntax(ExpressionSyntax):
    """`value if condition else otherwise`."""

    value: ExpressionSyntax
    condition: ExpressionSyntax
    otherwise: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class VectorSyntax(ExpressionSyntax):
    """`(a, b, c)` or `[a, b, c]`: a list or a point; of lists a matrix, row by row."""

    items: tuple[ExpressionSyntax, ...]


# ---------------------------------------------------------------- statements


@dataclass(frozen=True, slots=True)
class Item(SyntaxNode):
    """One name of a `parameter`, `constant`, `input`, `output`, `signal` or `mode` statement."""

    name: str
    index: Index | None
    unit: Unit | None
    value: ExpressionSyntax | None
    description: str | None
    choices: tuple[tuple[str, Span], ...] = ()  # `kind: {linear, cubic}`


@dataclass(frozen=True, slots=True)
class Quantities(SyntaxNode):
    """A statement that introduces named quantities; `role` is its first word. Those of a `solve` make the equations true."""

    role: str
    items: tuple[Item, ...]
    equations: tuple[Equation, ...] = ()


@dataclass(frozen=True, slots=True)
class FunctionSyntax(SyntaxNode):
    """`function f(x) = …`."""

    name: str
    parameters: tuple[str, ...]
    body: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Component(SyntaxNode):
    """One port in parentheses, with its domain if it is given: `(q: electric, x)`; of a width `(p: translation[n])`."""

    name: str
    domain: str | None
    width: Index | None = None


@dataclass(frozen=True, slots=True)
class PortItem(SyntaxNode):
    """One port of a model."""

    name: str
    index: Index | None
    components: tuple[Component, ...]
    domain: str | None
    description: str | None
    width: Index | None = None


@dataclass(frozen=True, slots=True)
class PortsSyntax(SyntaxNode):
    """`port a: electric, b: planar`."""

    items: tuple[PortItem, ...]


@dataclass(frozen=True, slots=True)
class Equation(SyntaxNode):
    """`left = right`."""

    left: ExpressionSyntax
    right: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class LawSyntax(SyntaxNode):
    """One or more equations, with commas between."""

    equations: tuple[Equation, ...]


@dataclass(frozen=True, slots=True)
class LinkSyntax(SyntaxNode):
    """`A to B`: the two parts of a joint."""

    first: ExpressionSyntax
    second: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Attribute(SyntaxNode):
    """`mass = 1 kg`, or with a target: `start v = 2 [m/s]`."""

    name: str
    target: PathSyntax | None
    value: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Declared(SyntaxNode):
    """One name that a declaration introduces."""

    name: str
    index: Index | None
    components: tuple[Component, ...]


@dataclass(frozen=True, slots=True)
class Declaration(SyntaxNode):
    """`kind name : definition { attributes }`."""

    kind: str
    names: tuple[Declared, ...]
    definition: LawSyntax | LinkSyntax | ExpressionSyntax | None
    attributes: tuple[Attribute, ...]
    description: str | None


@dataclass(frozen=True, slots=True)
class Nest(SyntaxNode):
    """A junction written in place, `0(…)` or `1(…)`, with the endpoints bonded to it."""

    kind: str
    members: tuple[PathSyntax | Nest, ...]


@dataclass(frozen=True, slots=True)
class Bonds(SyntaxNode):
    """A chain of places: `a -> b -> c, d`. `arrows` has one item fewer than `places`: `->` or `=>`."""

    places: tuple[tuple[PathSyntax | Nest, ...], ...]
    arrows: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Range(SyntaxNode):
    """`first .. last`."""

    first: ExpressionSyntax
    last: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class SettingSyntax(SyntaxNode):
    """A setting of a mechanism: `gravity = …`."""

    name: str
    value: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class LoopSyntax(SyntaxNode):
    """`for name in range { … }`."""

    name: str
    range: Range
    statements: tuple[SyntaxNode, ...]


@dataclass(frozen=True, slots=True)
class ConditionalSyntax(SyntaxNode):
    """`if condition { … } else { … }`."""

    condition: ExpressionSyntax
    statements: tuple[SyntaxNode, ...]
    otherwise: tuple[SyntaxNode, ...]


@dataclass(frozen=True, slots=True)
class MechanismSyntax(SyntaxNode):
    """A `multibody` block."""

    name: str
    index: Index | None
    space: str | None
    statements: tuple[SyntaxNode, ...]


@dataclass(frozen=True, slots=True)
class Reset(SyntaxNode):
    """An assignment of an event."""

    target: PathSyntax
    value: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class TimingSyntax(SyntaxNode):
    """`offset 0.2 ms` of an `every`, or its `delay`, `jitter` or `seed`."""

    word: str
    value: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class EventSyntax(SyntaxNode):
    """`when condition { … }`; or `every period timing { … }`, which is `sampled`."""

    condition: ExpressionSyntax
    resets: tuple[Reset, ...]
    sampled: bool
    timing: tuple[TimingSyntax, ...] = ()


@dataclass(frozen=True, slots=True)
class RequirementSyntax(SyntaxNode):
    """`require condition "text"`: the condition under which the model is valid."""

    condition: ExpressionSyntax
    text: str


@dataclass(frozen=True, slots=True)
class Description(SyntaxNode):
    """A string as a statement of its own."""

    text: str


# ---------------------------------------------------------------- experiments


@dataclass(frozen=True, slots=True)
class Set(SyntaxNode):
    """`set path = expression`, and `start path = expression` with `role` start."""

    role: str
    target: PathSyntax
    value: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class Simulate(SyntaxNode):
    """`simulate from .. to { attributes }`."""

    range: Range
    attributes: tuple[Attribute, ...]


@dataclass(frozen=True, slots=True)
class Bandwidth(SyntaxNode):
    """`bandwidth 50 kHz`: faster modes need not be followed."""

    value: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class StopSyntax(SyntaxNode):
    """`stop when CONDITION`: the run ends there."""

    condition: ExpressionSyntax


@dataclass(frozen=True, slots=True)
class ReadingSyntax(SyntaxNode):
    """A quantity of a report, and its unit."""

    value: ExpressionSyntax
    unit: Unit | None


@dataclass(frozen=True, slots=True)
class Report(SyntaxNode):
    """`report x in um, y`."""

    readings: tuple[ReadingSyntax, ...]


@dataclass(frozen=True, slots=True)
class SweepSyntax(SyntaxNode):
    """`sweep path: unit = 1, 2, 3`."""

    path: PathSyntax
    unit: Unit | None
    values: tuple[ExpressionSyntax, ...]


@dataclass(frozen=True, slots=True)
class GivenSyntax(SyntaxNode):
    """One item of an analysis: `path`, `push/pull`, `path = value`, `path = low .. high`, `correlation(path, other) = value`."""

    path: PathSyntax
    other: PathSyntax | None = None
    value: ExpressionSyntax | None = None
    range: Range | None = None
    word: str = ""


@dataclass(frozen=True, slots=True)
class Analysis(SyntaxNode):
    """An analysis step; `role`: its word, one of `ANALYSIS_STEPS`.

    `given`: the quantities that are moved, found or varied; `wanted`: the results; `files`: of measurements.
    """

    role: str
    given: tuple[GivenSyntax, ...]
    wanted: tuple[GivenSyntax, ...]
    files: tuple[TextSyntax, ...]
    range: Range | None
    attributes: tuple[Attribute, ...]


@dataclass(frozen=True, slots=True)
class Experiment(SyntaxNode):
    """A named experiment with its steps in order."""

    name: str
    steps: tuple[SyntaxNode, ...]


@dataclass(frozen=True, slots=True)
class Import(SyntaxNode):
    """`import A, B from "path.bg"` (`place` is a string) or from a library (`place` is a name)."""

    names: tuple[tuple[str, Span], ...]
    place: str
    is_file: bool


@dataclass(frozen=True, slots=True)
class ParameterSet(SyntaxNode):
    """`parameters Silicon { E = 130 GPa }`: values to hand over as one."""

    name: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class ModelSyntax(SyntaxNode):
    """A model definition."""

    name: str
    name_span: Span
    plain: bool
    statements: tuple[SyntaxNode, ...]


@dataclass(frozen=True, slots=True)
class SyntaxTree:
    """One file, parsed."""

    source: Source
    statements: tuple[SyntaxNode, ...]

    @property
    def models(self) -> dict[str, ModelSyntax]:
        """Models of the file by name, in the order of the text."""
        return {s.name: s for s in self.statements if isinstance(s, ModelSyntax)}
