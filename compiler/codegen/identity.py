"""Identity of a program's equations: one digest of all that moves states. Equal for texts that differ only in comments and order."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

from ..algebra.expression import Expression, Number, Symbol
from .limits import Leaf
from .lowered import Lowered
from .order import operations_in_order

COMMUTES = frozenset({"add", "multiply", "min", "max", "and", "or", "equal"})


def identity(lowered: Lowered) -> str:
    """Digest of the rates and of the effects of events, over the author's names. Parameters enter by name, not by value."""
    space, events = lowered.space, lowered.events
    moving = [*(s.variable for s in space.states), *(u.variable for u in space.unknowns)]
    names = [space.variables[v].name for v in moving]
    rows = list(zip(names, lowered.rates, strict=True))
    rows += [(f"when {i}", x) for i, x in enumerate((*events.triggers, *events.values, *events.targets))]
    rows += [(f"active {name}", x) for (name, _), x in zip(events.junctions, events.actives, strict=True)]
    rows += [(f"every {i}", x) for i, x in enumerate(events.sampling)]
    rows += [(f"delay {i}", x) for i, x in enumerate((*lowered.delayed, *lowered.lags))]
    leaves = {
        "parameter": [space.variables[v].name for v in lowered.parameters],
        "input": [space.variables[v].name for v in lowered.inputs],
        "state": names,
    }
    digests = _digests([x for _, x in rows], leaves)
    told = sorted(name.encode("utf-8", "surrogatepass") + b"\0" + d for (name, _), d in zip(rows, digests, strict=True))
    return hashlib.sha256(b"\n".join(told)).hexdigest()


def _digests(roots: Sequence[Expression], leaves: Mapping[str, Sequence[str]]) -> list[bytes]:
    known: dict[Expression, bytes] = {}

    def of(node: Expression) -> bytes:
        found = known.get(node)
        if found is None:  # no operation: those have their operands before them
            found = hashlib.sha256(_leaf(node, leaves).encode("utf-8", "surrogatepass")).digest()
            known[node] = found
        return found

    for node in operations_in_order(roots, {}):
        parts = [of(operand) for operand in node.operands]
        if node.operator in COMMUTES:
            parts.sort()
        known[node] = hashlib.sha256(b"\0".join([node.operator.encode(), *parts])).digest()
    return [of(root) for root in roots]


def _leaf(node: Expression, leaves: Mapping[str, Sequence[str]]) -> str:
    if isinstance(node, Number):
        return repr(node.value)
    assert isinstance(node, Symbol) and isinstance(node.key, Leaf)
    role, place = node.key
    return f"{role} {leaves[role][place] if role in leaves else place}"
