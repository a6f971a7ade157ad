"""A model of the language from sorted equations: its statements, with units where the file has some.

Expressions are written in the dimension that their place needs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from compiler.api import Dimension, NewNames, number_text, printable

from .events import EventClause, EventClauses
from .functions import BARE, WRITTEN
from .normal_form import NormalForm, Pair
from .parse import FlatModel, text_of
from .start import Starts
from .system import SortedSystem
from .tree import FALSE, ZERO, ComponentDeclaration, Term, named, names_in
from .units import ONE, Dimensions, declared_dimension, is_alike

SEPARATE = 20  # states without a dimension that are bare numbers one after the other, others all at once
CHOICE, OR, AND, NOT, COMPARE, SUM, PRODUCT, POWER, ATOM = range(9)  # what binds ever closer


class ModelWriter:
    """Writer of one model. Values that are not known before a run are refused."""

    def __init__(
        self, model: FlatModel, form: NormalForm, system: SortedSystem, starts: Starts, clauses: EventClauses
    ) -> None:
        self.model, self.form, self.system, self.starts, self.clauses = model, form, system, starts, clauses
        self.declared, events = model.declared, clauses.events
        # All that is written with expressions: what is named, and by what it is.
        self.equations = [(named(n), t) for terms in (form.values, starts.terms, system.definitions) for n, t in terms.items()]  # fmt: skip
        self.equations += [pair[:2] for _, pairs in system.rings for pair in pairs]
        self.equations += [(named(n), t) for event in events for n, t in event.settings.items()]
        self.equations += [(e.condition, e.condition) for e in events if isinstance(e.condition, Term)]
        self.equations += [(condition, condition) for condition, _ in form.requirements]
        self.outputs = self._outputs()
        self.dimensions = self._dimensions()
        self.names, self.hidden = self._names()
        self.expressions = ExpressionWriter(self.names, self.dimensions)

    def _dimensions(self) -> Dimensions:
        units = {n: declared_dimension(item) for n, item in self.declared.items()}
        dimensions = Dimensions(all(d in (None, ONE) for d in units.values()))
        for name, dimension in units.items():
            if dimension is not None:
                dimensions.set(name, dimension)
        open_states = [name for name in self.form.states if units[name] is None][:SEPARATE]
        for name in ["time", *open_states] if not dimensions.is_plain else ():
            if name == "time" or name not in dimensions.of:
                dimensions.set(name, ONE)
                dimensions.infer(self.equations)
        for name in [*self.declared, *self.clauses.latches]:
            dimensions.set(name, ONE)
        return dimensions

    def _outputs(self) -> set[str]:
        """Return what a run reports: the outputs of the file, else its states, else all that is computed."""
        changing = {n: d for n, d in self.declared.items() if not d.is_given and n not in self.form.samples}
        public = {n for n, d in changing.items() if "protected" not in d.prefixes}
        outputs = {n for n, d in changing.items() if "output" in d.prefixes}
        return outputs or self.form.states.keys() & public or public

    def _names(self) -> tuple[dict[str, str], dict[str, str]]:
        """Return the word for each name, and that of the output for those that are modes or solved."""
        new = NewNames({"time", *(word for word, _ in WRITTEN.values())})
        words = {name: new.new(name) for name in self.declared} | {"time": "time"}
        hidden = {n: words[n] for n in words if n in self.outputs and (n in self.form.modes or n in self.system.solved)}
        words |= {n: new.new(f"{n}_{'now' if n in self.form.modes else 'solved'}") for n in hidden}
        words |= {f"der({n})": new.new(f"der_{words[n]}") for n in self.form.states}
        words |= {n: new.new(n) for n in self.clauses.latches}
        self.experiment = new.new("run")
        return words, hidden

    def _head(self, name: str, word: str = "", *, with_unit: bool = True) -> str:
        dimension = self.dimensions.of[name]
        is_bare = self.dimensions.is_plain or dimension == ONE or not with_unit
        return f"{word}{' ' * bool(word)}{self.names[name]}{'' if is_bare else f': {dimension}'}"

    def _described(self, name: str) -> str:
        item = self.declared[name]
        unit = text_of(item.attributes.get("unit", Term("text", '""')).word)
        words = [item.text, f"in {unit}" if self.dimensions.of[name] == ONE and unit not in ("", "1", "rad") else ""]
        return f' "{", ".join(filter(None, words))}"' if any(words) else ""

    def _term(self, term: Term, name: str) -> str:
        return self.expressions.quantity(term, self.dimensions.of[name])

    def _before_the_run(self, term: Term, item: ComponentDeclaration) -> Term:
        """Return a value that is known before the run; refuse one that reads what changes."""
        for name in sorted(n for n in names_in(term) if n not in self.declared or not self.declared[n].is_fixed)[:1]:
            what = f"`{printable(item.name)}` needs `{printable(name)}`, which changes, before the run"
            self.model.refuse(item.place, what, "Give it a value of parameters and numbers.")
        return term

    def text(self) -> str:
        """Return the whole model."""
        head = f"{'plain ' if self.dimensions.is_plain else ''}model {NewNames(()).new(self.model.name)} {{"
        about = [f'"{self.model.text}"'] if self.model.text else []
        return "\n".join([head, *(f"  {line}" for line in [*about, *self._statements()]), "}", ""])

    def _statements(self) -> Iterator[str]:
        yield from (self._given(item) for item in self.declared.values() if item.is_given)
        yield from (f"{self._head(name, 'mode')} = {self._start(name)}" for name in self.form.modes)
        yield from (f"mode {self.names[name]} = false" for name in self.clauses.latches)
        yield from self._computed()
        yield from (self._ring(names, pairs) for names, pairs in self.system.rings)
        yield from (f"output {word} = {self.names[n]}{self._described(n)}" for n, word in self.hidden.items())
        for event in self.clauses.events:
            yield from self._event(event)
        for condition, words in self.form.requirements:
            yield f'require {self.expressions.text(condition)} "{text_of(words)}"'
        yield from self._experiment()

    def _given(self, item: ComponentDeclaration) -> str:
        term = self.form.values.get(item.name, self.form.starts.get(item.name))
        word = "input" if "input" in item.prefixes else "constant" if item.prefixes & {"constant", "final"} else "parameter"  # fmt: skip
        if word == "input":
            term = term or (FALSE if item.kind == "Boolean" else ZERO)
        if term is None:
            return f"{self._head(item.name, 'parameter')}{self._described(item.name)}"
        is_number = self._before_the_run(term, item).kind == "number"  # in the unit of its name
        value = self.expressions.text(term, ONE) if is_number else self._term(term, item.name)
        return f"{self._head(item.name, word)} = {value}{self._described(item.name)}"

    def _start(self, name: str) -> str:
        return self._term(self._before_the_run(self.starts.terms[name], self.declared[name]), name)

    def _computed(self) -> Iterator[str]:
        """Yield states and definitions; a derivative that only its state reads stands in the integral."""
        form, definitions = self.form, self.system.definitions
        read = names_in(*(t for pair in self.equations for t in pair if t.kind != "name" or t.word not in definitions))
        words = {n: "output" if n in self.outputs and n not in self.hidden else "signal" for n in self.declared}
        for name in form.states:
            rate = f"der({name})"
            text = self._term(definitions[rate], rate) if rate in definitions and rate not in read else self.names[rate]
            yield f"{words[name]} {self.names[name]} = integral({text}, {self._start(name)}){self._described(name)}"
        for name, term in definitions.items():
            if name in self.declared:
                yield f"{words[name]} {self.names[name]} = {self._term(term, name)}{self._described(name)}"
            elif name in read:
                yield f"signal {self.names[name]} = {self._term(term, name)}"

    def _ring(self, names: list[str], pairs: list[Pair]) -> str:
        equations, unknowns = [], []
        for left, right, _ in pairs:
            dimension = self.dimensions.dimension(left) or self.dimensions.dimension(right) or ONE
            equations.append(" = ".join(self.expressions.text(side, dimension) for side in (left, right)))
        for name in names:
            guess = self.form.starts.get(name)
            value = "" if guess is None else f" = {self._term(self._before_the_run(guess, self.declared[name]), name)}"
            unknowns.append(self._head(name, with_unit=guess is None) + value)
        return f"solve {', '.join(equations)} for {', '.join(unknowns)}"

    def _event(self, event: EventClause) -> Iterator[str]:
        if isinstance(event.condition, Term):
            yield f"when {self.expressions.text(event.condition)} {{"
        else:
            period, offset = (self.expressions.text(t, self.dimensions.of["time"]) for t in event.condition)
            yield f"every {period}{'' if offset == '0' else f' offset {offset}'} {{"
        yield from (f"  {self.names[name]} = {self._term(term, name)}" for name, term in event.settings.items())
        yield "}"

    def _experiment(self) -> Iterator[str]:
        facts, seconds = (
            self.model.experiment,
            "" if self.dimensions.is_plain else " [s]" if "s" in self.names.values() else " s",
        )
        if "StopTime" in facts or self.starts.is_rest:
            begin, end = (number_text(facts.get(n, d)) for n, d in (("StartTime", 0.0), ("StopTime", 1.0)))
            options = f" {{ rtol = {facts['Tolerance']:g} }}" if 1e-13 <= facts.get("Tolerance", 0) <= 1e-2 else ""
            rest = "equilibrium; " if self.starts.is_rest else ""
            begin += seconds * (begin != "0")
            yield f"experiment {self.experiment} {{ {rest}simulate {begin} .. {end}{seconds}{options} }}"


@dataclass(frozen=True, slots=True)
class ExpressionWriter:
    """Writer of terms. `names`: the words of the language for names."""

    names: Mapping[str, str]
    dimensions: Dimensions

    def text(self, term: Term, dimension: Dimension | None = None, level: int = CHOICE) -> str:
        """Return the text of a term, in a dimension (None: its own), in brackets where it binds less than `level`."""
        written, own_level = self._fitted(term, dimension)
        return f"({written})" if own_level < level else written

    def quantity(self, term: Term, dimension: Dimension) -> str:
        """Return the text of a value that tells its unit itself, zero too."""
        is_zero = term.kind == "number" and float(term.word) == 0
        return f"0{self._unit(dimension)}" if is_zero else self.text(term, dimension)

    def _unit(self, dimension: Dimension) -> str:
        return "" if self.dimensions.is_plain or dimension == ONE else f" [{dimension}]"

    def _fitted(self, term: Term, dimension: Dimension | None) -> tuple[str, int]:
        own = self.dimensions.dimension(term) or ONE
        if term.kind == "number" or is_alike(term):  # their parts take the unit
            return self._own(term, dimension or own)
        if dimension is None or own == dimension or self.dimensions.is_plain:
            return self._own(term, own)
        if term.kind == "product":  # its first number takes the unit
            for i, (sign, part) in enumerate(zip(term.word, term.parts, strict=True)):
                if sign == "*" and part.kind == "number":
                    return self._product(term, {i: dimension / own}), PRODUCT
        return f"1{self._unit(dimension / own)}*{self.text(term, None, PRODUCT)}", PRODUCT

    def _own(self, term: Term, dimension: Dimension) -> tuple[str, int]:
        """Text, in the term's own dimension, or that of its parts."""
        parts = term.parts
        if term.kind == "number":
            number, unit = number_text(float(term.word)), self._unit(dimension)
            if number == "0" or not unit:
                return number, ATOM if number.replace(".", "").isalnum() else PRODUCT
            return (f"({number})*1{unit}", PRODUCT) if "^" in number else (f"{number}{unit}", POWER)
        if term.kind == "sum":
            items = [f"{s} {self.text(p, dimension, PRODUCT)}" for s, p in zip(term.word, parts, strict=True)]
            return " ".join(items).removeprefix("+ ").replace("- ", "-", term.word[0] == "-"), SUM
        if term.kind == "choice":
            text, last = self.text(parts[-1], dimension, OR), ""
            for condition, value in zip(parts[-3::-2], parts[-2::-2], strict=True):
                last = f"({last})" if last else text
                last = f"{self.text(value, dimension, OR)} if {self.text(condition, None, OR)} else {last}"
            return last, CHOICE
        if term.kind == "product":
            return self._product(term, {}), PRODUCT
        if term.kind == "power":
            base = ONE if self.dimensions.dimension(term) == ONE else self.dimensions.dimension(parts[0])
            return f"{self.text(parts[0], base, ATOM)}^{self.text(parts[1], ONE, ATOM)}", POWER
        if term.kind == "compare":
            left, right = (self.text(p, self._common(parts), SUM) for p in parts)
            return f"{left} {'!=' if term.word == '<>' else term.word} {right}", COMPARE
        if term.kind in ("and", "or"):
            level = AND if term.kind == "and" else OR
            return f" {term.kind} ".join(self.text(p, None, level + 1) for p in parts), level
        if term.kind == "not":
            return f"not {self.text(parts[0], None, COMPARE)}", NOT
        if term.kind == "call":
            return f"{WRITTEN[term.word][0]}({', '.join(self._arguments(term, dimension))})", ATOM
        return self.names[term.word] if term.kind == "name" else term.word, ATOM

    def _product(self, term: Term, units: Mapping[int, Dimension]) -> str:
        text = self.text(term.parts[0], units.get(0), PRODUCT)
        for i, (sign, part) in enumerate(zip(term.word, term.parts, strict=True)):
            text += f"{sign}{self.text(part, units.get(i), POWER)}" if i else ""
        return text

    def _common(self, parts: tuple[Term, ...]) -> Dimension:
        return next(filter(None, map(self.dimensions.dimension, parts)), ONE)

    def _arguments(self, term: Term, dimension: Dimension) -> list[str]:
        if term.word == "delay":
            return [self.text(term.parts[0]), self.text(term.parts[1], self.dimensions.of["time"])]
        dimension = ONE if term.word in BARE else dimension if is_alike(term) else self._common(term.parts)
        return [self.text(p, dimension) for p in term.parts]
