"""Normal form of a model: equations as pairs, with what the language has no word for written by what it has; what is not in the subset is refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from math import isinf

from compiler.api import printable

from .functions import EVENTS, REPLACED, WRITTEN
from .parse import SCALARS, FlatModel
from .tree import FALSE, TRUE, ZERO, Term, is_call, joined, named, negated, rebuilt, walk

KINDS = ("name", "number", "truth", "sum", "product", "power", "compare", "or", "and", "not", "choice", "call")
MAXIMUM_PARTS = 2_000  # of a term that stands for another one
Pair = tuple[Term, Term, Term]  # left and right side of an equation, and where it stands


@dataclass(frozen=True, slots=True)
class When:
    """One branch of a `when`: what sets what. Each of several conditions acts."""

    conditions: tuple[Term, ...]
    settings: dict[str, Term]
    place: Term


@dataclass(slots=True)
class NormalForm:
    """Equations by their kinds. `states`: names with a derivative, whose name is `der(x)`; `modes`: names that events set."""

    pairs: list[Pair] = field(default_factory=list)
    whens: list[When] = field(default_factory=list)
    initial: list[Pair] = field(default_factory=list)
    requirements: list[tuple[Term, str]] = field(default_factory=list)
    samples: dict[str, Term] = field(default_factory=dict)
    states: dict[str, None] = field(default_factory=dict)
    modes: dict[str, None] = field(default_factory=dict)
    memories: dict[str, Term] = field(default_factory=dict)  # truths by what they were
    values: dict[str, Term] = field(default_factory=dict)  # of parameters, constants and inputs
    starts: dict[str, Term] = field(default_factory=dict)


class Normalizer:
    """Maker of the normal form of a model, which notes what is refused."""

    def __init__(self, model: FlatModel) -> None:
        self.model, self.form, self.calls = model, NormalForm(), 0
        self.families = {name.partition("[")[0] for name in model.declared}
        form = self.form
        pairs: list[Pair] = []
        for item in model.declared.values():
            if "start" in item.attributes:
                form.starts[item.name] = self.term(item.attributes["start"])
            for bound, sign in (("min", ">="), ("max", "<=")) if "parameter" in item.prefixes - {"final"} else ():
                if bound in item.attributes:
                    limit = Term("compare", sign, (named(item.name), self.term(item.attributes[bound])))
                    form.requirements.append((limit, f'"{bound} of {item.name}"'))
            if item.value is not None and item.is_given:
                form.values[item.name] = self.term(item.value)
            elif item.value is not None:
                pairs.append((named(item.name), self.term(item.value), Term("name", item.name, (), item.place)))
        for equation in model.equations:
            if equation.kind == "when":
                form.whens += self._whens(equation)
            else:
                pairs += self._pairs(equation)
        form.initial = [pair for equation in model.initial for pair in self._pairs(equation)]
        for left, right, place in pairs:
            own = left.word if left.kind == "name" else ""
            if own and is_call(right, "sample"):
                form.samples[own] = right
            elif own and self.is_truth(left) and Term("call", "pre", (left,)) in walk(right):
                form.memories[own] = right
                form.modes[own] = None
            else:
                form.pairs.append((left, right, place))
        form.pairs = [(self._settled(left), self._settled(right), place) for left, right, place in form.pairs]
        moving = form.states.keys() | form.modes.keys()
        for item in model.declared.values():
            is_fixed = (
                item.attributes.get("fixed", FALSE) == TRUE and item.kind == "Real" and "discrete" not in item.prefixes
            )
            if is_fixed and not item.is_given and item.name not in moving:
                start = form.starts.get(item.name, ZERO)
                form.initial.append((named(item.name), start, Term("name", item.name, (), item.place)))
        form.requirements = [(self._settled(condition), words) for condition, words in form.requirements]

    # ------------------------------------------------------------ expressions

    def term(self, term: Term) -> Term:
        """Return an expression in words of the language; note what is refused of it."""
        if term.kind == "call" and term.word in self.model.functions:
            return self._inlined(term)
        term, original = rebuilt(term, self.term), term
        parts = term.parts
        if term.kind == "name":
            self._check_name(term)
        elif term.kind not in KINDS and not (term.kind == "named" and term.word in ("actual", "simplified")):
            self.model.refuse(original, f"an expression of the kind `{term.kind}` cannot be imported", SCALARS)
        elif (term.kind == "number" and float(term.word) == 0) or (
            term.kind == "product" and any(s == "*" and p == ZERO for s, p in zip(term.word, parts, strict=True))
        ):
            return ZERO  # of any unit
        elif term.kind == "number" and isinf(float(term.word)):
            self.model.refuse(original, f"`{term.word}` is too large a number", "Numbers have at most 308 digits.")
        elif term.kind == "call":
            return self._call(term, tuple(p.parts[0] if p.kind == "named" else p for p in parts))
        elif term.kind == "compare" and term.word in ("==", "<>") and all(map(self.is_truth, parts)):
            equal = joined("or", joined("and", *parts), joined("and", *map(negated, parts)))
            return self._bounded(equal if term.word == "==" else negated(equal), original)
        elif term.kind == "choice" and self.is_truth(parts[-1]):
            result = parts[-1]
            for condition, value in zip(parts[-3::-2], parts[-2::-2], strict=True):
                result = joined("or", joined("and", condition, value), joined("and", negated(condition), result))
            return self._bounded(result, original)
        return term

    def _inlined(self, term: Term) -> Term:
        """Return what a function of the file gives, by what it takes here."""
        function, problems = self.model.functions[term.word], len(self.model.problems)
        values = {p.word: p.parts[0] for p in term.parts if p.kind == "named"}
        values |= zip(function.takes, (p for p in term.parts if p.kind != "named"), strict=False)
        self.calls += 1
        if len(values) < len(term.parts) or values.keys() - set(function.takes) or self.calls > MAXIMUM_PARTS:
            hint = f"It has other arguments, or is called more than {MAXIMUM_PARTS} times."
            self.model.refuse(term, f"the call `{printable(term.word)}(…)`, as it is here, cannot be imported", hint)
            return ZERO

        def put(part: Term) -> Term:
            if part.kind == "name" and part.word not in values:
                self.model.refuse(
                    part, f"`{printable(part.word)}` has no value here", "A function reads what it takes and has set."
                )
            return values.get(part.word, ZERO) if part.kind == "name" else rebuilt(part, put)

        for name, line in function.lines:
            if name not in values or name not in function.takes:
                values[name] = put(line)
        result = self._bounded(put(named(function.gives)), term)
        return self.term(result) if len(self.model.problems) == problems else ZERO

    def _bounded(self, term: Term, place: Term) -> Term:
        """Return what stands for another expression, which it may read several times; refuse what grows without bound."""
        if next(islice(walk(term), MAXIMUM_PARTS, None), None) is None:
            return term
        self.model.refuse(place, "this is too long, written in words of the language", "Name its parts.")
        return ZERO

    def _check_name(self, term: Term) -> None:
        base = term.word.partition("[")[0]
        if term.word not in self.model.declared and term.word != "time" and term.word[4:-1] not in self.form.states:
            is_array = base in self.families
            what = f"the array `{printable(base)}` is not flattened" if is_array else f"`{printable(term.word)}` is not declared"  # fmt: skip
            self.model.refuse(term, what, SCALARS if is_array else "Declare it in the model.")

    def _call(self, term: Term, parts: tuple[Term, ...]) -> Term:
        name, count = term.word, len(parts)
        if (name, count) in REPLACED:
            return self._bounded(REPLACED[name, count](*parts), term)
        if name == "der" and count == 1 and parts[0].kind == "name":
            own = self.model.declared.get(parts[0].word)
            if own is not None and not own.is_given and own.kind == "Real":
                self.form.states[own.name] = None
                return Term("name", f"der({own.name})", (), term.place)
        elif WRITTEN.get(name, ("", -1))[1] == count or (name in ("sample", "reinit") and count == 2):
            return term
        if count == 1 and (
            self.is_truth(parts[0]) if name in ("edge", "change") else name == "pre" and parts[0].kind == "name"
        ):
            return term
        hint = EVENTS.get(name, "Elementary functions are there; a flattener can inline others.")
        self.model.refuse(term, f"the call `{printable(name)}(…)`, as it is here, cannot be imported", hint)
        return term

    def _settled(self, term: Term) -> Term:
        """Return a term of an equation, between events: there a mode is what it was."""
        if is_call(term, "pre") and term.parts[0].word in self.form.modes:
            return term.parts[0]
        if is_call(term, "pre", "edge", "change", "sample") or (term.kind == "name" and term.word in self.form.samples):
            self.model.refuse(term, f"`{printable(term.word)}` cannot be imported here", "It stands in a `when`.")
        return rebuilt(term, self._settled)

    def is_truth(self, term: Term) -> bool:
        """Return True for a Boolean expression."""
        if term.kind == "name" or is_call(term, "pre"):
            item = self.model.declared.get(term.word if term.kind == "name" else term.parts[0].word)
            return item is not None and item.kind == "Boolean"
        return term.kind in ("compare", "and", "or", "not", "truth") or is_call(term, "edge", "change")

    # -------------------------------------------------------------- equations

    def _pairs(self, equation: Term) -> Iterator[Pair]:
        first = equation.parts[0] if equation.parts else equation
        if equation.kind == "equal":
            yield self.term(first), self.term(equation.parts[1]), equation
        elif equation.kind == "if":
            yield from self._chosen_pairs(equation)
        elif is_call(first, "assert") and len(first.parts) >= 2:
            words = first.parts[1].word if first.parts[1].kind == "text" else '"an assertion of the model"'
            self.form.requirements.append((self.term(first.parts[0]), words))
        elif first.kind == "call" and first.word not in EVENTS:
            self.term(first)
        else:
            what = f"`{first.word}`" if first.kind == "call" else f"`{equation.kind}`"
            self.model.refuse(equation, f"{what} as an equation cannot be imported", EVENTS.get(first.word, "Write it as `a = b`."))  # fmt: skip

    def _branches(self, equation: Term) -> list[tuple[Term, Sequence[Term]]]:
        """Conditions and bodies of an `if`; that of an `else` is `true`."""
        parts = [p for p in equation.parts if p.kind not in ("description", "annotation")]
        if len(parts) % 2:
            parts.insert(-1, TRUE)
        return [(self.term(c), body.parts) for c, body in zip(parts[::2], parts[1::2], strict=True)]

    def _chosen_pairs(self, equation: Term) -> Iterator[Pair]:
        """Yield the equations of an `if`, with the choice in their right sides."""
        branches = [(c, [p for e in body for p in self._pairs(e)]) for c, body in self._branches(equation)]
        conditions = [c for c, _ in branches]
        if conditions[-1] is not TRUE or len({len(pairs) for _, pairs in branches}) > 1:
            self.model.refuse(equation, "the branches of an `if` have different numbers of equations", "Give each as many, and an `else`.")  # fmt: skip
            return
        by_name = [{left.word: right for left, right, _ in pairs if left.kind == "name"} for _, pairs in branches]
        if all(len(v) == len(p) and v.keys() == by_name[0].keys() for v, (_, p) in zip(by_name, branches, strict=True)):
            rows = [(named(n), [v[n] for v in by_name]) for n in by_name[0]]
        else:
            several = zip(*(pairs for _, pairs in branches), strict=True)
            rows = [(ZERO, [Term("sum", "+-", pair[:2]) for pair in row]) for row in several]
        yield from ((left, self.chosen(conditions, values), equation) for left, values in rows)

    def chosen(self, conditions: list[Term], values: list[Term]) -> Term:
        """Return the value of the first condition that holds; the last one is `true`."""
        if all(v == values[0] for v in values):
            return values[0]
        items = [t for pair in zip(conditions[:-1], values[:-1], strict=True) for t in pair]
        return self.term(Term("choice", "", (*items, values[-1])))

    def _whens(self, equation: Term) -> list[When]:
        """Return the branches of a `when`; as one, the first of which acts, if they set different things."""
        parts = [p for p in equation.parts if p.kind not in ("description", "annotation")]
        whens = []
        for condition, body in zip(parts[::2], parts[1::2], strict=True):
            several = condition.parts if condition.kind == "array" else (condition,)
            whens.append(When(tuple(map(self.term, several)), self._settings(body.parts), condition))
        names = list(dict.fromkeys(name for when in whens for name in when.settings))
        if all(len(when.settings) == len(names) for when in whens):  # the language refuses what one instant sets twice
            return whens
        conditions = [tuple(c.parts[0] if is_call(c, "edge") else c for c in when.conditions) for when in whens]
        if any(is_call(c, "sample", "change") for several in conditions for c in several):
            self.model.refuse(equation, "branches that set different things by `sample` or `change` cannot be imported", "Write several `when`s.")  # fmt: skip
            return whens
        rows = [
            (joined("or", *(Term("call", "edge", (c,), when.place.place) for c in several)), when.settings)
            for several, when in zip(conditions, whens, strict=True)
        ]
        truths, old = [*(t for t, _ in rows), TRUE], {n: Term("call", "pre", (named(n),)) for n in names}
        chosen = {n: self.chosen(truths, [*(s.get(n, old[n]) for _, s in rows), old[n]]) for n in names}
        return [When(tuple(c for several in conditions for c in several), chosen, whens[0].place)]

    def _settings(self, body: Iterable[Term]) -> dict[str, Term]:
        """Return what a branch of a `when` sets."""
        settings: dict[str, Term] = {}
        for equation in body:
            first = equation.parts[0] if equation.parts else equation
            if equation.kind == "if":
                branches = [(c, self._settings(inner)) for c, inner in self._branches(equation)]
                branches += [] if branches[-1][0] is TRUE else [(TRUE, {})]
                for name in dict.fromkeys(n for _, values in branches for n in values):
                    old = Term("call", "pre", (named(name),))
                    settings[name] = self.chosen([c for c, _ in branches], [v.get(name, old) for _, v in branches])
            elif equation.kind == "equal" and first.kind == "name":
                self.form.modes[self.term(first).word] = None
                settings[first.word] = self.term(equation.parts[1])
            elif is_call(first, "reinit") and len(first.parts) == 2 and first.parts[0].kind == "name":
                self.form.states[self.term(first.parts[0]).word] = None
                settings[first.parts[0].word] = self.term(first.parts[1])
            else:
                self.model.refuse(equation, "what a `when` does here cannot be imported", "It sets a variable, or has `reinit`.")  # fmt: skip
        return settings
