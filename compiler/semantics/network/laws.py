"""Laws of elements: their own variables separated from the quantities they read, their form checked for their kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from ...algebra.expression import ZERO, Expression, Symbol, add, divide, multiply, substitute, symbols
from ...algebra.odd_roots import with_odd_roots
from ...graph.domains import Domain
from ...graph.elements import ELEMENTS
from ...graph.network import Law, Own
from ...graph.units import JOULE
from ...source import Span
from ...syntax import tree
from ..expressions.expression_compiler import ExpressionCompiler
from ..expressions.template import CompiledLaw, OwnVariable, Resolve, Slot
from ..names.domain_table import paths_of
from ..names.errors import DimensionMismatch, ForeignVariable, NameClash, NeedlessM, WrongLaw
from ..names.scope import STATIC_ROLES, Scalar, Scope
from ..names.statement_errors import Wrong, describe
from .transducers import check_many_ports

# Function from a slot's path and a scope to a scalar with its role.
RoleOf = Callable[[Slot, Scope], Scalar]


def _wrong(span: Span, what: str, hint: str) -> Wrong:
    return Wrong(WrongLaw(span, what, hint))


def own_variables(kind: str, ports: Mapping[str, Domain], variables: str) -> dict[str, OwnVariable]:
    """Map from each way in which a law may write its own variables to the variable."""
    own: dict[str, OwnVariable] = {}
    for number, (port, domain) in enumerate(ports.items()):
        for variable in variables:
            found = OwnVariable(Own(number, variable), domain.dimension(variable))
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


def compile_law(
    declaration: tree.Declaration,
    name: str,
    ports: Mapping[str, Domain],
    scope: Scope,
    resolve: Resolve,
    role_of: RoleOf,
) -> CompiledLaw:
    """Compile the law of one declared element. Raises `Wrong`."""
    definition = declaration.definition
    row = ELEMENTS[declaration.kind]
    kind = row.letters
    if not isinstance(definition, tree.LawSyntax):
        raise _wrong(
            declaration.span,
            f"`{declaration.kind} {name}` has no law",
            f"Write it after a colon, as in `{declaration.kind} {name} : {row.example}`.",
        )
    own = own_variables(kind, ports, row.variables + row.remembered)
    forbidden = own_variables(kind, ports, "".join(v for v in "efqp" if v not in row.variables + row.remembered))
    _check_names(declaration, name, own, forbidden, scope, resolve)
    compiler = ExpressionCompiler(scope, resolve, own)
    energy: Expression | None = None
    equations: list[tuple[Expression, Expression]] = []
    first = definition.equations[0].left
    if isinstance(first, tree.PathSyntax) and first.words == "energy":
        energy = _energy(definition, kind, declaration, name, compiler, ports, scope)
    else:
        for equation in definition.equations:
            left, right = compiler.scalar(equation.left), compiler.scalar(equation.right)
            if left.dimension is not None and right.dimension is not None and left.dimension != right.dimension:
                missing = left.dimension / right.dimension
                hint = (
                    f"What is missing is a factor in [{missing}]: a number needs its unit, `2 [{missing}]`; "
                    "a parameter's unit stands where it is declared."
                )
                raise Wrong(
                    DimensionMismatch(
                        equation.span,
                        f"The two sides of the law of `{name}` differ: `{equation.left.span.text}` is "
                        f"{describe(left.dimension)}, but `{equation.right.span.text}` is {describe(right.dimension)}",
                        hint,
                    )
                )
            equations.append((with_odd_roots(left.expression), with_odd_roots(right.expression)))
        _check_form(declaration, kind, name, equations, list(ports))
    slots = tuple(compiler.slot_list)
    _check_modulation(declaration, kind, name, slots, scope, role_of, energy is not None)
    if row.gives_heat:
        equations.append(_heat(len(ports)))
    law, remembered = _remembered(declaration, name, Law(tuple(equations), energy, len(slots)), len(ports))
    stored = _stored(kind, name, law, list(ports), definition.span)
    return CompiledLaw(law, slots, stored, remembered, tuple(compiler.checks), tuple(compiler.lists.values()))


def _remembered(declaration: tree.Declaration, name: str, law: Law, ports: int) -> tuple[Law, tuple[str, ...]]:
    """The law with its own integrals as further slots, and these integrals; for a kind whose law may read none, the law as it is."""
    row = ELEMENTS[declaration.kind]
    if not row.remembered:
        return law, ()
    used = {own.variable for pair in law.equations for side in pair for own in _own(side)}
    found = tuple(v for v in row.remembered if v in used)
    if ports > 1 or not found:
        what = "has more than one port" if ports > 1 else "reads neither its displacement nor its momentum"
        raise _wrong(declaration.span, f"`{name}` {what}", row.ports_advice)
    slots = {Own(0, v): Symbol(law.arity + i) for i, v in enumerate(found)}

    def put(symbol: Symbol) -> Expression:
        return slots.get(symbol.key, symbol)

    equations = tuple((substitute(left, put), substitute(right, put)) for left, right in law.equations)
    return Law(equations, None, law.arity + len(found)), found


def _heat(ports: int) -> tuple[Expression, Expression]:
    """Law of the last port of an RS: its flow is the power that the other ports take, divided by its effort."""
    power = add(*(multiply(Symbol(Own(p, "e")), Symbol(Own(p, "f"))) for p in range(ports - 1)))
    return Symbol(Own(ports - 1, "f")), divide(power, Symbol(Own(ports - 1, "e")))


def _stored(kind: str, name: str, law: Law, ports: list[str], span: Span) -> tuple[str, ...]:
    """Stored quantity of each port of a storage. For an IC, the one of the two that its law uses."""
    stored = ELEMENTS[kind].stored
    if len(stored) < 2:
        return (stored,) * len(ports) if stored else ()
    sides = [side for equation in law.equations for side in equation] + ([law.energy] if law.energy is not None else [])
    used = {own for side in sides for own in _own(side)}
    found = []
    for number, port in enumerate(ports):
        variables = [v for v in "qp" if Own(number, v) in used]
        if len(variables) != 1:
            what = (
                "both its displacement and its momentum" if variables else "neither its displacement nor its momentum"
            )
            hint = f"A port of an IC stores one of them: write `{port}.q` or `{port}.p`."
            raise _wrong(span, f"The law of `{name}` uses, of its port `{port}`, {what}", hint)
        found += variables
    return tuple(found)


def _energy(
    definition: tree.LawSyntax,
    kind: str,
    declaration: tree.Declaration,
    name: str,
    compiler: ExpressionCompiler,
    ports: Mapping[str, Domain],
    scope: Scope,
) -> Expression:
    row = ELEMENTS[kind]
    if not row.stored:
        raise _wrong(
            definition.span,
            f"`{name}` is {declaration.kind}: only C, I and IC store energy",
            "Write its law as an equation.",
        )
    if len(definition.equations) != 1:
        raise _wrong(
            definition.span, f"`{name}` has an energy and further equations", "The energy alone gives all efforts."
        )
    typed = compiler.scalar(definition.equations[0].right)
    for symbol in symbols(typed.expression):
        if isinstance(symbol.key, Own) and symbol.key.variable not in row.stored:
            raise _wrong(
                definition.span,
                f"The energy of `{name}` reads `{symbol.key.variable}`",
                f"An energy is a function of what is stored, its {row.stored_words}, alone.",
            )
    if all(d.has_power for d in ports.values()) and typed.dimension not in (None, JOULE):
        raise Wrong(
            DimensionMismatch(
                definition.span, f"The energy of `{name}` must be in [N*m], but it is {describe(typed.dimension)}", ""
            )
        )
    if not any(isinstance(s.key, Own) for s in symbols(typed.expression)):
        raise _wrong(
            definition.span,
            f"The energy of `{name}` does not depend on its own {row.stored_words}",
            "It would give no effort.",
        )
    return typed.expression


def _check_names(
    declaration: tree.Declaration,
    name: str,
    own: Mapping[str, OwnVariable],
    forbidden: Mapping[str, OwnVariable],
    scope: Scope,
    resolve: Resolve,
) -> None:
    row = ELEMENTS[declaration.kind]
    assert isinstance(declaration.definition, tree.LawSyntax)
    for path in paths_of(declaration.definition):
        words = path.words
        if words in own and not path.steps and scope.find(words) is not None and words != name:
            role = getattr(scope.find(words), "role", "")
            if role not in ("parameter", "constant", "input", "signal", "mode", "index"):
                continue  # not a number, or an output, which a law does not read
            variable = own[words].own
            generic = words if row.sides else variable.variable
            raise Wrong(NameClash(path.span, words, name, str(role), generic))
        if words in forbidden and scope.find(path.head) is None:
            raise _wrong(
                path.span,
                f"The law of `{declaration.kind} {name}` uses `{words}`; {row.letters} relates {row.relates}",
                row.advice.format(words),
            )


def _own(x: Expression) -> set[Own]:
    return {s.key for s in symbols(x) if isinstance(s.key, Own)}


def _check_form(
    declaration: tree.Declaration,
    kind: str,
    name: str,
    equations: list[tuple[Expression, Expression]],
    names: list[str],
) -> None:
    ports = len(names)
    span = declaration.definition.span if declaration.definition else declaration.span
    row = ELEMENTS[kind]
    transducer = row.group == "transducer"
    if transducer and "1" not in names:
        check_many_ports(kind, name, equations, ports, span)
        return
    expected = 1 if transducer else ports - row.gives_heat
    if len(equations) != expected:
        raise _wrong(
            span,
            f"`{name}` has {len(equations)} equation{'s' * (len(equations) != 1)}; {kind} with {ports} port{'s' * (ports != 1)} needs {expected}",
            "Equations are separated by commas."
            if len(equations) < expected
            else "One equation for each port says it all; leave the others out.",
        )
    used = [_own(left) | _own(right) for left, right in equations]
    if row.given:
        for (left, right), _ in zip(equations, used, strict=True):
            if not (isinstance(left, Symbol) and isinstance(left.key, Own) and not _own(right)):
                letter = "effort" if row.given == "e" else "flow"
                raise _wrong(
                    span,
                    f"The law of the source `{name}` must give its {letter}",
                    f"Write `{'F = …' if row.given == 'e' else 'v = …'}` with what it gives on the right.",
                )
        return
    if transducer:
        _check_transducer(kind, name, equations[0], used[0], span)
        return
    if any(right == ZERO for _, right in equations):
        return  # a coefficient of zero: the element gives nothing, and will be left out
    for port in range(ports - row.gives_heat):
        for variable in row.variables if len(row.stored) < 2 else "":
            wanted = {Own(port, variable)} if ports == 1 else {Own(port, v) for v in row.variables}
            if not any(wanted & u for u in used):
                words = {"e": "effort", "f": "flow", "q": "displacement", "p": "momentum"}[variable]
                raise _wrong(
                    span,
                    f"The law of `{name}` does not use the {words} of its port{f' number {port + 1}' * (ports > 1)}",
                    "A source gives an effort or flow by itself; C relates e and q, I relates f and p, R relates e and f.",
                )


def _check_transducer(
    kind: str, name: str, equation: tuple[Expression, Expression], used: set[Own], span: Span
) -> None:
    from ...algebra.affine import affine_parts

    pairs = {
        "TF": ({Own(0, "e"), Own(1, "e")}, {Own(0, "f"), Own(1, "f")}),
        "GY": ({Own(0, "e"), Own(1, "f")}, {Own(0, "f"), Own(1, "e")}),
    }
    if used not in pairs[kind]:
        usage = "`omega1 = 20*omega2` or `M2 = 20*M1`" if kind == "TF" else "`u1 = K*omega2` or `M2 = K*i1`"
        raise _wrong(
            span,
            f"The law of `{name}` must relate {'two efforts or two flows' if kind == 'TF' else 'the effort of one side and the flow of the other'}",
            f"For example {usage}; power gives the other equation.",
        )
    rest = equation[0] - equation[1]
    for own in used:
        parts = affine_parts(rest, Symbol(own))
        if parts is None:
            raise _wrong(
                span,
                f"The law of `{name}` is not linear in its variables",
                "A transducer passes power on: one side is a ratio times the other. The ratio may depend on anything else with MTF or MGY.",
            )
        rest = parts[1]
    if rest != ZERO:
        raise _wrong(
            span,
            f"The law of `{name}` has a part that does not vanish with its variables",
            "It would create energy; put a source beside it.",
        )


def _check_modulation(
    declaration: tree.Declaration,
    kind: str,
    name: str,
    slots: tuple[Slot, ...],
    scope: Scope,
    role_of: RoleOf,
    energy: bool,
) -> None:
    modulated = declaration.kind != kind
    foreign: Iterator[tuple[Slot, Scalar]] = (
        (s, r) for s in slots if (r := role_of(s, scope)).role not in STATIC_ROLES
    )
    changing = [(s, r) for s, r in foreign if not (r.role == "time" and ELEMENTS[kind].given)]
    if modulated and not changing:
        raise Wrong(NeedlessM(declaration.span, declaration.kind, name, kind))
    if not modulated and changing:
        slot, role = changing[0]
        if ELEMENTS[kind].stored:
            what = ELEMENTS[kind].stored_words
            hint = (
                f"A storage depends on its own {what} and on parameters. What moves it is one of its ports: "
                f"`{kind} {name}(…, …)` with a port for `{role.name}`."
            )
        else:
            hint = f"Say so with an M before the letter: `M{kind} {name}`."
            if ELEMENTS[kind].remembered:
                hint = "Its law reads its own variables and parameters. An MR reads others, also a signal `integral(rate, start)`."
        raise Wrong(ForeignVariable(slot.path.span, name, slot.words, hint))
