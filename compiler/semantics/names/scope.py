"""Names and their meanings in each instance. Quantities are resolved at their first use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import Path

from ...fast_dataclass import dataclass
from ...graph.domains import Domain
from ...graph.network import Reference
from ...graph.units import Dimension
from ...source import Source, Span
from ...syntax import tree
from ...syntax.blocks import flat, inner_blocks
from ...syntax.outline import Outline
from .column_file import Sheet
from .port_domains import DomainTable

STATIC_ROLES = frozenset({"parameter", "constant", "index", "number"})
RESERVED = frozenset("""model plain import from parameter parameters constant input output signal mode solve port multibody for when every require experiment
    function if else and or not in to over true false time pi ground""".split())  # fmt: skip  # noqa: SIM905


@dataclass(frozen=True, slots=True)
class TextValue:
    """A text known before the run, and the file that has it: the name of a file in it is relative to that."""

    value: str
    file: FileScope


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number with a dimension (None: a bare zero, which fits any)."""

    reference: Reference
    dimension: Dimension | None
    role: str  # parameter, constant, input, signal, output, index, number, time, reading
    name: str
    truth: bool = False  # a condition with a name: 1 or 0 as a number
    choices: tuple[str, ...] = ()  # a parameter that is one of these words: its number, from 1
    text: TextValue | None = None  # a parameter or constant that is a text, and no number

    @property
    def number(self) -> float | None:
        """Its value if that is a number of the text."""
        return self.reference if isinstance(self.reference, float) else None


@dataclass(frozen=True, slots=True)
class Items:
    """A list or a point, items from 1; or a matrix, row by row."""

    name: str
    items: tuple[Scalar, ...]
    columns: int = 0  # of a matrix

    def shape(self, like: object) -> tuple[object, ...]:
        """Units of the items and the columns, as `ListUnits`; with the numbers if those that it is compared with have them."""
        numbers = (tuple([i.number for i in self.items]),) * (isinstance(like, tuple) and len(like) > 2)
        return (tuple([i.dimension for i in self.items]), self.columns, *numbers)


@dataclass(slots=True)
class Pending:
    """A quantity that is not resolved yet."""

    item: tree.Item
    role: str
    name: str  # full name
    value: tree.ExpressionSyntax | None  # the binding, or the default
    scope: Scope  # scope in which `value` is read
    owner: Scope  # scope of the declaration
    is_default: bool
    state: str = "waiting"  # waiting, busy, guessed (done, for a unit alone), done, broken
    result: Scalar | Items | None = None


@dataclass(slots=True)
class Array:
    """An indexed name: items by index tuple."""

    name: str
    span: Span
    items: dict[tuple[int, ...], Entry] = field(default_factory=dict)

    def at(self, index: tuple[int, ...]) -> Entry | None:
        """The item with an index; with the first of several indices, the array of what is left."""
        if index in self.items:
            return self.items[index]
        count = len(index)
        row = {key[count:]: entry for key, entry in self.items.items() if key[:count] == index}
        return Array(indexed(self.name, index), self.span, row) if row else None


@dataclass(frozen=True, slots=True)
class ElementEntry:
    """An element or junction of this scope."""

    name: str  # full name
    kind: str  # "Se", "C", …, "0", "1", "splitter"
    declaration: tree.Declaration
    ports: Mapping[str, Domain]  # port name ("" for the only one) -> domain
    span: Span
    group: str = ""  # of one multibond of a transducer: the beginning of its ports' names, `a.`


@dataclass(frozen=True, slots=True)
class WallEntry:
    """A port of a model, a hole in its wall: components by name, "" for a scalar one."""

    name: str
    ports: Mapping[str, Domain]
    span: Span


@dataclass(frozen=True, slots=True)
class InstanceEntry:
    """An instance of a model; or a set of parameters, with the word `set`."""

    name: str
    scope: Scope
    span: Span
    word: str = "instance"


@dataclass(frozen=True, slots=True)
class PartEntry:
    """A body, joint or frame of a mechanism."""

    mechanism: str  # full name of the mechanism
    name: str  # its own name: `guide[1]`
    kind: str
    ports: Mapping[str, Domain]
    span: Span
    groups: Mapping[str, tuple[str, ...]]  # names that can only be read: `reaction`; `attitude` for a body in space


@dataclass(frozen=True, slots=True)
class GroupEntry:
    """`pin.reaction`, `top.attitude`: quantities that can only be read, one component at a time."""

    part: PartEntry
    name: str


@dataclass(slots=True)
class MechanismEntry:
    """A mechanism with its parts."""

    name: str
    parts: Scope
    span: Span
    planar: bool
    settings: list[tree.SettingSyntax] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Broken:
    """A name whose declaration has an error that is already reported."""

    span: Span


@dataclass(frozen=True, slots=True)
class Absent:
    """A name that is declared in a branch that is not taken: `branch` is the branch in words."""

    span: Span
    branch: str


@dataclass(frozen=True, slots=True)
class SlotEntry:
    """A parameter that stands for a model, which its name denotes as a kind."""

    definition: ModelDefinition
    span: Span


Entry = (
    SlotEntry
    | Broken
    | Absent
    | Scalar
    | Items
    | Pending
    | Array
    | ElementEntry
    | WallEntry
    | InstanceEntry
    | PartEntry
    | GroupEntry
    | MechanismEntry
)


@dataclass(slots=True, eq=False)
class FileScope:
    """One file: its own and imported models, its constants and functions."""

    source: Source
    root: Path | None = None  # the project folder
    library: Path | None = None
    models: dict[str, ModelDefinition] = field(default_factory=dict)
    constants: dict[str, tuple[tree.Item, tree.Quantities]] = field(default_factory=dict)
    functions: dict[str, tree.FunctionSyntax] = field(default_factory=dict)
    sets: dict[str, SetDefinition] = field(default_factory=dict)
    missing: set[str] = field(default_factory=set)  # models that could not be read; already reported
    sheets: dict[Path, Sheet] = field(default_factory=dict)  # files of columns that have been read
    places: dict[str, Span] = field(default_factory=dict)  # of all names
    outline: Outline | None = None  # of an imported file: its models that are not parsed yet


@dataclass(frozen=True, slots=True, eq=False)
class SetDefinition:
    """A set of parameters as defined in its file."""

    syntax: tree.ParameterSet
    file: FileScope


@dataclass(slots=True, eq=False)
class ModelDefinition:
    """A model as defined in its file."""

    model: tree.ModelSyntax
    file: FileScope
    domains: DomainTable | None = None
    functions: dict[str, tree.FunctionSyntax] = field(init=False)  # its own, beside those of the file
    branched: frozenset[str] = field(init=False)  # names of functions and quantities in its conditional parts

    def __post_init__(self) -> None:
        self.functions = functions_in(self.model.statements)
        conditional = (s for s in flat(self.model.statements) if isinstance(s, tree.ConditionalSyntax))
        inner = [s for c in conditional for block in inner_blocks(c) for s in flat(block)]
        quantities = (item.name for s in inner if isinstance(s, tree.Quantities) for item in s.items)
        self.branched = frozenset([*functions_in(inner), *quantities])

    @property
    def name(self) -> str:
        return self.model.name


def functions_in(statements: Iterable[tree.SyntaxNode]) -> dict[str, tree.FunctionSyntax]:
    """Functions of a block, by name; of two with one name the first."""
    functions: dict[str, tree.FunctionSyntax] = {}
    for statement in statements:
        if isinstance(statement, tree.FunctionSyntax):
            functions.setdefault(statement.name, statement)
    return functions


@dataclass(slots=True, eq=False)
class Scope:
    """Names of one instance, or of one round of a loop in it (then `outer` is set)."""

    definition: ModelDefinition
    path: str  # "" or "comb[1]."
    suffix: str = ""  # "[2]" in the second round of a loop
    outer: Scope | None = None
    entries: dict[str, Entry] = field(default_factory=dict)
    stands: Span | None = None  # declaration of the instance
    # of a round of a loop, and of the branches that are taken
    functions: dict[str, tree.FunctionSyntax] = field(default_factory=dict)

    @property
    def plain(self) -> bool:
        return self.definition.model.plain

    def full(self, name: str) -> str:
        return self.path + name

    def find(self, name: str) -> Entry | None:
        """Entry of that name in this scope, or in the scopes around it within the instance."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.entries:
                return scope.entries[name]
            scope = scope.outer
        return None

    def vacant(self, name: str) -> bool:
        """Return True if nothing is declared here under a name, except in a branch that is not taken."""
        entry = self.entries.get(name)
        return entry is None or isinstance(entry, Absent)

    def function(self, name: str) -> tuple[tree.FunctionSyntax, Scope] | None:
        """The function of that name in this scope, or in the scopes around it within the instance, and the scope that has it."""
        scope: Scope | None = self
        while scope is not None:
            functions = scope.functions or ({} if scope.outer is not None else scope.definition.functions)
            if name in functions:
                return functions[name], scope
            scope = scope.outer
        return None

    def rows(self) -> list[Scope]:
        """Scope of the whole instance, and those of the loops in it down to this one."""
        scopes = [self]
        while scopes[0].outer is not None:
            scopes.insert(0, scopes[0].outer)
        return scopes

    def base(self) -> Scope:
        """Scope of the whole instance, outside its loops."""
        scope = self
        while scope.outer is not None:
            scope = scope.outer
        return scope

    def names(self) -> Iterator[str]:
        scope: Scope | None = self
        while scope is not None:
            yield from scope.entries
            scope = scope.outer

    def where_else(self, name: str) -> str:
        """Advice where a mechanism or an instance has that name inside; empty if none has."""
        for outer in self.names():
            entry = self.find(outer)
            inner = entry.parts if isinstance(entry, MechanismEntry) else getattr(entry, "scope", None)
            if isinstance(inner, Scope) and name in inner.entries:
                return f"It stands in `{outer}`: write `{outer}.{name}`."
        return ""

    def readable(self) -> Iterator[str]:
        """Names that denote numbers."""
        for name in self.names():
            entry = self.find(name)
            if isinstance(entry, Array):
                entry = next(iter(entry.items.values()), None)
            if isinstance(entry, Scalar | Items | Pending):
                yield name


@dataclass(frozen=True, slots=True)
class DeclaredPart:
    """A declared part before its attributes are read."""

    entry: PartEntry
    declaration: tree.Declaration
    scope: Scope
    planar: bool


def indexed(name: str, index: tuple[int, ...]) -> str:
    """The name of one item of an array."""
    return f"{name}[{', '.join(map(str, index))}]"
