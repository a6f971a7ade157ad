"""Exercise on state equations: the states without right sides, and marks for right sides that were derived by hand.

A right side becomes an output of the model in this scene alone, so the compiler reads its names and checks its units. It is right if it and its derivatives
by everything that it may read agree with the model's at random points, of moderate and of very different magnitudes.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import isfinite, log10

import numpy as np

from compiler import api
from compiler.api import Compilation, CompilationFailed, Expression, Kind, Leaf, Lowered, Source, Span, StateSpace, Tape

from ..compiled_model import CompiledModel
from ..errors import UsageError
from .answer import Mark, MarkedAnswer, gaps, lines_of

EQUATION = re.compile(r"d/dt\s+(\S+)\s*=\s*(.*)")
POINTS, LEAST = 40, 8  # random points, and how many of them must have values
SAME, SAME_SLOPE = 1e-9, 1e-6  # relative differences
ROUNDED, TINY = 1e-12, 1e-300  # relative round-off of a slope beside the whole; so that nothing is divided by zero
OUTPUT = "answer of {}"
SOURCES = (Kind.EFFORT_SOURCE, Kind.FLOW_SOURCE)


def equations_to_write(model: CompiledModel) -> str:
    """Return the exercise: the rate of each state with a gap. Raises `CompilationFailed`, `UsageError`."""
    base = model.with_inputs()
    lines = [f"d/dt {name} = ?  # {unit}".rstrip(" #") for name, unit in _rates(base.state_space).items()]
    head = f"# State equations of {base.graph.name}: write a right side for each ?, in these names:"
    return "\n".join([head, f"# {', '.join(_names(base))}", *lines])


def mark_equations(model: CompiledModel, answer: Source) -> MarkedAnswer:
    """Return the marks of an answer. Raises `CompilationFailed` for errors of the model, `UsageError`."""
    base = model.with_inputs()
    rates, stray = _rates(base.state_space), list[Mark]()
    marks, written = dict[str, Mark](), dict[str, Span]()
    for line in lines_of(answer):
        match = EQUATION.fullmatch(line.text)
        if match and match[1] in rates and match[1] not in marks:
            marks[match[1]] = Mark(line, line.text, "it has no right side yet" * (match[2] in ("", "?")))
            written[match[1]] = Span(answer, line.end - len(match[2]), line.end)
        else:
            fault = f"there is no state `{match[1]}` left" if match else "a line has the form `d/dt STATE = RIGHT SIDE`"
            stray.append(Mark(line, line.text, fault))

    def mark(faults: Iterable[tuple[str, Span, str]]) -> dict[str, Span]:
        """Note faults, and return the lines that have none."""
        marks.update({name: replace(marks[name], span=span, wrong=wrong) for name, span, wrong in faults})
        return {name: line for name, line in written.items() if not marks[name].wrong}

    good = mark((n, *f) for n, line in mark(()).items() if (f := _misread(base, line)))
    good = mark((n, *f) for n, line in good.items() if (f := _refused(base, n, line)))
    if good:
        joint = _with_answers(base, good)
        mark((name, marks[name].span, wrong) for name, wrong in _compared(joint, tuple(good)).items())
    return MarkedAnswer(
        (*stray, *marks.values(), *gaps(answer, [f"d/dt {name} =" for name in rates if name not in marks]))
    )


def _rates(space: StateSpace) -> dict[str, str]:
    """Return the units of the rates by state. Raises `UsageError` for a model without state equations in closed form."""
    if space.unknowns or space.delays or not space.states:
        what = "has no states" if not space.states else "has unknowns of nonlinear loops, or delays"
        raise UsageError("BR657", f"{space.name} {what}: there are no state equations to write;", "take its strokes")
    units = {space.variables[s.variable]: f"({space.variables[s.variable].unit})/s" for s in space.states}
    for state in space.states:
        if isinstance(state.rate, int):
            units[space.variables[state.variable]] = space.variables[state.rate].unit
    return {v.name: "" if units[v] == "1" or not v.unit else units[v] for v in units}


# ---------------------------------------------------------------- reading


def _names(compilation: Compilation) -> tuple[str, ...]:
    """Return the names of which a right side may be made: states, what is given, and what sources give."""
    space, graph = compilation.state_space, compilation.graph
    states = [space.variables[s.variable].name for s in space.states]
    quantities = [v.name for v in space.variables if v.role in ("input", "mode", "time")]
    quantities += [n for n, q in compilation.whole_graph.quantities.items() if q.role in ("parameter", "constant")]
    sources = [n for n in graph.nodes if isinstance(n, api.Element) and n.kind in SOURCES and len(n.ports) == 1]
    drive = [f"{n.name}.{api.DOMAINS[n.ports[0].domain].letters[SOURCES.index(n.kind)]}" for n in sources]
    return tuple(dict.fromkeys((*states, *drive, *quantities)))


def _misread(compilation: Compilation, line: Span) -> tuple[Span, str] | None:
    """Return what is wrong with the words of a right side; None if it may be compiled."""
    try:
        tree = api.parse_expression(Source("answer", _in_place(line, "", "")))
    except CompilationFailed as failed:
        return _first(failed, line)
    names = _names(compilation)
    for node in sorted(api.nodes_in(tree), key=lambda n: n.span.start):
        if isinstance(node, api.Call) and node.function in api.MEMORIES:
            return _moved(node.span, line), f"`{node.function}` is no function of the states at one instant"
        if isinstance(node, api.PathSyntax) and node.words not in names:
            return _moved(node.span, line), f"`{node.words}` is not given: write it with {', '.join(names)}"
    return None


def _in_place(line: Span, before: str, after: str) -> str:
    """Return a right side behind as many spaces and lines as in its answer, so that places are the same; `before` takes the place of some."""
    start = line.start - len(before)
    return re.sub(r"[^\n]", " ", line.source.text[:start]) + before + line.text + after


def _moved(span: Span, line: Span) -> Span:
    start = min(max(span.start, line.start), line.end)
    return Span(line.source, start, max(start, min(span.end, line.end)))


def _first(failed: CompilationFailed, line: Span) -> tuple[Span, str]:
    problem = failed.diagnostics[0]
    return _moved(problem.span, line), f"{problem.sentence}. {problem.help}".strip()


def _with_answers(base: Compilation, lines: Mapping[str, Span], units: bool = True) -> Compilation:
    """Return the model with right sides as outputs, each of the unit of its rate. Raises `CompilationFailed`."""
    rates = _rates(base.state_space)
    zeros = {name: f") + 0 [{rates[name]}]" if rates[name] else ") + 0" for name in lines}
    texts = [(OUTPUT.format(name), _in_place(line, "(", zeros[name] if units else ")")) for name, line in lines.items()]
    scene = replace(base.scene, extra_outputs=tuple(texts))
    compilation = Compilation(base.source, scene, base.library, True, base.most_parts)
    _ = compilation.state_space
    return compilation


def _refused(base: Compilation, name: str, line: Span) -> tuple[Span, str] | None:
    """Return what the compiler says of a right side alone; None if nothing."""
    with suppress(CompilationFailed):
        _with_answers(base, {name: line})
        return None
    try:
        space = _with_answers(base, {name: line}, False).state_space
    except CompilationFailed as failed:
        return _first(failed, line)
    unit = space.variables[space.outputs[OUTPUT.format(name)]].unit
    return line, f"its unit is {unit or 1}, and that of the rate {_rates(base.state_space)[name] or 1}"


# ---------------------------------------------------------------- comparing


def _compared(compilation: Compilation, names: Sequence[str]) -> dict[str, str]:
    """Return what is wrong with the right sides of some states."""
    space = compilation.state_space
    lowered = api.lower(space, located=False)
    rates = {space.variables[s.variable].name: rate for s, rate in zip(space.states, lowered.rates, strict=True)}
    draws = random.Random(1)
    points = [_point(lowered, draws, spread) for spread in (1.0, 1.0, 9.0, 4.0) for _ in range(POINTS // 4)]
    pairs = {name: (rates[name], lowered.outputs[OUTPUT.format(name)]) for name in names}
    agreeing = {name: [a for p in points if (a := _agree(pair, p)) is not None] for name, pair in pairs.items()}
    few = {n: "it could not be compared: it has no value at most points" for n, a in agreeing.items() if len(a) < LEAST}
    return few | {n: _difference(lowered, *pairs[n], points) for n, a in agreeing.items() if not all(a)}


def _agree(pair: tuple[Expression, Expression], point: Callable[[Leaf], float]) -> bool | None:
    """Return True if two functions and their slopes agree at a point; None if one of them has no value there."""
    leaves = _leaves(*pair)
    directions = {leaf: np.eye(len(leaves))[n] for n, leaf in enumerate(leaves)}
    values, slopes = Tape(pair).slopes(point, directions, len(leaves))
    if not all(map(isfinite, values)):
        return None
    sizes = np.array([abs(point(leaf)) for leaf in leaves])
    a, b = (np.zeros(len(leaves)) if s is None else np.asarray(s, dtype=float) for s in slopes)
    larger = np.maximum(abs(a), abs(b))
    scale = max(map(abs, values)) + float(np.nansum(larger * sizes))
    differing = abs(a - b) > SAME_SLOPE * larger + ROUNDED * scale / np.maximum(sizes, TINY)
    return bool(abs(values[0] - values[1]) <= SAME * scale and not differing.any())


def _point(lowered: Lowered, draws: random.Random, spread: float) -> Callable[[Leaf], float]:
    """Return a random point: what is given within a factor of its value, the states anywhere within `spread` decades below ten."""
    space, values = lowered.space, dict[Leaf, float]()

    def anywhere() -> float:
        return float(10.0 ** draws.uniform(-spread, 1.0) * draws.choice((-1.0, 1.0)))

    for role, variables in (("parameter", lowered.parameters), ("input", lowered.inputs)):
        for position, variable in enumerate(variables):
            default = space.variables[variable].value
            values[Leaf(role, position)] = default * draws.uniform(0.5, 2.0) if default else anywhere()
    values |= {Leaf("state", position): anywhere() for position in range(len(space.states))}
    values[Leaf("time", 0)] = abs(anywhere())
    values |= {Leaf("mode", position): draws.choice((0.0, 1.0)) for position in range(lowered.events.size)}
    switches = Tape(lowered.switches)
    for _ in lowered.switches:  # one may stand in the next
        values |= zip((Leaf("mode", n) for n in lowered.events.timed), switches.values(values.__getitem__), strict=True)
    return values.__getitem__


def _difference(lowered: Lowered, rate: Expression, own: Expression, points: Sequence[Callable[[Leaf], float]]) -> str:
    """Return a hint: a term of the rate that is missing or has the other sign, else a point at which the values differ."""
    terms = rate.operands if isinstance(rate, api.Apply) and rate.operator == "add" else (rate,)
    tape = Tape([rate, own, *terms])
    rows = [(row, point) for point in points if all(map(isfinite, row := tape.values(point)))]
    for n, term in enumerate(terms, 2):
        for factor, fault in ((1.0, "is missing"), (2.0, "has the other sign")):
            if rows and all(abs(r[0] - r[1] - factor * r[n]) <= SAME * max(map(abs, r)) for r, _ in rows):
                names = " and ".join(f"`{_name(lowered, leaf)}`" for leaf in _leaves(term))
                return f"the term with {names or 'a number alone'} {fault}"
    sizes = [abs(r[0] - r[1]) / max(abs(r[0]), abs(r[1]), TINY) for r, _ in rows]
    if not any(sizes):
        return "it is another function"
    (right, wrong, *_), point = rows[sizes.index(max(sizes))]
    digits = 4 + max(0, int(-log10(max(sizes))))
    place = ", ".join(f"`{_name(lowered, leaf)}` = {point(leaf):.6g}" for leaf in _leaves(rate, own))
    return f"it gives {wrong:.{digits}g} where {right:.{digits}g} is right (in SI, at {place})"


def _leaves(*expressions: Expression) -> list[Leaf]:
    """Return what expressions read, states first."""
    leaves = {s.key for x in expressions for s in api.symbols(x) if s.key.role != "mode"}
    return sorted(leaves, key=lambda leaf: (leaf.role != "state", leaf))


def _name(lowered: Lowered, leaf: Leaf) -> str:
    space = lowered.space
    states = [s.variable for s in space.states]
    variables = {"state": states, "parameter": lowered.parameters, "input": lowered.inputs}
    return space.variables[variables[leaf.role][leaf.position]].name if leaf.role in variables else "time"
