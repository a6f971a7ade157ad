"""State equations to a Python module that a person reads: it needs numpy alone, and is called as scipy's solvers do."""

from __future__ import annotations

import keyword
from collections.abc import Iterable, Iterator, Mapping, Sequence

from sympy import Basic

from ...errors import printable
from ...reduction import StateSpace
from ..numpy.body import number
from ..numpy.names import Identifiers
from ..numpy.runtime import operator_functions
from ..symbolic.formulate import formulate
from ..symbolic.python_text import (
    PythonPrinter,
    assigned,
    cited,
    filled,
    function_names,
    lines_text,
    needed_lines,
    read_by,
    targets_of,
)
from ..symbolic.state_equations import Entry, Line, NamedSymbol, Partials, StateEquations
from .targets import TextTarget

OWN = (
    "constants", "start", "derivative", "jacobian", "outputs", "equations", "partials", "unknowns", "inputs", "indicators", "holds",
    "events", "reset", "periods", "lags", "delayed", "constraints", "initial", "on", "Parameters", "SimpleNamespace", "dataclass",
    "discrete_start", "reset_partials",
)  # fmt: skip
FEW = 3  # constants that are computed where they are read
DENSE = 5  # states up to which a Jacobian is written as a matrix,
WIDE = 60  # if no entry has more characters


def write(space: StateSpace, descriptions: Mapping[str, str]) -> str:
    """Text of the module."""
    return _NumpyModule(formulate(space, descriptions)).text()


TARGET = TextTarget("numpy", ".py", write)


class _NumpyModule:
    """Writer of one module."""

    def __init__(self, equations: StateEquations) -> None:
        self.equations = e = equations
        local, fields = Identifiers(), Identifiers()
        local.taken |= {"t", "x", "z", "p", "u", "m", "c", "n", "np", "J", *OWN, *keyword.kwlist}
        self.fields = {q.symbol: fields.of(q.name) for q in e.parameters}
        shared = len(e.constant) > FEW
        self.constant = e.constant if shared else frozenset()
        names = {e.time: "t"} | {symbol: f"p.{name}" for symbol, name in self.fields.items()}
        arrays = (q.symbol for group in (e.states, e.unknowns, e.discretes, e.inputs) for q in group)
        every = (*e.lines, *e.partials.lines, *e.reset_partials.lines)
        for symbol in (*arrays, *(t for line in every for t in targets_of(line))):
            name = local.of(str(symbol))
            names[symbol] = f"c.{name}" if symbol in self.constant else name
        self.names = names
        self.printer = PythonPrinter(names, function_names(lambda row: row.in_numpy))
        self.more = f"{', m' if e.discretes else ''}, p{', u=INPUT_DEFAULTS' if e.inputs else ''}"
        self.arguments = f"t, x{self.more}{', z=None' if e.unknowns else ''}"
        self.passed = self.more.replace("=INPUT_DEFAULTS", "")

    def text(self) -> str:
        """Functions first, so that the beginning has what they call."""
        functions = [text for part in (self._explicit, self._implicit, self._hybrid, self._checks) for text in part()]
        tables = "\n".join([*self._tables(), *(f"{name} = {text}" for text, name in self.printer.tables.items())])
        parts = [
            self._beginning(),
            *(part.rstrip() for part in operator_functions(self.printer.called)),
            tables,
            self._parameters(),
            *functions,
        ]
        return "\n\n\n".join(parts) + "\n"

    # ------------------------------------------------------------ names and values
    def _beginning(self) -> str:
        e = self.equations
        words = ", in SI units. Algebraic loops are solved by Newton's method." if e.unknowns else ", in SI units."
        m = "m, " if e.discretes else ""
        example = [f"{self.fields[q.symbol]}={number(q.value)}" for q in e.parameters[:1]]
        recipe = [f"p = Parameters(){f'  # with other values: Parameters({example[0]})' if example else ''}"]
        if e.discretes:
            recipe.append("m = discrete_start(p)")
        if e.states:
            recipe += [
                f"run = scipy.integrate.solve_ivp(derivative, (0.0, 1.0), start(p), 'Radau', jac=jacobian, args=({m}p,))",
                f"y = np.array([outputs(t, x, {m}p) for t, x in zip(run.t, run.y.T)])",
            ]
        else:
            recipe.append(f"y = outputs(0.0, (), {m}p)")
        if e.states and e.indicators:
            recipe.append(
                "# Rates may jump where an item of `indicators` is zero: end the steps there (`events=`), or results are those of the step size."
            )
        if e.switches:
            recipe.append(
                "# Junctions switch: these are the equations of the start, and hold as long as `on` is what it is there."
            )
        imports = [
            "from dataclasses import dataclass",
            *(["from types import SimpleNamespace"] if self.constant else []),
        ]
        heading = [
            f'"""{e.name}: state equations of a bond graph{words}',
            "",
            *(f"    {line}" for line in recipe),
            '"""',
        ]
        return "\n".join([*heading, "", *imports, "", "import numpy as np"])

    def _tables(self) -> Iterator[str]:
        e = self.equations
        yield from _table("STATES", [(q.name, q.unit) for q in e.states])
        yield from _table("OUTPUTS", [(q.name, q.unit) for q in e.outputs])
        for heading, group in (("UNKNOWNS", e.unknowns), ("DISCRETES", e.discretes), ("INPUTS", e.inputs)):
            if group:
                yield from _table(heading, [(q.name, q.unit) for q in group])
        if e.inputs:
            yield f"INPUT_DEFAULTS = ({', '.join(number(q.value or 0.0) for q in e.inputs)},)"

    def _parameters(self) -> str:
        lines = ["@dataclass", "class Parameters:", '    """Parameters, with the values of the model."""', ""]
        for q in self.equations.parameters:
            name = "" if self.fields[q.symbol] == q.name else repr(q.name)
            words = ", ".join(w for w in (name, q.unit, q.description) if w)
            note = f"  # {printable(words)}" if words else ""
            lines.append(f"    {self.fields[q.symbol]}: float = {number(q.value)}{note}")
        return "\n".join(lines) if self.equations.parameters else "\n".join(lines[:3])

    # ------------------------------------------------------------ functions of every model
    def _explicit(self) -> Iterator[str]:
        e = self.equations
        if self.constant:
            lines = [line for line in e.lines if self.constant & {*targets_of(line)}]
            body = lines_text(lines, self.printer, "np.linalg.solve")
            body = ["c = SimpleNamespace()", *body, "return c"]
            yield _function("constants", "p", "Quantities that depend on parameters alone.", body)
        if e.states:
            yield self._vector("start", "p", "States at the start.", e.starts)
        if not e.states and not e.unknowns:
            yield self._vector("outputs", self.arguments, "Outputs; there are no states, and x is not read.", e.outputs)
        elif not e.unknowns:
            rates = "Rates of the states."
            yield self._vector("derivative", self.arguments, rates, e.rates)
            words = "Derivatives of the rates (rows) by the states (columns)."
            yield self._matrix("jacobian", self.arguments, words, e.partials, len(e.states), len(e.states))
            yield self._vector("outputs", self.arguments, "Outputs.", e.outputs)

    def _implicit(self) -> Iterator[str]:
        """Functions of a model with algebraic loops: its unknowns by Newton's method, then the rates."""
        e = self.equations
        if not e.unknowns:
            return
        n, arguments = len(e.states), f"t, x, z{self.more}"
        words = "Rates of the states, then the residuals that the unknowns z make zero."
        yield self._vector("equations", arguments, words, (*e.rates, *e.residuals))
        words = "Derivatives of the rates and residuals (rows) by states and unknowns (columns)."
        size = n + len(e.unknowns)
        yield self._matrix("partials", arguments, words, e.partials, size, size)
        guesses = [q.value or 0.0 for q in e.unknowns]
        yield NEWTON.format(more=self.more, passed=self.passed, states=n, guesses=guesses, alike=self._alike())
        yield self._vector("outputs", self.arguments, "Outputs.", e.outputs)

    def _alike(self) -> list[list[int]]:
        """Return the unknowns of each one's unit, which share a magnitude; all lists of one length."""
        units = [q.unit for q in self.equations.unknowns]
        return [[j if unit == other else i for j, other in enumerate(units)] for i, unit in enumerate(units)]

    def _hybrid(self) -> Iterator[str]:
        """Functions for events, discrete variables and delays."""
        e, arguments = self.equations, self.arguments
        indicators = [Entry(i.owner, i.value, "", i.span) for i in e.indicators]
        words = "Left side less right side of each condition: an event is at a zero."
        yield from self._vectors(("indicators", arguments, words, indicators))
        yield from self._vectors(("discrete_start", "p", "Discrete variables at the start.", e.discrete_starts))
        if e.events:
            events = [Entry(event.words, event.condition, "", event.span) for event in e.events]
            words = "Truth of each event's condition: the event is where it becomes true."
            yield self._vector("events", arguments, words, events)
            yield self._reset()
            yield from self._sampling()
        lags = [Entry(entry.name, lag, "s", entry.span) for entry, lag in e.delays]
        yield from self._vectors(
            ("on", arguments, "Truth of the conditions of the switched junctions; the equations are those at the start.", e.switches),
            ("lags", "p", "Delays of the last inputs.", lags),
            ("delayed", arguments, "Values that the last inputs will have, later by their lags.", [d for d, _ in e.delays]),
        )  # fmt: skip

    def _checks(self) -> Iterator[str]:
        e, arguments = self.equations, self.arguments
        return self._vectors(
            ("initial", arguments, "Residuals of the starts given to computed quantities: zero at the start.", e.initial),
            ("constraints", arguments, "Constraint residuals, then their rates: zero along a run.", e.constraints),
            ("holds", arguments, "Truth of the requirements of the model.", e.requirements),
        )  # fmt: skip

    # ------------------------------------------------------------ bodies
    def _body(self, results: Iterable[Basic], more: Sequence[Line] = ()) -> list[str]:
        """Lines that name the items of the arguments, then those that the results need."""
        e, results = self.equations, list(results)
        lines = needed_lines((*e.lines, *more), results)
        own = [line for line in lines if self.constant.isdisjoint(targets_of(line))]
        read = {s for x in results for s in x.free_symbols} | {s for line in own for s in read_by(line)}
        text: list[str] = []
        if read & self.constant:
            text.append("c = constants(p)")
        groups: Sequence[tuple[str, Sequence[NamedSymbol]]] = (("x", e.states), ("m", e.discretes), ("u", e.inputs))
        for letter, group in groups:
            text += self._unpacked(letter, group, read)
        if read & {q.symbol for q in e.unknowns}:
            text += self._unpacked("z", e.unknowns, read)
        return text + lines_text(own, self.printer, "np.linalg.solve")

    def _unpacked(self, letter: str, group: Sequence[NamedSymbol], read: set[Basic]) -> list[str]:
        names = [self.names[q.symbol] if q.symbol in read else "_" for q in group]
        if all(name == "_" for name in names):
            return []
        text = f"{', '.join(names)}{',' * (len(names) == 1)}"
        return [f"{text} = {letter}"] if len(text) < 100 else ["(", *filled(text), f") = {letter}"]

    def _vectors(self, *rows: tuple[str, str, str, Sequence[Entry]]) -> Iterator[str]:
        """Yield the functions that have results."""
        return (self._vector(*row) for row in rows if row[3])

    def _vector(self, name: str, arguments: str, words: str, entries: Sequence[Entry]) -> str:
        body = self._body(entry.value for entry in entries)
        unknown = {q.symbol for q in self.equations.unknowns}
        if unknown and arguments.endswith("z=None") and any(line.endswith("= z") for line in body):
            body.insert(0, f"z = unknowns(t, x{self.passed}) if z is None else z")
        texts = [self.printer.text(entry.value) for entry in entries]
        whole = f"return np.array([{', '.join(texts)}], dtype=float)"
        if len(whole) < 100:
            return _function(name, arguments, words, [*body, whole])
        rows = [
            line
            for text, entry in zip(texts, entries, strict=True)
            for line in ((f"    {text},  # {printable(entry.name)}",) if len(text) < 100 else filled(f"{text},"))
        ]
        return _function(name, arguments, words, [*body, "return np.array([", *rows, "], dtype=float)"])

    def _matrix(self, name: str, arguments: str, words: str, partials: Partials, rows: int, columns: int) -> str:
        entries = partials.entries
        body = self._body(entries.values(), partials.lines)
        text = {place: self.printer.text(x) for place, x in entries.items()}
        if max(rows, columns) <= DENSE and max(map(len, text.values()), default=0) < WIDE:
            lines = [f"    [{', '.join(text.get((i, j), '0') for j in range(columns))}]," for i in range(rows)]
            body += ["return np.array([", *lines, "], dtype=float)"]
        else:
            body.append(f"J = np.zeros(({rows}, {columns}))")
            for (i, j), x in text.items():
                body += assigned(f"J[{i}, {j}]", x)
            body.append("return J")
        return _function(name, arguments, words, body)

    def _sampling(self) -> Iterator[str]:
        """Functions for the instants of sampled events: what is zero for all of them is left out."""
        sampled = [event for event in self.equations.events if event.sampling]
        for column, name, words in (
            (0, "periods", "Periods of the sampled events, in their order."),
            (1, "offsets", "Each sampled event acts so much after the multiples of its period."),
            (2, "delays", "And so much later, because it sets what the event before it has computed."),
            (3, "jitters", "And later by a random part of this, equal for an event and the one that is late."),
        ):
            entries = [Entry(e.words, e.sampling[column], "s", e.span) for e in sampled]
            if any(entry.value != 0 for entry in entries):
                yield self._vector(name, "p", words, entries)

    def _reset(self) -> str:
        """State and discrete variables after an event."""
        e = self.equations
        resets = [(k, reset, event) for k, event in enumerate(e.events) for reset in event.resets]
        targets = {q.symbol: f"x[{i}]" for i, q in enumerate(e.states)} | {
            q.symbol: f"m[{i}]" for i, q in enumerate(e.discretes)
        }
        body = self._body(x for _, r, _ in resets for x in (r.value, *(() if r.target in targets else (r.target,))))
        body.append(f"x = np.array(x, dtype=float){'; m = np.array(m, dtype=float)' if e.discretes else ''}")
        for k, event in enumerate(e.events):
            body.append(f"if event == {k}:  # {cited(event.span, event.words)}")
            lines = [
                f"    {targets[r.target]} = {self.printer.text(r.value)}" for r in event.resets if r.target in targets
            ]
            computed = [r for r in event.resets if r.target not in targets]
            if computed:
                wanted = ", ".join(f"{self.printer.text(r.value)} - {self.names[r.target]}" for r in computed)
                rows = [e.reset_targets.index(r.target) for r in computed]
                lines.append(f"    x += np.linalg.lstsq(reset_partials(t, x{self.passed})[{rows}], [{wanted}])[0]")
            body += lines or ["    pass"]
        body.append(f"return x{', m' if e.discretes else ''}")
        text = _function(
            "reset",
            f"event, {self.arguments}",
            f"State{' and discrete variables' * bool(e.discretes)} after an event, by its number.",
            body,
        )
        if not e.reset_targets:
            return text
        words = "Derivatives of what events set and states compute (rows) by the states (columns)."
        size = len(e.reset_targets), len(e.states)
        return self._matrix("reset_partials", self.arguments, words, e.reset_partials, *size) + "\n\n\n" + text


NEWTON = '''def unknowns(t, x{more}, z=None):
    """Unknowns of the algebraic loops by Newton's method, with steps halved where they make the residuals larger."""
    z = np.array({guesses}) if z is None else np.array(z, dtype=float)
    for _ in range(100):
        residual = equations(t, x, z{passed})[{states}:]
        step = np.linalg.solve(partials(t, x, z{passed})[{states}:, {states}:], residual)
        if np.all(np.abs(step) <= 1e-10 * np.abs(z) + 1e-14 * np.abs(z[{alike}]).max(axis=1)):
            return z - step
        for _ in range(40):
            if np.linalg.norm(equations(t, x, z - step{passed})[{states}:]) <= np.linalg.norm(residual):
                break
            step = step / 2
        z = z - step
    raise ArithmeticError(f"an algebraic loop has no solution at t = {{t}}")


def derivative(t, x{more}):
    """Rates of the states."""
    return equations(t, x, unknowns(t, x{passed}){passed})[:{states}]


def jacobian(t, x{more}):
    """Derivatives of the rates (rows) by the states (columns), along the solutions of the algebraic loops."""
    whole, n = partials(t, x, unknowns(t, x{passed}){passed}), {states}
    return whole[:n, :n] - whole[:n, n:] @ np.linalg.solve(whole[n:, n:], whole[n:, :n])'''


def _function(name: str, arguments: str, words: str, body: Sequence[str]) -> str:
    return "\n".join([f"def {name}({arguments}):", f'    """{words}"""', *(f"    {line}" for line in body)])


def _table(heading: str, rows: Sequence[tuple[str, str]]) -> Iterator[str]:
    if len(rows) <= 2:
        yield f"{heading} = ({''.join(f'({n!a}, {u!a}), ' for n, u in rows).rstrip()})  # name, SI unit"
        return
    yield f"{heading} = (  # name, SI unit"
    yield from (f"    ({name!a}, {unit!a})," for name, unit in rows)
    yield ")"
