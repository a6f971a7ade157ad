"""Errors in names, units, laws and connections: BG1xx."""

from __future__ import annotations

from ...errors import Diagnostic, WordedDiagnostic
from ...source import Span


class UnknownName(Diagnostic):
    code = "BG101"
    title = "There is no `{name}` in {where}"
    advice = "{hint}"
    name: str
    where: str
    hint: str


class UnknownFunction(Diagnostic):
    code = "BG109"
    title = "There is no function `{name}`"
    advice = "{hint}"
    name: str
    hint: str


class UnknownUnit(WordedDiagnostic):
    code = "BG102"


class DimensionMismatch(WordedDiagnostic):
    code = "BG103"


class DuplicateName(Diagnostic):
    code = "BG104"
    title = "The name `{name}` is already taken in this model"
    advice = "{hint}"
    name: str
    first: Span
    hint: str = "Rename one of the two."

    def related(self) -> tuple[tuple[Span, str], ...]:
        return ((self.first, "it was first used here"),)


class UnknownKind(Diagnostic):
    code = "BG105"
    title = "`{kind}` is neither a kind of element nor a model"
    advice = "{hint}"
    kind: str
    hint: str


class NotStatic(Diagnostic):
    code = "BG106"
    title = "{what} must be known before the run, but `{name}` changes during it"
    advice = "Use numbers, parameters and constants here."
    what: str
    name: str

    @property
    def help(self) -> str:
        """Advice; a quantity may be a signal instead, other places may not."""
        is_declared = self.what.startswith(("The parameter `", "The constant `"))
        return f"{self.advice[:-1]}, or declare it as `signal`." if is_declared else self.advice


class Cycle(Diagnostic):
    code = "BG107"
    title = "{what}: {chain}"
    advice = "Break the circle at one of these names."
    what: str
    chain: str


class WrongArguments(Diagnostic):
    code = "BG108"
    title = "`{function}` takes {expected}, not {count}"
    advice = "Write it as `{usage}`."
    function: str
    expected: str
    count: int
    usage: str


class MissingValue(Diagnostic):
    code = "BG110"
    title = "{role} `{name}` has no value"
    advice = "Give it one where it is declared{otherwise}."
    role: str
    name: str
    otherwise: str
    instance: Span | None = None

    def related(self) -> tuple[tuple[Span, str], ...]:
        return () if self.instance is None else ((self.instance, "the instance that needs it"),)


class WrongType(Diagnostic):
    code = "BG111"
    title = "{what} is expected here, this is {found}"
    advice = "{hint}"
    what: str
    found: str
    hint: str = "Write what is expected instead."


class WrongIndex(Diagnostic):
    code = "BG112"
    title = "`{name}` has no item {index}"
    advice = "{hint}"
    name: str
    index: str
    hint: str


class UnknownDomain(Diagnostic):
    code = "BG114"
    title = "The domain of {names} is not known"
    advice = "{first}Give the domain after a colon, as in `{example}`, or write a law in a domain's letters. What is bonded has one domain."
    names: str
    example: str
    first: str


class DomainConflict(Diagnostic):
    code = "BG115"
    title = "`{name}` is {first} here, but joined to `{neighbour}`, which is {second}"
    advice = "Two domains meet only through a transducer: TF, GY or a field with a port in each. Members of one array have one domain."
    name: str
    first: str
    neighbour: str
    second: str
    other: Span

    def related(self) -> tuple[tuple[Span, str], ...]:
        return ((self.other, f"{self.second} because of this"),)


class NameClash(Diagnostic):
    code = "BG116"
    title = "`{name}` could be a variable of `{element}` or the {role} of that name"
    advice = "Rename the {role}{instead}."
    name: str
    element: str
    role: str
    instead: str


class ForeignVariable(Diagnostic):
    code = "BG117"
    title = "The law of `{element}` reads `{name}`, which changes during a run"
    advice = "{hint}"
    element: str
    name: str
    hint: str


class NeedlessM(Diagnostic):
    code = "BG118"
    title = "`{kind} {element}` is modulated in name only: its law reads nothing that changes elsewhere"
    advice = "Write `{plain} {element}`."
    kind: str
    element: str
    plain: str


class WrongLaw(WordedDiagnostic):
    code = "BG119"


class UnknownAttribute(Diagnostic):
    code = "BG120"
    title = "`{owner}` has no attribute `{name}`"
    advice = "{hint}"
    owner: str
    name: str
    hint: str


class WrongValue(Diagnostic):
    code = "BG122"
    title = "`{attribute}` of `{owner}` cannot be `{value}`"
    advice = "{hint}"
    attribute: str
    owner: str
    value: str
    hint: str


class WrongConnection(WordedDiagnostic):
    code = "BG121"


class Unsupported(WordedDiagnostic):
    code = "BG130"
    title = "{what} is not supported by this version"


class WrongImport(WordedDiagnostic):
    code = "BG131"


class NoSingleModel(WordedDiagnostic):
    code = "BG132"


NO_NAMES = "Write an expression that has a finite value."  # the advice where no name has a value to tell


class NoValue(Diagnostic):
    code = "BG133"
    title = "This has no finite value: {why}"
    advice = "{values}"
    why: str
    values: str


class ReservedName(Diagnostic):
    code = "BG134"
    title = "`{name}` is reserved"
    advice = (
        "Choose another name; reserved are only the words that begin statements, "
        "`if else and or not in to over true false time pi ground`, and for models the kinds of elements."
    )
    name: str


class WrongMechanism(WordedDiagnostic):
    code = "BG140"


class WrongExperiment(WordedDiagnostic):
    code = "BG150"


class WrongTable(WordedDiagnostic):
    code = "BG151"


class WrongColumn(WordedDiagnostic):
    code = "BG152"


class WrongEvent(WordedDiagnostic):
    code = "BG153"


class AbsentName(Diagnostic):
    code = "BG170"
    title = "There is no `{name}` here: it stands in {branch}, which is not taken"
    advice = (
        "Put this line into the same branch, declare the name outside of the `if`, or set what the condition reads."
    )
    name: str
    branch: str
    declared: Span

    def related(self) -> tuple[tuple[Span, str], ...]:
        return ((self.declared, "where it is declared"),)


class WrongStructure(WordedDiagnostic):
    code = "BG171"


class WrongSet(WordedDiagnostic):
    code = "BG172"


class WrongSampling(WordedDiagnostic):
    code = "BG175"


class SamplingOutOfRange(WordedDiagnostic):
    code = "BG176"


class LateStorage(Diagnostic):
    code = "BG177"
    title = "`{words}` is set by an `every` with a delay, which sets `mode`s alone"
    advice = (
        "A delay is the time that a controller computes. Set a `mode` there, and `{words}` by an `every` without delay."
    )
    words: str


class TooMany(Diagnostic):
    code = "BG160"
    title = "{what}: more than {limit}"
    advice = "{hint}"
    what: str
    limit: int
    hint: str = "The limit protects against files that never end; split the model."


class TooLongRow(Diagnostic):
    """BG162: nested more deeply than the compiler follows."""

    code = "BG162"
    title = "In `{model}` quantities, functions or expressions read one another in a row that is too long to follow"
    advice = "Shorten the row: write several steps as one expression, or with `for` over elements that store something."
    model: str


class TooManyMistakes(Diagnostic):
    """BG161: the limit on reported errors is reached."""

    code = "BG161"
    title = "More than {limit} mistakes: what else is wrong is not told"
    advice = "Mend these first; one cause may be behind many of them."
    limit: int
