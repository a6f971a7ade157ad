"""Equations in the order of computation: each unknown is matched with an equation, rings of them are solved together.

Of all perfect matchings that with the least weight is taken: equations that give their unknown as they stand are light, those that must be solved heavy.
A model whose derivatives are constrained has none, and is refused: no index is reduced.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching, min_weight_full_bipartite_matching

from compiler.api import blocks, printable

from .normal_form import MAXIMUM_PARTS, NormalForm, Pair
from .parse import MAXIMUM_HEIGHT, FlatModel
from .tree import ZERO, Term, named, names_in, rebuilt, walk

GIVEN, SOLVABLE, IMPLICIT = 1, 4, 16  # weights of an unknown in an equation
MANY = 100  # unknowns of one equation
INDEX = "Import reduces no index: let the tool that flattens do it, or model the part as a mechanism."


@dataclass(slots=True)
class SortedSystem:
    """Definitions by name, in the order of computation, and rings: names with the equations that are solved for them."""

    definitions: dict[str, Term] = field(default_factory=dict)
    rings: list[tuple[list[str], list[Pair]]] = field(default_factory=list)
    solved: set[str] = field(default_factory=set)


def sort_equations(model: FlatModel, form: NormalForm) -> SortedSystem:
    """Return the equations in order. Raises `CompilationFailed`."""
    unknowns = [f"der({name})" for name in form.states]
    decided = form.states.keys() | form.modes.keys() | form.samples.keys()
    unknowns += [n for n, item in model.declared.items() if not item.is_given and n not in decided]
    truths = {n for n, item in model.declared.items() if item.kind == "Boolean"}
    matched = _match(unknowns, truths, model, form)
    numbers = {unknowns[unknown]: row for row, unknown in enumerate(matched)}
    reads = [sorted({numbers[n] for n in names_in(left, right) if n in numbers}) for left, right, _ in form.pairs]
    system = SortedSystem()
    for block in blocks(range(len(reads)), reads):
        names, pairs = list[str](), list[Pair]()
        for row in block:
            name, pair = unknowns[matched[row]], form.pairs[row]
            term = isolated(name, pair) if len(block) == 1 or name in truths else None
            if term is not None:
                system.definitions[name] = term
            else:
                names.append(name)
                pairs.append(pair)
        if names:
            system.rings.append((names, pairs))
            system.solved.update(names)
    return system


def _weights(pair: Pair, numbers: Mapping[str, int], truths: set[str]) -> dict[int, int]:
    """Return the weight of each unknown of an equation. A truth is given by an equation as it stands, or by another one."""
    weights = {}
    counts = Counter(t.word for side in pair[:2] for t in walk(side) if t.kind == "name" and t.word in numbers)
    for name, count in counts.items():
        if count == 1 and named(name) in pair[:2]:
            weights[numbers[name]] = GIVEN
        elif name not in truths:
            is_long = len(counts) > MANY
            weights[numbers[name]] = IMPLICIT if not is_long and isolated(name, pair) is None else SOLVABLE
    return weights


def _match(unknowns: Sequence[str], truths: set[str], model: FlatModel, form: NormalForm) -> list[int]:
    """Return the unknown of each equation. Raises `CompilationFailed` where there are too many or too few."""
    numbers = {name: i for i, name in enumerate(unknowns)}
    rows = [_weights(pair, numbers, truths) for pair in form.pairs]
    places = np.array([i for row in rows for i in row], dtype=np.int32)
    data = np.array([w for row in rows for w in row.values()], dtype=float)
    starts = np.cumsum([0, *map(len, rows)]).astype(np.int32)
    table = csr_array((data, places, starts), shape=(len(rows), len(unknowns)))
    partner = [-1] * len(rows)
    if len(places):
        partner = maximum_bipartite_matching(table, perm_type="column").tolist()
    if len(rows) == len(unknowns) and min(partner, default=0) >= 0:
        return min_weight_full_bipartite_matching(table)[1].tolist() if rows else []
    owner = {unknown: row for row, unknown in enumerate(partner) if unknown >= 0}
    constrained = False
    for row in (i for i, unknown in enumerate(partner) if unknown < 0):
        reached, stack = {row}, [row]  # equations that compete for the same unknowns
        while stack:
            new = {owner[u] for u in rows[stack.pop()] if u in owner} - reached
            reached |= new
            stack += new
        names = set().union(*(names_in(*form.pairs[i][:2]) for i in reached))
        states = ", ".join(f"`{printable(n)}`" for n in [n for n in form.states if n in names][:6])
        what = f"equations constrain {states}, whose derivatives are in the model" if states else "this equation is one too many"  # fmt: skip
        model.refuse(form.pairs[row][2], what, INDEX if states else "Others give all that it could give.")
        constrained = constrained or bool(states)
    for name in [] if constrained else [n for n, i in numbers.items() if i not in owner]:
        item = model.declared.get(name) or model.declared[name[4:-1]]
        model.refuse(
            item.place, f"no equation is left that gives `{printable(name)}`", "Each variable needs one equation."
        )
    model.stop()
    return []


def isolated(name: str, pair: Pair) -> Term | None:
    """Return what a name is by an equation in which it stands once, or None."""
    own = named(name)
    left, right = pair[:2] if own in walk(pair[0]) else (pair[1], pair[0])
    if own in walk(right) or own not in walk(left):
        return None
    while left != own:
        inside = [i for i, part in enumerate(left.parts) if own in walk(part)]
        if len(inside) != 1 or left.kind not in ("sum", "product"):
            return None
        first, other = ("+", "-") if left.kind == "sum" else ("*", "/")
        items = [(s, t) for i, (s, t) in enumerate(zip(left.word, left.parts, strict=True)) if i != inside[0]]
        if left.word[inside[0]] == first:  # right = own + rest
            items = [(first, right), *((other if s == first else first, t) for s, t in items)]
        else:  # right = rest - own
            items.append((other, right))
        right = _simple(left.kind, [(s, t) for s, t in items if t != ZERO or left.kind == "product"])
        left = left.parts[inside[0]]
    return right


def _simple(kind: str, items: list[tuple[str, Term]]) -> Term:
    """Return a sum or product of signed terms."""
    first = "+" if kind == "sum" else "*"
    if not items:
        return ZERO
    if items[0][0] == "/":
        items.insert(0, ("*", Term("number", "1")))
    return items[0][1] if items[0][0] == first and len(items) == 1 else Term(kind, "".join(s for s, _ in items), tuple(t for _, t in items))  # fmt: skip


def inlined(term: Term, system: SortedSystem, into: Mapping[str, Term]) -> Term | None:
    """Return a term with definitions, and the terms of `into`, in the place of names; None if a ring gives one of them, or it would be too long."""
    left = MAXIMUM_PARTS

    def put(term: Term, depth: int) -> Term:
        nonlocal left
        left -= 1
        if left < 0 or depth > MAXIMUM_HEIGHT or term.word in system.solved:
            raise OverflowError
        if term.kind == "name":
            value, definition = into.get(term.word), system.definitions.get(term.word)
            return value if value is not None else term if definition is None else put(definition, depth + 1)
        return rebuilt(term, lambda part: put(part, depth + 1))

    try:
        return put(term, 0)
    except OverflowError:
        return None
