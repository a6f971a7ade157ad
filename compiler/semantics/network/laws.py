"""Laws of elements: their own variables separated from the quantities they read, their form checked for their kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace
from functools import lru_cache

from ...algebra.affine import affine_parts
from ...algebra.expression import ZERO, Expression, Symbol, add, divide, multiply, substitute, symbols
from ...algebra.odd_roots import with_odd_roots, with_sides
from ...graph.domains import Domain, components_of, multibond_of
from ...graph.elements import ELEMENTS, ElementKind
from ...graph.network import Law, PortVariable
from ...graph.units import JOULE
from ...source import Span
from ...syntax import tree
from ..expressions.expression_compiler import ExpressionCompiler
from ..expressions.lists import columns_of, fitted, parts_of, place_in, shape_of, sort_of
from ..expressions.template import CompiledLaw, OwnVariable, Resolve, Slot, Typed
from ..names.domain_table import paths_of
from ..names.errors import DimensionMismatch, ForeignVariable, NameClash, NeedlessM, WrongLaw, WrongType
from ..names.scope import STATIC_ROLES, Array, Scalar, Scope
from ..names.statement_errors import Wrong, describe, no_law
from .transducers import check_many_ports

# Function from a slot's path and a scope to a scalar with its role.
RoleOf = Callable[[Slot, Scope], Scalar]
Lists = Mapping[str, tuple[OwnVariable, ...]]


def own_variables(kind: str, ports: Mapping[str, Domain], variables: str) -> dict[str, OwnVariable]:
    """Map from each way in which a law may write its own variables to the variable."""
    own: dict[str, OwnVariable] = {}
    for number, (port, domain) in enumerate(ports.items()):
        for variable in variables:
            found = OwnVariable(PortVariable(number, variable), domain.dimension(variable))
            letters = {variable, domain.letter(variable)}
            if port in ("1", "2"):
                own.update({letter + port: found for letter in letters})
            elif port:
                own.update({f"{port}.{letter}": found for letter in letters})
                if variable == ELEMENTS[kind].stored:
                    own[port] = found
            else:
                own.update(dict.fromkeys(letters, found))
    return own


def _of_all_ports(kind: ElementKind, ports: Mapping[str, Domain], variables: str) -> dict[str, tuple[OwnVariable, ...]]:
    """Map from each letter for a variable of all ports of a field to the list of these variables: `e = K*q`; a domain's own if all ports share it."""
    if "" in ports or kind.group == "transducer" or len(kind.stored) > 1:
        return {}
    count, lists = len(ports) - kind.gives_heat, {}
    for variable in variables:
        listed = tuple(
            OwnVariable(PortVariable(n, variable), d.dimension(variable)) for n, d in enumerate(ports.values())
        )
        letters = {d.letter(variable) for d in list(ports.values())[:count]}
        lists.update(dict.fromkeys((variable, *(letters if len(letters) == 1 else ())), listed[:count]))
    return {letter: listed for letter, listed in lists.items() if letter not in ports}


def _of_multibonds(ports: Mapping[str, Domain], variables: str, stored: str) -> dict[str, tuple[OwnVariable, ...]]:
    """Map from each way in which a law may write a variable of a whole multibond, `a.f`, to the list of its variables; by a letter that all share, too."""
    lists: dict[str, tuple[OwnVariable, ...]] = {}
    for whole in dict.fromkeys(filter(None, map(multibond_of, ports))):
        numbers = [n for n, port in enumerate(ports) if multibond_of(port) == whole]
        domains = [list(ports.values())[n] for n in numbers]
        for variable in variables:
            own = [PortVariable(n, variable) for n in numbers]
            listed = tuple(OwnVariable(o, d.dimension(variable)) for o, d in zip(own, domains, strict=True))
            letters = {d.letter(variable) for d in domains}
            words = (variable, *letters) if len(letters) == 1 else (variable,)
            lists |= dict.fromkeys((f"{whole}.{word}" for word in words), listed)
            if variable == stored:
                lists[whole] = listed
    return lists


def _item(listed: Sequence[OwnVariable], path: tree.PathSyntax) -> OwnVariable:
    """Return one of the variables in a list, `p.F[2]`. Raises `Wrong`."""
    items = path.steps[-1].items if isinstance(path.steps[-1], tree.Index) else ()
    numbers = [i.number for i in items if isinstance(i, tree.Literal)]
    if len(numbers) != len(items) or len(items) != 1 or numbers[0] not in range(1, len(listed) + 1):
        hint = "The index is written as a number, from 1: a law is the same in each round of a `for`."
        raise Wrong(WrongType(path.span, f"An item of a list of {len(listed)}", f"`{path.words}`", hint))
    return listed[int(numbers[0]) - 1]


@lru_cache(maxsize=1024)  # most elements of a large model are of few kinds and domains
def _words_of(
    kind: str, ports: tuple[tuple[str, Domain], ...]
) -> tuple[Mapping[str, OwnVariable], Lists, Set[str], Lists]:
    """Return the words for variables in the law of an element: its own, those of its multibonds, those of other kinds, and those of all ports."""
    row, by_name = ELEMENTS[kind], dict(ports)
    variables = row.variables + row.remembered
    others = "".join(v for v in "efqp" if v not in variables)
    return (
        own_variables(row.letters, by_name, variables), _of_multibonds(by_name, variables, row.stored),
        own_variables(row.letters, by_name, others).keys(), _of_all_ports(row, by_name, variables),
    )  # fmt: skip


def compile_law(
    declaration: tree.Declaration,
    name: str,
    ports: Mapping[str, Domain],
    scope: Scope,
    resolve: Resolve,
    role_of: RoleOf,
) -> CompiledLaw:
    """Compile the law of one declared element. Raises `Wrong`."""
    definition, row = declaration.definition, ELEMENTS[declaration.kind]
    if not isinstance(definition, tree.LawSyntax):
        raise Wrong(no_law(declaration, name))
    reader = _LawReader(declaration, definition, name, ports, scope)
    compiler = reader.compiler(resolve)
    energy: Expression | None = None
    equations: list[tuple[Expression, Expression]] = []
    first = definition.equations[0].left
    if isinstance(first, tree.PathSyntax) and first.words == "energy":
        energy = reader.energy(compiler)
    else:
        equations = [pair for equation in definition.equations for pair in reader.sides(equation, compiler)]
        reader.check_form(equations)
    slots = tuple(compiler.slot_list)
    reader.check_modulation(slots, role_of)
    if row.gives_heat:
        equations.append(_heat(len(ports)))
    law, remembered = reader.remembered(Law(tuple(equations), energy, len(slots)))
    return CompiledLaw(
        law,
        slots,
        reader.stored(law),
        remembered,
        tuple(compiler.checks),
        tuple(compiler.lists.values()),
        tuple(compiler.functions.items()),
        tuple(ports),
    )


def _heat(ports: int) -> tuple[Expression, Expression]:
    """Law of the last port of an RS: its flow is the power that the other ports take, divided by its effort."""
    power = add(*(multiply(Symbol(PortVariable(p, "e")), Symbol(PortVariable(p, "f"))) for p in range(ports - 1)))
    return Symbol(PortVariable(ports - 1, "f")), divide(power, Symbol(PortVariable(ports - 1, "e")))


def _own(x: Expression) -> set[PortVariable]:
    return {s.key for s in symbols(x) if isinstance(s.key, PortVariable)}


class _LawReader:
    """Reader of the law of one declared element. Its methods raise `Wrong`."""

    def __init__(
        self, declaration: tree.Declaration, definition: tree.LawSyntax, name: str, ports: Mapping[str, Domain], scope: Scope
    ) -> None:  # fmt: skip
        self.declaration, self.definition = declaration, definition
        self.name, self.ports, self.scope = name, ports, scope
        self.row = ELEMENTS[declaration.kind]
        self.kind = self.row.letters

    def _wrong(self, what: str, hint: str, span: Span | None = None) -> Wrong:
        return Wrong(WrongLaw(span or self.definition.span, what, hint))

    def compiler(self, resolve: Resolve) -> ExpressionCompiler:
        """Compiler of the law's expressions, after a check of the names in them."""
        of_ports, multibonds, forbidden, listed = _words_of(self.declaration.kind, tuple(self.ports.items()))
        own, paths = dict(of_ports), list(paths_of(self.definition))
        # no outputs, which a law does not read
        numbers = ("parameter", "constant", "input", "signal", "solve", "mode", "index")
        if all(getattr(self.scope.find(path.head), "role", "") in numbers for path in paths if path.words in listed):
            listed = {}  # names of the model, which such a law reads
        for path in paths:
            words, found = path.words, self.scope.find(path.head)
            item = next(iter(found.items.values())) if isinstance(found, Array) else found
            if words in {**listed, **multibonds} and (role := str(getattr(item, "role", ""))) in numbers:
                raise Wrong(NameClash(path.span, words, self.name, role, ""))
            if words in own and not path.steps and found is not None and words != self.name:
                role = getattr(found, "role", "")
                if role not in numbers:
                    continue
                generic = words if self.row.sides else own[words].own.variable
                instead = "" if generic == words else f", or write the variable as `{generic}`"
                raise Wrong(NameClash(path.span, words, self.name, str(role), instead))
            is_item = bool(path.steps) and isinstance(path.steps[-1], tree.Index)  # of a list of its own variables
            listing = replace(path, steps=path.steps[:-1]).words if is_item else words
            if (group := components_of(self.ports, path.head)) and not {words, listing} & {*own, *multibonds}:
                what = f"The law of `{self.name}` uses `{words}` of a multibond"
                port = group[next(iter(group))]
                one = f"{port}.{self.ports[port].letter('f')}"
                hint = f"Write `{path.head}.f`, all its flows, or `{one}`, one of them, with a number as its index."
                raise self._wrong(what, hint, path.span)
            if is_item and listing in {**multibonds, **listed}:
                own[words] = _item({**multibonds, **listed}[listing], path)
            if words in forbidden and found is None:
                what = f"The law of `{self.declaration.kind} {self.name}` uses `{words}`; {self.row.letters} relates {self.row.relates}"
                raise self._wrong(what, self.row.advice.format(words), path.span)
        return ExpressionCompiler(self.scope, resolve, {**own, **multibonds, **listed})

    def sides(self, equation: tree.Equation, compiler: ExpressionCompiler) -> list[tuple[Expression, Expression]]:
        """Both sides of an equation, of one dimension; between lists it is an equation for each item."""
        first, second = (compiler.numbers(compiler.value(side), side.span) for side in (equation.left, equation.right))
        first, second = fitted(first, second), fitted(second, first)
        if shape_of(first) != shape_of(second) or columns_of(first):
            size = "A list" if columns_of(first) else sort_of(first).capitalize()
            hint = "An equation between lists is one for each item, so both are as long."
            raise Wrong(WrongType(equation.right.span, size, sort_of(second), hint))
        pairs = zip(parts_of(first), parts_of(second), strict=True)
        return [self._pair(equation, a, b, place_in(first, number)) for number, (a, b) in enumerate(pairs)]

    def _pair(self, equation: tree.Equation, left: Typed, right: Typed, place: str) -> tuple[Expression, Expression]:
        if left.dimension is not None and right.dimension is not None and left.dimension != right.dimension:
            missing = left.dimension / right.dimension
            what = (
                f"The two sides of the law of `{self.name}` differ{f' in {place}' * bool(place)}: `{equation.left.span.text}` is "
                f"{describe(left.dimension)}, but `{equation.right.span.text}` is {describe(right.dimension)}"
            )
            hint = (
                f"What is missing is a factor in [{missing}]: a number needs its unit, `2 [{missing}]`; "
                "a parameter's unit stands where it is declared."
            )
            raise Wrong(DimensionMismatch(equation.span, what, hint))
        return with_sides(with_odd_roots(left.expression)), with_sides(with_odd_roots(right.expression))

    def energy(self, compiler: ExpressionCompiler) -> Expression:
        """The energy of a storage."""
        name, row = self.name, self.row
        if not row.stored:
            what = f"`{name}` is {self.declaration.kind}: only C, I and IC store energy"
            raise self._wrong(what, "Write its law as an equation.")
        if len(self.definition.equations) != 1:
            raise self._wrong(f"`{name}` has an energy and further equations", "The energy alone gives all efforts.")
        typed = compiler.scalar(self.definition.equations[0].right)
        for symbol in symbols(typed.expression):
            if isinstance(symbol.key, PortVariable) and symbol.key.variable not in row.stored:
                hint = f"An energy is a function of what is stored, its {row.stored_words}, alone."
                raise self._wrong(f"The energy of `{name}` reads `{symbol.key.variable}`", hint)
        if all(d.has_power for d in self.ports.values()) and typed.dimension not in (None, JOULE):
            what = f"The energy of `{name}` must be in [N*m], but it is {describe(typed.dimension)}"
            raise Wrong(DimensionMismatch(self.definition.span, what, ""))
        if not _own(typed.expression):
            what = f"The energy of `{name}` does not depend on its own {row.stored_words}"
            raise self._wrong(what, "It would give no effort.")
        return typed.expression

    def check_form(self, equations: list[tuple[Expression, Expression]]) -> None:
        """Check that the equations are those of this kind of element."""
        name, kind, row, ports, span = self.name, self.kind, self.row, len(self.ports), self.definition.span
        transducer = row.group == "transducer"
        if transducer and "1" not in self.ports:
            check_many_ports(kind, name, equations, ports, span)
            return
        expected = 1 if transducer else ports - row.gives_heat
        if len(equations) != expected:
            what = f"`{name}` has {len(equations)} equation{'s' * (len(equations) != 1)}; {kind} with {ports} port{'s' * (ports != 1)} needs {expected}"
            less = len(equations) < expected
            every = "One equation for each port says it all; leave the others out."
            raise self._wrong(what, "Equations are separated by commas." if less else every)
        if row.given:
            for left, right in equations:
                if not (isinstance(left, Symbol) and isinstance(left.key, PortVariable) and not _own(right)):
                    letter, example = ("effort", "F = …") if row.given == "e" else ("flow", "v = …")
                    hint = f"Write `{example}` with what it gives on the right."
                    raise self._wrong(f"The law of the source `{name}` must give its {letter}", hint)
        elif transducer:
            self._check_transducer(equations[0])
        elif all(right != ZERO for _, right in equations):  # a coefficient of zero gives nothing, and will be left out
            self._check_variables([_own(left) | _own(right) for left, right in equations])

    def _check_variables(self, used: list[set[PortVariable]]) -> None:
        """Check that each port has both of its variables in an equation."""
        row, ports = self.row, len(self.ports)
        for port in range(ports - row.gives_heat):
            for variable in row.variables if len(row.stored) < 2 else "":
                wanted = (
                    {PortVariable(port, variable)} if ports == 1 else {PortVariable(port, v) for v in row.variables}
                )
                if not any(wanted & u for u in used):
                    words = {"e": "effort", "f": "flow", "q": "displacement", "p": "momentum"}[variable]
                    what = f"The law of `{self.name}` does not use the {words} of its port{f' number {port + 1}' * (ports > 1)}"
                    hint = "A source gives an effort or flow by itself; C relates e and q, I relates f and p, R relates e and f."
                    raise self._wrong(what, hint)

    def _check_transducer(self, equation: tuple[Expression, Expression]) -> None:
        name, used = self.name, _own(equation[0]) | _own(equation[1])
        pairs = {
            "TF": ({PortVariable(0, "e"), PortVariable(1, "e")}, {PortVariable(0, "f"), PortVariable(1, "f")}),
            "GY": ({PortVariable(0, "e"), PortVariable(1, "f")}, {PortVariable(0, "f"), PortVariable(1, "e")}),
        }
        if used not in pairs[self.kind]:
            usage, sides = "`u1 = K*omega2` or `M2 = K*i1`", "the effort of one side and the flow of the other"
            if self.kind == "TF":
                usage, sides = "`omega1 = 20*omega2` or `M2 = 20*M1`", "two efforts or two flows"
            hint = f"For example {usage}; power gives the other equation."
            raise self._wrong(f"The law of `{name}` must relate {sides}", hint)
        rest = equation[0] - equation[1]
        for own in used:
            parts = affine_parts(rest, Symbol(own))
            if parts is None:
                hint = "A transducer passes power on: one side is a ratio times the other. The ratio may depend on anything else with MTF or MGY."
                raise self._wrong(f"The law of `{name}` is not linear in its variables", hint)
            rest = parts[1]
        if rest != ZERO:
            hint = "It would create energy; put a source beside it."
            raise self._wrong(f"The law of `{name}` has a part that does not vanish with its variables", hint)

    def check_modulation(self, slots: tuple[Slot, ...], role_of: RoleOf) -> None:
        """Check that a law reads changing quantities if its kind has an M, and only then."""
        foreign = ((s, r) for s in slots if (r := role_of(s, self.scope)).role not in STATIC_ROLES)
        changing = [(s, r) for s, r in foreign if not (r.role == "time" and self.row.given)]
        modulated = self.declaration.kind != self.kind
        if modulated and not changing:
            raise Wrong(NeedlessM(self.declaration.span, self.declaration.kind, self.name, self.kind))
        if not modulated and changing:
            slot, role = changing[0]
            hint = f"Say so with an M before the letter: `M{self.kind} {self.name}`."
            if self.row.stored:
                hint = (
                    f"A storage depends on its own {self.row.stored_words} and on parameters. What moves it is one of its ports: "
                    f"`{self.kind} {self.name}(…, …)` with a port for `{role.name}`."
                )
            elif self.row.remembered:
                hint = "Its law reads its own variables and parameters. An MR reads others, also a signal `integral(rate, start)`."
            raise Wrong(ForeignVariable(slot.path.span, self.name, slot.words, hint))

    def remembered(self, law: Law) -> tuple[Law, tuple[str, ...]]:
        """The law with its own integrals as further slots, and these integrals; for a kind whose law may read none, the law as it is."""
        if not self.row.remembered:
            return law, ()
        used = {own.variable for pair in law.equations for side in pair for own in _own(side)}
        found = tuple(v for v in self.row.remembered if v in used)
        if len(self.ports) > 1 or not found:
            several = len(self.ports) > 1
            what = "has more than one port" if several else "reads neither its displacement nor its momentum"
            raise self._wrong(f"`{self.name}` {what}", self.row.ports_advice, self.declaration.span)
        slots = {PortVariable(0, v): Symbol(law.arity + i) for i, v in enumerate(found)}

        def put(symbol: Symbol) -> Expression:
            return slots.get(symbol.key, symbol)

        equations = tuple((substitute(left, put), substitute(right, put)) for left, right in law.equations)
        return Law(equations, None, law.arity + len(found)), found

    def stored(self, law: Law) -> tuple[str, ...]:
        """Stored quantity of each port of a storage. For an IC, the one of the two that its law uses."""
        stored = self.row.stored
        if len(stored) < 2:
            return (stored,) * len(self.ports) if stored else ()
        sides = [*(side for equation in law.equations for side in equation), *([law.energy] if law.energy is not None else [])]  # fmt: skip
        used = {own for side in sides for own in _own(side)}
        found = []
        for number, port in enumerate(self.ports):
            variables = [v for v in "qp" if PortVariable(number, v) in used]
            if len(variables) != 1:
                one, two = "its displacement", "its momentum"
                what = f"both {one} and {two}" if variables else f"neither {one} nor {two}"
                hint = f"A port of an IC stores one of them: write `{port}.q` or `{port}.p`."
                raise self._wrong(f"The law of `{self.name}` uses, of its port `{port}`, {what}", hint)
            found += variables
        return tuple(found)
