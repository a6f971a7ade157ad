"""Keyword options that several calls of a model share, requests of analyses, and the check of a call's arguments against its own annotations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypedDict, TypeVar

from .errors import UsageError

LARGEST = 1 << 1023  # whole numbers below it are doubles

_Arguments = ParamSpec("_Arguments")
_Found = TypeVar("_Found")


class RunKeywords(TypedDict, total=False):
    """Options of a call that runs a model, beside experiment, settings, end and instants; each overrides the experiment.

    `rtol`, `atol`: tolerances; `accuracy`: largest error of an output relative to its magnitude, which chooses them. `energy` adds the energy balance.
    `outputs`: only these. `target`: native (machine code) or numpy; by default the first that this machine has. `solver`: a word of
    `compiler.solvers.SOLVERS`. `bandwidth`: a frequency as text or in Hz; faster modes need not be followed, and the result's `left_out` reports the
    truncated ones. `extremes`: the least and greatest values of the outputs are searched between the reported instants.
    """

    rtol: float | None
    atol: float | None
    accuracy: float | None
    energy: bool
    outputs: Sequence[str] | None
    target: str | None
    solver: str | None
    bandwidth: str | float | None
    extremes: bool


class SweepKeywords(RunKeywords, total=False):
    """Options of a sweep: those of its runs."""

    to: str | float | None
    points: int | None


class BenchmarkKeywords(TypedDict, total=False):
    """Options of a benchmark."""

    rounds: int
    peers: bool
    outputs: Sequence[str] | None
    progress: Callable[[str], None]


class StressKeywords(TypedDict, total=False):
    """Options of a stress test."""

    vary: Mapping[str, str]
    seed: int
    out: str | Path | None
    outputs: Sequence[str] | None
    progress: Callable[[str], None]


class MonteCarloKeywords(TypedDict, total=False):
    """Options of a Monte Carlo study."""

    correlations: Mapping[tuple[str, str], float] | None
    seed: int
    indices: int | None
    outputs: Sequence[str] | None
    to: str | float | None
    rtol: float | None


class ExperimentKeywords(TypedDict, total=False):
    """Options of an analysis: an experiment ("": the first, by default; None: none), whose settings and start values are used, and more settings by name."""

    experiment: str | None
    settings: Mapping[str, str | float] | None


class AnalysisKeywords(ExperimentKeywords, total=False):
    """Options of an analysis at an equilibrium: its inputs are held as at `time` (s; None: begin of the experiment)."""

    time: float | None


class PointKeywords(AnalysisKeywords, total=False):
    """Options of an analysis at a `state`: "equilibrium", "start", or values of states by name, in SI."""

    state: str | Mapping[str, float]


class PathKeywords(TypedDict, total=False):
    """Options of an inversion along a path.

    `start` of the path (None: 0 s, or the first line of its file), number of `points` (501), `moving`: it need not begin at rest; `limits`: largest inputs.
    """

    start: str | float | None
    points: int
    moving: bool
    limits: Mapping[str, str | float] | None


@dataclass(frozen=True, slots=True)
class AnalysisRequest:
    """Request for an operating point.

    `state`: "equilibrium", "start", or values of states by name (the rest as at the start). `by`: quantities by which derivatives are taken;
    `outputs`: None for all. `upstream`: without the states that no named output depends on.
    """

    experiment: str | None = ""
    settings: Mapping[str, str | float] | None = None
    outputs: tuple[str, ...] | None = None
    by: tuple[str, ...] = ()
    state: str | Mapping[str, float] = "equilibrium"
    time: float | None = None  # None: where the experiment begins
    upstream: bool = False


def checked(call: Callable[_Arguments, _Found]) -> Callable[_Arguments, _Found]:
    """Return the call with a check of its arguments before it. It raises `UsageError` with what it expects."""

    @wraps(call)
    def with_check(*values: _Arguments.args, **options: _Arguments.kwargs) -> _Found:
        _check(call, values, options)
        return call(*values, **options)

    return with_check


def check_keywords(call: Callable[..., object], options: Mapping[str, object], known: Set[str]) -> None:
    """Raise `UsageError` for an option that a call does not have, with the nearest that it has."""
    if unknown := sorted(options.keys() - known):
        from difflib import get_close_matches
        from inspect import signature

        names = sorted({*signature(call).parameters, *known} - {"self", "options"})
        near = get_close_matches(unknown[0], names, n=1)
        hint = f"did you mean `{near[0]}`?" if near else f"it has {', '.join(names)}"
        raise UsageError("BR614", f"`{call.__name__}` has no option `{unknown[0]}`; {hint}")


def _check(call: Callable[..., object], values: Sequence[object], options: Mapping[str, object]) -> None:
    places, kinds, needed = _expected(call)
    if len(values) > len(places):
        names = ", ".join(f"`{n}`" for n in places[1:])
        raise UsageError("BR696", f"`{call.__name__}` takes {names} by place, and no more")
    placed = dict(zip(places, values, strict=False))
    if options:
        check_keywords(call, options, kinds.keys())
    if needed and (lacking := [name for name in needed if name not in placed and name not in options]):
        raise UsageError("BR697", f"`{call.__name__}` needs `{lacking[0]}`, {_words(kinds[lacking[0]])}")
    for name, value in (*placed.items(), *options.items()):
        if name in placed and name in options:
            raise UsageError("BR698", f"`{call.__name__}` gets `{name}` twice, by its place and by its name")
        # an array without an axis is a number among settings, and as an option no key of what is kept
        if name in kinds and (
            (getattr(value, "shape", None) == () and type(value).__hash__ is None) or not _fits(value, kinds[name])
        ):
            raise _unfit(call, name, value, kinds)


def _unfit(call: Callable[..., object], name: str, value: object, kinds: Mapping[str, str]) -> UsageError:
    from reprlib import repr as shortened

    by_name = isinstance(value, Mapping) and "settings" in kinds and "Mapping" not in kinds[name]
    hint = (
        "values by name are its `settings={…}`" if by_name else f"`help({call.__qualname__})` describes its arguments"
    )
    return UsageError(
        "BR699", f"`{call.__name__}` expects as `{name}` {_words(kinds[name])}, not {shortened(value)}; {hint}"
    )


@cache
def _expected(call: Callable[..., object]) -> tuple[tuple[str, ...], Mapping[str, str], tuple[str, ...]]:
    """Return the names of a call's arguments by place, the annotation of each argument and option, and the names of those that it needs."""
    from inspect import Parameter, signature

    parameters = signature(call).parameters.values()
    options = next((p.annotation for p in parameters if p.kind is Parameter.VAR_KEYWORD), "Unpack[]")
    shared = globals().get(options[len("Unpack[") : -1])
    kinds = {n: reference.__forward_arg__ for n, reference in getattr(shared, "__annotations__", {}).items()}
    named = {p.name: p for p in parameters if p.kind is not Parameter.VAR_KEYWORD}
    places = tuple(n for n, p in named.items() if p.kind is not Parameter.KEYWORD_ONLY)
    kinds |= {n: p.annotation for n, p in named.items() if n != "self"}
    return places, kinds, tuple(n for n, p in named.items() if p.default is Parameter.empty and n != "self")


# name of a type: its words, and the attribute by which other types pass for it
_SIMPLE = {
    "str": ("a text", ""), "float": ("a number", "__float__"), "int": ("a whole number", "__index__"), "bool": ("True or False", "__bool__"),
    "Path": ("a path", "__fspath__"),
}  # fmt: skip
_OPEN = ("Any", "Submitting")  # what has no type of its own


def _fits(value: object, annotation: str) -> bool:
    """Return True if a value is of one of the kinds in an annotation."""
    kind: type = type(value)
    if kind is float or (isinstance(value, int) and abs(value) < LARGEST) or (kind is str and value):
        return _example_fits(kind, annotation)  # most are, and their type alone decides
    return any(_is_of(value, *kind) for kind in _kinds(annotation))


@cache
def _example_fits(kind: type, annotation: str) -> bool:
    """Return True if numbers, or texts that are not empty, are of one of the kinds in an annotation."""
    return any(_is_of(kind(1), *some) for some in _kinds(annotation))


def _is_of(value: object, kind: str, parts: tuple[str, ...]) -> bool:
    if kind == "None":
        return value is None
    if kind in ("Mapping", "Callable"):
        return callable(value) if kind == "Callable" else isinstance(value, Mapping) and all(
            _fits(k, parts[0]) and _fits(v, parts[1]) for k, v in value.items()
        )  # fmt: skip
    if kind in ("Sequence", "tuple"):
        listed = isinstance(value, Iterable) and not isinstance(value, Mapping | bytes)
        return listed and (not isinstance(value, Collection) or all(_fits(x, parts[0]) for x in value))
    if kind == "float" and not _is_number(value):
        return False
    if kind in _SIMPLE and (trait := _SIMPLE[kind][1]):
        return hasattr(value, trait) and not getattr(value, "shape", ())  # an array of one number is a list
    return kind in _OPEN or any(c.__name__ == kind for c in type(value).__mro__)


def _is_number(value: Any) -> bool:
    """Return True if a value is a real number that a double can hold; an array of one that has no axis, too."""
    try:
        return not isinstance(value, complex | str | bytes) and float(value) is not None
    except (TypeError, ValueError, OverflowError):  # a date of numpy; a whole number of 400 digits
        return False


@cache
def _kinds(annotation: str) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return the kinds in an annotation, each with what stands in its brackets: `str | Sequence[float]` is a text or a list of numbers."""
    kinds = []
    for part in _split(annotation, "|"):
        kind, _, inner = part.partition("[")
        kinds.append((kind, tuple(_split(inner[:-1], ","))))
    return tuple(kinds)


def _split(text: str, mark: str) -> list[str]:
    """Split a text at the marks outside of its brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "[") - (letter == "]")
        if letter == mark and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _words(annotation: str) -> str:
    """Return what an annotation asks for, in words."""
    words = []
    for kind, parts in _kinds(annotation):
        if kind == "Mapping":
            words.append(f"a dict by name whose values are each {_words(parts[1])}")
        elif kind in ("Sequence", "tuple"):
            words.append(f"a list whose items are each {_words(parts[0])}")
        elif kind not in ("None", *_OPEN):
            words.append(_SIMPLE.get(kind, (f"a `{kind}`", ""))[0])
    return " or ".join(dict.fromkeys(words))
