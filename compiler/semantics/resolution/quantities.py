"""Quantities: parameters, constants, inputs, signals, outputs, and signals with memory. Each is resolved at its first use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from ...algebra.expression import ZERO, Number, select, substitute, symbols
from ...algebra.formula import Bound, Formula
from ...errors import ValuesNeeded
from ...graph.network import Named, Quantity
from ...graph.units import ONE, Dimension, Scale
from ...scene import Override
from ...source import Span
from ...syntax import tree
from ..expressions.expression_compiler import MEMORIES
from ..expressions.lists import columns_of, parts_of, place_in, shape_of, sort_of
from ..expressions.scales import scale_of
from ..expressions.template import Typed, Value
from ..names.domain_table import paths_of
from ..names.errors import (
    Cycle,
    DimensionMismatch,
    DuplicateName,
    MissingValue,
    NotStatic,
    TooMany,
    WrongType,
    WrongValue,
)
from ..names.scope import Array, InstanceEntry, Items, Pending, Scalar, Scope
from ..names.statement_errors import AlreadyTold, Wrong, describe, suggestion, unit_hint, wrong_unit
from .cycles import counted, refuse_bare, refuse_other_readings
from .elaboration_cache import ElaborationCache
from .memories import MemoryResolver, constant
from .resolver import SHOWN
from .texts import is_text, text_of

# Their values are known before the run; of a mode the first one, of the unknown of a `solve` the guess.
UNCHANGING_ROLES = ("parameter", "constant", "mode", "solve")
MAXIMUM_ROW = 40  # quantities that wait for one another at once


class QuantityResolver(MemoryResolver):
    """Resolver of quantities, each once. A cycle is found at the reference that closes it."""

    def __init__(self, overrides: Iterable[Override], part: bool, known: ElaborationCache) -> None:
        super().__init__(overrides, part, known)
        self._guessing: list[str] = []  # signals of loops whose units are being looked for
        self._loops: dict[str, Scalar] = {}  # signals that depend on themselves, as they are read within
        self.solves: list[tuple[Scope, tree.Quantities, tuple[Pending, ...]]] = []
        self._waiting = 0  # quantities that are being resolved, one because of the other
        self._entered: set[int] = set()  # those whose turn comes

    # ------------------------------------------------------------ quantities
    def quantity(self, pending: Pending) -> Scalar | Items:
        """Resolve a quantity: its dimension, its definition, and its value if it is constant during a run."""
        if pending.state in ("done", "guessed"):
            self.guesses += pending.state == "guessed"
            assert pending.result is not None
            return pending.result
        if pending.state == "broken":
            raise AlreadyTold
        if pending.state == "busy" and self._inferring:
            self.guesses += 1
            return Scalar(Quantity(pending.name), self._guessed_unit(pending), pending.role, pending.name)
        if pending.state == "busy" and (loop := self._in_loop(pending)) is not None:
            return loop
        if pending.state == "busy":
            pending.state = "broken"
            what = "These depend on each other"
            if pending.role in ("signal", "output", "input"):
                what = "A signal depends on itself without a storage between"
            busy = [p.name for p in self.pending if p.state == "busy"]
            chain = [pending.name, *(name for name in busy if name != pending.name), pending.name]
            self.tell(Cycle(pending.item.span, what, " -> ".join(chain)))
            raise AlreadyTold
        if not self._inferring:
            self._resolve_what_it_reads(pending)
        if pending.state != "waiting":
            return self.quantity(pending)
        if self._waiting >= MAXIMUM_ROW:
            raise Wrong(self._too_long(pending))
        pending.state, guesses = "busy", self.guesses
        self._waiting += 1
        try:
            pending.result = self._resolve_quantity(pending)
            if pending.name in self._loops:
                self._close(pending, self._loops[pending.name])
        except (Wrong, AlreadyTold) as problem:
            pending.state = "broken"
            if isinstance(problem, Wrong):
                self.tell(problem.diagnostic)
            raise AlreadyTold from None
        finally:
            self._waiting -= 1
        pending.state = "done"
        if self._inferring and self.guesses > guesses:
            pending.state = "guessed"
            self._guessed_quantities.append(pending)
        return pending.result

    def _in_loop(self, pending: Pending) -> Scalar | None:
        """Signal that depends on itself, read before its definition is known; None for a list, or what must be known before the run.

        Its unit is the declared one, or that of its definition, in which signals that are being resolved fit any unit.
        """
        if pending.role not in ("signal", "output", "input"):
            return None
        if pending.name not in self._loops:
            if pending.value is None or isinstance(pending.value, tree.VectorSyntax):
                return None
            self._guessing.append(pending.name)
            try:
                value = self._guessed(pending.value, pending.scope)
            finally:
                self._guessing.pop()
            if isinstance(value, tuple):
                return None
            unit = None if pending.item.unit is None else scale_of(pending.item.unit).dimension
            if unit is None and pending.role == "input" and pending.item.value is not None:
                unit = self._looked_at(pending.item.value, pending.owner)
            dimension = None if pending.owner.plain else unit or value.dimension or ONE
            loop = Scalar(Quantity(pending.name), dimension, pending.role, pending.name, truth=value.truth)
            self._loops[pending.name] = loop
        return self._loops[pending.name]

    def _guessed_unit(self, pending: Pending) -> Dimension | None:
        """Unit of a signal that is being resolved: the declared one, or if a loop looks for it that of its definition; else None, which fits any."""
        if pending.item.unit is not None:
            return scale_of(pending.item.unit).dimension
        value = pending.value
        memory = value is None or (isinstance(value, tree.Call) and value.function in MEMORIES)
        if not self._guessing or pending.name in self._guessing or memory or isinstance(value, tree.VectorSyntax):
            return None
        self._guessing.append(pending.name)
        try:
            assert value is not None
            return self._looked_at(value, pending.scope)
        finally:
            self._guessing.pop()

    def _close(self, pending: Pending, loop: Scalar) -> None:
        """Mark a signal as one that a run solves for, and check that it is what was read of it."""
        result = pending.result
        if not isinstance(result, Scalar) or result.truth is not loop.truth:
            what = "A signal depends on itself, now as a number and now as a list or condition"
            raise Wrong(Cycle(pending.item.span, what, f"{pending.name} -> {pending.name}"))
        if loop.dimension is not None and result.dimension != loop.dimension:
            what = f"`{pending.item.name}` depends on itself, as {describe(loop.dimension)}, but its definition is {describe(result.dimension)}"
            hint = f"Say its unit: `{pending.role} {pending.item.name} : m = …`, and check its terms."
            raise Wrong(DimensionMismatch(pending.item.span, what, hint))
        self.quantities[pending.name] = replace(self.quantities[pending.name], role="loop")

    def _too_long(self, pending: Pending) -> TooMany:
        if self._inferring:  # an integral's rate is read later; only its unit is inferred now
            hint = f"Say the unit of one of them: `{pending.role} {pending.item.name} : m = …`."
            return TooMany(
                pending.item.span, "Integrals in a row that take their units from one another", MAXIMUM_ROW, hint
            )
        return TooMany(pending.item.span, "Quantities that read each other in a ring", MAXIMUM_ROW)

    def _resolve_what_it_reads(self, pending: Pending) -> None:
        """Resolve the quantities that a quantity depends on, in an order in which each only needs resolved ones.

        Without this, long chains of quantities would recurse too deeply. Quantities missed here are resolved at their first use.
        """
        rows = [(pending, self._reads(pending))]
        entered = {id(pending)} - self._entered
        self._entered |= entered
        while rows:
            current, reads = rows[-1]
            following = next((p for p in reads if p.state == "waiting" and id(p) not in self._entered), None)
            if following is not None:
                entered.add(id(following))
                self._entered.add(id(following))
                rows.append((following, self._reads(following)))
                continue
            rows.pop()
            if rows and current.state == "waiting":
                self.guard(self.quantity, current)
        self._entered -= entered

    def _reads(self, pending: Pending) -> Iterator[Pending]:
        """Quantities that its value names. Those in an integral are left out: they are read when all names are known."""
        value = pending.value
        if value is None or (isinstance(value, tree.Call) and value.function == "integral"):
            return
        for path in paths_of(value):
            entry = pending.scope.find(path.head)
            for step in path.steps:
                if isinstance(entry, InstanceEntry) and isinstance(step, tree.Member):
                    entry = entry.scope.entries.get(step.name)
                elif isinstance(entry, Array) and isinstance(step, tree.Index):
                    try:
                        entry = entry.items.get(self.index_of(step, pending.scope) or ())
                    except (Wrong, AlreadyTold):
                        entry = None  # reported when it is read
            if isinstance(entry, Pending):
                yield entry

    def _bare(self, pending: Pending, guesses: int) -> Dimension | None:
        """Dimension of a definition that has none: of a bare number, unless it read since then what is not resolved yet."""
        return None if pending.owner.plain or self.guesses > guesses else ONE

    def _resolve_quantity(self, pending: Pending) -> Scalar | Items:
        item, guesses = pending.item, self.guesses
        override = self.overrides.get(pending.name)
        if override is not None and pending.role in ("parameter", "input"):
            self.used_overrides.add(pending.name)
        else:
            override = None
        text = is_text(self, pending)
        if (item.choices or text) and override is not None and override.value is None:
            line = item.span.source.line(item.span.line).strip()  # structure: a run's program is made for one choice
            raise ValuesNeeded({pending.name: f"line {item.span.line}, `{line[:SHOWN]}`"})
        if item.choices:
            return self._choice(pending, override)
        if text:
            if pending.value is None and override is None:
                self._without_value(pending, ONE)
                del self.quantities[pending.name]  # of a part: a text is none
                raise AlreadyTold
            return text_of(self, pending, override)
        unit = scale_of(item.unit) if item.unit is not None else None
        if unit is not None and pending.owner.plain:
            raise Wrong(WrongType(item.span, "A bare number", "a unit", "A `plain model` has no units."))
        declared = None if unit is None else unit.dimension
        if item.value is None or (pending.is_default and override is None):
            entered = self._settled(pending, override, declared, unit)
            return _as_signal(entered) if pending.role == "solve" else entered
        default = self.template(item.value, pending.owner, unit).value
        if declared is None:  # the default gives the dimension; a bare zero is a bare number
            declared = self._dimension(default) or self._bare(pending, guesses)
        entered = self._settled(pending, override, declared, unit)
        # The default also says whether it is a truth: a place of the text that reads it is compiled once for all instances.
        truth = isinstance(default, Typed) and default.truth
        if not isinstance(entered, Scalar):
            return entered
        number = getattr(self.quantities.get(pending.name), "value", None)
        if truth and number not in (None, 0.0, 1.0):
            words = f"{number:g}"
            raise Wrong(
                WrongValue(item.span, item.name, pending.owner.definition.name, words, "It is `true` or `false`.")
            )
        return replace(entered, truth=truth)

    def _choice(self, pending: Pending, override: Override | None) -> Scalar:
        """A parameter that is one of several words: the number of its word, from 1, which is never an argument of a program."""
        item, words = pending.item, tuple(word for word, _ in pending.item.choices)
        for number, (word, span) in enumerate(item.choices):
            if word in words[:number]:
                raise Wrong(DuplicateName(span, word, item.choices[words.index(word)][1]))
        if pending.role not in ("parameter", "mode"):
            hint = "Only a parameter or a mode is one of several words."
            raise Wrong(WrongType(item.choices[0][1], "A number", "a choice", hint))
        value = override.value if override is not None else pending.value
        if value is None:
            entered = self._without_value(pending, ONE)
            return replace(entered, choices=words)
        hint = f"It can be: {', '.join(words)}."
        if isinstance(value, float):
            if value not in range(1, len(words) + 1):
                raise Wrong(WrongValue(item.span, item.name, pending.owner.definition.name, f"{value:g}", hint))
            return Scalar(value, ONE, "parameter", pending.name, choices=words)
        word = value.words if isinstance(value, tree.PathSyntax) else ""
        if word in words:
            return self._chosen(pending, 1.0 + words.index(word))
        scope = self.root if override is not None else pending.scope
        if isinstance(value, tree.PathSyntax) and scope.find(value.head) is not None:
            other = self.lookup(value, scope)
            if isinstance(other, Scalar) and other.choices == words and isinstance(other.reference, float):
                return self._chosen(pending, other.reference)
        hint = suggestion(value.span.words.strip('"'), words, hint)
        raise Wrong(WrongValue(value.span, item.name, pending.owner.definition.name, value.span.words, hint))

    def _chosen(self, pending: Pending, number: float) -> Scalar:
        """A parameter that is the word with a number, or a mode that begins with it."""
        words = tuple(word for word, _ in pending.item.choices)
        if pending.role == "parameter":
            return Scalar(number, ONE, "parameter", pending.name, choices=words)
        entered = self._enter_quantity(pending, "", Bound(constant(number), ()), ONE, pending.item.span)
        return replace(entered, choices=words)

    def _settled(
        self, pending: Pending, override: Override | None, declared: Dimension | None, unit: Scale | None
    ) -> Scalar | Items:
        """Quantity from what is set from outside, else from its binding or default."""
        if override is None:
            return self._valued(pending, pending.value, pending.scope, declared, unit if pending.is_default else None)
        if override.value is None:
            return self._enter_later(pending, "", declared, pending.item.span)
        if isinstance(override.value, float):
            return self._enter_quantity(pending, "", Bound(constant(override.value), ()), declared, pending.item.span)
        return self._valued(pending, override.value, self.root, declared, None)

    def _valued(
        self,
        pending: Pending,
        value: tree.ExpressionSyntax | None,
        scope: Scope,
        declared: Dimension | None,
        unit: Scale | None,
    ) -> Scalar | Items:
        """Quantity from its value, which is read in `scope`. Bare numbers in it are in `unit`."""
        if value is None:
            return self._without_value(pending, declared)
        if isinstance(value, tree.Call) and value.function == "integral" and len(value.arguments) == 2:
            if pending.role in UNCHANGING_ROLES:
                raise Wrong(NotStatic(value.span, _known(pending), f"{value.function}(…)"))
            return self._integral(value, scope, pending.name, pending.role, declared, pending.item.description or "")
        guesses = self.guesses
        template = self.template(value, scope, unit)
        if pending.role in UNCHANGING_ROLES:
            self.require_static(template, scope, _known(pending))
        units = self._checked_units(pending, template.value, value, declared)
        refuse_other_readings(self, value, scope, pending.item, pending.owner)
        if declared is None and self.guesses > guesses:
            units = [part.dimension for part in parts_of(template.value)]
        bounds = [self.bind(template, f, scope) for f in template.formulas]
        if isinstance(template.value, tuple):
            items = tuple(
                self._enter_quantity(pending, place_in(template.value, i), bound, unit, value.span)
                for i, (bound, unit) in enumerate(zip(bounds, units, strict=True))
            )
            return Items(pending.name, items, columns_of(template.value))
        bound, (dimension,) = bounds[0], units
        if template.value.truth and pending.role == "solve":
            raise Wrong(WrongType(value.span, "A number", "a condition", "A guess is a number near the solution."))
        if template.value.truth:
            truth = select(bound.formula.expression, Number(1.0), ZERO)
            bound = Bound(Formula(bound.formula.arity, truth), bound.arguments)
        entered = self._enter_quantity(pending, "", bound, dimension, value.span)
        return replace(entered, truth=True) if template.value.truth else entered

    def _without_value(self, pending: Pending, declared: Dimension | None) -> Scalar:
        """Quantity that has no value, which is allowed only in a part."""
        item = pending.item
        if not self.part and pending.role != "solve":
            roles = {"parameter": "Parameter", "input": "Input", "constant": "Constant", "mode": "Mode"}
            role = roles.get(pending.role, "Signal")
            settable = pending.role in ("parameter", "input")
            ways = f', or set it: in an instance `{{ {item.name} = … }}`, on the command line of a run `--set "{pending.name}=…"`'
            instance = pending.owner.base().stands
            self.tell(MissingValue(item.span, role, pending.name, ways if settable else "", instance))
            raise AlreadyTold
        self.quantities[pending.name] = Named(
            pending.name, pending.role, str(declared or ONE), None, None, item.span, item.description or ""
        )
        return Scalar(Quantity(pending.name), declared or ONE, pending.role, pending.name)

    def _checked_units(
        self, pending: Pending, typed: Value, value: tree.ExpressionSyntax, declared: Dimension | None
    ) -> list[Dimension | None]:
        """Unit of each number of a value: that of the declaration, or of the default there. Raises `Wrong` for others, and for a list in place of a number."""
        item, default = pending.item, typed
        if value is not item.value and item.value is not None:
            default = self.template(item.value, pending.owner, None if item.unit is None else scale_of(item.unit)).value
        if isinstance(typed, tuple) and not isinstance(default, tuple):
            hint = "Its default is a single number; give it one, or an item of the list."
            raise Wrong(WrongType(value.span, f"A single number for `{item.name}`", sort_of(typed), hint))
        if isinstance(typed, tuple) and pending.role == "input":
            raise Wrong(WrongType(value.span, "A single number", sort_of(typed), "An input is one signal."))
        own = None if item.unit is None else declared
        role = "parameter" if pending.role == "solve" else pending.role
        units = _units(default, role, own, pending.owner.plain)
        if shape_of(default) != shape_of(typed):
            if own is None and len(set(units) - {None}) > 1:
                what = f"{sort_of(default).capitalize()} for `{item.name}`"
                hint = "Its numbers have several units, so that its size is that of the default."
                raise Wrong(WrongType(value.span, what, sort_of(typed), hint))
            units = [declared if declared is not None else self._dimension(typed) or ONE] * len(parts_of(typed))
        for number, (part, unit) in enumerate(zip(parts_of(typed), units, strict=True)):
            if part.dimension in (None, unit):
                continue
            name = item.name + place_in(typed, number)
            here = f"{'here it' if isinstance(typed, tuple) else f'`{value.span.text}`'} is {describe(part.dimension)}"
            what, hint = f"`{name}` is {describe(unit)}, but {here}", unit_hint(part.dimension, unit, value)
            if unit is None:
                hint = f"Give the zero in the default the unit that it stands for: `0 [{part.dimension}]`."
            raise Wrong(DimensionMismatch(value.span, what, hint))
        return units

    def _enter_quantity(
        self, pending: Pending, suffix: str, bound: Bound, dimension: Dimension | None, span: Span
    ) -> Scalar:
        name = pending.name + suffix
        role = pending.role
        if dimension is None and role != "output" and not pending.owner.plain:
            if role == "solve":
                raise Wrong(
                    WrongType(span, f"A guess with a unit for `{name}`", "a zero without one", "Write `0 [N]`.")
                )
            if name in self.overrides:
                self.used_overrides.add(name)
                hint = "Give the zero in the default the unit that it stands for: `0 [N]`."
                raise Wrong(
                    WrongType(span, f"Zero for `{name}`, as in its default without a unit,", "another number", hint)
                )
            return Scalar(0.0, None, "constant", name)
        if suffix and name in self.overrides and role == "parameter":
            self.used_overrides.add(name)
            override = self.overrides[name].value
            if override is None:
                return self._enter_later(pending, suffix, dimension, span)
            if isinstance(override, float):
                bound = Bound(constant(override), ())
            else:
                refuse_bare(override, name, counted(self, pending.owner, pending.item, suffix))
                template = self.template(override, self.root)
                self.require_static(template, self.root, _known(pending))
                found = self._dimension(template.value)
                if isinstance(template.value, tuple):
                    raise Wrong(WrongType(override.span, f"A single number for `{name}`", "a list"))
                if found is not None and found != dimension:
                    raise wrong_unit(f"`{name}`", dimension, override, found)
                bound = self.bind(template, template.formulas[0], self.root)
        value = self.value_of(bound, span, decides=False) if role in ("parameter", "constant") else None
        if role == "constant" and value is not None and _reads_nothing(bound):
            return Scalar(value, dimension, role, name)  # a number with a name: nothing is left to be computed
        item, own = pending.item, counted(self, pending.owner, pending.item, suffix)
        self.quantities[name] = Named(
            name, role, str(dimension or ONE), bound, value, item.span, item.description or "", counted=own
        )
        return Scalar(Quantity(name), dimension, role, name)

    def _enter_later(self, pending: Pending, suffix: str, dimension: Dimension | None, span: Span) -> Scalar:
        """Enter a number that only a run knows, a parameter or an input, as an argument of the program."""
        name = pending.name + suffix
        description, own = pending.item.description or "", counted(self, pending.owner, pending.item, suffix)
        self.quantities[name] = Named(
            name, "parameter", str(dimension or ONE), None, None, span, description, counted=own
        )
        return Scalar(Quantity(name), dimension, pending.role, name)


def _known(pending: Pending) -> str:
    """A quantity whose value is known before the run, in words."""
    return f"The {pending.role.replace('solve', 'guess of')} `{pending.name}`"


def _as_signal(entered: Scalar | Items) -> Scalar | Items:
    """An unknown as it is read."""
    if isinstance(entered, Items):
        return replace(entered, items=tuple(replace(item, role="signal") for item in entered.items))
    return replace(entered, role="signal")


def _units(value: Value, role: str, declared: Dimension | None, plain: bool) -> list[Dimension | None]:
    """Unit of each number of a value that is its own default.

    A zero without a unit has that of the others, so that it can be set; in a matrix that nobody sets, and where the others have
    several, it stays a zero that fits any unit (`None`).
    """
    parts = parts_of(value)
    if declared is not None:
        return [declared] * len(parts)
    own = list(dict.fromkeys(part.dimension for part in parts if part.dimension is not None))
    free = not plain and (len(own) > 1 or (columns_of(value) > 0 and role != "parameter"))
    return [p.dimension or (None if free else (*own, ONE)[0]) for p in parts]


def _reads_nothing(bound: Bound) -> bool:
    """Return True if only numbers are left after folding: `a*sin(0)` does not read `a`."""
    if all(isinstance(a, float) for a in bound.arguments):
        return True
    arguments = [Number(a) if isinstance(a, float) else None for a in bound.arguments]
    return not any(symbols(substitute(bound.formula.expression, lambda s: arguments[s.key] or s)))
