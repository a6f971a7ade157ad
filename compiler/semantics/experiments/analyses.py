"""Reading of the analysis steps, and of the names in them. A step without names of its own is its row of `steps.py`.

Files of measurements for `fit` are in the project folder. Their headings are quantities of the model with units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ...errors import CompilationFailed
from ...graph.network import Named
from ...graph.units import ONE, SECOND, Dimension
from ...scene import (
    Analysis,
    BoundedParameter,
    ContinuationRequest,
    Differentiating,
    Fitting,
    Inverting,
    Linearizing,
    Study,
    TargetValue,
)
from ...source import Source, Span
from ...syntax import parse_expression, tree
from ...syntax.blocks import nodes_in
from ..expressions.tables import heading, locate
from ..names.column_file import read_sheet
from ..names.domain_table import paths_of
from ..names.errors import (
    DimensionMismatch,
    NotStatic,
    UnknownAttribute,
    UnknownName,
    WrongColumn,
    WrongExperiment,
    WrongType,
)
from ..names.scope import STATIC_ROLES, Scalar, Scope
from ..names.statement_errors import AlreadyTold, Wrong, describe, suggestion, wrong_unit
from ..network.elaborate import Elaborator
from .step_attributes import each, number, read_attributes, refuse_twice, settable, together, word
from .studies import read_montecarlo, read_response

_OF_MODES = re.compile(r"(frequency|damping) [1-9][0-9]*")
_SIGMA = "sigma "


def read_analysis(elaborator: Elaborator, step: tree.Analysis, root: Scope, outputs: Mapping[str, Named]) -> Analysis:
    """Return one analysis step with its numbers in SI.

    Raises `Wrong` and `AlreadyTold`. If several names of the step are wrong, all of them are reported.
    """
    match step.role:
        case "response":
            return read_response(elaborator, step, root, outputs)
        case "linearize":
            read = ((_moved, step.given), (_seen, step.wanted))
            return Linearizing(*together(elaborator, *(partial(each, elaborator, f, some, root) for f, some in read)))
        case "sensitivity":
            names = each(elaborator, settable, step.given, root, "A derivative is taken by one that can be set")
            refuse_twice(step.given)
            return Differentiating(names)
        case "continue":
            return _following(elaborator, step, root)
        case "invert":
            return _inverting(elaborator, step, root, outputs)
        case "montecarlo":
            return read_montecarlo(elaborator, step, root)
        case "fit":
            return _fitting(elaborator, step, root)
    return Study(step.role, **read_attributes(elaborator, step, root).values)


def _moved(elaborator: Elaborator, given: tree.GivenSyntax, root: Scope) -> str:
    """Name of an input of a linear model. Raises `Wrong` unless it is an input, parameter, signal or constant."""
    scalar = elaborator.lookup(given.path, root)
    if not isinstance(scalar, Scalar) or scalar.role not in ("parameter", "input", "signal", "constant"):
        what = f"A linear model leads from an input, which `{word(given.path)}` is not"
        raise Wrong(WrongExperiment(given.span, what, "Name an input, a parameter or a signal."))
    return word(given.path)


def _seen(elaborator: Elaborator, given: tree.GivenSyntax, root: Scope) -> str:
    """Name of an output of a linear model: any single number that a `report` could read. Raises `Wrong` for a list."""
    if not isinstance(elaborator.lookup(given.path, root), Scalar):
        raise Wrong(WrongType(given.span, "A single number", "a list", "Name its items one by one."))
    return word(given.path)


# ---------------------------------------------------------------- along a parameter
def _following(elaborator: Elaborator, step: tree.Analysis, root: Scope) -> ContinuationRequest:
    (given,) = step.given
    name, found = together(
        elaborator,
        partial(settable, elaborator, given, root, "A branch is followed along one that can be set"),
        partial(read_attributes, elaborator, step, root),
    )
    assert step.range is not None
    ends = (step.range.first, step.range.last)
    low, high = together(elaborator, *(partial(number, elaborator, e, given.path, root, f"`{name}`") for e in ends))
    if low == high:
        hint = "Write where it begins and where it ends."
        raise Wrong(WrongExperiment(step.range.span, "The range has no length", hint))
    return ContinuationRequest(name, low, high, **found.values)


def _dimension(elaborator: Elaborator, path: tree.PathSyntax, root: Scope) -> Dimension:
    scalar = elaborator.lookup(path, root)
    assert isinstance(scalar, Scalar)
    return scalar.dimension or ONE


# ---------------------------------------------------------------- inputs for outputs
def _inverting(elaborator: Elaborator, step: tree.Analysis, root: Scope, outputs: Mapping[str, Named]) -> Inverting:
    inputs, wanted, along = together(
        elaborator,
        partial(each, elaborator, _drive, step.given, root),
        partial(each, elaborator, _wish, step.wanted, root, outputs, step.range is not None),
        partial(_along, elaborator, step, root),
    )
    refuse_twice(step.given)
    refuse_twice(step.wanted)
    if len(inputs) != len(wanted):
        one, other = (
            f"{len(some)} {word}{'s' * (len(some) != 1)}" for some, word in ((wanted, "output"), (inputs, "input"))
        )
        hint = "There are as many inputs as outputs; of a pair `push/pull` one pushes while the other is zero, so that it counts as one."
        raise Wrong(WrongExperiment(step.span, f"{one} and {other} or pairs", hint))
    return Inverting(inputs, wanted, **along)


def _along(elaborator: Elaborator, step: tree.Analysis, root: Scope) -> dict[str, Any]:
    """Attributes of a path in time: start, stop, limits and settings. Empty if the step has no range."""
    if step.range is None:
        for attribute in step.attributes:
            hint = "Along a path it has: points, moving, `limit NAME = …`; say `over 0 .. 5 ms`."
            raise Wrong(UnknownAttribute(attribute.span, "invert", attribute.name, hint))
        return {}
    time = ONE if root.plain else SECOND
    names = {word(p) for g in step.given for p in (g.path, g.other) if p is not None}
    limit = {"limit": _limits(elaborator, names)}
    start, stop, found = together(
        elaborator,
        partial(elaborator.static, step.range.first, root, "The start of a path", time),
        partial(elaborator.static, step.range.last, root, "The end of a path", time),
        partial(read_attributes, elaborator, step, root, limit),
    )
    if stop <= start:
        raise Wrong(WrongExperiment(step.range.span, "The path ends before it begins", "Write `over 0 .. 5 ms`."))
    return {"start": start, "stop": stop, "limits": tuple(found.named["limit"].items()), **found.values}


def _drive(elaborator: Elaborator, given: tree.GivenSyntax, root: Scope) -> str:
    what = "What is found is one that can be set"
    first = settable(elaborator, given, root, what)
    if given.other is None:
        return first
    other = settable(elaborator, tree.GivenSyntax(given.other.span, given.other), root, what)
    dimensions = [_dimension(elaborator, p, root) for p in (given.path, given.other)]
    if dimensions[0] != dimensions[1]:
        told = f"`{first}` is {describe(dimensions[0])} and `{other}` is {describe(dimensions[1])}"
        raise Wrong(DimensionMismatch(given.span, told, "The two of a pair are of one kind."))
    return f"{first}/{other}"


def _limits(elaborator: Elaborator, names: set[str]) -> Callable[[tree.Attribute, Scope], tuple[str, float]]:
    def read(attribute: tree.Attribute, root: Scope) -> tuple[str, float]:
        assert attribute.target is not None
        name = word(attribute.target)
        if name not in names:
            hint = suggestion(name, sorted(names), f"Found are: {', '.join(sorted(names))}.")
            raise Wrong(UnknownName(attribute.target.span, name, "what is found here", hint))
        value = number(elaborator, attribute.value, attribute.target, root, f"The limit of `{name}`")
        if value <= 0:
            hint = "Write how large the input may be."
            raise Wrong(WrongExperiment(attribute.span, "A limit is larger than zero", hint))
        return name, value

    return read


def _wish(
    elaborator: Elaborator, given: tree.GivenSyntax, root: Scope, outputs: Mapping[str, Named], along: bool
) -> TargetValue:
    name = word(given.path)
    if name not in outputs:
        hint = suggestion(name, list(outputs), f"Outputs: {', '.join(outputs) or 'none'}.")
        raise Wrong(UnknownName(given.path.span, name, "the outputs", hint))
    scalar = elaborator.lookup(given.path, root)
    dimension = (scalar.dimension if isinstance(scalar, Scalar) else None) or ONE
    assert given.value is not None
    if not along:
        if any(word(p) == "time" for p in paths_of(given.value)):
            what = f"What is wanted of `{name}` goes with time, and no path is asked for"
            raise Wrong(WrongExperiment(given.value.span, what, "Say how long: `over 0 .. 5 ms`."))
        return TargetValue(name, number(elaborator, given.value, given.path, root, f"What is wanted of `{name}`"))
    return TargetValue(name, text=_over_time(elaborator, given.value, root, name, dimension))


def _over_time(elaborator: Elaborator, value: tree.ExpressionSyntax, root: Scope, name: str, wanted: Dimension) -> str:
    """The text of an expression of time, with numbers in the place of all names."""
    template = elaborator.template(value, root)
    if isinstance(template.value, tuple):
        raise Wrong(WrongType(value.span, "A single number", "a list"))
    found = template.value.dimension
    if found is not None and found != wanted:
        raise wrong_unit(f"`{name}`", wanted, value, found)
    own = _own_functions(value, root)
    if own:
        hint = "Write out what it stands for: a path is an expression of time, numbers and parameters."
        raise Wrong(WrongExperiment(own[0].span, f"A path cannot call your function `{own[0].function}`", hint))
    text, begin = value.span.source.text[value.span.start : value.span.end], value.span.start
    for path in sorted(paths_of(value), key=lambda p: -p.span.start):
        if word(path) in ("time", "pi"):
            continue
        scalar = elaborator.lookup(path, root)
        if not isinstance(scalar, Scalar):
            raise Wrong(WrongType(path.span, "A single number", "a list", "Name one of its items."))
        if scalar.role not in STATIC_ROLES:
            raise Wrong(NotStatic(path.span, f"What a path of `{name}` reads besides time", word(path)))
        dimension = scalar.dimension or ONE
        number = elaborator.static(path, root, f"`{word(path)}`", dimension)
        unit = "" if root.plain or dimension == ONE else f" [{dimension}]"
        text = f"{text[: path.span.start - begin]}({number!r}{unit}){text[path.span.end - begin :]}"
    return " ".join(text.split())


def _own_functions(value: tree.ExpressionSyntax, root: Scope) -> list[tree.Call]:
    """Calls in an expression that are the author's own functions."""
    own = {*root.definition.functions, *root.definition.file.functions}
    return [node for node in nodes_in(value) if isinstance(node, tree.Call) and node.function in own]


# ---------------------------------------------------------------- parameters from measurements
def _fitting(elaborator: Elaborator, step: tree.Analysis, root: Scope) -> Fitting:
    scales: dict[str, Callable[[tree.Attribute, Scope], tuple[str, bool]]] = {"scale": _scale}
    told = elaborator.guard(read_attributes, elaborator, step, root, scales)
    logarithmic = told.named["scale"] if told is not None else {}
    looked_for = {word(g.path) for g in step.given}
    sought, files = together(
        elaborator,
        partial(each, elaborator, _unknown, step.given, root, logarithmic),
        partial(together, elaborator, *(partial(read_headings, elaborator, t, root, looked_for) for t in step.files)),
    )
    if told is None:
        raise AlreadyTold
    refuse_twice(step.given)
    for name in set(logarithmic) - {s.name for s in sought}:
        span = next(a.span for a in step.attributes if a.target is not None and word(a.target) == name)
        hint = suggestion(name, [s.name for s in sought], f"Looked for are: {', '.join(s.name for s in sought)}.")
        raise Wrong(UnknownName(span, name, "what is looked for", hint))
    measured = dict.fromkeys(name for _, some in files for name in some)
    return Fitting(sought, tuple(path for path, _ in files), tuple(measured), **told.values)


def _scale(attribute: tree.Attribute, root: Scope) -> tuple[str, bool]:
    assert attribute.target is not None
    if attribute.value.span.words not in ("log", "linear"):
        raise Wrong(WrongExperiment(attribute.span, "A scale is `log` or `linear`", "Write `scale k = log`."))
    return word(attribute.target), attribute.value.span.words == "log"


def _unknown(
    elaborator: Elaborator, given: tree.GivenSyntax, root: Scope, logarithmic: Mapping[str, bool]
) -> BoundedParameter:
    name = settable(elaborator, given, root, "What is looked for is one that can be set")
    scale = logarithmic.get(name, False)
    if given.range is None:
        return BoundedParameter(name, logarithmic=scale)
    ends = given.range.first, given.range.last
    low, high = (number(elaborator, e, given.path, root, f"A bound of `{name}`") for e in ends)
    if not low < high:
        what = f"The bounds of `{name}` do not go from low to high"
        raise Wrong(WrongExperiment(given.range.span, what, f"Write `{name} = LOW .. HIGH`."))
    if scale and low < 0:
        what = f"A logarithmic scale has no bounds below zero, and `{name}` has one"
        raise Wrong(WrongExperiment(given.range.span, what, "Leave out the `scale`, or raise the bound."))
    return BoundedParameter(name, low, high, scale)


def read_headings(
    elaborator: Elaborator, text: tree.TextSyntax, root: Scope, sought: set[str]
) -> tuple[str, tuple[str, ...]]:
    """Return the file name as written and the names of the measured quantities.

    Raises `Wrong` or `AlreadyTold` unless the model has every quantity of the headings, in such units.
    """
    path = locate(text.span, text.value, root.definition.file)
    sheet = read_sheet(text.span, text.value, path)
    columns = zip(sheet.names, sheet.headers, strict=True)
    found = together(elaborator, *(partial(_column, elaborator, text, root, sought, column) for column in columns))
    measured = tuple(name for name in found if name)
    if not measured:
        hint = "A column of an output, or of `frequency 1 [Hz]`, says what was found."
        raise Wrong(WrongColumn(text.span, f"Nothing is measured in {text.value}", hint))
    return text.value, measured


def _column(
    elaborator: Elaborator, text: tree.TextSyntax, root: Scope, sought: set[str], head: tuple[str, Span]
) -> str:
    """Name of the measured quantity in a column; "" for a column of anything else. Raises `Wrong`."""
    written, place = head
    name, scale = heading(text, written, place)
    bare = name.removeprefix(_SIGMA)
    wanted, is_set = _kind(elaborator, text, root, bare, place)
    if is_set and bare in sought:
        hint = "What is looked for has one value for all lines."
        what = f"`{bare}` is looked for, and set line by line"
        raise Wrong(WrongColumn(text.span, what, hint, ((place, "this header"),)))
    found, named = ONE if scale is None else scale.dimension, elaborator.quantities.get(bare)
    if named is not None and named.counted and "[" not in written:
        what = f"`{bare}` is in {named.counted}, but {text.value} has it without a unit"
        hint = f"Write `{bare} [{named.counted}]`, or `{bare} [1]` for bare numbers."
        raise Wrong(WrongColumn(text.span, what, hint, ((place, "this header"),)))
    if found != wanted:
        what = f"`{bare}` is {describe(wanted)}, but {text.value} has it {'without a unit' if scale is None else describe(found)}"
        raise Wrong(WrongColumn(text.span, what, "Headings are names with units: `x [um]`.", ((place, "this header"),)))
    return "" if is_set or name != bare or bare == "time" else bare


def _kind(elaborator: Elaborator, text: tree.TextSyntax, root: Scope, name: str, place: Span) -> tuple[Dimension, bool]:
    """Dimension of the quantity in a heading, and True if the person who measures sets it."""
    if name == "time":
        return (ONE if root.plain else SECOND), False
    if _OF_MODES.fullmatch(name):
        return (ONE if name.startswith("damping") or root.plain else ONE / SECOND), False
    try:
        path = parse_expression(Source(text.value, name))
        scalar = elaborator.lookup(path, root) if isinstance(path, tree.PathSyntax) else None
    except (CompilationFailed, Wrong):
        scalar = None
    if not isinstance(scalar, Scalar):
        what = f"`{name}` in {text.value} is nothing that the model has"
        hint = "A heading is `time [s]`, `frequency 1 [Hz]`, a quantity of the model, or `sigma` before one of these."
        raise Wrong(WrongColumn(text.span, what, hint, ((place, "this header"),)))
    return scalar.dimension or ONE, scalar.role in ("parameter", "input")
