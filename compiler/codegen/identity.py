"""Whether two programs solve the same equations: one number for all that moves states, whatever the text, its comments and its order."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

from ..algebra.expression import Apply, Expression, Number, Symbol
from .limits import Leaf
from .lower import Lowered

COMMUTES = frozenset({"add", "multiply", "min", "max", "and", "or", "equal"})


def identity(lowered: Lowered) -> str:
    """A digest of the rates and of what events do, over the author's names; parameters by their names, not by their values."""
    space, events = lowered.space, lowered.events
    moving = [*(s.variable for s in space.states), *(u.variable for u in space.unknowns)]
    names = [space.variables[v].name for v in moving]
    rows = list(zip(names, lowered.rates, strict=True))
    rows += [(f"when {i}", x) for i, x in enumerate((*events.triggers, *events.values, *events.targets))]
    rows += [(f"active {name}", x) for (name, _), x in zip(events.junctions, events.actives, strict=True)]
    rows += [(f"every {i}", x) for i, x in enumerate(events.periods)]
    rows += [(f"delay {i}", x) for i, x in enumerate((*lowered.delayed, *lowered.lags))]
    known: dict[Expression, bytes] = {}
    leaves = {
        "parameter": [space.variables[v].name for v in lowered.parameters],
        "input": [space.variables[v].name for v in lowered.inputs],
        "state": names,
    }
    told = sorted(name.encode("utf-8", "surrogatepass") + b"\0" + _digest(x, known, leaves) for name, x in rows)
    return hashlib.sha256(b"\n".join(told)).hexdigest()


def _digest(x: Expression, known: dict[Expression, bytes], leaves: Mapping[str, Sequence[str]]) -> bytes:
    stack = [x]
    while stack:
        node = stack[-1]
        if node in known:
            stack.pop()
            continue
        if isinstance(node, Apply):
            missing = [o for o in node.operands if o not in known]
            if missing:
                stack += missing
                continue
            parts = [known[o] for o in node.operands]
            if node.operator in COMMUTES:
                parts.sort()
            known[node] = hashlib.sha256(b"\0".join([node.operator.encode(), *parts])).digest()
        else:
            known[node] = hashlib.sha256(_leaf(node, leaves).encode("utf-8", "surrogatepass")).digest()
        stack.pop()
    return known[x]


def _leaf(node: Expression, leaves: Mapping[str, Sequence[str]]) -> str:
    if isinstance(node, Number):
        return repr(node.value)
    assert isinstance(node, Symbol) and isinstance(node.key, Leaf)
    role, place = node.key
    return f"{role} {leaves[role][place] if role in leaves else place}"
